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
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...estimation.grid import Grid, make_grid
from ...estimation.inputs import PiecewiseInput, piecewise, settled_hold
from ...estimation.linear import forced_response
from ...estimation.named_model import NamedModel, Values
from ...estimation.problem import Basis
from ...estimation.recursion import behind_play
from ...estimation.response_model import Beginning
from ...experiment import Array, Experiment, FloatArray, Signal

ANY = Beginning()
_PARTS = 8  # of a sample time at most, for a command that moves
_PIECE = 0.0025  # of the range of the command, by which it moves in a part
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


@dataclass(frozen=True)
class _Run:
    """Command and grids of one run, computed once; ``commands`` begin with the level before.

    ``stepped`` tells that the command is a step from rest that was not recorded; ``unseen`` samples
    at the start answer to commands before it.
    """

    commands: FloatArray
    moves: bool
    stepped: bool
    nodes: Grid
    samples: Grid
    unseen: int


def _prepare(e: Experiment, unrecorded: float) -> _Run:
    signal = e.signals["command"]
    moves, samples = settled_hold(signal) != "zoh", make_grid(e.time)
    time, values = _refine(signal) if moves else (signal.time, signal.values)
    return _Run(
        np.append(signal.before, values), moves, signal.values.size == 1,
        samples if np.array_equal(time, e.time) else make_grid(time), samples,
        int(np.searchsorted(e.time, e.time[0] + unrecorded)),
    )  # fmt: skip


def _refine(signal: Signal) -> tuple[FloatArray, FloatArray]:
    """A moving command at instants so close that its way across a corner is nearly straight."""
    time, values, curve = signal.time, signal.values, piecewise(signal).coefficients
    power = np.arange(curve.shape[1])
    terms = power * curve[: time.size - 1] * np.diff(time)[:, None] ** power
    # the way of a sample at the speed of its beginning or its end, whichever is more
    moved = np.maximum(np.abs(terms[:, 1]), np.abs(terms.sum(axis=1)))
    moved /= max(float(np.ptp(values)), 1e-300)
    most = max(1, min(_PARTS, _MOST // time.size))
    # powers of two: few lengths of pieces
    parts = np.minimum(2 ** np.ceil(np.log2(np.maximum(moved / _PIECE, 1.0))), most).astype(int)
    piece = np.repeat(np.arange(parts.size), parts)
    past = np.diff(time)[piece] * _count_up(parts) / parts[piece]
    out = np.zeros(past.size)
    for column in curve.T[::-1]:
        out = out * past + column[piece]
    return np.append(time[piece] + past, time[-1]), np.append(out, values[-1])


def _count_up(counts: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
    """``0, 1, ... counts[0] - 1, 0, 1, ...``."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


class MotorModel:
    """Speeds of some runs as a function of the parameters, each with what belongs to it.

    The offset and the deviation that fades at the beginning are every run's own, where ``begin``
    says that there are any. Any other ``output`` than the speed is its integral.
    """

    def __init__(
        self, experiments: Sequence[Experiment], begin: Beginning = ANY, output: str = "speed"
    ) -> None:
        self.begin, self.integrates = begin, output != "speed"
        self.runs = [_prepare(e, begin.unrecorded) for e in experiments]
        self.measured = [
            e[output][r.unseen :] for e, r in zip(experiments, self.runs) if output in e
        ]
        self.resolutions = [e.signals[output].resolution for e in experiments if output in e]
        self._played: dict[int, tuple[float, FloatArray, FloatArray]] = {}

    def steady(self, index: int, values: Values) -> Array:
        """Steady speed at rest before a run and at the nodes of its command."""
        width = values["hysteresis"]
        known = self._played.get(index)
        if known is None or known[0] != np.real(width):
            size = float(np.real(width))
            known = self._played[index] = (size, *play(self.runs[index].commands, size))
        return static_speed(known[1] + known[2] * (width - known[0]), values)

    def response(self, index: int, values: Values) -> Array:
        """Output of one run, from the steady speed of the command before it [its unit]."""
        run, (rest, *_) = self.runs[index], (steady := self.steady(index, values))
        target = (steady[1:] - rest)[:, None]
        if run.moves:
            slope = np.diff(target[:, 0]) / np.diff(run.nodes.instants)
            target = np.column_stack((target, np.append(slope, 0.0)))
        instants = run.samples.instants
        if self.integrates:
            rest = rest * (instants - instants[0])
        return rest + forced_response(
            *lag(values, self.integrates), PiecewiseInput(run.nodes.instants, target),
            instants, dead_time=values.get("dead_time", 0.0), grid=run.nodes,
        )  # fmt: skip

    def named(self, names: tuple[str, ...]) -> NamedModel:
        """The model in the form the estimation takes; the gain enters linearly."""
        return NamedModel(
            names, ("gain",), self.columns, self.measured, resolutions=self.resolutions
        )

    def columns(self, index: int, values: Values) -> Basis:
        """Output per gain, and the columns of what is the run's own: offset, fading deviation."""
        run, shape = self.runs[index], self.response(index, {**values, "gain": 1.0})
        time = run.samples.instants
        own = [np.ones(time.size)] if self.begin.offset != "none" else []
        if not (run.stepped or self.begin.rest):
            fading = np.exp(-(time - time[0]) / values["time_constant"])
            own.append(1.0 - fading if self.integrates else fading)
        local = np.stack(own, axis=1) if own else np.zeros((time.size, 0))
        used = slice(run.unseen, None)
        return Basis(np.zeros(time.size - run.unseen), shape[used, None], local[used])
