"""Fewer points for the same picture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray


def envelope(x: FloatArray, y: FloatArray, bins: int = 1500) -> tuple[FloatArray, FloatArray]:
    """Keep the smallest and the largest value of every bin: peaks survive.

    Parameters
    ----------
    x, y : (n,)
    bins
        Bins of equal count, about the pixels of the axis.

    Returns
    -------
    x, y : (k,)
        All of them when there are not many more than ``2 * bins``.
    """
    if y.size <= 4 * bins:
        return x, y
    width = y.size // bins
    whole = y[: width * bins].reshape(bins, width)
    filled = np.where(np.isnan(whole), np.inf, whole)
    low = filled.argmin(axis=1)
    high = np.where(np.isnan(whole), -np.inf, whole).argmax(axis=1)
    start = np.arange(bins) * width
    ends = np.concatenate((start + np.minimum(low, high), start + np.maximum(low, high)))
    kept = np.unique(np.concatenate((ends, [0, *range(width * bins, y.size)])))
    return x[kept], y[kept]


def subset(size: int, most: int) -> npt.NDArray[np.intp]:
    """Indices of at most so many samples, evenly spread."""
    if size <= most:
        return np.arange(size)
    return np.unique(np.linspace(0, size - 1, most).astype(np.intp))
