"""What a fit returns: numbers, curves, pictures, and the document that becomes a file."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import StrictError, in_python
from .experiment import FloatArray
from .family import Quantity
from .logs import LogLike, open_logs
from .notices import is_information
from .outcome import Outcome, Simulation, percent_text
from .parameters import ParameterDocument, save_document
from .simulation import simulate_logs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class FitResult(Outcome):
    """A finished fit; see :class:`.outcome.Outcome` for what it holds.

    ``summary()`` tells it in words, ``plot()`` shows it, ``save()`` writes it, ``simulate()``
    runs it on another log.
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

    def summary(self) -> str:
        """Verdict, parameters with intervals, and warnings, as text."""
        fit = self.document.fit
        lines = [
            f"{self.family}: verdict {fit.verdict}, rmse {fit.rmse.value:.4g} {fit.rmse.unit}"
            + ("" if fit.fit_percent is None else f", fit {percent_text(fit.fit_percent)}")
        ]
        rows = [_row(name, q) for name, q in self.parameters.items()]
        wide = [max(map(len, column)) for column in zip(*rows)]
        lines += [
            f"  {r[0]:{wide[0]}}  {r[1]:>{wide[1]}}  {r[2]:{wide[2]}}  {r[3]:{wide[3]}}  {r[4]}"
            for r in rows
        ]
        lines += [f"[{n.code}] {in_python(n.message)}" for n in self.notices]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Table of the parameters, for notebooks."""
        rows = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in _row(name, q)) + "</tr>"
            for name, q in self.parameters.items()
        )
        said = "".join(f"<li>{html.escape(in_python(n.message))}</li>" for n in self.notices)
        titles = ("parameter", "value", "std error", "unit", "95 % interval")
        head = "<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>"
        return f"<p>{html.escape(repr(self)[1:-1])}</p><table>{head}{rows}</table>" + (
            f"<ul>{said}</ul>" if said else ""
        )

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
        """Refuse a fit of which anything is to be said, as ``strict`` does.

        Raises
        ------
        StrictError
            When there is a warning or a note.
        """
        if not self.notices:
            return
        notes = sum(is_information(n.code) for n in self.notices)
        counts = ((len(self.notices) - notes, "warning"), (notes, "note"))
        count = " and ".join(f"{n} {word}{'s' * (n > 1)}" for n, word in counts if n)
        raise StrictError(
            f"{count} under --strict, nothing was written:",
            expected="\n".join(f"  {n.code}: {n.message}" for n in self.notices),
            remedy="Remove the causes, or run without --strict.",
        )

    def simulate(self, logs: Sequence[LogLike] | LogLike) -> list[Simulation]:
        """Simulate other logs, one entry per run; columns are bound as those of the fit were.

        Raises
        ------
        LogError, UsageError
            When a log does not have what the model needs.
        """
        return simulate_logs(self.document, open_logs(logs))

    def plot(self) -> Figure:
        """Return a figure: measured against simulated, residuals, and the curve of a map."""
        from .report import plot_result

        return plot_result(self)


def _row(name: str, q: Quantity) -> tuple[str, str, str, str, str]:
    """Name, value, standard error, unit and interval of a parameter as text."""
    status = q.status.replace("_", " ")
    if isinstance(q.value, list):
        return name, f"[{len(q.value)} entries]", "", q.unit, status
    error = f"± {q.std_error:.2g}" if isinstance(q.std_error, float) and q.std_error else ""
    if isinstance(q.ci95, list | tuple) and q.status == "estimated":
        return name, f"{q.value:.6g}", error, q.unit, f"{q.ci95[0]:.6g} .. {q.ci95[1]:.6g}"
    return name, f"{q.value:.6g}", error, q.unit, status
