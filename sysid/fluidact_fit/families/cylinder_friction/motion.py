"""Motion of a log: velocity, instrument and acceleration, and the length of the filter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import islice

import numpy as np

from ...errors import LogError, UsageError
from ...estimation.noise import white_noise
from ...experiment import BoolArray, Experiment, FloatArray
from ...signals import polynomial_taps
from .axis import is_place
from .filters import (
    DEGREE,
    FIVE_POINTS,
    central_difference,
    differentiate,
    fill,
    filtered,
    matched_kernel,
    sharpener,
)

_HALF_WIDTHS = (2, 4, 8, 16, 32, 64, 128)
_QUIET = 0.003  # noise of the filtered speed, as a share of the highest, that is small enough
SLOW = 0.05  # share of the highest speed below which friction is not that of motion
_EXPLAINED = 1.2  # times its noise that an acceleration may change when filtered for longer
_LOCAL = 4  # windows that are compared: from an eighth of the filter, or the shortest
_FLATTENED = 0.8  # of the highest speed, left by a filter that is too long for the strokes


@dataclass(frozen=True)
class FilteredMotion:
    """Motion of one log: arrays of shape ``(n,)``, velocities and noise in m/s or rad/s.

    Attributes
    ----------
    experiment, role
        The run, and the signal of its motion.
    velocity
        Filtered; it gives the direction of a sample, and whether it moves.
    instrument
        That of the regression: where a velocity was measured, filtered without each sample's own
        reading.
    regressor
        Velocity that belongs to the matched force: the measured one, or the filtered slope of a
        position.
    sharp
        Velocity for predictions, with little noise and hardly flattened: a measured velocity
        smoothed, or the slope of a position by windows that end at corners.
    inside
        Mask of the samples whose filter window lies within the record.
    noise, raw
        Standard deviations of the noise of ``velocity``, and of the speed that multiplies the
        Stribeck level: the readings, or ``sharp``.
    half
        Half-width of the filter in samples; 0 for none.
    kernel
        Weights that smooth the force to match the regressor.
    exact
        Whether the motion was given as a step, without noise.
    """

    experiment: Experiment
    role: str
    velocity: FloatArray
    instrument: FloatArray
    regressor: FloatArray
    sharp: FloatArray
    inside: BoolArray
    noise: float
    raw: float
    half: int = 0
    kernel: FloatArray = field(default_factory=lambda: np.ones(1))
    exact: bool = False

    def is_that_of(self, experiment: Experiment, half: int) -> bool:
        """Return whether a run has the same readings of the motion and its filter this length."""
        same = self.experiment[self.role] is experiment[self.role]
        return same and self.experiment.time is experiment.time and half == self.half

    def speed_at(self, share: float) -> float:
        """Quantile of the speed [m/s]."""
        return float(np.quantile(np.abs(self.velocity[self.inside]), share))

    @property
    def fast(self) -> float:
        """Highest speed but for 2 % [m/s]."""
        return self.speed_at(0.98)

    @property
    def reach(self) -> int:
        """Samples on either side that the matched force depends on."""
        return self.kernel.size // 2

    @cached_property
    def turns(self) -> FloatArray:
        """Largest second difference of the velocity within reach of a sample, ``(n,)`` [m/s].

        Where it is that of a corner, the acceleration changed between two readings, and with it
        the force, at an instant that they do not show.
        """
        from scipy.ndimage import maximum_filter1d

        corner = np.pad(np.abs(np.diff(self.sharp, 2)), 1)[: self.sharp.size]
        return np.asarray(maximum_filter1d(corner, 2 * max(self.reach, self.half) + 3))

    @cached_property
    def acceleration(self) -> FloatArray:
        """Derivative of the filtered velocity, ``(n,)`` [m/s2]; zero without time and at steps."""
        if self.exact or not self.experiment.time.size:
            return np.zeros(self.velocity.size)
        return central_difference(self.velocity if self.reach else self.sharp, self.experiment.time)

    @cached_property
    def quiet_acceleration(self) -> FloatArray:
        """Acceleration with as little noise as the motion allows, shape ``(n,)`` [m/s2].

        From the filter that the log itself needs, that of a position is made longer as long as what
        this changes is noise, and taken one step before that [1]_.

        .. [1] O. V. Lepski, "A problem of adaptive estimation in Gaussian white noise", Theory of
           Probability and its Applications 35, 1990.
        """
        if not self.reach:
            return self.acceleration
        e, half = self.experiment, self.half
        noise = self.noise / _slope_noise(e, half)
        while half > 2 and noise * _slope_noise(e, half // 2) <= _QUIET * self.fast:
            half //= 2  # the filter is one that another log needs
        before, best, left = np.zeros(0), np.zeros(0), 0.0
        for (slope, weights), _ in _slopes(e, e[self.role], half):
            longer = central_difference(slope, e.time)
            if best.size and np.mean((longer - best)[self.inside] ** 2) > _EXPLAINED * left**2:
                break
            left = noise * float(np.linalg.norm(np.convolve(weights, FIVE_POINTS)))
            left /= e.sample_time
            before, best = best if best.size else longer, longer
        return before

    def match_force(self, force: FloatArray) -> FloatArray:
        """Smooth a force as the regressor is smoothed, shape ``(n,)``.

        The slope of a position is a weighted mean of the velocity within the window; the same
        slope of the integral of the force, here of its Hermite cubics, is the same mean of it.
        """
        time = self.experiment.time
        if not self.reach:
            return force
        if self.experiment.uniform:
            return np.convolve(np.pad(force, self.reach, mode="edge"), self.kernel, "valid")
        from scipy.interpolate import CubicHermiteSpline

        cubics = CubicHermiteSpline(time, force, np.gradient(force, time))
        return differentiate(self.experiment, cubics.antiderivative()(time), self.half)[1]


def _samples(experiment: Experiment, role: str, half_width: float) -> int:
    """Samples in the half-width of a filter [s], as many as it can have."""
    least = 1 if is_place(role) else 2  # a parabola through three readings smooths nothing
    samples = round(half_width / experiment.sample_time) if experiment.sample_time else 0
    return max(least, min(samples, (experiment[role].size - 1) // 2))


def _filter(experiment: Experiment, role: str, half: int) -> FilteredMotion:
    """Motion by a zero-phase quadratic over ``half`` samples on either side.

    The slope of a position is regressor and instrument at once. Of a velocity the readings are the
    regressor, and their neighbours the instrument. A step was not recorded, and is taken as it is.
    """
    y, motion = experiment[role], partial(FilteredMotion, experiment, role)
    everywhere = np.ones(experiment.samples, dtype=bool)
    if y.size != experiment.samples:
        if is_place(role):
            raise UsageError(
                f"steps of the {role} cannot be simulated: the velocity is infinite at a step and "
                "zero at all other times, and friction follows the velocity",
                where=experiment.name,
                remedy=f"Give a LOG with a recorded {role} (what drives it need not be in it).",
            )
        v = experiment.sampled(role)
        return motion(v, v, v, v, everywhere, 0.0, 0.0, exact=True)
    step = experiment.signals[role].resolution
    if np.ptp(y) < 20.0 * step:
        step = 0.0  # a handful of exact levels, as in a table of plateaus
    noise = max(white_noise(y, experiment.uneven), float(step / np.sqrt(12.0)))
    if not experiment.time.size:
        return motion(y, y, y, y, everywhere, noise, noise)
    value, rate, inside = differentiate(experiment, y, half)
    if not inside.any():
        raise LogError(
            f"no stretch of {2 * half + 1} samples without a gap is left to differentiate",
            where=experiment.name,
            remedy="Give a shorter --filter, or a longer log.",
        )
    if is_place(role):
        v, kernel = fill(rate, inside), matched_kernel(half, 1)
        far = np.convolve(~inside, np.ones(kernel.size), "same") < 0.5
        inside = far if far.any() else inside
        quiet = noise * _slope_noise(experiment, half)
        return motion(v, v, v, v, inside, quiet, quiet, half, kernel)
    kernel, v = matched_kernel(half, 0), fill(value, inside)
    others = np.where(inside, (v - kernel[half] * y) / (1.0 - kernel[half]), v)
    quiet = noise * float(np.linalg.norm(kernel))
    return motion(v, others, y, filtered(v, sharpener(kernel)), inside, quiet, noise, half)


def _slopes(
    experiment: Experiment, place: FloatArray, half: int
) -> Iterator[tuple[tuple[FloatArray, FloatArray], ...]]:
    """Yield slopes by ever longer windows, from a half-width on to an eighth of the record.

    Two by each: with the loss by its filter restored to first order, and as they are. Each comes
    with its weights, by which noise of the place goes into it: ``(n,)`` [m/s] and ``(m,)`` [1/s].
    """
    _, rate, inside = differentiate(experiment, place, half)
    while inside.any():
        taps = polynomial_taps(half, DEGREE)[1] / experiment.sample_time
        rate, sharp = fill(rate, inside), sharpener(matched_kernel(half, 1))
        yield (filtered(rate, sharp), np.convolve(taps, sharp)), (rate, taps)
        half *= 2
        if 16 * half > place.size:
            return
        _, rate, inside = differentiate(experiment, place, half)


def _with_local_slope(motion: FilteredMotion) -> FilteredMotion:
    """Give the motion of a place the slope by the longest window that all shorter ones agree with.

    A window that reaches over a corner of the velocity disagrees with them [1]_. Windows as they
    are end close to a corner; those whose loss is restored are longer where the motion is smooth.

    References
    ----------
    .. [1] A. Goldenshluger, A. Nemirovski, "On spatially adaptive estimation of nonparametric
       regression", Mathematical Methods of Statistics 6, 1997.
    """
    if not motion.reach:
        return motion
    experiment, half = motion.experiment, motion.half
    noise = motion.noise / _slope_noise(experiment, half)
    n = experiment.samples
    far = float(np.sqrt(2.0 * np.log(n)))  # of so many normal variables hardly any is
    lengths, (best, errors) = np.zeros((2, n), dtype=int), np.zeros((2, 2, n))
    low, high = np.full((2, 2, n), np.inf) * np.array([-1.0, 1.0])[:, None, None]
    windows = _slopes(experiment, experiment[motion.role], max(half // 8, min(half, 2)))
    for k, pair in enumerate(islice(windows, _LOCAL)):
        slopes = np.array([slope for slope, _ in pair])
        error = noise * np.array([[np.linalg.norm(weights)] for _, weights in pair])
        low, high = np.maximum(low, slopes - far * error), np.minimum(high, slopes + far * error)
        agree = (lengths == k) & (low <= high)
        best, errors = np.where(agree, slopes, best), np.where(agree, error, errors)
        lengths += agree
    row = (lengths[1] > lengths[0]).astype(int)[None]
    sharp, errors = (np.take_along_axis(x, row, axis=0)[0] for x in (best, errors))
    return replace(motion, sharp=sharp, raw=float(np.sqrt(np.mean(errors**2))))


def _slope_noise(experiment: Experiment, half: int) -> float:
    """Standard deviation of a filtered slope, per that of the place [1/s]."""
    return float(np.linalg.norm(polynomial_taps(half, DEGREE)[1])) / experiment.sample_time


def _flattens(before: FilteredMotion, now: FilteredMotion) -> bool:
    """Return whether a longer filter removes much of the highest speed, and not just its noise.

    Noise alone raises the highest speed by up to two of its standard deviations.
    """
    quiet = before.noise <= 0.2 * before.fast
    return quiet and now.fast < _FLATTENED * (before.fast - 2.0 * before.noise)


def _choose_slope(experiments: Sequence[Experiment], role: str) -> float:
    """Half-width for positions: quiet enough, and not too long for any of the strokes [s]."""
    chosen = []
    for e in experiments:
        tried: list[FilteredMotion] = []
        for half in _HALF_WIDTHS:
            motion = _filter(e, role, _samples(e, role, half * e.sample_time))
            if tried and _flattens(tried[-1], motion):
                break
            tried.append(motion)
            if motion.noise <= _QUIET * motion.fast or 16 * half >= e.samples:
                break
        chosen.append(tried[-1])
    widths = [m.half * e.sample_time for e, m in zip(experiments, chosen)]
    longest = max(widths)
    # a filter that a slow log needs may flatten a fast one
    for e, m, own in zip(experiments, chosen, widths):
        while longest > 1.5 * own and _flattens(m, _filter(e, role, _samples(e, role, longest))):
            longest *= 0.5
    return longest


def _choose_smoothing(experiments: Sequence[Experiment], role: str) -> float:
    """Half-width for velocities: least error of noise and flattening [s].

    ``mean((y - K y)^2) + 2 k_0 s^2`` is that error but for a constant (Mallows 1973); ``K``
    smooths, ``k_0`` is each reading's share in itself, by which the variance of the noise goes
    into ``K y``, and ``s`` the noise of the readings.
    """
    step, samples = min(e.sample_time for e in experiments), min(e.samples for e in experiments)
    best, chosen = np.inf, _HALF_WIDTHS[0]
    for half in _HALF_WIDTHS:
        if half > _HALF_WIDTHS[0] and 16 * half >= samples:
            break
        error = 0.0
        for e in experiments:
            m = _filter(e, role, _samples(e, role, half * step))
            rest = (m.regressor - m.velocity)[m.inside]
            error += float(rest @ rest) + 2.0 * rest.size * m.noise**2
        if error > best:
            break
        best, chosen = error, half
    return chosen * step


def make_motions(
    experiments: Sequence[Experiment],
    role: str,
    half_width: float | None,
    known: Sequence[FilteredMotion] = (),
) -> tuple[list[FilteredMotion], float]:
    """Motion of every log, and the half-width of the filter of all of them [s].

    It is chosen where none is given, and 0 without time. Motions that are ``known`` already are
    not made again.
    """
    measured = [e for e in experiments if e.time.size and e[role].size == e.samples]
    if half_width is None and measured:
        half_width = (_choose_slope if is_place(role) else _choose_smoothing)(measured, role)
    half_width, motions = half_width or 0.0, []
    for e in experiments:
        half = _samples(e, role, half_width)
        same = (m for m in known if m.is_that_of(e, half))
        motions.append(next(same, None) or _with_local_slope(_filter(e, role, half)))
    return motions, half_width
