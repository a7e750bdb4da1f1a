"""Test of whether another hold of an input fits better, by Gauss-Newton steps from the optimum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.blocks import joined
from ..estimation.inputs import choose_hold
from ..estimation.least_squares import scaled_least_squares
from ..estimation.solution import base_name, moved, number
from ..experiment import Hold, Signal
from ..family import Value
from ..outcome import Simulation
from ..rows import LONG
from ..units import as_share
from . import policy
from .optimum import Optimum

_ROUNDS = 3  # Gauss-Newton steps under another hold
_WORDS: dict[Hold, str] = {
    "zoh": "held between its samples",
    "foh": "on straight lines between its samples",
    "smooth": "on a smooth curve through its samples",
}


@dataclass(frozen=True)
class _Shift:
    """Change of the parameters under another hold; its fields are the entry of the file.

    ``parameter`` moves most, by ``shift`` [its unit], which is that many ``standard_errors``.
    ``evidence`` is the change of the negative log-likelihood, ``left`` the ratio of the root mean
    square of the residual to the present one.
    """

    hold: Hold
    other: Hold
    parameter: str
    shift: float
    standard_errors: float
    evidence: float
    left: float


def find_other_holds(at: Optimum, declared: Collection[str]) -> tuple[dict[str, Any], list[Notice]]:
    """Judge the fit under another hold of every role that drives the model.

    Roles in ``declared`` have a hold that the user gave.
    """
    at = at.part
    experiments = at.experiments
    if sum(e.samples for e in experiments) > LONG:  # of all runs together
        return {}, []
    table: dict[str, Any] = {}
    notices: list[Notice] = []
    for role in (r for r in at.variant.driving if r.name in at.driving):
        taken = experiments[0].signals[role.name].hold
        others = [h for h in _WORDS if h != (taken or "zoh")]
        tried = [t for h in others if (t := _shift(at, role.name, h))]
        # no command carries noise: what does was measured, and may have moved in between
        noisy = role.hold == "auto" and role.name in at.solution.noise.inputs
        if not at.solution.residuals_are_fitted and not (noisy and taken == "zoh"):
            tried = [t for t in tried if _explains_forces(at, t)]
        found = _best_hold(tried, [e.signals[role.name] for e in experiments])
        if found is None:
            continue
        table[role.name] = asdict(found)
        given = role.name in declared
        said = _hold_notice(role.name, found, at.solution.values, given)
        if said is None:
            continue
        # a declared hold is the user's word, unless the family calls measured what was held
        trusted = given and (role.hold != "auto" or taken != "zoh")
        unsure = not trusted and _looks_otherwise(at.fitted, role.name, found.hold)
        if said.code == "hold-doubtful" or unsure:
            notices.append(said)
    return table, notices


def _explains_forces(at: Optimum, t: _Shift) -> bool:
    """Return whether another hold explains more than noise.

    Where other channels were fitted besides the output, the residual contains forces as well: it
    has to shrink with the parameter still in its range.
    """
    spec, value = at.variant.parameter(base_name(t.parameter)), number(at.plant, t.parameter)
    return t.left <= policy.HOLD_EXPLAINS and spec.minimum <= value + t.shift <= spec.maximum


def _best_hold(tried: Sequence[_Shift], signals: Sequence[Signal]) -> _Shift | None:
    """Return the hold that fits best, so that following the advice does not lead to another one.

    Of several that fit alike it is the one that the samples look like.
    """
    best = min(tried, key=lambda t: t.evidence, default=None)
    if best is None or best.evidence > -policy.HOLD_EVIDENCE:
        return best
    alike = [t for t in tried if t.evidence - best.evidence < policy.HOLD_EVIDENCE]
    if len(alike) < 2:
        return best
    likely = choose_hold(signals)
    return next((t for t in alike if t.other == likely), best)


def _shift(at: Optimum, role: str, other: Hold) -> _Shift | None:
    """Take Gauss-Newton steps from the optimum under another hold, the derivatives unchanged.

    A long first step ends where the model is no longer linear, so another one is taken. The gain of
    a step under the present hold (the estimate may be at a bound) does not count for the other.
    ``None`` where the model breaks down, or nothing was estimated.
    """
    turned = []
    for e in at.experiments:
        signal = replace(e.signals[role], hold=other)
        turned.append(replace(e, signals={**e.signals, role: signal}))
    before, j = joined(at.residuals), joined(at.jacobians)
    if j.shape[1] == 0:
        return None
    own, noise = np.zeros(j.shape[1]), at.solution.noise
    # a score that is corrected for noise of an input is not zero, wherever the estimate ends
    if not noise.inputs or noise.instruments:
        own = scaled_least_squares(j, before, 1e-10)
    total, plant = -own, at.plant
    for _ in range(_ROUNDS):
        try:
            r = before - np.concatenate(at.change(turned, plant))
        except np.linalg.LinAlgError:  # the model breaks down where the step leads
            return None
        if not np.all(np.isfinite(r)):
            return None
        step = scaled_least_squares(j, r, 1e-10)
        after, total = float(np.sum((r - j @ step) ** 2)), total + step
        if np.abs(step / at.std_errors).max() < policy.TERM_MOVES:
            break
        for name, by in zip(at.names, step):
            plant = moved(plant, name, float(by), at.variant.parameter(base_name(name)))
    deviations = total / at.std_errors
    worst = int(np.argmax(np.abs(deviations)))
    ratio = max(after, 1e-300) / max(float(np.sum((before - j @ own) ** 2)), 1e-300)
    return _Shift(
        at.experiments[0].signals[role].hold or "zoh",
        other,
        at.names[worst],
        float(total[worst]),
        float(deviations[worst]),
        0.5 * r.size * float(np.log(ratio)),
        sqrt(ratio),
    )


def _hold_notice(
    role: str, found: _Shift, values: Mapping[str, Value], declared: bool
) -> Notice | None:
    """A warning when the hold matters and the data do not confirm the one assumed or declared."""
    moves = abs(found.standard_errors) > policy.TERM_MOVES
    if not moves or found.evidence > policy.HOLD_EVIDENCE:
        return None
    value = values[base_name(found.parameter)]
    share = as_share(found.shift, value) if isinstance(value, float) else ""
    taken, better = _WORDS[found.hold], _WORDS[found.other]
    if found.evidence < -policy.HOLD_EVIDENCE:
        code = "hold-doubtful"
        lead = f"the data fit better with '{role}' {better} than {taken}"
        then = (
            "Resolve this first; the other warnings may follow from it. If it was right, "
            "look for lost rows, gaps, clipping or a lag."
        )
    else:
        code = "hold-matters"
        if declared:
            code = "hold-as-given"
        lead = f"the data cannot tell whether '{role}' is {taken}"
        # What was declared is a note on an assumption; nothing in the data speaks against it.
        then = "" if declared else "If it was right, look for lost rows, gaps, clipping or a lag."
    return Notice(
        code,
        f"{lead}; with --hold {role}={found.other} {found.parameter} would change by "
        f"{found.shift:+.3g}{share}, {abs(found.standard_errors):.1f} standard errors. Commands "
        "are held (zoh), measured signals are not (foh or smooth): give --hold by what the signal "
        f"is, not by what fits. {then}".rstrip(),
    )


def _looks_otherwise(fitted: Sequence[Simulation], role: str, hold: Hold) -> bool:
    """Return whether an input does not look as its hold has it.

    A measured signal moves little within a sample; at which instant between two samples it jumped,
    no data can tell. A command is held from one sample to the next; one that glides for much of the
    time and never jumps may have moved in between.
    """
    values = [s.experiment.signals[role].values for s in fitted]
    span = max(float(np.ptp(v)) for v in values)
    steps = np.abs(np.concatenate([np.diff(v) for v in values]))
    jumps = bool(steps.max(initial=0.0) > policy.HOLD_JUMP * span)
    return jumps if hold != "zoh" else not jumps and float(np.mean(steps > 0.0)) > policy.HOLD_MOVES
