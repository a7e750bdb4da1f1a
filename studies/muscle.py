# ruff: noqa: T201 (it prints its results)
"""Force maps of real pneumatic muscles: hidden units, branches, a length left out.

    python studies/muscle.py [DIRECTORY of the logs] [--seeds N]

Trained on the repeats Test8, judged on Test9 with every row counted, spikes and all. The logs
are not part of this repository (../shared/data/muscle); the contraction and the length stand
in the file names.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fluidact_fit.estimation.network import polynomial_fit
from fluidact_fit.experiment import Experiment, FloatArray, Signal
from fluidact_fit.families.force_map import ForceMap
from fluidact_fit.family import Request

INPUTS = "command,position,length,direction"
NETWORKS = (("8", "relu"), ("16", "relu"), ("16", "tanh"), ("16,16", "tanh"))


def read(folder: Path, test: int) -> list[Experiment]:
    """All muscles of one repeat: pressure [Pa], contraction [1], length [m], force [N]."""
    out = []
    for path in sorted(folder.glob(f"*_Test{test}.csv")):
        match = re.match(r"10mm_(\d+)cm_(?:Unkink|kinked(\d+))", path.name)
        assert match is not None
        force, pressure, _, state = np.loadtxt(path, delimiter=",").T
        columns = {
            "command": (1e3 * pressure, "Pa"),
            "position": (np.array([float(match[2] or 0) / 100.0]), "1"),
            "length": (np.array([float(match[1]) / 100.0]), "m"),
            "force": (force, "N"),
            "direction": (state, "1"),
        }
        signals = {
            role: Signal(role, np.zeros(v.size), v, unit, before=float(v[0]))
            for role, (v, unit) in columns.items()
        }
        out.append(Experiment(path.name, len(out), np.zeros(0), signals, 0.0, False))
    return out


def table(experiments: Sequence[Experiment]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inputs, force and motion state of all rows."""
    rows, forces = [], []
    for e in experiments:
        n = e["force"].size
        state = np.where(e["direction"] == 1.0, 1.0, -1.0)
        constants = np.broadcast_to([e["position"][0], e["length"][0]], (n, 2))
        rows.append(np.column_stack((e["command"], constants, state)))
        forces.append(e["force"])
    x = np.vstack(rows)
    return x, np.concatenate(forces), x[:, 3]


def say(name: str, error: FloatArray, state: FloatArray, more: str = "") -> None:
    """Print the errors over all rows and of each branch."""
    parts = [error, error[state > 0.0], error[state < 0.0]]
    print(f"{name:34s}", *(f"{np.sqrt(np.mean(p**2)):7.2f}" for p in parts), more, flush=True)


def judge(
    name: str, hidden: str, activation: str, train: list[Experiment], test: list[Experiment],
    seed: int,
) -> None:  # fmt: skip
    """Train on some muscles, judge on others."""
    family, begin = ForceMap(), time.perf_counter()
    options = {"target": "force", "inputs": INPUTS, "hidden": hidden, "activation": activation}
    found = family.estimate(family.variants[1], train, Request(options=options, seed=seed))
    values = {k: q.value for k, q in found.parameters.items()}
    simulated = [family.simulate(family.variants[1], values, e, options) for e in test]
    _, force, state = table(test)
    details = found.details
    more = (
        f"{details['network_parameters']} parameters, fit {details['branches']['rmse']:.2f} N, "
        f"{details['spikes']} spikes, {time.perf_counter() - begin:.0f} s"
    )
    say(name, force - np.concatenate(simulated), state, more)


def main() -> None:
    """Print the tables."""
    beside = Path(__file__).parents[2] / "shared" / "data" / "muscle"
    parser = argparse.ArgumentParser(description="Force maps of real pneumatic muscles.")
    parser.add_argument("folder", nargs="?", type=Path, default=beside)
    parser.add_argument("--seeds", type=int, default=1)
    given = parser.parse_args()
    first, second = read(given.folder, 8), read(given.folder, 9)
    apart = [e for e in first if e["length"][0] != 0.2]
    left = [e for e in second if e["length"][0] == 0.2]
    print(f"{'rms error on Test9 [N]':34s}     all    load  unload")
    for seed in range(given.seeds):
        for hidden, activation in NETWORKS:
            judge(f"{hidden} {activation}, seed {seed}", hidden, activation, first, second, seed)
    for name, some, others in (("", first, second), (", 20 cm left out", apart, left)):
        x, y, _ = table(some)
        scale = np.ptp(x, axis=0)
        z, force, state = table(others)
        cubic = polynomial_fit(x / scale, y)
        say(f"cubic polynomial{name}", force - cubic(z / scale), state)
    for seed in range(given.seeds):
        for hidden, activation in NETWORKS:
            title = f"{hidden} {activation}, 20 cm left out, {seed}"
            judge(title, hidden, activation, apart, left, seed)


if __name__ == "__main__":
    main()
