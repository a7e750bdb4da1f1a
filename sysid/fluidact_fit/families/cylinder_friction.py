"""Friction of a cylinder: two Coulomb levels and viscous friction.

    F_f = F_c+ [v > 0] - F_c- [v < 0] + b v
    F_f = F - (A_1 p_1 - A_2 p_2) - m a      with a load cell
    F_f = A_1 p_1 - A_2 p_2 - m a            without: the pressures drive

``F`` is what drives the motion, positive along positive velocity; pressure forces and the
inertia ``m a`` are taken off when the areas and the mass are given. All levels are
magnitudes. The regression sees moving samples only [1]_: near standstill friction is a
matter of presliding and stiction, and a smoothed sign would bias the levels.

Both sides of the equation go through one filter. Whatever takes a share off the velocity
of a fast stroke takes the same share off its force, so the friction is that of the
unfiltered motion; windows that touch a reversal, over which the sign is not constant, are
left out. The noise that is left in the velocity is taken off the normal equations [3]_.
The covariance is that of the noise before the filter, carried through it.

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
from ..signals import antiderivative, central_difference, matched_kernel, smooth

Mask = npt.NDArray[np.bool_]

_SIDES = ("positive", "negative")
_LEVELS = ("coulomb_positive", "coulomb_negative")
_DEGREE = 2
_HALF_WIDTHS = (2, 4, 8, 16, 32, 64, 128)
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
    """Filtered motion of one log.

    Attributes
    ----------
    velocity, acceleration : (n,)
        Filtered [m/s], and the derivative of that [m/s2]; no acceleration without time.
    bare : (n,)
        Velocity that the filter flattens (next to) nothing of: as measured, or from a
        position with the first order of what the filter took off put back [m/s].
    sharp : (n,)
        Velocity to predict with, quiet and hardly flattened [m/s].
    inside : (n,)
        Whether the filter window lies within the record.
    noise
        Standard deviation of the filtered velocity [m/s].
    half
        Half-width of the filter in samples; 0: not filtered.
    kernel : (2 m + 1,)
        What the force is smoothed with to match the velocity.
    """

    velocity: FloatArray
    acceleration: FloatArray | None
    bare: FloatArray
    sharp: FloatArray
    inside: Mask
    noise: float
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
    ``matched`` that rest smoothed like the velocity, all of shape ``(n,)`` [N]; ``kept``
    marks the samples that are fitted. The output is the drive divided by ``scale``.
    """

    experiment: Experiment
    motion: _Motion
    known: FloatArray
    friction: FloatArray
    matched: FloatArray
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
    """Value, rate and curvature of a signal, shape ``(3, n)``, and where its window is whole."""
    if experiment.uniform:
        s = smooth(values, experiment.sample_time, half, _DEGREE)
        return np.stack([s.value, s.rate, s.curvature]), s.inside
    return _local_polynomial(experiment.time, values, experiment.sample_time, half)


def _filter(experiment: Experiment, role: str, half: int) -> _Motion:
    """Velocity and acceleration by a zero-phase quadratic over ``2 half + 1`` samples."""
    signal = experiment.signals[role]
    y, step = signal.values, experiment.sample_time
    noise = _sensor_noise(y, experiment.time, signal.resolution)
    if not experiment.time.size:
        whole = np.ones(y.size, dtype=bool)
        return _Motion(y, None, y, y, whole, noise, 0, np.ones(1))
    half = max(1, min(half, (y.size - 1) // 2))
    rows, inside = _differentiate(experiment, y, half)
    if not inside.any():
        raise LogError(
            f"no stretch of {2 * half + 1} samples without a gap is left to differentiate",
            where=experiment.name,
            remedy="Give a shorter --filter, or a longer log.",
        )
    order = 1 if role == "position" else 0
    offsets = np.arange(-half, half + 1)
    taps = np.linalg.pinv(np.vander(offsets, _DEGREE + 1, increasing=True))[order]
    gain = float(np.linalg.norm(taps)) / step**order
    v = _fill(rows[order], inside)
    kernel = matched_kernel(half, order, _DEGREE)
    bare = sharp = v
    if order:
        bare = sharp = _sharpen(v, kernel)
        far = np.convolve(~inside, np.ones(kernel.size), "same") < 0.5
        inside = far if far.any() else inside
    else:
        bare = y
    slope = central_difference(v, experiment.time)
    return _Motion(v, slope, bare, sharp, inside, noise * gain, half, kernel)


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
    """Smooth a force so that the filter of the velocity shows in it as well, shape ``(n,)``.

    The slope of a position is a weighted mean of the velocity within the window; the same
    slope of the integral of the force is the same mean of the force.
    """
    if not motion.half:
        return force
    if experiment.uniform:
        padded = np.pad(force, motion.reach, mode="edge")
        return np.convolve(padded, motion.kernel, "valid")
    if role == "velocity":
        return _differentiate(experiment, force, motion.half)[0][0]
    integral = antiderivative(force, experiment.time)
    return _differentiate(experiment, integral, motion.half)[0][1]


def _flattens(before: _Motion, now: _Motion) -> bool:
    """Whether a longer filter takes away much of the highest speed, and not just its noise.

    Noise alone raises the highest speed by up to two of its standard deviations.
    """
    quiet = before.noise <= 0.2 * before.fast
    return quiet and now.fast < _FLATTENED * (before.fast - 2.0 * before.noise)


def _choose_half_width(experiment: Experiment, role: str) -> float:
    """Shortest half-width whose velocity is quiet enough, and not too long for the strokes [s]."""
    chosen, before = 1, None
    for half in _HALF_WIDTHS:
        motion = _filter(experiment, role, half)
        if before is not None and _flattens(before, motion):
            break
        chosen, before = half, motion
        if motion.noise <= _QUIET * motion.fast or 16 * half >= experiment.samples:
            break
    return chosen * experiment.sample_time


def _motions(
    experiments: Sequence[Experiment], role: str, half_width: float | None
) -> tuple[list[_Motion], float]:
    """Motion of every log through one filter, and its half-width [s]."""
    timed = [e for e in experiments if e.time.size]
    if half_width is None:
        wanted = [_choose_half_width(e, role) for e in timed]
        half_width = max(wanted, default=0.0)
        for e, own in zip(timed, wanted):  # what a slow log needs may flatten a fast one
            before = _filter(e, role, round(own / e.sample_time))
            while half_width > 1.5 * own:
                now = _filter(e, role, round(half_width / e.sample_time))
                if not _flattens(before, now):
                    break
                half_width *= 0.5
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
    h = motion.reach
    if h:
        whole = np.zeros(v.size, dtype=bool)
        if v.size > 2 * h:
            whole[h : v.size - h] = changes[2 * h :] == changes[: v.size - 2 * h]
        moving &= whole
    return np.asarray(moving)


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
            f"{e.name} has no force and the pressure of one chamber only: friction is the "
            "difference of both chambers' forces",
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
        kept = _steady(motion, deadband)
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
        out.append(_Data(e, motion, known, rest - inertia, matched, kept, scale))
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
        forward = d.side("positive")
        rows.append(np.column_stack((forward, ~forward, d.speed, d.motion.acceleration[d.kept])))
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
        self.names, self.data, self.held = tuple(names), data, held
        self.limits = [limits.get(n, (-np.inf, np.inf)) for n in names]
        self.columns = [_columns(self.names, d.speed, d.speed, i) for i, d in enumerate(data)]
        self.right = [
            d.matched[d.kept] - _held_force(held, d.speed, d.speed, i) for i, d in enumerate(data)
        ]
        self.timed = all(d.experiment.time.size for d in data)

    def _normal(self) -> tuple[FloatArray, FloatArray]:
        """Normal equations, the noise of the velocity taken off; shapes (p, p) and (p,)."""
        a, y = np.vstack(self.columns), np.concatenate(self.right)
        matrix = a.T @ a
        if "viscous" in self.names:
            k = self.names.index("viscous")
            noise = sum(int(d.kept.sum()) * d.motion.noise**2 for d in self.data)
            own = 1.0 / max(float(_invert(matrix)[k, k]), 1e-300)
            # where noise is most of it there is a warning, and no arithmetic that helps
            matrix[k, k] -= min(noise, 0.3 * own)
        return matrix, a.T @ y

    def solve(self) -> _Regression:
        """Least squares within the bounds, with the covariance of the free problem."""
        matrix, right = self._normal()
        inverse = _invert(matrix)
        x = inverse @ right
        free = dict(zip(self.names, x.tolist()))
        uncertainty, bare = self._uncertainty(inverse, x)
        low, high = np.array(self.limits).T
        if np.any((x < low) | (x > high)):
            scale = np.sqrt(np.diag(matrix))
            values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
            root = np.sqrt(np.maximum(values, 0.0))
            a = root[:, None] * vectors.T
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
        spread = [d.spread(c) for d, c in zip(self.data, self.columns)]
        gains = np.vstack(spread) @ inverse
        size = np.linalg.norm(gains, axis=0)
        size[size == 0.0] = 1.0
        gains = gains / size
        jacobian = gains @ np.linalg.pinv(gains.T @ gains) / size
        ends = np.cumsum([c.shape[0] for c in spread])[:-1]
        columns, residuals, bare = [], [], []
        for i, (d, j) in enumerate(zip(self.data, np.split(jacobian, ends))):
            at = d.support
            sign, speed = d.motion.velocity[at], d.motion.bare[at]
            r = d.friction[at] - _held_force(self.held, sign, speed, i)
            r = r - _columns(self.names, sign, speed, i) @ x
            bare.append(r)
            cuts = _stretches(at)
            columns += [part for part in np.split(j, cuts) if part.size]
            residuals += [part for part in np.split(r, cuts) if part.size]
        found = covariance(columns, residuals, robust=self.timed)
        found = _widen(found, columns, len(self.names))
        matched = self._matched_uncertainty(x)
        # of very fast strokes the unfiltered velocity is not known well enough
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.diag(found.covariance) / np.diag(matched.covariance)
        return (matched if np.nanmin(ratio, initial=np.inf) > 4.0 else found), bare

    def _matched_uncertainty(self, x: FloatArray) -> Uncertainty:
        """Covariance from the residuals of the filtered forces and their own colour."""
        columns, residuals = [], []
        for d, c, y in zip(self.data, self.columns, self.right):
            cuts = _stretches(d.kept)
            columns += [part for part in np.split(c, cuts) if part.size]
            residuals += [part for part in np.split(y - c @ x, cuts) if part.size]
        found = covariance(columns, residuals, robust=self.timed)
        return _widen(found, columns, len(self.names))


def _invert(matrix: FloatArray) -> FloatArray:
    """Inverse of a symmetric matrix of unknowns in any units."""
    scale = np.sqrt(np.diag(matrix))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.pinv(matrix / np.outer(scale, scale)) / np.outer(scale, scale))


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


def _column(name: str, sign: FloatArray, speed: FloatArray, index: int) -> FloatArray:
    """What multiplies an unknown, shape ``(n,)``; ``sign`` is that of the direction."""
    if name == "coulomb_positive":
        return np.asarray(sign > 0.0, dtype=float)
    if name == "coulomb_negative":
        return -np.asarray(sign < 0.0, dtype=float)
    if name == "coulomb_mean":
        return np.sign(sign)
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
    raise LogError(
        f"friction would be negative ({mean:.4g} N): the force left after pressure and inertia "
        "helps the motion",
        where=", ".join(d.experiment.name for d in data),
        expected="Force counts positive along positive velocity and is what drives the motion.",
        remedy="Give --scale force=-1 if the sensor counts the other way. If the force comes "
        "from one chamber's pressure, the other chamber is missing: give both as --column "
        "pressure=HEADER --area M2 --column pressure_2=HEADER --area-2 M2, without a force."
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


def _flattening(
    fit: _Fit, variant: Variant, experiments: Sequence[Experiment], half_width: float
) -> list[Notice]:
    """Warn where a filter of twice the width gives another viscous friction.

    Both sides are filtered alike; what is left is motion too fast for its own samples. The
    two estimates share their noise, so their difference varies as their variances differ.
    """
    if "viscous" not in fit.found.names or half_width <= 0.0:
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
        "force_filter": "matched to the velocity filter" if half_width > 0.0 else "none",
        "deadband": deadband,
        "left_out": dict(counts),
        "speeds": {s: [low, high] for s, (low, high) in fit.ranges.items()},
        "covariance": f"autoregressive residuals of order {order}" if order else "white",
    }
    if fit.symmetric:
        out["force_offsets"] = [fit.log_offset(i) for i in range(len(fit.data))]
    return out
