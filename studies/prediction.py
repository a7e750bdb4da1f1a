# ruff: noqa: T201 (it prints its table)
"""How often the predicted band of the tracking error holds that of the true machine.

    python -m studies.prediction [--rigs 100] [--write]

A rig is drawn, three short logs of it are simulated and fitted, and the closed loop is predicted
from the parameter file with its uncertainty (``--draws`` of the command line). Then the true
machine runs under the controller that the file gave. No rig is left out: one that cannot be fitted
is counted. ``--write`` writes ``docs/prediction.md``.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from studies.red_team.attacks.hydrostatic import record

import fluidact_fit as ff
from fluidact_fit.control.closed_loop import make_reference, simulate_loop, with_values
from fluidact_fit.control.controller_file import ControllerFile, PDKeys, ReferenceKeys
from fluidact_fit.control.loading import make_block
from fluidact_fit.control.loop import run_loop
from fluidact_fit.control.machines import make_plant
from fluidact_fit.control.metrics import tracking_metrics
from fluidact_fit.errors import FluidactError

PAGE = Path(__file__).parents[1] / "docs" / "prediction.md"
SEED, DRAWS, DURATION, SAMPLES, NOISE = 8811, 60, 4.0, 400, 0.1
METRICS = ("rms_error", "largest_error")
CONTROLLER = ControllerFile(
    "pd", 0.01, PDKeys(bandwidth=1.0, damping_ratio=0.8),
    reference=ReferenceKeys(size=5e-3, speed=1e-2),
)  # fmt: skip
_EXPLAINED = f"""\
# Prediction of closed loops

Written by `studies/prediction.py`. A rig of the hydrostatic kind is drawn (mass 30 to 90 kg,
damping 1000 to 3000 N s/m, dead-zone edges 1 to 4 N), three logs of {SAMPLES} samples with noise of
{100 * NOISE:g} % of the position are fitted, and the tracking of a triangle (5 mm at 10 mm/s) under
the controller that the file gives (bandwidth 1 Hz, damping ratio 0.8) is predicted from {DRAWS}
draws of the parameters. Then the true machine runs under that controller. `held`: how often the
middle 90 % of the predictions hold what the true machine does; `width`: half the band over the
error, median.

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


def one(number: int) -> Mapping[str, Any]:
    """What a rig showed: metric to (low, high, true); ``refused`` with the reason instead."""
    rng = np.random.default_rng([SEED, number])
    truth = machine(rng)
    logs = record(rng, truth=truth, n=SAMPLES, sigma=NOISE, runs=3)
    try:
        document = ff.fit("hydrostatic", [dict(log) for log in logs]).document
        loop = simulate_loop(
            [document], CONTROLLER, "triangle", duration=DURATION, draws=DRAWS, seed=number
        )
    except FluidactError as error:
        return {"refused": str(error).splitlines()[0]}
    plant = make_plant(CONTROLLER, [make_block(with_values(document, truth), accept_failed=True)])
    course, start, _ = make_reference("triangle", CONTROLLER.reference, plant.controlled.unit)
    true = run_loop(plant, loop.controller, course, DURATION, start)
    found = tracking_metrics(true.reference, true.output).to_dict()
    spread = loop.spread()
    return {name: (*spread[name], found[name]) for name in METRICS}


def rows(outcomes: list[Mapping[str, Any]]) -> Iterator[str]:
    """The table, and what was refused."""
    good = [o for o in outcomes if "refused" not in o]
    for name in METRICS:
        low, high, true = np.array([o[name] for o in good]).T
        held = np.mean((low <= true) & (true <= high))
        width = np.median(0.5 * (high - low) / true)
        words = name.replace("_", " ")
        yield f"| {words} | {len(good)} | {100.0 * held:.0f} % | {100.0 * width:.2g} % |"
    refused = Counter(o["refused"] for o in outcomes if "refused" in o)
    for reason, count in refused.items():
        yield f"\nNot fitted, {count}: {reason}"


def main() -> None:
    """Run the rigs on all cores, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        table = "\n".join(rows(list(pool.map(one, range(given.rigs))))) + "\n"
    print(table)
    if given.write:
        PAGE.write_text(_EXPLAINED + table, encoding="utf-8")


if __name__ == "__main__":
    main()
