"""Windows of the logs over which the flow balances; see ``docs/theory/hydraulic-cylinder.md``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...estimation.inputs import piecewise
from ...estimation.named_model import Values
from ...estimation.noise import noise_floor
from ...experiment import Array, BoolArray, Experiment, FloatArray
from ...mechanics.hydraulic_cylinder import HydraulicMachine, chamber_flow

_LEAST_DROP = 0.04  # of supply above tank: below it the piston stands at the end of its stroke
_STEADY = 0.01 * 0.7e9 / 0.5  # Pa/m: 1 % of the motion, compressing half a metre of oil of 0.7 GPa
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Windows:
    """Flow balance of one chamber (1 or 2) of one experiment over short windows.

    ``first`` holds the first sample of every window, ``(m,)``, each of ``samples`` intervals.
    """

    experiment: Experiment
    chamber: int
    machine: HydraulicMachine
    first: Rows
    samples: int

    def chosen(self, rows: BoolArray) -> Windows:
        """Some of the windows."""
        return replace(self, first=self.first[rows])

    @property
    def last(self) -> Rows:
        """Last sample of every window."""
        return self.first + self.samples

    @property
    def duration(self) -> FloatArray:
        """Time from first to last sample [s]."""
        return self.experiment.time[self.last] - self.experiment.time[self.first]

    @cached_property
    def command(self) -> FloatArray:
        """Mean command of every interval of the log, ``(n - 1,)`` [V]."""
        return mean_command(self.experiment)

    @cached_property
    def pressure(self) -> FloatArray:
        """Pressure at the ends of the intervals, ``(n,)`` [Pa]."""
        return self.experiment.sampled(f"pressure_{self.chamber}")

    @cached_property
    def motion(self) -> FloatArray:
        """``A dy / duration``, ``(m,)``: flow that moves the piston [m3/s]."""
        y = self.experiment["position"]
        moved = self.machine.area(self.chamber) * (y[self.last] - y[self.first])
        return np.asarray(moved / self.duration)

    @cached_property
    def swelling(self) -> FloatArray:
        """``-+ int V dp / duration``, ``(m,)`` [m3 Pa/s]: ``motion = Q + swelling / beta``.

        Zero where the dead volume is not known.
        """
        y = self.experiment["position"]
        total = np.append(0.0, np.cumsum(self.machine.swelling(self.chamber, y, self.pressure)))
        return np.asarray((total[self.last] - total[self.first]) / self.duration)

    def mean(self, per_interval: Array) -> Array:
        """Time average of a value per interval of the log over every window."""
        step = np.diff(self.experiment.time)
        total = np.concatenate(([0.0], np.cumsum(per_interval * step)))
        return np.asarray((total[self.last] - total[self.first]) / self.duration)

    @cached_property
    def mean_command(self) -> FloatArray:
        """Over every window [V]."""
        return self.mean(self.command)

    @cached_property
    def mean_pressure(self) -> FloatArray:
        """Over every window [Pa]."""
        return self.mean(0.5 * (self.pressure[:-1] + self.pressure[1:]))

    def modelled(self, values: Values) -> Array:
        """Expected ``motion``: mean flow of the valve, less what compresses the oil, ``(m,)``."""
        flow = mean_flow(self.chamber, self.command, self.pressure, values, self.machine)
        return self.mean(flow) + self.swelling / values.get("bulk_modulus", np.inf)


def mean_command(e: Experiment) -> FloatArray:
    """Command over every interval between samples, ``(n - 1,)`` [V].

    Held between its samples it is the command itself. One that acts late or moves between them
    counts by its mean: the valve's flow is proportional to it, and the oil integrates the flow.
    """
    signal = e.signals["command"]
    if signal.hold in (None, "zoh") and np.array_equal(signal.time, e.time):
        return e.sampled("command")[:-1]
    from scipy.interpolate import PPoly

    u = piecewise(signal, level=signal.before)
    knots = np.append(u.nodes, max(u.nodes[-1], e.time[-1]) + 1.0)
    total = PPoly(np.real(u.coefficients[:, ::-1].T), knots).antiderivative()
    # what is left of the level is zero before the first node
    return np.asarray(
        signal.before + np.diff(total(np.maximum(e.time, knots[0]))) / np.diff(e.time)
    )


def mean_flow(
    chamber: int, command: Array, pressure: Array, values: Values, machine: HydraulicMachine
) -> Array:
    """`chamber_flow` over the intervals between ``(n,)`` pressures, mean of that at both ends."""
    ends = pressure[:-1], pressure[1:]
    before, after = (chamber_flow(chamber, command, p, values, machine) for p in ends)
    return 0.5 * (before + after)


def cut_windows(
    experiments: Sequence[Experiment], chambers: Sequence[int], machine: HydraulicMachine,
    length: float, overlap: int = 1,
) -> list[Windows]:  # fmt: skip
    """Windows of so many seconds of every recorded chamber that say something of the valve.

    Left out are windows with hardly any pressure drop at the valve (a piston at the end of its
    stroke) and, where the dead volume is not given, those in which the pressure changes.
    ``overlap`` windows begin within one length.
    """
    out = []
    for e in experiments:
        samples = max(round(length / max(e.sample_time, 1e-12)), 2)
        first = np.arange(0, e.samples - samples, max(samples // overlap, 1))
        for chamber in chambers if first.size > 1 else ():
            if f"pressure_{chamber}" in e:
                w = Windows(e, chamber, machine, first, samples)
                out.append(w.chosen(_usable(w)))
    return [w for w in out if w.first.size]


def _usable(w: Windows) -> BoolArray:
    """Windows with a pressure drop at the valve; of a chamber of unknown volume steady ones."""
    machine, rows = w.machine, w.first[:, None] + np.arange(w.samples)
    pressure = w.pressure[rows].mean(axis=1)
    drop = machine.pressure_drop(w.chamber, w.mean_command, pressure)
    kept = drop > _LEAST_DROP * (machine.supply - machine.tank)
    return kept & _steady(w, pressure) if machine.dead_volume(w.chamber) is None else kept


def _steady(w: Windows, pressure: FloatArray) -> BoolArray:
    """Windows amid a plateau: command held and ``pressure`` constant two windows to either side.

    The flow ``V/beta dp/dt`` that compresses the oil has to be below 1 % of the motion's; a
    volume of half a metre of piston area and 0.7 GPa are taken for that judgement alone.
    """
    reach = 2 * max(w.samples // int(w.first[1] - w.first[0]), 1)
    kept = np.zeros(w.first.size, dtype=bool)
    if w.first.size <= 2 * reach:
        return kept
    ends, begins = w.first[2 * reach :], w.first[: -2 * reach]
    duration = w.experiment.time[ends] - w.experiment.time[begins]
    slope = np.abs(pressure[2 * reach :] - pressure[: -2 * reach]) / duration
    changes = np.append(0, np.cumsum(np.diff(w.experiment.sampled("command")) != 0.0))
    speed = np.abs(w.motion)[reach:-reach] / w.machine.area(w.chamber)
    random = 3.0 * noise_floor(w.pressure, 2) * np.sqrt(2.0 / w.samples) / duration
    kept[reach:-reach] = (changes[w.last[2 * reach :]] == changes[begins]) & (
        slope <= np.maximum(_STEADY * speed, random)
    )
    return kept
