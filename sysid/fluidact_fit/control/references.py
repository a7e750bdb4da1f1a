"""References for the output: step, triangle, sine, ramp insertion, or samples."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi
from typing import Literal

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray

Kind = Literal["step", "triangle", "sine", "ramp-insertion"]
KINDS: tuple[Kind, ...] = ("step", "triangle", "sine", "ramp-insertion")


@dataclass(frozen=True)
class Reference:
    """A course of the wanted output [SI unit of the output].

    Attributes
    ----------
    kind
        ``"step"``: ``start``, and ``start + size`` from ``at`` on. ``"triangle"``: up by ``size``
        at ``speed`` and down again, over and over. ``"sine"``: ``size`` times a sine of
        ``frequency`` about ``start``. ``"ramp-insertion"``: from ``at`` on up by ``size`` at
        ``speed``, and there it stays. All but the step rest at ``start`` until ``at``.
    start, size
        [unit of the output]
    at
        [s]
    speed
        [unit of the output per second]
    frequency
        [Hz]
    """

    kind: Kind
    start: float = 0.0
    size: float = 1.0
    at: float = 0.0
    speed: float = 1.0
    frequency: float = 0.1

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UsageError(
                f"there is no reference {self.kind!r}", expected=f"One of {', '.join(KINDS)}."
            )
        for name in ("speed", "frequency"):
            if not getattr(self, name) > 0.0:
                raise UsageError(f"the {name} of a reference is above 0")
        if self.size == 0.0:
            raise UsageError("a reference of size 0 goes nowhere")

    def check_sampling(self, sample_time: float) -> None:
        """Refuse one that repeats itself faster than samples can show (``UsageError``)."""
        period = {"sine": 1.0 / self.frequency, "triangle": 2.0 * abs(self.size) / self.speed}
        if period.get(self.kind, inf) <= 2.0 * sample_time:
            raise UsageError(
                f"the {self.kind} repeats itself every {period[self.kind]:.3g} s, and samples "
                f"every {sample_time:g} s show another course",
                expected="Expected more than two samples a period.",
                remedy="Choose a lower reference.frequency or reference.speed, or a shorter "
                "sample_time.",
            )

    def __call__(self, time: FloatArray) -> FloatArray:
        """Value at instants ``(n,)`` [s]."""
        since = np.maximum(time - self.at, 0.0)
        if self.kind == "step":
            return np.where(time >= self.at - 1e-12, self.start + self.size, self.start)
        if self.kind == "sine":
            return self.start + self.size * np.sin(2.0 * pi * self.frequency * since)
        way = self.speed * since / abs(self.size)
        if self.kind == "triangle":
            return self.start + self.size * (1.0 - np.abs(way % 2.0 - 1.0))
        return self.start + self.size * np.minimum(way, 1.0)


@dataclass(frozen=True)
class SampledReference:
    """Straight lines between samples ``(n,)``; before the first and after the last they rest."""

    time: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        if self.time.size < 2 or not (np.diff(self.time) > 0.0).all():
            raise UsageError("a reference needs two samples or more, one after the other in time")

    @property
    def start(self) -> float:
        """Value before the first sample."""
        return float(self.values[0])

    def __call__(self, time: FloatArray) -> FloatArray:
        """Value at instants ``(n,)`` [s]."""
        return np.interp(time, self.time, self.values)
