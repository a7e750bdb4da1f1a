"""A number of a fit has one unit wherever people read it: that of its log."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff
from fluidact_fit.report import plot_result
from fluidact_fit.report.page import document_page, result_page

DATA = Path(__file__).parents[2] / "datasets/valve"
COLUMNS = {"time": "#1", "command": "#2", "outlet": "#3"}


@pytest.fixture(scope="module")
def result() -> Any:
    """Fit of a log in V and bar; SI would be Pa/V."""
    return ff.fit("valve", DATA / "trial1.csv", columns=COLUMNS)


def unit_of(table: Any, name: str) -> str:
    row = next(row for row in table.rows if row[0] == name)
    return str(row[table.head.index("unit")])


def test_gain_is_in_bar_per_volt_in_every_table(result: Any) -> None:
    document, changed = result.document, ff.check(result, DATA / "trial2.csv")
    for table in (result.table(), changed.table(), ff.compare(result, result).table()):
        assert unit_of(table, "gain") == "bar/V"
    for page in (result_page(result), document_page(document, (), ff.compare(result, result))):
        assert re.search(r"<code>gain</code>.{0,300}?<td>bar/V</td>", page, re.DOTALL)


def test_rmse_is_the_same_in_summary_picture_and_page(result: Any) -> None:
    drawn = " ".join(t.get_text() for t in plot_result(result).texts)
    assert "rmse 992.4 Pa" in result.summary()
    for text in (drawn, result_page(result), repr(result)):
        assert "rmse 992 Pa" in text or "rmse 992.4 Pa" in text


def test_a_moved_parameter_is_told_in_the_same_unit(result: Any) -> None:
    stronger = ff.read_log(DATA / "trial2.csv", columns=COLUMNS, scales={"outlet": 1.2})
    (moved,) = [r for r in ff.check(result, stronger).reasons if r.startswith("gain moved")]
    assert re.search(r"from 0\.9\d* to 1\.0\d* bar/V \(\+(19|20)\.\d+ %\)", moved), moved
