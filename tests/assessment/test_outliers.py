"""Samples that the model of all others contradicts: left out of the fit, and named."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from studies.red_team.attack import Attack
from studies.red_team.attacks import valve
from studies.red_team.run import write

import fluidact_fit as ff

WHERE = (451, 452, 780)  # away from the jumps of the command


def log_of(folder, spoil, seed=3, **machine):
    """A valve recorded with some samples of its outlet spoilt."""
    attack = Attack("valve", "", "", valve.TRUTH, partial(valve.record, **machine), valve.UNITS)
    (recording,) = attack.record(np.random.default_rng(seed))
    outlet = recording["outlet"].copy()
    for k, by in spoil.items():
        outlet[k] += by
    return write(folder / "log.csv", {**recording, "outlet": outlet}, valve.UNITS)


def codes(result):
    return {n.code for n in result.notices}


def test_a_bad_sample_beside_the_model_does_not_move_the_estimate(tmp_path):
    clean = ff.fit("valve", log_of(tmp_path, {}))
    spoilt = ff.fit("valve", log_of(tmp_path, {451: 0.4}))
    assert clean.verdict == "pass"
    assert codes(spoilt) == {"outliers"}
    for name in clean.solution.names:
        q = clean.parameters[name]
        # one of a thousand samples is not there: that moves an estimate by next to nothing
        assert spoilt.parameters[name].value == pytest.approx(q.value, abs=0.1 * q.std_error)
    (entry,) = spoilt.document.fit.details["outliers"]
    assert "log.csv, t = 4.51 s" in entry["place"]
    assert entry["measured"] - entry["replaced"] == pytest.approx(0.4, abs=0.1)


def test_every_sample_that_was_left_out_is_listed(tmp_path):
    found = ff.fit("valve", log_of(tmp_path, dict.fromkeys(WHERE, -0.5)))
    places = [entry["place"] for entry in found.document.fit.details["outliers"]]
    assert sorted(places) == [f"log.csv, t = {0.01 * k:.6g} s" for k in WHERE]
    (message,) = [n.message for n in found.notices if n.code == "outliers"]
    assert all(place in message for place in places)


def test_samples_that_the_model_misses_in_a_row_stay(tmp_path):
    found = ff.fit("valve", log_of(tmp_path, dict.fromkeys(range(430, 440), 0.3)))
    assert "outliers" not in codes(found)
    assert found.verdict == "warn"


def test_what_a_wrong_model_misses_is_not_taken_for_outliers(tmp_path):
    for machine in ({"delay": 0.004}, {"pole": 60.0}):
        assert "outliers" not in codes(ff.fit("valve", log_of(tmp_path, {}, **machine)))
