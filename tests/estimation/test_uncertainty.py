"""Covariance of unknowns that few samples cannot determine."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.estimation.uncertainty import covariance


@pytest.mark.parametrize("samples", [1, 3, 4])
def test_fewer_samples_than_unknowns_determine_none_that_they_mix(samples: int) -> None:
    rng = np.random.default_rng(3)
    jacobian = rng.normal(size=(samples, 5))
    found = covariance([jacobian], [np.full(samples, 0.1)])
    assert np.isinf(np.diag(found.covariance)).all()


def test_an_unknown_that_the_samples_do_tell_keeps_its_variance() -> None:
    jacobian = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # of three, the first alone
    found = covariance([jacobian], [np.array([0.1, -0.05])])
    variances = np.diag(found.covariance)
    # one degree of freedom: cost / (J'J)
    assert variances[0] == pytest.approx((0.1**2 + 0.05**2) / 5.0)
    assert np.isinf(variances[1:]).all()
