"""Fit of friction: unknowns that the logs determine, their values, and refusals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...errors import LogError, NotIdentifiedError, UsageError
from ...estimation.named_model import check_form
from ...estimation.regression import Estimator, Regression, shared_limits
from ...estimation.results import Refusal, determine, find_uninformative
from ...estimation.stribeck import free_names, undetermined
from ...estimation.uncertainty import t_quantile
from ...experiment import FloatArray
from ...family import Quantity, Request, Variant
from ...mechanics.friction_law import mean_and_offset
from .axis import LINEAR
from .options import SIDES, FrictionOptions
from .samples import (
    LEVELS,
    FrictionData,
    both_ways,
    friction_model,
    group_by_log,
    half_range,
    offset_groups,
    sides_moved,
    speeds,
)

SECOND_SPEED = 1.5  # ratio of two speeds that are clearly different
Ranges = Mapping[str, tuple[float, float]]  # slowest and fastest speed by direction [m/s or rad/s]
_MEAN = "coulomb_mean"  # stands for both levels where they are equal about an offset


class FrictionFit:
    """A fit of friction: refuses what is not determined, adds an offset where one is needed.

    Parameters
    ----------
    variant, data, request
        Roles and parameters, the runs, and what the user asked for.

    Attributes
    ----------
    options
        With everything settled.
    found, solved
        Regression in its own unknowns, and the same by parameters and offsets.
    ranges
        Slowest and fastest speed by direction [m/s or rad/s].
    notices
        Warnings of refusals and of the shape of the law.

    Raises
    ------
    LogError
        Where the forces cannot be those of friction.
    UsageError, NotIdentifiedError
        Where nothing is left to estimate, or an offset that was asked for cannot be.
    """

    def __init__(
        self, variant: Variant, data: Sequence[FrictionData], request: Request[FrictionOptions]
    ) -> None:
        options, fixed, axis = request.options, request.fixed, data[0].axis
        given = {**fixed, **request.bounds}
        check_form(given, "viscous", options.rates, "viscous", options.viscous)
        self.data, self.options, self.fixed, self.axis = data, options, fixed, axis
        self.offset = f"{axis.drive}_offset"  # its name among the derived numbers
        self.model, self.ranges = friction_model(data), _speed_ranges(data)
        self.specs = {p.name: p for p in variant.parameters}
        ranges = {n: (p.minimum, p.maximum) for n, p in self.specs.items()}
        self.limits = {**ranges, **request.bounds}
        self.rising = free_names(options.stribeck == "estimate", fixed)
        if not self._offset_asked and not fixed:
            _check_signs(data)
        end = determine(
            self._fit, self._undetermined, self.specs, fixed=fixed, refusals=self._unseen()
        )
        self.found, unknowns = end.solution, end.solution.free.names
        written = [n for n in self.specs if n in LEVELS or n in self.found.values]
        source = {n: _MEAN if n in LEVELS and _MEAN in unknowns else n for n in written}
        source |= {n: n for n in unknowns if n.startswith("offset")}
        solved = replace(
            self.found.free, values=self.found.values, fixed=fixed, refused=end.refused
        )
        self.solved = solved.renamed(source)
        self.options = replace(options, force_offset=_MEAN in unknowns)
        self.notices = [*end.notices, *self.found.estimator.other_shape()]

    @property
    def covered(self) -> dict[str, tuple[float, float, str]]:
        """Range of the speed where it was computed from a position or angle [m/s or rad/s]."""
        if self.axis.speed in self.data[0].experiment:
            return {}
        v = speeds(self.data)
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

    @property
    def _offset_asked(self) -> bool:
        """Return whether an offset of the drive has to be estimated."""
        return self.options.offset == "free" or self.options.force_offset is True

    def _unseen(self) -> list[Refusal]:
        """Refuse parameters of directions without motion, and viscous friction at one speed."""
        moved, rates = sides_moved(self.data), self.options.rates
        out = [r for s in SIDES if s not in moved for r in self._refuse_side(s)]
        known = {*self.fixed, *(r.parameter for r in out)}
        alike = [n for n in rates if n not in known and _one_speed(self._of(n))]
        out += [self._too_alike(n) for n in alike]
        if alike and _one_speed(self.ranges):
            out += [Refusal(n, f"{self._describe(self.ranges)}.") for n in self.rising]
        return out

    def _fit(self, held: Mapping[str, float]) -> Regression:
        """Solve, with an offset where it is asked for or a level would be negative."""
        options, asked = self.options, self._offset_asked
        possible = not any(n in held for n in LEVELS) and options.offset != "none"
        if asked and not possible:
            kind = NotIdentifiedError if options.is_settled else UsageError
            raise kind(
                f"an offset of the {self.axis.drive} cannot be estimated here",
                expected="This needs motion in both directions and free Coulomb levels.",
                remedy="Leave --offset out, or record strokes in both directions.",
            )
        if not asked:
            found = self._solve(held, LEVELS, self.limits)
            optional = possible and not options.is_settled
            if not (optional and (levels_impossible(found) or _one_log_has_offset(self.data))):
                return found
        logs = offset_groups(self.data)
        offsets = [f"offset[{d[0].experiment.log}]" for d in logs] if logs[1:] else ["offset"]
        limits = {**self.limits, _MEAN: shared_limits(self.limits, LEVELS)}
        return self._solve(held, [_MEAN, *offsets], limits)

    def _solve(
        self, held: Mapping[str, float], levels: Sequence[str],
        limits: Mapping[str, tuple[float, float]],
    ) -> Regression:  # fmt: skip
        names = [n for n in (*levels, *self.options.rates, *self.rising) if n not in held]
        if not names:
            raise UsageError(
                "nothing is left to estimate: every parameter is fixed or undetermined",
                remedy="Leave out one --fix.",
            )
        return Estimator(self.model, names, held, limits).solve()

    def _undetermined(self, found: Regression) -> list[Refusal]:
        """Refuse what a solution leaves undetermined.

        A viscous coefficient is refused if half of all friction is in doubt by it: by the
        half-width of its interval times the range of speeds.
        """
        rise = undetermined(
            found.free,
            self.model.speed,
            # where the search ended: a step of a rise that is not determined may go anywhere
            lambda held: self._fit({**held, "stribeck_speed": found.speed}).free,
            (self.axis.force_unit, self.axis.speed_unit),
            deadband=self.options.deadband or 0.0,
        )
        if rise:
            return rise
        rates = {n: self.specs[n] for n in self.options.rates if n in found.free.names}
        spans = {n: max(high - low for low, high in self._of(n).values()) for n in rates}
        widths = {n: 0.5 * half_range(self.data) / max(s, 1e-300) for n, s in spans.items()}
        return [
            self._too_alike(r.parameter, f"{r.reason} Noise hides it: ")
            for r in find_uninformative(found.free, rates, widths)
        ]

    def _of(self, name: str) -> Ranges:
        """Speed ranges of the directions that a viscous coefficient acts in."""
        return {s: r for s, r in self.ranges.items() if name in ("viscous", f"viscous_{s}")}

    def _refuse_side(self, side: str) -> list[Refusal]:
        """Refuse the parameters of a direction without motion."""
        (other,) = (s for s in SIDES if s != side)
        nothing = f"nothing moves in the {side} direction."
        low, high = self.ranges[other]
        level = Refusal(
            f"coulomb_{side}",
            f"{nothing} An offset of the drive, if there is one, counts as friction of the {other} "
            "direction until it does.",
            remedy=f"Record at least one stroke in the {side} direction, at steady speed: at "
            f"{low:.3g} to {high:.3g} {self.axis.speed_unit}, as in the {other} direction.",
        )
        return [level, *(Refusal(n, nothing) for n in self.options.rates if n.endswith(side))]

    def _too_alike(self, name: str, doubt: str = "") -> Refusal:
        """Refuse viscous friction that the speeds there are cannot tell from the levels."""
        own, unit, side = self._of(name), self.axis.speed_unit, name.partition("_")[2]
        levels = f"level of the {side} direction includes" if side else "levels include"
        wanted = " or ".join(
            f"at {SECOND_SPEED * high:.2g} {unit} or faster, or {low / SECOND_SPEED:.2g} {unit} or "
            f"slower, in the {s} direction"
            for s, (low, high) in own.items()
        )
        return Refusal(
            name,
            f"{doubt}{self._describe(own)}. The Coulomb {levels} all friction at that speed.",
            remedy=f"Add one stroke, or one log, at a speed {SECOND_SPEED:g} times another: "
            f"{wanted}.",
        )

    def _describe(self, ranges: Ranges) -> str:
        """Say which speeds the logs have."""
        unit = self.axis.speed_unit
        parts = [f"{low:.3g} and {high:.3g} {unit} ({s} direction)"
                 for s, (low, high) in ranges.items()]  # fmt: skip
        return "all strokes (ends excluded) run between " + " and between ".join(parts)


def _one_log_has_offset(data: Sequence[FrictionData]) -> bool:
    """Return whether a single log shows an offset, which the others may hide."""
    logs = [d for d in group_by_log(data) if both_ways(d) and len(d) < len(data)]
    return any(levels_impossible(Estimator(friction_model(d), LEVELS).solve()) for d in logs)


def levels_impossible(found: Regression) -> bool:
    """Return whether a level about zero is negative beyond its interval."""
    free = found.free
    return any(free.values[n] + free.half_width(n) < 0.0 for n in LEVELS if n in free.names)


def _check_signs(data: Sequence[FrictionData]) -> None:
    """Reject forces that act along the motion, as friction never does.

    The mean force of the strokes, half the difference of the two directions, would then be
    negative beyond doubt.
    """
    names = [f"coulomb_{s}" for s in sides_moved(data)]
    found = Estimator(friction_model(data), names).solve().free
    mean = sum(found.values.values()) / len(names)
    error = float(np.sqrt(max(float(found.covariance.sum()), 0.0))) / len(names)
    if mean + t_quantile(0.975, found.degrees) * error >= 0.0:
        return
    axis = data[0].axis
    remedy = f"Give --scale {axis.drive}=-1 if the sensor has the opposite sign."
    if data[0].variant.output.name == "pressure":
        remedy = (
            "pressure has to be that of the chamber that pushes in the positive direction, and "
            "pressure_2 that of the other one, recorded or as levels (--step "
            "pressure_2=FROM:TO@T in Pa). Swap them with their areas, or give --scale "
            "position=-1 (or velocity=-1) if the sensor has the opposite sign."
        )
    elif axis is LINEAR:
        remedy += (
            " If the pressures move the piston against the measured force, give --pressures=drive."
            " If the force comes from one chamber's pressure, the other chamber is missing: give "
            "both as --column pressure=HEADER --area=M2 --column pressure_2=HEADER --area-2=M2, "
            "without a force."
        )
    if len(names) == 1:
        remedy += f" If a constant {axis.drive} is added to it, record strokes in both directions."
    raise LogError(
        f"friction would be negative ({mean:.4g} {axis.force_unit}): the {axis.drive} left after "
        f"{'pressure and ' * (axis is LINEAR)}inertia acts along the motion",
        where=", ".join(d.experiment.name for d in data),
        expected=f"The {axis.drive} is positive along positive velocity and drives the motion.",
        remedy=remedy,
    )


def _speed_ranges(data: Sequence[FrictionData]) -> dict[str, tuple[float, float]]:
    """Slowest and fastest speed of whole strokes by direction, over all logs.

    Noise of the velocity, 2 x 1.282 standard deviations of it, is taken off the spread.
    """
    noise, out = max(d.motion.noise for d in data), {}
    for s in sides_moved(data):
        runs = [np.abs(d.speed[d.side(s)]) for d in data]
        # a few stray samples are no strokes, unless all logs are that short
        lows, highs = zip(*map(_speeds, [v for v in runs if v.size >= 5] or [np.concatenate(runs)]))
        low, high = min(lows), max(highs)
        span = float(np.sqrt(max((high - low) ** 2 - (2.563 * noise) ** 2, 0.0)))
        out[s] = 0.5 * (low + high - span), 0.5 * (low + high + span)
    return out


def _speeds(speed: FloatArray) -> tuple[float, float]:
    """Range of the speeds of whole strokes [m/s].

    Weighted by distance, the short slow tails about a reversal weigh little and a fast
    stroke as much as a slow one: the middle 80 % of the distance. Slow strokes that take a
    fifth of the time are not tails, however short they are.
    """
    v = np.sort(speed)
    share = np.cumsum(v)
    low, high = np.searchsorted(share, np.array([0.1, 0.9]) * share[-1])
    return float(v[min(low, v.size // 5)]), float(v[min(high, v.size - 1)])


def _one_speed(ranges: Ranges) -> bool:
    """Return whether every direction has one speed only."""
    return all(high < SECOND_SPEED * low for low, high in ranges.values())
