"""Named fits: what the search stops is not measured."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.errors import NotIdentifiedError
from fluidact_fit.estimation.named_model import NamedModel, Values, make_unknowns
from fluidact_fit.estimation.parametric import fit_named
from fluidact_fit.estimation.problem import Basis
from fluidact_fit.family import FamilyOptions, ParameterSpec, Request

TIME = np.linspace(0.0, 1.0, 100)
SPEC = (ParameterSpec("rate", "1/s", "rate of decay", minimum=0.0, remedy="Sample faster."),)


def decay(index: int, values: Values) -> Basis:
    return Basis(np.exp(-values["rate"] * TIME), np.zeros((100, 0)), np.zeros((100, 0)))


def fit(fastest: float = 5.0, **request: tuple[float, float]) -> float:
    noise = 1e-3 * np.random.default_rng(1).standard_normal(100)
    model = NamedModel(("rate",), (), decay, [np.exp(-9.0 * TIME) + noise])
    asked = Request(options=FamilyOptions(), bounds=request)
    unknowns = make_unknowns(SPEC, ("rate",), {"rate": 1.0}, asked, {"rate": (0.1, fastest)})
    return fit_named(model, SPEC, asked, unknowns, [{"rate": 1.0}]).values["rate"]


def test_a_value_on_a_limit_of_the_search_is_refused() -> None:
    with pytest.raises(NotIdentifiedError, match="as far as the search goes"):
        fit()


def test_a_value_whose_interval_reaches_across_the_limit_is_refused() -> None:
    """The standard error is 0.0055: a search to 9.3 measured the rate, one to 9.005 stopped it."""
    assert fit(9.3) == pytest.approx(9.0, abs=0.02)
    with pytest.raises(NotIdentifiedError, match="as far as the search goes"):
        fit(9.005)


def test_a_value_on_a_bound_that_was_given_is_a_result() -> None:
    assert fit(rate=(0.1, 8.9)) == pytest.approx(8.9)
    assert fit(rate=(0.1, 20.0)) == pytest.approx(9.0, rel=0.01)
