"""Dry and viscous friction by direction: one law with one set of names.

    F_f = coulomb_positive + viscous_positive v      positive direction
    F_f = -coulomb_negative + viscous_negative v     negative direction
    -breakaway_negative <= F_f <= breakaway_positive at rest: what is needed

At low speed a lubricated contact has more friction, ``stribeck exp(-(v / stribeck_speed)^2)``
above either level, or up to the static one of each direction [2]_. All levels are magnitudes
[1]_. Nothing is smoothed: at rest friction takes whatever value balances the other forces, up to
the static level.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 1, 17 to 19 and table 3.
.. [2] B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools
   and compensation methods for the control of machines with friction", Automatica 30, 1994,
   equation 8 with the exponent of Bo and Pavelescu, 2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from ..routines import Expression, by_sign, choose, constant, exp
from ..routines.expression import Operand
from ..specification import Quantity

_TOLD = 4.0  # standard errors of half the difference of two levels that is beyond doubt
_NOTABLE = 0.015  # part of their mean that it has to be to matter


def stribeck_share(velocity: FloatArray, speed: float, exponent: float = 2.0) -> FloatArray:
    """Part of the Stribeck level that is left at a velocity, same shape; none at speed 0."""
    if speed <= 0.0:
        return np.zeros(np.shape(velocity))
    return np.asarray(np.exp(-((np.abs(velocity) / speed) ** exponent)))


@dataclass(frozen=True)
class FrictionLaw:
    """Levels [N or N m] and viscous coefficients [per m/s or rad/s] by direction.

    ``stribeck`` [N or N m] is how far friction rises above either level towards rest, and
    ``stribeck_speed`` [m/s or rad/s] the speed at which 1/e of that is left; 0: no rise. Where
    the levels are ``joined``, it rises to the static level of each direction instead.

    A static level below that of the slowest motion means nothing: the axis would break away
    and stop at once. It is raised to it.
    """

    coulomb_positive: float
    coulomb_negative: float
    viscous_positive: float = 0.0
    viscous_negative: float = 0.0
    breakaway_positive: float = 0.0
    breakaway_negative: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 0.0
    joined: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        for side in ("positive", "negative"):
            static, kinetic = f"breakaway_{side}", f"coulomb_{side}"
            slowest = getattr(self, kinetic) + self.stribeck * (self.stribeck_speed > 0.0)
            object.__setattr__(self, static, max(getattr(self, static), slowest))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Read the law off named parameters.

        ``viscous`` and ``coulomb`` stand for both directions where there are no one-sided
        values; whatever else the mapping holds is left alone. A ``stribeck_speed`` without a
        ``stribeck`` says that a curve joins the levels.
        """
        speed = float(values.get("stribeck_speed", 0.0))

        def side(kind: str, way: str) -> float:
            return float(values.get(f"{kind}_{way}", values.get(kind, 0.0)))

        return cls(
            side("coulomb", "positive"), side("coulomb", "negative"),
            side("viscous", "positive"), side("viscous", "negative"),
            side("breakaway", "positive"), side("breakaway", "negative"),
            float(values.get("stribeck", 0.0)), speed,
            joined=speed > 0.0 and "stribeck" not in values,
        )  # fmt: skip

    def rise(self, way: float) -> float:
        """Rise of friction above the kinetic level of a direction towards rest [N or N m]."""
        if self.stribeck_speed <= 0.0:
            return 0.0
        if not self.joined:
            return self.stribeck
        if way > 0.0:
            return self.breakaway_positive - self.coulomb_positive
        return self.breakaway_negative - self.coulomb_negative

    @property
    def curved(self) -> bool:
        """Return whether friction in motion falls with the speed."""
        return max(self.rise(1.0), self.rise(-1.0)) > 0.0

    @property
    def fall(self) -> float:
        """Steepest fall of friction with the speed, ``sqrt(2 / e)`` of rise over speed."""
        if not self.curved:
            return 0.0
        rise = max(self.rise(1.0), self.rise(-1.0))
        return math.sqrt(2.0 / math.e) * rise / self.stribeck_speed

    def moving(self, velocity: npt.ArrayLike, direction: npt.ArrayLike | None = None) -> FloatArray:
        """Friction that has to be overcome to move, shape of ``velocity``.

        Parameters
        ----------
        velocity
            [m/s or rad/s]
        direction
            Motion state where it is known better than from the sign of the velocity: positive,
            negative, or 0 where it is unknown and the levels cancel.

        Returns
        -------
        FloatArray
            Zero where nothing moves.
        """
        v = np.asarray(velocity, dtype=float)
        s = np.sign(v if direction is None else np.asarray(direction, dtype=float))
        level = np.where(s > 0.0, self.coulomb_positive, self.coulomb_negative)
        rise = np.where(s > 0.0, self.rise(1.0), self.rise(-1.0))
        level = level + rise * stribeck_share(v, self.stribeck_speed)
        rate = np.where(v > 0.0, self.viscous_positive, self.viscous_negative)
        return np.asarray(s * level + rate * v)

    def at_rest(self, drive: npt.ArrayLike) -> FloatArray:
        """Friction at rest under a driving force: what balances it, up to the static levels."""
        return np.clip(
            np.asarray(drive, dtype=float), -self.breakaway_negative, self.breakaway_positive
        )

    def routine_value(
        self, velocity: Expression, rest: Operand = 0.0, direction: Expression | None = None
    ) -> Expression:
        """:meth:`moving` as an expression.

        ``rest`` is what it is at zero velocity; a motion state that is known (``direction``) leaves
        nothing to rest.
        """
        forward, backward = self._level(velocity, 1.0), self._level(velocity, -1.0)
        up = constant("viscous_positive", self.viscous_positive) * velocity
        down = constant("viscous_negative", self.viscous_negative) * velocity
        if self.viscous_positive == self.viscous_negative:
            up = down = constant("viscous", self.viscous_positive) * velocity
        if direction is not None:
            viscous = choose(velocity, ">", 0.0, up, down)
            return by_sign(direction, forward, backward) + viscous
        return by_sign(velocity, up + forward, down + backward, rest)

    def _level(self, velocity: Expression, sign: float) -> Expression:
        """Dry friction of one direction, with its sign."""
        side = "positive" if sign > 0.0 else "negative"
        level = constant(f"coulomb_{side}", sign * getattr(self, f"coulomb_{side}"))
        rise = self.rise(sign)
        if rise <= 0.0:
            return level
        share = velocity * constant("per_stribeck_speed", 1.0 / self.stribeck_speed)
        return level + constant(f"rise_{side}", sign * rise) * exp(-(share * share))


def mean_and_offset(values: Mapping[str, float]) -> dict[str, float]:
    """Mean of the two Coulomb levels, and half their difference [N or N m]."""
    positive, negative = values["coulomb_positive"], values["coulomb_negative"]
    return {
        "coulomb_mean": 0.5 * (positive + negative),
        "coulomb_offset": 0.5 * (positive - negative),
    }


def unequal_levels(
    derived: Mapping[str, Quantity], drive: str, same: str, remedy: str
) -> Iterator[str]:
    """Tell of Coulomb levels that differ beyond doubt and by enough to matter, in words.

    A constant force gives the same: ``F_c+ [v > 0] - F_c- [v < 0]`` is
    ``(F_c+ + F_c-) / 2 sign(v) + (F_c+ - F_c-) / 2``.

    Parameters
    ----------
    derived
        :func:`mean_and_offset` with their errors.
    drive, same
        What moves the axis, and where a constant part of it may come from.
    """
    half, mean = derived["coulomb_offset"].number, derived["coulomb_mean"].number
    unit = derived["coulomb_mean"].unit
    error = float(np.max(derived["coulomb_offset"].std_error or 0.0))
    if abs(half) > max(_TOLD * error, _NOTABLE * abs(mean)):
        yield (
            f"the Coulomb levels differ by {2.0 * half:+.3g} {unit} ({abs(200.0 * half / mean):.0f}"
            f" % of their mean, {mean:.4g} {unit}, which is measured either way). A constant "
            f"{drive} of {half:+.3g} {unit} ({same}) gives the same, and no motion can tell the "
            f"two apart. {remedy}"
        )
