# ruff: noqa: T201 (it prints its table)
"""Random tables, written by writers of its own in every dialect and format, and read back.

    python studies/differential_tables.py [--count 5000] [--seed 0] [--write]

Names, units, instants and values are known; what the reader makes of a file is compared with
them. A file may be refused: that is counted, with the reason. A file that is read to other names,
units or numbers without a warning is a silent difference, and makes the study fail. ``--write``
writes ``docs/differential-tables.md``.
"""

from __future__ import annotations

import argparse
import gzip
import io
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log
from fluidact_fit.notices import CODES
from fluidact_fit.units import conversion_factor

PAGE = Path(__file__).parents[1] / "docs" / "differential-tables.md"
_EXPLAINED = """\
# Random tables, written and read back

Written by `studies/differential_tables.py --count {count} --write`: tables of known names, units
and numbers, written in random dialects and formats by writers of its own, and read back. A silent
difference is a table that is read to other names, units or numbers without a warning.

| format | tables | as written | refused | silent differences |
| --- | --- | --- | --- | --- |
"""
# Units as people write them, with their size in SI: from tables of units, not from the program.
_UNITS = {
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


def _header(table: Table, rng: np.random.Generator) -> tuple[list[list[str]], bool]:
    """Rows of cells above the table, and whether they hold the units."""
    names, units = list(table.names), list(table.units)
    if not any(units):
        return [names], True
    style = rng.integers(6)
    if style < 3:
        form = ["{} [{}]", "{} ({})", "{} / {}"][style]
        return [[form.format(n, u) for n, u in zip(names, units)]], True
    bracket = ["{}", "[{}]", "({})"][rng.integers(3)]
    row = [bracket.format(u) for u in units]
    if style == 5 and len(names) > 2:  # units for some, names for the others
        upper = [names[0], *(f"Channel {k}" for k in range(1, len(names)))]
        table.units[1:] = [""] * (len(names) - 1)
        table.names[1:] = [f"{a} {b}" for a, b in zip(upper[1:], names[1:])]
        return [upper, [f"[{units[0]}]", *names[1:]]], True
    return [names, row] if style == 3 or len(names) < 3 else [row, names], True


def text(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    """Delimited text of a random dialect."""
    sign = [",", ";", "\t", "  ", "|"][rng.choice(5, p=[0.3, 0.3, 0.2, 0.1, 0.1])]
    decimal = "," if sign in (";", "\t") and rng.random() < 0.6 else "."
    quoted = sign in ",;\t" and rng.random() < 0.15
    head, _ = _header(table, rng)
    if sign == "  ":
        table.names[:] = [name.replace(" ", "_") for name in table.names]
        head = [[f"{n}[{u}]" if u else n for n, u in zip(table.names, table.units)]]
    extra = int(rng.choice([0, 1, 2], p=[0.7, 0.2, 0.1])) if sign in ",;\t" else 0
    named = rng.random() < 0.5
    rows = [[c.replace(".", decimal) for c in row] for row in zip(*table.texts)]
    below = []
    if rng.random() < 0.2 and sign != "  ":
        words = [["Mean", "Std"], ["Mittelwert"], ["Min", "Max", "Mean"]][rng.integers(3)]
        below = [[w, *(["1.5".replace(".", decimal)] * (len(table.names) - 1))] for w in words]

    def line(cells: Sequence[str]) -> str:
        return sign.join(f'"{c}"' for c in cells) if quoted else sign.join(cells)

    names = next(
        (row for row in head if row[0].startswith(("t", "Z")) and row[0] != "t/h"), head[0]
    )
    comments = [f"remark{k}" for k in range(extra)] if named else [""] * extra
    lines = [f"Recorder {k};  of Monday" for k in range(int(rng.integers(0, 4)))]
    lines = [s.replace(sign, " ") for s in lines]
    prefix = "# " if rng.random() < 0.1 and not quoted else ""
    for row in head:
        lines.append(prefix + line([*row, *(comments if row is names else [""] * extra)]))
    body = [line([*row, *[""] * extra]) for row in rows]
    if rng.random() < 0.1:
        body.insert(int(rng.integers(1, len(body))), "")
    lines += body
    lines += [""] * (bool(below) and rng.random() < 0.5) + [
        line([*r, *[""] * extra]) for r in below
    ]
    end = ["\n", "\r\n"][rng.integers(2)]
    whole = end.join(lines) + (end if rng.random() < 0.9 else "")
    encoding = ["utf-8", "utf-8-sig", "utf-16", "cp1252"][rng.choice(4, p=[0.7, 0.1, 0.1, 0.1])]
    raw = whole.encode(encoding)
    if named and extra:
        table.names += comments
    return (gzip.compress(raw), "text") if rng.random() < 0.05 else (raw, "text")


def _headed(table: Table) -> list[str]:
    return [f"{n} [{u}]" if u else n for n, u in zip(table.names, table.units)]


def as_json(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    names, rows = _headed(table), list(zip(*table.texts))
    cells = ["[" + ", ".join(row) + "]" for row in rows]
    records = [
        "{" + ", ".join(f"{json.dumps(n)}: {c}" for n, c in zip(names, r)) + "}" for r in rows
    ]
    columns = [f"{json.dumps(n)}: [{', '.join(c)}]" for n, c in zip(names, table.texts)]
    forms = [
        "[" + ",\n".join(records) + "]",
        "\n".join(records) + "\n",
        "{" + ", ".join(columns) + "}",
        '{"columns": ' + json.dumps(names) + ', "data": [' + ", ".join(cells) + "]}",
        '{"rig": "B", "data": [' + ", ".join(records) + "]}",
        "[" + json.dumps(names) + ", " + ", ".join(cells) + "]",
    ]
    return forms[rng.integers(len(forms))].encode(), "JSON"


def workbook(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    from openpyxl import Workbook

    book = Workbook(write_only=True)
    sheet = book.create_sheet("log")
    head, _ = _header(table, rng)
    for row in head:
        sheet.append(row)
    for cells in zip(*table.texts):
        sheet.append([float(c) for c in cells])
    out = io.BytesIO()
    book.save(out)
    return out.getvalue(), "Excel workbook"


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


def parquet(table: Table, rng: np.random.Generator) -> tuple[bytes, str]:
    frame = pd.DataFrame({n: list(map(float, c)) for n, c in zip(_headed(table), table.texts)})
    out = io.BytesIO()
    frame.to_parquet(out)
    return out.getvalue(), "Parquet"


_WRITERS: list[tuple[Callable[[Table, np.random.Generator], tuple[bytes, str]], float]] = [
    (text, 0.62), (as_json, 0.1), (pairs, 0.07), (labchart, 0.05), (codesys, 0.05), (labview, 0.05),
    (workbook, 0.04), (parquet, 0.02),
]  # fmt: skip


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
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="write the page")
    parser.add_argument("--keep", default="", help="folder for files that differ")
    given = parser.parse_args()
    tables, same, refused, silent = Counter(), Counter(), Counter(), Counter()
    reasons: Counter[str] = Counter()
    weights = np.array([w for _, w in _WRITERS])
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.count):
            rng = np.random.default_rng([given.seed, number])
            table = make(rng)
            writer = _WRITERS[rng.choice(len(_WRITERS), p=weights / weights.sum())][0]
            raw, kind = writer(table, rng)
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
