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
from .equation import SHORT_OF_TOP, edges

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
    """Inverse of :func:`_bend` for ``0 <= y <= most``: ``-log(1 - k y) / k``.

    In single precision nothing is left of ``1 - k y`` where the curve is flat.
    """
    if k * most >= _NEAR:
        left = 1.0 - y * constant("curvature", k)
        left = maximum(left, SHORT_OF_TOP) if 1.0 - k * most < SHORT_OF_TOP else left
        return log(left) * constant("per_curvature", -1.0 / k)
    return y * polynomial([k**n / (n + 1.0) for n in range(_TERMS)], y, "unbend")


class MotorRoutines:
    """Routines of the values of a motor, for the ``command`` and the ``unit`` of the speed."""

    def __init__(self, values: Mapping[str, float], command: Argument, unit: str) -> None:
        self.command, self.unit = command, unit
        self.gain, self.offset = values["gain"], values.get("command_offset", 0.0)
        self.edges, self.k = edges(values), max(values["curvature"], 1e-12)
        low, high = self.edges
        self.half = constant("half_hysteresis", 0.5 * values["hysteresis"])
        reach = max(command.high - self.offset, self.offset - command.low, high, -low)
        reach += 0.5 * values["hysteresis"]
        self.top = min(values.get("saturation_command", reach), reach)
        self.most = [max(self.top - edge, 0.0) for edge in (high, -low)]
        self.fastest = [self.gain * -expm1(-self.k * x) / self.k for x in self.most]

    def steady(self) -> Routine:
        """Steady speed behind the play; the first command finds the spool where it is."""
        about = "Steady speed; the play of the valve is kept between calls."
        draft = Draft("steady", about, self.unit)
        u = draft.argument(self.command)
        spool, begun = draft.state("spool"), draft.state("begun")
        draft.put(spool, choose(begun, ">", 0.0, self._behind_play(u, spool), u))
        draft.put(begun, 1.0)
        return draft.returns(self._speed(spool))

    def step(self, role: str, unit: str, lag: Filter, offset: float, sample_time: float) -> Routine:
        """One step of the motion, to an output; ``lag`` follows the curve."""
        about = f"Take the command of this sample, return the {role}."
        follow = Draft("step", about, unit, sample_time)
        u, spool = follow.argument(self.command), follow.state("spool", self.offset)
        follow.put(spool, self._behind_play(u, spool))
        follow.let("drive", self._speed(spool))
        moved = follow.filter(lag)
        return follow.returns(moved + constant("output_offset", offset) if offset else moved)

    def curve(self) -> tuple[Routine, Routine]:
        """Steady speed and its inverse, where the direction of the command is known."""
        direction = Argument("direction", "1", "1 where the command was last raised, -1 lowered, "
                             "0 between", -1.0, 1.0)  # fmt: skip
        about = "Steady speed where the direction of the command is known."
        steady = Draft("speed", about, self.unit)
        u, way = steady.argument(self.command), steady.argument(direction)
        at = steady.let("spool", u - by_sign(way, self.half, -self.half))
        inverse = Draft("command_for", "Command for a steady speed.", self.command.unit)
        forward, backward = self.fastest
        wanted = inverse.argument(
            Argument("speed", self.unit, "wanted speed without the offset of its sensor",
                     -backward * (self.command.low < self.offset), forward, recorded=False)
        )  # fmt: skip
        shape = abs(wanted) * constant("per_gain", 1.0 / self.gain)
        size = inverse.let("size", _unbend(shape, self.k, max(self.fastest) / self.gain))
        shift = by_sign(inverse.argument(direction), self.half, -self.half)
        low, high = self.edges
        back = by_sign(wanted, size + high + shift, shift - size + low)
        back = back + constant("offset", self.offset) if self.offset else back
        return steady.returns(self._speed(at)), inverse.returns(back)

    def _behind_play(self, u: Expression, spool: Expression) -> Expression:
        return minimum(maximum(spool, u - self.half), u + self.half)

    def _speed(self, spool: Expression) -> Expression:
        """Steady speed over the spool's command behind the play; one side is always at rest."""
        low, high = self.edges
        apart = spool - constant("offset", self.offset) if self.offset else spool
        sides = []
        for way, edge, most in ((apart, high, self.most[0]), (-apart, -low, self.most[1])):
            x = maximum(minimum(way, constant("top", self.top)) - edge, 0.0)
            sides.append(_bend(x, self.k, most))
        return (sides[0] - sides[1]) * self.gain
