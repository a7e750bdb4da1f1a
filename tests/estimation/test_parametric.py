"""Named fits: what the search stops is not measured."""

from __future__ import annotations

import numpy as np
import pytest

from fluidact_fit.errors import NotIdentifiedError
from fluidact_fit.estimation.named_model import NamedModel, Values, bind, make_unknowns
from fluidact_fit.estimation.parametric import fit_named
from fluidact_fit.estimation.problem import Basis, Unknown
from fluidact_fit.estimation.separable import solve
from fluidact_fit.family import FamilyOptions, ParameterSpec, Request

TIME = np.linspace(0.0, 1.0, 100)
SPEC = (ParameterSpec("rate", "1/s", "rate of decay", minimum=0.0, remedy="Sample faster."),)


def decay(index: int, values: Values) -> Basis:
    return Basis(np.exp(-values["rate"] * TIME))


def fit(fastest: float = 5.0, **request: tuple[float, float]) -> float:
    noise = 1e-3 * np.random.default_rng(1).standard_normal(100)
    model = NamedModel(("rate",), (), decay, [np.exp(-9.0 * TIME) + noise])
    asked = Request(options=FamilyOptions(), bounds=request)
    unknowns = make_unknowns(SPEC, ("rate",), {"rate": 1.0}, asked, {"rate": (0.1, fastest)})
    return fit_named(model, SPEC, asked, unknowns, [{"rate": 1.0}]).values["rate"]


def test_a_value_on_a_limit_of_the_search_is_refused() -> None:
    with pytest.raises(NotIdentifiedError, match="at the search limit"):
        fit()


def test_a_value_whose_interval_reaches_across_the_limit_is_refused() -> None:
    """The standard error is 0.0055: a search to 9.3 measured the rate, one to 9.005 stopped it."""
    assert fit(9.3) == pytest.approx(9.0, abs=0.02)
    with pytest.raises(NotIdentifiedError, match="at the search limit"):
        fit(9.005)


def test_a_value_on_a_bound_that_was_given_is_a_result() -> None:
    assert fit(rate=(0.1, 8.9)) == pytest.approx(8.9)
    assert fit(rate=(0.1, 20.0)) == pytest.approx(9.0, rel=0.01)


def test_readings_of_a_converter_are_weighed_as_their_residuals_are() -> None:
    """Two logs, every residual times the same number: no interval changes."""
    x = np.repeat(np.tile([-1.0, -0.61, -0.2, 0.27, 0.6, 1.0], 4), 20)
    step, y = 0.1, 1.37 + 1.23 * x
    coarse = step * np.round((y + 1e-3 * np.random.default_rng(3).standard_normal(x.size)) / step)

    def line(index: int, values: Values) -> Basis:
        return Basis(np.zeros(x.size), [np.ones(x.size), x])

    model = NamedModel(
        (), ("level", "slope"), line, [coarse, coarse], resolutions=[step] * 2, logs=[0, 1],
    )  # fmt: skip
    unknowns = {name: Unknown(name) for name in model.linear}
    errors = []
    for factor in (1.0, 7.3):
        scaled = model.scaled({0: factor, 1: factor})
        found = solve(bind(scaled, unknowns, {}), np.zeros(0))
        errors.append(np.diag(scaled.uncertainty(found).covariance))
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-6)
