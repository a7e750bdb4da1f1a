"""Is a response missing from the model? One more term at a time, judged without another fit.

A parameter of the family that was not estimated may matter; every input may act later or
earlier than recorded; the output may lag behind (a filter, a transducer, a pole that the model
has not) or drift. Each of these changes the output in a direction of its own. Where the
residual has a significant part in that direction, and taking it along would move a parameter
by more than its interval, the interval does not hold what it says and the fit must not pass in
silence; see :mod:`.score`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.noise import noise_floor
from ..estimation.recursion import run_recursion
from ..experiment import FloatArray, Signal, all_of
from ..family import ParameterSpec, UnmodelledEffect
from ..options import describe
from ..rows import blocks, by_rows
from ..units import after_number, as_share
from .noisy_inputs import beside_copies
from .optimum import Optimum, Series, delayed, root_mean_square, shifted
from .score import Score, Term, judge_term
from .shapes import shape_terms

_PREFERRED = 0.8  # share of the best significance at which a parameter of the family is named
_LAGS = (0.5, 2.0, 8.0, 32.0)  # sample times
_FARTHEST = 10.0  # times the lag that was tried: of a longer one nothing is known
_SHIFT = 0.1  # sample times by which an input is moved to see what a delay does
_SAMPLED = 2.0  # ratio of the changes by a whole sample and a tenth, up to which they are one
_ASIDE = 12, 24  # rows; farther than a velocity is computed from
_ROUGH = 0.05  # noise of a simulated channel, in standard deviations of its residual
_LAG_REMEDY = (
    "A lag: look for a filter, a slow sensor or late time stamps of the output, and for dynamics "
    "that this family does not have. A lead: look for those of an input, or for a missing mass. "
    "Noise of an input and gaps look alike; settle what is said of them first."
)


def find_missing_response(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Judge every term that the model may lack: entries for the file, and a warning."""
    whole = beside_copies(at)
    part = whole.part
    judged = chain(
        (judge_term(whole, t) for t in _terms_of_time(whole)),
        (judge_term(part, t) for t in _terms(part)),
    )
    scores = [s for s in judged if s is not None]
    table = {
        s.term.name: {
            "size": s.size,
            "unit": s.term.unit,
            "deviations": s.deviations,
            "parameter": s.parameter,
            "shift": s.shift,
            "standard_errors": s.errors,
            **s.unseen,
        }
        for s in scores
    }
    telling = [s for s in scores if s.telling]
    if not telling:
        return table, []
    best = max(abs(s.deviations) for s in telling)
    near = [s for s in telling if s.term.offered and abs(s.deviations) > _PREFERRED * best]
    return table, [_notice(at, max(near or telling, key=lambda s: abs(s.deviations)))]


def _terms_of_time(at: Optimum) -> Iterator[Term]:
    """What changes from one log to another, or on the way."""
    yield from _levels(at)
    for name in at.roles:
        yield _drift(at, name)


def _terms(at: Optimum) -> Iterator[Term]:
    """What is always there: what the family offers, delays, lags, shapes."""
    runs = at.experiments
    yield from _offered(at)
    yield from _unmodelled(at)
    if not all(e.time.size for e in runs):
        return
    step = min(e.sample_time for e in runs)
    for role in at.variant.driving:
        if all(role.name in e and e.signals[role.name].time.size > 1 for e in runs):
            yield _delay(at, role.name, step)
    for name in at.roles:
        yield from _lags(at, name, step)
    yield from shape_terms(at)


def _lags(at: Optimum, role: str, step: float) -> Iterator[Term]:
    """Lags behind a channel that was fitted."""
    of, response = ("", "the response") if len(at.roles) == 1 else (f" of {role}", f"'{role}'")
    tracks = [_make_track(at, s) if s.role == role else None for s in at.series]
    for lag in _LAGS:
        behind = _aside(at, _behind(at, tracks, lag * step))
        yield Term(
            f"lag{of} of {lag:g} samples", "s",
            lambda size: f"{response} {'lags' if size > 0.0 else 'leads'} by another "
            f"{1e3 * abs(size):.3g} ms",
            _LAG_REMEDY, behind, most=_FARTHEST * lag * step,
        )  # fmt: skip


def _drift(at: Optimum, role: str) -> Term:
    """A channel that drifts: with the time, or from the first row of a log to the last."""
    unit, said = at.signal(role).unit, at.signal(role).text
    of, it = ("", "the output") if len(at.roles) == 1 else (f" of {role}", f"'{role}'")
    timed = all(s.experiment.time.size for s in at.series)
    columns = []
    for s in at.series:
        t = s.experiment.time if timed else np.linspace(0.0, 1.0, s.used.size)
        since, size = t[0] if timed else 0.0, (s.role == role) / s.scale
        columns.append(by_rows(partial(_ramp, since=since, size=size), all_of(t, s.used)))
    per = "a second" if timed else "from the first row of a log to the last"
    return Term(
        f"drift{of}", f"{unit}/s" if timed else unit,
        lambda size: f"{it} drifts by {said(size)} {per}",
        "Let the sensor warm up, or cut the log with --window." if timed else
        "Go back to the first position at the end and compare. In sorted rows, or in a single "
        "sweep, a drift cannot be told from the curve or from play.", columns,
    )  # fmt: skip


def _ramp(t: FloatArray, since: float, size: float) -> FloatArray:
    return (t - since) * size


def _levels(at: Optimum) -> Iterator[Term]:
    """An output that lies beside that of the other logs, unless each has an offset of its own."""
    role = at.variant.output
    logs = {s.experiment.log: s.experiment.name.split("#")[0] for s in at.series}
    if len(logs) < 2 or any(s.own_level for s in at.series):
        return
    signal = at.signal(role.name)
    for log, name in logs.items():
        yield Term(
            f"offset of log {log + 1}", signal.unit,
            partial(_beside, name, signal), "Check the zero of the sensors, and whether this log "
            "is of the same machine in the same state; fit it by itself.",
            [np.full(int(s.used.sum()), (s.role == role.name and s.experiment.log == log) / s.scale)
             for s in at.series],
        )  # fmt: skip


def _beside(name: str, signal: Signal, size: float) -> str:
    """What an offset of one log would be."""
    way = "above" if size > 0.0 else "below"
    return f"'{signal.role}' of {name} lies {signal.text(abs(size))} {way} that of the other logs"


def _offered(at: Optimum) -> Iterator[Term]:
    """Parameters of the family that were not estimated."""
    freed = {o.frees: o for o in describe(at.family.options_type) if o.frees}
    parameters = at.solution.parameters
    given = [n for n, q in parameters.items() if q.status == "fixed" and isinstance(q.value, float)]
    for name in dict.fromkeys((*given, *(n for n in freed if n not in parameters))):
        spec = at.variant.parameter(name)
        known = parameters.get(name, parameters.get(spec.general))
        if known is not None and known.status == "not_identified":
            continue  # its parts are no better known
        value = known.number if known is not None else spec.neutral or 0.0
        full = replace(at.plant, values={**at.plant.values, name: value})
        columns = at.slopes(full, name)
        if columns is None:
            continue
        instruments = at.slopes(full, name, represented=True) if at.instruments else None
        option = f"another --fix {name}=VALUE"
        if name in freed:
            option = f"--{freed[name].name}={freed[name].choices[-1]}"
        apart = spec.general and name not in parameters
        words = partial(_apart, spec) if apart else partial(_instead, spec, value)
        yield Term(
            name, spec.unit,
            words, f"Try {option}.", columns, offered=True, instruments=instruments or (),
        )  # fmt: skip


def _unmodelled(at: Optimum) -> Iterator[Term]:
    """What a machine of this family may do that no parameter stands for."""
    if at.instruments:
        return  # the inputs are noisy, and what stands in for them is not known here
    for d in at.family.unmodelled_effects(at.plant):
        found = d.response(at.experiments, at.solution.simulate_near)
        if not any(found):
            continue  # not known of these runs
        columns = [
            all_of(found[s.run][s.role], s.used) / s.scale
            if s.role in found[s.run]
            else np.zeros(int(s.used.sum()))
            for s in at.series
        ]
        unit = at.signal(d.of).unit if d.of else d.unit
        words = partial(_departed, replace(d, unit=unit))
        yield Term(d.name, unit, words, d.remedy, columns, positive=d.positive)


def _departed(departure: UnmodelledEffect, size: float) -> str:
    if departure.positive and size < 0.0:
        return _impossible(departure.name, size, departure.unit)
    return departure.words


def _impossible(name: str, value: float, unit: str) -> str:
    return f"{name} were {value:.3g}{after_number(unit)}, which cannot be"


def _instead(spec: ParameterSpec, value: float, change: float) -> str:
    """What another value of a parameter would be."""
    if not spec.minimum <= value + change <= spec.maximum:
        return _impossible(spec.name, value + change, spec.unit)
    return (
        f"{spec.name} is about {value + change:.3g}{after_number(spec.unit)} instead of {value:.3g}"
    )


def _apart(spec: ParameterSpec, change: float) -> str:
    """How far a parameter is from the one that stood for it, which moves too."""
    way = "above" if change > 0.0 else "below"
    return f"{spec.name} is {abs(change):.3g}{after_number(spec.unit)} {way} {spec.general}"


def _delay(at: Optimum, role: str, step: float) -> Term:
    """An input that acts later than recorded."""

    def words(size: float) -> str:
        when = "later" if size > 0.0 else "earlier"
        return f"'{role}' acts {1e3 * abs(size):.3g} ms {when} than recorded"

    columns = _aside(at, _later(at, role, step))
    return Term(
        f"delay of {role}", "s", words,
        "Check that one clock stamps all channels; look for delays of filters, buses and valves.",
        columns,
    )  # fmt: skip


def _later(at: Optimum, role: str, step: float) -> list[FloatArray]:
    """Change of the output per second that an input comes later.

    A model that reads a held input at its samples sees nothing of a shift by part of a sample
    but a whole one. Half the difference of a delay and a lead by one sample is then the
    derivative; as with :func:`_behind`, noise of the input does not tell it from the residual.
    """
    runs = at.experiments
    near = at.change([delayed(e, role, _SHIFT * step) for e in runs])
    if all(e.signals[role].hold == "zoh" for e in runs):
        late = at.change([shifted(e, role, 1) for e in runs])
        if root_mean_square(late) < _SAMPLED * root_mean_square(near):
            early = at.change([shifted(e, role, -1) for e in runs])
            return [(a - b) / (2.0 * step) for a, b in zip(late, early, strict=True)]
    return [c / (_SHIFT * step) for c in near]


def _aside(at: Optimum, columns: Sequence[FloatArray]) -> list[FloatArray]:
    """What stands in for a change in time: the mean of the same over rows before and after.

    No sample is common to it and to the residual, so that noise which is in one column only,
    as that of a computed velocity is, does not tell one direction of time from the other either.
    """
    if not at.instruments:
        return list(columns)
    near, far = _ASIDE
    out = []
    for c in columns:
        total, k = np.concatenate(([0.0], np.cumsum(c))), np.arange(c.size)
        first = np.clip([k - far, k + near], 0, c.size)
        last = np.clip([k - near + 1, k + far + 1], 0, c.size)
        sums, rows = (total[last] - total[first]).sum(axis=0), (last - first).sum(axis=0)
        out.append(sums / np.maximum(rows, 1))
    return out


@dataclass(frozen=True)
class _Track:
    """A simulated channel on an even grid of instants, shape ``(m,)`` each.

    ``grid`` is ``None`` where that is the one of the samples. ``rough`` says that the noise of a
    measured input is in it, and nothing else tells it.
    """

    grid: FloatArray | None
    values: FloatArray
    rough: bool


def _make_track(at: Optimum, s: Series) -> _Track:
    e, t, step = s.experiment, s.experiment.time, s.experiment.sample_time
    grid, values = None, s.simulated
    if not e.uniform or abs(float(t[-1] - t[0]) - (t.size - 1) * step) > 0.5 * step:
        grid = np.arange(t[0], t[-1] + step, step)
        values = np.interp(grid, t, s.simulated)
    rough = not at.copies and noise_floor(values) > _ROUGH * at.sigma * s.scale
    return _Track(grid, values, rough)


def _behind(at: Optimum, tracks: Sequence[_Track | None], lag: float) -> list[FloatArray]:
    """Change of a simulated channel per second of a first-order lag [s] behind it.

    The noise of a measured input is in the simulated output and, with the opposite sign, in
    the residual, which would be taken for a lag. It has no direction in time: half the
    difference of a lag and a lead is free of it.
    """
    out = []
    for s, track in zip(at.series, tracks, strict=True):
        if track is None:
            out.append(np.zeros(int(s.used.sum())))
            continue
        even, step = track.values, s.experiment.sample_time
        change = _lagging(even, step, lag)
        change -= even
        if track.rough:
            lead = _lagging(even[::-1], step, lag)[::-1]
            lead -= even
            change = 0.5 * (change - lead)
        if track.grid is not None:
            change = np.interp(s.experiment.time, track.grid, change)
        change = all_of(change, s.used)
        change /= lag * s.scale
        out.append(change)
    return out


def _lagging(even: FloatArray, step: float, lag: float) -> FloatArray:
    """A signal on straight lines, shape ``(n,)``, behind a first-order lag [s], from rest."""
    decay = float(np.exp(-step / lag))
    ramp = (1.0 - decay) * lag / step  # mean of the decay over a sample
    out, before, held = np.empty(even.size), float(even[0]), float(even[0])
    for at in blocks(even.size):
        driven = (1.0 - ramp) * even[at]
        driven[0] += (ramp - decay) * before + decay * held
        driven[1:] += (ramp - decay) * even[at][:-1]
        out[at] = run_recursion(driven, [decay])
        before, held = float(even[at][-1]), float(out[at][-1])
    return out


def _notice(at: Optimum, s: Score) -> Notice:
    value, spec = at.number(s.parameter), at.variant.parameter(s.parameter.partition("[")[0])
    share = as_share(s.shift, value)
    moved = f"would then change by {s.shift:+.3g}{at.unit(s.parameter)}{share}, more than its "
    moved += "interval allows for"
    if not spec.minimum <= value + s.shift <= spec.maximum:
        moved = "would then leave its range: it cannot be trusted"
    return Notice(
        "unmodelled-response",
        f"something is missing from the model: the data fit better if {s.term.words(s.size)} "
        f"({abs(s.deviations):.0f} standard errors). {s.parameter} {moved}. {s.term.remedy}",
    )
