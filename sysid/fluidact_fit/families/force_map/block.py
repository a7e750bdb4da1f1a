"""A force map for a controller, and its picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import Block, Port, as_motion_state
from ...errors import UsageError
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import Experiment, FloatArray
from ...family import Curve
from ...parameters.document import ParameterDocument
from ...routines import Argument, Draft, Expression, Routine, choose
from ...specification import Variant
from .data import held_state, predict_runs
from .options import ForceMapOptions


class ForceMapBlock(Block):
    """A force map that a controller calls with its inputs by name, in SI.

    ``block(force=30.0, position=0.012, direction=1)`` gives the command; arrays go
    through at once. A network with a motion state takes it as ``direction`` (1 loading,
    -1 unloading); for an array it is otherwise taken from the held sign of the change
    of the force or command given.

    Attributes
    ----------
    inputs
        Names of the inputs, in the order of the network.
    target
        What the map gives: ``"command"`` or ``"force"``.
    activation
        Of the hidden units.
    """

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        super().__init__(document, variant)
        self.options = document.settled_options(ForceMapOptions)
        self.inputs = self.options.names
        self.target = self.options.target
        self.activation = self.options.activation

    @property
    def input(self) -> Port:
        """Quantity that the output rises with: the force for a command, the command for a force."""
        return Port(self.options.driver, self._unit(self.options.driver))

    @cached_property
    def _map(self) -> ScaledNetwork:
        return ScaledNetwork.of(self.parameters, self.activation)

    def __call__(self, **values: npt.ArrayLike) -> float | FloatArray:
        """Command or force for the inputs by name [SI]; scalars or arrays of one shape.

        A motion state of 0, not known, is taken for loading, as the exports take it.
        """
        self.watch(**values)
        x, shape = self._table(values)
        y = self._map(x)
        return float(y[0]) if not shape else y.reshape(shape)

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """The map; see :meth:`.Block.methods`."""
        return {"map": lambda *inputs: self(**dict(zip(self.inputs, inputs, strict=True)))}

    def routines(self) -> Sequence[Routine]:
        """The map itself; its scalings are part of the first and the last layer."""
        low, high = (np.asarray(self.parameters[f"input_{k}"]) for k in ("low", "high"))
        unit = self.variant.output.unit if self.target == "force" else self._unit(self.target)
        draft = Draft("map", f"{self.target.capitalize()} for the inputs.", unit)
        inputs: list[Expression] = []
        for name, a, b in zip(self.inputs, low.tolist(), high.tolist()):
            if name == "direction":
                about = "1 loading (or 0), -1 unloading"
                state = draft.argument(Argument(name, "1", about, -1.0, 1.0))
                inputs.append(choose(state, "<", 0.0, -1.0, 1.0))
            else:
                about = "input of the network"
                inputs.append(draft.argument(Argument(name, self._unit(name), about, a, b)))
        return (draft.returns(self._map.draw(draft, inputs)),)

    def _unit(self, role: str) -> str:
        known = self.validity.get(role)
        return known.unit if known else next(r.unit for r in self.variant.roles if r.name == role)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Output from the inputs of a recording; see :meth:`.Block.predict`."""
        inputs = {r: s for r, s in experiment.signals.items() if r != self.target}
        (run,) = predict_runs(self._map, [replace(experiment, signals=inputs)], self.options)
        return run.output

    def outside(
        self, role: str | None = None, value: npt.ArrayLike = np.nan, **inputs: npt.ArrayLike
    ) -> Any:
        """Return whether values lie outside the range that the data covered.

        Either one role with its values, as for every block, or all inputs as when calling:
        then whether any of them does.
        """
        if role is not None:
            return super().outside(role, value)
        x, shape = self._table(inputs)
        low, high = (np.asarray(self.parameters[f"input_{k}"]) for k in ("low", "high"))
        slack = 1e-9 * (high - low)
        out = ~((x >= low - slack) & (x <= high + slack)).all(axis=1)
        return bool(out[0]) if not shape else out.reshape(shape)

    def _table(self, values: Mapping[str, npt.ArrayLike]) -> tuple[FloatArray, tuple[int, ...]]:
        given = {k: np.asarray(v, dtype=float) for k, v in values.items()}
        if "direction" in self.inputs and "direction" not in given:
            v = given.get(self.options.driver)
            if v is None or v.ndim != 1:
                raise UsageError(
                    "the motion state is missing",
                    remedy="Give direction=1 while loading and direction=-1 while unloading.",
                )
            given["direction"] = held_state(v, self.options.driver, self.options)
        elif "direction" in given:
            state = as_motion_state(given["direction"])
            given["direction"] = np.where(state < 0.0, -1.0, 1.0)
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
    network: ScaledNetwork, x: FloatArray, names: Sequence[str], source: str
) -> list[Curve]:
    """Both branches at the lowest and the highest position, all other inputs at their means."""
    low, high, k = x.min(axis=0), x.max(axis=0), names.index(source)
    along, columns = np.linspace(low[k], high[k], 200), np.arange(x.shape[1])
    tables = {"": np.where(columns == k, along[:, None], x.mean(axis=0))}
    for name, ends in (
        ("position", {"low position": low, "high position": high}),
        ("direction", {"loading": np.ones_like(low), "unloading": -np.ones_like(low)}),
    ):
        if name in names and name != source:
            at = columns == names.index(name)
            tables = {
                f"{word}, {label}".removesuffix(", "): np.where(at, values, table)
                for (label, table), (word, values) in product(tables.items(), ends.items())
            }
    return [Curve(label or "network", along, network(t)) for label, t in tables.items()]
