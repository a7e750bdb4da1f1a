"""Solution of a fit: what :meth:`.Family.estimate` returns and every examination reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from ..errors import Notice
from ..experiment import BoolArray, Experiment, FloatArray, all_of, is_finite, where_finite
from ..options import FamilyOptions
from ..parameters.rounding import round_covariance, round_quantity
from ..rows import BLOCK_ROWS
from ..specification import (
    NoiseLevel,
    ParameterSpec,
    Plant,
    Quantity,
    ReadT,
    Simulate,
    Simulated,
    Value,
    Variant,
)
from .budget import uncounted

OptionsT = TypeVar("OptionsT", bound=FamilyOptions)
_STEP = 0.02  # standard errors, for differences of a simulation
_RELATIVE_STEP = 1e-6  # relative to the value, where there is no standard error


@dataclass(frozen=True)
class NoiseModel:
    """Noise model that an estimator assumed for the residuals.

    Attributes
    ----------
    covariance
        Of the estimated values, in the order of :attr:`Solution.names`, shape ``(p, p)``
        [product of the units]; empty where there is none.
    independent
        Number of independent samples that would show the size of the errors as well as the
        residuals did; infinite where those are white or more is known of them.
    inputs
        Noise on measured inputs that the estimate allows for, by role. The residual then contains
        the response to it.
    instruments
        Derivatives of the output with instruments in the place of noisy inputs, per run as the
        Jacobians are, shape ``(m_i, q)``; empty unless the estimate has instruments. Noise of such
        an input is in the residual and in every derivative, but not in these.
        :func:`make_solution` fills them in.
    simulate_instruments
        Simulates with instruments, as :attr:`Solution.simulate_near` does without.
    """

    covariance: FloatArray
    independent: float = np.inf
    inputs: Mapping[str, NoiseLevel] = field(default_factory=dict)
    instruments: Sequence[FloatArray] = ()
    simulate_instruments: Simulate | None = None


@dataclass(frozen=True)
class FittedRun:
    """One run of a fit: its simulation, and the derivatives by the parameters.

    Attributes
    ----------
    experiment
        The run.
    simulated
        Simulation with the values of the solution, as :meth:`.Family.simulate` returns it.
    jacobians
        Derivatives of every channel that was fitted, by role, over the samples that were used,
        shape ``(m, q)`` [unit of the channel per unit of the parameter]. Unknowns of single logs
        are projected out.
    """

    experiment: Experiment
    simulated: Simulated
    jacobians: Mapping[str, FloatArray]

    def channel(self, role: str, output: str) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Measured and simulated values and mask of used samples of a channel, ``(n,)`` each.

        ``output`` is the role that :attr:`Simulated.output` stands for.
        """
        s = self.simulated
        measured = self.experiment.sampled(role)
        if role != output:
            return measured, s.also[role], where_finite(measured)
        simulated = np.asarray(s.output, dtype=float)
        known = where_finite(simulated) if s.used is None else s.used
        finite = where_finite(measured)
        return measured, simulated, known if finite.all() else finite & known

    def residual(self, role: str, output: str) -> FloatArray:
        """Measured less simulated over the samples that were used, shape ``(m,)`` [SI]."""
        measured, simulated, used = self.channel(role, output)
        return all_of(measured - simulated, used)


@dataclass(frozen=True)
class Solution(Generic[ReadT]):
    """Solution of a fit, whichever estimator found it.

    Attributes
    ----------
    variant
        Variant of the family that was fitted.
    parameters
        Every parameter of the variant's table (optional ones when used), by name. The status
        tells which were estimated, held (``fixed``) or refused (``not_identified``).
    names
        Estimated values, in the order of :attr:`NoiseModel.covariance` and of the columns of the
        Jacobians; entries of lists as ``control_points[2]``. Jacobians may have fewer columns:
        values at the end that were bracketed and not fitted have none.
    runs
        Residuals and Jacobians, per run and measured channel.
    noise
        Noise model of the residuals.
    options
        The options with everything that the fit chose: sizes given as ``auto``, dead bands and
        filters found from the noise. The file holds them.
    simulate_near
        Simulates the runs, or their beginnings, with slightly other values, inputs or options as
        :meth:`.Family.simulate` does. A family whose simulation searches at length for unknowns
        of single logs may take those to first order from the fit.
    residuals_are_fitted
        Whether the estimator minimised the residuals of the runs, and not those of other rows.
    derived
        Numbers computed from the parameters, with their own uncertainty.
    notices
        Warnings.
    covered
        Ranges, over the samples that were used, of quantities that the family computed from the
        logs: lowest, highest and unit, by name.
    details
        Further entries of the file under ``fit`` (method, starts, filter). Tables under
        ``comparisons``, rows by title, are shown by the report.
    """

    variant: Variant
    parameters: Mapping[str, Quantity]
    names: tuple[str, ...]
    runs: Sequence[FittedRun]
    noise: NoiseModel
    options: ReadT
    simulate_near: Simulate
    residuals_are_fitted: bool
    derived: Mapping[str, Quantity] = field(default_factory=dict)
    notices: Sequence[Notice] = ()
    covered: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, Value]:
        """Plain values by name."""
        return {k: q.value for k, q in self.parameters.items()}

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the estimated values, shape ``(p, p)``."""
        return self.noise.covariance

    @property
    def differentiated(self) -> int:
        """Number of estimated values, from the first, that have derivatives."""
        return next(iter(self.runs[0].jacobians.values())).shape[1]

    @cached_property
    def plant(self) -> Plant[ReadT]:
        """The model with the numbers that are written."""
        return Plant(self.variant, self.values, self.options)


def make_solution(
    simulate: Simulate,
    experiments: Sequence[Experiment],
    variant: Variant,
    options: OptionsT,
    parameters: Mapping[str, Quantity],
    names: tuple[str, ...],
    noise: NoiseModel,
    *,
    jacobians: Sequence[Mapping[str, FloatArray]] = (),
    simulate_near: Simulate | None = None,
    derived: Mapping[str, Quantity] | None = None,
    notices: Sequence[Notice] = (),
    covered: Mapping[str, tuple[float, float, str]] | None = None,
    details: Mapping[str, Any] | None = None,
) -> Solution[OptionsT]:
    """Return the solution with these values, rounded as they are written, and its runs simulated.

    Parameters
    ----------
    simulate, experiments
        Simulation of the family, and the runs that were fitted.
    variant, options, parameters, names, noise, simulate_near, derived, notices, covered, details
        As of :class:`Solution`.
    jacobians
        Derivatives of the channels of every run, if the estimator has them, over all samples or
        over those used, shape ``(n, p)`` each [unit of the channel per unit of the value].
        Otherwise those of the output are computed as differences of simulations.
    """
    near = simulate_near or simulate
    # everything below is computed from the numbers as they are written
    parameters = {name: round_quantity(q) for name, q in parameters.items()}
    derived = {name: round_quantity(q) for name, q in (derived or {}).items()}
    noise = replace(noise, covariance=round_covariance(noise.covariance))
    plant = Plant(variant, {name: q.value for name, q in parameters.items()}, options)
    with uncounted():
        found = simulate(plant, experiments)
        runs = [FittedRun(e, s, {}) for e, s in zip(experiments, found, strict=True)]
        output = plant.variant.output.name
        known = [_over_used(run, j, output) for run, j in zip(runs, jacobians)]
        residuals_are_fitted = bool(known) and all(j is not None for j in known)
        if residuals_are_fitted:
            runs = [replace(run, jacobians=j) for run, j in zip(runs, known) if j is not None]
        else:
            tables = differences(near, plant, runs, names, noise.covariance)
            if noise.simulate_instruments is not None:
                stand_in = noise.simulate_instruments
                instruments = differences(stand_in, plant, runs, names, noise.covariance)
                noise = replace(noise, instruments=instruments)
            runs = [replace(run, jacobians={output: j}) for run, j in zip(runs, tables)]
    return Solution(
        variant, parameters, names, runs, noise, options, near, residuals_are_fitted, derived,
        notices, covered or {}, details or {},
    )  # fmt: skip


def differences(
    simulate: Simulate,
    plant: Plant[Any],
    runs: Sequence[FittedRun],
    names: Sequence[str],
    covariance: FloatArray,
) -> list[FloatArray]:
    """Derivatives of the output of every run over used samples, shape ``(m_i, p)`` each.

    By central differences with steps of part of a standard error, as ``covariance`` has it.
    """
    variances = np.diag(covariance) if covariance.size else np.zeros(0)
    steps = [_step(plant, n, float(v)) for n, v in zip(names, variances, strict=True)]
    output = plant.variant.output.name
    experiments = [run.experiment for run in runs]
    used = [run.channel(output, output)[2] for run in runs]
    # column by column in memory for long records: they are filled in one by one
    out = [
        np.zeros((rows, len(names)), order="F" if rows > BLOCK_ROWS else "C")
        for rows in (int(np.count_nonzero(u)) for u in used)
    ]
    for k, (name, step) in enumerate(zip(names, steps, strict=True)):
        ends = [simulate(moved(plant, name, s * step), experiments) for s in (1.0, -1.0)]
        for j, u, up, down in zip(out, used, *ends, strict=True):
            change = all_of(np.asarray(up.output) - down.output, u)
            if not is_finite(change):  # samples that other values leave undescribed tell nothing
                change = np.nan_to_num(change, nan=0.0, posinf=np.inf, neginf=-np.inf)
            j[:, k] = change / (2.0 * step)
        del ends, up, down  # a long log leaves no memory for two of them
    return out


def _over_used(
    run: FittedRun, jacobians: Mapping[str, FloatArray], output: str
) -> dict[str, FloatArray] | None:
    """Rows of the used samples, by role; ``None`` where the rows are not those of samples."""
    found = {}
    for role, j in jacobians.items():
        used = run.channel(role, output)[2]
        found[role] = all_of(j, used) if j.shape[0] == used.size else j
        if found[role].shape[0] != np.count_nonzero(used):
            return None
    return found


def _step(plant: Plant[Any], name: str, variance: float) -> float:
    if np.isfinite(variance) and variance > 0.0:
        return _STEP * float(np.sqrt(variance))
    return _RELATIVE_STEP * (abs(number(plant, name)) or 1.0)


def base_name(name: str) -> str:
    """Name of a parameter, of which ``name`` may be an entry, ``levels[2]``."""
    return name.partition("[")[0]


def number(plant: Plant[Any], name: str) -> float:
    """Value of a parameter of a plant, or one entry of a list, ``levels[2]`` [SI]."""
    key, _, index = name.partition("[")
    return float(np.ravel(plant.values[key])[int(index.rstrip("]") or 0)])


def moved(
    plant: Plant[ReadT], name: str, by: float, spec: ParameterSpec | None = None
) -> Plant[ReadT]:
    """Return the plant with a value moved ``by`` an amount [SI], within the range of its ``spec``.

    ``name`` may be an entry of a list, ``levels[2]``.
    """
    key, _, index = name.partition("[")
    entries = np.array(plant.values[key], dtype=float)
    at = int(index.rstrip("]") or 0)
    low, high = (spec.minimum, spec.maximum) if spec else (-np.inf, np.inf)
    entries.flat[at] = min(max(entries.flat[at] + by, low), high)
    return replace(plant, values={**plant.values, key: entries.tolist()})
