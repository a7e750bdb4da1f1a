"""Damage to a draft of a log: each function does one kind, somewhere, and says what it did."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable

from .drafts import Draft, Line

_TEXTS = (
    "", "nan", "NaN", "inf", "-inf", "1e999", "---", "#VALUE!", "10x7", "TRUE", "null", "?",
    "1_000", "0x1A", "1 2", "'1'", "1.2.3", "--5", "1e", "１２", "−5", "\x1b[31m5", "5\u00a0",
    "1d3", "+.5", "5.", "1e5", "12:30:00", "1/2", "N/A", "\ufeff5", "1,2,3", "9" * 400, "\x0c", "²",
)  # fmt: skip
_WORDS = (
    "Pause", "ERROR 5: buffer overrun", "-----", "# marker", "Total", "recording resumed at 12:31",
    "=~=~=~=~= PuTTY log 2020.01.01 10:00:00 =~=~=~=~=", "x" * 5000, ";" * 50, ",,,,", "\t\t",
    "\x1b[2Jcleared", '"', '"open quote', "</table>", "NaN", "EPOS Studio Version:;3.6",
)  # fmt: skip


def _place(draft: Draft, rng: random.Random) -> int:
    """A line: more often among the first sixty, at the edge of the table, or at the end."""
    last, pick = len(draft.lines) - 1, rng.random()
    if pick < 0.3:
        return rng.randint(0, min(last, 60))
    if pick < 0.45:
        rows = draft.rows() or [0]
        return min(last, max(0, rows[0] + rng.randint(-3, 4)))
    if pick < 0.6:
        return max(0, last - rng.randrange(3))
    return rng.randint(0, last)


def _rows(draft: Draft, rng: random.Random) -> list[int]:
    """Some rows: one, a block, one in ten, or all."""
    rows = draft.rows()
    if not rows:
        return []
    if (how := rng.random()) < 0.4:
        place = _place(draft, rng)
        return [min(rows, key=lambda i: abs(i - place))]
    if how < 0.6:
        first = rng.randrange(len(rows))
        return rows[first : first + rng.choice((3, 20, 60))]
    return rows if how > 0.85 else [i for i in rows if rng.random() < 0.1]


def _named(where: Iterable[int]) -> str:
    numbers = [i + 1 for i in where]
    return f"lines {numbers[:5]}" + (f" and {len(numbers) - 5} more" if len(numbers) > 5 else "")


def _spoil(draft: Draft, index: int, text: str) -> None:
    line = draft.lines[index]
    draft.lines[index] = Line(text, line.kind, (None,) * len(line.values))


def delete_lines(draft: Draft, rng: random.Random) -> str:
    """Delete one line or a block."""
    at, count = _place(draft, rng), rng.choice((1, 1, 1, 5, 40))
    del draft.lines[at : at + count]
    return f"{count} lines from {at + 1} on deleted"


def duplicate_line(draft: Draft, rng: random.Random) -> str:
    """Write a line twice."""
    at = _place(draft, rng)
    draft.lines.insert(at, Line(**vars(draft.lines[at])))
    return f"line {at + 1} twice"


def truncate_line(draft: Draft, rng: random.Random) -> str:
    """Cut the end or the beginning off a line."""
    at = _place(draft, rng)
    text = draft.lines[at].text
    cut = rng.randint(0, len(text))
    _spoil(draft, at, text[:cut] if rng.random() < 0.7 else text[cut:])
    return f"line {at + 1} cut at {cut}"


def garble_line(draft: Draft, rng: random.Random) -> str:
    """Change characters of a line at random."""
    at = _place(draft, rng)
    characters = list(draft.lines[at].text)
    for _ in range(rng.choice((1, 2, 10, 100))):
        if characters:
            signs = '0123456789.,;\t -+eE"#%abcXYZ{}°\x07\x1bé'
            characters[rng.randrange(len(characters))] = rng.choice(signs)
    _spoil(draft, at, "".join(characters))
    return f"line {at + 1} garbled"


def join_lines(draft: Draft, rng: random.Random) -> str:
    """Lose the line end between two lines."""
    at = _place(draft, rng)
    if at + 1 < len(draft.lines):
        _spoil(draft, at, draft.lines[at].text + draft.lines.pop(at + 1).text)
    return f"line {at + 1} joined with the next"


def insert_text(draft: Draft, rng: random.Random) -> str:
    """Put prose, marks or blank lines between lines."""
    at = _place(draft, rng)
    texts = rng.choices((*_WORDS, "", "", "   "), k=rng.choice((1, 1, 2, 12)))
    draft.lines[at:at] = [Line(text, "other") for text in texts]
    return f"{[t[:40] for t in texts[:3]]} inserted before line {at + 1}"


def insert_character(draft: Draft, rng: random.Random) -> str:
    """Put a NUL, a quote, a blank or a delimiter into a line."""
    at, sign = _place(draft, rng), rng.choice("\0\"' \t\u00a0#;,|")
    text = draft.lines[at].text
    k = rng.randint(0, len(text))
    _spoil(draft, at, text[:k] + sign + text[k:])
    return f"{sign!r} put into line {at + 1} at {k}"


def damage_cell(draft: Draft, rng: random.Random) -> str:
    """Put text into cells."""
    where, text, column = _rows(draft, rng), rng.choice(_TEXTS), rng.randrange(4)
    for at in where:
        cells = draft.cells(at)
        k = min(column, len(cells) - 1)
        if cells:
            cells[k] = text
            moved = (not text.strip() and draft.delimiter == " ") or text.split() != [text]
            moved = moved or draft.delimiter in text
            joined = draft.delimiter == "," and " " in text  # "490,1 2" is 490.1 and 2 as well
            draft.put(at, cells, range(max(k - joined, 0), 10_000) if moved else [k])
    return f"{text[:20]!r} in column {column + 1} of {_named(where)}"


def change_width(draft: Draft, rng: random.Random) -> str:
    """Drop a cell, or add one."""
    where, column, text = _rows(draft, rng), rng.randrange(5), rng.choice(("", "0", "12.5", None))
    for at in where:
        cells = draft.cells(at)
        k = min(column, len(cells))
        if text is None:
            del cells[k : k + 1]
        else:
            cells.insert(k, text)
        trailing = not text and k >= len(draft.lines[at].values)
        draft.put(at, cells, () if trailing else range(10_000))
    return f"cell {'dropped' if text is None else repr(text)} at {column + 1} of {_named(where)}"


def change_decimals(draft: Draft, rng: random.Random) -> str:
    """Write some cells with the other decimal sign."""
    where, columns = _rows(draft, rng), _columns(draft, rng)
    other = "," if draft.decimal == "." else "."
    grouped = any(f"thousands by {other!r}" in said for said in draft.about)
    for at in where:
        cells = draft.cells(at)
        hit = [k for k in columns if k < len(cells) and draft.decimal in cells[k]]
        for k in hit:
            cells[k] = cells[k].replace(draft.decimal, other)
        moved = other == draft.delimiter and hit
        draft.put(at, cells, range(10_000) if moved else hit if grouped else ())
    return f"decimal {other!r} in columns {[k + 1 for k in columns]} of {_named(where)}"


def group_thousands(draft: Draft, rng: random.Random) -> str:
    """Group the thousands of some cells, as programs for people do."""
    signs = [s for s in (",", ".", " ", "'", "\u00a0") if s not in (draft.decimal, draft.delimiter)]
    sign = rng.choice([s for s in signs if s.strip() or draft.delimiter != " "])
    where, columns = _rows(draft, rng), _columns(draft, rng)
    for at in where:
        cells = draft.cells(at)
        for k in columns:
            if k < len(cells):
                cells[k] = _grouped(cells[k], sign, draft.decimal)
        draft.put(at, cells)
    return f"thousands by {sign!r} in columns {[k + 1 for k in columns]} of {_named(where)}"


def _grouped(cell: str, sign: str, decimal: str) -> str:
    whole, point, rest = cell.partition(decimal)
    if not re.fullmatch(r"\s*-?\d+\s*", whole) or abs(int(whole)) < 1000:
        return cell
    return f"{int(whole):,}".replace(",", sign) + point + rest


def _columns(draft: Draft, rng: random.Random) -> list[int]:
    width = max((len(line.values) for line in draft.lines), default=0) or 1
    return list(range(width)) if rng.random() < 0.4 else [rng.randrange(width)]


def change_delimiter(draft: Draft, rng: random.Random) -> str:
    """Separate some lines by something else."""
    where, other = _rows(draft, rng), rng.choice([s for s in ",;\t |" if s != draft.delimiter])
    for at in where:
        _spoil(draft, at, other.join(draft.cells(at)))
    return f"delimiter {other!r} in {_named(where)}"


def pad_lines(draft: Draft, rng: random.Random) -> str:
    """Add blanks or a delimiter that change nothing."""
    tail = rng.choice((" ", "  ", "\t", draft.delimiter if draft.delimiter != "|" else " "))
    where, front = _rows(draft, rng), rng.choice(("", " "))
    if draft.delimiter == "\t" and front:
        tail = " "
    for at in where:
        draft.lines[at].text = front + draft.lines[at].text + tail
    return f"{front!r} before and {tail!r} behind {_named(where)}"


def lose_header(draft: Draft, rng: random.Random) -> str:
    """Remove all above the first row, or only the header."""
    gone = ("header",) if rng.random() < 0.5 else ("header", "units", "preamble")
    draft.lines = [line for line in draft.lines if line.kind not in gone]
    return f"{', '.join(gone)} removed"


def restart(draft: Draft, rng: random.Random) -> str:
    """Let a recording follow the first, with or without all that stands above it."""
    rows = [line for line in draft.lines if line.kind == "row"]
    above = [line for line in draft.lines if line.kind in ("preamble", "header", "units")]
    heads = [Line(line.text, "other") for line in above[-rng.randint(0, 3) :]]
    again = rows[: rng.choice((5, 60, 10_000))]
    first = rng.random() < 0.3
    if first:  # the first recording is the short one
        draft.lines = [*above, *again, *heads, *rows]
    else:
        draft.lines += [*heads, *again]
    draft.lines = [Line(**vars(line)) for line in draft.lines]
    return f"a recording of {len(again)} rows {'before' if first else 'behind'} it"


def cut_file(draft: Draft, rng: random.Random) -> str:
    """End the file somewhere."""
    at = _place(draft, rng)
    text = draft.lines[at].text
    cut = rng.randint(0, len(text))
    del draft.lines[at + 1 :]
    draft.lines[at].text = text[:cut]
    if draft.lines[at].values:
        kept = text[:cut].count(draft.delimiter) if draft.delimiter != " " else 0
        draft.put(at, draft.cells(at), range(kept, 10_000))
    draft.open = True
    return f"file cut in line {at + 1} at {cut}"


def add_footer(draft: Draft, rng: random.Random) -> str:
    """Add what programs write below a table."""
    width = max((len(line.values) for line in draft.lines), default=1)
    numbers = draft.delimiter.join(["Mean", *["1"] * (width - 1)])
    texts = rng.choice((["", "End of recording"], [numbers], ["", "", ""], ["\x1a"]))
    draft.lines += [Line(text, "other") for text in texts]
    return f"{texts} below"


def leave(draft: Draft, rng: random.Random) -> str:
    """Leave the log as it is."""
    return "nothing"


Damage = Callable[[Draft, random.Random], str]
ON_CELLS: tuple[Damage, ...] = (
    damage_cell, damage_cell, change_decimals, group_thousands, pad_lines, change_width,
    insert_character,
)  # fmt: skip
ON_LINES: tuple[Damage, ...] = (
    delete_lines, duplicate_line, truncate_line, garble_line, join_lines, insert_text,
    change_delimiter, lose_header, restart, cut_file, add_footer,
)  # fmt: skip


def damaged(draft: Draft, rng: random.Random, kinds: tuple[Damage, ...]) -> Draft:
    """Do one to three kinds of damage."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        if draft.lines:
            draft.about.append(rng.choice(kinds)(draft, rng))
    return draft
