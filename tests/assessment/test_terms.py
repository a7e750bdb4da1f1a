"""Terms that a family declares: offsets and initial states that a fit was made without."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fluidact_fit.assessment.optimum import Optimum, Series
from fluidact_fit.assessment.score_test import Score, judge_term
from fluidact_fit.assessment.terms import terms_at_any_time
from fluidact_fit.estimation.unmodelled_effects import initial_states, output_offset
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.family import FamilyOptions, UnmodelledEffect

STEP, SAMPLES = 0.01, 600


class _Straight(Optimum):
    """An output that is proportional to its input, of runs that have been fitted."""

    def number(self, name: str) -> float:
        return 1.0


def judge(effect: UnmodelledEffect, missed: list[np.ndarray]) -> Score:
    """The score of an effect where the model of a gain misses some runs so."""
    rng = np.random.default_rng(4)
    series, residuals, jacobians = [], [], []
    for k, more in enumerate(missed):
        u, t = np.repeat(rng.standard_normal(SAMPLES // 20), 20), STEP * np.arange(SAMPLES)
        r = more + 0.1 * rng.standard_normal(SAMPLES)
        signals = {
            "inlet": Signal("inlet", t, u, "Pa", "zoh"),
            "outlet": Signal("outlet", t, u, "Pa"),
        }
        e = Experiment(f"log{k}", k, t, signals, STEP, True)
        series.append(Series(k, "outlet", e, u, np.ones(SAMPLES, dtype=bool)))
        residuals.append(r)
        jacobians.append(u[:, None])
    j, r = np.vstack(jacobians), np.concatenate(residuals)
    gain = float(j[:, 0] @ r) / float(j[:, 0] @ j[:, 0])
    error = np.sqrt(np.mean(r**2) / np.sum(j**2))
    family = SimpleNamespace(options_type=FamilyOptions, unmodelled_effects=lambda plant: [effect])
    solution = SimpleNamespace(
        parameters={}, plant=None, simulate_near=lambda plant, runs: [SimpleNamespace(
            output=e["inlet"], also={}) for e in runs],
    )  # fmt: skip
    fitted = [SimpleNamespace(experiment=s.experiment) for s in series]
    at = _Straight(
        family, get_family("line").variants[0], solution, fitted, ("gain",), np.array([error]),
        series, [x - gain * y[:, 0] for x, y in zip(residuals, jacobians)], jacobians,
    )  # fmt: skip
    term = next(t for t in terms_at_any_time(at) if t.name == effect.name)
    score = judge_term(at, term)
    assert score is not None
    return score


@pytest.mark.parametrize("offset", [0.0, 2.0])
def test_an_offset_that_was_left_out_is_found_with_its_size(offset: float) -> None:
    score = judge(output_offset("outlet"), [np.zeros(SAMPLES), np.full(SAMPLES, offset)])
    assert abs(score.deviations) < 3.0 or offset
    if offset:
        assert score.deviations > 20.0
        assert abs(score.size) == pytest.approx(offset, rel=0.05)


@pytest.mark.parametrize("start", [0.0, 3.0])
def test_an_initial_state_that_was_left_out_is_found_with_its_size(start: float) -> None:
    decay = 0.97 ** np.arange(SAMPLES)
    effect = initial_states("outlet", lambda e: decay[:, None])
    score = judge(effect, [np.zeros(SAMPLES), start * decay])
    assert abs(score.deviations) < 3.0 or start
    if start:
        assert score.deviations > 10.0
        assert abs(score.size) == pytest.approx(start, rel=0.1)
