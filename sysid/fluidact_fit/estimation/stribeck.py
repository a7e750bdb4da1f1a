"""Stribeck friction: option, parameters, search, and when the logs show none.

The law, ``stribeck exp(-(v / stribeck_speed)^2)`` above the kinetic level, is that of
``mechanics.friction_law``. It is linear in the level and not in the speed, which is therefore
searched for over the range of the motion first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import Notice, NotIdentifiedError, UsageError
from ..experiment import Experiment, FloatArray
from ..options import choice
from ..specification import ParameterSpec, Simulate, Structure, UnmodelledEffect
from .budget import simulated
from .results import Refusal, Solved
from .significance import CERTAIN

STRIBECK = ("stribeck", "stribeck_speed")
EXPONENT = "stribeck_exponent"  # of the curve: 2, but a fit is tested for another one
_ALIKE, _DIFFERENT = 1.1, 1.5  # ratios of speeds that count as one, and as two
_HELD = 0.01  # least share of the samples at a speed that counts
_TESTED = 3  # clearly different speeds that a test for a rise needs
_GRID = 16  # speeds at which the search begins
_FALLS = ((1.0, "exp(-|v| / stribeck_speed)"), (4.0, "exp(-(v / stribeck_speed)^4)"))
_SLOWER = (
    "Record steady strokes at several speeds on either side of the one at which friction is least; "
    "leave --stribeck out if it does not rise towards rest."
)
FRICTION_STRUCTURES = (
    Structure("symmetric viscous friction", {"viscous": "symmetric", "stribeck": "none"}),
    Structure("asymmetric viscous friction", {"viscous": "asymmetric", "stribeck": "none"}),
    Structure("symmetric, Stribeck", {"viscous": "symmetric", "stribeck": "estimate"}),
    Structure("asymmetric, Stribeck", {"viscous": "asymmetric", "stribeck": "estimate"}),
)


def stribeck_choice(frees: str = "stribeck") -> Any:
    """The option ``--stribeck`` of a family; ``frees`` is empty where no fit is tested for it."""
    words = "whether to estimate how friction rises at low speed"
    return choice("none", ("none", "estimate"), words, frees)


def stribeck_specs(force_unit: str, speed_unit: str) -> tuple[ParameterSpec, ...]:
    """Level and speed, entries of a family's parameter table."""
    rows = (
        ("stribeck", force_unit, "friction at the slowest motion, above the kinetic level"),
        ("stribeck_speed", speed_unit, "Stribeck velocity, at which that has fallen to 1/e"),
    )
    return tuple(
        ParameterSpec(name, unit, words, neutral=0.0, minimum=0.0, optional=True, remedy=_SLOWER)
        for name, unit, words in rows
    )


def free_names(asked: bool, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Stribeck parameters that are estimated: those asked for and not fixed.

    Raises
    ------
    UsageError
        Where one of them is given and nothing is said of the other.
    """
    given = [n for n in STRIBECK if n in fixed]
    if len(given) == 1 and not asked:
        (other,) = set(STRIBECK) - set(given)
        raise UsageError(
            f"--fix {given[0]} means nothing without {other}",
            remedy=f"Give --fix {other}=VALUE too, or --stribeck=estimate.",
        )
    return tuple(n for n in STRIBECK if asked and n not in fixed)


def rise_words(values: Mapping[str, Any], sign: str, speed: str = "v") -> str:
    """The term in the equation of a file, empty where there is no rise; its sign and speed."""
    return f" + {sign}*stribeck*exp(-({speed}/stribeck_speed)^2)" * bool(values.get("stribeck"))


def another_fall(
    response: Callable[[Sequence[Experiment], Simulate], Sequence[Mapping[str, FloatArray]]],
) -> UnmodelledEffect:
    """Friction that falls off from rest as ``exp(-(v / stribeck_speed)^m)``, ``m`` less than 2.

    ``response`` has the derivatives by ``-m``.
    """
    return UnmodelledEffect(
        "fall of friction",
        "friction falls off from rest otherwise than as exp(-(v / stribeck_speed)^2)",
        "The levels at rest and stribeck_speed depend on the shape that is supposed: use them "
        "within the speeds of the logs only, and judge them by the picture (--plot) or with "
        "--validate.",
        response,
    )


def slowest_and_fastest(speed: FloatArray, least: float = 0.0) -> tuple[float, float]:
    """Range of some speeds but for the slowest percent; nothing is known below ``least``."""
    size = np.abs(speed)
    fastest = float(size.max())
    return float(max(np.quantile(size, 0.01), 1e-3 * fastest, least)), fastest


def with_speed(values: Mapping[str, float], speed: FloatArray) -> dict[str, float]:
    """Values of a plant, with a speed for a Stribeck level that a fit without one is tested for.

    It lies in the middle of the speeds of the motion. With fewer than three speeds a rise cannot be
    told from Coulomb and viscous friction.
    """
    out = dict(values)
    tested = out.get("stribeck") and not out.get("stribeck_speed") and np.any(speed)
    if tested and _count_speeds(speed, 0.0) >= _TESTED:
        out["stribeck_speed"] = float(np.sqrt(np.prod(slowest_and_fastest(speed))))
    return out


@dataclass(frozen=True)
class Rise:
    """Stribeck level and speed at which a balance is made linear [N, m/s]; zeros: none.

    ``exponent`` is 2 except where other shapes are compared.
    """

    level: float = 0.0
    speed: float = 0.0
    exponent: float = 2.0

    def shares(
        self, velocity: FloatArray, noise: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Share of the level, and its slopes by its speed and by the velocity, ``(n,)`` each.

        ``noise`` of the velocity [m/s] blurs the share: taken instead is the function of the noisy
        velocity whose mean over normal noise is the share itself [1]_ [1, s/m, s/m].

        References
        ----------
        .. [1] L. A. Stefanski, "Unbiased estimation of a nonlinear function of a normal mean with
           application to measurement error models", Communications in Statistics A18, 1989.
        """
        v = self.speed
        if v <= 0.0:
            return (np.zeros(velocity.size),) * 3
        if self.exponent != 2.0:
            share = np.asarray(np.exp(-((np.abs(velocity) / v) ** self.exponent)))
            return share, np.zeros(velocity.size), np.zeros(velocity.size)
        # where the speed is drowned in noise it is refused, and no arithmetic helps
        q = max(v**2 - 2.0 * noise**2, 0.5 * v**2)
        share = v / np.sqrt(q) * np.exp(-(velocity**2) / q)
        by_speed = share * (1.0 / v - v / q + 2.0 * v * velocity**2 / q**2)
        return share, by_speed, share * -2.0 * velocity / q

    def columns(
        self, sign: FloatArray, velocity: FloatArray, noise: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Factors of the level and of a change of the speed, ``(n,)`` each; see :meth:`shares`.

        ``sign`` is that of the motion.
        """
        share, by_speed, _ = self.shares(velocity, noise)
        return sign * share, sign * self.level * by_speed


def friction_columns(
    sign: FloatArray, velocity: FloatArray, rise: Sequence[FloatArray]
) -> dict[str, FloatArray]:
    """Columns of the parameters of friction in a balance, by name, ``(n,)`` each.

    Parameters
    ----------
    sign
        Direction of the motion: 1, -1, or between where samples are means over a reversal.
    velocity
        [m/s or rad/s]
    rise
        What multiplies the Stribeck level and a change of the Stribeck speed; see
        :meth:`Rise.columns`.
    """
    forward = np.where(sign > 0.0, velocity, 0.0)
    return {
        "coulomb_positive": 0.5 * (1.0 + sign),
        "coulomb_negative": -0.5 * (1.0 - sign),
        "coulomb_mean": sign,
        "viscous": velocity,
        "viscous_positive": forward,
        "viscous_negative": velocity - forward,
        **dict(zip(STRIBECK, rise)),
    }


@dataclass(frozen=True)
class RiseSearch:
    """The Stribeck speed on a grid from the slowest to the fastest motion.

    ``solve`` gives the misfit, a sum or mean of squares over ``samples``, and the Stribeck level
    at a speed; all else is linear in it.
    """

    ends: tuple[float, float]
    samples: int
    solve: Callable[[float], tuple[float, float]]

    @cached_property
    def grid(self) -> FloatArray:
        """Logarithms of the speeds, shape ``(_GRID,)``."""
        low, high = self.ends
        return np.linspace(np.log(low), np.log(high), _GRID)

    @cached_property
    def found(self) -> tuple[FloatArray, FloatArray]:
        """Misfits and levels over the grid."""
        costs, levels = zip(*(self._at(s) for s in self.grid))
        return np.array(costs), np.array(levels)

    @cached_property
    def rise(self) -> tuple[float, float, float]:
        """Misfit, level and speed of the best rise towards rest, of the best fall where none is."""
        from scipy.optimize import minimize_scalar

        costs, levels = self.found
        k = int(np.argmin(np.where(levels > 0.0, costs, np.inf) if levels.max() > 0.0 else costs))
        ends = self.grid[max(k - 1, 0)], self.grid[min(k + 1, _GRID - 1)]
        at = minimize_scalar(lambda s: self._at(s)[0], bounds=ends,
                             method="bounded", options={"xatol": 1e-4}).x  # fmt: skip
        return *self._at(at), float(np.exp(at))

    def _at(self, logarithm: float) -> tuple[float, float]:
        """Misfit and level at a speed: one look at all samples."""
        simulated()
        return self.solve(float(np.exp(logarithm)))


def shape_notice(search: Callable[[float], RiseSearch]) -> Iterator[Notice]:
    """Warn if another law would fit as well with as many unknowns.

    ``search`` searches for the rise with a given exponent of its fall: 2 is that of the law; from
    0.5 to "very large" have been proposed [1]_. Friction that grows faster than in proportion to
    the speed looks like a level that *falls* towards rest.

    References
    ----------
    .. [1] B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis
       tools and compensation methods for the control of machines with friction", Automatica
       30(7), 1994, section 2.1.
    """
    own = search(2.0)
    costs, levels = own.found
    best, level, _ = own.rise
    if level <= 0.0:
        return
    rivals = [
        (float(np.min(np.where(levels < 0.0, costs, np.inf))),
         "that grows faster than in proportion to the speed"),
    ]  # fmt: skip
    for exponent, words in _FALLS:
        cost, level, _ = search(exponent).rise
        if level > 0.0:
            rivals.append((cost, f"that falls off from rest as {words}"))
    cost, words = min(rivals)
    if (cost - best) * own.samples > CERTAIN**2 * best:
        return
    share = 100.0 * abs(cost / max(best, np.finfo(float).tiny) - 1.0)
    fits = f"better ({share:.2g} % less" if cost < best else f"as well ({share:.2g} % more"
    yield Notice(
        "friction-shape",
        f"friction {words} would fit {fits} squared misfit) with as many unknowns: the levels "
        "and stribeck depend on the shape that is supposed. Use the law within the speeds of "
        "the logs only, and judge it there by the picture (--plot); steady strokes at more "
        "speeds show the shape.",
    )


def _count_speeds(speed: FloatArray, least: float) -> int:
    """Count clearly different speeds; a continuous range counts by its width."""
    low, _ = slowest_and_fastest(speed, least)
    bins = np.floor(np.log(np.maximum(np.abs(speed) / low, 1.0)) / np.log(_ALIKE)).astype(int)
    share = np.bincount(bins) / speed.size
    held = np.flatnonzero(share >= _HELD)
    runs = np.split(held, np.flatnonzero(np.diff(held) > 1) + 1)
    return sum(max(1, round(r.size * np.log(_ALIKE) / np.log(_DIFFERENT))) for r in runs)


def undetermined(
    found: Solved,
    speed: FloatArray,
    solve: Callable[[Mapping[str, float]], Solved],
    units: tuple[str, str] = ("N", "m/s"),
    least: float = 0.0,
    deadband: float = 0.0,
) -> list[Refusal]:
    """Refuse both parameters where the rise is in doubt, or its speed could be any.

    Parameters
    ----------
    speed : (n,)
        Velocities of the samples that were fitted.
    solve
        Fits again with values held, to see whether there is a rise at all.
    units
        Of force and speed.
    least
        Speed below which there is only noise.
    deadband
        Speed up to which samples were left out, by an option that can keep more of them.

    Raises
    ------
    NotIdentifiedError
        Where friction rises for sure, by a law that the logs do not show.
    """
    if not any(n in found.names for n in STRIBECK):
        return []
    level, at = (found.values[n] for n in STRIBECK)
    low, high = slowest_and_fastest(speed, least)
    half = {n: found.half_width(n) for n in STRIBECK if n in found.names}
    seen = f"the logs show motion from {low:.2g} to {high:.2g} {units[1]}"
    if least and low == least:
        seen += ", and slower motion is lost in its noise: record it with less"
    speeds, needed = _count_speeds(speed, least), 2 + len(half)
    if speeds < needed:
        reason = f"that takes {needed} clearly different speeds, and the strokes have {speeds}."
    elif level <= half.get("stribeck", 0.0):
        rise = f"{level:.3g} ± {half.get('stribeck', 0.0):.2g} {units[0]}"
        reason = f"friction does not rise beyond doubt at low speed ({rise}); {seen}."
    elif "stribeck_speed" in half and not (
        low < at < 0.7 * high and half["stribeck_speed"] < 0.7 * at
    ):
        found_speed = f"{at:.2g} ± {half['stribeck_speed']:.2g} {units[1]}"
        reason = f"its speed would be {found_speed}; {seen}."
    else:
        return []
    if low < 2.0 * deadband:
        reason += (
            f" Motion slower than {deadband:.2g} {units[1]} was left out: a lower --deadband, above"
            " the noise of the speed, keeps slower strokes; a longer --filter lowers that noise."
        )
    if "stribeck_speed" in half:
        held = {n: v for n, v in found.values.items() if n not in found.names}
        _require_no_rise(solve({**held, "stribeck_speed": at}), reason)
    reason += " What rise there is counts as Coulomb and viscous friction."
    return [Refusal(n, reason) for n in STRIBECK if n in found.names]


def _require_no_rise(found: Solved, reason: str) -> None:
    """Refuse all friction where it certainly rises, but by an unknown law.

    ``found`` has the rise at the speed that fits best. Levels and slope without a rise would be
    those of a law that the logs contradict, with intervals that assume it.
    """
    if "stribeck" not in found.names:
        return
    size = found.values["stribeck"] / max(found.std_error("stribeck"), np.finfo(float).tiny)
    if not size > CERTAIN:
        return
    raise NotIdentifiedError(
        f"the data cannot determine friction with --stribeck. It rises towards rest ({size:.2g} "
        f"standard errors), but how cannot be told: {reason}",
        expected="Coulomb and viscous friction hang on it. Nothing was written.",
        remedy="Record steady strokes at several speeds on either side of the one at which "
        "friction is least, or give --fix stribeck_speed=VALUE if it is known; without "
        "--stribeck, what rise there is counts as Coulomb and viscous friction, at the speeds of "
        "these logs only.",
    )
