"""What a fit returns: numbers, curves, and the document that becomes a parameter file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import Notice
from .experiment import Experiment, FloatArray
from .family import Estimate, Quantity, Variant

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Simulation:
    """A log that was simulated with the fitted parameters: judged, never fitted."""

    experiment: Experiment
    simulated: FloatArray
    measured: FloatArray


@dataclass(frozen=True)
class FitResult:
    """A finished fit.

    Attributes
    ----------
    family, variant
        What was fitted.
    estimate
        Parameters, covariance, simulated output (:class:`.family.Estimate`).
    experiments
        The data that were fitted.
    validation
        Logs that were only judged.
    document
        The parameter document, ready to be written.
    notices
        All warnings, those of the reader included.
    """

    family: str
    variant: Variant
    estimate: Estimate
    experiments: Sequence[Experiment]
    validation: Sequence[Simulation]
    document: Mapping[str, Any]
    notices: Sequence[Notice] = field(default_factory=tuple)

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Parameters by name: value, unit, standard error, interval, status."""
        return self.estimate.parameters

    @property
    def derived(self) -> Mapping[str, Quantity]:
        """Numbers computed from the parameters."""
        return self.estimate.derived

    @property
    def covariance(self) -> FloatArray:
        """Covariance matrix in the order of :attr:`covariance_order`, shape ``(p, p)``."""
        return self.estimate.covariance

    @property
    def covariance_order(self) -> tuple[str, ...]:
        """Names of the rows of :attr:`covariance`."""
        return self.estimate.covariance_order

    @property
    def verdict(self) -> str:
        """``pass``, ``warn`` or ``fail``."""
        return str(self.document["fit"]["verdict"])

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the parameter file atomically and return its path.

        Raises
        ------
        OutputError
            When the file exists and ``overwrite`` is false, or cannot be written.
        """
        from .parameters import save_document

        return save_document(self.document, path, overwrite=overwrite)

    def plot(self) -> Figure:
        """Return a figure: measured against simulated, residuals, and the curve of a map."""
        from .report import plot_result

        return plot_result(self)
