"""A network of quantities in their units: scaled to order one, computed, and scaled back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..experiment import FloatArray
from ..routines import Draft, Expression
from .network import Network


@dataclass(frozen=True)
class Scaling:
    """Inputs ``(x - offset) / scale``, ``(inputs,)`` each, and output ``(y - base) / span``."""

    offset: FloatArray
    scale: FloatArray
    base: float
    span: float

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, kept: int | None = None) -> Self:
        """Scaling that gives rows ``(n, inputs)`` and ``(n,)`` zero mean and unit deviation.

        An input that never changes keeps its scale; the one numbered ``kept`` stays as it is.
        """
        offset, scale = x.mean(axis=0), x.std(axis=0)
        if kept is not None:
            offset[kept], scale[kept] = 0.0, 1.0
        scale = np.where(scale > 1e-12 * np.maximum(np.abs(offset), 1e-300), scale, 1.0)
        return cls(offset, scale, float(y.mean()), max(float(y.std()), 1e-300))

    def inputs(self, x: FloatArray) -> FloatArray:
        """Inputs in their units as standardised ones."""
        return np.asarray((x - self.offset) / self.scale)

    def output(self, y: FloatArray) -> FloatArray:
        """Outputs in their units as standardised ones."""
        return np.asarray((y - self.base) / self.span)


@dataclass(frozen=True)
class ScaledNetwork:
    """``y = base + span * network((x - offset) / scale)``."""

    network: Network
    scaling: Scaling

    def __call__(self, x: FloatArray) -> FloatArray:
        """Output ``(n,)`` for inputs ``(n, inputs)``, all in their own units."""
        s = self.scaling
        return np.asarray(s.base + s.span * self.network(s.inputs(x)))

    @property
    def unscaled(self) -> Network:
        """The network that takes and gives quantities in their units; of no use for training."""
        s, weights, biases = self.scaling, [*self.network.weights], [*self.network.biases]
        weights[-1], biases[-1] = s.span * weights[-1], s.base + s.span * biases[-1]
        biases[0] = biases[0] - weights[0] @ (s.offset / s.scale)
        weights[0] = weights[0] / s.scale
        return replace(self.network, weights=tuple(weights), biases=tuple(biases))

    def draw(self, draft: Draft, inputs: Sequence[Expression]) -> Expression:
        """Output as a controller computes it: without the arithmetic of the scalings."""
        net, layer = self.unscaled, inputs
        for k, (w, b) in enumerate(zip(net.weights, net.biases), start=1):
            last = k == len(net.weights)
            layer = draft.layer(f"layer_{k}", w, b, layer, "linear" if last else net.activation)
        return layer[0]
