"""Whitening of a residual that is an autoregression from rest plus white noise.

Noise of a measured input that has passed through a model is close to an autoregression of low
order, of a unit root where the model integrates; the noise of the output comes on top and is
white. The innovations of the Kalman filter [1]_ of the two are white.

References
----------
.. [1] R. E. Kalman, "A new approach to linear filtering and prediction problems",
   J. Basic Engineering 82, 1960.
.. [2] M. Morf, G. Sidhu, T. Kailath, "Some new algorithms for recursive estimation in constant,
   linear, discrete-time systems", IEEE Trans. Automatic Control 19(4), 1974.
.. [3] A. Oppenheim, R. Schafer, Discrete-Time Signal Processing, 3rd ed., 2010, section 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..experiment import Array, FloatArray
from .recursion import run_recursion

_LONGEST = 300  # samples after which the gain of the filter is taken as constant
_SETTLED = 1e-4  # relative change of the innovations' variance below which it is constant


@dataclass(frozen=True)
class Whitening:
    """Innovations filter of ``n_k = sum_i a_i n_{k-1-i} + drive v_k`` plus ``white e_k``.

    Attributes
    ----------
    coefficients
        ``a``, shape ``(q,)``; the process is zero before the first sample.
    drive, white
        Standard deviations of the noise that drives the process, and of the white noise on top
        [unit of the rows].
    focus
        Weights of a filter that the innovations pass afterwards, shape ``(m,)``, latest first.
    """

    coefficients: FloatArray
    drive: float
    white: float
    focus: FloatArray = field(default_factory=lambda: np.ones(1))

    @cached_property
    def _gains(self) -> tuple[FloatArray, FloatArray]:
        """Gains of the predictor ``(k, q)`` and variances of the innovations ``(k,)``, by sample.

        The state is in observer form: its first entry is the process itself. Its covariance changes
        by a matrix of rank one from sample to sample, whose root is propagated [2]_.
        """
        # plain numbers are faster than arrays of a few entries over hundreds of samples
        a: list[float] = self.coefficients.tolist()
        variance = self.drive**2 + self.white**2
        root, weight = a, self.drive**2 * self.white**2 / variance
        gain = [x * (self.drive**2 / variance) for x in a]
        gains, variances = [gain], [variance]
        while len(gains) < _LONGEST:
            first = root[0]
            later = variance + weight * first**2
            root = [x * first + r - g * first for x, r, g in zip(a, (*root[1:], 0.0), gain)]
            share = weight * first / later
            gain = [g + r * share for g, r in zip(gain, root)]
            weight *= variance / later
            before, variance = variance, later
            if len(gains) > 2 * len(a) and abs(later - before) <= _SETTLED * later / _LONGEST:
                break
            gains.append(gain)
            variances.append(variance)
        return np.array(gains), np.array(variances)

    @property
    def settling(self) -> int:
        """Samples until the gain of the filter is constant."""
        return int(self._gains[1].size)

    def filter(self, rows: Array) -> Array:
        """Innovations of rows (samples first), in their standard deviations, focused."""
        white = self._innovations(rows)
        if self.focus.size == 1:
            return white
        size = rows.shape[0] + self.focus.size - 1
        gains = np.fft.rfft(self.focus, size).reshape(-1, *(1 for _ in rows.shape[1:]))
        found = np.fft.irfft(gains * np.fft.rfft(white, size, axis=0), size, axis=0)
        return np.asarray(found[: rows.shape[0]])

    def _innovations(self, rows: Array) -> Array:
        """Innovations of rows (samples first), in their standard deviations.

        With ``g_k`` the gain of the predictor, ``e_k = n_k - sum_i a_i n_{k-1-i} +
        sum_i (a_i - g_{k-1-i,i}) e_{k-1-i}``: one banded system, the transient included.
        """
        if self.coefficients.size == 0:
            return np.asarray(rows / np.hypot(self.drive, self.white))
        flat = rows.reshape(rows.shape[0], -1)
        driven = flat.copy()
        for i, c in enumerate(self.coefficients):
            driven[i + 1 :] -= c * flat[: -i - 1]
        gains, deviations = self._over(flat.shape[0])
        innovations = run_recursion(driven, self.coefficients[:, None] - gains)
        return np.asarray(innovations / deviations[:, None]).reshape(rows.shape)

    def _over(self, samples: int) -> tuple[FloatArray, FloatArray]:
        """Gains ``(q, n)`` and standard deviations of the innovations ``(n,)``."""
        gains, variances = self._gains
        which = np.minimum(np.arange(samples), variances.size - 1)
        return gains[which].T, np.sqrt(variances)[which]

    def logarithm(self, samples: int) -> float:
        """Logarithm of the determinant of the covariance of that many samples."""
        if self.coefficients.size == 0:
            return samples * float(np.log(self.drive**2 + self.white**2))
        variances = np.log(self._gains[1][:samples])
        return float(variances.sum() + (samples - variances.size) * variances[-1])


def causal_filter(power: FloatArray, length: int) -> FloatArray:
    """Weights of the minimum-phase filter with given squared gains, shape ``(length,)``.

    Its cepstrum is the causal half, doubled, of that of the gains [3]_.

    Parameters
    ----------
    power : (k,)
        Positive, at evenly spaced frequencies from zero to half a cycle a sample.
    """
    cepstrum = np.fft.irfft(0.5 * np.log(power))
    half = cepstrum.size // 2
    cepstrum[1:half] *= 2.0
    cepstrum[half + 1 :] = 0.0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstrum)))[:length]


def autoregression_from_rest(series: Sequence[FloatArray], order: int) -> tuple[FloatArray, float]:
    """Least-squares autoregression of series that are zero before their first sample.

    Nothing is assumed to be stationary, so an integrated noise keeps its unit root.

    Returns
    -------
    coefficients : (order,)
    drive
        Standard deviation of what is left.
    """
    normal = np.zeros((order + 1, order + 1))
    count = sum(s.size for s in series)
    for s in series:
        padded = np.concatenate((np.zeros(order), s))
        lagged = np.stack([padded[order - k : order - k + s.size] for k in range(order + 1)])
        normal += lagged @ lagged.T
    scale = float(normal[0, 0])
    if scale <= 0.0:
        return np.zeros(order), 0.0
    a = np.linalg.lstsq(normal[1:, 1:] / scale, normal[1:, 0] / scale, rcond=1e-12)[0]
    left = float(normal[0, 0] - 2.0 * a @ normal[1:, 0] + a @ normal[1:, 1:] @ a)
    return np.asarray(a), float(np.sqrt(max(left, 1e-30 * scale) / count))
