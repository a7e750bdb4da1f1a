"""Bounds of the slopes of a network: exact ones of small ReLU networks, safe ones of any other.

A ReLU network is affine in every region of constant activation pattern. For few units the
regions that meet a box are enumerated by linear programs, which makes the range of the
gradient exact [1]_; larger networks get an interval bound that is safe and wider.

References
----------
.. [1] G. Montufar, R. Pascanu, K. Cho, Y. Bengio, "On the number of linear regions of deep
   neural networks", NIPS 2014.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...estimation.network import Activation, Network, activate
from ...experiment import BoolArray, FloatArray

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

    The box is cut by one unit after the other. Each region carries a point inside; the
    side that holds it is known to be there, the other one is asked for by a linear
    program (largest ball). An input with ``low == high`` is held.

    Parameters
    ----------
    low, high : (inputs,)
        Corners of the box, standardised.
    """
    if net.activation != "relu" or len(net.weights) != 2:
        raise ValueError("regions can be enumerated for one hidden layer of ReLU units only")
    free = high > low
    span = np.where(free, high - low, 1.0)
    w = net.weights[0][:, free] * span[free]
    b = net.biases[0] + net.weights[0] @ low
    size = np.linalg.norm(w, axis=1)
    flat = size <= 1e-12
    w, b = w / np.where(flat, 1.0, size)[:, None], b / np.where(flat, 1.0, size)
    found: list[tuple[tuple[bool, ...], FloatArray]] = [((), np.full(int(free.sum()), 0.5))]
    for k in range(b.size):
        found = [
            ((*pattern, side), point)
            for pattern, old in found
            for side, point in _sides(w[: k + 1], b[: k + 1], pattern, old)
        ]
    out = []
    for pattern, point in found:
        inside = low.copy()
        inside[free] += point * span[free]
        gradient = (net.weights[1][0] * np.array(pattern, dtype=float)) @ net.weights[0]
        out.append(Region(pattern, inside, gradient))
    return out


def _sides(
    w: FloatArray, b: FloatArray, pattern: tuple[bool, ...], point: FloatArray
) -> list[tuple[bool, FloatArray]]:
    """Which sides of the last unit's hyperplane a region reaches, with a point each."""
    if np.minimum(w[-1], 0.0).sum() + b[-1] >= -_NARROWEST:
        return [(True, point)]
    if np.maximum(w[-1], 0.0).sum() + b[-1] <= _NARROWEST:
        return [(False, point)]
    here, out = float(w[-1] @ point + b[-1]), []
    for side, known in ((False, here < -_NARROWEST), (True, here > _NARROWEST)):
        inside = point if known else _largest_ball(w, b, np.array([*pattern, side]))
        if inside is not None:
            out.append((side, inside))
    return out


def _largest_ball(w: FloatArray, b: FloatArray, sides: BoolArray) -> FloatArray | None:
    """Centre of the largest ball in a region of the unit box, ``None`` when it is empty."""
    from scipy.optimize import linprog

    sign = np.where(sides, 1.0, -1.0)
    size = np.linalg.norm(w, axis=1)
    d = w.shape[1]
    # sign (w x + b) >= r |w|, and r <= x <= 1 - r
    rows = np.vstack(
        (np.column_stack((-sign[:, None] * w, size)),
         np.column_stack((-np.eye(d), np.ones(d))),
         np.column_stack((np.eye(d), np.ones(d))))
    )  # fmt: skip
    right = np.concatenate((sign * b, np.zeros(d), np.ones(d)))
    answer = linprog(np.append(np.zeros(d), -1.0), rows, right, bounds=(None, None))
    found = answer.status == 0 and answer.x is not None and answer.x[-1] > _NARROWEST
    return np.asarray(answer.x[:-1]) if found else None


def gradient_interval(
    net: Network, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Safe bounds of the gradient in a box by interval arithmetic, shape ``(inputs,)`` each.

    Not exact: the true range lies within.
    """
    centre, radius = 0.5 * (low + high), 0.5 * (high - low)
    slopes: list[tuple[FloatArray, FloatArray]] = []
    for w, b in zip(net.weights[:-1], net.biases[:-1]):
        middle, reach = w @ centre + b, np.abs(w) @ radius
        least, most = middle - reach, middle + reach
        slopes.append(_slope_range(least, most, net.activation))
        least, most = activate(least, net.activation), activate(most, net.activation)
        centre, radius = 0.5 * (least + most), 0.5 * (most - least)
    down = up = net.weights[-1][0]
    for w, (flat, steep) in zip(net.weights[-2::-1], slopes[::-1]):
        ends = np.stack((down * flat, down * steep, up * flat, up * steep))
        least, most = ends.min(axis=0), ends.max(axis=0)
        middle, reach = 0.5 * (least + most) @ w, 0.5 * (most - least) @ np.abs(w)
        down, up = middle - reach, middle + reach
    return down, up


def _slope_range(
    least: FloatArray, most: FloatArray, activation: Activation
) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest derivative of the activation over intervals."""
    if activation == "relu":
        return (least > 0.0).astype(float), (most > 0.0).astype(float)
    ends = 1.0 - np.tanh(np.stack((least, most))) ** 2
    across = (least < 0.0) & (most > 0.0)
    return ends.min(axis=0), np.where(across, 1.0, ends.max(axis=0))
