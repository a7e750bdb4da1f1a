"""Experiments: a log as a family gets it. SI arrays with named roles, nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .rows import Array as Array
from .rows import BoolArray as BoolArray
from .rows import FloatArray as FloatArray
from .rows import blocks
from .units import after_number

IndexArray = npt.NDArray[np.integer[Any]]
Hold = Literal["zoh", "foh", "smooth", "auto"]


def is_finite(values: FloatArray) -> bool:
    """Return whether all numbers of a record are finite; shape ``(n,)``."""
    return all(bool(np.isfinite(values[at]).all()) for at in blocks(values.shape[0]))


def where_finite(values: FloatArray) -> BoolArray:
    """Mask of the finite numbers of a record, shape ``(n,)``; read only."""
    # where all of them are, as nearly always, one entry stands for every one
    return np.broadcast_to(np.True_, values.shape) if is_finite(values) else np.isfinite(values)


def where_both(one: BoolArray, other: BoolArray) -> BoolArray:
    """Samples that are among both, shape ``(n,)``; one of both where the other is all samples."""
    if other.all():
        return one
    return other if one.all() else one & other


def where_changed(values: FloatArray) -> IndexArray:
    """Samples after which a record changes, shape ``(m,)``."""
    parts = ((at.start, values[at.start : at.stop + 1]) for at in blocks(values.size - 1))
    return np.concatenate([begin + np.flatnonzero(np.diff(part)) for begin, part in parts])


def all_of(values: Array, used: BoolArray) -> Array:
    """Values at some samples; without a copy where it is all of them."""
    return values if used.all() else values[used]


def at_rows(values: Array, rows: IndexArray) -> Array:
    """Values at increasing rows; a view where the rows follow each other."""
    if rows.size and rows[-1] - rows[0] + 1 == rows.size:
        return values[rows[0] : rows[-1] + 1]
    return np.asarray(values[rows])


@dataclass(frozen=True)
class Signal:
    """One quantity over time, in SI units.

    Attributes
    ----------
    role
        The role it plays, for example ``"force"``.
    time
        Instants of the values, shape ``(n,)`` [s]. Usually the log's own instants; a
        step that was not recorded has one node, the instant of the step.
    values
        Shape ``(n,)`` [SI unit of the role].
    unit
        The SI unit, for example ``"N"``.
    hold
        How the signal behaves between its instants: ``"zoh"`` (zero-order hold) is held,
        ``"foh"`` (first-order hold) follows straight lines, ``"smooth"`` a smooth curve through
        the samples. ``"auto"`` is yet to be settled, once for all logs of a fit.
        ``None`` for signals that drive nothing.
    before
        Value before the first instant [SI unit]; the first value unless a step said
        otherwise.
    resolution
        Smallest distance between two distinct neighbouring values that the log shows
        (converter or print resolution) [SI unit]; 0 when the signal is constant.
    recorded
        What was recorded of the samples that were replaced because no machine can have given
        them, by their number [SI unit].
    logged_in
        The unit of the log, and the size of one of it [SI unit]: what messages speak in. The SI
        unit where a log says none.
    """

    role: str
    time: FloatArray
    values: FloatArray
    unit: str
    hold: Hold | None = None
    before: float = 0.0
    resolution: float = 0.0
    recorded: Mapping[int, float] = field(default_factory=dict)
    logged_in: tuple[str, float] | None = None

    def text(self, value: float, form: str = ".3g") -> str:
        """A value [SI unit] as a message says it, in the unit of the log: ``3.5 bar``."""
        unit, size = self.logged_in or (self.unit, 1.0)
        return f"{value / size:{form}}{after_number(unit)}"

    def beginning(self, values: int) -> Signal:
        """The signal without what comes after its first values."""
        kept = {k: x for k, x in self.recorded.items() if k < values}
        return replace(self, time=self.time[:values], values=self.values[:values], recorded=kept)


@dataclass(frozen=True)
class Experiment:
    """One run of one log: SI arrays with named roles.

    Attributes
    ----------
    name
        File name, with ``#run`` appended when the log holds several runs.
    log
        Index of the log this run came from, counted from 0.
    time
        Instants of the samples, shape ``(n,)`` [s]; strictly increasing. Empty for
        static data without a time column.
    signals
        Role to signal.
    sample_time
        Median time between samples [s]; 0 when there is no time.
    uniform
        Whether all samples lie on one grid of ``sample_time`` (to one part in a
        million of it), in which case ``time`` has been snapped to it.
    attributes
        Anything else the dialect says about the run, for example a direction.
    """

    name: str
    log: int
    time: FloatArray
    signals: Mapping[str, Signal]
    sample_time: float
    uniform: bool
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, role: str) -> FloatArray:
        """Return the values of a role, shape ``(n,)`` [SI]."""
        return self.signals[role].values

    @property
    def uneven(self) -> FloatArray | None:
        """Instants of samples that lie on no grid, shape ``(n,)`` [s]; ``None`` of any others."""
        return None if self.uniform or not self.time.size else self.time

    def sampled(self, role: str) -> FloatArray:
        """Return the values of a role at the samples, shape ``(n,)`` [SI].

        An input that stepped and was not recorded has one node; here it is written out, as is
        a constant of a log without time. One that was sampled at other instants is read off
        between them, as it is held or by straight lines.
        """
        signal = self.signals[role]
        if not self.time.size:
            full = signal.values.size == self.samples
            return signal.values if full else np.full(self.samples, signal.values[-1])
        if signal.time is self.time or np.array_equal(signal.time, self.time):
            return signal.values
        if signal.time.size > 1 and signal.hold != "zoh":
            return np.interp(self.time, signal.time, signal.values)
        at = np.searchsorted(signal.time, self.time, side="right")
        values: FloatArray = np.append(signal.before, signal.values)[at]
        return values

    def __contains__(self, role: object) -> bool:
        return role in self.signals

    @property
    def log_name(self) -> str:
        """Name of the log, without the run."""
        return self.name.split("#")[0]

    @property
    def units(self) -> dict[str, str]:
        """Role to SI unit."""
        return {role: signal.unit for role, signal in self.signals.items()}

    @property
    def samples(self) -> int:
        """Number of samples."""
        if self.time.size:
            return int(self.time.size)
        return max((s.values.size for s in self.signals.values()), default=0)

    def with_readings(self, role: str, values: FloatArray) -> Experiment:
        """The run with other readings of a role."""
        signal = replace(self.signals[role], values=values)
        return replace(self, signals={**self.signals, role: signal})

    def without(self, role: str) -> Experiment:
        """The run without a role."""
        return replace(self, signals={r: s for r, s in self.signals.items() if r != role})

    def beginning(self, samples: int) -> Experiment:
        """The run without what comes after its first samples; itself if it has no more."""
        if self.samples <= samples:
            return self
        time, signals = self.time[:samples], {}
        for role, s in self.signals.items():
            own = self.time.size and s.time.size != self.time.size
            values = np.searchsorted(s.time, time[-1], side="right") if own else samples
            signals[role] = s.beginning(int(values))
        return replace(self, time=time, signals=signals)
