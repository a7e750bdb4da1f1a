"""The corrected score: consistent where output error is biased, and how noise is recognised."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import lfilter

from fluidact_fit.estimation.input_noise import InputNoise, correct, moving_inputs
from fluidact_fit.estimation.noise import white_level
from fluidact_fit.estimation.problem import Basis, Problem, Unknown
from fluidact_fit.estimation.separable import evaluate, solve
from fluidact_fit.estimation.whitening import Whitening
from fluidact_fit.experiment import Experiment, Signal

POLE, GAIN = 0.8, 2.0
N, STEP = 1500, 0.01


class FirstOrder:
    """``y[k] = pole y[k-1] + (1 - pole) gain u[k-1]``: linear in the input."""

    def __init__(self, experiments: Sequence[Experiment]) -> None:
        self.inputs = [e["u"] for e in experiments]

    def basis(self, index: int, eta: np.ndarray) -> Basis:
        pole, gain = eta
        b = np.array([0.0, (1.0 - pole) * gain])
        known = lfilter(b, np.array([1.0, -pole]), self.inputs[index])
        return Basis(known, local=[np.ones(N)])


def record(
    seed: int, noise: float, output_noise: float = 0.02,
    frequencies: Sequence[float] = (0.2, 0.7, 1.6, 3.1, 5.0),
) -> Experiment:  # fmt: skip
    rng = np.random.default_rng([4, seed])
    t = STEP * np.arange(N)
    f = np.array(frequencies)
    u = np.sin(2.0 * np.pi * np.outer(t, f) + rng.uniform(0.0, 6.0, 5)).sum(axis=1)
    y = lfilter([0.0, (1.0 - POLE) * GAIN], [1.0, -POLE], u)
    y = y + output_noise * rng.standard_normal(N)
    seen = u + noise * rng.standard_normal(N)
    signals = {"u": Signal("u", t, seen, "1", "foh"), "y": Signal("y", t, y, "1")}
    return Experiment("log", 0, t, signals, STEP, True)


def build(experiments: Sequence[Experiment], whiten: Sequence[object] = ()) -> Problem:
    unknowns = [Unknown("pole", 0.0, 1.0), Unknown("gain")]
    measured = [e["y"] for e in experiments]
    return Problem(FirstOrder(experiments), measured, unknowns, whiten=whiten)


def fits(noise: float, runs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Output error, corrected estimates and their errors in standard errors."""
    plain, corrected, deviations = [], [], []
    for seed in range(runs):
        e = [record(seed, noise)]
        start = solve(build(e), np.array([0.7, 1.5])).eta
        found = correct(InputNoise(e, "u", noise), build, start)
        assert found.converged
        plain.append(start)
        corrected.append(found.eta)
        deviations.append((found.eta - [POLE, GAIN]) / np.sqrt(np.diag(found.covariance)))
    return np.array(plain), np.array(corrected), np.array(deviations)


def test_the_correction_is_consistent_where_output_error_is_not() -> None:
    plain, corrected, deviations = fits(noise=0.7, runs=10)
    error = corrected.std(axis=0) / np.sqrt(10)
    assert np.all(np.abs(corrected.mean(axis=0) - [POLE, GAIN]) < 4.0 * error)
    assert abs(plain[:, 0].mean() - POLE) > 5.0 * plain[:, 0].std() / np.sqrt(10)
    assert np.mean(np.abs(deviations) < 1.96) > 0.8
    assert 0.5 < np.sqrt(np.mean(deviations**2)) < 1.5


def test_a_slow_input_with_noise_is_used_as_well_as_can_be() -> None:
    """Where frequencies without any input counted like all others, the pole erred 16 times more."""
    noise, white, slow = 0.3, 0.005, (0.07, 0.13, 0.2, 0.29, 0.37)
    errors, stated, bounds = [], [], []
    for seed in range(20):
        e, clean = ([record(seed, n, white, slow)] for n in (noise, 0.0))
        start = solve(build(e), np.array([0.7, 1.5])).eta
        found = correct(InputNoise(e, "u", noise), build, start)
        errors.append(found.eta - [POLE, GAIN])
        stated.append(np.sqrt(np.diag(found.covariance)))
        filtered = Whitening(np.array([POLE]), (1.0 - POLE) * GAIN * noise, white)
        exact = evaluate(build(clean, [filtered]), np.array([POLE, GAIN])).jacobian[0]
        bounds.append(np.sqrt(np.diag(np.linalg.inv(exact.T @ exact))))
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bound
    said = np.sqrt(np.mean(np.square(stated), axis=0)) / bound
    assert np.all(ratio < 1.4)  # twenty runs know it to a sixth
    assert np.all((said > 0.8) & (said < 1.3))


class BehindDeadZone(FirstOrder):
    """``y[k] = y[k-1] + gain max(u[k-1] - edge, 0)``: noise passes while it moves, and stays."""

    def basis(self, index: int, eta: np.ndarray) -> Basis:
        edge, gain = eta
        driving = np.where(np.real(self.inputs[index] - edge) > 0.0, self.inputs[index] - edge, 0.0)
        known = gain * np.concatenate(([0.0], np.cumsum(driving)[:-1])) / N
        return Basis(known, local=[np.ones(N)])


def test_noise_that_passes_while_the_output_moves_widens_the_intervals() -> None:
    """Residuals white all in all are not where the derivatives are: 1.5 deviations before."""
    edge, gain, noise, deviations = 0.5, 3.0, 0.2, []
    unknowns = [Unknown("edge"), Unknown("gain")]

    def build(experiments: Sequence[Experiment], whiten: Sequence[object] = ()) -> Problem:
        measured = [e["y"] for e in experiments]
        return Problem(BehindDeadZone(experiments), measured, unknowns, whiten=whiten)

    for seed in range(60):
        clean = record(seed, 0.0)
        rng = np.random.default_rng([5, seed])
        y = BehindDeadZone([clean]).basis(0, np.array([edge, gain])).known
        e = clean.with_readings("y", y + 0.002 * rng.standard_normal(N))
        e = e.with_readings("u", clean["u"] + noise * rng.standard_normal(N))
        found = correct(InputNoise([e], "u", noise), build, np.array([edge, gain]))
        deviations.append((found.eta - [edge, gain]) / np.sqrt(np.diag(found.covariance)))
    size = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert np.all(size > 0.7)
    assert np.all(size < 1.35)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_correction_settles_wherever_it_starts(seed: int) -> None:
    """Its first step may be long or short in standard errors, with or without what noise adds."""
    e = [record(seed, 0.7)]
    noise = InputNoise(e, "u", 0.7)
    found = correct(noise, build, solve(build(e), np.array([0.7, 1.5])).eta)
    errors = np.sqrt(np.diag(found.covariance))
    for far in (0.2, 0.5, 0.7, 0.8, 0.9, 0.95, 1.05, 1.5, 3.0):
        again = correct(noise, build, found.eta + far * errors * [1.0, -1.0])
        assert again.converged
        assert np.all(np.abs(again.eta - found.eta) < 0.2 * errors)


def test_the_log_shows_its_noise() -> None:
    noise = InputNoise.seen([record(1, 0.3)], "u", 0)
    assert noise.sigma == pytest.approx(0.3, rel=0.1)
    at = np.array([POLE, GAIN])
    assert noise.supported(build, at).sigma == noise.sigma
    assert moving_inputs(noise.experiments) == ["u"]


def test_motion_is_not_taken_for_noise() -> None:
    """A clean input that jumps at every sample: the residual says that it is clean."""
    e = record(2, 0.0)
    rng = np.random.default_rng(3)
    u = rng.uniform(-1.0, 1.0, N)
    y = lfilter([0.0, (1.0 - POLE) * GAIN], [1.0, -POLE], u) + 0.02 * rng.standard_normal(N)
    signals = {"u": Signal("u", e.time, u, "1", "foh"), "y": Signal("y", e.time, y, "1")}
    clean = [Experiment("log", 0, e.time, signals, STEP, True)]
    seen = InputNoise.seen(clean, "u", 0)
    assert seen.sigma > 0.3
    assert seen.supported(build, np.array([POLE, GAIN])).sigma == 0.0


def test_level_of_noise_on_a_signal_that_moves() -> None:
    rng = np.random.default_rng(5)
    t = np.linspace(0.0, 20.0, 2000)
    fast = np.sin(2.0 * np.pi * 6.0 * t)
    sigma, relative = white_level(fast + 0.01 * rng.standard_normal(t.size))
    assert sigma == pytest.approx(0.01, rel=0.15)
    assert 0.03 < relative < 0.2
    assert white_level(fast)[0] < 1e-3
    steps = np.repeat(rng.uniform(size=40), 50)
    assert white_level(steps + 0.01 * rng.standard_normal(2000))[0] == pytest.approx(0.01, rel=0.15)
    assert white_level(np.round(steps, 1), 0.1)[0] == pytest.approx(0.1 / np.sqrt(12.0))


def test_levels_of_a_command_are_no_converter() -> None:
    e = record(6, 0.0)
    command = Signal("u", e.time, np.sign(e["u"]), "1", "zoh", resolution=2.0)
    held = Experiment("log", 0, e.time, {**e.signals, "u": command}, STEP, True)
    assert InputNoise.seen([held], "u", 0).sigma == 0.0


def test_levels_that_were_commanded_carry_no_noise() -> None:
    rng = np.random.default_rng(4)
    t = 0.08 * np.arange(300)
    levels = rng.choice([3.41, 6.41], t.size)
    noisy = levels + 0.01 * rng.standard_normal(t.size)
    for values, step, exact in ((levels, 3.0, True), (noisy, 1e-5, False)):
        signal = Signal("inlet", t, values, "Pa", hold="zoh", resolution=step)
        run = Experiment("log", 0, t, {"inlet": signal}, 0.08, True)
        assert (InputNoise.seen([run], "inlet", 0).sigma == 0.0) == exact
