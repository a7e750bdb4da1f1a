"""Stamps with more digits than double precision holds, as differences to the first of them.

A clock that counts nanoseconds since 1970 has 19 digits, doubles have 16: a step of a microsecond
would be read as 768 or 1024 ns. Subtracted before they become doubles, nothing is lost.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from .layout import Layout

_PLAIN = re.compile(r"[+-]?\d{1,30}(?:\.(\d{1,15}))?", re.ASCII)
_LARGE = 1e9  # below it, doubles hold what loggers print of an instant
_HELD = 1e-3  # of the last digit, within which a double has to be
_WHOLE = 2**53 * _HELD  # beyond it, it is not in another unit
_ROWS = 1000  # that are looked at


class Exact(NamedTuple):
    """Differences of stamps to the first of them, shape ``(n,)``, and this one."""

    since: FloatArray
    first: Decimal


def of_integers(values: npt.NDArray[Any]) -> Exact | None:
    """Differences of whole numbers, ``None`` where nothing is lost without them.

    ``values`` of any kind of number, shape ``(n,)``.
    """
    kept = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    if not kept.size or abs(float(kept[0])) < _WHOLE or (kept.dtype.kind == "f" and _parts(kept)):
        return None
    first, low = int(kept[0]), kept.min()
    if int(kept.max()) - int(low) > 2**53:
        return None
    since: FloatArray = (values - low).astype(np.float64) - float(first - int(low))
    return Exact(since, Decimal(first))


def _parts(values: npt.NDArray[Any]) -> bool:
    """True if doubles hold parts of whole numbers, or whole numbers that they do not resolve."""
    return bool(np.abs(values).max() > 2**53 or (values != np.round(values)).any())


def of_objects(values: Sequence[Any]) -> Exact | None:
    """The same of Python's whole numbers, some of which may be missing."""
    known = [v for v in values if isinstance(v, int) and not isinstance(v, bool)]
    if not known or abs(known[0]) < _WHOLE or max(known) - min(known) > 2**53:
        return None
    since = [float(v - known[0]) if isinstance(v, int) else np.nan for v in values]
    return Exact(np.array(since), Decimal(known[0]))


def loses(cells: Sequence[str], values: FloatArray, decimal: str) -> bool:
    """Return whether the first of a column of stamps have digits that doubles do not hold."""
    known = np.flatnonzero(np.isfinite(values[:_ROWS])).tolist()
    if not known or abs(float(values[known[0]])) < _LARGE:
        return False
    texts = [cells[k].strip().replace(decimal, ".") for k in known]
    found = [_PLAIN.fullmatch(text) for text in texts]
    digits = max((len(m[1] or "") for m in found if m), default=0)
    spacing = float(np.spacing(abs(values[known[0]])))
    return None not in found and spacing > _HELD * 10.0**-digits


def of_cells(cells: Sequence[str], values: FloatArray, layout: Layout) -> Exact | None:
    """Differences to the first of a column of stamps, ``None`` where doubles hold them."""
    if layout.thousands or not loses(cells, values, layout.decimal):
        return None
    at = np.flatnonzero(np.isfinite(values)).tolist()
    texts = [cells[k].strip().replace(layout.decimal, ".") for k in at]
    if not all(map(_PLAIN.fullmatch, texts)):
        return None
    first = Decimal(texts[0])
    since = np.full(values.size, np.nan)
    whole = all("." not in text for text in texts)
    begin = int(first) if whole else 0
    since[at] = [int(t) - begin if whole else float(Decimal(t) - first) for t in texts]
    return Exact(since, first)
