"""The separable solver and the covariance, against textbook answers."""

from collections.abc import Callable

import numpy as np
import pytest

from fluidact_fit.estimation.agreement_of_logs import compare_logs
from fluidact_fit.estimation.least_squares import bounded_least_squares
from fluidact_fit.estimation.problem import Basis, Problem, Unknown
from fluidact_fit.estimation.separable import evaluate, solve, solve_from
from fluidact_fit.estimation.uncertainty import covariance, fit_autoregression, whiteness
from fluidact_fit.estimation.whitening import Whitening

FAR = np.array([0.3])  # a start


class Decay:
    """y = a exp(-k t) + offset, several logs."""

    def __init__(self, times: list[np.ndarray]) -> None:
        self.times = times

    def basis(self, index: int, eta: np.ndarray) -> Basis:
        t = self.times[index]
        return Basis(np.zeros(t.size), [np.exp(-eta[0] * t)], [np.ones(t.size)])


def make(seed: int = 0, logs: int = 2, **bounds: float) -> Problem:
    rng = np.random.default_rng(seed)
    times = [np.linspace(0.0, 3.0, 80) for _ in range(logs)]
    measured = [
        2.0 * np.exp(-1.5 * t) + k + 0.01 * rng.normal(size=80) for k, t in enumerate(times)
    ]
    linear = Unknown("a", bounds.get("low", -np.inf), bounds.get("high", np.inf))
    return Problem(Decay(times), measured, [Unknown("k", 0.0, 50.0)], [linear])


def test_recovers_shared_and_local_unknowns() -> None:
    found = solve(make(), FAR)
    assert found.converged
    u = covariance(found.jacobian, found.residuals, local_unknowns=2)
    errors = np.abs(np.array([found.eta[0] - 1.5, found.linear[0] - 2.0]))
    assert np.all(errors < 3.5 * np.sqrt(np.diag(u.covariance)))
    np.testing.assert_allclose([x[0] for x in found.local], [0.0, 1.0], atol=0.02)


def test_covariance_is_that_of_the_joint_problem() -> None:
    """Eliminating unknowns must not change the standard errors of those that stay."""
    problem = make()
    found = evaluate(problem, solve(problem, FAR).eta)
    rows = []
    for i, t in enumerate(problem.model.times):
        k, a = found.eta[0], found.linear[0]
        own = np.zeros((t.size, 2))
        own[:, i] = 1.0
        rows.append(np.column_stack((-a * t * np.exp(-k * t), np.exp(-k * t), own)))
    j = np.vstack(rows)
    s2 = found.cost / (j.shape[0] - 4)
    want = s2 * np.linalg.inv(j.T @ j)[:2, :2]
    got = covariance(found.jacobian, found.residuals, local_unknowns=2, robust=False).covariance
    np.testing.assert_allclose(got, want, rtol=1e-5)  # the fit stops at 1e-5 standard errors


class Residuals:
    """A model whose first rows are given functions of the unknowns, the others zero."""

    def __init__(self, function: Callable[[np.ndarray], np.ndarray], samples: int) -> None:
        self.function, self.samples = function, samples

    def basis(self, index: int, eta: np.ndarray) -> Basis:
        rows = self.function(eta)
        return Basis(np.append(rows, np.zeros(self.samples - rows.size)))


def test_a_fit_does_not_end_with_a_step_that_is_short_for_its_damping_alone() -> None:
    """Valleys that bend: a damped step along them is short and just as predicted (Rosenbrock)."""
    rng = np.random.default_rng(1)
    ends = 0
    for seed in range(60):
        (k, c), start = 10.0 ** rng.uniform(0.0, 2.0, 2), rng.uniform(-2.0, 2.0, 2)
        model = Residuals(lambda x: np.array([k * c * (x[1] - x[0] ** 2), c * (1.0 - x[0])]), 200)  # noqa: B023
        y = np.random.default_rng(seed).normal(size=200)
        problem = Problem(model, [y], [Unknown("a"), Unknown("b")])
        found = solve(problem, start, tolerance=1e-2)
        least = float(y[2:] @ y[2:])
        ends += found.converged
        assert not found.converged or found.cost - least < least / 198
    assert ends > 30


@pytest.mark.parametrize("slowness", [0.1, 0.3])
def test_a_fit_does_not_end_while_its_slowest_unknown_is_on_the_way(slowness: float) -> None:
    """One unknown gets there at once, the other by a part ``slowness`` less with every step."""
    y = np.random.default_rng(3).normal(size=200)
    y[:3] = 10.0, 0.0, 10.0
    model = Residuals(lambda x: np.array([x[0], x[1], 0.05 * slowness * x[1] ** 2]), 200)
    sigma = float(np.sqrt(y[2:] @ y[2:] / 198))
    begin = 0.025 * sigma / (1.0 - slowness) / slowness
    problem = Problem(model, [y], [Unknown("fast"), Unknown("slow")])
    found = solve(problem, np.array([0.0, begin]))
    assert abs(found.eta[1]) < 1e-4 * sigma


def test_slopes_that_a_fit_keeps_from_its_last_step_are_those_of_its_end() -> None:
    """A step of a few hundredths of a standard error is not worth the slopes at its end."""
    problem = make()
    found = solve(problem, FAR)
    there = evaluate(problem, found.eta)
    kept, exact = (
        covariance(s.jacobian, s.residuals, local_unknowns=2, robust=False) for s in (found, there)
    )
    np.testing.assert_allclose(kept.covariance, exact.covariance, rtol=1e-3)


def test_bounds_of_linear_and_nonlinear_unknowns_hold() -> None:
    assert solve(make(low=2.5), FAR).linear[0] == pytest.approx(2.5)
    problem = make()
    tight = Problem(problem.model, problem.measured, [Unknown("k", 0.0, 1.2)], problem.linear)
    found = solve(tight, FAR)
    assert found.eta[0] == pytest.approx(1.2)


def test_bounded_least_squares_satisfies_its_optimality_conditions() -> None:
    rng = np.random.default_rng(3)
    a, y = rng.normal(size=(40, 4)), rng.normal(size=40)
    low, high = np.zeros(4), np.full(4, 0.1)
    x, active = bounded_least_squares(a, y, low, high)
    gradient = a.T @ (a @ x - y)
    assert np.all((x >= low) & (x <= high))
    assert np.all(np.abs(gradient[~active]) < 1e-9)
    assert np.all(gradient[x == low] >= -1e-9)
    assert np.all(gradient[x == high] <= 1e-9)


def test_search_counts_the_starts_that_agree() -> None:
    found = solve_from(make(), [np.array([0.2]), np.array([1.0]), np.array([6.0])])
    assert found.tried == 3
    assert found.agreeing >= 2


def test_whitened_fit_is_generalised_least_squares() -> None:
    """With the true autoregression the whitened estimate scatters less than the plain one."""
    plain, white = [], []
    for seed in range(60):
        rng = np.random.default_rng([5, seed])
        problem = make(seed, logs=1)
        noise = np.zeros(80)
        for k in range(1, 80):
            noise[k] = 0.9 * noise[k - 1] + 0.01 * rng.normal()
        t = problem.model.times[0]
        y = [2.0 * np.exp(-1.5 * t) + noise]
        base = Problem(problem.model, y, problem.nonlinear, problem.linear)
        near = np.array([1.2])
        plain.append(solve(base, near).eta[0])
        filtered = Problem(
            problem.model,
            y,
            problem.nonlinear,
            problem.linear,
            whiten=[Whitening(np.array([0.9]), 0.01, 0.0)],
        )
        white.append(solve(filtered, near).eta[0])
    assert np.std(white) < 0.97 * np.std(plain)
    assert abs(np.mean(white) - 1.5) < 4.0 * np.std(white) / np.sqrt(60)


def test_autoregression_is_found() -> None:
    rng = np.random.default_rng(8)
    e = np.zeros(20_000)
    for k in range(2, e.size):
        e[k] = 1.2 * e[k - 1] - 0.5 * e[k - 2] + rng.normal()
    a, variance = fit_autoregression([e], 10)
    assert a[0] == pytest.approx(1.2, abs=0.03)
    assert a[1] == pytest.approx(-0.5, abs=0.03)
    assert variance == pytest.approx(1.0, abs=0.05)


def test_whiteness_has_the_level_it_claims() -> None:
    rng = np.random.default_rng(2)
    p = [whiteness([rng.normal(size=300)]).p_value for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09
    assert whiteness([np.cumsum(rng.normal(size=300))]).p_value < 1e-6


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_robust_covariance_covers(rho: float) -> None:
    """A mean with coloured noise: the interval holds the truth as often as it says."""
    hits = 0
    for seed in range(300):
        rng = np.random.default_rng([9, seed])
        e = np.zeros(700)
        for k in range(1, 700):
            e[k] = rho * e[k - 1] + rng.normal()
        e = e[200:]
        j = np.ones((500, 1))
        u = covariance([j], [e - e.mean()], small_sample=True)
        hits += abs(e.mean()) < 1.96 * np.sqrt(u.covariance[0, 0])
    assert hits / 300 > 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / 300) - 0.01


def test_a_standing_reading_has_a_standing_error() -> None:
    """Ten plateaus of a converter are ten measurements, however often they are read."""
    rng = np.random.default_rng(1)
    errors, claimed = [], []
    for _ in range(300):
        y = np.repeat(np.round(rng.uniform(0, 50, 10) * 2.0) / 2.0, 100)
        error = np.repeat(rng.uniform(-0.25, 0.25, 10), 100)
        errors.append(error.mean())
        r = error - error.mean()
        u = covariance([np.ones((1000, 1))], [r], readings=[(y, 0.5)])
        claimed.append(np.sqrt(u.covariance[0, 0]))
    assert np.median(claimed) > 0.8 * np.std(errors)


def test_the_odd_log_is_named() -> None:
    rng = np.random.default_rng(0)
    jacobian, residuals = [], []
    for k in range(6):
        j = rng.normal(size=(200, 2))
        shift = np.array([0.3, 0.0]) if k == 4 else np.zeros(2)
        jacobian.append(j)
        residuals.append(j @ shift + 0.1 * rng.normal(size=200))
    drifts, left_out = compare_logs(jacobian, residuals, range(6), ["mass", "damping"])
    assert (drifts[0].log, drifts[0].parameter) == (4, "mass")
    assert drifts[0].p_value < 1e-6
    assert drifts[0].difference == pytest.approx(0.3, abs=0.05)
    assert all(d.p_value > 1e-3 for d in drifts[1:])
    assert max(left_out, key=left_out.__getitem__) == 4
