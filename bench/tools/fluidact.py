"""This project: ``Family.estimate`` on experiments read from a CSV log.

The log goes through a CSV file as every log does; reading it is not timed, as handing an
array to the other tools is not. It is run without start values, that is with less than the
other tools are told, and once more with ``--start`` at the guess they get. The gain of P2 is
fixed at one because the model of P2 has none. Offset and initial state stay free, as they
are by default, although the bound takes them as known.
"""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path
from typing import Any

import fluidact_fit as ff
from fluidact_fit.estimation.inputs import settle_holds
from fluidact_fit.family import Request
from fluidact_fit.logs import choose_variant, experiments

TITLE = "**fluidact-fit**"

# problem: family, headers of the columns, hold of the input, parameters, fixed ones
_HOW: dict[str, tuple[str, tuple[str, str], tuple[str, str], dict[str, str], dict[str, float]]] = {
    "P1": ("hydrostatic", ("force [N]", "position [m]"), ("force", "auto"),
           {"dz_neg": "dead_zone_negative", "dz_pos": "dead_zone_positive", "m": "mass",
            "c": "damping"}, {}),
    "P2": ("valve", ("command [V]", "outlet [V]"), ("command", "zoh"),
           {"wn": "natural_frequency", "z": "damping_ratio"}, {"gain": 1.0}),
    "P3": ("line", ("inlet [Pa]", "outlet [Pa]"), ("inlet", "zoh"),
           {"K": "gain", "tau": "time_constant", "L": "dead_time"}, {}),
    "P4": ("ball-screw", ("torque [N m]", "angle [rad]"), ("torque", "auto"),
           {"J": "inertia", "b": "viscous", "fkp": "coulomb_positive", "fkn": "coulomb_negative",
            "fsp": "breakaway_positive", "fsn": "breakaway_negative"}, {}),
}  # fmt: skip


def version() -> str:
    """Version of the package."""
    return ff.__version__


def prepare(fit: str, log: Any) -> Any:
    """Write the log as a CSV and read it back as experiments."""
    family, headers, (role, hold), _, _ = _HOW[fit.split("|")[0]]
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "log.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time [s]", *headers])
            writer.writerows(zip(log.t.tolist(), log.u.tolist(), log.y.tolist()))
        read = ff.read_log(path)
    read.holds[role] = hold
    variant = choose_variant([read], ff.get_family(family).variants)
    return variant, settle_holds(experiments(read, variant)[0])


def _fit(problem: str, started: bool) -> Any:
    family, _, _, names, fixed = _HOW[problem]
    model = ff.get_family(family)
    options = model.options_type()

    def run(given: Any, guess: dict[str, float]) -> dict[str, float]:
        variant, runs = given
        start = {names[k]: v for k, v in guess.items()} if started else {}
        estimate = model.estimate(variant, runs, Request(options, fixed, start))
        return {k: estimate.parameters[n].value for k, n in names.items()}

    return run


FITS = {problem: _fit(problem, False) for problem in _HOW}
FITS |= {f"{problem}|started at the guess": _fit(problem, True) for problem in _HOW}
