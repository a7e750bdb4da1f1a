"""Problem and solution of a separable fit; see :mod:`.separable`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..experiment import Array, FloatArray
from ..rows import blocks, side_by_side
from ..specification import STEP
from .budget import simulated
from .whitening import Whitening


@dataclass(frozen=True)
class Unknown:
    """An unknown of the estimation.

    ``scale`` is its typical size (the iteration sees ``value / scale``); ``low`` and
    ``high`` are closed bounds in the unit of the value.
    """

    name: str
    low: float = -np.inf
    high: float = np.inf
    scale: float = 1.0


def bounds_of(unknowns: Sequence[Unknown]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds of some unknowns, shape ``(p,)`` each."""
    return np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])


@dataclass(frozen=True)
class Basis:
    """The columns of one experiment at given ``eta`` (real or complex).

    Each has shape ``(n,)``: what is ``known``, a column for every ``shared`` linear unknown, and
    one for every ``local`` one.
    """

    known: Array
    shared: Sequence[Array] = ()
    local: Sequence[Array] = ()

    def combined(self, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Output of the model with some linear unknowns, shape ``(n,)``."""
        return self._sum(list(self._parts(shared, local)))

    def slope(self, shared: FloatArray, local: FloatArray, step: float) -> FloatArray:
        """Derivative of `combined` by what was moved by ``1j step``, shape ``(n,)``."""
        parts = self._parts(shared, local)
        return self._sum([(x.imag, s / step) for x, s in parts if np.iscomplexobj(x)])

    def _parts(self, shared: FloatArray, local: FloatArray) -> Iterable[tuple[Array, float]]:
        columns = (self.known, *self.shared, *self.local)
        return zip(columns, (1.0, *shared, *local), strict=True)

    def _sum(self, parts: Sequence[tuple[FloatArray, float]]) -> FloatArray:
        """Sum of columns of some sizes, shape ``(n,)``."""
        out = np.zeros(len(self.known))
        for at in blocks(out.size):
            for column, size in parts:
                out[at] += size * column[at]
        return out

    def holding(self, sizes: Sequence[float | None]) -> Basis:
        """The columns where some shared unknowns are held; ``None`` for those that are not."""
        known = self.known
        for column, size in zip(self.shared, sizes, strict=True):
            if size is not None:
                known = known + column * size
        free = [column for column, size in zip(self.shared, sizes) if size is None]
        return Basis(known, free, self.local)


class Model(Protocol):
    """Model as the solver needs it.

    One of which ``known`` alone depends on ``eta``, and which knows its derivatives, has a method
    ``slopes(index, eta)`` as well, which returns those of ``known``, shape ``(p, n)``.
    """

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns of experiment ``index``; analytic in ``eta`` unless slopes are given."""
        ...


@dataclass(frozen=True)
class Problem:
    """Data and unknowns of a separable fit.

    ``channels`` functions of the same samples stand in the rows of an experiment.

    ``measured`` holds one array ``(n_i,)`` per experiment; ``weights`` one number or
    array ``(n_i,)`` per experiment that multiplies the residual (0 leaves a sample out).
    ``whiten`` is one filter per experiment, applied to both sides after the weights, which is
    generalised least squares; none where the residuals are taken for white. ``follow(eta, step)``
    is where a step of the nonlinear unknowns leads; see :func:`.minimise.minimise`.
    """

    model: Model
    measured: Sequence[FloatArray]
    nonlinear: Sequence[Unknown]
    linear: Sequence[Unknown] = ()
    weights: Sequence[FloatArray | float] = ()
    whiten: Sequence[Whitening] = ()
    channels: int = 1
    follow: Callable[[FloatArray, FloatArray], FloatArray] | None = None

    @property
    def rows(self) -> int:
        """Number of rows of all experiments."""
        return sum(y.shape[0] for y in self.measured)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the nonlinear unknowns."""
        return tuple(u.name for u in self.nonlinear)

    def vector(self, values: Mapping[str, float]) -> FloatArray:
        """Values of the nonlinear unknowns, shape ``(p,)``."""
        return np.array([values[n] for n in self.names])

    def named(self, values: Iterable[float]) -> dict[str, float]:
        """Values by name: of the nonlinear unknowns, and of the linear ones if they follow."""
        every = (*self.nonlinear, *self.linear)
        return {u.name: float(x) for u, x in zip(every, values)}

    def basis(self, index: int, eta: Array) -> Basis:
        """Columns of one experiment."""
        self.count(index)
        return self.model.basis(index, eta)

    def simulate(self, at: StationaryPoint) -> list[FloatArray]:
        """Output of the model at a stationary point, shape ``(n_i,)`` per experiment."""
        bases = (self.basis(i, at.eta) for i in range(len(self.measured)))
        return [b.combined(at.linear, local) for b, local in zip(bases, at.local, strict=True)]

    def write_derivatives(
        self, index: int, eta: FloatArray, scales: FloatArray, shared: FloatArray,
        local: FloatArray, rows: FloatArray,
    ) -> None:  # fmt: skip
        """Write the derivatives of the output of one experiment by ``eta`` to ``rows`` ``(p, n)``.

        By complex steps, of a part of the ``scales``, unless the model has its own.
        """
        own = getattr(self.model, "slopes", None)
        if own is not None:
            self.count(index, 1 + eta.size)
            rows[:] = own(index, eta)
            return
        for k, step in enumerate(STEP * scales):
            moved = eta.astype(complex)
            moved[k] += 1j * step
            rows[k] = self.basis(index, moved).slope(shared, local, step)

    def count(self, index: int, passes: int = 1) -> None:
        """Count simulations of one experiment."""
        simulated(self.measured[index].shape[0] / self.channels, passes)

    def weigh(self, index: int, *columns: Array) -> Sequence[Array]:
        """Weigh and whiten columns of one experiment, shape ``(n,)`` each."""
        w = np.asarray(self.weights[index] if self.weights else 1.0)
        parts = [x * w for x in columns] if w.ndim or w != 1.0 else columns
        return list(self.whiten[index].filter(side_by_side(*parts)).T) if self.whiten else parts


@dataclass(frozen=True)
class StationaryPoint:
    """A stationary point of a `Problem`.

    Attributes
    ----------
    eta, linear
        Values of the nonlinear and the shared linear unknowns.
    local
        Local linear unknowns, one array per experiment.
    cost
        Sum of the squared weighted residuals.
    residuals
        Weighted residuals ``measured - model`` per experiment.
    jacobian
        Weighted derivative of the model output by ``(eta, linear)`` with the local
        unknowns projected out, one array ``(n_i, p + q)`` per experiment.
    local_counts
        Number of local unknowns per experiment.
    iterations, converged
        What the iteration did.
    """

    eta: FloatArray
    linear: FloatArray
    local: list[FloatArray]
    cost: float
    residuals: list[FloatArray]
    jacobian: list[FloatArray]
    local_counts: tuple[int, ...]
    iterations: int
    converged: bool


def real_if_real(values: Array) -> Array:
    """Complex values as real ones where no step was taken in them: half the work."""
    return np.real(values) if not np.any(np.imag(values)) else values
