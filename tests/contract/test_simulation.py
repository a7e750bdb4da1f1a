"""A file, simulated on the logs it was fitted to, gives the numbers that stand in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff

EXACT = 1e-9
PRINTED = 1e-6  # a table has twelve digits; what is left after a subtraction has fewer


def read_table(text: str) -> dict[str, np.ndarray]:
    """Columns of a CSV by header without its unit."""
    head, *rows = text.splitlines()
    numbers = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
    return {name.split(" [")[0]: numbers[:, i] for i, name in enumerate(head.split(","))}


def squares(table: dict[str, np.ndarray], output: str) -> tuple[float, int]:
    """Sum of squared residuals of the samples that are used, and their number."""
    residual = table[output] - table[f"{output}_simulated"]
    used = np.isfinite(residual)
    if "used" in table:
        used &= table["used"] != 0.0
    return float(np.sum(residual[used] ** 2)), int(used.sum())


def test_python_gives_the_rmse_of_the_file(trial: Any) -> None:
    from fluidact_fit.simulation import simulate_logs

    fit = trial.raw["fit"]
    runs = simulate_logs(trial.document, trial.read())
    assert [r.experiment.name for r in runs] == [entry["file"] for entry in fit["logs"]]
    used = [int(np.isfinite(r.measured).sum()) for r in runs]
    assert used == [entry["samples"] for entry in fit["logs"]]
    due = [entry["rmse"]["value"] for entry in fit["logs"]]
    assert [r.rmse for r in runs] == pytest.approx(due, rel=EXACT, abs=0.0)
    total = sum(n * r.rmse**2 for n, r in zip(used, runs))
    assert np.sqrt(total / sum(used)) == pytest.approx(fit["rmse"]["value"], rel=EXACT, abs=0.0)


def test_each_log_alone_gives_its_rmse(trial: Any, here: Callable[..., Any]) -> None:
    output = trial.variant.output.name
    for log, entry in zip(trial.logs, trial.raw["fit"]["logs"]):
        done = here("simulate", trial.path, log)
        assert done.status == 0, done.err
        total, used = squares(read_table(done.out), output)
        assert used == entry["samples"], log.name
        assert np.sqrt(total / used) == pytest.approx(
            entry["rmse"]["value"], rel=PRINTED, abs=0.0
        ), log.name


def test_all_logs_together_give_the_rmse_of_the_file(
    trial: Any, here: Callable[..., Any], tmp_path: Path
) -> None:
    target, fit = tmp_path / "simulated.csv", trial.raw["fit"]
    done = here("simulate", trial.path, *trial.logs, "-o", target)
    assert done.status == 0, done.err
    for log in trial.logs:
        assert re.search(rf"{re.escape(log.name)}\b.*rmse", done.out + done.err), log.name
    total, used = squares(read_table(target.read_text(encoding="utf-8")), trial.variant.output.name)
    assert used == fit["samples"]
    assert np.sqrt(total / used) == pytest.approx(fit["rmse"]["value"], rel=PRINTED, abs=0.0)


def test_inputs_that_step_are_simulated_or_refused(trial: Any, here: Callable[..., Any]) -> None:
    raw = trial.raw
    step = raw["provenance"]["logs"][0].get("sample_time") or 0.01
    words = []
    for role in trial.inputs:
        covered = raw["validity"].get(role, {"low": 0.0, "high": 1.0})
        words += ["--input", f"{role}={covered['low']}:{covered['high']}@{20 * step:.9g}"]
    time = ["--duration", f"{80 * step:.9g}", "--sample-time", f"{step:.9g}"]
    done = here("simulate", trial.path, *words, *time)
    assert done.status in (0, 2), done.err
    if done.status == 0:
        simulated = read_table(done.out)[f"{trial.variant.output.name}_simulated"]
        assert simulated.size == 81
        assert np.isfinite(simulated).all()
    else:
        assert done.err.strip(), "the message says why not"


def test_an_output_is_no_input(trial: Any, here: Callable[..., Any]) -> None:
    """A step of what the model gives would be ignored: it is refused."""
    document = ff.read_document(trial.path)
    output = ff.get_family(document.family).variant(document.variant).output.name
    words = ["--input", f"{output}=0:1", "--duration", "1", "--sample-time", "0.1"]
    for role in trial.inputs:
        words += ["--input", f"{role}=0:1"]
    done = here("simulate", trial.path, *words)
    assert done.status == 2, done.err
    assert f"--input names the input '{output}', which does not exist here" in done.err
