"""The network as a controller runs it: without the arithmetic of its scalings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...routines import Argument, Draft, Routine, choose
from ...routines.expression import Expression
from .equation import NetworkMap


def map_routine(
    network: NetworkMap, arguments: Sequence[Argument], output: tuple[str, str]
) -> Routine:
    """Return the map; ``output`` is its name and unit.

    ``(x - offset) / scale`` is drawn into the first layer, ``base + span y`` into the last. A
    motion state is taken as one of two: what lies between is for whoever does not know it.
    """
    name, unit = output
    draft = Draft("map", f"{name.capitalize()} for the inputs.", unit)
    inputs: list[Expression] = []
    for a in arguments:
        given = draft.argument(a)
        inputs.append(choose(given, "<", 0.0, -1.0, 1.0) if a.name == "direction" else given)
    s, net = network.scaling, network.network
    weights, biases = [np.array(w) for w in net.weights], [np.array(b) for b in net.biases]
    biases[0] = biases[0] - weights[0] @ (s.offset / s.scale)
    weights[0] = weights[0] / s.scale
    weights[-1], biases[-1] = s.span * weights[-1], s.base + s.span * biases[-1]
    layer: Sequence[Expression] = inputs
    for k, (w, b) in enumerate(zip(weights, biases), start=1):
        last = k == len(weights)
        layer = draft.layer(f"layer_{k}", w, b, layer, "linear" if last else net.activation)
    return draft.returns(layer[0])
