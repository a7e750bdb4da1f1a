"""Is a response missing from the model? One more term at a time, judged without another fit.

A parameter of the family that was not estimated may matter; every input may act later or
earlier than recorded; the output may lag behind (a filter, a transducer, a pole that the model
has not) or drift. Each of these changes the output in a direction of its own. Where the
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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..options import describe
from .optimum import Optimum, delayed, moved

_SIGNIFICANT = 5.0  # standard errors of the added term
_MATTERS = 2.0  # standard errors by which a parameter would move
_PREFERRED = 0.8  # share of the best significance at which a parameter of the family is named
_LAGS = (0.5, 2.0, 8.0, 32.0)  # sample times
_SHIFT = 0.1  # sample times by which an input is moved to see what a delay does
_SMALL = 0.3  # standard deviations of the residual by which a parameter is moved
_OWN = 1e-3  # part of a direction that the parameters must leave over to tell it apart


@dataclass(frozen=True)
class Term:
    """One thing that the model may lack.

    ``columns`` are its directions in the output, per run and per ``unit``; ``words`` says what
    a size of it would mean, ``remedy`` what to do. ``offered`` marks a parameter of the family.
    """

    name: str
    unit: str
    words: Callable[[float], str]
    remedy: str
    columns: Sequence[FloatArray]
    offered: bool = False


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

    @property
    def telling(self) -> bool:
        """Whether the term is there, and matters."""
        return abs(self.deviations) > _SIGNIFICANT and abs(self.errors) > _MATTERS


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
    telling = [s for s in scores if s.telling]
    if not telling:
        return table, []
    best = max(abs(s.deviations) for s in telling)
    near = [s for s in telling if s.term.offered and abs(s.deviations) > _PREFERRED * best]
    return table, [_notice(at, max(near or telling, key=lambda s: abs(s.deviations)))]


def _terms(at: Optimum) -> Iterator[Term]:
    """Everything that is tried: what the family offers, delays, lags and a drift."""
    runs = [s.experiment for s in at.fitted]
    yield from _offered(at, runs)
    if not all(e.time.size for e in runs):
        return
    step = min(e.sample_time for e in runs)
    for role in at.variant.driving:
        if all(role.name in e and e.signals[role.name].time.size > 1 for e in runs):
            yield _delay(at, runs, role.name, _SHIFT * step)
    middle = float(np.mean([e.time.mean() for e in runs]))
    for channel in at.roles:
        alone = len(at.roles) == 1
        of, it = ("", "the output") if alone else (f" of {channel}", f"'{channel}'")
        response = "the response" if alone else it
        for lag in _LAGS:
            yield Term(
                f"lag{of} of {lag:g} samples", "s",
                lambda size, response=response: (  # type: ignore[misc]
                    f"{response} lags by another {1e3 * size:.3g} ms"
                ),
                "Look for a filter or transducer in the measuring chain and for dynamics that "
                "this family does not have.", _behind(at, channel, lag * step),
            )  # fmt: skip
        yield Term(
            f"drift{of}", "1/s",
            lambda size, it=it: f"{it} drifts",  # type: ignore[misc]
            "Let the sensor warm up, or cut the log with --window.",
            [(s.role == channel) * (s.experiment.time[s.used] - middle) for s in at.series],
        )  # fmt: skip


def _offered(at: Optimum, runs: Sequence[Experiment]) -> Iterator[Term]:
    """Parameters of the family that were not estimated."""
    freed = {o.frees: o.name for o in describe(at.family.options_type) if o.frees}
    values, parameters = at.estimate.values, at.estimate.parameters
    given = [n for n, q in parameters.items() if q.status == "fixed" and isinstance(q.value, float)]
    for name in dict.fromkeys((*given, *(n for n in freed if n not in parameters))):
        spec = at.variant.parameter(name)
        value = parameters[name].number if name in parameters else spec.neutral or 0.0
        full = {**values, name: value}
        step = _SHIFT * runs[0].sample_time if spec.unit == "s" else abs(value) * 1e-3 or 1.0
        columns = at.change(at.simulate(runs, moved(full, name, step)))
        size = float(np.sqrt(np.mean(np.concatenate(columns) ** 2)))
        if not (np.isfinite(size) and size > 0.0):
            continue
        if spec.unit != "s":
            step *= _SMALL * at.sigma / size
            columns = at.change(at.simulate(runs, moved(full, name, step)))
        option = f"--{freed[name]}=estimate" if name in freed else f"another --fix {name}=VALUE"
        yield Term(
            name, spec.unit,
            lambda size, name=name, value=value, unit=spec.unit: (  # type: ignore[misc]
                f"{name} is about {value + size:.3g} {unit} instead of {value:.3g}"
            ),
            f"Try {option}.", [c / step for c in columns], offered=True,
        )  # fmt: skip


def _delay(at: Optimum, runs: Sequence[Experiment], role: str, by: float) -> Term:
    """An input that acts later than recorded."""
    late = at.simulate([delayed(e, role, by) for e in runs])
    columns = [c / by for c in at.change(late)]

    def words(size: float) -> str:
        when = "later" if size > 0.0 else "earlier"
        return f"'{role}' acts {1e3 * abs(size):.3g} ms {when} than recorded"

    return Term(
        f"delay of {role}", "s", words,
        "Check that one clock stamps all channels; look for delays of filters, buses and valves.",
        columns,
    )  # fmt: skip


def _behind(at: Optimum, role: str, lag: float) -> list[FloatArray]:
    """Change of a simulated channel per second of a first-order lag [s] behind it."""
    from scipy.signal import lfilter

    out = []
    for s in at.series:
        t, y, step = s.experiment.time, s.simulated, s.experiment.sample_time
        if s.role != role:
            out.append(np.zeros(int(s.used.sum())))
            continue
        grid = np.arange(t[0], t[-1] + step, step)
        even = np.interp(grid, t, y)
        decay = float(np.exp(-step / lag))
        ramp = (1.0 - decay) * lag / step  # mean of the decay over a sample
        start = [ramp * even[0]]  # at rest at the first value
        late, _ = lfilter([1.0 - ramp, ramp - decay], [1.0, -decay], even, zi=start)
        out.append(((np.interp(t, grid, late) - y) / lag)[s.used] / s.scale)
    return out


def _score(at: Optimum, term: Term) -> Score | None:
    """Size and significance of a term; ``None`` where the parameters can stand for it."""
    p = len(at.names)
    white = at.whiten(
        [
            np.column_stack(parts)
            for parts in zip(at.jacobians, at.levels, term.columns, at.residuals)
        ]
    )
    if not np.all(np.isfinite(white)):
        return None
    columns, target = white[:, :-1], white[:, -1]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    own = abs(float(np.asarray(np.linalg.qr(columns / scale, mode="r"))[-1, -1]))
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
    value = at.number(s.parameter)
    share = f" ({100.0 * s.shift / abs(value):+.1f} %)" if value else ""
    return Notice(
        "unmodelled-response",
        "the residual holds a response that the model does not have: the data fit better "
        f"({abs(s.deviations):.0f} standard errors) if {s.term.words(s.size)}. {s.parameter} would "
        f"then change by {s.shift:+.3g}{share}, {abs(s.errors):.1f} standard errors: more than its "
        f"interval allows for. {s.term.remedy}",
    )
