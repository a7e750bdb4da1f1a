"""Robust linear regression of the force, and what the logs cannot determine.

There are three constants and two branches: ``F_0``, ``c_l`` and ``c_u`` show only as
``F_0 + c_l`` and ``F_0 - c_u``. Unless the preload (or a level) is given with ``--fix``, the
two levels are taken to be equal.

References
----------
.. [1] P. J. Huber, E. Ronchetti, Robust Statistics, 2nd ed., 2009, chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, UsageError
from ...estimation.results import Determined, Refusal, Solved, determine
from ...estimation.uncertainty import Uncertainty, covariance, t_quantile
from ...experiment import FloatArray
from ...family import ParameterSpec, Request
from ...specification import Variant
from .data import Run
from .equation import GAINS, LEVELS
from .options import SpringOptions

_EQUAL = "coulomb"  # stands for both levels where they are taken to be equal
_HUBER = 2.5  # threshold in robust standard deviations
SPIKE = 8.0  # robust standard deviations beyond which a lone sample counts as a spike
_SENSIBLE = 2.0  # half-width of an interval, relative to the value, beyond which it is useless


@dataclass(frozen=True)
class Regression:
    """A robust regression: values and names, residuals per run, covariance.

    ``scale`` is the robust standard deviation of the residuals, ``spike`` the distance beyond
    which a sample has no weight [N].
    """

    names: tuple[str, ...]
    values: dict[str, float]
    residuals: list[FloatArray]
    uncertainty: Uncertainty
    scale: float
    spike: float

    @property
    def spikes(self) -> int:
        """Number of samples without weight."""
        return int(np.sum(np.abs(np.concatenate(self.residuals)) > self.spike))

    @property
    def equal(self) -> bool:
        """Whether both levels are one unknown."""
        return _EQUAL in self.names

    def half_width(self, name: str) -> float:
        """Of the 95 % interval of an unknown."""
        k = self.names.index(name)
        variance = max(float(self.uncertainty.covariance[k, k]), 0.0)
        return t_quantile(0.975, self.uncertainty.degrees) * float(np.sqrt(variance))


def settle_levels(options: SpringOptions, fixed: Mapping[str, float]) -> SpringOptions:
    """Decide whether the levels are equal.

    Raises
    ------
    UsageError
        When free levels were asked for and none of the three constants is given.
    """
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


def regress(
    variant: Variant, runs: Sequence[Run], request: Request[SpringOptions]
) -> Determined[Regression]:
    """Solve, and solve again without what turns out to be undetermined or impossible.

    Raises
    ------
    NotIdentifiedError, LogError
        When a parameter without a neutral value is undetermined, or of the wrong sign.
    """
    specs = {s.name: s for s in variant.parameters}
    equal = request.options.levels == "equal"
    resolution = max(d.experiment.signals["force"].resolution for d in runs) / np.sqrt(12.0)

    def solve(held: Mapping[str, float]) -> Regression:
        free = [n for n in specs if n not in held]
        if equal and not any(n in held for n in LEVELS):
            free = [_EQUAL if n == LEVELS[0] else n for n in free if n != LEVELS[1]]
        return _solve(runs, tuple(free), held, resolution, request.options.spike or 0.0)

    known = _out_of_reach(runs, variant, request.fixed)
    return determine(
        solve, lambda found: _undetermined(found, specs), specs, fixed=request.fixed,
        refusals=known,
    )  # fmt: skip


def by_parameter(
    end: Determined[Regression], variant: Variant, fixed: Mapping[str, float]
) -> Solved:
    """The regression by parameters: equal levels are one unknown under two names."""
    found, source = end.solution, {s.name: s.name for s in variant.parameters}
    if found.equal:
        source |= dict.fromkeys(LEVELS, _EQUAL)
    names = tuple(n for n in source if source[n] in found.names)
    rows = [found.names.index(source[n]) for n in names]
    values = {n: found.values[s] for n, s in source.items()}
    matrix, degrees = found.uncertainty.covariance[np.ix_(rows, rows)], found.uncertainty.degrees
    return Solved(values, names, matrix, degrees, fixed, end.refused)


def _column_of(name: str, d: Run) -> FloatArray:
    """Derivative of the force by a parameter, at the kept samples."""
    s = d.direction[d.kept]
    if name in GAINS.values():
        return d.drive[d.kept]
    if name == "stiffness":
        return np.asarray(-d.position[d.kept])
    if name == "preload":
        return np.full(s.size, -1.0)
    if name == "coulomb_loading":
        return np.asarray(-(s > 0.0).astype(float))
    if name == "coulomb_unloading":
        return np.asarray((s < 0.0).astype(float))
    if name == _EQUAL:
        return np.asarray(-np.sign(s))
    return np.asarray(-d.velocity[d.kept])


def _solve(
    runs: Sequence[Run], names: tuple[str, ...], held: Mapping[str, float], minimum: float,
    spike: float,
) -> Regression:  # fmt: skip
    """Huber regression by iterated reweighting [1]_; lone spikes get no weight at all.

    ``minimum`` is the least scale of the residuals, ``spike`` the least distance at which a
    sample loses its weight [N].
    """
    columns = [np.column_stack([_column_of(n, d) for n in names]) for d in runs]
    sides = [
        d.force[d.kept] - sum((v * _column_of(n, d) for n, v in held.items()), np.zeros(1))
        for d in runs
    ]
    a, y = np.vstack(columns), np.concatenate(sides)
    norm = np.linalg.norm(a, axis=0)
    norm[norm == 0.0] = 1.0
    weight, p, scale, limit = np.ones(y.size), np.zeros(len(names)), 0.0, np.inf
    for _ in range(30):
        root = np.sqrt(weight)[:, None]
        now = np.linalg.lstsq(root * a / norm, root[:, 0] * y, rcond=1e-12)[0] / norm
        r = y - a @ now
        scale = max(1.4826 * float(np.median(np.abs(r))), minimum)
        size, limit = np.abs(r), max(SPIKE * scale, spike)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-300))
        weight[size > limit] = 0.0
        done = np.all(np.abs(now - p) <= 1e-10 * (np.abs(now) + scale / norm))
        p = now
        if done:
            break
    lengths = np.cumsum([s.size for s in sides])[:-1]
    root = np.sqrt(weight)
    residuals = y - a @ p
    uncertainty = covariance(
        np.split(root[:, None] * a, lengths), np.split(root * residuals, lengths),
        robust=all(d.experiment.time.size > 0 for d in runs),
    )  # fmt: skip
    values = {**held, **dict(zip(names, p.tolist()))}
    return Regression(names, values, np.split(residuals, lengths), uncertainty, scale, limit)


def _out_of_reach(
    runs: Sequence[Run], variant: Variant, fixed: Mapping[str, float]
) -> list[Refusal]:
    """What cannot be determined at any noise: compare what varies with what is needed."""
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
    if not _speed_matters(speed):
        refused["viscous"] = "the piston hardly moves in any log."
    return [Refusal(name, reason) for name, reason in refused.items()]


def _speed_matters(speed: FloatArray) -> bool:
    """Whether the piston moves at all: 1 mm/s or more, for long enough to count."""
    return bool(speed.size) and float(np.quantile(np.abs(speed), 0.9)) > 1e-3


def _undetermined(found: Regression, specs: Mapping[str, ParameterSpec]) -> list[Refusal]:
    """A parameter whose interval is useless, or that has an impossible value."""
    for name in found.names:
        value, half = found.values[name], found.half_width(name)
        reason = ""
        if not np.isfinite(half):
            reason = "the force does not depend on it anywhere in the logs."
        elif name == "preload":  # zero is a value like any other
            continue
        elif value + half < 0.0 and name in (*GAINS.values(), "stiffness"):
            column = "position" if name == "stiffness" else "force"
            raise LogError(
                f"{name} would be {value:.3g} {specs[name].unit}, and it cannot be negative.",
                expected="Expected a rod that pushes harder with more pressure and with a "
                "shorter spring.",
                remedy=f"Check the sign of the {column}: --scale {column}=-1 reverses it.",
            )
        elif value <= 0.0 or half > _SENSIBLE * abs(value):
            reason = f"its 95 % interval would be {value:.3g} ± {half:.2g}."
        if reason:
            return [Refusal(n, reason) for n in (LEVELS if name == _EQUAL else (name,))]
    return []
