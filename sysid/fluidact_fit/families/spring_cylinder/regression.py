"""Robust linear regression of the force, and what the logs cannot determine.

There are three constants and two branches: ``F_0``, ``c_l`` and ``c_u`` show only as
``F_0 + c_l`` and ``F_0 - c_u``. Unless the preload (or a level) is given with ``--fix``, the
two levels are taken to be equal. The Stribeck speed, in which the force is not linear, is searched
for on a grid and then by Gauss-Newton steps.

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
from ...estimation.stribeck import (
    STRIBECK,
    RiseSearch,
    free_names,
    shape_notice,
    undetermined,
)
from ...estimation.uncertainty import Uncertainty, covariance, enlarge, score_covariance
from ...estimation.weak_instruments import reachable_variances
from ...experiment import FloatArray
from ...family import ParameterSpec, Request
from ...specification import Variant
from .columns import (
    EQUAL,
    Rise,
    disturbances,
    fitted_velocities,
    instrumented,
    make_columns,
    speed_noise,
    speed_range,
)
from .data import Run
from .equation import GAINS, LEVELS
from .options import SpringOptions

_HUBER = 2.5, 4.0  # threshold in robust standard deviations: of even and of skew errors
_BIASED = 0.3  # standard errors of bias by noise of a column from which instruments are used
SPIKE = 8.0  # robust standard deviations beyond which a lone sample counts as a spike
_ENOUGH = 4000  # samples on which the Stribeck speed is searched for
_STEPS = 12  # from one Stribeck speed to the next
_SETTLED = 1e-3  # relative change of level and speed at which they end
_SENSIBLE = 2.0  # half-width of an interval, relative to the value, beyond which it is useless


@dataclass(frozen=True)
class Regression:
    """A robust regression of a system: values, what was held included, and residuals per run.

    ``scale`` is the robust standard deviation of the residuals, ``spike`` the distance beyond
    which a sample has no weight [N], ``order`` that of their autoregression.
    """

    system: _System
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
        return EQUAL in self.solved.names

    def other_shape(self) -> Notice | None:
        """Say that another law of the rise fits better with as many unknowns, where one does."""
        if not set(STRIBECK) <= set(self.solved.names):
            return None
        return shape_notice(self.system.search)


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
    fixed = request.fixed
    low = free_names(request.options.stribeck == "estimate", fixed)
    specs = {s.name: s for s in variant.parameters if not s.optional or s.name in (*low, *fixed)}
    resolution = max(d.experiment.signals["force"].resolution for d in runs) / np.sqrt(12.0)

    def solve(held: Mapping[str, float]) -> Regression:
        free = [n for n in specs if n not in held]
        if request.options.levels == "equal" and not any(n in held for n in LEVELS):
            free = [EQUAL if n == LEVELS[0] else n for n in free if n != LEVELS[1]]
        least = resolution, request.options.spike or 0.0
        return _System(runs, tuple(free), held, least).solve()

    end = determine(
        solve,
        lambda found: (
            undetermined(
                found.solved, fitted_velocities(runs), lambda held: solve(held).solved,
                least=speed_noise(runs),
            )
            or _undetermined(found.solved, specs)
        ),
        specs, fixed=fixed, refusals=_out_of_reach(runs, variant, fixed, low),
    )  # fmt: skip
    found = end.solution
    source = {n: EQUAL if found.equal and n in LEVELS else n for n in specs}
    solved = replace(found.solved.renamed(source), fixed=fixed, refused=end.refused)
    return found, solved, end.notices


@dataclass(frozen=True)
class _System:
    """What stays the same from attempt to attempt: runs, unknowns, values held.

    ``least`` is the smallest scale of the residuals, and the smallest distance at which a
    sample loses its weight [N].
    """

    runs: Sequence[Run]
    names: tuple[str, ...]
    held: Mapping[str, float]
    least: tuple[float, float]

    def equations(
        self, rise: Rise, names: Sequence[str], instead: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Columns of some unknowns ``(n, p)`` and what they have to explain ``(n,)`` [N].

        ``instead``: of the instruments in place of noisy columns.
        """
        held = {n: v for n, v in self.held.items() if n != "stribeck_speed"}
        runs = [instrumented(d) for d in self.runs] if instead else self.runs
        every = [make_columns([*names, *held], d, rise) for d in runs]
        known = np.array([0.0] * len(names) + list(held.values()))
        a = np.vstack(every)
        force = np.concatenate([d.force[d.kept] for d in runs])
        return a[:, : len(names)], force - a @ known

    @property
    def _blurred(self) -> bool:
        """Whether noise of the speed is in a Stribeck term."""
        return "stribeck" in self.names and bool(speed_noise(self.runs))

    @property
    def _robust(self) -> tuple[float, float, float]:
        """Threshold of Huber's weights, least scale and least distance of a spike [N].

        Through the curve of a Stribeck term noise of the speed has a skew error, of mean zero:
        weights that cut the longer tail would shift what is estimated.
        """
        return (_HUBER[1 if self._blurred else 0], *self.least)

    def solve(self) -> Regression:
        """Solve, about one Stribeck speed after the other where that is unknown."""
        rise = self._start()
        found = self._about(rise)
        if "stribeck_speed" not in self.names:
            return found
        low, high = speed_range(self.runs)
        for _ in range(_STEPS):
            level, speed = (found.solved.values[n] for n in STRIBECK)
            # no further at once than where the term is still the same one
            speed = float(np.clip(speed, 0.6 * rise.speed, 1.6 * rise.speed))
            speed = float(np.clip(speed, 0.5 * low, 2.0 * high))
            # about too high a level the speed hardly moves, and would seem to be known well
            off = abs(speed - rise.speed) / speed, abs(level - rise.level) / max(abs(level), 1e-300)
            if max(off) < _SETTLED:
                break
            rise = Rise(level, speed)
            found = self._about(rise)
        return found

    def search(self, exponent: float = 2.0) -> RiseSearch:
        """The Stribeck speed over the range of the motion, on part of the samples."""
        names = [n for n in self.names if n != "stribeck_speed"]
        samples = sum(int(d.kept.sum()) for d in self.runs)
        every = -(-samples // _ENOUGH)
        thin = slice(None, None, every)

        def solve(speed: float) -> tuple[float, float]:
            """Squared mean size of the residuals [N2], which spikes hardly change, and level."""
            a, y = (x[thin] for x in self.equations(Rise(0.0, speed, exponent), names))
            best = _reweighted(a, a, y, self._robust)
            level = {**self.held, **dict(zip(names, best.values.tolist()))}["stribeck"]
            return float(np.mean(np.abs(y - a @ best.values))) ** 2, level

        return RiseSearch(speed_range(self.runs), -(-samples // every), solve)

    def _start(self) -> Rise:
        if "stribeck_speed" in self.names:
            return Rise(*self.search().rise[1:])
        return Rise(*(self.held.get(n, 0.0) for n in STRIBECK))

    def _about(self, rise: Rise) -> Regression:
        """Least squares, or with instruments where noise of a column would bias it."""
        a, y = self.equations(rise, self.names)
        cuts = np.cumsum([int(d.kept.sum()) for d in self.runs])[:-1]
        timed = all(d.experiment.time.size > 0 for d in self.runs)

        def spread(of: _Robust) -> Uncertainty:
            root, residual = np.sqrt(of.weight), y - a @ of.values
            rows = np.split(root[:, None] * of.columns, cuts)
            rests = np.split(root * residual, cuts)
            return self._spread(rows, rests, timed)

        best = _reweighted(a, a, y, self._robust)
        found = spread(best)
        errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
        biased = bool(np.any(np.abs(self._bias(rise, a, best)) > _BIASED * errors))
        if biased:
            best = _reweighted(
                a, self.equations(rise, self.names, instead=True)[0], y, self._robust
            )
            found = _reaching(spread(best), best, a, y)
        values = dict(zip(self.names, best.values.tolist()))
        if "stribeck_speed" in values:
            values["stribeck_speed"] += rise.speed
        solved = Solved(
            {**self.held, **values}, self.names, found.covariance, found.degrees,
            independent=found.independent,
        )  # fmt: skip
        residuals = np.split(y - a @ best.values, cuts)
        return Regression(self, solved, residuals, best.scale, best.limit, found.order, biased)

    def _spread(
        self, rows: Sequence[FloatArray], rests: Sequence[FloatArray], timed: bool
    ) -> Uncertainty:
        """Covariance; with a noisy speed in a Stribeck term no less than that from the scores.

        The noise of the speed is largest in the force where that term is steepest, and there
        its parameters are told: the residual has not the same variance everywhere.
        """
        found = covariance(rows, rests, robust=timed)
        if not self._blurred:
            return found
        scores = score_covariance(rows, rests, [[slice(0, r.size)] for r in rests])
        return replace(found, covariance=enlarge(found.covariance, np.diag(scores.covariance)))

    def _bias(self, rise: Rise, a: FloatArray, best: _Robust) -> FloatArray:
        """What noise of the columns does to least squares: it adds to their products, ``(p,)``."""
        normal = (best.weight[:, None] * a).T @ a
        added = sum(
            c.T @ (best.weight * (c @ best.values))
            for c in disturbances(self.names, self.runs, rise)
        )
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        scaled = normal / np.outer(size, size)
        return np.asarray(np.linalg.lstsq(scaled, added / size, rcond=1e-12)[0] / size)


@dataclass(frozen=True)
class _Robust:
    """Values, the weight of every sample, scale and limit of the residuals, columns projected."""

    values: FloatArray
    weight: FloatArray
    scale: float
    limit: float
    columns: FloatArray


def _reaching(found: Uncertainty, best: _Robust, a: FloatArray, y: FloatArray) -> Uncertainty:
    """No less than what instruments that say little leave open."""
    root = np.sqrt(best.weight)
    variances = reachable_variances(
        root[:, None] * a, root[:, None] * best.columns, root * (y - a @ best.values),
        np.diag(found.covariance), found.degrees,
    )  # fmt: skip
    return replace(found, covariance=enlarge(found.covariance, variances))


def _reweighted(
    a: FloatArray, z: FloatArray, y: FloatArray, robust: tuple[float, float, float]
) -> _Robust:
    """Huber regression by iterated reweighting [1]_; lone spikes get no weight at all.

    ``z`` are the instruments of the columns ``a``, both ``(n, p)``: with their own columns as
    instruments this is least squares, else two-stage least squares.
    """
    threshold, least, spike = robust
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
        scale = max(1.4826 * float(np.median(size)), least)
        limit = max(SPIKE * scale, spike)
        weight = np.minimum(1.0, threshold * scale / np.maximum(size, 1e-300))
        weight[size > limit] = 0.0
        done = np.all(np.abs(now - p) <= 1e-10 * (np.abs(now) + scale / norm))
        p = now
        if done:
            break
    return _Robust(p, weight, scale, limit, columns)


def _out_of_reach(
    runs: Sequence[Run], variant: Variant, fixed: Mapping[str, float], low: Sequence[str]
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
            column = "position" if name == "stiffness" else "force"
            raise LogError(
                f"{name} would be {value:.3g} {specs[name].unit}, and it cannot be negative.",
                expected="Expected a rod that pushes harder with more pressure and with a "
                "shorter spring.",
                remedy=f"Check the sign of the {column}: --scale {column}=-1 reverses it.",
            )
        elif value <= 0.0 or half > _SENSIBLE * abs(value):
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
