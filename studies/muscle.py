# ruff: noqa: T201 (it prints its results)
"""Force maps of real pneumatic muscles: hidden units, branches, a length left out.

    python studies/muscle.py [DIRECTORY of the logs] [--seeds N] [--networks "8:relu 16,16:tanh"]

Trained on the repeats Test8, judged on Test9 with every row counted, spikes and all. A length
left out is judged on both repeats: Test9 adds to it what changed in between, which is much on
the loading branches of 15 and 20 cm. The logs are not part of this repository
(../shared/data/muscle) and the study says so where they are missing; the contraction and the
length stand in the file names.
"""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Sequence
from itertools import chain, combinations_with_replacement
from pathlib import Path

import numpy as np

from fluidact_fit.experiment import Experiment, FloatArray, Signal
from fluidact_fit.families.force_map.family import ForceMap
from fluidact_fit.families.force_map.options import ForceMapOptions
from fluidact_fit.family import Request

Tests = dict[str, list[Experiment]]
INPUTS = "command,position,length,direction"
UNSEEN = 0.2  # m: the length that is left out
NETWORKS = "8:relu 16:relu 16:tanh 16,16:tanh"


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
    print(f"{name:32s}", *(f"{np.sqrt(np.mean(p**2)):7.2f}" for p in parts), more, flush=True)


def judge(network: str, train: list[Experiment], tests: Tests, seed: int) -> None:
    """Train a network on some muscles, judge it on others."""
    hidden, activation = network.split(":")
    family, begin = ForceMap(), time.perf_counter()
    options = ForceMapOptions.read(
        {"target": "force", "inputs": INPUTS, "hidden": hidden, "activation": activation}
    )
    variant = family.variant("force")
    found = family.estimate(variant, train, Request(options=options, seed=seed))
    spent = time.perf_counter() - begin
    details = found.details
    more = (
        f"  {details['network_parameters']} parameters, {details['multiplications']} "
        f"multiplications, fit {details['branches']['rmse']:.2f} N, {details['spikes']} spikes, "
        f"{spent:.0f} s"
    )
    for title, test in tests.items():
        runs = family.simulate(found.plant, test)
        _, force, state = table(test)
        error = force - np.concatenate([r.output for r in runs])
        say(f"{hidden} {activation}, seed {seed}, {title}", error, state, more)
        more = ""


def monomials(x: FloatArray) -> FloatArray:
    """All products of up to three inputs, shape ``(n, terms)``."""
    terms = chain.from_iterable(
        combinations_with_replacement(x.T, degree) for degree in range(1, 4)
    )
    return np.column_stack([np.ones(len(x)), *(np.prod(t, axis=0) for t in terms)])


def judge_polynomial(train: list[Experiment], tests: Tests) -> None:
    """Judge a cubic polynomial of the same inputs."""
    x, y, _ = table(train)
    scale = np.ptp(x, axis=0)
    # direction^2 = 1: columns repeat, and the shortest solution is as good as any
    weights = np.linalg.lstsq(monomials(x / scale), y, rcond=1e-10)[0]
    for title, test in tests.items():
        z, force, state = table(test)
        say(f"cubic polynomial, {title}", force - monomials(z / scale) @ weights, state)


def main() -> None:
    """Print the tables."""
    beside = Path(__file__).parents[2] / "shared" / "data" / "muscle"
    parser = argparse.ArgumentParser(description="Force maps of real pneumatic muscles.")
    parser.add_argument("folder", nargs="?", type=Path, default=beside)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--networks", default=NETWORKS, help=f"default: {NETWORKS}")
    given = parser.parse_args()
    first, second = read(given.folder, 8), read(given.folder, 9)
    if not first or not second:
        print("skipped: the logs of the muscles are not there")
        return
    apart = [e for e in first if e["length"][0] != UNSEEN]
    left = {
        f"Test{8 + k}": [e for e in every if e["length"][0] == UNSEEN]
        for k, every in enumerate((first, second))
    }
    for title, train, tests in (
        ("trained on Test8", first, {"Test9": second}),
        ("the same without 20 cm, on 20 cm", apart, left),
    ):
        print(f"{title:32s}     all    load  unload   rms error [N]")
        judge_polynomial(train, tests)
        for network in given.networks.split():
            for seed in range(given.seeds):
                judge(network, train, tests, seed)


if __name__ == "__main__":
    main()
