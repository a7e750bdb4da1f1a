"""Estimates are compared over what all of them cover."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fluidact_fit as ff
from fluidact_fit.alignment import Estimates, align
from fluidact_fit.check import check
from fluidact_fit.comparison import Comparison, compare
from fluidact_fit.families import get_family
from fluidact_fit.families.potentiometer.calibration import Calibration, over_common_readings
from fluidact_fit.family import Quantity

POINTS, WEIGHTS = np.array([0.0, 0.016, 0.094, 0.1]), np.array([1.0, 0.6, 1.7, 1.0])


def sweep(seed: int, low: float = 100.0, high: float = 3900.0) -> dict[str, Any]:
    """Readings with noise of half a count, rounded, and positions of a curve over 100 to 3900."""
    rng = np.random.default_rng(seed)
    true = low + (high - low) * 0.5 * (1.0 - np.cos(np.linspace(0.0, 4.0 * np.pi, 800)))
    curve = Calibration(((POINTS, WEIGHTS),), 100.0, 3900.0)
    reading = np.round(true + 0.5 * rng.standard_normal(true.size))
    position = curve.position(true) + 2e-5 * rng.standard_normal(true.size)
    return {"reading": reading, "reference": position}


def fit(seed: int, **where: float) -> Any:
    return ff.fit("potentiometer", [sweep(seed, **where)], degree=3, branches="pooled")


@given(st.integers(0, 10_000), st.floats(0.0, 0.4), st.floats(0.6, 1.0), st.booleans())
def test_curves_over_common_readings_are_the_same_curves(
    seed: int, low: float, high: float, higher: bool
) -> None:
    rng = np.random.default_rng(seed)
    each = []
    for ends, size in (((0.0, 1.0), 3), ((low, high), 5 if higher else 3)):
        points, weights = np.sort(rng.random(size)), np.append(1.0, rng.uniform(0.2, 5.0, size - 1))
        each.append({"control_points": points.tolist(), "weights": weights.tolist(),
                     "reading_range": [100.0 + 900.0 * end for end in ends]})  # fmt: skip
    common, about = over_common_readings(each)
    assert about or not (higher or each[0]["reading_range"] != each[1]["reading_range"])
    readings = np.linspace(100.0 + 900.0 * low, 100.0 + 900.0 * high, 40)
    for before, now in zip(each, common, strict=True):
        points, weights = (np.array(now[n]) for n in ("control_points", "weights"))
        over = Calibration(((points, weights),), readings[0], readings[-1])
        assert weights[0] == 1.0
        assert over.position(readings) == pytest.approx(
            Calibration.of(before).position(readings), abs=1e-9
        )


def test_errors_over_common_readings_are_those_of_draws() -> None:
    rng, order = np.random.default_rng(3), tuple(f"control_points[{i}]" for i in range(3))
    root = 1e-3 * rng.standard_normal((3, 3))
    values = {"control_points": [0.0, 0.4, 1.0], "weights": [1.0, 2.0, 1.0],
              "reading_range": [0.0, 1000.0]}  # fmt: skip
    own = Estimates(
        {n: Quantity(v, "1", std_error=[0.0] * 3) for n, v in values.items()}, order, root @ root.T
    )
    other = Estimates(
        {**own.quantities, "reading_range": Quantity([200.0, 900.0], "1")}, (), np.zeros((0, 0))
    )
    (found, _), about = align(get_family("potentiometer"), [own, other])
    assert "200 to 900" in about
    drawn = []
    for row in values["control_points"] + rng.standard_normal((4000, 3)) @ root.T:
        both = [{**values, "control_points": row.tolist()}, other.values]
        drawn.append(over_common_readings(both)[0][0]["control_points"])
    size = found.covariance.max()
    assert np.cov(np.transpose(drawn)) == pytest.approx(found.covariance, abs=0.06 * size)


def test_fits_of_one_sensor_agree_whatever_readings_each_log_had() -> None:
    """The extreme readings of a log are chance, and control points are those over them."""
    fits = [fit(seed) for seed in range(6)]
    ranges = {tuple(f.parameters["reading_range"].value) for f in fits}
    assert len(ranges) > 2
    p_values = []
    for one, other in combinations(fits, 2):
        found = compare(one, other)
        assert isinstance(found, Comparison)
        p_values.append(found.together[0].p_value)
    assert min(p_values) > 1e-3
    shifted = sweep(9)
    shifted["reference"] = shifted["reference"] * 1.004
    changed = compare(fits[0], ff.fit("potentiometer", [shifted], degree=3, branches="pooled"))
    assert isinstance(changed, Comparison)
    assert changed.together[0].differs


def test_a_log_of_part_of_the_stroke_fits_the_file() -> None:
    file = fit(0)
    for seed in (1, 2, 3):
        found = check(file, [sweep(seed, low=800.0, high=3100.0)])
        assert found.fits, found.reasons
        assert "compared-in-common" in [n.code for n in found.notices]
        assert len(found.drifts) > 4


def test_ranges_apart_have_nothing_to_compare() -> None:
    low, high = (
        fit(seed, low=a, high=b) for seed, a, b in ((0, 100.0, 1900.0), (1, 2100.0, 3900.0))
    )
    found = compare(low, high)
    assert isinstance(found, Comparison)
    assert "cannot be compared" in found.summary()
    assert found.together[0].degrees == 0
