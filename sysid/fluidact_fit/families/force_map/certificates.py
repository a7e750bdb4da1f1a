"""Bounds of a network's slopes inside the data's box: does it rise with the force?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.network import Network
from ...experiment import FloatArray
from .data import Data, Scaling
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

    @property
    def lipschitz(self) -> FloatArray:
        """Largest size of the slope by each input."""
        return np.asarray(np.maximum(np.abs(self.low), np.abs(self.high)))


def certify(net: Network, scaling: Scaling, data: Data) -> Certificate:
    """Bound the slopes of a network for each motion state inside the data's box."""
    x = data.x[data.used]
    low, high = scaling.inputs(x.min(axis=0)), scaling.inputs(x.max(axis=0))
    boxes = [(low, high)]
    if "direction" in data.names:
        k = data.names.index("direction")
        boxes = []
        for state in np.unique(x[:, k]):
            corners = low.copy(), high.copy()
            corners[0][k] = corners[1][k] = state
            boxes.append(corners)
    factor = scaling.span / scaling.scale
    exact = net.activation == "relu" and len(net.weights) == 2 and net.hidden[0] <= ENUMERATED
    if exact:
        regions = [r for a, b in boxes for r in activation_regions(net, a, b)]
        slopes = np.array([r.gradient for r in regions]) * factor
        points = np.array([r.inside for r in regions]) * scaling.scale + scaling.offset
        worst = points[slopes.argmin(axis=0)]
        return Certificate(
            data.names, slopes.min(axis=0), slopes.max(axis=0), worst, True, len(regions)
        )
    bounds = [gradient_interval(net, a, b) for a, b in boxes]
    smallest = np.min([b[0] for b in bounds], axis=0) * factor
    largest = np.max([b[1] for b in bounds], axis=0) * factor
    nowhere = np.full((len(data.names), len(data.names)), np.nan)
    return Certificate(data.names, smallest, largest, nowhere, False, 0)


def certificate_details(c: Certificate, data: Data, source: str) -> dict[str, Any]:
    """The certificate for the file."""
    out: dict[str, Any] = {
        "method": f"{c.regions} activation regions enumerated" if c.exact else "interval bound",
        "exact": c.exact,
        "inside": {
            n: [float(v) for v in (data.x[data.used, k].min(), data.x[data.used, k].max())]
            for k, n in enumerate(data.names)
        },
        "slopes": {
            n: [float(c.low[k]), float(c.high[k])]
            for k, n in enumerate(c.names)
            if n != "direction"
        },
        "lipschitz": {n: float(c.lipschitz[k]) for k, n in enumerate(c.names) if n != "direction"},
    }
    if source in c.names:
        k = c.names.index(source)
        out["rises_with"] = {"input": source, "certified": c.monotone(source)}
        if not c.monotone(source) and c.exact:
            where = {n: float(v) for n, v in zip(c.names, c.worst[k])}
            out["rises_with"]["violated_at"] = where
    return out


def certificate_notice(c: Certificate, data: Data, source: str, target: str) -> list[Notice]:
    """Warn of a certified place where the output falls with what it has to rise with."""
    if c.monotone(source) or not c.exact:
        return []
    k = c.names.index(source)
    where = ", ".join(
        f"{n} {v:.4g} {u}".rstrip(" 1") if u == "1" else f"{n} {v:.4g} {u}"
        for n, v, u in zip(c.names, c.worst[k], data.units)
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
