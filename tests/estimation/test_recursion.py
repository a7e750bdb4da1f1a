"""Recursions in whole arrays against the loops that they stand for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fluidact_fit.estimation.recursion import BlockRecursion, clamped


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


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.integers(0, 100), st.integers(1, 3), st.integers(1, 2),
    st.sampled_from(["", "system", "input"]),
)  # fmt: skip
def test_a_response_in_blocks_is_that_of_the_loop(
    seed: int, steps: int, n: int, d: int, moved: str
) -> None:
    rng = np.random.default_rng(seed)
    turn = 1e-30j * (moved == "system")
    phi = rng.standard_normal((n, n))
    phi = 0.99 * phi / np.abs(np.linalg.eigvals(phi)).max() + turn * rng.standard_normal((n, n))
    gamma = rng.standard_normal((n, d)) + turn * rng.standard_normal((n, d))
    row, direct = rng.standard_normal(n) + turn, rng.standard_normal(d) + turn
    u = rng.standard_normal((steps + 1, d)) + 1e-30j * (moved == "input") * rng.standard_normal(d)
    x = start = rng.standard_normal(n)
    out = []
    for w in u:
        out.append(row @ x + direct @ w)
        last, x = x, phi @ x + gamma @ w
    y, state = BlockRecursion(phi, gamma, row, direct).run(u, start)
    for part in (np.real, np.imag):
        size = max(np.abs(part(out)).max(), 1e-300)
        assert np.abs(part(y) - part(out)).max() < 1e-11 * size
        assert np.abs(part(state) - part(last)).max() < 1e-11 * max(np.abs(part(last)).max(), size)
