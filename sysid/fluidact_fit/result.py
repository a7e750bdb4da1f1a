"""Result of a fit: numbers, curves, pictures, and the document that becomes a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np
import numpy.typing as npt

from .arguments import require
from .block import Block, ValidRange, are_samples, valid_ranges
from .control import make_block
from .errors import StrictError
from .experiment import FloatArray
from .logs import LogLike, Reading
from .notices import is_note
from .outcome import Outcome, Simulation
from .parameters import ParameterDocument, save_document
from .simulation import simulate_given

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class FitResult(Outcome):
    """A finished fit; see :class:`.outcome.Outcome` for what it holds.

    ``summary()`` tells it in words, ``table()`` and ``to_dataframe()`` list the parameters,
    ``plot()`` shows it, ``save()`` writes it, ``simulate()`` runs it on another log, ``draws()``
    varies it as it is uncertain, and ``model`` is what a controller runs.
    """

    def __repr__(self) -> str:
        fit = self.document.fit
        return (
            f"<FitResult {self.family}: verdict {fit.verdict}, {len(self.parameters)} parameters, "
            f"rmse {fit.rmse.value:.4g} {fit.rmse.unit}, {len(self.fitted)} runs, "
            f"{len(self.notices)} warnings>"
        )

    @property
    def covariance(self) -> FloatArray:
        """Covariance matrix in the order of :attr:`covariance_order`, shape ``(p, p)``."""
        return self.solution.covariance

    @property
    def covariance_order(self) -> tuple[str, ...]:
        """Names of the rows of :attr:`covariance`."""
        return self.solution.names

    def save(
        self, path: str | Path, *, overwrite: bool = False, accept_failed: bool = False
    ) -> Path:
        """Write the parameter file atomically and return its path.

        Parameters
        ----------
        path
            The file.
        overwrite
            Replace a file that exists.
        accept_failed
            Write the file although the verdict is FAIL: the file then says so.

        Raises
        ------
        OutputError
            When the file exists and ``overwrite`` is false, is one of the logs, or cannot be
            written.
        StrictError
            When the verdict is FAIL and that was not accepted.
        """
        document = self.document_to_write(accept_failed)
        return save_document(document, path, overwrite=overwrite, inputs=self.inputs)

    def document_to_write(self, accept_failed: bool = False) -> ParameterDocument:
        """Return the document, marked where it is written against the verdict.

        Raises
        ------
        StrictError
            When the verdict is FAIL and that was not accepted.
        """
        require("truth", accept_failed=accept_failed)
        if self.verdict != "fail":
            return self.document
        if not accept_failed:
            raise StrictError(
                "the verdict is FAIL, nothing was written:",
                expected="\n".join(f"  {n.code}: {n.message}" for n in self.notices),
                remedy="Correct the cause, or give --accept-failed to write the file anyway.",
            )
        return self.document.model_copy(update={"accepted_failed": True})

    def raise_for_notices(self) -> None:
        """Refuse a fit with warnings or notes, as ``strict`` does: an assumed unit is a note.

        Raises
        ------
        StrictError
            When there is a warning or a note.
        """
        if not self.notices:
            return
        notes = sum(is_note(n.code) for n in self.notices)
        counts = ((len(self.notices) - notes, "warning"), (notes, "note"))
        count = " and ".join(f"{n} {word}{'s' * (n > 1)}" for n, word in counts if n)
        raise StrictError(
            f"{count} under --strict; nothing was written:",
            expected="\n".join(f"  {n.code}: {n.message}" for n in self.notices),
            remedy="Remove the causes, or run without --strict.",
        )

    @cached_property
    def model(self) -> Block:
        """Model for a controller, as :func:`.load` returns it from the saved file.

        Raises
        ------
        StrictError
            When the verdict is FAIL.
        """
        block = make_block(self.document)
        block.watching = True
        return block

    @property
    def validity(self) -> Mapping[str, ValidRange]:
        """Role to the range that the data covered; outside it the model extrapolates."""
        return valid_ranges(self.document)

    @overload
    def simulate(
        self, logs: FloatArray | Sequence[float], time: npt.ArrayLike | None = None, **how: Any
    ) -> FloatArray: ...
    @overload
    def simulate(
        self, logs: Sequence[LogLike] | LogLike, **reading: Unpack[Reading]
    ) -> list[Simulation]: ...
    def simulate(self, logs: Any, time: Any = None, **how: Any) -> FloatArray | list[Simulation]:
        """Simulate logs, or samples of the input.

        Parameters
        ----------
        logs
            Logs as :func:`.fit` takes them, columns bound as those of the fit were unless ``how``
            says otherwise; or samples of the input, shape ``(n,)`` [SI].
        time
            Instants of the samples, shape ``(n,)`` [s], as ``model.simulate`` takes them.
        **how
            How the logs are read (:class:`.logs.Reading`), or whatever else ``model.simulate``
            takes.

        Returns
        -------
        list of Simulation, or (n,)
            One entry per run of the logs; of samples, what ``model.simulate`` gives.

        Raises
        ------
        LogError, UsageError
            When a log does not have what the model needs, or the model takes no samples.
        """
        if time is None and not are_samples(logs):
            return simulate_given(self.document, logs, **how)
        return np.asarray(self.model.simulate(logs, time, **how))

    def plot(self) -> Figure:
        """Return a figure: measured against simulated, residuals, and the curve of a map."""
        from .report import plot_result

        return plot_result(self)

    def report(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the page of the fit: values, pictures, warnings, provenance; return its path.

        Raises
        ------
        OutputError
            When the file exists and ``overwrite`` is false, or cannot be written.
        """
        from .report import write_html

        return write_html(self, path, overwrite=overwrite)
