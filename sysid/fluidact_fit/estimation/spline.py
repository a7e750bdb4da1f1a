"""Cubic spline through samples.

``scipy.interpolate`` has one, but takes longer to import than a small fit takes in all.
"""

from __future__ import annotations

import numpy as np

from ..experiment import FloatArray

FEWEST = 4  # samples of a spline


def cubic_pieces(time: FloatArray, values: FloatArray) -> FloatArray:
    """Cubic spline through four samples or more, its third derivative the same beside the ends.

    With the steps ``h_i``, the slopes of the lines ``m_i`` and those of the curve ``s_i``, equal
    second derivatives at a sample say [1]_

        h_i s_(i-1) + 2 (h_(i-1) + h_i) s_i + h_(i-1) s_(i+1) = 3 (h_i m_(i-1) + h_(i-1) m_i)

    and equal third derivatives at the second one, with ``d = h_0 + h_1``,

        h_1 s_0 + d s_1 = ((h_0 + 2 d) h_1 m_0 + h_0^2 m_1) / d

    Parameters
    ----------
    time, values : (n,)
        Increasing instants [s].

    Returns
    -------
    (n - 1, 4) coefficients of rising powers of the time since the sample before.

    References
    ----------
    .. [1] C. de Boor, A Practical Guide to Splines, 1978, chapter IV.
    """
    from scipy.linalg.lapack import dgtsv

    h = np.diff(time)
    m = np.diff(values) / h
    first, last = h[0] + h[1], h[-1] + h[-2]
    lower = np.append(h[1:], last)
    upper = np.append(first, h[:-1])
    middle, right = np.empty(time.size), np.empty(time.size)
    middle[1:-1] = 2.0 * (h[:-1] + h[1:])
    right[1:-1] = 3.0 * (h[1:] * m[:-1] + h[:-1] * m[1:])
    middle[0], middle[-1] = h[1], h[-2]
    right[0] = ((h[0] + 2.0 * first) * h[1] * m[0] + h[0] ** 2 * m[1]) / first
    right[-1] = (h[-1] ** 2 * m[-2] + (2.0 * last + h[-1]) * h[-2] * m[-1]) / last
    s = dgtsv(lower, middle, upper, right, True, True, True, True)[3]
    pieces = np.empty((h.size, 4))
    pieces[:, 0], pieces[:, 1] = values[:-1], s[:-1]
    bend = (s[:-1] + s[1:] - 2.0 * m) / h
    pieces[:, 2] = (m - s[:-1]) / h - bend
    pieces[:, 3] = bend / h
    return pieces
