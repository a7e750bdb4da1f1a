"""Noise on a measured input: how much of it there is, and what it does to the estimates.

An output-error fit takes its input to be exact. Noise of a load cell passes through the
model into the residual, where it is strongly autocorrelated (integrated, for a position), and
it blurs the edges of a dead zone, which biases them. The first is met by whitening the
residual with an autoregression (generalised least squares), the second by adding the same
noise once more and extrapolating back (SIMEX [1]_).

References
----------
.. [1] J. Cook, L. Stefanski, "Simulation-extrapolation estimation in parametric
   measurement error models", J. Am. Stat. Assoc. 89, 1994.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..experiment import Experiment, FloatArray
from .separable import Problem, Solution, evaluate
from .uncertainty import fit_autoregression

_PAIRS = 16


def moving_inputs(experiments: Sequence[Experiment]) -> list[str]:
    """Roles that a sensor measured while they moved."""
    first = experiments[0]
    return [r for r, s in first.signals.items() if s.hold not in (None, "zoh") and s.time.size > 1]


def perturb(
    experiments: Sequence[Experiment], role: str, sigma: float, rng: np.random.Generator
) -> tuple[list[Experiment], list[Experiment]]:
    """Add one draw of noise to an input, and subtract it."""
    up: list[Experiment] = []
    down: list[Experiment] = []
    for e in experiments:
        s = e.signals[role]
        noise = sigma * rng.standard_normal(s.values.size)
        for out, sign in ((up, 1.0), (down, -1.0)):
            moved = replace(s, values=s.values + sign * noise)
            out.append(replace(e, signals={**e.signals, role: moved}))
    return up, down


def share_of_residual(
    build: Callable[[Sequence[Experiment]], Problem],
    experiments: Sequence[Experiment],
    solution: Solution,
    role: str,
    sigma: float,
    rng: np.random.Generator,
) -> float:
    """Part of the residual variance that the noise of an input explains."""
    up, _ = perturb(experiments, role, sigma, rng)
    moved = evaluate(build(up), solution.eta)
    change = sum(float(np.sum((a - b) ** 2)) for a, b in zip(moved.residuals, solution.residuals))
    return change / max(solution.cost, 1e-300)


def whitening(
    build: Callable[[Sequence[Experiment]], Problem],
    experiments: Sequence[Experiment],
    solution: Solution,
    role: str,
    sigma: float,
    output_sigma: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Autoregression of what noise of input and output makes of the output, ``(order,)``.

    It is fitted to draws of that noise through the model, not to the residual: a fit has
    already absorbed the slow part of the latter, and integrated noise without its slow part
    looks far too harmless.
    """
    drawn = []
    for _ in range(4):
        for some in perturb(experiments, role, sigma, rng):
            moved = evaluate(build(some), solution.eta)
            for now, before in zip(moved.simulated, solution.simulated):
                drawn.append(now - before + output_sigma * rng.standard_normal(now.size))
    shortest = min(r.size for r in drawn)
    a, _ = fit_autoregression(drawn, int(min(30, shortest // 10)))
    return a


def extrapolate_bias(
    build: Callable[[Sequence[Experiment]], Problem],
    experiments: Sequence[Experiment],
    solution: Solution,
    role: str,
    sigma: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Bias of ``(eta, linear)`` by noise of an input, and its sampling covariance.

    The noise is added once more, in antithetic pairs, and one Gauss-Newton step is taken
    from the estimate. The even part of the steps is what the noise that was already there
    has done to the estimate, their odd part how it makes the estimate scatter.

    Returns
    -------
    bias : (p,)
    covariance : (p, p)
        Of the estimate by the noise of the input, uncertainty of the bias included.
    """
    here = evaluate(build(experiments), solution.eta)
    base = _step(here)
    steps, scatter = [], []
    for _ in range(_PAIRS):
        pair = [
            _step(evaluate(build(some), solution.eta)) - base
            for some in perturb(experiments, role, sigma, rng)
        ]
        steps.append(0.5 * (pair[0] + pair[1]))
        scatter.append(0.5 * (pair[0] - pair[1]))
    even, odd = np.array(steps), np.array(scatter)
    spread = np.cov(even.T).reshape(even.shape[1], -1)
    return even.mean(axis=0), odd.T @ odd / _PAIRS + spread * (1.0 + 1.0 / _PAIRS)


def _step(solution: Solution) -> FloatArray:
    """One Gauss-Newton step in ``(eta, linear)`` from a point that is no optimum."""
    j, r = np.vstack(solution.jacobian), np.concatenate(solution.residuals)
    scale = np.linalg.norm(j, axis=0)
    scale[scale == 0.0] = 1.0
    step = np.linalg.lstsq(j / scale, r, rcond=1e-12)[0] / scale
    # the shared linear unknowns are already at their optimum for this eta
    step[solution.eta.size :] += solution.linear
    return np.asarray(step)
