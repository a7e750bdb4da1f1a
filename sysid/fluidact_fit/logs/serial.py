"""Captures of the serial output of microcontrollers.

The monitor of the Arduino IDE writes ``HH:MM:SS.mmm -> `` before every line, and sketches for its
plotter ``name:value`` for every value; other programs write ``name=value``, in any order, and a
time before them. A capture begins in the middle of a line, and holds what the sketch says when it
starts again.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from .layout import Cut

_ARROW = re.compile(
    r"\s*\[?((?:\d{4}-\d\d-\d\d[T ])?\d{1,2}:\d\d:\d\d(?:[.,]\d+)?Z?)\]?\s*"
    r"(?:->\s?|(?=[^\W\d]\w{0,40}=))"
)
_NUMBER = r"[+-]?(?:\d+(?:[.,]\d+|\.)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|ovf)(?!\w)"
_PAIR = re.compile(
    rf"\s*(?P<name>[^\W\d][^:=\t;,|]*+)\s*+[:=]\s*(?P<value>{_NUMBER})"
    r"(?:\s?(?P<unit>[^\W\d][\w/²³]*|[%°µ][\w/²³]*))?\s*(?:[\t;,|]|(?<=\s)|$)",
    re.IGNORECASE,
)
_WORD = re.compile(
    r"\s*(?P<name>[^\W\d][^:=\t;,|\s]*)=(?P<value>\"[^\"]*\"|[^\s;,|=\"]*)\s*(?:[;,|]|(?<=\s)|$)"
)
_USUAL = 0.05  # share of the lines, from which on other names are no damage


@dataclass(frozen=True)
class Capture:
    """Text that a capture writes around its values.

    ``arrow`` says whether a clock stands before the lines; ``names`` are those before the values,
    each with the unit behind it, empty without names. A line has those of one of the ``usual``
    sets, in any order.
    """

    arrow: bool
    names: tuple[str, ...]
    usual: frozenset[frozenset[str]] = frozenset()

    def values(self, lines: Iterable[str]) -> list[str]:
        """The lines of this form without clock and names; values of names between tabs."""
        parts = map(self._take_apart, lines)
        return [values for _, values in filter(None, parts)]

    def around(self, cut: Cut) -> Cut:
        """Derive the rule that cuts whole lines from the one that cuts their values."""
        return replace(
            cut, width=cut.width + self.arrow, tidy=partial(self._tidy, delimiter=cut.delimiter)
        )

    def _tidy(self, line: str, delimiter: str) -> str | None:
        parts = self._take_apart(line)
        if parts is None:
            return None
        return delimiter.join(parts) if self.arrow else parts[1]

    def _take_apart(self, line: str) -> tuple[str, str] | None:
        """Clock and values of a line, ``None`` where it has another form."""
        clock, rest = "", line
        if self.arrow:
            found = _ARROW.match(line)
            if found is None:
                return None
            clock, rest = found[1], line[found.end() :]
        if not self.names:
            return clock, rest
        pairs = find_pairs(rest)
        values = dict(pairs)
        if len(values) < len(pairs) or frozenset(values) not in self.usual:
            return None
        return clock, "\t".join(values.get(name, "") for name in self.names)


def find_pairs(line: str) -> list[tuple[str, str]]:
    """Names, with the units behind the values, and values; empty for a line of anything else."""
    out, at, end = [], 0, len(line.rstrip())
    while at < end:
        found = _PAIR.match(line, at) or _WORD.match(line, at)
        if found is None:
            return []
        name, unit = found["name"].rstrip(), found["unit"] if found.re is _PAIR else None
        value = found["value"].strip('"').replace("\t", " ")
        out.append((f"{name} [{unit}]" if unit else name, value))
        at = found.end()
    return out


def recognise(lines: Sequence[str]) -> Capture | None:
    """Recognise the text around the values of a capture; ``None`` for other logs."""
    arrow = _most(sum(_ARROW.match(line) is not None for line in lines), lines)
    rest = [_ARROW.sub("", line) for line in lines] if arrow else lines
    counts = Counter(tuple(name for name, _ in find_pairs(line)) for line in rest)
    sets: Counter[frozenset[str]] = Counter()
    for names, count in counts.items():
        if names and len(set(names)) == len(names):
            sets[frozenset(names)] += count
    least = max(2.0, _USUAL * len(lines))
    best = max(sets.values(), default=0)
    usual = frozenset(names for names, count in sets.items() if count >= min(least, best))
    if not _most(sum(sets[names] for names in usual), lines):
        return Capture(arrow, ()) if arrow else None
    ordered = [names for names, _ in counts.most_common() if frozenset(names) in usual]
    union = tuple(dict.fromkeys(name for names in ordered for name in names))
    return Capture(arrow, union, usual)


def _most(number: int, lines: Sequence[str]) -> bool:
    return number > 0.5 * len(lines)
