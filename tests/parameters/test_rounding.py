"""Numbers are written to four digits beyond their standard errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit.parameters.rounding import round_covariance, round_numbers, round_quantity
from fluidact_fit.specification import Quantity

SIZES = st.floats(1e-30, 1e30)


@given(st.floats(-1e30, 1e30), SIZES)
def test_a_value_moves_by_less_than_a_thousandth_of_its_error(value: float, error: float) -> None:
    found = round_quantity(Quantity(value, "N", "estimated", error, [value - error, value + error]))
    assert abs(found.number - value) <= 1e-4 * error
    assert float(found.std_error) == pytest.approx(error, rel=1e-4)
    assert abs(found.ci95[0] - (value - error)) <= 1e-4 * error + 1e-9 * abs(value)


@given(SIZES, SIZES)
def test_a_value_far_below_its_error_keeps_four_digits(value: float, error: float) -> None:
    assert round_quantity(Quantity(value, "1", "estimated", error)).number == pytest.approx(
        value, rel=1e-3
    )


def test_digits_are_those_of_the_error() -> None:
    found = round_quantity(Quantity(53.79315238901349, "kg", "estimated", 0.16576345940404535))
    assert (found.value, found.std_error) == (53.79315, 0.16576)


def test_what_was_given_stays_as_it_is() -> None:
    given_ = Quantity(0.123456789012345, "m", "fixed")
    assert round_quantity(given_) == given_


def test_entries_of_a_list_are_rounded_one_by_one() -> None:
    found = round_quantity(Quantity([1.23456789, 9.87654321e-5], "m", "estimated", [0.1, 1e-7]))
    assert found.value == [1.23457, 9.876543e-05]


@given(st.integers(2, 6), st.integers(0, 10_000), st.floats(0.0, 12.0))
def test_a_rounded_covariance_is_one(size: int, seed: int, power: float) -> None:
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-9.0, 9.0, size)
    root = rng.standard_normal((size, size)) * np.append(np.ones(size - 1), 10.0**-power)
    matrix = root @ root.T * np.outer(scale, scale)
    found = round_covariance(0.5 * (matrix + matrix.T))
    spread = np.sqrt(np.diag(found))
    assert np.allclose(found, matrix, rtol=1e-5, atol=1e-5 * float(np.outer(spread, spread).min()))
    assert np.linalg.eigvalsh(found / np.outer(spread, spread))[0] > -1e-8
    assert np.array_equal(found, found.T)


def test_numbers_of_plain_data_are_rounded_and_nothing_else() -> None:
    tree = {"a": [0.1 + 0.2, 3, "text", True], "b": {"c": 7.999999999981355e-07}}
    assert round_numbers(tree) == {"a": [0.3, 3, "text", True], "b": {"c": 8e-07}}
