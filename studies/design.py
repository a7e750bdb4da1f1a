"""Does the designed experiment halve the standard error of the worst parameter?

    python studies/design.py [--seeds 8] [--trials 1 2 3] [--families ...] [--output FILE.md]

For every dynamic family and every trial of its dataset: fit the one log, design the next
experiment from that file within the same duration, amplitude and stroke, play it to the
dataset's own simulator (``datasets/generators``: true parameters, its noise, its
converters), fit again, and compare with logs of the trial's own kind of excitation.

``cylinder-friction`` is a static map, and its bound is known: whatever the motion, half the
samples are the most that either Coulomb level can have if the other is to be as good, and
``viscous`` needs a spread of speeds that the amplitude limits. The least ratio over *all*
motions within the amplitude is printed beside what was reached; both sides of it are
Cramer-Rao bounds with every sample used.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

import fluidact_fit as ff
from fluidact_fit.excitation import Design, design
from fluidact_fit.result import FitResult

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[1]
FAMILIES = ("ball-screw", "hydrostatic", "valve", "line", "cylinder-friction")
STROKES = {"cylinder-friction": (0.0, 0.055)}  # range of its position sensor [m]


def load_generator() -> SimpleNamespace:
    """Return the simulators of ``datasets/generators`` under one roof."""
    if str(ROOT / "datasets") not in sys.path:
        sys.path.insert(0, str(ROOT / "datasets"))
    names = ("signals", "writing", *(f.replace("-", "_") for f in FAMILIES))
    modules = [import_module(f"generators.{name}") for name in names]
    found = {key: value for module in modules for key, value in vars(module).items()}
    return SimpleNamespace(**found, DATASETS=[m.DATASET for m in modules[2:]])


def move_smoothly(g: Any, command: Array) -> Array:
    """A command that moves on between its samples, on the fine grid."""
    from scipy.interpolate import PchipInterpolator

    fine = g.STEP / g.FINE * np.arange((command.size - 1) * g.FINE + 1)
    return np.asarray(PchipInterpolator(g.STEP * np.arange(command.size), command)(fine))


def play_hydrostatic(g: Any, found: Design, rng: np.random.Generator) -> list[Array]:
    """Force on straight lines of 0.1 ms, as in the dataset."""
    force = move_smoothly(g, found.signals["force"])
    low, high = (g.scalar(g.HYDROSTATIC, f"dead_zone_{s}") for s in ("negative", "positive"))
    net = np.maximum(force - high, 0.0) + np.minimum(force - low, 0.0)
    damping = g.scalar(g.HYDROSTATIC, "damping")
    tau = g.scalar(g.HYDROSTATIC, "mass") / damping
    speed = g.lag_of_straight_lines(net / damping, tau)
    h = g.STEP / g.FINE
    impulse = np.concatenate(([0.0], np.cumsum(0.5 * h * (net[1:] + net[:-1]))))
    position = (impulse / damping - tau * speed)[:: g.FINE]
    n = position.size
    measured = 0.025 + position + 10e-6 * rng.standard_normal(n)
    sensed = force[:: g.FINE] + 0.02 * rng.standard_normal(n)
    return [
        found.time,
        g.quantise(sensed, 100.0 / 2**16),
        1e3 * g.quantise(measured, 55e-3 / 2**16),
    ]


def play_valve(g: Any, found: Design, rng: np.random.Generator) -> list[Array]:
    """Held command, second order."""
    command = np.round(found.signals["command"], 2)
    omega, zeta = g.scalar(g.VALVE, "natural_frequency"), g.scalar(g.VALVE, "damping_ratio")
    pressure = 1e-5 * g.scalar(g.VALVE, "gain") * g.second_order(command, omega, zeta, g.STEP)
    measured = 0.03 + pressure + 0.01 * rng.standard_normal(command.size)
    return [found.time, command, g.quantise(measured, 10.0 / 2**12)]


def play_line(g: Any, found: Design, rng: np.random.Generator) -> list[Array]:
    """The dataset's valve follows the designed pressure as best it can."""
    target = np.repeat(1e-5 * found.signals["inlet"], g.FINE)[: -(g.FINE - 1)]
    inlet = g.second_order(target, 40.0, 0.8, g.STEP / g.FINE)
    late = round(g.scalar(g.LINE, "dead_time") / (g.STEP / g.FINE))
    delayed = np.concatenate((np.full(late, inlet[0]), inlet[:-late]))
    tau = g.scalar(g.LINE, "time_constant")
    outlet = g.scalar(g.LINE, "gain") * g.lag_of_straight_lines(delayed, tau)
    n = found.time.size
    near = inlet[:: g.FINE] + 0.002 * rng.standard_normal(n)
    far = outlet[:: g.FINE] + 0.005 * rng.standard_normal(n)
    return [1e3 * found.time, g.quantise(near, 10.0 / 2**14), g.quantise(far, 10.0 / 2**14)]


def play_ball_screw(g: Any, found: Design, rng: np.random.Generator) -> list[Array]:
    """Held torque in steps of 0.003 mN m, encoder of 2000 counts."""
    torque = g.quantise(1e3 * found.signals["torque"], 0.003)
    turns = g.stick_slip((1e-3 * torque).tolist()) / (2.0 * np.pi)
    return [found.time, torque, 0.18 * np.floor(2000.0 * turns + rng.uniform())]


def play_cylinder(g: Any, found: Design, rng: np.random.Generator) -> list[Array]:
    """Strokes of a hand or a drive that keeps the speed."""
    speed, position = found.signals["velocity"], found.signals["position"]
    level = np.where(
        speed > 0.0,
        g.scalar(g.CYLINDER, "coulomb_positive"),
        -g.scalar(g.CYLINDER, "coulomb_negative"),
    )
    inertia = g.CYLINDER_MASS * np.gradient(speed, g.STEP)
    n = speed.size
    force = inertia + g.scalar(g.CYLINDER, "viscous") * speed + level * (speed != 0.0)
    return [
        found.time,
        g.quantise(force + 0.1 * rng.standard_normal(n), 100.0 / 2**16),
        1e3 * g.quantise(position + 10e-6 * rng.standard_normal(n), 55e-3 / 2**16),
        1e3 * (speed + 1e-3 * rng.standard_normal(n)),
    ]


PLAYERS = {
    "hydrostatic": play_hydrostatic,
    "valve": play_valve,
    "line": play_line,
    "ball-screw": play_ball_screw,
    "cylinder-friction": play_cylinder,
}


def fit_columns(data: Any, columns: Sequence[Array], folder: Path) -> FitResult:
    """Write a log as the dataset does and fit it."""
    path = folder / "log.csv"
    path.write_text(load_generator().format_log(data, columns), encoding="utf-8")
    return ff.fit(data.family, ff.read_log(path, columns=data.roles), **data.options)


@dataclass(frozen=True)
class Runs:
    """Standard errors and errors over repetitions, by parameter: shape ``(seeds,)`` each."""

    std_errors: Mapping[str, Array]
    errors: Mapping[str, Array]

    def std_error(self, name: str) -> float:
        """Median standard error."""
        return float(np.median(self.std_errors[name]))

    def rms(self, name: str) -> float:
        """Root mean square of the true error."""
        return float(np.sqrt(np.mean(self.errors[name] ** 2)))


def collect(results: Sequence[FitResult], truth: Mapping[str, float]) -> Runs:
    """Gather the numbers of several fits."""

    def spread(result: FitResult, name: str) -> float:
        given = result.parameters[name].std_error
        return given if isinstance(given, float) else float("nan")

    std_errors = {n: np.array([spread(r, n) for r in results]) for n in truth}
    errors = {
        n: np.array([np.asarray(r.parameters[n].value) - v for r in results])
        for n, v in truth.items()
    }
    return Runs(std_errors, errors)


@dataclass(frozen=True)
class Outcome:
    """Before and after, of one trial of one family."""

    family: str
    trial: int
    truth: Mapping[str, float]
    before: Runs
    after: Runs
    plan: Design
    least: float | None = None

    def relative(self, runs: Runs, name: str) -> float:
        """Standard error as a share of the truth."""
        return runs.std_error(name) / abs(self.truth[name])

    @property
    def worst(self) -> str:
        """The parameter with the largest relative standard error before."""
        return max(self.truth, key=lambda n: self.relative(self.before, n))

    @property
    def ratio(self) -> float:
        """Largest relative standard error after, by the largest before."""
        after = max(self.relative(self.after, n) for n in self.truth)
        return after / self.relative(self.before, self.worst)

    @property
    def ratio_of_worst(self) -> float:
        """Standard error after by before, of the parameter that was the worst."""
        return self.after.std_error(self.worst) / self.before.std_error(self.worst)


def least_ratio(velocity: Array, truth: Mapping[str, float]) -> float:
    """Least ratio of the worst relative standard error that any motion could reach.

    The best of all measures on the speeds up to the highest of a log, shape ``(n,)`` [m/s],
    against every sample of that log. A line is known best from its ends, so the measure
    needs four speeds: next to rest and the highest, in both directions.
    """
    from scipy.optimize import minimize

    scales = np.array([truth[n] for n in ("viscous", "coulomb_positive", "coulomb_negative")])

    def worst(speeds: Array, weights: Array) -> float:
        rows = np.column_stack((speeds, speeds > 0.0, -(speeds < 0.0).astype(float)))
        inverse = np.linalg.inv(rows.T @ (weights[:, None] * rows))
        return float(np.max(np.sqrt(np.diag(inverse)) / scales))

    own = worst(velocity, np.ones(velocity.size))
    rest = 1e-6 * float(np.abs(velocity).max())
    ends = np.array([float(velocity.min()), -rest, rest, float(velocity.max())])

    def of_shares(x: Array) -> float:
        shares = np.exp(np.append(x, 0.0))
        return worst(ends, velocity.size * shares / shares.sum())

    starts = [np.array([a, b, b]) for a in (-2.0, 0.0) for b in (0.0, 2.0)]
    options = {"maxfev": 2000, "xatol": 1e-5, "fatol": 1e-9}
    found = [minimize(of_shares, x, method="Nelder-Mead", options=options).fun for x in starts]
    return float(min(found) / own)


def study(family: str, trial: int, seeds: int) -> Outcome:
    """Compare the designed experiment with the dataset's own kind of excitation."""
    g = load_generator()
    data = next(d for d in g.DATASETS if d.family == family)
    truth = {n: g.scalar(data.truth, n) for n in data.truth}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = np.random.default_rng([*data.seed, trial])
        present = fit_columns(data, data.simulate(first, trial), folder)
        present.save(folder / "present.yaml")
        plan = design(folder / "present.yaml", stroke=STROKES.get(family))
        own, designed = [present], []
        for k in range(seeds):
            rng = np.random.default_rng([*data.seed, trial, 1000 + k])
            designed.append(fit_columns(data, PLAYERS[family](g, plan, rng), folder))
            if k:
                own.append(fit_columns(data, data.simulate(rng, trial), folder))
    least = None
    if family == "cylinder-friction":
        rng = np.random.default_rng([*data.seed, trial])
        least = least_ratio(1e-3 * data.simulate(rng, trial)[3], truth)
    before, after = collect(own, truth), collect(designed, truth)
    return Outcome(family, trial, truth, before, after, plan, least)


def format_outcome(o: Outcome) -> list[str]:
    """Rows of the table, one per parameter."""
    rows = []
    for n in o.truth:
        predicted = o.plan.predicted.get(n)
        after = o.after.std_error(n)
        rows.append(
            f"| {o.family} {o.trial + 1} | {n}{' **(worst)**' if n == o.worst else ''} "
            f"| {100 * o.relative(o.before, n):.3g} % | {100 * o.relative(o.after, n):.3g} % "
            f"| {after / o.before.std_error(n):.2g} "
            f"| {'' if not predicted else f'{after / predicted:.2f}'} "
            f"| {o.before.rms(n) / abs(o.truth[n]) * 100:.2g} % "
            f"| {o.after.rms(n) / abs(o.truth[n]) * 100:.2g} % |"
        )
    return rows


def main() -> None:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--trials", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=FAMILIES)
    parser.add_argument("--output", type=Path)
    chosen = parser.parse_args()
    rows = [
        "# Designed experiments, played",
        "",
        f"Written by `python studies/design.py` (`make study`), {chosen.seeds} seeds. The standard",
        "errors are those that the fits state, in % of the value; the rms errors are against the",
        "truth. See [design.md](../design.md).",
        "",
        "| log | parameter | own std error | designed std error | ratio | designed / predicted "
        "| own rms error | designed rms error |",
        "|---|---|---|---|---|---|---|---|",
    ]
    verdicts = []
    for family in chosen.families:
        for trial in chosen.trials:
            o = study(family, trial - 1, chosen.seeds)
            rows += format_outcome(o)
            word = "halved" if o.ratio <= 0.5 else "NOT halved"
            if o.least is not None:
                word += f"; no motion could reach less than x {o.least:.2g}"
            verdicts.append(
                f"- {family} trial {trial}: worst parameter {o.worst}, std error x "
                f"{o.ratio_of_worst:.2g}; worst of all x {o.ratio:.2g} ({word}); "
                f"{o.plan.description}"
            )
            sys.stdout.write(verdicts[-1] + "\n")
            sys.stdout.flush()
    text = "\n".join([*rows, "", *verdicts, ""])
    sys.stdout.write(text)
    if chosen.output:
        chosen.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
