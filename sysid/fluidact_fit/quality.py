"""How well a model describes logs, and what verdict that deserves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .errors import Notice
from .estimation.uncertainty import Whiteness, whiteness
from .experiment import FloatArray
from .notices import is_information


@dataclass(frozen=True)
class Agreement:
    """Measured against simulated: RMSE [unit of the output], fit [%], samples used."""

    rmse: float
    fit_percent: float
    samples: int
    sum_of_squares: float


def agreement(measured: Sequence[FloatArray], simulated: Sequence[FloatArray]) -> Agreement:
    """Pooled agreement; every log is compared with its own mean, samples at NaN left out.

    ``fit = 100 (1 - ||y - y_model|| / ||y - mean(y)||)`` as in MATLAB's ``compare``.
    """
    error, spread, samples = 0.0, 0.0, 0
    for y, model in zip(measured, simulated):
        used = np.isfinite(y) & np.isfinite(model)
        if not used.any():
            continue
        error += float(np.sum((y[used] - model[used]) ** 2))
        spread += float(np.sum((y[used] - y[used].mean()) ** 2))
        samples += int(used.sum())
    rmse = float(np.sqrt(error / max(samples, 1)))
    if spread > 0.0:
        fit = 100.0 * (1.0 - float(np.sqrt(error / spread)))
    else:
        fit = 100.0 if error == 0.0 else 0.0
    return Agreement(rmse, fit, samples, error)


def residual_whiteness(
    measured: Sequence[FloatArray], simulated: Sequence[FloatArray], unknowns: int
) -> Whiteness:
    """Ljung-Box test of the residuals of all logs."""
    rest = []
    for y, model in zip(measured, simulated):
        r = y - model
        rest.append(r[np.isfinite(r)])
    return whiteness(rest, unknowns)


def judge(
    overall: Agreement,
    notices: Sequence[Notice],
    residual_to_noise: float | None = None,
    white: Whiteness | None = None,
) -> tuple[str, list[Notice]]:
    """Verdict ``pass``, ``warn`` or ``fail`` and the reasons as notices."""
    reasons: list[Notice] = []
    if (
        residual_to_noise is not None
        and white is not None
        and residual_to_noise > 3.0
        and white.p_value < 1e-3
        and overall.fit_percent < 99.0
    ):
        reasons.append(
            Notice(
                "residuals-autocorrelated",
                f"the residuals are {residual_to_noise:.0f} times the noise of the output and "
                "autocorrelated: this machine does something that the model does not. The "
                "intervals allow for the autocorrelation, not for a wrong model; look at the "
                "picture (--plot) and judge whether the misfit matters where the model will be "
                "used.",
            )
        )
    if overall.fit_percent < 20.0:
        reasons.append(
            Notice(
                "poor-fit",
                f"the simulated output explains {overall.fit_percent:.1f} % of the measured one. "
                "Check the columns, units and signs, or whether this family describes the machine.",
            )
        )
        return "fail", reasons
    if overall.fit_percent < 60.0:
        reasons.append(
            Notice(
                "weak-fit",
                f"the simulated output explains only {overall.fit_percent:.1f} % of the measured "
                "one; look at the picture (--plot) before using the numbers.",
            )
        )
    if not all(is_information(n.code) for n in (*notices, *reasons)):
        return "warn", reasons
    return "pass", reasons
