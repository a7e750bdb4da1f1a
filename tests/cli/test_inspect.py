"""``inspect`` as the gate before a fit: what it prints, what it draws, what it suggests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fluidact_fit_cli.channel_lines import sparkline

Run = Callable[..., Any]
ROOT = Path(__file__).parents[2]
LINE = ROOT / "datasets" / "line" / "trial1.csv"


def table(path: Path, columns: list[np.ndarray], header: str = "") -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="",
               fmt="%.8g")  # fmt: skip
    return path


@pytest.mark.parametrize("width", [60, 80])
def test_everything_but_commands_fits_the_terminal(
    here: Run, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr("fluidact_fit_cli.show.width_of", lambda stream: width)
    for log in (LINE, ROOT / "datasets" / "hydraulic-cylinder" / "trial1.csv"):
        done = here("inspect", log, "--no-trial")
        lines = [x for x in done.out.splitlines() if "fluidact-fit" not in x and str(log) not in x]
        assert max(map(len, lines)) <= width
        assert len(lines) < 40


def test_a_channel_is_shown_with_its_noise_and_what_leads(here: Run) -> None:
    out = here("inspect", LINE, "--no-trial").out
    assert "noise 0.0023 bar (9.1 bits)" in out
    assert "12 reversals" in out
    assert "#2 leads: #3 moves with it 0.04 s later" in out
    found = json.loads(here("inspect", LINE, "--no-trial", "--json").out)
    channel = found["columns"][1]["channel"]
    assert channel["noise"] == pytest.approx(0.0023, abs=1e-4)
    assert found["relations"][0]["first"] == 2


def test_a_sparkline_has_blocks_or_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stream:
        encoding = "ascii"

    monkeypatch.setattr("sys.stdout", Stream())
    assert sparkline([0.0, None, 1.0], 10) == "_ #"
    Stream.encoding = "utf-8"
    assert sparkline([0.0, None, 1.0], 10) == "▁ █"
    assert len(sparkline([0.5] * 80, 37)) == 37


def test_a_computed_force_leaves_no_map_of_itself(here: Run, inside: Path) -> None:
    rng = np.random.default_rng(3)
    t = 0.001 * np.arange(2000)
    u = np.cumsum(rng.standard_normal(2000))
    x = 1e-4 * np.cumsum(u)
    log = table(inside / "axis.csv", [t, u, 35.15 * u, x], "time [s],u [V],force [N],position [m]")
    done = here("inspect", log, "--no-trial")
    assert "#3 is 35.15 times #2" in done.out
    families = [s["family"] for s in json.loads(
        here("inspect", log, "--no-trial", "--json").out)["suggestions"]]  # fmt: skip
    assert "ball-screw" in families
    assert "force-map" not in families


def test_a_measured_position_goes_before_the_one_that_was_asked_for(
    here: Run, inside: Path
) -> None:
    rng = np.random.default_rng(3)
    t = 0.001 * np.arange(2000)
    x = np.sin(t)
    log = table(inside / "axis.csv", [t, x, x + 1e-3 * rng.standard_normal(2000),
                                      rng.standard_normal(2000)],
                "t [s],q_ref [m],q [m],F [N]")  # fmt: skip
    (first, *_) = json.loads(here("inspect", log, "--no-trial", "--json").out)["suggestions"]
    assert first["columns"]["position"] == "#3"


def test_without_header_the_leader_drives(here: Run, inside: Path) -> None:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(0.0, 5.0, 20), 50)
    y = np.r_[np.zeros(5), np.convolve(u, np.full(30, 1 / 30.0))[:995]]
    log = table(inside / "bare.csv", [0.02 * np.arange(1000), y, u])
    done = here("inspect", log)
    assert "#3 leads #2 and may" in done.out
    commands = [x.strip() for x in done.out.splitlines() if x.strip().startswith("fluidact-fit")]
    assert any("line" in c and "inlet=#3" in c for c in commands)


def test_columns_that_nothing_names_are_listed_with_a_command_to_complete(
    here: Run, inside: Path
) -> None:
    rng = np.random.default_rng(3)
    log = table(inside / "bare.csv", [0.02 * np.arange(500), *rng.standard_normal((3, 500))])
    out = here("inspect", log, "--no-trial").out
    assert "Neither names nor units tell what #2, #3 and #4 are." in out
    assert "candidates for every role: #2, #3, #4" in out
    assert "force + position" in out
    assert "--column 'command=#N'" in out.splitlines()[-1]
    done = here("fit", log)
    assert done.status == 2
    assert "Neither names nor units tell what #2, #3 and #4 are." in done.err


def test_a_role_whose_column_is_constant_is_not_asked_for(here: Run, inside: Path) -> None:
    """A position that never changed was called missing, to be recorded or given with --set."""
    rng = np.random.default_rng(3)
    p = 1e5 * (2.0 + np.sin(0.01 * np.arange(1000)))
    log = table(inside / "spring.csv", [p, 1e-3 * p + rng.standard_normal(1000), 0.0 * p + 12.0],
                "p [Pa],force [N],position [mm]")  # fmt: skip
    done = here("inspect", log)
    assert "position=#3" in done.out
    assert "position is the same in every row (#3)" in done.out
    assert "not determined: stiffness" in done.out
    assert "--set position" not in done.out
    done = here("fit", log)
    assert done.status == 2
    assert "error: position is the same in every row (#3)" in done.err


def test_a_role_that_is_missing_is_named_with_the_option_that_gives_it(
    here: Run, inside: Path
) -> None:
    rng = np.random.default_rng(3)
    p = 1e5 * (2.0 + np.sin(0.01 * np.arange(1000)))
    log = table(inside / "spring.csv", [p, 1e-3 * p + rng.standard_normal(1000)],
                "p [Pa],force [N]")  # fmt: skip
    done = here("inspect", log, "--no-trial")
    assert "--set position=VALUE" in done.out
    assert "fill in what stands in capitals" in done.out


def test_only_the_rows_that_a_fit_uses_are_described(here: Run, inside: Path) -> None:
    t = 0.01 * np.arange(1000)
    ramp = table(inside / "ramp.csv", [t, 2.0 * t, t**2], "time [s],inlet [bar],outlet [bar]")
    words = ("inspect", ramp, "--no-trial", "--window", "2:6", "--exclude", "time=4:9")
    done = here(*words)
    assert "1000 rows, 200 of them used" in done.out
    assert "2 to 3.99 s" in done.out
    assert "4 to 7.98 bar" in done.out
    found = json.loads(here(*words, "--json").out)
    assert (found["columns"][1]["low"], found["columns"][1]["high"]) == (4.0, 7.98)
    nothing = here("inspect", ramp, "--no-trial", "--window", "20:")
    assert nothing.status == 3
    assert "no sample lies within the window 20: s" in nothing.err


def test_every_name_that_is_shown_is_taken_for_a_column(here: Run, inside: Path) -> None:
    headers = ("t_s", "q_ref_m", "q_m", "p [bar]", "p [V]", "#1", "Druck hinter dem Ventil [bar]")
    rng = np.random.default_rng(3)
    log = table(inside / "axis.csv", [0.01 * np.arange(200), *rng.standard_normal((6, 200))],
                ",".join(headers))  # fmt: skip
    columns = json.loads(here("inspect", log, "--no-trial", "--json").out)["columns"]
    out = here("inspect", log, "--no-trial").out
    for column in columns[1:]:
        assert f"#{column['number']}" in out
        assert column["reference"] in out
        done = here("inspect", log, "--no-trial", "--json", "--column",
                    f"force={column['reference']}", "--unit", "force=N")  # fmt: skip
        assert done.status == 0, done.err
    assert columns[5]["reference"] == "#6"  # "#1" is the first column


def test_a_likely_time_says_what_a_fit_has_to_be_told(here: Run, inside: Path) -> None:
    rng = np.random.default_rng(3)
    log = table(inside / "bare.csv", [0.01 * np.arange(200), *rng.standard_normal((3, 200))])
    assert "a fit needs --column time=#1" in here("inspect", log, "--no-trial").out
    assert "a fit needs" not in here("inspect", LINE, "--no-trial").out


def test_pictures_and_their_files(here: Run, inside: Path) -> None:
    assert here("inspect", LINE, "--plot", "a.html").status == 0
    page = (inside / "a.html").read_text()
    assert page.count("<img") == 2
    assert "http" not in page.replace("http-equiv", "")
    assert here("inspect", LINE, "--no-trial", "--plot", "a.html").status == 2  # kept
    done = here("inspect", LINE, "--no-trial", "--plot", "b.svg")
    assert done.status == 0
    assert sorted(p.name for p in inside.glob("b*")) == ["b-responses.svg", "b.svg"]
    assert "b-responses.svg" in done.out
    copy = inside / "log.csv"
    copy.write_bytes(LINE.read_bytes())
    assert here("inspect", copy, "--plot", copy, "-f").status == 2
    assert here("inspect", LINE, "--plot", "c.txt").status == 2


def test_a_parameter_file_is_told_from_a_log(here: Run, valve: Run, inside: Path) -> None:
    assert here("valve", valve(), "-q").status == 0
    done = here("inspect", "valve.yaml")
    assert done.status == 3
    assert "parameter file" in done.err
    assert "fluidact-fit report valve.yaml" in done.err


def test_invalid_cells_of_a_constant_channel_are_counted(here: Run, inside: Path) -> None:
    rows = [f"{k},{'x' if k == 7 else 2.25}" for k in range(50)]
    (inside / "c.csv").write_text("\n".join(["time [s],p [bar]", *rows]))
    assert "always 2.25 bar; 1 invalid cell" in here("inspect", "c.csv").out


def test_the_command_repeats_what_was_typed(here: Run, inside: Path) -> None:
    for name in ("a", "b"):
        (inside / f"{name}.csv").write_text(LINE.read_text(encoding="utf-8"), encoding="utf-8")
    words = ("b.csv", "--exclude", "b.csv:time=0:2", "--decimal", ".", "a.csv")
    done = here("inspect", "--no-trial", *words)
    assert "fluidact-fit line b.csv --exclude b.csv:time=0:2 --decimal . a.csv --col" in done.out


def test_a_second_picture_that_is_there_is_told_before_any_work(here: Run, inside: Path) -> None:
    (inside / "p-responses.png").write_bytes(b"mine")
    done = here("inspect", LINE, "--plot", "p.png")
    assert (done.status, done.out) == (2, "")
    assert (inside / "p-responses.png").read_bytes() == b"mine"


@pytest.mark.parametrize("command", ["inspect", "fit"])
def test_where_no_family_fits_every_unit_is_said_as_it_is_read(
    here: Run, inside: Path, command: str
) -> None:
    t = np.linspace(0.0, 1.0, 50)
    columns = [t, np.sin(20.0 * t), np.cos(20.0 * t)]
    log = table(inside / "log.csv", columns, "time (s),force (lb),angle (Grad)")
    done = here(command, log)
    assert "#2: 'lb' is a mass" in done.out + done.err
    assert "#3: unit 'Grad' is not clear: it may be degrees" in done.out + done.err
