"""Tables, summaries and draws of a document."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.parameters.document import WarningEntry
from fluidact_fit.tables import Table

GOLDEN = Path(__file__).parent / "golden" / ff.__version__


@pytest.fixture
def model() -> Any:
    return ff.load(GOLDEN / "valve.yaml", accept_failed=True)


def with_document(model: Any, **changes: Any) -> Any:
    """The model with another document, which nothing but its presentation reads."""
    model.document = model.document.model_copy(update=changes)
    return model


def test_draws_stay_within_the_bounds_of_the_fit(model: Any) -> None:
    gain = model.document.parameters["gain"]
    bounds = [gain.value, gain.value + gain.std_error]
    options = {"options": {"bounds": {"gain": bounds}}}
    provenance = model.document.provenance.model_copy(update=options)
    drawn = with_document(model, provenance=provenance).draws(200)["gain"]
    assert bounds[0] <= float(drawn.min())
    assert float(drawn.max()) <= bounds[1]
    assert float(drawn.std()) > 0.0


def test_without_xarray_the_remedy_is_named(model: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ff.UsageError, match=r"pip install 'fluidact-fit\[xarray\]'"):
        model.draws()


def test_a_parameter_that_was_not_identified_says_why(model: Any) -> None:
    zeta = model.document.parameters["damping_ratio"]
    lost = {"damping_ratio": zeta.model_copy(update={"status": "not_identified", "value": 0.0,
                                                     "std_error": None, "ci95": None})}  # fmt: skip
    warning = WarningEntry(code="not-identified", message="damping_ratio is lost. Give --fix.")
    parameters = {**model.document.parameters, **lost}
    found = with_document(model, parameters=parameters, warnings=[warning]).to_dataframe()
    assert found.loc["damping_ratio", "status"] == "not_identified"
    assert found.loc["damping_ratio", "reason"] == "damping_ratio is lost. Give fixed."
    assert np.isnan(found.loc["damping_ratio", "std_error"])
    assert found.loc["gain", "reason"] == ""
    assert "not identified" in repr(model.table())


def test_texts_of_a_file_are_no_markup(model: Any) -> None:
    entry = WarningEntry(code="<b>", message="<script>alert(1)</script>")
    page = with_document(model, warnings=[entry])._repr_html_()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "<i>" not in Table(("<i>",), (("<i>",),))._repr_html_()
    assert "warning (<b>)" in model.summary()


def test_a_long_list_is_counted(model: Any) -> None:
    block = ff.load(GOLDEN / "force-map.yaml", accept_failed=True)
    assert " x " in next(row[1] for row in block.table().rows if row[0] == "weights_1")
    assert "weights_1[0][0]" in block.to_dataframe().index


@pytest.mark.parametrize("asked", [{"n": 0}, {"n": -1}, {"n": 5, "seed": -1}, {"chains": 0}])
def test_draws_that_cannot_be_are_refused(model: Any, asked: dict[str, int]) -> None:
    with pytest.raises(ff.UsageError, match="1 or more"):
        model.draws(**asked)
