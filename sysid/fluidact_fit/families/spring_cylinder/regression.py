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

from ...errors import LogError, Notice, UsageError
from ...estimation.results import Refusal, Solved, determine
from ...estimation.uncertainty import Uncertainty, covariance
from ...experiment import FloatArray
from ...family import ParameterSpec, Request
from ...specification import Variant
from .data import Run
from .equation import GAINS, LEVELS
from .options import SpringOptions

_EQUAL = "coulomb"  # stands for both levels where they are taken to be equal
_HUBER = 2.5  # threshold in robust standard deviations
_CARRIER = {"stiffness": "position", "viscous": "velocity"} | dict.fromkeys(GAINS.values(), "drive")
_BIASED = 0.3  # standard errors of bias by noise of a column from which instruments are used
SPIKE = 8.0  # robust standard deviations beyond which a lone sample counts as a spike
_SENSIBLE = 2.0  # half-width of an interval, relative to the value, beyond which it is useless


@dataclass(frozen=True)
class Regression:
    """A robust regression: what it solved, what was held included, and residuals per run.

    ``scale`` is the robust standard deviation of the residuals, ``spike`` the distance beyond
    which a sample has no weight [N], ``order`` that of their autoregression.
    """

    solved: Solved
    residuals: list[FloatArray]
    scale: float
    spike: float
    order: int
    instrumented: bool

    @property
    def spikes(self) -> int:
        """Number of samples without weight."""
        return int(np.sum(np.abs(np.concatenate(self.residuals)) > self.spike))

    @property
    def equal(self) -> bool:
        """Whether both levels are one unknown."""
        return _EQUAL in self.solved.names


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


def regress(
    variant: Variant, runs: Sequence[Run], request: Request[SpringOptions]
) -> tuple[Regression, Solved, list[Notice]]:
    """Solve, and solve again without what turns out to be undetermined or impossible.

    Returns
    -------
    The last regression, the same by parameters (equal levels are one unknown under two names),
    and the warnings.

    Raises
    ------
    NotIdentifiedError, LogError
        When a parameter without a neutral value is undetermined, or of the wrong sign.
    """
    specs, fixed = {s.name: s for s in variant.parameters}, request.fixed
    resolution = max(d.experiment.signals["force"].resolution for d in runs) / np.sqrt(12.0)

    def solve(held: Mapping[str, float]) -> Regression:
        free = [n for n in specs if n not in held]
        if request.options.levels == "equal" and not any(n in held for n in LEVELS):
            free = [_EQUAL if n == LEVELS[0] else n for n in free if n != LEVELS[1]]
        return _solve(runs, free, held, (resolution, request.options.spike or 0.0))

    end = determine(
        solve, lambda found: _undetermined(found.solved, specs), specs, fixed=fixed,
        refusals=_out_of_reach(runs, variant, fixed),
    )  # fmt: skip
    found = end.solution
    source = {n: _EQUAL if found.equal and n in LEVELS else n for n in specs}
    solved = replace(found.solved.renamed(source), fixed=fixed, refused=end.refused)
    return found, solved, end.notices


def _columns(names: Sequence[str], d: Run) -> FloatArray:
    """Derivative of the force by parameters at the kept samples, shape ``(kept, p)``."""
    s = d.direction[d.kept]
    known = {
        "stiffness": -d.position[d.kept],
        "preload": np.full(s.size, -1.0),
        "coulomb_loading": np.where(s > 0.0, -1.0, 0.0),
        "coulomb_unloading": np.where(s < 0.0, 1.0, 0.0),
        _EQUAL: -np.sign(s),
        "viscous": -d.velocity[d.kept],
        **dict.fromkeys(GAINS.values(), d.drive[d.kept]),
    }
    return np.stack([known[n] for n in names], axis=1)


def _solve(
    runs: Sequence[Run], names: Sequence[str], held: Mapping[str, float],
    least: tuple[float, float],
) -> Regression:  # fmt: skip
    """Least squares, or with instruments where noise of a column would bias it.

    ``least`` is the smallest scale of the residuals, and the smallest distance at which a
    sample loses its weight [N].
    """
    every = [_columns([*names, *held], d) for d in runs]
    known = np.array([0.0] * len(names) + list(held.values()))
    a = np.vstack(every)[:, : len(names)]
    y = np.concatenate([d.force[d.kept] - c @ known for d, c in zip(runs, every)])
    cuts = np.cumsum([c.shape[0] for c in every])[:-1]
    timed = all(d.experiment.time.size > 0 for d in runs)

    def spread(of: _Robust) -> Uncertainty:
        root, residual = np.sqrt(of.weight), y - a @ of.values
        rows = np.split(root[:, None] * of.columns, cuts)
        return covariance(rows, np.split(root * residual, cuts), robust=timed)

    best = _reweighted(a, a, y, least)
    found = spread(best)
    z, variance = _instruments(runs, names, a)
    # what noise of the columns does to least squares: it adds to their squares
    normal, added = (best.weight[:, None] * a).T @ a, variance.T @ best.weight
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    bias = np.linalg.lstsq(scaled, added * best.values / size, rcond=1e-12)[0] / size
    errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    biased = bool(np.any(np.abs(bias) > _BIASED * errors))
    if biased:
        best = _reweighted(a, z, y, least)
        found = spread(best)
    values = {**held, **dict(zip(names, best.values.tolist()))}
    solved = Solved(values, tuple(names), found.covariance, found.degrees)
    residuals = np.split(y - a @ best.values, cuts)
    return Regression(solved, residuals, best.scale, best.limit, found.order, biased)


@dataclass(frozen=True)
class _Robust:
    """Values, the weight of every sample, scale and limit of the residuals, columns projected."""

    values: FloatArray
    weight: FloatArray
    scale: float
    limit: float
    columns: FloatArray


def _reweighted(a: FloatArray, z: FloatArray, y: FloatArray, least: tuple[float, float]) -> _Robust:
    """Huber regression by iterated reweighting [1]_; lone spikes get no weight at all.

    ``z`` are the instruments of the columns ``a``, both ``(n, p)``: with their own columns as
    instruments this is least squares, else two-stage least squares.
    """
    norm = np.linalg.norm(a, axis=0)
    norm[norm == 0.0] = 1.0
    size_z = np.linalg.norm(z, axis=0)
    size_z[size_z == 0.0] = 1.0
    weight, p, scale, limit, columns = np.ones(y.size), np.zeros(a.shape[1]), 0.0, np.inf, a
    for _ in range(30):
        root = np.sqrt(weight)[:, None]
        if z is not a:
            first = np.linalg.lstsq(root * z / size_z, root * a, rcond=1e-12)[0]
            columns = z / size_z @ first
        now = np.linalg.lstsq(root * columns / norm, root[:, 0] * y, rcond=1e-12)[0] / norm
        size = np.abs(y - a @ now)
        scale = max(1.4826 * float(np.median(size)), least[0])
        limit = max(SPIKE * scale, least[1])
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-300))
        weight[size > limit] = 0.0
        done = np.all(np.abs(now - p) <= 1e-10 * (np.abs(now) + scale / norm))
        p = now
        if done:
            break
    return _Robust(p, weight, scale, limit, columns)


def _instruments(
    runs: Sequence[Run], names: Sequence[str], a: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Instruments of the columns ``a``, and the variance of their noise, both ``(n, p)``."""
    z, variance = a.copy(), np.zeros_like(a)
    begin = 0
    for d in runs:
        rows = slice(begin, begin := begin + int(d.kept.sum()))
        for k, name in enumerate(names):
            if (found := d.instruments.get(_CARRIER.get(name, ""))) is not None:
                z[rows, k] = found.values[d.kept]
                variance[rows, k] = found.noise**2
    return z, variance


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
    # 1 mm/s or more, for long enough to count
    if not speed.size or float(np.quantile(np.abs(speed), 0.9)) <= 1e-3:
        refused["viscous"] = "the piston hardly moves in any log."
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
            column = "position" if name == "stiffness" else "force"
            raise LogError(
                f"{name} would be {value:.3g} {specs[name].unit}, and it cannot be negative.",
                expected="Expected a rod that pushes harder with more pressure and with a "
                "shorter spring.",
                remedy=f"Check the sign of the {column}: --scale {column}=-1 reverses it.",
            )
        elif value <= 0.0 or half > _SENSIBLE * abs(value):
            unit = specs[LEVELS[0] if name == _EQUAL else name].unit
            reason = f"its 95 % interval would be {value:.3g} ± {half:.2g} {unit}."
            if value + half < 0.0:
                reason = (
                    f"it would be {value:.3g} ± {half:.2g} {unit}, and it cannot be negative: "
                    "force and motion were not read at the same instants, or one has the wrong "
                    "sign. Check their clocks and --scale."
                )
        if reason:
            return [Refusal(n, reason) for n in (LEVELS if name == _EQUAL else (name,))]
    return []
