"""Feed-forward force control of a single-acting cylinder, with smoothing and an observer.

The command for a wanted force comes from a map that knows the hysteresis by the motion state

    s_j = sgn(F_j - F_(j-1)), held while F rests,

and is applied over ``n_s`` samples (equation 8 of the paper [1]_):

    u_j = u_(j-1) + i (u* - u_(j-1)) / n_s,    i = 1 ... n_s.

Both readings of it are here. ``held``: the ``u_(j-1)`` on the right is the command at which the
target changed, as figure 14 draws it; the command then moves along a straight line. ``recursive``:
it is the command of the last sample, as printed; the course is S-shaped and over half-way sooner.
With ``n_s = 1`` there is no difference and no smoothing. A new target begins again with ``i = 1``.

The observer asks the opposite map for the force of the command that is applied.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force Control
   of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis Characteristic", Actuators
   14, 162, 2025, section 3.4 and equations 3 and 8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf, isnan
from typing import Literal

from ...routines import Argument, Draft, Expression, Operand, Routine, choose, constant, minimum
from .base import Controller, Travel
from .routines import arguments, limited

Reading = Literal["held", "recursive"]
CommandMap = Callable[[float, float, float], tuple[float, bool]]
"""Command for a force [N] at a position [m] in a motion state; whether any of them was clamped."""
ForceMap = Callable[[float, float, float], float]
"""Force [N] of a command at a position [m] in a motion state."""


class MotionState:
    """Sign of the latest change of a signal: 1 loading, -1 unloading; 1 before any change.

    ``start`` is where the signal has been before the first sample.
    """

    def __init__(self, start: float = 0.0) -> None:
        self._start = start
        self.reset()

    def reset(self) -> None:
        """Forget the signal."""
        self._last, self.state = self._start, 1

    def step(self, value: float) -> int:
        """Take a sample and return the state."""
        if value != self._last:
            self.state = 1 if value > self._last else -1
        self._last = value
        return self.state


class Smoothing:
    """Equation 8: the way from one command to the next, over ``steps`` samples."""

    def __init__(self, steps: int, reading: Reading = "held") -> None:
        self.steps, self.reading = steps, reading
        self.reset()

    def reset(self, command: float = 0.0) -> None:
        """Have applied a command for ever."""
        self._start = self._now = command
        self._count = self.steps

    def begin(self) -> None:
        """Count from the command of now: there is another target."""
        self._start, self._count = self._now, 0

    def step(self, target: float) -> float:
        """Return the command of this sample."""
        self._count = min(self._count + 1, self.steps)
        start = self._start if self.reading == "held" else self._now
        self._now = start + self._count * (target - start) / self.steps
        return self._now


ANY_FORCE = Travel("force")


@dataclass(frozen=True)
class Start:
    """Start of a force loop: the wanted force [N], and the command for it."""

    force: float = 0.0
    command: float = 0.0


class FeedforwardForceController(Controller):
    """The controller of the paper.

    Attributes
    ----------
    observed
        Force that the observer gives for the command just applied [N]; NaN without one.
    """

    def __init__(
        self, command_for: CommandMap, sample_time: float, smoothing: Smoothing,
        observer: ForceMap | None = None, *, travel: Travel = ANY_FORCE,
        limits: tuple[float, float] = (-inf, inf), start: Start = Start(),
    ) -> None:  # fmt: skip
        super().__init__(sample_time, travel, limits)
        self.begins = (start.command,)
        self.smoothing, self.start = smoothing, start
        self._command_for, self._observer = command_for, observer
        self._wanted, self._applied = MotionState(start.force), MotionState(start.command)
        self.reset()

    def reset(self) -> None:
        """Forget what was wanted and applied since the start."""
        super().reset()
        self.smoothing.reset(self.start.command)
        self._wanted.reset()
        self._applied.reset()
        self._reference, self._given = self.start.force, self.begins
        self.observed = float("nan")

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        """Return the command; see :meth:`Controller.step`.

        The way over ``n_s`` samples begins anew when the reference changes. The target itself
        may move on the way, with the position, beyond whose range the map takes the end of it.
        """
        low, high = self.travel.reach
        wanted = min(max(reference, low), high)
        self.outside = wanted != reference
        if isnan(reference) or isnan(measured["position"]):
            self.outside = True
            if not isnan(wanted):
                self._wanted.step(wanted)
        else:
            self._given = (self._command(measured["position"], wanted),)
        return self._given

    def _command(self, place: float, wanted: float) -> float:
        state = self._wanted.step(wanted)
        if wanted != self._reference:
            self.smoothing.begin()
            self._reference = wanted
        target, clamped = self._command_for(wanted, place, state)
        self.outside |= clamped
        command = self.smoothing.step(self.limit(target))
        if self._observer is not None:
            self.observed = self._observer(command, place, self._applied.step(command))
        return command

    def routines(
        self, drive_for: Routine, target: Argument, supply: tuple[float, float], unit: str
    ) -> tuple[Routine, Routine, Routine]:
        """Return what is called, in order: motion state, map and smoothing.

        Parameters
        ----------
        drive_for, target
            The map from the force, and what it gives as an argument of the last routine.
        supply
            Gain and offset of ``drive = gain command + offset`` for what the map gives.
        unit
            Of the command.
        """
        reference = replace(arguments(self.travel)[0], held=True)
        return (
            _direction(reference, self.start),
            replace(drive_for, careful=True),
            _smoothed(self, reference, target, supply, unit),
        )


def _direction(reference: Argument, start: Start) -> Routine:
    """Motion state of what is wanted; the first value is a change from that of the start."""
    about = "Motion state of the wanted force: 1 loading, -1 unloading."
    draft = Draft("direction", about, "1", careful=True)
    wanted = draft.argument(reference)
    last, state = draft.state("last", start.force), draft.state("moved", 1.0)
    draft.put(state, _by_change(wanted, last, -1.0, 1.0, state))
    draft.put(last, wanted)
    return draft.returns(state)


def _by_change(
    value: Expression, last: Expression, fell: Operand, rose: Operand, rests: Operand
) -> Expression:
    return choose(value, ">", last, rose, choose(value, "<", last, fell, rests))


def _smoothed(
    c: FeedforwardForceController, reference: Argument, target: Argument,
    supply: tuple[float, float], unit: str,
) -> Routine:  # fmt: skip
    """Equation 8, written as a mean of two values, so that what was rounded before fades."""
    draft = Draft("step", "Command of this sample.", unit, c.sample_time, careful=True)
    wanted, drive = draft.argument(reference), draft.argument(target)
    gain, offset = supply
    steps, held = float(c.smoothing.steps), c.smoothing.reading == "held"
    start = c.start
    last, count = draft.state("last", start.force), draft.state("count", steps)
    now = draft.state("now", start.command)
    goal: Expression = drive
    if supply != (1.0, 0.0):
        goal = (drive - constant("offset", offset)) * constant("per_gain", 1.0 / gain)
    goal = draft.let("goal", limited(goal, c.limits))
    changed = draft.let("changed", _by_change(wanted, last, 1, 1, 0))
    draft.put(last, wanted)
    draft.put(count, choose(changed, ">", 0.0, 1.0, minimum(count + 1.0, constant("steps", steps))))
    base: Expression = now
    if held:
        base = draft.state("start", start.command)
        draft.put(base, choose(changed, ">", 0.0, now, base))
    share = draft.let("share", count * constant("per_steps", 1.0 / steps))
    draft.put(now, base * (1.0 - share) + goal * share)
    return draft.returns(now)
