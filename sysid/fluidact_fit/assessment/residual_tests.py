"""Tests that begin with residuals: noise or model error, missed channels, feedback."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import erfc, sqrt
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.input_noise import with_noise
from ..estimation.noise import noise_floor
from ..estimation.solution import moved
from ..estimation.uncertainty import fit_autoregression, innovations, whiteness
from ..experiment import Experiment, FloatArray, all_of, where_finite
from ..family import Family, FamilyOptions, Solution, Variant
from ..options import describe
from ..outcome import Simulation, sum_of_squares
from . import policy
from .optimum import Optimum

_LAGS = 10  # samples before and after, over which input and residual are correlated
_ORDER = 20  # highest order of an autoregression of input or residual
_MOST_SAMPLES = 50_000  # of a run that are correlated


def residual_to_noise(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], fitted: Sequence[Simulation]
) -> float | None:
    """Ratio of the residual to the noise that output, inputs and residual themselves show.

    Near one, the residual is noise. Far above, it is model error. ``None`` where there is no noise,
    or too few samples.
    """
    error, floor = 0.0, 0.0
    for s, own in zip(fitted, _noise_through_model(family, solution, fitted)):
        used = where_finite(s.residual)
        samples = np.count_nonzero(used)
        if samples < policy.FEW:
            continue
        residual, measured = all_of(s.residual, used), all_of(s.measured, used)
        error += sum_of_squares(residual)
        noise = noise_floor(measured, robust=False) ** 2 + own
        floor += float(samples) * max(noise, noise_floor(residual) ** 2)
    return sqrt(error / floor) if floor > 0.0 else None


def _noise_through_model(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], fitted: Sequence[Simulation]
) -> list[float]:
    """Mean square that noise of the inputs adds to the residual of every run [output unit^2]."""
    if not solution.noise.inputs:
        return [0.0] * len(fitted)
    runs, rng = [s.experiment for s in fitted], np.random.default_rng(0)
    moved = with_noise(runs, solution.noise.inputs, rng)
    again = family.simulate(solution.plant, moved)
    return [float(np.nanmean((a.output - s.simulated) ** 2)) for a, s in zip(again, fitted)]


def judge_channels(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], fitted: Sequence[Simulation]
) -> tuple[dict[str, Any], list[Notice]]:
    """Judge the channels besides the output: entries for the file, and a warning."""
    table: dict[str, Any] = {}
    missed = []
    for role in dict.fromkeys(role for s in fitted for role in s.also):
        own = [s for s in fitted if role in s.also]
        pairs = [s.others[role] for s in own]
        code = max(s.experiment.signals[role].resolution for s in own) / sqrt(12.0)
        found = _judge_channel(pairs, len(solution.names), code)
        if found is None:
            continue
        table[role] = found
        structured = found["p_value"] < policy.HALVES
        if found["times_noise"] > policy.CHANNEL_MISSED and structured:
            signal = next(s.experiment.signals[role] for s in fitted if role in s.also)
            missed.append(
                f"'{role}' by {signal.text(found['rmse'])} "
                f"({found['times_noise']:.2g} times its noise)"
            )
    return table, [_channel_notice(family, solution, missed)] if missed else []


def _judge_channel(
    pairs: Sequence[tuple[FloatArray, FloatArray]], unknowns: int, code: float
) -> dict[str, Any] | None:
    """Residual of a channel over all runs, in its unit and relative to its noise.

    The noise is at least ``code``, the standard deviation of the error of the converter: at rest
    that error persists, and no difference shows it. ``None`` where there are too few samples.
    """
    error, floor, residuals = 0.0, 0.0, []
    for measured, simulated in pairs:
        used = np.isfinite(measured) & np.isfinite(simulated)
        if used.sum() < policy.FEW:
            continue
        residuals.append((measured - simulated)[used])
        error += float(residuals[-1] @ residuals[-1])
        floor += float(used.sum()) * max(_noise(measured[used], residuals[-1]), code) ** 2
    if not residuals or floor <= 0.0:
        return None
    samples = sum(r.size for r in residuals)
    return {
        "rmse": sqrt(error / samples),
        "times_noise": sqrt(error / floor),
        "p_value": whiteness(residuals, unknowns).p_value,
    }


def _noise(measured: FloatArray, residual: FloatArray) -> float:
    """Standard deviation of the noise of a channel, the steps of a converter included.

    Differences of the residual are free of the fast motion that differences of the channel contain.
    """
    return max(
        noise_floor(residual, robust=True),
        min(noise_floor(x, robust=False) for x in (measured, residual)),
    )


def _channel_notice(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], missed: Sequence[str]
) -> Notice:
    given = [
        f"--{o.name}"
        for o in describe(family.options_type)
        if o.kind == "float" and getattr(solution.options, o.keyword)
    ]
    numbers = f"the given numbers ({', '.join(given)}), " if given else ""
    return Notice(
        "channel-missed",
        f"the model misses {' and '.join(missed)}, in a way that is not random: something that was "
        "given or recorded is not as the machine was, and the parameters make up for it. Check "
        f"{numbers}scale and zero of the sensors, that one clock stamps all channels, and that "
        "nothing leaks.",
    )


def reversed_gains(variant: Variant, solution: Solution[FamilyOptions]) -> Iterator[Notice]:
    """Report an output that falls as an input rises: a reversing machine, or a wrong sign."""
    output, inputs = variant.output.name, [r.name for r in variant.driving]
    for spec in variant.parameters:
        if not spec.ratio:
            continue
        top, bottom, q = spec.ratio[0], spec.ratio[-1], solution.parameters.get(spec.name)
        if top == output and bottom in inputs and q is not None and np.all(np.array(q.value) < 0.0):
            yield Notice(
                "sign-reversed",
                f"{spec.name} is negative: '{output}' falls as '{bottom}' rises. If that is "
                f"not so, give --scale {bottom}=-1 or --scale {output}=-1.",
            )


def find_feedback(
    variant: Variant,
    solution: Solution[FamilyOptions],
    fitted: Sequence[Simulation],
    at: Optimum | None = None,
) -> tuple[dict[str, Any], list[Notice]]:
    """Correlate the residual with the input before and after it, to find feedback.

    Both are whitened first (Box and Jenkins). A residual that follows the input shows dynamics that
    the model lacks; an input that follows the residual shows feedback. Missing dynamics correlate
    with the future of a predictable input (a chirp) as well, so feedback has to be the stronger of
    the two. Correlation within the sample is feedback where the model answers its input later.
    Noise of an input that the solution allows for is in the residual as well.

    Feedback of white noise biases nothing, since an input answers earlier noise only, and that of
    an encoder next to nothing: where the derivatives are known (``at``), a warning is given if it
    moves a parameter noticeably.

    Returns
    -------
    Entries for the file by role, and warnings.
    """
    table: dict[str, Any] = {}
    notices: list[Notice] = []
    for role in (r.name for r in variant.driving):
        pairs = [pair for s in fitted if (pair := _whitened(s, role)) is not None]
        count = sum(u.size for u, _ in pairs)
        if count < 4 * policy.FEW:
            continue
        lags = range(1, _LAGS + 1)
        past = np.array([sum(u[:-k] @ r[k:] for u, r in pairs) for k in lags])
        future = np.array([sum(u[k:] @ r[:-k] for u, r in pairs) for k in lags])
        now = np.array([sum(u @ r for u, r in pairs)])
        noisy = role in solution.noise.inputs
        strong = not noisy or abs(now[0]) > policy.FEEDBACK_BY_NOISE * count
        at_once = strong and _is_feedback(now, past, count)
        suspected = at_once or _is_feedback(future, past, count)
        answers_at_once = _answers_at_once(solution, fitted, role) if suspected else True
        if answers_at_once is None:
            continue  # the model does not use it
        if at_once and not answers_at_once:
            future = np.append(now, future)
        elif noisy:
            continue
        elif at_once:  # noise of the input, which whitening spreads over later samples
            past = np.append(now, past)
        first = _LAGS + 1 - future.size
        table[role] = {
            "residual_follows_input": _significance(past / sqrt(count)),
            "input_follows_residual": _significance(future / sqrt(count)),
        }
        if _is_feedback(future, past, count) and (
            at is None or moved_by_feedback(at.part, role) > policy.FEEDBACK_MOVES
        ):
            notices.append(_feedback_notice(role, int(np.argmax(np.abs(future))) + first))
    return table, notices


def moved_by_feedback(at: Optimum, role: str) -> float:
    """Largest shift of a parameter by noise that came back through an input [standard errors].

    With the input less what follows the residual as instrument: its derivatives ``Z`` are not
    correlated with the noise, and the estimate would move by ``(Z'J)^-1 Z'e`` [1]_. Infinite where
    the fit has instruments of its own or several channels, or cannot be simulated without it.

    References
    ----------
    .. [1] T. Soderstrom, P. Stoica, "Instrumental variable methods for system identification",
       Springer, 1983.
    """
    if at.instruments or len(at.roles) > 1:
        return np.inf
    runs = [_without_feedback(s, role) for s in at.fitted]
    plain = at.change(runs)
    steps = [at.change(runs, moved(at.plant, n, h)) for n, h in zip(at.names, at.std_errors)]
    slopes = [np.column_stack(own) - p[:, None] for *own, p in zip(*steps, plain)]
    level = [s.own_level for s in at.series]
    z, j, e = (
        np.concatenate([x - free * x.mean(axis=0) for x, free in zip(parts, level)])
        for parts in (slopes, [j * at.std_errors for j in at.jacobians], at.residuals)
    )
    if not np.all(np.isfinite(z)):
        return np.inf
    instrumental, least_squares = (np.linalg.lstsq(x.T @ j, x.T @ e, rcond=None)[0] for x in (z, j))
    return float(np.abs(instrumental - least_squares).max())


def _without_feedback(run: Simulation, role: str) -> Experiment:
    """Return the run with an input less what of it follows the residual within some samples."""
    if not _is_recorded(run, role):
        return run.experiment
    u, e = run.experiment[role], np.nan_to_num(np.asarray(run.residual))
    a, _ = fit_autoregression([u - u.mean()], _ORDER)
    e = e - e.mean()
    rows = innovations(e, a)
    later = np.column_stack(
        [np.append(np.zeros(k), rows[: rows.size - k]) for k in range(_LAGS + 1)]
    )
    response = np.linalg.lstsq(later, innovations(u - u.mean(), a), rcond=None)[0]
    return run.experiment.with_readings(role, u - np.convolve(e, response)[: e.size])


def _is_feedback(future: FloatArray, past: FloatArray, count: int) -> bool:
    """Return whether sums of ``count`` products with the future are no chance, and dominate."""
    one_sided = np.abs(future).max() > policy.ONE_SIDED * np.abs(past).max()
    return bool(one_sided) and _significance(future / sqrt(count)) < policy.CHANCE


def _answers_at_once(
    solution: Solution[FamilyOptions], fitted: Sequence[Simulation], role: str
) -> bool | None:
    """Return whether the model answers an input within the sample; ``None`` where it never does.

    One sample is moved to the far end of the range: a motion state has no other values.
    """
    recorded = [run for run in fitted if _is_recorded(run, role)]
    s = max(recorded, key=lambda run: run.experiment.samples)
    values, k = s.experiment[role], s.experiment.samples // 2
    low, high = float(values.min()), float(values.max())
    other = values.copy()
    other[k] = low if 2.0 * values[k] > low + high else high
    before, after = (
        solution.simulate_near(solution.plant, [e])[0].output
        for e in (s.experiment, s.experiment.with_readings(role, other))
    )
    change = np.nan_to_num(np.abs(np.asarray(after) - before))
    return bool(change[k] > 0.01 * change[k:].max()) if change.any() else None


def _is_recorded(run: Simulation, role: str) -> bool:
    """Return whether a role was sampled with the output: a step given by the user was not."""
    signals = run.experiment.signals
    return role in signals and signals[role].time.size == run.measured.size


def _whitened(run: Simulation, role: str) -> tuple[FloatArray, FloatArray] | None:
    """Innovations of input and residual, of unit variance; ``None`` where one has none.

    Samples that the model does not describe at the beginning, within a dead time, are left out.
    """
    if not _is_recorded(run, role):
        return None
    residual = np.asarray(run.residual[:_MOST_SAMPLES])
    known = np.flatnonzero(np.isfinite(residual))
    first = int(known[0]) if known.size else 0
    residual = residual[first:]
    if residual.size < 2 * policy.FEW or not np.all(np.isfinite(residual)):
        return None
    out = []
    for series in (run.experiment[role][first : first + residual.size], residual):
        centred = series - series.mean()
        a, variance = fit_autoregression([centred], _ORDER)
        innovation = innovations(centred, a)[_ORDER - a.size :]
        spread = float(innovation.std())
        if spread <= 1e-4 * float(centred.std()) or spread == 0.0 or variance <= 0.0:
            return None
        out.append((innovation - innovation.mean()) / spread)
    return out[0], out[1]


def _significance(correlations: FloatArray) -> float:
    """Probability that independent series show a correlation this large at any lag."""
    largest = float(np.max(np.abs(correlations)))
    return min(1.0, correlations.size * erfc(largest / sqrt(2.0)))


def _feedback_notice(role: str, lag: int) -> Notice:
    when = f"{lag} {'sample' if lag == 1 else 'samples'} later" if lag else "in the same sample"
    return Notice(
        "closed-loop",
        f"'{role}' follows the residual of the output {when}: the log was recorded "
        "in closed loop, where noise of the output comes back through the input and biases the "
        "parameters. Record with the controller off or with an added excitation, or with a "
        "cleaner sensor.",
    )
