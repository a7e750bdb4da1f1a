"""Simulations of a search: what one is, and that no fit takes more than it may."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fluidact_fit as ff
from dataset_fits import fit_dataset
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import NotIdentifiedError
from fluidact_fit.estimation import budget
from fluidact_fit.estimation.budget import counting, exhausted, simulated
from fluidact_fit.estimation.network import Training, search
from fluidact_fit.estimation.problem import Basis, Problem, Unknown
from fluidact_fit.estimation.separable import evaluate, solve
from fluidact_fit.estimation.stribeck import RiseSearch

TIME = np.linspace(0.0, 3.0, 80)
SEARCHING = [
    "ball-screw", "potentiometer", "hydrostatic", "valve", "line", "hydraulic-motor", "force-map",
    "hydraulic-cylinder",
]  # fmt: skip


class Decay:
    """y = exp(-k t) + offset in two logs, every pass noted by its samples."""

    def __init__(self) -> None:
        self.passes: list[int] = []

    def basis(self, index: int, eta: np.ndarray) -> Basis:
        self.passes.append(TIME.size)
        return Basis(np.exp(-eta[0] * TIME), local=[np.ones(TIME.size)])


class Sloped(Decay):
    """The same with its own derivatives, which it says of two logs at once."""

    def slopes(self, index: int, eta: np.ndarray) -> np.ndarray:
        at = self.basis(index, eta)
        self.passes.append(TIME.size)
        return -(TIME * at.known)[None]


def problem(model: Decay) -> Problem:
    rng = np.random.default_rng(0)
    measured = [np.exp(-1.5 * TIME) + k + 0.01 * rng.normal(size=80) for k in range(2)]
    return Problem(model, measured, [Unknown("k", 0.0, 50.0)])


@pytest.mark.parametrize("kind", [Decay, Sloped])
def test_every_pass_and_every_derivative_counts(kind: type[Decay]) -> None:
    model = kind()
    with counting(2 * TIME.size) as paid:
        solve(problem(model), np.array([0.3]))
    assert len(model.passes) > 10
    assert paid.spent == pytest.approx(sum(model.passes) / (2 * TIME.size))


def test_part_of_the_logs_counts_by_its_share() -> None:
    """One log of ten as long: a pass over it, and its derivative."""
    single = problem(Decay())
    with counting(10 * TIME.size) as paid:
        evaluate(replace(single, measured=single.measured[:1]), np.array([1.5]))
    assert paid.spent == pytest.approx(0.2)


def test_functions_of_the_same_samples_are_one_simulation() -> None:
    with counting(TIME.size) as paid:
        evaluate(replace(problem(Decay()), channels=2), np.array([1.5]))
    assert paid.spent == pytest.approx(2.0)


def test_nothing_is_counted_where_nobody_asks() -> None:
    simulated(1e9)
    assert not exhausted()


def test_a_search_ends_where_it_may_not_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "PASSES", 0.0)
    monkeypatch.setattr(budget, "AT_MOST", 12)
    with counting(2 * TIME.size) as paid:
        found = solve(problem(Decay()), np.array([0.3]))
    assert not found.converged
    assert 6.0 <= paid.spent <= 12.0
    assert solve(problem(Decay()), np.array([0.3])).iterations > found.iterations


def test_training_of_a_network_ends_there_too(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((200, 2))
    y = np.abs(x[:, 0]) - x[:, 1]
    monkeypatch.setattr(budget, "PASSES", 0.0)
    monkeypatch.setattr(budget, "AT_MOST", 100)
    with counting(y.size) as paid:
        search(x, y, Training((3,), starts=4), rng)
    assert 50.0 <= paid.spent <= 100.0


def test_beyond_its_bound_nothing_is_simulated() -> None:
    with counting(10) as paid, pytest.raises(NotIdentifiedError, match="does not end within"):
        simulated(11 * paid.at_most)
    assert paid.spent == 0.0


@pytest.mark.parametrize("family", SEARCHING)
def test_the_file_says_what_the_search_has_cost(family: str) -> None:
    """Far from the bound: nothing that fits well comes near it."""
    result = fit_dataset(family)
    said = (result.document.fit.details or {})["search"]
    assert 1 < said["simulations"] < 0.2 * said["at_most"]
    assert "search-bounded" not in {n.code for n in result.document.warnings}


@pytest.mark.parametrize("family", ["cylinder-friction", "spring-cylinder"])
def test_a_regression_simulates_nothing(family: str) -> None:
    assert "search" not in (fit_dataset(family).document.fit.details or {})


def test_every_speed_at_which_a_rise_is_sought_is_one_simulation() -> None:
    tried: list[float] = []

    def misfit(speed: float) -> tuple[float, float]:
        tried.append(speed)
        return (np.log(speed / 0.05)) ** 2, 1.0

    with counting(1000) as paid:
        _, _, speed = RiseSearch((0.001, 1.0), 20, misfit).rise
    assert speed == pytest.approx(0.05, rel=1e-3)
    assert paid.spent == len(tried) > 16


@pytest.mark.parametrize("family", SEARCHING)
def test_a_fit_of_every_family_ends_at_its_bound(
    family: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With few simulations it ends early and says so, with hardly any it writes nothing.

    Searches end at half of what is allowed, and may leave more to be done after them.
    """
    dataset, taken = load_dataset(family), fit_dataset(family).document.fit.details or {}
    most = int(1.1 * taken["search"]["simulations"])
    monkeypatch.setattr(budget, "PASSES", 0.0)
    monkeypatch.setattr(budget, "AT_MOST", most)
    result = ff.fit(family, dataset.read(), **dataset.options)
    said = (result.document.fit.details or {})["search"]
    assert said["at_most"] == most
    assert 0.5 * most <= said["simulations"] <= most
    assert "search-bounded" in {n.code for n in result.document.warnings}
    monkeypatch.setattr(budget, "AT_MOST", 2)
    with pytest.raises(NotIdentifiedError, match="does not end within 2 simulations"):
        ff.fit(family, dataset.read(), **dataset.options)
