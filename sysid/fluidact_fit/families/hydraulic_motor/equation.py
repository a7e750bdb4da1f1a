"""Hydraulic motor behind a proportional valve: dead zone, saturation, hysteresis, lag.

    w          = play(u, h) - u_0                      spool command, hysteresis of width h
    n_0        = sgn(w) g / k (1 - exp(-k x)),  x = min(|w|, u_s) - d, 0 below the dead zone
    tau n' + n = n_0(t - T_d)

with dead zone ``d``, slope ``g`` at its edge, curvature ``k`` (0: a straight line) and saturation
from the command ``u_s`` on. All commands count from ``u_0``, at which the machine stands still
(1500 us of a servo pulse); the dead zone may have another edge for either direction. A log of the
angle shows ``n`` by its integral. The play is that of magnetisation and friction of the spool:
going up the valve opens ``h/2`` later, going down it closes ``h/2`` later.

A held command gives a held steady speed, and the lag behind it is exact. Of a command
that moves between its samples the steady speed is taken to follow straight lines between
instants several times closer than these, so that the corners of the curve stay sharp.

References
----------
.. [1] J. Watton, Fundamentals of Fluid Power Control, 2012, chapters 3 and 5.
.. [2] M. Krasnoselskii, A. Pokrovskii, Systems with Hysteresis, 1989: the play operator.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from ...estimation.inputs import PiecewiseInput, piecewise, settled_hold, straight_lines
from ...estimation.linear import forced_response
from ...estimation.named_model import NamedModel, Values
from ...estimation.problem import Basis
from ...estimation.recursion import behind_play
from ...estimation.response_model import Beginning
from ...estimation.transfer_model import ANY, TransferModel
from ...experiment import Array, Experiment, FloatArray, Signal
from ...specification import Variant

SHORT_OF_TOP = 1e-5  # share of the top speed that the inverse leaves out: the curve is flat there
_PARTS = 8  # of a sample time at most, for a command that moves
_MOST = 400_000  # instants of a moving command


def play(command: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Play of a width, and its derivative by the width, ``(n,)`` each [unit of the command]."""
    out = behind_play(command, width)
    before = np.concatenate((command[:1], out[:-1]))
    pulled, pushed = command - 0.5 * width > before, command + 0.5 * width < before
    last = np.maximum.accumulate(np.where(pulled | pushed, np.arange(out.size), -1))
    # until either edge is met the output does not depend on the width
    return out, np.where(last < 0, 0.0, np.where(pulled[last], -0.5, 0.5))


def edges(values: Values) -> tuple[Any, Any]:
    """Negative and positive edge of the dead zone, counted from the offset of the command."""
    both = values.get("dead_zone", 0.0)
    return values.get("dead_zone_negative", -both), values.get("dead_zone_positive", both)


def static_speed(spool: Array, values: Values) -> Array:
    """Steady speed over the spool's command ``(n,)`` behind the play.

    ``values`` holds the dead zone or its two edges, gain, curvature and, where there is one, the
    offset of the command and the saturation command.
    """
    spool = spool - values.get("command_offset", 0.0)
    forward, (low, high) = np.real(spool) >= 0.0, edges(values)
    top = values.get("saturation_command", np.inf)
    size = np.where(forward, spool, -spool)
    x = np.where(np.real(size) < np.real(top), size, top) - np.where(forward, high, -low)
    x = np.where(np.real(x) > 0.0, x, 0.0)
    k = values["curvature"] + 1e-12  # the limit of a straight line
    speed = -values["gain"] / k * _expm1(-k * x)
    return np.asarray(np.where(forward, speed, -speed))


def _expm1(z: Array) -> Array:
    """``exp(z) - 1`` where the imaginary part is the tiny one of a complex step: cheaper."""
    real = np.expm1(np.real(z))
    return real + 1j * np.imag(z) * (1.0 + real) if np.iscomplexobj(z) else real


def lag(values: Values, integrates: bool) -> tuple[Array, Array, Array]:
    """State space from steady speed to speed, or to its integral."""
    rate = 1.0 / values["time_constant"]
    if not integrates:
        return np.array([[-rate]]), np.array([rate]), np.ones(1)
    return np.array([[-rate, 0.0], [1.0, 0.0]]), np.array([rate, 0.0]), np.array([0.0, 1.0])


class Steady:
    """Steady speed under the commands ``(n,)`` of a run; a play of some width is followed once."""

    def __init__(self, commands: FloatArray) -> None:
        self.commands = commands
        self._played: tuple[tuple[float, float], FloatArray, FloatArray] | None = None

    def __call__(self, values: Values, before: Any) -> Array:
        """Under a command at rest before the run, and under its own, ``(n + 1,)``."""
        width = values["hysteresis"]
        at = float(np.real(width)), float(np.real(before))
        if self._played is None or self._played[0] != at:
            self._played = at, *play(np.append(at[1], self.commands), at[0])
        _, place, slope = self._played
        return static_speed(place + slope * (width - at[0]), values)


class SettledModel:
    """Steady speeds of settled points, in the order in which they were visited.

    Before the first one the machine stood still, the spool in the middle.
    """

    def __init__(self, experiments: Sequence[Experiment]) -> None:
        self.runs = [Steady(e.sampled("command")) for e in experiments]
        self.measured = [e["speed"] for e in experiments if "speed" in e]

    def response(self, index: int, values: Values) -> Array:
        """Speeds of one run, shape ``(n,)`` [their unit]."""
        return self.runs[index](values, values.get("command_offset", 0.0))[1:]

    def columns(self, index: int, values: Values) -> Basis:
        """Speeds of one run per gain."""
        shape = self.response(index, {**values, "gain": 1.0})
        return Basis(np.zeros(shape.size), [shape])

    def named(self, names: tuple[str, ...]) -> NamedModel:
        """The model in the form the estimation takes; the gain enters linearly."""
        return NamedModel(names, ("gain",), self.columns, self.measured)


class MotorModel(TransferModel):
    """Speeds of some runs behind the lag, or any other output, which is their integral.

    Runs begin with any speed, unless ``begin`` says that they are at rest under their command. A
    run with an offset of its own begins at any angle or position by that.
    """

    gain: ClassVar[str | None] = "gain"
    dead_zone: ClassVar[bool] = False

    def __init__(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning = ANY
    ) -> None:
        self.integrates = variant.output.name != "speed"
        super().__init__(self, variant, experiments, begin)
        self.runs = [Steady(p.u.coefficients[:, 0]) for p in self.prepared]
        self.before = [e.signals["command"].before for e in experiments]

    def realise(self, values: Values) -> tuple[Array, Array, Array]:
        """State space of the lag."""
        return lag(values, self.integrates)

    def beginnings(self, values: Values, offset: bool) -> tuple[Array, Array, Sequence[int]]:
        """``(A, C)``, and the states that a run may begin with."""
        a, _, c = self.realise(values)
        return a, c, (0,) if offset else range(c.size)

    def level(self, signal: Signal) -> float:
        """Zero: the speed is not proportional to the command."""
        return 0.0

    def read(self, signal: Signal) -> PiecewiseInput:
        """The command; one that moves, at instants so close that it is nearly straight."""
        return piecewise(signal) if settled_hold(signal) == "zoh" else _refine(signal)

    def forced(self, index: int, values: Values) -> Array:
        """Response of one run to its steady speed, per gain, shape ``(n,)``."""
        p = self.prepared[index]
        steady = self.runs[index]({**values, "gain": 1.0}, self.before[index])
        rest, target, nodes = steady[0], steady[1:] - steady[0], p.nodes.instants
        held = p.u.coefficients.shape[1] == 1
        u = PiecewiseInput(nodes, target[:, None]) if held else straight_lines(nodes, target)
        a, b, c = self.realise(values)
        y = forced_response(
            a, b, c, u, p.time, dead_time=values.get("dead_time", 0.0), grid=p.nodes
        )
        return (y + (rest if c.size == 1 else rest * (p.time - p.time[0])))[p.unseen :]


def _refine(signal: Signal) -> PiecewiseInput:
    """A moving command, straight between instants so close that its corners stay sharp."""
    time, values, curve = signal.time, signal.values, piecewise(signal).coefficients[:-1]
    parts = max(1, min(_PARTS, _MOST // time.size))
    past = np.diff(time)[:, None] * np.arange(parts) / parts
    between = np.zeros(past.shape)
    for column in curve.T[::-1]:
        between = between * past + column[:, None]
    return straight_lines(
        np.append(time[:-1, None] + past, time[-1]), np.append(between, values[-1])
    )
