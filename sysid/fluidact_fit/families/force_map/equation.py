"""Output of a force map for logs, and sums that change with every entry of its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...estimation.map import lone_samples
from ...estimation.motion_state import fill_start
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import Experiment
from ...family import Simulated, Value
from .data import branch_of, column_of, input_table, is_known, state_column
from .options import ForceMapOptions, default_inputs


def checksums(values: Mapping[str, Value]) -> dict[str, float | list[float]]:
    """Sums of the positive and of the negative entries of lists, later ones weighing more."""
    out: dict[str, float | list[float]] = {}
    for name, value in values.items():
        if not isinstance(value, list):
            out[name] = value
            continue
        flat = np.asarray(value, dtype=float).ravel()
        weight = 1.0 + np.arange(flat.size) / flat.size
        out[name] = [float(weight @ np.maximum(sign * flat, 0.0)) for sign in (1.0, -1.0)]
    return out


def predict_runs(
    network: ScaledNetwork, experiments: Sequence[Experiment], options: ForceMapOptions
) -> list[Simulated]:
    """Output of every run; rows without a motion state and lone samples are not described.

    The first motion state is that of the beginning, too; one that is never known is loading.
    """
    out = []
    for e in experiments:
        names = options.names or default_inputs(options, [e])
        x = input_table(e, names, options)
        used, state = is_known(x, names), state_column(names)
        if state is not None:
            fill_start(x[:, state])
            x[:, state] = np.where(x[:, state] < 0.0, -1.0, 1.0)
        y = network(x)
        if options.target in e:
            measured = column_of(e, options.target)
            there = np.isfinite(measured)
            level, rest = np.where(there, (measured - network.scaling.base, measured - y), 0.0)
            used &= there & ~lone_samples(level, rest, branch_of(e, options)[1])
        out.append(Simulated(y, used))
    return out
