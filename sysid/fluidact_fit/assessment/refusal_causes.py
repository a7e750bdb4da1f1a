"""Causes in a recording why nothing can be determined from it: named before any parameter.

Only refused fits are searched for them: each also occurs in recordings that are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..estimation.noise import noise_floor
from ..experiment import Experiment, FloatArray
from ..family import Variant
from . import policy

_LAGS = range(1, 51)  # samples
_CHANGE_OVER = 5  # samples
_CONTROLLED = "If a controller holds a set point, record steps of it, or open the loop."
_ONE_SIDED = ("_positive", "_negative", "_1", "_2")  # ends of the names of one-sided parameters


@dataclass(frozen=True)
class Cause:
    """Cause that precedes the text of a refusal, and the remedy that replaces its own."""

    words: str
    remedy: str


def find_cause(variant: Variant, experiments: Sequence[Experiment]) -> Cause | None:
    """Find the first cause that the channels show, ``None`` where there is none."""
    timed = [e for e in experiments if e.time.size]
    return next(_causes(variant, timed), None)


def _causes(variant: Variant, runs: Sequence[Experiment]) -> Iterator[Cause]:
    """Yield causes, the most fundamental one first."""
    output = variant.output.name
    if role := variant.leading:
        pairs = [(e[role], e[output]) for e in runs if role in e and output in e]
        before = [leads(u, y) for u, y in pairs if u.size == y.size]
        if before and all(x is False for x in before):
            yield Cause(
                f"'{role}' follows '{output}', not the other way round: the two columns seem to "
                f"be swapped, or a controller moves '{role}' to hold '{output}', and",
                f"Check --column {role}=... and --column {output}=... {_CONTROLLED}",
            )
        yield from _reversed_signs(runs, role, output)
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
        if samples > policy.STOP_SAMPLES * sum(e.samples for e in runs):
            text = next(e for e in runs if output in e).signals[output].text(end)
            yield Cause(
                f"'{output}' stays at {text}, an end of its range, for {samples} samples while "
                f"'{role}' changes: there seems to be a stop, or a sensor at its limit, and",
                "Leave that out with --exclude or --window, or record within the stroke.",
            )
    one_sided = any(p.name.endswith(_ONE_SIDED) for p in variant.parameters)
    for role in (r.name for r in variant.driving):
        times = 1.0 if one_sided else _asymmetry(runs, role, output)
        if times > policy.SIDES_DIFFER:
            yield Cause(
                f"'{output}' answers {times:.2g} times as much to one sign of '{role}' as to the "
                "other, which this model does not do, and",
                f"Fit each sign of '{role}' by itself (--exclude or --window), or correct what is "
                "steeper on one side: a sensor, a valve, an area.",
            )
        if _is_one_signal(runs, role, output):
            yield Cause(
                f"'{output}' is '{role}' at the same sample, but for a factor and noise: the two "
                "columns seem to be of one signal, and",
                f"Check --column {role}=... and --column {output}=...; of a machine that answers "
                "so fast, sample faster.",
            )


def _pairs(
    runs: Sequence[Experiment], role: str, output: str
) -> list[tuple[FloatArray, FloatArray]]:
    """Input and output of the runs that have both at the same, and enough, samples."""
    both = [(e[role], e[output]) for e in runs if role in e and output in e]
    return [(u, y) for u, y in both if u.size == y.size >= policy.CAUSE_SAMPLES]


def leads(first: FloatArray, second: FloatArray) -> bool | None:
    """Return whether the changes of one signal precede those of another; ``None`` where none does.

    The shortest lag decides at which they correlate about as well as at any: a periodic signal
    correlates at longer ones, too. Both have shape ``(n,)``.
    """
    known = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(known) < policy.CAUSE_SAMPLES:
        return None
    u, y = np.diff(first[known]), np.diff(second[known])
    ahead, behind = np.abs(_correlations(u, y)), np.abs(_correlations(y, u))
    most = max(ahead.max(), behind.max())
    if most < policy.LEADS_CHANCE / np.sqrt(u.size):
        return None
    one, other = (
        int(np.argmax(x > policy.LEADS_AGREE * most)) + 1
        if x.max() > policy.LEADS_AGREE * most
        else 4 * len(x)
        for x in (ahead, behind)
    )
    return one < other if max(one, other) >= policy.LEADS_LATER * min(one, other) else None


def _correlations(first: FloatArray, second: FloatArray, lags: Sequence[int] = _LAGS) -> FloatArray:
    """Correlation of two signals, ``(n,)`` each, the second later by each of the lags."""
    power = float(np.linalg.norm(first) * np.linalg.norm(second)) or 1.0
    return np.array([float(first[: first.size - k] @ second[k:]) / power for k in lags])


def _reversed_signs(runs: Sequence[Experiment], role: str, output: str) -> Iterator[Cause]:
    """Yield an output that moves against an input, in all logs or in some of them."""
    signs = {f"log {e.log + 1} ({e.log_name})": _direction(e, role, output) for e in runs}
    against = [name for name, sign in signs.items() if sign < 0]
    along = [name for name, sign in signs.items() if sign > 0]
    if against and not along:
        yield Cause(
            f"'{output}' moves against '{role}': one of them seems to have the other sign, or a "
            "controller holds it, and",
            f"If so, give --scale {role}=-1 or --scale {output}=-1; else check their columns. "
            f"{_CONTROLLED}",
        )
    elif against:
        fewer = min(against, along, key=len)
        most = "against" if fewer is along else "along with"
        yield Cause(
            f"'{output}' moves {most} '{role}' in most logs, and the other way in "
            f"{', '.join(fewer)}: one of its columns seems to have the other sign, and",
            f"If so, leave {'it' if len(fewer) == 1 else 'them'} out, or reverse the column in the "
            f"file: --scale {role}=-1 would reverse it in all logs.",
        )


def _direction(e: Experiment, role: str, output: str) -> int:
    return direction(e[role], e[output]) if role in e and output in e else 0


def direction(u: FloatArray, y: FloatArray) -> int:
    """Return 1 where the output, or its change, follows the input, -1 where it opposes it, else 0.

    The output of a line follows its input; the change of the output of a mass does. Whichever
    correlates better with the input counts. Both signals have shape ``(n,)``.
    """
    if not u.size == y.size >= policy.CAUSE_SAMPLES:
        return 0
    u, y = u - u.mean(), y - y.mean()
    change = y[_CHANGE_OVER:] - y[:-_CHANGE_OVER]
    pairs = ((y, u), (change, u[: change.size]))
    found = [_correlations(drive, moved, (0, *_LAGS)) for moved, drive in pairs]
    near, other = sorted(found, key=lambda c: -float(np.abs(c).max()))
    for sign in (1, -1):
        most, least = float((sign * near).max()), float((-sign * near).max())
        aside = float((-sign * other).max())
        if most > max(policy.SIGN_CORRELATION, 2.0 * least) and aside < policy.SIGN_ASIDE * most:
            return sign
    return 0


def _asymmetry(runs: Sequence[Experiment], role: str, output: str) -> float:
    """Ratio of the responses of an output to both signs of its input.

    Means of large inputs of either sign, against the output without input; 1 where there is none.
    """
    both = _pairs(runs, role, output)
    answers = []
    for sign in (1.0, -1.0):
        top = max((float((sign * u).max()) for u, _ in both), default=0.0)
        gains = []
        for u, y in both:
            large, rest = sign * u > 0.5 * top, np.abs(u) < policy.SAME_BAND * np.abs(u).max()
            if top > 0.0 and large.any() and rest.any():
                rise = float(y[large].mean() - y[rest].mean())
                gains.append(rise / float(u[large].mean()))
        answers.append(float(np.mean(gains)) if gains else 0.0)
    low, high = sorted(answers)
    return high / low if low > 0.0 else 1.0


def _is_one_signal(runs: Sequence[Experiment], role: str, output: str) -> bool:
    """Return whether the output is the input of the same sample, but for a factor and noise."""
    both = [(u, y) for u, y in _pairs(runs, role, output) if np.ptp(u) > 0.0 < np.ptp(y)]
    return bool(both) and all(
        np.corrcoef(u, y)[0, 1] ** 2 > 1.0 - policy.ONE_SIGNAL**2
        and np.argmax(np.abs(_correlations(np.diff(u), np.diff(y), (0, *_LAGS)))) == 0
        for u, y in both
    )


def _turn(values: FloatArray) -> float:
    """Size of the jumps by which a counter or angle begins again, 0 where a signal does not.

    Its jumps are all of one size, and without them it continues beyond its range. A square wave
    without its jumps has hardly any range.
    """
    if values.size < policy.CAUSE_SAMPLES:
        return 0.0
    steps, span = np.diff(values), float(np.ptp(values))
    far = np.abs(steps) > policy.WRAP_JUMPS * span
    if not far.any():
        return 0.0
    size = float(np.median(np.abs(steps[far])))
    alike = float(np.ptp(np.abs(steps[far]))) < policy.WRAP_OTHERWISE * span
    small = float(np.abs(steps[~far]).max(initial=0.0)) < policy.WRAP_OTHERWISE * span
    continued = np.cumsum(np.where(far, steps - np.sign(steps) * size, steps))
    return size if alike and small and np.ptp(continued) > policy.WRAP_BEYOND * span else 0.0


def _at_end(runs: Sequence[Experiment], role: str, output: str) -> tuple[int, float]:
    """Number of samples of the output at an end of its range while an input pushes on; the end.

    The input changes meanwhile, and pushes harder than where it moves the output elsewhere: within
    a dead zone its changes move nothing.
    """
    both = _pairs(runs, role, output)
    n = _CHANGE_OVER
    pairs = [(u[:-n], y[:-n], y[n:] - y[:-n]) for u, y in both]
    if not pairs:
        return 0, 0.0
    u, y, change = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    near = max(
        policy.SAME_BAND * float(np.ptp(y)),
        *(policy.SAME_NOISE * noise_floor(values) for _, values, _ in pairs),
    )
    counts = {}
    for sign, end in ((-1.0, float(y.min())), (1.0, float(y.max()))):
        there = np.abs(y - end) < near
        moving = ~there & (sign * change > policy.STOP_MOVING * np.abs(change).max())
        if not moving.any():
            continue
        pushed, count = sign * u > np.median(sign * u[moving]), 0
        edges = np.flatnonzero(np.diff(np.r_[False, there, False].astype(int)))
        for first, stop in zip(edges[::2], edges[1::2], strict=True):
            # the output may not have answered the last samples yet
            answered = u[first : max(stop - n, first + 1)]
            changes = np.ptp(answered) > policy.STOP_INPUT * np.ptp(u)
            count += int(stop - first) * bool(
                changes and pushed[first:stop].mean() > policy.STOP_PUSHED
            )
        counts[end] = count
    end = max(counts, key=lambda x: counts[x], default=0.0)
    return counts.get(end, 0), end
