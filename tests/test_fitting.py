"""What a fit in Python takes: everything that the command line takes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lsim

import fluidact_fit as ff
from fluidact_fit_cli.main import run

DATA = Path(__file__).parents[1] / "datasets" / "valve"
COLUMNS = {"time": "Zeit [s]", "command": "Sollwert [V]", "outlet": "Druck [bar]"}
LOGS = [DATA / f"trial{k}.csv" for k in (1, 2, 3)]
Fit = Callable[..., ff.FitResult]


@pytest.fixture
def fit() -> Fit:
    return lambda logs, **given: ff.fit_valve(logs, columns=COLUMNS, **given)


@pytest.fixture(scope="module")
def result() -> ff.FitResult:
    return ff.fit("valve", LOGS[0], columns=COLUMNS)


def test_python_and_the_command_line_give_the_same_file(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "valve.yaml"
    columns = [word for r, h in COLUMNS.items() for word in ("--column", f"{r}={h}")]
    words = [
        "--window", ":6", "--validate-window", "6:", "--exclude", "trial2.csv:time=1:2",
        "--exclude-rows", "5:9", "--bounds", "damping_ratio=0.1:2", "--dead-time", "estimate",
    ]  # fmt: skip
    logs = [str(log) for log in LOGS[:2]]
    assert run(["valve", *logs, *columns, *words, "-q", "-o", str(path)]) == 0
    result = fit(
        LOGS[:2], window=(None, 6), validate_window=(6, None), exclude="trial2.csv:time=1:2",
        exclude_rows="5:9", bounds={"damping_ratio": (0.1, 2)}, dead_time="estimate",
    )  # fmt: skip
    due, found = ff.read_document(path), result.document
    assert found.parameters == due.parameters
    assert found.validation == due.validation
    assert len(found.validation) == 2
    assert [s.details for s in found.provenance.logs] == [s.details for s in due.provenance.logs]
    assert "exclude" in (found.provenance.logs[1].details or {})


def test_strict_refuses_what_the_command_line_refuses(fit: Fit, tmp_path: Path) -> None:
    text = LOGS[0].read_text(encoding="utf-8")
    unnamed = tmp_path / "unnamed.csv"
    unnamed.write_text(text.replace("[bar]", ""), encoding="utf-8")
    with pytest.raises(ff.StrictError, match=r"1 note under strict.*\n.*unit-assumed"):
        ff.fit_valve(unnamed, columns={**COLUMNS, "outlet": "Druck"}, strict=True)
    assert fit(LOGS[:1], strict=True).verdict == "pass"


def test_seconds_that_are_fitted_do_not_validate(fit: Fit) -> None:
    with pytest.raises(ff.UsageError, match="validate_window holds seconds that are fitted"):
        fit(LOGS[:1], window=(0, 6), validate_window=(5, None))
    with pytest.raises(ff.UsageError, match="an iterator gives them once"):
        fit(iter(LOGS[:1]), window=(0, 5), validate_window=(5, None))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"columns": {"command": 2}}, "number of a column as '#2'"),
        ({"columns": ["Sollwert [V]"]}, "not a mapping of role to value"),
        ({"units": "bar"}, "not a mapping of role to value"),
        ({"window": "0.5s:2s"}, "not a pair of times"),
        ({"window": 2}, "not a pair of times"),
        ({"window": ("0.5 V", "2s")}, "window: unit 'V' is a voltage"),
        ({"scales": {"outlet": "x"}}, "is not a number"),
        ({"sample_time": "ten"}, "sample_time: 'ten' is not a number"),
        ({"fixed": "dead_time=12 ms"}, "not a mapping of name to number"),
        ({"columns": {"command": 0}}, "number of a column as '#1', counted from 1"),
        ({"fixed": {5: 1.0}}, "not a mapping of name to number"),
        ({"columns": {0: "#1"}}, "not a mapping of name to value"),
        ({"units": {"outlet": 5}}, "units of outlet=5 is not text"),
        ({"scales": {"outlet": True}}, "is not a number"),
        ({"hold": "zoh"}, "hold='zoh' is not a mapping"),
        ({"bounds": [("gain", 1, 2)]}, "is not a mapping"),
        ({"steps": {"command": (0, 1)}}, r"Give for example .*StepInput\(0.0, 1.0, at=2.0\)"),
        ({"sample_time": 10**400}, "sample_time=<int> is not a number"),
        ({"window": (0, 10**5000)}, "end of window=<int> is not a number"),
        ({"controller_sample_time": True}, "is not a number"),
        ({"validate_window": 5}, "validate_window=5 is not a pair of times"),
        ({"decimal": 5}, "decimal=5 is not text"),
        ({"skip_rows": 1.5}, "skip_rows=1.5 is not a whole number"),
        ({"strict": "no"}, "strict='no' is not True or False"),
        ({"progress": 5}, "progress=5 is not a function"),
    ],
)
def test_keywords_of_another_kind_are_named(given: dict[str, object], words: str) -> None:
    """They ended in the TypeError or ValueError of whatever read them first."""
    with pytest.raises(ff.UsageError, match=words):
        ff.fit("valve", LOGS[0], **{"columns": COLUMNS, **given})


@pytest.mark.parametrize("family", [None, ["valve"], pd.DataFrame({"command": [0.0]})])
def test_a_family_that_is_no_name_is_refused(family: object) -> None:
    with pytest.raises(ff.UsageError, match="is not text"):
        ff.fit(family, LOGS[0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda result, folder: result.save(None), "path=None is not a file name"),
        (lambda result, folder: result.report(5), "path=5 is not a file name"),
        (lambda result, folder: result.save(folder / "a.yaml", overwrite="no"), "not True or"),
        (lambda result, folder: result.save(folder / "a.yaml", accept_failed="no"), "not True or"),
        (lambda result, folder: result.draws("x"), "n='x' is not a whole number"),
        (lambda result, folder: result.draws(2, seed=0.5), "seed=0.5 is not a whole number"),
        (lambda result, folder: ff.load(None), "path=None is not a file name"),
        (lambda result, folder: ff.load({}), "path={} is not a file name"),
        (lambda result, folder: ff.check(5, LOGS[0]), "path=5 is not a file name"),
        (lambda result, folder: ff.export(result, "json", 5), "folder=5 is not a file name"),
        (lambda result, folder: ff.export([], "json", folder), "no parameter file was given"),
        (lambda result, folder: ff.export([None], "json", folder), "paths=None is not a file name"),
        (lambda result, folder: ff.read_log(LOGS[0], columns=5), "is not a mapping"),
    ],
)
def test_arguments_of_another_kind_are_named(
    result: ff.FitResult, tmp_path: Path, call: Callable[..., object], words: str
) -> None:
    with pytest.raises(ff.UsageError, match=words):
        call(result, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_result_is_exported_as_its_file_would_be(result: ff.FitResult, tmp_path: Path) -> None:
    result.save(tmp_path / "valve.yaml")
    (direct,) = ff.export(result, "json", tmp_path / "a")
    (saved,) = ff.export(tmp_path / "valve.yaml", "json", tmp_path / "b")
    assert direct.read_text(encoding="utf-8") == saved.read_text(encoding="utf-8")


def test_a_keyword_that_does_not_exist_is_named(fit: Fit) -> None:
    with pytest.raises(ff.UsageError, match="Did you mean window"):
        fit(LOGS[0]).simulate(LOGS[1], windw=(0.0, 1.0))


def test_columns_are_found_where_only_the_brackets_of_a_unit_differ(
    fit: Fit, tmp_path: Path
) -> None:
    fit(LOGS[0]).save(tmp_path / "valve.yaml")
    text = LOGS[1].read_text(encoding="utf-8")
    for unit, brackets in (("bar", "(bar)"), ("kPa", "(kPa)")):
        log = tmp_path / f"{unit}.csv"
        log.write_text(text.replace("[V]", "(V)").replace("[bar]", brackets), encoding="utf-8")
    assert ff.check(tmp_path / "valve.yaml", tmp_path / "bar.csv").fits
    with pytest.raises(ff.LogError, match="outlet"):  # numbers in another unit are not these
        ff.check(tmp_path / "valve.yaml", tmp_path / "kPa.csv")


def test_times_are_taken_with_their_units(fit: Fit) -> None:
    plain = fit(LOGS[0], window=(0.0, 4.0), validate_window=(4.0, 6.0), controller_sample_time=0.02)
    same = fit(
        LOGS[0], window=(None, "4 s"), validate_window=("4000 ms", 6.0),
        controller_sample_time="20 ms",
    )  # fmt: skip
    assert same.parameters["gain"] == plain.parameters["gain"]
    assert same.document.validation == plain.document.validation
    assert same.document.model == plain.document.model


def test_numbers_are_taken_with_their_units(fit: Fit) -> None:
    plain = fit(LOGS[0], fixed={"gain": 9e4}, bounds={"natural_frequency": (5.0, 60.0)})
    same = fit(
        LOGS[0], fixed={"gain": "0.9 bar/V"}, bounds={"natural_frequency": ("5 rad/s", "60 rad/s")}
    )
    for name, quantity in plain.parameters.items():
        assert same.parameters[name].value == pytest.approx(quantity.value, rel=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fixed": {"gain": "1 bar"}}, "unit 'bar' is a pressure"),
        ({"fixed": {"gain": "much"}}, "'much' is not a number"),
        ({"fixed": {"gain": None}}, "is not a number"),
        ({"start": {"gian": "1 bar"}}, "names the single-valued parameter 'gian'"),
        ({"bounds": {"gain": (3.0, 2.0)}}, "3.0 is not below 2.0"),
        ({"bounds": {"gian": ("1 bar", "2 bar")}}, "names the single-valued parameter 'gian'"),
        ({"fixed": {"gain": True}}, "is a truth value"),
        ({"fixed": {"gain": 10**5000}}, "is not finite"),
        ({"bounds": {"gain": (0, 10**400)}}, "is not finite"),
        ({"seed": -1}, "seed=-1 is not a whole number from 0"),
        ({"hold": np.ones(2)}, "is not a mapping"),
        ({"fixed": np.ones(2)}, "is not a mapping"),
        ({"noise": np.ones(2)}, "is not a mapping"),
        ({"progress": np.ones(2)}, "is not a function"),
        ({"seed": "one"}, "seed='one' is not a whole number from 0"),
    ],
)
def test_numbers_that_are_none_are_named(fit: Fit, given: dict[str, object], words: str) -> None:
    with pytest.raises(ff.UsageError, match=words):
        fit(LOGS[0], **given)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ff.inspect([]), "no log was given"),
        (lambda: ff.inspect(LOGS[0], family=["line"]), r"family=\['line'\] is not text"),
        (lambda: ff.get_family({}), r"family=\{\} is not text"),
        (lambda: ff.export("a.yaml", ["c"], "."), r"to=\['c'\] is not text"),
        (lambda: ff.export("a.yaml", "c", ".", arithmetic=np.ones(2)), "is not text"),
        (lambda: ff.read_log(LOGS[0], exclude=3), "exclude #1=3 is not text"),
        (lambda: ff.read_log(LOGS[0], exclude=["run=1", 2]), "exclude #2=2 is not text"),
        (lambda: ff.read_log(LOGS[0], invalid=np.ones(2)), "is not text"),
    ],
)
def test_what_no_call_takes_is_named(call: Callable[[], object], words: str) -> None:
    with pytest.raises(ff.UsageError, match=words):
        call()


def test_a_refused_fit_names_the_term_that_describes_the_log() -> None:
    """ "Move faster" was the remedy for a mass on a spring: a model without one follows nowhere."""
    rng = np.random.default_rng(5)
    mass, damping, stiffness = 2.0, 60.0, 3000.0
    time = np.arange(3000) * 0.002
    force = np.repeat(rng.uniform(-20.0, 20.0, 12), 250)
    held = (np.arange(3000 * 5) * 0.0004, np.repeat(force, 5))
    _, fine, _ = lsim(([1.0], [mass, damping, stiffness]), held[1], held[0], interp=False)
    position = fine[::5] + rng.normal(0.0, 1e-5, 3000)
    log = {"time": time, "force": force, "position": position}
    with pytest.raises(ff.NotIdentifiedError, match="describes these logs") as e:
        ff.fit_hydrostatic(log, hold={"force": "zoh"})
    assert e.value.option == "--stiffness=estimate"
    found = ff.fit_hydrostatic(log, hold={"force": "zoh"}, stiffness="estimate").parameters
    assert found["mass"].number == pytest.approx(mass, rel=0.01)
    assert found["stiffness"].number == pytest.approx(stiffness, rel=0.01)


def test_what_a_declared_hold_of_a_measured_force_decides_is_told() -> None:
    """A hand's force declared a command: a mass 17 % off passed without a word."""
    log = DATA.parent / "hydrostatic" / "trial1.csv"
    columns = {"time": "t [s]", "force": "F [N]", "position": "x [mm]"}
    held = ff.fit_hydrostatic(log, columns=columns, hold={"force": "zoh"})
    (said,) = (n for n in held.notices if n.code == "hold-as-given")
    measured = ff.fit_hydrostatic(log, columns=columns, hold={"force": "smooth"})
    shift = measured.parameters["mass"].number - held.parameters["mass"].number
    told = re.search(r"mass would change by \+([\d.]+)", said.message)
    assert told is not None
    assert float(told[1]) == pytest.approx(shift, rel=0.05)
    assert not [n for n in measured.notices if n.code.startswith("hold-")]
