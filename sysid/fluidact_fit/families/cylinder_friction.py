"""Friction of a cylinder: two Coulomb levels and viscous friction.

    F_f = F_c+ [v > 0] - F_c- [v < 0] + b v
    F_f = F - (A_1 p_1 - A_2 p_2) - m a      with a load cell
    F_f = A_1 p_1 - A_2 p_2 - m a            without: the pressures drive

``F`` is what drives the motion, positive along positive velocity; pressure forces and the
inertia ``m a`` are taken off when the areas and the mass are given. All levels are
magnitudes. The regression sees moving samples only [1]_: near standstill friction is a
matter of presliding and stiction, and a smoothed sign would bias the levels.

A *measured velocity* stands in the equation as it is. Its noise would make ``b`` too small;
the instrument [4]_ in its place is the velocity smoothed over the neighbours of each sample,
without its own reading, whose noise it does not share: ``Z' (F - A x) = 0``.

The *slope of a position* is a weighted mean of the velocity; the force and the sign of the
velocity go through the same mean. Whatever the filter takes off a fast stroke it takes off
its force, so the friction is that of the unfiltered motion, reversals in the window
included. The noise that is left in the slope is taken off the normal equations [3]_, and the
covariance is that of the noise before the filter, carried through it.

Without a second speed in at least one direction, ``b v`` cannot be told from the levels:
``viscous`` is then written as not identified and the levels hold all friction.

References
----------
.. [1] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
   System Identification Benchmarks, 2019: regression on filtered velocity with slow
   samples left out.
.. [2] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 17 to 19: friction levels by direction with a velocity tolerance.
.. [3] W. A. Fuller, Measurement Error Models, 1987, section 1.2: the moment estimator with
   a known variance of the error in the regressor.
.. [4] A. Janot, P.-O. Vandanjon, M. Gautier, "A generic instrumental variable approach for
   industrial robot identification", IEEE Trans. Control Systems Technology 22(1), 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, NotIdentifiedError, UsageError
from ..estimation.information import Information
from ..estimation.parametric import check_request, make_unknowns, refuse, scalars
from ..estimation.uncertainty import Uncertainty, covariance, enlarge, t_quantile
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
from ..signals import antiderivative, central_difference, matched_kernel, smooth

Mask = npt.NDArray[np.bool_]

_SIDES = ("positive", "negative")
_LEVELS = ("coulomb_positive", "coulomb_negative")
_DEGREE = 2
_HALF_WIDTHS = (2, 4, 8, 16, 32, 64, 128)
_LINGER = 1.5  # times the way through rest that its slope foretells: longer is a rest
_QUIET = 0.02  # noise of the filtered speed, as a share of the highest, that is small enough
_SLOW = 0.05  # share of the highest speed below which friction is not that of motion
_SECOND_SPEED = 1.5  # ratio of two speeds that are clearly different
_SMALL = 0.05  # share of the friction that inertia may have before it matters
_FLATTENED = 0.8  # of the highest speed, left by a filter that is too long for the strokes
_PRESSURES = "-pressures"  # variants without a load cell


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
    area_2: float | None
    mass: float | None
    half_width: float | None
    deadband: float | None
    offset: str

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> _Options:
        return cls(
            given.get("area"),
            given.get("area-2"),
            given.get("mass"),
            given.get("filter"),
            given.get("deadband"),
            given.get("offset") or "auto",
        )


@dataclass(frozen=True)
class _Motion:
    """Motion of one log.

    Attributes
    ----------
    velocity : (n,)
        Filtered; it tells which way a sample moves, and is the instrument of the regression.
        Of a measured velocity, each sample's own reading has no part in it [m/s].
    regressor : (n,)
        Velocity that belongs to the matched force: the measured one as it is, or the
        filtered slope of a position [m/s].
    acceleration : (n,)
        Derivative of the regressor, a measured velocity filtered before [m/s2]; ``None``
        without time.
    bare : (n,)
        Velocity that the filter flattens (next to) nothing of: as measured, or from a
        position with the first order of what the filter took off put back [m/s].
    sharp : (n,)
        Velocity to predict with, quiet and hardly flattened [m/s].
    inside : (n,)
        Whether the filter window lies within the record.
    noise
        Standard deviation of ``velocity`` [m/s].
    shared
        Standard deviation of the noise that ``velocity`` and ``regressor`` have in common
        [m/s].
    half
        Half-width of the filter in samples; 0: not filtered.
    kernel : (2 m + 1,)
        What the force is smoothed with to match the regressor.
    """

    velocity: FloatArray
    regressor: FloatArray
    acceleration: FloatArray | None
    bare: FloatArray
    sharp: FloatArray
    inside: Mask
    noise: float
    shared: float
    half: int
    kernel: FloatArray

    @property
    def fast(self) -> float:
        """Highest speed but for 2 % [m/s]."""
        return float(np.quantile(np.abs(self.velocity[self.inside]), 0.98))

    @property
    def reach(self) -> int:
        """Samples on either side that the matched force depends on."""
        return self.kernel.size // 2


@dataclass(frozen=True)
class _Data:
    """One log, ready for the regression.

    ``known`` is the part of the drive that is no friction, ``friction`` the rest, and
    ``matched`` that rest smoothed like the regressor, all of shape ``(n,)`` [N];
    ``direction`` is the sign of the velocity, smoothed alike. ``kept`` marks the samples
    that are fitted. The output is the drive divided by ``scale``.
    """

    experiment: Experiment
    motion: _Motion
    known: FloatArray
    friction: FloatArray
    matched: FloatArray
    direction: FloatArray
    kept: Mask
    scale: float

    @property
    def speed(self) -> FloatArray:
        """Velocities of the kept samples [m/s]."""
        return self.motion.velocity[self.kept]

    @property
    def support(self) -> Mask:
        """Samples that the fitted ones depend on, shape ``(n,)``."""
        reach, n = self.motion.reach, self.kept.size
        if not reach:
            return self.kept
        count = np.concatenate(([0], np.cumsum(self.kept)))
        at = np.arange(n)
        return np.asarray(
            count[np.minimum(at + reach + 1, n)] > count[np.maximum(at - reach, 0)], dtype=bool
        )

    def spread(self, columns: FloatArray) -> FloatArray:
        """What multiplies the unfiltered force where ``columns`` multiply the matched one.

        Shapes ``(kept, p)`` and ``(support, p)``.
        """
        if not self.motion.reach:
            return columns
        full = np.zeros((self.kept.size, columns.shape[1]))
        full[self.kept] = columns
        out = [np.convolve(c, self.motion.kernel, "same") for c in full.T]
        return np.column_stack(out)[self.support]

    def side(self, side: str) -> Mask:
        """Which of the kept samples move in a direction."""
        return self.speed > 0.0 if side == "positive" else self.speed < 0.0


@dataclass(frozen=True)
class _Regression:
    """A solved regression: values by name and residuals per log, matched and unfiltered."""

    values: dict[str, float]
    names: tuple[str, ...]
    residuals: list[FloatArray]
    bare_residuals: list[FloatArray]
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
    rows : (4, n)
        Value, first and second derivative, and the share of each sample's own reading in
        its value.
    inside : (n,)
        False near the ends and where the window bridges a gap.
    """
    n, width = values.size, 2 * half + 1
    rows, inside = np.zeros((4, n)), np.zeros(n, dtype=bool)
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
        rows[:3, at] = found.T / np.array([1.0, half * step, 0.5 * (half * step) ** 2])[:, None]
        rows[0, at] += middle
        rows[3, at] = np.linalg.inv(moments)[:, 0, 0]
        inside[at] = good
    rows[:, :half], rows[:, n - half :] = rows[:, half, None], rows[:, n - half - 1, None]
    return rows, inside


def _sensor_noise(values: FloatArray, time: FloatArray, resolution: float) -> float:
    """Noise that no motion explains: high differences, or the resolution if that is more.

    A handful of exact levels, as in a table of plateaus, is no resolution.
    """
    if np.ptp(values) < 20.0 * resolution:
        resolution = 0.0
    floor = float(resolution / np.sqrt(12.0))
    if values.size < 8:
        return floor
    found = [float(np.median(np.abs(_rough(values, time, order)))) for order in (3, 5)]
    return max(1.4826 * min(found), floor)


def _rough(values: FloatArray, time: FloatArray, order: int) -> FloatArray:
    """Divided differences, scaled so that white noise keeps its size; without time: as even."""
    if not time.size:
        time = np.arange(values.size, dtype=float)
    n = values.size - order
    t = np.stack([time[k : n + k] for k in range(order + 1)])
    t = (t - t[0]) / max(float(np.median(t[order] - t[0])), 1e-300)
    weights = []
    for k in range(order + 1):
        gaps = t[k] - np.delete(t, k, axis=0)
        weights.append(1.0 / np.prod(gaps, axis=0))
    w = np.stack(weights)
    w /= np.sqrt(np.sum(w**2, axis=0))
    return np.asarray(np.sum(w * np.stack([values[k : n + k] for k in range(order + 1)]), axis=0))


def _differentiate(
    experiment: Experiment, values: FloatArray, half: int
) -> tuple[FloatArray, Mask]:
    """Value, rate, curvature, own share: shape ``(4, n)``; and where the window is whole."""
    if experiment.uniform:
        s = smooth(values, experiment.sample_time, half, _DEGREE)
        own = np.full(values.size, matched_kernel(half, 0, _DEGREE)[half])
        return np.stack([s.value, s.rate, s.curvature, own]), s.inside
    return _local_polynomial(experiment.time, values, experiment.sample_time, half)


def _filter(experiment: Experiment, role: str, half: int) -> _Motion:
    """Motion by a zero-phase quadratic over ``2 half + 1`` samples."""
    signal = experiment.signals[role]
    y = signal.values
    noise = _sensor_noise(y, experiment.time, signal.resolution)
    if not experiment.time.size:
        whole = np.ones(y.size, dtype=bool)
        return _Motion(y, y, None, y, y, whole, noise, noise, 0, np.ones(1))
    least = 1 if role == "position" else 2  # a parabola through three readings smooths nothing
    half = max(least, min(half, (y.size - 1) // 2))
    rows, inside = _differentiate(experiment, y, half)
    if not inside.any():
        raise LogError(
            f"no stretch of {2 * half + 1} samples without a gap is left to differentiate",
            where=experiment.name,
            remedy="Give a shorter --filter, or a longer log.",
        )
    if role == "position":
        return _slope_of_position(experiment, rows[1], inside, noise, half)
    return _smoothed_velocity(experiment, y, rows, inside, noise, half)


def _slope_of_position(
    experiment: Experiment, slope: FloatArray, inside: Mask, noise: float, half: int
) -> _Motion:
    """Motion from a position: its slope is regressor and instrument at once."""
    v = _fill(slope, inside)
    kernel = matched_kernel(half, 1, _DEGREE)
    sharp = _sharpen(v, kernel)
    far = np.convolve(~inside, np.ones(kernel.size), "same") < 0.5
    inside = far if far.any() else inside
    offsets = np.arange(-half, half + 1)
    gain = 1.0 / (experiment.sample_time * float(np.linalg.norm(offsets)))
    acceleration = central_difference(v, experiment.time)
    own = noise * gain
    return _Motion(v, v, acceleration, sharp, sharp, inside, own, own, half, kernel)


def _smoothed_velocity(
    experiment: Experiment,
    measured: FloatArray,
    rows: FloatArray,
    inside: Mask,
    noise: float,
    half: int,
) -> _Motion:
    """Motion from a velocity: the readings are the regressor, their neighbours the instrument."""
    smoothed, kernel = _fill(rows[0], inside), np.ones(1)
    own, share = np.where(inside, rows[3], 0.0), float(np.median(rows[3][inside]))
    power = share  # of a least-squares fit's value: its own share
    if experiment.uniform:
        once = matched_kernel(half, 0, _DEGREE)
        smoothed = _sharpen(smoothed, once)
        kernel = _sharpened(once)
        reach = kernel.size // 2
        share, power = float(kernel[reach]), float(kernel @ kernel)
        own = np.full(measured.size, share)
    others = (smoothed - own * measured) / (1.0 - own)
    others = np.where(inside, others, smoothed)
    quiet = noise * float(np.sqrt(power - share**2)) / (1.0 - share)
    acceleration = central_difference(smoothed, experiment.time)
    return _Motion(
        others, measured, acceleration, measured, smoothed, inside, quiet, 0.0, half, np.ones(1)
    )


def _sharpened(kernel: FloatArray) -> FloatArray:
    """Kernel of :func:`_sharpen` after this one, three times as long."""
    twice = np.convolve(kernel, kernel)
    out = np.convolve(twice, kernel)
    reach = kernel.size // 2
    out[reach:-reach] -= 3.0 * twice
    out[2 * reach : -2 * reach] += 3.0 * kernel
    return out


def _pad(values: FloatArray, before: int, after: int) -> FloatArray:
    """Continue a signal at both ends, point symmetric about its ends if it is long enough."""
    if values.size > max(before, after):
        return np.pad(values, (before, after), mode="reflect", reflect_type="odd")
    return np.pad(values, (before, after), mode="edge")


def _fill(values: FloatArray, inside: Mask) -> FloatArray:
    """Continue a filtered signal over the ends, and straight over gaps."""
    index = np.flatnonzero(inside)
    first, last = int(index[0]), int(index[-1])
    between = np.interp(np.arange(first, last + 1), index, values[index])
    return _pad(between, first, values.size - 1 - last)


def _sharpen(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Put back what a filter took off, but for the third power of its share.

    What another pass takes off is what the first one took, to first order (Tukey's twicing).
    """
    reach = kernel.size // 2
    out = lost = values
    for _ in range(2):
        lost = lost - np.convolve(_pad(lost, reach, reach), kernel, "valid")
        out = out + lost
    return out


def _match(experiment: Experiment, role: str, motion: _Motion, force: FloatArray) -> FloatArray:
    """Smooth a force as the regressor is smoothed, shape ``(n,)``.

    The slope of a position is a weighted mean of the velocity within the window; the same
    slope of the integral of the force is the same mean of the force.
    """
    if role == "velocity":
        return force
    if experiment.uniform:
        padded = np.pad(force, motion.reach, mode="edge")
        return np.convolve(padded, motion.kernel, "valid")
    integral = antiderivative(force, experiment.time)
    return _differentiate(experiment, integral, motion.half)[0][1]


def _flattens(before: _Motion, now: _Motion) -> bool:
    """Whether a longer filter takes away much of the highest speed, and not just its noise.

    Noise alone raises the highest speed by up to two of its standard deviations.
    """
    quiet = before.noise <= 0.2 * before.fast
    return quiet and now.fast < _FLATTENED * (before.fast - 2.0 * before.noise)


def _choose_slope(experiment: Experiment) -> float:
    """Half-width for a position: quiet enough, and not too long for the strokes [s]."""
    chosen, before = _HALF_WIDTHS[0], None
    for half in _HALF_WIDTHS:
        motion = _filter(experiment, "position", half)
        if before is not None and _flattens(before, motion):
            break
        chosen, before = half, motion
        if motion.noise <= _QUIET * motion.fast or 16 * half >= experiment.samples:
            break
    return chosen * experiment.sample_time


def _choose_smoothing(experiment: Experiment) -> float:
    """Half-width for a velocity: least error of noise and flattening together [s].

    ``mean((y - K y)^2) + 2 k_0 s^2`` is that error but for a constant (Mallows 1973); ``K``
    smooths, ``k_0`` is each reading's share in itself and ``s`` the noise of the readings.
    """
    signal = experiment.signals["velocity"]
    y = signal.values
    variance = _sensor_noise(y, experiment.time, signal.resolution) ** 2
    best, chosen = np.inf, _HALF_WIDTHS[0]
    for half in _HALF_WIDTHS:
        if half > _HALF_WIDTHS[0] and 16 * half >= experiment.samples:
            break
        motion = _filter(experiment, "velocity", half)
        rest = (y - motion.sharp)[motion.inside]
        # the part without the reading itself is further off by that reading's share
        others = (y - motion.velocity)[motion.inside]
        share = 1.0 - float(np.sum(rest**2) / max(float(rest @ others), 1e-300))
        error = float(np.mean(rest**2)) + 2.0 * share * variance
        if error < best:
            best, chosen = error, half
        if 4.0 * motion.noise <= _SLOW * motion.fast:  # the deadband is no wider for it
            break
    return chosen * experiment.sample_time


def _motions(
    experiments: Sequence[Experiment], role: str, half_width: float | None
) -> tuple[list[_Motion], float]:
    """Motion of every log, and the half-width of its filter [s].

    Positions go through one filter, which both sides of the equation feel; the filter of a
    velocity is that of its own log, and the longest is returned.
    """
    timed = [e for e in experiments if e.time.size]
    wanted = [half_width] * len(timed)
    if half_width is None and role == "velocity":
        wanted = [_choose_smoothing(e) for e in timed]
    elif half_width is None and timed:
        wanted = [_common_slope(timed)] * len(timed)
    chosen = {id(e): w for e, w in zip(timed, wanted) if w is not None}
    out = []
    for e in experiments:
        half = round(chosen[id(e)] / e.sample_time) if e.time.size else 0
        out.append(_filter(e, role, half))
    return out, max(chosen.values(), default=0.0)


def _common_slope(experiments: Sequence[Experiment]) -> float:
    """Half-width for the positions of several logs [s]."""
    wanted = [_choose_slope(e) for e in experiments]
    half_width = max(wanted)
    for e, own in zip(experiments, wanted):  # what a slow log needs may flatten a fast one
        before = _filter(e, "position", round(own / e.sample_time))
        while half_width > 1.5 * own:
            now = _filter(e, "position", round(half_width / e.sample_time))
            if not _flattens(before, now):
                break
            half_width *= 0.5
    return half_width


def _choose_deadband(motions: Sequence[_Motion]) -> float:
    """Speed below which a sample may be at rest: noise, or a share of the speed [m/s].

    The slowest log that moves at all sets the share, so that a fast one does not hide it.
    """
    floor = 4.0 * max(m.noise for m in motions)
    moving = [m.fast for m in motions if m.fast > floor]
    return float(max(floor, _SLOW * min(moving, default=0.0)))


def _moving(motion: _Motion, deadband: float) -> Mask:
    """Samples that move, and whose filter window holds no rest, shape ``(n,)``.

    Near a rest the filter spreads motion over samples that stand still. A reversal in
    passing has no rest: what lies within the deadband there is left out alone, unless the
    matched force is a mean over it.
    """
    v = motion.velocity
    idle = np.abs(v) <= deadband
    lost = np.zeros(v.size + 1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], idle, [False])).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist()):
        reach = motion.reach
        if not _passes(v, begin, end, deadband):
            reach = max(reach, motion.half)
        lost[max(begin - reach, 0)] += 1.0
        lost[min(end + reach, v.size)] -= 1.0
    kept = (np.cumsum(lost[:-1]) < 0.5) & motion.inside
    if motion.reach:  # reversals that follow each other so fast leave no cubic to match
        turns = np.concatenate(([0], np.cumsum(np.sign(v[1:]) != np.sign(v[:-1]))))
        at, last = np.arange(v.size), v.size - 1
        span = 2 * motion.reach
        after, before = np.minimum(at + span, last), np.maximum(at - span, 0)
        kept &= turns[after] - turns[before] <= 1
    return np.asarray(kept)


def _passes(velocity: FloatArray, begin: int, end: int, deadband: float) -> bool:
    """Whether samples ``begin`` to ``end`` are on the way from one direction to the other."""
    if begin < 1 or end + 1 > velocity.size:
        return False
    before, after = float(velocity[begin - 1]), float(velocity[min(end, velocity.size - 1)])
    if before * after >= 0.0:
        return False
    # as many samples as a straight line through the neighbours of the deadband would need
    run = end - begin
    slope = abs(after - before) / (run + 1)
    edge = [abs(velocity[begin - 1] - velocity[max(begin - 2, 0)]),
            abs(velocity[min(end + 1, velocity.size - 1)] - after)]  # fmt: skip
    return bool(run <= 1 or _LINGER * slope >= 0.5 * (edge[0] + edge[1]))


def _motion_role(variant: Variant) -> str:
    return variant.name.removesuffix(_PRESSURES)


def _pressure_force(experiment: Experiment, options: _Options) -> FloatArray | float:
    """Force of the chambers, ``A_1 p_1 - A_2 p_2`` [N]."""
    out: FloatArray | float = 0.0
    for role, area, sign in (("pressure", options.area, 1.0), ("pressure_2", options.area_2, -1.0)):
        if area is not None and role in experiment:
            out = out + sign * area * experiment.sampled(role)
    return out


def _check_options(variant: Variant, experiments: Sequence[Experiment], options: _Options) -> None:
    """Reject options that do not fit the logs."""
    driven = variant.name.endswith(_PRESSURES)
    if driven:
        _check_chambers(experiments)
    for role, area, name, example in (
        ("pressure", options.area, "area", " (bore 25 mm: --area 4.9087e-4)"),
        ("pressure_2", options.area_2, "area-2", " (bore less rod)"),
    ):
        without = [e.name for e in experiments if role not in e]
        if area is None and len(without) < len(experiments):
            raise UsageError(
                f"there is a {role}, but no area to turn it into a force",
                remedy=f"Give --{name} M2{example}"
                + (
                    "."
                    if driven
                    else ", or leave the pressure out if the force is that of the piston rod alone."
                ),
            )
        if area is not None and without:
            raise UsageError(
                f"--{name} was given, but {without[0]} has no {role}",
                remedy=f"Give --column {role}=HEADER, or leave --{name} out.",
            )
    if driven and not options.area:
        raise UsageError("--area is zero", remedy="Give the piston area in m2.")
    untimed = [e.name for e in experiments if not e.time.size]
    for name, value in (("mass", options.mass), ("filter", options.half_width)):
        if value is not None and untimed:
            raise UsageError(
                f"--{name} needs time, and {untimed[0]} has none",
                remedy=f"Give --column time=HEADER or --sample-time S, or leave --{name} out.",
            )


def _check_chambers(experiments: Sequence[Experiment]) -> None:
    """Without a load cell, the pressures of both chambers have to be known.

    Raises
    ------
    NotIdentifiedError
        When the second one is missing.
    """
    for e in experiments:
        if "pressure_2" in e:
            continue
        raise NotIdentifiedError(
            "there is no force, and the pressure of one chamber only: friction is the difference "
            "of both chambers' forces",
            where=e.name,
            expected="Nothing was written.",
            remedy="Give the other chamber's as --column pressure_2=HEADER with --area-2 M2. If it "
            "was recorded in a repeat of the same command, put both columns into one log, or give "
            "its mean before and after a reversal at T seconds: --step pressure_2=FROM:TO@T (Pa). "
            "A chamber open to the air, gauge pressures: --step pressure_2=0:0.",
        )


def _drive(experiment: Experiment, options: _Options) -> FloatArray | None:
    """What drives the motion [N]: the force, or the first chamber's without one."""
    if "force" in experiment:
        return experiment["force"]
    if "pressure" in experiment and options.area is not None:
        return np.asarray(options.area * experiment["pressure"])
    return None


def _prepare(
    variant: Variant,
    experiments: Sequence[Experiment],
    options: _Options,
    half_width: float | None = None,
) -> tuple[list[_Data], float, float]:
    """Friction force and moving samples per log; filter half-width [s], deadband [m/s]."""
    _check_options(variant, experiments, options)
    role = _motion_role(variant)
    driven = variant.name.endswith(_PRESSURES)
    wanted = options.half_width if half_width is None else half_width
    motions, half_width = _motions(experiments, role, wanted)
    deadband = _choose_deadband(motions) if options.deadband is None else options.deadband
    out = []
    for e, motion in zip(experiments, motions):
        inertia: FloatArray | float = 0.0
        kept = _moving(motion, deadband)
        if options.mass is not None and motion.acceleration is not None:
            inertia = options.mass * motion.acceleration
        pressure = _pressure_force(e, options)
        drive = _drive(e, options)
        if driven:
            assert options.area is not None
            pressure = options.area * e.sampled("pressure") - pressure  # that of the other one
        size = motion.velocity.size
        rest = np.zeros(size) if drive is None else drive - pressure
        known = np.broadcast_to(pressure + inertia, (size,))
        scale = float(options.area or 1.0) if driven else 1.0
        matched = _match(e, role, motion, rest) - inertia
        direction = _match(e, role, motion, np.sign(motion.velocity))
        out.append(_Data(e, motion, known, rest - inertia, matched, direction, kept, scale))
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
    force = np.concatenate([d.matched[d.kept] for d in data])
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
    rows, force = [], np.concatenate([d.matched[d.kept] for d in data])
    for d in data:
        assert d.motion.acceleration is not None
        signs, regressor = d.direction[d.kept], d.motion.regressor[d.kept]
        acceleration = d.motion.acceleration[d.kept]
        rows.append(np.column_stack((1.0 + signs, 1.0 - signs, regressor, acceleration)))
    a = np.vstack(rows)
    step = min(d.experiment.sample_time for d in data)
    if np.abs(a[:, 3]).max() <= 1e-9 * np.abs(a[:, 2]).max() / step:
        return list(data), 0, []  # rounding, no acceleration
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
    """Range of the speeds of whole strokes [m/s].

    Weighted by distance, the short slow tails about a reversal weigh little and a fast
    stroke as much as a slow one: the middle 80 % of the way travelled. Slow strokes that
    take a fifth of the time are no tails, however short their way.
    """
    if speed.size < 5:
        return None
    v = np.sort(np.abs(speed))
    share = np.cumsum(v)
    low, high = np.searchsorted(share, np.array([0.1, 0.9]) * share[-1])
    low = min(int(low), v.size // 5)
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
        self.names, self.data, self.held = tuple(names), data, held
        self.limits = [limits.get(n, (-np.inf, np.inf)) for n in names]
        self.columns, self.instruments, self.right = [], [], []
        for i, d in enumerate(data):
            signs, regressor = d.direction[d.kept], d.motion.regressor[d.kept]
            self.columns.append(_columns(self.names, signs, regressor, i))
            self.instruments.append(_columns(self.names, signs, d.speed, i))
            self.right.append(d.matched[d.kept] - _held_force(held, signs, regressor, i))
        self.timed = all(d.experiment.time.size for d in data)

    def _normal(self) -> tuple[FloatArray, FloatArray]:
        """Normal equations ``Z' A x = Z' y``, common noise taken off; shapes (p, p), (p,)."""
        a, z = np.vstack(self.columns), np.vstack(self.instruments)
        matrix = z.T @ a
        if "viscous" in self.names:
            k = self.names.index("viscous")
            noise = sum(int(d.kept.sum()) * d.motion.shared**2 for d in self.data)
            own = 1.0 / max(float(_invert(z.T @ z)[k, k]), 1e-300)
            # where noise is most of it there is a warning, and no arithmetic that helps
            matrix[k, k] -= min(noise, 0.3 * own)
        return matrix, z.T @ np.concatenate(self.right)

    def jacobian(self) -> FloatArray:
        """Derivative of the unfiltered forces, shape ``(support, p)``, of all logs."""
        inverse = _invert(self._normal()[0])
        spread = [d.spread(z) for d, z in zip(self.data, self.instruments)]
        return np.vstack(_equivalent(spread, inverse))

    def solve(self) -> _Regression:
        """The estimate within the bounds, with the covariance of the free problem."""
        matrix, right = self._normal()
        inverse = _invert(matrix)
        x = inverse @ right
        free = dict(zip(self.names, x.tolist()))
        uncertainty, bare = self._uncertainty(inverse, x)
        low, high = np.array(self.limits).T
        if np.any((x < low) | (x > high)):
            z = np.vstack(self.instruments)
            scale = np.linalg.norm(z, axis=0)
            scale[scale == 0.0] = 1.0
            a = np.asarray(np.linalg.qr(z / scale, mode="r"))
            x = _bounded(a, a @ (scale * x), low * scale, high * scale) / scale
        residuals = [r - c @ x for r, c in zip(self.right, self.columns)]
        values_by_name = dict(zip(self.names, x.tolist()))
        return _Regression(values_by_name, self.names, residuals, bare, uncertainty, free)

    def _uncertainty(
        self, inverse: FloatArray, x: FloatArray
    ) -> tuple[Uncertainty, list[FloatArray]]:
        """Covariance of the free solution; a stroke is one stretch of correlated noise.

        The estimate is ``K e`` with the noise ``e`` of the unfiltered forces; ``pinv(K)`` is a
        Jacobian whose least-squares estimate is just that.
        """
        spread = [d.spread(z) for d, z in zip(self.data, self.instruments)]
        jacobian = _equivalent(spread, inverse)
        columns, residuals, bare = [], [], []
        for i, (d, j) in enumerate(zip(self.data, jacobian)):
            at = d.support
            sign, speed = np.sign(d.motion.velocity[at]), d.motion.bare[at]
            r = d.friction[at] - _held_force(self.held, sign, speed, i)
            r = r - _columns(self.names, sign, speed, i) @ x
            bare.append(r)
            cuts = _stretches(at)
            columns += [part for part in np.split(j, cuts) if part.size]
            residuals += [part for part in np.split(r, cuts) if part.size]
        found = covariance(columns, residuals, robust=self.timed, small_sample=True)
        found = self._with_hidden_colour(found, columns, x)
        matched = self._matched_uncertainty(inverse, x)
        # of very fast strokes the unfiltered velocity is not known well enough
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.diag(found.covariance) / np.diag(matched.covariance)
        return (matched if np.nanmin(ratio, initial=np.inf) > 4.0 else found), bare

    def _with_hidden_colour(
        self, found: Uncertainty, columns: Sequence[FloatArray], x: FloatArray
    ) -> Uncertainty:
        """Enlarge by the colour of the force that white noise of a velocity hides.

        The residuals of a quiet velocity lack the noise of the readings but for the slow
        part, which alone matters to slow regressors.
        """
        if all(d.motion.shared > 0.0 for d in self.data):
            return found
        residuals = []
        for i, d in enumerate(self.data):
            at = d.support
            sign, speed = np.sign(d.motion.velocity[at]), d.motion.sharp[at]
            r = d.friction[at] - _held_force(self.held, sign, speed, i)
            r = r - _columns(self.names, sign, speed, i) @ x
            residuals += [part for part in np.split(r, _stretches(at)) if part.size]
        quiet = covariance(columns, residuals, robust=self.timed, small_sample=True)
        before, now = np.diag(found.covariance), np.diag(quiet.covariance)
        if not np.any(now > before):
            return found
        larger = enlarge(found.covariance, now)
        return replace(
            found,
            covariance=larger,
            degrees=min(found.degrees, quiet.degrees),
            order=max(found.order, quiet.order),
        )

    def _matched_uncertainty(self, inverse: FloatArray, x: FloatArray) -> Uncertainty:
        """Covariance from the residuals of the filtered forces and their own colour."""
        columns, residuals = [], []
        jacobian = _equivalent(self.instruments, inverse)
        for d, j, c, y in zip(self.data, jacobian, self.columns, self.right):
            cuts = _stretches(d.kept)
            columns += [part for part in np.split(j, cuts) if part.size]
            residuals += [part for part in np.split(y - c @ x, cuts) if part.size]
        return covariance(columns, residuals, robust=self.timed, small_sample=True)


def _equivalent(instruments: Sequence[FloatArray], inverse: FloatArray) -> list[FloatArray]:
    """Jacobians whose least-squares estimate has the gains ``Z inverse'``, per log."""
    gains = np.vstack(instruments) @ inverse.T
    size = np.linalg.norm(gains, axis=0)
    size[size == 0.0] = 1.0
    gains = gains / size
    jacobian = gains @ np.linalg.pinv(gains.T @ gains) / size
    return np.split(jacobian, np.cumsum([z.shape[0] for z in instruments])[:-1])


def _invert(matrix: FloatArray) -> FloatArray:
    """Inverse of a matrix of unknowns in any units."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.pinv(matrix / np.outer(scale, scale)) / np.outer(scale, scale))


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


def _column(name: str, sign: FloatArray, speed: FloatArray, index: int) -> FloatArray:
    """What multiplies an unknown, shape ``(n,)``; ``sign`` is the (smoothed) direction."""
    if name == "coulomb_positive":
        return np.asarray(0.5 * (1.0 + sign))
    if name == "coulomb_negative":
        return np.asarray(-0.5 * (1.0 - sign))
    if name == "coulomb_mean":
        return sign
    if name == "viscous":
        return speed
    return np.full(speed.size, 1.0 if name in ("offset", f"offset[{index}]") else 0.0)


def _columns(names: Sequence[str], sign: FloatArray, speed: FloatArray, index: int) -> FloatArray:
    return np.column_stack([_column(n, sign, speed, index) for n in names])


def _held_force(
    held: Mapping[str, float], sign: FloatArray, speed: FloatArray, index: int
) -> FloatArray:
    """Force of what is not estimated, shape ``(n,)`` [N]."""
    out = np.zeros(speed.size)
    for name, value in held.items():
        out += value * _column(name, sign, speed, index)
    return out


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
                self._refuse_direction(s)
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

    def _refuse(self, name: str, reason: str, remedy: str) -> None:
        self.refused[name] = reason
        self.notices.append(refuse(replace(self.specs[name], remedy=remedy), reason))

    def _refuse_direction(self, side: str) -> None:
        """Refuse the level of a direction without motion; the other one's speeds show how."""
        other = next(s for s in _SIDES if s != side)
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
            f"at {_SECOND_SPEED * high:.2g} m/s or faster, or {low / _SECOND_SPEED:.2g} m/s or "
            f"slower, in the {s} direction"
            for s, (low, high) in self.ranges.items()
        )
        self._refuse(
            "viscous",
            reason + " The Coulomb levels hold all friction at that speed.",
            f"Add one stroke, or one log, at a speed {_SECOND_SPEED:g} times another: {wanted}.",
        )

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
    bare = zip(fit.data, fit.found.bare_residuals)
    r = np.concatenate([r[d.kept[d.support]] for d, r in bare])
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
    """Warn where viscous friction hinges on the noise of the velocity that was taken off."""
    if "viscous" not in fit.found.names:
        return []
    within = np.concatenate(
        [v - v.mean() for s in fit.moved if (v := _side_speeds(fit.data, s)).size]
    )
    shared = max(d.motion.shared for d in fit.data)
    share = shared**2 / max(float(np.mean(within**2)), 1e-300)
    if share <= 0.05:
        return []
    message = (
        f"{100 * share:.0f} % of the variance of the speed is noise. It would make viscous "
        "friction too small by as much and was taken off, but its size is known from the log "
        "only. Give a longer --filter, or a better velocity."
    )
    return [Notice("velocity-noise", message)]


def _side_speeds(data: Sequence[_Data], side: str) -> FloatArray:
    return np.concatenate([d.speed[d.side(side)] for d in data])


def _flattening(
    fit: _Fit, variant: Variant, experiments: Sequence[Experiment], half_width: float
) -> list[Notice]:
    """Warn where a filter of twice the width gives another viscous friction.

    A measured velocity enters the regression unfiltered, and nothing can flatten it. From a
    position both sides are filtered alike; what is left is motion too fast for its own
    samples. The two estimates share their noise, so their difference varies as their
    variances differ.
    """
    if "viscous" not in fit.found.names or all(d.motion.reach == 0 for d in fit.data):
        return []
    try:
        wider, _, _ = _prepare(variant, experiments, fit.options, 2.0 * half_width)
        both = [replace(w, kept=w.kept & d.kept) for w, d in zip(wider, fit.data)]
        if any(2 * w.kept.sum() < d.kept.sum() for w, d in zip(both, fit.data)):
            return []
        again = _System(both, fit.found.names, fit.fixed, fit.limits).solve()
    except LogError:
        return []
    first, second = (f.std_error({"viscous": 1.0}) for f in (fit.found, again))
    error = max(np.sqrt(max(second**2 - first**2, 0.0)), 0.5 * first)
    change = again.free_values["viscous"] - fit.found.free_values["viscous"]
    if abs(change) <= 3.0 * error + 1e-3 * abs(fit.found.free_values["viscous"]):
        return []
    message = (
        f"viscous friction changes by {change:+.3g} N s/m when the velocity filter is twice as "
        f"wide (half-width {half_width:.3g} s): the motion is too fast for these samples, or "
        "friction is no straight line. Sample faster, move more slowly, or give a measured "
        "velocity; --filter sets the half-width."
    )
    return [Notice("velocity-flattened", message)]


def _variant(motion: str, unit: str, time_required: bool, pressures: bool = False) -> Variant:
    """Roles and parameters with velocity or position as the motion, by force or pressures."""
    force = Role(
        "force", "N", "force that drives the motion, positive along positive velocity", output=True
    )
    drive = (
        Role("pressure", "Pa", "pressure that drives positive motion (with --area)", output=True)
        if pressures
        else Role("pressure", "Pa", "pressure whose force is no friction", required=False)
    )
    # with a hold, --step can stand for a pressure of which only the levels are known
    other = Role("pressure_2", "Pa", "pressure of the other chamber", required=False, hold="foh")
    return Variant(
        motion + _PRESSURES if pressures else motion,
        (
            Role("time", "s", "time of each sample", required=time_required),
            *(() if pressures else (force,)),
            Role(motion, unit, f"{motion} of the piston"),
            drive,
            other,
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
        "force - (area * pressure - area_2 * pressure_2) - mass * acceleration = "
        "coulomb_positive [v > 0] - coulomb_negative [v < 0] + viscous * v; without a force, "
        "area * pressure - area_2 * pressure_2 drives"
    )
    variants = (
        _variant("velocity", "m/s", False),
        _variant("position", "m", True),
        _variant("velocity", "m/s", False, pressures=True),
        _variant("position", "m", True, pressures=True),
    )
    options = (
        Option("area", "float", "piston area that the pressure acts on", unit="m2", minimum=0.0),
        Option("area-2", "float", "area that pressure_2 acts on", unit="m2", minimum=0.0),
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
        _check_measured(data)
        accelerating = 0
        notices: list[Notice] = []
        if options.mass is None:
            data, accelerating, notices = _leave_out_accelerations(data)
        fit = _Fit(variant, data, request, options)
        notices += [*fit.notices, *_spikes(fit), *_disagreement(fit), *_attenuation(fit)]
        notices += _flattening(fit, variant, experiments, half_width)
        ends = int(sum(d.kept.sum() for d in data) - sum(d.kept.sum() for d in fit.data))
        data = fit.data
        order, matrix = fit.covariance()
        p = scalars({n: q.value for n, q in fit.quantities().items()})
        simulated = [_predict(d, p, fit.log_offset(i), deadband) for i, d in enumerate(data)]
        measured = [np.where(d.kept, d.experiment[variant.output.name], np.nan) for d in data]
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
        driven = _drive(experiment, chosen) is not None
        if driven and symmetric and both and chosen.offset != "none":
            rest = d.friction[d.kept] - friction_force(d.motion.sharp[d.kept], **p)
            offset = 0.5 * float(sum(np.mean(rest[d.side(s)]) for s in _SIDES))
        return _predict(d, p, offset, deadband)

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """What a motion would tell; see :meth:`Family.information`.

        The rows are those of the force before any filter, at the samples that a fit would
        keep. Without the mass they are those of steady speed.
        """
        chosen = _Options.read(options)
        moved = next(v for v in self.variants if v.name == _motion_role(variant))
        chosen = replace(chosen, area=None, area_2=None)
        (d,), _, _ = _prepare(moved, [experiment], chosen)
        slope = d.motion.acceleration
        if chosen.mass is None and slope is not None:
            d = replace(d, kept=d.kept & (np.abs(slope) <= 0.01 * float(np.abs(slope).max())))
        names = ("viscous", *_LEVELS)
        rows = np.zeros((d.kept.size, len(names)))
        if d.kept.any():
            rows[d.support] = _System([d], names, {}, {}).jacobian()
        predicted = friction_force(d.motion.sharp, **scalars(parameters))
        return Information(names, rows, predicted)

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
        v = np.concatenate([d.motion.sharp for d in data])
        model = friction_force(v, **p)
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        # slow samples are predicted without friction: only what is fitted has its own offset
        friction = np.concatenate([d.friction for d in data])
        drive = np.concatenate([d.known + d.friction for d in data])
        predicted = [d.scale * y for d, y in zip(data, estimate.simulated)]
        rest = drive - np.concatenate(predicted)
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
    """Output that the model predicts at every sample; no friction within the deadband."""
    v = np.where(np.abs(d.motion.velocity) > deadband, d.motion.sharp, 0.0)
    return np.asarray((d.known + friction_force(v, **p) + offset) / d.scale)


def _check_measured(data: Sequence[_Data]) -> None:
    """Refuse a force that never changes while the piston moves.

    Raises
    ------
    LogError
        When all moving samples hold one and the same value.
    """
    force = np.concatenate([d.friction[d.kept] for d in data])
    span = float(np.ptp(force))
    if span > 1e-12 * float(np.abs(force).max()):
        return
    raise LogError(
        f"the force is {force[0]:g} N in all {force.size} moving samples: no sensor reads so",
        where=", ".join(d.experiment.name for d in data),
        expected="A measured force, with strokes in both directions. Nothing was written.",
        remedy="Check --column of the force and the load cell.",
    )


def _instrument(data: Sequence[_Data]) -> str:
    """What stands in for the velocity in ``Z' (F - A x) = 0``."""
    if any(d.motion.reach > 0 for d in data):
        return "slope of the position"
    shared = any(d.motion.shared > 0.0 for d in data)
    return "the velocity itself" if shared else "velocity of the neighbouring samples"


def _details(
    fit: _Fit, half_width: float, deadband: float, counts: Mapping[str, int]
) -> dict[str, Any]:
    """What was done, for the file."""
    order = fit.found.uncertainty.order
    matched = any(d.motion.reach > 0 for d in fit.data)
    out: dict[str, Any] = {
        "method": "linear regression on moving samples",
        "instrument": _instrument(fit.data),
        "velocity_filter": {
            "type": "zero-phase local polynomial" if half_width > 0.0 else "none",
            "half_width": half_width,
            "degree": _DEGREE,
        },
        "force_filter": "matched to the velocity filter" if matched else "none",
        "deadband": deadband,
        "left_out": dict(counts),
        "force_noise": fit.found.uncertainty.sigma,
        "speeds": {s: [low, high] for s, (low, high) in fit.ranges.items()},
        "covariance": f"autoregressive residuals of order {order}" if order else "white",
    }
    if fit.symmetric:
        out["force_offsets"] = [fit.log_offset(i) for i in range(len(fit.data))]
    return out
