"""Pictures in words, for who cannot see them: what is drawn, numbers, and what follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..outcome import Outcome, Simulation, agreement
from ..parameter_table import recorded_units
from .details import physics_view
from .figure import static_view
from .numbers import choose_scale, count, percent, scaled, short
from .runs import choose, drive_role, worst_residual

_WHITE = 0.01  # p value from which residuals count as white, as on the page


def describe_fit(result: Outcome) -> str:
    """The picture of a fit in words."""
    fit, view = result.document.fit, static_view(result)
    used, units = f"{count(fit.samples)} samples", recorded_units(result.document)
    if view is None:
        law = physics_view(result)
        beneath = "Beneath: close-ups of the largest residual and of the sharpest edge"
        parts = [_over_time(result.fitted, result), beneath + (f"; {law.title}." if law else ".")]
    else:
        x, y = (choose_scale(u, float(np.abs(v[view.used]).max(initial=0.0)), units)
                for u, v in ((view.x_unit, view.x), (view.y_unit, view.measured)))  # fmt: skip
        ranges = (f"{short(v[view.used].min() * s.factor, 3)} to "
                  f"{short(v[view.used].max() * s.factor, 3)} {s.unit}".rstrip()
                  for v, s in ((view.x, x), (view.measured, y)))  # fmt: skip
        over, of = ranges
        curves = ", ".join(c.label for c in view.curves) or "fitted curve"
        parts = [f"{view.y_name} over {view.x_name}: {used} from {over}, {of}, with {curves}.",
                 "Below, the residuals over the same axis and their distribution."]  # fmt: skip
    parts += [
        f"Fit {percent(fit.fit_percent)} over {used}, "
        f"rmse {scaled(fit.rmse.value, fit.rmse.unit, units)}.",
        _whiteness(result),
        f"Verdict {result.verdict.upper()}.",
    ]
    warned = [w.code for w in result.document.warnings]
    if result.verdict != "pass" and warned:
        parts.append(f"Warnings: {', '.join(dict.fromkeys(warned))}.")
    return " ".join(p for p in parts if p)


def describe_validation(result: Outcome) -> str:
    """The picture of the logs that were not fitted in words."""
    found = agreement(result.validation)
    return (f"{_over_time(result.validation, result)} Fit {percent(found.fit_percent)} over "
            f"{count(found.samples)} samples that were not fitted.")  # fmt: skip


def _over_time(runs: Sequence[Simulation], result: Outcome) -> str:
    """Describe the signals over time, the agreement of every run, and the worst residual."""
    shown, output = choose(runs).runs, result.variant.output
    drive = drive_role(result.variant)
    recorded = recorded_units(result.document)
    unit = shown[0].experiment.signals[output.name].unit if shown else output.unit
    below = ", the residuals" + (f" and {drive}" if drive else "")
    out = (
        f"{output.name}, measured and simulated, over time{below}; "
        f"{len(shown)} of {len(runs)} runs."
    )
    if len(shown) <= 3:
        out += "".join(
            f" {r.experiment.name}: fit {percent(r.agreement.fit_percent)}, largest residual "
            f"{scaled(worst_residual(r)[0], unit, recorded)}." for r in shown
        )  # fmt: skip
    return out


def _whiteness(result: Outcome) -> str:
    w = result.document.fit.residual_whiteness
    if w is None:
        return ""
    return "Residuals are white." if w.p_value >= _WHITE else "Residuals are autocorrelated."
