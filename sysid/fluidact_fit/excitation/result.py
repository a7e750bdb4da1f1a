"""The next experiment: its limits, its table and the standard errors to expect."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..experiment import FloatArray
from ..parameters import write_atomically
from ..tables import Shown, Table, format_interval, format_number, format_spread
from ..units import display_unit

NOT_GIVEN = (0.0, 0.0)  # an amplitude that is left to what the file's logs covered


@dataclass(frozen=True)
class Limits:
    """Limits that the next experiment has to respect.

    ``amplitude`` is the lowest and the highest value of the driving role [SI], ``rate`` its largest
    slope [SI/s] and ``stroke`` the range of the output [SI], either ``None`` for no limit.
    ``duration`` and ``sample_time`` [s] are both 0 for a static map without time.
    """

    amplitude: tuple[float, float]
    rate: float | None
    stroke: tuple[float, float] | None
    duration: float
    sample_time: float

    @property
    def count(self) -> int:
        """Number of samples."""
        return round(self.duration / self.sample_time)

    @property
    def travel(self) -> float:
        """Length of the stroke [SI]; infinite without a limit."""
        return np.inf if self.stroke is None else self.stroke[1] - self.stroke[0]


@dataclass(frozen=True)
class Forecast:
    """A parameter before and after the next experiment [``unit``].

    ``present`` is the standard error in the file (``None`` when it was not identified),
    ``predicted`` that of the new experiment alone (``None``: it would not determine it
    either), ``ratio`` their quotient; both intervals are 95 % about ``value``.
    ``supposed`` says that the value is only plausible.
    """

    name: str
    unit: str
    value: float
    present: float | None
    predicted: float | None
    ratio: float | None
    present_ci95: tuple[float, float] | None
    predicted_ci95: tuple[float, float] | None
    supposed: bool = False


@dataclass(frozen=True)
class Candidate:
    """An excitation that was tried: in words, and its worst relative standard error."""

    description: str
    worst_relative: float | None


@dataclass(frozen=True)
class Design(Shown):
    """The next experiment.

    Attributes
    ----------
    family
        Name of the family.
    description
        The excitation in words.
    time
        Instants, shape ``(n,)`` [s]; empty for a static design without time.
    signals, units
        Columns by name, shape ``(n,)`` each [SI], and their units.
    forecasts
        One entry per parameter.
    criterion
        What was minimised.
    limits
        The limits it respects.
    binding
        The limits that the design reaches; relaxing these would help.
    notes
        What a person should know.
    candidates
        The best of each shape, best first.
    inputs
        The parameter file, where one was read; what is saved never replaces it.
    recorded_units
        Units of the columns of the file's logs, in which numbers are shown.
    """

    family: str
    description: str
    time: FloatArray
    signals: Mapping[str, FloatArray]
    units: Mapping[str, str]
    forecasts: tuple[Forecast, ...]
    criterion: str
    limits: Limits
    binding: tuple[str, ...]
    notes: tuple[str, ...]
    candidates: tuple[Candidate, ...] = ()
    inputs: tuple[str, ...] = ()
    recorded_units: tuple[str, ...] = ()

    def parts(self) -> list[Table | str]:
        """Return the excitation, the errors to expect, and what a person should know."""
        notes = [f"binding limits: {', '.join(self.binding)}", *(f"- {n}" for n in self.notes)]
        return [f"{self.family}: {self.description}", self.table(), "\n".join(notes)]

    def table(self) -> Table:
        """Return present and predicted errors as a table that shows itself."""
        head = ("parameter", "value", "unit", "present", "predicted", "change", "present 95 %",
                "predicted 95 %")  # fmt: skip
        rows = tuple(_cells(f, self.recorded_units) for f in self.forecasts)
        return Table(head, rows, right=(1, 5), drop=(7, 6, 2))

    @property
    def predicted(self) -> dict[str, float | None]:
        """Predicted standard errors by name."""
        return {f.name: f.predicted for f in self.forecasts}

    @property
    def present(self) -> dict[str, float | None]:
        """Present standard errors by name."""
        return {f.name: f.present for f in self.forecasts}

    def to_csv(self) -> str:
        """Return the table that a controller plays: a header with units, one row per sample."""
        columns = {f"{n} [{self.units[n]}]": v for n, v in self.signals.items()}
        if self.time.size:
            columns = {"time [s]": self.time, **columns}
        rows = [",".join(f"{value:.10g}" for value in row) for row in zip(*columns.values())]
        return "\n".join([",".join(columns), *rows, ""])

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, text and numbers, without the samples."""
        return {
            "family": self.family,
            "description": self.description,
            "criterion": self.criterion,
            "samples": int(next(iter(self.signals.values())).size),
            "limits": {
                k: list(v) if isinstance(v, tuple) else v for k, v in vars(self.limits).items()
            },
            "binding": list(self.binding),
            "parameters": [asdict(f) for f in self.forecasts],
            "notes": list(self.notes),
            "candidates": [asdict(c) for c in self.candidates],
        }

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the table atomically and return its path.

        Raises
        ------
        OutputError
            When the file exists and ``overwrite`` is false, or cannot be written.
        """
        return write_atomically(path, self.to_csv(), overwrite=overwrite, inputs=self.inputs)


def _cells(f: Forecast, recorded: Sequence[str]) -> tuple[str, ...]:
    shown = display_unit(f.unit, abs(f.value), recorded)
    present, predicted = (
        None if error is None else error * shown.factor for error in (f.present, f.predicted)
    )
    before, after = (
        None if ends is None else [end * shown.factor for end in ends]
        for ends in (f.present_ci95, f.predicted_ci95)
    )
    return (
        f.name,
        format_number(f.value * shown.factor, predicted),
        shown.unit,
        f"± {format_spread(present)}" if present else "not identified",
        f"± {format_spread(predicted)}" if predicted else "not identified",
        f"× {f.ratio:.2g}" if f.ratio is not None else "",
        format_interval(before, present),
        format_interval(after, predicted),
    )
