"""``simulate --controller``: from parameter files to a closed loop."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.control import read_document
from fluidact_fit.control.closed_loop import simulate_loop
from fluidact_fit.control.controller_file import read_controller_file
from fluidact_fit.export.controller import controller_code
from fluidact_fit.families import get_family
from fluidact_fit.family import Plant
from fluidact_fit.parameters import make_document, save_document
from fluidact_fit.parameters.draws import with_values
from fluidact_fit.routines import Machine

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__
Here = Callable[..., Any]
VALUES: dict[str, tuple[str | None, dict[str, float]]] = {
    "hydrostatic": (
        "hydrostatic",
        {"mass": 53.7, "damping": 1720.5, "dead_zone_negative": 0.0, "dead_zone_positive": 0.0},
    ),
    "ball-screw": (
        "rotary",
        {
            "inertia": 11.71e-7, "viscous": 0.0,
            "coulomb_positive": 2.0e-3, "coulomb_negative": 1.6e-3,
            "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
        },
    ),
    "valve": (
        "valve",
        {"gain": 1.0, "natural_frequency": 60.0, "damping_ratio": 0.7, "dead_time": 0.0},
    ),
    "cylinder-friction": (
        "velocity", {"viscous": 45.0, "coulomb_positive": 2.4, "coulomb_negative": 2.4}
    ),
}  # fmt: skip
PD = """
format: fluidact-controller
format_version: 1
kind: pd
sample_time: 0.01
controller: {proportional: 4.0, damping_ratio: 0.8, friction: static, velocity_tolerance: 1.0e-3}
machine: {lever: 5.6e-5, transmission: 27646.0}
"""


HEAD_OF_LINE = """
format: fluidact-controller
format_version: 1
kind: pd
sample_time: 0.01
controller: {bandwidth: 4.0, damping_ratio: 0.9}
"""


def save(
    folder: Path, name: str, deviation: float = 0.0, *, values: dict[str, float] | None = None,
    **options: str,
) -> str:  # fmt: skip
    """A parameter file with given values; ``deviation`` is the share they are uncertain by."""
    variant_name, usual = VALUES[name]
    values = usual if values is None else values
    family = get_family(name)
    variant = family.variant(variant_name)
    specs = {s.name: s for s in variant.parameters}
    plant = Plant(variant, values, family.options_type(**options))
    data: dict[str, Any] = {
        "format": "fluidact-parameters", "format_version": 1, "family": name,
        "variant": variant_name,
        "parameters": {
            n: {"value": v, "unit": specs[n].unit, "status": "fixed"} for n, v in values.items()
        },
        "options": plant.options.given(),
        "model": family.model(plant, 0.01, "zoh"),
        "validity": {
            r.name: {"low": -1.0, "high": 8e5 if name == "valve" else 2.0, "unit": r.unit}
            for r in variant.roles if r.name != "time"
        },
        "fit": {
            "samples": 10, "rmse": {"value": 0.1, "unit": variant.output.unit},
            "fit_percent": 90.0, "verdict": "pass",
        },
        "provenance": {
            "tool": {"name": "fluidact-fit", "version": "0.1.0"},
            "created": "2026-11-20T22:00:00Z",
        },
    }  # fmt: skip
    if deviation:
        order = [n for n, v in values.items() if v]
        data["covariance"] = {
            "order": order,
            "matrix": np.diag([(deviation * values[n]) ** 2 for n in order]).tolist(),
        }  # fmt: skip
        for n in order:
            sd, v = deviation * abs(values[n]), values[n]
            data["parameters"][n] |= {
                "status": "estimated", "std_error": sd, "ci95": [v - 2.0 * sd, v + 2.0 * sd]
            }  # fmt: skip
    path = folder / f"{name}.yaml"
    return str(save_document(make_document(data, get_family), path, overwrite=True))


def controller(folder: Path, text: str = PD) -> str:
    path = folder / "controller.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.fixture
def screw(tmp_path: Path) -> list[str]:
    return [save(tmp_path, "ball-screw"), save(tmp_path, "hydrostatic")]


def test_thesis_machine_follows_a_step(here: Here, tmp_path: Path, screw: list[str]) -> None:
    table, picture = tmp_path / "out.csv", tmp_path / "out.svg"
    done = here(
        "simulate", *screw, "--controller", controller(tmp_path), "--reference", "step",
        "--json", "-o", str(table), "--plot", str(picture),
    )  # fmt: skip
    assert done.status == 0, done.err
    found = json.loads(done.out)
    assert found["controlled"] == {"role": "position", "unit": "m"}
    assert found["step"]["target"] == 5e-4
    assert abs(found["step"]["steady_state_error"]) < 1e-4
    assert found["margins"]["gain"] > 2.0
    rows = np.genfromtxt(table, delimiter=",", names=True, deletechars="")
    assert rows.size == found["samples"] == 1001
    assert rows["position_[m]"][-1] == pytest.approx(found["step"]["final"], rel=1e-2)
    assert picture.read_bytes().startswith(b"<?xml")


def test_a_stiffer_proportional_gain_follows_a_triangle_closer(
    here: Here, tmp_path: Path, screw: list[str]
) -> None:
    errors = []
    for gain in ("4.0", "8.0"):
        file = controller(tmp_path, PD.replace("4.0", gain))
        done = here("simulate", *screw, "--controller", file, "--reference", "triangle", "--json")
        errors.append(json.loads(done.out)["tracking"]["largest_error"])
    # moving, only the level of kinetic friction and the viscous force are left: equation 15
    level = (2.0e-3 + 0.056e-3 * 1720.5 * 0.005) / 4.0
    assert errors[0] > level
    assert errors[1] < 0.7 * errors[0]


def test_draws_widen_the_band_with_the_covariance(here: Here, tmp_path: Path) -> None:
    widths = []
    for deviation in (0.01, 0.1):
        files = [save(tmp_path, "ball-screw", deviation), save(tmp_path, "hydrostatic", deviation)]
        args = ["simulate", *files, "--controller", controller(tmp_path), "--reference", "step"]
        args += ["--duration", "0.4", "--draws", "10", "--json"]
        done = here(*args)
        assert done.status == 0, done.err
        found = json.loads(done.out)["draws"]
        assert found["responses"] + found["failed"] == 10
        low, high = found["spread"]["rms_error"]
        least, most = found["spread"]["gain_margin"]
        assert 1.0 < least < most
        widths.append(high - low)
    assert here(*args).out == done.out
    assert widths[0] > 0.0
    assert widths[1] > 3.0 * widths[0]


def test_reference_from_a_file_in_its_unit(here: Here, tmp_path: Path, screw: list[str]) -> None:
    wanted = tmp_path / "wanted.csv"
    wanted.write_text("time [s],reference [mm]\n0,1\n1,1\n2,3\n3,3\n", encoding="utf-8")
    out = tmp_path / "out.csv"
    done = here("simulate", *screw, "--controller", controller(tmp_path), "--reference",
                str(wanted), "-o", str(out))  # fmt: skip
    assert done.status == 0, done.err
    rows = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    assert rows["reference_[m]"][[0, 150, -1]] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert rows["position_[m]"][0] == 1e-3


def test_impedance_pushes_through_tissue(here: Here, tmp_path: Path) -> None:
    files = [save(tmp_path, "cylinder-friction"), save(tmp_path, "valve")]
    file = controller(tmp_path, """
format: fluidact-controller
format_version: 1
kind: impedance
sample_time: 0.001
controller: {stiffness: 1000.0, damping: 20.0, sum_of_pressures: 8.0e+5, cutoff: 80.0}
machine: {mass: 0.14, area_1: 3.0e-4, area_2: 2.5e-4}
tissue: {surface: 0.01, stiffness: 2000.0, puncture_force: 5.0, residual_stiffness: 20.0}
reference: {size: 0.02, speed: 0.01}
""")  # fmt: skip
    out = tmp_path / "out.csv"
    done = here("simulate", *files, "--controller", file, "--reference", "ramp-insertion",
                "--duration", "3", "-o", str(out))  # fmt: skip
    assert done.status == 0, done.err
    rows = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    force, lag = rows["resistance_[N]"], rows["reference_[m]"] - rows["position_[m]"]
    assert 4.8 < force.max() <= 5.0
    # F_d = 1000 N/m times the lag carries tissue, friction and damping just before the puncture
    at = int(force.argmax())
    speed = rows["speed_[m/s]"][at]
    wanted = 5.0 + 2.4 + 45.0 * speed - 20.0 * (0.01 - speed)
    assert 1000.0 * lag[at] == pytest.approx(wanted, rel=0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("kind: pd", "kind: lqg"), "is not one of pd"),
        (("damping_ratio: 0.8, ", ""), "expected one of derivative, damping_ratio"),
        (("proportional: 4.0", "proportional: -4.0"), "above 0"),
        (("proportional: 4.0", "proportinal: 4.0"), "did you mean 'proportional'"),
        (("sample_time: 0.01", "sample_time: true"), "number of seconds"),
        (("format_version: 1", "format_version: 2"), "only one there is"),
        (("friction: static", "friction: [static]"), "controller.friction"),
        (("machine: {", "tissue: {surface: 1.0}\nmachine: {"), "tissue.stiffness: is missing"),
        (("machine: {lever: 5.6e-5, ", "machine: {"), "machine.lever"),
        (("sample_time: 0.01", "sample_time: 0.01\nsample_time: 0.02"), "sample_time"),
    ],
)
def test_a_wrong_controller_file_is_refused(
    change: tuple[str, str], words: str, here: Here, tmp_path: Path, screw: list[str]
) -> None:
    file = controller(tmp_path, PD.replace(*change))
    done = here("simulate", *screw, "--controller", file, "--reference", "step")
    assert done.status in (2, 3)
    assert words in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--reference", "step"], "give --controller"),
        (["--controller", "C"], "needs --reference"),
        (["--controller", "C", "--reference", "square"], "neither a kind of reference nor a file"),
        (["--controller", "C", "--reference", "step", "--window", "0:1"], "about reading a LOG"),
        (["--controller", "C", "--reference", "step", "--duration", "1e9"], "samples"),
    ],
)
def test_a_wrong_command_is_refused(
    options: list[str], words: str, here: Here, tmp_path: Path, screw: list[str]
) -> None:
    file = controller(tmp_path)
    done = here("simulate", *screw, *(file if o == "C" else o for o in options))
    assert done.status == 2
    assert words in done.err


FORCE = """
format: fluidact-controller
format_version: 1
kind: feedforward-force
sample_time: 0.01
controller: {smoothing_steps: 10, smoothing: %s}
machine: {position: 0.012}
reference: {start: 22.0, size: 20.0, at: 0.2}
"""
GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"


@pytest.mark.parametrize("smoothing", ["held", "recursive"])
@pytest.mark.parametrize("names", [["spring-cylinder"], ["spring-cylinder", "valve"]])
def test_a_force_loop_begins_where_its_reference_does(
    names: list[str], smoothing: str, here: Here, tmp_path: Path
) -> None:
    """Nothing moves before the reference does, and the export begins with the same command."""
    files, out = [str(GOLDEN / f"{n}.yaml") for n in names], tmp_path / "out.csv"
    file = controller(tmp_path, FORCE % smoothing)
    done = here("simulate", *files, "--controller", file, "--reference", "step", "--duration", "1",
                "-o", str(out))  # fmt: skip
    assert done.status == 0, done.err
    rows = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    before = rows["time_[s]"] < 0.195
    np.testing.assert_allclose(rows["force_[N]"][before], 22.0, rtol=1e-9)
    command = rows["command_[V]"][before]
    assert np.ptp(command) < 1e-9 * command[0]
    blocks = [ff.load(f) for f in files]
    machine = Machine(controller_code(file, blocks).routines[-1])
    assert machine.states["now"] == pytest.approx(command[0], rel=1e-9)
    assert machine.states["last"] == 22.0
    words = f"A reset begins at 22 N, with a command of {command[0]:.6g} V"
    assert words in controller_code(file, blocks).remarks


@pytest.mark.parametrize(
    ("start", "size", "place", "words"),
    [
        (30.0, 5.0, 0.012, None),
        (2.0, 3.0, 0.0232, "the force goes from 2 to 10.18 N"),
        (30.0, 60.0, 0.012, "the force goes from 30 to 90 N"),
        (30.0, 5.0, 0.5, "the position goes from 0.5 to 0.5 m"),
    ],
)
def test_a_force_loop_that_leaves_the_logs_is_warned_of(
    start: float, size: float, place: float, words: str | None, here: Here, tmp_path: Path
) -> None:
    """What is wanted beyond them is taken at the end of the range, as by the export."""
    text = (FORCE % "held").replace("22.0, size: 20.0", f"{start}, size: {size}")
    file = controller(tmp_path, text.replace("position: 0.012", f"position: {place}"))
    done = here("simulate", str(GOLDEN / "spring-cylinder.yaml"), "--controller", file,
                "--reference", "step", "--duration", "1", "--json")  # fmt: skip
    found = json.loads(done.out)
    assert done.status == 0, done.err
    if words is None:
        assert not found["warnings"]
        return
    assert words in done.err
    assert any(words in w for w in found["warnings"])
    if start == 2.0:
        ends = [found["step"]["initial"], found["step"]["final"]]
        assert ends == pytest.approx([10.18, 10.18])


def test_a_line_that_leaves_the_logs_is_warned_of(here: Here, tmp_path: Path) -> None:
    """Of a line that is the same everywhere it counts how far it moves, not where."""
    path = str(GOLDEN / "hydrostatic.yaml")
    text = HEAD_OF_LINE + "reference: {size: %s}\nlimits: {low: -11.0, high: 11.0}\n"
    for size, far in ((5e-3, False), (0.2, True)):
        file = controller(tmp_path, text % size)
        done = here("simulate", path, "--controller", file, "--reference", "step")
        assert done.status == 0, done.err
        assert ("the position moves over" in done.err) == far
        assert "the force that is asked for" not in done.err
    file = controller(tmp_path, HEAD_OF_LINE + "reference: {size: 5.0e-3}\n")
    done = here("simulate", path, "--controller", file, "--reference", "step")
    assert "beyond the -11.71 to 12.01 N in the logs of hydrostatic" in done.err


def test_a_line_on_a_spring_begins_where_its_reference_does(here: Here, tmp_path: Path) -> None:
    """The command that holds it there is part of every command, in the export as well."""
    values = VALUES["hydrostatic"][1] | {"stiffness": 100.0, "dead_zone_positive": 1.0}
    path = save(tmp_path, "hydrostatic", values=values, stiffness="estimate")
    text = HEAD_OF_LINE + "reference: {start: 0.005, size: 0.002, at: 0.2}\n"
    out = tmp_path / "out.csv"
    done = here("simulate", path, "--controller", controller(tmp_path, text), "--reference", "step",
                "--duration", "0.5", "-o", str(out))  # fmt: skip
    assert done.status == 0, done.err
    rows = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    before = rows["time_[s]"] < 0.195
    np.testing.assert_allclose(rows["position_[m]"][before], 0.005, rtol=1e-9)
    np.testing.assert_allclose(rows["force_[N]"][before], 100.0 * 0.005 + 1.0, rtol=1e-9)
    machine = Machine(controller_code(tmp_path / "controller.yaml", [ff.load(path)]).routines[0])
    assert float(machine(wanted=0.005, position=0.005)[0]) == pytest.approx(1.5)


def test_files_that_make_no_machine_are_refused(here: Here, tmp_path: Path) -> None:
    done = here("simulate", save(tmp_path, "valve"), "--controller", controller(tmp_path),
                "--reference", "step")  # fmt: skip
    assert done.status == 2
    assert "takes a ball-screw file" in done.err
    motor = str(GOLDEN / "hydraulic-motor.yaml")
    for files in ([motor], [str(GOLDEN / "spring-cylinder.yaml"), motor]):
        file = controller(tmp_path, FORCE % "held")
        done = here("simulate", *files, "--controller", file, "--reference", "step")
        assert done.status == 2
        assert "a file of hydraulic-motor has no place in a closed loop" in done.err


def test_a_place_that_no_reading_can_be_of_is_warned_of(here: Here, tmp_path: Path) -> None:
    text = HEAD_OF_LINE + "machine: {travel_from: 0.0, travel_to: 1.0e-3}\nreference: {size: 0.05}"
    path = str(GOLDEN / "hydrostatic.yaml")
    done = here("simulate", path, "--controller", controller(tmp_path, text), "--reference", "step")
    assert done.status == 0, done.err
    assert "believes no reading and holds its command" in done.err


def test_example_of_the_page_runs(here: Here, tmp_path: Path, screw: list[str]) -> None:
    page = (Path(__file__).parents[2] / "docs" / "closed-loop.md").read_text(encoding="utf-8")
    file = controller(tmp_path, page.partition("```yaml\n")[2].partition("```")[0])
    done = here("simulate", *screw, "--controller", file, "--reference", "sine", "--duration", "1")
    assert done.status == 0, done.err
    assert "rms error" in done.out + done.err


@pytest.mark.parametrize(("gain", "warns"), [("4.0", False), ("80.0", True)])
def test_a_loop_that_only_friction_holds_is_warned_of(
    gain: str, warns: bool, here: Here, tmp_path: Path, screw: list[str]
) -> None:
    """On standard error, as JSON, and in what is exported."""
    file = controller(tmp_path, PD.replace("4.0", gain) + "limits: {low: -0.02, high: 0.02}\n")
    command = ["simulate", *screw, "--controller", file, "--reference", "step", "--duration", "1"]
    assert ("not stable" in here(*command).err) == warns
    found = json.loads(here(*command, "--json").out)
    assert bool(found["warnings"]) == warns == (found["margins"]["gain"] < 1.0)
    out = tmp_path / "out"
    done = here("export", *screw, "--controller", file, "--to", "c", "-o", str(out))
    assert done.status == 0, done.err
    (header,) = out.glob("*.h")
    assert ("UNSTABLE" in header.read_text()) == warns


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("bandwidth: 1.0, damping_ratio: 0.8", "damping_ratio 0.8 cannot be reached"),
        ("bandwidth: 60.0, derivative: 1.0", "60 Hz cannot be reached in steps of 0.01 s"),
        ("bandwidth: 12.0, damping_ratio: 0.8", "velocity filter cuts off at 10 Hz"),
        ("bandwidth: 4.0, damping_ratio: 0.8", None),
    ],
)
def test_gains_that_were_chosen_are_shown_and_what_they_miss(
    keys: str, words: str | None, here: Here, tmp_path: Path
) -> None:
    head = PD.partition("controller:")[0]
    file = controller(tmp_path, f"{head}controller: {{{keys}}}\n")
    line = save(tmp_path, "hydrostatic")
    command = ["simulate", line, "--controller", file, "--reference", "step", "--duration", "1"]
    done = here(*command)
    assert done.status == 0, done.err
    assert (words in done.err) if words else ("cannot" not in done.err)
    found = json.loads(here(*command, "--json").out)
    assert found["controller"]["proportional"]["unit"] == "N/m"
    for name in ("proportional", "derivative", "natural_frequency", "damping_ratio"):
        shown = f"{found['controller'][name]['value']:.6g}"
        (row,) = (r for r in done.out.splitlines() if r.startswith(name.replace("_", " ")))
        assert shown in row.split()
    assert "proportional gain" in here(*command, "-v").out
    if words:
        assert any(words in w for w in found["warnings"])


@pytest.mark.parametrize(
    ("kind", "reference", "refused"),
    [
        ("sine", "{size: 1.0e-3, frequency: 200.0}", True),
        ("sine", "{size: 1.0e-3, frequency: 50.0}", True),
        ("sine", "{size: 1.0e-3, frequency: 20.0}", False),
        ("triangle", "{size: 1.0e-3, speed: 1.0e+09}", True),
        ("triangle", "{size: -1.0e-3, speed: 0.1}", True),
        ("triangle", "{size: -1.0e-3, speed: 0.05}", False),
        ("ramp-insertion", "{size: 1.0e-3, speed: 1.0e+09}", False),
    ],
)
def test_a_reference_that_samples_cannot_show_is_refused(
    kind: str, reference: str, refused: bool, here: Here, tmp_path: Path
) -> None:
    head = PD.partition("controller:")[0]
    keys = f"controller: {{proportional: 3000.0, derivative: 0.0}}\nreference: {reference}\n"
    line, file = save(tmp_path, "hydrostatic"), controller(tmp_path, head + keys)
    done = here("simulate", line, "--controller", file, "--reference", kind, "--duration", "1")
    assert done.status == (2 if refused else 0), done.err
    assert ("show another course" in done.err) == refused


@pytest.mark.parametrize(
    ("family", "values"),
    [
        ("hydrostatic", {"mass": 1e-6}),
        ("hydraulic-cylinder", {"bulk_modulus": 1e15}),
        ("hydraulic-cylinder", {"viscous": 1e12}),
    ],
)
def test_a_machine_too_fast_to_be_followed_is_refused(
    family: str, values: dict[str, float], tmp_path: Path
) -> None:
    head = PD.partition("controller:")[0]
    text = "controller: {proportional: 1.0e+5, derivative: 0.0}\nreference: {start: 0.1}\n"
    file = read_controller_file(controller(tmp_path, head + text))
    document = with_values(read_document(GOLDEN / f"{family}.yaml"), values)
    with pytest.raises(ff.UsageError, match="too fast to be followed"):
        simulate_loop([document], file, "step", duration=0.3)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("friction: none", "the viscous friction of the machine adds to it"),
        ("friction: viscous", None),
        ("friction: viscous, cutoff: 1.0", "velocity filter cuts off at 1 Hz"),
    ],
)
def test_a_damping_ratio_that_friction_adds_to_is_named(
    keys: str, words: str | None, here: Here, tmp_path: Path
) -> None:
    text = f"""\
format: fluidact-controller
format_version: 1
kind: impedance
sample_time: 0.005
controller: {{stiffness: 500.0, damping_ratio: 0.8, sum_of_pressures: 8.0e+05, {keys}}}
machine: {{mass: 2.0, area_1: 5.0e-4, area_2: 4.0e-4}}
"""
    files = [save(tmp_path, "cylinder-friction"), save(tmp_path, "valve")]
    command = ["--controller", controller(tmp_path, text), "--reference", "step", "--duration", "1"]
    done = here("simulate", *files, *command)
    assert done.status == 0, done.err
    assert (words in done.err) if words else ("damping" not in done.err)


def test_an_impedance_that_is_unstable_is_named(here: Here, tmp_path: Path) -> None:
    files = [save(tmp_path, "cylinder-friction"), save(tmp_path, "valve")]
    text = """
format: fluidact-controller
format_version: 1
kind: impedance
sample_time: 0.01
controller: {stiffness: %s, damping_ratio: 1.0, sum_of_pressures: 8.0e+5, cutoff: 40.0}
machine: {mass: 0.14, area_1: 3.0e-4, area_2: 2.5e-4}
"""
    for stiffness, stable in (("100.0", True), ("1.0e+7", False)):
        file = controller(tmp_path, text % stiffness)
        done = here("simulate", *files, "--controller", file, "--reference", "step",
                    "--duration", "0.2", "--json")  # fmt: skip
        assert done.status == 0, done.err
        found = json.loads(done.out)
        assert found["margins"]["stable"] == stable
        assert ("the loop is unstable" in done.err) != stable


def test_files_given_in_the_place_of_others_are_told_apart(
    here: Here, tmp_path: Path, screw: list[str]
) -> None:
    done = here("simulate", *screw, "--controller", screw[0], "--reference", "step")
    assert done.status == 3
    assert "is a parameter file, not a controller file" in done.err
    done = here("simulate", *screw, "--controller", str(tmp_path / "no"), "--reference", "step")
    assert done.status == 3
    assert "does not exist" in done.err
    assert "parameter file" not in done.err
    pd = controller(tmp_path)
    done = here("export", pd, "--to", "c", "-o", str(tmp_path / "out"))
    assert done.status == 3
    assert "is a controller file, not a parameter file" in done.err
    assert "--controller" in done.err
    assert not list(tmp_path.glob("out/*"))


def test_draws_have_a_column_where_there_are_any(
    here: Here, tmp_path: Path, screw: list[str]
) -> None:
    command = ["simulate", *screw, "--controller", controller(tmp_path), "--reference", "step"]
    assert "of draws" not in here(*command).out
    assert "of draws" in here(*command, "--draws", "2").out
