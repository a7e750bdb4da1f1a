"""Parts of a log left out, constants per file, and two parts of one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.errors import LogError, ParameterFileError, UnitError, UsageError
from fluidact_fit.families import get_family
from fluidact_fit.logs import experiments, read_log
from fluidact_fit.logs.exclusions import find_in_name, parse_constant, parse_exclusion
from fluidact_fit.recall import recall_columns
from fluidact_fit_cli.main import run
from fluidact_fit_cli.options import read_logs

VALVE = get_family("valve").variants[0]
DATA = Path(__file__).parents[2] / "datasets/valve/trial1.csv"
BOUND = {"time": "#1", "command": "#2", "outlet": "#3"}
WORDS = ["--column", "time=#1", "--column", "command=#2", "--column", "outlet=#3"]


def two_runs(path: Path) -> Path:
    lines = DATA.read_text().splitlines()
    path.write_text("\n".join([*lines[:401], *lines[1:301]]) + "\n")
    return path


@pytest.mark.parametrize(
    ("exclude", "sizes"),
    [
        ([], [400, 300]),
        (["run=1"], [300]),
        (["run=2"], [400]),
        (["time=1:2"], [100, 199, 100, 99]),
        (["time=:2"], [199, 99]),
        (["time=2.5:"], [250, 250]),
        (["lines=402:701"], [400]),
        (["lines=10:12"], [397, 300]),
        (["lines=10", "run=2"], [399]),
        (["rows=9:11"], [397, 300]),
        (["rows=401:700"], [400]),
    ],
)
def test_parts_are_left_out(tmp_path: Path, exclude: list[str], sizes: list[int]) -> None:
    log = read_log(two_runs(tmp_path / "a.csv"), columns=BOUND, exclude=exclude)
    found, _ = experiments(log, VALVE)
    assert [e.samples for e in found] == sizes
    for e in found:
        assert np.all(np.diff(e.time) > 0.0)


@pytest.mark.parametrize(
    "exclude", ["time=100:200", "rows=701", "rows=900:950", "lines=800", "lines=702:900"]
)
def test_what_names_nothing_is_refused(tmp_path: Path, exclude: str) -> None:
    log = two_runs(tmp_path / "a.csv")
    with pytest.raises(UsageError, match=r"leaves out nothing of a\.csv"):
        ff.fit("valve", log, columns=BOUND, exclude=[exclude])


def test_a_window_may_take_away_what_is_left_out(tmp_path: Path) -> None:
    log = read_log(
        two_runs(tmp_path / "a.csv"), columns=BOUND, exclude=["time=3:3.5"], window=(0.0, 1.0)
    )
    assert [e.samples for e in experiments(log, VALVE)[0]] == [101, 101]


def test_lines_left_out_are_accounted_for(tmp_path: Path) -> None:
    log = read_log(two_runs(tmp_path / "a.csv"), columns=BOUND, exclude=["lines=10:12"])
    assert log.account.left_out == ((10, "excluded"), (11, "excluded"), (12, "excluded"))
    assert 10 not in log.lines


@pytest.mark.parametrize(
    "exclude", ["run=3", "time=:", "time=3:2", "lines=0", "run", "lines=1:9999999"]
)
def test_impossible_parts_are_refused(tmp_path: Path, exclude: str) -> None:
    path = two_runs(tmp_path / "a.csv")
    with pytest.raises(UsageError, match="exclude"):
        experiments(read_log(path, columns=BOUND, exclude=[exclude]), VALVE)


@pytest.mark.parametrize(
    ("text", "value"),
    [("25 %", (25.0, "%")), ("25%", (25.0, "%")), ("-0.3", (-0.3, None)), ("1e-3 m", (1e-3, "m"))],
)
def test_constants(text: str, value: tuple[float, str | None]) -> None:
    assert parse_constant("position", text) == value


@pytest.mark.parametrize(
    ("template", "name", "value"),
    [
        ("kinked{%}", "10mm_10cm_kinked25_Test8.csv", (25.0, "%")),
        ("_{cm}cm", "10mm_10cm_kinked25_Test8.csv", (10.0, "cm")),
        ("kinked{%}", "10mm_10cm_Unkink_Test8.csv", None),
        ("p{bar}_", "tube_l1_p2.5_start_1.csv", (2.5, "bar")),
        ("l{}_", "tube_l1_p2.5_start_1.csv", (1.0, None)),
    ],
)
def test_numbers_in_names(template: str, name: str, value: object) -> None:
    assert find_in_name("position", template, name) == value


@pytest.mark.parametrize("template", ["kinked", "{m}", "a{m}b{m}", "a}m{"])
def test_templates_need_braces_and_text(template: str) -> None:
    with pytest.raises(UsageError):
        find_in_name("position", template, "name")


def test_exclusions_are_written_as_they_are_given() -> None:
    short = ("run=2", "time=3:3.5", "time=:2", "time=3:", "lines=120:130")
    for text in (*short, "lines=1234567:1234568", "time=1234.5678:123456.789012345"):
        assert parse_exclusion(text).text == text


def muscle(path: Path, contraction: float, rng: np.random.Generator) -> Path:
    """Pressure up and down, and a force that contraction makes smaller."""
    p = 3.0 + 2.5 * np.sin(np.linspace(0.0, 12.0, 300))
    f = 40.0 * p * (1.0 - contraction) + 0.2 * rng.standard_normal(p.size)
    np.savetxt(path, np.column_stack((p, f)), delimiter=",", header="command [bar],force [N]",
               comments="", fmt="%.4f")  # fmt: skip
    return path


def test_a_constant_of_every_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    names = {"m_unkink_1.csv": 0.0, "m_kinked25_1.csv": 0.25, "m_kinked50_1.csv": 0.5}
    for name, contraction in names.items():
        muscle(Path(name), contraction, rng)
    given = ["--target", "force", "--inputs", "command,position", "--hidden", "2", "-q",
             "--from-name", "position=kinked{%}"]  # fmt: skip
    said = ["--set", "*unkink*:position=0 %"]
    assert run(["force-map", *names, *given, "-o", "none.yaml"]) == 2
    assert run(["force-map", *names, *given, *said, "-o", "map.yaml"]) == 0
    document = ff.read_document("map.yaml")
    assert [s.columns["position"].step.start for s in document.provenance.logs] == [0.0, 25.0, 50.0]
    # a new log says in its name what it is; one that was fitted is known
    new = muscle(tmp_path / "m_kinked40_2.csv", 0.4, rng)
    assert recall_columns(document, read_log(new)).steps["position"].start == 40.0
    old = recall_columns(document, read_log("m_unkink_1.csv"))
    assert (old.steps["position"].start, old.units["position"]) == (0.0, "%")
    # nobody knows of one that is neither
    other = muscle(tmp_path / "m_other.csv", 0.1, rng)
    with pytest.raises(UsageError, match=r"m_unkink_1\.csv 0 %, m_kinked25_1\.csv 25 %"):
        recall_columns(document, read_log(other))


def test_a_constant_in_a_unit_of_another_kind_is_refused(tmp_path: Path) -> None:
    bound = {"time": "#1", "outlet": "#3"}
    log = read_log(DATA, columns=bound, constants={"command": "3 N"})
    with pytest.raises(UnitError, match="command"):
        experiments(log, VALVE)


def test_two_parts_of_one_file(tmp_path: Path) -> None:
    out = tmp_path / "valve.yaml"
    words = ["valve", str(DATA), *WORDS, "-q", "-o", str(out)]
    assert run([*words, "--validate-window", "6:"]) == 2
    assert run([*words, "--window", ":6", "--validate-window", "6.01:"]) == 0
    document = ff.read_document(out)
    assert document.fit.samples + document.validation[0].samples == 1000
    assert document.validation[0].fit_percent > 95.0


@pytest.mark.parametrize("window", [(None, 6.0), (1.0, None), (0.1 + 0.2, 7.123456789)])
def test_the_part_that_was_fitted_is_used_again(window: tuple[float | None, float | None]) -> None:
    document = ff.fit("valve", read_log(DATA, columns=BOUND, window=window)).document
    again = recall_columns(document, read_log(DATA))
    assert again.window == window
    assert "part-recalled" in [n.code for n in again.notices]
    assert recall_columns(document, read_log(DATA, window=(6.0, 8.0))).window == (6.0, 8.0)
    other = read_log(DATA.with_name("trial2.csv"))
    assert recall_columns(document, other).window is None


@pytest.mark.parametrize("spoilt", [6, "6", "a:b", "7:6", "1:2:3", ":", [0.0, 6.0]])
def test_a_file_with_a_window_that_is_none_is_refused(tmp_path: Path, spoilt: object) -> None:
    path = tmp_path / "valve.yaml"
    ff.fit("valve", read_log(DATA, columns=BOUND, window=(None, 6.0))).save(path)
    raw = yaml.safe_load(path.read_text())
    assert raw["provenance"]["logs"][0]["details"]["window"] == ":6"
    raw["provenance"]["logs"][0]["details"]["window"] = spoilt
    path.write_text(yaml.safe_dump(raw))
    with pytest.raises(ParameterFileError, match="window"):
        ff.read_document(path)


def test_a_part_that_was_left_out_is_left_out_again(tmp_path: Path) -> None:
    log = read_log(DATA, columns=BOUND, exclude=["time=3:3.5"])
    document = ff.fit("valve", log).document
    assert document.provenance.logs[0].details["exclude"] == ["time=3:3.5"]
    again = recall_columns(document, read_log(DATA))
    assert [x.text for x in again.exclude] == ["time=3:3.5"]


@pytest.mark.parametrize("spoilt", [5, "time=1:2", [5], {"a": 1}, ["row=3"], ["run=1;x"]])
def test_a_file_that_excludes_nonsense_is_refused(tmp_path: Path, spoilt: object) -> None:
    path = tmp_path / "valve.yaml"
    ff.fit("valve", read_log(DATA, columns=BOUND, exclude=["time=3:3.5"])).save(path)
    raw = yaml.safe_load(path.read_text())
    raw["provenance"]["logs"][0]["details"]["exclude"] = spoilt
    path.write_text(yaml.safe_dump(raw))
    with pytest.raises(ParameterFileError, match="exclude"):
        ff.read_document(path)


@pytest.mark.parametrize(
    "option",
    [
        ["--exclude", "b.csv:run=1"],
        ["--exclude", "nonsense"],
        ["--set", "nothing=3"],
        ["--set", "outlet"],
        ["--from-name", "nothing=a{}"],
    ],
)
def test_options_that_name_nothing_are_refused(tmp_path: Path, option: list[str]) -> None:
    assert run(["valve", str(DATA), *WORDS, *option, "-q", "-o", str(tmp_path / "v.yaml")]) == 2
    assert not (tmp_path / "v.yaml").exists()


def test_two_logs_of_one_experiment(tmp_path: Path) -> None:
    """The command every 10 ms in one file, the outlet every 20 ms and 3 ms later in another."""
    whole = read_log(DATA, columns=BOUND)
    time, command, outlet = (c.values for c in whole.columns)
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    np.savetxt(a, np.column_stack((time, command)), header="time [s];command [V]",
               delimiter=";", comments="")  # fmt: skip
    late = np.arange(0.0, 9.9, 0.02) + 0.003
    np.savetxt(b, np.column_stack((late, np.interp(late, time, outlet))),
               header="t [s];outlet [bar]", delimiter=";", comments="")  # fmt: skip
    log = read_log(f"{a}+{b}")
    assert log.name == "a.csv+b.csv"
    (run_,), notices = experiments(log, VALVE)
    assert run_.sample_time == pytest.approx(0.02)
    np.testing.assert_allclose(run_.time, late)
    np.testing.assert_allclose(run_.signals["command"].time, time)
    assert "time-bases" in [n.code for n in notices]
    document = ff.fit("valve", log).document
    assert document.provenance.logs[0].file == "a.csv+b.csv"


@pytest.mark.parametrize("pattern", ["a_7V.csv", "b_*", "a_7V.csv+b_*"])
def test_either_name_of_merged_logs_is_matched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pattern: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in").mkdir()
    rows = [f"{0.1 * k:.1f},{k % 3}" for k in range(30)]
    Path("in/a_7V.csv").write_text("\n".join(["time [s],force [N]", *rows]))
    Path("in/b_2.csv").write_text("\n".join(["time [s],outlet [bar]", *rows]))
    params = read_params(set=[f"{pattern}:inlet=3 bar"], exclude=[f"{pattern}:time=1.05:"])
    params["from_name"] = {"command": "a_{V}V"}
    merged = f"{tmp_path / 'in/a_7V.csv'}+in/b_2.csv"
    (log,) = read_logs([merged], {**params, "logs": [merged]})
    assert log.name == "a_7V.csv+b_2.csv"
    assert {role: step.start for role, step in log.steps.items()} == {"inlet": 3.0, "command": 7.0}
    assert [x.text for x in log.exclude] == ["time=1.05:"]
    Path("in/c+b_2.csv").write_text(Path("in/b_2.csv").read_text())  # one log with such a name
    with pytest.raises(UsageError, match="not given"):
        read_logs(
            ["in/c+b_2.csv"], {**params, "set": ["b_2.csv:inlet=3"], "logs": ["in/c+b_2.csv"]}
        )


def read_params(**given: object) -> dict[str, object]:
    """The options that read a log, as the command line holds them."""
    usual = {"sample_time": None, "window": None, "exclude": [], "exclude_rows": [], "set": [],
             "from_name": {}}  # fmt: skip
    signs = dict.fromkeys(("decimal", "thousands", "delimiter", "skip_rows", "header_row"))
    by_role = {name: {} for name in ("column", "unit", "scale", "step", "hold")}
    return {**usual, **signs, **by_role, **given}


@pytest.mark.parametrize(
    ("given", "left_out"),
    [
        ({"exclude": ["2"]}, ["run=2"]),
        ({"exclude": ["1,3", "time=:2"]}, ["run=1", "run=3", "time=:2"]),
        ({"exclude": ["a*.csv:1, 2"]}, ["run=1", "run=2"]),
        ({"exclude_rows": ["7"]}, ["rows=7:7"]),
        ({"exclude_rows": ["a.csv:3:5,9"]}, ["rows=3:5", "rows=9:9"]),
        ({"exclude_rows": ["3:5"], "exclude": ["a.csv:2"]}, ["run=2", "rows=3:5"]),
    ],
)
def test_runs_and_rows_by_their_numbers(
    tmp_path: Path, given: dict[str, list[str]], left_out: list[str]
) -> None:
    path = str(two_runs(tmp_path / "a.csv"))
    (log,) = read_logs([path], {**read_params(**given), "logs": [path]})
    assert [x.text for x in log.exclude] == left_out


def test_two_parts_of_one_file_by_the_names_of_the_contract(tmp_path: Path) -> None:
    out = tmp_path / "v.yaml"
    parts = ["--fit-window", ":5", "--validate-window", "5:", "--exclude-rows", "3:5"]
    assert run(["valve", str(DATA), *WORDS, *parts, "-q", "-o", str(out)]) == 0
    document = ff.load(out).document
    assert document.provenance.logs[0].details["exclude"] == ["rows=3:5"]
    assert document.fit.samples == 498
    assert len(document.validation) == 1


def test_logs_of_two_experiments_are_not_merged(tmp_path: Path) -> None:
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    a.write_text("time,u\n" + "\n".join(f"{k},{k % 3}" for k in range(20)))
    b.write_text("time,y\n" + "\n".join(f"{k + 100},{k % 4}" for k in range(20)))
    with pytest.raises(LogError, match="in common"):
        read_log(f"{a}+{b}")
