"""A network of quantities in their units: scaled to order one, computed, and scaled back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray
from ..routines import Draft, Expression
from .network import Activation, Network

_SCALINGS = ("input_offset", "input_scale", "output_offset", "output_scale")


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

    @classmethod
    def of(
        cls, values: Mapping[str, Any], activation: Activation = "relu", prefix: str = ""
    ) -> Self:
        """The network of a file, whose parameters have names as in :meth:`numbers`.

        Raises
        ------
        UsageError
            When the sizes of layers and scalings do not agree.
        """

        def array(name: str) -> FloatArray:
            return np.asarray(values[prefix + name], dtype=float)

        layers = [k for k in ("1", "2", "3") if f"{prefix}weights_{k}" in values]
        weights, biases = (tuple(array(f"{n}_{k}") for k in layers) for n in ("weights", "biases"))
        offset, scale, base, span = map(array, _SCALINGS)
        widths = (weights[0].shape[1], *(b.size for b in biases))
        due: dict[str, tuple[int, ...]] = {
            "input_offset": widths[:1], "input_scale": widths[:1], f"biases_{layers[-1]}": (1,),
            **{f"weights_{k}": ends[::-1] for k, ends in zip(layers, pairwise(widths))},
        }  # fmt: skip
        for name, shape in due.items():
            if (found := array(name).shape) != shape:
                sizes = [" x ".join(map(str, s)) for s in (found, shape)]
                raise UsageError(
                    f"{prefix}{name} has {sizes[0]} entries, and the others need {sizes[1]}"
                )
        return cls(
            Network(weights, biases, activation), Scaling(offset, scale, base.item(), span.item())
        )

    def numbers(self) -> dict[str, Any]:
        """Layers, ``weights_1`` with a row per unit, ``biases_1`` and so on, and scalings."""
        net, s = self.network, self.scaling
        out: dict[str, Any] = {}
        for k, (w, b) in enumerate(zip(net.weights, net.biases), start=1):
            out |= {f"weights_{k}": w.tolist(), f"biases_{k}": b.tolist()}
        return out | dict(zip(_SCALINGS, (s.offset.tolist(), s.scale.tolist(), s.base, s.span)))

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


def checksums(values: Mapping[str, Any]) -> dict[str, float | list[float]]:
    """Numbers that change with every entry of the parameters, its sign and its place.

    Of lists sums of the positive and of the negative entries, later ones weighing more.
    """
    out: dict[str, float | list[float]] = {}
    for name, value in values.items():
        if not isinstance(value, list):
            out[name] = value
            continue
        flat = np.asarray(value, dtype=float).ravel()
        weight = 1.0 + np.arange(flat.size) / flat.size
        out[name] = [float(weight @ np.maximum(sign * flat, 0.0)) for sign in (1.0, -1.0)]
    return out
