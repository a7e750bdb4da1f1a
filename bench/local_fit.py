# ruff: noqa: T201 (it prints its table)
"""One local fit, beside the same by hand: P1 to P3 from the same start, in one process.

    python bench/local_fit.py [--repeat 30]

By hand is the last ``least_squares`` of ``tools/scipy_reference.py`` over the exact simulator, with
neither search nor intervals: of P3 not its grid of dead times. Beside it one ``separable.solve`` of
the family's own model from the same start. That has offset and first state among its unknowns, as
it always has; so has ``the same unknowns``, by hand. Processor time of all in turn, medians.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "tools"))
sys.path.insert(0, str(Path(__file__).parent))

import fluidact as own
import scipy_reference as by_hand
from problems import PROBLEMS, make_trial


@contextmanager
def watched(module: ModuleType, name: str) -> Iterator[list[tuple[Any, ...]]]:
    """What a function of a module is given meanwhile, call by call."""
    taken, function = [], getattr(module, name)

    def watch(*given: Any, **options: Any) -> Any:
        taken.append(given)
        return function(*given, **options)

    setattr(module, name, watch)
    try:
        yield taken
    finally:
        setattr(module, name, function)


def captured(name: str, log: Any, start: dict[str, float]) -> tuple[Any, np.ndarray]:
    """The last problem that the family solves over a log, and where it is to begin."""
    from fluidact_fit.estimation import separable

    with watched(separable, "solve") as taken:
        own.FITS[f"{name}|started at the guess"](own.prepare(name, log), PROBLEMS[name].guess)
    problem = max((given[0] for given in reversed(taken)), key=lambda p: p.rows)
    names = own._HOW[name][3]
    at = {names[k]: v for k, v in start.items()}
    return problem, np.array([at[u.name] for u in problem.nonlinear])


def _p1_free(p: dict[str, float], t: np.ndarray) -> np.ndarray:
    """What offset and first speed add to a mass in oil."""
    lag = p["m"] / p["c"]
    return p["offset"] - p["rate"] * lag * np.expm1(-t / lag)


def _p2_free(p: dict[str, float], t: np.ndarray) -> np.ndarray:
    """What offset and first state add to a valve."""
    root = np.sqrt(complex(p["z"] ** 2 - 1.0)) + 1e-9
    fast, slow = (p["wn"] * (-p["z"] - side * root) for side in (1.0, -1.0))
    share = (p["rate"] - slow * p["first"]) / (fast - slow)
    free = share * np.exp(fast * t) + (p["first"] - share) * np.exp(slow * t)
    return np.asarray(p["offset"] + np.real(free))


def _p3_free(p: dict[str, float], t: np.ndarray) -> np.ndarray:
    """What offset and first pressure add to a line."""
    return p["offset"] + p["first"] * np.exp(-t / abs(p["tau"]))


_FREE = {
    "P1": (_p1_free, ("offset", "rate")),
    "P2": (_p2_free, ("offset", "first", "rate")),
    "P3": (_p3_free, ("offset", "first")),
}


def fits_by_hand(name: str, log: Any) -> tuple[Callable[[], Any], Callable[[], Any], Any]:
    """The last fit by hand, the same with the unknowns of the family, and where both begin."""
    solve = by_hand._solve
    with watched(by_hand, "_solve") as taken:
        by_hand.FITS[name](log, PROBLEMS[name].guess)
    simulate, _, start = taken[-1]
    free, names = _FREE[name]
    size, t = 0.01 * float(np.ptp(log.y)), log.t - log.t[0]
    sizes = {"offset": size, "first": size, "rate": 0.1 * size / log.sample_time}
    more = {**start, **{n: sizes[n] for n in names}}
    return (
        partial(solve, simulate, log, start),
        partial(solve, lambda p: simulate(p) + free(p, t), log, more),
        start,
    )


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
    print(
        "| problem | by hand [ms] | the same unknowns [ms] | one local fit [ms] | ratios |\n"
        "|---|---|---|---|---|"
    )
    with threadpool_limits(limits=1):
        for name in ("P1", "P2", "P3"):
            log = make_trial(PROBLEMS[name], 0).log
            *hand, start = fits_by_hand(name, log)
            every = *hand, partial(solve, *captured(name, log, start))
            runs = [tuple(map(processor, every)) for _ in range(repeat)]
            plain, same, own_fit = (1e3 * float(np.median(column)) for column in zip(*runs))
            print(
                f"| {name} | {plain:.2f} | {same:.2f} | {own_fit:.2f} | "
                f"{own_fit / plain:.2f}, {own_fit / same:.2f} |"
            )


if __name__ == "__main__":
    main()
