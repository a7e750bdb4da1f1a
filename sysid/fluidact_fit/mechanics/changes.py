"""Derivatives of a motion with events, in one pass over all its steps.

Between events a motion consists of steps, the speed and place after each of which depend on the
speed before it and on the law. The derivative of the speed obeys a linear recursion, that of the
place is a sum. Events tie the steps together (implicit function theorem):

- A stop is at speed zero: where it is does not depend on when. What rests has no derivative of its
  speed; a turning point without rest hands on ``a_after / a_before`` of it.
- A break-away that comes later by ``dt`` begins with ``-a dt`` at the instant that was due.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..estimation.recursion import run_recursion
from ..experiment import Array, FloatArray
from .motion import Motion, StickSlip


@dataclass(frozen=True)
class Steps:
    """All steps of a motion in order, shape ``(n,)`` each.

    Attributes
    ----------
    node, way
        Interval between two nodes of the torque, and direction.
    offset, span
        Where in its interval a step begins and how long it is [s].
    speed
        At the begin.
    carry
        What the derivative of the last speed is multiplied by to be that of the next first one:
        1 but after stops.
    lead
        Derivative of the first speed by the static level of the direction.
    """

    node: npt.NDArray[np.intp]
    way: npt.NDArray[np.intp]
    offset: FloatArray
    span: FloatArray
    speed: FloatArray
    carry: FloatArray
    lead: FloatArray


@dataclass(frozen=True)
class Varied:
    """Derivatives of the speed after each step, and of the way it makes.

    By the first speed, shape ``(n,)``, and by the law, ``(q, n)``: the first ``q`` of inertia,
    viscous friction, kinetic level, static level, speed and exponent of the curve.
    """

    speed: FloatArray
    speed_by_law: FloatArray
    way: FloatArray
    way_by_law: FloatArray


def with_changes(
    motion: Motion, steps: Steps | None, varied: Varied | None, p: StickSlip, start: Array
) -> Motion:
    """The motion with its derivatives as imaginary parts, in the directions of the parameters."""
    position = motion.position.astype(complex)
    if steps is None or varied is None:
        return replace(motion, position=position)
    theta = np.imag(p.rows)
    moving = np.real(start.flat[0]) != 0.0
    first = np.imag(np.broadcast_to(start, theta.shape[1])) * moving
    place = _propagate(steps, varied, theta, first)
    count = np.searchsorted(steps.node, np.arange(position.shape[1]))  # steps before each node
    position.imag[:] = place[:, count]
    return replace(motion, position=position)


def _propagate(steps: Steps, varied: Varied, theta: FloatArray, start: FloatArray) -> FloatArray:
    """Propagate changes of the rows of a drive, ``(9, k)``, and of the first speed, ``(k,)``.

    Returns the changes of the place before every step and after the last, ``(k, n + 1)``.
    """
    sides = [(steps.way > 0) * 1.0, (steps.way < 0) * 1.0]
    # after every step: by inertia, then by direction viscous, kinetic, static, then the curve
    speed, way = (
        np.array([
            rows[0], *(row * side for row in rows[1:4] for side in sides), *rows[4:],
        ])
        for rows in (varied.speed_by_law, varied.way_by_law)
    )  # fmt: skip
    known = theta[: speed.shape[0]].T
    driven = np.empty((start.size, steps.node.size))
    driven[:, 1:] = known @ (steps.carry * speed)[:, :-1]
    driven[:, 0] = start
    if steps.lead.any():
        driven += theta[5:7].T @ (steps.lead * np.array(sides))
    before = run_recursion(driven.T, (steps.carry * varied.speed)[None]).T
    place = np.zeros((start.size, steps.node.size + 1))
    before *= varied.way
    before += known @ way
    np.cumsum(before, axis=1, out=place[:, 1:])
    return place
