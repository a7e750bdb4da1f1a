"""What a fit in Python returns, and that it does not matter how the samples are filed."""

from __future__ import annotations

import inspect
import json
import re
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.options import describe
from fluidact_fit.parameter_table import recorded_units
from fluidact_fit.tables import format_spread
from fluidact_fit.units import display_unit

SAME = 0.1  # standard errors


def test_runs_of_one_log_and_several_logs_give_the_same(trial: Any, result: ff.FitResult) -> None:
    raw = trial.raw
    assert set(result.parameters) == set(raw["parameters"])
    apart = []
    for name, due in raw["parameters"].items():
        found = result.parameters[name]
        assert found.status == due["status"], name
        value, other = np.asarray(found.value), np.asarray(due["value"])
        assert value.shape == other.shape, name
        error = np.asarray(due.get("std_error", 0.0), dtype=float)
        allowed = np.maximum(SAME * error, 1e-6 * np.abs(other))
        if np.any(np.abs(value - other) > allowed):
            apart.append((name, found.value, due["value"], due.get("std_error")))
    assert not apart
    assert result.verdict == raw["fit"]["verdict"]


def test_a_result_is_readable(result: ff.FitResult) -> None:
    text = repr(result)
    assert result.family in text
    assert result.verdict in text.lower()
    assert len(text) < 300


def test_a_summary_names_every_parameter(result: ff.FitResult) -> None:
    text, page = result.summary(), result._repr_html_()
    units = recorded_units(result.document)
    for name, quantity in result.parameters.items():
        assert name in text
        assert name in page
        if quantity.status != "estimated":
            assert quantity.status.replace("_", " ") in text
        elif isinstance(quantity.std_error, float):
            shown = display_unit(quantity.unit, abs(quantity.number), units)
            error = format_spread(quantity.std_error * shown.factor)
            assert f"± {error}" in text
            assert f"± {error}" in page
    assert result.verdict in text.lower()
    assert result.verdict.upper() in page
    assert "<table" in page
    for notice in result.notices:
        assert f"({notice.code})" in text
        assert f"({notice.code})" in page


def test_a_result_simulates_a_log(
    trial: Any, result: ff.FitResult, joined: Path, tmp_path: Path
) -> None:
    from fluidact_fit.simulation import simulate_logs

    path = joined if "time" in trial.columns else trial.logs[0]
    (log,) = trial.read([path])
    runs = result.simulate(log)
    document = ff.read_document(result.save(tmp_path / "result.yaml"))
    due = simulate_logs(document, [log])
    assert len(runs) == len(due)
    for run, other in zip(runs, due):
        assert run.rmse == pytest.approx(other.rmse, rel=1e-9, abs=0.0)
        np.testing.assert_array_equal(run.simulated, other.simulated)


def test_a_result_holds_the_document_it_saves(result: ff.FitResult, tmp_path: Path) -> None:
    saved = ff.read_document(result.save(tmp_path / "result.yaml"))
    assert without_details(saved) == without_details(result.document)


def without_details(document: ff.ParameterDocument) -> dict[str, Any]:
    """The document but for what the file keeps in part."""
    plain = document.to_dict()
    return {**plain, "fit": {k: v for k, v in plain["fit"].items() if k != "details"}}


def test_a_file_keeps_the_short_details(result: ff.FitResult, tmp_path: Path) -> None:
    path = result.save(tmp_path / "result.yaml")
    kept = ff.read_document(path).fit.details or {}
    assert kept.items() <= (result.document.fit.details or {}).items()
    lines = path.read_text(encoding="utf-8").splitlines()
    begin = next(k for k, x in enumerate(lines) if x.startswith("  details:"))
    end = next(k for k, x in enumerate(lines[begin + 1 :], begin + 1) if not x.startswith("    "))
    assert end - begin <= 21


def test_values_have_four_digits_beyond_their_errors(result: ff.FitResult) -> None:
    for name, q in result.parameters.items():
        if q.std_error is None:
            continue
        pairs = zip(np.ravel(q.value), np.ravel(q.std_error))
        for value, error in ((v, e) for v, e in pairs if e > 0.0):
            places = max(4 - floor(log10(error)), 3 - floor(log10(abs(value) or 1.0)))
            assert value == round(float(value), places), name


def test_a_result_and_a_loaded_model_say_the_same(result: ff.FitResult, tmp_path: Path) -> None:
    path = result.save(tmp_path / "result.yaml", accept_failed=True)
    model = ff.load(path, accept_failed=True)
    assert model.summary() == result.summary()
    assert model._repr_html_() == result._repr_html_()
    assert model.to_dataframe().equals(result.to_dataframe())
    for name in ("verdict", "family", "not_identified", "validity"):
        assert getattr(model, name) == getattr(result, name), name


def test_a_table_has_every_number_with_its_uncertainty(result: ff.FitResult) -> None:
    table = result.to_dataframe()
    for name, q in result.parameters.items():
        rows = table[[label.partition("[")[0] == name for label in table.index]]
        assert len(rows) == np.size(q.value), name
        np.testing.assert_array_equal(rows["value"], np.ravel(q.value))
        assert {*rows["status"]} == {q.status}
        assert {*rows["unit"]} == {q.unit}
        if q.std_error is not None:
            np.testing.assert_array_equal(rows["std_error"], np.ravel(q.std_error))
        if q.status == "not_identified":
            assert rows["reason"].str.startswith(name).all()
    derived = result.to_dataframe(derived=True)
    assert {*derived.index} - {*table.index} >= {
        n for n, q in result.derived.items() if not isinstance(q.value, list)
    }


def test_draws_scatter_as_the_covariance_says(result: ff.FitResult) -> None:
    if result.document.covariance is None:
        with pytest.raises(ff.UsageError, match="no covariance"):
            result.draws()
        return
    drawn = result.draws(400, seed=1)
    assert drawn.equals(result.draws(400, seed=1))
    assert dict(drawn.sizes)["draw"] == 400
    assert result.draws(5, chains=3).sizes["chain"] == 3
    for name, array in drawn.items():
        q, spec = result.parameters[str(name)], result.variant.parameter(str(name))
        assert array.shape == (1, 400, *np.shape(q.value))
        assert array.attrs["units"] == q.unit
        assert float(array.min()) >= min(spec.minimum, np.min(q.value))
        assert float(array.max()) <= max(spec.maximum, np.max(q.value))
        errors = np.asarray(q.std_error, dtype=float)
        # 400 draws tell a standard deviation to 3.5 %; one that is cut off is smaller
        assert (np.std(array.values[0], axis=0) <= 1.2 * errors + 1e-300).all(), name


def test_samples_of_the_input_are_simulated_as_the_model_does(result: ff.FitResult) -> None:
    role = result.variant.driving[0].name if result.variant.driving else ""
    run = result.experiments[0]
    if not hasattr(result.model, "simulate_samples"):
        with pytest.raises(ff.UsageError, match="does not simulate samples"):
            result.simulate(np.zeros(3))
        return
    u, t = run.sampled(role), run.time
    due = result.model.simulate(u, t, hold="foh")
    np.testing.assert_array_equal(result.simulate(u, t, hold="foh"), due)
    np.testing.assert_array_equal(
        result.simulate(u[:20].tolist()), result.model.simulate(u[:20].tolist())
    )


def test_a_loaded_model_simulates_the_logs_that_a_result_does(
    trial: Any, result: ff.FitResult
) -> None:
    block = ff.load(trial.path, accept_failed=True, accept_not_identified=True)
    for found, due in zip(block.simulate(trial.logs[0]), result.simulate(trial.logs[0])):
        np.testing.assert_array_equal(found.measured, due.measured)
        np.testing.assert_allclose(found.simulated, due.simulated, rtol=1e-9, atol=1e-12)


def test_python_checks_as_the_command_line_does(
    trial: Any, here: Any, result: ff.FitResult
) -> None:
    found = ff.check(trial.path, list(trial.logs))
    due = json.loads(here("check", trial.path, *trial.logs, "--json").out)
    assert json.loads(json.dumps(found.to_dict())) == due
    found.raise_for_mismatch()
    for text in (found.summary(), found._repr_html_()):
        assert "still fits" in text
        assert all(log.file in text for log in found.logs)
        assert all(drift.name in text for drift in found.drifts)
    columns = trial.columns if "time" in trial.columns else {}
    assert ff.check(result, trial.logs[0], columns=columns).family == trial.family


def test_every_family_has_a_function_with_its_options(trial: Any) -> None:
    function = getattr(ff, "fit_" + trial.family.replace("-", "_"))
    assert function.__name__ in dir(ff)
    options = ff.get_family(trial.family).options_type
    declared = {o.name.replace("-", "_"): o.default for o in describe(options)}
    parameters = inspect.signature(function).parameters
    assert {n: parameters[n].default for n in declared} == declared
    for name in [n for n in parameters if n != "set"]:
        assert re.search(rf"^    (\w+, )*{name}(, \w+)*$", function.__doc__, re.MULTILINE), name
    for role in trial.variant.roles:
        assert f"``{role.name}`` [" in function.__doc__
    with pytest.raises(TypeError, match="no_such_option"):
        function(list(trial.logs), no_such_option=1)
    found = function(list(trial.logs), columns=trial.columns, **trial.options)
    due = trial.raw["parameters"]
    assert {n: q.value for n, q in found.parameters.items()} == {n: due[n]["value"] for n in due}
