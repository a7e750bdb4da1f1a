"""Errors of a position's readings: taken away without rounding its reversals, or allowed for.

Parabolas over windows of equal width: about each sample or, where others that hold it fit far
better, before or after it [1]_. What the smoothing leaves of the noise is seen by drawing it anew.

References
----------
.. [1] A. Harten, S. Osher, "Uniformly high-order accurate nonoscillatory schemes I", SIAM Journal
   on Numerical Analysis 24(2), 1987: stencils that do not cross a kink.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..experiment import FloatArray
from ..rows import blocks
from .noise import common_step, white_noise
from .parametric import Fitted

_WINDOWS = (6, 12, 24)  # samples on either side that are tried
_UNLIKE_WHITE = 1.4  # times the white noise that the narrowest windows leave: codes are not white
_AS_NOISY = 1.1  # times what narrower windows leave, up to which wider ones miss no motion
_MISSED = 5.0  # times what windows leave, by which a smooth curve misses a reading at most
_DRAWS = 12  # of the errors of a record
_COUNTS = 0.1  # of a variance, from which on a profile of the cost says too little
_CODES = 3.0  # steps of a converter that a motion goes at once, unless it was commanded in them


def smooth_sharply(values: FloatArray, half: int | None) -> FloatArray:
    """Smooth over ``half`` samples on either side, shape ``(n,)``; nothing for ``None``."""
    if not half or values.size < 4 * half:
        return values
    return _smoothed(values, half)[0]


def choose_smoothing(records: Sequence[FloatArray]) -> int | None:
    """Widest windows in which parabolas leave of every record nothing but its noise."""
    chosen, least, limit = None, [white_noise(x) for x in records], _UNLIKE_WHITE
    for half in _WINDOWS:
        if not any(least) or any(x.size < 4 * half for x in records):
            break
        found = [_smoothed(x, half) for x in records]
        if any(
            rest > limit * before or np.abs(x - smooth).max() > _MISSED * rest
            for x, before, (smooth, rest) in zip(records, least, found)
        ):
            break
        chosen, least, limit = half, [rest for _, rest in found], _AS_NOISY
    return chosen


def _smoothed(values: FloatArray, half: int) -> tuple[FloatArray, float]:
    """The smoothed record, and the median of what the windows leave that were taken."""
    width = 2 * half + 1
    powers = np.vander(np.arange(-half, half + 1), 3, increasing=True).astype(float)
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    inverse, found = np.linalg.pinv(powers).T, np.empty((windows.shape[0], 3))
    rest = np.empty(windows.shape[0])
    for at in blocks(windows.shape[0]):
        found[at] = windows[at] @ inverse
        rest[at] = np.sum((windows[at] - found[at] @ powers.T) ** 2, axis=1)
    rest = np.sqrt(rest / (width - 3))
    now = np.arange(values.size)
    middle = np.clip(now, half, values.size - 1 - half)
    # chance makes windows differ: only what is far better is worth the ends of a parabola
    least = rest[middle - half] * (1.0 + 6.0 / np.sqrt(width)) ** -0.5
    for shift in (half // 2, -(half // 2), half, -half):
        other = np.clip(now + shift, half, values.size - 1 - half)
        better = rest[other - half] < least
        middle = np.where(better, other, middle)
        least = np.where(better, rest[other - half], least)
    c, away = found[middle - half], now - middle
    smooth = c[:, 0] + away * (c[:, 1] + away * c[:, 2])
    return smooth, float(np.median(rest[middle - half]))


@dataclass(frozen=True)
class ReadingErrors:
    """White ``noise`` and ``step`` of the codes that ``readings``, shape ``(n,)``, show."""

    readings: FloatArray
    noise: float
    step: float

    @classmethod
    def of(cls, readings: FloatArray) -> ReadingErrors:
        """Errors of a record; a motion that was commanded in equal steps has none."""
        steps = np.diff(readings)
        steps = np.abs(steps[steps != 0.0])
        step, noise = common_step(steps), white_noise(readings)
        coded = steps.size and step > noise and np.median(steps) >= _CODES * step
        return cls(readings, noise, step if coded else 0.0)

    def draw(self, smooth: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Other readings of a smooth motion, shape ``(n,)``."""
        if not self.step:
            return smooth + self.noise * rng.standard_normal(smooth.size)
        # strokes of one speed meet codes in a pattern: all samples of one share the error of that
        stroke = (np.gradient(smooth) > 0.0).astype(int)
        if not self.noise:
            return smooth + self.step * rng.uniform(-0.5, 0.5, 2)[stroke]
        if smooth is self.readings:  # other codes of codes would be the same
            return smooth + self.step * rng.uniform(-0.5, 0.5, smooth.size)
        begin = self.step * rng.uniform(0.0, 1.0, 2)[stroke]
        return np.asarray(np.round((smooth - begin) / self.step) * self.step + begin)


def allow_for_readings(
    fitted: Fitted, change: Callable[[np.random.Generator], Sequence[FloatArray]]
) -> tuple[Fitted, dict[str, float]]:
    """Add to a covariance what errors of an input's readings do, beyond what residuals show.

    Parameters
    ----------
    change
        How the output of every run changes with errors that are drawn anew, shape ``(n,)`` each,
        unknowns of single runs projected out.

    Returns
    -------
    The fit, and by how much its estimates are shifted in the mean, by name; intervals that were
    profiled are dropped where the errors count.
    """
    if not fitted.names:
        return fitted, {}
    rng, table = np.random.default_rng(0), np.vstack(fitted.sensitivity())
    # a model that lies higher by so much has estimates that make up for it
    moved = -np.array([
        np.linalg.lstsq(table, np.concatenate(change(rng)), rcond=None)[0] for _ in range(_DRAWS)
    ])  # fmt: skip
    spread = np.atleast_2d(np.cov(moved.T))
    total = fitted.covariance + spread
    counts = bool(np.any(np.diag(spread) > _COUNTS * np.diag(total)))
    out = replace(
        fitted, covariance=total, intervals={} if counts else fitted.intervals
    )  # fmt: skip
    return out, dict(zip(fitted.names, moved.mean(axis=0).tolist()))
