"""What one stage of the fit hands on to the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...estimation.parametric import bind
from ...estimation.results import Refusal
from ...estimation.separable import Problem, Solution, Unknown, solve
from ...experiment import Experiment, FloatArray
from .model import Axis, Compared, DriveModel


@dataclass(frozen=True)
class Stage:
    """State of a fit between two of its stages.

    Attributes
    ----------
    names, unknowns
        Parameters of the model and initial speeds, those that are held included.
    start
        Where the search now is [SI].
    fixed, refusals
        What the user gave (or a bracket found), and what the data cannot determine.
    """

    experiments: Sequence[Experiment]
    axis: Axis
    names: tuple[str, ...]
    unknowns: Mapping[str, Unknown]
    start: Mapping[str, float]
    fixed: Mapping[str, float] = field(default_factory=dict)
    refusals: tuple[Refusal, ...] = ()

    @property
    def held(self) -> dict[str, float]:
        """Values that are held while the rest is fitted: what was refused, and what is given."""
        return {**{r.parameter: float(r.hold or 0.0) for r in self.refusals}, **self.fixed}

    @property
    def largest_drive(self) -> float:
        """Largest torque or force [SI]."""
        return max(float(np.abs(e.sampled(self.axis.drive)).max()) for e in self.experiments)

    @property
    def resolution(self) -> float:
        """Coarsest step of the encoders [SI]."""
        return max(e.signals[self.axis.motion].resolution for e in self.experiments)

    def problem(
        self, compared: Compared | None = None, weights: Sequence[FloatArray] = ()
    ) -> Problem:
        """The solver's problem of everything that is not held."""
        model = DriveModel(self.experiments, self.axis, compared)
        return bind(model.named(self.names, weights), self.unknowns, self.held)

    def solve(self, problem: Problem, max_iterations: int, tolerance: float) -> Solution:
        """Solve a problem from where the search now is."""
        eta = np.array([self.start[u.name] for u in problem.nonlinear])
        return solve(problem, eta, max_iterations=max_iterations, tolerance=tolerance)
