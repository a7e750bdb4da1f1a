"""Friction of a cylinder: two Coulomb levels and viscous friction.

    F_f = F_c+ [v > 0] - F_c- [v < 0] + b v
    F_f = F - A p - m a

``F`` is what drives the motion, positive along positive velocity; the pressure force
``A p`` and the inertia ``m a`` are taken off when the area and the mass are given. All
levels are magnitudes. The regression sees moving samples only [1]_: near standstill
friction is a matter of presliding and stiction, and a smoothed sign would bias the levels.

Without a second speed in at least one direction, ``b v`` cannot be told from the levels:
``viscous`` is then written as not identified and the levels hold all friction.

References
----------
.. [1] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
   System Identification Benchmarks, 2019: regression on filtered velocity with slow
   samples left out.
.. [2] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 17 to 19: friction levels by direction with a velocity tolerance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, NotIdentifiedError, UsageError
from ..estimation.parametric import check_request, make_unknowns, refuse, scalars
from ..estimation.uncertainty import Uncertainty, covariance, t_quantile
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Block,
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    StaticView,
    Value,
    Variant,
)
from ..signals import smooth

Mask = npt.NDArray[np.bool_]

_SIDES = ("positive", "negative")
_LEVELS = ("coulomb_positive", "coulomb_negative")
_DEGREE = 2
_HALF_WIDTHS = (2, 4, 8, 16, 32, 64, 128)
_QUIET = 0.02  # noise of the filtered speed, as a share of the highest, that is small enough
_SLOW = 0.05  # share of the highest speed below which friction is not that of motion
_SECOND_SPEED = 1.5  # ratio of two speeds that are clearly different
_SMALL = 0.05  # share of the friction that inertia may have before it matters


def friction_force(
    velocity: FloatArray, coulomb_positive: float, coulomb_negative: float, viscous: float
) -> FloatArray:
    """Friction that has to be overcome to move at a velocity.

    Parameters
    ----------
    velocity
        Shape ``(n,)`` [m/s].
    coulomb_positive, coulomb_negative
        Magnitudes of the kinetic levels [N].
    viscous
        Viscous friction [N s/m].

    Returns
    -------
    FloatArray
        Shape ``(n,)`` [N]; zero at rest, where friction takes any value between the levels.
    """
    v = np.asarray(velocity, dtype=float)
    level = np.where(v > 0.0, coulomb_positive, coulomb_negative)
    return np.asarray(np.sign(v) * level + viscous * v)


class FrictionBlock(Block):
    """Friction force over velocity, for feed-forward compensation.

    Parameters
    ----------
    parameters
        ``coulomb_positive``, ``coulomb_negative`` [N] and ``viscous`` [N s/m].
    width
        Speed over which the sign is rounded as ``tanh(v / width)`` [m/s]; 0: not at all. A
        controller that compensates all friction at the exact sign chatters about rest.
    """

    family = "cylinder-friction"

    def __init__(self, parameters: Mapping[str, Value], width: float = 0.0) -> None:
        self.parameters = dict(parameters)
        self.width = width

    def __call__(self, velocity: npt.ArrayLike, width: float | None = None) -> FloatArray:
        """Return the friction force, shape of ``velocity`` [N]; ``velocity`` in m/s."""
        p = scalars(self.parameters)
        v = np.asarray(velocity, dtype=float)
        width = self.width if width is None else width
        sharp = friction_force(v, p["coulomb_positive"], p["coulomb_negative"], 0.0)
        if width > 0.0:
            sharp = np.abs(sharp) * np.tanh(v / width)
        return np.asarray(sharp + p["viscous"] * v)


@dataclass(frozen=True)
class _Options:
    """The family's options."""

    area: float | None
    mass: float | None
    half_width: float | None
    deadband: float | None
    offset: str

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> _Options:
        return cls(
            given.get("area"),
            given.get("mass"),
            given.get("filter"),
            given.get("deadband"),
            given.get("offset") or "auto",
        )


@dataclass(frozen=True)
class _Motion:
    """Filtered motion of one log.

    ``inside`` marks the samples whose filter window lies within the record, ``noise`` is
    the standard deviation of the filtered velocity [m/s], ``half`` the half-width of the
    filter in samples (0: not filtered) and ``fast`` the highest speed but for 2 % [m/s].
    """

    velocity: FloatArray
    acceleration: FloatArray | None
    inside: Mask
    noise: float
    half: int

    @property
    def fast(self) -> float:
        return float(np.quantile(np.abs(self.velocity[self.inside]), 0.98))


@dataclass(frozen=True)
class _Data:
    """One log, ready for the regression.

    ``known`` is the part of the force that is no friction, ``friction`` the rest, both of
    shape ``(n,)`` [N]; ``kept`` marks the samples that are fitted.
    """

    experiment: Experiment
    motion: _Motion
    known: FloatArray
    friction: FloatArray
    kept: Mask

    @property
    def speed(self) -> FloatArray:
        """Velocities of the kept samples [m/s]."""
        return self.motion.velocity[self.kept]

    def side(self, side: str) -> Mask:
        """Which of the kept samples move in a direction."""
        return self.speed > 0.0 if side == "positive" else self.speed < 0.0


@dataclass(frozen=True)
class _Regression:
    """A solved regression: values by name and residuals per log."""

    values: dict[str, float]
    names: tuple[str, ...]
    residuals: list[FloatArray]
    uncertainty: Uncertainty
    free_values: dict[str, float] = field(default_factory=dict)

    @property
    def quantile(self) -> float:
        return t_quantile(0.975, self.uncertainty.degrees)

    def std_error(self, weights: Mapping[str, float]) -> float:
        """Standard error of a weighted sum of unknowns."""
        w = np.array([weights.get(n, 0.0) for n in self.names])
        return float(np.sqrt(max(float(w @ self.uncertainty.covariance @ w), 0.0)))


def _local_polynomial(
    time: FloatArray, values: FloatArray, step: float, half: int
) -> tuple[FloatArray, Mask]:
    """Local quadratics on an uneven time base, by value, slope and curvature.

    Returns
    -------
    rows : (3, n)
        Value, first and second derivative.
    inside : (n,)
        False near the ends and where the window bridges a gap.
    """
    n, width = values.size, 2 * half + 1
    rows, inside = np.zeros((3, n)), np.zeros(n, dtype=bool)
    if n < width:
        return rows, inside
    times = np.lib.stride_tricks.sliding_window_view(time, width)
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    for begin in range(0, times.shape[0], 4096):
        part = slice(begin, min(begin + 4096, times.shape[0]))
        at = slice(part.start + half, part.stop + half)
        s = (times[part] - time[at, None]) / (half * step)
        middle = values[at]
        powers = np.stack([np.ones_like(s), s, s * s])
        moments = np.einsum("ikj,lkj->kil", powers, powers)
        right = np.einsum("ikj,kj->ki", powers, windows[part] - middle[:, None])
        good = (s[:, -1] - s[:, 0] < 3.0) & (s[:, -1] > 0.5) & (s[:, 0] < -0.5)
        moments[~good] = np.eye(3)
        found = np.linalg.solve(moments, right[:, :, None])[:, :, 0]
        rows[:, at] = found.T / np.array([1.0, half * step, 0.5 * (half * step) ** 2])[:, None]
        rows[0, at] += middle
        inside[at] = good
    rows[:, :half], rows[:, n - half :] = rows[:, half, None], rows[:, n - half - 1, None]
    return rows, inside


def _sensor_noise(values: FloatArray, resolution: float) -> float:
    """Noise that no motion explains: third differences, or the resolution if that is more.

    A handful of exact levels, as in a table of plateaus, is no resolution.
    """
    if np.ptp(values) < 20.0 * resolution:
        resolution = 0.0
    if values.size < 8:
        return resolution / np.sqrt(12.0)
    third = np.abs(np.diff(values, 3))
    return max(1.4826 * float(np.median(third)) / np.sqrt(20.0), resolution / np.sqrt(12.0))


def _filter(experiment: Experiment, role: str, half: int) -> _Motion:
    """Velocity and acceleration by a zero-phase quadratic over ``2 half + 1`` samples."""
    signal = experiment.signals[role]
    y, step = signal.values, experiment.sample_time
    noise = _sensor_noise(y, signal.resolution)
    if not experiment.time.size:
        return _Motion(y, None, np.ones(y.size, dtype=bool), noise, 0)
    half = max(1, min(half, (y.size - 1) // 2))
    if experiment.uniform:
        s = smooth(y, step, half, _DEGREE)
        rows, inside = np.stack([s.value, s.rate, s.curvature]), s.inside
    else:
        rows, inside = _local_polynomial(experiment.time, y, step, half)
    if not inside.any():
        raise LogError(
            f"no stretch of {2 * half + 1} samples without a gap is left to differentiate",
            where=experiment.name,
            remedy="Give a shorter --filter, or a longer log.",
        )
    order = 1 if role == "position" else 0
    offsets = np.arange(-half, half + 1)
    kernel = np.linalg.pinv(np.vander(offsets, _DEGREE + 1, increasing=True))[order]
    gain = float(np.linalg.norm(kernel)) / step**order
    return _Motion(rows[order], rows[order + 1], inside, noise * gain, half)


def _choose_half_width(experiment: Experiment, role: str) -> float:
    """Shortest half-width whose velocity is quiet enough [s]."""
    half = 1
    for half in _HALF_WIDTHS:
        motion = _filter(experiment, role, half)
        if motion.noise <= _QUIET * motion.fast or 16 * half >= experiment.samples:
            break
    return half * experiment.sample_time


def _motions(
    experiments: Sequence[Experiment], role: str, half_width: float | None
) -> tuple[list[_Motion], float]:
    """Motion of every log through one filter, and its half-width [s]."""
    timed = [e for e in experiments if e.time.size]
    if half_width is None:
        half_width = max((_choose_half_width(e, role) for e in timed), default=0.0)
    out = []
    for e in experiments:
        half = round(half_width / e.sample_time) if e.time.size else 0
        out.append(_filter(e, role, half))
    return out, half_width


def _choose_deadband(motions: Sequence[_Motion]) -> float:
    """Speed below which a sample may be at rest: noise, or a share of the speed [m/s].

    The slowest log that moves at all sets the share, so that a fast one does not hide it.
    """
    floor = 4.0 * max(m.noise for m in motions)
    moving = [m.fast for m in motions if m.fast > floor]
    return float(max(floor, _SLOW * min(moving, default=0.0)))


def _steady(motion: _Motion, deadband: float) -> Mask:
    """Samples that move, and so does their whole filter window in the same direction."""
    v = motion.velocity
    state = np.where(np.abs(v) > deadband, np.sign(v), 0.0)
    changes = np.concatenate(([0], np.cumsum(state[1:] != state[:-1])))
    moving = (state != 0.0) & motion.inside
    h = motion.half
    if h and v.size > 2 * h:
        moving[h : v.size - h] &= changes[2 * h :] == changes[: v.size - 2 * h]
    return np.asarray(moving)


def _known_force(experiment: Experiment, motion: _Motion, options: _Options) -> FloatArray:
    """Pressure force and inertia [N]."""
    out = np.zeros(motion.velocity.size)
    if options.area is not None:
        out += options.area * experiment["pressure"]
    if options.mass is not None and motion.acceleration is not None:
        out += options.mass * motion.acceleration
    return out


def _check_options(experiments: Sequence[Experiment], options: _Options) -> None:
    """Reject options that do not fit the logs."""
    without = [e.name for e in experiments if "pressure" not in e]
    if options.area is None and len(without) < len(experiments):
        raise UsageError(
            "there is a pressure, but no area to turn it into a force",
            remedy="Give --area M2 (bore 25 mm: --area 4.9087e-4), or leave the pressure out if "
            "the force is that of the piston rod alone.",
        )
    if options.area is not None and without:
        raise UsageError(
            f"--area was given, but {without[0]} has no pressure",
            remedy="Give --column pressure=HEADER, or leave --area out.",
        )
    untimed = [e.name for e in experiments if not e.time.size]
    for name, value in (("mass", options.mass), ("filter", options.half_width)):
        if value is not None and untimed:
            raise UsageError(
                f"--{name} needs time, and {untimed[0]} has none",
                remedy=f"Give --column time=HEADER or --sample-time S, or leave --{name} out.",
            )


def _prepare(
    variant: Variant, experiments: Sequence[Experiment], options: _Options
) -> tuple[list[_Data], float, float]:
    """Friction force and moving samples per log; filter half-width [s], deadband [m/s]."""
    _check_options(experiments, options)
    motions, half_width = _motions(experiments, variant.name, options.half_width)
    deadband = _choose_deadband(motions) if options.deadband is None else options.deadband
    out = []
    for e, motion in zip(experiments, motions):
        known = _known_force(e, motion, options)
        friction = e["force"] - known if "force" in e else np.zeros_like(known)
        out.append(_Data(e, motion, known, friction, _steady(motion, deadband)))
    return out, half_width, deadband


def _sides_moved(data: Sequence[_Data]) -> list[str]:
    """Directions with enough moving samples to average.

    Raises
    ------
    NotIdentifiedError
        When nothing moves.
    """
    counts = {s: sum(int(d.side(s).sum()) for d in data) for s in _SIDES}
    least = max(5.0, 0.005 * sum(counts.values()))
    moved = [s for s in _SIDES if counts[s] >= least]
    if not moved:
        raise NotIdentifiedError(
            "nothing moves in these logs, and friction shows in motion only",
            expected="Nothing was written.",
            remedy="Record strokes in both directions, or check --column and --unit of the "
            "motion, or give a smaller --deadband.",
        )
    return moved


def _half_range(data: Sequence[_Data]) -> float:
    """Half the distance of the mean forces of the two directions, or the one there is [N]."""
    force = np.concatenate([d.friction[d.kept] for d in data])
    forward = np.concatenate([d.side("positive") for d in data])
    if forward.all() or not forward.any():
        return abs(float(np.mean(force)))
    return 0.5 * float(np.mean(force[forward]) - np.mean(force[~forward]))


def _leave_out_accelerations(data: Sequence[_Data]) -> tuple[list[_Data], int, list[Notice]]:
    """Leave out samples in which an unknown mass would show.

    The mass is estimated along with friction, only to see where its force exceeds a share
    of the friction.
    """
    if any(d.motion.acceleration is None for d in data):
        return list(data), 0, []
    rows, force = [], np.concatenate([d.friction[d.kept] for d in data])
    for d in data:
        assert d.motion.acceleration is not None
        forward = d.side("positive")
        rows.append(np.column_stack((forward, ~forward, d.speed, d.motion.acceleration[d.kept])))
    a = np.vstack(rows)
    a = a[:, np.any(a != 0.0, axis=0)]
    scale = np.linalg.norm(a, axis=0)
    mass = float((np.linalg.lstsq(a / scale, force, rcond=None)[0] / scale)[-1])
    limit = _SMALL * abs(_half_range(data))
    if mass * float(np.quantile(np.abs(a[:, -1]), 0.999)) <= limit:
        return list(data), 0, []
    quiet = [
        replace(d, kept=d.kept & (np.abs(np.asarray(d.motion.acceleration)) * mass <= limit))
        for d in data
    ]
    for s in _SIDES:
        before, after = (sum(int(d.side(s).sum()) for d in some) for some in (data, quiet))
        if after < 0.2 * before:
            message = (
                f"accelerating takes more than {100 * _SMALL:.0f} % of the friction in most of "
                f"the moving samples (about {mass:.3g} kg). Give --mass KG to take it off."
            )
            return list(data), 0, [Notice("inertia-matters", message)]
    return quiet, int(sum(d.kept.sum() for d in data) - sum(d.kept.sum() for d in quiet)), []


def _speeds(speed: FloatArray) -> tuple[float, float] | None:
    """Range that holds the middle 80 % of the way travelled [m/s].

    Weighted by distance, the short slow tails about a reversal weigh little and a fast
    stroke as much as a slow one.
    """
    if speed.size < 5:
        return None
    v = np.sort(np.abs(speed))
    share = np.cumsum(v)
    low, high = np.searchsorted(share, np.array([0.1, 0.9]) * share[-1])
    return float(v[low]), float(v[min(int(high), v.size - 1)])


def _speed_ranges(data: Sequence[_Data], moved: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Slowest and fastest speed by direction, over all logs."""
    out = {}
    for s in moved:
        found = [r for d in data if (r := _speeds(d.speed[d.side(s)])) is not None]
        if found:
            out[s] = min(r[0] for r in found), max(r[1] for r in found)
    return out


def _span(low: float, high: float, noise: float) -> float:
    """Spread of true speeds, the noise of the velocity (2 x 1.282 sd) taken off [m/s]."""
    return float(np.sqrt(max((high - low) ** 2 - (2.563 * noise) ** 2, 0.0)))


def _one_speed(ranges: Mapping[str, tuple[float, float]], noise: float) -> bool:
    """Whether every direction knows one speed only."""
    for low, high in ranges.values():
        middle, half = 0.5 * (low + high), 0.5 * _span(low, high, noise)
        if middle + half >= _SECOND_SPEED * (middle - half):
            return False
    return True


def _at_speed(data: Sequence[_Data], ranges: Mapping[str, tuple[float, float]]) -> list[_Data]:
    """Leave out the ends of the strokes: the levels are to be those of the one speed."""
    out = []
    for d in data:
        near = np.zeros(d.kept.size, dtype=bool)
        for s, (low, high) in ranges.items():
            v = d.motion.velocity if s == "positive" else -d.motion.velocity
            near |= (v >= 0.9 * low) & (v <= 1.1 * high)
        out.append(replace(d, kept=d.kept & near))
    return out


def _describe(ranges: Mapping[str, tuple[float, float]]) -> str:
    """Say what speeds were seen."""
    parts = [f"{low:.3g} and {high:.3g} m/s ({s} direction)" for s, (low, high) in ranges.items()]
    return "all strokes, their ends aside, run between " + " and between ".join(parts)


class _System:
    """The linear regression: columns by name, values held, bounds."""

    def __init__(
        self,
        data: Sequence[_Data],
        names: Sequence[str],
        held: Mapping[str, float],
        limits: Mapping[str, tuple[float, float]],
    ) -> None:
        self.names = tuple(names)
        self.limits = [limits.get(n, (-np.inf, np.inf)) for n in names]
        self.columns = [
            np.column_stack([_column(n, d.speed, i) for n in names]) for i, d in enumerate(data)
        ]
        self.right = [
            d.friction[d.kept] - sum(v * _column(n, d.speed, i) for n, v in held.items())
            for i, d in enumerate(data)
        ]
        self.timed = all(d.experiment.time.size for d in data)
        self.cuts = [_stretches(d.kept) for d in data]

    def solve(self) -> _Regression:
        """Least squares within the bounds, with the covariance of the free problem."""
        a, y = np.vstack(self.columns), np.concatenate(self.right)
        scale = np.linalg.norm(a, axis=0)
        scale[scale == 0.0] = 1.0
        x = np.linalg.lstsq(a / scale, y, rcond=None)[0] / scale
        free = dict(zip(self.names, x.tolist()))
        low, high = np.array(self.limits).T
        if np.any((x < low) | (x > high)):
            x = _bounded(a / scale, y, low * scale, high * scale) / scale
        residuals = [r - c @ x for r, c in zip(self.right, self.columns)]
        uncertainty = self._uncertainty(np.array(list(free.values())))
        values = dict(zip(self.names, x.tolist()))
        return _Regression(values, self.names, residuals, uncertainty, free)

    def _uncertainty(self, x: FloatArray) -> Uncertainty:
        """Covariance of the free solution; a stroke is one stretch of correlated noise."""
        columns, residuals = [], []
        for c, y, cuts in zip(self.columns, self.right, self.cuts):
            r = y - c @ x
            columns += [part for part in np.split(c, cuts) if part.size]
            residuals += [part for part in np.split(r, cuts) if part.size]
        return _widen(covariance(columns, residuals, robust=self.timed), columns, len(self.names))


def _widen(found: Uncertainty, columns: Sequence[FloatArray], unknowns: int) -> Uncertainty:
    """Correct the covariance of coloured residuals for a small effective sample.

    ``n_e`` samples that were independent would give the same variance. Residuals of ``p``
    unknowns lose ``p / n_e`` of their variance, and an autoregression fitted to them, its
    coefficient too small by ``(1 + 3 rho) / n`` (Kendall 1954), some ``2 (p + 1) / n_e``.
    """
    a = np.vstack(columns)
    white = found.sigma**2 * np.diag(np.linalg.pinv(a.T @ a))
    if found.order == 0 or not np.all(white > 0.0):
        return found
    inflation = max(float(np.median(np.diag(found.covariance) / white)), 1.0)
    effective = a.shape[0] / inflation
    rest = max(effective - 3.0 * unknowns - 2.0, 0.25 * effective)
    degrees = max(int(effective) - unknowns, 1)
    return replace(found, covariance=found.covariance * (effective / rest), degrees=degrees)


def _stretches(kept: Mask) -> list[int]:
    """Where one stroke ends and another begins, as indices into the kept samples.

    Crumbs of fewer than 20 samples stay with the stretch before them.
    """
    index = np.flatnonzero(kept)
    out: list[int] = []
    for cut in (np.flatnonzero(np.diff(index) > 1) + 1).tolist():
        if cut - (out[-1] if out else 0) >= 20 and index.size - cut >= 20:
            out.append(cut)
    return out


def _column(name: str, speed: FloatArray, index: int) -> FloatArray:
    """What multiplies an unknown, shape ``(n,)``."""
    if name == "coulomb_positive":
        return np.asarray(speed > 0.0, dtype=float)
    if name == "coulomb_negative":
        return -np.asarray(speed < 0.0, dtype=float)
    if name == "coulomb_mean":
        return np.sign(speed)
    if name == "viscous":
        return speed
    return np.full(speed.size, 1.0 if name in ("offset", f"offset[{index}]") else 0.0)


def _bounded(a: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Bounded least squares; unknowns whose bounds coincide are held there."""
    from scipy.optimize import lsq_linear

    x = np.where(low == high, low, 0.0)
    free = low < high
    if free.any():
        rest = y - a[:, ~free] @ x[~free]
        x[free] = lsq_linear(a[:, free], rest, (low[free], high[free]), method="bvls").x
    return np.asarray(x)


def _check_signs(data: Sequence[_Data], moved: Sequence[str]) -> None:
    """Reject forces that point along the motion as friction never does.

    Raises
    ------
    LogError
        When the mean force of the strokes, half the difference of the two directions, is
        negative beyond doubt.
    """
    names = [f"coulomb_{s}" for s in moved]
    found = _System(data, names, {}, {}).solve()
    mean = sum(found.values.values()) / len(names)
    half = found.quantile * found.std_error(dict.fromkeys(names, 1.0 / len(names)))
    if mean + half >= 0.0:
        return
    one_sided = len(names) == 1
    raise LogError(
        f"friction would be negative ({mean:.4g} N): the force left after pressure and inertia "
        "helps the motion",
        where=", ".join(d.experiment.name for d in data),
        expected="Force counts positive along positive velocity and is what drives the motion.",
        remedy="Give --scale force=-1 if the sensor counts the other way. If the force comes "
        "from one chamber's pressure, the other chamber is missing: give it as --column "
        "pressure=HEADER with its --area."
        + (" If a constant force adds to it, record strokes in both directions." * one_sided),
    )


def _levels_impossible(found: _Regression) -> bool:
    """Whether a level about zero is negative beyond its interval."""
    return any(
        found.free_values[n] + found.quantile * found.std_error({n: 1.0}) < 0.0
        for n in _LEVELS
        if n in found.names
    )


class _Fit:
    """One fit from start to end: which unknowns, their values, and what to say of them."""

    def __init__(
        self, variant: Variant, data: Sequence[_Data], request: Request, options: _Options
    ) -> None:
        self.data, self.options = list(data), options
        self.specs = {p.name: p for p in variant.parameters}
        self.fixed = {n: float(v) for n, v in request.fixed.items()}
        unknowns = make_unknowns(variant.parameters, tuple(self.specs), {}, request)
        self.limits = {n: (u.low, u.high) for n, u in unknowns.items()}
        self.notices: list[Notice] = []
        self.refused: dict[str, str] = {}
        self.symmetric = options.offset == "estimate"
        self.moved = _sides_moved(data)
        self.ranges = _speed_ranges(data, self.moved)
        self.noise = max(d.motion.noise for d in data)
        self.found = self._run()

    def _run(self) -> _Regression:
        """Solve, refuse what is not determined, and let an offset in where one must be."""
        if not self.symmetric and not self.fixed:
            _check_signs(self.data, self.moved)
        for s in _SIDES:
            if s not in self.moved and f"coulomb_{s}" not in self.fixed:
                self._refuse(f"coulomb_{s}", f"nothing moves in the {s} direction.")
        if self.symmetric and not self._offset_possible():
            raise UsageError(
                "an offset of the force cannot be estimated here",
                expected="It takes motion in both directions and free Coulomb levels.",
                remedy="Leave --offset out, or record strokes in both directions.",
            )
        if "viscous" not in self.fixed and _one_speed(self.ranges, self.noise):
            self._refuse_viscous(_describe(self.ranges) + ".")
            self.data = _at_speed(self.data, self.ranges)
        found = self._with_offset(self._solve())
        if self._undetermined(found):
            half = found.quantile * found.std_error({"viscous": 1.0})
            self._refuse_viscous(
                f"its 95 % interval would be {found.free_values['viscous']:.3g} ± {half:.2g} "
                f"N s/m; {_describe(self.ranges)}."
            )
            found = self._with_offset(self._solve())
        if "coulomb_mean" in found.names:
            self._explain_offset(found)
        elif _levels_impossible(found):
            self._explain_negative(found)
        return found

    def _with_offset(self, found: _Regression) -> _Regression:
        """Solve again with an offset where a level about zero is impossible.

        In all logs together or in a single one: logs whose offsets differ hide them from
        the common fit.
        """
        if self.symmetric or not self._offset_possible():
            return found
        both = [d for d in self.data if all(d.side(s).any() for s in _SIDES)]
        alone = (_System([d], _LEVELS, {}, {}).solve() for d in both if len(self.data) > 1)
        if not _levels_impossible(found) and not any(_levels_impossible(a) for a in alone):
            return found
        self.symmetric = True
        return self._solve()

    def _refuse(self, name: str, reason: str) -> None:
        self.refused[name] = reason
        self.notices.append(refuse(self.specs[name], reason))

    def _refuse_viscous(self, reason: str) -> None:
        self._refuse("viscous", reason + " The Coulomb levels hold all friction at that speed.")

    def _offset_possible(self) -> bool:
        free = all(n not in self.fixed and n not in self.refused for n in _LEVELS)
        return free and self.options.offset != "none"

    def _undetermined(self, found: _Regression) -> bool:
        """Whether viscous friction could be half of all friction, or none of it.

        The interval times the span of speeds is the force that is in doubt.
        """
        if "viscous" not in found.names:
            return False
        span = max(_span(low, high, self.noise) for low, high in self.ranges.values())
        half = found.quantile * found.std_error({"viscous": 1.0})
        return not half * span <= 0.5 * abs(_half_range(self.data))

    def _offsets(self) -> list[str]:
        """One offset per log where every log shows both directions, else one for all."""
        if all(d.side(s).any() for d in self.data for s in _SIDES):
            return [f"offset[{i}]" for i in range(len(self.data))]
        return ["offset"]

    def _solve(self) -> _Regression:
        levels = ["coulomb_mean", *self._offsets()] if self.symmetric else list(_LEVELS)
        names = [n for n in (*levels, "viscous") if n not in self.fixed and n not in self.refused]
        limits = dict(self.limits)
        low, high = zip(*(self.limits[n] for n in _LEVELS))
        limits["coulomb_mean"] = (max(low), min(high))
        if not names:
            raise UsageError(
                "nothing is left to estimate: every parameter is fixed or out of reach",
                remedy="Leave out one --fix.",
            )
        return _System(self.data, names, self.fixed, limits).solve()

    def _explain_offset(self, found: _Regression) -> None:
        if self.options.offset == "estimate":
            return
        message = (
            f"the force has an offset of {self.offset(found):.4g} N (another chamber, gravity, a "
            "preload or the sensor's zero), so a level about zero would be negative. The levels "
            "are taken about the offset and are equal: their difference cannot be told from it. "
            "Remove the offset with the other chamber's pressure, or give --offset none."
        )
        self.notices.append(Notice("force-offset", message))

    def _explain_negative(self, found: _Regression) -> None:
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

    def offset(self, found: _Regression) -> float:
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
            out.update(dict.fromkeys(_LEVELS, self.found.values["coulomb_mean"]))
        return out

    def covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names and covariance of what was estimated."""
        order = tuple(n for n in self.specs if n not in self.fixed and n not in self.refused)
        source = ["coulomb_mean" if self.symmetric and n in _LEVELS else n for n in order]
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
        if not any(n in self.refused for n in _LEVELS):
            for name, sign in (("coulomb_mean", 1.0), ("coulomb_offset", -1.0)):
                weights = {_LEVELS[0]: 0.5, _LEVELS[1]: 0.5 * sign}
                w = np.array([weights.get(n, 0.0) for n in order])
                se = float(np.sqrt(max(float(w @ matrix @ w), 0.0)))
                value = sum(weights[n] * values[n] for n in _LEVELS)
                out[name] = Quantity(value, "N", "derived", se)
        names = [n for n in self.found.names if n.startswith("offset")]
        if names:
            se = self.found.std_error(dict.fromkeys(names, 1.0 / len(names)))
            out["force_offset"] = Quantity(self.offset(self.found), "N", "derived", se)
        return out


def _spikes(fit: _Fit) -> list[Notice]:
    """Warn of residuals far outside all others: they pull a least-squares fit."""
    r = np.concatenate(fit.found.residuals)
    spread = 1.4826 * float(np.median(np.abs(r - np.median(r))))
    limit = max(8.0 * spread, 2.0 * abs(_half_range(fit.data)))
    count = int(np.sum(np.abs(r - np.median(r)) > limit))
    if not count:
        return []
    message = (
        f"{count} of {r.size} moving samples lie more than {limit:.3g} N off the fit: "
        "spikes of the load cell, or contact at the end of the stroke. Look at the plot and "
        "leave them out with --window."
    )
    return [Notice("force-spikes", message)]


def _disagreement(fit: _Fit) -> list[Notice]:
    """Warn of logs whose mean friction is not that of the fit."""
    limit = 0.25 * abs(_half_range(fit.data))
    worst: tuple[float, str, str] = (0.0, "", "")
    for d, r in zip(fit.data, fit.found.residuals):
        for s in fit.moved:
            if d.side(s).sum() >= 5:
                off = abs(float(np.mean(r[d.side(s)])))
                worst = max(worst, (off, d.experiment.name, s))
    if len(fit.data) < 2 or worst[0] <= limit:
        return []
    message = (
        f"the logs do not share one friction: in {worst[1]}, {worst[2]} direction, it is "
        f"{worst[0]:.3g} N off the common fit. Friction of seals rises with pressure: fit logs "
        "of different pressure one by one."
    )
    return [Notice("logs-disagree", message)]


def _attenuation(fit: _Fit) -> list[Notice]:
    """Warn where noise of the velocity makes viscous friction look smaller."""
    if "viscous" not in fit.found.names:
        return []
    within = np.concatenate(
        [v - v.mean() for s in fit.moved if (v := _side_speeds(fit.data, s)).size]
    )
    share = fit.noise**2 / max(float(np.mean(within**2)), 1e-300)
    if share <= 0.05:
        return []
    message = (
        f"{100 * share:.0f} % of the variance of the speed is noise, which makes viscous friction "
        "come out too small by about as much. Give a longer --filter, or a better velocity."
    )
    return [Notice("velocity-noise", message)]


def _side_speeds(data: Sequence[_Data], side: str) -> FloatArray:
    return np.concatenate([d.speed[d.side(side)] for d in data])


def _variant(motion: str, unit: str, time_required: bool) -> Variant:
    """Roles and parameters with velocity or position as the motion."""
    return Variant(
        motion,
        (
            Role("time", "s", "time of each sample", required=time_required),
            Role(
                "force",
                "N",
                "force that drives the motion, positive along positive velocity",
                output=True,
            ),
            Role(motion, unit, f"{motion} of the piston"),
            Role("pressure", "Pa", "pressure whose force is no friction", required=False),
        ),
        (
            ParameterSpec(
                "viscous",
                "N s/m",
                "viscous friction",
                neutral=0.0,
                minimum=0.0,
                remedy="Add one stroke, or one log, at another speed in the same direction: "
                f"{_SECOND_SPEED:g} times faster or more.",
            ),
            *(
                ParameterSpec(
                    f"coulomb_{s}",
                    "N",
                    f"kinetic friction, {s} direction (magnitude)",
                    neutral=0.0,
                    minimum=0.0,
                    remedy=f"Record at least one stroke in the {s} direction, at steady speed.",
                )
                for s in _SIDES
            ),
        ),
    )


class CylinderFriction(Family):
    """Coulomb and viscous friction of a cylinder by regression on moving samples."""

    name = "cylinder-friction"
    title = "Friction of a cylinder: Coulomb levels by direction and viscous friction"
    equation = (
        "force - area * pressure - mass * acceleration = coulomb_positive [v > 0] "
        "- coulomb_negative [v < 0] + viscous * v"
    )
    variants = (_variant("velocity", "m/s", False), _variant("position", "m", True))
    options = (
        Option("area", "float", "piston area that the pressure acts on", unit="m2", minimum=0.0),
        Option("mass", "float", "moving mass, to take inertia off", unit="kg", minimum=0.0),
        Option(
            "filter",
            "float",
            "half-width of the zero-phase velocity filter (default: from the noise)",
            unit="s",
            minimum=0.0,
        ),
        Option(
            "deadband",
            "float",
            "samples slower than this are left out (default: from noise and speed)",
            unit="m/s",
            minimum=0.0,
        ),
        Option(
            "offset",
            "choice",
            "constant offset of the force: estimated where the levels need one, always, or never",
            default="auto",
            choices=("auto", "estimate", "none"),
        ),
    )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit levels and viscous friction; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        options = _Options.read(request.options)
        data, half_width, deadband = _prepare(variant, experiments, options)
        slow = sum(d.kept.size - int(d.kept.sum()) for d in data)
        _sides_moved(data)
        accelerating = 0
        notices: list[Notice] = []
        if options.mass is None:
            data, accelerating, notices = _leave_out_accelerations(data)
        fit = _Fit(variant, data, request, options)
        notices += [*fit.notices, *_spikes(fit), *_disagreement(fit), *_attenuation(fit)]
        ends = int(sum(d.kept.sum() for d in data) - sum(d.kept.sum() for d in fit.data))
        data = fit.data
        order, matrix = fit.covariance()
        p = scalars({n: q.value for n, q in fit.quantities().items()})
        simulated = [_predict(d, p, fit.log_offset(i), deadband) for i, d in enumerate(data)]
        measured = [np.where(d.kept, d.experiment["force"], np.nan) for d in data]
        counts = {"slow_or_reversing": slow, "accelerating": accelerating, "stroke_ends": ends}
        details = _details(fit, half_width, deadband, counts)
        return Estimate(
            fit.quantities(), fit.derived(), order, matrix, simulated, measured, notices, details
        )

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Force needed for the motion of a log; see :meth:`Family.simulate`.

        Equal levels are levels about an offset of the force, which belongs to the log and
        is then fitted to it.
        """
        chosen = _Options.read(options)
        (d,), _, deadband = _prepare(variant, [experiment], chosen)
        p = scalars(parameters)
        offset = 0.0
        symmetric = p["coulomb_positive"] == p["coulomb_negative"] > 0.0
        both = all(d.side(s).any() for s in _SIDES)
        if "force" in experiment and symmetric and both and chosen.offset != "none":
            rest = d.friction[d.kept] - friction_force(d.speed, **p)
            offset = 0.5 * float(sum(np.mean(rest[d.side(s)]) for s in _SIDES))
        return _predict(d, p, offset, deadband)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The static map for feed-forward compensation."""
        return {
            "friction": {
                "equation": "coulomb_positive*(v>0) - coulomb_negative*(v<0) + viscous*v",
                "input": {"name": "velocity", "unit": "m/s"},
                "output": {"name": "force", "unit": "N"},
                **scalars(parameters),
            }
        }

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Friction over velocity: force less pressure, inertia and offset, and the fitted lines."""
        data, _, _ = _prepare(variant, experiments, _Options.read(options))
        p = scalars({n: q.value for n, q in estimate.parameters.items()})
        v = np.concatenate([d.motion.velocity for d in data])
        model = friction_force(v, **p)
        force = np.concatenate([e["force"] for e in experiments])
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        # slow samples are predicted without friction: only what is fitted has its own offset
        friction = np.concatenate([d.friction for d in data])
        rest = force - np.concatenate(list(estimate.simulated))
        lines = []
        for side, sign in (("positive", 1.0), ("negative", -1.0)):
            speeds = v[used & (v * sign > 0.0)]
            if speeds.size:
                x = np.array([0.0, speeds.max() if sign > 0.0 else speeds.min()])
                level = sign * p[f"coulomb_{side}"]
                lines.append(Curve(f"fitted, {side}", x, level + p["viscous"] * x))
        return StaticView(
            "velocity", "m/s", "friction", "N",
            v, np.where(used, model + rest, friction), model, used, lines,
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> FrictionBlock:
        """The friction map that a controller calls with a velocity."""
        return FrictionBlock({n: p["value"] for n, p in document["parameters"].items()})


def _predict(d: _Data, p: Mapping[str, float], offset: float, deadband: float) -> FloatArray:
    """Force that the model predicts at every sample [N]; no friction within the deadband."""
    v = d.motion.velocity
    friction = friction_force(np.where(np.abs(v) > deadband, v, 0.0), **p)
    return np.asarray(d.known + friction + offset)


def _details(
    fit: _Fit, half_width: float, deadband: float, counts: Mapping[str, int]
) -> dict[str, Any]:
    """What was done, for the file."""
    order = fit.found.uncertainty.order
    out: dict[str, Any] = {
        "method": "linear regression on moving samples",
        "velocity_filter": {
            "type": "zero-phase local polynomial" if half_width > 0.0 else "none",
            "half_width": half_width,
            "degree": _DEGREE,
        },
        "deadband": deadband,
        "left_out": dict(counts),
        "speeds": {s: [low, high] for s, (low, high) in fit.ranges.items()},
        "covariance": f"autoregressive residuals of order {order}" if order else "white",
    }
    if fit.symmetric:
        out["force_offsets"] = [fit.log_offset(i) for i in range(len(fit.data))]
    return out
