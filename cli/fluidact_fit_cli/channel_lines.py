"""Channels of a log as lines of text: a curve of blocks, and what stands out in words."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .show import echo, echo_text, format_number

_BLOCKS = "▁▂▃▄▅▆▇█"
_LETTERS = "_.,-~=*#"  # where the encoding has no blocks
_WIDEST = 100  # columns of text
_LABEL = 22  # of the name of a channel
_MANY = 8  # channels, beyond which each has one line
_SHORT = 24  # characters of a curve then
_RESTS = 0.05  # of the time, that is worth a word


def text_width() -> int:
    """Columns to print in: those of the terminal, 80 without one."""
    return min(shutil.get_terminal_size((80, 24)).columns, _WIDEST)


def sparkline(heights: Sequence[float | None], width: int) -> str:
    """A curve of at most so many characters; a space where nothing is known."""
    marks = _BLOCKS if _encodes(_BLOCKS) else _LETTERS
    count, out = min(width, len(heights)), ""
    for k in range(count):
        part = heights[k * len(heights) // count : (k + 1) * len(heights) // count]
        known = [h for h in part if h is not None]
        level = sum(known) / len(known) if known else 0.0
        out += marks[min(int(level * len(marks)), len(marks) - 1)] if known else " "
    return out


def _encodes(text: str) -> bool:
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def echo_channels(columns: Sequence[Mapping[str, Any]], roles: Mapping[int, str]) -> None:
    """Print every channel: its curve, then its range, noise and what stands out."""
    for column in columns:
        label = _label(column, roles)
        found = column["channel"]
        if found is None:
            echo_text(f"{label}: fewer than two numbers")
            continue
        if len(label) > _LABEL:
            echo_text(label)
            label = ""
        if len(columns) > _MANY:
            curve = sparkline(found["curve"], min(_SHORT, text_width() - _LABEL - 1))
            echo(f"{label:{_LABEL}} {curve}")
            echo_text("; ".join([_range(column), *troubles(column)]), "    ", "    ")
        else:
            echo(f"{label:{_LABEL}} {sparkline(found['curve'], text_width() - _LABEL - 1)}")
            echo_text("; ".join(_facts(column)), "    ", "    ")


def _label(column: Mapping[str, Any], roles: Mapping[int, str]) -> str:
    """Return number, name, unit and role of a column; the name is one that ``--column`` takes."""
    number, unit = f"#{column['number']}", column["unit"] or ""
    name = "" if column["reference"] == number else column["reference"]
    role = roles.get(column["number"], "")
    parts = [number, name, f"[{unit}]" if unit and not name.endswith((f"[{unit}]", f"({unit})"))
             else "", f"({role})" if role and role != name else ""]  # fmt: skip
    return " ".join(part for part in parts if part)


def _range(column: Mapping[str, Any]) -> str:
    found, unit = column["channel"], column["unit"] or ""
    low, high = (f"{found[end]:.4g}" for end in ("low", "high"))
    if low == high:
        return f"always {low} {unit}".strip()
    text = f"{low} to {high} {unit}".strip()
    return f"{text} in {found['levels']} levels" if found["levels"] else text


def _facts(column: Mapping[str, Any]) -> Iterator[str]:
    """Range, noise, motion and trouble of a channel."""
    found, unit = column["channel"], column["unit"] or ""
    yield _range(column)
    if found["low"] == found["high"]:
        yield from troubles(column)
        return
    bits = "" if found["bits"] is None else f" ({found['bits']:.1f} bits)"
    if found["noise"]:
        yield f"noise {found['noise']:.2g} {unit}".strip() + bits
    elif bits and column["resolution"]:
        yield f"no noise, steps of {column['resolution']:.2g} {unit}".strip() + bits
    if found["rest"] >= _RESTS:
        yield f"steady {found['rest']:.0%} of the time".replace("%", " %")
    if found["reversals"]:
        yield f"{found['reversals']} reversal{'s' * (found['reversals'] > 1)}"
    yield from troubles(column)


def troubles(column: Mapping[str, Any]) -> list[str]:
    """List what is or may be wrong with a channel."""
    found, unit = column["channel"], column["unit"] or ""
    invalid = column["invalid_cells"]
    out = [f"{invalid} invalid cell{'s' * (invalid > 1)}"] if invalid else []
    if column["unit_doubt"]:
        out.append(column["unit_doubt"])
    if found is None:
        return out
    for end in ("low", "high"):
        share = found[f"clipped_{end}"]
        if share:
            value = f"{found[end]:.4g} {unit}".strip()
            out.append(f"{100.0 * share:.2g} % of the samples at exactly {value}: clipped, or at "
                       "a stop")  # fmt: skip
    if found["stuck"]:
        out.append(f"stuck for {found['stuck']} rows from row {found['stuck_from'] + 1}")
    if found["repeated"] > 1.0:
        out.append(f"a new reading only every {found['repeated']:.2g} rows")
    return out


def echo_relations(relations: Sequence[Mapping[str, Any]], time: Mapping[str, Any] | None) -> None:
    """Print which channel leads which, by how much, and which are computed from others."""
    for r in relations:
        first, second = f"#{r['first']}", f"#{r['second']}"
        sign = "against" if r["correlation"] < 0.0 else "with"
        if r["factor"] is not None:
            echo_text(f"{second} is {format_number(r['factor'])} times {first} plus a constant, "
                      "exactly: computed or recorded twice, it adds nothing")  # fmt: skip
        elif r["lag"]:
            step = time["sample_time"] if time else None
            lag = f"{r['lag'] * step:.2g} s" if step else f"{r['lag']:.0f} rows"
            echo_text(f"{first} leads: {second} moves {sign} it {lag} later "
                      f"(correlation {r['correlation']:+.2f})")  # fmt: skip
        else:
            echo_text(f"{first} and {second} move {'together' if sign == 'with' else sign}"
                      f"{' each other' * (sign == 'against')}, neither leads "
                      f"(correlation {r['correlation']:+.2f})")  # fmt: skip
