"""Channels that are not straight: play and hysteresis, and a characteristic that is bowed.

Each is a term that a model may lack, judged like the others of :mod:`.structure`. A sensor or
valve with play ``w`` shows ``x - w/2`` on the way up and ``x + w/2`` on the way down; one that is
bowed adds ``1 - s^2`` times its bow amid its range, ``s`` going from -1 to 1 over it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from ..estimation.noise import noise_floor
from ..estimation.recursion import behind_play
from ..experiment import FloatArray
from .beside import all_of
from .optimum import Optimum, root_mean_square, with_readings
from .score import Term

_PART = 0.01  # of its range, by which a channel is bowed, and most play of one
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
        yield from _input_terms(at, role.name, role.unit)


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
    unit = at.variant.role(name).unit
    yield Term(
        f"play of {name}", unit, partial(_played, name, unit), _PLAY, columns, least=_MATTERS
    )


def _width(records: Sequence[FloatArray]) -> float | None:
    """Width of play that records show, ``None`` where it would be lost in their noise."""
    known = [r for r in records if r.size]
    if not known:
        return None
    span = max(float(r.max()) for r in known) - min(float(r.min()) for r in known)
    width = max(_NARROW * span, _ABOVE * max(noise_floor(r) for r in known))
    return width if 0.0 < width <= _PART * span else None


def _input_terms(at: Optimum, role: str, unit: str) -> Iterator[Term]:
    values = [e[role] for e in at.experiments]
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    if low == high:
        return
    bow, width = _PART * (high - low), _width(values)

    def bowed(x: FloatArray) -> FloatArray:
        place = 2.0 * (x - low) / (high - low) - 1.0
        return x + bow * (1.0 - place**2)

    yield from _changed(at, f"bow of {role}", role, bowed, bow, partial(_bowed, role, unit), _BOW)
    if width is not None:
        yield from _changed(
            at, f"play of {role}", role, lambda x: behind_play(x, width), width,
            partial(_played, role, unit), _PLAY,
        )  # fmt: skip


def _changed(
    at: Optimum, name: str, role: str, change: Callable[[FloatArray], FloatArray], size: float,
    words: Callable[[float], str], remedy: str,
) -> Iterator[Term]:  # fmt: skip
    """The term of another reading of an input, per unit of its size."""
    found = at.change([with_readings(e, role, change(e[role])) for e in at.experiments])
    if root_mean_square(found) > _LEAST * at.sigma:
        columns = [c / size for c in found]
        yield Term(name, at.variant.role(role).unit, words, remedy, columns, least=_MATTERS)


def _played(role: str, unit: str, size: float) -> str:
    way = "less" if size > 0.0 else "more"
    return f"'{role}' shows {abs(size):.3g} {unit} {way} on the way up than on the way down"


def _bowed(role: str, unit: str, size: float) -> str:
    way = "more" if size > 0.0 else "less"
    return f"'{role}' is a curve, {abs(size):.3g} {unit} {way} amid its range than a straight line"
