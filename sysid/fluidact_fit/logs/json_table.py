"""Tables in JSON: records, columns, channels, rows, what pandas writes, and one record per line.

A table is written again as text with tabs, one line per record, and is then read as other text is:
numbers stay as they are written, times of day are found, what is no number is named.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import LogError, Notice
from ..formats.sink import MOST_COLUMNS
from .clock import find_clocks
from .layout import SAMPLE, Hints, Layout, Written
from .log import count_of, cut_last_line
from .source import Source

_CERTAIN = re.compile(rb'\s*(\{\s*["}]|\[\s*[\[{"])')
_LIKELY = re.compile(rb"\s*\[\s*[-\d]")
_LARGEST = 64_000_000  # bytes of a document, which takes ten times as much when it is read
_UNITS = ("units", "unit", "einheiten")
_NAMES, _ROWS_BELOW = ("columns", "fields", "header", "names"), ("data", "rows", "values")
_APART = (_NAMES, _ROWS_BELOW)
_NAME = ("name", "label", "header", "signal", "channel", "title")
_VALUES = ("values", "data", "samples", "y")
_DEEPEST, _FEW = 8, 16  # of objects in a record, and elements of a list in it, that are columns
_INSTANT = re.compile(r"\d{12,19}|\d{4}-\d\d-\d\d[T ].*")


class _Number(str):
    """A number as it is written."""

    __slots__ = ()


@dataclass(frozen=True)
class _Table:
    """Names and rows of a table, units by name, and the keys of what is no part of it.

    The first row of one that is ``headed`` has the names; ``cut`` is the line (from 1) of a record
    that was not written to its end, 0 without one.
    """

    names: Sequence[str]
    rows: Iterable[Sequence[Any]]
    units: Mapping[str, str] = field(default_factory=dict)
    others: tuple[str, ...] = ()
    headed: bool = False
    cut: int = 0


def read_json(source: Source, written: Written) -> tuple[Source, Layout] | None:
    """The table of a JSON document as text and how it is laid out; ``None`` for other text.

    Raises
    ------
    LogError
        When it is damaged, too large, or holds no table, several, or nested values.
    """
    certain = _CERTAIN.match(source.data)
    if certain is None and not _LIKELY.match(source.data):
        return None
    name = source.name
    lines = source.data.split(b"\n", 1)
    first = _parsed(lines[0], name, quiet=True)
    if isinstance(first, dict | list) and first and len(lines) > 1 and lines[1].strip():
        table, kind = _of_lines(source), "JSON lines"
    else:
        _require_small(source)
        document, kind = _parsed(source.data, name, quiet=certain is None), "JSON"
        if document is None and certain is None:
            return None
        table = _table_of(document, name)
    if written != Written():
        raise _refusal(
            "options that say how a text is written do not apply to JSON.", name,
            "Expected none of --delimiter, --decimal, --thousands, --skip-rows, --header-row.",
            "Leave them out.",
        )  # fmt: skip
    return _as_text(source, table, kind)


def _require_small(source: Source) -> None:
    if len(source.data) > _LARGEST:
        raise _refusal(
            f"{len(source.data) / 1e6:.0f} MB in one JSON document.", source.name,
            f"Expected at most {_LARGEST / 1e6:.0f} MB.",
            "Write one record per line (JSON lines), CSV or Parquet.",
        )  # fmt: skip


def _refusal(
    what: str,
    where: str,
    expected: str = "Expected a table: a list of records, or lists of equal length by name.",
    remedy: str = "Write it so, or as CSV.",
) -> LogError:
    return LogError(what, where=where, expected=expected, remedy=remedy)


def _parsed(data: bytes, where: str, *, quiet: bool = False) -> Any:
    """A document, its numbers as text; ``None`` for a damaged one where that is ``quiet``."""
    try:
        return json.loads(
            data.decode(errors="replace"),
            parse_int=_Number,
            parse_float=_Number,
            parse_constant=_Number,
            object_pairs_hook=_without_repeats,
        )
    except RecursionError:
        problem = "it is nested too deeply"
    except json.JSONDecodeError as error:
        problem = f"{error.msg}, line {error.lineno}, column {error.colno}"
    except _RepeatedError as error:
        problem = f"the key '{str(error)[:60]}' appears twice in one object"
    if quiet:
        return None
    raise _refusal(f"the JSON cannot be read: {problem}.", where, "Expected valid JSON.")


class _RepeatedError(ValueError):
    """A key that stands twice in an object."""


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise _RepeatedError(next(key for key, count in counts.items() if count > 1))
    return found


def _of_lines(source: Source) -> _Table:
    """The table of a record per line, an empty one for an empty line.

    Every line is read twice: the names are those of all records, which are never there at once.
    """
    names: dict[str, None] = {}
    kinds = set()
    cut = _cut_line(source)
    for record in _records(source, cut):
        kinds.add(type(record))
        if isinstance(record, dict):
            names.update(dict.fromkeys(record))
    if kinds <= {dict, type(None)}:
        records = _records(source, cut)
        rows = ([] if r is None else list(map(r.get, names)) for r in records)
        return _Table(list(names), rows, cut=cut)
    _require_small(source)
    table = _of_list(list(_records(source, cut)), source.name)
    if table is None:
        raise _refusal("the lines are neither records nor rows.", source.name)
    return replace(table, cut=cut)


def _cut_line(source: Source) -> int:
    """The last line (from 1) where it is not written to its end, else 0."""
    if source.data.endswith(b"\n"):
        return 0
    last = source.data[source.data.rfind(b"\n") + 1 :]
    return 0 if _parsed(last, "", quiet=True) is not None else source.line_ends + 1


def _records(source: Source, cut: int) -> Iterator[Any]:
    for number, line in enumerate(source.data.rstrip().split(b"\n"), start=1):
        where = f"{source.name}, line {number}"
        record = _parsed(line, where) if line.strip() and number != cut else None
        yield _flattened(record, where) if isinstance(record, dict) else record


def _flattened(record: Mapping[str, Any], where: str) -> dict[str, Any]:
    """A record whose objects and short lists are values of their own: ``valve.p``, ``p[0]``."""
    found = {}
    for key, value in record.items():
        nested = _nested(key, value, 0) if isinstance(value, dict | list) else [(key, value)]
        for name, part in nested:
            if name in found:
                raise _refusal(f"a record has two values for '{name[:60]}'.", where)
            found[name] = part
    return found


def _nested(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    if depth < _DEEPEST and isinstance(value, dict) and value:
        for key, part in value.items():
            yield from _nested(f"{name}.{key}", part, depth + 1)
    elif depth < _DEEPEST and isinstance(value, list) and 0 < len(value) <= _FEW:
        for k, part in enumerate(value):
            yield from _nested(f"{name}[{k}]", part, depth + 1)
    else:
        yield name, value


def _table_of(document: Any, name: str) -> _Table:
    """The one table in a document."""
    found = _table_in(document, name)
    if found is not None:
        return found
    inner = {}
    if isinstance(document, dict):
        tables = ((key, _table_in(value, name)) for key, value in document.items())
        inner = {key: table for key, table in tables if table is not None}
    if len(inner) > 1:
        listed = ", ".join(f"'{key}'" for key in list(inner)[:8])
        raise _refusal(
            f"it holds {len(inner)} tables ({listed}).", name, "Expected one.",
            "Write each to a file of its own.",
        )  # fmt: skip
    if not inner:
        raise _refusal("it holds no table.", name)
    (key, table), units = inner.popitem(), _units_of(document)
    others = tuple(k for k in document if k != key and k not in _UNITS)
    return replace(table, units={**units, **table.units}, others=(*others, *table.others))


def _table_in(value: Any, name: str) -> _Table | None:
    """The table that a value is, ``None`` where it is none."""
    if isinstance(value, list):
        return _of_channels([(None, v) for v in value], name) or _of_list(value, name)
    if not isinstance(value, dict) or not value:
        return None
    if keys := _names_and_rows(value):
        return _split(value, keys, name)
    if channels := _of_channels(list(value.items()), name):
        return channels
    lists = _lists_in(value)
    if lists and all(_is_flat(v) for v in lists.values()):
        return _of_columns(lists, value, name)
    if all(isinstance(v, dict) and v for v in value.values()):
        return _by_index(value, name)
    return None


def _lists_in(value: Mapping[str, Any]) -> dict[str, Sequence[Any]]:
    """Lists by name, those in objects beside a list of the same length among them."""
    lists: dict[str, Sequence[Any]]
    lists = {key: v for key, v in value.items() if isinstance(v, list)}
    length = {len(v) for v in lists.values()}
    for key, inner in value.items():
        if isinstance(inner, dict) and inner and key not in _UNITS:
            same = all(isinstance(v, list) and {len(v)} == length for v in inner.values())
            lists |= {k if k not in lists else f"{key}.{k}": v for k, v in inner.items() if same}
    return lists


def _of_channels(items: Sequence[tuple[str | None, Any]], name: str) -> _Table | None:
    """The table of objects that each hold a channel: its name, unit and values."""
    lists: dict[str, list[Any]] = {}
    units: dict[str, str] = {}
    for key, channel in items:
        if not isinstance(channel, dict):
            return None
        label = key or next((channel[k] for k in _NAME if isinstance(channel.get(k), str)), None)
        values = next((channel[k] for k in _VALUES if isinstance(channel.get(k), list)), None)
        if label is None or values is None or not _is_flat(values) or label in lists:
            return None
        lists[label] = values
        if unit := _unit_of(channel):
            units[label] = unit
    return _of_columns(lists, {"units": units}, name) if lists else None


def _is_flat(values: Sequence[Any]) -> bool:
    return not any(isinstance(v, dict | list) for v in values)


def _of_list(values: Sequence[Any], name: str) -> _Table | None:
    """A table of records, of rows, or of the values of one column."""
    known = [v for v in values if v is not None]
    if not known:
        return None
    if all(isinstance(v, dict) for v in known):
        flat = [None if r is None else _flattened(r, name) for r in values]
        names = list(dict.fromkeys(key for record in flat if record for key in record))
        records = [[] if r is None else [r.get(key) for key in names] for r in flat]
        return _Table(names, records)
    if all(isinstance(v, list) for v in known):
        head = known[0]
        words = bool(head) and not any(
            isinstance(c, _Number) or not isinstance(c, str) for c in head
        )
        below = known[1] if len(known) > 1 else []
        named = words and values[0] is head and any(isinstance(c, _Number) for c in below)
        wrong = next((k for k, v in enumerate(values) if v and len(v) != len(head)), None)
        if wrong is not None:
            raise _refusal(
                f"row {wrong + 1} has {count_of(len(values[wrong]), 'value')}, the first "
                f"{len(head)}.", name,
            )  # fmt: skip
        rows: list[list[Any]] = [row or [] for row in values]
        return _Table(head if named else [""] * len(head), rows, headed=named)
    if all(isinstance(v, _Number) for v in known):
        return _Table([""], [[v] for v in values])
    return None


def _names_and_rows(value: Mapping[str, Any]) -> tuple[str, str] | None:
    """The keys of names and of rows that stand apart from each other, ``None`` without such."""
    keys = [next((k for k in some if isinstance(value.get(k), list)), "") for some in _APART]
    if not all(keys) or not all(isinstance(n, str | list | dict) for n in value[keys[0]]):
        return None
    rows = value[keys[1]]
    return (keys[0], keys[1]) if rows and any(isinstance(r, list) for r in rows) else None


def _split(value: Mapping[str, Any], keys: tuple[str, str], name: str) -> _Table:
    """Names, index and rows apart, as pandas and data bases write them."""
    fields, rows = (value[key] for key in keys)
    units = _units_of(value)
    names = []
    for entry in fields:
        if isinstance(entry, dict):
            text = next((str(entry[k]) for k in _NAME if k in entry), "")
            if unit := _unit_of(entry):
                units[text] = unit
        else:
            text = entry if isinstance(entry, str) else " ".join(map(str, entry))
        names.append(text)
    wrong = next(
        (k for k, r in enumerate(rows) if not isinstance(r, list) or len(r) != len(names)), None
    )
    if wrong is not None:
        raise _refusal(f"row {wrong + 1} of '{keys[1]}' does not fit '{keys[0]}'.", name)
    others = tuple(key for key in value if key not in (*keys, "index", *_UNITS))
    index = value.get("index")
    if isinstance(index, list) and len(index) == len(rows):
        names, rows = _with_index(index, names, rows)
    return _Table(names, rows, units, others)


def _with_index(
    index: Sequence[Any], names: list[str], rows: Sequence[Sequence[Any]]
) -> tuple[list[str], Sequence[Sequence[Any]]]:
    """The rows with their index before them, if it does more than count them.

    One that holds instants is called the time.
    """
    if [str(k) for k in index] == [str(k) for k in range(len(index))]:
        return names, rows
    timed = "time" not in names and all(map(_INSTANT.fullmatch, map(str, index)))
    return ["time" if timed else "index", *names], [[k, *row] for k, row in zip(index, rows)]


def _of_columns(lists: Mapping[str, Sequence[Any]], value: Mapping[str, Any], name: str) -> _Table:
    """Lists of equal length by name; what is no list says something of them."""
    sizes = {len(v) for v in lists.values()}
    if len(sizes) > 1:
        listed = ", ".join(f"'{key}' {len(v)}" for key, v in list(lists.items())[:8])
        raise _refusal(f"the columns differ in length: {listed}.", name)
    used = set(map(id, lists.values()))
    others = tuple(
        key for key, v in value.items()
        if key not in (*lists, *_UNITS)
        and not (isinstance(v, dict) and v and all(id(part) in used for part in v.values()))
    )  # fmt: skip
    return _Table(list(lists), list(zip(*lists.values())), _units_of(value), others)


def _by_index(value: Mapping[str, Mapping[str, Any]], name: str) -> _Table | None:
    """Objects in an object: columns by index, or records by index where that is a number."""
    keys = list(next(iter(value.values())))
    if not all(list(inner) == keys and _is_flat(list(inner.values())) for inner in value.values()):
        return None
    if all(key.isdigit() or _INSTANT.fullmatch(key) for key in value):
        index, names, rows = list(value), keys, [list(inner.values()) for inner in value.values()]
    else:
        index, names = keys, list(value)
        rows = [list(row) for row in zip(*(inner.values() for inner in value.values()))]
    if len(rows) < 2:
        return None
    named, whole = _with_index(index, names, rows)
    return _Table(named, whole)


def _unit_of(channel: Mapping[str, Any]) -> str:
    """The unit that an object states of the channel in it, empty without one."""
    return next((channel[k] for k in _UNITS if isinstance(channel.get(k), str)), "")


def _units_of(value: Mapping[str, Any]) -> dict[str, str]:
    """Units by the names of the columns, where such are given."""
    found: dict[str, Any]
    found = next((value[key] for key in _UNITS if isinstance(value.get(key), dict)), {})
    return {key: unit for key, unit in found.items() if isinstance(unit, str)}


def _as_text(source: Source, table: _Table, kind: str) -> tuple[Source, Layout]:
    """The rows as lines of cells between tabs, and where everything is."""
    width = len(table.names)
    if not 0 < width <= MOST_COLUMNS:
        raise _refusal(
            f"{count_of(width, 'column')}.", source.name, f"Expected 1 to {MOST_COLUMNS}."
        )
    unknown = [key for key in table.units if key not in table.names]
    if unknown:
        raise _refusal(
            f"a unit of '{unknown[0][:60]}', which is not a column.", source.name,
            f"The columns are {', '.join(table.names[:12])}.", "Correct the name.",
        )  # fmt: skip
    lines = []
    for number, row in enumerate(table.rows, start=1):
        lines.append("\t".join(_cell(v, table.names[k], number, source) for k, v in enumerate(row)))
    if table.cut:
        lines[table.cut - 1 :] = ["cut"]
    text = "\n".join(lines) + "\n"
    sample = [line.split("\t") for line in lines[table.headed : SAMPLE] if line and line != "cut"]
    clocks = find_clocks(sample)
    units = [table.units.get(name, "") for name in table.names]
    notices = []
    if table.cut:
        notices.append(cut_last_line(source.name, table.cut))
    if table.others:
        listed = ", ".join(key[:40] for key in table.others[:8])
        notices.append(
            Notice(
                "variables-left-out",
                f"{source.name}: {count_of(len(table.others), 'value')} beside the table left out: "
                f"{listed}.",
            )
        )
    layout = Layout(
        delimiter="\t",
        decimal=".",
        width=width,
        first_row=int(table.headed),
        hints=Hints(kind),
        header_row=0 if table.headed else None,
        headers=[" ".join(name.split()) for name in table.names],
        units=["s" if k in clocks else unit for k, unit in enumerate(units)],
        clocks=clocks,
        skipped={table.cut: "cut short"} if table.cut else {},
        notices=tuple(notices),
    )
    return replace(source, data=text.encode(errors="replace")), layout


def _cell(value: Any, column: str, number: int, source: Source) -> str:
    if isinstance(value, dict | list):
        raise _refusal(
            f"'{column[:60]}' holds {'an object' if isinstance(value, dict) else 'a list'}.",
            f"{source.name}, record {number}",
            "Expected a number, a text or null.",
            "Write nested values as columns of their own.",
        )
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).casefold()
    return " ".join(str(value).replace('"', "'").split())
