"""A finished fit near its optimum: residuals, their derivatives, and the noise in between.

Near its optimum a fit is linear in its parameters. How the estimate would move if the model
had one more term, if a sample were not there, or if half of the data were, then follows from
the derivatives of the output without another fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..estimation.uncertainty import fit_autoregression
from ..experiment import Experiment, FloatArray
from ..family import Estimate, Family, FamilyOptions, Simulated, Value, Variant
from ..outcome import Simulation

_STEP = 0.02  # of a standard error, for differences of a simulation
_ORDER = 25  # highest of the autoregression that whitens the residual


@dataclass(frozen=True)
class Optimum:
    """A fit and its derivatives by the parameters, run by run.

    Attributes
    ----------
    family, variant, estimate, fitted
        The fit. ``fitted`` are its runs, simulated with the values that are written.
    names, errors
        Parameters that were estimated, and their standard errors, shape ``(p,)``.
    residuals, jacobians
        Of every run over the samples that were used, shapes ``(n_i,)`` and ``(n_i, p)``.
    """

    family: Family[FamilyOptions]
    variant: Variant
    estimate: Estimate[FamilyOptions]
    fitted: Sequence[Simulation]
    names: tuple[str, ...]
    errors: FloatArray
    residuals: Sequence[FloatArray]
    jacobians: Sequence[FloatArray]

    def simulate(
        self, experiments: Sequence[Experiment], values: Mapping[str, Value] | None = None
    ) -> list[Simulated]:
        """What the model gives for other experiments or with other values."""
        e = self.estimate
        return self.family.simulate(
            self.variant, e.values if values is None else values, experiments, e.options
        )

    def change(self, found: Sequence[Simulated]) -> list[FloatArray]:
        """Differences of other simulations from those of the fit, over the samples used."""
        return [
            (np.asarray(f.output) - s.simulated)[np.isfinite(s.measured)]
            for f, s in zip(found, self.fitted, strict=True)
        ]

    @property
    def sigma(self) -> float:
        """Root mean square of the residuals [unit of the output]."""
        return float(np.sqrt(np.mean(np.concatenate(self.residuals) ** 2)))

    @property
    def used(self) -> list[npt.NDArray[np.bool_]]:
        """Which samples of every run were used, shape ``(n_i,)`` each."""
        return [np.isfinite(s.measured) for s in self.fitted]

    def number(self, name: str) -> float:
        """Value of a parameter or of one entry of a list, ``levels[2]`` [SI]."""
        key, _, index = name.partition("[")
        return float(np.ravel(self.estimate.values[key])[int(index.rstrip("]") or 0)])

    def places(self) -> list[str]:
        """Where every sample used stands: log and instant, or its number."""
        out = []
        for s, used in zip(self.fitted, self.used):
            e = s.experiment
            for k in np.flatnonzero(used):
                at = f"t = {e.time[k]:.6g} s" if e.time.size else f"sample {k + 1}"
                out.append(f"{e.name}, {at}")
        return out

    def whiten(
        self, columns: Sequence[FloatArray], noise: Sequence[FloatArray] | None = None
    ) -> FloatArray:
        """Stack the columns of all runs, ``(n_i, q)`` each, as the residual becomes white.

        ``noise``, ``(n_i,)`` each, is what becomes white instead of the residual.
        """
        noise = self.residuals if noise is None else noise
        order = int(min(_ORDER, min(r.size for r in noise) // 10))
        coefficients = fit_autoregression(noise, order)[0]
        out = []
        for part in columns:
            rows = part.astype(float)
            for k, c in enumerate(coefficients):
                rows[k + 1 :] -= c * part[: -k - 1]
            out.append(rows[coefficients.size :])
        return np.vstack(out)


def make_optimum(
    family: Family[FamilyOptions],
    variant: Variant,
    estimate: Estimate[FamilyOptions],
    fitted: Sequence[Simulation],
) -> Optimum | None:
    """The fit with its derivatives; ``None`` where it has none to be examined by."""
    residuals = [(s.measured - s.simulated)[np.isfinite(s.measured)] for s in fitted]
    errors = (
        np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
        if estimate.covariance.size
        else np.zeros(0)
    )
    names = estimate.covariance_order
    if not names or min((r.size for r in residuals), default=0) < 20:
        return None
    if not np.all(np.isfinite(errors)) or not np.all(errors > 0.0):
        return None
    if estimate.sensitivity:
        jacobians = [
            j[np.isfinite(s.measured)] if j.shape[0] == s.measured.size else j
            for j, s in zip(estimate.sensitivity, fitted, strict=True)
        ]
        names = names[: jacobians[0].shape[1]]
        errors = errors[: len(names)]
    else:
        blank = Optimum(family, variant, estimate, fitted, (), errors, residuals, ())
        jacobians = _differences(blank, names, errors)
    if any(j.shape[0] != r.size for j, r in zip(jacobians, residuals)):
        return None
    return Optimum(family, variant, estimate, fitted, names, errors, residuals, jacobians)


def _differences(at: Optimum, names: Sequence[str], errors: FloatArray) -> list[FloatArray]:
    """Derivatives of the output by central differences of simulations."""
    columns: list[list[FloatArray]] = [[] for _ in at.fitted]
    runs = [s.experiment for s in at.fitted]
    for name, error in zip(names, errors):
        ends = []
        for sign in (1.0, -1.0):
            values = moved(at.estimate.values, name, sign * _STEP * error)
            ends.append(at.change(at.simulate(runs, values)))
        for k, (up, down) in enumerate(zip(*ends)):
            columns[k].append((up - down) / (2.0 * _STEP * error))
    return [np.column_stack(c) for c in columns]


def moved(values: Mapping[str, Value], name: str, by: float) -> dict[str, Value]:
    """Values with one of them moved; ``name`` may be an entry of a list, ``levels[2]``."""
    key, _, index = name.partition("[")
    value = values[key]
    if not index:
        assert isinstance(value, float)
        return {**values, key: value + by}
    entries = np.array(value, dtype=float)
    entries.flat[int(index.rstrip("]"))] += by
    return {**values, key: entries.tolist()}
