"""The exported unit in place of the machine in the closed loop: the same response."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.control.controller_file import read_controller_file
from fluidact_fit.control.loop import run_loop
from fluidact_fit.control.machines import make_controller, make_plant
from fluidact_fit.control.plants.base import Plant
from fluidact_fit.control.references import Reference
from fluidact_fit.export.fmu import write
from fluidact_fit.export.target import Job
from fmu_host import OK, Host

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
HEAD = {"format": "fluidact-controller", "format_version": 1, "sample_time": 0.01}
STIFF = {"proportional": 2e3, "derivative": 30.0, "friction": "static", "velocity_tolerance": 2e-3}
SOFT = {"proportional": 2e3, "derivative": 30.0}

# family: kind, keys of the controller, reference, and where the loop starts
LOOPS: dict[str, tuple[str, dict[str, Any], Reference, float]] = {
    "hydrostatic": ("pd", STIFF, Reference("triangle", 0.001, 4e-3, 0.1, 8e-3), 0.001),
    "hydrostatic, beyond its force": ("pd", SOFT, Reference("step", 0.0, 2e-2, 0.1), 0.0),
    "ball-screw": (
        "pd", {**STIFF, "proportional": 2e-4, "derivative": 1e-5, "velocity_tolerance": 0.5},
        Reference("triangle", 0.5, 20.0, 0.1, 15.0), 0.5,
    ),
    "ball-screw, beyond its torque": (
        "pd", {"bandwidth": 8.0, "damping_ratio": 0.8}, Reference("step", 0.0, 9.0, 0.1), 0.0,
    ),
    "hydraulic-cylinder": (
        "pd", {"proportional": 60.0, "derivative": 0.0}, Reference("step", 0.05, 2e-2, 0.1), 0.05,
    ),
    "hydraulic-cylinder, beyond its command": (
        "pd", {"proportional": 900.0, "derivative": 0.0}, Reference("step", 0.05, 2e-2, 0.1), 0.05,
    ),
    "spring-cylinder": (
        "feedforward-force", {}, Reference("sine", 30.0, 10.0, 0.1, 1.0, 0.5), 30.0,
    ),
    "spring-cylinder, smoothed": (
        "feedforward-force", {"smoothing_steps": 7}, Reference("step", 30.0, 20.0, 0.1), 30.0,
    ),
    "spring-cylinder, beyond its force": (
        "feedforward-force", {}, Reference("step", 30.0, 100.0, 0.1), 30.0,
    ),
}  # fmt: skip


class UnitPlant(Plant):
    """The unit of a file; of a map with a motion state, that of the latest command."""

    def __init__(self, like: Plant, host: Host, start: float) -> None:
        self.commands, self.controlled = like.commands, like.controlled
        self.sample_time, self.limits = like.sample_time, ((-np.inf, np.inf),) * len(like.commands)
        self.static = "force_value" in host.reference
        settings = {} if self.static else {f"initial_{like.controlled.role}": start}
        self.unit, self.like, self.last = host.running(**settings), like, 0.0

    def reset(self, output: float = 0.0, *more: Any) -> None:
        if self.static:
            self.like.reset(output, *more)
            self.unit.set("position", self.like.measure()["position"])
            self.put(float(self.like._state[-1]), 1.0)  # type: ignore[attr-defined]

    def put(self, command: float, way: float) -> None:
        assert self.unit.set("direction", way) == self.unit.set("command", command) == OK
        self.last = command

    def measure(self) -> Mapping[str, float]:
        role = self.controlled.role
        if self.static:
            return {role: self.unit.get("force_value"), "position": self.unit.get("position")}
        return {role: self.unit.get(role)}

    def _advance(self, command: Sequence[float]) -> None:
        (value,) = command
        if self.static and value != self.last:
            self.put(value, 1.0 if value > self.last else -1.0)
        elif not self.static:
            assert self.unit.set(self.commands[0].role, value) == OK
        assert self.unit.step(self.sample_time) == OK


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("name", LOOPS)
def test_the_unit_in_the_loop_is_the_machine_of_the_loop(name: str, tmp_path: Path) -> None:
    kind, keys, reference, start = LOOPS[name]
    family = name.split(",")[0]
    path = tmp_path / "loop.yaml"
    machine = {"machine": {"position": 0.012}} if kind == "feedforward-force" else {}
    text = yaml.safe_dump({**HEAD, "kind": kind, "controller": keys, **machine})
    path.write_text(text, encoding="utf-8")
    file = read_controller_file(path)
    block = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
    plant = make_plant(file, [block])
    controller = make_controller(file, [block], plant, start)
    (unit,) = write(Job("unit", block)).values()
    there = UnitPlant(plant, Host(tmp_path / "unit", unit), start)
    ours = run_loop(plant, controller, reference, 2.0, start)
    theirs = run_loop(there, controller, reference, 2.0, start)
    beyond = "beyond" in name
    low, high = plant.limits[0]
    assert bool((ours.commands > high).any() or (ours.commands < low).any()) == beyond
    assert np.ptp(ours.output) > 0.3 * abs(reference.size)
    np.testing.assert_allclose(
        theirs.output, ours.output, rtol=0.0, atol=1e-6 * float(np.ptp(ours.output))
    )
