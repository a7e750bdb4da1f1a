"""What a fit in Python takes: everything that the command line takes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import fluidact_fit as ff
from fluidact_fit_cli.main import run

DATA = Path(__file__).parents[1] / "datasets" / "valve"
COLUMNS = {"time": "Zeit [s]", "command": "Sollwert [V]", "outlet": "Druck [bar]"}
LOGS = [DATA / f"trial{k}.csv" for k in (1, 2, 3)]
Fit = Callable[..., ff.FitResult]


@pytest.fixture
def fit() -> Fit:
    return lambda logs, **given: ff.fit_valve(logs, columns=COLUMNS, **given)


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
