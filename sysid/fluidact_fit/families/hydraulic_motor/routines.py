"""The curve of the motor and its inverse, as a controller runs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import expm1

from ...routines import (
    Argument,
    Draft,
    Expression,
    Filter,
    Routine,
    by_sign,
    choose,
    constant,
    exp,
    log,
    maximum,
    minimum,
    polynomial,
)

_NEAR = 0.3  # k x below which a series is used: an exponential would cancel
_TERMS = 14  # of the series; the first one left out is below 1e-9 of it


def _bend(x: Expression, k: float, most: float) -> Expression:
    """``(1 - exp(-k x)) / k`` for ``0 <= x <= most``."""
    if k * most >= _NEAR:
        return (1.0 - exp(x * constant("curvature", -k))) * constant("per_curvature", 1.0 / k)
    series, term = [1.0], 1.0
    for n in range(2, _TERMS):
        term *= -k / n
        series.append(term)
    return x * polynomial(series, x, "bend")


def _unbend(y: Expression, k: float, most: float) -> Expression:
    """Inverse of :func:`_bend` for ``0 <= y <= most``: ``-log(1 - k y) / k``."""
    if k * most >= _NEAR:
        return log(1.0 - y * constant("curvature", k)) * constant("per_curvature", -1.0 / k)
    return y * polynomial([k**n / (n + 1.0) for n in range(_TERMS)], y, "unbend")


class _Curve:
    """Steady speed over the spool's command behind the play."""

    def __init__(self, values: Mapping[str, float], command: Argument) -> None:
        self.gain, self.zone = values["gain"], values["dead_zone"]
        self.k, self.width = max(values["curvature"], 1e-12), values["hysteresis"]
        reach = max(command.high, -command.low, self.zone) + 0.5 * self.width
        self.top = min(values.get("saturation_command", reach), reach)
        self.most = max(self.top - self.zone, 0.0)
        self.fastest = self.gain * -expm1(-self.k * self.most) / self.k

    def speed(self, spool: Expression) -> Expression:
        """Odd about zero: one side is always at rest."""
        sides = []
        for way in (spool, -spool):
            x = maximum(minimum(way, constant("top", self.top)) - self.zone, 0.0)
            sides.append(_bend(x, self.k, self.most))
        return (sides[0] - sides[1]) * self.gain

    def command(self, speed: Expression) -> Expression:
        """Magnitude of the command for the magnitude of a speed."""
        shape = speed * constant("per_gain", 1.0 / self.gain)
        return self.zone + _unbend(shape, self.k, self.fastest / self.gain)


def curve_routine(values: Mapping[str, float], command: Argument, unit: str) -> Routine:
    """Steady speed behind the play; the first command finds the spool where it is."""
    curve = _Curve(values, command)
    draft = Draft("steady", "Steady speed; the play of the valve is kept between calls.", unit)
    u = draft.argument(command)
    spool, begun = draft.state("spool"), draft.state("begun")
    draft.put(spool, choose(begun, ">", 0.0, _behind_play(u, spool, values), u))
    draft.put(begun, 1.0)
    return draft.returns(curve.speed(spool))


def _half(values: Mapping[str, float]) -> Expression:
    return constant("half_hysteresis", 0.5 * values["hysteresis"])


def _behind_play(u: Expression, spool: Expression, values: Mapping[str, float]) -> Expression:
    half = _half(values)
    return minimum(maximum(spool, u - half), u + half)


def routines_of(
    values: Mapping[str, float], command: Argument, unit: str, lag: Filter, offset: float,
    sample_time: float,
) -> Sequence[Routine]:  # fmt: skip
    """Return the routines; ``unit`` is that of the speed, ``lag`` what follows the curve."""
    curve, half = _Curve(values, command), _half(values)
    direction = Argument(
        "direction", "1", "1 where the command was last raised, -1 lowered, 0 between", -1.0, 1.0
    )

    def shift(way: Expression) -> Expression:
        return by_sign(way, half, -half)

    follow = Draft("step", "Take the command of this sample, return the speed.", unit, sample_time)
    u, spool = follow.argument(command), follow.state("spool")
    follow.put(spool, _behind_play(u, spool, values))
    follow.let("drive", curve.speed(spool))
    motion = follow.returns(follow.filter(lag) + constant("offset", offset))
    steady = Draft("speed", "Steady speed where the direction of the command is known.", unit)
    at = steady.let("spool", steady.argument(command) - shift(steady.argument(direction)))
    inverse = Draft("command_for", "Command for a steady speed.", command.unit)
    wanted = inverse.argument(
        Argument("speed", unit, "wanted speed without the offset of its sensor",
                 -curve.fastest * (command.low < 0.0), curve.fastest, recorded=False)
    )  # fmt: skip
    size, moved = inverse.let("size", curve.command(abs(wanted))), inverse.argument(direction)
    back = by_sign(wanted, size + shift(moved), shift(moved) - size)
    return motion, steady.returns(curve.speed(at)), inverse.returns(back)
