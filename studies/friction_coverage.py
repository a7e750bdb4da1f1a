"""Do the intervals of ``cylinder-friction`` hold, and how far is it from the bound?

    python studies/friction_coverage.py [--runs 500] [--output FILE.md]

A piston moved by hand as in ``datasets/cylinder-friction`` (three sines in closed form, the
dataset's truth, 10 s at 100 Hz), slow, medium and fast, with white or autocorrelated noise of the
force (first-order autoregression, 0.1 N) and more or less noise of the velocity or the
position. Every run has its own seed.

The bound is that of Cramer and Rao with all samples and the true autocorrelation of the force. The
noise of a measured velocity counts as noise of ``viscous`` times as much force, that of a
position, which hardly moves its slope over a stroke, as none.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fluidact_fit.errors import FluidactError
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families.cylinder_friction.family import CylinderFriction
from fluidact_fit.families.cylinder_friction.options import FrictionOptions
from fluidact_fit.family import Request
from fluidact_fit.mechanics.friction_law import FrictionLaw

Array = npt.NDArray[np.float64]
TRUTH = {"viscous": 45.0, "coulomb_positive": 2.4, "coulomb_negative": 2.4}
MASS = 0.14  # kg
FORCE_NOISE = 0.1  # N
STEP = 0.01  # s
SAMPLES = 1000
PACES = {"slow": (0.4, 0.014), "medium": (1.0, 0.016), "fast": (2.2, 0.018)}  # Hz, m
SEED = 20261121


@dataclass(frozen=True)
class Cell:
    """One row of the table: pace, role, noise of the motion [SI], AR(1) of the force noise."""

    pace: str
    role: str
    noise: float
    colour: float

    @property
    def words(self) -> str:
        """Pace, sensor and AR(1) coefficient in words."""
        sensor = (
            f"velocity, {1e3 * self.noise:g} mm/s"
            if self.role == "velocity"
            else f"position, {1e6 * self.noise:g} um"
        )
        return f"{self.pace} | {sensor} | {self.colour:g}"


def move(rng: np.random.Generator, pace: str) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration of a hand, shape ``(n,)`` each [SI]."""
    base, size = PACES[pace]
    omega = 2.0 * np.pi * base * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    share = size * np.array([1.0, 0.5, 0.25])
    angle = np.outer(STEP * np.arange(SAMPLES), omega) + rng.uniform(0.0, 2.0 * np.pi, 3)
    return (
        np.sin(angle) @ share,
        np.cos(angle) @ (share * omega),
        -np.sin(angle) @ (share * omega**2),
    )


def colour_noise(rng: np.random.Generator, colour: float) -> Array:
    """First-order autoregression of variance one, shape ``(n,)``."""
    white = rng.standard_normal(SAMPLES)
    out = white.copy()
    for k in range(1, SAMPLES):
        out[k] = colour * out[k - 1] + np.sqrt(1.0 - colour**2) * white[k]
    return out


def whitener(cell: Cell) -> Array:
    """Matrix that makes the noise of the equation white, of variance one; shape ``(n, n)``."""
    lags = np.abs(np.subtract.outer(np.arange(SAMPLES), np.arange(SAMPLES)))
    total = FORCE_NOISE**2 * cell.colour**lags
    if cell.role == "velocity":
        total += (TRUTH["viscous"] * cell.noise) ** 2 * np.eye(SAMPLES)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def bound(velocity: Array, white: Array) -> Array:
    """Least standard error of every parameter, shape ``(3,)`` [SI]."""
    columns = np.column_stack((velocity, velocity > 0.0, -(velocity < 0.0).astype(float)))
    rows = white @ columns
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))))


def record(rng: np.random.Generator, cell: Cell) -> tuple[Experiment, Array]:
    """A log and the true velocity."""
    position, velocity, acceleration = move(rng, cell.pace)
    force = MASS * acceleration + FrictionLaw.of(TRUTH).moving(velocity)
    force = force + FORCE_NOISE * colour_noise(rng, cell.colour)
    motion = (velocity if cell.role == "velocity" else position) + cell.noise * rng.standard_normal(
        SAMPLES
    )
    time = STEP * np.arange(SAMPLES)
    units = {"force": "N", "velocity": "m/s", "position": "m"}
    signals = {
        role: Signal(role, time, values, units[role])
        for role, values in (("force", force), (cell.role, motion))
    }
    return Experiment("log.csv", 0, time, signals, STEP, True), velocity


@dataclass(frozen=True)
class Result:
    """Per parameter, shape ``(3,)``: what the runs of a cell gave."""

    coverage: Array
    bias: Array
    spread: Array
    efficiency: Array
    refused: int


def run(cell: Cell, runs: int) -> Result:
    """Fit many logs of a cell."""
    family = CylinderFriction()
    variant = next(v for v in family.variants if v.name == cell.role)
    request = Request(options=FrictionOptions(mass=MASS))
    white = whitener(cell)
    hits, off, bounds, refused = [], [], [], 0
    for k in range(runs):
        rng = np.random.default_rng([SEED, k])
        log, velocity = record(rng, cell)
        try:
            found = family.estimate(variant, [log], request)
        except FluidactError:
            refused += 1
            continue
        quantities = [found.parameters[n] for n in TRUTH]
        if any(q.status != "estimated" for q in quantities):
            refused += 1
            continue
        value = np.array([q.value for q in quantities], dtype=float)
        error = np.array([q.std_error for q in quantities], dtype=float)
        ends = np.array([q.ci95 for q in quantities], dtype=float)
        truth = np.array(list(TRUTH.values()))
        hits.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
        off.append(np.column_stack((value - truth, (value - truth) / error)))
        bounds.append(bound(velocity, white))
    errors = np.array(off)
    rms = np.sqrt(np.mean(errors[:, :, 0] ** 2, axis=0))
    return Result(
        np.mean(hits, axis=0),
        np.mean(errors[:, :, 1], axis=0),
        np.std(errors[:, :, 1], axis=0),
        rms / np.sqrt(np.mean(np.square(bounds), axis=0)),
        refused,
    )


def cells() -> Iterator[Cell]:
    """All rows of the table."""
    for pace, colour in product(PACES, (0.0, 0.9)):
        for noise in (1e-3, 10e-3):
            yield Cell(pace, "velocity", noise, colour)
        yield Cell(pace, "position", 10e-6, colour)


def main() -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--paces", nargs="+", choices=list(PACES), default=list(PACES))
    chosen = parser.parse_args()
    names = "viscous, positive and negative level"
    rows = [
        "# Intervals of the cylinder friction",
        "",
        "Written by `python studies/friction_coverage.py` (`make study`).",
        f"Every triple: {names}; {chosen.runs} runs of each row, seed {SEED}.",
        "",
        "| strokes | motion | AR(1) of the force noise | coverage of the 95 % interval "
        "| mean error / std error | spread / std error | rms error / bound | refused |",
        "|---|---|---|---|---|---|---|---|",
    ]
    sys.stdout.write("\n".join(rows) + "\n")
    for cell in cells():
        if cell.pace not in chosen.paces:
            continue
        r = run(cell, chosen.runs)
        rows.append(
            f"| {cell.words} "
            f"| {' '.join(f'{c:.3f}' for c in r.coverage)} "
            f"| {' '.join(f'{b:+.2f}' for b in r.bias)} "
            f"| {' '.join(f'{s:.2f}' for s in r.spread)} "
            f"| {' '.join(f'{e:.2f}' for e in r.efficiency)} | {r.refused} |"
        )
        sys.stdout.write(rows[-1] + "\n")
        sys.stdout.flush()
    if chosen.output:
        chosen.output.write_text("\n".join([*rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
