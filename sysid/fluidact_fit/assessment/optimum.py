"""A finished fit near its optimum: residuals, their derivatives, and what simulates nearby.

Near its optimum a fit is linear in its parameters. How the estimate would move if the model had one
more term, or if a sample or half of the data were left out, then follows from the derivatives of
the output without another fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..estimation.solution import base_name, moved, number
from ..estimation.uncertainty import covariance
from ..experiment import (
    BoolArray,
    Experiment,
    FloatArray,
    Signal,
    all_of,
    is_finite,
    where_finite,
)
from ..family import Family, FamilyOptions, Plant, Simulated, Solution, Variant
from ..outcome import Simulation
from ..rows import square_sum
from ..units import after_number
from .noise_treatment import (
    AugmentedJacobian,
    Instrumented,
    NoiseTreatment,
    TermRegression,
    Whitened,
)

_SAME = 1.0 - 1e-9  # correlation of two names for one unknown
_TIME_STEP = 0.1  # sample times by which a time is moved for a derivative
_OUTPUT_STEP = 0.3  # standard deviations of the residual by which a derivative changes the output
_TRIES = 8  # to find the step that does
_FEWEST = 20  # samples of a series that can be examined


@dataclass(frozen=True)
class Series:
    """One channel of one run in a fit.

    Attributes
    ----------
    run, role
        Index of the run, and the channel.
    experiment
        The run.
    simulated, used
        Simulated values, and mask of the samples that count, shape ``(n,)`` each.
    scale
        Divisor of residuals and derivatives: 1 where the output alone was fitted, else the root
        mean square of the residuals of the channel over all runs [its unit].
    own_level
        Whether the series has an offset of its own, which takes the mean of the residual.
    """

    run: int
    role: str
    experiment: Experiment
    simulated: FloatArray
    used: BoolArray
    scale: float = 1.0
    own_level: bool = False

    @property
    def resolution(self) -> float:
        """Step of the converter, divided by the scale; 0 where the channel was not logged."""
        signal = self.experiment.signals.get(self.role)
        return signal.resolution / self.scale if signal is not None else 0.0


@dataclass(frozen=True)
class Optimum:
    """A fit and its derivatives by the parameters, channel by channel of every run.

    Whatever is "as the residuals are" covers the used samples of a series and is divided by its
    scale.

    Attributes
    ----------
    family, variant, solution, fitted
        The fit. ``fitted`` are its runs, simulated with the values that are written.
    names, std_errors
        Parameters that were estimated, and their standard errors, shape ``(p,)``.
    series
        The channels that were fitted, all channels of one run after the other.
    residuals, jacobians
        Of every series over the samples that were used, divided by its scale, shapes
        ``(n_i,)`` and ``(n_i, p)``.
    instruments
        The derivatives with instruments in the place of noisy inputs, shape ``(n_i, p)`` each;
        empty where the fit has none.
    treatment
        Treatment of the noise where the runs are not those of the solution alone.
    """

    family: Family[FamilyOptions]
    variant: Variant
    solution: Solution[FamilyOptions]
    fitted: Sequence[Simulation]
    names: tuple[str, ...]
    std_errors: FloatArray
    series: Sequence[Series]
    residuals: Sequence[FloatArray]
    jacobians: Sequence[FloatArray]
    instruments: Sequence[FloatArray] = ()
    treatment: NoiseTreatment | None = None

    @property
    def plant(self) -> Plant[FamilyOptions]:
        """The model with the values and options that are written."""
        return self.solution.plant

    @property
    def experiments(self) -> list[Experiment]:
        """The runs that were fitted."""
        return [s.experiment for s in self.fitted]

    @property
    def driving(self) -> list[str]:
        """Roles that drive the model and were sampled in every run: no single steps."""
        runs = [e.signals for e in self.experiments]
        return [r.name for r in self.variant.driving
                if all(r.name in s and s[r.name].values.size > 1 for s in runs)]  # fmt: skip

    def signal(self, role: str) -> Signal:
        """Signal of a role in the first log that has it: its units are those of the fit."""
        return next(e.signals[role] for e in self.experiments if role in e)

    @cached_property
    def part(self) -> Optimum:
        """The same fit over the first rows of long runs, which show any effect that is constant."""
        return self.beginning(self.family.examined)

    def beginning(self, rows: int) -> Optimum:
        """The same fit over the first rows of every run.

        A fit with instruments stays whole: they are made from whole runs only.
        """
        if self.instruments or all(e.samples <= rows for e in self.experiments):
            return self
        counts = [int(s.used[:rows].sum()) for s in self.series]
        if min(counts) < _FEWEST:
            return self
        runs, output = [e.beginning(rows) for e in self.experiments], self.variant.output.name
        fitted = [
            Simulation.of(e, found, output)
            for e, found in zip(runs, self.solution.simulate_near(self.plant, runs), strict=True)
        ]
        series = [
            replace(
                s,
                experiment=runs[s.run],
                used=s.used[:rows],
                simulated=fitted[s.run].also.get(s.role, fitted[s.run].simulated),
            )
            for s in self.series
        ]
        return replace(
            self,
            fitted=fitted,
            series=series,
            residuals=[r[:n] for r, n in zip(self.residuals, counts, strict=True)],
            jacobians=[j[:n] for j, n in zip(self.jacobians, counts, strict=True)],
        )

    def regress(
        self, columns: Sequence[FloatArray], instruments: Sequence[FloatArray] = ()
    ) -> TermRegression | None:
        """Regress the residual on the derivatives and one more column of every series.

        ``instruments`` are that column without the noise of inputs, where that is known.
        """
        return self.noise.regress(columns, instruments)

    @cached_property
    def noise(self) -> NoiseTreatment:
        """Treatment that allows for the noise of this fit."""
        if self.treatment is not None:
            return self.treatment
        plain = self.augmented([np.zeros((r.size, 0)) for r in self.residuals])
        return Instrumented(plain, self.instruments) if self.instruments else Whitened(plain)

    def augmented(self, columns: Sequence[FloatArray]) -> AugmentedJacobian:
        """Derivatives, further columns and residual of every series."""
        roles, free = [s.role for s in self.series], [s.own_level for s in self.series]
        return AugmentedJacobian(self.jacobians, columns, self.residuals, roles, free)

    def change(
        self,
        experiments: Sequence[Experiment] | None = None,
        plant: Plant[FamilyOptions] | None = None,
    ) -> list[FloatArray]:
        """Change of all series by other inputs, values or options, as the residuals are."""
        found = self.solution.simulate_near(plant or self.plant, experiments or self.experiments)
        return self.columns([
            _channel(found[s.run], s.role) - s.simulated for s in self.series
        ])  # fmt: skip

    def columns(self, values: Sequence[FloatArray]) -> list[FloatArray]:
        """Turn values of all series, shape ``(n,)`` each, into columns as the residuals are."""
        out = []
        for s, every in zip(self.series, values, strict=True):
            column = all_of(every, s.used) if s.scale == 1.0 else all_of(every, s.used) / s.scale
            if not is_finite(column):  # samples that other inputs leave undescribed tell nothing
                column = np.nan_to_num(column, nan=0.0, posinf=np.inf, neginf=-np.inf)
            out.append(column)
        return out

    @property
    def measured(self) -> list[FloatArray]:
        """Measurements of every series, scaled as the residuals, shape ``(n_i,)``."""
        return [
            r + all_of(s.simulated, s.used) / s.scale for s, r in zip(self.series, self.residuals)
        ]

    def is_less_certain(self, times: float) -> bool:
        """Return whether some standard error exceeds that of white residuals so many times."""
        white = covariance(self.jacobians, self.residuals, robust=False).covariance
        return bool(np.any(self.std_errors > times * np.sqrt(np.diag(white))))

    @property
    def sigma(self) -> float:
        """Root mean square of the residuals [unit of the residuals]."""
        return root_mean_square(self.residuals)

    @property
    def samples(self) -> int:
        """Samples of all series that were used."""
        return sum(r.size for r in self.residuals)

    @property
    def roles(self) -> tuple[str, ...]:
        """The channels that were fitted."""
        return tuple(dict.fromkeys(s.role for s in self.series))

    def number(self, name: str) -> float:
        """Value of a parameter or of one entry of a list, ``levels[2]`` [SI]."""
        return number(self.plant, name)

    def slopes(
        self, plant: Plant[FamilyOptions], name: str
    ) -> tuple[list[FloatArray], list[FloatArray]] | None:
        """Derivatives of every series by a value of a plant, as the residuals are.

        The step changes the output by part of the residual: a smaller one drowns in rounding, a
        larger one is no derivative.

        Returns
        -------
        The derivatives, and those with instruments in the place of noisy inputs where a fit has
        them; ``None`` where the output does not change.
        """
        timed, value = self.variant.parameter(name).unit == "s", number(plant, name)
        step = _TIME_STEP * self.experiments[0].sample_time if timed else 1e-3 * (abs(value) or 1.0)
        factor = 1.0
        for _ in range(_TRIES):
            step *= factor
            columns = self.change(plant=moved(plant, name, step))
            size = root_mean_square(columns)
            if not (np.isfinite(size) and size > 0.0):
                return None
            factor = _OUTPUT_STEP * self.sigma / size
            if timed or 0.5 < factor < 2.0:
                break  # the first steps may show nothing but rounding
        instruments = self._instruments(moved(plant, name, step))
        return [c / step for c in columns], [c / step for c in instruments]

    def _instruments(self, plant: Plant[FamilyOptions]) -> list[FloatArray]:
        """Change of the model with instruments for noisy inputs by slightly other values."""
        simulate = self.solution.noise.simulate_instruments if self.instruments else None
        if simulate is None:
            return []
        then, now = (simulate(p, self.experiments) for p in (plant, self.plant))
        return self.columns([
            _channel(then[s.run], s.role) - _channel(now[s.run], s.role) for s in self.series
        ])  # fmt: skip

    def unit(self, name: str) -> str:
        """Unit of a parameter as it follows its value in a text."""
        return after_number(self.solution.parameters[base_name(name)].unit)

    def place(self, series: int, row: int) -> str:
        """Describe the place of a used sample: log, instant or number, and channel if several."""
        s = self.series[series]
        k = int(np.flatnonzero(s.used)[row])
        e, of = s.experiment, f" of {s.role}" if len(self.roles) > 1 else ""
        at = f"t = {e.time[k]:.6g} s" if e.time.size else f"sample {k + 1}"
        return f"{e.name}, {at}{of}"


def root_mean_square(parts: Sequence[FloatArray]) -> float:
    """Root of the mean square of all parts together; the parts may have any shape."""
    return float(np.sqrt(sum(map(square_sum, parts)) / sum(x.size for x in parts)))


def _channel(found: Simulated, role: str) -> FloatArray:
    return np.asarray(found.also.get(role, found.output), dtype=float)


def make_optimum(
    family: Family[FamilyOptions],
    variant: Variant,
    solution: Solution[FamilyOptions],
    fitted: Sequence[Simulation],
) -> Optimum | None:
    """Return the fit with its derivatives; ``None`` where it has too few rows or no derivatives."""
    series, residuals = _series(variant, solution, fitted)
    if not solution.names or min((r.size for r in residuals), default=0) < _FEWEST:
        return None
    errors = np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))
    if not np.all(np.isfinite(errors)) or not np.all(errors > 0.0):
        return None
    q = solution.differentiated
    if not q:
        return None
    names, errors = solution.names[:q], errors[:q]
    column = _places(solution.covariance[:q, :q] / np.outer(errors, errors), errors)
    kept = [column.index(k) for k in range(max(column) + 1)]
    jacobians = []
    for s in series:
        j = _merged(solution.runs[s.run].jacobians[s.role], column)
        jacobians.append(j if s.scale == 1.0 else j / s.scale)
    return Optimum(
        family, variant, solution, fitted, tuple(names[k] for k in kept), errors[kept], series,
        residuals, jacobians, [_merged(j, column) for j in solution.noise.instruments],
    )  # fmt: skip


def _places(correlations: FloatArray, errors: FloatArray) -> list[int]:
    """Column of every name among the unknowns: two names can stand for the same unknown.

    ``correlations`` has shape ``(p, p)``, ``errors`` are the standard errors, shape ``(p,)``.
    """
    column: list[int] = []
    for k in range(errors.size):
        same = (i for i in range(k) if correlations[i, k] > _SAME and errors[i] == errors[k])
        column.append(next((column[i] for i in same), max(column, default=-1) + 1))
    return column


def _merged(jacobian: FloatArray, column: Sequence[int]) -> FloatArray:
    """Derivatives by the unknowns, ``(n, q)``, from those by all names, ``(n, p)``."""
    unknowns = max(column) + 1
    return jacobian if unknowns == len(column) else jacobian @ np.eye(unknowns)[list(column)]


def _series(
    variant: Variant, solution: Solution[FamilyOptions], fitted: Sequence[Simulation]
) -> tuple[list[Series], list[FloatArray]]:
    """The channels that were fitted, run by run, and their residuals."""
    series, residuals = [], []
    output = variant.output.name
    for run, s in enumerate(fitted):
        channels = {output: (s.measured, s.simulated, s.residual)}
        fits = solution.runs[run].jacobians
        channels |= {r: (y, x, y - x) for r, (y, x) in s.others.items() if r in fits}
        for role, (measured, simulated, residual) in channels.items():
            used = where_finite(measured)
            level = role == output and s.offset is not None
            series.append(Series(run, role, s.experiment, simulated, used, own_level=level))
            residuals.append(all_of(residual, used))
    if all(s.role == output for s in series):
        return series, residuals
    size = {}
    for role in {s.role for s in series}:
        own = [r for s, r in zip(series, residuals) if s.role == role]
        size[role] = root_mean_square(own) or 1.0
    scaled = [replace(s, scale=size[s.role]) for s in series]
    return scaled, [r / s.scale for s, r in zip(scaled, residuals)]


def delayed(experiment: Experiment, role: str, by: float) -> Experiment:
    """The same run with an input that acts later [s]."""
    signal = experiment.signals[role]
    late = replace(signal, time=signal.time + by)
    return replace(experiment, signals={**experiment.signals, role: late})
