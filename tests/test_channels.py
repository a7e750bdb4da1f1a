"""What channels show before a fit."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.channels import Channel, describe_channel, factor_between, relate
from fluidact_fit.experiment import FloatArray
from fluidact_fit.logs.log import Column

RNG = np.random.default_rng(20)
T = np.linspace(0.0, 10.0, 2000)
WAVE = np.sin(2.0 * np.pi * 0.5 * T)


def column(values: FloatArray, index: int = 1) -> Column:
    return Column(index, "x", "x", None, False, np.asarray(values, dtype=float))


def seen(values: FloatArray) -> Channel:
    found = describe_channel(column(values))
    assert found is not None
    return found


def test_noise_and_bits_are_those_of_the_simulated_sensor() -> None:
    found = seen(5.0 * WAVE + 0.02 * RNG.standard_normal(T.size))
    assert found.noise == pytest.approx(0.02, rel=0.1)
    # an ideal converter over 10 units whose rounding has this standard deviation
    assert found.bits == pytest.approx(np.log2(10.0 / (np.sqrt(12.0) * 0.02)), abs=0.3)
    rounded = seen(np.round(WAVE * 512.0) / 512.0)
    assert rounded.bits == pytest.approx(10.0, abs=0.3)


def test_reversals_are_counted_in_spite_of_noise() -> None:
    found = seen(WAVE + 0.05 * RNG.standard_normal(T.size))
    assert found.reversals == 10  # five periods, two each
    assert seen(T + 0.05 * RNG.standard_normal(T.size)).reversals == 0


def test_rest_is_a_share_of_the_time() -> None:
    moved = np.where(T < 5.0, 0.0, 1.0 - np.cos(T - 5.0)) + 1e-3 * RNG.standard_normal(T.size)
    assert seen(moved).rest == pytest.approx(0.5, abs=0.1)


def test_a_noisy_channel_at_its_end_is_clipped() -> None:
    noisy = WAVE + 0.01 * RNG.standard_normal(T.size)
    found = seen(np.minimum(noisy, 0.8))
    assert found.clipped_high == pytest.approx(np.mean(noisy >= 0.8))
    assert found.clipped_low == 0.0
    assert seen(noisy).clipped_high == 0.0
    square = np.where(WAVE > 0.0, 2.0, -2.0)  # a command is no clipped sensor
    assert seen(square).levels == 2
    assert seen(square).clipped_high == 0.0


def test_a_sensor_that_hangs_is_named_with_its_rows() -> None:
    values = WAVE + 0.01 * RNG.standard_normal(T.size)
    values[700:760] = values[700]
    found = seen(values)
    assert (found.stuck_from, found.stuck) == (700, 60)
    assert seen(WAVE + 0.01 * RNG.standard_normal(T.size)).stuck == 0


def test_a_slow_channel_repeats_its_readings() -> None:
    slow = np.repeat((WAVE + 0.01 * RNG.standard_normal(T.size))[::4], 4)
    assert seen(slow).repeated == pytest.approx(4.0, rel=0.05)


def test_too_little_and_nothing() -> None:
    assert describe_channel(column(np.array([1.0]))) is None
    assert describe_channel(column(np.full(5, np.nan))) is None
    constant = seen(np.full(100, 3.0))
    assert (constant.low, constant.high, constant.noise, constant.rest) == (3.0, 3.0, 0.0, 1.0)
    holes = np.where(np.arange(T.size) % 3 == 0, WAVE, np.nan)
    assert seen(holes).reversals == 10


def test_what_leads_and_which_way_it_moves() -> None:
    u = np.cumsum(RNG.standard_normal(1000))
    late = np.r_[np.full(7, u[0]), u[:-7]]
    (found,) = relate([column(late, 2), column(-3.0 * u, 5)])
    assert (found.first, found.second) == (5, 2)
    assert found.lag == 7.0
    assert found.correlation == pytest.approx(-1.0, abs=0.05)
    assert relate([column(u), column(np.cumsum(RNG.standard_normal(1000)), 2)]) == []


def test_a_column_that_was_computed_is_told_from_one_that_was_measured() -> None:
    u = RNG.standard_normal(500)
    assert factor_between(u, np.round(35.15 * u + 4.0, 3)) == pytest.approx(35.15, rel=1e-4)
    assert factor_between(u, 35.15 * u + 0.1 * RNG.standard_normal(500)) is None
    levels = RNG.integers(0, 2, 500).astype(float)
    assert factor_between(levels, 2.0 * levels) is None  # switched together, not computed


def test_the_largest_number_there_is_hides_no_other_channel() -> None:
    broken = WAVE.copy()
    broken[700] = np.finfo(float).max
    columns = [column(WAVE, 1), column(broken, 2)]
    assert [r.lag for r in relate(columns)] == [0]
