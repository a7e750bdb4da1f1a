"""Noise of a sampled signal that carries motion as well: one estimator for everybody.

Differences of a high order take away what moves smoothly and leave white noise, amplified by
``sqrt(C(2 q, q))`` for the order ``q``. A low order leaves motion in, a high one needs longer
records and takes a jump in more samples; 3 removes parabolas and is the usual choice. The
median of the absolute differences does not see jumps and spikes, the mean square sees all.
"""

from __future__ import annotations

from math import comb, sqrt

import numpy as np

from ..experiment import FloatArray

_NORMAL = 1.4826  # standard deviation of a normal variable per median of its absolute value


def noise_floor(values: FloatArray, order: int = 3, *, robust: bool = True) -> float:
    """Standard deviation of the white part of an evenly sampled signal.

    Parameters
    ----------
    values : (n,)
        [any unit]
    order
        Of the differences.
    robust
        From the median of the absolute differences, which jumps and spikes leave as it is;
        else from their mean square, which sees steps of a converter that mostly rests.

    Returns
    -------
    float
        [unit of the values]; 0 where the record is shorter than four times the order.
    """
    if values.size < 4 * order:
        return 0.0
    differences = np.diff(values, order)
    gain = sqrt(comb(2 * order, order))
    if robust:
        return _NORMAL * float(np.median(np.abs(differences))) / gain
    return sqrt(float(np.mean(differences**2))) / gain
