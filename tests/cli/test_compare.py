"""``fluidact-fit compare`` and ``report``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fluidact_fit.structures import StructureComparison, StructureFit
from fluidact_fit_cli.commands.compare_structures import next_commands
from fluidact_fit_cli.errors import Invocation

Run = Callable[..., Any]
Log = Callable[..., Path]


@pytest.fixture
def files(here: Run, valve: Log, inside: Path) -> Path:
    """Two files of one machine and one of another, beside the logs."""
    for k, gain in enumerate((1000.0, 1000.0, 1030.0)):
        valve(f"v{k}.csv", seed=k, gain=gain)
        assert here("valve", f"v{k}.csv", "-o", f"v{k}.yaml", "-q").status == 0
    return inside


def test_parameter_files_are_compared_with_the_first(here: Run, files: Path) -> None:
    done = here("compare", "v0.yaml", "v1.yaml", "v2.yaml")
    assert done.status == 0
    assert "v1.yaml: does not differ beyond chance" in done.out
    assert "v2.yaml: differs by more than chance" in done.out
    found = json.loads(here("compare", "v0.yaml", "v2.yaml", "--json").out)
    gain = next(p for p in found["parameters"] if p["name"] == "gain")
    assert gain["deviations"][1] > 10.0
    assert found["together"][0]["p_value"] < 1e-6


def test_logs_are_compared(here: Run, files: Path) -> None:
    done = here("compare", "v0.csv", "v1.csv")
    assert done.status == 0
    assert "same columns, units, rows and sampling" in done.out
    (files / "other.csv").write_text("time,command\n" + "0,1\n1,2\n2,1\n" * 9, encoding="utf-8")
    assert "other.csv has no column 'outlet'" in here("compare", "v0.csv", "other.csv").out


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["v0.yaml"], 2, "nothing to compare"),
        (["v0.yaml", "v1.csv"], 2, "fluidact-fit check v0.yaml v1.csv"),
        (["v0.yaml", "absent.yaml"], 3, "absent.yaml"),
        (["v0.csv", "absent.csv"], 3, "absent.csv"),
        (["v0.yaml", "v1.yaml", "--unit", "outlet=bar"], 2, "--unit is about logs"),
        (["v0.yaml", "v1.yaml", "--sample-time", "0.1"], 2, "--sample-time is about logs"),
    ],
)
def test_what_cannot_be_compared(
    words: list[str], status: int, said: str, here: Run, files: Path
) -> None:
    done = here("compare", *words)
    assert done.status == status
    assert said in done.err


def test_a_page_is_written_beside_its_file(here: Run, files: Path) -> None:
    done = here("report", "v0.yaml")
    assert done.status == 0
    assert "v0.html" in done.out
    alone = (files / "v0.html").read_text(encoding="utf-8")
    assert "natural_frequency" in alone
    assert "<svg" not in alone
    assert here("report", "v0.yaml", "v2.yaml").status != 0  # it is there already
    assert (files / "v0.html").read_text(encoding="utf-8") == alone
    assert here("report", "v0.yaml", "v2.yaml", "-f").status == 0
    page = (files / "v0.html").read_text(encoding="utf-8")
    assert "differs by more than chance" in page
    assert "data:image/svg" in page or "<svg" in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")


def test_a_page_that_cannot_be(here: Run, files: Path) -> None:
    assert here("report", "v0.yaml", "-o", "page.txt").status == 2
    assert here("report", "v0.yaml", "-o", "v0.yaml", "-f").status == 2
    assert here("report", "absent.yaml").status == 3
    assert not list(files.glob("*.html"))


def test_structures_are_compared_and_the_command_to_run_next_runs(here: Run, files: Path) -> None:
    words = ["v0.csv", "v1.csv", "--zero", "none", "--fix", "gain=1000"]
    done = here("compare", "--structures", "valve", *words)
    assert done.status == 0
    assert "held out: each log in turn" in done.out
    assert "recommended: second order\n" in done.out
    assert "\nsecond order, dead time" in done.out
    command = done.out.splitlines()[-1].split()
    assert command[:2] == ["fluidact-fit", "valve"]
    assert command[2:4] == ["v0.csv", "v1.csv"]
    assert command.count("--zero") == command.count("--dead-time") == 1
    assert here(*command[1:], "-q").status == 0
    assert (files / "valve.yaml").is_file()

    found = json.loads(here("compare", *words, "--structures=valve", "--json").out)
    assert found["command"] == " ".join(command)
    assert [s["name"] for s in found["structures"]] == ["second order", "second order, dead time"]
    assert found["structures"][0]["parameters"] == 2


def test_where_the_judges_disagree_both_commands_are_listed() -> None:
    both = tuple(
        StructureFit(name, {"dead-time": delay, "zero": "none"}, {})
        for name, delay in (("second order", "none"), ("second order, dead time", "estimate"))
    )
    names = (both[0].name, both[1].name)
    found = StructureComparison("valve", both, None, "each log in turn", 100, names)
    words = ("compare", "--structures", "valve", "v0.csv", "--zero", "none")
    commands = next_commands(found, Invocation(words), {})
    assert list(commands) == list(names)
    for name, delay, file in zip(
        names, ("none", "estimate"), ("valve-second-order", "valve-second-order-dead-time")
    ):
        assert commands[name].startswith("fluidact-fit valve v0.csv ")
        assert f"--dead-time {delay}" in commands[name]
        assert commands[name].endswith(f"-o {file}.yaml")


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--structures", "vlve", "v0.csv"], 2, "vlve"),
        (["--structures", "force-map", "v0.csv"], 2, "one structure only"),
        (["--structures", "valve", "v0.csv", "v0.csv"], 2, "given twice"),
        (["--structures", "valve", "absent.csv"], 3, "absent.csv"),
        (["--structures", "valve", "v0.csv", "--column", "flow=x"], 2, "flow"),
        (["--structures", "valve", "v0.csv", "--fix", "mass=1"], 2, "mass"),
        (["v0.csv", "v1.csv", "--zero", "none"], 2, "--zero"),
    ],
)
def test_structures_that_cannot_be_compared(
    words: list[str], status: int, said: str, here: Run, files: Path
) -> None:
    done = here("compare", *words)
    assert done.status == status
    assert said in done.err
    assert "Traceback" not in done.err


def test_the_help_lists_the_options_of_the_family(here: Run) -> None:
    done = here("compare", "--structures", "line", "--help")
    assert done.status == 0
    assert "--sound-speed" in done.out
    assert "--fix" in done.out
    assert "--sound-speed" not in here("compare", "--help").out


def test_given_numbers_that_differ_are_named(here: Run, tmp_path: Path) -> None:
    """Gains at 35 and at 50 bar were called different machines without a word of the pressure."""
    log = str(Path(__file__).parents[2] / "datasets" / "flow-map" / "trial1.csv")
    columns = ["--column", "command=u", "--column", "flow=Q", "--column", "pressure_drop=dp"]
    for name, pressure in (("a", "35 bar"), ("b", "50 bar")):
        file = str(tmp_path / f"{name}.yaml")
        done = here("flow-map", log, *columns, "--reference-pressure", pressure, "-o", file)
        assert done.status == 0, done.err
    done = here("compare", str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml"))
    assert "--reference-pressure is 5e+06 Pa in" in done.out.replace("\n", " ")


def test_parameters_of_another_quantity_are_not_compared(here: Run, tmp_path: Path) -> None:
    """A gain in bar stood beside one in bar/V, 3,951 standard errors from it."""
    rows = (Path(__file__).parents[2] / "datasets" / "valve" / "trial1.csv").read_text("utf-8")
    (tmp_path / "volt.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "share.csv").write_text(rows.replace("[V]", "[%]"), encoding="utf-8")
    for name in ("volt", "share"):
        done = here("valve", str(tmp_path / f"{name}.csv"), "-o", str(tmp_path / f"{name}.yaml"),
                    "--column", "command=Sollwert", "--column", "outlet=Druck")  # fmt: skip
        assert done.status == 0, done.err
    done = here("compare", str(tmp_path / "volt.yaml"), str(tmp_path / "share.yaml"))
    assert done.status == 2
    assert "gain is in Pa in" in done.err
