"""Logs as they are drafted: every line with what a person would read in it.

What the reader makes of a file is compared with this and with nothing of the reader's own.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
_SHARED = ROOT.parent / "shared" / "data"
# Pattern, lines of preamble, lines of header (the second has units), delimiter, decimal sign.
_RECORDED = (
    ("emps/*.csv", 0, 1, ",", "."),
    ("screwdrives/*/start_stop/*.csv", 11, 2, ";", "."),
    ("pneucyl/*.csv", 0, 0, "\t", "."),
    ("tubes/*_start.csv", 1, 0, ",", "."),
    ("tubes/*_p2*.csv", 0, 0, ",", "."),
    ("muscle/*Test9.csv", 0, 0, ",", "."),
    ("linpot/*.csv", 0, 1, ",", "."),
    ("hydraulic_motor/*.csv", 0, 0, ",", "."),
    ("dryer/*.dat", 0, 0, "\t", "."),
    ("hydcyl/*s1.csv", 0, 1, ",", "."),
)
_MOST = 1000  # rows
_PREAMBLE = (
    "Recorder 3.1", "Date: 2020-01-02 10:11:12", "Sample rate;100;Hz", "Operator  N. N.", "",
    "Channel 1: range 5.0 V, gain 1.5", "# a comment", "Prüfstand 3, 21,5 °C", "----------",
    "Serial No.\t4711", "key,value", "Trigger: rising 0.25",
)  # fmt: skip


@dataclass
class Line:
    """A line; ``kind`` is ``preamble``, ``header``, ``units``, ``row`` or ``other``.

    ``values`` of a row are the numbers a person reads, ``None`` in cells that were spoiled.
    """

    text: str
    kind: str
    values: tuple[float | None, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether it is a row with at least one cell as it was."""
        return self.kind == "row" and any(v is not None for v in self.values)


@dataclass
class Draft:
    """A log before it is written; ``open`` leaves out the last line end."""

    name: str
    lines: list[Line]
    delimiter: str
    decimal: str
    end: str = "\n"
    encoding: str = "utf-8"
    open: bool = False
    about: list[str] = field(default_factory=list)

    def cells(self, index: int) -> list[str]:
        """The cells of a line as they stand, blanks and quotes included."""
        text = self.lines[index].text
        return text.split() if self.delimiter == " " else text.split(self.delimiter)

    def put(self, index: int, cells: Sequence[str], spoiled: Sequence[int] = ()) -> None:
        """Write the cells of a line; those at ``spoiled`` no longer say what they did."""
        line = self.lines[index]
        values = tuple(None if k in spoiled else v for k, v in enumerate(line.values))
        self.lines[index] = Line(self.delimiter.join(cells), line.kind, values)

    def rows(self) -> list[int]:
        """Indices of the lines that are rows."""
        return [i for i, line in enumerate(self.lines) if line.kind == "row"]

    def encoded(self) -> bytes:
        """The bytes of the file."""
        text = self.end.join(line.text for line in self.lines) + ("" if self.open else self.end)
        return text.encode(self.encoding, errors="replace")


def number(text: str, decimal: str) -> float | None:
    """The number that a cell holds, ``None`` if it is none."""
    try:
        return float(text.strip().strip('"').replace(decimal, "."))
    except ValueError:
        return None


def sources() -> list[Path]:
    """The logs that there are to begin with; those of ``../shared`` where it is present."""
    found = sorted((ROOT / "datasets").glob("*/trial1.csv"))
    for pattern, *_ in _RECORDED:
        found += sorted(_SHARED.glob(pattern))[:4]
    return found


@cache
def _lines(path: Path) -> list[str]:
    with path.open(encoding="utf-8", errors="replace") as file:
        return [line.rstrip("\n") for line, _ in zip(file, range(_MOST))]


def recorded(path: Path) -> Draft:
    """A log as it was recorded, at most its first thousand rows."""
    preamble, headers, delimiter, decimal = 0, 1, ",", "."
    for pattern, *form in _RECORDED:
        if path in _SHARED.glob(pattern):
            preamble, headers, delimiter, decimal = form
    if path.parent.name == "valve":
        delimiter, decimal = ";", ","
    lines = [Line(t, "preamble") for t in _lines(path)[:preamble]]
    kinds = ("header", "units")[:headers]
    lines += [Line(t, kind) for t, kind in zip(_lines(path)[preamble:], kinds)]
    body = _lines(path)[preamble + headers :]
    values = [[number(cell, decimal) for cell in text.split(delimiter)] for text in body]
    widths = [len(v) for v in values]
    width = max(set(widths), key=widths.count)
    while width and values[len(values) // 2][width - 1] is None:
        width -= 1  # rows end with a delimiter
    for text, found in zip(body, values):
        row = len(found) >= width and None not in found[:width] and not any(found[width:])
        lines.append(Line(text, "row", tuple(found[:width])) if row else Line(text, "other"))
    return Draft(path.parent.name + "/" + path.name, lines, delimiter, decimal)


def dressed(rng: random.Random) -> Draft:
    """A log at random, of any length and, if it is one of ``datasets``, in any dialect."""
    path = rng.choice(sources())
    draft = recorded(path)
    first = draft.rows()[0]
    keep = min(len(draft.lines) - first, round(10 ** rng.uniform(0.6, 3.0)))
    draft.lines = draft.lines[: first + keep]
    draft.about.append(f"{draft.name}, {keep} lines of data")
    if path.is_relative_to(ROOT):
        _redress(draft, rng)
    draft.end = rng.choice(("\n", "\n", "\n", "\r\n", "\r\n", "\r", "\r\r\n"))
    encodings = ("utf-8", "utf-8", "utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le")
    draft.encoding = rng.choice(encodings)
    draft.open = rng.random() < 0.2
    draft.about.append(f"{draft.encoding}, line end {draft.end!r}")
    return draft


def _redress(draft: Draft, rng: random.Random) -> None:
    """Write the same numbers in another dialect."""
    old, delimiter = draft.decimal, rng.choice((",", ",", ";", ";", "\t", " ", "|"))
    decimal = "." if delimiter == "," else rng.choice(".,")
    factors = [rng.choice((1, 1, 1, 1000)) for _ in draft.lines[-1].values]
    padding, quoted = rng.choice(("", "", "", " ")), rng.random() < 0.05
    for index, line in enumerate(draft.lines):
        cells = draft.cells(index)
        if line.kind == "row":
            exact = [Decimal(c.replace(old, ".")) * f for c, f in zip(cells, factors)]
            values = tuple(float(v) for v in exact)
            texts = [f"{v:f}".replace(".", decimal) for v in exact]
            texts = [f'"{t}"' for t in texts] if quoted else texts
            draft.lines[index] = Line((delimiter + padding).join(texts), "row", values)
        elif delimiter == " ":
            line.text = " ".join(c.replace(" ", "_") for c in cells)
        else:
            line.text = delimiter.join(cells)
    draft.delimiter, draft.decimal = delimiter, decimal
    if rng.random() < 0.2:
        _split_units(draft)
    if rng.random() < 0.15:
        draft.lines = [line for line in draft.lines if line.kind == "row"]
    if rng.random() < 0.4:
        texts = rng.choices(_PREAMBLE, k=rng.choice((1, 3, 10, 40)))
        draft.lines[:0] = [Line(text, "preamble") for text in texts]
    draft.about.append(f"delimiter {delimiter!r}, decimal {decimal!r}, factors {factors}")


def _split_units(draft: Draft) -> None:
    """Put the units of the header into a row of their own."""
    at = next(i for i, line in enumerate(draft.lines) if line.kind == "header")
    cells = [c.replace("_", " ").replace("(", "[").rstrip("])") for c in draft.cells(at)]
    names = [c.partition("[")[0].strip().replace(" ", "_") for c in cells]
    units = [c.partition("[")[2] or "-" for c in cells]
    draft.lines[at : at + 1] = [
        Line(draft.delimiter.join(names), "header"), Line(draft.delimiter.join(units), "units"),
    ]  # fmt: skip
