"""One fit: which unknowns the logs determine, their values, and what is refused.

There are three constants and two branches: ``F_0``, ``c_l`` and ``c_u`` show only as
``F_0 + c_l`` and ``F_0 - c_u``. Unless the preload (or a level) is given with ``--fix``, the
two levels are taken to be equal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, Notice, UsageError
from ...estimation.regression import Estimator, Regression, shared_limits
from ...estimation.results import Refusal, Solved, determine
from ...estimation.stribeck import free_names, undetermined
from ...family import ParameterSpec, Request
from ...specification import Variant
from .data import EQUAL, Run, spring_model
from .equation import GAINS, LEVELS
from .options import SpringOptions

_MAX_HALF_WIDTH = (
    2.0  # half-width of an interval, relative to the value, beyond which it is useless
)


@dataclass(frozen=True)
class SpringFit:
    """A finished fit: the regression in its own unknowns, the same by parameters, and warnings."""

    found: Regression
    solved: Solved
    notices: list[Notice]

    @property
    def equal(self) -> bool:
        """Return whether both levels are one unknown."""
        return EQUAL in self.found.free.names


def settle_levels(options: SpringOptions, fixed: Mapping[str, float]) -> SpringOptions:
    """Decide whether the levels are equal; free ones need one of the three constants."""
    known = any(n in fixed for n in ("preload", *LEVELS))
    if options.levels == "free" and not known:
        raise UsageError(
            "--levels=free needs one of the three constants",
            expected="Preload and the two friction levels show only as two branches.",
            remedy="Give --fix preload=N (a spring scale shows it), or leave --levels out.",
        )
    if options.levels == "auto":
        return replace(options, levels="free" if known else "equal")
    return options


def fit_cylinder(
    variant: Variant, runs: Sequence[Run], request: Request[SpringOptions]
) -> SpringFit:
    """Solve, and solve again without what turns out to be undetermined or impossible.

    Raises
    ------
    NotIdentifiedError, LogError
        When a parameter without a neutral value is undetermined, or of the wrong sign.
    """
    fixed, options = request.fixed, request.options
    low = free_names(options.stribeck == "estimate", fixed)
    specs = {s.name: s for s in variant.parameters if not s.optional or s.name in (*low, *fixed)}
    model = spring_model(runs, GAINS[variant.name])

    def solve(held: Mapping[str, float]) -> Regression:
        free = [n for n in specs if n not in held]
        limits = dict(request.bounds)
        if options.levels == "equal" and not any(n in held for n in LEVELS):
            free = [EQUAL if n == LEVELS[0] else n for n in free if n != LEVELS[1]]
            limits[EQUAL] = shared_limits(limits, LEVELS)
        return Estimator(model, free, held, limits, spike=options.spike or 0.0).solve()

    def doubt(found: Regression) -> list[Refusal]:
        return undetermined(
            found.free, model.speed, lambda held: solve(held).free, least=model.least_speed
        ) or _undetermined(found.free, specs)

    end = determine(
        solve, doubt, specs, fixed=fixed, refusals=_out_of_reach(runs, variant, fixed, low)
    )
    found = end.solution
    source = {n: EQUAL if EQUAL in found.free.names and n in LEVELS else n for n in specs}
    bounded = replace(found.free, values=found.values)
    solved = replace(bounded.renamed(source), fixed=fixed, refused=end.refused)
    return SpringFit(found, solved, [*end.notices, *found.estimator.other_shape()])


def _out_of_reach(
    runs: Sequence[Run], variant: Variant, fixed: Mapping[str, float], low: Sequence[str]
) -> list[Refusal]:
    """Refuse what cannot be determined at any noise: compare what varies with what is needed."""
    drive, position, state, speed = (
        np.concatenate([getattr(d, k)[d.kept] for d in runs])
        for k in ("drive", "position", "direction", "velocity")
    )
    refused: dict[str, str] = {}
    if not drive.size or float(np.ptp(drive)) == 0.0:
        refused[GAINS[variant.name]] = f"the {variant.name} never changes."
    if position.size and float(np.ptp(position)) <= 1e-9 + 1e-6 * float(np.abs(position).max()):
        refused["stiffness"] = "all samples are at one position, where it is part of the preload."
    for name, sign, other in zip(LEVELS, (1.0, -1.0), ("unloading", "loading")):
        if not np.any(state == sign):
            refused[name] = f"the logs only hold {other}."
    if any(n in refused for n in LEVELS) and "preload" not in fixed:
        for name in LEVELS:  # a single level cannot be separated from the preload
            refused.setdefault(name, "with one direction it is part of the preload.")
    # 1 mm/s or more, for long enough to count
    if not speed.size or float(np.quantile(np.abs(speed), 0.9)) <= 1e-3:
        refused |= dict.fromkeys(("viscous", *low), "the piston hardly moves in any log.")
    return [Refusal(name, reason) for name, reason in refused.items()]


def _undetermined(found: Solved, specs: Mapping[str, ParameterSpec]) -> list[Refusal]:
    """A parameter whose interval is useless, or that has an impossible value."""
    for name in found.names:
        value, half = found.values[name], found.half_width(name)
        reason = ""
        if not np.isfinite(half):
            reason = "the force does not depend on it anywhere in the logs."
        elif name == "preload":  # zero is a value like any other
            continue
        elif value + half < 0.0 and name in (*GAINS.values(), "stiffness"):
            drive = [role for role, gain in GAINS.items() if gain == name]
            roles = [*drive, "force"] if drive else ["position"]
            options = " or ".join(f"--scale {role}=-1" for role in roles)
            raise LogError(
                f"{name} would be {value:.3g} {specs[name].unit}, and it cannot be negative.",
                expected="Expected a rod that pushes harder with more pressure and with a "
                "shorter spring.",
                remedy=f"Check the sign of {' and '.join(roles)}: {options} reverses it.",
            )
        elif value <= 0.0 or half > _MAX_HALF_WIDTH * abs(value):
            unit = specs[LEVELS[0] if name == EQUAL else name].unit
            reason = f"its 95 % interval would be {value:.3g} ± {half:.2g} {unit}."
            if value + half < 0.0:
                reason = (
                    f"it would be {value:.3g} ± {half:.2g} {unit}, and it cannot be negative: "
                    "force and motion were not read at the same instants, or one has the wrong "
                    "sign. Check their clocks and --scale."
                )
        if reason:
            return [Refusal(n, reason) for n in (LEVELS if name == EQUAL else (name,))]
    return []
