"""The page of a batch."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.estimation.random_effects import estimate_spread
from fluidact_fit.report import fleet
from fluidact_fit.report.fleet import FleetJob, FleetQuantity, fleet_page


def quantity(name: str) -> FleetQuantity:
    values, errors = np.linspace(1.0, 1.2, 8), np.full(8, 0.01)
    jobs = [f"unit{k}" for k in range(8)]
    return FleetQuantity("valve", name, "V", jobs, values, errors, estimate_spread(values, errors))


def test_numbers_without_a_picture_are_said_to_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "_MOST_PICTURES", 2)
    names = ["gain", "level", "offset"]
    text = fleet_page({"verdict pass": 8}, [], [quantity(n) for n in names], [], {}, "logs")
    assert "the first 2 of 3 numbers" in text
    assert "summary.csv" in text
    assert all(f"valve {n}" in text for n in names)  # in the table
    whole = fleet_page({"verdict pass": 8}, [], [quantity(n) for n in names[:2]], [], {}, "logs")
    assert "The pictures show" not in whole


def test_jobs_are_listed_with_their_files_and_sorted_by_numbers() -> None:
    jobs = [FleetJob(f"unit{k}", "valve", "done", "pass", ["spikes"], [f"unit{k}.yaml"])
            for k in range(8)]  # fmt: skip
    jobs.append(FleetJob("a b", "valve", "refused", "", [], ["logs/a b.txt"]))
    text = fleet_page({"verdict pass": 8}, jobs, [quantity("gain")], [], {}, "logs")
    table = text[text.index("<h2>Jobs</h2>") :]
    assert 'class="sortable"' in table
    assert '<th scope="col" class="n">gain [V]</th>' in table
    assert 'data-value="1.2">1.200 ± 0.010</td>' in table
    assert 'unit7 (<a href="unit7.yaml">yaml</a>, <a href="logs/unit7.txt">log</a>)' in table
    assert 'a b (<a href="logs/a%20b.txt">log</a>)' in table
    jobs.append(FleetJob("other", "line", "done", "pass", [], []))
    mixed = fleet_page({"verdict pass": 8}, jobs, [quantity("gain")], [], {}, "logs")
    assert "gain [V]" not in mixed[mixed.index("<h2>Jobs</h2>") :]
