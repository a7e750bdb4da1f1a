"""The machines of the benchmark, as a new user logs them: right model, hold not declared.

Nothing is wrong with these logs, so nothing may be said about them.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ...statistics_study import PROBLEMS, Cell, Problem, linearised, make_noise
from ..attack import Attack, Recording

RATE, DECIBEL, DURATION = 100.0, 40.0, 10.0
RUNS = 500
UNITS = {"force": "N", "position": "m", "command": "V", "inlet": "Pa", "outlet": "Pa"}


def record(rng: np.random.Generator, *, problem: Problem, cell: Cell) -> list[Recording]:
    """One log of ten seconds at 100 Hz, its noise 40 dB below the output."""
    step, n = 1.0 / RATE, round(DURATION * RATE)
    u = problem.excite(np.random.default_rng([7, 0, 0]), n, step)
    y = make_noise(cell, problem.simulate(problem.truth, u, n, step), rng)
    driving, output = problem.roles
    return [{"time": np.arange(n) * step, driving: u[:: problem.fine], output: y}]


def attacks() -> Iterator[Attack]:
    """One a machine."""
    for name, problem in PROBLEMS.items():
        cell = Cell(name, RATE, DECIBEL, 1, "white", RUNS)
        yield Attack(
            problem.family, f"nothing wrong: {name}", "100 Hz, 40 dB", problem.truth,
            partial(record, problem=problem, cell=cell),
            {role: UNITS[role] for role in problem.roles},
            bounds=dict(zip(problem.truth, linearised(cell)[0].tolist())), repetitions=RUNS,
        )  # fmt: skip
