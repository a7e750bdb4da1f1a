"""``export`` and ``check-consumer`` on the command line."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff

Run = Callable[..., Any]
GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


@pytest.fixture
def files(inside: Path) -> Path:
    """The parameter files of this version in the working directory."""
    for path in GOLDEN.glob("*.yaml"):
        shutil.copy(path, inside)
    return inside


@pytest.mark.parametrize(
    ("to", "suffixes"),
    [
        ("json", ["json"]),
        ("st", ["st"]),
        ("ros2", ["ros2.yaml", "declaration.yaml", "metadata.yaml"]),
        ("matlab", ["m", "mat"]),
    ],
)
def test_names_of_files_go_to_standard_output(
    to: str, suffixes: list[str], files: Path, here: Run
) -> None:
    done = here("export", "valve.yaml", "ball-screw.yaml", "--to", to, "-o", "out/deep")
    assert done.status == 0
    assert done.err == ""
    second = "ball_screw" if to == "matlab" else "ball-screw"  # it calls functions by their files
    due = [f"out/deep/{n}.{s}" for n in ("valve", second) for s in suffixes]
    assert done.out.splitlines() == due
    assert sorted(p.name for p in (files / "out" / "deep").iterdir()) == sorted(
        name.removeprefix("out/deep/") for name in due
    )
    again = here("export", "valve.yaml", "--to", to, "-o", "out/deep")
    assert again.status == 2  # as of a fit
    assert again.out == ""
    assert "--force" in again.err
    assert here("export", "valve.yaml", "--to", to, "-o", "out/deep", "-f", "-q").out == ""


def test_json_is_the_document_that_the_fit_prints(inside: Path, here: Run, valve: Any) -> None:
    printed = json.loads(here("valve", valve(), "-o", "fit.yaml", "--json").out)
    assert here("export", "fit.yaml", "--to", "json").out == "fit.json\n"
    exported = json.loads((inside / "fit.json").read_text(encoding="ascii"))
    # the file keeps the short ones of the details that are printed
    assert exported["fit"].pop("details").items() <= printed["fit"].pop("details").items()
    assert exported == printed


@pytest.mark.parametrize(
    ("words", "status", "hint"),
    [
        (["valve.yaml"], 2, "--to"),
        (["--to", "json"], 2, "PARAMS"),
        (["valve.yaml", "--to", "rust"], 2, "Targets:"),
        (["valve.yaml", "--to", "json", "--arithmetic", "q15"], 2, "does not know"),
        (["valve.yaml", "--to", "json", "--arithmetic", "q7"], 2, "q15"),
        (["absent.yaml", "--to", "json"], 3, "does not exist"),
        (["valve.yaml", "--to", "json", "-o", ""], 2, "folder"),
        (["valve.yaml", "--to", "json", "-o", "valve.yaml"], 3, "valve.yaml"),
        (["valve.yaml", "--to", "json", "--accept-not-identified", "gian"], 2, "gian"),
        (["open.yaml", "--to", "json"], 4, "--accept-not-identified damping_ratio"),
        (["failed.yaml", "--to", "json"], 4, "--accept-failed"),
    ],
)
def test_refusals(words: list[str], status: int, hint: str, files: Path, here: Run) -> None:
    text = (files / "valve.yaml").read_text(encoding="utf-8")
    (files / "failed.yaml").write_text(text.replace("verdict: pass", "verdict: fail"))
    write_open(files)
    before = sorted(files.iterdir())
    done = here("export", *words)
    assert done.status == status
    assert hint in done.err
    assert "Traceback" not in done.err
    assert done.out == ""
    assert sorted(files.iterdir()) == before


def write_open(folder: Path) -> None:
    """A valve whose damping ratio was not identified."""
    import yaml

    raw = yaml.safe_load((folder / "valve.yaml").read_text(encoding="utf-8"))
    entry = raw["parameters"]["damping_ratio"]
    entry["status"] = "not_identified"
    for key in ("std_error", "ci95", "method"):
        entry.pop(key, None)
    table = raw["covariance"]
    gone = table["order"].index("damping_ratio")
    table["order"].pop(gone)
    table["matrix"] = [row[:gone] + row[gone + 1 :] for row in table["matrix"]]
    table["matrix"].pop(gone)
    (folder / "open.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")


@pytest.mark.parametrize("name", ["damping_ratio", "all"])
def test_what_was_not_identified_may_be_accepted(name: str, files: Path, here: Run) -> None:
    write_open(files)
    words = ["--to", "matlab", "--accept-not-identified", name]
    assert here("export", "open.yaml", *words).out == "open.m\nopen.mat\n"
    assert "NOT IDENTIFIED: damping_ratio" in (files / "open.m").read_text(encoding="ascii")


def test_check_consumer(files: Path, here: Run) -> None:
    assert here("export", "line.yaml", "--to", "ros2").status == 0
    done = here("check-consumer", "line.yaml", "line.declaration.yaml")
    assert done.status == 0
    assert done.out.endswith("keys agree\n")
    (files / "keys.txt").write_text("gain [1]\ntime_constant [ms]\nwidth\n", encoding="utf-8")
    done = here("check-consumer", "line.yaml", "keys.txt")
    assert done.status == 5
    rows = [line.split() for line in done.out.splitlines()]
    assert rows[1][-2:] == ["other", "unit"]
    assert rows[2] == ["width", "lacking"]
    assert rows[3] == ["dead_time", "s", "ignored"]
    assert "1000 times" in done.err
    found = json.loads(here("check-consumer", "line.yaml", "keys.txt", "--json").out)
    assert found["agrees"] is False
    assert [row["finding"] for row in found["keys"]] == [
        "agrees", "other unit", "lacking", "ignored",
    ]  # fmt: skip
    assert here("check-consumer", "line.yaml", "absent.h").status == 3
    assert here("check-consumer", "absent.yaml", "keys.txt").status == 3
    assert here("check-consumer", "line.yaml").status == 2


def test_the_example_of_the_page(files: Path, here: Run) -> None:
    """What docs/export.md shows of check-consumer is what it prints."""
    page = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    _, _, shown = page.partition("    $ fluidact-fit check-consumer line.yaml controller.h\n")
    assert shown
    (files / "controller.h").write_text(
        "#define LINE_GAIN 0.98f /* 1 */\n"
        "static const float line_time_constant = 120.0f; /* [ms] */\n",
        encoding="ascii",
    )
    done = here("check-consumer", "line.yaml", "controller.h")
    due = [line.removeprefix("    ").rstrip() for line in shown.splitlines()]
    assert (done.out + done.err).splitlines() == due


def test_every_target_is_on_the_page_and_in_the_help(here: Run) -> None:
    from fluidact_fit.export import TARGETS

    page = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    text = here("export", "--help").out
    for name in TARGETS:
        assert f"\n## `{name}`\n" in page
        assert f"\n  {name} " in text


def test_export_loads_nothing_that_it_does_not_need() -> None:
    code = (
        "import sys\n"
        "from fluidact_fit_cli.main import run\n"
        f"assert run(['export', {str(GOLDEN / 'line.yaml')!r}, '--to', 'rust']) == 2\n"
        "heavy = {'scipy.io', 'scipy.signal', 'pandas', 'matplotlib', 'casadi', 'control'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["math", "String", "stdint", "con", "assert"])
def test_no_file_is_called_like_a_header_or_a_device(name: str, files: Path, here: Run) -> None:
    shutil.copy(files / "ball-screw.yaml", files / f"{name}.yaml")
    done = here("export", f"{name}.yaml", "--to", "c", "-o", "out")
    assert done.status == 0
    assert done.out.splitlines() == [f"out/{name}_p{e}" for e in (".h", ".c", "_selftest.c")]
    assert f"note: {name}.yaml is exported as {name}_p" in done.err
    assert f'#include "{name}_p.h"' in (files / f"out/{name}_p.c").read_text(encoding="ascii")


def test_a_reserved_word_is_told(files: Path, here: Run) -> None:
    shutil.copy(files / "line.yaml", files / "while.yaml")
    done = here("export", "while.yaml", "--to", "st")
    assert done.out == "while.st\n"
    assert done.err == "note: while.yaml: while is a reserved word, identifiers are while_p.\n"


def test_what_a_language_cannot_hold_does_not_keep_others_back(files: Path, here: Run) -> None:
    names = ("valve.yaml", "ball-screw.yaml", "line.yaml", "potentiometer.yaml")
    done = here("export", *names, "--to", "c", "--arithmetic", "q15", "-o", "out")
    assert done.status == 2
    due = [f"out/{n}{e}" for n in ("ball-screw", "potentiometer") for e in (".h", ".c")]
    assert set(due) < set(done.out.splitlines())
    assert sorted(f"out/{p.name}" for p in (files / "out").iterdir()) == sorted(
        done.out.splitlines()
    )
    assert "2 files were not exported; the others were" in done.err
    for name in ("valve.yaml", "line.yaml"):
        assert f"{name}: nothing of" in done.err
    alone = here("export", "valve.yaml", "line.yaml", "--to", "c", "--arithmetic", "q15", "-o", "b")
    assert alone.status == 2
    assert alone.out == ""
    assert not (files / "b").exists()


def test_two_files_that_would_write_one_are_refused(files: Path, here: Run) -> None:
    shutil.copy(files / "line.yaml", files / "line_selftest.yaml")
    done = here("export", "line.yaml", "line_selftest.yaml", "--to", "c", "-o", "out")
    assert done.status == 2
    assert "line_selftest.c" in done.err
    assert not (files / "out").exists()


@pytest.mark.parametrize("to", ["c", "st", "matlab", "ros2", "fmu"])
def test_every_export_says_where_it_comes_from(to: str, files: Path, here: Run) -> None:
    digest = hashlib.sha256((files / "line.yaml").read_bytes()).hexdigest()
    if to == "fmu" and shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    assert here("export", "line.yaml", "--to", to, "-o", "out").status == 0
    for path in (files / "out").iterdir():
        content = path.read_bytes()
        if path.suffix == ".fmu":
            content = zipfile.ZipFile(path).read("sources/line.c")
        for words in (digest, "fluidact-fit 0.1.0", "2026-11-22T01:08:24Z", "pass"):
            assert words.encode() in content, (path, words)
    first = {p.name: p.read_bytes() for p in (files / "out").iterdir()}
    assert here("export", "line.yaml", "--to", to, "-o", "again").status == 0
    assert {p.name: p.read_bytes() for p in (files / "again").iterdir()} == first


@pytest.mark.parametrize("place", [0.0, 110350.0, 1e9])
@pytest.mark.parametrize("to", ["c", "st"])
def test_a_range_of_a_single_value_is_refused(
    place: float, to: str, files: Path, here: Run
) -> None:
    import yaml

    raw = yaml.safe_load((files / "line.yaml").read_text(encoding="utf-8"))
    raw["validity"]["inlet"].update(low=place, high=place * (1.0 + 1e-12))
    (files / "point.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
    done = here("export", "point.yaml", "--to", to)
    assert done.status == 2
    assert "inlet, whose range is the single value" in done.err


@pytest.mark.parametrize(("to", "name"), [("c", "flat.h"), ("st", "flat.st")])
def test_an_inverse_without_a_range_is_left_out(
    to: str, name: str, inside: Path, here: Run
) -> None:
    """A calibration that is constant has a position at every reading: all of it was refused."""
    import yaml

    raw = yaml.safe_load((GOLDEN / "potentiometer.yaml").read_text(encoding="utf-8"))
    for entry in raw["parameters"].values():
        entry["status"] = "fixed"
        for key in ("std_error", "ci95", "method"):
            entry.pop(key, None)
    raw["parameters"]["control_points"]["value"] = [0.03] * 4
    del raw["covariance"], raw["derived"]
    curve = raw["model"]["curve"]
    curve["ascending_numerator"] = [0.03 * x for x in curve["ascending_denominator"]]
    (inside / "flat.yaml").write_text(yaml.safe_dump(raw), encoding="utf-8")
    done = here("export", "flat.yaml", "--to", to, "-o", "out")
    assert done.status == 0, done.err
    text = (inside / "out" / name).read_text(encoding="utf-8")
    assert "LEFT OUT: reading_at, a function of position, whose range is the single" in text
    assert text.count("reading_at") == 1
