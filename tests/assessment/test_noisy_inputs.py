"""Noise of a measured input is in the residual and in what is looked for there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.red_team.attacks import spring_cylinder as spring
from studies.red_team.run import write

import fluidact_fit as ff

RISING = {**spring.TRUTH, "stribeck": 2.0, "stribeck_speed": 0.004}


def _fit(folder: Path, seed: int, **machine: object) -> ff.FitResult:
    (recording,) = spring.log(np.random.default_rng(seed), **machine)  # type: ignore[arg-type]
    return ff.fit("spring-cylinder", [write(folder / "x.csv", recording, spring.UNITS)])


def _scores(result: ff.FitResult) -> dict[str, float]:
    """Standard errors of every term that was tried."""
    table = result.document.fit.details["missing_response"]
    return {name: abs(entry["deviations"]) for name, entry in table.items()}


@pytest.mark.parametrize(
    "machine",
    [
        {"noise": {"position": 1e-4}},
        {"noise": {"position": 2e-4}, "stroke": 0.003},
        {"noise": {"position": 2e-4, "velocity": 1e-3}, "velocity": True},
        {"noise": {"pressure": 1e4}, "p": spring.BY_PRESSURE},
    ],
)
def test_noise_of_an_input_is_no_missing_response(
    tmp_path: Path, machine: dict[str, object]
) -> None:
    # with noise e of a column a x the delay by one sample has the mean a^2 sigma^2 with the
    # residual: 24 to 156 standard errors where the noise was not kept out
    for seed in range(3):
        result = _fit(tmp_path, seed, **machine)
        assert result.verdict == "pass", result.notices
        scores = _scores(result)
        # the largest of some eight normal variables, in 24 draws: 3.3 on average
        assert max(scores.values()) < 5.0, scores
        assert len(scores) >= 8


def test_real_motion_at_the_sampling_rate_is_no_missing_response(tmp_path: Path) -> None:
    def shake(r: spring.Recording, rng: np.random.Generator) -> spring.Recording:
        return spring._spoil(r, rng, "vibration")

    result = _fit(tmp_path, 0, spoil=shake)
    assert result.verdict == "pass", result.notices


def late(rows: int, role: str) -> spring.Spoil:
    """A channel that is read some rows late."""

    def spoil(r: spring.Recording, rng: np.random.Generator) -> spring.Recording:
        x = r[role]
        return {**r, role: np.concatenate((np.full(rows, x[0]), x[:-rows]))}

    return spoil


@pytest.mark.parametrize(
    ("machine", "word"),
    [
        ({"noise": {"position": 2e-5}, "p": RISING}, "stribeck"),
        ({"noise": {"velocity": 1e-3}, "p": RISING, "velocity": True}, "stribeck"),
        ({"noise": {"position": 1e-4}, "spoil": late(8, "position")}, "earlier"),
        ({"noise": {"position": 1e-4}, "spoil": lambda r, g: spring._spoil(r, g, "drift")},
         "drifts"),
    ],
)  # fmt: skip
def test_what_is_missing_is_seen_through_noise_of_an_input(
    tmp_path: Path, machine: dict[str, object], word: str
) -> None:
    for seed in range(2):
        result = _fit(tmp_path, seed, **machine)
        said = [n.message for n in result.notices if n.code == "unmodelled-response"]
        assert len(said) == 1
        assert word in said[0] or "lead" in said[0]


def test_the_lateness_of_a_held_column_is_that_of_the_log(tmp_path: Path) -> None:
    # a column read at its samples moves by a whole sample or not at all: 10 ms each
    result = _fit(tmp_path, 0, sigma=0.03, stroke=0.06, spoil=late(3, "position"))
    entry = result.document.fit.details["missing_response"]["delay of position"]
    assert entry["size"] == pytest.approx(-0.03, rel=0.35)
