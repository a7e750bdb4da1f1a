# ruff: noqa: T201 (it prints its results)
"""Long checks of the hydraulic cylinder that are no unit tests.

    python studies/hydraulic_cylinder.py [coverage|networks|pressures]

``coverage``: share of 95 % intervals that hold the truth over repeated simulated logs.
``networks``: equations and networks near zero command and away from it (figure 9 of the paper).
``pressures``: chamber pressures of a held-out log simulated with either flow, by command.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "datasets"))

import generate_hydraulic as simulator

import fluidact_fit as ff

GIVEN = {
    "area_1": simulator.AREA_1,
    "area_2": simulator.AREA_2,
    "dead_volume_1": simulator.DEAD_1,
    "dead_volume_2": simulator.DEAD_2,
    "mass": simulator.MASS,
    "supply_pressure": simulator.SUPPLY,
}
HEADER = "time,command,pressure_1,pressure_2,position"
FINE = 20


def record(seconds: float, seed: int, path: Path) -> Path:
    """Simulate held random levels with slow passes through zero between them, at 1 kHz."""
    rng = np.random.default_rng(seed)
    x: tuple[float, ...] = (1.2e6, 1.2e6 * simulator.AREA_1 / simulator.AREA_2, 0.1, 0.0)
    until, level, rows = 0, 0.0, []
    for k in range(int(1000 * seconds)):
        if (k // 1000) % 2:
            u = round(0.9 * (4.0 * abs((k / 500.0 + 0.25) % 1.0 - 0.5) - 1.0), 3)
        else:
            if k >= until:
                sign = math.copysign(1.0, 0.1 - x[2])
                if abs(x[2] - 0.1) < 0.04:
                    sign = float(rng.choice([-1.0, 1.0]))
                level = round(sign * math.exp(rng.uniform(math.log(0.15), math.log(9.0))), 3)
                until = k + int(rng.uniform(40, 160))
            u = level
        rows.append((1e-3 * k, u, x[0], x[1], x[2]))
        for _ in range(FINE):
            x = simulator.advance(x, u, 1e-3 / FINE)
    table = np.array(rows)
    table[:, 2:] += rng.standard_normal((len(rows), 3)) * [2e4, 2e4, 5e-5]
    np.savetxt(path, table, delimiter=",", header=HEADER, comments="", fmt="%.7g")
    return path


def coverage(folder: Path, runs: int = 25) -> None:
    """Count the intervals that hold the truth; one log of 4 s per run."""
    truth = {n: t.value for n, t in simulator.CYLINDER.items()}
    held = dict.fromkeys(truth, 0)
    errors: dict[str, list[float]] = {n: [] for n in truth}
    for seed in range(runs):
        result = ff.fit("hydraulic-cylinder", record(4.0, 100 + seed, folder / "c.csv"), **GIVEN)
        for name, value in truth.items():
            found = result.parameters[name]
            low, high = found.ci95
            held[name] += low <= value <= high
            errors[name].append(float(found.value) / value - 1.0)
    for name in truth:
        e = np.array(errors[name])
        print(f"{name:20s} {held[name]:3d} of {runs}  mean error {100 * e.mean():+.3f} %  "
              f"sd {100 * e.std():.3f} %")  # fmt: skip


def networks(folder: Path) -> None:
    """Print the comparison of the flows."""
    logs = [record(12.0, seed, folder / f"n{seed}.csv") for seed in range(3)]
    given = {n: v for n, v in GIVEN.items() if n != "mass"}
    result = ff.fit("hydraulic-cylinder", logs, flow="mlp", friction="mlp", **given)
    details = result.document["fit"]["details"]
    for row in (*details["flow_comparison"], *details["friction_comparison"]):
        print(row)


def pressures(folder: Path) -> None:
    """Integrate equations 2 and 3 with the measured motion and either flow, 50 ms at a time."""
    logs = [record(12.0, seed, folder / f"p{seed}.csv") for seed in range(3)]
    given = {n: v for n, v in GIVEN.items() if n != "mass"}
    result = ff.fit("hydraulic-cylinder", logs[:2], flow="mlp", **given)
    zero = {"dead_zone_negative": 0.0, "dead_zone_positive": 0.0}
    plain = ff.fit("hydraulic-cylinder", logs[:2], fixed=zero, **given)
    models = {"equations, no dead zone": (plain, False), "equations": (result, False),
              "network": (result, True)}  # fmt: skip
    table = np.loadtxt(logs[2], delimiter=",", skiprows=1)
    for label, (fit, network) in models.items():
        block = ff.load(fit.save(folder / "p.yaml", overwrite=True))
        beta = float(fit.parameters["bulk_modulus"].value)
        error, command = _pressure_errors(table, block, beta, network)
        near = np.abs(command) < 0.45
        print(f"{label:25s} chamber 1, rms error: |u| < 0.45 V {1e-5 * _rms(error[near]):.2f} bar, "
              f"beyond {1e-5 * _rms(error[~near]):.2f} bar")  # fmt: skip


def _pressure_errors(table: np.ndarray, block: object, beta: float, network: bool) -> tuple:
    """Error of p1 at the end of every 50 ms, all pieces side by side."""
    steps, n = 50, table.shape[0] - 60
    begin = np.arange(30, n - steps, 25)
    y = np.convolve(table[:, 4], np.ones(11) / 11.0, mode="same")
    v = np.gradient(np.convolve(y, np.ones(11) / 11.0, mode="same"), 1e-3)
    p = np.mean([table[begin + s, 2] for s in range(-2, 3)], axis=0)
    for k in range(steps):
        u, volume = table[begin + k, 1], simulator.DEAD_1 + simulator.AREA_1 * y[begin + k]
        for _ in range(5):
            q = block.flow(1, u, p, network=network)  # type: ignore[attr-defined]
            p = p + 2e-4 * beta / volume * (q - simulator.AREA_1 * v[begin + k])
    end = np.mean([table[begin + steps + s, 2] for s in range(-2, 3)], axis=0)
    return p - end, np.abs(table[begin[:, None] + np.arange(steps), 1]).max(axis=1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["networks", "pressures", "coverage"]
    for name in chosen:
        print(f"== {name}")
        {"coverage": coverage, "networks": networks, "pressures": pressures}[name](Path(mkdtemp()))
