"""Interface of every plant to the closed loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from math import inf
from types import MappingProxyType

from ...block import Port
from ...estimation.sampled import Sampled

Limits = tuple[float, float]
"""Lowest and highest command that is taken [its unit]."""
UNLIMITED: Limits = (-inf, inf)


class Plant(ABC):
    """A machine that takes commands once per sample and is followed exactly in between.

    Attributes
    ----------
    commands
        What it takes, held from sample to sample.
    controlled
        What is to follow the reference.
    sample_time
        [s]
    limits
        Of each command: those of the logs where the machine is that of a file. What is beyond is
        taken at the end of it, as by every export of the file.
    anywhere
        Whether the machine is the same at every place of the controlled output.
    units
        Of what only this machine measures, by role.
    """

    commands: tuple[Port, ...]
    controlled: Port
    sample_time: float
    limits: tuple[Limits, ...]
    anywhere: bool = False
    units: Mapping[str, str] = MappingProxyType({})

    @abstractmethod
    def reset(self, output: float = 0.0, commands: Sequence[float] = ()) -> None:
        """Be at rest with the controlled output there [its unit].

        ``commands`` are those that have been held until now. A machine whose output follows from
        them is at rest where they lead.
        """

    @abstractmethod
    def measure(self) -> Mapping[str, float]:
        """Present sensor readings by role [SI], with the controlled output among them."""

    def advance(self, command: Sequence[float]) -> None:
        """Hold these commands, each within its limits, for one sample."""
        self._advance(self.within(command))

    def within(self, command: Sequence[float]) -> list[float]:
        """Commands, each within its limits."""
        return [min(max(u, low), high) for u, (low, high) in zip(command, self.limits)]

    @abstractmethod
    def _advance(self, command: Sequence[float]) -> None:
        """Hold commands that are within their limits for one sample."""

    def linear(self) -> tuple[tuple[Sampled, ...], ...]:
        """Output to each command, dry friction and dead zones apart; one state for all commands.

        Once for each point about which the plant is linear but for those: one is enough where it
        is so everywhere, and there may be none.
        """
        return ()
