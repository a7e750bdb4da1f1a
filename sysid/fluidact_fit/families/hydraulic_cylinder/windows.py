"""Windows of the logs over which the flow balances; see ``docs/theory/hydraulic-cylinder.md``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...estimation.named_model import Values
from ...estimation.noise import noise_floor
from ...experiment import Array, BoolArray, Experiment, FloatArray
from ...mechanics.hydraulic_cylinder import Machine, chamber_flow

_LEAST_DROP = 0.04  # of supply above tank: below it the piston stands at the end of its stroke
_STEADY = 0.01 * 0.7e9 / 0.5  # Pa/m: 1 % of the motion, compressing half a metre of oil of 0.7 GPa
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Windows:
    """Flow balance of one chamber (1 or 2) of one experiment, by its index, over short windows.

    Attributes
    ----------
    first, last, duration : (m,)
        First and last sample of every window, and the time between them [s].
    motion : (m,)
        ``A dy / duration``: flow that moves the piston [m3/s].
    swelling : (m,)
        ``-+ int V dp / duration`` [m3 Pa/s]: ``motion = Q + swelling / beta``. Zero where the
        dead volume is not known.
    command, step, pressure : (n - 1,), (n - 1,), (n,)
        Held command [V] and length [s] of every interval of the log, pressure at its ends [Pa].
    """

    experiment: int
    chamber: int
    first: Rows
    last: Rows
    duration: FloatArray
    motion: FloatArray
    swelling: FloatArray
    command: FloatArray
    step: FloatArray
    pressure: FloatArray

    def chosen(self, rows: BoolArray | slice) -> Windows:
        """Some of the windows."""
        names = ("first", "last", "duration", "motion", "swelling")
        return replace(self, **{n: getattr(self, n)[rows] for n in names})

    def mean(self, per_interval: Array) -> Array:
        """Time average of a value per interval of the log over every window."""
        total = np.concatenate(([0.0], np.cumsum(per_interval * self.step)))
        return np.asarray((total[self.last] - total[self.first]) / self.duration)

    @cached_property
    def mean_command(self) -> FloatArray:
        """Over every window [V]."""
        return self.mean(self.command)

    @cached_property
    def mean_pressure(self) -> FloatArray:
        """Over every window [Pa]."""
        return self.mean(0.5 * (self.pressure[:-1] + self.pressure[1:]))

    def flow(self, values: Values, machine: Machine) -> Array:
        """Mean flow of the valve over every window, ``(m,)`` [m3/s]."""
        return self.mean(mean_flow(self.chamber, self.command, self.pressure, values, machine))

    def modelled(self, values: Values, machine: Machine) -> Array:
        """Expected ``motion``: that flow, less what compresses the oil."""
        flow = self.flow(values, machine)
        beta = values.get("bulk_modulus")
        return flow if beta is None else flow + self.swelling / beta


def mean_flow(
    chamber: int, command: Array, pressure: Array, values: Values, machine: Machine
) -> Array:
    """`chamber_flow` over the intervals between ``(n,)`` pressures, mean of that at both ends."""
    ends = pressure[:-1], pressure[1:]
    before, after = (chamber_flow(chamber, command, p, values, machine) for p in ends)
    return 0.5 * (before + after)


def window_length(experiments: Sequence[Experiment]) -> float:
    """Length of the windows [s]: long against the noise of the position, short otherwise.

    20 ms, more where the position is so noisy that it would blur the speed by over 2 %, at
    most 0.1 s and never less than 4 samples.
    """
    step = max(e.sample_time for e in experiments)
    noise, speed = 0.0, 0.0
    for e in experiments:
        y = e["position"]
        noise = max(noise, noise_floor(y, 2))
        width = max(1, round(0.05 / e.sample_time))
        if y.size > width:
            rate = np.abs(y[width:] - y[:-width]) / (width * e.sample_time)
            speed = max(speed, float(np.quantile(rate, 0.98)))
    wanted = np.sqrt(2.0) * noise / max(0.02 * speed, 1e-12)
    return float(max(min(max(wanted, 0.02), 0.1), 4.0 * step))


def cut_windows(
    experiments: Sequence[Experiment], chambers: Sequence[int], machine: Machine, length: float,
    overlap: int = 1,
) -> list[Windows]:  # fmt: skip
    """Windows of so many seconds of every recorded chamber that say something of the valve.

    Left out are windows with hardly any pressure drop at the valve (a piston at the end of its
    stroke) and, where the dead volume is not given, those in which the pressure changes.
    ``overlap`` windows begin within one length.
    """
    out = []
    for index, e in enumerate(experiments):
        samples = max(round(length / max(e.sample_time, 1e-12)), 2)
        first = np.arange(0, e.samples - samples, max(samples // overlap, 1))
        for chamber in chambers if first.size > 1 else ():
            if f"pressure_{chamber}" in e:
                out.append(_make_windows(e, index, chamber, machine, first, samples))
    return [w for w in out if w.first.size]


def _make_windows(
    e: Experiment, index: int, chamber: int, machine: Machine, first: Rows, samples: int
) -> Windows:
    """Keep the windows of one chamber that begin at ``first`` and say something."""
    y, time = e["position"], e.time
    p, u = e.sampled(f"pressure_{chamber}"), e.sampled("command")
    rows = first[:, None] + np.arange(samples)
    extending, pressure = u[rows].mean(axis=1) >= 0.0, p[rows].mean(axis=1)
    drop = machine.pressure_drop(chamber, extending, pressure)
    kept = drop > _LEAST_DROP * (machine.supply - machine.tank)
    if machine.dead_volume(chamber) is None:
        kept &= _steady(e, pressure, noise_floor(p, 2), first, samples)
    swelling = np.concatenate(([0.0], np.cumsum(machine.swelling(chamber, y, p))))
    first = first[kept]
    last = first + samples
    duration = time[last] - time[first]
    return Windows(
        index, chamber, first, last, duration,
        machine.area(chamber) * (y[last] - y[first]) / duration,
        (swelling[last] - swelling[first]) / duration,
        u[:-1], np.diff(time), p,
    )  # fmt: skip


def _steady(
    e: Experiment, pressure: FloatArray, noise: float, first: Rows, samples: int
) -> BoolArray:
    """Windows amid a plateau: command held and pressure constant two windows to either side.

    The flow ``V/beta dp/dt`` that compresses the oil has to be below 1 % of the motion's; a
    volume of half a metre of piston area and 0.7 GPa are taken for that judgement alone.
    """
    reach = 2 * max(samples // int(first[1] - first[0]), 1)
    kept = np.zeros(first.size, dtype=bool)
    if first.size <= 2 * reach:
        return kept
    time, u, y = e.time, e.sampled("command"), e["position"]
    middle = slice(reach, first.size - reach)
    ends, begins = first[2 * reach :], first[: -2 * reach]
    duration = time[ends] - time[begins]
    slope = np.abs(pressure[2 * reach :] - pressure[: -2 * reach]) / duration
    change = np.concatenate(([0], np.cumsum(np.diff(u) != 0.0)))
    last = np.minimum(first + samples, time.size - 1)
    held = change[last[2 * reach :]] == change[begins]
    speed = np.abs(y[last[middle]] - y[first[middle]]) / (time[last] - time[first])[middle]
    random = 3.0 * noise * np.sqrt(2.0 / samples) / duration
    kept[middle] = held & (slope <= np.maximum(_STEADY * speed, random))
    return kept
