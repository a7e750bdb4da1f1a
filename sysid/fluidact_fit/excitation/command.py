"""The command of a dynamic model: shapes to begin with, the best improved number by number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import NotIdentifiedError, UsageError
from ..experiment import FloatArray
from .result import Candidate, Design
from .search import RISE, Search, Trial
from .task import Task, Unknown, finite_or_none, undetermined
from .waveforms import Waveform, to_segments

_LEADERS = 4  # shapes that are improved
_PIECES = 40  # straight pieces that are shaped one by one
_TRIES = 400  # of changes to the pieces


def _first_waveforms(task: Task) -> list[Waveform]:
    """Shapes to begin with; the search stretches their times and frequencies."""
    span, step = task.limits.duration, task.limits.sample_time
    holds = np.geomspace(max(4.0 * step, 0.002 * span), 0.12 * span, 8)
    bands, lowest = [1.0 / (2.0 * h) for h in holds[:6]], 1.0 / span
    sizes = ((1.0, 0.5), (2.0, 0.35))
    shapes = [
        *(("steps", {"hold": h, "levels": n}) for h in holds for n in (2.0, 5.0)),
        *(("square", {"hold": h, "last": h * g}) for h in holds for g in (1.0, 4.0)),
        *(("two sizes", {"hold": h, "small": h * g, "part": p}) for h in holds for g, p in sizes),
        *(("rest and go", {"hold": h, "pause": h * g}) for h in holds for g in (0.3, 1.0)),
        *(("chirp", {"first": lowest, "last": f, "log": k}) for f in bands for k in (0.0, 1.0)),
        *(("multisine", {"first": lowest, "last": f}) for f in bands),
        *(("triangle", {"period": span / n}) for n in (1.0, 2.0, 4.0, 8.0)),
    ]
    out = [Waveform(shape, numbers, task.seed) for shape, numbers in shapes]
    slow = Waveform("triangle", {"period": 0.25 * span})
    for h in holds[1:6]:
        out.append(replace(slow, then=Waveform("steps", {"hold": h, "levels": 2.0}, task.seed)))
    return [*out, *_mixtures(holds), *_approaches(task)]


def _mixtures(holds: FloatArray) -> list[Waveform]:
    """Slow squares of two sizes, which show levels and slopes, and then a quick one."""
    out = []
    for q in holds[1:6:2]:
        quick = Waveform("square", {"hold": q, "last": q})
        for h in holds[4:]:
            slow = Waveform("two sizes", {"hold": h, "small": h, "part": 0.6}, then=quick)
            out += [replace(slow, turn=turn) for turn in (0.35, 0.65)]
    return out


def _approaches(task: Task) -> list[Waveform]:
    """Slow passages through the static levels, for models that have any."""
    levels: dict[str, float] = {}
    for side, limit in zip(("positive", "negative"), reversed(task.limits.amplitude)):
        unknown = next((u for u in task.unknowns if u.spec.threshold == side), None)
        if unknown is None or not limit:
            return []
        low, high = _ramp_range(task, unknown)
        levels[f"low_{side}"] = low / abs(limit)
        levels[f"high_{side}"] = min(high / abs(limit), 1.0)
    span = task.limits.duration
    # A fit of slow passages alone has several optima; vigorous motion has one.
    lively = [
        Waveform("chirp", {"first": 2.0 / span, "last": last / span, "log": 0.0})
        for last in (10.0, 40.0)
    ]
    slow = [
        {"half": 0.5 * span / n, "pause": pause, "push": 0.03, **levels}
        for n in (2.0, 4.0, 6.0)
        for pause in (0.15, 0.3)
    ]
    return [Waveform("approach", s, then=then) for then in lively for s in slow]


def _ramp_range(task: Task, unknown: Unknown) -> tuple[float, float]:
    """Levels between which a static level is sure to lie [SI of the drive]."""
    below = task.plant.values.get(unknown.spec.base)
    base = below if isinstance(below, float) else 0.0
    if unknown.supposed or unknown.present is None:
        return base, max(2.0 * base, 1.3 * unknown.value)
    half = max(4.0 * unknown.present, 0.02 * unknown.value)
    return max(unknown.value - half, base), unknown.value + half


def _improve(search: Search, trial: Trial) -> Trial:
    """Change one number at a time while that helps."""
    factor = 1.5
    while factor > 1.04:
        before = trial
        for k in range(len(trial.waveform.neighbours(factor))):
            some = trial.waveform.neighbours(factor)
            tried = search.try_out(some[min(k, len(some) - 1)])
            if tried.score < trial.score - 1e-3:
                trial = tried
        if trial is before:
            factor = 1.0 + 0.5 * (factor - 1.0)
    return trial


def _reshape(search: Search, trial: Trial) -> Trial:
    """Change the levels and lengths of a trial's straight pieces one by one while that helps.

    Slow passages have none, as their levels hold for whatever the static level is.
    """
    begun = None if trial.waveform.absolute else to_segments(trial.shape, _PIECES)
    if begun is None:
        return trial
    best = search.try_out(begun)
    level, factor, left = 0.2, 1.25, _TRIES
    while level > 0.02 and left > 0:
        before = best
        for k in range(len(begun.pieces)):
            for stretch, shift in ((1.0, level), (factor, 0.0)):
                for sign in (1.0, -1.0):
                    pieces = list(best.waveform.pieces)
                    pieces[k] = pieces[k].change(stretch**sign, sign * shift)
                    tried = search.try_out(replace(best.waveform, pieces=tuple(pieces)))
                    left -= 1
                    if tried.score < best.score - 1e-4:
                        best = tried
                        break
        if before.score - best.score < 0.005:
            level, factor = 0.5 * level, 1.0 + 0.5 * (factor - 1.0)
    return best if best.score < trial.score else trial


def design_command(task: Task) -> Design:
    """Design the command to play."""
    if not task.limits.sample_time:
        raise UsageError("the sample time is unknown.", remedy="Give --sample-time and --duration.")
    search = Search(task)
    waveforms = _first_waveforms(task)
    trials = []
    for number, waveform in enumerate(waveforms, start=1):
        if number % 10 == 1:
            task.progress(f"candidate {number} of {len(waveforms)}")
        trials.append(search.try_out(waveform))
    every, trials = trials, [t for t in trials if np.isfinite(t.score)]
    if not trials and not any(search.is_within_stroke(t.output) for t in every):
        raise _out_of_stroke(task, [t.output for t in every])
    if not trials:
        raise undetermined("excitation")
    trials.sort(key=lambda t: t.score)
    leaders = _best_of_each(trials)
    improved = []
    for number, trial in enumerate(leaders[:_LEADERS], start=1):
        task.progress(f"improving {number} of {min(len(leaders), _LEADERS)}")
        improved.append(_improve(search, trial))
    improved.sort(key=lambda t: t.score)
    task.progress("shaping the best")
    improved[:1] = [_reshape(search, trial) for trial in improved[:1]]
    ranking = sorted([*improved, *leaders[_LEADERS:]], key=lambda t: t.score)
    return _to_design(task, search, ranking)


def _out_of_stroke(task: Task, outputs: Sequence[FloatArray]) -> NotIdentifiedError:
    """The error when the output leaves its stroke whatever is played."""
    role, limits, unit = task.output, task.limits, task.output.unit
    assert limits.stroke is not None, "without a stroke nothing is outside it"
    nearest = min(outputs, key=np.ptp)
    whose = "" if task.given.stroke else ", which the file's logs covered"
    low, high = limits.amplitude
    return NotIdentifiedError(
        f"within --amplitude {low:g}:{high:g} {task.drive.unit}, {role.name} leaves its range of "
        f"{limits.stroke[0]:.4g} to {limits.stroke[1]:.4g} {unit}{whose}: it moves over "
        f"{nearest.min():.4g} to {nearest.max():.4g} {unit} or further.",
        expected="Nothing was written.",
        remedy="Give the range that the machine may use as --stroke LOW:HIGH, or a smaller "
        "--amplitude.",
    )


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """The best trial of every shape, best first."""
    best: dict[tuple[str, str], Trial] = {}
    for t in trials:
        then = t.waveform.then
        best.setdefault((t.waveform.shape, then.shape if then else ""), t)
    return list(best.values())


def _to_design(task: Task, search: Search, ranking: Sequence[Trial]) -> Design:
    best, name, output = ranking[0], task.drive.name, task.output
    notes = task.notes
    if search.drifts and task.limits.stroke is not None:
        needed = float(np.ptp(best.output))
        start = task.limits.stroke[0] - float(best.output.min() - best.output[0])
        start += 0.5 * (task.limits.travel - needed)
        notes.append(
            f"Start at {output.name} {start:.4g} {output.unit}: from there the "
            f"run needs {needed:.4g} {output.unit} of stroke."
        )
    if task.drive.hold != "zoh" and task.limits.rate is None:
        notes.append(
            f"{name} is not held between samples, so jumps are spread over {RISE} "
            "samples. Give --rate if the source is slower."
        )
    candidates = [
        Candidate(t.waveform.describe(), finite_or_none(task.worst(t.errors))) for t in ranking
    ]
    return Design(
        family=task.family.name,
        description=best.waveform.describe(),
        time=search.time,
        signals={name: best.command},
        units={name: task.drive.unit},
        forecasts=task.forecasts(best.errors),
        criterion=task.criterion,
        limits=task.limits,
        binding=_binding(task, search, best),
        notes=tuple(notes),
        candidates=tuple(candidates),
    )


def _binding(task: Task, search: Search, best: Trial) -> tuple[str, ...]:
    """Limits that the design reaches."""
    limits = task.limits
    out = []
    low, high = limits.amplitude
    margin = 0.01 * (high - low)
    if best.command.min() <= low + margin or best.command.max() >= high - margin:
        out.append("amplitude")
    slope = float(np.abs(np.diff(best.command)).max()) / limits.sample_time
    if limits.rate is not None and slope >= 0.97 * limits.rate:
        out.append("rate")
    if limits.stroke is not None and search.drifts:
        reached = float(np.ptp(best.output)) >= 0.85 * limits.travel
        if reached or best.waveform.size < 1.0:
            out.append("stroke")
    return (*out, "duration")
