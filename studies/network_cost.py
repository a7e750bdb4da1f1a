# ruff: noqa: T201 (it prints its results)
"""What training a force map costs: rows against wall and processor seconds.

    python studies/network_cost.py [--repeat N]

Trains the paper's two networks (26 and 43 parameters) on the positions of
``datasets/force-map``, every start and the validation included. More rows are the same
cycles recorded again, with noise of their own; fewer are the beginning of each position.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np

from fluidact_fit.experiment import Experiment, FloatArray, Signal
from fluidact_fit.families.force_map.family import ForceMap
from fluidact_fit.families.force_map.options import ForceMapOptions
from fluidact_fit.family import Request

DATA = Path(__file__).parents[1] / "datasets" / "force-map"
ROWS = (1250, 2500, 5000, 10_000, 20_000, 40_000, 80_000)
STEP = 0.01  # s
NOISE = 0.02  # N


def positions() -> list[FloatArray]:
    """Command [V], position [m] and force [N] at each position, shape ``(n, 3)`` each."""
    out = []
    for trial in (1, 2):
        table = np.loadtxt(DATA / f"trial{trial}.csv", delimiter=",", skiprows=1)[:, 1:]
        table[:, 1] *= 1e-3
        out += np.split(table, 3)
    return out


def experiment(part: FloatArray, number: int, rows: int) -> Experiment:
    """A log of one position with as many rows as asked for."""
    rng = np.random.default_rng([number, rows])
    table = np.resize(part, (rows, 3))
    table[:, 2] += NOISE * rng.standard_normal(rows)
    t = STEP * np.arange(rows)
    signals = {
        name: Signal(name, t, column, unit, before=float(column[0]))
        for name, unit, column in zip(("command", "position", "force"), "VmN", table.T)
    }
    return Experiment(f"position {number}", number, t, signals, STEP, True)


def train(target: str, rows: int, seed: int) -> tuple[float, float]:
    """Wall and processor seconds of one training."""
    logs = [experiment(p, k, rows // 6) for k, p in enumerate(positions())]
    family = ForceMap()
    options = ForceMapOptions(target=target)
    (variant,) = family.variants_for(options)
    wall, processor = time.perf_counter(), time.process_time()
    family.estimate(variant, logs, Request(options=options, seed=seed))
    return time.perf_counter() - wall, time.process_time() - processor


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Cost of training a force map.")
    parser.add_argument("--repeat", type=int, default=3, help="trainings per line; medians count")
    given = parser.parse_args()
    print(f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}: wall means much at 0")
    heads = ("network", "rows", "wall [s]", "processor [s]", "us per row")
    print("{:>8s} {:>7s} {:>9s} {:>14s} {:>11s}".format(*heads))
    for target, shape in (("command", "3-5-1"), ("force", "4-7-1")):
        spent = []
        for rows in ROWS:
            tried = np.array([train(target, rows, seed) for seed in range(given.repeat)])
            wall, processor = np.median(tried, axis=0)
            spent.append(processor)
            print(f"{shape:>8s} {rows:7d} {wall:9.2f} {processor:14.2f} "
                  f"{1e6 * processor / rows:11.1f}", flush=True)  # fmt: skip
        many = [(r, s) for r, s in zip(ROWS, spent) if r >= 5000]
        power = np.polyfit(*np.log(np.array(many)).T, 1)[0]
        print(f"{shape:>8s} grows like rows^{power:.2f} from 5000 rows on")


if __name__ == "__main__":
    main()
