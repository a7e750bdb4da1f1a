"""A network as it stands in a file: its equation, for inputs in SI."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np

from ...estimation.network import Activation, Network
from ...experiment import FloatArray
from ...family import Value


def force_map(
    parameters: Mapping[str, Value], x: FloatArray, activation: str = "relu"
) -> FloatArray:
    """Output of a network for inputs in SI.

    ``y = output_offset + output_scale (W_L phi(... W_1 (x - input_offset) / input_scale ...))``

    Parameters
    ----------
    parameters
        As in the file.
    x : (n, inputs)
        Inputs in the file's order [SI].
    activation
        ``relu`` or ``tanh``.

    Returns
    -------
    (n,) [SI unit of the target]
    """
    net = network_of(parameters, activation)
    offset, scale = (np.asarray(parameters[f"input_{k}"], dtype=float) for k in ("offset", "scale"))
    y = net((x - offset) / scale)
    return _number(parameters["output_offset"]) + _number(parameters["output_scale"]) * y


def network_of(parameters: Mapping[str, Value], activation: str = "relu") -> Network:
    """The network of a file, in standardised coordinates."""
    layers = [k for k in ("1", "2", "3") if f"weights_{k}" in parameters]
    return Network(
        tuple(np.asarray(parameters[f"weights_{k}"], dtype=float) for k in layers),
        tuple(np.asarray(parameters[f"biases_{k}"], dtype=float) for k in layers),
        cast(Activation, activation),
    )


def _number(value: Value) -> float:
    return float(np.asarray(value, dtype=float).ravel()[0])
