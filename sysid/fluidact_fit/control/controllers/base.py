"""What every controller is to the closed loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import inf

from ..filters import System


class Controller(ABC):
    """A controller that runs once per sample.

    Attributes
    ----------
    sample_time
        [s]
    limits
        Lowest and highest command [its unit]; what is beyond is cut off.
    unreached
        What its file asks for and it cannot do, in words.
    """

    unreached: tuple[str, ...] = ()

    def __init__(self, sample_time: float, limits: tuple[float, float] = (-inf, inf)) -> None:
        self.sample_time, self.limits = sample_time, limits

    @abstractmethod
    def reset(self) -> None:
        """Forget everything that was measured."""

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
