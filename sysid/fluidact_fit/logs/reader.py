"""Read a log: file to `Log`."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from ..errors import LogError, UsageError
from ..units import is_doubtful_suffix, names_input, parse_unit_from_header
from .arrays import log_of, make_log
from .binary import read_binary, read_stored
from .codesys import read_trace
from .dialect import find_layout
from .exclusions import parse_exclusion, with_constants, without
from .groups import sparse_columns
from .json_table import read_json
from .kinds import check_kinds
from .layout import Layout, Written
from .log import Account, Column, Dialect, Invalid, Log, StepInput, check_hold
from .long_form import refuse_long_form
from .merging import merged
from .source import Source, files_of, make_source, name_of, read_bytes
from .split_time import with_joined_time
from .table import Table, read_table
from .workbook import read_workbook


def read_log(
    path: str | os.PathLike[str] | Any,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    scales: Mapping[str, float] | None = None,
    sample_time: float | None = None,
    window: tuple[float | None, float | None] | None = None,
    steps: Mapping[str, StepInput] | None = None,
    holds: Mapping[str, str] | None = None,
    unwrap: Mapping[str, float | str] | None = None,
    constants: Mapping[str, str] | None = None,
    from_name: Mapping[str, str] | None = None,
    exclude: Sequence[str] | str = (),
    invalid: Invalid | None = None,
    decimal: str | None = None,
    thousands: str | None = None,
    delimiter: str | None = None,
    skip_rows: int = 0,
    header_row: int | None = None,
) -> Log:
    """Read a recorded log.

    Encoding, separator, decimal sign, preamble, header and units are detected; nothing is
    converted or resampled.

    Parameters
    ----------
    path
        The file: text of any logger, MATLAB, Parquet, HDF5, TDMS, MDF or a ROS bag, packed or not;
        ``"-"`` for standard input, ``"a.csv+b.csv"`` for two logs of one experiment. Or the data
        themselves: a DataFrame, a mapping of header to array, a table of numbers.
    columns
        Role to header, or to a 1-based number such as ``"#3"``. A role without an entry
        takes the column of its own name.
    units
        Role to unit; overrides the unit in the header.
    scales
        Role to a factor for the raw column.
    sample_time
        Time between rows [s], for logs without a time column. Replaces one.
    window
        Part of the log to use [s], ``None`` for an open side.
    steps
        Role to `StepInput` for inputs that were not recorded.
    holds
        Role to ``"zoh"``, ``"foh"``, ``"smooth"`` or ``"auto"``.
    unwrap
        Role to what its column begins again after, in its own numbers (360 for degrees), or
        ``"none"``; what is not given is found where it is certain.
    constants
        Role to what it was all the time: ``"25 %"``, or ``"0.3"`` in SI.
    from_name
        Role to where its constant stands in the name of the file: ``"kinked{%}"``.
    exclude
        What is left out: ``"run=2"``, ``"time=3:3.5"`` [s], ``"lines=120:130"``, or several.
    invalid
        What becomes of rows with a missing or non-numeric cell in a column that is used: by
        default such a log is refused, ``"drop"`` leaves the rows out.
    decimal, thousands, delimiter
        Signs, where they are not to be found out.
    skip_rows
        Lines at the top that are not looked at.
    header_row
        Line of the header, counted from 1.

    Returns
    -------
    Log
        Raw columns with everything above.

    Raises
    ------
    LogError
        When the file cannot be read as a table of numbers.
    UsageError
        When an argument is not possible.
    """
    check_kinds(
        {
            "columns": columns, "units": units, "scales": scales, "sample_time": sample_time,
            "window": window, "steps": steps, "holds": holds, "unwrap": unwrap,
            "constants": constants, "from_name": from_name, "decimal": decimal,
            "thousands": thousands, "delimiter": delimiter, "skip_rows": skip_rows,
            "header_row": header_row, "exclude": exclude, "invalid": invalid,
        }
    )  # fmt: skip
    _check_arguments(scales or {}, sample_time, window, steps or {}, holds or {})
    written = _checked_writing(Written(decimal, thousands, delimiter, skip_rows, header_row))
    given = [parse_exclusion(t) for t in ([exclude] if isinstance(exclude, str) else exclude or ())]
    if invalid not in (None, *get_args(Invalid)):
        raise UsageError(f"--invalid {invalid} is not possible.", remedy="Give drop or refuse.")
    log = replace(
        with_joined_time(_read(path, written)),
        bindings=dict(columns or {}),
        units=dict(units or {}),
        scales={role: float(factor) for role, factor in (scales or {}).items()},
        steps=dict(steps or {}),
        holds=dict(holds or {}),
        turns={role: _turn(role, given) for role, given in (unwrap or {}).items()},
        sample_time=None if sample_time is None else float(sample_time),
        window=window,
        invalid=invalid,
        written=written.given,
    )
    refuse_long_form(log)
    return without(with_constants(log, constants or {}, from_name or {}), given)


def _read(path: str | os.PathLike[str] | Any, written: Written) -> Log:
    """The log as it was recorded."""
    if not isinstance(path, str | os.PathLike):
        return log_of(path)
    place = Path(path)
    if str(place) == "-" != os.fspath(path):
        place = place.absolute()  # "./-" is a file, and "-" standard input
    if len(files := files_of(place)) > 1:
        return merged([with_joined_time(_read(file, written)) for file in files])
    (place,) = files
    raw, sha256 = b"", ""
    found = read_stored(place)
    if found is None:
        raw, sha256 = read_bytes(place)
        found = read_binary(raw, name_of(place))
    if found is not None:
        return make_log(
            found.columns,
            name_of(place),
            found.dialect,
            path=place,
            sha256=found.sha256 or sha256,
            notices=found.notices,
            elements=found.elements,
        )
    source, layout, table = _read_text(place, raw, sha256, written)
    return Log(
        path=place,
        name=source.name,
        sha256=sha256,
        columns=_name_columns(layout, table),
        lines=table.lines,
        dialect=_describe_dialect(source, layout, table),
        account=_account(source, layout, table),
        notices=table.notices,
    )


def _turn(role: str, given: float | str | None) -> float:
    """Value at which a column wraps, 0 for never."""
    with contextlib.suppress(TypeError, ValueError):
        turn = 0.0 if given is None or given == "none" else float(given)
        if math.isfinite(turn) and turn >= 0.0:
            return turn
    raise UsageError(
        f"--unwrap {role}={given} is not possible.",
        expected="Expected what the column begins again after, in its own numbers, or none.",
        remedy=f"Give for example --unwrap {role}=360.",
    )


def _read_text(
    place: Path, raw: bytes, sha256: str, written: Written
) -> tuple[Source, Layout, Table]:
    """The table of a text, or of what is written again as text."""
    book = read_workbook(raw, Source(place, b"", "utf-8", sha256), written, find_layout)
    source = make_source(place, raw, sha256) if book is None else book[0]
    found = book or read_json(source, written)
    if found is not None:
        source, layout = found
        return source, layout, read_table(source, layout)
    trace = read_trace(source, written)
    if trace is not None:
        return source, *trace
    layout = find_layout(source, written)
    return source, layout, read_table(source, layout)


def _check_arguments(
    scales: Mapping[str, float],
    sample_time: float | None,
    window: tuple[float | None, float | None] | None,
    steps: Mapping[str, StepInput],
    holds: Mapping[str, str],
) -> None:
    if sample_time is not None and not (math.isfinite(sample_time) and sample_time > 0):
        raise UsageError(
            f"a sample time of {sample_time} s is not possible.",
            remedy="Give the time between two rows in seconds, for example --sample-time 0.001.",
        )
    for role, factor in scales.items():
        if not math.isfinite(factor) or factor == 0:
            raise UsageError(
                f"a scale of {factor} for '{role}' is not possible.",
                remedy="Give a finite factor that is not zero.",
            )
    for role, step in steps.items():
        if not all(map(math.isfinite, (step.start, step.end, step.at))):
            raise UsageError(f"the step of '{role}' is not finite.", remedy="Give three numbers.")
    for role, hold in holds.items():
        check_hold(role, hold)
    low, high = window or (None, None)
    if any(side is not None and math.isnan(side) for side in (low, high)) or (
        low is not None and high is not None and low >= high
    ):
        raise UsageError(
            f"the window {low}:{high} is empty.", remedy="Give START:END in seconds, START first."
        )


def _checked_writing(written: Written) -> Written:
    """Refuse signs that cannot be what they are said to be."""
    signs = {
        "--decimal": (written.decimal, ".,"),
        "--thousands": (written.thousands, ".,'\u2019 \u00a0\u202f\u2009_"),
        "--delimiter": (written.delimiter, "\t;,| "),
    }
    for option, (sign, known) in signs.items():
        if sign is not None and (len(sign) != 1 or sign not in known):
            raise UsageError(
                f"{option} {sign!r} is not possible.",
                expected="Expected one of " + ", ".join(repr(s) for s in known) + ".",
                remedy="Leave it out, or give one of them in quotes.",
            )
    chosen = [sign for sign in (written.decimal, written.thousands) if sign is not None]
    if written.delimiter != ",":  # a comma between quotes does not separate
        chosen += [written.delimiter] if written.delimiter is not None else []
    if len(set(chosen)) < len(chosen):
        raise UsageError(
            "--decimal, --thousands and --delimiter name the same sign.",
            remedy="One sign can only mean one of them.",
        )
    if written.skip_rows < 0 or (written.header_row is not None and written.header_row < 1):
        raise UsageError(
            "--skip-rows or --header-row is not possible.", remedy="Lines count from 1."
        )
    return written


def _account(source: Source, layout: Layout, table: Table) -> Account:
    """Account for every line; ``LogError`` if the account does not add up."""
    total = source.line_ends + (not source.data.endswith(b"\n"))
    rows, above = table.data_lines, layout.first_row
    blank = total - above - rows - len(table.left_out)
    found = _count_blank(source, above) if blank else 0
    if blank != found:
        raise LogError(
            f"{abs(blank - found)} lines of the table were neither read nor left out.",
            where=source.name,
            expected="This is a bug of the reader.",
            remedy="Report it with the log, and give --delimiter and --header-row meanwhile.",
        )
    stray = [(i + 1, "above the table") for i in layout.stray]
    return Account(total, above - len(stray), rows, blank, (*stray, *table.left_out))


def _count_blank(source: Source, above: int) -> int:
    """Number of empty lines below the first few."""
    lines = source.data.split(b"\n")[above:]
    ends = not lines[-1] and len(lines) > 0
    return sum(not line or line.isspace() for line in lines) - ends


def _name_columns(layout: Layout, table: Table) -> tuple[Column, ...]:
    columns = []
    rasters = sparse_columns(table.values, table.bad)
    parts = zip(layout.headers, layout.units, table.values, table.bad)
    has_input = names_input(layout.headers)
    for index, (header, unit_in_row, values, bad) in enumerate(parts, start=1):
        texts = layout.parts.get(index - 1, (header,))
        named = [parse_unit_from_header(text) for text in texts]
        name = " ".join(text for text, _ in named)
        unit = next((unit for _, unit in reversed(named) if unit), None)
        if has_input and header.strip() == "in":
            unit = None
        doubtful = not unit_in_row and is_doubtful_suffix(texts[-1])
        clock = index - 1 in layout.clocks
        empty = layout.hints.sparse and bool(bad) and not any(bad.values())
        sparse = empty or (index - 1 in rasters and not clock)
        also = [*texts, *(text for text, _ in named)] if len(texts) > 1 else []
        columns.append(
            Column(
                index,
                header,
                name,
                unit_in_row or unit,
                doubtful,
                values,
                bad,
                sparse,
                clock,
                doubt=table.doubts.get(index - 1, ""),
                also=tuple(also),
                exact=table.exact.get(index - 1),
                since=table.since.get(index - 1, 0),
            )
        )
    return tuple(columns)


def _describe_dialect(source: Source, layout: Layout, table: Table) -> Dialect:
    header, units = layout.header_row, layout.units_row
    return Dialect(
        name=layout.hints.name,
        encoding=source.encoding,
        delimiter=layout.delimiter,
        decimal=layout.decimal,
        preamble=layout.first_row if header is None else header,
        header_line=None if header is None else header + 1,
        units_line=None if units is None else units + 1,
        first_data_line=int(table.lines[0]),
        serial=layout.hints.serial,
    )
