"""Channels that are not straight: play and hysteresis, and characteristics of another shape.

Each is a term that a model may lack, judged like the others of :mod:`.structure`. A sensor or
valve with play ``w`` shows ``x - w/2`` on the way up and ``x + w/2`` on the way down; one that is
bowed adds ``1 - s^2`` times its bow amid its range, ``s`` going from -1 to 1 over it. Where a
valve opens softly, differs from one direction to the other or saturates in another way than its
model, its command acts as if it were a little more here and less there: how much at every one of
some places is fitted to the residual, and the curve through them is the term.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..estimation.noise import noise_floor
from ..estimation.recursion import behind_play
from ..experiment import FloatArray, Signal, all_of
from .optimum import Optimum, root_mean_square
from .score import Term, fit_together

_PART = 0.01  # of its range, by which a channel is bowed, and most play of one
_PLACES = 9  # over the range of an input, between which its characteristic is straight
_NARROW = 0.001  # of its range, of which play is: wider, it begins late after a reversal
_ABOVE = 6.0  # times its noise, of which it has to be: narrower, it follows the noise
_MATTERS = 0.005  # of a parameter, by which it has to move: no channel is quite straight
_LEAST = 1e-12  # of the residual, that a change has to be
_PLAY = (
    "Check the coupling of the sensor, its hysteresis, and friction beside what the model has: "
    "they look alike."
)
_BOW = (
    "Check the characteristic of the sensor or valve (--scale is a straight line), or fit a "
    "smaller range; the family force-map takes any shape."
)


def shape_terms(at: Optimum) -> Iterator[Term]:
    """Play of every channel that was fitted, play and bow of every input."""
    if at.instruments or not all(e.time.size for e in at.experiments):
        return  # noise has no way there and back, nor have rows without an order
    for name in at.roles:
        yield from _output_play(at, name)
    for role in at.variant.driving:
        runs = [e.signals.get(role.name) for e in at.experiments]
        if role.name in at.roles or not all(s is not None and s.time.size > 1 for s in runs):
            continue
        yield from _input_terms(at, at.signal(role.name))


def _output_play(at: Optimum, name: str) -> Iterator[Term]:
    own = [s.simulated for s in at.series if s.role == name]
    width = _width([all_of(values, np.isfinite(values)) for values in own])
    if width is None:
        return
    columns = []
    for s in at.series:
        change = np.zeros(s.simulated.size)
        if s.role == name:
            known = np.isfinite(s.simulated)
            change[known] = behind_play(all_of(s.simulated, known), width)
            change[known] -= s.simulated[known]
            change /= width * s.scale
        columns.append(all_of(change, s.used))
    signal = at.signal(name)
    yield Term(
        f"play of {name}", signal.unit, partial(_played, signal), _PLAY, columns, least=_MATTERS
    )


def _width(records: Sequence[FloatArray]) -> float | None:
    """Width of play that records show, ``None`` where it would be lost in their noise."""
    known = [r for r in records if r.size]
    if not known:
        return None
    span = max(float(r.max()) for r in known) - min(float(r.min()) for r in known)
    width = max(_NARROW * span, _ABOVE * max(noise_floor(r) for r in known))
    return width if 0.0 < width <= _PART * span else None


def _input_terms(at: Optimum, signal: Signal) -> Iterator[Term]:
    role = signal.role
    values = [e[role] for e in at.experiments]
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    if low == high:
        return
    yield from _characteristic(at, signal, (low, high))
    width = _width(values)
    if width is None:
        return
    change = _change(at, role, lambda x: behind_play(x, width), width)
    if change is not None:
        yield Term(
            f"play of {role}", signal.unit, partial(_played, signal), _PLAY, change, least=_MATTERS
        )


def _characteristic(at: Optimum, signal: Signal, span: tuple[float, float]) -> Iterator[Term]:
    """A bow, and any curve: straight lines between places over the range."""
    role, unit = signal.role, signal.unit
    places, known = np.linspace(*span, _PLACES), list[int]()
    reach = _PART * (span[1] - span[0])
    columns = [np.zeros((r.size, _PLACES)) for r in at.residuals]
    for k, only in enumerate(np.eye(_PLACES)):
        hat = _change(at, role, partial(_raised, places=places, by=reach * only), reach)
        if hat is None:
            continue
        for c, values in zip(columns, hat, strict=True):
            c[:, len(known)] = values
        known.append(k)
    if not known:
        return
    columns = [c[:, : len(known)] for c in columns]
    place = np.asarray(places[known], dtype=float)

    def term(
        name: str, per: str, words: Callable[[Signal, float], str], way: Sequence[FloatArray]
    ) -> Term:
        return Term(f"{name} {role}", per, partial(words, signal), _BOW, way, least=_MATTERS)

    bow = 1.0 - (2.0 * (place - span[0]) / (span[1] - span[0]) - 1.0) ** 2
    yield term("bow of", unit, _bowed, [c @ bow for c in columns])
    if span[0] < 0.0 < span[1]:
        below = np.minimum(place, 0.0)
        yield term("gain below zero of", "1", _steeper, [c @ below for c in columns])
        aside = _change(at, role, lambda x: x + reach * (x < 0.0), reach)
        if aside is not None:
            yield term("offset below zero of", unit, _aside, aside)
    found = fit_together(at, columns, reach)
    if found is None:
        return
    sizes, count = found
    most = int(np.argmax(np.abs(sizes)))
    words = partial(_bent, float(np.sign(sizes[most])), float(place[most]))
    shape = sizes / max(abs(sizes[most]), np.finfo(float).tiny)
    any_curve = term("characteristic of", unit, words, [c @ shape for c in columns])
    yield replace(any_curve, chosen=count)


def _raised(x: FloatArray, places: FloatArray, by: FloatArray) -> FloatArray:
    return x + np.interp(x, places, by)


def _change(
    at: Optimum, role: str, other: Callable[[FloatArray], FloatArray], size: float
) -> list[FloatArray] | None:
    """What another reading of an input changes, per unit of its size."""
    found = at.change([e.with_readings(role, other(e[role])) for e in at.experiments])
    if not root_mean_square(found) > _LEAST * at.sigma:
        return None
    return [c / size for c in found]


def _played(signal: Signal, size: float) -> str:
    return f"'{signal.role}' shows {_more(signal, -size)} on the way up than on the way down"


def _bowed(signal: Signal, size: float) -> str:
    return f"'{signal.role}' is a curve, {_more(signal, size)} amid its range than a straight line"


def _aside(signal: Signal, size: float) -> str:
    return f"'{signal.role}' acts as {_more(signal, size)} than it shows where it is negative"


def _steeper(signal: Signal, size: float) -> str:
    change = f"{abs(100.0 * size):.3g} % {_way(size)}"
    return f"'{signal.role}' acts by {change} where it is negative than elsewhere"


def _bent(sign: float, place: float, signal: Signal, size: float) -> str:
    change = _more(signal, sign * size)
    return f"'{signal.role}' acts as {change} at {signal.text(place)} than it shows"


def _more(signal: Signal, size: float) -> str:
    return f"{signal.text(abs(size))} {_way(size)}"


def _way(size: float) -> str:
    return "more" if size > 0.0 else "less"
