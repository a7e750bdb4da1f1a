"""The command of a dynamic model: the best of every shape, improved number by number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import UsageError
from .candidates import first_waveforms
from .result import Candidate, Design
from .search import RISE, Search, Trial
from .task import Task, finite_or_none, undetermined
from .waveforms import Waveform

_LEADERS = 4  # shapes that are improved
_TRIES = 400  # of changes to the pieces


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
    """Change the levels and lengths of a trial's straight pieces one by one while that helps."""
    begun = search.straighten(trial)
    if begun is None:
        return trial
    best = search.try_out(begun)
    level, factor, left = 0.2, 1.25, _TRIES
    while level > 0.02 and left > 0:
        before = best
        for name in begun.numbers:
            if name.startswith("end_"):
                continue
            for sign in (1.0, -1.0):
                tried = search.try_out(_change(best.waveform, name, sign * level, factor**sign))
                left -= 1
                if tried.score < best.score - 1e-4:
                    best = tried
                    break
        if before.score - best.score < 0.005:
            level, factor = 0.5 * level, 1.0 + 0.5 * (factor - 1.0)
    return best if best.score < trial.score else trial


def _change(waveform: Waveform, name: str, shift: float, factor: float) -> Waveform:
    """Stretch one piece by a factor, or shift its level; of a ramp, where it begins."""
    numbers = dict(waveform.numbers)
    kind, _, index = name.partition("_")
    if kind == "length":
        numbers[name] *= factor
    else:
        flat = numbers[name] == numbers[f"end_{index}"]
        numbers[name] = float(np.clip(numbers[name] + shift, -1.0, 1.0))
        if flat:
            numbers[f"end_{index}"] = numbers[name]
    return replace(waveform, numbers=numbers)


def design_command(task: Task) -> Design:
    """Design the command to play."""
    if not task.limits.sample_time:
        raise UsageError("the sample time is unknown.", remedy="Give --sample-time and --duration.")
    search = Search(task)
    waveforms = first_waveforms(task)
    trials = []
    for number, waveform in enumerate(waveforms, start=1):
        if number % 10 == 1:
            task.progress(f"candidate {number} of {len(waveforms)}")
        trials.append(search.try_out(waveform))
    trials = sorted((t for t in trials if np.isfinite(t.score)), key=lambda t: t.score)
    if not trials:
        raise undetermined("excitation")
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


def _best_of_each(trials: Sequence[Trial]) -> list[Trial]:
    """The best trial of every shape, best first."""
    best: dict[tuple[str, str], Trial] = {}
    for t in trials:
        then = t.waveform.then
        best.setdefault((t.waveform.shape, then.shape if then else ""), t)
    return list(best.values())


def _to_design(task: Task, search: Search, ranking: Sequence[Trial]) -> Design:
    best, name, output = ranking[0], task.drive.name, task.variant.output
    notes = list(task.notes)
    if search.drifts and task.limits.stroke is not None:
        needed = float(np.ptp(best.output))
        start = task.limits.stroke[0] - float(best.output.min() - best.output[0])
        start += 0.5 * (task.limits.travel - needed)
        notes.append(
            f"Start at {output.name} {start:.4g} {output.unit}: from there the "
            f"run needs {needed:.4g} {output.unit} of stroke."
        )
    if task.hold != "zoh" and task.limits.rate is None:
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
        units={name: task.unit},
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
