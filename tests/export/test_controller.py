"""Exported controllers: compiled, and run against the exact plant beside their Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.block import Block
from fluidact_fit.control.controller_file import read_controller_file
from fluidact_fit.control.controllers import Controller
from fluidact_fit.control.loop import Response, run_loop
from fluidact_fit.control.machines import make_controller, make_plant
from fluidact_fit.control.references import Reference
from fluidact_fit.errors import UsageError
from fluidact_fit.export import export

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion"]
HEAD = "format: fluidact-controller\nformat_version: 1\nsample_time: 0.01\n"
PD = HEAD + (
    "kind: pd\n"
    "controller: {bandwidth: 6.0, damping_ratio: 0.9, friction: static,\n"
    "  velocity_tolerance: 2.0e-3}\n"
    "limits: {low: -200.0, high: 200.0}\n"
)
IMPEDANCE = HEAD + (
    "kind: impedance\n"
    "controller: {stiffness: 800.0, damping_ratio: 1.0, sum_of_pressures: 6.0e+5, friction: all,\n"
    "  velocity_tolerance: 1.0e-3, lowest_pressure: 1.0e+5, highest_pressure: 6.0e+5}\n"
    "machine: {mass: 0.5, area_1: 3.1e-4, area_2: 2.6e-4, atmosphere: 0.0, travel_from: 0.0,\n"
    "  travel_to: 0.02}\n"
)
LOOPS = {
    "pd": (PD, ["hydrostatic"]),
    "impedance": (IMPEDANCE, ["cylinder-friction", "valve", "line"]),
}
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


class Compiled(Controller):
    """A controller that calls the exported code, float by float."""

    def __init__(self, library: ctypes.CDLL, name: str, like: Controller, role: str) -> None:
        super().__init__(like.sample_time)
        self.role, self.kind = role, name
        first = "step" if name == "pd" else "force"
        self._state = ctypes.create_string_buffer(256)  # more than the structure
        self._reset = getattr(library, f"loop_{first}_reset")
        self._first = getattr(library, f"loop_{first}")
        self._first.restype = ctypes.c_float
        self._then = [getattr(library, f"loop_command_{k}") for k in (1, 2) if name != "pd"]
        for function in self._then:
            function.restype = ctypes.c_float

    def reset(self) -> None:
        self._reset(self._state)

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        outside = ctypes.c_int()
        x, r = ctypes.c_float(measured[self.role]), ctypes.c_float(reference)
        found = float(self._first(self._state, r, x, ctypes.byref(outside)))
        assert outside.value == 0
        if not self._then:
            return (found,)
        return tuple(float(f(ctypes.c_float(found), None)) for f in self._then)


def blocks_of(names: list[str]) -> list[Block]:
    return [ff.load(GOLDEN / f"{n}.yaml", accept_not_identified=True) for n in names]


def exported(tmp_path: Path, kind: str) -> Path:
    text, names = LOOPS[kind]
    (tmp_path / "loop.yaml").write_text(text, encoding="utf-8")
    files = [GOLDEN / f"{n}.yaml" for n in names]
    export(files, "c", tmp_path, accept_not_identified=True, controller=tmp_path / "loop.yaml")
    return tmp_path / "loop.c"


def loop_of(
    tmp_path: Path, kind: str, controller: Callable[[Any, Controller], Controller]
) -> Response:
    file, blocks = read_controller_file(tmp_path / "loop.yaml"), blocks_of(LOOPS[kind][1])
    plant = make_plant(file, blocks)
    used = controller(plant, make_controller(file, blocks, plant))
    course = Reference("triangle", 0.0, 4e-3, 0.1, 8e-3, 0.1)
    return run_loop(plant, used, course, 3.0, 0.0)


@needs_gcc
@pytest.mark.parametrize("kind", LOOPS)
def test_compiled_controller_moves_the_machine_as_its_python_does(
    kind: str, tmp_path: Path
) -> None:
    source = exported(tmp_path, kind)
    shared = tmp_path / "loop.so"
    command = ["gcc", "-O1", "-shared", "-fPIC", *STRICT, str(source), "-lm", "-o", str(shared)]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(shared))
    found = loop_of(tmp_path, kind, lambda p, c: Compiled(library, kind, c, p.controlled.role))
    wanted = loop_of(tmp_path, kind, lambda p, c: c)
    assert np.ptp(wanted.output) > 2e-3
    np.testing.assert_allclose(found.output, wanted.output, atol=2e-5 * np.ptp(wanted.output))
    # compensation jumps: a sample on whose rounding it depends may be pushed the other way
    off = np.abs(found.commands - wanted.commands) > 1e-3 * np.ptp(wanted.commands, axis=0)
    assert off.any(axis=1).mean() < 0.02


@needs_gcc
@pytest.mark.parametrize("kind", LOOPS)
def test_self_test_of_a_controller_passes(kind: str, tmp_path: Path) -> None:
    source, test = exported(tmp_path, kind), tmp_path / "loop_selftest.c"
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    files = [str(source), str(test), "-lm", "-o", str(tmp_path / "run")]
    command = ["gcc", "-O1", *STRICT, *sanitizers, *files]
    subprocess.run(command, check=True)
    assert subprocess.run([tmp_path / "run"], check=False).returncode == 0


def test_only_c_knows_controllers(tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").write_text(PD, encoding="utf-8")
    with pytest.raises(UsageError, match="does not know controllers"):
        export([GOLDEN / "hydrostatic.yaml"], "st", tmp_path, controller=tmp_path / "loop.yaml")
    assert [p.name for p in tmp_path.iterdir()] == ["loop.yaml"]


def test_force_controller_is_refused_with_what_to_do(tmp_path: Path) -> None:
    text = HEAD + "kind: feedforward-force\n"
    (tmp_path / "loop.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match="cannot be exported"):
        export([GOLDEN / "spring-cylinder.yaml"], "c", tmp_path, controller=tmp_path / "loop.yaml")
