"""P1 to P4 of the benchmark through the command line, each trial by itself."""

from __future__ import annotations

import csv
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .command import ROOT, fit
from .figures import Figure, number, quantity
from .task import Task

sys.path.insert(0, str(ROOT / "bench"))

import problems

GROUP = "bench"
TRIALS = 3

# problem: family, headers, parameters of the file. Holds are declared in _more.
_HOW: dict[str, tuple[str, tuple[str, str], dict[str, str]]] = {
    "P1": ("hydrostatic", ("force [N]", "position [m]"),
           {"dz_neg": "dead_zone_negative", "dz_pos": "dead_zone_positive", "m": "mass",
            "c": "damping"}),
    "P2": ("valve", ("command [V]", "outlet [V]"),
           {"wn": "natural_frequency", "z": "damping_ratio"}),
    "P3": ("line", ("inlet [Pa]", "outlet [Pa]"),
           {"K": "gain", "tau": "time_constant", "L": "dead_time"}),
    "P4": ("ball-screw", ("torque [N m]", "angle [rad]"),
           {"J": "inertia", "b": "viscous", "fkp": "coulomb_positive",
            "fkn": "coulomb_negative", "fsp": "breakaway_positive",
            "fsn": "breakaway_negative"}),
}  # fmt: skip


def tasks() -> list[Task]:
    """One task per problem."""
    return [Task(GROUP, n, 40.0 if n == "P4" else 10.0, partial(_problem, n)) for n in _HOW]


def _more(name: str) -> list[str]:
    """What is known beside the log: that an input is held or is not, a gain of one."""
    return {
        "P1": [],
        "P2": ["--fix", "gain=1"],
        "P3": ["--hold", "inlet=zoh"],
        "P4": ["--hold", "torque=auto"],
    }[name]


def _problem(name: str, folder: Path) -> list[Figure]:
    family, headers, names = _HOW[name]
    problem = problems.PROBLEMS[name]
    errors: dict[str, list[float]] = {k: [] for k in names}
    trouble = ""
    for number_of_trial in range(TRIALS):
        trial = problems.make_trial(problem, number_of_trial)
        path = folder / f"{name}-{number_of_trial}.csv"
        _write(path, headers, trial.log)
        run = fit([family, str(path), *_more(name)], path.with_suffix(".yaml"))
        if run.file is None:
            trouble = run.word
            continue
        bound = problems.bound(problem, trial)
        for short, long in names.items():
            found = quantity(run.file, long)
            if found.get("status") == "not_identified" or found.get("value") is None:
                trouble = "not identified"
                continue
            errors[short].append((float(found["value"]) - problem.truth[short]) / bound[short])
    what = f"rms error of {TRIALS} trials in Cramér-Rao deviations"
    out = []
    for short, long in names.items():
        whole = len(errors[short]) == TRIALS
        seen: Any = float(np.sqrt(np.mean(np.square(errors[short])))) if whole else trouble
        truth = f"truth {problem.truth[short]:g}"
        out.append(number(GROUP, f"{name}: {long}", what, truth, seen, "low", noise=0.1))
    return out


def _write(path: Path, headers: tuple[str, str], log: Any) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time [s]", *headers])
        writer.writerows(zip(log.t.tolist(), log.u.tolist(), log.y.tolist()))
