# ruff: noqa: T201 (it prints its results)
"""Long checks of the hydraulic cylinder that are no unit tests.

    python studies/hydraulic_cylinder.py [coverage|networks|pressures] [--runs N]
        [--command-noise VOLTS]

``coverage``: share of 95 % intervals that hold the truth over repeated simulated logs, how far
the estimates scatter beside their standard errors, and how much of that is bias.
``networks``: equations and networks near zero command and away from it (figure 9 of the paper).
``pressures``: chamber pressures of a held-out log simulated with either flow, by command.
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "datasets"))

import generators.hydraulic_cylinder as simulator

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
NOISE = (2e4, 2e4, 5e-5)  # Pa, Pa, m
FINE = 20  # steps of the simulation per sample
FINEST = 200  # the same where its own errors would count among hundreds of repetitions
TRAJECTORIES = 10


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
    table[:, 2:] += rng.standard_normal((len(rows), 3)) * NOISE
    return write(table, path)


def write(table: np.ndarray, path: Path) -> Path:
    """Write a log."""
    np.savetxt(path, table, delimiter=",", header=HEADER, comments="", fmt="%.7g")
    return path


@cache
def trajectory(number: int) -> np.ndarray:
    """One trial of 2.2 s as in the dataset, without noise; rows of :data:`HEADER`."""
    command = simulator.Commander(np.random.default_rng([7, number]), number % 3)
    x: tuple[float, ...] = (1.2e6, 1.2e6 * simulator.AREA_1 / simulator.AREA_2, 0.1, 0.0)
    rows = []
    for k in range(simulator.CYLINDER_SAMPLES):
        u = command(k, x[2])
        rows.append((1e-3 * k, u, x[0], x[1], x[2]))
        for _ in range(FINEST):
            x = simulator.advance(x, u, 1e-3 / FINEST)
    return np.array(rows)


def coverage(folder: Path, runs: int, command_noise: float) -> None:
    """Count the intervals that hold the truth; one log per run."""
    truth = {n: t.value for n, t in simulator.CYLINDER.items()}
    found: dict[str, list[tuple[float, float, bool]]] = {n: [] for n in truth}
    for run in range(runs):
        rng = np.random.default_rng([11, run])
        table = trajectory(run % TRAJECTORIES).copy()
        table[:, 2:] += rng.standard_normal((table.shape[0], 3)) * NOISE
        table[:, 1] += command_noise * rng.standard_normal(table.shape[0])
        result = ff.fit("hydraulic-cylinder", write(table, folder / "c.csv"), **GIVEN)
        for name, value in truth.items():
            q = result.parameters[name]
            low, high = q.ci95
            found[name].append((float(q.value) - value, q.std_error, low <= value <= high))
    print(f"{runs} repetitions, {1e3 * command_noise:g} mV of noise on the logged command")
    print("parameter             covered  rms/se  bias/rms  rms error")
    shares = []
    for name, value in truth.items():
        error, se, held = (np.array(c) for c in zip(*found[name]))
        rms = _rms(error)
        shares.append(float(np.mean(held)))
        print(f"{name:20s}  {100 * shares[-1]:5.1f} %  {rms / _rms(se):6.2f}  "
              f"{error.mean() / rms:+8.2f}  {100 * rms / abs(value):7.3f} %")  # fmt: skip
    print(f"{'all':20s}  {100 * np.mean(shares):5.1f} %")


def networks(folder: Path) -> None:
    """Print the comparisons, with the dead zone and with the paper's equations, which have none."""
    logs = [record(12.0, seed, folder / f"n{seed}.csv") for seed in range(3)]
    given = {n: v for n, v in GIVEN.items() if n != "mass"} | {"flow": "mlp", "friction": "mlp"}
    zero = {"dead_zone_negative": 0.0, "dead_zone_positive": 0.0}
    for label, fixed in (("dead zone fitted", {}), ("no dead zone", zero)):
        result = ff.fit("hydraulic-cylinder", logs, fixed=fixed, **given)
        for title, rows in result.document.fit.details["comparisons"].items():
            print(f"{title}, {label}")
            for row in rows:
                print("  ", row)


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


def main() -> None:
    """Run what was asked for, or everything."""
    parser = argparse.ArgumentParser(description="Long checks of the hydraulic cylinder.")
    parser.add_argument("checks", nargs="*", metavar="coverage|networks|pressures")
    parser.add_argument("--runs", type=int, default=300, help="repetitions of coverage")
    parser.add_argument("--command-noise", type=float, default=0.01, help="of coverage [V]")
    given = parser.parse_args()
    folder = Path(mkdtemp())
    for name in given.checks or ["networks", "pressures", "coverage"]:
        print(f"== {name}")
        if name == "coverage":
            coverage(folder, given.runs, given.command_noise)
        else:
            {"networks": networks, "pressures": pressures}[name](folder)


if __name__ == "__main__":
    main()
