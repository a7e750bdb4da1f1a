"""What every plant is to the closed loop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from ...block import Port
from ...experiment import FloatArray


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
    units
        Of what only this machine measures, by role.
    """

    commands: tuple[Port, ...]
    controlled: Port
    sample_time: float
    units: Mapping[str, str] = MappingProxyType({})

    @abstractmethod
    def reset(self, output: float = 0.0) -> None:
        """Be at rest with the controlled output there [its unit]."""

    @abstractmethod
    def measure(self) -> Mapping[str, float]:
        """What sensors show now, by role [SI]; the controlled output among it."""

    @abstractmethod
    def advance(self, command: Sequence[float]) -> None:
        """Hold these commands for one sample."""

    def response(self, z: complex) -> FloatArray:
        """Response of the output to each command in ``z``, dry friction apart, ``(commands,)``.

        Raises
        ------
        NotImplementedError
            When the plant is not linear but for its friction.
        """
        raise NotImplementedError(f"{type(self).__name__} has no linear response")
