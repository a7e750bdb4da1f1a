"""Functional mock-up units: valid, the same numbers as the models, and safe whatever is called."""

from __future__ import annotations

import ctypes as ct
import io
import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.block import Block
from fluidact_fit.control.machines import hydraulic_cylinder
from fluidact_fit.control.plants.hydraulic import HydraulicPlant
from fluidact_fit.errors import OutputError, UsageError
from fluidact_fit.estimation.stribeck import rise_words
from fluidact_fit.export.fmu import describe_unit, write
from fluidact_fit.export.target import Job
from fluidact_fit.routines import Machine
from fmu_host import ERROR, OK, Array, Host, Unit

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
FAMILIES = sorted(path.stem for path in GOLDEN.glob("*.yaml"))
PLANTS = {
    "ball-screw": "torque", "hydraulic-motor": "command", "hydrostatic": "force", "line": "inlet",
    "valve": "command",
}  # fmt: skip
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def block_of(family: str) -> Any:
    return ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)


def job_of(family: str, **changes: Any) -> Job:
    return replace(Job(family.replace("-", "_"), block_of(family)), **changes)


@lru_cache
def unit_of(family: str) -> bytes:
    (content,) = write(job_of(family)).values()
    return content


def fmpy() -> Any:
    """FMPy, or a skip: it is looked for where it is used, for it is slow to import."""
    return pytest.importorskip("fmpy", reason="FMPy is not installed")


@pytest.fixture
def host(tmp_path: Path) -> Callable[[str], Host]:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    return lambda family: Host(tmp_path / family, unit_of(family))


# ------------------------------------------------------------------------------ numbers


def draw(low: float, high: float, count: int, seed: int = 3) -> Array:
    """Values within a range that stay for a while, with both ends."""
    rng = np.random.default_rng(seed)
    values = np.repeat(rng.uniform(low, high, count), rng.integers(1, 5, count))[:count]
    values[:2] = low, high
    return values


def close(found: Array, wanted: Array) -> None:
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.ptp(wanted))


def one_by_one(method: Callable[..., Any], *records: Array) -> Array:
    return np.array([float(method(*row)) for row in np.column_stack(records).tolist()])


def inputs_of(block: Block, names: Any) -> dict[str, Array]:
    """A record for every input, in the ranges that all its routines have."""
    values: dict[str, Array] = {}
    for r in block.routines():
        for a in r.arguments:
            if a.name in names and r.name in names[a.name]:
                v = draw(a.low, a.high, 40, len(values))
                values[a.name] = np.sign(v) + (v == 0.0) if a.name == "direction" else v
    return values


@needs_gcc
@pytest.mark.filterwarnings("ignore")  # those of FMPy itself
@pytest.mark.parametrize("family", FAMILIES)
def test_fmpy_finds_no_problem(family: str, tmp_path: Path) -> None:
    fmpy()
    from fmpy.validation import validate_fmu

    path = tmp_path / "unit.fmu"
    path.write_bytes(unit_of(family))
    assert validate_fmu(str(path)) == []


@needs_gcc
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("family", FAMILIES)
def test_fmpy_simulates_what_the_model_gives(family: str, tmp_path: Path) -> None:
    """Steps of one sample; outputs are those at the end of a step."""
    path = tmp_path / "unit.fmu"
    path.write_bytes(unit_of(family))
    block = block_of(family)
    period = block.sample_time if family in PLANTS else 0.01
    if family in PLANTS:
        (low, high, _), name = block.validity[PLANTS[family]], PLANTS[family]
        records = {name: draw(low, high, 200)}
        wanted = {block.output.role: np.array([block.step(u) for u in records[name].tolist()])}
    else:
        names: dict[str, set[str]] = {}
        for r in block.routines():
            if r.name in block.methods():
                for a in r.arguments:
                    names.setdefault(a.name, set()).add(r.name)
        records = inputs_of(block, names)
        wanted = {
            f"{r.name}_value": one_by_one(
                block.methods()[r.name], *(records[a.name] for a in r.arguments)
            )
            for r in block.routines() if r.name in block.methods()
        }  # fmt: skip
    count = len(next(iter(records.values())))
    given = np.zeros(count, dtype=[(n, float) for n in ("time", *records)])
    given["time"] = np.arange(count) * period
    for name, values in records.items():
        given[name] = values
    found = fmpy().simulate_fmu(
        str(path), input=given, output_interval=period, stop_time=(count - 1) * period,
        output=list(wanted),
    )  # fmt: skip
    for name, values in wanted.items():
        if family in PLANTS:
            close(found[name], values)
        else:
            close(found[name][1:], values[:-1])


@pytest.mark.parametrize("family", ["hydrostatic", "line", "valve", "ball-screw"])
def test_a_plant_is_followed_exactly_over_steps_of_any_length(
    family: str, host: Callable[[str], Host]
) -> None:
    """The solver of simulate is another one; steps from a thousandth of a sample to many.

    That of the drive takes a long step for lost rows, so that its steps are less uneven.
    """
    block, name = block_of(family), PLANTS[family]
    low, high, _ = block.validity[name]
    rng = np.random.default_rng(8)
    spans = 0.01 * 10.0 ** rng.uniform(-3.0, 1.5, 300)
    if family == "ball-screw":
        spans = rng.uniform(0.008, 0.011, 300)
    u = draw(low, high, 300)
    time = np.concatenate(([0.0], np.cumsum(spans)))
    found = host(family).running().follow(name, u, spans, block.output.role)
    given = {} if family == "ball-screw" else {"before": 0.0}
    wanted = block.simulate(np.append(u, u[-1]), time, hold="zoh", **given)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.ptp(wanted))


@pytest.mark.parametrize("dead_time", [0.0, 0.004, 0.01, 0.0333, 0.5])
def test_a_dead_time_of_any_length(dead_time: float, tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    block = block_of("line")
    block.parameters._values["dead_time"] = dead_time
    host = Host(tmp_path, write(Job("line", block))["line.fmu"])
    low, high, _ = block.validity["inlet"]
    u = draw(low, high, 300)
    found = host.running().follow("inlet", u, np.full(300, 0.003), "outlet")
    wanted = block.simulate(np.append(u, u[-1]), np.arange(301) * 0.003, hold="zoh", before=0.0)
    close(found, wanted)


def test_a_plant_starts_at_rest_where_it_is_told(host: Callable[[str], Host]) -> None:
    valve, line = block_of("valve"), host("hydrostatic")
    unit = host("valve").running(initial_command=3.0)
    u = draw(2.0, 6.0, 60)
    valve.reset(input=3.0)
    found = unit.follow("command", u, np.full(60, 0.01), "outlet")
    close(found[:-1], np.array([valve.step(x) for x in u.tolist()]))
    unit = line.running(initial_position=0.012)
    assert unit.step(1.0) == OK
    assert unit.get("position") == 0.012


def test_a_drive_does_in_one_step_what_it_does_in_many(host: Callable[[str], Host]) -> None:
    screw = host("ball-screw")
    whole, parts = screw.running(), screw.running()
    low, high, _ = block_of("ball-screw").validity["torque"]
    for u in draw(low, high, 60).tolist():
        assert whole.set("torque", u) == parts.set("torque", u) == OK
        assert whole.step(0.05) == OK
        assert all(parts.step(0.0005) == OK for _ in range(100))
        assert whole.get("angle") == pytest.approx(parts.get("angle"), rel=1e-11, abs=1e-12)
    assert abs(whole.get("angle")) > 1.0


def test_a_drive_honours_its_parameters(host: Callable[[str], Host]) -> None:
    """Against the closed solutions of v' = (u - C - b v) / J, and of the stop by friction."""
    names = ("viscous", "coulomb", "breakaway")
    none = {f"plant__{n}_{w}": 0.0 for n in names for w in ("negative", "positive")}
    screw = host("ball-screw")
    free = screw.running(**none, plant__inertia=2e-3, initial_angle=1.0)
    assert free.set("torque", 4e-3) == OK
    assert free.step(0.7) == OK
    assert free.get("angle") == pytest.approx(1.0 + 0.5 * 2.0 * 0.7**2, rel=1e-12)
    damped = screw.running(**none | {"plant__viscous_negative": 1e-3}, plant__inertia=2e-3)
    assert damped.set("torque", -4e-3) == OK
    assert damped.step(3.0) == OK
    assert damped.get("angle_rate") == pytest.approx(-4.0 * -np.expm1(-1.5), rel=1e-12)
    braked = none | {"plant__coulomb_positive": 6e-3, "plant__breakaway_positive": 6e-3}
    braked["plant__breakaway_negative"] = 6e-3
    stopping = screw.running(**braked, plant__inertia=2e-3, initial_angle_rate=3.0)
    assert stopping.step(5.0) == OK
    assert stopping.get("angle") == pytest.approx(3.0**2 / (2.0 * 3.0), rel=1e-12)
    assert stopping.get("angle_rate") == 0.0


def cylinder_of(span: float) -> HydraulicPlant:
    block = block_of("hydraulic-cylinder")
    return HydraulicPlant(*hydraulic_cylinder(block), block.input, span)


@pytest.mark.parametrize("span", [2.5e-3, 0.0173])
def test_a_cylinder_moves_as_in_the_closed_loop(span: float, host: Callable[[str], Host]) -> None:
    """Between closed and wide open, with stops and break-aways in it, and pressures that ring."""
    low, high, _ = block_of("hydraulic-cylinder").validity["command"]
    openings = draw(low, high, 16) * np.resize([0.6, 0.0, 0.02, 0.0], 16)
    u = np.repeat(openings, round(0.1 / span))
    unit, plant = host("hydraulic-cylinder").running(initial_position=0.05), cylinder_of(span)
    plant.reset(0.05)
    names = {"position": "position", "speed": "position_rate", "pressure_1": "plant.pressure_1",
             "pressure_2": "plant.pressure_2"}  # fmt: skip
    found, wanted = [], []
    for value in u.tolist():
        plant.advance((value,))
        assert unit.set("command", value) == OK
        assert unit.step(span) == OK
        wanted.append([plant.measure()[name] for name in names])
        found.append([unit.get(name) for name in names.values()])
    table = np.array(wanted)
    assert (table[:, 1] == 0.0).any()
    assert np.abs(table[:, 1]).max() > 0.05
    size = np.abs(table).max(axis=0)
    np.testing.assert_allclose(found / size, table / size, rtol=0.0, atol=1e-9)


def test_the_friction_of_a_cylinder_falls_as_in_the_closed_loop(tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    document = yaml.safe_load((GOLDEN / "hydraulic-cylinder.yaml").read_text(encoding="utf-8"))
    given = {"stribeck": ("N", 60.0), "stribeck_speed": ("m/s", 0.01)}
    for name, (unit, value) in given.items():
        entry = {"value": value, "unit": unit, "status": "fixed"}
        document["parameters"][name] = entry
        document["model"]["hydraulic"][name] = value
    document["model"]["hydraulic"]["friction"] += rise_words(given, "sgn(y')", "y'")
    document["options"]["stribeck"] = "estimate"
    path = tmp_path / "cylinder.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    block = ff.load(path)
    unit = Host(tmp_path, write(Job("cylinder", block))["cylinder.fmu"]).running(
        initial_position=0.05
    )
    plant = HydraulicPlant(*hydraulic_cylinder(block), block.input, 2.5e-3)
    plant.reset(0.05)
    for value in np.repeat([1.0, 0.2, 0.0, -0.3, 0.0], 40).tolist():
        plant.advance((value,))
        assert unit.set("command", value) == unit.step(2.5e-3) == OK
        measured = plant.measure()
        assert unit.get("position") == pytest.approx(measured["position"], rel=1e-9)
        assert unit.get("position_rate") == pytest.approx(measured["speed"], abs=1e-9)


def test_a_cylinder_does_in_long_steps_what_it_does_in_short_ones(
    host: Callable[[str], Host],
) -> None:
    """To the order of the scheme; a short step is a tenth of what it takes by itself."""
    unit = host("hydraulic-cylinder")
    whole, parts = unit.running(), unit.running()
    for u in (2.0, 0.0, -1.5, 0.05):
        assert whole.set("command", u) == parts.set("command", u) == OK
        assert whole.step(0.02) == OK
        assert all(parts.step(4e-5) == OK for _ in range(500))
        assert whole.get("position") == pytest.approx(parts.get("position"), rel=1e-4)
    assert whole.get("position") > 5e-4


def test_a_piston_without_oil_is_an_error_that_changes_nothing(
    host: Callable[[str], Host],
) -> None:
    h = host("hydraulic-cylinder")
    unit = h.running()
    assert unit.set("command", 6.0) == OK
    while unit.step(0.1) == OK:
        assert unit.time < 20.0
    place = unit.get("position")
    assert any("holds oil" in text for text in h.said)
    assert unit.step(0.1) == ERROR
    assert unit.get("position") == place > 0.1
    assert unit.step(1e9) == ERROR


def test_a_cylinder_of_a_file_without_volumes_has_its_maps_alone(tmp_path: Path) -> None:
    document = yaml.safe_load((GOLDEN / "hydraulic-cylinder.yaml").read_text(encoding="utf-8"))
    for name in ("dead-volume-1", "dead-volume-2"):
        del document["options"][name]
    document["options"]["stage"] = "flow-balance"
    path = tmp_path / "cylinder.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    xml, sources = describe_unit(Job("cylinder", ff.load(path, accept_not_identified=True)))
    assert b"flow_1_value" in xml
    assert b"plant." not in xml
    assert "hydraulic.h" not in sources


def test_every_routine_gives_what_it_gives_in_python(host: Callable[[str], Host]) -> None:
    for family in FAMILIES:
        h, block = host(family), block_of(family)
        for routine in (r for r in block.routines() if not r.sample_time):
            unit, machine = h.running(), Machine(routine)
            rng = np.random.default_rng(1)
            for _ in range(20):
                values = {a.name: float(rng.uniform(a.low - 0.1 * (a.high - a.low), a.high))
                          for a in routine.arguments}  # fmt: skip
                for name, value in values.items():
                    own = f"{routine.name}_{name}"
                    assert unit.set(own if own in h.reference else name, value) == OK
                assert unit.step(0.01) == OK
                wanted, outside = machine(**values)
                found = unit.get(f"{routine.name}_value")
                assert found == pytest.approx(float(wanted), rel=1e-9, abs=1e-300)
                assert unit.get(f"{routine.name}_outside") == bool(outside)


@pytest.mark.filterwarnings("ignore::fluidact_fit.ExtrapolationWarning")
def test_what_is_beyond_a_range_is_clamped_and_told(host: Callable[[str], Host]) -> None:
    unit, block = host("potentiometer").running(), block_of("potentiometer")
    for reading in (-50.0, 5000.0, np.inf, -np.inf):
        assert unit.set("reading", reading) == OK
        assert unit.get("position_value") == pytest.approx(float(block(reading)), rel=1e-12)
        assert unit.get("position_outside") == 1.0
    assert unit.set("reading", np.nan) == OK
    assert unit.get("position_outside") == 1.0
    assert np.isfinite(unit.get("position_value"))
    assert unit.set("reading", 500.0) == OK
    assert unit.get("position_outside") == 0.0
    plant = host("hydrostatic")
    high = block_of("hydrostatic").validity["force"].high
    far, end = plant.running(), plant.running()
    assert (far.set("force", 1e9), end.set("force", high)) == (OK, OK)
    assert (far.step(0.2), end.step(0.2)) == (OK, OK)
    assert far.get("position") == end.get("position") != 0.0
    assert (far.get("outside"), end.get("outside")) == (1.0, 0.0)


def test_asking_changes_nothing_and_a_step_does(host: Callable[[str], Host]) -> None:
    """The play of the motor's valve keeps the direction of the last step only."""
    block, unit = block_of("hydraulic-motor"), host("hydraulic-motor").running()
    long = 60.0 * block.parameters["time_constant"]
    for u in (5.0, 3.0):
        assert unit.set("command", u) == OK
        assert unit.step(long) == OK
    down = unit.get("speed")
    assert down == pytest.approx(float(block(3.0, -1)) + block.offset, rel=1e-9)
    assert unit.set("command", 0.5) == OK
    unit.get("speed")
    assert unit.set("command", 3.0) == OK
    assert unit.get("speed") == down
    for u in (0.5, 3.0):
        assert unit.set("command", u) == OK
        assert unit.step(long) == OK
    up = unit.get("speed")
    assert up == pytest.approx(float(block(3.0, 1)) + block.offset, rel=1e-9)
    assert up != pytest.approx(down, rel=1e-3)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_parameter_reaches_code_that_runs(family: str) -> None:
    """An identified lag or offset that no export has would be lost on the machine."""

    def code(name: str | None = None) -> str:
        block = block_of(family)
        if name is not None:
            value = block.parameters._values[name]
            block.parameters._values[name] = np.multiply(value, 1.01).tolist()
        job = Job("unit", block)
        model = describe_unit(job)[1]["unit.c"].partition("model_least")[2]
        return model + "".join(map(repr, block.routines()))

    present = code()
    values = block_of(family).parameters
    assert [n for n in values if np.any(values[n]) and code(n) == present] == []


# ---------------------------------------------------------------------- life of an instance


def test_reset_and_two_instances_at_once(host: Callable[[str], Host]) -> None:
    line = host("line")
    low, high, _ = block_of("line").validity["inlet"]
    u, spans = draw(low, high, 50), np.full(50, 0.004)
    one, other = line.running(), line.running(initial_inlet=3e5)
    alone = one.follow("inlet", u, spans, "outlet")
    one.call("Reset")
    one.time = 0.0
    one.start()
    both = []
    for x in u.tolist():
        for unit, value in ((one, x), (other, high)):
            assert unit.set("inlet", value) == OK
            assert unit.step(0.004) == OK
        both.append(one.get("outlet"))
    assert both == alone[1:].tolist()
    assert other.get("outlet") != one.get("outlet")
    for unit in (one, other):
        assert unit.call("Terminate") == OK
        line.library.fmi2FreeInstance(unit.component)


def test_a_state_is_returned_to_also_from_bytes(host: Callable[[str], Host]) -> None:
    h = host("line")
    unit, state, again = h.running(), ct.c_void_p(), ct.c_void_p()
    u = draw(2e5, 5e5, 20)
    spans = np.full(20, 0.004)
    unit.follow("inlet", u, spans, "outlet")
    begin = unit.time
    assert unit.call("GetFMUstate", ct.byref(state)) == OK
    first = unit.follow("inlet", u, spans, "outlet")
    assert unit.call("SetFMUstate", state) == OK
    unit.time = begin
    assert unit.follow("inlet", u, spans, "outlet").tolist() == first.tolist()
    size = ct.c_size_t()
    assert unit.call("SerializedFMUstateSize", state, ct.byref(size)) == OK
    content = ct.create_string_buffer(size.value)
    assert unit.call("SerializeFMUstate", state, content, size) == OK
    other = h.running()
    assert other.call("DeSerializeFMUstate", content, ct.c_size_t(3), ct.byref(again)) == ERROR
    assert other.call("DeSerializeFMUstate", content, size, ct.byref(again)) == OK
    assert other.call("SetFMUstate", again) == OK
    other.time = begin
    assert other.follow("inlet", u, spans, "outlet").tolist() == first.tolist()
    assert unit.call("FreeFMUstate", ct.byref(state)) == OK
    assert state.value is None


def test_calls_that_make_no_sense_are_refused(host: Callable[[str], Host]) -> None:
    h = host("ball-screw")
    unit = Unit(h)
    assert unit.step(0.1) == ERROR
    assert unit.set("plant.inertia", 0.0) == ERROR
    assert unit.set("plant.inertia", float("nan")) == ERROR
    unit.start()
    for name in ("plant.inertia", "parameters.inertia", "angle", "initial_angle"):
        assert unit.set(name, 1.0) == ERROR, name
    for span in (-0.1, float("nan"), float("inf")):
        assert unit.step(span) == ERROR
    none, one, value = ct.c_uint(999), ct.c_size_t(1), ct.c_double()
    assert unit.call("GetReal", ct.byref(none), one, ct.byref(value)) == ERROR
    assert unit.call("GetBoolean", ct.byref(none), one, ct.byref(ct.c_int())) == ERROR
    assert unit.call("GetInteger", ct.byref(none), one, ct.byref(ct.c_int())) == ERROR
    assert unit.get("angle") == 0.0
    assert h.instance(kind=0) is None
    h.guid = "{0}"
    assert h.instance() is None
    assert h.said[-1] == "the GUID is not that of this library"
    assert len(h.said) > 10


def test_more_changes_than_fit_into_the_dead_time_are_refused(
    host: Callable[[str], Host],
) -> None:
    h = host("line")
    unit = h.running()
    for k in range(20_000):
        unit.set("inlet", 2e5 + 10.0 * k)
        if unit.step(1e-9) != OK:
            break
    assert 16_000 < k < 17_000
    assert "longer steps" in h.said[-1]
    assert unit.step(1.0) == ERROR  # the same change is still to be taken
    unit.set("inlet", 2e5 + 10.0 * (k - 1))
    assert unit.step(10.0) == OK
    assert np.isfinite(unit.get("outlet"))


# ------------------------------------------------------------------------ compiled sources


def sources_of(job: Job, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in describe_unit(job)[1].items():
        (folder / name).write_text(text, encoding="ascii")
    return folder / f"{job.name}.c"


def gcc(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["gcc", *map(str, arguments)], capture_output=True, text=True, check=False
    )


@needs_gcc
@pytest.mark.parametrize("family", FAMILIES)
def test_the_sources_compile_without_a_warning_under_names_of_their_own(
    family: str, tmp_path: Path
) -> None:
    job = job_of(family)
    prefix = f"-DFMI2_FUNCTION_PREFIX={job.name}_"
    made = gcc(*STRICT, prefix, "-c", sources_of(job, tmp_path), "-o", tmp_path / "unit.o")
    assert made.returncode == 0, made.stderr
    names = subprocess.run(
        ["nm", "-g", "--defined-only", tmp_path / "unit.o"], capture_output=True, text=True,
        check=True,
    ).stdout.split()[2::3]  # fmt: skip
    assert f"{job.name}_fmi2DoStep" in names
    assert all(name.startswith(f"{job.name}_") for name in names)


@needs_gcc
@pytest.mark.filterwarnings("ignore")  # those of FMPy itself
@pytest.mark.parametrize("family", ["hydraulic-motor", "line"])
def test_a_library_that_fmpy_compiles_from_the_sources_runs(family: str, tmp_path: Path) -> None:
    """The way of every platform that the unit holds no library for."""
    fmpy()
    if shutil.which("cmake") is None or shutil.which("make") is None:
        pytest.skip("cmake or make is not installed")
    from fmpy.build import build_platform_binary

    with zipfile.ZipFile(io.BytesIO(unit_of(family))) as archive:
        archive.extractall(tmp_path)
    (library,) = (tmp_path / "binaries" / "linux64").iterdir()
    library.unlink()
    build_platform_binary(tmp_path)
    plain = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True,
                           check=True).stdout.split()[2::3]  # fmt: skip
    assert "fmi2DoStep" in plain
    found = fmpy().simulate_fmu(str(tmp_path), stop_time=0.1)
    assert len(found) > 1


DRIVER = """
#include "{name}.c"

int main(void)
{{
    const double odd[] = {{0.0, 1.0, -1e300, 1e300, 3.5, -0.02, NAN, INFINITY, -INFINITY, 0.004}};
    const double spans[] = {{0.01, 0.0, 1e-9, 0.37, 1e6, 0.004}};
    const fmi2CallbackFunctions none = {{0}};
    fmi2Component unit[2];
    fmi2FMUstate state = NULL, other = NULL;
    char bytes[sizeof(fmi2_snapshot)];
    double time[2] = {{0.0, 5.0}};
    int k, i, failed = 0;
    unsigned n;

    for (i = 0; i < 2; i++) {{
        unit[i] = fmi2Instantiate("unit", fmi2CoSimulation, MODEL_GUID, "", i ? &none : NULL, 0, 0);
        failed |= !unit[i];
        failed |= fmi2SetupExperiment(unit[i], 0, 0.0, time[i], 0, 0.0) != fmi2OK;
        failed |= fmi2EnterInitializationMode(unit[i]) != fmi2OK;
        failed |= fmi2ExitInitializationMode(unit[i]) != fmi2OK;
    }}
    for (k = 0; k < 600; k++) {{
        for (i = 0; i < 2; i++) {{
            double value;
            int flag;
            for (n = 0; n < MODEL_INPUTS; n++) {{
                failed |= fmi2SetReal(unit[i], &n, 1, &odd[(k * (int)(n + 1) + i) % 10]) != fmi2OK;
            }}
            for (n = 0; n < MODEL_REALS; n++) {{
                failed |= fmi2GetReal(unit[i], &n, 1, &value) != fmi2OK;
                failed |= n >= MODEL_OUTPUTS && !isfinite(value);
            }}
            for (n = 0; n < MODEL_BOOLEANS; n++) {{
                failed |= fmi2GetBoolean(unit[i], &n, 1, &flag) != fmi2OK;
            }}
#ifdef HYDRAULIC_STEPS /* a cylinder runs out of oil */
            if (fmi2DoStep(unit[i], time[i], spans[k % 6], 1) != fmi2OK) continue;
#else
            failed |= fmi2DoStep(unit[i], time[i], spans[k % 6], 1) != fmi2OK;
#endif
            time[i] += spans[k % 6];
        }}
        if (k == 300) failed |= fmi2GetFMUstate(unit[0], &state) != fmi2OK;
    }}
    failed |= fmi2SerializeFMUstate(unit[0], state, bytes, sizeof bytes) != fmi2OK;
    failed |= fmi2DeSerializeFMUstate(unit[1], bytes, sizeof bytes, &other) != fmi2OK;
    failed |= fmi2SetFMUstate(unit[1], other) != fmi2OK;
    failed |= fmi2FreeFMUstate(unit[0], &state) != fmi2OK;
    failed |= fmi2FreeFMUstate(unit[1], &other) != fmi2OK;
    failed |= fmi2Reset(unit[0]) != fmi2OK;
    failed |= fmi2Terminate(unit[1]) != fmi2OK;
    for (i = 0; i < 2; i++) fmi2FreeInstance(unit[i]);
    return failed;
}}
"""


@needs_gcc
@pytest.mark.parametrize("family", FAMILIES)
def test_no_call_reads_or_writes_what_it_should_not(family: str, tmp_path: Path) -> None:
    job = job_of(family)
    sources_of(job, tmp_path)
    driver = tmp_path / "driver.c"
    driver.write_text(DRIVER.format(name=job.name), encoding="ascii")
    made = gcc("-std=c99", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all",
               driver, "-o", tmp_path / "driver", "-lm")  # fmt: skip
    if "cannot find" in made.stderr:
        pytest.skip("the sanitizers of gcc are not installed")
    assert made.returncode == 0, made.stderr
    done = subprocess.run([tmp_path / "driver"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


HOSTILE = (
    "*/ int evil(void); /*", "// evil \\", "??/", '"; system("evil"); "', "]]> <evil a='&'/>",
    "evil\n#include <evil.h>", "\x00\x1b[31m\u202eevil", "%s%n evil", "e" * 100_000,
)  # fmt: skip


@needs_gcc
def test_hostile_texts_of_a_file_are_harmless(tmp_path: Path) -> None:
    job = job_of("spring-cylinder", remarks=HOSTILE)
    known = dict(job.block.validity)
    known["command"] = known["command"]._replace(unit='V"/><evil x="\n*/ evil /*')
    job.block.validity = known
    host = Host(tmp_path / "unit", write(job)["spring_cylinder.fmu"])
    assert host.xml.get("fmiVersion") == "2.0"
    assert not list(host.xml.iter("evil"))
    made = gcc(*STRICT, "-c", sources_of(job, tmp_path / "c"), "-o", tmp_path / "unit.o")
    assert made.returncode == 0, made.stderr
    code = (tmp_path / "c" / "spring_cylinder.c").read_text(encoding="ascii")
    assert "evil" in code
    assert "evil" not in re.sub(r"/\*.*?\*/", "", code, flags=re.DOTALL)
    assert host.running().get("force_value") == Host(
        tmp_path / "plain", unit_of("spring-cylinder")
    ).running().get("force_value")


# ------------------------------------------------------------------------------- archive


@needs_gcc
def test_the_same_file_gives_the_same_unit_and_another_one_another_guid() -> None:
    assert unit_of("valve") == write(job_of("valve"))["valve.fmu"]
    block = block_of("valve")
    block.parameters._values["gain"] *= 1.0 + 1e-15
    guids = [ET.fromstring(describe_unit(job)[0]).get("guid", "")
             for job in (job_of("valve"), Job("valve", block))]  # fmt: skip
    assert len(set(guids)) == 2
    assert all(re.fullmatch(r"\{[0-9a-f]{64}\}", guid) for guid in guids)


@needs_gcc
def test_what_is_in_the_archive() -> None:
    with zipfile.ZipFile(io.BytesIO(unit_of("line"))) as archive:
        assert archive.testzip() is None
        assert sorted(archive.namelist()) == [
            "binaries/linux64/line.so", "modelDescription.xml", "sources/fmi2_steps.h",
            "sources/fmi2_types.h", "sources/fmi2_unit.h", "sources/fmi2_variables.h",
            "sources/line.c", "sources/linear.h",
        ]  # fmt: skip
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_description_tells_units_ranges_and_numbers_of_the_file(
    host: Callable[[str], Host],
) -> None:
    h, block = host("line"), block_of("line")
    inlet = h.variables["inlet"].find("Real")
    assert inlet is not None
    low, high, unit = block.validity["inlet"]
    assert (inlet.get("min"), inlet.get("max"), inlet.get("unit")) == (repr(low), repr(high), unit)
    (pascal,) = (u for u in h.xml.iter("Unit") if u.get("name") == "Pa")
    base = pascal.find("BaseUnit")
    assert base is not None
    assert base.attrib == {"kg": "1", "m": "-1", "s": "-2"}
    running = h.running()
    for name, value in block.numbers().items():
        assert h.variables[f"parameters.{name}"].get("variability") == "constant"
        assert running.get(f"parameters.{name}") == value
    remarks = job_of("line", remarks=("VERDICT FAIL: accepted",))
    assert b"VERDICT FAIL: accepted" in describe_unit(remarks)[0]


def test_without_a_compiler_nothing_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match="no C compiler") as caught:
        write(job_of("line"))
    assert "gcc" in str(caught.value)
    broken = tmp_path / "gcc"
    broken.write_text("#!/bin/sh\necho stdio.h is missing >&2\nexit 1\n", encoding="ascii")
    broken.chmod(0o755)
    with pytest.raises(OutputError, match=r"stdio\.h is missing"):
        write(job_of("line"))


def test_on_another_machine_nothing_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "arm64")
    with pytest.raises(OutputError, match="arm64"):
        write(job_of("line"))


def test_a_sampled_routine_without_a_continuous_model_is_refused() -> None:
    class Sampled:
        family = "test"

        def routines(self) -> Any:
            return [r for r in block_of("line").routines() if r.sample_time]

    with pytest.raises(UsageError, match="no continuous model"):
        describe_unit(Job("test", Sampled()))  # type: ignore[arg-type]
