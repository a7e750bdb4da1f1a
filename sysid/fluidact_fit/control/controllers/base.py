"""Interface of every controller to the closed loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite, nan

from ...routines import Machine, Routine
from ..filters import System

_FAR = 10.0  # strokes beyond what the logs covered: nothing that is measured lies there


@dataclass(frozen=True)
class Travel:
    """Role, unit and range of what is controlled, as the logs covered it."""

    role: str
    unit: str = ""
    low: float = -inf
    high: float = inf

    @property
    def reach(self) -> tuple[float, float]:
        """Plausible range: 10 strokes beyond either end."""
        far = _FAR * (self.high - self.low)
        return self.low - far, self.high + far


class Controller(ABC):
    """A controller that runs once per sample.

    It acts as its exports do: what is wanted beyond :attr:`Travel.reach` is taken at the end of it,
    and without a reading that can be true nothing is computed. The last commands stand, and what
    was going on goes on with the next reading.

    Attributes
    ----------
    sample_time
        [s]
    travel
        Of what is wanted.
    limits
        Lowest and highest command [its unit]; what is beyond is cut off.
    begins
        Commands after a reset, that keep the machine where it starts.
    outside
        Whether the latest sample was clamped, or could not be read.
    unreached
        What its file asks for and it cannot do, in words.
    """

    unreached: tuple[str, ...] = ()
    begins: tuple[float, ...] = ()

    def __init__(
        self, sample_time: float, travel: Travel, limits: tuple[float, float] = (-inf, inf)
    ) -> None:
        self.sample_time, self.travel, self.limits = sample_time, travel, limits
        self.outside = False

    def reset(self) -> None:
        """Forget everything that was measured."""
        self.outside = False

    @abstractmethod
    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        """Return the commands that are held until the next sample.

        Parameters
        ----------
        measured
            Role to value [SI], of this sample.
        reference
            Where the output is wanted at this sample [SI].
        """

    def linear(self) -> System | None:
        """From the output falling short to the commands, compensation and limits apart.

        ``None`` where nothing is fed back.
        """
        return None

    def limit(self, command: float) -> float:
        """Cut a command off at the limits."""
        return min(max(command, self.limits[0]), self.limits[1])


class RoutineController(Controller):
    """A controller that runs the routines that are exported of it.

    The first takes what is wanted and what is measured; what it gives goes to the others, of which
    each gives a command, or is the command where there are none.
    """

    @abstractmethod
    def routines(self, unit: str = "") -> tuple[Routine, ...]:
        """Return what has to be called, in order; ``unit`` is that of the commands."""

    @cached_property
    def _machines(self) -> list[Machine]:
        return [Machine(r) for r in self.routines()]

    def reset(self) -> None:
        """Forget everything that was measured."""
        super().reset()
        for machine in self._machines:
            machine.reset()

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        """Return the commands; see :meth:`Controller.step`."""
        first, *others = self._machines
        reading = measured[self.travel.role]
        known = {self.travel.role: reading if isfinite(reading) else nan, "wanted": reference}
        value, outside = first(**known)
        found = [machine(**{first.routine.name: value}) for machine in others]
        self.outside = bool(outside) or any(beyond for _, beyond in found)
        return tuple(float(command) for command, _ in found or [(value, outside)])
