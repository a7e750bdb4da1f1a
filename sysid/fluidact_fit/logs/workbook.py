"""Excel workbooks (XLSX): the one sheet that holds a table, written again as text with tabs.

Rows and columns keep their numbers. Formulas count with the value that was last computed; dates
become stamps with all their digits, which openpyxl would round to milliseconds.
"""

from __future__ import annotations

import io
import math
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from functools import lru_cache
from importlib import import_module
from itertools import zip_longest
from typing import Any

from ..errors import LogError, Notice
from ..formats.sink import MOST_COLUMNS
from ..units import looks_like_unit
from .archives import Budget, member_blocks, open_zip
from .layout import Layout, Written
from .log import count_of
from .source import Source

MAGIC = b"PK\x03\x04"
_BOOK = "xl/workbook.xml"
_LARGEST = 1 << 28  # bytes of its parts, unpacked
_PICTURES = "xl/media/"  # drawn ones may be XML with a document type
_MOST_ROWS = 1_048_576
_DAY = 86_400 * 10**6  # microseconds
_LITERAL = re.compile(r'"([^"]*)"')  # of a number format: what is shown behind the number
_THOUSANDS = re.compile(r"[0#?],+(?![0#?,])")  # of a number format: these are shown
_BUG = 60  # Excel counts a 29 February 1900


def read_workbook(
    raw: bytes, source: Source, written: Written, read: Callable[[Source, Written], Layout]
) -> tuple[Source, Layout] | None:
    """The table of a workbook as text, and how it is laid out; ``None`` for other files.

    Parameters
    ----------
    raw
        The bytes of the file.
    source
        A source of the file without text.
    written
        What the user says of the rows: ``skip_rows`` and ``header_row`` apply.
    read
        Finds a table in text.

    Raises
    ------
    LogError
        When the workbook is damaged or too large, no sheet holds a table, or several do.
    """
    if not raw.startswith(MAGIC):
        return None
    archive = open_zip(raw, source.name)
    if _BOOK not in archive.namelist():
        raise LogError(
            "this is a zip archive.",
            where=source.name,
            expected="Expected a text file with columns of numbers (CSV or similar).",
            remedy="Unpack it, and give the log in it.",
        )
    computed = _check(archive, Budget(len(raw), source.name, _LARGEST))
    signs = (written.delimiter, written.decimal, written.thousands)
    if signs != (None, None, None):
        raise LogError(
            "--delimiter, --decimal and --thousands do not apply to a workbook.",
            where=source.name,
            remedy="Leave them out: its cells are numbers.",
        )
    sheets, hidden = _sheets(raw, computed, source)
    as_text = replace(written, delimiter="\t", decimal=".", cells=True)
    found: dict[str, tuple[Source, Layout]] = {}
    failures: dict[str, LogError] = {}
    for title, text in sheets.items():
        try:
            found[title] = text, read(text, as_text)
        except LogError as error:
            failures[title] = error
    if not found:
        empty = LogError("no sheet holds anything.", where=source.name, remedy="Save it again.")
        raise next(iter(failures.values()), empty)
    if len(found) > 1:
        raise LogError(
            f"{len(found)} sheets hold a table: {_listed(list(found))}.",
            where=source.name,
            expected="Expected one.",
            remedy="Save the sheet with the log as a workbook or CSV of its own.",
        )
    (title, (text, layout)), others = found.popitem(), [*failures, *hidden]
    notices = list(layout.notices)
    if others:
        left = f"{count_of(len(others), 'other sheet')} left out: {_listed(others)}"
        message = f"{source.name}: sheet '{title}' was read, {left}."
        notices.append(Notice("variables-left-out", message))
    hints = replace(layout.hints, name="Excel workbook")
    return text, replace(layout, hints=hints, notices=tuple(notices))


def _listed(titles: Sequence[str]) -> str:
    return ", ".join(f"'{title[:40]}'" for title in titles[:8])


def _check(archive: zipfile.ZipFile, budget: Budget) -> bool:
    """Bound what the parts unpack to, refuse declared entities; whether there are formulas.

    Any part may be one that is read, wherever it lies: others name it.
    """
    formulas = False
    for member in archive.infolist():
        tail = b""
        for block in member_blocks(archive, member, budget):
            text, tail = tail + block, block[-16:]
            drawn = member.filename.startswith(_PICTURES)
            if not drawn and (b"<!DOCTYPE" in text or b"<!ENTITY" in text):
                what = "it declares XML entities, as no spreadsheet does."
                raise _refusal(what, budget.name)
            formulas |= "worksheets/" in member.filename and b"<f" in text
    return formulas


def _refusal(what: str, name: str) -> LogError:
    return LogError(
        what,
        where=name,
        expected="Expected an Excel workbook (XLSX).",
        remedy="Save it again, or the sheet with the log as CSV.",
    )


def _sheets(raw: bytes, computed: bool, source: Source) -> tuple[dict[str, Source], list[str]]:
    """Visible sheets with their cells as text, and the titles of the hidden ones."""
    try:
        openpyxl = import_module("openpyxl")
    except ImportError:
        raise LogError(
            "reading it needs the Python package openpyxl, which is not installed.",
            where=source.name,
            remedy="Run: pip install 'fluidact-fit[excel]', or save the sheet as CSV.",
        ) from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions that say nothing of cells
            book = _opened(openpyxl, raw, data_only=True)
            formulas = _opened(openpyxl, raw, data_only=False) if computed else None
            texts, hidden = {}, []
            for sheet in book.worksheets:
                if sheet.sheet_state != "visible":
                    hidden.append(f"{sheet.title} (hidden)")
                    continue
                other = formulas[sheet.title] if formulas is not None else None
                rows = list(_rows(sheet, other, book.epoch, source.name))
                width = max(map(len, rows), default=0)
                lines = ["\t".join(row + [""] * (width - len(row))) if row else "" for row in rows]
                text = "\n".join(lines).rstrip()
                if text:
                    texts[sheet.title] = replace(source, data=text.encode() + b"\n")
    except LogError:
        raise
    except Exception as error:
        message = f"it is damaged ({type(error).__name__}: {str(error)[:150]})."
        raise _refusal(message, source.name) from None
    return texts, hidden


def _opened(openpyxl: Any, raw: bytes, *, data_only: bool) -> Any:
    """A workbook whose dates stay the numbers that they are."""
    book = openpyxl.load_workbook(
        io.BytesIO(raw), read_only=True, data_only=data_only, keep_links=False
    )
    book._date_formats, book._timedelta_formats = set(), set()
    return book


def _rows(sheet: Any, formulas: Any, epoch: datetime, name: str) -> Iterator[list[str]]:
    """The cells of every row of a sheet; none of one that is empty."""
    for each in (sheet, formulas) if formulas is not None else (sheet,):
        each.reset_dimensions()  # which a file may state as it likes
    others = formulas.iter_rows() if formulas is not None else ()
    for number, (row, other) in enumerate(zip_longest(sheet.iter_rows(), others), start=1):
        if number > _MOST_ROWS or len(row or ()) > MOST_COLUMNS:
            raise _refusal(f"sheet '{sheet.title[:40]}' has too many rows or columns.", name)
        cells = [_text(cell, epoch) for cell in row or ()]
        for k, cell in enumerate(other or ()):
            if k < len(cells) and not cells[k] and cell.value is not None:
                cells[k] = _clean(f"={str(cell.value).lstrip('=')}")  # never computed
        yield cells if any(cells) else []


def _text(cell: Any, epoch: datetime) -> str:
    """A cell as text: numbers with all their digits, dates as stamps."""
    value = cell.value
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).casefold()
    if not isinstance(value, int | float):
        return _clean(str(value))
    style = _kind_of(cell.number_format[:200])
    if style == "number" or not math.isfinite(value):
        form = cell.number_format[:200]
        shown = None if _THOUSANDS.search(_LITERAL.sub("", form)) else _LITERAL.search(form)
        unit = shown[1].strip() if shown else ""
        return f"{value!r} {unit}" if looks_like_unit(unit) else repr(value)
    if style == "duration":
        seconds, part = divmod(round(value * _DAY), 10**6)
        hours, rest = divmod(seconds, 3600)
        sign = "" if seconds >= 0 else "-"
        return f"{sign}{hours // 24} days {hours % 24:02}:{rest // 60:02}:{rest % 60:02}.{part:06}"
    if 0 <= value < 1:
        value, style = value, "time"
    elif value < _BUG and epoch.year == 1899:
        value += 1
    if not 0 <= value < 2_958_466:
        return repr(value)  # no date
    instant = epoch + timedelta(microseconds=round(value * _DAY))
    return f"{instant:%H:%M:%S.%f}" if style == "time" else f"{instant:%Y-%m-%d %H:%M:%S.%f}"


@lru_cache(maxsize=1024)
def _kind_of(number_format: str) -> str:
    """Kind of a number format: ``number``, ``date`` or ``duration``."""
    formats = import_module("openpyxl.styles.numbers")
    if not formats.is_date_format(number_format):
        return "number"
    return "duration" if formats.is_timedelta_format(number_format) else "date"


def _clean(text: str) -> str:
    return " ".join(text.replace('"', "'").split())
