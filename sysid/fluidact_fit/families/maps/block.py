"""A force map for a controller, and its picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ...branches import choose_dead_band
from ...errors import UsageError
from ...experiment import FloatArray
from ...family import Block, Curve, Value
from ...signals import held_direction
from .equation import force_map


class ForceMapBlock(Block):
    """A force map that a controller calls with its inputs by name, in SI.

    ``block(force=30.0, position=0.012, direction=1)`` gives the command; arrays go
    through at once. A network with a motion state takes it as ``direction`` (1 loading,
    -1 unloading); for an array it is otherwise taken from the held sign of the change
    of the force or command given.
    """

    family = "force-map"

    def __init__(
        self, parameters: Mapping[str, Value], inputs: Sequence[str], target: str,
        activation: str = "relu",
    ) -> None:  # fmt: skip
        self.parameters = dict(parameters)
        self.inputs = tuple(inputs)
        self.target = target
        self.activation = activation
        size = len(self.inputs)
        self._low = np.asarray(parameters.get("input_low", [-np.inf] * size), dtype=float)
        self._high = np.asarray(parameters.get("input_high", [np.inf] * size), dtype=float)

    def __call__(self, **values: npt.ArrayLike) -> float | FloatArray:
        """Command or force for the inputs by name [SI]; scalars or arrays of one shape."""
        x, shape = self._table(values)
        y = force_map(self.parameters, x, self.activation)
        if "direction" in self.inputs:  # a state that is not known lies between the branches
            k = self.inputs.index("direction")
            rest = x[:, k] == 0.0
            if rest.any():
                ends = [np.where(np.arange(x.shape[1]) == k, s, x[rest]) for s in (1.0, -1.0)]
                y[rest] = np.mean([force_map(self.parameters, e, self.activation) for e in ends], 0)
        return float(y[0]) if not shape else y.reshape(shape)

    def outside(self, **values: npt.ArrayLike) -> Any:
        """Whether inputs lie outside the range of the data, where the map extrapolates."""
        x, shape = self._table(values)
        slack = 1e-9 * (self._high - self._low)
        out = ~((x >= self._low - slack) & (x <= self._high + slack)).all(axis=1)
        return bool(out[0]) if not shape else out.reshape(shape)

    @property
    def validity(self) -> dict[str, tuple[float, float]]:
        """Range of each input that the data covered [SI]."""
        return {n: (float(a), float(b)) for n, a, b in zip(self.inputs, self._low, self._high)}

    def _table(self, values: Mapping[str, npt.ArrayLike]) -> tuple[FloatArray, tuple[int, ...]]:
        given = {k: np.asarray(v, dtype=float) for k, v in values.items()}
        source = "force" if self.target == "command" else "command"
        if "direction" in self.inputs and "direction" not in given:
            v = given.get(source)
            if v is None or v.ndim != 1:
                raise UsageError(
                    "the motion state is missing",
                    remedy="Give direction=1 while loading and direction=-1 while unloading.",
                )
            given["direction"] = held_direction(v, choose_dead_band(v)).astype(float)
        unknown, missing = set(given) - set(self.inputs), set(self.inputs) - set(given)
        if unknown or missing:
            wrong = ", ".join(sorted(unknown | missing))
            raise UsageError(
                f"{'unknown' if unknown else 'missing'} input: {wrong}",
                expected="This map takes " + ", ".join(self.inputs) + ".",
            )
        columns = np.broadcast_arrays(*(given[n] for n in self.inputs))
        shape = columns[0].shape
        return np.column_stack([np.ravel(c) for c in columns]), shape


def branch_curves(
    values: Mapping[str, Value], x: FloatArray, names: Sequence[str], source: int, activation: str
) -> list[Curve]:
    """Both branches at the lowest and the highest position, all other inputs at their means."""
    along = np.linspace(x[:, source].min(), x[:, source].max(), 200)
    out = []
    ends: list[tuple[str, float | None]] = [("", None)]
    if "position" in names:
        p = x[:, names.index("position")]
        ends = [("low position", float(p.min())), ("high position", float(p.max()))]
    states: list[tuple[str, float | None]] = (
        [("loading", 1.0), ("unloading", -1.0)] if "direction" in names else [("", None)]
    )
    for place, position in ends:
        for branch, state in states:
            table = np.tile(x.mean(axis=0), (along.size, 1))
            table[:, source] = along
            if position is not None:
                table[:, list(names).index("position")] = position
            if state is not None:
                table[:, list(names).index("direction")] = state
            label = ", ".join(w for w in (branch, place) if w) or "network"
            out.append(Curve(label, along, force_map(values, table, activation)))
    return out
