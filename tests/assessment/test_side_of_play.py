"""The direction that stands for play of a sensor does not follow the noise of what is simulated."""

import numpy as np

from fluidact_fit.assessment.terms import _side_of_play
from fluidact_fit.estimation.recursion import behind_play


def test_noise_within_play_changes_nothing() -> None:
    way = np.concatenate([np.linspace(0.0, 1.0, 50), np.ones(50), np.linspace(1.0, 0.0, 50)])
    noisy = way + 1e-3 * np.random.default_rng(7).standard_normal(way.size)
    side = _side_of_play(behind_play(noisy, 0.01) - noisy)
    assert set(side[5:100]) == {-0.5}
    assert set(side[105:]) == {0.5}
