"""What the residuals show about a fit: noise or model error, hold, feedback.

None of this needs a second fit: another hold is judged by a few Gauss-Newton steps from the
optimum, with the Jacobian that the fit already has.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import erfc, sqrt
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.blocks import joined
from ..estimation.inputs import choose_hold
from ..estimation.least_squares import scaled_least_squares
from ..estimation.noise import noise_floor
from ..estimation.solution import moved, number
from ..estimation.uncertainty import fit_autoregression, innovations
from ..experiment import FloatArray, Hold, Signal, all_of, where_finite
from ..family import Family, FamilyOptions, Plant, Solution, Value, Variant
from ..outcome import Simulation, sum_of_squares
from ..units import as_share
from .channels import judge_channels
from .conditional import find_conditional
from .given import find_reliance
from .independence import find_independent_samples
from .influence import find_deciding_samples, find_disagreeing_parts
from .optimum import Optimum
from .structure import find_missing_response

_EXAMINATIONS = {
    "independence": find_independent_samples,
    "influence": find_deciding_samples,
    "parts": find_disagreeing_parts,
    "missing_response": find_missing_response,
    "given": find_reliance,
    "conditional": find_conditional,
}
_TELL_MORE = ("unmodelled-response", "halves-disagree")
_LAGS = 10
_ONE_SIDED = 1.5  # times the correlation with the input's past: more than chance, and than misfit
_PAST = 20  # highest order of an autoregression of input or residual
_SERIES = 50_000  # samples of a run that are correlated
_DECISIVE = 7.0  # difference of log-likelihoods: a thousand to one
_MOVING = 0.2  # part of the samples in which a command moves that may not be held
_ROUNDS = 3  # Gauss-Newton steps under another hold
_LONG_STEP = 2.0  # standard errors of a step after which another one is taken
_EXPLAINS = 0.7  # of the residual, which another hold leaves at most where forces are in it
_JUMP = 0.25  # part of its range that an input crosses in one sample when it jumps
_LONG = 200_000  # samples of all runs together, beyond which no other hold is tried
_WORDS: dict[Hold, str] = {
    "zoh": "held between its samples",
    "foh": "on straight lines between its samples",
    "smooth": "on a smooth curve through its samples",
}


def diagnose(
    family: Family[FamilyOptions],
    variant: Variant,
    solution: Solution[FamilyOptions],
    fitted: Sequence[Simulation],
    at: Optimum | None,
    declared: Collection[str] = (),
) -> tuple[dict[str, Any], list[Notice]]:
    """Examine a finished fit; returns entries for the file and warnings.

    ``fitted`` are the runs simulated with the estimate, ``at`` the same with its derivatives.
    ``declared`` are the roles whose hold the user has given: those are not questioned, unless
    the data contradict them.
    """
    details, notices = _examined(at)
    details["channels"], missed = judge_channels(family, solution, fitted)
    notices += missed
    if not all(s.experiment.time.size for s in fitted):
        return details, notices
    holds, doubts = _other_holds(at, declared) if at is not None else ({}, [])
    correlation, feedback = _cross_correlation(variant, fitted, solution.noise.inputs)
    found = {
        "residual_to_noise": _noise_or_model(
            fitted, _noise_through_model(family, variant, solution, fitted)
        ),
        "intersample": holds,
        "cross_correlation": correlation,
        **details,
    }
    kept = {key: entry for key, entry in found.items() if entry not in (None, {})}
    return kept, [*doubts, *feedback, *notices]


def _examined(at: Optimum | None) -> tuple[dict[str, Any], list[Notice]]:
    """What the derivatives of the fit show."""
    details: dict[str, Any] = {}
    notices: list[Notice] = []
    if at is None:
        return details, notices
    for name, examine in _EXAMINATIONS.items():
        details[name], said = examine(at)
        notices += said
    if any(n.code in _TELL_MORE for n in notices):  # what they name changes slowly as well
        notices = [n for n in notices if n.code != "errors-change-slowly"]
    return {name: entry for name, entry in details.items() if entry}, notices


def _noise_through_model(
    family: Family[FamilyOptions],
    variant: Variant,
    solution: Solution[FamilyOptions],
    fitted: Sequence[Simulation],
) -> list[float]:
    """Mean square that noise of the inputs adds to the residual of every run."""
    if not solution.noise.inputs:
        return [0.0] * len(fitted)
    rng = np.random.default_rng(0)
    moved = []
    for s in fitted:
        e = s.experiment
        for role, noise in solution.noise.inputs.items():
            x = e.signals[role].values
            e = e.with_readings(role, x + noise.sigma * rng.standard_normal(x.size))
        moved.append(e)
    again = family.simulate(solution.plant, moved)
    return [float(np.nanmean((a.output - s.simulated) ** 2)) for a, s in zip(again, fitted)]


def _noise_or_model(fitted: Sequence[Simulation], through: Sequence[float]) -> float | None:
    """Residual in units of the noise that output and inputs themselves show.

    Near one, the residual is noise. Far above, it is what the model does not describe.
    ``through`` is the mean square that comes from the inputs, run by run.
    """
    error, floor = 0.0, 0.0
    for s, own in zip(fitted, through):
        residual = s.residual
        used = where_finite(residual)
        samples = np.count_nonzero(used)
        if samples < 50:
            continue
        error += sum_of_squares(all_of(residual, used))
        noise = noise_floor(all_of(s.measured, used), robust=False)
        floor += float(samples) * (noise**2 + own)
    return sqrt(error / floor) if floor > 0.0 else None


@dataclass(frozen=True)
class _Shift:
    """How another hold would change the parameters, as the file tells it.

    ``evidence`` is the change of the negative log-likelihood, ``left`` the root mean square of the
    residual in parts of the present one.
    """

    hold: Hold
    other: Hold
    parameter: str
    shift: float
    standard_errors: float
    evidence: float
    left: float


def _other_holds(at: Optimum, declared: Collection[str]) -> tuple[dict[str, Any], list[Notice]]:
    """Judge the fit under another hold of every role that drives the model."""
    at = at.part
    experiments = at.experiments
    if sum(e.samples for e in experiments) > _LONG:
        return {}, []
    table: dict[str, Any] = {}
    notices: list[Notice] = []
    for role in at.variant.driving:
        driving = [e for e in experiments if role.name in e and e.signals[role.name].time.size > 1]
        if len(driving) < len(experiments):
            continue
        taken = experiments[0].signals[role.name].hold
        others = [h for h in _WORDS if h != (taken or "zoh")]
        tried = [t for h in others if (t := _shift(at, role.name, h))]
        # no command carries noise: what does was measured, and may have moved in between
        noisy = role.hold == "auto" and role.name in at.solution.noise.inputs
        if not at.solution.minimised and not (noisy and taken == "zoh"):
            tried = [t for t in tried if _explains_forces(at, t)]
        found = _best_hold(tried, [e.signals[role.name] for e in driving])
        if found is None:
            continue
        table[role.name] = asdict(found)
        said = _hold_notice(role.name, found, at.solution.values)
        unsure = role.name not in declared and _looks_otherwise(at.fitted, role.name, found.hold)
        if said and (said.code == "hold-doubtful" or unsure):
            notices.append(said)
    return table, notices


def _explains_forces(at: Optimum, t: _Shift) -> bool:
    """Whether another hold explains what is not noise.

    Where more was compared than the output the residual holds forces as well: it has to shrink,
    with every parameter in its range.
    """
    spec, value = at.variant.parameter(t.parameter.partition("[")[0]), number(at.plant, t.parameter)
    return t.left <= _EXPLAINS and spec.minimum <= value + t.shift <= spec.maximum


def _best_hold(tried: Sequence[_Shift], signals: Sequence[Signal]) -> _Shift | None:
    """What fits best is named: whoever follows the advice is not told the next one.

    Of two that fit alike it is the one that the samples look like.
    """
    best = min(tried, key=lambda t: t.evidence, default=None)
    if best is None or best.evidence > -_DECISIVE:
        return best
    alike = [t for t in tried if t.evidence - best.evidence < _DECISIVE]
    if len(alike) < 2:
        return best
    likely = choose_hold(signals)
    return next((t for t in alike if t.other == likely), best)


def _shift(at: Optimum, role: str, other: Hold) -> _Shift | None:
    """Gauss-Newton steps from the optimum under another hold, the derivatives as they are.

    A long first step ends where the model is no longer linear, and another one is taken.
    """
    turned = []
    for e in at.experiments:
        signal = replace(e.signals[role], hold=other)
        turned.append(replace(e, signals={**e.signals, role: signal}))
    before, j = joined(at.residuals), joined(at.jacobians)
    if j.shape[1] == 0:
        return None
    total, plant = np.zeros(j.shape[1]), at.plant
    for _ in range(_ROUNDS):
        r = before - np.concatenate(at.change(turned, plant))
        if not np.all(np.isfinite(r)):
            return None
        step = scaled_least_squares(j, r, 1e-10)
        after, total = float(np.sum((r - j @ step) ** 2)), total + step
        if np.abs(step / at.errors).max() < _LONG_STEP:
            break
        for name, by in zip(at.names, step):
            plant = moved(plant, name, _within(at, name, plant, float(by)))
    deviations = total / at.errors
    worst = int(np.argmax(np.abs(deviations)))
    ratio = max(after, 1e-300) / max(float(before @ before), 1e-300)
    return _Shift(
        at.experiments[0].signals[role].hold or "zoh",
        other,
        at.names[worst],
        float(total[worst]),
        float(deviations[worst]),
        0.5 * r.size * float(np.log(ratio)),
        sqrt(ratio),
    )


def _within(at: Optimum, name: str, plant: Plant[FamilyOptions], by: float) -> float:
    """A change of a parameter that keeps it in its physical range."""
    spec, now = at.variant.parameter(name.partition("[")[0]), number(plant, name)
    return float(np.clip(now + by, spec.minimum, spec.maximum)) - now


def _hold_notice(role: str, found: _Shift, values: Mapping[str, Value]) -> Notice | None:
    """A warning when the hold matters and the data do not confirm the one assumed."""
    if abs(found.standard_errors) <= 2.0 or found.evidence > _DECISIVE:
        return None
    value = values[found.parameter.split("[")[0]]
    share = as_share(found.shift, value) if isinstance(value, float) else ""
    taken, better = _WORDS[found.hold], _WORDS[found.other]
    if found.evidence < -_DECISIVE:
        code = "hold-doubtful"
        lead = f"the data fit better with '{role}' {better} than {taken}"
        then = (
            "Settle it first: what else is said of this fit may come from it. If it was right, "
            "look for lost rows, gaps, clipping or a lag."
        )
    else:
        code = "hold-matters"
        lead = f"the data cannot tell whether '{role}' is {taken}"
        then = "If it was right, look for lost rows, gaps, clipping or a lag."
    return Notice(
        code,
        f"{lead}; with --hold {role}={found.other} {found.parameter} would change by "
        f"{found.shift:+.3g}{share}, {abs(found.standard_errors):.1f} standard errors. Commands "
        "are held (zoh), measured signals are not (foh or smooth): give --hold by what the signal "
        f"is, not by what fits. {then}",
    )


def _looks_otherwise(fitted: Sequence[Simulation], role: str, hold: Hold) -> bool:
    """Whether an input does not look like what it is taken for.

    What moves little in a sample was measured while it moved: when a jump of a measured signal
    took place between two samples no data can tell. A command is held from one sample to the
    next; one that glides for much of the time and never jumps may as well have moved in between.
    """
    values = [s.experiment.signals[role].values for s in fitted]
    span = max(float(np.ptp(v)) for v in values)
    steps = np.abs(np.concatenate([np.diff(v) for v in values]))
    jumps = bool(steps.max(initial=0.0) > _JUMP * span)
    return jumps if hold != "zoh" else not jumps and float(np.mean(steps > 0.0)) > _MOVING


def _cross_correlation(
    variant: Variant, fitted: Sequence[Simulation], noisy: Collection[str]
) -> tuple[dict[str, Any], list[Notice]]:
    """Correlation of the residual with the input before and after it.

    Both are whitened first (Box and Jenkins). A residual that follows the input shows
    dynamics that the model lacks; an input that follows the residual, feedback. What the model
    lacks correlates with the future of an input as well where that can be told from its past
    (a chirp), so feedback is only what is stronger on its own side. The noise of ``noisy``
    inputs is in the residual as well and tells neither.
    """
    table: dict[str, Any] = {}
    notices: list[Notice] = []
    for role in variant.driving:
        if role.name in noisy:
            continue
        past, future, count = np.zeros(_LAGS), np.zeros(_LAGS), 0
        for s in fitted:
            pair = _whitened(s, role.name)
            if pair is None:
                continue
            u, r = pair
            past += [u[:-k] @ r[k:] for k in range(1, _LAGS + 1)]
            future += [u[k:] @ r[:-k] for k in range(1, _LAGS + 1)]
            count += u.size
        if count < 200:
            continue
        feedback = _significance(future / sqrt(count))
        alone = float(np.abs(future).max()) > _ONE_SIDED * float(np.abs(past).max())
        table[role.name] = {
            "residual_follows_input": _significance(past / sqrt(count)),
            "input_follows_residual": feedback,
        }
        if feedback < 1e-5 and alone:
            notices.append(_feedback_notice(role.name, int(np.argmax(np.abs(future))) + 1))
    return table, notices


def _whitened(run: Simulation, role: str) -> tuple[FloatArray, FloatArray] | None:
    """Innovations of input and residual, of unit variance; None when one has none."""
    size = run.measured.size
    if role not in run.experiment or run.experiment.signals[role].time.size != size:
        return None
    residual = run.measured[:_SERIES] - run.simulated[:_SERIES]
    if size < 100 or not np.all(np.isfinite(residual)):
        return None
    out = []
    for series in (run.experiment[role][:_SERIES], residual):
        centred = series - series.mean()
        a, variance = fit_autoregression([centred], _PAST)
        innovation = innovations(centred, a)[_PAST - a.size :]
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
    samples = "sample" if lag == 1 else "samples"
    return Notice(
        "closed-loop",
        f"'{role}' follows the residual of the output {lag} {samples} later: the log was recorded "
        "in closed loop, where noise of the output comes back through the input and biases the "
        "parameters. Record with the controller off or with an added excitation, or with a "
        "cleaner sensor.",
    )
