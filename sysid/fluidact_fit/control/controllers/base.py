"""Interface of every controller to the closed loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, isnan

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

    def __init__(
        self, sample_time: float, travel: Travel, limits: tuple[float, float] = (-inf, inf),
        begins: tuple[float, ...] = (),
    ) -> None:  # fmt: skip
        self.sample_time, self.travel, self.limits = sample_time, travel, limits
        self.begins = self._given = begins
        self.outside = False

    def reset(self) -> None:
        """Forget everything that was measured."""
        self._given, self.outside = self.begins, False

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        """Return the commands that are held until the next sample.

        Parameters
        ----------
        measured
            Role to value [SI], of this sample.
        reference
            Where the output is wanted at this sample [SI].
        """
        low, high = self.travel.reach
        wanted = min(max(reference, low), high)
        self.outside = wanted != reference
        if isnan(reference) or not self._readable(measured):
            self.outside = True
            self._interrupt(wanted)
        else:
            self._given = self.compute(measured, wanted)
        return self._given

    def _readable(self, measured: Mapping[str, float]) -> bool:
        """Return whether what was measured can be true."""
        (low, high), value = self.travel.reach, measured[self.travel.role]
        return isfinite(value) and low <= value <= high

    def _interrupt(self, wanted: float) -> None:
        """Be ready for the next reading; ``wanted`` may be NaN."""
        return

    @abstractmethod
    def compute(self, measured: Mapping[str, float], wanted: float) -> tuple[float, ...]:
        """Return the commands for readings that can be true."""

    def linear(self) -> System:
        """From the output falling short to the commands, compensation and limits apart.

        Raises
        ------
        NotImplementedError
            When the controller feeds nothing back.
        """
        raise NotImplementedError(f"{type(self).__name__} feeds nothing back")

    def limit(self, command: float) -> float:
        """Cut a command off at the limits."""
        return min(max(command, self.limits[0]), self.limits[1])
