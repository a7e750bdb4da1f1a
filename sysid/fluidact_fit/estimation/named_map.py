"""Static maps whose unknowns are named numbers: fit, refuse what is not determined, fit again.

A family gives its equation as a plain function of named values, analytic in them, and says where
a search begins; derivatives are taken by complex steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ..errors import Notice
from ..experiment import Array, BoolArray, Experiment, FloatArray, Signal
from ..options import FamilyOptions
from ..specification import STEP, ParameterSpec, Quantity, Request, Simulate, Variant
from .map import (
    AT_ODDS,
    MapFit,
    MapRows,
    Misfit,
    excess_tail,
    find_misfit,
    find_uncertainty,
    fit_map,
)
from .parametric import PROFILED
from .profile_likelihood import profile_interval
from .results import Refusal, Solved, determine, find_uninformative
from .significance import CERTAIN, DECISIVE
from .solution import NoiseModel, Solution, make_solution
from .uncertainty import information_units, t_quantile, widen_by

OptionsT = TypeVar("OptionsT", bound=FamilyOptions)
Law = Callable[[Mapping[str, Any], FloatArray], Array]


@dataclass(frozen=True)
class NamedMap:
    """A :class:`.map.MapModel` of named values; ``held`` ones are known.

    ``law(values, x)`` is the map at inputs ``(n, inputs)``, shape ``(n,)``, analytic in the values.
    """

    law: Law
    names: tuple[str, ...]
    held: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Limits of the free values."""
        low, high = np.array([self.limits[n] for n in self.names]).reshape(-1, 2).T
        return low, high

    @property
    def linear(self) -> BoolArray:
        """None of the values: nothing is known of the law."""
        return np.zeros(len(self.names), dtype=bool)

    def values(self, theta: Array) -> dict[str, Any]:
        """All values by name."""
        return {**self.held, **dict(zip(self.names, theta))}

    def value(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """The map."""
        return np.asarray(self.law(self.values(theta), x), dtype=float)

    def slopes(self, theta: FloatArray, x: FloatArray) -> FloatArray:
        """Derivatives by the free values."""
        out = np.zeros((x.shape[0], theta.size), order="F")
        for k in range(theta.size):
            moved = theta.astype(complex)
            moved[k] += 1j * STEP
            out[:, k] = np.imag(self.law(self.values(moved), x)) / STEP
        return out


@dataclass(frozen=True)
class NamedRows:
    """Samples of all logs: inputs ``(n, inputs)`` and output ``(n,)``, cut at ``ends`` by log.

    Samples that are ``in_order`` follow one another in time. ``steps`` are those of the converter
    of the output, by log.
    """

    x: FloatArray
    y: FloatArray
    ends: tuple[int, ...]
    steps: tuple[float, ...]
    in_order: bool

    @classmethod
    def of(
        cls, inputs: Sequence[FloatArray], outputs: Sequence[Signal], in_order: bool
    ) -> NamedRows:
        """Rows of logs whose inputs are ``(n_i, inputs)`` and outputs ``(n_i,)``."""
        ends = tuple(np.cumsum([y.values.size for y in outputs]).tolist())
        steps = tuple(y.resolution for y in outputs)
        values = np.concatenate([y.values for y in outputs])
        return cls(np.vstack(inputs), values, ends, steps, in_order)

    @property
    def readings(self) -> list[tuple[FloatArray, float]]:
        """Output of every log with the step of its converter."""
        return list(zip(self.by_log(self.y), self.steps, strict=True))

    def by_log(self, values: Array) -> list[Array]:
        """Rows of every log."""
        return np.split(values, self.ends[:-1])

    @property
    def rows(self) -> MapRows:
        """The same for a fit."""
        return MapRows(self.x, self.y, np.broadcast_to(1.0, self.y.shape))


@dataclass(frozen=True)
class NamedFit:
    """A finished fit: values with covariance, notices of refusals, and what it leaves.

    ``jacobian`` has a column for each of ``solved.names``, shape ``(n, q)``.
    """

    solved: Solved
    notices: list[Any]
    fit: MapFit[NamedMap]
    data: NamedRows
    jacobian: FloatArray
    misfit: Misfit | None

    @property
    def residual(self) -> FloatArray:
        """Residual of the map, shape ``(n,)``."""
        return self.data.y - self.fit.model.value(self.fit.theta, self.data.x)

    def solution(
        self,
        simulate: Simulate,
        experiments: Sequence[Experiment],
        variant: Variant,
        options: OptionsT,
        derived: Mapping[str, Quantity],
        notices: Sequence[Notice],
    ) -> Solution[OptionsT]:
        """Return the solution to examine and write; ``options`` are settled."""
        parameters, order, matrix = self.solved.quantities(variant.parameters, experiments[0].units)
        return make_solution(
            simulate, experiments, variant, options, parameters, order,
            NoiseModel(matrix, self.solved.independent),
            jacobians=[{variant.output.name: j} for j in self.data.by_log(self.jacobian)],
            derived=derived, notices=[*self.notices, *notices],
            details={"starts": self.fit.tried, "agreeing": self.fit.agreeing},
        )  # fmt: skip


@dataclass(frozen=True)
class _Search:
    """Fits of one law to some rows with values held; ``specs`` are those of all values by name."""

    law: Law
    specs: Mapping[str, ParameterSpec]
    data: NamedRows
    starts: Callable[[Mapping[str, float]], Sequence[Mapping[str, float]]]
    limits: Mapping[str, tuple[float, float]]
    request: Request[Any]

    def solve(self, held: Mapping[str, float]) -> MapFit[NamedMap]:
        """The best fit with some values held."""
        names = tuple(n for n in self.specs if n not in held)
        begin = [{**s, **self.request.start} for s in self.starts(held)]
        return fit_map(
            NamedMap(self.law, names, held, self.limits), self.data.rows,
            [np.array([s[n] for n in names]) for s in begin],
        )  # fmt: skip

    def held_by(self, refusal: Refusal) -> dict[str, float]:
        """The value that a refused parameter is held at, by its name."""
        return {refusal.parameter: refusal.value(self.specs[refusal.parameter])}

    def not_demanded(
        self, optional: Sequence[Refusal], held: Mapping[str, float]
    ) -> Iterator[Refusal]:
        """Optional parts, one after the other, without which the law fits as well."""
        known = dict(held)
        for part in optional:
            if part.parameter in held:
                continue
            found, simple = self.solve(known), self.solve(known | self.held_by(part))
            unknowns, extra = found.theta.size, found.theta.size - simple.theta.size
            tail = excess_tail(simple.cost, found.cost, extra, self.data.y.size, unknowns)
            if tail >= AT_ODDS:
                known |= self.held_by(part)
                yield part

    def finish(self, held: Mapping[str, float]) -> NamedFit:
        """A fit with covariance and intervals."""
        found, data = self.solve(held), self.data
        # a value on a bound has a derivative to one side, and an interval that the bound cuts
        jacobian, rest = found.model.slopes(found.theta, data.x), data.rows.residual(found)
        misfit = find_misfit(data.x[:, 0], rest, found.theta.size, None)
        spread = find_uncertainty(
            data.by_log(jacobian), data.by_log(rest), misfit, data.in_order, data.readings
        )
        solved = Solved(
            found.model.values(found.theta), found.model.names, spread.covariance, spread.degrees,
            self.request.fixed, independent=spread.independent,
        )  # fmt: skip
        return NamedFit(
            _with_intervals(solved, found, data, jacobian), [], found, data, jacobian, misfit
        )


def fit_named_map(
    law: Law,
    specs: Sequence[ParameterSpec],
    data: NamedRows,
    starts: Callable[[Mapping[str, float]], Sequence[Mapping[str, float]]],
    limits: Mapping[str, tuple[float, float]],
    request: Request[Any],
    *,
    max_half_widths: Mapping[str, float],
    refusals: Sequence[Refusal],
    optional: Sequence[Refusal] = (),
) -> NamedFit:
    """Fit a map of named values.

    Parameters
    ----------
    starts
        ``starts(held)`` gives values to begin at.
    limits
        Lowest and highest values of the map's domain; those of ``request`` are kept as well.
    max_half_widths
        Half-widths of 95 % intervals beyond which a parameter is refused, by name; see
        :func:`.results.find_uninformative`.
    refusals
        Parameters that no sample determines.
    optional
        Parts that the map has only where the data demand them, held as they say otherwise.

    Raises
    ------
    NotIdentifiedError
        When a parameter without a neutral value is undetermined.
    """
    ranges = {}
    for s in specs:
        given = [r[s.name] for r in (limits, request.bounds) if s.name in r]
        low, high = zip((s.minimum, s.maximum), *given)
        ranges[s.name] = (max(low), min(high))
    search = _Search(law, {s.name: s for s in specs}, data, starts, ranges, request)
    held = dict(request.fixed)
    for refusal in refusals:
        held = search.held_by(refusal) | held
    ended = determine(
        search.finish, lambda f: find_uninformative(f.solved, search.specs, max_half_widths),
        search.specs, fixed=request.fixed,
        refusals=[*refusals, *search.not_demanded(optional, held)],
    )  # fmt: skip
    last = ended.solution
    solved = replace(last.solved, refused=dict(ended.refused))
    return replace(last, solved=solved, notices=ended.notices)


def _with_intervals(
    solved: Solved, found: MapFit[NamedMap], data: NamedRows, jacobian: FloatArray
) -> Solved:
    """The values with intervals of the profiled cost: an edge between few points is no parabola.

    Where another optimum explains the rows as well, the errors reach there.
    """
    model = found.model
    if data.y.size > PROFILED:
        return solved
    matrix = solved.covariance
    unit = information_units([jacobian], [data.rows.residual(found)], matrix)
    usable = np.isfinite(unit) & (np.diag(matrix) > 0.0)
    if not usable.any():
        return solved
    alike = [theta for theta, cost in found.others
             if cost - found.cost < DECISIVE * float(np.median(unit[usable]))]  # fmt: skip
    for change in (theta - found.theta for theta in alike):
        if np.any(np.abs(change[usable]) > CERTAIN * np.sqrt(np.diag(matrix)[usable])):
            matrix = widen_by(matrix, change)
    quantile, intervals = t_quantile(0.975, solved.degrees), {}
    for k in np.flatnonzero(usable).tolist():
        rise = partial(_rise, model, found, alike, data, matrix, k, float(unit[k]))
        name, error = model.names[k], float(np.sqrt(matrix[k, k]))
        intervals[name] = profile_interval(
            rise, float(found.theta[k]), error, quantile, model.limits[name]
        )
    return replace(solved, covariance=matrix, intervals=intervals)


def _rise(
    model: NamedMap, found: MapFit[NamedMap], alike: Sequence[FloatArray], data: NamedRows,
    matrix: FloatArray, k: int, unit: float, x: float,
) -> float:  # fmt: skip
    """Root of the rise of the profiled cost with one value at ``x``, in standard deviations."""
    name = model.names[k]
    others = tuple(n for n in model.names if n != name)
    held = replace(model, names=others, held={**model.held, name: x})
    near = found.theta + matrix[k] / matrix[k, k] * (x - found.theta[k])
    starts = [np.clip(np.delete(theta, k), *held.bounds) for theta in (near, *alike)]
    cost = fit_map(held, data.rows, starts).cost
    return float(np.sqrt(max(cost - found.cost, 0.0) / unit))
