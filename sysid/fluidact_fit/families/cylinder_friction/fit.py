"""One fit: which unknowns the logs determine, their values, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError, UsageError
from ...estimation.named_model import check_form
from ...estimation.regression import Estimator, Regression
from ...estimation.results import Refusal, Solved, determine, left_open
from ...estimation.stribeck import free_names, undetermined
from ...estimation.uncertainty import t_quantile
from ...experiment import FloatArray
from ...family import ParameterSpec, Quantity, Request, Variant
from ...mechanics.friction_law import mean_and_offset
from .axis import LINEAR, Axis
from .options import ONE_SIDED, SIDES, FrictionOptions
from .samples import (
    LEVELS,
    Data,
    FrictionBalance,
    at_speeds,
    both_ways,
    group_by_log,
    half_range,
    sides_moved,
)

SECOND_SPEED = 1.5  # ratio of two speeds that are clearly different
_MEAN = "coulomb_mean"  # stands for both levels where they are equal about an offset


@dataclass(frozen=True)
class Fit:
    """A finished fit: ``data`` as fitted, ``options`` with everything settled.

    ``found`` is the regression in its own unknowns, ``solved`` the same by parameters and
    offsets; ``ranges`` are the slowest and fastest speed by direction [m/s or rad/s].
    """

    data: list[Data]
    options: FrictionOptions
    found: Regression
    solved: Solved
    ranges: Mapping[str, tuple[float, float]]
    notices: list[Notice]

    @property
    def axis(self) -> Axis:
        """Drive and moving part."""
        return self.data[0].axis

    @property
    def offset(self) -> str:
        """Name of the offset of the drive among the derived numbers."""
        return f"{self.axis.drive}_offset"

    @property
    def covered(self) -> dict[str, tuple[float, float, str]]:
        """Range of the speed where it was computed from a place [m/s or rad/s]."""
        if self.axis.speed in self.data[0].experiment:
            return {}
        v = np.concatenate([d.speed for d in self.data])
        return {self.axis.speed: (float(v.min()), float(v.max()), self.axis.speed_unit)}

    def derived(self) -> dict[str, Quantity]:
        """Mean and half difference of the levels, and the offset of the force or torque."""
        known = not any(n in self.solved.refused for n in LEVELS)
        offsets = [n for n in self.solved.names if n.startswith("offset")]

        def function(v: Mapping[str, float]) -> dict[str, float]:
            out = mean_and_offset(v) if known else {}
            if offsets:
                out[self.offset] = sum(v[n] for n in offsets) / len(offsets)
            return out

        names = ("coulomb_mean", "coulomb_offset", self.offset)
        units = dict.fromkeys(names, self.axis.force_unit)
        return self.solved.derive(units, function)


def fit_friction(variant: Variant, data: list[Data], request: Request[FrictionOptions]) -> Fit:
    """Fit, refuse what is not determined, and add an offset where one is needed.

    An error where the forces cannot be those of friction, or nothing is left to estimate.
    """
    options, fixed, moved = request.options, request.fixed, sides_moved(data)
    check_form({**fixed, **request.bounds}, "viscous", options.rates, "viscous", options.viscous)
    asked = options.offset == "estimate" or options.force_offset is True
    if not asked and not fixed:
        _check_signs(data, moved)
    ranges, noise = _speed_ranges(data, moved), max(d.motion.noise for d in data)
    specs = {p.name: _with_remedy(p, ranges, data[0].axis) for p in variant.parameters}
    limits = {p.name: request.bounds.get(p.name, (p.minimum, p.maximum)) for p in specs.values()}
    refusals = [r for s in SIDES if s not in moved for r in _idle(s, options)]
    rising = free_names(options.stribeck == "estimate", fixed)
    known = {*fixed, *(r.parameter for r in refusals)}
    alike = [n for n in options.rates if n not in known and _one_speed(_of(n, ranges), noise)]
    axis = data[0].axis
    refusals += [_too_alike(n, _describe_speeds(_of(n, ranges), axis) + ".") for n in alike]
    if alike and _one_speed(ranges, noise):
        refusals += [Refusal(n, _describe_speeds(ranges, axis) + ".") for n in rising]
        if not options.is_settled:  # without the ends of the strokes, levels are of one speed
            near = {s: (0.9 * low, 1.1 * high) for s, (low, high) in ranges.items()}
            data = [replace(d, kept=d.kept & at_speeds(d.motion, near)) for d in data]
            options = replace(
                options, speeds_positive=near.get("positive"), speeds_negative=near.get("negative")
            )
    problem = _Problem(data, limits, options, asked, rising)
    end = determine(
        problem.solve,
        lambda found: (
            undetermined(
                found.free,
                FrictionBalance(data).speed,
                # where the search ended: a step of a rise that is not determined may go anywhere
                lambda held: problem.solve({**held, "stribeck_speed": found.speed}).free,
                (axis.force_unit, axis.speed_unit),
                deadband=options.deadband or 0.0,
            )
            or _undetermined(found.free, specs, data, ranges, noise)
        ),
        specs,
        fixed=fixed,
        refusals=refusals,
    )
    found, unknowns = end.solution, end.solution.free.names
    options = replace(options, force_offset=_MEAN in unknowns)
    written = [n for n in specs if n in LEVELS or n in found.values]
    source = {n: _MEAN if n in LEVELS and _MEAN in unknowns else n for n in written}
    source |= {n: n for n in unknowns if n.startswith("offset")}
    solved = replace(found.free, values=found.values, fixed=fixed, refused=end.refused)
    held = {n: v for n, v in found.free.values.items() if n not in unknowns}
    notices = [*end.notices, *Estimator(FrictionBalance(data), unknowns, held).other_shape()]
    return Fit(data, options, found, solved.renamed(source), ranges, notices)


def _of(name: str, ranges: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Speeds by direction of the motion that feels a viscous coefficient; empty: none moved."""
    return {s: r for s, r in ranges.items() if name in ("viscous", f"viscous_{s}")}


def _check_signs(data: Sequence[Data], moved: Sequence[str]) -> None:
    """Reject forces that act along the motion, as friction never does.

    The mean force of the strokes, half the difference of the two directions, would then be
    negative beyond doubt.
    """
    names = [f"coulomb_{s}" for s in moved]
    found = Estimator(FrictionBalance(data), names).solve().free
    mean = sum(found.values.values()) / len(names)
    error = float(np.sqrt(max(float(found.covariance.sum()), 0.0))) / len(names)
    if mean + t_quantile(0.975, found.degrees) * error >= 0.0:
        return
    one_sided, axis = len(names) == 1, data[0].axis
    remedy = f"Give --scale {axis.drive}=-1 if the sensor has the opposite sign."
    if axis is LINEAR:
        remedy += (
            " If the pressures move the piston against the measured force, give --pressures=drive."
            " If the force comes from one chamber's pressure, the other chamber is missing: give "
            "both as --column pressure=HEADER --area=M2 --column pressure_2=HEADER --area-2=M2, "
            "without a force."
        )
    if not any(axis.drive in d.experiment for d in data):
        remedy = (
            "pressure has to be that of the chamber that pushes in the positive direction, and "
            "pressure_2 that of the other one, recorded or as levels (--step "
            "pressure_2=FROM:TO@T in Pa). Swap them with their areas, or give --scale "
            "position=-1 (or velocity=-1) if the sensor has the opposite sign."
        )
    raise LogError(
        f"friction would be negative ({mean:.4g} {axis.force_unit}): the {axis.drive} left after "
        f"{'pressure and ' * (axis is LINEAR)}inertia acts along the motion",
        where=", ".join(d.experiment.name for d in data),
        expected=f"The {axis.drive} is positive along positive velocity and drives the motion.",
        remedy=remedy
        + f" If a constant {axis.drive} is added to it, record strokes in both directions."
        * one_sided,
    )


def _with_remedy(
    spec: ParameterSpec, ranges: Mapping[str, tuple[float, float]], axis: Axis
) -> ParameterSpec:
    """The specification with a remedy in numbers, from the speeds that the logs have."""
    unit = axis.speed_unit
    if spec.name in ("viscous", *ONE_SIDED):
        wanted = " or ".join(
            f"at {SECOND_SPEED * high:.2g} {unit} or faster, or {low / SECOND_SPEED:.2g} {unit} or "
            f"slower, in the {s} direction"
            for s, (low, high) in _of(spec.name, ranges).items()
        )
        if not wanted:
            return spec
        remedy = f"Add one stroke, or one log, at a speed {SECOND_SPEED:g} times another: {wanted}."
        return replace(spec, remedy=remedy)
    if spec.name not in LEVELS:
        return spec
    side = spec.name.removeprefix("coulomb_")
    other = next(s for s in SIDES if s != side)
    remedy = f"Record at least one stroke in the {side} direction, at steady speed"
    if other in ranges:
        low, high = ranges[other]
        remedy += f": at {low:.3g} to {high:.3g} {unit}, as in the {other} direction"
    return replace(spec, remedy=remedy + ".")


def _idle(side: str, options: FrictionOptions) -> list[Refusal]:
    """Names that belong only to a direction without motion."""
    other = next(s for s in SIDES if s != side)
    nothing = f"nothing moves in the {side} direction."
    level = Refusal(
        f"coulomb_{side}",
        f"{nothing} An offset of the drive, if there is one, counts as friction of the {other} "
        "direction until it does.",
    )
    return [level, *(Refusal(n, nothing) for n in options.rates if n == f"viscous_{side}")]


def _too_alike(name: str, reason: str) -> Refusal:
    """Viscous friction cannot be told at one speed."""
    said = "The Coulomb levels include all friction at that speed."
    if name in ONE_SIDED:
        side = name.removeprefix("viscous_")
        said = f"The Coulomb level of the {side} direction includes all friction at that speed."
    return Refusal(name, f"{reason} {said}")


def _undetermined(
    found: Solved,
    specs: Mapping[str, ParameterSpec],
    data: Sequence[Data],
    ranges: Mapping[str, tuple[float, float]],
    noise: float,
) -> list[Refusal]:
    """The viscous coefficient most in doubt, if it could be anything up to half of all friction.

    The interval times the range of speeds is the force that is in doubt.
    """
    sensible = {}
    for name in (n for n in ("viscous", *ONE_SIDED) if n in found.names):
        span = max(_speed_span(low, high, noise) for low, high in _of(name, ranges).values())
        sensible[name] = 0.5 * half_range(data) / max(span, 1e-300)
    for r in left_open(found, {n: specs[n] for n in sensible}, sensible):
        seen = _describe_speeds(_of(r.parameter, ranges), data[0].axis)
        return [_too_alike(r.parameter, f"{r.reason} Noise hides it: {seen}.")]
    return []


@dataclass(frozen=True)
class _Problem:
    """Parts of the problem that stay the same from attempt to attempt.

    ``asked``: an offset is required; ``rising``: Stribeck parameters to estimate.
    """

    data: list[Data]
    limits: Mapping[str, tuple[float, float]]
    options: FrictionOptions
    asked: bool
    rising: Sequence[str]

    def solve(self, held: Mapping[str, float]) -> Regression:
        """Solve with some parameters held, with an offset where a level would be negative."""
        possible = not any(n in held for n in LEVELS) and self.options.offset != "none"
        if self.asked and not possible:
            kind = NotIdentifiedError if self.options.is_settled else UsageError
            raise kind(
                f"an offset of the {self.data[0].axis.drive} cannot be estimated here",
                expected="This needs motion in both directions and free Coulomb levels.",
                remedy="Leave --offset out, or record strokes in both directions.",
            )
        if self.asked:
            return self._solve(held, [_MEAN, *self._offsets()])
        found = self._solve(held, LEVELS)
        if possible and not self.options.is_settled and self._needs_offset(found):
            return self._solve(held, [_MEAN, *self._offsets()])
        return found

    def _needs_offset(self, found: Regression) -> bool:
        """Return whether a level is impossible in all logs together, or in a single one.

        Offsets that differ from log to log do not show in the common fit.
        """
        logs = group_by_log(self.data)
        alone = (
            Estimator(FrictionBalance(d), LEVELS).solve()
            for d in logs
            if len(logs) > 1 and both_ways(d)
        )
        return levels_impossible(found) or any(map(levels_impossible, alone))

    def _offsets(self) -> list[str]:
        """One offset per log where every log shows both directions, else one for all."""
        logs = group_by_log(self.data)
        if all(map(both_ways, logs)):
            return [f"offset[{d[0].experiment.log}]" for d in logs]
        return ["offset"]

    def _solve(self, held: Mapping[str, float], levels: Sequence[str]) -> Regression:
        names = [n for n in (*levels, *self.options.rates, *self.rising) if n not in held]
        if not names:
            raise UsageError(
                "nothing is left to estimate: every parameter is fixed or undetermined",
                remedy="Leave out one --fix.",
            )
        low, high = zip(*(self.limits[n] for n in LEVELS))
        limits = {**self.limits, _MEAN: (max(low), min(high))}
        return Estimator(FrictionBalance(self.data), names, held, limits).solve()


def levels_impossible(found: Regression) -> bool:
    """Return whether a level about zero is negative beyond its interval."""
    free = found.free
    return any(free.values[n] + free.half_width(n) < 0.0 for n in LEVELS if n in free.names)


def _speeds(speed: FloatArray) -> tuple[float, float] | None:
    """Range of the speeds of whole strokes [m/s].

    Weighted by distance, the short slow tails about a reversal weigh little and a fast
    stroke as much as a slow one: the middle 80 % of the distance. Slow strokes that take a
    fifth of the time are not tails, however short they are.
    """
    if speed.size < 5:
        return None
    v = np.sort(np.abs(speed))
    share = np.cumsum(v)
    low, high = np.searchsorted(share, np.array([0.1, 0.9]) * share[-1])
    low = min(int(low), v.size // 5)
    return float(v[low]), float(v[min(int(high), v.size - 1)])


def _speed_ranges(data: Sequence[Data], moved: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Slowest and fastest speed by direction, over all logs."""
    out = {}
    for s in moved:
        found = [r for d in data if (r := _speeds(d.speed[d.side(s)])) is not None]
        if found:
            out[s] = min(r[0] for r in found), max(r[1] for r in found)
    return out


def _speed_span(low: float, high: float, noise: float) -> float:
    """Spread of true speeds, the noise of the velocity (2 x 1.282 sd) subtracted [m/s]."""
    return float(np.sqrt(max((high - low) ** 2 - (2.563 * noise) ** 2, 0.0)))


def _one_speed(ranges: Mapping[str, tuple[float, float]], noise: float) -> bool:
    """Return whether every direction has one speed only."""
    spans = [(low + high, _speed_span(low, high, noise)) for low, high in ranges.values()]
    return all(twice + span < SECOND_SPEED * (twice - span) for twice, span in spans)


def _describe_speeds(ranges: Mapping[str, tuple[float, float]], axis: Axis) -> str:
    """Say which speeds the logs have."""
    parts = [
        f"{low:.3g} and {high:.3g} {axis.speed_unit} ({s} direction)"
        for s, (low, high) in ranges.items()
    ]
    return "all strokes (ends excluded) run between " + " and between ".join(parts)
