"""State space of a transfer function, in a scale of time that keeps its numbers of order one."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.estimation.transfer_model import state_space


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([2.0], [1e-3, 1.0]),
        ([1.0], [53.7, 1720.5, 0.0]),  # a free mass
        ([0.02 * 4e8, 4e8], [1.0, 2.8e4, 4e8]),  # a zero, and poles in rad/s
        ([1e-9, 3.0], [1.0, 20.0, 3e5, 1e6]),
    ],
)
def test_the_response_is_that_of_the_coefficients(numerator, denominator) -> None:
    a, b, c = state_space(numerator, denominator)
    for s in 1j * np.geomspace(1e-2, 1e6, 9):
        found = c @ np.linalg.solve(s * np.eye(b.size) - a, b)
        assert found == pytest.approx(np.polyval(numerator, s) / np.polyval(denominator, s))


def test_derivatives_by_complex_steps_are_exact() -> None:
    s, step = 30.0j, 1e-30
    a, b, c = state_space([1.0], [53.7, 1720.5 + 1j * step, 900.0])
    # of C (s - A)^-1 B, by the parts of it that moved
    inverse = np.linalg.inv(s * np.eye(2) - a.real)
    moved = c.imag @ inverse @ b + c.real @ inverse @ a.imag @ inverse @ b
    assert moved / step == pytest.approx(-s / (53.7 * s**2 + 1720.5 * s + 900.0) ** 2)
