"""One fit: which unknowns the logs determine, their values, and what is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import LogError, Notice, UsageError
from ...estimation.parametric import make_unknowns, refuse
from ...experiment import FloatArray
from ...family import Quantity, Request, Variant
from .options import Options
from .regression import Regression, System
from .samples import SIDES, Data, half_range, sides_moved
from .speeds import SECOND_SPEED, at_speed, describe_speeds, one_speed, speed_ranges, speed_span

LEVELS = ("coulomb_positive", "coulomb_negative")


def _check_signs(data: Sequence[Data], moved: Sequence[str]) -> None:
    """Reject forces that point along the motion as friction never does.

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
        "Give --scale force=-1 if the sensor counts the other way. If the force comes "
        "from one chamber's pressure, the other chamber is missing: give both as --column "
        "pressure=HEADER --area M2 --column pressure_2=HEADER --area-2 M2, without a force."
    )
    if not any("force" in d.experiment for d in data):
        remedy = (
            "pressure has to be that of the chamber that pushes along positive velocity, and "
            "pressure_2 that of the other one, recorded or as levels (--step "
            "pressure_2=FROM:TO@T in Pa). Swap them with their areas, or give --scale "
            "position=-1 (or velocity=-1) if the sensor counts the other way."
        )
    raise LogError(
        f"friction would be negative ({mean:.4g} N): the force left after pressure and inertia "
        "helps the motion",
        where=", ".join(d.experiment.name for d in data),
        expected="Force counts positive along positive velocity and is what drives the motion.",
        remedy=remedy
        + (" If a constant force adds to it, record strokes in both directions." * one_sided),
    )


def _levels_impossible(found: Regression) -> bool:
    """Whether a level about zero is negative beyond its interval."""
    return any(
        found.free_values[n] + found.quantile * found.std_error({n: 1.0}) < 0.0
        for n in LEVELS
        if n in found.names
    )


class Fit:
    """One fit from start to end: which unknowns, their values, and what to say of them."""

    def __init__(
        self, variant: Variant, data: Sequence[Data], request: Request, options: Options
    ) -> None:
        self.data, self.options = list(data), options
        self.specs = {p.name: p for p in variant.parameters}
        self.fixed = {n: float(v) for n, v in request.fixed.items()}
        unknowns = make_unknowns(variant.parameters, tuple(self.specs), {}, request)
        self.limits = {n: (u.low, u.high) for n, u in unknowns.items()}
        self.notices: list[Notice] = []
        self.refused: dict[str, str] = {}
        self.symmetric = options.offset == "estimate"
        self.moved = sides_moved(data)
        self.ranges = speed_ranges(data, self.moved)
        self.noise = max(d.motion.noise for d in data)
        self.found = self._run()

    def _run(self) -> Regression:
        """Solve, refuse what is not determined, and let an offset in where one must be."""
        if not self.symmetric and not self.fixed:
            _check_signs(self.data, self.moved)
        for s in SIDES:
            if s not in self.moved and f"coulomb_{s}" not in self.fixed:
                self._refuse_direction(s)
        if self.symmetric and not self._offset_possible():
            raise UsageError(
                "an offset of the force cannot be estimated here",
                expected="It takes motion in both directions and free Coulomb levels.",
                remedy="Leave --offset out, or record strokes in both directions.",
            )
        if "viscous" not in self.fixed and one_speed(self.ranges, self.noise):
            self._refuse_viscous(describe_speeds(self.ranges) + ".")
            self.data = at_speed(self.data, self.ranges)
        found = self._with_offset(self._solve())
        if self._undetermined(found):
            half = found.quantile * found.std_error({"viscous": 1.0})
            self._refuse_viscous(
                f"its 95 % interval would be {found.free_values['viscous']:.3g} ± {half:.2g} "
                f"N s/m; {describe_speeds(self.ranges)}."
            )
            found = self._with_offset(self._solve())
        if "coulomb_mean" in found.names:
            self._explain_offset(found)
        elif _levels_impossible(found):
            self._explain_negative(found)
        return found

    def _with_offset(self, found: Regression) -> Regression:
        """Solve again with an offset where a level about zero is impossible.

        In all logs together or in a single one: logs whose offsets differ hide them from
        the common fit.
        """
        if self.symmetric or not self._offset_possible():
            return found
        both = [d for d in self.data if all(d.side(s).any() for s in SIDES)]
        alone = (System([d], LEVELS, {}, {}).solve() for d in both if len(self.data) > 1)
        if not _levels_impossible(found) and not any(_levels_impossible(a) for a in alone):
            return found
        self.symmetric = True
        return self._solve()

    def _refuse(self, name: str, reason: str, remedy: str) -> None:
        self.refused[name] = reason
        self.notices.append(refuse(replace(self.specs[name], remedy=remedy), reason))

    def _refuse_direction(self, side: str) -> None:
        """Refuse the level of a direction without motion; the other one's speeds show how."""
        other = next(s for s in SIDES if s != side)
        remedy = f"Record at least one stroke in the {side} direction, at steady speed"
        if other in self.ranges:
            low, high = self.ranges[other]
            remedy += f": at {low:.3g} to {high:.3g} m/s, as in the {other} direction"
        self._refuse(
            f"coulomb_{side}",
            f"nothing moves in the {side} direction. An offset of the force, if there is one, "
            f"counts as friction of the {other} direction until it does.",
            remedy + ".",
        )

    def _refuse_viscous(self, reason: str) -> None:
        wanted = " or ".join(
            f"at {SECOND_SPEED * high:.2g} m/s or faster, or {low / SECOND_SPEED:.2g} m/s or "
            f"slower, in the {s} direction"
            for s, (low, high) in self.ranges.items()
        )
        self._refuse(
            "viscous",
            reason + " The Coulomb levels hold all friction at that speed.",
            f"Add one stroke, or one log, at a speed {SECOND_SPEED:g} times another: {wanted}.",
        )

    def _offset_possible(self) -> bool:
        free = all(n not in self.fixed and n not in self.refused for n in LEVELS)
        return free and self.options.offset != "none"

    def _undetermined(self, found: Regression) -> bool:
        """Whether viscous friction could be half of all friction, or none of it.

        The interval times the span of speeds is the force that is in doubt.
        """
        if "viscous" not in found.names:
            return False
        span = max(speed_span(low, high, self.noise) for low, high in self.ranges.values())
        half = found.quantile * found.std_error({"viscous": 1.0})
        return not half * span <= 0.5 * abs(half_range(self.data))

    def _offsets(self) -> list[str]:
        """One offset per log where every log shows both directions, else one for all."""
        if all(d.side(s).any() for d in self.data for s in SIDES):
            return [f"offset[{i}]" for i in range(len(self.data))]
        return ["offset"]

    def _solve(self) -> Regression:
        levels = ["coulomb_mean", *self._offsets()] if self.symmetric else list(LEVELS)
        names = [n for n in (*levels, "viscous") if n not in self.fixed and n not in self.refused]
        limits = dict(self.limits)
        low, high = zip(*(self.limits[n] for n in LEVELS))
        limits["coulomb_mean"] = (max(low), min(high))
        if not names:
            raise UsageError(
                "nothing is left to estimate: every parameter is fixed or out of reach",
                remedy="Leave out one --fix.",
            )
        return System(self.data, names, self.fixed, limits).solve()

    def _explain_offset(self, found: Regression) -> None:
        if self.options.offset == "estimate":
            return
        message = (
            f"the force has an offset of {self.offset(found):.4g} N (another chamber, gravity, a "
            "preload or the sensor's zero), so a level about zero would be negative. The levels "
            "are taken about the offset and are equal: their difference cannot be told from it. "
            "Remove the offset with the other chamber's pressure, or give --offset none."
        )
        self.notices.append(Notice("force-offset", message))

    def _explain_negative(self, found: Regression) -> None:
        if self.options.offset == "none":
            raise LogError(
                "a Coulomb level would be negative: the force has an offset",
                where=", ".join(d.experiment.name for d in self.data),
                remedy="Leave out --offset none to estimate it, or take it off the force.",
            )
        message = (
            "a Coulomb level would be negative and was held at zero: the force has an offset, or "
            "friction bends with speed. Record strokes in both directions at several speeds."
        )
        self.notices.append(Notice("negative-friction", message))

    def offset(self, found: Regression) -> float:
        """Mean offset of the force [N]; zero where none is estimated."""
        values = [v for n, v in found.values.items() if n.startswith("offset")]
        return float(np.mean(values)) if values else 0.0

    def log_offset(self, index: int) -> float:
        """Offset of one log's force [N]."""
        values = self.found.values
        return values.get(f"offset[{index}]", values.get("offset", 0.0))

    def values(self) -> dict[str, float]:
        """All parameters of the file, by name."""
        out = {n: self.fixed.get(n, self.found.values.get(n, 0.0)) for n in self.specs}
        if self.symmetric:
            out.update(dict.fromkeys(LEVELS, self.found.values["coulomb_mean"]))
        return out

    def covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names and covariance of what was estimated."""
        order = tuple(n for n in self.specs if n not in self.fixed and n not in self.refused)
        source = ["coulomb_mean" if self.symmetric and n in LEVELS else n for n in order]
        rows = [self.found.names.index(n) for n in source]
        return order, self.found.uncertainty.covariance[np.ix_(rows, rows)]

    def quantities(self) -> dict[str, Quantity]:
        """Parameters with standard errors and intervals, cut at the physical range."""
        order, matrix = self.covariance()
        out = {}
        for name, value in self.values().items():
            unit = self.specs[name].unit
            if name not in order:
                status = "fixed" if name in self.fixed else "not_identified"
                out[name] = Quantity(value, unit, status)  # type: ignore[arg-type]
                continue
            k = order.index(name)
            se = float(np.sqrt(matrix[k, k]))
            low, high = value - self.found.quantile * se, value + self.found.quantile * se
            ci = [max(low, self.specs[name].minimum), high]
            out[name] = Quantity(value, unit, "estimated", se, ci, "wald")
        return out

    def derived(self) -> dict[str, Quantity]:
        """Mean and half difference of the levels, and the offset of the force."""
        values, out = self.values(), {}
        order, matrix = self.covariance()
        if not any(n in self.refused for n in LEVELS):
            for name, sign in (("coulomb_mean", 1.0), ("coulomb_offset", -1.0)):
                weights = {LEVELS[0]: 0.5, LEVELS[1]: 0.5 * sign}
                w = np.array([weights.get(n, 0.0) for n in order])
                se = float(np.sqrt(max(float(w @ matrix @ w), 0.0)))
                value = sum(weights[n] * values[n] for n in LEVELS)
                out[name] = Quantity(value, "N", "derived", se)
        names = [n for n in self.found.names if n.startswith("offset")]
        if names:
            se = self.found.std_error(dict.fromkeys(names, 1.0 / len(names)))
            out["force_offset"] = Quantity(self.offset(self.found), "N", "derived", se)
        return out
