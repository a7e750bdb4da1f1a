"""Strokes at constant speed for the friction of a cylinder: speeds and shares of the time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import UsageError
from ..estimation.information import cramer_rao
from ..experiment import FloatArray
from .points import is_speed, speed_and_place, static_errors, static_rows, static_samples
from .result import NOT_GIVEN, Design
from .task import Task, make_run, undetermined

_TURN = 0.1  # s that the motion takes to reach its speed
_USED = 0.9  # share of the stroke that strokes at constant speed use
_DURATION = 10.0  # s, where neither the file nor the user says


@dataclass(frozen=True)
class Strokes:
    """Pairs of strokes back and forth at constant speed: slow ones, then fast ones.

    ``slow`` and ``fast`` are the speeds in the positive and negative direction [SI],
    magnitudes; ``share`` is the share of the time that the slow pairs take.
    """

    slow: tuple[float, float]
    fast: tuple[float, float]
    share: float

    def speeds(self) -> list[tuple[float, float]]:
        """Signed speeds and shares of the time; a pair covers the same distance both ways."""
        out = []
        for (to, fro), share in ((self.slow, self.share), (self.fast, 1.0 - self.share)):
            out += [(to, share * fro / (to + fro)), (-fro, share * to / (to + fro))]
        return out

    def play(self, travel: float, duration: float, step: float, rate: float) -> FloatArray:
        """Velocity at the samples, shape ``(n,)`` [SI].

        The turns are straight ramps no steeper than ``rate`` [SI]. A pair returns to where it
        began, within the ``travel``: a stroke of ``n`` samples, ``k`` of them in a ramp, covers
        ``speed * step * (n - k)``.
        """
        count, pieces = round(duration / step), list[FloatArray]()
        for pair, share in ((self.slow, self.share), (self.fast, 1.0 - self.share)):
            turns = [max(round(_TURN / step), 2, int(np.ceil(v / (rate * step)))) for v in pair]
            lost, slowness = step * sum(turns), sum(1.0 / v for v in pair)
            time = share * duration
            laps = max(int(np.ceil(time / (_USED * travel * slowness + lost))), 1)
            ramps = (v * step * turn for v, turn in zip(pair, turns))
            distance = max((time / laps - lost) / slowness, *ramps)
            lap = []
            for speed, turn, sign in zip(pair, turns, (1.0, -1.0)):
                held = max(int(np.ceil(distance / (speed * step))), turn)
                lap.append(_stroke(sign * distance / (held * step), held + turn, turn))
            pieces += laps * lap
        velocity = np.concatenate(pieces)[:count]
        return np.pad(velocity, (0, count - velocity.size))


def design_strokes(task: Task) -> Design:
    """Strokes at constant speed whose speeds and shares of the time are searched."""
    covered = task.document.validity.get(speed_and_place(task)[1].name)
    if task.limits.stroke is None and covered is not None:
        stroke = (covered.low, covered.high)
        task = replace(task, given=replace(task.given, stroke=stroke))
    low, high = _speed_limits(task)
    slowest = max(task.excitation.slowest, 0.075 * max(high, -low))

    def badness(strokes: Strokes) -> float:
        return task.score(_stroke_errors(task, strokes))

    starts = [
        Strokes((k * slowest, k * slowest), (high, -low), share)
        for k in (1.0, 2.0, 4.0)
        for share in (0.3, 0.5, 0.7, 0.85)
        if k * slowest < min(high, -low)
    ]
    starts.sort(key=badness)
    if not starts or not np.isfinite(badness(starts[0])):
        raise undetermined("strokes")
    improved = [_improve_strokes(badness, s, (low, high), slowest) for s in starts[:2]]
    return _describe_strokes(task, min(improved, key=badness), _least(task, low, high, slowest))


def _speed_limits(task: Task) -> tuple[float, float]:
    """Lowest and highest velocity [SI]: as given, or what the file's logs covered."""
    covered = task.limits.amplitude if is_speed(task.drive) else task.excitation.fastest
    low, high = covered if task.given.amplitude == NOT_GIVEN else task.given.amplitude
    unit, most = speed_and_place(task)[0].unit, _reachable(task)
    low, high = max(low, -most), min(high, most)
    if not (high > task.excitation.slowest and -low > task.excitation.slowest):
        raise UsageError(
            "the speeds allow no motion in both directions.",
            expected=f"Both ends have to lie beyond {task.excitation.slowest:.3g} {unit}.",
            remedy="Give --amplitude LOW:HIGH as a range of velocities, for example -0.1:0.1."
            + f" Within --stroke and --rate {most:.3g} {unit} can be reached."
            * bool(most < np.inf),
        )
    return low, high


def _reachable(task: Task) -> float:
    """Highest speed that a stroke reaches and leaves again within the travel and the rate [SI]."""
    limits = task.limits
    travel, rate = _USED * limits.travel, limits.rate
    if rate is not None and not is_speed(task.drive):
        return min(travel / _TURN, rate)
    return min(travel / _TURN, np.inf if rate is None else float(np.sqrt(rate * travel)))


def _play(task: Task, strokes: Strokes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time [s], velocity and position [SI], shape ``(n,)`` each."""
    limits, step = task.limits, task.limits.sample_time or 0.01
    rate = np.inf if limits.rate is None or not is_speed(task.drive) else limits.rate
    velocity = strokes.play(limits.travel, limits.duration or _DURATION, step, rate)
    place = step * (np.cumsum(velocity) - 0.5 * velocity)
    place += (limits.stroke or (0.0, 0.0))[0] - place.min()
    return step * np.arange(velocity.size, dtype=np.float64), velocity, place


def _stroke_errors(task: Task, strokes: Strokes) -> FloatArray:
    """Predicted standard errors from the samples that a fit would keep, shape ``(p,)``."""
    time, velocity, place = _play(task, strokes)
    run = make_run(task.drive, time, velocity if is_speed(task.drive) else place)
    rows = task.inform(run).jacobian
    return np.sqrt(np.diag(cramer_rao(rows.T @ rows))) * task.excitation.noise


def _improve_strokes(
    badness: Callable[[Strokes], float],
    start: Strokes,
    limits: tuple[float, float],
    slowest: float,
) -> Strokes:
    """Search speeds and shares from a start."""
    low, high = limits

    def make(x: FloatArray) -> Strokes:
        to, fro = slowest * np.exp(np.abs(x[:2]))
        fast = high * np.exp(-abs(x[3])), -low * np.exp(-abs(x[4]))
        slow = min(float(to), float(fast[0])), min(float(fro), float(fast[1]))
        share = 1.0 / (1.0 + np.exp(-x[2]))
        return Strokes(slow, (float(fast[0]), float(fast[1])), float(np.clip(share, 0.02, 0.98)))

    at = [np.log(start.slow[0] / slowest), np.log(start.slow[1] / slowest),
          np.log(start.share / (1.0 - start.share)), 0.0, 0.0]  # fmt: skip
    spread = np.array([0.3, 0.3, 0.4, 0.15, 0.15])
    return make(_minimise(lambda x: badness(make(x)), np.array(at), spread, 200))


def _minimise(
    score: Callable[[FloatArray], float], start: FloatArray, spread: FloatArray, most: int
) -> FloatArray:
    """Smallest score near a start, by the simplex of Nelder and Mead."""
    from scipy.optimize import minimize

    simplex = np.vstack((start, start + np.diag(spread)))
    options: Any = {"initial_simplex": simplex, "maxfev": most, "xatol": 1e-3, "fatol": 1e-5}
    found = minimize(lambda x: min(score(x), 1e6), start, method="Nelder-Mead", options=options)
    return np.asarray(found.x)


def _least(task: Task, low: float, high: float, slowest: float) -> FloatArray:
    """Standard errors of the best shares of the samples at any speeds, turns left out.

    A straight line in either direction is best determined from its ends, so the two slowest and
    the two fastest speeds are enough.
    """
    rows = static_rows(task, np.array([low, -slowest, slowest, high]))
    size = task.excitation.noise / np.sqrt(static_samples(task))

    def errors(x: FloatArray) -> FloatArray:
        logits = np.append(x, 0.0)
        shares = np.exp(logits - np.max(logits))
        return np.asarray(size * static_errors(rows, shares / shares.sum()))

    return errors(_minimise(lambda x: task.score(errors(x)), np.zeros(3), np.ones(3), 600))


def _describe_strokes(task: Task, best: Strokes, ideal: FloatArray) -> Design:
    """The design in words and numbers."""
    time, velocity, place = _play(task, best)
    errors, stroke = _stroke_errors(task, best), task.limits.stroke
    speed, where = speed_and_place(task)
    listed = ", ".join(
        f"{v:.3g} {speed.unit} ({100.0 * s:.0f} %)" for v, s in sorted(best.speeds())
    )
    notes = [*task.notes, f"Speeds and their shares of the time: {listed}."]
    notes.append(
        f"The worst relative standard error becomes {100.0 * task.worst(errors):.3g} %; no "
        f"speeds within the limits can bring it below {100.0 * task.worst(ideal):.3g} %."
    )
    notes += _time_to_halve(task, errors)
    if stroke is None:
        notes.append(
            f"The stroke is not in the file: this one needs {np.ptp(place):.3g} {where.unit}. "
            "Give --stroke LOW:HIGH."
        )
    return Design(
        family=task.family.name,
        description=f"strokes at {len(best.speeds())} constant speeds",
        time=time,
        signals={speed.name: velocity, where.name: place},
        units={speed.name: speed.unit, where.name: where.unit},
        forecasts=task.forecasts(errors),
        criterion=task.criterion,
        limits=task.limits,
        binding=tuple(_binding(task, time, velocity)),
        notes=tuple(notes),
    )


def _binding(task: Task, time: FloatArray, velocity: FloatArray) -> Iterator[str]:
    """Limits that the strokes reach."""
    rate = task.limits.rate
    slopes = np.diff(velocity) / np.diff(time) if is_speed(task.drive) else velocity
    yield "amplitude"
    if rate is not None and np.abs(slopes).max() >= 0.97 * rate:
        yield "rate"
    if task.limits.stroke:
        yield "stroke"
    yield "duration"


def _time_to_halve(task: Task, errors: FloatArray) -> list[str]:
    """Duration of these strokes that halves the present worst standard error."""
    present = [u.present / u.scale for u in task.unknowns if u.present is not None]
    if len(present) < len(task.unknowns):
        return []
    ratio = task.worst(errors) / max(present)
    if ratio <= 0.5:
        return []
    duration = (task.limits.duration or _DURATION) * (ratio / 0.5) ** 2
    return [
        f"That is {ratio:.2g} times the present worst one. To halve it, such strokes take "
        f"{duration:.3g} s: give --duration {np.ceil(duration):.0f}, or average more readings of "
        f"the {task.variant.output.name}."
    ]


def _stroke(speed: float, count: int, turn: int) -> FloatArray:
    """Speed up, hold, slow down; shape ``(count,)`` [SI]."""
    place = np.arange(count) + 0.5
    return np.asarray(speed * np.minimum(1.0, np.minimum(place, count - place) / turn))
