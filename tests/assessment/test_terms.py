"""Terms that a family declares: offsets and initial states that a fit was made without."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from line_simulator import line_log, steps
from scipy import stats

import fluidact_fit as ff
from fluidact_fit.assessment.optimum import Optimum, Series
from fluidact_fit.assessment.score_test import TermScore, as_normal, judge_term
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


def judge(effect: UnmodelledEffect, missed: list[np.ndarray]) -> TermScore:
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
    assert isinstance(score, TermScore)
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


@pytest.mark.parametrize("change", [0.0, 0.08])
def test_a_gain_that_changes_while_a_log_is_recorded_is_said(change: float) -> None:
    """An output that fades evenly: its mean gain is right, and no part of the log has it."""
    said = []
    for seed in range(4):
        rng = np.random.default_rng([31, seed])
        log = line_log(rng, steps(rng, 0.3, 1.0, 0.01), time_constant=0.12, dead_time=0.0147,
                       step=0.01, span=20.0, noise=0.0)  # fmt: skip
        fading = 1.0 + change * (0.5 - log["time"] / log["time"][-1])
        outlet = fading * log["outlet"] + 0.02 * rng.standard_normal(fading.size)
        notices = ff.fit("line", {**log, "outlet": outlet}, hold={"inlet": "zoh"}).notices
        said.append(any("gain changes by -0.0" in n.message for n in notices))
    assert said == 4 * [bool(change)]


@pytest.mark.parametrize("degrees", [8, 20, 200])
@pytest.mark.parametrize("chosen", [1, 2, 9])
def test_deviations_are_those_of_a_normal_variable_that_are_as_rare(
    degrees: int, chosen: int
) -> None:
    """Student's t of one direction, F of the best of several, against the distributions."""
    for rare in (1e-2, 1e-4, 1e-6):
        if chosen == 1:
            found = as_normal(stats.t.isf(rare / 2.0, degrees), 1, degrees)
            assert found == pytest.approx(stats.norm.isf(rare / 2.0), rel=0.02)
            continue
        left = degrees - chosen + 1
        if left < 8:
            continue
        ratio = stats.f.isf(rare, chosen, left)
        found = as_normal(np.sqrt(chosen * ratio * degrees / left), chosen, degrees)
        assert found == pytest.approx(stats.norm.isf(rare), rel=0.06)
