"""Exported controllers: compiled, and run against the exact plant beside their Python."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from st_interpreter import Instance
from st_parser import Parser

import fluidact_fit as ff
from fluidact_fit.block import Block
from fluidact_fit.control.controller_file import read_controller_file
from fluidact_fit.control.controllers import Controller
from fluidact_fit.control.loop import LoopResponse, run_loop
from fluidact_fit.control.machines import make_controller, make_plant
from fluidact_fit.control.references import Reference
from fluidact_fit.errors import ControllerFileError, UsageError
from fluidact_fit.export import export
from fluidact_fit.export.c.files import Function
from fluidact_fit.export.controller import controller_code
from fluidact_fit.export.rounding import CALLS, UNIT
from fluidact_fit.routines import Machine

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
FORCE = HEAD + (
    "kind: feedforward-force\n"
    "controller: {smoothing_steps: 12, smoothing: %s}\n"
    "machine: {position: 0.012}\n"
    "limits: {low: 0.0, high: 3.0}\n"
)
LOOPS = {
    "pd": (PD, ["hydrostatic"]),
    "impedance": (IMPEDANCE, ["cylinder-friction", "valve", "line"]),
    "force": (FORCE % "held", ["spring-cylinder", "valve"]),
    "recursive": (FORCE % "recursive", ["spring-cylinder", "valve"]),
}
COURSES = {
    "pd": (Reference("triangle", 0.0, 4e-3, 0.1, 8e-3, 0.1), 0.0),
    "impedance": (Reference("triangle", 0.0, 4e-3, 0.1, 8e-3, 0.1), 0.0),
    "force": (Reference("triangle", 15.0, 30.0, 0.1, 40.0, 0.1), 15.0),
    "recursive": (Reference("step", 15.0, 20.0, 0.1), 15.0),
}
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
Call = Callable[..., float]


class Exported(Controller):
    """A controller that calls what was exported of it, in the order that the page says."""

    def __init__(self, kind: str, call: Call, like: Controller, role: str) -> None:
        super().__init__(like.sample_time, like.travel)
        self.begins = like.begins
        self.kind, self.call, self.role, self.first = kind, call, role, True

    def reset(self) -> None:
        super().reset()
        self.first = True

    def step(self, measured: Mapping[str, float], reference: float) -> tuple[float, ...]:
        kept, self.first = {"reset": self.first}, False
        if self.kind == "pd":
            return (self.call("step", reference, measured[self.role], **kept),)
        if self.kind == "impedance":
            force = self.call("force", reference, measured[self.role], **kept)
            return tuple(self.call(f"command_{k}", force) for k in (1, 2))
        state = self.call("direction", reference, **kept)
        target = self.call("command_for", reference, measured["position"], state, 0.0)
        return (self.call("step", reference, target, **kept),)


def compiled(library: ctypes.CDLL, flags: list[bool] | None = None) -> Call:
    """Functions of a library, float by float; ``flags`` takes those that are set."""
    states: dict[str, Any] = {}

    def call(name: str, *values: float, reset: bool | None = None) -> float:
        function, outside = getattr(library, f"loop_{name}"), ctypes.c_int()
        function.restype = ctypes.c_float
        if reset:
            states[name] = ctypes.create_string_buffer(256)  # more than the structure
            getattr(library, f"loop_{name}_reset")(states[name])
        first = [] if reset is None else [states[name]]
        found = float(function(*first, *map(ctypes.c_float, values), ctypes.byref(outside)))
        assert flags is not None or outside.value == 0
        if flags is not None:
            flags.append(bool(outside.value))
        return found

    return call


def interpreted(text: str, flags: list[bool] | None = None) -> Call:
    """Function blocks of a text, called with their inputs in order; ``flags`` as above."""
    parser = Parser(text)
    blocks = {name: Instance(parser, name) for name in parser.blocks if "SELFTEST" not in name}

    def call(name: str, *values: float, reset: bool | None = None) -> float:
        instance = blocks[f"FB_LOOP_{name.upper()}"]
        inputs = [k for k, d in instance.block.variables.items() if d.section == "VAR_INPUT"]
        kept = {} if reset is None else {"reset": reset}
        out = instance(**dict(zip(inputs, values)), **kept)
        assert flags is not None or not out["outside"]
        if flags is not None:
            flags.append(bool(out["outside"]))
        return float(out["value"])

    return call


def blocks_of(names: list[str]) -> list[Block]:
    return [ff.load(GOLDEN / f"{n}.yaml", accept_not_identified=True) for n in names]


def exported(tmp_path: Path, kind: str, to: str = "c") -> list[Path]:
    text, names = LOOPS[kind]
    (tmp_path / "loop.yaml").write_text(text, encoding="utf-8")
    files = [GOLDEN / f"{n}.yaml" for n in names]
    controller = tmp_path / "loop.yaml"
    return export(files, to, tmp_path, accept_not_identified=True, controller=controller)


def loop_of(tmp_path: Path, kind: str, call: Call | None = None) -> LoopResponse:
    """The loop with what was exported, or with the Python controller."""
    file, blocks = read_controller_file(tmp_path / "loop.yaml"), blocks_of(LOOPS[kind][1])
    plant = make_plant(file, blocks)
    controller = make_controller(file, blocks, plant)
    if call is not None:
        controller = Exported(kind, call, controller, plant.controlled.role)
    course, start = COURSES[kind]
    return run_loop(plant, controller, course, 3.0, start)


@needs_gcc
@pytest.mark.parametrize("kind", LOOPS)
def test_compiled_controller_moves_the_machine_as_its_python_does(
    kind: str, tmp_path: Path
) -> None:
    source, shared = exported(tmp_path, kind)[1], tmp_path / "loop.so"
    command = ["gcc", "-O1", "-shared", "-fPIC", *STRICT, str(source), "-lm", "-o", str(shared)]
    subprocess.run(command, check=True)
    found = loop_of(tmp_path, kind, compiled(ctypes.CDLL(str(shared))))
    wanted = loop_of(tmp_path, kind)
    assert np.ptp(wanted.output) > 2e-3
    np.testing.assert_allclose(found.output, wanted.output, atol=2e-5 * np.ptp(wanted.output))
    # compensation jumps: a sample on whose rounding it depends may be pushed the other way
    off = np.abs(found.commands - wanted.commands) > 1e-3 * np.ptp(wanted.commands, axis=0)
    assert off.any(axis=1).mean() < 0.02


@pytest.mark.parametrize("kind", LOOPS)
def test_structured_text_moves_the_machine_as_its_python_does(kind: str, tmp_path: Path) -> None:
    text = exported(tmp_path, kind, "st")[0].read_text(encoding="ascii")
    assert Instance(Parser(text), "FB_loop_selftest")() == {"passed": True, "failures": 0}
    found, wanted = loop_of(tmp_path, kind, interpreted(text)), loop_of(tmp_path, kind)
    assert np.ptp(wanted.output) > 2e-3
    np.testing.assert_allclose(found.output, wanted.output, atol=1e-9 * np.ptp(wanted.output))


@pytest.mark.parametrize("kind", LOOPS)
def test_constants_are_the_numbers_of_the_controller(kind: str, tmp_path: Path) -> None:
    """The same in Structured Text and for a ROS 2 node, and those that Python controls with."""
    constants = Parser(exported(tmp_path, kind, "st")[0].read_text(encoding="ascii")).constants
    values, declaration, _ = (
        yaml.safe_load(path.read_text(encoding="ascii"))
        for path in exported(tmp_path, kind, "ros2")
    )
    parameters = values["loop"]["ros__parameters"]
    kept = {n.lower(): d.initial[0] for n, d in constants.items() if d.initial}
    assert kept == {n: v for n, v in parameters.items() if not isinstance(v, str)}
    assert [*declaration["loop"]] == [*parameters]
    file, blocks = read_controller_file(tmp_path / "loop.yaml"), blocks_of(LOOPS[kind][1])
    controller: Any = make_controller(file, blocks, make_plant(file, blocks))
    assert parameters["sample_time"] == controller.sample_time
    if kind == "pd":
        for name in ("proportional", "derivative"):
            assert parameters[name] == getattr(controller.gains, name) > 0.0
        assert parameters["command_high"] == 200.0
        assert declaration["loop"]["derivative"]["description"].endswith("[N s/m]")
    elif kind == "impedance":
        assert parameters["damping"] == controller.impedance.damping
        assert parameters["area_2"] == 2.6e-4
        assert "force_low" not in parameters
    else:
        assert parameters["smoothing_steps"] == 12
        assert parameters["smoothing"] == controller.smoothing.reading


BARE = {
    "pd": ("bandwidth: 6.0, damping_ratio: 0.9, friction: static,\n  velocity_tolerance: 2.0e-3",
           "proportional: 900.0, derivative: 0.0"),
    "impedance": ("damping_ratio: 1.0, sum_of_pressures: 6.0e+5, friction: all",
                  "damping: 0.0, sum_of_pressures: 6.0e+5, friction: none"),
}  # fmt: skip


@needs_gcc
@pytest.mark.parametrize("kind", [*LOOPS, *(f"bare {kind}" for kind in BARE)])
def test_self_test_of_a_controller_passes(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where gains are zero, and nothing is kept for them."""
    bare, kind = kind.startswith("bare"), kind.removeprefix("bare ")
    if bare:
        text = LOOPS[kind][0].replace(*BARE[kind])
        assert text != LOOPS[kind][0]
        monkeypatch.setitem(LOOPS, kind, (text, LOOPS[kind][1]))
    sources = [str(path) for path in exported(tmp_path, kind)[1:]]
    sanitizers = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = ["gcc", "-O1", *STRICT, *sanitizers, *sources, "-lm", "-o", str(tmp_path / "run")]
    subprocess.run(command, check=True)
    assert subprocess.run([tmp_path / "run"], check=False).returncode == 0


NAN, INF = float("nan"), float("inf")
OUTAGES = {  # sample: what is read, and what is wanted where that is none
    "nan": {100: (NAN, None)},
    "infinite": {100: (INF, None), 150: (-INF, None)},
    "absurd": {100: (1e6, None), 160: (-1e6, None)},
    "long": dict.fromkeys(range(100, 160), (NAN, None)),
    "from the first": dict.fromkeys(range(5), (NAN, None)),
    "wanted": {100: (None, NAN), 140: (None, NAN), 141: (NAN, NAN)},
}


@pytest.fixture(scope="module", params=LOOPS)
def both(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, Path, str]:
    """A kind of loop with its file, its library and its Structured Text."""
    folder = tmp_path_factory.mktemp("both")
    source, shared = exported(folder, request.param)[1], folder / "loop.so"
    subprocess.run(["gcc", "-shared", "-fPIC", str(source), "-lm", "-o", str(shared)], check=True)
    text = exported(folder, request.param, "st")[0].read_text(encoding="ascii")
    return request.param, folder / "loop.yaml", shared, text


@needs_gcc
@pytest.mark.parametrize("outage", OUTAGES)
def test_without_a_reading_the_last_command_stands(
    outage: str, both: tuple[str, Path, Path, str]
) -> None:
    """Flagged, and without a jump afterwards: in Python, in C and in Structured Text alike."""
    kind, path, shared, text = both
    file, blocks = read_controller_file(path), blocks_of(LOOPS[kind][1])
    plant = make_plant(file, blocks)
    course, _ = COURSES[kind]
    controller = make_controller(file, blocks, plant, file.reference.start or 0.0)
    role, flags = plant.controlled.role, {"c": list[bool](), "st": list[bool]()}
    calls = {"c": compiled(ctypes.CDLL(str(shared)), flags["c"]),
             "st": interpreted(text, flags["st"])}  # fmt: skip
    others = {to: Exported(kind, call, controller, role) for to, call in calls.items()}
    time = 0.01 * np.arange(260)
    wanted = course(time)
    at = np.full(260, 0.012) if "force" in kind or kind == "recursive" else wanted - 4e-5 * time
    given, untouched = [], []
    twin = make_controller(file, blocks, plant, file.reference.start or 0.0)
    for k, (r, x) in enumerate(zip(wanted.tolist(), at.tolist())):
        untouched.append(twin.step({role: x, "position": x}, r))
        read, asked = OUTAGES[outage].get(k, (None, None))
        measured = dict.fromkeys((role, "position"), x if read is None else read)
        reference = r if asked is None else asked
        command = controller.step(measured, reference)
        given.append(command)
        size = np.abs(untouched).max()
        for to, other in others.items():
            flags[to].clear()
            found = other.step(measured, reference)
            np.testing.assert_allclose(found, command, atol=(1e-5 if to == "c" else 1e-9) * size)
            assert any(flags[to]) == controller.outside
        held = np.isnan(reference) or (
            np.isnan(measured["position"]) if role != "position"
            else not abs(measured["position"]) < 1.0
        )  # fmt: skip
        assert controller.outside or not held
        if held:
            assert command == (given[-2] if k else controller.begins)
    jumps, usual = np.abs(np.diff(given, axis=0)).max(), np.abs(np.diff(untouched, axis=0)).max()
    lasts = max(len(OUTAGES[outage]) - 5, 0) + 2 if outage == "long" else 2
    assert jumps <= lasts * usual * 1.5


def test_a_target_without_controllers_says_so(tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").write_text(PD, encoding="utf-8")
    with pytest.raises(UsageError, match="does not know controllers"):
        export([GOLDEN / "hydrostatic.yaml"], "json", tmp_path, controller=tmp_path / "loop.yaml")
    assert [p.name for p in tmp_path.iterdir()] == ["loop.yaml"]


@needs_gcc
@pytest.mark.parametrize("steps", [2, 7, 300])
@pytest.mark.parametrize("reading", ["held", "recursive"])
def test_what_smoothing_rounds_fades(steps: int, reading: str, tmp_path: Path) -> None:
    """The bound holds for references that change at every call, and for those that rest."""
    text = (FORCE % reading).replace("steps: 12", f"steps: {steps}")
    (tmp_path / "loop.yaml").write_text(text, encoding="utf-8")
    files = [GOLDEN / "spring-cylinder.yaml", GOLDEN / "valve.yaml"]
    source = export(files, "c", tmp_path, controller=tmp_path / "loop.yaml")[1]
    code = controller_code(tmp_path / "loop.yaml", [ff.load(f) for f in files])
    function = Function.of(code.routines[-1], "loop")
    target = function.routine.arguments[1]
    span = min(target.high, 3.0) - max(target.low, 0.0)
    assert function.bound < (steps + 1) * 8.0 * UNIT * span
    shared = tmp_path / "loop.so"
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", str(source), "-o", str(shared)], check=True)
    call, rng, worst = compiled(ctypes.CDLL(str(shared))), np.random.default_rng(3), 0.0
    for rests in (1, 4, 2 * steps):
        machine = Machine(function.routine)
        wanted = np.repeat(rng.uniform(10.0, 60.0, CALLS), rests)[:CALLS]
        goals = np.repeat(rng.uniform(0.0, 3.0, CALLS), rests)[:CALLS]
        rows = np.float32([wanted, goals]).T.tolist()
        for k, (r, u) in enumerate(rows):
            exact, _ = machine(wanted=r, target=u)
            worst = max(worst, abs(call("step", r, u, reset=k == 0) - float(exact)))
    assert 0.0 < worst < function.bound


@pytest.mark.parametrize("target", ["force", "command"])
def test_force_controller_calls_a_network(target: str, tmp_path: Path) -> None:
    """The map of the command gives the command itself, whatever supplies the cylinder."""
    (tmp_path / "loop.yaml").write_text(FORCE % "held", encoding="utf-8")
    network = ff.load(GOLDEN / "force-map.yaml")
    spring = ff.load(GOLDEN / "spring-cylinder.yaml")
    blocks = [spring, network] if target == "command" else [spring]
    code = controller_code(tmp_path / "loop.yaml", blocks)
    found = Machine(code.routines[1])
    assert [r.name for r in code.routines] == ["direction", "command_for", "step"]
    values: dict[str, float] = {"force": 30.0, "position": 0.012, "direction": 1.0}
    due: Any = network(**values) if target == "command" else spring.inverse(30.0, 0.012, 1.0)
    given = {a.name: values.get(a.name, 0.0) for a in code.routines[1].arguments}
    assert float(found(**given)[0]) == pytest.approx(float(due), rel=1e-9)


@needs_gcc
@pytest.mark.parametrize("kind", ["pd", "impedance", "force"])
def test_the_self_test_finds_a_controller_that_computes_from_no_reading(
    kind: str, tmp_path: Path
) -> None:
    """Also one that forgets to begin anew after it."""
    _, source, test = exported(tmp_path, kind)
    text = source.read_text(encoding="ascii")
    branch = re.compile(r"if \(!\(\([^{]*\) \{\n        /\* nothing")
    again = re.compile(r"        state->(error_rate|speed)_begun = 0\.0f;\n")
    changes = [branch.sub("if (0) {\n        /* nothing", text)]
    changes += [again.sub("", text)] if again.search(text) else []
    for changed in changes:
        assert changed != text
        source.write_text(changed, encoding="ascii")
        command = ["gcc", str(source), str(test), "-lm", "-o", str(tmp_path / "run")]
        subprocess.run(command, check=True)
        assert subprocess.run([tmp_path / "run"], check=False).returncode != 0


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (("lowest_pressure: 1.0e+5", "lowest_pressure: 6.1e+5"), "controller.lowest_pressure"),
        (("lowest_pressure: 1.0e+5", "lowest_pressure: 6.0e+5"), "controller.lowest_pressure"),
        (("area_2: 2.6e-4", "area_2: 3.2e-4"), "machine.area_2"),
    ],
)
def test_a_machine_that_cannot_be_is_refused(
    change: tuple[str, str], place: str, tmp_path: Path
) -> None:
    path = tmp_path / "loop.yaml"
    path.write_text(IMPEDANCE.replace(*change), encoding="utf-8")
    with pytest.raises(ControllerFileError, match=re.escape(place)):
        read_controller_file(path)
