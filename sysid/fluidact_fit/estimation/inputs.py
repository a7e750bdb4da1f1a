"""Inputs as exact functions of time: piecewise polynomials with kinks.

A sampled signal says nothing about what happens between its samples until a hold is
chosen. The hold is turned into a piecewise polynomial here, once, and everything after
this point is exact for that polynomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import get_args

import numpy as np
import numpy.typing as npt

from ..errors import UsageError
from ..experiment import Array, Experiment, FloatArray, Hold, Signal
from ..rows import blocks, middle_of
from .noise import PER_MEDIAN, white_level
from .significance import SEEN
from .spline import FEWEST, cubic_pieces

GAP = 3.5  # usual sample times that a curve is drawn across
_FEWEST_TOLD = 16  # samples that a comparison of curves and lines needs
_ENOUGH = 20_000  # samples that compare them as well as a million
_CLEARLY = 0.9  # ratio of squared errors of cubics to those of lines that is clearly better
# variances of a prediction from every second sample of white noise of variance 1
_NOISE_OF_LINE, _NOISE_OF_CUBIC = 1.5, 1.755
_SPREAD_OF_BOTH = 1.7  # deviation of their difference times the root of n; with a signal: 0.9
_NOISY = 0.1  # share of the power of a signal that noise may have


@dataclass(frozen=True)
class Kinks:
    """Bends between nodes.

    Each adds ``sum_i bend[i - 1] * (t - node - offset)**i`` (``i = 1..degree``) from
    ``offset`` after its node until the next node. ``interval`` has shape ``(k,)`` (index
    of the node before, never falling), ``offset`` shape ``(k,)`` [s] and ``bend`` shape
    ``(k, degree)`` [unit/s**i]; the last two may be complex, which is how derivatives travel
    (see :mod:`.separable`).
    """

    interval: npt.NDArray[np.intp]
    offset: Array
    bend: Array


NO_KINKS = Kinks(np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, 1)))


@dataclass(frozen=True)
class PiecewiseInput:
    """Piecewise polynomial ``u(t) = sum_i coefficients[j, i] (t - nodes[j])**i``.

    ``nodes`` has shape ``(m,)`` [s], increasing; ``coefficients`` has shape
    ``(m, degree + 1)``. The last piece extends to infinity and the input is zero before
    the first node: callers subtract the level of rest.
    """

    nodes: FloatArray
    coefficients: Array
    kinks: Kinks = field(default=NO_KINKS)


def is_smooth(signals: Sequence[Signal]) -> bool:
    """Return whether cubics through every second sample predict the others better than lines.

    Lines clip the peaks of a smooth signal, such as the force of a hand, which biases the inertia
    fitted to it. The contribution of noise to both errors is subtracted; where the rest does not
    distinguish the two, curves are the better guess.

    Parameters
    ----------
    signals
        The same role in all logs: one decision for all of them.
    """
    cubic = line = noise = power = doubt = 0.0
    samples = 0
    for signal in signals:
        at = middle_of(signal.values.size, _ENOUGH)
        time, values = signal.time[at], signal.values[at]
        if values.size < _FEWEST_TOLD:
            continue
        more = _prediction_errors(time, values)
        sigma, relative = white_level(values)
        cubic, line = cubic + more[0], line + more[1]
        samples += values.size
        noise += 0.5 * values.size * sigma**2
        doubt += 0.5 * values.size * sigma**2 * relative
        power += 0.5 * values.size * float(values.var())
    if noise > _NOISY * power:  # there is no signal to speak of
        return bool(cubic < _CLEARLY * line)
    known = _NOISE_OF_CUBIC - _CLEARLY * _NOISE_OF_LINE
    better = _CLEARLY * line - cubic + known * noise
    chance = np.hypot(_SPREAD_OF_BOTH * noise / np.sqrt(max(samples, 1)), known * doubt)
    return bool(better > -SEEN * chance)


def _prediction_errors(time: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Squared errors of a cubic and of lines through every second sample at the others."""
    kept, asked = slice(0, None, 2), slice(1, values.size - values.size % 2, 2)
    asked_time, truth = time[asked][2:-2], values[asked][2:-2]
    pieces = cubic_pieces(time[kept], values[kept])[2:][: truth.size]
    cubic = _values(pieces, asked_time - time[kept][2:][: truth.size]) - truth
    line = np.interp(asked_time, time[kept], values[kept]) - truth
    return float(cubic @ cubic), float(line @ line)


def piecewise(signal: Signal, *, level: float = 0.0) -> PiecewiseInput:
    """Turn a signal into the piecewise polynomial that its hold describes.

    Parameters
    ----------
    signal
        Values at instants, with ``hold`` ``"zoh"`` (held), ``"foh"`` (straight lines) or
        ``"smooth"`` (cubic spline through the samples). The last value is held.
    level
        Level of rest that is subtracted [unit of the signal].
    """
    time, values = signal.time, signal.values
    if level:
        values = values - level
    kind = settled_hold(signal)
    if kind == "zoh":
        return PiecewiseInput(time, values[:, None])
    straight = straight_lines(time, values)
    return straight if kind == "foh" else _smooth_pieces(straight)


def straight_lines(time: FloatArray, values: Array) -> PiecewiseInput:
    """Straight lines from value to value, shape ``(n,)``; the last one is held."""
    slopes = np.append(np.diff(values) / np.diff(time), 0.0)
    return PiecewiseInput(time, np.column_stack((values, slopes)))


def _smooth_pieces(straight: PiecewiseInput) -> PiecewiseInput:
    """Cubics through the samples that lines join.

    A cubic across a gap follows the slopes at its ends for as long as the gap lasts and leaves
    the range of the signal: there the lines stay, and each side has a curve of its own.
    """
    time, lines = straight.nodes, straight.coefficients
    pieces = np.column_stack((lines, np.zeros((time.size, 2))))
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    for begin, end in pairwise((0, *gaps, time.size)):
        if end - begin >= FEWEST:
            pieces[begin : end - 1] = cubic_pieces(time[begin:end], lines[begin:end, 0])
    return PiecewiseInput(time, pieces)


def settled_hold(signal: Signal) -> Hold:
    """Hold of a signal; straight lines where it has too few samples for a smooth curve."""
    if signal.hold is None or signal.values.size < 2:
        return "zoh"
    if signal.hold == "smooth" and signal.values.size < 4:
        return "foh"
    assert signal.hold != "auto", f"the hold of {signal.role} was never settled"
    return signal.hold


def choose_hold(signals: Sequence[Signal]) -> Hold:
    """Settle ``auto`` for a role of all logs: ``zoh`` on levels, else ``foh`` or ``smooth``."""
    moving = [s for s in signals if s.values.size > 1 and np.ptp(s.values) > 0.0]
    if all(_is_held(s.values[:10_000]) for s in moving):
        return "zoh"
    return "smooth" if is_smooth(signals) else "foh"


def _is_held(values: FloatArray) -> bool:
    """Return whether a signal keeps levels, exactly or but for noise, and jumps between them.

    A jump stands alone and is large beside the usual change from one sample to the next. Between
    jumps nothing is left but ``s / sqrt(2)``, noise whose differences have the deviation ``s``.
    """
    change = np.abs(np.diff(values))
    if np.unique(values).size <= 2:
        return True
    usual = PER_MEDIAN * float(np.median(change))
    jumps = np.flatnonzero(change > 5.0 * usual)
    if jumps.size == 0 or np.sum(np.diff(jumps) == 1) > 0.1 * jumps.size:
        return False
    levels = np.split(values, jumps + 1)
    # a jump too small to be seen leaves one level wide, not the others
    if np.median([v.std() for v in levels]) > usual + 1e-9 * np.ptp(values):
        return False
    # steps of a converter, which a slow signal climbs by one or a few, are no levels of a command
    codes = change[jumps] / change[jumps].min()
    whole = np.median(np.abs(codes - np.rint(codes))) < 0.1
    steps = usual == 0.0 and whole and np.median(codes) < 4.0
    return not steps or np.median([v.size for v in levels]) >= 20


def settle_holds(experiments: Sequence[Experiment]) -> list[Experiment]:
    """Replace the hold ``auto`` of every role, judged from all logs together."""
    open_roles = {r for e in experiments for r, s in e.signals.items() if s.hold == "auto"}
    chosen = {
        role: choose_hold([e.signals[role] for e in experiments if role in e])
        for role in open_roles
    }
    return [
        replace(
            e,
            signals={
                r: replace(s, hold=chosen[r]) if s.hold == "auto" else s
                for r, s in e.signals.items()
            },
        )
        for e in experiments
    ]


def make_signal(
    role: str, values: npt.ArrayLike, time: npt.ArrayLike, unit: str, hold: Hold
) -> Signal:
    """Signal of a record, its hold settled.

    Raises
    ------
    UsageError
        When the record or the hold is not possible.
    """
    t, u = _check_record(values, time)
    if hold not in get_args(Hold):
        raise UsageError(
            f"hold cannot be {hold!r}", expected=f"One of {', '.join(get_args(Hold))}."
        )
    signal = Signal(role, t, u, unit, hold, before=float(u[0]))
    return replace(signal, hold=choose_hold([signal])) if hold == "auto" else signal


def _check_record(values: npt.ArrayLike, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Instants and values as finite arrays of equal length, instants increasing."""
    u = np.asarray(values, dtype=float)
    t = np.asarray(time, dtype=float)
    if u.ndim != 1 or t.shape != u.shape or u.size == 0:
        raise UsageError(
            f"input of shape {u.shape} at instants of shape {t.shape}",
            expected="Two one-dimensional arrays of the same length, at least one sample.",
        )
    if not (np.isfinite(u).all() and np.isfinite(t).all()):
        raise UsageError("input or instants hold a value that is not finite")
    if t.size > 1 and not (np.diff(t) > 0.0).all():
        raise UsageError("the instants do not increase", remedy="Sort them, drop repeated ones.")
    return t, u


def beyond_dead_zone(u: Array, negative: complex, positive: complex) -> Array:
    """Output of a dead zone of slope one: ``max(u - u+, 0) + min(u - u-, 0)``, shape ``(n,)``.

    The edges are complex in derivatives.
    """
    out = np.empty(u.shape, np.result_type(u, negative, positive, float))
    for at in blocks(u.size):
        value, least, most = np.real(u[at]), np.real(negative), np.real(positive)
        # a difference at an edge of zero takes it across: both parts count then
        out.real[at] = np.maximum(value - most, 0.0) + np.minimum(value - least, 0.0)
        if np.iscomplexobj(out):
            moved = np.imag(u[at])
            out.imag[at] = (value > most) * (moved - np.imag(positive))
            out.imag[at] += (value < least) * (moved - np.imag(negative))
    return out


def apply_dead_zone(u: PiecewiseInput, negative: complex, positive: complex) -> PiecewiseInput:
    """Pass an input through a dead zone of slope one; its kinks are located exactly.

    ``w = max(u - positive, 0) + min(u - negative, 0)``.

    Held inputs jump at nodes only. For moving inputs the instant at which an edge is
    crossed is solved inside the interval, so the response of a linear system to ``w`` is
    a smooth function of both edges.

    Parameters
    ----------
    u
        Input of any degree.
    negative, positive
        Edges [unit of u], ``negative <= 0 <= positive``.
    """
    start = u.coefficients[:, 0]
    level = beyond_dead_zone(start, negative, positive)
    if u.coefficients.shape[1] == 1:
        return PiecewiseInput(u.nodes, level[:, None])
    above, below = start > np.real(positive), start < np.real(negative)
    end = np.append(start[1:], start[-1])
    leaves = above[:-1] != (end > np.real(positive))[:-1]
    enters = below[:-1] != (end < np.real(negative))[:-1]
    up, down = np.flatnonzero(leaves), np.flatnonzero(enters)
    order = np.argsort(np.concatenate((up, down)), kind="stable")
    crossed = np.concatenate((up, down))[order]
    edges = np.repeat(np.array((positive, negative)), (up.size, down.size))[order]
    offset, bend = _cross(u, crossed, edges)
    turn = np.where(np.concatenate((above[up], below[down]))[order], -1.0, 1.0)
    kinks = Kinks(crossed, offset, turn[:, None] * bend)
    active = (above | below)[:, None]
    coefficients = np.column_stack((level, np.where(active, u.coefficients[:, 1:], 0.0)))
    return PiecewiseInput(u.nodes, coefficients, kinks)


def _cross(u: PiecewiseInput, index: npt.NDArray[np.intp], edges: Array) -> tuple[Array, Array]:
    """Offsets at which pieces cross an edge each and their polynomials about that point."""
    c = u.coefficients[index]
    step = np.diff(u.nodes)[index]
    target = np.real(edges)
    low, high = np.zeros(index.size), step.copy()
    rising = c[:, 0] <= target
    rise = _values(c, step) - c[:, 0]
    share = (target - c[:, 0]) / np.where(rise == 0.0, 1.0, rise)
    offset: Array = step * np.minimum(np.maximum(share, 0.0), 1.0)
    gradient = c[:, 1:] * np.arange(1, c.shape[1])
    for _ in range(1 if c.shape[1] == 2 else 8):  # Newton kept inside a shrinking bracket
        miss = _values(c, offset) - target
        left = (miss <= 0.0) == rising
        low, high = np.where(left, offset, low), np.where(left, high, offset)
        slope = _values(gradient, offset)
        moved = offset - miss / np.where(slope == 0.0, np.inf, slope)
        moved = np.where((moved >= low) & (moved <= high), moved, 0.5 * (low + high))
        settled = np.all(np.abs(moved - offset) <= 1e-12 * step)
        offset = moved
        if settled:  # Newton squares the error: what is left is rounding
            break
    bend = _expand(c, offset)[:, 1:]
    if np.iscomplexobj(edges):
        slope = bend[:, 0]
        offset = offset + 1j * np.imag(edges) / np.where(slope == 0.0, np.inf, slope)
        bend = _expand(c, offset)[:, 1:]
    return offset, bend


def _values(c: Array, offset: Array) -> Array:
    """Values of polynomials with rising powers, one per row."""
    total: Array = c[:, -1]
    for i in range(c.shape[1] - 2, -1, -1):
        total = total * offset + c[:, i]
    return total


def _expand(c: Array, offset: Array) -> Array:
    """Coefficients of the same polynomials about another point."""
    moved = np.array(np.broadcast_to(c, c.shape), dtype=np.result_type(c, offset))
    degree = c.shape[1] - 1
    for k in range(degree):  # repeated synthetic division
        for i in range(degree - 1, k - 1, -1):
            moved[:, i] = moved[:, i] + offset * moved[:, i + 1]
    return moved
