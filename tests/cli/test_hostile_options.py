"""Option values that are text, but not sense: blamed by name, with the documented status."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from fluidact_fit.errors import UsageError
from fluidact_fit.families import family_names
from fluidact_fit.units.quantities import plausible

Run = Callable[..., Any]
DATASETS = Path(__file__).parents[2] / "datasets"
GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"


def dataset(family: str, rows: int, target: Path, *, trial: int = 1, step: int = 1) -> list[str]:
    """The first rows of a dataset's log, written to ``target``, and the words of its fit."""
    folder = DATASETS / family
    lines = (folder / f"trial{trial}.csv").read_text(encoding="utf-8").splitlines()
    target.write_text("\n".join([lines[0], *lines[1::step][:rows]]) + "\n", encoding="utf-8")
    truth = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))
    return [family, target.name, *truth["arguments"]]


@pytest.mark.parametrize("family", family_names())
@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--controller-sample-time", "1e308", "'1e308' is too large"),
        ("--controller-sample-time", "1e29", "Expected 1e-12 to 1e+09 s"),
        ("--controller-sample-time", "1e-29", "Expected 1e-12 to 1e+09 s"),
        ("--sample-time", "1e29", "--sample-time"),
        ("--window", "1e300:1e301", "'1e300' is too large"),
        ("-o", "nodir/", "-o nodir/ names a directory"),
    ],
)
def test_every_family(
    family: str, option: str, value: str, told: str, here: Run, inside: Path
) -> None:
    words = dataset(family, 60, inside / "log.csv")
    done = here(*words, option, value)
    assert (done.status, done.out) == (2, "")
    assert told in done.err
    assert [p.name for p in inside.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("family", "options", "told"),
    [
        ("hydraulic-cylinder", ["--mass", "1e300"], "'--mass': '1e300' is too large"),
        ("cylinder-friction", ["--mass", "1e300"], "'--mass': '1e300' is too large"),
        ("line", ["--sound-speed", "0"], "Expected a number above 0 [m/s]"),
        ("line", ["--sound-speed", "1e-320"], "'--sound-speed': '1e-320' is too small"),
        ("line", ["--scale", "time=1e-320"], "'1e-320' is too small"),
        ("line", ["--scale", "inlet=1e31"], "'1e31' is too large"),
        ("line", ["--column", "inlet=#²"], "no column '#²'"),
        ("line", ["--column", "inlet=#٢"], "no column '#٢'"),
        ("line", ["--column", f"inlet=#{'9' * 5000}"], "no column '#99999"),
        ("valve", ["--fix", "gain=1e200"], "'1e200' is too large"),
        ("valve", ["--bounds", "gain=0:1e200"], "'1e200' is too large"),
        ("line", ["--controller-sample-time", "1e8"], "what the longest run lasts"),
        ("line", ["--fix", "gain=1bar"], "--fix gain=1 bar: unit 'bar' is a pressure"),
        ("cylinder-friction", ["--deadband", "5kg"], "for example --deadband 1.5m/s"),
        ("valve", ["--step", "command=0:1@1e6"], "log.csv ends before that"),
        ("hydrostatic", ["--start", "mass=-1e99"], "'-1e99' is too large"),
    ],
)
def test_the_value_is_blamed(
    family: str, options: list[str], told: str, here: Run, inside: Path
) -> None:
    words = dataset(family, 60, inside / "log.csv")
    role = options[1].partition("=")[0]
    kept = [
        word
        for pair in zip(words[2::2], words[3::2])
        if not pair[1].startswith(f"{role}=") and pair[0] != options[0]
        for word in pair
    ]
    done = here(*words[:2], *kept, *options)
    assert done.status in (2, 3)
    assert told in done.err, done.err
    assert "the document" not in done.err


def test_the_same_holds_in_python(inside: Path) -> None:
    from fluidact_fit import fit, read_log

    words = dataset("line", 60, inside / "log.csv")
    columns = dict(word.split("=") for word in words if "=" in word)
    for more, told in (
        ({"fixed": {"gain": 1e200}}, "too large"),
        ({"length": 1e300}, "too large"),
        ({"sound_speed": 1e-320}, "too small"),
        ({"controller_sample_time": 1e308}, "is impossible"),
        ({"controller_sample_time": float("nan")}, "is impossible"),
    ):
        with pytest.raises(UsageError, match=told):
            fit("line", read_log(inside / "log.csv", columns=columns), **more)


def test_plausible() -> None:
    assert [plausible(v) for v in (0.0, -1e30, 1e-30)] == [0.0, -1e30, 1e-30]
    for value in (float("nan"), float("inf"), 1.1e30, -9e-31):
        with pytest.raises(ValueError, match=r"not finite|too large|too small"):
            plausible(value)


def test_equal_friction_levels_that_few_rows_do_not_tell(here: Run, inside: Path) -> None:
    words = dataset("spring-cylinder", 160, inside / "log.csv")
    done = here(*words, "--motion-state", "position", "--accept-failed")
    assert done.status in (0, 4), done.err
    assert "95 % interval would be" in done.err


@pytest.mark.parametrize("flow", ["orifice", "mlp"])
@pytest.mark.parametrize(("trial", "rows", "step"), [(1, 120, 1), (2, 120, 1), (3, 300, 3)])
def test_a_cylinder_of_few_rows(
    flow: str, trial: int, rows: int, step: int, here: Run, inside: Path
) -> None:
    words = dataset("hydraulic-cylinder", rows, inside / "log.csv", trial=trial, step=step)
    done = here(*words, "--flow", flow, "--accept-failed")
    assert done.status in (0, 3, 4), done.err
    assert ("Nothing was written" in done.err) == (
        not (inside / "hydraulic-cylinder.yaml").exists()
    )


_OF_LOGS = ["--window 0:1", "--exclude run=1", "--set command=3", "--decimal ,", "--skip-rows 3"]


@pytest.mark.parametrize("option", ["column=#2", "scale=2", "step=0:1", "hold=zoh", *_OF_LOGS])
def test_a_simulation_of_steps_reads_no_log(option: str, here: Run, inside: Path) -> None:
    assert here(*dataset("valve", 200, inside / "log.csv"), "-q", "--accept-failed").status == 0
    name, _, value = option.partition("=")
    words = option.split() if option.startswith("--") else [f"--{name}", f"command={value}"]
    steps = ["--input", "command=0:1", "--duration", "1", "--sample-time", "0.01"]
    done = here("simulate", "valve.yaml", *steps, *words)
    assert (done.status, done.out) == (2, "")
    assert f"{words[0]} is about reading a LOG" in done.err
    assert here("simulate", "valve.yaml", *steps).status == 0


def test_a_start_beyond_all_numbers_breaks_nothing(here: Run, inside: Path) -> None:
    """A search steps back from where the motion cannot be followed, or refuses in words."""
    words = dataset("ball-screw", 60, inside / "log.csv")
    done = here(*words, "--start", "inertia=1e30")
    assert done.status == 4, done.err
    assert "cannot determine inertia" in done.err
    assert [p.name for p in inside.iterdir()] == ["log.csv"]
    done = here(*words, "--start", "coulomb_negative=1e30", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["fit"]["fit_percent"] > 99.0


def test_a_rate_that_never_gets_anywhere_costs_no_memory(here: Run, inside: Path) -> None:
    words = ["design", "hydrostatic", "--from", str(GOLDEN / "hydrostatic.yaml"), "-o", "next.csv"]
    done = here(*words, "--duration", "0.2", "--rate", "1e-12")
    assert done.status == 4
    assert "no excitation within these limits" in done.err
    assert not list(inside.iterdir())


@pytest.mark.parametrize("words", [["line", "a\0b"], ["design", "line", "--from", "a\0b"]])
def test_a_nul_is_blamed(words: list[str], here: Run) -> None:
    done = here(*words)
    assert done.status == 2
    assert "holds a NUL" in done.err


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--window", "0:1", "--window", "1:2"], "--window was given twice"),
        (["--seed", "1", "--seed=2"], "--seed was given twice"),
        (["-o", "a.yaml", "-o", "b.yaml"], "-o was given twice"),
        (["--fix", "gain=1", "--bounds", "gain=2:3"], "gain=1 lies outside --bounds gain=2:3"),
        (["--start", "gain=3", "--bounds", "gain=0:2"], "--start gain=3 lies outside --bounds"),
        (
            ["--start", "time_constant=3 ms", "--bounds", "time_constant=5:20 ms"],
            '--start "time_constant=0.003 s" lies outside --bounds "time_constant=0.005:0.02 s"',
        ),
        (["--start", "gain=3", "--fix", "gain=2"], "--start gain=... means nothing with --fix"),
        (["--fix", "time_constant=-1"], "Expected 1e-09 s or more."),
        (["--start", "time_constant=-2 ms"], '--start "time_constant=-0.002 s" is outside'),
        (["--exclude-rows", "600"], "leaves out nothing of log.csv"),
        (["--exclude", "rows=5:3"], "is not understood"),
    ],
)
def test_what_contradicts_itself_is_refused(
    options: list[str], told: str, here: Run, inside: Path
) -> None:
    done = here(*dataset("line", 300, inside / "log.csv"), *options)
    assert (done.status, done.out) == (2, "")
    assert told in done.err
    assert [p.name for p in inside.iterdir()] == ["log.csv"]


@pytest.mark.parametrize("headers", ["time [s],p1,outlet [bar]", "time [s],,outlet [bar]",
                                     "time [s],foo,bar", "time [s],inlet [bar],"])  # fmt: skip
def test_a_role_without_a_column_is_named(headers: str, here: Run, inside: Path) -> None:
    dataset("line", 300, inside / "log.csv")
    text = (inside / "log.csv").read_text(encoding="utf-8")
    (inside / "log.csv").write_text(headers + text[text.index("\n") :], encoding="utf-8")
    done = here("line", "log.csv")
    assert done.status == 3
    assert "no column is named" in done.err
