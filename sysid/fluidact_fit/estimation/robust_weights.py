"""Huber's weights: samples far off count less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..experiment import FloatArray
from .noise import PER_MEDIAN

HUBER = 4.0  # robust standard deviations from which a residual counts less: normal ones are not
SPIKE = 8.0  # robust standard deviations beyond which it counts for nothing: it is no noise
ROUNDS = 6  # of reweighting


def huber_weights(
    rest: Sequence[FloatArray], limit: float | None
) -> tuple[list[FloatArray], float]:
    """Roots of Huber's weights, ``(n_i,)``, and the residual from which a sample counts less.

    ``rest`` is what a model leaves, ``(n_i,)`` each; without a ``limit`` it follows from that.
    """
    if limit is None:
        limit = HUBER * PER_MEDIAN * float(np.median(np.abs(np.concatenate(rest))))
    return [np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(r), 1e-300))) for r in rest], limit
