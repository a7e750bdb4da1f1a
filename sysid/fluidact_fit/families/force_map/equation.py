"""A network as it stands in a file: its equation in SI, and what it gives for a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from ...errors import UsageError
from ...estimation.map import lone_samples
from ...estimation.motion_state import fill_start
from ...estimation.network import Activation, Network
from ...estimation.scaled_network import ScaledNetwork, Scaling
from ...experiment import Experiment, FloatArray
from ...family import Simulated, Value
from .data import branch_of, column_of, input_table, is_known, state_column
from .options import ForceMapOptions, default_inputs


@dataclass(frozen=True)
class NetworkMap(ScaledNetwork):
    """The network of a file, with its motion state."""

    @classmethod
    def of(cls, values: Mapping[str, Value], activation: Activation = "relu") -> Self:
        """The map of a file.

        Raises
        ------
        UsageError
            When the sizes of layers and scalings do not agree.
        """
        layers = [k for k in ("1", "2", "3") if f"weights_{k}" in values]
        found = cls(
            Network(
                tuple(_array(values, f"weights_{k}", 2) for k in layers),
                tuple(_array(values, f"biases_{k}", 1) for k in layers),
                activation,
            ),
            Scaling(
                _array(values, "input_offset", 1),
                _array(values, "input_scale", 1),
                float(_array(values, "output_offset", 0)),
                float(_array(values, "output_scale", 0)),
            ),
        )
        found._check_sizes()
        return found

    def _check_sizes(self) -> None:
        w, b = self.network.weights, self.network.biases
        inputs, s = self.network.inputs, self.scaling
        for name, given in (("input_offset", s.offset), ("input_scale", s.scale)):
            if given.size != inputs:
                raise UsageError(
                    f"{name} has {given.size} entries, and weights_1 is for {inputs} inputs",
                    expected="One entry for each input.",
                )
        for k, (rows, biases) in enumerate(zip(w, b), start=1):
            if rows.shape[0] != biases.size:
                raise UsageError(f"weights_{k} has {rows.shape[0]} rows, biases_{k} {biases.size}")
        for k, (one, following) in enumerate(pairwise(w), start=2):
            if one.shape[0] != following.shape[1]:
                raise UsageError(
                    f"weights_{k} is for {following.shape[1]} units, and there are {one.shape[0]}"
                )
        if w[-1].shape[0] != 1:
            raise UsageError(f"the last layer has {w[-1].shape[0]} outputs instead of one")

    def predict(self, x: FloatArray, names: Sequence[str]) -> FloatArray:
        """Output [SI], between both branches where the motion state is not known (0)."""
        y, state = self(x), state_column(names)
        if state is not None and (rest := x[:, state] == 0.0).any():
            ends = [np.where(np.arange(x.shape[1]) == state, s, x[rest]) for s in (1.0, -1.0)]
            y[rest] = 0.5 * (self(ends[0]) + self(ends[1]))
        return y


def _array(values: Mapping[str, Value], name: str, rank: int) -> FloatArray:
    try:
        array = np.asarray(values[name], dtype=float)
    except ValueError:
        raise UsageError(f"the rows of {name} differ in length") from None
    if array.ndim != rank:
        raise UsageError(f"{name} has {array.ndim} dimensions instead of {rank}")
    return array


def checksums(values: Mapping[str, Value]) -> dict[str, float | list[float]]:
    """Numbers that change with every entry of the parameters, its sign and its place.

    Sums of the positive and of the negative entries, later ones weighing more.
    """
    out: dict[str, float | list[float]] = {}
    for name, value in values.items():
        if not isinstance(value, list):
            out[name] = value
            continue
        flat = np.asarray(value, dtype=float).ravel()
        weight = 1.0 + np.arange(flat.size) / flat.size
        out[name] = [float(weight @ np.maximum(flat, 0.0)), float(weight @ np.maximum(-flat, 0.0))]
    return out


def predict_runs(
    network: NetworkMap, experiments: Sequence[Experiment], options: ForceMapOptions
) -> list[Simulated]:
    """Output of every run; rows without a motion state and lone samples are not described."""
    out = []
    for e in experiments:
        names = options.names or default_inputs(options, [e])
        x = input_table(e, names, options)
        used, state = is_known(x, names), state_column(names)
        if state is not None:  # the first motion state is that of the beginning, too
            fill_start(x[:, state])
        y = network.predict(x, names)
        if options.target in e:
            measured = column_of(e, options.target)
            there = np.isfinite(measured)
            level, rest = np.where(there, (measured - network.scaling.base, measured - y), 0.0)
            used &= there & ~lone_samples(level, rest, branch_of(e, options)[1])
        out.append(Simulated(y, used))
    return out
