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
from dataclasses import dataclass, replace

import numpy as np

from ...estimation.separable import Problem, Solution, evaluate
from ...estimation.uncertainty import fit_autoregression
from ...experiment import Experiment, FloatArray

_PAIRS = 16
Build = Callable[[Sequence[Experiment]], Problem]


def moving_inputs(experiments: Sequence[Experiment]) -> list[str]:
    """Roles that a sensor measured while they moved."""
    first = experiments[0]
    return [r for r, s in first.signals.items() if s.hold not in (None, "zoh") and s.time.size > 1]


@dataclass(frozen=True)
class InputNoise:
    """White noise of standard deviation ``sigma`` on the input ``role`` of some experiments.

    ``build`` makes the solver's problem of experiments, everywhere below.
    """

    experiments: Sequence[Experiment]
    role: str
    sigma: float
    rng: np.random.Generator

    def perturb(self) -> tuple[list[Experiment], list[Experiment]]:
        """Add one draw of noise to the input, and subtract it."""
        up: list[Experiment] = []
        down: list[Experiment] = []
        for e in self.experiments:
            s = e.signals[self.role]
            noise = self.sigma * self.rng.standard_normal(s.values.size)
            for out, sign in ((up, 1.0), (down, -1.0)):
                moved = replace(s, values=s.values + sign * noise)
                out.append(replace(e, signals={**e.signals, self.role: moved}))
        return up, down

    def share_of_residual(self, build: Build, solution: Solution) -> float:
        """Part of the residual variance that the noise explains."""
        moved = evaluate(build(self.perturb()[0]), solution.eta)
        change = sum(
            float(np.sum((a - b) ** 2)) for a, b in zip(moved.residuals, solution.residuals)
        )
        return change / max(solution.cost, 1e-300)

    def whitening(self, build: Build, solution: Solution, output_sigma: float) -> FloatArray:
        """Autoregression of what noise of input and output makes of the output, ``(order,)``.

        It is fitted to draws of that noise through the model, not to the residual: a fit has
        already absorbed the slow part of the latter, and integrated noise without its slow
        part looks far too harmless.
        """
        drawn = []
        for _ in range(4):
            for some in self.perturb():
                moved = evaluate(build(some), solution.eta)
                for now, before in zip(moved.simulated, solution.simulated):
                    white = output_sigma * self.rng.standard_normal(now.size)
                    drawn.append(now - before + white)
        shortest = min(r.size for r in drawn)
        return fit_autoregression(drawn, int(min(30, shortest // 10)))[0]

    def extrapolate_bias(self, build: Build, solution: Solution) -> tuple[FloatArray, FloatArray]:
        """Bias of ``(eta, linear)`` by the noise, and its sampling covariance.

        The noise is added once more, in antithetic pairs, and one Gauss-Newton step is taken
        from the estimate. The even part of the steps is what the noise that was already there
        has done to the estimate, their odd part how it makes the estimate scatter.

        Returns
        -------
        bias : (p,)
        covariance : (p, p)
            Of the estimate by the noise of the input, uncertainty of the bias included.
        """
        base = _step(evaluate(build(self.experiments), solution.eta))
        pairs = np.array([
            [_step(evaluate(build(some), solution.eta)) - base for some in self.perturb()]
            for _ in range(_PAIRS)
        ])  # fmt: skip
        even, odd = 0.5 * (pairs[:, 0] + pairs[:, 1]), 0.5 * (pairs[:, 0] - pairs[:, 1])
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
