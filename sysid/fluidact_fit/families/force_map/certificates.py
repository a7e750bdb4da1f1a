"""Bounds of a network's slopes inside the data's box: does it rise with the force?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.network import Network
from ...experiment import FloatArray
from .data import Data, state_column
from .equation import NetworkMap
from .slope_bounds import activation_regions, gradient_interval

ENUMERATED = 8  # hidden units up to which the regions are enumerated


@dataclass(frozen=True)
class Certificate:
    """Range of the slopes of a network inside the data's box, per input [SI].

    ``exact`` says whether the regions were enumerated (``regions`` of them); otherwise the
    bounds are safe and wider than the truth. ``worst`` is a point of the smallest slope of
    each input.
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    worst: FloatArray
    exact: bool
    regions: int

    def monotone(self, name: str) -> bool:
        """Whether the output rises with an input everywhere in the box."""
        return name not in self.names or bool(self.low[self.names.index(name)] >= 0.0)


def is_enumerable(net: Network) -> bool:
    """Whether all regions in which a network is affine can be gone through."""
    return net.activation == "relu" and len(net.weights) == 2 and net.hidden[0] <= ENUMERATED


def certify(network: NetworkMap, data: Data) -> Certificate:
    """Bound the slopes of a network for each motion state inside the data's box."""
    net, s, x = network.network, network.scaling, data.x[data.used]
    boxes = [(s.inputs(x.min(axis=0)), s.inputs(x.max(axis=0)))]
    state = state_column(data.names)
    if state is not None:
        held = np.arange(x.shape[1]) == state
        boxes = [
            (np.where(held, at, boxes[0][0]), np.where(held, at, boxes[0][1]))
            for at in np.unique(x[:, state])
        ]
    factor = s.span / s.scale
    if is_enumerable(net):
        regions = [r for low, high in boxes for r in activation_regions(net, low, high)]
        slopes = np.array([r.gradient for r in regions]) * factor
        points = np.array([r.inside for r in regions]) * s.scale + s.offset
        worst = points[slopes.argmin(axis=0)]
        return Certificate(
            data.names, slopes.min(axis=0), slopes.max(axis=0), worst, True, len(regions)
        )
    bounds = np.array([gradient_interval(net, low, high) for low, high in boxes]) * factor
    nowhere = np.full((len(data.names), len(data.names)), np.nan)
    smallest, largest = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    return Certificate(data.names, smallest, largest, nowhere, False, 0)


def certificate_details(c: Certificate, data: Data, source: str) -> dict[str, Any]:
    """The certificate for the file."""
    x = data.x[data.used]
    ends = np.column_stack((x.min(axis=0), x.max(axis=0))).tolist()
    slopes = dict(zip(c.names, np.column_stack((c.low, c.high)).tolist()))
    slopes.pop("direction", None)
    out: dict[str, Any] = {
        "method": f"{c.regions} activation regions enumerated" if c.exact else "interval bound",
        "exact": c.exact,
        "inside": dict(zip(data.names, ends)),
        "slopes": slopes,
        "lipschitz": {n: max(abs(low), abs(high)) for n, (low, high) in slopes.items()},
    }
    if source in c.names:
        out["rises_with"] = {"input": source, "certified": c.monotone(source)}
        if not c.monotone(source) and c.exact:
            worst = c.worst[c.names.index(source)]
            out["rises_with"]["violated_at"] = dict(zip(c.names, worst.tolist()))
    return out


def certificate_notice(c: Certificate, data: Data, source: str, target: str) -> list[Notice]:
    """Warn of a certified place where the output falls with what it has to rise with."""
    if c.monotone(source) or not c.exact:
        return []
    k = c.names.index(source)
    where = ", ".join(
        f"{n} {v:.4g} {u}".removesuffix(" 1") for n, v, u in zip(c.names, c.worst[k], data.units)
    )
    return [
        Notice(
            "not-monotone",
            f"inside the data's range the {target} falls with rising {source} somewhere, by "
            f"{-c.low[k]:.3g} per unit of the {source}: at {where}. A loop closed over it would "
            "have the wrong sign there. Give other --hidden units or another --seed, or record "
            "more data around it.",
        )
    ]
