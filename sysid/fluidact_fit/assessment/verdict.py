"""Verdict on a fit, and its reasons.

A warning turns ``pass`` into ``warn`` by its severity (:mod:`.notices`); what makes a fit fail, or
adds reasons of its own, stands here.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import Notice
from ..estimation.uncertainty import Whiteness, whiteness
from ..experiment import all_of, where_finite
from ..notices import is_note
from ..outcome import Agreement, Simulation
from ..tables import percent_text
from . import policy
from .refusal_causes import Cause


def residual_whiteness(fitted: Sequence[Simulation], unknowns: int) -> Whiteness:
    """Ljung-Box test of the residuals of all runs, with that many ``unknowns`` fitted."""
    return whiteness([all_of(s.residual, where_finite(s.residual)) for s in fitted], unknowns)


def judge(
    overall: Agreement,
    notices: Sequence[Notice],
    residual_to_noise: float | None = None,
    white: Whiteness | None = None,
    cause: Cause | None = None,
    given: str = "",
) -> tuple[str, list[Notice]]:
    """Return the verdict, ``pass``, ``warn`` or ``fail``, and its reasons as notices.

    A fit fails where it explains less than half of the variance of the output, unless its residual
    is white and no larger than the noise of the output.

    Parameters
    ----------
    overall
        Agreement of all runs together.
    notices
        Notices given so far.
    residual_to_noise, white
        As :func:`.residual_tests.residual_to_noise` and :func:`residual_whiteness` give them.
    cause, given
        Possible cause of a failure in the logs, and options of the user that may be one.
    """
    ratio = residual_to_noise or 0.0
    structured = white is not None and white.p_value < policy.STRUCTURED
    missed = 100.0 - overall.fit_percent
    misses = f"the model misses the output by {percent_text(missed, '.0f')} of what it moves (RMS)"
    noise_alone = 0.0 < ratio < policy.NOISE_ALONE and not structured
    if overall.fit_percent < policy.FIT_POOR and not noise_alone:
        words = f"{cause.words} {misses}. {cause.remedy}" if cause else (
            f"{misses}. Check the columns, units and signs, or whether this family describes the "
            "machine."
        )  # fmt: skip
        if given:
            words += f" Or these logs contradict {given} (in SI): try without."
        return "fail", [Notice("poor-fit", words)]
    reasons: list[Notice] = []
    if ratio > policy.TIMES_NOISE and structured and overall.fit_percent < policy.FIT_CLOSE:
        reasons.append(
            Notice(
                "residuals-autocorrelated",
                f"the model misses the output by {percent_text(missed, '.1f')} of what it "
                f"moves (RMS), {ratio:.0f} times its noise, and not at random: something in the "
                "machine, a sensor or a given value is not in the model. No interval "
                "covers that. Look at the picture (--plot): a slow trend is a drift, peaks at "
                "reversals are friction, mass or a delay.",
            )
        )
    if overall.fit_percent < policy.FIT_WEAK:
        remedy = "; look at the picture (--plot) before using the numbers."
        if noise_alone:
            remedy = (
                ", all of it noise of the output, which the intervals include. Move further, or "
                "record with a cleaner sensor, to narrow them."
            )
        reasons.append(Notice("weak-fit", misses + remedy))
    if not all(is_note(n.code) for n in (*notices, *reasons)):
        return "warn", reasons
    return "pass", reasons
