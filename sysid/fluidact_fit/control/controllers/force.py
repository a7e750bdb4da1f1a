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
from dataclasses import dataclass
from math import inf, isnan
from typing import Literal

from .base import Controller, Travel

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
        super().__init__(sample_time, travel, limits, (start.command,))
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
        self._reference = self.start.force
        self.observed = float("nan")

    def _readable(self, measured: Mapping[str, float]) -> bool:
        return not isnan(measured["position"])  # beyond its range the map takes the end of it

    def _interrupt(self, wanted: float) -> None:
        if not isnan(wanted):
            self._wanted.step(wanted)

    def compute(self, measured: Mapping[str, float], wanted: float) -> tuple[float, ...]:
        """Command for readings that can be true.

        The way over ``n_s`` samples begins anew when the reference changes. The target itself
        may move on the way, with the position.
        """
        place = measured["position"]
        state = self._wanted.step(wanted)
        if wanted != self._reference:
            self.smoothing.begin()
            self._reference = wanted
        target, clamped = self._command_for(wanted, place, state)
        self.outside |= clamped
        command = self.smoothing.step(self.limit(target))
        if self._observer is not None:
            self.observed = self._observer(command, place, self._applied.step(command))
        return (command,)
