"""What noise of a measured input is taken for, and what is found in spite of it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from studies.red_team.attacks import hydrostatic, input_noise
from studies.red_team.run import write

import fluidact_fit as ff
from fluidact_fit.assessment.corrected_score import CorrectedScore
from fluidact_fit.estimation.whitening import Whitening

RIGHT = 5  # recordings of a right model


def fit(folder, family, recordings, units):
    """Fit recordings."""
    paths = [write(folder / f"log{k}.csv", r, units) for k, r in enumerate(recordings)]
    return ff.fit(family, paths)


def force(folder, seed, **more):
    """A hydrostatic machine whose force carries noise of 0.1 N."""
    recordings = hydrostatic.record(np.random.default_rng([seed, 7]), noise=0.1, **more)
    return fit(folder, "hydrostatic", recordings, hydrostatic.UNITS)


def missing(result):
    """The table of what may be missing, and whether something is said to be."""
    said = {n.code for n in result.notices}
    return result.document.fit.details["missing_response"], "unmodelled-response" in said


def test_products_without_the_noise_are_those_of_the_exact_input():
    """A gain and its neighbour's: least squares finds the neighbour in the noise."""
    rng = np.random.default_rng(2)
    n, sigma, count = 2000, 0.3, 60
    exact = np.repeat(rng.standard_normal(n // 5), 5)
    sizes, naive, stated = [], [], []
    for _ in range(count):
        drawn = sigma * rng.standard_normal((4, n))
        inputs = exact + drawn[0] + np.vstack((np.zeros(n), drawn[1:]))
        output = exact + 0.05 * rng.standard_normal(n)
        jacobians = [u[:, None] for u in inputs]
        found = CorrectedScore(
            [Whitening(np.zeros(0), sigma, 0.05)], 0.0, jacobians, [output - u for u in inputs]
        ).products([np.roll(u, 1) for u in inputs])
        triangle = found.triangle
        x = np.linalg.solve(triangle[:2, :2], triangle[:2, 2])
        sizes.append(x[1])
        stated.append(np.sqrt(found.covariance(x)[1, 1]))
        table = np.column_stack((inputs[0], np.roll(inputs[0], 1)))
        naive.append(np.linalg.lstsq(table, output - inputs[0], rcond=None)[0][1])
    assert abs(np.mean(naive)) > 5.0 * np.mean(stated)
    assert abs(np.mean(sizes)) < 4.0 * np.std(sizes) / np.sqrt(count)
    # 3.5 standard errors of a deviation of that many
    assert np.mean(stated) == pytest.approx(np.std(sizes), rel=3.5 / np.sqrt(2.0 * count))


def test_columns_that_are_all_noise_say_nothing():
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((4, 500))
    copies = noise[0] + np.vstack((np.zeros(500), noise[1:]))
    along = [np.arange(500.0)[:, None]] * 4
    found = CorrectedScore([Whitening(np.zeros(0), 1.0, 1.0)], 0.0, along, list(noise)).products(
        list(copies)
    )
    assert found.weak


def test_a_right_model_is_quiet_although_its_force_is_noisy(tmp_path):
    said, deviations, bows = 0, [], 0
    for seed in range(RIGHT):
        (tmp_path / str(seed)).mkdir()
        table, named = missing(force(tmp_path / str(seed), seed))
        said += named
        deviations += [entry["deviations"] for entry in table.values()]
        assert {"dead_time", "dry friction", "characteristic of force"} <= set(table)
        bows += "bow of force" in table
    assert said == 0
    assert bows >= RIGHT - 1  # one that the noise hides is left out
    assert np.abs(deviations).max() < 4.0


@pytest.mark.parametrize(
    ("name", "machine"),
    [
        ("dead_time", {"truth": {**hydrostatic.TRUTH, "dead_time": 0.02}}),
        ("dry friction", {"machine": partial(hydrostatic.differ, friction=2.0)}),
        ("soft edges of the dead zone", {"machine": partial(hydrostatic.differ, soft=0.5)}),
    ],
)
def test_another_machine_is_told_from_the_noise_of_its_force(tmp_path, name, machine):
    """A noisy force was no reason to look for nothing: all of these passed."""
    table, named = missing(force(tmp_path, 0, **machine))
    assert named
    assert abs(table[name]["deviations"]) > 4.0


def test_noise_of_an_inlet_is_not_taken_for_a_lag(tmp_path):
    recordings = input_noise._line(np.random.default_rng(4), kind="multisine", noise=0.1)
    table, named = missing(fit(tmp_path, "line", recordings, input_noise.LINE_UNITS))
    assert not named
    lags = [e["deviations"] for term, e in table.items() if term.startswith("lag")]
    assert lags
    assert np.abs(lags).max() < 4.0
