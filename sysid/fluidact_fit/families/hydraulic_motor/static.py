"""Settled points: the curve of the motor and its hysteresis, without the lag.

The rows are points at which the motor turned steadily, in the order in which they were visited: the
play needs to know from which side each was approached.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...estimation.named_map import NamedFit, NamedRows, fit_named_map
from ...estimation.named_model import Values
from ...estimation.response_model import ResponseTask
from ...estimation.results import Refusal
from ...estimation.separable import solve
from ...estimation.transfer_model import ANY
from ...experiment import Array, FloatArray
from .equation import SettledModel
from .fit import MotorOptions


def fit_points(task: ResponseTask[MotorOptions]) -> NamedFit:
    """Fit what the plan searches for; see :func:`.fit_named_map`."""
    runs, plan, request = task.experiments, task.plan, task.request
    model = SettledModel(runs)
    data = NamedRows.of(
        [e.sampled("command")[:, None] for e in runs], [e.signals["speed"] for e in runs],
        in_order=True,
    )  # fmt: skip

    def law(values: Values, x: FloatArray) -> Array:
        return np.concatenate([model.response(k, values) for k in range(len(runs))])

    def starts(held: Mapping[str, float]) -> list[dict[str, float]]:
        own = replace(task, request=replace(request, fixed=held))
        problem, out = own.problem(runs, ANY), []
        for start in own.starts(runs, ANY):
            found = solve(problem, problem.vector(start), max_iterations=0)
            out.append({**start, **problem.named((*found.eta, *found.linear))})
        return out

    unknowns = task.unknowns
    return fit_named_map(
        law, [s for s in task.variant.parameters if s.name in unknowns], data, starts,
        {n: (u.low, u.high) for n, u in unknowns.items()}, request,
        max_half_widths=plan.max_half_widths,
        refusals=[r for r in plan.refusals if r.parameter not in request.fixed],
        optional=[Refusal(n, "the speed grows up to the last command.", at)
                  for n, at in plan.no_effect_at.items()],
    )  # fmt: skip
