"""What a fit in Python returns, and that it does not matter how the samples are filed."""

from __future__ import annotations

from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff

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
    for name, quantity in result.parameters.items():
        assert name in text
        assert name in page
        if quantity.status != "estimated":
            assert quantity.status.replace("_", " ") in text
        elif isinstance(quantity.std_error, float):
            assert f"± {quantity.std_error:.2g}" in text
            assert f"± {quantity.std_error:.2g}" in page
    assert result.verdict in text.lower()
    assert "<table" in page


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
