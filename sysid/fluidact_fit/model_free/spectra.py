"""Frequency response with coherence, and what a residual still holds of its input.

Sources: Bendat and Piersol, "Random Data" (2010), chapter 9, for the frequency response; Ljung,
"System Identification" (1999), 16.6, for the cross-correlation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..experiment import FloatArray

_SEGMENTS = 8  # of a spectrum at least
_LAGS = 30  # of a cross-correlation, to either side
_CHANCE = 2.5758  # standard deviations of a 99 % band

Runs = Sequence[tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class FrequencyResponse:
    """Frequency response by averaged spectra, shapes ``(n,)``.

    Attributes
    ----------
    frequency
        [Hz]
    magnitude, phase
        [output/input] and [rad], unwrapped.
    coherence
        Share of the output that is the input's by a linear system, from 0 to 1.
    relative
        Standard error of the magnitude as a part of it, and of the phase [rad].
    """

    frequency: FloatArray
    magnitude: FloatArray
    phase: FloatArray
    coherence: FloatArray
    relative: FloatArray


@dataclass(frozen=True)
class CrossCorrelation:
    """Correlation of the residual with the input before and after it.

    Attributes
    ----------
    lag : (n,)
        By which the residual follows [s].
    correlation : (n,)
        From -1 to 1.
    limit : float
        Half the 99 % band of what chance makes of an unrelated pair.
    """

    lag: FloatArray
    correlation: FloatArray
    limit: float


def frequency_response(runs: Runs, sample_time: float) -> FrequencyResponse | None:
    """Frequency response with coherence, by Welch's averages over all runs.

    Parameters
    ----------
    runs
        Input and output of each, shapes ``(n,)`` [any units].
    sample_time
        Of all of them [s].

    Returns
    -------
    FrequencyResponse or None
        ``None`` where there are fewer than 64 samples, or the input does not change. The standard
        error of the magnitude is ``|G| sqrt((1 - c) / (2 m c))`` for the coherence ``c`` and ``m``
        independent segments.
    """
    from scipy.signal import csd

    shortest = min(u.size for u, _ in runs)
    length = 1 << max(int(np.log2(2 * shortest / (_SEGMENTS + 1))), 0)
    if shortest < 64 or not any(np.ptp(u) > 0.0 for u, _ in runs):
        return None
    weights = [2.0 * u.size / length - 1.0 for u, _ in runs]

    def spectrum(one: int, other: int) -> FloatArray:
        how = {"fs": 1.0 / sample_time, "nperseg": length, "detrend": "linear"}
        parts = (w * csd(run[one], run[other], **how)[1] for w, run in zip(weights, runs))
        return np.asarray(sum(parts))[1:]

    uu, yy, uy = spectrum(0, 0).real, spectrum(1, 1).real, spectrum(0, 1)
    strong = uu > 1e-8 * uu.max()
    frequency = np.fft.rfftfreq(length, sample_time)[1:][strong]
    gain = uy[strong] / uu[strong]
    coherence = np.clip(np.abs(uy[strong]) ** 2 / np.maximum(uu * yy, 1e-300)[strong], 0.0, 1.0)
    independent = max(sum(weights) * 0.53, 1.0)  # of halfway overlapping Hann windows
    relative = np.sqrt((1.0 - coherence) / (2.0 * independent * np.maximum(coherence, 1e-12)))
    return FrequencyResponse(
        frequency, np.abs(gain), np.unwrap(np.angle(gain)), coherence, relative
    )


def cross_correlation(
    inputs: Sequence[FloatArray], residuals: Sequence[FloatArray], sample_time: float
) -> CrossCorrelation | None:
    """Correlation of residual and input, and what chance makes of it.

    Parameters
    ----------
    inputs, residuals
        Of each run, shapes ``(n,)`` [any units]; a residual that is NaN counts as 0.
    sample_time
        [s]

    Returns
    -------
    CrossCorrelation or None
        ``None`` where either does not change. The variance of a chance correlation is
        ``sum_k r_e(k) r_u(k) / n``, with the autocorrelations of both.
    """
    pairs = [(u - u.mean(), np.nan_to_num(e - np.nanmean(e)))
             for u, e in zip(inputs, residuals, strict=True) if u.size > 2 * _LAGS]  # fmt: skip
    size = sum(u.size for u, _ in pairs)
    power = np.sqrt(sum(float(u @ u) for u, _ in pairs) * sum(float(e @ e) for _, e in pairs))
    if not pairs or not power > 0.0:
        return None
    lags = np.arange(-_LAGS, _LAGS + 1, dtype=float)
    found = sum(_products(u, e)[_around(u.size, _LAGS)] for u, e in pairs) / power
    long = min(min(u.size for u, _ in pairs) - 1, 20 * _LAGS)
    own = []
    for which in (0, 1):
        whole = sum(_products(p[which], p[which])[_around(p[0].size, long)] for p in pairs)
        own.append(np.asarray(whole) / float(np.asarray(whole)[long]))
    variance = max(float(own[0] @ own[1]), 1.0) / size
    return CrossCorrelation(
        sample_time * lags, np.asarray(found), _CHANCE * float(np.sqrt(variance))
    )


def _products(u: FloatArray, e: FloatArray) -> FloatArray:
    """Sums ``sum_k u_k e_(k+lag)``, shape ``(2 n - 1,)``, lag 0 in the middle."""
    length = 2 * u.size
    whole = np.fft.irfft(np.conj(np.fft.rfft(u, length)) * np.fft.rfft(e, length), length)
    return np.r_[whole[u.size + 1 :], whole[: u.size]]


def _around(size: int, lags: int) -> slice:
    return slice(size - 1 - lags, size + lags)
