# ruff: noqa: T201 (it prints its table)
"""One local fit, beside the same by hand: P1 to P3 from the same start, in one process.

    python bench/local_fit.py [--repeat 30]

By hand is ``tools/scipy_reference.py``: ``least_squares`` over the exact simulator, from the
benchmark's guess, with neither search nor offsets nor intervals; of P3 only its last fit, not
its grid. Beside it one ``separable.solve`` of the family's own model from the same guess, offset
and initial state free as they always are. Processor time of both in turn, medians.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "tools"))
sys.path.insert(0, str(Path(__file__).parent))

import fluidact as own
import scipy_reference as by_hand
from problems import PROBLEMS, make_trial


def captured(name: str, log: Any) -> tuple[Any, np.ndarray]:
    """The last problem that the family solves over a log, and the benchmark's guess for it."""
    from fluidact_fit.estimation import separable

    taken, solve = [], separable.solve

    def watch(problem: Any, start: np.ndarray, **limits: Any) -> Any:
        taken.append(problem)
        return solve(problem, start, **limits)

    separable.solve = watch
    try:
        own.FITS[f"{name}|started at the guess"](own.prepare(name, log), PROBLEMS[name].guess)
    finally:
        separable.solve = solve
    problem = max(reversed(taken), key=lambda p: p.rows)
    names = own._HOW[name][3]
    at = {names[k]: v for k, v in PROBLEMS[name].guess.items()}
    return problem, np.array([at[u.name] for u in problem.nonlinear])


def processor(run: Callable[[], Any]) -> float:
    """Processor time of one call [s]."""
    began = time.process_time()
    run()
    return time.process_time() - began


def main() -> None:
    """Measure and print."""
    from threadpoolctl import threadpool_limits

    from fluidact_fit.estimation.separable import solve

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=30)
    repeat = parser.parse_args().repeat
    print("| problem | by hand [ms] | one local fit [ms] | ratio |\n|---|---|---|---|")
    with threadpool_limits(limits=1):
        for name in ("P1", "P2", "P3"):
            log = make_trial(PROBLEMS[name], 0).log
            problem, at = captured(name, log)
            guess = PROBLEMS[name].guess
            both = partial(by_hand.FITS[name], log, guess), partial(solve, problem, at)
            pairs = [tuple(map(processor, both)) for _ in range(repeat)]
            theirs, ours = (1e3 * float(np.median(column)) for column in zip(*pairs))
            print(f"| {name} | {theirs:.2f} | {ours:.2f} | {ours / theirs:.2f} |")


if __name__ == "__main__":
    main()
