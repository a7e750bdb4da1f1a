"""Tables as text, as loggers, spreadsheets and people write them."""

from __future__ import annotations

import random
from dataclasses import dataclass
from datetime import datetime, timedelta

from .truth import REMARKS, TIME_UNITS, Truth

_SHAPES = ("{n} [{u}]", "{n} ({u})", "{n}[{u}]", "{n}({u})", "{n} / {u}", "{n} in {u}", "{n}, {u}",
           "{n} {{{u}}}", "{n} <{u}>", "{n}（{u}）", "{n}【{u}】", "{n} [{u}] {r}", "[{u}] {n}",
           "{n} ({r}) [{u}]", "{n}: {u}", "{n} (in {u})")  # fmt: skip
_PREAMBLE = ("# logger 3.1", "# rig 7: cylinder", "Operator: N. N.", "Serial No. 4711", "",
             "// recorded with care", "Comment: right side", "% channel list follows")  # fmt: skip


@dataclass
class Written:
    """A file, what is given to read it, and how it was made."""

    data: bytes
    suffix: str
    how: str
    sample_time: float | None = None
    time: str = ""  # the column of the time, where it is named


def write(rng: random.Random, truth: Truth) -> Written:
    """Write a table in a dialect that one reading fits."""
    delimiter = rng.choice((",", ";", "\t", "|", " "))
    decimal = "." if delimiter == "," else rng.choice(".,")
    thousands = rng.choice(("", "", "", "", "'")) if delimiter != " " else ""
    timed = rng.choice(("number", "number", "iso", "clock", "epoch", "none", "split"))
    said = rng.choice(("header", "header", "row", "none"))
    if delimiter == " " and timed in ("iso", "split"):
        timed = "number"
    stamps, names, units = _stamps(rng, truth, timed, decimal)
    columns = [[_number(v, c.decimals, decimal, thousands) for v in c.values]
               for c in truth.channels]  # fmt: skip
    wanted = [c.name for c in truth.channels]
    shape = rng.choice(_SHAPES)
    if said == "none":
        for c in truth.channels:
            c.unit, c.size = "", 1.0
    header = [*names, *wanted]
    if said == "header":
        both = zip(header, [*units, *(c.unit for c in truth.channels)])
        header = [_headed(rng, n, u, shape) if u else n for n, u in both]
    elif units and units[0]:  # the time says its unit in any case
        header[0] = f"{header[0]} [{units[0]}]"
        units = [""] * len(units) if said == "none" else units
    lines = [rng.choice(_PREAMBLE) for _ in range(rng.choice((0, 0, 0, 1, 3)))]
    quoted = rng.choice(("none", "header", "all"))
    lines.append(_joined(rng, header, delimiter, quoted != "none"))
    if said == "row":
        row = [*units, *(c.unit for c in truth.channels)]
        lines.append(_joined(rng, row, delimiter, quoted == "all"))
    for cells in zip(*stamps, *columns):
        lines.append(_joined(rng, list(cells), delimiter, quoted == "all"))
    end = rng.choice(("\n", "\r\n", "\r"))
    text = end.join(lines) + rng.choice(("", end, end, 2 * end))
    encodings = ["utf-8", "utf-8-sig", "utf-16"]
    if _fits(text, "cp1252"):
        encodings.append("cp1252")
    encoding = rng.choice(encodings)
    how = (f"text {delimiter!r} {decimal!r} {thousands!r} {timed} units={said} {shape!r} "
           f"{quoted} {encoding} {end!r}")  # fmt: skip
    given = truth.step if timed == "none" else None
    named = "" if timed in ("none", "split") else "#1"
    return Written(text.encode(encoding), ".csv", how, given, named)


def _headed(rng: random.Random, name: str, unit: str, shape: str) -> str:
    return shape.format(n=name, u=unit, r=rng.choice(REMARKS))


def _number(value: float, decimals: int, decimal: str, thousands: str) -> str:
    """A number as text: digits, the signs in use, no help of the locale."""
    digits = f"{abs(value):.{decimals}f}"
    whole, _, rest = digits.partition(".")
    if thousands:
        groups: list[str] = []
        while len(whole) > 3:
            groups.insert(0, whole[-3:])
            whole = whole[:-3]
        whole = thousands.join([whole, *groups])
    return ("-" if value < 0.0 else "") + whole + (decimal + rest if rest else "")


def _joined(rng: random.Random, cells: list[str], delimiter: str, quoted: bool) -> str:
    if delimiter == " ":
        return rng.choice((" ", "  ", "   ")).join(f'"{c}"' if " " in c or quoted else c
                                                   for c in cells)  # fmt: skip
    # "force, kN" above decimals with commas would be two names above two columns
    must = [quoted or delimiter in c or ("," in c and len(cells) == 1) for c in cells]
    return delimiter.join(f'"{c}"' if q else c for c, q in zip(cells, must))


def _stamps(
    rng: random.Random, truth: Truth, timed: str, decimal: str
) -> tuple[list[list[str]], list[str], list[str]]:
    """Columns of time, with their names and units."""
    name = rng.choice(("time", "t", "Time", "Zeit", "Timestamp"))
    start = datetime(2024, 5, 27, 8, 30) + timedelta(seconds=rng.randint(0, 40_000))
    at = [start + timedelta(microseconds=round(1e6 * t)) for t in truth.times]
    if timed == "none":
        return [], [], []
    if timed == "iso":
        sep, zone = rng.choice("T "), rng.choice(("", "Z", "+02:00"))
        return [[x.isoformat(sep, "milliseconds") + zone for x in at]], [name], [""]
    if timed == "clock":
        return [[f"{x:%H:%M:%S}{decimal}{x.microsecond // 1000:03d}" for x in at]], [name], [""]
    if timed == "split":
        days = [f"{x:%Y-%m-%d}" for x in at]
        clocks = [f"{x:%H:%M:%S}{decimal}{x.microsecond // 1000:03d}" for x in at]
        return [days, clocks], ["Date", "Time"], ["", ""]
    if timed == "epoch":
        ms = 1_716_800_000_000 + rng.randint(0, 10**9)
        return [[str(ms + round(1e3 * t)) for t in truth.times]], [name], ["ms"]
    unit = rng.choice(sorted(TIME_UNITS))
    size = TIME_UNITS[unit]
    decimals = 0
    while decimals < 9 and 10.0**-decimals * size > 1e-3 * truth.step:
        decimals += 1
    stamps = [_number(t / size, decimals, decimal, "") for t in truth.times]
    return [stamps], [name], [unit]


def _fits(text: str, encoding: str) -> bool:
    try:
        return text.encode(encoding).decode(encoding) == text
    except UnicodeError:
        return False
