# ruff: noqa: T201 (it prints its table)
"""How often the predicted band of the tracking error holds that of the true machine.

    python -m studies.prediction [--rigs 120] [--write]

A rig is drawn, three short logs of it are simulated and fitted, and the closed loop is predicted
from the parameter file with its uncertainty (``--draws`` of the command line). Then the true
machine runs under the gains that the file gave. Machine and controller of the truth are a few lines
of their own here: the equation that is fitted, and scipy's filter. No rig is left out: one that
cannot be fitted is counted. ``--write`` writes ``docs/evidence/prediction.md``.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import butter
from studies.red_team.attacks.hydrostatic import record

import fluidact_fit as ff
from fluidact_fit.control.closed_loop import simulate_loop
from fluidact_fit.control.controller_file import (
    ControllerFile,
    LimitKeys,
    PDKeys,
    ReferenceKeys,
)
from fluidact_fit.errors import FluidactError
from fluidact_fit.experiment import FloatArray

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "prediction.md"
SEED, DRAWS, DURATION, SAMPLES, NOISE = 8811, 60, 4.0, 400, 0.1
METRICS = ("rms_error", "largest_error")
STEP, SIZE, SPEED, CUTOFF = 0.01, 5e-3, 1e-2, 10.0
LOGGED, LIMIT = 40.0, 38.0  # force of the logs, and of the controller, which stays within them [N]
BANDWIDTH, RATIO = 2.5, 0.8
CONTROLLER = ControllerFile(
    "pd", STEP, PDKeys(bandwidth=BANDWIDTH, damping_ratio=RATIO, cutoff=CUTOFF),
    reference=ReferenceKeys(size=SIZE, speed=SPEED, at=0.0), limits=LimitKeys(-LIMIT, LIMIT),
)  # fmt: skip
_EXPLAINED = f"""\
# Prediction of closed loops

Written by `studies/prediction.py`. A rig of the hydrostatic kind is drawn (mass 30 to 90 kg,
damping 1000 to 3000 N s/m, dead-zone edges 1 to 4 N), three logs of {SAMPLES} samples with noise of
{100 * NOISE:g} % of the position and forces up to {LOGGED:g} N are fitted, and the tracking of a
triangle ({1e3 * SIZE:g} mm at {1e3 * SPEED:g} mm/s) under the controller that the file gives
(bandwidth {BANDWIDTH:g} Hz, damping ratio {RATIO:g}, at most {LIMIT:g} N) is predicted from {DRAWS}
draws of the parameters. Then the true machine runs under that controller: a mass with viscous
damping behind a dead zone, as it is fitted, in a simulator of its own. `held`: how often the middle
90 % of the predictions hold what the true machine does, with the standard error of that; `width`:
half the band over the error, median.

| metric | rigs | held | width |
|---|---|---|---|
"""


def machine(rng: np.random.Generator) -> dict[str, float]:
    """A rig: parameters [SI]."""
    return {
        "mass": rng.uniform(30.0, 90.0),
        "damping": rng.uniform(1000.0, 3000.0),
        "dead_zone_negative": -rng.uniform(1.0, 4.0),
        "dead_zone_positive": rng.uniform(1.0, 4.0),
    }


def triangle(time: FloatArray) -> FloatArray:
    """What is wanted [m]."""
    phase = (SPEED * time / SIZE) % 2.0
    return SIZE * (1.0 - np.abs(phase - 1.0))


def true_errors(
    truth: Mapping[str, float], proportional: float, derivative: float
) -> dict[str, float]:
    """Errors of the true machine under a PD controller, its force held from sample to sample."""
    b, a = butter(2, CUTOFF, fs=1.0 / STEP)
    rate = truth["damping"] / truth["mass"]
    fading = exp(-rate * STEP)
    x = v = 0.0
    last, filtered, errors = None, [0.0, 0.0], []
    for wanted in triangle(np.arange(round(DURATION / STEP) + 1) * STEP).tolist():
        error = wanted - x
        slope = 0.0 if last is None else (error - last) / STEP
        last = error
        smooth = b[0] * slope + filtered[0]
        filtered = [b[1] * slope - a[1] * smooth + filtered[1], b[2] * slope - a[2] * smooth]
        force = min(max(proportional * error + derivative * smooth, -LIMIT), LIMIT)
        low, high = truth["dead_zone_negative"], truth["dead_zone_positive"]
        through = force - high if force > high else force - low if force < low else 0.0
        final = through / truth["damping"]
        x += final * STEP + (v - final) * (1.0 - fading) / rate
        v = final + (v - final) * fading
        errors.append(error)
    found = np.array(errors)
    return {
        "rms_error": float(np.sqrt(np.mean(found**2))),
        "largest_error": float(np.abs(found).max()),
    }


def one(number: int) -> Mapping[str, Any]:
    """What a rig showed: metric to (low, high, true); ``refused`` with the reason instead."""
    rng = np.random.default_rng([SEED, number])
    truth = machine(rng)
    logs = record(rng, truth=truth, n=SAMPLES, sigma=NOISE, runs=3, low=-LOGGED, high=LOGGED)
    try:
        document = ff.fit("hydrostatic", [dict(log) for log in logs]).document
        loop = simulate_loop(
            [document], CONTROLLER, "triangle", duration=DURATION, draws=DRAWS, seed=number
        )
    except FluidactError as error:
        return {"refused": str(error).splitlines()[0]}
    gains = {e.key: float(e.value) for e in loop.numbers if not isinstance(e.value, str)}
    found = true_errors(truth, gains["proportional"], gains["derivative"])
    spread = loop.spread()
    return {name: (*spread[name], found[name]) for name in METRICS}


def rows(outcomes: list[Mapping[str, Any]]) -> Iterator[str]:
    """The table, and what was refused."""
    good = [o for o in outcomes if "refused" not in o]
    for name in METRICS:
        low, high, true = np.array([o[name] for o in good]).T
        held = float(np.mean((low <= true) & (true <= high)))
        error = np.sqrt(held * (1.0 - held) / len(good))
        width = np.median(0.5 * (high - low) / true)
        words = name.replace("_", " ")
        share = f"{100.0 * held:.0f} ± {100.0 * error:.0f} %"
        yield f"| {words} | {len(good)} | {share} | {100.0 * width:.2g} % |"
    refused = Counter(o["refused"] for o in outcomes if "refused" in o)
    for reason, count in refused.items():
        yield f"\nNot fitted, {count}: {reason}"


def main() -> None:
    """Run the rigs on all cores, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=120)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        table = "\n".join(rows(list(pool.map(one, range(given.rigs))))) + "\n"
    print(table)
    if given.write:
        PAGE.write_text(_EXPLAINED + table, encoding="utf-8")


if __name__ == "__main__":
    main()
