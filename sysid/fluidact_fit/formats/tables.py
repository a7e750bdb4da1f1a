"""Arrays of recordings as vectors: which way samples run, and what packed numbers mean."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import KEPT, MOST_COLUMNS, Array, Sink, full

_WIDE = 10  # times as many columns as rows, from which rows are taken for the channels
_SINCE = re.compile(r"\s*(\w+) since .*", re.DOTALL)


def add_array(
    sink: Sink,
    name: str,
    values: Array,
    *,
    group: str = "",
    unit: str | None = None,
    samples: Sequence[int] = (),
    how: str = "",
) -> None:
    """Hand over an array of numbers: a vector, or the columns of a table.

    Samples run down the columns, unless only the other axis is as long as one of the vectors
    beside it (``samples``), or it is far longer. What is neither a vector nor a table is left out.
    """
    if not sink.holds_numbers(name, values, group):
        return
    if values.size < 2:
        why = "a single number" if values.size else "empty"
        sink.leave(name, why, group=group, signal=False)
        return
    shape = values.shape
    values = np.squeeze(values)
    if values.ndim == 1:
        sink.add(name, values, group=group, unit=unit, how=how)
        return
    if values.ndim > 2:
        size = " x ".join(map(str, shape))
        sink.leave(name, f"an array of {values.ndim} axes ({size})", group=group)
        return
    rows, columns = values.shape
    across = columns >= _WIDE * rows
    if samples:
        down, across = rows in samples, columns in samples and rows not in samples
        across = across or (not down and columns >= _WIDE * rows)
    if across:
        values = values.T
    if values.shape[1] > MOST_COLUMNS:
        sink.leave(name, f"a table of {values.shape[1]} columns", group=group)
        return
    for k in range(values.shape[1]):
        sink.add(f"{name}{k + 1}", values[:, k], group=group, unit=unit)
    channels = "rows" if across else "columns"
    sink.convert(name, f"{values.shape[1]} {channels} to channels{how and ', '}{how}", group)


def decoded(
    name: str, values: Array, attributes: Mapping[str, Any]
) -> tuple[Array, str, dict[int, str]]:
    """Numbers as the conventions of netCDF say they are packed: what they mean, and how.

    ``scale_factor``, ``add_offset``, ``_FillValue``, ``missing_value`` and ``valid_range`` are
    applied; cells that are none become NaN. Also returns these by their row, for vectors.

    Raises
    ------
    LogError
        When one of these attributes is no number.
    """
    given = {k: _numbers(name, k, attributes[k]) for k in _PACKING if k in attributes}
    if not given:
        return values, "", {}
    for key in ("scale_factor", "add_offset", "valid_min", "valid_max"):
        if key in given and (given[key].size != 1 or not math.isfinite(float(given[key][0]))):
            raise _no_number(name, key, attributes[key])
    missing = np.zeros(values.shape, dtype=np.bool_)
    for key in ("_FillValue", "missing_value"):
        for value in given.get(key, ()):
            missing |= values == value
    low, high = given.get("valid_min"), given.get("valid_max")
    if "valid_range" in given:
        if given["valid_range"].size != 2:
            raise _no_number(name, "valid_range", attributes["valid_range"])
        low, high = given["valid_range"][:1], given["valid_range"][1:]
    if low is not None:
        missing |= values < low[0]
    if high is not None:
        missing |= values > high[0]
    scale = float(given.get("scale_factor", np.ones(1))[0])
    offset = float(given.get("add_offset", np.zeros(1))[0])
    how = []
    bad: dict[int, str] = {}
    if missing.any():
        if values.ndim == 1:
            bad = {int(k): str(values[k]) for k in np.flatnonzero(missing)[:KEPT]}
        how.append(f"{int(missing.sum())} cells marked as missing")
    if scale != 1.0 or offset != 0.0:
        how.append(f"times {scale:g} plus {offset:g}")
    if how:
        values = values.astype(np.float64) * scale + offset
        values[missing] = np.nan
    return values, ", ".join(how), bad


_PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max",
            "valid_range")  # fmt: skip


def _numbers(name: str, key: str, value: Any) -> Array:
    found = np.atleast_1d(np.asarray(value)).ravel()
    if found.dtype.kind not in "fiu" or not found.size:
        raise _no_number(name, key, value)
    return found


def _no_number(name: str, key: str, value: Any) -> LogError:
    return LogError(
        f"attribute {key} of '{name}' is {str(value)[:60]!r}.",
        expected="Expected a number by which its values are to be read.",
        remedy="Correct the attribute, or export the recording as CSV.",
    )


def unit_of(attributes: Mapping[str, Any]) -> str | None:
    """The unit among the attributes of a dataset; of instants since a date, that of time."""
    for key, value in attributes.items():
        if key.casefold() in ("units", "unit"):
            if isinstance(value, np.ndarray) and value.size == 1:
                value = value.ravel()[0]
            text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
            if isinstance(text, str) and text.strip():
                since = _SINCE.fullmatch(text)
                return since[1] if since else text.strip()
    return None


def add_packed(
    sink: Sink,
    name: str,
    values: Array,
    attributes: Mapping[str, Any],
    *,
    group: str = "",
    samples: Sequence[int] = (),
    blank: Array | None = None,
) -> None:
    """Hand over an array of a file whose attributes say its unit, and how it is packed.

    Cells that are ``blank`` were never written.
    """
    unit = unit_of(attributes)
    if values.dtype.kind in "fiu":
        values, how, bad = decoded(full(group, name), np.squeeze(values), attributes)
        if blank is not None:
            values = values.astype(np.float64)
            values[np.squeeze(blank)] = np.nan
            how = ", ".join(filter(None, (how, f"{int(blank.sum())} cells never written")))
            bad |= {int(k): "" for k in np.flatnonzero(blank)[:KEPT]} if values.ndim == 1 else {}
    else:
        how, bad = "", {}
    before = len(sink.vectors)
    add_array(sink, name, values, group=group, unit=unit, samples=samples, how=how)
    if bad and len(sink.vectors) == before + 1:
        sink.mark(before, bad)
