"""Servo-hydraulic cylinder: equations, windowed regressions and small networks.

The equations are plain functions. Stage one compares flows over short windows,

    A1 dy + (1/beta) int (V1 + A1 y) dp1 = int Q1(u, p1) dt
    A2 dy - (1/beta) int (V2 - A2 y) dp2 = int Q2(u, p2) dt

which needs no derivative of a noisy pressure. Stage two is :mod:`.gray_box`.

References
----------
.. [1] "A hydraulic actuator model using feedforward neural networks", 25th ABCM
   International Congress of Mechanical Engineering (COBEM), 2019.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import Experiment, FloatArray
from .separable import Basis

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
GRAY_NAMES = (
    "valve_gain_1", "valve_gain_2", "line_loss_1", "line_loss_2", "line_loss_3", "line_loss_4",
    "bulk_modulus", "dead_zone_negative", "dead_zone_positive", "viscous", "coulomb",
)  # fmt: skip
LOSSES = {1: ("line_loss_1", "line_loss_3"), 2: ("line_loss_4", "line_loss_2")}


# ------------------------------------------------------------------------------- equations


def effective_command(command: Array, negative: complex, positive: complex) -> Array:
    """Command beyond the dead zone: ``max(u - u+, 0) + min(u - u-, 0)``.

    Parameters
    ----------
    command : (n,)
        [V]
    negative, positive
        Edges of the dead zone [V]; complex in derivatives.
    """
    above = np.where(np.real(command - positive) > 0.0, command - positive, 0.0)
    below = np.where(np.real(command - negative) < 0.0, command - negative, 0.0)
    return np.asarray(above + below)


def orifice_flow(command: Array, drop: Array, gain: complex, loss: complex) -> Array:
    """Flow through an orifice in series with a line, solved in closed form.

    ``Q = K u sqrt(drop - r |Q|)`` holds the flow on both sides. With ``k = K |u|`` its
    solution is ``Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 drop)) / 2``, written here as
    ``sgn(u) 2 k drop / (k r + sqrt(k^2 r^2 + 4 drop))`` which loses no digits at small flow.

    The paper [1]_ (equation 4, table 1) gives ``l = r Q`` with its sign; for ``u < 0`` that
    would make the loss drive the flow. A loss brakes, so it goes with ``|Q|``.

    Parameters
    ----------
    command : (n,)
        Beyond the dead zone [V].
    drop : (n,)
        Pressure across valve and line [Pa]; flow turns back where it is negative.
    gain
        ``K`` [m3/(s V Pa^0.5)].
    loss
        ``r`` [Pa s/m3].

    Returns
    -------
    (n,) flow with the sign of the command [m3/s].
    """
    sign = np.where(np.real(command) >= 0.0, 1.0, -1.0)
    k = gain * command * sign
    size = np.where(np.real(drop) >= 0.0, drop, -drop) + 1e-9
    root = np.sqrt((k * loss) ** 2 + 4.0 * size)
    return np.asarray(sign * 2.0 * k * drop / (k * loss + root))


def pressure_drop(
    chamber: int, extending: Mask, pressure: Array, supply: float, tank: float
) -> Array:
    """Pressure that drives the flow of a chamber: equation 4 of the paper without losses.

    Parameters
    ----------
    chamber
        1 (fed for ``u >= 0``) or 2 (fed for ``u < 0``).
    extending : (n,)
        Where the command is not negative.
    pressure : (n,)
        In the chamber [Pa].
    supply, tank
        [Pa]
    """
    fed = extending if chamber == 1 else ~extending
    return np.asarray(np.where(fed, supply - pressure, pressure - tank))


def chamber_flow(
    chamber: int,
    command: Array,
    pressure: Array,
    values: Mapping[str, Any],
    supply: float,
    tank: float,
) -> Array:
    """Flow into chamber 1 or out of chamber 2, ``K_i u g_i`` of equation 4.

    Parameters
    ----------
    chamber
        1 or 2.
    command, pressure : (n,)
        [V], [Pa]
    values
        Valve gain, the two losses of the chamber and the dead zone, by name.
    supply, tank
        [Pa]

    Returns
    -------
    (n,) flow, positive while the piston extends [m3/s].
    """
    beyond = effective_command(command, values["dead_zone_negative"], values["dead_zone_positive"])
    extending = np.real(beyond) >= 0.0
    drop = pressure_drop(chamber, extending, pressure, supply, tank)
    forward, backward = LOSSES[chamber]
    loss = np.where(extending, values[forward], values[backward])
    return orifice_flow(beyond, drop, values[f"valve_gain_{chamber}"], loss)


# --------------------------------------------------------------------------------- machine


@dataclass(frozen=True)
class Machine:
    """What is given, not estimated: areas [m2], volumes [m3], mass [kg], pressures [Pa].

    ``None`` where nobody said.
    """

    area_1: float | None = None
    area_2: float | None = None
    dead_volume_1: float | None = None
    dead_volume_2: float | None = None
    mass: float | None = None
    supply: float = 0.0
    tank: float = 0.0

    def area(self, chamber: int) -> float:
        """Piston area of a chamber [m2]."""
        area = self.area_1 if chamber == 1 else self.area_2
        assert area is not None
        return area

    def dead_volume(self, chamber: int) -> float | None:
        """Volume of a chamber and its line at position 0 [m3]."""
        return self.dead_volume_1 if chamber == 1 else self.dead_volume_2

    def volume(self, chamber: int, position: Array) -> Array | None:
        """``V1 + A1 y`` or ``V2 - A2 y`` [m3]."""
        dead = self.dead_volume(chamber)
        if dead is None:
            return None
        sign = 1.0 if chamber == 1 else -1.0
        return np.asarray(dead + sign * self.area(chamber) * position)

    @property
    def complete(self) -> bool:
        """Whether the gray box can be simulated."""
        given = (self.area_1, self.area_2, self.dead_volume_1, self.dead_volume_2, self.mass)
        return all(v is not None for v in given)


# ---------------------------------------------------------------- stage one: windowed flow


@dataclass(frozen=True)
class Windows:
    """Flow balance of one chamber of one experiment over short windows.

    Attributes
    ----------
    experiment
        Index of the experiment.
    chamber
        1 or 2.
    first, last : (m,)
        First and last sample of every window.
    duration : (m,)
        [s]
    motion : (m,)
        ``A dy / duration``: flow that moves the piston [m3/s].
    swelling : (m,)
        ``-+ int V dp / duration``: times ``1/beta`` the flow that compresses oil [m3 Pa/s],
        with the sign that makes ``motion = Q + swelling / beta``. Zero where the dead
        volume is not known.
    command, before, after
        Held command and pressure at both ends of every interval of the log, ``(n - 1,)``.
    step : (n - 1,)
        [s]
    """

    experiment: int
    chamber: int
    first: npt.NDArray[np.intp]
    last: npt.NDArray[np.intp]
    duration: FloatArray
    motion: FloatArray
    swelling: FloatArray
    command: FloatArray
    before: FloatArray
    after: FloatArray
    step: FloatArray

    def mean(self, per_interval: Array) -> Array:
        """Time average of a value per interval of the log over every window."""
        total = np.concatenate(([0.0], np.cumsum(per_interval * self.step)))
        return np.asarray((total[self.last] - total[self.first]) / self.duration)

    def flow(self, values: Mapping[str, Any], machine: Machine) -> Array:
        """Mean flow of the valve over every window, ``(m,)`` [m3/s]."""
        ends = [
            chamber_flow(self.chamber, self.command, p, values, machine.supply, machine.tank)
            for p in (self.before, self.after)
        ]
        return self.mean(0.5 * (ends[0] + ends[1]))


def _white_noise(values: FloatArray) -> float:
    """Standard deviation of white noise, from second differences [unit of the values]."""
    return float(np.median(np.abs(np.diff(values, 2)))) / 0.6745 / float(np.sqrt(6.0))


def window_length(experiments: Sequence[Experiment]) -> float:
    """Length of the windows [s]: long against the noise of the position, short otherwise.

    20 ms, more where the position is so noisy that it would blur the speed by over 2 %, at
    most 0.1 s and never less than 4 samples.
    """
    step = max(e.sample_time for e in experiments)
    noise, speed = 0.0, 0.0
    for e in experiments:
        y = e["position"]
        noise = max(noise, _white_noise(y))
        width = max(1, round(0.05 / e.sample_time))
        if y.size > width:
            rate = np.abs(y[width:] - y[:-width]) / (width * e.sample_time)
            speed = max(speed, float(np.quantile(rate, 0.98)))
    wanted = np.sqrt(2.0) * noise / max(0.02 * speed, 1e-12)
    return float(max(min(max(wanted, 0.02), 0.1), 4.0 * step))


def make_windows(
    experiment: Experiment,
    index: int,
    chamber: int,
    machine: Machine,
    length: float,
    overlap: int = 1,
) -> Windows | None:
    """Cut one experiment into windows and keep those that say something of the valve.

    Left out: windows in which the valve has hardly any pressure drop left (a piston at the
    end of its stroke), and, where the dead volume is not given, windows in which the pressure
    changes, because the flow that compresses the oil is not known there.

    Parameters
    ----------
    experiment, index
        The log and its number.
    chamber
        1 or 2.
    machine
        What is given.
    length
        Of a window [s].
    overlap
        How many windows begin within one length; a network wants many rows, a covariance
        wants them apart.
    """
    e = experiment
    p = e[f"pressure_{chamber}"]
    samples = max(round(length / max(e.sample_time, 1e-12)), 2)
    stride = max(samples // overlap, 1)
    first = np.arange(0, e.samples - samples, stride)
    if first.size < 2:
        return None
    last = first + samples
    y, time = e["position"], e.time
    duration = time[last] - time[first]
    volume = machine.volume(chamber, y)
    swelling = np.zeros(first.size)
    sign = -1.0 if chamber == 1 else 1.0
    if volume is not None:
        parts = np.concatenate(([0.0], np.cumsum(0.5 * (volume[1:] + volume[:-1]) * np.diff(p))))
        swelling = sign * (parts[last] - parts[first]) / duration
    kept = _kept_windows(e, chamber, machine, first, samples, stride, volume is None)
    return Windows(
        index, chamber, first[kept], last[kept], duration[kept],
        machine.area(chamber) * (y[last] - y[first])[kept] / duration[kept], swelling[kept],
        e["command"][:-1], p[:-1], p[1:], np.diff(time),
    )  # fmt: skip


def _kept_windows(
    e: Experiment,
    chamber: int,
    machine: Machine,
    first: npt.NDArray[np.intp],
    samples: int,
    stride: int,
    steady_only: bool,
) -> Mask:
    p, u = e[f"pressure_{chamber}"], e["command"]
    head = machine.supply - machine.tank
    rows = first[:, None] + np.arange(samples)
    mean = p[rows].mean(axis=1)
    command = u[rows]
    drop = pressure_drop(chamber, command.mean(axis=1) >= 0.0, mean, machine.supply, machine.tank)
    kept = drop > 0.04 * head
    if steady_only:
        kept &= (np.ptp(command, axis=1) == 0.0) & _steady(
            e, mean, _white_noise(p), first, samples, stride
        )
    return np.asarray(kept)


def _steady(
    e: Experiment,
    mean: FloatArray,
    noise: float,
    first: npt.NDArray[np.intp],
    samples: int,
    stride: int,
) -> Mask:
    """Windows amid a plateau: command held and pressure constant two windows to either side.

    The flow ``V/beta dp/dt`` that compresses the oil has to be below 1 % of the motion's; a
    volume of half a metre of piston area and 0.7 GPa are taken for that judgement alone.
    """
    reach = 2 * max(samples // stride, 1)
    kept = np.zeros(first.size, dtype=bool)
    if first.size <= 2 * reach:
        return kept
    middle = slice(reach, first.size - reach)
    duration = e.time[first[2 * reach :]] - e.time[first[: -2 * reach]]
    slope = np.abs(mean[2 * reach :] - mean[: -2 * reach]) / duration
    u = e["command"]
    change = np.concatenate(([0], np.cumsum(np.diff(u) != 0.0)))
    last = np.minimum(first + samples, e.samples - 1)
    held = change[last[2 * reach :]] == change[first[: -2 * reach]]
    y = e["position"]
    speed = np.abs(y[last[middle]] - y[first[middle]]) / (e.time[last] - e.time[first])[middle]
    random = 3.0 * noise * np.sqrt(2.0 / samples) / duration
    kept[middle] = held & (slope <= np.maximum(0.01 * speed * 0.7e9 / 0.5, random))
    return kept


def flow_columns(
    windows: Sequence[Windows], machine: Machine
) -> Callable[[int, Mapping[str, Any]], Basis]:
    """Model of the stage-one regression, for :class:`.parametric.NamedModel`."""

    def columns(index: int, values: Mapping[str, Any]) -> Basis:
        w = windows[index]
        flow = w.flow(values, machine)
        if "bulk_modulus" in values:
            flow = flow + w.swelling / values["bulk_modulus"]
        empty = np.zeros((flow.size, 0))
        return Basis(flow, empty, empty)

    return columns


# ----------------------------------------------------------------------------- small networks


@dataclass(frozen=True)
class Network:
    """One hidden layer of rectified linear units with its standardisation.

    ``y = output_offset + output_scale (w2 max(w1 x + b1, 0) + b2)`` with
    ``x = (input - input_offset) / input_scale``.

    Attributes
    ----------
    weights_1 : (hidden, inputs)
    biases_1 : (hidden,)
    weights_2 : (1, hidden)
    biases_2 : (1,)
    input_offset, input_scale : (inputs,)
        In the units of the inputs.
    output_offset, output_scale : (1,)
        In the unit of the output.
    """

    weights_1: FloatArray
    biases_1: FloatArray
    weights_2: FloatArray
    biases_2: FloatArray
    input_offset: FloatArray
    input_scale: FloatArray
    output_offset: FloatArray
    output_scale: FloatArray

    def __call__(self, inputs: FloatArray) -> FloatArray:
        """Evaluate.

        Parameters
        ----------
        inputs : (n, inputs)
            In their own units.

        Returns
        -------
        (n,) outputs in their own unit.
        """
        x = (inputs - self.input_offset) / self.input_scale
        layer = np.maximum(x @ self.weights_1.T + self.biases_1, 0.0)
        y = layer @ self.weights_2[0] + self.biases_2[0]
        return np.asarray(self.output_offset[0] + self.output_scale[0] * y)


def train_network(inputs: FloatArray, target: FloatArray, hidden: int, seed: int) -> Network:
    """Train one hidden layer by multi-start Levenberg-Marquardt (:mod:`.network`).

    Parameters
    ----------
    inputs : (n, inputs)
        In any units.
    target : (n,)
        In any unit.
    hidden
        Number of units.
    seed
        Of the starts.
    """
    from .network import search

    centre, spread = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), 1e-300)
    middle, size = float(target.mean()), max(float(target.std()), 1e-300)
    rng = np.random.default_rng([seed, hidden, inputs.shape[1]])
    net = search(
        (inputs - centre) / spread, (target - middle) / size, (hidden,), rng, starts=8
    ).best.network
    return Network(
        net.weights[0], net.biases[0], net.weights[1], net.biases[1],
        centre, spread, np.array([middle]), np.array([size]),
    )  # fmt: skip
