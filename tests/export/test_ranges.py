"""Intervals with errors: they hold whatever is drawn from them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from fluidact_fit.export import ranges
from fluidact_fit.export.ranges import Range
from fluidact_fit.routines.expression import Choose, Name

Array = npt.NDArray[np.float64]
LOWER = Choose(Name("a"), "<", Name("b"), Name("a"), Name("b"))
TWO: dict[str, tuple[Callable[[Range, Range], Range], Callable[[Array, Array], Array]]] = {
    "plus": (ranges.plus, np.add),
    "minus": (ranges.minus, np.subtract),
    "times": (ranges.times, np.multiply),
    "over": (ranges.over, np.divide),
    "min": (lambda a, b: ranges.extreme(a, b, "min"), np.minimum),
    "max": (lambda a, b: ranges.extreme(a, b, "max"), np.maximum),
    "choose": (lambda a, b: ranges.choose(LOWER, (a, b), a, b), lambda a, b: np.where(a < b, a, b)),
}
ONE: dict[str, Callable[[Array], Array]] = {
    "neg": np.negative, "abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log,
}  # fmt: skip


def draw(rng: np.random.Generator, least: float) -> tuple[Range, Array, Array]:
    """Boxes, and an exact and a computed value in each."""
    ends = np.sort(rng.uniform(least, 3.0, (2, 4000)), axis=0)
    error = rng.choice([0.0, 0.05, 0.4], 4000)
    share = rng.choice([0.0, 1.0, 0.3, 0.8], 4000)
    exact = ends[0] + share * (ends[1] - ends[0])
    return Range(ends[0], ends[1], error), exact, exact + error * rng.uniform(-1.0, 1.0, 4000)


@pytest.mark.parametrize("name", TWO)
def test_an_operation_holds_what_is_drawn(name: str) -> None:
    rng = np.random.default_rng(2)
    rule, function = TWO[name]
    a, x, near_x = draw(rng, -3.0)
    b, y, near_y = draw(rng, 0.5 if name == "over" else -3.0)
    found, exact, near = rule(a, b), function(x, y), function(near_x, near_y)
    assert np.all((found.low <= exact + 1e-12) & (exact <= found.high + 1e-12))
    assert np.all(np.abs(near - exact) <= found.error + 1e-12)


@pytest.mark.parametrize("name", ONE)
def test_a_function_holds_what_is_drawn(name: str) -> None:
    x, exact, near = draw(np.random.default_rng(4), 0.5)
    found = ranges.unary(name, x)
    value, other = ONE[name](exact), ONE[name](near)
    assert np.all((found.low <= value + 1e-12) & (value <= found.high + 1e-12))
    assert np.all(np.abs(other - value) <= found.error + 1e-12)


def test_the_error_of_a_maximum_is_that_of_the_side_which_is_surely_larger() -> None:
    large, small = (Range(*(np.array([v]) for v in ends)) for ends in ((5, 6, 0.1), (0, 0, 0.0)))
    for a, b in ((large, small), (small, large)):
        assert ranges.extreme(a, b, "max").error.tolist() == [0.1]
        assert ranges.extreme(a, b, "min").error.tolist() == [0.0]
