"""What a controller calls of a drive: feed-forward, and friction in motion and at rest."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from ...block import Port
from ...mechanics.friction_law import FrictionLaw
from ...routines import Argument, Draft, Routine, by_sign, constant, maximum, minimum


def reach_of(
    law: FrictionLaw, inertia: float, drive: tuple[float, float], travel: float
) -> tuple[float, float]:
    """Velocities [per second] that the drive of the logs can give over the way they covered.

    The steady one against friction, or that of the whole way under full drive where that is less.
    """
    ends = []
    for level, viscous, most in (
        (law.coulomb_negative, law.viscous_negative, -drive[0]),
        (law.coulomb_positive, law.viscous_positive, drive[1]),
    ):
        net = max(most - level, 1e-3 * max(most, level, 1e-12))
        free = sqrt(2.0 * net * travel / inertia)
        ends.append(min(net / viscous, free) if viscous > 0.0 else free)
    return -ends[0], ends[1]


def routines_of(
    law: FrictionLaw, moving: FrictionLaw, inertia: float, drive: Argument, output: Port,
    travel: float,
) -> Sequence[Routine]:  # fmt: skip
    """Return the routines; ``moving`` is the law without static levels."""
    low, high = reach_of(moving, inertia, (drive.low, drive.high), travel)
    velocity = Argument(
        "velocity", f"{output.unit}/s", "wanted velocity", low, high, recorded=False
    )
    most = max(drive.high, -drive.low) / inertia
    acceleration = Argument(
        "acceleration", f"{output.unit}/s2", "wanted acceleration", -most, most, recorded=False
    )
    ahead = Draft(
        "feedforward", "Input for a wanted motion: inertia, viscous and kinetic friction.",
        drive.unit,
    )  # fmt: skip
    v, a = ahead.argument(velocity), ahead.argument(acceleration)
    forward, backward = (float(moving.moving(0.0, way)) for way in (1.0, -1.0))
    starting = by_sign(
        a, constant("starting_positive", forward), constant("starting_negative", backward)
    )
    friction = Draft(
        "friction", "Friction against the motion; at rest what it balances.", drive.unit
    )
    speed, load = friction.argument(velocity), friction.argument(drive)
    at_rest = minimum(
        maximum(load, constant("breakaway_negative", -law.breakaway_negative)),
        constant("breakaway_positive", law.breakaway_positive),
    )
    return (
        ahead.returns(moving.routine_value(v, starting) + inertia * a),
        friction.returns(law.routine_value(speed, at_rest)),
    )
