"""Efficiency and coverage of the estimates, by repetition. ``make study``.

Three problems with exact simulators of their own (none of the estimator's code): P1 dead
zone and hydrostatic mass under a hand force, P2 valve, P3 line with a dead time of a
fraction of a sample. For every cell the logs are simulated afresh, fitted, and compared
with the truth:

* efficiency: root-mean-square error over the Cramér-Rao bound of the same unknowns (gain
  and the offset of every log included). The error of the linearised estimate, whose mean
  square is the bound itself, is computed from the same noise and serves as control variate:
  only what the fit adds to it is left to chance, so that few repetitions tell one per cent;
* coverage: how often the 95 % interval holds the truth, with white noise, with
  autoregressive noise of coefficient 0.9, and with a 12-bit converter.

Run ``python studies/statistics_study.py --help`` for the options. The table is written
into ``docs/evidence/statistics.md``; every number follows from the seed in it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.signal import lfilter

SEED = 20_261_121
DURATION = 10.0  # s
FINE = 40  # grid of the P1 simulator per sample


@dataclass(frozen=True)
class Problem:
    """A machine, its excitation and what is asked of the fit."""

    family: str
    roles: tuple[str, str]
    hold: str
    truth: dict[str, float]
    options: dict[str, object]
    excite: Callable[[np.random.Generator, int, float], np.ndarray]
    simulate: Callable[[dict[str, float], np.ndarray, int, float], np.ndarray]
    fine: int = 1


def hand_force(rng: np.random.Generator, n: int, step: float) -> np.ndarray:
    """Smooth force of six sines below 2.1 Hz, 12 N at its peak, on the fine grid."""
    t = np.arange((n - 1) * FINE + 1) * step / FINE
    f = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    raw = (f[:, None] ** -0.4 * np.sin(2 * np.pi * f[:, None] * t + phase[:, None])).sum(0)
    raw *= 1.0 - np.exp(-((t / 0.3) ** 2))
    return 12.0 * raw / np.abs(raw).max()


def levels(rng: np.random.Generator, n: int, step: float) -> np.ndarray:
    """Random levels held for 0.3 to 1 s, after 0.1 s of rest."""
    u, k = np.zeros(n), round(0.1 / step)
    while k < n:
        hold = round(rng.uniform(0.3, 1.0) / step)
        u[k : k + hold] = rng.uniform(-1.0, 1.0)
        k += hold
    return u


def hydrostatic(p: dict[str, float], u: np.ndarray, n: int, step: float) -> np.ndarray:
    """Exact for straight lines on the fine grid: velocity by recursion, position by momentum."""
    h = step / FINE
    w = np.maximum(u - p["dead_zone_positive"], 0.0) + np.minimum(u - p["dead_zone_negative"], 0.0)
    tau = p["mass"] / p["damping"]
    a = np.exp(-h / tau)
    v = lfilter([1 - tau / h * (1 - a), tau / h * (1 - a) - a], [1, -a], w / p["damping"])
    impulse = np.concatenate(([0.0], np.cumsum(0.5 * h * (w[1:] + w[:-1]))))
    return (impulse / p["damping"] - tau * (v - v[0]))[::FINE]


def valve(p: dict[str, float], u: np.ndarray, n: int, step: float) -> np.ndarray:
    """Exact for held commands: matrix exponential and difference equation."""
    wn, z = p["natural_frequency"], p["damping_ratio"]
    e = expm(np.array([[0, 1, 0], [-(wn**2), -2 * z * wn, wn**2], [0, 0, 0]]) * step)
    a1, a2 = -np.trace(e[:2, :2]), np.linalg.det(e[:2, :2])
    b1 = e[0, 2]
    b2 = (e[:2, :2] @ e[:2, 2] + e[:2, 2])[0] + a1 * b1 - b1
    return p["gain"] * lfilter([0, b1, b2], [1, a1, a2], u)


def line(p: dict[str, float], u: np.ndarray, n: int, step: float) -> np.ndarray:
    """Exact for a held inlet: the dead time splits every sample in two."""
    whole = int(np.floor(p["dead_time"] / step))
    part, tau = p["dead_time"] / step - whole, p["time_constant"]
    a, new = np.exp(-step / tau), 1 - np.exp(-(1 - part) * step / tau)
    b = np.concatenate((np.zeros(whole + 1), [new, 1 - a - new]))
    return p["gain"] * lfilter(b, [1, -a], u)


PROBLEMS = {
    "P1": Problem(
        "hydrostatic", ("force", "position"), "auto",
        {"mass": 53.7, "damping": 1720.5, "dead_zone_negative": -3.0, "dead_zone_positive": 1.2},
        {"stiffness": "none", "dead-time": "none"},
        hand_force, hydrostatic, FINE,
    ),
    "P2": Problem(
        "valve", ("command", "outlet"), "zoh",
        {"gain": 1.0, "natural_frequency": 20.0, "damping_ratio": 0.7},
        {"dead-time": "none", "zero": "none"}, levels, valve,
    ),
    "P3": Problem(
        "line", ("inlet", "outlet"), "zoh",
        {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.0147},
        {"length": None, "sound-speed": None}, levels, line,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """One cell of the table."""

    problem: str
    rate: float
    decibel: float
    logs: int
    noise: str
    repetitions: int


def make_noise(cell: Cell, y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The output as logged."""
    sigma = float(np.std(y)) * 10.0 ** (-cell.decibel / 20.0)
    if cell.noise == "white":
        return y + sigma * rng.standard_normal(y.size)
    if cell.noise == "ar1":
        drive = sigma * np.sqrt(1.0 - 0.81) * rng.standard_normal(y.size + 300)
        return y + lfilter([1.0], [1.0, -0.9], drive)[300:]
    lsb = float(np.ptp(y)) / 4096.0
    return np.floor((y + rng.uniform(0.0, lsb)) / lsb) * lsb + 0.5 * lsb


def resolution(cell: Cell, y: np.ndarray) -> float:
    """What the reader of logs finds: the smallest distance of two readings."""
    return float(np.min(np.diff(np.unique(y)))) if cell.noise == "adc12" else 0.0


@cache
def linearised(cell: Cell) -> tuple[np.ndarray, list[np.ndarray]]:
    """Cramér-Rao deviations, and per log the matrix from its noise to the error.

    The gain, where there is one, is among the parameters; the offset of every log is
    unknown as well. Shapes ``(p,)`` and ``(p, n)`` each.
    """
    p = PROBLEMS[cell.problem]
    step, n = 1.0 / cell.rate, round(DURATION * cell.rate)
    weighted, total = [], 0.0
    for u in _inputs(cell):
        clean = p.simulate(p.truth, u, n, step)
        sigma = float(np.std(clean)) * 10.0 ** (-cell.decibel / 20.0)
        columns = []
        for name, value in p.truth.items():
            h = 1e-5 * abs(value)
            up = p.simulate({**p.truth, name: value + h}, u, n, step)
            down = p.simulate({**p.truth, name: value - h}, u, n, step)
            columns.append((up - down) / (2.0 * h))
        j = np.column_stack(columns)
        j = j - j.mean(axis=0)  # the offset of the log
        weighted.append(j.T / sigma**2)
        total = total + weighted[-1] @ j
    covariance = np.linalg.inv(total)
    return np.sqrt(np.diag(covariance)), [covariance @ w for w in weighted]


@dataclass(frozen=True)
class Outcome:
    """Errors of one repetition in bounds, those of the linearised estimate, and hits."""

    errors: np.ndarray
    linear: np.ndarray
    hits: np.ndarray


def repeat(task: tuple[Cell, int]) -> Outcome:
    """Simulate and fit one repetition."""
    from fluidact_fit.estimation.inputs import settle_holds
    from fluidact_fit.experiment import Experiment, Signal
    from fluidact_fit.families import get_family
    from fluidact_fit.family import Request

    cell, number = task
    p = PROBLEMS[cell.problem]
    step, n = 1.0 / cell.rate, round(DURATION * cell.rate)
    family = get_family(p.family)
    time_axis = np.arange(n) * step
    experiments = []
    deviations, to_error = linearised(cell)
    linear = np.zeros(deviations.size)
    # a converter errs in the same way every time: only another motion is another experiment
    for k, u in enumerate(_inputs(cell, number if cell.noise == "adc12" else 0)):
        rng = np.random.default_rng([SEED, number, k])
        clean = p.simulate(p.truth, u, n, step)
        y = make_noise(cell, clean, rng)
        linear += to_error[k] @ (y - clean)
        logged = u[:: p.fine]
        signals = {
            p.roles[0]: Signal(p.roles[0], time_axis, logged, "1", p.hold, float(logged[0])),
            p.roles[1]: Signal(p.roles[1], time_axis, y, "1", resolution=resolution(cell, y)),
        }
        experiments.append(Experiment(f"log{k}", k, time_axis, signals, step, True))
    estimate = family.estimate(
        family.variants[0],
        settle_holds(experiments),
        Request(options=family.options_type.read(p.options)),
    )
    found = [estimate.parameters[name] for name in p.truth]
    truth = np.array(list(p.truth.values()))
    errors = np.array([float(q.value) for q in found]) - truth
    hits = [q.ci95 is not None and q.ci95[0] <= t <= q.ci95[1] for q, t in zip(found, truth)]
    return Outcome(errors / deviations, linear / deviations, np.array(hits))


def _inputs(cell: Cell, number: int = 0) -> list[np.ndarray]:
    p = PROBLEMS[cell.problem]
    step, n = 1.0 / cell.rate, round(DURATION * cell.rate)
    return [p.excite(np.random.default_rng([7, number, k]), n, step) for k in range(cell.logs)]


def run(cell: Cell, pool: ProcessPoolExecutor) -> list[str]:
    """One row per parameter."""
    begin = time.perf_counter()
    found = list(pool.map(repeat, [(cell, k) for k in range(cell.repetitions)], chunksize=2))
    errors, linear = np.array([f.errors for f in found]), np.array([f.linear for f in found])
    covered = 100.0 * np.mean([f.hits for f in found], axis=0)
    added = errors**2 - linear**2
    ratio = np.sqrt(np.maximum(1.0 + added.mean(axis=0), 0.0))
    spread = 0.5 * added.std(axis=0, ddof=1) / np.sqrt(len(found)) / np.maximum(ratio, 0.1)
    raw = np.sqrt(np.mean(errors**2, axis=0))
    exact = 100.0 * np.mean(np.abs(linear) <= 1.96, axis=0)
    rows = []
    for k, name in enumerate(PROBLEMS[cell.problem].truth):
        row = f"| {cell.problem} {name} | {cell.noise} | {cell.rate:g} | {cell.decibel:g} | "
        row += f"{cell.logs} | {cell.repetitions} | "
        if cell.noise == "white":
            row += f"{raw[k]:.3f} | {ratio[k]:.3f} ± {spread[k]:.3f} | {covered[k]:.1f} % | "
            rows.append(row + f"{exact[k]:.1f} % |")
        else:
            rows.append(row + f"| | {covered[k]:.1f} % | |")
    seconds = (time.perf_counter() - begin) / cell.repetitions
    print("\n".join(rows), f"   ({seconds:.2f} s per repetition)", flush=True)  # noqa: T201
    return rows


def cells(scale: float) -> tuple[list[Cell], list[Cell]]:
    """Cells of the coverage table and of the efficiency table."""
    many, some, few = (max(4, round(k * scale)) for k in (500, 100, 50))
    coverage = [
        Cell(p, 100.0, 40.0, 1, noise, many)
        for noise in ("white", "ar1", "adc12")
        for p in PROBLEMS
    ]
    efficiency = [
        Cell(p, rate, db, logs, "white", few if rate > 500 or logs > 1 else some)
        for p in PROBLEMS
        for rate in (50.0, 100.0, 1000.0)
        for db in (20.0, 40.0, 60.0)
        for logs in (1, 5)
    ]
    return coverage, efficiency


HEAD = """# How good the numbers are

Written by `python studies/statistics_study.py` (`make study`), seed {seed}, {date}.
{repetitions}

`rms / bound` is the root-mean-square error over the Cramér-Rao bound of the same unknowns: one
is as good as any unbiased estimate can be. As counted, {few} repetitions give it to about
±{ratio:.0%}. In `controlled` the error of the linearised estimate under the same noise, whose
mean square is the bound itself, serves as control variate; ± is its standard deviation.
`coverage` is how often the 95 % interval held the truth, known to ±{cover:.1f} points with {many}
repetitions; `exact` is how often an exact interval about the linearised estimate held it under
the same noise, so that the difference of the two is no matter of chance. `white`, `ar1`
(coefficient 0.9) and `adc12` (12-bit converter, another motion every time) are the noises; for
the converter the signal-to-noise ratio is the converter's own.

| parameter | noise | Hz | dB | logs | runs | rms / bound | controlled | coverage | exact |
|---|---|---|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Run the study and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scale", type=float, default=1.0, help="share of the repetitions")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=("coverage", "efficiency"), default=None)
    parser.add_argument("--rates", default="50,100,1000", help="rates of the efficiency table")
    parser.add_argument("--output", type=Path, default=Path("docs/evidence/statistics.md"))
    given = parser.parse_args()
    coverage, efficiency = cells(given.scale)
    rates = {float(r) for r in given.rates.split(",")}
    chosen = [] if given.only == "efficiency" else coverage
    chosen += [] if given.only == "coverage" else [c for c in efficiency if c.rate in rates]
    rows: list[str] = []
    with ProcessPoolExecutor(given.workers) as pool:
        for cell in chosen:
            rows += run(cell, pool)
    counts = sorted({c.repetitions for c in chosen})
    head = HEAD.format(
        seed=SEED,
        date=time.strftime("%Y-%m-%d"),
        repetitions=f"Repetitions: {', '.join(map(str, counts))} per cell.",
        few=counts[0],
        many=counts[-1],
        ratio=(1.0 / (2.0 * counts[0])) ** 0.5,
        cover=100.0 * (0.05 * 0.95 / counts[-1]) ** 0.5,
    )
    given.output.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
