# ruff: noqa: T201 (it prints its table)
"""Random tables in the formats of loggers, written by writers of its own and read back.

    python studies/logger_tables.py [--count 2000] [--seed 0] [--write]

Plain tables and binary formats are those of ``studies/reading_differential``.

Names, units, instants and values are known; what the reader makes of a file is compared with
them. A file may be refused: that is counted, with the reason. A file that is read to other names,
units or numbers without a warning is a silent difference, and makes the study fail. ``--write``
writes ``docs/evidence/logger-tables.md``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.notices import CODES
from fluidact_fit.units import conversion_factor

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "logger-tables.md"
_EXPLAINED = """\
# Tables of loggers, written and read back

Written by `studies/logger_tables.py --count {count} --write`: tables of known names, units
and numbers, written as loggers write them by writers of its own, and read back. A silent
difference is a table that is read to other names, units or numbers without a warning.

| format | tables | as written | refused | silent differences |
| --- | --- | --- | --- | --- |
"""
# Units as people write them, with their size in SI: from tables of units, not from the program.
_UNITS: dict[str, list[tuple[str, Any]]] = {
    "s": [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("min", 60.0)],
    "Pa": [("Pa", 1.0), ("bar", 1e5), ("mbar", 100.0), ("kPa", 1e3), ("MPa", 1e6),
           ("psi", 6894.757293168361)],
    "V": [("V", 1.0), ("mV", 1e-3)],
    "m": [("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254)],
    "N": [("N", 1.0), ("kN", 1e3), ("daN", 10.0)],
    "rad/s": [("rad/s", 1.0), ("rpm", 2 * np.pi / 60), ("1/min", None)],
}  # fmt: skip
_NAMES = {
    "Pa": ["p", "p_valve", "Druck", "pressure 2", "Kammer A"], "V": ["u", "Sollwert", "cmd"],
    "m": ["x", "Weg", "rod position"], "N": ["F", "Kraft links", "force"],
    "rad/s": ["w", "Drehzahl"],
}  # fmt: skip


@dataclass
class Table:
    """What is written: names, units (empty without), SI units and numbers by column."""

    names: list[str]
    units: list[str]
    kinds: list[str]
    texts: list[list[str]]  # cells by column, with a decimal point

    @property
    def rows(self) -> int:
        return len(self.texts[0])


def make(rng: np.random.Generator) -> Table:
    """A table of a time and one to five signals."""
    rows = int(rng.integers(8, 120))
    names, units, kinds, texts = ["t" if rng.random() < 0.5 else "Zeit"], [], [], []
    united = rng.random() < 0.8
    step, decimals = [(0.01, 2), (1.0, 0), (0.5, 1), (0.00125, 5), (20.0, 0)][rng.integers(5)]
    begin = step * int(rng.integers(0, 3))
    texts.append([f"{begin + step * k:.{decimals}f}" for k in range(rows)])
    kinds.append("s")
    units.append(_UNITS["s"][rng.integers(len(_UNITS["s"]))][0] if united else "")
    for kind in rng.choice(list(_NAMES), int(rng.integers(1, 6))):
        free = [n for n in _NAMES[kind] if n not in names]
        if not free:
            continue
        names.append(str(rng.choice(free)))
        kinds.append(str(kind))
        units.append(str(rng.choice([u for u, _ in _UNITS[kind]])) if united else "")
        size = 10.0 ** rng.integers(-2, 4)
        values = size * np.cumsum(rng.normal(0, 1, rows))
        digits = int(rng.integers(1, 7))
        forms = [f"{{:.{digits}f}}", f"{{:.{digits}e}}", "{:.10g}", "{:.0f}"]
        form = forms[rng.choice(4, p=[0.6, 0.15, 0.15, 0.1])]
        texts.append([form.format(v) for v in values])
    return Table(names, units, kinds, texts)


def pairs(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    table.names[:] = [n.replace(" ", "_") for n in table.names]
    sign = [" ", "; ", "\t", ", "][rng.integers(4)]
    names = [f"{n}[{u}]" if u else n for n, u in zip(table.names, table.units)]
    lines = []
    for row in zip(*table.texts):
        found = [f"{n}={c}" for n, c in zip(names, row)]
        lines.append(sign.join(found))
    return "\n".join(lines).encode() + b"\n", "name=value"


def labchart(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    table.names[0], table.units[0] = "time", "s"
    times = [float(t) for t in table.texts[0]]
    channels = table.names[1:]
    ranges = [f"10.000 {u}" if u else "*" for u in table.units[1:]]
    lines = [
        f"Interval=\t{times[1] - times[0]:.10g} s",
        "TimeFormat=\tStartOfBlock",
        "DateFormat=\t",
    ]
    lines += ["ChannelTitle=\t" + "\t".join(channels), "Range=\t" + "\t".join(ranges)]
    lines += ["\t".join(row) for row in zip(*table.texts)]
    return "\r\n".join(lines).encode() + b"\r\n", "LabChart"


def codesys(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    table.names[0], table.units[0] = "time", "ms"
    table.units[1:] = [""] * len(table.units[1:])
    decimal = "," if rng.random() < 0.3 else "."
    lines = ["[key]; [value]", "Version; 0x03050000", "Name; Application.Trace"]
    for k, (name, cells) in enumerate(zip(table.names[1:], table.texts[1:])):
        lines += [f"{k}.Variable; {name}", f"{k}.Class; 14", f"{k}.Data; "]
        both = zip(table.texts[0], cells)
        lines += [f"; {t}; {v}".replace(".", decimal) for t, v in both]
    return "\n".join(lines).encode() + b"\n", "CODESYS trace"


def labview(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    table.names[0], table.units[0] = "time", "s"
    columns = ["One", "Multi"][rng.integers(2)]
    between = "\t\t" if columns == "Multi" else "\t"
    channels, n = table.names[1:], len(table.names) - 1
    head = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        f"X_Columns\t{columns}",
        "***End_of_Header***",
        "",
    ]
    block = {"Samples": ["9"] * n, "Y_Unit_Label": table.units[1:], "X_Dimension": ["Time"] * n}
    block |= {"X0": ["0.0"] * n, "Delta_X": ["0.01"] * n}
    head += [f"Channels\t{n}", *(f"{key}\t{between.join(v)}" for key, v in block.items())]
    heads = (
        [h for c in channels for h in ("X_Value", c)]
        if columns == "Multi"
        else ["X_Value", *channels]
    )
    head += ["***End_of_Header***", "\t".join([*heads, "Comment"])]
    for t, *values in zip(*table.texts):
        cells = [c for v in values for c in (t, v)] if columns == "Multi" else [t, *values]
        head.append("\t".join(cells))
    return "\r\n".join(head).encode() + b"\r\n", "LabVIEW"


_WRITERS: list[Callable[[Table, np.random.Generator], tuple[bytes, str]]] = [
    pairs,
    labchart,
    codesys,
    labview,
]


def differences(table: Table, log: Log) -> list[str]:
    """What of a log is not as it was written."""
    found = []
    names = [c.name or c.header for c in log.columns]
    if [n for n in names if n][: len(table.names)] != table.names:
        return [f"names {names}, written {table.names}"]
    if log.rows != table.rows:
        found.append(f"{log.rows} rows, written {table.rows}")
    for column, unit, kind, cells in zip(log.columns, table.units, table.kinds, table.texts):
        if bool(column.unit) != bool(unit):
            found.append(f"{column.header}: unit {column.unit}, written {unit}")
        elif unit:
            size = dict(_UNITS[kind])[unit] or 2 * np.pi / 60
            try:
                read = conversion_factor(column.unit or "", kind)
            except Exception as error:
                found.append(f"{column.header}: {error}")
                continue
            if abs(read - size) > 1e-9 * size:
                found.append(f"{column.header}: {column.unit} is {read}, written {unit}")
        values = np.array([float(c) for c in cells])
        if log.rows == values.size and not np.allclose(column.values, values, rtol=1e-12, atol=0):
            found.append(f"{column.header}: other numbers")
    return found


def main() -> None:
    """Write and read the tables; exit 1 where one differs in silence."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--keep", default="", help="folder for files that differ")
    given = parser.parse_args()
    tables, same, refused, silent = Counter(), Counter(), Counter(), Counter()
    reasons: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.count):
            rng = np.random.default_rng([given.seed, number])
            table = make(rng)
            raw, kind = _WRITERS[rng.integers(len(_WRITERS))](table, rng)
            path = Path(folder) / f"{number}.log"
            path.write_bytes(raw)
            tables[kind] += 1
            try:
                log = read_log(path)
            except LogError as error:
                refused[kind] += 1
                reasons[
                    error.what[:60] if hasattr(error, "what") else error.text.split("\n")[0][:90]
                ] += 1
                path.unlink()
                continue
            wrong = differences(table, log)
            warned = [n.code for n in log.notices if CODES[n.code].severity == "warning"]
            if wrong and not warned:
                silent[kind] += 1
                print(f"{number} ({kind}): {'; '.join(wrong)[:300]}", file=sys.stderr)
                if given.keep:
                    (Path(given.keep) / f"{number}.log").write_bytes(raw)
            same[kind] += not wrong
            path.unlink()
    rows = [
        f"| {kind} | {tables[kind]} | {same[kind]} | {refused[kind]} | {silent[kind]} |"
        for kind in sorted(tables)
    ]
    total = [sum(c.values()) for c in (tables, same, refused, silent)]
    rows.append("| all | " + " | ".join(map(str, total)) + " |")
    page = _EXPLAINED.format(count=given.count) + "\n".join(rows) + "\n"
    print(page)
    for reason, count in reasons.most_common(12):
        print(f"{count} refused: {reason}", file=sys.stderr)
    if given.write and not sum(silent.values()):
        PAGE.write_text(page, encoding="utf-8")
    sys.exit(1 if sum(silent.values()) else 0)


if __name__ == "__main__":
    main()
