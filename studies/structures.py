# ruff: noqa: T201 (it prints its table)
"""Does ``compare --structures`` recommend the structure that the logs were made with?

    python studies/structures.py [--write] [--seeds N] [FAMILY...]

Two logs a machine, from simulators that share nothing with the estimators; a simple machine must
not get more terms than it has, and a machine with a term must get it. ``--write`` writes
``docs/evidence/structures.md``.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies.red_team.attack import Recording
from studies.red_team.attacks import (
    cylinder_friction,
    flow_map,
    hydraulic_motor,
    hydrostatic,
    spring_cylinder,
    valve,
)

from fluidact_fit.structures import compare_structures

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "structures.md"
Record = Callable[[np.random.Generator], list[Recording]]
SEEDS = {"hydrostatic": 3, "hydraulic-motor": 3}  # these take their time
HEAD = (
    "# Recommended structures",
    "",
    "Written by `studies/structures.py`: what `compare --structures` recommends for two logs of",
    "machines of known structure, from simulators that share nothing with the estimators.",
    "A simple machine must not get more terms than it has, a machine with a term must get it.",
    "The second number is how many pairs of logs were tried.",
    "",
    "| family | structure of the machine | recommended | instead |",
    "|---|---|---|---|",
)


@dataclass(frozen=True)
class Machine:
    """A machine of a known structure, how it is recorded, and what else the fit is told."""

    family: str
    structure: str
    record: Record
    options: Mapping[str, Any] = field(default_factory=dict)


def line(rng: np.random.Generator, *, lags: tuple[float, ...], delay: float) -> list[Recording]:
    """A line of one or two lags behind a held inlet, exact at the samples."""
    n, step = 600, 0.01
    u = 1e5 * (2.0 + valve.levels(rng, n, step, 0.2, 0.8))
    poles = 1.0 / np.array(lags if len(lags) == 2 else (lags[0], 1e-6))
    truth = {"gain": 0.98, "natural_frequency": np.sqrt(poles.prod()),
             "damping_ratio": 0.5 * poles.sum() / np.sqrt(poles.prod())}  # fmt: skip
    y = valve.simulate(truth, u - u[0], step, delay) + 0.98 * u[0]
    time = step * np.arange(n)
    return [{"time": time, "inlet": u, "outlet": y + 500.0 * rng.standard_normal(n)}]


def sided(rng: np.random.Generator, *, law: Mapping[str, float]) -> list[Recording]:
    """Friction that may differ between the directions by its viscous part."""
    (found,) = cylinder_friction.record(
        rng, law=law, motions=[STROKES], n=1500, role="velocity", sigma=0.1
    )
    v = found["velocity"]
    return [{**found, "force": found["force"] + law.get("more", 0.0) * np.maximum(v, 0.0)}]


STROKES = partial(cylinder_friction.in_strokes, speeds=(0.02, 0.05, 0.09, 0.15), length=0.08,
                  ramp=0.05)  # fmt: skip
FRICTION = dict(cylinder_friction.TRUTH)
SPRING = dict(spring_cylinder.TRUTH)
HYDROSTATIC = dict(hydrostatic.TRUTH)
MOTOR = dict(hydraulic_motor.TRUTH)


def machines() -> Iterator[Machine]:
    """Every structure of every family that a simulator can make."""
    made = partial(valve.record, n=600)
    yield Machine("valve", "second order", made)
    yield Machine("valve", "second order, dead time", partial(made, delay=0.013))
    held = {"hold": {"inlet": "zoh"}}
    for structure, lags, delay in (
        ("first order", (0.12,), 0.0),
        ("first order, dead time", (0.12,), 0.0147),
        ("second order", (0.12, 0.05), 0.0),
        ("second order, dead time", (0.12, 0.05), 0.0147),
    ):
        yield Machine("line", structure, partial(line, lags=lags, delay=delay), held)
    zoned = partial(hydrostatic.record, n=600)
    yield Machine("hydrostatic", "dead zone", zoned)
    late, sprung = {**HYDROSTATIC, "dead_time": 0.03}, {**HYDROSTATIC, "stiffness": 2000.0}
    yield Machine("hydrostatic", "dead zone, dead time", partial(zoned, truth=late))
    yield Machine("hydrostatic", "dead zone, spring", partial(zoned, truth=sprung))
    mass = {"mass": cylinder_friction.MASS}
    for structure, more in (
        ("symmetric viscous friction", {}),
        ("asymmetric viscous friction", {"more": 15.0}),
        ("symmetric, Stribeck", {"stribeck": 1.5, "stribeck_speed": 0.04}),
    ):
        record = partial(sided, law={**FRICTION, **more})
        yield Machine("cylinder-friction", structure, record, mass)
    rising = {**SPRING, "stribeck": 2.5, "stribeck_speed": 0.008}
    for structure, law in (
        ("Coulomb friction", SPRING),
        ("Coulomb friction, Stribeck", rising),
    ):
        yield Machine("spring-cylinder", structure, partial(spring_cylinder.log, p=law, n=2500))
    for structure, change in (
        ("no hysteresis, no dead time", {"hysteresis": 0.0, "dead_time": 0.0}),
        ("hysteresis", {"dead_time": 0.0}),
        ("dead time", {"hysteresis": 0.0}),
        ("hysteresis, dead time", {}),
    ):
        record = partial(hydraulic_motor.log, p={**MOTOR, **change}, n=1000)
        yield Machine("hydraulic-motor", structure, record)
    for structure, change in (
        ("straight, no leakage", {"curvature": 0.0, "leakage": 0.0}),
        ("curved, no leakage", {"leakage": 0.0}),
        ("straight, leakage", {"curvature": 0.0}),
        ("curved, leakage", {}),
    ):
        yield Machine("flow-map", structure, partial(flow_map._log, machine=change, n=600))


def recommended(machine: Machine, seed: int) -> str:
    """What is recommended for two logs of a machine."""
    rng = np.random.default_rng(seed)
    logs = [log for _ in range(2) for log in machine.record(rng)]
    return str(compare_structures(machine.family, logs, **machine.options).recommended)


def table(families: list[str], seeds: int | None) -> Iterator[str]:
    """Rows of the page, one a machine."""
    for machine in machines():
        if families and machine.family not in families:
            continue
        times = seeds or SEEDS.get(machine.family, 10)
        found = Counter(recommended(machine, seed) for seed in range(times))
        right = found.pop(machine.structure, 0)
        others = ", ".join(f"{name} ({count})" for name, count in found.items()) or "-"
        yield f"| {machine.family} | {machine.structure} | {right} of {times} | {others} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("families", nargs="*")
    parser.add_argument("--seeds", type=int)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    rows = []
    for row in table(given.families, given.seeds):
        print(row, flush=True)
        rows.append(row)
    if given.write:
        PAGE.write_text("\n".join([*HEAD, *rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
