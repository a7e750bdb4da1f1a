"""Estimates of one family brought to what all of them cover, before they are compared.

Some parameters depend on what a log happened to cover, such as control points over the range of its
readings. A family gives them over what is common (:meth:`.Family.in_common`); the covariance
follows by its derivatives, ``C' = J C J'``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from .experiment import FloatArray
from .family import Family, Quantity, Solution, Value
from .parameters.document import ParameterDocument
from .parameters.draws import pick, place_of
from .specification import entry_name

_STEP = 1e-3  # standard errors by which an estimate is moved for a derivative


@dataclass(frozen=True)
class Estimates:
    """Parameters, and the names ``(p,)`` and covariance ``(p, p)`` of those estimated [SI]."""

    quantities: Mapping[str, Quantity]
    order: tuple[str, ...]
    covariance: FloatArray

    @classmethod
    def of(cls, document: ParameterDocument) -> Self:
        """Estimates of a parameter file."""
        known = document.covariance
        order = () if known is None else tuple(known.order)
        matrix = np.zeros((0, 0)) if known is None else np.array(known.matrix, dtype=float)
        return cls(document.quantities(), order, matrix)

    @classmethod
    def of_fit(cls, solution: Solution[Any]) -> Self:
        """Estimates of a fit."""
        return cls(solution.parameters, solution.names, solution.noise.covariance)

    @property
    def values(self) -> dict[str, Value]:
        """Values by name."""
        return {name: q.value for name, q in self.quantities.items()}

    def vector(self) -> FloatArray:
        """Values of what has a covariance, ``(p,)``."""
        return pick(self.values, self.order)


def align(family: Family[Any], each: Sequence[Estimates]) -> tuple[list[Estimates], str]:
    """Bring estimates to what all of them cover.

    Returns
    -------
    The estimates, without those that have nothing in common, and a sentence on what that is: empty
    where nothing changed.
    """
    values, about = family.in_common([e.values for e in each])
    if not about:
        return list(each), ""
    return [_aligned(family, each, k, common) for k, common in enumerate(values)], about


def _aligned(
    family: Family[Any], each: Sequence[Estimates], k: int, common: Mapping[str, Value]
) -> Estimates:
    """Estimates ``k`` with the values that they have in common with the others."""
    own = each[k]
    errors = np.sqrt(np.maximum(np.diag(own.covariance), 0.0))
    order = tuple(dict.fromkeys(
        entry for name in (place_of(n)[0] for n in own.order) if name in common
        for entry in _entry_names(name, common[name])
    ))  # fmt: skip
    slopes = np.zeros((len(order), len(own.order)))
    for column, (name, error) in enumerate(zip(own.order, errors)):
        ends = []
        for step in (-_STEP * error, _STEP * error):
            others = [e.values for e in each]
            others[k] = _moved(own.values, name, step)
            ends.append(pick(family.in_common(others)[0][k], order))
        slopes[:, column] = (ends[1] - ends[0]) / (2.0 * _STEP * error) if error else 0.0
    matrix = slopes @ own.covariance @ slopes.T
    sizes = dict(zip(order, np.sqrt(np.maximum(np.diag(matrix), 0.0)).tolist()))
    quantities = {
        name: replace(q, value=common[name], std_error=_errors(name, common[name], sizes, q),
                      ci95=None)
        for name, q in own.quantities.items() if name in common
    }  # fmt: skip
    kept = [i for i, size in enumerate(sizes.values()) if size > 0.0]
    return Estimates(
        quantities, tuple(order[i] for i in kept), np.asarray(matrix[np.ix_(kept, kept)])
    )


def _errors(name: str, value: Value, sizes: Mapping[str, float], q: Quantity) -> Value | None:
    """Standard errors in the shape of a value, as far as it has any."""
    if q.std_error is None:
        return None
    flat = [sizes.get(entry, 0.0) for entry in _entry_names(name, value)]
    return flat[0] if np.ndim(value) == 0 else np.reshape(flat, np.shape(value)).tolist()


def _entry_names(name: str, value: Value) -> list[str]:
    """Names of the numbers of a value, as in ``control_points[2]``."""
    return [entry_name(name, at) for at in np.ndindex(np.shape(value))]


def _moved(values: Mapping[str, Value], name: str, step: float) -> dict[str, Value]:
    """Values of which one number is larger by a step."""
    head, at = place_of(name)
    array = np.array(values[head], dtype=float)
    array[at] += step
    return {**values, head: array.tolist()}
