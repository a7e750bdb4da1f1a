"""Parameters drawn from the covariance of a file, within the ranges that they can have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..experiment import FloatArray
from ..specification import Value, Variant
from .document import ParameterDocument

_ATTEMPTS = 1000


def draw_values(
    document: ParameterDocument, variant: Variant, rng: np.random.Generator, number: int
) -> FloatArray:
    """Draw what a file estimated, shape ``(number, p)`` in the order of its covariance [SI].

    A draw beyond the physical range of a parameter, or the bounds that it was fitted within, is
    drawn again; should that never end, it is cut off there.
    """
    covariance = document.covariance
    if covariance is None or not covariance.order:
        return np.zeros((number, 0))
    mean = pick(document.values(), covariance.order)
    bounds = (document.provenance.options or {}).get("bounds", {})
    low, high = np.array([_range(variant, bounds, name) for name in covariance.order]).T
    low, high = np.minimum(low, mean), np.maximum(high, mean)
    root = _root(covariance.matrix)
    out = np.empty((number, mean.size))
    for row in out:
        for _ in range(_ATTEMPTS):
            row[:] = mean + root @ rng.standard_normal(mean.size)
            if ((row >= low) & (row <= high)).all():
                break
    return np.clip(out, low, high)


def draw_document(
    document: ParameterDocument, variant: Variant, rng: np.random.Generator
) -> ParameterDocument:
    """A document with parameters drawn from its covariance (:func:`draw_values`)."""
    if document.covariance is None:
        return document
    (found,) = draw_values(document, variant, rng, 1)
    return with_values(document, dict(zip(document.covariance.order, found.tolist())))


def with_values(document: ParameterDocument, drawn: Mapping[str, float]) -> ParameterDocument:
    """The document with other parameters, those of lists by their places: ``weights_1[2][0]``."""
    parameters = dict(document.parameters)
    arrays = {
        n: np.array(parameters[n].value, dtype=float) for n in {place_of(d)[0] for d in drawn}
    }
    for name, value in drawn.items():
        head, indices = place_of(name)
        arrays[head][indices] = value
    for name, array in arrays.items():
        parameters[name] = parameters[name].model_copy(update={"value": array.tolist()})
    return document.model_copy(update={"parameters": parameters})


def place_of(name: str) -> tuple[str, tuple[int, ...]]:
    """Parameter and indices of ``weights_1[2][0]``."""
    head, *rest = name.split("[")
    return head, tuple(int(part.rstrip("]")) for part in rest)


def _root(matrix: Sequence[Sequence[float]]) -> FloatArray:
    """A root of a covariance matrix, by its correlations: units may differ by many powers."""
    full = np.array(matrix, dtype=float)
    scale = np.sqrt(np.diag(full))
    known = np.where(scale == 0.0, 1.0, scale)
    size, vectors = np.linalg.eigh(full / np.outer(known, known))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(size, 0.0)))


def pick(values: Mapping[str, Value], order: Sequence[str]) -> FloatArray:
    """Numbers named as in ``control_points[2]``, ``(p,)``."""
    places = map(place_of, order)
    return np.array([np.array(values[head], dtype=float)[at] for head, at in places])


def _range(
    variant: Variant, bounds: Mapping[str, Sequence[float]], name: str
) -> tuple[float, float]:
    head = place_of(name)[0]
    spec, (low, high) = variant.parameter(head), bounds.get(head, (-np.inf, np.inf))
    return max(spec.minimum, low), min(spec.maximum, high)
