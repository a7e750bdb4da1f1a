"""Results of a fit or a simulation: curves to compare with the log, and the document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from .errors import Notice
from .estimation.blocks import joined
from .experiment import Experiment, FloatArray, all_of, where_finite
from .family import FamilyOptions, Quantity, Simulated, Solution, StaticView, Variant
from .parameters.document import ParameterDocument
from .presentation import Presented
from .rows import blocks


@dataclass(frozen=True)
class Agreement:
    """Measured against simulated: RMSE [unit of the output], fit [%], samples used."""

    rmse: float
    fit_percent: float
    samples: int
    sum_of_squares: float


def common_level(runs: Sequence[Simulation]) -> float | None:
    """Mean of what was measured over all runs; ``None`` where runs have offsets of their own.

    An offset that several runs share is not their own.
    """
    offsets = {s.offset for s in runs}
    if len(offsets) > 1 or (len(runs) == 1 and offsets != {None}):
        return None
    used = joined([all_of(s.measured, where_finite(s.residual)) for s in runs])
    return float(used.mean()) if used.size else None


def sum_of_squares(values: FloatArray, reference: float = 0.0) -> float:
    """Sum of squares of what values of shape ``(n,)`` are beside a reference."""
    parts = (values[at] - reference if reference else values[at] for at in blocks(values.size))
    return sum(float(np.sum(part**2)) for part in parts)


def agreement(runs: Sequence[Simulation]) -> Agreement:
    """Agreement of all runs together, samples at NaN left out.

    ``fit = 100 (1 - ||y - y_model|| / ||y - reference||)`` as in MATLAB's ``compare``. The
    reference is what the model explains nothing of: the mean of every run where each has an
    offset of its own. Else the level is the model's to explain, and the reference is that of the
    fitted logs, or the :func:`common_level` of these runs where none is known: at one constant
    speed a log, all that a friction explains are the means of the logs.
    """
    level = next((s.level for s in runs if s.level is not None), None)
    level = common_level(runs) if level is None else level
    error, spread, samples = 0.0, 0.0, 0
    for s in runs:
        residual = s.residual
        at = where_finite(residual)
        if not at.any():
            continue
        y, residual = all_of(s.measured, at), all_of(residual, at)
        reference = y.mean() if level is None else level
        error += sum_of_squares(residual)
        spread += sum_of_squares(y, float(reference))
        samples += y.size
    rmse = float(np.sqrt(error / max(samples, 1)))
    fit = 100.0 if error == 0.0 else 0.0
    if spread > 0.0:
        fit = 100.0 * (1.0 - float(np.sqrt(error / spread)))
    return Agreement(rmse, fit, samples, error)


@dataclass(frozen=True)
class Simulation:
    """One run simulated with the parameters of a file.

    Attributes
    ----------
    experiment
        The run.
    simulated
        Output of the model at its samples, shape ``(n,)`` [SI].
    measured
        What it is compared with, same shape; NaN where nothing was recorded or the model
        does not claim to describe the sample.
    offset
        Offset of the output that belongs to the log [SI], or ``None``.
    also
        Other channels as the model gives them, by role, shape ``(n,)`` [SI]: those that the
        run recorded.
    level
        Mean of the output over all logs that were fitted [SI], which ``fit_percent`` compares
        with; ``None`` for that of the run itself.
    """

    experiment: Experiment
    simulated: FloatArray
    measured: FloatArray
    offset: float | None = None
    also: Mapping[str, FloatArray] = field(default_factory=dict)
    level: float | None = None

    @classmethod
    def of(cls, experiment: Experiment, found: Simulated, output: str) -> Simulation:
        """Put a simulation beside what the run recorded of its output role."""
        simulated = np.asarray(found.output, dtype=float)
        if output in experiment:
            used = where_finite(simulated) if found.used is None else found.used
            recorded = experiment.sampled(output)
            measured = recorded if used.all() else np.where(used, recorded, np.nan)
        else:
            measured = np.full(simulated.shape, np.nan)
        also = {role: values for role, values in found.also.items() if role in experiment}
        return cls(experiment, simulated, measured, found.offset, also)

    @cached_property
    def residual(self) -> FloatArray:
        """Measured less simulated, shape ``(n,)`` [SI]; NaN where a sample was left out."""
        return self.measured - self.simulated

    @property
    def others(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Other channels, measured and simulated, by role; shapes ``(n,)`` [SI]."""
        return {role: (self.experiment.sampled(role), y) for role, y in self.also.items()}

    @property
    def agreement(self) -> Agreement:
        """Measured against simulated."""
        return agreement([self])

    @property
    def rmse(self) -> float:
        """Root mean square of the residual over the samples used [SI]."""
        return self.agreement.rmse

    @property
    def left_out(self) -> int:
        """Samples that the model does not claim to describe."""
        return int(self.measured.size - np.count_nonzero(where_finite(self.measured)))


def pair(
    runs: Sequence[Experiment],
    found: Sequence[Simulated],
    variant: Variant,
    level: float | None = None,
) -> list[Simulation]:
    """Put simulations beside what the runs recorded; ``level`` is that of the fitted logs."""
    output = variant.output.name
    pairs = [Simulation.of(run, s, output) for run, s in zip(runs, found, strict=True)]
    return pairs if level is None else [replace(s, level=level) for s in pairs]


@dataclass(frozen=True)
class Outcome(Presented):
    """A finished fit, as pictures and pages need it.

    Attributes
    ----------
    family, variant
        What was fitted.
    solution
        Parameters, covariance, settled options (:class:`.estimation.solution.Solution`).
    fitted
        Every run that was fitted, simulated with the values that are written.
    validation
        Runs that were not fitted.
    document
        The parameter document, ready to be written.
    notices
        All warnings, those of the reader included.
    static_view
        What a picture of a static map shows; ``None`` for a dynamic model.
    inputs
        Files of the logs; what is saved never replaces one of them.
    """

    family: str
    variant: Variant
    solution: Solution[FamilyOptions]
    fitted: Sequence[Simulation]
    validation: Sequence[Simulation]
    document: ParameterDocument
    notices: Sequence[Notice]
    static_view: StaticView | None
    inputs: Sequence[str] = ()

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Parameters by name: value, unit, standard error, interval, status."""
        return self.solution.parameters

    @property
    def derived(self) -> Mapping[str, Quantity]:
        """Numbers computed from the parameters."""
        return self.solution.derived

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Names of the parameters that the data could not determine."""
        return tuple(n for n, q in self.parameters.items() if q.status == "not_identified")

    @property
    def experiments(self) -> list[Experiment]:
        """The runs that were fitted."""
        return [s.experiment for s in self.fitted]
