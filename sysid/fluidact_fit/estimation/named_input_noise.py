"""A fit of named parameters, corrected for the noise of a measured input."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..specification import NoiseLevel
from .input_noise import Corrected, InputNoise, correct
from .parametric import Fitted, no_effect
from .problem import Problem
from .results import Refusal, Solved, determine, find_uninformative
from .significance import DECISIVE
from .whitening import Whitening

BuildHeld = Callable[[Mapping[str, float], Sequence[Experiment], Sequence[Whitening]], Problem]
_CHANGED = 2.0  # change [standard errors] by the correction that is not chance
_LEFT = 0.5  # remaining bias [standard errors] that is worth a warning


def correct_named(
    noise: InputNoise,
    build: BuildHeld,
    fitted: Fitted,
    *,
    refusals: Sequence[Refusal],
    max_half_widths: Mapping[str, float],
    no_effect_at: Mapping[str, float],
) -> Fitted:
    """Estimate again from inputs with noise, and refuse what they do not determine.

    Parameters
    ----------
    build
        ``build(held, experiments, whitening)``: a problem whose nonlinear unknowns are all
        parameters that are not held.
    fitted
        The fit that took the input for exact.
    refusals, max_half_widths, no_effect_at
        As in :func:`.parametric.fit_named`. Noise of an input that accumulates in the output can
        look like an effect that does not exist: a value whose errors allow the one without effect
        is refused.
    """

    def solve_with(held: Mapping[str, float]) -> tuple[Corrected, Solved]:
        exact = build(held, noise.experiments, ())
        found = correct(noise, partial(build, held), exact.vector(fitted.values))
        values = {**fitted.values, **held, **exact.named(found.eta)}
        return found, Solved(values, exact.names, found.covariance, fitted.degrees)

    def undetermined(attempt: tuple[Corrected, Solved]) -> list[Refusal]:
        _, solved = attempt
        near = [
            no_effect(fitted.specs[n], value, fitted.unknowns[n].low)
            for n, value in no_effect_at.items() if n in solved.names
            and abs(solved.values[n] - value) < DECISIVE**0.5 * solved.std_error(n)
        ]  # fmt: skip
        return near or find_uninformative(solved, fitted.specs, max_half_widths)

    # parameters that exact inputs leave undetermined stay so: they may have no effect at all
    every = list({r.parameter: r for r in (*refusals, *fitted.refused.values())}.values())
    done = determine(solve_with, undetermined, fitted.specs, fixed=fitted.fixed, refusals=every)
    found, solved = done.solution
    values = {**solved.values, **fitted.fixed}
    values |= {n: r.value(fitted.specs[n]) for n, r in done.refused.items()}
    kept = [n for n in fitted.notices if n.code != "not-identified"]
    level = NoiseLevel(noise.sigma, noise.relative)
    return replace(
        fitted, values=values, names=solved.names, covariance=solved.covariance, intervals={},
        refused=done.refused, from_scores=True, input_noise={noise.role: level},
        notices=[*kept, *done.notices, *_notices(noise, solved, found, fitted.values)],
    )  # fmt: skip


def _notices(
    noise: InputNoise, solved: Solved, found: Corrected, before: Mapping[str, float]
) -> Iterator[Notice]:
    """Report the noise, the error it would have caused, and what remains of it, if it matters.

    ``before`` is the estimate that took the input for exact.
    """
    signal = noise.experiments[0].signals[noise.role]
    errors = np.array([max(solved.std_error(n), 1e-300) for n in solved.names])
    level = f"'{noise.role}' carries noise of about {signal.text(noise.sigma, '.2g')} rms"
    most, worst = _most_moved(found.bias / errors), _most_moved(found.left / errors)
    if found.weak or not found.converged:
        yield Notice(
            "input-noise-left",
            f"{level}, which looks so much like what the log says of {solved.names[most]} that the "
            "intervals are guesses. Record the input with a cleaner sensor, or move it further "
            "and faster.",
        )
        return
    if abs(found.left[worst]) > _LEFT * errors[worst]:
        yield Notice(
            "input-noise-left",
            f"{level}, too much to be allowed for exactly: {solved.names[worst]} may still be off "
            f"by {found.left[worst]:+.2g}. Record the input with a cleaner sensor, or move it "
            "further.",
        )
        return
    moved = np.array([before[n] - solved.values[n] for n in solved.names])
    most = _most_moved(moved / errors)
    if abs(moved[most]) < _CHANGED * errors[most]:
        return
    yield Notice(
        "input-noise",
        f"{level}, which was allowed for: it would have changed {solved.names[most]} by "
        f"{moved[most]:+.2g}, {abs(moved[most]) / errors[most]:.1f} standard errors. "
        "A cleaner sensor would narrow the intervals, and show sooner what the model lacks.",
    )


def _most_moved(values: FloatArray) -> int:
    return int(np.argmax(np.abs(values)))
