"""A figure of the table: what was seen, what it should be, how much of a change is noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SHARE = 0.1  # of a standard error: a change below it is noise
ALLOWED = 4.0  # standard errors between an estimate and the truth


@dataclass(frozen=True)
class Figure:
    """One row.

    Attributes
    ----------
    group, row, what
        Group of rows that run together, name of the row (unique), what is measured.
    reference
        Truth, published value or aim, in words.
    seen
        The figure, in SI or the unit that ``what`` names; a word where there is no number
        (``"did not end in 120 s"``, ``"not identified"``) or where the row is about words.
    aim
        ``"low"`` or ``"high"``: that way is better. ``"stay"``: it must not change. A number:
        the nearer the better.
    noise
        How much worse is still the same.
    spread
        Standard error, of an estimate.
    limit
        Badness (see :meth:`badness`) beyond which the figure is wrong, whatever is committed.
    wanted
        The right words, of a row of words.
    """

    group: str
    row: str
    what: str
    reference: str
    seen: float | str
    aim: float | str = "stay"
    noise: float = 0.0
    spread: float | None = None
    limit: float | None = None
    wanted: str | None = None

    def badness(self, value: float, committed: float | None = None) -> float:
        """How bad a value is: itself, its negative, or its distance from the aim."""
        if self.aim == "low":
            return value
        if self.aim == "high":
            return -value
        if self.aim == "stay":
            return 0.0 if committed is None else abs(value - committed)
        return abs(value - float(self.aim))

    @property
    def wrong(self) -> bool:
        """Whether it misses its reference, however long it has done so."""
        if isinstance(self.seen, str):
            return self.seen != self.wanted if self.wanted else self.aim != "stay"
        return self.limit is not None and self.badness(self.seen) > self.limit

    def text(self) -> str:
        """The figure as it stands in the table."""
        if isinstance(self.seen, str):
            return self.seen
        if self.spread is None:
            return f"{self.seen:.{self._digits(self.seen)}g}"
        if isinstance(self.aim, str):
            return f"{self.seen:.5g} ± {self.spread:.2g}"
        return f"{self.seen:.6g} ({(self.seen - self.aim) / self.spread:+.2f} se)"

    def _digits(self, value: float) -> int:
        """So many that the noise can be seen, five at least."""
        if not self.noise or not value:
            return 5
        return max(5, 1 + math.ceil(math.log10(abs(value) / self.noise)))

    def noise_text(self) -> str:
        """The noise as it stands in the table."""
        if self.aim == "stay" and self.noise == 0.0:
            return "none"
        return f"{SHARE:g} se" if self.spread is not None else f"{self.noise:.2g}"


def words(
    group: str, row: str, what: str, seen: str, wanted: str | None = None, reference: str = ""
) -> Figure:
    """Row of words: equal to what is wanted, or else to what is committed."""
    return Figure(group, row, what, reference or wanted or "-", seen, wanted=wanted)


def number(
    group: str, row: str, what: str, reference: str, seen: float | str, aim: float | str,
    *, noise: float | None = None, share: float = 0.0, limit: float | None = None,
) -> Figure:  # fmt: skip
    """Row of a number without standard error; the noise absolute, or a share of the number."""
    if isinstance(seen, float) and not math.isfinite(seen):
        seen = str(seen)
    if noise is None:
        noise = 0.0 if isinstance(seen, str) else share * abs(seen)
    return Figure(group, row, what, reference, seen, aim, noise, limit=limit)


def parameter(
    group: str, row: str, file: Mapping[str, Any] | None, key: str, missing: str,
    *, truth: float | None = None, aim: float | str = "stay", reference: str = "-",
    limit: float | None = None,
) -> Figure:  # fmt: skip
    """Row of a parameter or derived value of a file, with its standard error.

    ``missing`` is the word for a file that is not there. A ``truth`` is the aim, to be met
    within :data:`ALLOWED` standard errors.
    """
    if truth is not None:
        aim, reference = truth, f"truth {truth:.6g}"
    found = quantity(file, key)
    unit = found.get("unit", "")
    what = f"{key} [{unit}]" if unit not in ("", "1") else key
    value, error = found.get("value"), found.get("std_error")
    if found.get("status") == "not_identified":
        return Figure(group, row, what, reference, "not identified", aim)
    if value is None or error is None:
        word = missing if file is None else "no value with a standard error"
        return Figure(group, row, what, reference, word, aim)
    spread = float(error)
    if truth is not None:
        limit = ALLOWED * spread
    return Figure(group, row, what, reference, float(value), aim, SHARE * spread, spread, limit)


def quantity(file: Mapping[str, Any] | None, key: str) -> Mapping[str, Any]:
    """Entry of a parameter or derived value; empty when it is not there."""
    for section in ("parameters", "derived"):
        found = ((file or {}).get(section) or {}).get(key)
        if isinstance(found, dict):
            return found
    return {}


def value(file: Mapping[str, Any] | None, key: str, missing: str) -> float | str:
    """Value alone, or the word for why there is none."""
    found = quantity(file, key)
    if found.get("status") == "not_identified":
        return "not identified"
    if found.get("value") is None:
        return missing if file is None else "no value"
    return float(found["value"])


def rmse(file: Mapping[str, Any] | None, missing: str) -> float | str:
    """Root mean square of the residuals over all fitted logs [SI]."""
    return missing if file is None else float(file["fit"]["rmse"]["value"])


def codes(file: Mapping[str, Any] | None, missing: str) -> str:
    """Warning codes of a file, each once, in order."""
    if file is None:
        return missing
    return " ".join(sorted({w["code"] for w in file["warnings"]})) or "none"
