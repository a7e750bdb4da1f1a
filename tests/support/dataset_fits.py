"""The fit of a whole dataset, made once in a process for all tests that look at it."""

from __future__ import annotations

from functools import cache

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.result import FitResult


@cache
def fit_dataset(family: str) -> FitResult:
    """The fit of the README; nobody changes it."""
    dataset = load_dataset(family)
    return ff.fit(family, dataset.read(), **dataset.options)
