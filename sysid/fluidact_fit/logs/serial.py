"""What microcontrollers print: captures of a serial line.

The monitor of the Arduino IDE writes ``HH:MM:SS.mmm -> `` before every line, and sketches for its
plotter ``name:value`` for every value. A capture begins in the middle of a line, and holds what the
sketch says when it starts again.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from .layout import Cut

_ARROW = re.compile(r"^\s*(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)\s*->\s?")
_NUMBER = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|ovf)"
_PAIR = re.compile(
    rf"\s*(?P<name>[^\W\d][^:=\t;,|]*?)\s*[:=]\s*(?P<value>{_NUMBER})"
    r"(?:\s?(?P<unit>[^\W\d][\w/²³]*|[%°µ][\w/²³]*))?\s*(?:[\t;,|]|(?<=\s)|$)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Capture:
    """What a capture writes around its values.

    ``arrow`` says whether a clock stands before the lines; ``names`` are those before the values,
    each with the unit behind it, empty without names.
    """

    arrow: bool
    names: tuple[str, ...]

    def values(self, lines: Iterable[str]) -> list[str]:
        """The lines of this form without clock and names; values of names between tabs."""
        parts = map(self._take_apart, lines)
        return [values for _, values in filter(None, parts)]

    def around(self, cut: Cut) -> Cut:
        """How to cut whole lines, from how to cut their values."""
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
        if tuple(name for name, _ in pairs) != self.names:
            return None
        return clock, "\t".join(value for _, value in pairs)


def find_pairs(line: str) -> list[tuple[str, str]]:
    """Names, with the units behind the values, and values; empty for a line of anything else."""
    out, at, end = [], 0, len(line.rstrip())
    while at < end:
        found = _PAIR.match(line, at)
        if found is None:
            return []
        unit = found["unit"]
        out.append((f"{found['name']} [{unit}]" if unit else found["name"], found["value"]))
        at = found.end()
    return out


def recognise(lines: Sequence[str]) -> Capture | None:
    """What a capture writes around its values, from lines of its table; ``None`` for other logs."""
    arrow = _most(sum(_ARROW.match(line) is not None for line in lines), lines)
    rest = [_ARROW.sub("", line) for line in lines] if arrow else lines
    counts = Counter(tuple(name for name, _ in find_pairs(line)) for line in rest)
    names, share = counts.most_common(1)[0] if counts else ((), 0)
    if not _most(share, lines) or len(set(names)) < len(names):
        names = ()
    return Capture(arrow, names) if arrow or names else None


def _most(number: int, lines: Sequence[str]) -> bool:
    return number > 0.5 * len(lines)
