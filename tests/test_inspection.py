"""``fluidact_fit.inspect``: what the command shows, as an object."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit_cli.main import run

LINE = Path(__file__).parents[1] / "datasets" / "line" / "trial1.csv"


def test_the_object_holds_what_the_command_writes(capsys: pytest.CaptureFixture[str]) -> None:
    found = ff.inspect(LINE, trial=False)
    assert run(["inspect", str(LINE), "--no-trial", "--json"]) == 0
    assert json.loads(json.dumps(found.to_dict())) == json.loads(capsys.readouterr().out)
    assert found.suggestions[0].family == "line"


def test_a_notebook_shows_columns_and_the_command() -> None:
    found = ff.inspect(LINE, trial=False)
    page = found._repr_html_()
    assert page.count("<table>") == 2
    assert "<p>next: fluidact-fit line" in page
    assert "p_chamber (bar)" in repr(found.table())
    assert found.suggestions[0].command in found.summary()


def test_candidates_stand_in_the_table_of_families() -> None:
    rng = np.random.default_rng(1)
    table = np.column_stack([0.01 * np.arange(300), *rng.normal(size=(3, 300))])
    found = ff.inspect(table, trial=False)
    assert "force=#2|#3|#4" in repr(found.family_table())
    assert "Neither names nor units" in found.summary()


def test_a_family_that_cannot_use_the_log_is_refused() -> None:
    with pytest.raises(ff.LogError, match="force"):
        ff.inspect(LINE, "hydrostatic", trial=False)
