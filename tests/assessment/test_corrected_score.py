"""The corrected score: regression of a residual without the noise of an input."""

from __future__ import annotations

import numpy as np

from fluidact_fit.assessment.corrected_score import Products


def test_a_column_that_only_noise_fills_says_nothing() -> None:
    """An inlet that rests at zero has no reading below it, while draws of its noise have."""
    recorded, added = np.diag([4.0, 0.0, 1.0]), np.diag([0.1, 0.2, 0.1])
    assert not Products(recorded, [added, added], 0.0, 100).is_finite
    assert Products(recorded + np.diag([0.0, 1.0, 0.0]), [added, added], 0.0, 100).is_finite
