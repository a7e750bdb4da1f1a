"""Chains of transfer functions as state space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...experiment import FloatArray


class Transfer(Protocol):
    """``exp(-dead_time s) numerator(s) / denominator(s)``, falling powers of ``s``."""

    @property
    def numerator(self) -> tuple[float, ...]: ...
    @property
    def denominator(self) -> tuple[float, ...]: ...
    @property
    def dead_time(self) -> float: ...


@dataclass(frozen=True)
class Chain:
    """``x' = a x + b u(t - dead_time)``, ``y = c x``; ``gain`` is the steady output per input."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    dead_time: float

    @property
    def gain(self) -> float:
        """Steady output per input."""
        return float(-self.c @ np.linalg.solve(self.a, self.b)) if self.a.size else 1.0

    def rest(self, value: float) -> FloatArray:
        """State that an input held for ever leads to, ``(n,)``."""
        return np.asarray(np.linalg.solve(self.a, -self.b * value), dtype=float)


def make_chain(links: Sequence[Transfer]) -> Chain:
    """Put strictly proper transfer functions in series; dead times add up, wherever they are."""
    a, b, c = np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    for number, link in enumerate(links):
        f, g, h = _companion(link)
        n, m = a.shape[0], f.shape[0]
        joined = np.zeros((n + m, n + m))
        joined[:n, :n], joined[n:, n:] = a, f
        if number:
            joined[n:, :n] = np.outer(g, c)
        b = np.append(b, np.zeros(m) if number else g)
        a, c = joined, np.append(np.zeros(n), h)
    return Chain(a, b, c, sum(link.dead_time for link in links))


def _companion(link: Transfer) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Observable form: the output is the first state."""
    den = np.asarray(link.denominator, dtype=float) / link.denominator[0]
    n = den.size - 1
    num = np.zeros(n)
    num[n - len(link.numerator) :] = np.asarray(link.numerator) / link.denominator[0]
    a = np.zeros((n, n))
    a[:, 0] = -den[1:]
    a[:-1, 1:] = np.eye(n - 1)
    return a, num, np.eye(n)[0]
