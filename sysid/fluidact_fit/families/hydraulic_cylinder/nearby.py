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
from .gray_search import GrayPoint, moving_speeds
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
    what the initial states can say. ``runs`` are log and name of each fitted one.
    """

    fit: GrayPoint
    runs: Sequence[tuple[int, str]]

    def __call__(
        self, plant: Plant[HydraulicCylinderOptions], experiments: Sequence[Experiment]
    ) -> list[Simulated]:
        """Simulate some of the fitted runs, or their beginnings; see `.Family.simulate`."""
        values = with_speed(plant.numbers, moving_speeds(self.fit))
        box = replace(self.fit.problem.box, machine=read_machine(plant.options, (1, 2)))
        return [self._run(e, box, values) for e in experiments]

    def _run(self, e: Experiment, box: GrayBox, values: Mapping[str, float]) -> Simulated:
        problem, k, n = self.fit.problem, self.runs.index((e.log, e.name)), e.samples
        whole, states = problem.logs[k], self.fit.states[k][:n]
        log = replace(whole.cut(0, n), command=mean_command(e))
        change = (box.simulate(log, states[0], values) - states).T[: len(CHANNELS)]
        channels, basis = list(log.channels), self.fit.start_basis[k]
        if n < whole.samples:
            rows = basis.reshape(len(channels), whole.samples, -1)[:, :n]
            basis = orthonormal(rows.reshape(len(channels) * n, -1))
        kept = without(basis, problem.weighted(log, change.T)).reshape(len(channels), -1)
        change[channels] = kept * problem.sigma[channels, None]
        simulated = dict(zip(CHANNELS, states.T[: len(CHANNELS)] + change))
        return Simulated(simulated.pop(CHANNELS[-1]), also=simulated)
