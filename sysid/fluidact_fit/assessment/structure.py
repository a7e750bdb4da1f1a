"""Is a response missing from the model? One more term at a time, judged without another fit.

Every input may act later or earlier than recorded, the output may lag behind (a filter, a
transducer, a pole that the model has not) or drift, and a parameter of the family that was not
asked for may matter. Each of these changes the output in a direction of its own. Where the
residual has a significant part in that direction, and taking it along would move a parameter
by more than its interval, the interval does not hold what it says and the fit must not pass in
silence. This is Rao's score test of one added parameter [1]_; residual and directions are
whitened first, so that autocorrelated noise is not taken for a missing response.

References
----------
.. [1] C. R. Rao, "Large sample tests of statistical hypotheses concerning several
   parameters", Proc. Cambridge Phil. Soc. 44, 1948.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from .optimum import Optimum, moved

_SIGNIFICANT = 5.0  # standard errors of the added term
_MATTERS = 2.0  # standard errors by which a parameter would move
_LAGS = (0.5, 2.0, 8.0, 32.0)  # sample times
_SHIFT = 0.1  # sample times by which an input is moved to see what a delay does
_OWN = 1e-3  # part of a direction that the parameters must leave over to tell it apart


@dataclass(frozen=True)
class Term:
    """One thing that the model may lack.

    ``columns`` are its directions in the output, per run and per ``unit``; ``found`` says in
    words what a size of it is, ``remedy`` what to do.
    """

    name: str
    unit: str
    found: str
    remedy: str
    columns: Sequence[FloatArray]


@dataclass(frozen=True)
class Score:
    """What adding a term would do.

    ``size`` is that of the term [its unit], ``deviations`` that in its standard errors;
    ``parameter`` would move by ``shift`` [its unit], ``errors`` of its standard errors.
    """

    term: Term
    size: float
    deviations: float
    parameter: str
    shift: float
    errors: float


def find_missing_response(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Judge every term that the model may lack: entries for the file, and a warning."""
    scores = [s for s in (_score(at, t) for t in _terms(at)) if s is not None]
    table = {
        s.term.name: {
            "size": s.size,
            "unit": s.term.unit,
            "deviations": s.deviations,
            "parameter": s.parameter,
            "shift": s.shift,
            "standard_errors": s.errors,
        }
        for s in scores
    }
    telling = [s for s in scores if abs(s.deviations) > _SIGNIFICANT and abs(s.errors) > _MATTERS]
    if not telling:
        return table, []
    return table, [_notice(at, max(telling, key=lambda s: abs(s.deviations)))]


def _terms(at: Optimum) -> Iterator[Term]:
    """Everything that is tried: what the family offers, delays, lags and a drift."""
    runs = [s.experiment for s in at.fitted]
    if not all(e.time.size for e in runs):
        return
    step = min(e.sample_time for e in runs)
    for role in at.variant.driving:
        if all(role.name in e and e.signals[role.name].time.size > 1 for e in runs):
            late = [_delayed(e, role.name, _SHIFT * step) for e in runs]
            columns = [c / (_SHIFT * step) for c in at.change(at.simulate(late))]
            yield Term(
                f"delay of {role.name}", "s", f"'{role.name}' acts {{0:.3g}} ms {{1}} than recorded",
                "Check that all channels are stamped by one clock, and look for delays of filters, "
                "buses and valves.", columns,
            )  # fmt: skip
    for lag in _LAGS:
        yield Term(
            f"lag of {lag:g} samples", "s", "the response lags by another {0:.3g} ms or so",
            "Look for a filter or transducer in the measuring chain and for dynamics that this "
            "family does not have.", _behind(at, lag * step),
        )  # fmt: skip
    middle = float(np.mean([e.time.mean() for e in runs]))
    yield Term(
        "drift", "1/s", "the output drifts",
        "Let the sensor warm up, or cut the log with --window.",
        [e.time[u] - middle for e, u in zip(runs, at.used)],
    )  # fmt: skip


def _offered(at: Optimum, runs: Sequence[Experiment]) -> Iterator[Term]:
    """Parameters of the family that were left at their neutral value unasked."""
    values = at.estimate.values
    for name, (step, option) in at.family.unasked(at.variant, values, at.estimate.options).items():
        columns = [c / step for c in at.change(at.simulate(runs, moved(values, name, step)))]
        spec = at.variant.parameter(name)
        yield Term(
            name, spec.unit, f"{name} would be {{0:+.3g}} {spec.unit}, not {values[name]:g}",
            f"Estimate it with {option}, or fix it with --fix {name}=VALUE.", columns,
        )  # fmt: skip


def _delayed(experiment: Experiment, role: str, by: float) -> Experiment:
    """The same run with an input that acts later [s]."""
    signal = experiment.signals[role]
    late = replace(signal, time=signal.time + by)
    return replace(experiment, signals={**experiment.signals, role: late})


def _behind(at: Optimum, lag: float) -> list[FloatArray]:
    """Change of the simulated output per second of a first-order lag [s] behind it."""
    out = []
    for s, used in zip(at.fitted, at.used):
        t, y = s.experiment.time, s.simulated
        grid = np.arange(t[0], t[-1] + s.experiment.sample_time, s.experiment.sample_time)
        even = np.interp(grid, t, y)
        ratio = s.experiment.sample_time / lag
        decay = float(np.exp(-ratio))
        ramp = (1.0 - decay) / ratio  # response to a straight line from sample to sample
        start = [ramp * even[0]]  # at rest at the first value
        late, _ = lfilter([1.0 - ramp, ramp - decay], [1.0, -decay], even, zi=start)
        out.append(((np.interp(t, grid, late) - y) / lag)[used])
    return out


def _score(at: Optimum, term: Term) -> Score | None:
    """Size and significance of a term; ``None`` where the parameters can stand for it."""
    p = len(at.names)
    rows = [
        np.column_stack((j, np.ones(r.size), c, r))
        for j, c, r in zip(at.jacobians, term.columns, at.residuals)
    ]
    white = at.whiten(rows)
    if not np.all(np.isfinite(white)):
        return None
    columns, target = white[:, :-1], white[:, -1]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    own = abs(float(np.linalg.qr(columns / scale, mode="r")[-1, -1]))
    if own < _OWN:
        return None
    x = np.linalg.lstsq(columns / scale, target, rcond=1e-12)[0]
    rest = target - (columns / scale) @ x
    sigma = float(np.sqrt(rest @ rest / max(target.size - p - 2, 1)))
    shifts = (x / scale)[:p]
    errors = shifts / at.errors
    worst = int(np.argmax(np.abs(errors)))
    return Score(
        term, float(x[-1] / scale[-1]), float(x[-1]) * own / max(sigma, 1e-300), at.names[worst],
        float(shifts[worst]), float(errors[worst]),
    )  # fmt: skip


def _notice(at: Optimum, s: Score) -> Notice:
    key = s.parameter.split("[")[0]
    value = at.estimate.values[key]
    share = f" ({100.0 * s.shift / abs(value):+.1f} %)" if isinstance(value, float) and value else ""
    size = 1e3 * s.size if s.term.unit == "s" and "delay" in s.term.name else s.size
    if s.term.unit == "s" and "{1}" not in s.term.found:
        size *= 1e3 if "lag" in s.term.name else 1.0
    words = s.term.found.format(abs(size) if "{1}" in s.term.found else size, "later" if s.size > 0.0 else "earlier")
    return Notice(
        "unmodelled-response",
        f"the residual holds a response that the model does not have: it is explained better "
        f"({abs(s.deviations):.0f} standard errors) if {words}. With it {s.parameter} would "
        f"change by {s.shift:+.3g}{share}, {abs(s.errors):.1f} of its standard errors: its "
        f"interval does not cover this. {s.term.remedy}",
    )
