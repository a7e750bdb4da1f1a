"""Presentation that a finished fit and a loaded model share, from their document."""

from __future__ import annotations

import html
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import require
from .errors import Notice, UsageError, in_python
from .notices import is_note
from .parameter_table import agreement_parts, entries, parameter_table, recorded_units
from .parameters import read_document
from .parameters.document import ParameterDocument
from .parameters.draws import draw_values, place_of
from .parameters.validation import Lookup
from .specification import Variant
from .tables import Table

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

_COLOURS = {"pass": "#2e7d32", "warn": "#b26a00", "fail": "#c62828"}


class Presented:
    """Views of the ``document`` of a ``variant``: a table, a summary, draws.

    ``table()`` and ``summary()`` are for people, ``to_dataframe()`` and ``draws()`` for programs;
    a notebook shows the object itself as ``summary()`` says it.
    """

    document: ParameterDocument
    variant: Variant

    @property
    def verdict(self) -> str:
        """Verdict of the fit: ``pass``, ``warn`` or ``fail``."""
        return str(self.document.fit.verdict)

    def table(self, *, derived: bool = True) -> Table:
        """Return the parameters as a table that prints itself and shows itself in a notebook.

        Values stand in the units of the log, or in those that engineers use, with SI beside them.

        Parameters
        ----------
        derived
            Whether numbers computed from the parameters follow, such as a time constant.
        """
        return parameter_table(self.document, derived)

    def to_dataframe(self, *, derived: bool = False) -> DataFrame:
        """Return the parameters as a table of pandas, an entry of a list in each row.

        Parameters
        ----------
        derived
            Whether numbers computed from the parameters follow.

        Returns
        -------
        DataFrame
            By name: ``value``, ``std_error``, ``low`` and ``high`` of the 95 % interval
            [``unit``], ``relative_percent`` (standard error as a part of the value), ``status``,
            and ``reason``: why a parameter was not identified, and what would determine it.
        """
        import pandas as pd  # slow to load

        reasons = why_not_identified(self.document)
        records = [
            {
                "parameter": r.name,
                "value": r.value,
                "std_error": np.nan if r.std_error is None else r.std_error,
                "low": r.interval[0] if r.interval else np.nan,
                "high": r.interval[1] if r.interval else np.nan,
                "unit": r.unit,
                "relative_percent": np.nan if r.percent is None else r.percent,
                "status": r.status,
                "reason": in_python(reasons.get(place_of(r.name)[0], "")),
            }
            for r in entries(self.document, derived)
        ]
        return pd.DataFrame(records).set_index("parameter")

    def draws(self, n: int = 1000, *, chains: int = 1, seed: int = 0) -> Dataset:
        """Draw parameters as they are uncertain, for ArviZ.

        They have a normal distribution with the covariance of the file, cut off at the physical
        ranges of the parameters and at the bounds they were fitted within. An interval that was
        found by profiling the likelihood may be less symmetrical than the draws.

        Parameters
        ----------
        n
            How many in each chain.
        chains
            How many chains, all alike: ``arviz.summary`` asks for two or more.
        seed
            Seed of the random numbers.

        Returns
        -------
        xarray.Dataset
            One variable per estimated parameter [SI], with dimensions ``chain`` and ``draw``, and
            the places of a list; as ArviZ takes it.

        Raises
        ------
        UsageError
            When xarray is not installed, or the file holds no covariance.
        """
        try:
            import xarray as xr
        except ImportError:
            raise UsageError(
                "draws need xarray, which is not installed.",
                remedy="Install it: pip install 'fluidact-fit[xarray]'",
            ) from None
        document = self.document
        if document.covariance is None:
            raise UsageError(
                f"this {document.family} has no covariance to draw from.",
                expected="Expected parameters that were estimated with their uncertainty.",
            )
        require("whole", n=n, chains=chains, seed=0 if seed is None else seed)
        if n < 1 or chains < 1 or (seed is not None and seed < 0):
            raise UsageError(
                f"draws({n}, chains={chains}, seed={seed}) cannot be.",
                expected="Expected numbers of 1 or more, and a seed of 0 or more.",
            )
        rng = np.random.default_rng(seed)
        values = draw_values(document, self.variant, rng, chains * n).reshape(chains, n, -1)
        arrays: dict[str, Any] = {}
        for k, name in enumerate(document.covariance.order):
            head, indices = place_of(name)
            if head not in arrays:
                nominal = np.array(document.parameters[head].value, dtype=float)
                arrays[head] = np.tile(nominal, (chains, n) + (1,) * nominal.ndim)
            arrays[head][(slice(None), slice(None), *indices)] = values[:, :, k]
        variables = {
            name: (
                ["chain", "draw", *(f"{name}_dim_{k}" for k in range(array.ndim - 2))],
                array,
                {"units": document.parameters[name].unit},
            )
            for name, array in arrays.items()
        }
        coordinates = {"chain": np.arange(chains), "draw": np.arange(n)}
        return xr.Dataset(variables, coordinates, {"family": document.family, "seed": seed})

    def summary(self) -> str:
        """Return verdict, parameters, validation and warnings as text."""
        lines = [self._headline(f"verdict {self.verdict}, ")]
        lines += [f"  {line}" for line in repr(self.table()).splitlines()]
        lines += _validation(self.document)
        lines += [f"{word} ({code}): {text}" for word, code, text in _notices(self.document)]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.summary()

    def _headline(self, verdict: str = "") -> str:
        """Family and agreement, with the verdict before it if that is given."""
        agreement = ", ".join(agreement_parts(self.document.fit, recorded_units(self.document)))
        return f"{self.document.family}: {verdict}{agreement}"

    def _repr_html_(self) -> str:
        """The same for notebooks."""
        verdict = self.verdict
        badge = (
            f'<span style="background:{_COLOURS[verdict]};color:#fff;padding:0.1em 0.5em;'
            f'border-radius:0.3em"><b>{verdict.upper()}</b></span>'
        )
        parts = [f"<p>{badge} {html.escape(self._headline())}</p>"]
        parts.append(self.table()._repr_html_())
        parts += [f"<p>{html.escape(line)}</p>" for line in _validation(self.document)]
        if notices := _notices(self.document):
            entries = (
                f"<li><b>{word}</b> ({html.escape(code)}): {html.escape(text)}</li>"
                for word, code, text in notices
            )
            parts.append(f"<ul>{''.join(entries)}</ul>")
        return "".join(parts)


ParametersLike = Presented | ParameterDocument | str | PathLike[str]


def document_of(given: ParametersLike, lookup: Lookup) -> ParameterDocument:
    """Return the document of a result or a model, or read and check that of a file.

    ``lookup`` finds families by name. ``ParameterFileError`` when a file is not valid.
    """
    if isinstance(given, ParameterDocument):
        return given
    return given.document if isinstance(given, Presented) else read_document(given, lookup)


def weak_file(document: ParameterDocument, name: str = "the parameter file") -> list[Notice]:
    """Return a notice where the verdict of a file is not ``pass``.

    Whatever is computed from such a file inherits its weakness.
    """
    verdict = document.fit.verdict
    if verdict == "pass":
        return []
    codes = dict.fromkeys(w.code for w in document.warnings if not is_note(w.code))
    why = f" ({', '.join(codes)})" if codes else ""
    return [
        Notice(
            "weak-file",
            f"{name} has the verdict {verdict.upper()}{why}. Look at its warnings before you "
            "rely on its numbers.",
        )
    ]


def _validation(document: ParameterDocument) -> list[str]:
    units = recorded_units(document)
    return [
        f"validation {entry.file}: {', '.join(agreement_parts(entry, units))}"
        for entry in document.validation
    ]


def _notices(document: ParameterDocument) -> list[tuple[str, str, str]]:
    """Word, code and text of every warning; files of later versions may hold unknown codes."""
    out = []
    for entry in document.warnings:
        word = "note" if is_note(entry.code) else "warning"
        out.append((word, entry.code, in_python(entry.message)))
    return out


def why_not_identified(document: ParameterDocument) -> dict[str, str]:
    """Parameters that were not identified, with what the warning says of each."""
    said = [w.message for w in document.warnings if w.code == "not-identified"]
    lost = [n for n, p in document.parameters.items() if p.status == "not_identified"]
    return {n: next((m for m in said if m.startswith(f"{n} ")), "") for n in lost}
