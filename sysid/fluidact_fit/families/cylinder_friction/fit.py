"""One fit: which unknowns the logs determine, their values, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError, UsageError
from ...estimation.parametric import make_unknowns
from ...estimation.results import Determined, Refusal, Solved, determine
from ...family import ParameterSpec, Quantity, Request, Variant
from .options import FrictionOptions
from .regression import Regression, System
from .samples import SIDES, Data, at_speeds, half_range, sides_moved
from .speeds import SECOND_SPEED, around, describe_speeds, one_speed, speed_ranges, speed_span

LEVELS = ("coulomb_positive", "coulomb_negative")
_MEAN = "coulomb_mean"  # stands for both levels where they are equal about an offset


@dataclass(frozen=True)
class Fit:
    """A finished fit: ``data`` as fitted, ``options`` with everything settled.

    ``found`` is the regression in its own unknowns, ``solved`` the same by parameters and
    offsets; ``limits`` are the ranges it was held in, ``moved`` the directions with motion and
    ``ranges`` the slowest and fastest speed by direction [m/s].
    """

    data: list[Data]
    options: FrictionOptions
    found: Regression
    solved: Solved
    limits: Mapping[str, tuple[float, float]]
    moved: list[str]
    ranges: Mapping[str, tuple[float, float]]
    notices: list[Notice]

    def derived(self) -> dict[str, Quantity]:
        """Mean and half difference of the levels, and the offset of the force."""
        known = not any(n in self.solved.refused for n in LEVELS)
        offsets = [n for n in self.solved.names if n.startswith("offset")]

        def function(v: Mapping[str, float]) -> dict[str, float]:
            positive, negative = (v[n] for n in LEVELS)
            out = {}
            if known:
                out["coulomb_mean"] = 0.5 * (positive + negative)
                out["coulomb_offset"] = 0.5 * (positive - negative)
            if offsets:
                out["force_offset"] = sum(v[n] for n in offsets) / len(offsets)
            return out

        units = dict.fromkeys(("coulomb_mean", "coulomb_offset", "force_offset"), "N")
        return self.solved.derive(units, function)


def fit_friction(variant: Variant, data: Sequence[Data], request: Request[FrictionOptions]) -> Fit:
    """Fit, refuse what is not determined, and add an offset where one is needed.

    Raises
    ------
    LogError, UsageError, NotIdentifiedError
        When the forces cannot be those of friction, or nothing is left to estimate.
    """
    unknowns = make_unknowns(
        variant.parameters, tuple(p.name for p in variant.parameters), {}, request
    )
    limits = {n: (u.low, u.high) for n, u in unknowns.items()}
    fixed = {n: float(v) for n, v in request.fixed.items()}
    options, moved = request.options, sides_moved(data)
    asked = options.offset == "estimate" or options.force_offset is True
    if not asked and not fixed:
        _check_signs(data, moved)
    ranges, noise = speed_ranges(data, moved), max(d.motion.noise for d in data)
    specs = {p.name: _with_remedy(p, ranges) for p in variant.parameters}
    refusals = [_idle(s) for s in SIDES if s not in moved]
    if "viscous" not in fixed and one_speed(ranges, noise):
        refusals.append(_too_alike(describe_speeds(ranges) + "."))
        if not options.is_settled:
            near = around(ranges)
            data = [replace(d, kept=d.kept & at_speeds(d.motion, near)) for d in data]
            options = replace(
                options, speeds_positive=near.get("positive"), speeds_negative=near.get("negative")
            )
    problem = _Problem(list(data), limits, options, asked)

    def undetermined(found: Regression) -> list[Refusal]:
        return _undetermined(found, data, ranges, noise)

    end = determine(problem.solve, undetermined, specs, fixed=fixed, refusals=refusals)
    symmetric = _MEAN in end.solution.names
    options = replace(options, force_offset=symmetric)
    solved = _by_parameter(end, specs, fixed)
    fit = Fit(list(data), options, end.solution, solved, limits, moved, ranges, end.notices)
    if symmetric:
        fit.notices.extend(_explain_offset(fit))
    elif _levels_impossible(fit.found):
        fit.notices.extend(_explain_negative(fit))
    return fit


def _check_signs(data: Sequence[Data], moved: Sequence[str]) -> None:
    """Reject forces that act along the motion, as friction never does.

    Raises
    ------
    LogError
        When the mean force of the strokes, half the difference of the two directions, is
        negative beyond doubt.
    """
    names = [f"coulomb_{s}" for s in moved]
    found = System(data, names, {}, {}).solve()
    mean = sum(found.values.values()) / len(names)
    half = found.quantile * found.std_error(dict.fromkeys(names, 1.0 / len(names)))
    if mean + half >= 0.0:
        return
    one_sided = len(names) == 1
    remedy = (
        "Give --scale force=-1 if the sensor has the opposite sign. If the force comes "
        "from one chamber's pressure, the other chamber is missing: give both as --column "
        "pressure=HEADER --area=M2 --column pressure_2=HEADER --area-2=M2, without a force."
    )
    if not any("force" in d.experiment for d in data):
        remedy = (
            "pressure has to be that of the chamber that pushes in the positive direction, and "
            "pressure_2 that of the other one, recorded or as levels (--step "
            "pressure_2=FROM:TO@T in Pa). Swap them with their areas, or give --scale "
            "position=-1 (or velocity=-1) if the sensor has the opposite sign."
        )
    raise LogError(
        f"friction would be negative ({mean:.4g} N): the force left after pressure and inertia "
        "acts along the motion",
        where=", ".join(d.experiment.name for d in data),
        expected="Force is positive along positive velocity and drives the motion.",
        remedy=remedy
        + (" If a constant force is added to it, record strokes in both directions." * one_sided),
    )


def _with_remedy(spec: ParameterSpec, ranges: Mapping[str, tuple[float, float]]) -> ParameterSpec:
    """The specification with a remedy in numbers, from the speeds that the logs have."""
    if spec.name == "viscous":
        wanted = " or ".join(
            f"at {SECOND_SPEED * high:.2g} m/s or faster, or {low / SECOND_SPEED:.2g} m/s or "
            f"slower, in the {s} direction"
            for s, (low, high) in ranges.items()
        )
        remedy = f"Add one stroke, or one log, at a speed {SECOND_SPEED:g} times another: {wanted}."
        return replace(spec, remedy=remedy)
    side = spec.name.removeprefix("coulomb_")
    other = next(s for s in SIDES if s != side)
    remedy = f"Record at least one stroke in the {side} direction, at steady speed"
    if other in ranges:
        low, high = ranges[other]
        remedy += f": at {low:.3g} to {high:.3g} m/s, as in the {other} direction"
    return replace(spec, remedy=remedy + ".")


def _idle(side: str) -> Refusal:
    """The level of a direction without motion."""
    other = next(s for s in SIDES if s != side)
    return Refusal(
        f"coulomb_{side}",
        f"nothing moves in the {side} direction. An offset of the force, if there is one, "
        f"counts as friction of the {other} direction until it does.",
    )


def _too_alike(reason: str) -> Refusal:
    return Refusal("viscous", reason + " The Coulomb levels include all friction at that speed.")


def _undetermined(
    found: Regression,
    data: Sequence[Data],
    ranges: Mapping[str, tuple[float, float]],
    noise: float,
) -> list[Refusal]:
    """Viscous friction, if it could be anything from none to half of all friction.

    The interval times the range of speeds is the force that is in doubt.
    """
    if "viscous" not in found.names:
        return []
    span = max(speed_span(low, high, noise) for low, high in ranges.values())
    half = found.quantile * found.std_error({"viscous": 1.0})
    if half * span <= 0.5 * abs(half_range(data)):
        return []
    return [
        _too_alike(
            f"its 95 % interval would be {found.free_values['viscous']:.3g} ± {half:.2g} "
            f"N s/m; {describe_speeds(ranges)}."
        )
    ]


@dataclass(frozen=True)
class _Problem:
    """What stays the same from attempt to attempt; ``asked``: an offset is required."""

    data: list[Data]
    limits: Mapping[str, tuple[float, float]]
    options: FrictionOptions
    asked: bool

    def solve(self, held: Mapping[str, float]) -> Regression:
        """Solve with some parameters held, with an offset where a level would be negative without.

        It may show in all logs together or in a single one: offsets that differ from log to log
        do not show in the common fit.
        """
        possible = not any(n in held for n in LEVELS) and self.options.offset != "none"
        if self.asked:
            if not possible:
                self._refuse_offset()
            return self._solve(held, symmetric=True)
        found = self._solve(held, symmetric=False)
        if not possible or self.options.is_settled:
            return found
        logs = self._logs() if len(self._logs()) > 1 else []
        alone = (System(d, LEVELS, {}, {}).solve() for d in logs if _both_ways(d))
        if not _levels_impossible(found) and not any(_levels_impossible(a) for a in alone):
            return found
        return self._solve(held, symmetric=True)

    def _refuse_offset(self) -> None:
        kind = NotIdentifiedError if self.options.is_settled else UsageError
        raise kind(
            "an offset of the force cannot be estimated here",
            expected="This needs motion in both directions and free Coulomb levels.",
            remedy="Leave --offset out, or record strokes in both directions.",
        )

    def _logs(self) -> list[list[Data]]:
        """Runs by log."""
        numbers = dict.fromkeys(d.experiment.log for d in self.data)
        return [[d for d in self.data if d.experiment.log == k] for k in numbers]

    def _offsets(self) -> list[str]:
        """One offset per log where every log shows both directions, else one for all."""
        logs = self._logs()
        if all(_both_ways(d) for d in logs):
            return [f"offset[{d[0].experiment.log}]" for d in logs]
        return ["offset"]

    def _solve(self, held: Mapping[str, float], *, symmetric: bool) -> Regression:
        levels = [_MEAN, *self._offsets()] if symmetric else list(LEVELS)
        names = [n for n in (*levels, "viscous") if n not in held]
        low, high = zip(*(self.limits[n] for n in LEVELS))
        limits = {**self.limits, _MEAN: (max(low), min(high))}
        if not names:
            raise UsageError(
                "nothing is left to estimate: every parameter is fixed or undetermined",
                remedy="Leave out one --fix.",
            )
        return System(self.data, names, held, limits).solve()


def _both_ways(runs: Sequence[Data]) -> bool:
    return all(any(d.side(s).any() for d in runs) for s in SIDES)


def _levels_impossible(found: Regression) -> bool:
    """Whether a level about zero is negative beyond its interval."""
    return any(
        found.free_values[n] + found.quantile * found.std_error({n: 1.0}) < 0.0
        for n in LEVELS
        if n in found.names
    )


def _by_parameter(
    end: Determined[Regression], specs: Mapping[str, ParameterSpec], fixed: Mapping[str, float]
) -> Solved:
    """The regression by parameters: equal levels are one unknown under two names."""
    found, held = end.solution, {**dict.fromkeys(end.refused, 0.0), **fixed}
    source = {n: _MEAN if n in LEVELS and _MEAN in found.names else n for n in specs}
    source |= {n: n for n in found.names if n.startswith("offset")}
    names = tuple(n for n in source if n not in held)
    rows = [found.names.index(source[n]) for n in names]
    values = {**held, **{n: found.values[source[n]] for n in names}}
    matrix, degrees = found.uncertainty.covariance[np.ix_(rows, rows)], found.uncertainty.degrees
    return Solved(values, names, matrix, degrees, fixed, end.refused)


def _explain_offset(fit: Fit) -> list[Notice]:
    if fit.options.offset == "estimate":
        return []
    size = fit.derived()["force_offset"].number
    message = (
        f"the force has an offset of {size:.4g} N (another chamber, gravity, a preload or the "
        "sensor's zero), so a level about zero would be negative. The levels are taken about the "
        "offset and are equal: their difference cannot be separated from it. Remove the offset "
        "with the other chamber's pressure, or give --offset=none."
    )
    return [Notice("force-offset", message)]


def _explain_negative(fit: Fit) -> list[Notice]:
    if fit.options.offset == "none":
        raise LogError(
            "a Coulomb level would be negative: the force has an offset",
            where=", ".join(d.experiment.name for d in fit.data),
            remedy="Leave out --offset=none to estimate it, or subtract it from the force.",
        )
    message = (
        "a Coulomb level would be negative and was held at zero: the force has an offset, or "
        "friction is not linear in speed. Record strokes in both directions at several speeds."
    )
    return [Notice("negative-friction", message)]
