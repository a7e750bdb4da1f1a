"""The result of a fit on the screen: parameters, verdict, and agreement with every log."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from .show import echo, echo_painted, echo_text, show_table, width_of

if TYPE_CHECKING:
    from fluidact_fit.parameters import ParameterDocument

_MANY_RUNS = 10  # more than fit on a screen beside the table


def echo_parameters(document: ParameterDocument, verbose: bool = False) -> None:
    """Print parameters and derived values of a document, and how well they fit."""
    from fluidact_fit.parameter_table import agreement_parts, parameter_table, recorded_units

    show_table(parameter_table(document, derived=True))
    echo()
    fit = document.fit
    agreement = "   ".join(agreement_parts(fit, recorded_units(document)))
    runs = f" in {len(fit.logs)} runs" if len(fit.logs) > 1 else ""
    _echo_verdict(fit.verdict.upper(), agreement + runs)
    _echo_logs(document, verbose)


def _echo_verdict(verdict: str, agreement: str) -> None:
    """Print the verdict and how well the model fits, in two lines where one is too narrow."""
    width = width_of(sys.stdout)
    if width is None or len(f"verdict {verdict}   {agreement}") <= width:
        echo_painted("verdict ", verdict, "   ", agreement)
    else:
        echo_painted("verdict ", verdict)
        echo_text(agreement)


def _echo_logs(document: ParameterDocument, verbose: bool) -> None:
    """Print how well every run is met, where there are several."""
    from fluidact_fit.parameter_table import log_table

    fitted = document.fit.logs
    if len(fitted) + len(document.validation) < 2 and not verbose:
        return
    if len(fitted) > _MANY_RUNS and not verbose:
        echo(f"The worst of {len(fitted)} runs (-v lists them all):")
        fitted = [min(fitted, key=lambda e: 100.0 if e.fit_percent is None else e.fit_percent)]
    echo()
    show_table(log_table(document, fitted))
