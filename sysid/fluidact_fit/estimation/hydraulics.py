"""Servo-hydraulic cylinder: equations, windowed regressions and the gray box.

The equations are plain functions. Stage one compares flows over short windows,

    A1 dy + (1/beta) int (V1 + A1 y) dp1 = int Q1(u, p1) dt
    A2 dy - (1/beta) int (V2 - A2 y) dp2 = int Q2(u, p2) dt

which needs no derivative of a noisy pressure. Stage two simulates all four states and
compares pressures and position. It is a lifted Gauss-Newton iteration (multiple shooting
whose node states are condensed away [1]_) with sensitivities that are the exact derivatives of
the Runge-Kutta scheme, built with CasADi.

References
----------
.. [1] J. Albersmeyer, M. Diehl, "The lifted Newton method and its application in
   optimization", SIAM Journal on Optimization 20(3), 2010.
.. [2] "A hydraulic actuator model using feedforward neural networks", 25th ABCM
   International Congress of Mechanical Engineering (COBEM), 2019.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import Experiment, FloatArray
from ..signals import smooth
from .separable import Basis

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
GRAY_NAMES = (
    "valve_gain_1", "valve_gain_2", "line_loss_1", "line_loss_2", "line_loss_3", "line_loss_4",
    "bulk_modulus", "dead_zone_negative", "dead_zone_positive", "viscous", "coulomb",
)  # fmt: skip
LOSSES = {1: ("line_loss_1", "line_loss_3"), 2: ("line_loss_4", "line_loss_2")}
_ROUND = 1e4  # Pa: pressure drop below which the square root of the gray box is rounded off
_MOST_SUBSTEPS = 16
_SLIP = 1e-3  # speed over which dry friction is rounded off, of the fast motion


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

    The paper [2]_ (equation 4, table 1) gives ``l = r Q`` with its sign; for ``u < 0`` that
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


# --------------------------------------------------------------------- stage two: gray box


@dataclass(frozen=True)
class GrayLog:
    """One experiment as the gray box sees it.

    ``command`` and ``step`` have shape ``(n - 1,)``; ``channels`` holds the measured states
    (0: p1, 1: p2, 2: y) and ``measured`` their values, ``(len(channels), n)``. ``guess`` holds
    all four states from smoothed signals, ``(n, 4)``.
    """

    command: FloatArray
    step: FloatArray
    channels: tuple[int, ...]
    measured: FloatArray
    guess: FloatArray

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.guess.shape[0])


@dataclass
class GraySolution:
    """Outcome of the gray-box iteration.

    ``states`` holds ``(n, 4)`` per log (p1, p2, y, v), ``residuals`` and ``jacobian`` the
    weighted rows of every log, channel after channel, initial states projected out.
    """

    values: dict[str, float]
    states: list[FloatArray]
    residuals: list[FloatArray]
    jacobian: list[FloatArray]
    cost: float
    iterations: int
    converged: bool
    active: Mask
    sigma: FloatArray
    nodes: list[FloatArray]
    defect: float = 0.0


def make_gray_log(e: Experiment, machine: Machine) -> GrayLog:
    """Prepare one experiment: measured channels and a first guess of all four states."""
    half = max(2, round(0.006 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, 2 * half, 3)
    guess = np.zeros((e.samples, 4))
    guess[:, 2], guess[:, 3] = motion.value, motion.rate
    channels = []
    for k, role in enumerate(("pressure_1", "pressure_2")):
        if role in e:
            guess[:, k] = smooth(e[role], e.sample_time, max(1, half // 2), 2).value
            channels.append(k)
    area_1, area_2, mass = machine.area(1), machine.area(2), machine.mass or 0.0
    inertia = mass * motion.curvature
    if 1 not in channels:
        guess[:, 1] = (guess[:, 0] * area_1 - inertia) / area_2
    if 0 not in channels:
        guess[:, 0] = (guess[:, 1] * area_2 + inertia) / area_1
    guess[:, :2] = np.clip(guess[:, :2], machine.tank, machine.supply)
    channels.append(2)
    roles = ("pressure_1", "pressure_2", "position")
    measured = np.array([e[roles[k]] for k in channels])
    return GrayLog(e["command"][:-1], np.diff(e.time), tuple(channels), measured, guess)


@lru_cache(maxsize=8)
def _segment_function(
    machine: Machine, segment: int, substeps: int, slip: float, free: tuple[str, ...]
) -> Any:
    """CasADi function that integrates states and sensitivities over a segment.

    ``(z, [u; h], theta) -> z after every sample``, with ``z`` the states and, column by column,
    their derivatives by the initial state and the free parameters. The variational
    equations run through the same Runge-Kutta scheme, which makes them its exact derivative.
    """
    import casadi as ca

    x, u, theta = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("theta", len(GRAY_NAMES))
    rate = _symbolic_rates(ca, x, u, theta, machine, slip)
    columns = 4 + len(free)
    s = ca.SX.sym("s", 4, columns)
    which = [GRAY_NAMES.index(n) for n in free]
    forced = ca.horzcat(ca.SX(4, 4), ca.jacobian(rate, theta)[:, which])
    flow = ca.mtimes(ca.jacobian(rate, x), s) + forced
    z = ca.vertcat(x, ca.vec(s))
    f = ca.Function("f", [z, u, theta], [ca.vertcat(rate, ca.vec(flow))])
    input = ca.SX.sym("input", 2)
    h = input[1] / substeps
    z0 = ca.SX.sym("z", 4 + 4 * columns)
    k1 = f(z0, input[0], theta)
    k2 = f(z0 + 0.5 * h * k1, input[0], theta)
    k3 = f(z0 + 0.5 * h * k2, input[0], theta)
    k4 = f(z0 + h * k3, input[0], theta)
    one = ca.Function("sub", [z0, input, theta], [z0 + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)])
    now = ca.MX.sym("z", 4 + 4 * columns)
    held, values = ca.MX.sym("input", 2), ca.MX.sym("theta", len(GRAY_NAMES))
    after = now
    for _ in range(substeps):
        after = one(after, held, values)
    step = ca.Function("step", [now, held, values], [after])
    return step.mapaccum("segment", segment)


def _symbolic_rates(ca: Any, x: Any, u: Any, theta: Any, machine: Machine, slip: float) -> Any:
    """Equations 1 to 4 with dead zone, losses and dry friction, as CasADi expressions.

    Equation 5 of the paper writes ``f`` with a dot although it is no derivative, and equation
    8 has ``M y'`` where equation 1 has ``M y''``: both are typing errors.
    """
    p = dict(zip(GRAY_NAMES, ca.vertsplit(theta)))
    beyond = ca.fmax(u - p["dead_zone_positive"], 0.0) + ca.fmin(u - p["dead_zone_negative"], 0.0)
    forward = beyond >= 0.0
    sign = ca.if_else(forward, 1.0, -1.0)

    def flow(chamber: int, pressure: Any) -> Any:
        inward = machine.supply - pressure
        outward = pressure - machine.tank
        ahead, back = (inward, outward) if chamber == 1 else (outward, inward)
        names = LOSSES[chamber]
        drop = ca.if_else(forward, ahead, back)
        loss = ca.if_else(forward, p[names[0]], p[names[1]])
        k = p[f"valve_gain_{chamber}"] * beyond * sign
        # without loss the root has an infinite slope at zero drop: rounded off below 0.1 bar
        size = ca.sqrt(drop * drop + _ROUND**2)
        return sign * 2.0 * k * drop / (k * loss + ca.sqrt((k * loss) ** 2 + 4.0 * size))

    p1, p2, y, v = ca.vertsplit(x)
    area_1, area_2 = machine.area(1), machine.area(2)
    beta, mass = p["bulk_modulus"], machine.mass
    volume_1 = (machine.dead_volume_1 or 0.0) + area_1 * y
    volume_2 = (machine.dead_volume_2 or 0.0) - area_2 * y
    dp1 = beta / volume_1 * (flow(1, p1) - area_1 * v)
    dp2 = -beta / volume_2 * (flow(2, p2) - area_2 * v)
    friction = p["viscous"] * v + p["coulomb"] * ca.tanh(v / slip)
    dv = (p1 * area_1 - p2 * area_2 - friction) / mass
    return ca.vertcat(dp1, dp2, v, dv)


class GrayBox:
    """Output error of pressures and position over several logs.

    Parameters
    ----------
    logs
        See :func:`make_gray_log`.
    machine
        Everything given; complete.
    friction
        Largest dry and viscous friction to be expected [N], [N s/m]: they set the speed over
        which dry friction is rounded off and the number of Runge-Kutta steps per sample.
    segment
        Samples between two shooting nodes.
    """

    def __init__(
        self,
        logs: Sequence[GrayLog],
        machine: Machine,
        friction: tuple[float, float],
        segment: int = 50,
    ) -> None:
        self.logs, self.machine = list(logs), machine
        self.segment = min(segment, *(log.samples - 1 for log in logs))
        step = max(float(np.max(log.step)) for log in logs)
        coulomb, viscous = friction
        mass = machine.mass or 1.0
        speeds = np.concatenate([np.abs(log.guess[:, 3]) for log in logs])
        self.slip = max(_SLIP * float(np.quantile(speeds, 0.95)), 1e-7)
        # Runge-Kutta of order 4 is stable up to 2.78 / h and exact enough below 0.3 / omega
        stiff = step * (coulomb / (mass * self.slip) + viscous / mass) / 2.0
        self.substeps = int(np.clip(np.ceil(max(stiff, step / 5e-4)), 1, _MOST_SUBSTEPS))
        if stiff > self.substeps:
            self.slip *= stiff / self.substeps

    def integrate(
        self, log: GrayLog, nodes: FloatArray, values: Mapping[str, float], free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        """States and sensitivities after every sample of every segment.

        Parameters
        ----------
        log
            The log.
        nodes : (segments, 4)
            State at the beginning of every segment [Pa, Pa, m, m/s].
        values
            All parameters by name.
        free
            Names of those whose sensitivities are wanted.

        Returns
        -------
        states : (segments, segment, 4)
        slopes : (segments, segment, 4, 4 + free)
            Derivatives by the node's state and the free parameters.
        """
        count, length = nodes.shape[0], self.segment
        columns = 4 + len(free)
        function = _segment_function(
            self.machine, length, self.substeps, self.slip, tuple(free)
        ).map(count)
        inputs = np.zeros((2, count * length))
        inputs[0, : log.command.size], inputs[0, log.command.size :] = log.command, log.command[-1]
        inputs[1, : log.step.size], inputs[1, log.step.size :] = log.step, log.step[-1]
        seed = np.zeros((4, columns))
        seed[:, :4] = np.eye(4)
        z = np.vstack((nodes.T, np.repeat(seed.T.reshape(-1, 1), count, axis=1)))
        theta = np.tile(np.array([[values[n]] for n in GRAY_NAMES]), (1, count * length))
        out = np.asarray(function(z, inputs, theta)).T.reshape(count, length, -1)
        slopes = out[:, :, 4:].reshape(count, length, columns, 4)
        return out[:, :, :4], np.swapaxes(slopes, 2, 3)

    def close(self, log: GrayLog, initial: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Nodes that follow from the initial state without gaps, ``(segments, 4)``.

        Parameters
        ----------
        log
            The log.
        initial : (4,)
            [Pa, Pa, m, m/s]
        values
            All parameters by name.
        """
        count = -(-(log.samples - 1) // self.segment)
        function = _segment_function(self.machine, self.segment, self.substeps, self.slip, ())
        theta = np.tile(np.array([[values[n]] for n in GRAY_NAMES]), (1, self.segment))
        inputs = np.zeros((2, count * self.segment))
        inputs[0, : log.command.size] = log.command
        inputs[1, : log.step.size] = log.step
        nodes = np.empty((count, 4))
        nodes[0] = initial
        seed = np.eye(4).reshape(-1)
        for k in range(count - 1):
            part = inputs[:, k * self.segment : (k + 1) * self.segment]
            out = function(np.concatenate((nodes[k], seed)), part, theta)
            nodes[k + 1] = np.asarray(out)[:4, -1]
        return nodes

    def nodes_of(self, log: GrayLog) -> FloatArray:
        """Node states from the first guess, ``(segments, 4)``."""
        count = -(-(log.samples - 1) // self.segment)
        return log.guess[np.arange(count) * self.segment].copy()

    def linearise(
        self,
        log: GrayLog,
        nodes: FloatArray,
        values: Mapping[str, float],
        free: Sequence[str],
    ) -> _Linear:
        """Condense one log: states as an affine function of initial state and parameters."""
        states, slopes = self.integrate(log, nodes, values, free)
        count, length = states.shape[:2]
        n, q = log.samples, 4 + len(free)
        value, slope = np.empty((count * length + 1, 4)), np.empty((count * length + 1, 4, q))
        shift, defects = np.empty((count * length + 1, 4)), np.zeros((count, 4))
        by_node, known = np.zeros((4, q)), np.zeros(4)
        by_node[:, :4] = np.eye(4)
        chain, offsets = np.empty((count, 4, q)), np.empty((count, 4))
        value[0], slope[0], shift[0] = nodes[0], by_node, known
        for k in range(count):
            rows = slice(k * length + 1, (k + 1) * length + 1)
            chain[k], offsets[k] = by_node, known
            forward = slopes[k, :, :, :4]
            slope[rows] = forward @ by_node
            slope[rows, :, 4:] += slopes[k, :, :, 4:]
            shift[rows] = forward @ known
            value[rows] = states[k]
            by_node, known = slope[rows][-1], shift[rows][-1]
            if k + 1 < count:
                defects[k] = states[k, -1] - nodes[k + 1]
                known = known + defects[k]
        return _Linear(value[:n], slope[:n], shift[:n], chain, offsets, defects)


@dataclass(frozen=True)
class _Linear:
    """States ``value + slope d + shift`` for a change ``d`` of initial state and parameters."""

    value: FloatArray
    slope: FloatArray
    shift: FloatArray
    chain: FloatArray
    offsets: FloatArray
    defects: FloatArray


_STATE_SCALE = np.array([1e5, 1e5, 1e-3, 1e-2])


@dataclass
class _Iterate:
    """A point of the iteration with everything computed there."""

    values: dict[str, float]
    nodes: list[FloatArray]
    linear: list[_Linear] = field(default_factory=list)
    cost: float = np.inf
    defect: float = np.inf


def solve_gray_box(
    box: GrayBox,
    start: Mapping[str, float],
    free: Sequence[str],
    scales: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
    sigma: FloatArray,
    nodes: Sequence[FloatArray] | None = None,
    max_iterations: int = 40,
) -> GraySolution:
    """Minimise the weighted output error over parameters and initial states.

    Parameters
    ----------
    box
        Logs and machine.
    start
        All parameters by name.
    free
        Those to be estimated.
    scales, bounds
        Typical size and closed range of each free one.
    sigma : (3,)
        Standard deviation of the residuals of p1, p2 and y [Pa, Pa, m].
    nodes
        Node states to begin with; from the measured signals when left out.
    max_iterations
        Limit on accepted and rejected steps together.
    """
    now = _Iterate(dict(start), [box.nodes_of(log) for log in box.logs])
    if nodes is not None:
        now.nodes = [n.copy() for n in nodes]
    _evaluate(box, now, free, sigma)
    scale = np.array([scales[n] for n in free])
    problem = _Problem(box, free, scale, bounds, sigma)
    now, first, _ = _iterate(problem, now, max_iterations, closed=False)
    # dry friction bends the states of a node so sharply that gaps can close no further: from
    # here on the nodes follow from the initial state
    closed = _Iterate(now.values, [box.close(log, n[0], now.values)
                                   for log, n in zip(box.logs, now.nodes)])  # fmt: skip
    _evaluate(box, closed, free, sigma)
    if not np.isfinite(closed.cost):
        return _finish(box, now, free, bounds, sigma, first, False)
    now, second, converged = _iterate(problem, closed, max_iterations, closed=True)
    return _finish(box, now, free, bounds, sigma, first + second, converged)


@dataclass(frozen=True)
class _Problem:
    box: GrayBox
    free: Sequence[str]
    scale: FloatArray
    bounds: Mapping[str, tuple[float, float]]
    sigma: FloatArray


def _iterate(
    problem: _Problem, now: _Iterate, most: int, closed: bool
) -> tuple[_Iterate, int, bool]:
    """Damped steps until none helps; with ``closed`` every trial is simulated without gaps."""
    p = problem
    damping, count = 1e-4, 0
    while count < most:
        count += 1
        step, initial, predicted = _propose(p.box, now, p.free, p.scale, p.bounds, p.sigma, damping)
        trial = _move(p.box, now, p.free, step, initial, p.bounds)
        if closed:
            trial.nodes = [p.box.close(log, n[0], trial.values)
                           for log, n in zip(p.box.logs, trial.nodes)]  # fmt: skip
        _evaluate(p.box, trial, p.free, p.sigma)
        merit, new = now.cost + now.defect, trial.cost + trial.defect
        if new <= merit * (1.0 + 1e-12):
            now, damping = trial, max(0.1 * damping, 1e-10)
            tight = now.defect <= 1e-6 * now.cost + 1e-12
            # a hundredth of one squared standard error
            if tight and merit - new <= 1e-2:
                return now, count, True
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e4 or predicted <= 1e-2:
                return now, count, predicted <= 1e-2 or closed
    return now, count, False


def _rows(log: GrayLog, linear: _Linear, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals (closed to first order) and Jacobian, channel after channel."""
    r, j = [], []
    for c, y in zip(log.channels, log.measured):
        r.append((y - linear.value[:, c] - linear.shift[:, c]) / sigma[c])
        j.append(linear.slope[:, c, :] / sigma[c])
    return np.concatenate(r), np.vstack(j)


def _evaluate(box: GrayBox, point: _Iterate, free: Sequence[str], sigma: FloatArray) -> None:
    cost, defect = 0.0, 0.0
    point.linear = []
    for log, nodes in zip(box.logs, point.nodes):
        with np.errstate(all="ignore"):
            linear = box.linearise(log, nodes, point.values, free)
        point.linear.append(linear)
        for c, y in zip(log.channels, log.measured):
            cost += float(np.sum(((y - linear.value[:, c]) / sigma[c]) ** 2))
        gaps = linear.defects / _defect_scale(sigma)
        defect += float(10.0 * np.sum(gaps**2))
    finite = np.isfinite(cost) and np.isfinite(defect)
    point.cost, point.defect = (cost, defect) if finite else (np.inf, np.inf)


def _defect_scale(sigma: FloatArray) -> FloatArray:
    """Size of a gap between two segments that weighs as much as one residual."""
    return np.array([sigma[0], sigma[1], sigma[2], 100.0 * sigma[2]])


def _propose(
    box: GrayBox,
    now: _Iterate,
    free: Sequence[str],
    scale: FloatArray,
    bounds: Mapping[str, tuple[float, float]],
    sigma: FloatArray,
    damping: float,
) -> tuple[FloatArray, list[FloatArray], float]:
    """Damped Gauss-Newton step of the parameters and the initial states."""
    p = len(free)
    h, g = np.zeros((p, p)), np.zeros(p)
    blocks = []
    for log, linear in zip(box.logs, now.linear):
        r, j = _rows(log, linear, sigma)
        own, shared = j[:, :4] * _STATE_SCALE, j[:, 4:] * scale
        q, t = np.linalg.qr(own)
        shared = shared - q @ (q.T @ shared)
        h += shared.T @ shared
        g += shared.T @ (r - q @ (q.T @ r))
        blocks.append((q, t, r, j))
    low = np.array([bounds[n][0] for n in free]) / scale
    high = np.array([bounds[n][1] for n in free]) / scale
    x = np.array([now.values[n] for n in free]) / scale
    step = _bounded_step(h, g, x, low, high, damping)
    initial = []
    for q, t, r, j in blocks:
        rest = r - j[:, 4:] @ (step * scale)
        # damped as well: the speed of a piston at rest is anything but linear in its friction
        damped = np.vstack((t, np.diag(np.sqrt(damping) * np.linalg.norm(t, axis=0))))
        target = np.concatenate((q.T @ rest, np.zeros(4)))
        initial.append(np.linalg.lstsq(damped, target, rcond=1e-12)[0] * _STATE_SCALE)
    return step * scale, initial, float(2.0 * g @ step - step @ h @ step)


def _bounded_step(
    h: FloatArray, g: FloatArray, x: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> FloatArray:
    """Marquardt step in scaled unknowns; those that would cross a bound stop on it."""
    step = np.zeros(g.size)
    free = ~(((x <= low) & (g <= 0.0)) | ((x >= high) & (g >= 0.0)))
    for _ in range(g.size + 1):
        index = np.flatnonzero(free)
        if index.size == 0:
            break
        size = np.sqrt(np.maximum(np.diag(h)[index], 1e-300))
        normal = h[np.ix_(index, index)] / np.outer(size, size) + damping * np.eye(index.size)
        rhs = (g[index] - h[index][:, ~free] @ step[~free]) / size
        step[index] = np.linalg.lstsq(normal, rhs, rcond=1e-14)[0] / size
        crossing = free & ((x + step < low) | (x + step > high))
        if not crossing.any():
            break
        step[crossing] = np.clip(x + step, low, high)[crossing] - x[crossing]
        free &= ~crossing
    return step


def _move(
    box: GrayBox,
    now: _Iterate,
    free: Sequence[str],
    step: FloatArray,
    initial: Sequence[FloatArray],
    bounds: Mapping[str, tuple[float, float]],
) -> _Iterate:
    """Take a step: parameters, initial states, and the nodes that follow from them."""
    values = dict(now.values)
    for name, d in zip(free, step):
        low, high = bounds[name]
        values[name] = float(np.clip(values[name] + d, low, high))
    nodes = []
    for linear, old, start in zip(now.linear, now.nodes, initial):
        d = np.concatenate((start, step))
        nodes.append(old + linear.chain @ d + linear.offsets)
    return _Iterate(values, nodes)


def _finish(
    box: GrayBox,
    now: _Iterate,
    free: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
    sigma: FloatArray,
    count: int,
    converged: bool,
) -> GraySolution:
    residuals, jacobian = [], []
    for log, linear in zip(box.logs, now.linear):
        r, j = _rows(log, linear, sigma)
        q = np.linalg.qr(j[:, :4] * _STATE_SCALE)[0]
        shared = j[:, 4:]
        residuals.append(r)
        jacobian.append(shared - q @ (q.T @ shared))
    active = np.array([not bounds[n][0] < now.values[n] < bounds[n][1] for n in free], dtype=bool)
    return GraySolution(
        now.values, [lin.value for lin in now.linear], residuals, jacobian, now.cost, count,
        converged, active, sigma, now.nodes, now.defect,
    )  # fmt: skip


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
