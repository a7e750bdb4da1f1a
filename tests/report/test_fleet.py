"""The page of a batch."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.estimation.random_effects import estimate_spread
from fluidact_fit.report import fleet
from fluidact_fit.report.fleet import FleetQuantity, fleet_page


def quantity(name: str) -> FleetQuantity:
    values, errors = np.linspace(1.0, 1.2, 8), np.full(8, 0.01)
    jobs = [f"unit{k}" for k in range(8)]
    return FleetQuantity("valve", name, "V", jobs, values, errors, estimate_spread(values, errors))


def test_numbers_without_a_picture_are_said_to_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "_MOST_PICTURES", 2)
    names = ["gain", "level", "offset"]
    text = fleet_page({"verdict pass": 8}, [quantity(n) for n in names], [], {}, "logs")
    assert "the first 2 of 3 numbers" in text
    assert "summary.csv" in text
    assert all(f"valve {n}" in text for n in names)  # in the table
    whole = fleet_page({"verdict pass": 8}, [quantity(n) for n in names[:2]], [], {}, "logs")
    assert "The pictures show" not in whole
