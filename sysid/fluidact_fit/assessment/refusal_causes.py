"""What a recording shows that may be why it determines nothing: named before any parameter.

Only a refused fit is asked: each of these also occurs in a recording that is right.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..estimation.noise import noise_floor
from ..experiment import Experiment, FloatArray
from ..family import Variant

_LAGS = range(1, 51)  # samples
_LEAST = 200  # samples of a log that tells
_AHEAD = 4.0  # times as much that follows as precedes, where a log is refused for it
_AGREES = 0.5  # of the largest correlation, from which on two signals agree
_LATER = 3  # times the lag one way, that the lag the other way is, where it tells which is first
_CHANCE = 5.0  # standard deviations of a correlation by chance
_NOISE = 6.0  # standard deviations within which a value is the same
_BAND = 0.01  # of its range, the same of a channel without noise
_SPEED = 5  # samples over which a change is taken
_AT_END = 0.05  # of the samples, that are at one end
_CHANGES = 0.25  # of its range, which an input changes while the output is there
_MOVING = 0.05  # of the largest speed, at which something moves
_PUSHED = 0.2  # of that time, in which it would move elsewhere
_AGAINST = 0.5  # correlation of an input and the motion against it
_JUMP = 0.6  # of its range, which a counter that begins again jumps by at least
_OTHERWISE = 0.2  # of its range, below which all other steps are
_BEYOND = 1.1  # times its range, over which a counter goes on


@dataclass(frozen=True)
class Cause:
    """What stands before the words of a refusal, and the remedy in place of its own."""

    words: str
    remedy: str


def find_cause(variant: Variant, experiments: Sequence[Experiment]) -> Cause | None:
    """The first thing that the channels show, ``None`` where they show nothing."""
    timed = [e for e in experiments if e.time.size]
    return next(_causes(variant, timed), None)


def _causes(variant: Variant, runs: Sequence[Experiment]) -> Iterator[Cause]:
    output = variant.output.name
    for role in (r.name for r in variant.driving):
        if _follows(runs, role, output):
            yield Cause(
                f"'{role}' follows '{output}', not the other way round: the two columns seem to "
                "be swapped, and",
                f"Check --column {role}=... and --column {output}=...",
            )
        if _moves_against(runs, role, output):
            yield Cause(
                f"'{output}' moves against '{role}': one of them seems to have the other sign, and",
                f"If so, give --scale {role}=-1 or --scale {output}=-1; else check their columns.",
            )
    measured = [r.name for r in variant.roles if r.name != "time" and r.hold != "zoh"]
    for role in measured:
        some = [e for e in runs if role in e]
        if turn := max((_turn(e[role]) for e in some), default=0.0):
            yield Cause(
                f"'{role}' jumps from one end of its range to the other and moves on from there: "
                f"it seems to begin again after about {some[0].signals[role].text(turn)}, and",
                f"Have it continued with --unwrap {role}=SIZE, or keep to a part without a jump "
                "with --window.",
            )
    for role in (r.name for r in variant.driving):
        samples, end = _at_end(runs, role, output)
        if samples > _AT_END * sum(e.samples for e in runs):
            text = next(e for e in runs if output in e).signals[output].text(end)
            yield Cause(
                f"'{output}' stays at {text}, an end of its range, for {samples} samples while "
                f"'{role}' changes: there seems to be a stop, or a sensor at its limit, and",
                "Leave that out with --exclude or --window, or record within the stroke.",
            )


def _follows(runs: Sequence[Experiment], role: str, output: str) -> bool:
    """Whether the changes of an input follow those of the output instead of preceding them."""
    ahead, behind, least = 0.0, 0.0, 0.0
    for e in runs:
        if role not in e or output not in e or not e[role].size == e[output].size >= _LEAST:
            continue
        u, y = np.diff(e[role]), np.diff(e[output])
        ahead += float(np.sum(_correlations(u, y) ** 2))
        behind += float(np.sum(_correlations(y, u) ** 2))
        least += 3.0 * len(_LAGS) / u.size
    return behind > max(_AHEAD * ahead, least)


def leads(first: FloatArray, second: FloatArray) -> bool | None:
    """Whether the changes of one signal precede those of another; ``None`` where none does.

    By the shortest lag at which they agree about as well as at any: what a signal does again agrees
    at others, too.
    """
    known = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(known) < _LEAST:
        return None
    u, y = np.diff(first[known]), np.diff(second[known])
    ahead, behind = np.abs(_correlations(u, y)), np.abs(_correlations(y, u))
    most = max(ahead.max(), behind.max())
    if most < _CHANCE / np.sqrt(u.size):
        return None
    one, other = (
        int(np.argmax(x > _AGREES * most)) + 1 if x.max() > _AGREES * most else 4 * len(x)
        for x in (ahead, behind)
    )
    return one < other if max(one, other) >= _LATER * min(one, other) else None


def _correlations(first: FloatArray, second: FloatArray, lags: Sequence[int] = _LAGS) -> FloatArray:
    """Correlation of two signals of one length, the second so many samples later."""
    power = float(np.linalg.norm(first) * np.linalg.norm(second)) or 1.0
    return np.array([float(first[: first.size - k] @ second[k:]) / power for k in lags])


def _moves_against(runs: Sequence[Experiment], role: str, output: str) -> bool:
    both = [(e[role], e[output]) for e in runs if role in e and output in e]
    return moves_against(both)


def moves_against(pairs: Iterable[tuple[FloatArray, FloatArray]]) -> bool:
    """Whether an output, or its change, follows an input of the other sign alone.

    What swings follows one of either sign, half a period later. Pairs of input and output, shapes
    ``(n,)`` [any units]; short ones and those of two lengths tell nothing.
    """
    along, against = 0.0, 0.0
    for u, y in pairs:
        if not u.size == y.size >= _LEAST:
            continue
        u, y = u - u.mean(), y - y.mean()
        speed = y[_SPEED:] - y[:-_SPEED]
        for moved, drive in ((y, u), (speed, u[: speed.size])):
            correlations = _correlations(drive, moved, (0, *_LAGS))
            along = max(along, float(correlations.max()))
            against = min(against, float(correlations.min()))
    return against < -max(_AGAINST, 2.0 * along)


def _turn(values: FloatArray) -> float:
    """After what a signal begins again, 0 where it does not.

    Its jumps are all of one size. Without them it goes on beyond its range; what a square wave
    is without its jumps has hardly any.
    """
    if values.size < _LEAST:
        return 0.0
    steps, span = np.diff(values), float(np.ptp(values))
    far = np.abs(steps) > _JUMP * span
    if not far.any():
        return 0.0
    size = float(np.median(np.abs(steps[far])))
    alike = float(np.ptp(np.abs(steps[far]))) < _OTHERWISE * span
    small = float(np.abs(steps[~far]).max(initial=0.0)) < _OTHERWISE * span
    goes_on = np.cumsum(np.where(far, steps - np.sign(steps) * size, steps))
    return size if alike and small and np.ptp(goes_on) > _BEYOND * span else 0.0


def _at_end(runs: Sequence[Experiment], role: str, output: str) -> tuple[int, float]:
    """Samples of the output at an end of its range while an input would move it on; the end.

    The input changes meanwhile, and beyond what moves the output that way elsewhere: what it does
    within a dead zone moves nothing.
    """
    both = [(e[role], e[output]) for e in runs if role in e and output in e]
    pairs = [(u[:-_SPEED], y[:-_SPEED], y[_SPEED:] - y[:-_SPEED])
             for u, y in both if u.size == y.size >= _LEAST]  # fmt: skip
    if not pairs:
        return 0, 0.0
    u, y, speed = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    near = max(_BAND * float(np.ptp(y)), *(_NOISE * noise_floor(values) for _, values, _ in pairs))
    found = {}
    for way, end in ((-1.0, float(y.min())), (1.0, float(y.max()))):
        there = np.abs(y - end) < near
        moving = ~there & (way * speed > _MOVING * np.abs(speed).max())
        if not moving.any():
            continue
        pushed, count = way * u > np.median(way * u[moving]), 0
        edges = np.flatnonzero(np.diff(np.r_[False, there, False].astype(int)))
        for first, stop in zip(edges[::2], edges[1::2], strict=True):
            changes = np.ptp(u[first:stop]) > _CHANGES * np.ptp(u)
            count += int(stop - first) * bool(changes and pushed[first:stop].mean() > _PUSHED)
        found[end] = count
    end = max(found, key=lambda x: found[x], default=0.0)
    return found.get(end, 0), end
