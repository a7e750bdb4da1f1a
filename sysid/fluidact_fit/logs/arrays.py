"""Logs that are arrays already: DataFrames, mappings, tables, and what binary files hold."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice
from ..experiment import FloatArray, where_finite
from ..formats.sink import KEPT, MOST_COLUMNS, seconds_of
from ..units import is_doubtful_suffix, names_input, parse_unit_from_header
from .clock import Clocks, find_clocks, read_clocks
from .exact import Exact, of_integers, of_objects
from .groups import united
from .layout import NUMBER, SAMPLE, to_number
from .log import Account, Column, Dialect, Element, Log, count_of


@dataclass(frozen=True)
class Named:
    """A column by its header; ``unit`` where it does not stand in the header.

    ``values`` of shape ``(n,)``: numbers, text, instants or durations. Of a ``sparse`` one NaN
    are no samples. Of one that is ``own`` nobody else holds the values. ``bad`` has the text of
    cells that were no number, a ``clock`` held instants and counts from ``since`` [ns]. A header
    that is a ``path`` (``/topic/state.position[0]``) has a unit only in its last name (``p_bar``).
    """

    header: str
    values: Any
    unit: str | None = None
    sparse: bool = False
    own: bool = False
    bad: Mapping[int, str] | None = None
    clock: bool = False
    since: int = 0
    path: bool = False


def log_of(data: Any, name: str = "data", *, path: str | Path | None = None) -> Log:
    """Return the log of a DataFrame, a mapping of arrays, or a table.

    Parameters
    ----------
    data
        A pandas DataFrame (an index of instants becomes the time), a mapping of header to array
        of shape ``(n,)``, a structured array, or an array of shape ``(n, columns)`` whose columns
        are ``#1``, ``#2``, ... Headers name units as in a file: ``force [N]``.
    name
        What messages call it.

    Raises
    ------
    LogError
        When it is no table of numbers, or its columns differ in length.
    """
    named = list(_columns_of(data, name))
    return make_log(named, name, "in memory", path=Path(path or name))


def _columns_of(data: Any, name: str) -> Iterable[Named]:
    if isinstance(data, Mapping):
        return [Named(str(k), _unmasked(v)) for k, v in data.items()]
    if hasattr(data, "columns") and hasattr(data, "index"):
        index = data.index
        timed = np.asarray(index).dtype.kind in "mM" or (
            index.name is not None and str(index.name) not in map(str, data.columns)
        )
        first = [Named(str(index.name or "time"), np.asarray(index))] if timed else []
        # by position: names may stand twice
        return [*first, *(Named(str(k), data.iloc[:, i]) for i, k in enumerate(data.columns))]
    table = np.asanyarray(data)
    if table.dtype.names:
        return [Named(str(k), _unmasked(table[k])) for k in table.dtype.names]
    if table.ndim == 2:
        return [Named("", _unmasked(column)) for column in table.T]
    raise LogError(
        f"{type(data).__name__} of shape {table.shape} is no log.",
        where=name,
        expected="Expected a file, a DataFrame, a mapping of arrays, or a table of numbers.",
        remedy="Give for example {'time': t, 'command': u, 'outlet': y}.",
    )


def _unmasked(values: Any) -> Any:
    """Values of which those that a mask hides are none."""
    if not isinstance(values, np.ma.MaskedArray) or not np.ma.is_masked(values):
        return values
    none: dict[str, Any] = {"f": np.nan, "m": np.timedelta64("NaT"), "M": np.datetime64("NaT")}
    known = values.dtype.kind in none
    out = np.array(values.data, dtype=None if known else object)
    out[np.ma.getmaskarray(values)] = none.get(values.dtype.kind)
    return out


def make_log(
    named: Sequence[Named],
    name: str,
    dialect: str,
    *,
    path: Path,
    sha256: str = "",
    notices: Sequence[Notice] = (),
    elements: Sequence[Element] = (),
) -> Log:
    """Return a log of columns; ``LogError`` when they are no table."""
    if not named or len(named) > MOST_COLUMNS:
        raise LogError(
            f"{len(named)} columns.", where=name,
            expected=f"Expected 1 to {MOST_COLUMNS}.", remedy="Leave out what is not needed.",
        )  # fmt: skip
    sizes = Counter(np.size(c.values) for c in named)
    if len(sizes) > 1:
        listed = ", ".join(f"'{c.header}' {np.size(c.values)}" for c in named[:8])
        raise LogError(
            f"the columns differ in length: {listed}.",
            where=name,
            expected="Expected one value per sample in each.",
            remedy="Give logs of one time base each, or fill what was not sampled with NaN.",
        )
    (rows,) = sizes
    if not rows:
        raise LogError("there are no samples.", where=name, remedy="Check what was recorded.")
    said = list(notices)
    has_input = names_input(c.header for c in named)
    columns = tuple(_column(k, c, name, said, has_input) for k, c in enumerate(named, start=1))
    return Log(
        path=path,
        name=name,
        sha256=sha256 or _checksum(columns),
        columns=columns,
        lines=np.arange(1, rows + 1),
        dialect=Dialect(dialect, "binary", "", ".", 0, None, None, 1),
        account=Account(int(rows), 0, int(rows), 0, elements=tuple(elements)),
        notices=tuple(said),
    )


def _column(index: int, given: Named, name: str, notices: list[Notice], has_input: bool) -> Column:
    """A column as a file would have it."""
    values, unit = _numbers(given, name)
    header, clock, doubt = given.header.strip(), given.clock, ""
    since = given.since or _first_instant(given)
    if unit is None and not np.isfinite(values).any():
        clocks = _clocks(given, index, name)
        clock, doubt = bool(clocks.seconds), clocks.doubts.get(index - 1, "")
        values, unit = clocks.seconds.get(index - 1, values), "s" if clock else None
        notices += clocks.notices
        since = clocks.since.get(index - 1, 0)
    last = _last_name(header) if given.path else header
    written, in_header = parse_unit_from_header(last)
    if given.path:
        written, in_header = header, in_header if "_" in last else None
    if has_input and header == "in":
        in_header = None
    unit = unit or given.unit or in_header
    finite = where_finite(values)
    bad: dict[int, str] = {}
    if not finite.all():
        where = np.flatnonzero(~finite)[:KEPT]
        raw = np.asarray(given.values).ravel()[where].tolist()
        bad = {int(k): _text(cell)[:60] for k, cell in zip(where, raw)}
        bad |= given.bad or {}
        values = np.where(finite, values, np.nan)
    doubtful = given.unit is None and is_doubtful_suffix(last)
    whole = None if clock else _exact(given)
    return Column(
        index, header, written, unit, doubtful, values, bad, given.sparse, clock, doubt,
        exact=whole, since=since,
    )  # fmt: skip


def _last_name(path: str) -> str:
    """The last name of a path, without what distinguishes the elements of an array."""
    return re.split(r"[./]", re.sub(r"\[[^\]]*\]", "", path))[-1]


def _first_instant(given: Named) -> int:
    """The first of an array of instants [ns since 1970], 0 where it holds none."""
    values = np.asarray(given.values).ravel()
    return seconds_of(values)[1] if values.dtype.kind == "M" else 0


def _exact(given: Named) -> Exact | None:
    """Differences of whole numbers that doubles do not hold."""
    values = np.asarray(given.values).ravel()
    if values.dtype.kind in "iuf":
        return of_integers(values) if values.dtype.itemsize == 8 else None
    return of_objects(values.tolist()) if values.dtype.kind == "O" else None


def _text(cell: Any) -> str:
    """A cell as text; nothing where it holds none, or no instant."""
    return "" if cell is None or str(cell) in ("NaT", "<NA>") else str(cell)


def _clocks(given: Named, index: int, name: str) -> Clocks:
    """Instants of a column of text or of objects, where it holds such."""
    raw = np.asarray(given.values)
    if raw.dtype.kind not in "OSU":
        return Clocks({})
    cells = [_text(cell) for cell in raw.astype(object).ravel()]
    if not find_clocks([[cell] for cell in cells if cell][:SAMPLE]):
        return Clocks({})
    lines = np.arange(1, len(cells) + 1)
    return read_clocks({index - 1: cells}, {index - 1: None}, lines, name)


def _numbers(given: Named, name: str) -> tuple[FloatArray, str | None]:
    """Values as numbers, instants and durations as seconds since the first."""
    values: npt.NDArray[Any] = np.asarray(given.values)
    if values.ndim != 1:
        if values.size != max(values.shape, default=0):
            raise LogError(
                f"column '{given.header}' has the shape {values.shape}.",
                where=name,
                expected="Expected one value per sample.",
                remedy="Give each of its columns a name of its own.",
            )
        values = values.ravel()
    if values.dtype.kind in "mM":
        return seconds_of(values)[0], "s"
    if values.dtype.kind in "fiu":
        return values.astype(np.float64, copy=not given.own), None
    if values.dtype.kind == "c":
        raise LogError(
            f"column '{given.header}' holds complex numbers.", where=name,
            remedy="Give real ones.",
        )  # fmt: skip
    return np.array([_number(cell) for cell in values], dtype=np.float64), None


def _number(cell: Any) -> float:
    """A cell of an array of objects: text as that of a file, a truth value is no number."""
    if isinstance(cell, str):
        return to_number(cell) if NUMBER["."].match(cell := cell.strip()) else np.nan
    try:
        return np.nan if isinstance(cell, bool | np.bool_) else float(cell)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def _checksum(columns: Sequence[Column]) -> str:
    """SHA-256 of headers and numbers: the same data have the same checksum."""
    found = hashlib.sha256()
    for column in columns:
        found.update(column.header.encode() + b"\0")
        found.update(np.ascontiguousarray(column.values, dtype="<f8").tobytes())
    return found.hexdigest()


def joined(parts: Sequence[Sequence[Named]], name: str) -> list[Named]:
    """Columns of several time bases over the union of their instants; holes are no samples.

    The first column of every part is its time [s], strictly increasing. The others say by
    ``sparse`` whether their holes are none.
    """
    instants, places = united([np.asarray(p[0].values, dtype=float) for p in parts])
    out = [Named(parts[0][0].header, instants, "s")]
    for (time, *columns), rows in zip(parts, places):
        if np.any(np.diff(rows) <= 0):
            raise LogError(
                f"'{time.header}' does not increase.",
                where=name,
                expected=f"Expected {count_of(rows.size, 'instant')} in order.",
                remedy="Export the recording again.",
            )
        for column in columns:
            values, unit = _numbers(column, name)
            full = np.full(instants.size, np.nan)
            full[rows] = values
            holes = rows.size < full.size or not np.isfinite(values).all()
            sparse = column.sparse and holes
            unit = column.unit or unit
            out.append(Named(column.header, full, unit, sparse, path=column.path))
    return out
