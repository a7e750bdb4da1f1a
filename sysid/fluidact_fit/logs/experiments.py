"""From a log to experiments: SI arrays with named roles, one per run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import LogError, Notice, UsageError
from ..experiment import Experiment, Signal, at_rows
from ..specification import Role, Variant
from ..units import conversion_factor
from ..units.quantities import plausible
from .agreement import absolute_notice, overridden_notice, require_agreement
from .checks import check_sampling, check_signals, find_suspects, smallest_step
from .columns import (
    Binding,
    assumed_notice,
    bind_role,
    bind_roles,
    check_roles,
    exchanged_notice,
    in_unit,
    missing_roles,
    require_roles,
)
from .grid import Run, counted_run, make_run, print_resolution, untimed_run
from .invalid import require_numbers, without_invalid
from .log import MIN_RUN, Log, StepInput, check_hold
from .repeats import check_lines, check_repeats
from .selection import select_runs
from .spikes import replace_spikes
from .timebase import split_runs
from .turns import settle_turns

_OTHER_STEP = 0.05  # logarithm of the ratio of two sample times that contradict each other
_LARGEST = 1e30  # of any quantity in SI; products of a few must not overflow
SHORTEST, LONGEST = 1e-12, 1e9  # step of time [s]


def choose_variant(logs: Log | Sequence[Log], variants: Sequence[Variant]) -> Variant:
    """Return the variant whose roles the logs hold; ``LogError`` says what the closest one lacks.

    The variant has to be complete for every log; of several, the one that uses the most of
    the roles the user named wins, then the first.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    everything = {role.name: role for variant in variants for role in variant.roles}
    for log in logs:
        check_roles(log, everything.values())

    def rank(variant: Variant) -> tuple[int, int]:
        names = {role.name for role in variant.roles}
        named = sum(len(names & {*log.bindings, *log.steps}) for log in logs)
        return -sum(len(missing_roles(log, variant.roles)) for log in logs), named

    chosen = max(variants, key=rank)
    for log in logs:
        require_roles(log, chosen.roles)
    return chosen


def experiments(
    log: Log, variant: Variant, *, index: int = 0
) -> tuple[list[Experiment], list[Notice]]:
    """Turn a log into experiments of a variant: one per run, and everything worth a warning.

    ``index`` is the number of the log among those of the fit, from 0.

    Raises
    ------
    UsageError
        When an option does not fit the variant.
    UnitError
        When a column has a unit of the wrong dimension.
    LogError
        When a role is missing, a used cell is no number or time cannot be ordered.
    """
    check_roles(log, variant.roles)
    require_roles(log, variant.roles)
    require_agreement([log], variant)
    bindings = bind_roles(log, variant.roles)
    notices = list(log.notices)
    runs = _find_runs(log, variant, bindings, notices)
    _require_time_scale(log, runs)
    notices += assumed_notice(log, bindings.values())
    notices += exchanged_notice(log, variant.roles, bindings)
    notices += overridden_notice(log, bindings)
    notices += absolute_notice(log, bindings.values())
    written, turned = bindings, settle_turns(log, bindings, runs)
    notices += turned.notices
    runs = select_runs(log, runs)
    kept = without_invalid(log, turned.bindings, runs)
    bindings, whole = kept.bindings, [run for _, run in kept.runs]
    notices += kept.notices
    suspects = find_suspects(log, written)
    resolutions = {
        role: smallest_step(b.column.values) * abs(b.to_si)
        for role, b in written.items()
        if role != "time"
    }
    runs = [_sampled_run(log, variant, bindings, run) for run, _ in kept.runs]
    pairs = list(zip(runs, whole))
    attributes = {"turns": turned.turns, "dropped": kept.dropped}
    found = _make_experiments(log, variant, bindings, pairs, resolutions, attributes, index)
    cleaned = [replace_spikes(e, variant) for e in found]
    found = [e for e, _ in cleaned]
    notices += [n for _, said in cleaned for n in said]
    notices += _time_bases(log, found)
    notices += check_sampling(log, runs)
    notices += check_signals(log, bindings, found, suspects)
    notices += check_repeats(log, bindings, found)
    notices += check_lines(log, bindings, found)
    return found, notices


def _time_bases(log: Log, found: Sequence[Experiment]) -> list[Notice]:
    """Say which columns were sampled at other instants than the output."""
    other = {
        role: float(np.median(np.diff(s.time)))
        for e in found
        for role, s in e.signals.items()
        if s.time.size > 1 and s.time is not e.time and not np.array_equal(s.time, e.time)
    }
    if not other:
        return []
    listed = ", ".join(f"'{role}' every {step:g} s" for role, step in other.items())
    return [
        Notice(
            "time-bases",
            f"{log.name}: {listed}, the output every {found[0].sample_time:g} s; each is used at "
            "its own instants, nothing was resampled.",
        )
    ]


def _time_replaced(log: Log, unused: Binding, sample_time: float) -> Notice:
    """Report a time column that was not used, and warn of one in seconds that contradicts."""
    words = (
        f"{log.name}: the time column '{unused.column.label}' was not used, "
        f"--sample-time {sample_time:g} replaces it."
    )
    steps = np.diff(unused.column.values) * unused.to_si
    own = float(np.median(steps)) if steps.size else np.nan
    if unused.assumed or not own > 0.0 or abs(np.log(own / sample_time)) < _OTHER_STEP:
        return Notice("time-replaced", words)
    times = max(own / sample_time, sample_time / own)
    return Notice(
        "time-contradicted",
        f"{words} It says {own:.3g} s between samples, {times:.3g} times "
        f"{'more' if own > sample_time else 'less'}. Leave --sample-time out unless the column is "
        "wrong.",
    )


def _find_runs(
    log: Log, variant: Variant, bindings: dict[str, Binding], notices: list[Notice]
) -> list[Run]:
    """Return the runs of a log; drops an optional time column that cannot be used."""
    timed = next((role for role in variant.roles if role.name == "time"), None)
    if timed is not None and log.sample_time is not None:
        if (unused := bind_role(log, timed)) is not None:
            notices.append(_time_replaced(log, unused, log.sample_time))
        return [counted_run(log.rows, log.sample_time, log.places)]
    binding = bindings.get("time")
    if timed is None or binding is None:
        return [untimed_run(log.rows)]
    try:
        runs, found = split_runs(log, binding)
    except LogError as error:
        if timed.required or "time" in log.bindings:
            raise
        # The user did not ask for this column, and static data do not need it.
        del bindings["time"]
        notices.append(
            Notice("time-unusable", f"{error.where}: {error.what} The time column was not used.")
        )
        return [untimed_run(log.rows)]
    notices.extend(found)
    return runs


def _require_time_scale(log: Log, runs: Sequence[Run]) -> None:
    """Refuse sample times that no machine has and that arithmetic cannot handle."""
    for run in runs:
        step = run.sample_time
        if run.time.size < 2 or SHORTEST <= step <= LONGEST:
            continue
        what = f"the samples are {step:.3g} s apart."
        expected = f"Expected {SHORTEST:g} to {LONGEST:g} s."
        if log.sample_time is not None:
            raise UsageError(what, expected=expected, remedy="Correct --sample-time.")
        raise LogError(
            what,
            where=log.name,
            expected=expected,
            remedy="Check the time column, --unit time=... and --scale time=...",
        )


def _make_experiments(
    log: Log,
    variant: Variant,
    bindings: Mapping[str, Binding],
    runs: Sequence[tuple[Run, Run]],
    resolutions: Mapping[str, float],
    attributes: Mapping[str, Any],
    index: int,
) -> list[Experiment]:
    measured = {role: b for role, b in bindings.items() if role != "time"}
    spent = _spent(log, measured)
    _require_steps_within(log, [run for run, _ in runs])
    found = []
    for number, (run, whole) in enumerate(runs, start=1):
        signals = {
            role: _measured_signal(log, binding, run, whole, resolutions[role], role in spent)
            for role, binding in measured.items()
        }
        for role in variant.roles:
            if role.name in log.steps:
                step, scale = log.steps[role.name], log.scales.get(role.name, 1.0)
                unit = step.unit or log.units.get(role.name)
                where = f"--{'set' if step.start == step.end else 'step'} {role.name}=..."
                signals[role.name] = step_signal(in_unit(role, unit), step, where, unit, scale)
        first, last = log.lines[run.rows[[0, -1]]].tolist()
        found.append(
            Experiment(
                name=log.name if len(runs) == 1 else f"{log.name}#{number}",
                log=index,
                time=run.time,
                signals=signals,
                sample_time=run.sample_time,
                uniform=run.uniform,
                attributes={"lines": (first, last), **attributes},
            )
        )
    return found


def _require_steps_within(log: Log, runs: Sequence[Run]) -> None:
    """Refuse a step after the end: nothing in the log would answer to it."""
    end = max((float(run.time[-1]) for run in runs if run.time.size), default=np.inf)
    for role, step in log.steps.items():
        if step.at >= end and step.start != step.end:
            raise UsageError(
                f"--step {role}={step.start:g}:{step.end:g}@{step.at:g}: {log.name} ends before "
                f"that, at {end:g} s.",
                remedy="Give the instant of the step by the time of the log.",
            )


def _spent(log: Log, measured: Mapping[str, Binding]) -> set[str]:
    """Roles whose column may be turned to SI where it lies: nobody else reads it."""
    if not log.disposable:
        return set()
    times = Counter(b.column.index for b in measured.values())
    return {role for role, b in measured.items() if times[b.column.index] == 1}


def _sampled_run(log: Log, variant: Variant, bindings: Mapping[str, Binding], run: Run) -> Run:
    """The rows of a run in which the output was sampled; all where none is sparse."""
    output = bindings.get(variant.output.name)
    if output is None or not output.column.sparse or not run.time.size:
        return run
    kept = np.isfinite(output.column.values[run.rows])
    if kept.sum() < MIN_RUN:
        raise LogError(
            f"column '{output.column.label}' holds {int(kept.sum())} samples.",
            where=log.where(run.rows[0]),
            expected=f"Expected {MIN_RUN} or more in a run.",
            remedy=f"Give --column {variant.output.name}=... with another column.",
        )
    return make_run(run.rows[kept], run.time[kept], print_resolution(run.time[kept]), 1.0)


def _measured_signal(
    log: Log, binding: Binding, run: Run, whole: Run, resolution: float, spent: bool
) -> Signal:
    """Return a column over one run, in SI.

    What drives the machine keeps the instants at which it was sampled; all else is read off
    straight lines where the output was sampled at other ones. ``whole`` is the run with every
    row. Refused are values whose squares overflow or vanish: nothing can be computed with them.
    A column that is ``spent`` gives its memory away.
    """
    rows, time = run.rows, run.time
    if binding.column.sparse and whole.time.size:
        kept = np.isfinite(binding.column.values[whole.rows])
        if kept.any() and not np.array_equal(whole.rows[kept], rows):
            rows, time = whole.rows[kept], whole.time[kept]
    require_numbers(log, binding, rows)
    role, raw = binding.role, at_rows(binding.column.values, rows)
    size = max(float(raw.max()), -float(raw.min())) * abs(binding.to_si)
    if size != 0.0 and not 1.0 / _LARGEST <= size <= _LARGEST:
        worst, extreme = int(np.argmax(np.abs(raw))), "large" if size > _LARGEST else "small"
        raise LogError(
            f"column '{binding.column.label}' holds {raw[worst]:g}, which is too {extreme} to "
            "compute with.",
            where=log.where(rows[worst]),
            expected=f"Expected {role.name} in the range of a real sensor, in {role.unit}.",
            remedy=f"Check the column and --unit {role.name}=..., or remove the line.",
        )
    values = raw
    if binding.to_si != 1.0:
        values = np.multiply(raw, binding.to_si, out=raw if spent and raw.flags.writeable else None)
    if role.hold is None and time is not run.time:
        time, values = run.time, np.interp(run.time, time, values)
    return Signal(
        role=role.name,
        time=time,
        values=values,
        unit=role.unit,
        hold=check_hold(role.name, log.holds.get(role.name)) or role.hold,
        before=float(values[0]),
        resolution=resolution,
        logged_in=binding.logged_in,
    )


def step_signal(
    role: Role, step: StepInput, where: str, unit: str | None, scale: float = 1.0
) -> Signal:
    """Return the signal of a role that was not recorded but is known to have stepped."""
    factor = conversion_factor(unit, role.unit, where, role.name) if unit else 1.0
    factor *= scale
    for value in (step.start * factor, step.end * factor):
        try:
            plausible(value)
        except ValueError as error:
            raise UsageError(
                f"{where}: {value:g} {role.unit} is {error}",
                remedy=f"Check it, and --unit and --scale of {role.name}.",
            ) from None
    return Signal(
        role=role.name,
        time=np.array([step.at]),
        values=np.array([step.end * factor]),
        unit=role.unit,
        hold="zoh",
        before=step.start * factor,
        resolution=abs(step.end - step.start) * abs(factor),
    )
