"""The friction law: levels by direction, rest, and names."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.mechanics.friction_law import FrictionLaw

LAW = FrictionLaw(2.0, 1.6, 0.5, 0.25, 2.9, 1.9)


def test_levels_and_slopes_by_direction() -> None:
    np.testing.assert_allclose(LAW.moving([3.0, -4.0, 0.0]), [2.0 + 1.5, -1.6 - 1.0, 0.0])


def test_a_motion_state_decides_the_level_and_the_velocity_the_slope() -> None:
    np.testing.assert_allclose(LAW.moving([0.0, 0.0, 0.0, -2.0], [1, -1, 0, 1]),
                               [2.0, -1.6, 0.0, 2.0 - 0.5])  # fmt: skip


def test_rest_balances_up_to_the_static_levels() -> None:
    np.testing.assert_allclose(LAW.at_rest([1.0, 5.0, -1.5, -5.0]), [1.0, 2.9, -1.5, -1.9])


def test_no_static_level_lies_below_the_kinetic_one() -> None:
    assert FrictionLaw(2.0, 1.0).breakaway_positive == 2.0
    assert FrictionLaw(2.0, 1.0, breakaway_negative=0.5).breakaway_negative == 1.0


def test_friction_rises_at_low_speed_in_both_directions() -> None:
    law = FrictionLaw(2.0, 1.0, stribeck=0.5, stribeck_speed=0.1)
    rise = 0.5 * np.exp(-1.0)
    np.testing.assert_allclose(law.moving([0.1, -0.1, 9.0]), [2.0 + rise, -1.0 - rise, 2.0])
    assert (law.breakaway_positive, law.breakaway_negative) == (2.5, 1.5)


@pytest.mark.parametrize(
    ("values", "law"),
    [
        ({"viscous": 3.0, "coulomb_positive": 1.0, "coulomb_negative": 2.0, "mass": 9.0},
         FrictionLaw(1.0, 2.0, 3.0, 3.0)),
        ({"viscous": 3.0, "coulomb": 1.0}, FrictionLaw(1.0, 1.0, 3.0, 3.0)),
        ({"viscous_positive": 1.0, "viscous_negative": 2.0, "coulomb": 0.0},
         FrictionLaw(0.0, 0.0, 1.0, 2.0)),
    ],
)  # fmt: skip
def test_names_of_a_file(values: dict[str, float], law: FrictionLaw) -> None:
    assert FrictionLaw.of(values) == law
