"""Picture of what the input does to the output without a model, and of the model beside it."""

from __future__ import annotations

import numpy as np

from ..model_free import Views, view_fit
from ..notices import is_note
from ..outcome import Outcome
from ..parameter_table import recorded_units
from .figure import static_view
from .html import Picture
from .inspection import plot_views
from .numbers import percent, scaled
from .reading import picture
from .runs import is_too_long

# Warnings that such a picture explains: the model moves otherwise than the machine.
_EXPLAINED = (
    "closed-loop", "hold-doubtful", "poor-fit", "residuals-autocorrelated", "unmodelled-response",
    "weak-fit",
)  # fmt: skip


def responses_picture(result: Outcome) -> Picture | None:
    """Return impulse, step and frequency response with bands, the model drawn over them.

    ``None`` for static maps, long records, and runs without one input that changes over even
    time. Disagreement raises no warning of its own: the examination of the fit tests for it, and
    the title names the warnings that it gave.
    """
    if static_view(result) is not None or is_too_long(result):
        return None
    views = view_fit(result)
    if views is None or views.model is None:
        return None
    title = "Responses without a model, and those of the model"
    codes = dict.fromkeys(n.code for n in result.notices if not is_note(n.code))
    if explained := [code for code in _EXPLAINED if code in codes]:
        title += f"; warnings about them: {', '.join(explained)}"
    figure = plot_views(views, recorded_units(result.document))
    return picture(figure, title, _in_words(views))


def _in_words(views: Views) -> str:
    """Describe the picture for people who cannot see it."""
    total, half = views.response.step_response
    model = np.cumsum(views.model if views.model is not None else total)
    inside = 100.0 * float(np.mean(np.abs(model - total) <= half))
    low, high = (scaled(end, "s") for end in views.response.delay)
    return (
        f"Impulse response, step response and frequency response of {views.output} to "
        f"{views.role}, from the logs alone with 95 % bands, and the same of the model; coherence; "
        f"correlation of the residual with {views.role}. Dead time {low} to {high}. The step "
        f"response of the model is within its band at {percent(inside)} of the instants."
    )
