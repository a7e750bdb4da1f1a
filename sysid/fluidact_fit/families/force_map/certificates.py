"""Slopes of a ReLU network inside the data's box: does the output rise with the force?

A ReLU network is affine in every region of constant activation pattern. For few units the
regions that meet a box are enumerated by linear programs, which makes the range of the
gradient exact [1]_.

References
----------
.. [1] G. Montufar, R. Pascanu, K. Cho, Y. Bengio, "On the number of linear regions of deep
   neural networks", NIPS 2014.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.network import Network
from ...experiment import FloatArray
from .data import Data, state_column
from .equation import NetworkMap

ENUMERATED = 8  # hidden units up to which the regions are enumerated
_NARROWEST = 1e-9  # radius of a region, in widths of the box, below which it is no region


@dataclass(frozen=True)
class Region:
    """A part of the box in which a ReLU network is affine.

    ``pattern`` says which units are active, ``inside`` is a point of the region and
    ``gradient`` the derivative of the output there, all standardised.
    """

    pattern: tuple[bool, ...]
    inside: FloatArray
    gradient: FloatArray


def activation_regions(net: Network, low: FloatArray, high: FloatArray) -> list[Region]:
    """All regions of a ReLU network of one hidden layer that meet a box.

    The box is cut by one unit after the other, and each region carries a point inside.

    Parameters
    ----------
    low, high : (inputs,)
        Corners of the box, standardised. An input with ``low == high`` is held.
    """
    if net.activation != "relu" or len(net.weights) != 2:
        raise ValueError("regions can be enumerated for one hidden layer of ReLU units only")
    free = high > low
    span = (high - low)[free]
    w, b = net.weights[0][:, free] * span, net.biases[0] + net.weights[0] @ low
    found: list[tuple[tuple[bool, ...], FloatArray]] = [((), np.full(span.size, 0.5))]
    for k in range(1, b.size + 1):
        found = [
            ((*pattern, side), inside)
            for pattern, point in found
            for side in (False, True)
            if (inside := _point_inside(w[:k], b[:k], (*pattern, side), point)) is not None
        ]
    out = []
    for pattern, point in found:
        inside = low.copy()
        inside[free] += point * span
        gradient = (net.weights[1][0] * np.array(pattern, dtype=float)) @ net.weights[0]
        out.append(Region(pattern, inside, gradient))
    return out


def _point_inside(
    w: FloatArray, b: FloatArray, pattern: tuple[bool, ...], known: FloatArray
) -> FloatArray | None:
    """Point of the unit box where the sums ``w x + b`` have the signs of a pattern.

    It is the ``known`` one, if that does, or the one furthest from where a sum changes its sign;
    ``None`` where there is none.
    """
    from scipy.optimize import linprog

    sign, size = np.where(pattern, 1.0, -1.0), np.linalg.norm(w, axis=1)
    if np.all(sign * (w @ known + b) > _NARROWEST * size):
        return known
    # the largest r with sign (w x + b) >= r |w|
    rows = np.column_stack((-sign[:, None] * w, size))
    target = np.append(np.zeros(known.size), -1.0)
    answer = linprog(target, rows, sign * b, bounds=[(0.0, 1.0)] * known.size + [(None, 1.0)])
    return np.asarray(answer.x[:-1]) if answer.status == 0 and answer.x[-1] > _NARROWEST else None


@dataclass(frozen=True)
class Certificate:
    """Range of the slopes of a network inside the data's box, per input [SI].

    ``regions`` were enumerated; ``worst`` is a point of the smallest slope of each input.
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    worst: FloatArray
    regions: int

    def monotone(self, name: str) -> bool:
        """Return whether the output rises with an input everywhere in the box."""
        return name not in self.names or bool(self.low[self.names.index(name)] >= 0.0)


def is_enumerable(net: Network) -> bool:
    """Return whether all regions in which a network is affine can be gone through."""
    return net.activation == "relu" and len(net.weights) == 2 and net.hidden[0] <= ENUMERATED


def certify(network: NetworkMap, data: Data) -> Certificate:
    """Bound the slopes of an enumerable network for each motion state inside the data's box."""
    net, s, x = network.network, network.scaling, data.x[data.used]
    boxes = [(s.inputs(x.min(axis=0)), s.inputs(x.max(axis=0)))]
    state = state_column(data.names)
    if state is not None:
        held = np.arange(x.shape[1]) == state
        boxes = [
            (np.where(held, at, boxes[0][0]), np.where(held, at, boxes[0][1]))
            for at in np.unique(x[:, state])
        ]
    regions = [r for low, high in boxes for r in activation_regions(net, low, high)]
    slopes = np.array([r.gradient for r in regions]) * (s.span / s.scale)
    points = np.array([r.inside for r in regions]) * s.scale + s.offset
    worst = points[slopes.argmin(axis=0)]
    return Certificate(data.names, slopes.min(axis=0), slopes.max(axis=0), worst, len(regions))


def certificate_details(c: Certificate | None, data: Data, source: str) -> dict[str, Any]:
    """The certificate for the file; nothing is certified of a network that is too large."""
    if c is None:
        return {"exact": False}
    x = data.x[data.used]
    ends = np.column_stack((x.min(axis=0), x.max(axis=0))).tolist()
    slopes = dict(zip(c.names, np.column_stack((c.low, c.high)).tolist()))
    slopes.pop("direction", None)
    out: dict[str, Any] = {
        "method": f"{c.regions} activation regions enumerated",
        "exact": True,
        "inside": dict(zip(data.names, ends)),
        "slopes": slopes,
    }
    if source in c.names:
        out["rises_with"] = {"input": source, "certified": c.monotone(source)}
        if not c.monotone(source):
            worst = c.worst[c.names.index(source)]
            out["rises_with"]["violated_at"] = dict(zip(c.names, worst.tolist()))
    return out


def certificate_notice(
    c: Certificate | None, data: Data, source: str, target: str
) -> Iterator[Notice]:
    """Warn of a certified place where the output falls with what it has to rise with."""
    if c is None or c.monotone(source):
        return
    k = c.names.index(source)
    where = ", ".join(
        f"{n} {v:.4g} {u}".removesuffix(" 1") for n, v, u in zip(c.names, c.worst[k], data.units)
    )
    yield Notice(
        "not-monotone",
        f"inside the data's range the {target} falls with rising {source} somewhere, by "
        f"{-c.low[k]:.3g} per unit of the {source}: at {where}. A loop closed over it would "
        "have the wrong sign there. Give other --hidden units or another --seed, or record "
        "more data around it.",
    )
