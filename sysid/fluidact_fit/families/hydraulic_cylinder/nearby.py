"""Simulations near a gray-box fit, its initial states moved to first order only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...estimation.least_squares import orthonormal, without
from ...estimation.stribeck import EXPONENT, with_speed
from ...estimation.unmodelled_effects import slopes
from ...experiment import Experiment, FloatArray
from ...family import Plant, Simulate, Simulated
from .case import read_machine
from .gray_box import CHANNELS, GrayBox, mean_command
from .gray_search import GraySolution, moving_speeds
from .options import HydraulicCylinderOptions

_APART = 0.1  # of the exponent, between its two simulations and 2


def fall_slopes(
    plant: Plant[HydraulicCylinderOptions], experiments: Sequence[Experiment], simulate: Simulate
) -> list[dict[str, FloatArray]]:
    """Derivatives of all channels by how much slower friction falls off from rest."""
    less, more = (
        simulate(replace(plant, values={**plant.values, EXPONENT: 2.0 + by}), experiments)
        for by in (-_APART, _APART)
    )
    return slopes(more, less, CHANNELS[-1], 2.0 * _APART)


@dataclass(frozen=True)
class Nearby:
    """Simulation of the fitted runs with slightly other inputs, values or options.

    The search for initial states begins with derivatives, which cost most of it. Near the fit
    its own are as good: a change ``d`` of the channels becomes ``d - Q Q' d``, ``Q`` a basis of
    what the initial states can say.
    """

    solution: GraySolution

    def __call__(
        self, plant: Plant[HydraulicCylinderOptions], experiments: Sequence[Experiment]
    ) -> list[Simulated]:
        """Simulate the fitted runs or their beginnings, in their order; see `.Family.simulate`."""
        plain = with_speed(plant.numbers, moving_speeds(self.solution))
        box = replace(self.solution.problem.box, machine=read_machine(plant.options, (1, 2)))
        return [self._run(k, e, box, plain) for k, e in enumerate(experiments)]

    def _run(self, k: int, e: Experiment, box: GrayBox, values: Mapping[str, float]) -> Simulated:
        problem, n = self.solution.problem, e.samples
        states = self.solution.states[k][:n]
        log = replace(problem.logs[k].cut(0, n), command=mean_command(e))
        change = (box.simulate(log, states[0], values) - states).T[: len(CHANNELS)]
        channels, basis = list(log.channels), self._basis(k, n)
        kept = without(basis, problem.weighted(log, change.T)).reshape(len(channels), -1)
        change[channels] = kept * problem.sigma[channels, None]
        found = dict(zip(CHANNELS, states.T[: len(CHANNELS)] + change))
        return Simulated(found.pop(CHANNELS[-1]), also=found)

    def _basis(self, k: int, samples: int) -> FloatArray:
        """Orthonormal basis of the effect of a run's initial states on its first samples."""
        whole = self.solution.start_basis[k]
        if samples == self.solution.problem.logs[k].samples:
            return whole
        parts = whole.reshape(-1, self.solution.problem.logs[k].samples, whole.shape[1])
        return orthonormal(parts[:, :samples].reshape(-1, whole.shape[1]))
