"""The curve of the motor and its inverse, as a controller runs them."""

from __future__ import annotations

from collections.abc import Mapping
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
from .equation import edges

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
        self.gain, self.offset = values["gain"], values.get("command_offset", 0.0)
        self.edges = edges(values)
        self.k, self.width = max(values["curvature"], 1e-12), values["hysteresis"]
        low, high = self.edges
        reach = max(command.high - self.offset, self.offset - command.low, high, -low)
        reach += 0.5 * self.width
        self.top = min(values.get("saturation_command", reach), reach)
        self.most = [max(self.top - edge, 0.0) for edge in (high, -low)]
        self.fastest = [self.gain * -expm1(-self.k * x) / self.k for x in self.most]

    def speed(self, spool: Expression) -> Expression:
        """One side is always at rest."""
        low, high = self.edges
        apart = spool - constant("offset", self.offset) if self.offset else spool
        sides = []
        for way, edge, most in ((apart, high, self.most[0]), (-apart, -low, self.most[1])):
            x = maximum(minimum(way, constant("top", self.top)) - edge, 0.0)
            sides.append(_bend(x, self.k, most))
        return (sides[0] - sides[1]) * self.gain

    def opening(self, speed: Expression) -> Expression:
        """Command beyond the edge for the magnitude of a speed."""
        shape = speed * constant("per_gain", 1.0 / self.gain)
        return _unbend(shape, self.k, max(self.fastest) / self.gain)


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


def step_routine(
    values: Mapping[str, float], command: Argument, output: tuple[str, str], lag: Filter,
    offset: float, sample_time: float,
) -> Routine:  # fmt: skip
    """Return one step of the motion, to the role and unit ``output``; ``lag`` follows the curve."""
    curve, (role, unit) = _Curve(values, command), output
    about = f"Take the command of this sample, return the {role}."
    follow = Draft("step", about, unit, sample_time)
    u, spool = follow.argument(command), follow.state("spool", curve.offset)
    follow.put(spool, _behind_play(u, spool, values))
    follow.let("drive", curve.speed(spool))
    moved = follow.filter(lag)
    return follow.returns(moved + constant("output_offset", offset) if offset else moved)


def curve_routines(
    values: Mapping[str, float], command: Argument, unit: str
) -> tuple[Routine, Routine]:
    """Return steady speed and its inverse; ``unit`` is that of the speed."""
    curve, half = _Curve(values, command), _half(values)
    direction = Argument(
        "direction", "1", "1 where the command was last raised, -1 lowered, 0 between", -1.0, 1.0
    )

    def shift(way: Expression) -> Expression:
        return by_sign(way, half, -half)

    steady = Draft("speed", "Steady speed where the direction of the command is known.", unit)
    at = steady.let("spool", steady.argument(command) - shift(steady.argument(direction)))
    inverse = Draft("command_for", "Command for a steady speed.", command.unit)
    forward, backward = curve.fastest
    wanted = inverse.argument(
        Argument("speed", unit, "wanted speed without the offset of its sensor",
                 -backward * (command.low < curve.offset), forward, recorded=False)
    )  # fmt: skip
    size, moved = inverse.let("size", curve.opening(abs(wanted))), inverse.argument(direction)
    low, high = curve.edges
    back = by_sign(wanted, size + high + shift(moved), shift(moved) - size + low)
    if curve.offset:
        back = back + constant("offset", curve.offset)
    return steady.returns(curve.speed(at)), inverse.returns(back)
