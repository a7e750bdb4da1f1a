"""Names and units of a controller against those of a parameter file."""

from __future__ import annotations

import re
from collections.abc import Collection, Container, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from pathlib import PurePath
from typing import Any, Literal

import numpy as np

from ..block import Block
from ..errors import closest
from ..export.flat import flatten
from ..export.target import Entry, safe_name
from ..units import SUFFIXES, conversion_factor, is_known_unit, normalise_unit, same_dimension
from .read import Key
from .values import differing, is_computed, literals_in

# Words behind a name that say a unit, the longest first: a macro has no small letters.
_SUFFIXES = {
    suffix.lower(): unit for suffix, unit in sorted(SUFFIXES.items(), key=lambda p: -len(p[0]))
}

_SUGGESTED = 20  # lacking keys that a similar one is sought for

Finding = Literal["agrees", "ignored", "lacking", "other unit", "other value"]


@dataclass(frozen=True)
class Row:
    """One key of the file, the controller, or both.

    Attributes
    ----------
    parameter, consumer
        Its name there; empty where it is missing.
    unit, consumer_unit
        Its unit there; empty where there is none or none is said.
    finding
        ``"ignored"`` is a parameter that the controller does not read, ``"lacking"`` a key that
        the file does not hold. ``"other value"`` is a number that the controller's does not round
        to.
    message
        What is wrong, a whole sentence; empty where nothing is.
    """

    parameter: str
    consumer: str
    unit: str
    consumer_unit: str
    finding: Finding
    message: str = ""


@dataclass(frozen=True)
class Comparison:
    """All keys of a file and a controller.

    ``stale`` says that the controller was exported from another file; empty where it was not, or
    does not say from which.
    """

    rows: tuple[Row, ...]
    stale: str = ""

    @property
    def agrees(self) -> bool:
        """True if the controller reads every parameter, nothing else, in its unit and value."""
        return not self.reasons

    @property
    def reasons(self) -> tuple[str, ...]:
        """Problems, one sentence for each key."""
        return tuple(filter(None, (self.stale, *(row.message for row in self.rows))))

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        keys = [asdict(row) for row in self.rows]
        return {"agrees": self.agrees, "stale": self.stale, "keys": keys}


def compare(
    block: Block, keys: Sequence[Key], path: str = "", *, sha256: str = "",
    exported_from: Collection[str] = (),
) -> Comparison:  # fmt: skip
    """Compare the keys that a controller reads with a parameter file.

    A controller has to read every parameter. What the file says besides (model, options,
    ranges) it may read. Names agree without regard to case, hyphens and dots, to the name of
    the file or its family before them or whatever all keys begin with, and to a unit behind.

    Parameters
    ----------
    block
        The parameter file, loaded.
    keys
        What the controller reads.
    path
        Name of the parameter file.
    sha256, exported_from
        That of the file, and those that the controller names as where it comes from.
    """
    entries = {_plain(entry.key): entry for entry in flatten(block)}
    own = [block.family, *([safe_name(PurePath(path).name)] if path else [])]
    own_prefixes = tuple(f"{_plain(name)}_" for name in own)
    prefixes = (*own_prefixes, *_shared_prefixes(keys))
    rows, read, lacking = list[Row](), set(), 0
    for key in keys:
        name, unit = _find(key, entries, prefixes)
        if name:
            read.add(name)
            rows.append(_compare_key(entries[name], replace(key, unit=unit)))
        elif key.surely or _plain(key.name).startswith(own_prefixes):
            lacking += 1
            rows.append(_lacking(key, entries if lacking <= _SUGGESTED else ()))
    rows += [
        _ignored(entry)
        for name, entry in entries.items()
        if entry.key == entry.parameter and name not in read
    ]
    stale = ""
    if exported_from and sha256 not in exported_from:
        stale = "The controller was exported from another file, or this one has changed since."
    return Comparison(tuple(rows), stale)


def _plain(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_")


def _shared_prefixes(keys: Sequence[Key]) -> Iterator[str]:
    """Prefixes that all keys share, and the ``k`` of constants such as ``kGain``."""
    names = sorted(_plain(key.name).split("_") for key in keys if key.surely)
    if len(names) > 1:
        both = takewhile(lambda words: words[0] == words[1], zip(names[0], names[-1]))
        yield "".join(f"{word}_" for word, _ in both)
    yield "k_"


def _find(key: Key, known: Container[str], prefixes: Sequence[str]) -> tuple[str, str]:
    """Name of the entry that a controller means, empty where there is none, and its unit."""
    whole = _plain(key.name)
    suffix = next((s for s in _SUFFIXES if whole.endswith(f"_{s}")), "")
    bare = whole.removesuffix(f"_{suffix}")
    for name, unit in ((whole, key.unit), (bare, key.unit or _SUFFIXES.get(suffix, ""))):
        tried = [name, *(name.removeprefix(prefix) for prefix in prefixes)]
        tried += [t.removeprefix("parameters_") for t in tried]
        if found := next((t for t in tried if t in known), ""):
            return found, unit
    return "", key.unit


def _lacking(key: Key, names: Iterable[str]) -> Row:
    close = closest(_plain(key.name), names)
    hint = f" Is {close} meant?" if close else ""
    message = f"{key.name}: missing in the file.{hint}"
    return Row("", key.name, "", key.unit, "lacking", message)


def _ignored(entry: Entry) -> Row:
    message = f"{entry.key}: the controller does not read it."
    return Row(entry.key, "", entry.unit, "", "ignored", message)


def _compare_key(entry: Entry, key: Key) -> Row:
    """Compare units, and numbers where the controller has any."""
    row, literals = _compare_units(entry, key), literals_in(key.value)
    if row.finding != "agrees" or isinstance(entry.value, bool | str):
        return row
    if is_computed(key.value):
        shown = " ".join(key.value.split())
        why = f"the controller computes it, {shown[:60]}; write the number itself to compare it"
        return replace(row, finding="other value", message=f"{entry.key}: {why}.")
    if literals is None:
        return row
    factor = conversion_factor(entry.unit or "1", key.unit) if key.unit else 1.0
    numbers = np.atleast_1d(np.asarray(entry.value, dtype=float)) * factor
    if numbers.size != len(literals):
        why = f"the controller has {len(literals)} numbers, the file {numbers.size}"
        return replace(row, finding="other value", message=f"{entry.key}: {why}.")
    at = differing(numbers, literals)
    if at is None:
        return row
    which = f" {at + 1}" if numbers.size > 1 else ""
    unit = f" {key.unit or entry.unit}".removesuffix(" 1")
    message = (
        f"{entry.key}: number{which} of the controller is {literals[at].value:.9g}{unit}, that of "
        f"the file {numbers[at]:.9g}{unit}."
    )
    return replace(row, finding="other value", message=message)


def _compare_units(entry: Entry, key: Key) -> Row:
    """Compare units; a controller that does not name one is taken to read that of the file."""
    row = Row(entry.key, key.name, entry.unit, key.unit, "agrees")
    mine, theirs = normalise_unit(entry.unit or "1"), normalise_unit(key.unit)
    if not key.unit or mine == theirs:
        return row
    if not is_known_unit(key.unit):
        why = f"the controller reads {key.unit!r}, which is not known as a unit"
    elif not same_dimension(mine, key.unit):
        why = f"the controller reads {key.unit}, which measures something else"
    else:
        factor = conversion_factor(mine, key.unit)
        if abs(factor - 1.0) < 1e-12:
            return row
        why = f"the controller reads {key.unit}: {factor:.6g} times the number in the file"
    message = f"{entry.key} is in {entry.unit or '1'}; {why}."
    return Row(entry.key, key.name, entry.unit, key.unit, "other unit", message)
