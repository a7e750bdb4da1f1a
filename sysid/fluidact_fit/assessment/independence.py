"""How many independent samples are the data worth?

Strongly autocorrelated errors make hundreds of samples say as much as a dozen independent ones.
The covariance allows for that, with a size and an autocorrelation of the errors that come from
the same residuals. Where these are worth hardly more samples than there are unknowns, the curve
has taken the slow part of the errors for its own, and no residual shows how large it was.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import Notice
from .optimum import Optimum

_FEWEST = 8.0  # independent samples an unknown: with fewer, errors of 4 standard errors were seen


def find_independent_samples(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """How many independent samples the residuals are worth, and a warning where they are few."""
    independent, unknowns = at.estimate.independent, len(at.names)
    if not np.isfinite(independent):
        return {}, []
    entry = {"samples": independent}
    if independent >= _FEWEST * unknowns:
        return entry, []
    samples = sum(r.size for r in at.residuals)
    return entry, [
        Notice(
            "few-independent-samples",
            f"the residuals are autocorrelated over so long that {samples} samples show the size "
            f"of the errors as well as some {independent:.0f} independent ones would, with "
            f"{unknowns} unknowns fitted to them: the parameters may be off by more than their "
            "intervals say. Settle what else is said of this fit first, since it may be the cause; "
            "then record for longer, with more strokes over the whole range. Faster sampling does "
            "not help.",
        )
    ]
