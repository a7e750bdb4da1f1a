"""What all dynamic blocks share: parameters, validity, and the roles they connect."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy.typing as npt

from ..errors import UsageError
from ..estimation.inputs import PiecewiseInput, piecewise
from ..experiment import FloatArray, Hold, Signal
from ..family import Block, Value
from ..parameters import ParameterDocument


class ValidRange(NamedTuple):
    """Range of a role that the fitted data covered [unit]."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Port:
    """Name and unit of the input or output of a block."""

    role: str
    unit: str


class ModelBlock(Block):
    """A dynamic model: one input, one output, one step per sample.

    Attributes
    ----------
    family
        Name of the model family.
    parameters
        Values by name [SI].
    document
        The whole parameter document: units, uncertainty, warnings, provenance.
    validity
        Role to the range that the data covered; outside it the model extrapolates.
    not_identified
        Names of the parameters that the data could not determine. They carry a neutral
        value; whoever uses them should know.
    input, output
        Role and unit of what the block takes and gives.
    """

    def __init__(self, document: ParameterDocument, input: Port, output: Port) -> None:
        self.family = document.family
        self.document = document
        self.parameters: Mapping[str, Value] = document.values()
        self.validity: Mapping[str, ValidRange] = {
            role: ValidRange(r.low, r.high, r.unit) for role, r in document.validity.items()
        }
        self.not_identified: tuple[str, ...] = tuple(
            n for n, p in document.parameters.items() if p.status == "not_identified"
        )
        self.input, self.output = input, output

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} {self.family}: {self.input.role} [{self.input.unit}] -> "
            f"{self.output.role} [{self.output.unit}], sample_time={self.sample_time:g} s>"
        )

    @property
    def verdict(self) -> str:
        """Verdict of the fit: ``pass``, ``warn`` or ``fail``."""
        return str(self.document.fit.verdict)

    def outside(self, role: str, value: float) -> bool:
        """Whether a value lies outside the range that the data covered.

        Parameters
        ----------
        role
            For example ``"force"``.
        value
            [SI unit of the role]. NaN is outside.

        Raises
        ------
        UsageError
            When the file holds no range of that role.
        """
        if role not in self.validity:
            raise UsageError(
                f"the parameter file holds no range of {role!r}",
                expected="Ranges it holds: " + (", ".join(self.validity) or "none") + ".",
            )
        r = self.validity[role]
        return not r.low <= value <= r.high

    @property
    @abstractmethod
    def sample_time(self) -> float:
        """Period of :meth:`step` [s]; 0 when the file holds no discrete model."""

    @abstractmethod
    def reset(self, *, output: float | None = None) -> None:
        """Return to rest."""

    @abstractmethod
    def step(self, value: float) -> float:
        """Advance by one sample."""

    @abstractmethod
    def simulate(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
    ) -> FloatArray:
        """Simulate a whole record."""

    def _signal(
        self, values: npt.ArrayLike, time: npt.ArrayLike, hold: Hold, before: float | None
    ) -> tuple[PiecewiseInput, FloatArray, float]:
        """Input as a piecewise polynomial, its instants, and its level before the start."""
        t, u = check_record(values, time)
        level = float(u[0]) if before is None else before
        if hold not in ("zoh", "foh", "linear", "cubic"):
            raise UsageError(f"hold cannot be {hold!r}", expected="One of zoh, foh, linear, cubic.")
        return piecewise(Signal(self.input.role, t, u, self.input.unit, hold)), t, level


def check_record(values: npt.ArrayLike, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Instants and input as finite arrays of equal length, instants increasing.

    Raises
    ------
    UsageError
        When they are not.
    """
    import numpy as np

    u = np.asarray(values, dtype=float)
    t = np.asarray(time, dtype=float)
    if u.ndim != 1 or t.shape != u.shape or u.size == 0:
        raise UsageError(
            f"input of shape {u.shape} at instants of shape {t.shape}",
            expected="Two one-dimensional arrays of the same length, at least one sample.",
        )
    if not (np.isfinite(u).all() and np.isfinite(t).all()):
        raise UsageError("input or instants hold a value that is not finite")
    if t.size > 1 and not (np.diff(t) > 0.0).all():
        raise UsageError("the instants do not increase", remedy="Sort them, drop repeated ones.")
    return t, u
