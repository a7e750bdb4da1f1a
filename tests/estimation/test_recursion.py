"""Recursions in whole arrays against the loops that they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit.estimation.recursion import clamped


@given(st.integers(0, 2**32 - 1), st.integers(0, 200), st.booleans())
def test_a_clamped_sum_is_that_of_the_loop(seed: int, count: int, moving: bool) -> None:
    rng = np.random.default_rng(seed)
    steps = 0.5 * rng.standard_normal(count)
    low = rng.standard_normal(count) - 1.0 if moving else -1.0
    high = low + rng.uniform(0.0, 2.0, count) if moving else 1.0
    x, out = 0.3, []
    for step, a, b in zip(steps, np.broadcast_to(low, count), np.broadcast_to(high, count)):
        x = min(max(x + step, a), b)
        out.append(x)
    # what a block begins with is the sum of its steps in another order
    assert clamped(0.3, low, high, steps, count) == pytest.approx(np.array(out), abs=1e-13)
    if count:  # without steps nothing is added: the same digits
        whole = clamped(0.3, low, high, 0.0, count)
        x = 0.3
        for k in range(count):
            x = min(max(x, np.broadcast_to(low, count)[k]), np.broadcast_to(high, count)[k])
            assert whole[k] == x
