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
from typing import Any, NamedTuple

import numpy as np

from ...errors import Notice
from ...estimation.network import Network
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import FloatArray
from ...units import after_number
from .data import Data, state_column

ENUMERATED = 8  # hidden units up to which the regions are enumerated
_NARROWEST = 1e-9  # radius of a region, in widths of the box, below which it is no region


class Region(NamedTuple):
    """Part of a box in which a ReLU network is affine, standardised.

    ``pattern`` says which units are active, ``inside`` is a point of it.
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
    """Range of the slopes of a network by each input inside the data's box ``(2, inputs)`` [SI].

    ``low`` and ``high`` have shape ``(inputs,)``. ``fault`` is a point of the smallest slope by the
    input ``source`` that the output has to rise with, where it falls somewhere.
    """

    names: tuple[str, ...]
    source: str
    box: FloatArray
    low: FloatArray
    high: FloatArray
    regions: int
    fault: dict[str, float] | None

    @classmethod
    def of(cls, network: ScaledNetwork, data: Data, source: str) -> Certificate | None:
        """The certificate for each motion state; ``None`` of a network with too many regions."""
        net, s, x = network.network, network.scaling, data.x[data.used]
        if net.activation != "relu" or len(net.weights) != 2 or net.hidden[0] > ENUMERATED:
            return None
        box, held = np.array([x.min(axis=0), x.max(axis=0)]), np.zeros(x.shape[1], dtype=bool)
        states = np.zeros(1)
        if (state := state_column(data.names)) is not None:
            held[state], states = True, np.unique(x[:, state])
        regions = [
            region for at in states
            for region in activation_regions(net, *s.inputs(np.where(held, at, box)))
        ]  # fmt: skip
        slopes = np.array([r.gradient for r in regions]) * (s.span / s.scale)
        low, high, fault = slopes.min(axis=0), slopes.max(axis=0), None
        if source in data.names and low[k := data.names.index(source)] < 0.0:
            worst = regions[slopes[:, k].argmin()].inside * s.scale + s.offset
            fault = dict(zip(data.names, worst.tolist()))
        return cls(data.names, source, box, low, high, len(regions), fault)

    def details(self) -> dict[str, Any]:
        """The certificate for the file."""
        slopes = dict(zip(self.names, np.column_stack((self.low, self.high)).tolist()))
        slopes.pop("direction", None)
        out: dict[str, Any] = {
            "method": f"{self.regions} activation regions enumerated",
            "exact": True,
            "inside": dict(zip(self.names, self.box.T.tolist())),
            "slopes": slopes,
        }
        if self.source in self.names:
            out["rises_with"] = {"input": self.source, "certified": self.fault is None}
        if self.fault:
            out["rises_with"]["violated_at"] = self.fault
        return out

    def notices(self, target: str, units: tuple[str, ...]) -> Iterator[Notice]:
        """Warn of a place where the ``target`` falls with what it has to rise with."""
        if not self.fault:
            return
        where = ", ".join(
            f"{n} {v:.4g}{after_number(u)}" for (n, v), u in zip(self.fault.items(), units)
        )
        yield Notice(
            "not-monotone",
            f"inside the data's range the {target} falls with rising {self.source} somewhere, by "
            f"{-self.low[self.names.index(self.source)]:.3g} per unit of the {self.source}: at "
            f"{where}. A loop closed over it would have the wrong sign there. Give other --hidden "
            "units or another --seed, or record more data around it.",
        )
