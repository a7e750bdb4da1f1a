"""The noise floor: white noise on motion, jumps, converters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit.estimation.noise import common_step, noise_floor


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("robust", [True, False])
def test_noise_on_a_smooth_signal(order: int, robust: bool) -> None:
    rng = np.random.default_rng(order)
    n = 20_000
    motion = 100.0 * np.sin(2.0 * np.pi * np.arange(n) / 2000.0)
    found = noise_floor(motion + 0.3 * rng.standard_normal(n), order, robust=robust)
    # spread of a median over correlated differences: 2 % of itself at this length
    assert found == pytest.approx(0.3, rel=0.06)


def test_jumps_and_spikes_do_not_count_where_it_is_robust() -> None:
    rng = np.random.default_rng(0)
    steps = np.repeat(rng.uniform(-50.0, 50.0, 40), 100) + 0.1 * rng.standard_normal(4000)
    assert noise_floor(steps) == pytest.approx(0.1, rel=0.15)
    assert noise_floor(steps, robust=False) > 1.0


def test_polynomials_below_the_order_hold_no_noise() -> None:
    t = np.arange(100.0)
    assert noise_floor(t**2, 3) < 1e-9
    assert noise_floor(t**2, 2) > 0.1


def test_too_short_a_record_tells_nothing() -> None:
    assert noise_floor(np.arange(11.0) % 2.0, 3) == 0.0


@given(st.sets(st.integers(1, 200), min_size=2, max_size=6), st.sampled_from([0.5, 0.1, 1e-3]))
def test_levels_of_a_converter_have_a_step_in_common(codes: set[int], step: float) -> None:
    found = common_step(step * np.array([*codes, -next(iter(codes)), 0.0]))
    assert found == pytest.approx(step * np.gcd.reduce(list(codes)), rel=1e-6)


def test_levels_of_no_converter_have_none() -> None:
    rng = np.random.default_rng(6)
    for levels in (rng.uniform(-5.0, 5.0, 4), np.array([3.0, -3.0]), np.zeros(2)):
        assert common_step(levels) == 0.0
