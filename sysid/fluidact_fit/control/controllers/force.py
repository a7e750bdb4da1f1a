"""Feed-forward force control of a single-acting cylinder, with smoothing.

The command for a wanted force comes from a map that knows the hysteresis by the motion state

    s_j = sgn(F_j - F_(j-1)), held while F rests,

and is applied over ``n_s`` samples (equation 8 of the paper [1]_):

    u_j = u_(j-1) + i (u* - u_(j-1)) / n_s,    i = 1 ... n_s.

Both readings of it are here. ``held``: the ``u_(j-1)`` on the right is the command at which the
target changed, as figure 14 draws it; the command then moves along a straight line. ``recursive``:
it is the command of the last sample, as printed; the course is S-shaped and over half-way sooner.
With ``n_s = 1`` there is no difference and no smoothing. A new target begins again with ``i = 1``.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force Control
   of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis Characteristic", Actuators
   14, 162, 2025, section 3.4 and equations 3 and 8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Literal

from ...routines import (
    Argument,
    Draft,
    Expression,
    Machine,
    Operand,
    Routine,
    choose,
    constant,
    minimum,
)
from .base import RoutineController, Travel
from .routines import arguments, limited

Reading = Literal["held", "recursive"]
ForceMap = Callable[[float, float, float], float]
"""Force [N] of a command at a position [m] in a motion state."""


@dataclass(frozen=True)
class Smoothing:
    """Equation 8: over how many samples a command is applied, and how it is read."""

    steps: int
    reading: Reading = "held"


ANY_FORCE = Travel("force")


@dataclass(frozen=True)
class Start:
    """Start of a force loop: the wanted force [N], and the command for it."""

    force: float = 0.0
    command: float = 0.0


class FeedforwardForceController(RoutineController):
    """The controller of the paper.

    Parameters
    ----------
    command_for, target
        The map from a force, a position and a motion state, and what it gives as an argument.
    sample_time
        [s]
    smoothing
    supply
        Gain and offset of ``target = gain command + offset``.
    travel
        Of the force.
    limits
        Of the command.
    start
    """

    def __init__(
        self, command_for: Routine, target: Argument, sample_time: float, smoothing: Smoothing, *,
        supply: tuple[float, float] = (1.0, 0.0), travel: Travel = ANY_FORCE,
        limits: tuple[float, float] = (-inf, inf), start: Start = Start(),
    ) -> None:  # fmt: skip
        super().__init__(sample_time, travel, limits)
        self.smoothing, self.start, self.begins = smoothing, start, (start.command,)
        self._map, self._target, self._supply = command_for, target, supply

    def routines(self, unit: str = "") -> tuple[Routine, ...]:
        """Motion state, map and smoothing, in order; see :meth:`RoutineController.routines`."""
        reference = replace(arguments(self.travel)[0], held=True)
        return (
            _direction(reference, self.start),
            replace(self._map, careful=True),
            self._smoothed(reference, unit),
        )

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        """Return the command; see :meth:`Controller.step`.

        The way over ``n_s`` samples begins anew when the reference changes. The target itself
        may move on the way, with the position.
        """
        direction, command_for, smoothed = self._machines
        state, clamped = direction(wanted=reference)
        known = {"force": reference, "position": measured["position"], "direction": state}
        target, beyond = ask(command_for, known)
        command, outside = smoothed(wanted=reference, target=target)
        self.outside = bool(clamped) or bool(beyond) or bool(outside)
        return (float(command),)

    def _smoothed(self, reference: Argument, unit: str) -> Routine:
        """Equation 8, written as a mean of two values, so that what was rounded before fades."""
        about = "Command of this sample."
        draft = Draft("step", about, unit, self.sample_time, careful=True)
        wanted, drive = draft.argument(reference), draft.argument(self._target)
        (gain, offset), start = self._supply, self.start
        steps, held = float(self.smoothing.steps), self.smoothing.reading == "held"
        last, count = draft.state("last", start.force), draft.state("count", steps)
        now = draft.state("now", start.command)
        goal: Expression = drive
        if self._supply != (1.0, 0.0):
            goal = (drive - constant("offset", offset)) * constant("per_gain", 1.0 / gain)
        goal = draft.let("goal", limited(goal, self.limits))
        changed = draft.let("changed", _by_change(wanted, last, 1, 1, 0))
        draft.put(last, wanted)
        going = minimum(count + 1.0, constant("steps", steps))
        draft.put(count, choose(changed, ">", 0.0, 1.0, going))
        base: Expression = now
        if held:
            base = draft.state("start", start.command)
            draft.put(base, choose(changed, ">", 0.0, now, base))
        share = draft.let("share", count * constant("per_steps", 1.0 / steps))
        draft.put(now, base * (1.0 - share) + goal * share)
        return draft.returns(now)


def ask(machine: Machine, known: Mapping[str, Any]) -> tuple[Any, Any]:
    """Output of a map for what is known by name, all else being zero, and its flag."""
    return machine(**{a.name: known.get(a.name, 0.0) for a in machine.routine.arguments})


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
