"""Noise of a sampled signal that also contains motion: one estimator for all families.

Differences of a high order take away what moves smoothly and leave white noise, amplified by
``sqrt(C(2 q, q))`` for the order ``q``. A low order leaves motion in, a high one needs longer
records and spreads a jump over more samples; 3 removes parabolas and is the usual choice. The
median of the absolute differences ignores jumps and spikes, the mean square includes them.
"""

from __future__ import annotations

from math import comb, sqrt

import numpy as np

from ..experiment import FloatArray

_ORDERS = (3, 5, 7)  # of the differences of a column that may be exact
_EXACT = 1e-6  # share of its range that is rounding
PER_MEDIAN = 1.4826  # standard deviation of a normal variable per median of its absolute value


def noise_floor(
    values: FloatArray, order: int = 3, *, robust: bool = True, time: FloatArray | None = None
) -> float:
    """Standard deviation of the white part of a sampled signal.

    Parameters
    ----------
    values : (n,)
        [any unit]
    order
        Of the differences.
    robust
        From the median of the absolute differences, which jumps and spikes leave as it is;
        else from their mean square, which includes the steps of a converter that mostly rests.
    time : (n,)
        Instants where they are not evenly spaced, for divided differences [any unit].

    Returns
    -------
    float
        [unit of the values]; 0 where the record is shorter than four times the order.
    """
    if values.size < 4 * order:
        return 0.0
    if time is not None:
        white = _divided_differences(values, time, order)
    else:
        white = np.diff(values, order) / sqrt(comb(2 * order, order))
    if not robust:
        return sqrt(float(white @ white) / white.size)
    return PER_MEDIAN * float(np.median(np.abs(white), overwrite_input=True))


def _divided_differences(values: FloatArray, time: FloatArray, order: int) -> FloatArray:
    """Divided differences, scaled so that white noise keeps its size; shape ``(n - order,)``."""
    n = values.size - order
    t = np.stack([time[k : n + k] for k in range(order + 1)])
    t = (t - t[0]) / max(float(np.median(t[order] - t[0])), 1e-300)
    weights = np.stack(
        [1.0 / np.prod(t[k] - np.delete(t, k, axis=0), axis=0) for k in range(order + 1)]
    )
    weights /= np.sqrt(np.sum(weights**2, axis=0))
    samples = np.stack([values[k : n + k] for k in range(order + 1)])
    return np.asarray(np.sum(weights * samples, axis=0))


def white_noise(values: FloatArray, time: FloatArray | None = None) -> float:
    """Standard deviation of the white noise of a column ``(n,)``, 0 where it is exact [its unit].

    Whatever shrinks with the order of the differences is motion, not noise; ``time`` as in
    :func:`noise_floor`.
    """
    sigma = min(noise_floor(values, order, time=time) for order in _ORDERS)
    return sigma if sigma > _EXACT * float(np.ptp(values)) else 0.0


def white_level(values: FloatArray, resolution: float = 0.0) -> tuple[float, float]:
    """Standard deviation of white noise on a moving signal, and its accuracy.

    The order of the differences is raised as long as that lowers the result, since what a higher
    order removes was motion. Where jumps and spikes are rare, the mean square of the differences
    is taken, which is more precise. The error of an ideal converter is the lower limit.

    Parameters
    ----------
    values : (n,)
        Evenly sampled [any unit].
    resolution
        Step of the converter [unit of the values].

    Returns
    -------
    sigma
        [unit of the values]; motion that no difference takes away is in it.
    relative
        Relative standard error of ``sigma**2``.
    """
    order = 4
    sigma = noise_floor(values, order)
    while order < 10 and noise_floor(values, order + 2) < 0.85 * sigma:
        order += 2
        sigma = noise_floor(values, order)
    alike = sum(comb(2 * order, order - k) ** 2 for k in range(-order, order + 1))
    relative = sqrt(2.0 * alike / max(values.size, 1)) / comb(2 * order, order)
    plain = noise_floor(values, order, robust=False)
    if plain < 1.15 * sigma:
        return max(plain, resolution / sqrt(12.0)), relative
    return max(sigma, resolution / sqrt(12.0)), 1.65 * relative


def common_step(levels: FloatArray) -> float:
    """Largest step of which all levels ``(k,)`` are multiples, 0 where there is none.

    It may be the step of a converter where signals rest and show no steps. Euclid's algorithm, down
    to a thousandth of the largest level.
    """
    sizes = np.unique(np.abs(levels[levels != 0.0]))
    if sizes.size < 2:
        return 0.0
    least, step = 1e-3 * float(sizes[-1]), 0.0
    for size in sizes.tolist():
        a, b = size, step
        while b > least:
            a, b = b, abs(a - b * round(a / b))
        if b > 1e-3 * least:  # what is left is no rounding
            return 0.0
        step = a
    return step
