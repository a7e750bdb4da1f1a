"""Parameters of a document as a table for people: in the units of the log, SI beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .parameters.document import Derived, Fit, LogFit, ParameterDocument
from .specification import Quantity, entry_name
from .tables import (
    Table,
    format_interval,
    format_number,
    format_quantity,
    format_spread,
    percent_text,
)
from .units import display_unit

_MOST_ENTRIES = 24  # of a list that has a row for each
_MOST_PERCENT = 1000.0
_HEAD = ("parameter", "value", "std error", "unit", "error %", "95 % interval", "in SI", "status")


class Entry(NamedTuple):
    """One number of a document [SI]; ``value`` is ``None`` for a list that is only counted.

    ``size`` is the largest magnitude in the list that the number belongs to, ``shape`` that of a
    counted list.
    """

    name: str
    value: float | None
    std_error: float | None
    interval: tuple[float, float] | None
    unit: str
    status: str
    size: float = 0.0
    shape: tuple[int, ...] = ()

    @property
    def percent(self) -> float | None:
        """Standard error as a part of the value [%]."""
        if not self.value or not self.std_error:
            return None
        return 100.0 * self.std_error / abs(self.value)


def recorded_units(document: ParameterDocument) -> tuple[str, ...]:
    """Units of the columns of the fitted logs, which :func:`.units.display_unit` prefers."""
    units = (c.unit for log in document.provenance.logs for c in log.columns.values())
    return tuple(dict.fromkeys(units))


def entries(
    document: ParameterDocument, derived: bool = False, most: int | None = None
) -> Iterator[Entry]:
    """Yield every number of a document.

    Parameters
    ----------
    derived
        Whether numbers computed from the parameters follow.
    most
        Lists of more entries, and tables, are one entry without a value.
    """
    yield from entries_of({**document.parameters, **(document.derived if derived else {})}, most)


def entries_of(
    quantities: Mapping[str, Derived | Quantity], most: int | None = None
) -> Iterator[Entry]:
    """Yield every number of some parameters; see :func:`entries`."""
    for name, q in quantities.items():
        value = np.array(q.value, dtype=float)
        status = q.status or "derived"
        size = float(np.abs(value).max(initial=0.0))
        if most is not None and (value.ndim > 1 or value.size > most):
            yield Entry(name, None, None, None, q.unit, status, size, value.shape)
            continue
        error = None if q.std_error is None else np.array(q.std_error, dtype=float)
        ends = None if q.ci95 is None else np.array(q.ci95, dtype=float)
        for at in np.ndindex(value.shape):
            yield Entry(
                entry_name(name, at),
                float(value[at]),
                None if error is None or np.isnan(error[at]) else float(error[at]),
                None if ends is None else (float(ends[at][0]), float(ends[at][1])),
                q.unit,
                status,
                size,
            )


def parameter_table(document: ParameterDocument, derived: bool = False) -> Table:
    """Return the parameters as a table, followed by the ``derived`` numbers if wanted."""
    units = recorded_units(document)
    rows = (_cells(entry, units) for entry in entries(document, derived, _MOST_ENTRIES))
    return Table(_HEAD, tuple(rows), right=(1, 4), drop=(6, 5, 4))


def agreement_parts(entry: Fit | LogFit, units: tuple[str, ...]) -> list[str]:
    """Return how well runs are met, in words: fit, rmse and samples."""
    if entry.rmse is None:
        return ["no sample that the model describes"]
    percent = [] if entry.fit_percent is None else [f"fit {percent_text(entry.fit_percent)}"]
    rmse = format_quantity(entry.rmse.value, entry.rmse.unit, units)
    samples = entry.samples or 0
    left = sum(log.left_out or 0 for log in (entry.logs if isinstance(entry, Fit) else [entry]))
    count = f"{samples} of {samples + left}" if left else f"{samples}"
    return [*percent, f"rmse {rmse}", f"{count} samples"]


def log_table(document: ParameterDocument, fitted: Sequence[LogFit]) -> Table:
    """Return how well fitted runs, and those of the validation, are met."""
    units = recorded_units(document)
    used = [("fitted", run) for run in fitted] + [("validated", run) for run in document.validation]
    rows = []
    for use, run in used:
        percent = "" if run.fit_percent is None else percent_text(run.fit_percent)
        rmse = format_quantity(run.rmse.value, run.rmse.unit, units) if run.rmse else ""
        rows.append((run.file, use, percent, rmse))
    return Table(("log", "use", "fit", "rmse"), tuple(rows), right=(2,))


def _cells(entry: Entry, units: tuple[str, ...]) -> tuple[str, ...]:
    shown = display_unit(entry.unit, entry.size, units)
    status = "" if entry.status == "estimated" else entry.status.replace("_", " ")
    if entry.value is None:
        count = " x ".join(map(str, entry.shape))
        return entry.name, f"{count} numbers", "", entry.unit, "", "", "", status
    error = entry.std_error * shown.factor if entry.std_error else None
    ends = [end * shown.factor for end in entry.interval] if entry.interval else None
    in_si = f"{format_number(entry.value, entry.std_error)} {entry.unit}"
    return (
        entry.name,
        format_number(entry.value * shown.factor, error),
        f"± {format_spread(error)}" if error else "",
        shown.unit,
        _percent(entry.percent),
        format_interval(ends, error),
        in_si if shown.factor != 1.0 else "",
        status,
    )


def _percent(percent: float | None) -> str:
    if percent is None:
        return ""
    if percent > _MOST_PERCENT:
        return f"> {_MOST_PERCENT:.0f}"
    return f"{percent:.2g}" if percent < 99.5 else f"{percent:.0f}"
