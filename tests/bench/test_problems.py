"""The benchmark's simulators against brute force, its bounds against a fit."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares


def _load() -> ModuleType:
    path = Path(__file__).parents[2] / "bench" / "problems.py"
    spec = importlib.util.spec_from_file_location("bench_problems", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


P = _load()


def test_hand_moved_mass_agrees_with_an_integrator() -> None:
    problem = P.PROBLEMS["P1"]
    trial, p = P.make_trial(problem, 0), problem.truth
    fine = np.arange(trial.drive.size) * problem.sample_time / P.FINE

    def rate(t: float, x: np.ndarray) -> list[float]:
        force = P.dead_zone(np.interp(t, fine, trial.drive), p["dz_neg"], p["dz_pos"])
        return [x[1], float(force - p["c"] * x[1]) / p["m"]]

    t = trial.log.t[:200]
    found = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-12,
                      max_step=1e-3)  # fmt: skip
    assert np.abs(found.y[0] - trial.clean[:200]).max() < 1e-3 * trial.sigma


@pytest.mark.parametrize("damping", [0.3, 1.0, 2.5])
def test_valve_agrees_with_small_steps(damping: float) -> None:
    theta, u = {"wn": 20.0, "z": damping}, np.repeat([0.0, 1.0, -0.5, 0.2], 25)
    y = P.valve(theta, u, 0.01)
    again = P.valve(theta, np.repeat(u, 50), 0.01 / 50)[::50]
    assert y == pytest.approx(again, abs=1e-9)

    def rate(t: float, x: np.ndarray) -> list[float]:
        return [x[1], 400.0 * (u[min(int(t / 0.01 + 1e-9), 99)] - x[0]) - 40.0 * damping * x[1]]

    found = solve_ivp(rate, (0.0, 0.99), [0.0, 0.0], t_eval=np.arange(100) * 0.01,
                      rtol=1e-9, atol=1e-10, max_step=1e-3)  # fmt: skip
    assert found.y[0] == pytest.approx(y, abs=2e-4)


@pytest.mark.parametrize("dead", [0.0, 0.0003, 0.01, 0.0147, 0.02, 0.0999])
def test_line_agrees_with_a_grid_on_which_the_dead_time_is_whole(dead: float) -> None:
    rng = np.random.default_rng(1)
    u = P.multistep(rng, 300, 0.01)
    h = 1e-4
    late = np.concatenate((np.zeros(round(dead / h)), np.repeat(u, 100)))[: 300 * 100]
    a, y = np.exp(-h / 0.12), np.zeros(late.size)
    for k in range(late.size - 1):
        y[k + 1] = a * y[k] + 0.9 * (1.0 - a) * late[k]
    assert P.line({"K": 0.9, "tau": 0.12, "L": dead}, u, 0.01) == pytest.approx(y[::100], abs=1e-9)


def test_stick_slip_agrees_with_tiny_steps() -> None:
    problem = P.PROBLEMS["P4"]
    trial, p = P.make_trial(problem, 1), problem.truth
    samples, per = 150, 60
    h = problem.sample_time / P.FINE / per
    angle = speed = 0.0
    way, out = 0, []
    for i in range(samples * P.FINE):
        if i % P.FINE == 0:
            out.append(angle)
        for k in range(per):
            torque = trial.drive[i] + (trial.drive[i + 1] - trial.drive[i]) * (k + 0.5) / per
            if way == 0:
                way = 1 if torque > p["fsp"] else -1 if torque < -p["fsn"] else 0
            if way == 0:
                continue
            friction = p["fkp"] if way > 0 else -p["fkn"]
            new = speed + h / p["J"] * (torque - p["b"] * speed - friction)
            angle += h * 0.5 * (speed + new) if new * way > 0.0 else 0.0
            speed, way = (new, way) if new * way > 0.0 else (0.0, 0)
    assert np.ptp(out) > 100.0 * P.COUNT
    assert np.abs(np.array(out) - trial.clean[:samples]).max() < 0.06 * P.COUNT


@pytest.mark.parametrize("name", ["P1", "P2", "P3"])
def test_an_exact_fit_scatters_by_the_bound(name: str) -> None:
    problem = P.PROBLEMS[name]
    scale = np.array(list(problem.truth.values()))
    ratios = []
    for number in range(8):
        trial = P.make_trial(problem, number)
        size = float(np.std(trial.log.y))

        def residual(x: np.ndarray, trial: object = trial, size: float = size) -> np.ndarray:
            theta = dict(zip(problem.truth, x * scale))
            return (P.simulate(problem, theta, trial) - trial.log.y) / size

        found = least_squares(residual, np.ones(scale.size), x_scale="jac").x * scale
        bounds = np.array(list(P.bound(problem, trial).values()))
        ratios.append((found - scale) / bounds)
    assert 0.6 < float(np.sqrt(np.mean(np.square(ratios)))) < 1.4


def test_trials_are_reproducible_and_differ() -> None:
    for problem in P.PROBLEMS.values():
        first, again, other = (P.make_trial(problem, k) for k in (0, 0, 1))
        assert np.array_equal(first.log.y, again.log.y)
        assert not np.array_equal(first.log.u, other.log.u)


def test_variations_keep_the_guess_and_change_the_machine() -> None:
    assert P.vary(0, 5)["P1"].truth == P.PROBLEMS["P1"].truth
    for number in (1, 2):
        for name, problem in P.vary(number).items():
            if name == "P4" and number > 1:
                continue  # its bound takes a second
            assert problem.guess == P.PROBLEMS[name].guess
            assert problem.truth != P.PROBLEMS[name].truth
            trial = P.make_trial(problem, 0)
            assert trial.log.y.size == problem.samples
            assert all(v > 0.0 for v in P.bound(problem, trial).values())
