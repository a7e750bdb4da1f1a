"""Effects outside the models of several families; see :class:`.UnmodelledEffect`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..experiment import Experiment, FloatArray
from ..specification import Plant, Simulate, Simulated, UnmodelledEffect

_SOFT = 0.03  # share of the range of a command over which an edge opens


def soft_edges(plant: Plant[Any], role: str, edges: tuple[float, float]) -> UnmodelledEffect:
    """Effect of a dead zone whose edges open gradually, as those of a notched spool do.

    Beyond the edge ``a`` the effective command is ``r ln(1 + exp((u - a) / r))`` in place of
    ``max(u - a, 0)``, ``r`` a small part of the range: the largest change is ``r ln 2``, at the
    edge itself.
    """
    return UnmodelledEffect(
        "soft edges of the dead zone",
        f"'{role}' acts gradually, not at once, where it leaves the dead zone",
        "Edges and slope beside them depend on the shape that is supposed: use them within the "
        "commands of the logs only, or fit commands far from the edges by themselves.",
        partial(_softened, plant, role, edges),
        positive=True,
        of=role,
    )


def output_offset(role: str) -> UnmodelledEffect:
    """Effect of an output offset of every log, for a fit without any (``--offset none``)."""
    return UnmodelledEffect(
        "output offset",
        f"'{role}' has an offset of its own in every log",
        "Zero the sensor before a log, or fit offsets with --offset free.",
        partial(_levels, role),
        of=role,
        offered=True,
    )


def _levels(
    role: str, experiments: Sequence[Experiment], simulate: Simulate
) -> list[dict[str, FloatArray]]:
    """A column of ones for the samples of every log, shape ``(n, logs)``."""
    logs = list(dict.fromkeys(e.log for e in experiments))
    return [{role: np.tile(np.eye(len(logs))[logs.index(e.log)], (e.samples, 1))}
            for e in experiments]  # fmt: skip


def initial_states(role: str, responses: Callable[[Experiment], FloatArray]) -> UnmodelledEffect:
    """Effect of initial states, for a fit from rest (``--start-state rest``).

    ``responses`` are the free responses of the output to unit states, shape ``(n, states)``.
    """
    return UnmodelledEffect(
        "initial state",
        f"'{role}' was not at rest where a log begins",
        "Begin logs at rest, or fit the initial state with --start-state free.",
        partial(_free_responses, role, responses),
        of=role,
        offered=True,
    )


def _free_responses(
    role: str, responses: Callable[[Experiment], FloatArray], experiments: Sequence[Experiment],
    simulate: Simulate,
) -> list[dict[str, FloatArray]]:  # fmt: skip
    """Free responses of every run, with zeros for the states of others, ``(n, runs * states)``.

    Copies of a run with noise added to its input share its state.
    """
    names, out = list(dict.fromkeys(e.name for e in experiments)), []
    for e in experiments:
        own = np.asarray(responses(e))
        table = np.zeros((own.shape[0], len(names), own.shape[1]))
        table[:, names.index(e.name)] = own
        # a step that was not recorded was preceded by rest
        out.append({role: table.reshape(own.shape[0], -1)} if own.shape[1] else {})
    return out


def _softened(
    plant: Plant[Any], role: str, edges: tuple[float, float],
    experiments: Sequence[Experiment], simulate: Simulate,
) -> list[dict[str, FloatArray]]:  # fmt: skip
    low, high = edges
    ends = [(float(e[role].min()), float(e[role].max())) for e in experiments]
    reach = _SOFT * (max(most for _, most in ends) - min(least for least, _ in ends))
    if not reach:
        return [{} for _ in experiments]
    soft = []
    for e in experiments:
        u = e[role]
        beyond = np.logaddexp(0.0, (u - high) / reach) - np.logaddexp(0.0, (low - u) / reach)
        # as much beyond an edge of the model as the softer one lets pass
        soft.append(e.with_readings(role, reach * beyond + np.where(beyond > 0.0, high, low)))
    output = plant.variant.output.name
    return slopes(simulate(plant, experiments), simulate(plant, soft), output, reach)


def change_to(
    plant: Plant[Any], other: Plant[Any], by: float, experiments: Sequence[Experiment],
    simulate: Simulate,
) -> list[dict[str, FloatArray]]:  # fmt: skip
    """Change of all channels from one plant to another, per size of what makes them differ."""
    before, after = simulate(plant, experiments), simulate(other, experiments)
    return slopes(before, after, plant.variant.output.name, by)


def slopes(
    before: Sequence[Simulated], after: Sequence[Simulated], output: str, by: float
) -> list[dict[str, FloatArray]]:
    """Derivatives of all channels of every run, by role, from simulations ``by`` a size apart."""

    def channels(one: Simulated) -> Mapping[str, FloatArray]:
        return {**one.also, output: one.output}

    return [
        {role: (values - channels(x)[role]) / by for role, values in channels(y).items()}
        for x, y in zip(before, after, strict=True)
    ]
