"""Attacks on the ball screw whose friction falls over the speed, asked for with ``--stribeck``.

    F(v) = F_k + (F_s - F_k) exp(-(v / v_s)^2)

The simulator steps the motion with the classical Runge-Kutta rule, fifty steps to a sample, and
solves break-away and stop inside a step; it shares nothing with the estimator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from ..attack import Array, Attack
from .ball_screw import AXIS, COUNT, SCREW, STATIC, Logger, Machine, follow, make_attack

SPEED = "stribeck_speed"
_HALVINGS = 40  # of a step, in which a stop is sought


def slide(machine: Machine, drive: Array, step: float, jumps: bool = False) -> Array:
    """Motion at the instants of a drive, ``step`` apart; as :func:`follow` with a curve."""
    p = machine.truth
    static = {1: p[STATIC[0]], -1: p[STATIC[1]]}
    out = drive.copy()
    place, speed, way = 0.0, 0.0, 0
    u = drive.tolist()
    for i, begin in enumerate(u):
        out[i] = place
        if i == len(u) - 1:
            break
        slope = 0.0 if jumps else (u[i + 1] - begin) / step
        at = 0.0  # of the step
        while at < step:
            if way == 0:
                way, at = _breakaway(static, begin, slope, at, step)
                if way == 0:
                    break
                speed = 0.0
            pull = partial(_acceleration(machine, way), begin * way, slope * way)
            far, new = _advance(pull, at, speed, step - at)
            if new > 0.0:
                place, speed = place + way * far, new
                break
            if speed <= 0.0:  # broke away by a hair and cannot move yet
                way = 0
                break
            low, high = 0.0, step - at
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                moving = _advance(pull, at, speed, middle)[1] > 0.0
                low, high = (middle, high) if moving else (low, middle)
            place += way * _advance(pull, at, speed, low)[0]
            at, speed, way = at + low, 0.0, 0
    return out


def _breakaway(
    static: dict[int, float], begin: float, slope: float, at: float, step: float
) -> tuple[int, float]:
    """Direction and instant in which an axis at rest moves next; 0 if it stays."""
    for side in (1, -1):
        if side * (begin + slope * at) > static[side]:
            return side, at
        if side * (begin + slope * step) > static[side]:
            return side, (side * static[side] - begin) / slope
    return 0, at


def _acceleration(machine: Machine, way: int) -> Callable[[float, float, float, float], float]:
    """Acceleration in the direction of motion, speed and drive taken positive there."""
    p = machine.truth
    inertia, viscous = p.get("inertia", p.get("mass", 0.0)), p["viscous"]
    side = "positive" if way > 0 else "negative"
    kinetic = p[f"coulomb_{side}"]
    fall, curve, shape = p[f"breakaway_{side}"] - kinetic, p[SPEED], p.get("shape", 2.0)

    def pull(begin: float, slope: float, t: float, v: float) -> float:
        friction = kinetic + fall * math.exp(-((abs(v) / curve) ** shape)) + viscous * v
        return (begin + slope * t - friction) / inertia

    return pull


def _advance(
    pull: Callable[[float, float], float], t: float, v: float, h: float
) -> tuple[float, float]:
    """Way and speed after one Runge-Kutta step."""
    a1 = pull(t, v)
    a2 = pull(t + 0.5 * h, v + 0.5 * h * a1)
    a3 = pull(t + 0.5 * h, v + 0.5 * h * a2)
    a4 = pull(t + h, v + h * a3)
    return h * v + h * h / 6.0 * (a1 + a2 + a3), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def attacks() -> Iterator[Attack]:
    """All of them."""
    asked = partial(make_attack, stribeck="estimate", move=slide)
    curved = Machine({**SCREW, SPEED: 10.0})
    held = Logger()
    moving, lines = replace(held, kind="continuous"), replace(held, kind="lines")
    right = "Stribeck asked for"
    yield asked(right, "held", curved, held, bounds=True, repetitions=4)
    yield asked(right, "levels", curved, replace(held, kind="levels"), bounds=True)
    yield asked(right, "lines, foh", curved, lines, "foh", bounds=True)
    yield asked(right, "continuous, smooth", curved, moving, "smooth", bounds=True, repetitions=4)
    for speed in (2.0, 40.0):
        other = Machine({**SCREW, SPEED: speed})
        yield asked(right, f"{speed:g} rad/s, smooth", other, moving, "smooth", bounds=True)
        yield asked(right, f"{speed:g} rad/s, held", other, held, bounds=True)
    axis = Machine({**AXIS, SPEED: 5e-3})
    axis_log = Logger(count=1e-6, duration=10.0, step=0.005)
    yield asked(right, "linear axis", axis, axis_log, bounds=True)
    for loud in (0.55, 2.0):
        words = f"{loud:g} of the usual torque"
        log = replace(moving, loud=loud)
        yield asked("Stribeck, other speeds", words, curved, log, "smooth", bounds=True)
    noisy = replace(moving, noise=0.5 * COUNT)
    yield asked("Stribeck, noise", "half a count", curved, noisy, "smooth", bounds=True)
    for noise in (1e-6, 1e-5):
        log = replace(moving, drive_noise=noise)
        yield asked("Stribeck, noise", f"{noise:g} N m, smooth", curved, log, "smooth")
    for hold, log in (("", held), ("smooth", moving)):
        words = f"5 % of {log.kind}, {hold or 'default'}"
        yield asked("Stribeck, lost rows", words, curved, replace(log, lost=0.05), hold)
    yield asked("Stribeck, another hold", "curved, taken for held", curved, moving)
    yield asked("Stribeck, another hold", "curved, taken for lines", curved, moving, "foh")
    yield asked("Stribeck, another hold", "held, taken for lines", curved, held, "foh")
    none = Machine({**SCREW, SPEED: 0.0})
    plain = partial(asked, move=follow, scales={SPEED: 10.0})
    yield plain("Stribeck that is not there", "held", none, held)
    yield plain("Stribeck that is not there", "smooth", none, moving, "smooth")
    flat = {**SCREW, "breakaway_positive": 2e-3, "breakaway_negative": 1.6e-3, SPEED: 0.0}
    yield plain("Stribeck that is not there", "no static level", Machine(flat), moving, "smooth")
    for speed in (2.0, 10.0):
        other = Machine(SCREW, stribeck=speed)
        yield plain("Stribeck of another shape", f"{speed:g} rad/s", other, moving, "smooth")
    sudden = Machine({**SCREW, SPEED: 10.0, "shape": 4.0})
    yield asked("Stribeck of another shape", "fourth power", sudden, moving, "smooth")
