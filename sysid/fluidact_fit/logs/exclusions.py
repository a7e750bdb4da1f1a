"""Parts of a log that are left out, and what was constant while it was recorded.

``run=2``, ``time=3:3.5``, ``rows=7:9`` and ``lines=120:130`` leave out a run, seconds of every run,
rows of the data and lines of the file. A constant is ``25 %`` or ``0.3 m``; it may stand in the
name of the file, where ``kinked{%}`` finds the number of ``kinked25_Test8.csv``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import UsageError
from ..experiment import BoolArray, FloatArray
from .grid import Run
from .log import MIN_RUN, Column, Exclusion, IntArray, Log, StepInput

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_LONGEST_NAME = 4096  # characters of a file name
_FORMS = "run=2, time=3:3.5 (seconds, either end may be empty), rows=7:9 or lines=120:130"


def parse_exclusion(text: str) -> Exclusion:
    """Read ``run=2``, ``time=3:3.5``, ``rows=7:9`` or ``lines=120:130`` (else ``UsageError``)."""
    kind, _, what = text.strip().partition("=")
    low, colon, high = what.partition(":")
    try:
        if kind == "run" and not colon:
            return Exclusion(kind, _whole(low), _whole(low))
        if kind in ("lines", "rows"):
            first, last = _whole(low), _whole(high if colon else low)
            if first <= last:
                return Exclusion(kind, first, last)
        if kind == "time" and colon:
            ends = float(low or "-inf"), float(high or "inf")
            if ends[0] < ends[1] and (low or high):
                return Exclusion(kind, *ends)
    except ValueError:
        pass
    if kind == "rows":
        raise UsageError(
            f"--exclude-rows {what} is not understood.",
            expected="Expected rows counted from 1: 7, or the first and the last as 120:130.",
            remedy="For one log of several: --exclude-rows trial1.csv:7.",
        )
    raise UsageError(
        f"--exclude {text!r} is not understood.",
        expected=f"Expected {_FORMS}.",
        remedy="For one log of several: --exclude 'trial1.csv:run=2'.",
    )


def _whole(text: str) -> float:
    if not re.fullmatch(r"[0-9]{1,12}", text.strip()) or int(text) < 1:
        raise ValueError(text)
    return float(text)


def parse_constant(role: str, text: str) -> tuple[float, str | None]:
    """Read ``25 %`` or ``0.3``: number and unit, ``None`` without one."""
    found = re.fullmatch(rf"\s*((?>{_NUMBER}))\s*(\S.*)?", str(text))
    if found is None or not math.isfinite(float(found[1])):
        raise UsageError(
            f"--set {role}={text} is not a number.",
            expected="Expected a number, and its unit where it is not SI.",
            remedy=f"Give for example --set '{role}=25 %'.",
        )
    return float(found[1]), found[2].strip() if found[2] else None


def find_in_name(role: str, template: str, name: str) -> tuple[float, str | None] | None:
    """Number that stands in a file name where a template has ``{UNIT}``; ``None`` without one."""
    found = re.fullmatch(r"([^{}]*)\{([^{}]*)\}([^{}]*)", template)
    if found is None or not (found[1] or found[3]):
        raise UsageError(
            f"--from-name {role}={template} does not say where the number is.",
            expected="Expected the text around it, and braces with the unit in its place.",
            remedy=f"Give for example --from-name '{role}=kinked{{%}}'.",
        )
    number = re.search(
        rf"{re.escape(found[1])}({_NUMBER}){re.escape(found[3])}", name[:_LONGEST_NAME]
    )
    return None if number is None else (float(number[1]), found[2].strip() or None)


def with_constants(log: Log, constants: Mapping[str, str], from_name: Mapping[str, str]) -> Log:
    """The log with roles that were constant, from its name or as given; the name comes first."""
    steps, units, named = dict(log.steps), dict(log.units), dict(log.from_name)
    for role in dict.fromkeys((*constants, *from_name)):
        found = find_in_name(role, from_name[role], log.name) if role in from_name else None
        if found is not None:
            named[role] = from_name[role]
        elif role in constants:
            found = parse_constant(role, constants[role])
        if found is None:
            raise UsageError(
                f"--from-name {role}={from_name[role]} finds no number in '{log.name}'.",
                remedy=f"Give it with --set '{log.name}:{role}=VALUE UNIT'.",
            )
        value, unit = found
        steps[role] = StepInput(value, value)
        if unit is not None:
            units[role] = unit
    return replace(log, steps=steps, units=units, from_name=named)


def without(log: Log, exclusions: Sequence[Exclusion]) -> Log:
    """The log without the rows and lines excluded; runs and seconds are noted for later."""
    log = replace(log, exclude=tuple(exclusions))
    if all(x.kind not in ("lines", "rows") for x in exclusions):
        return log
    kept: BoolArray = np.ones(log.rows, dtype=np.bool_)
    places = {"lines": log.lines, "rows": 1 + np.arange(log.rows)}
    for x in exclusions:
        if x.kind in places:
            numbers = places[x.kind]
            if not numbers.size or x.low > numbers[-1] or x.high < numbers[0]:
                raise _nothing_there(log, x, f"Its data are {x.kind} {_extent(numbers)}.")
            kept &= (numbers < x.low) | (numbers > x.high)
    if kept.all():
        return log
    if not kept.any():
        raise UsageError(f"--exclude leaves out all of {log.name}.", remedy="Leave out less.")
    account = log.account
    out = [(int(line), "excluded") for line in log.lines[~kept]]
    left_out = tuple(sorted([*account.left_out, *out]))
    account = replace(account, data_rows=int(kept.sum()), left_out=left_out)
    return replace(with_rows(log, kept), account=account)


def _nothing_there(log: Log, x: Exclusion, expected: str) -> UsageError:
    ends = dict.fromkeys((x.low, x.high))
    what = ":".join("" if math.isinf(end) else f"{end:g}" for end in ends)
    return UsageError(
        f"--exclude {x.kind}={what} leaves out nothing of {log.name}.", expected=expected,
        remedy="Correct it or, with several logs, name the one it is for: "
        f"--exclude 'LOG:{x.kind}={what}'.",
    )  # fmt: skip


def _extent(values: FloatArray | IntArray) -> str:
    return f"{values[0]:g} to {values[-1]:g}" if values.size else "none"


def with_rows(log: Log, kept: BoolArray) -> Log:
    """Return a log with some of its rows; ``kept`` has shape ``(n_rows,)``."""
    return replace(
        log,
        columns=tuple(_rows(column, kept) for column in log.columns),
        lines=log.lines[kept],
        places=(np.arange(log.rows) if log.places is None else log.places)[kept],
    )


def _rows(column: Column, kept: BoolArray) -> Column:
    places = np.cumsum(kept) - 1
    bad = {int(places[row]): text for row, text in column.bad.items() if kept[row]}
    exact = column.exact and column.exact._replace(since=column.exact.since[kept])
    return replace(column, values=column.values[kept], bad=bad, exact=exact)


def exclude_runs(log: Log, runs: Sequence[Run]) -> list[Run]:
    """Runs without those that are excluded; one with a gap becomes several.

    What drove the machine meanwhile is left out as well: each part begins where it was then.
    """
    dropped = {int(x.low) for x in log.exclude if x.kind == "run"}
    if wrong := [n for n in dropped if n > len(runs)]:
        raise UsageError(
            f"--exclude run={wrong[0]}: {log.name} holds {len(runs)} "
            f"{'run' if len(runs) == 1 else 'runs'}.",
            remedy="See `fluidact-fit inspect`; runs are counted from 1.",
        )
    left = [run for number, run in enumerate(runs, start=1) if number not in dropped]
    timed = [run.time for run in runs if run.time.size]
    for x in log.exclude:
        if x.kind == "time":
            # what a window has taken away need not be there
            if (
                timed
                and log.window is None
                and not any(((t >= x.low) & (t <= x.high)).any() for t in timed)
            ):
                ends = np.array([min(t[0] for t in timed), max(t[-1] for t in timed)])
                raise _nothing_there(log, x, f"Its time runs from {_extent(ends)} s.")
            left = [part for run in left for part in _apart(run, x)]
    if not left:
        raise UsageError(f"--exclude leaves out all of {log.name}.", remedy="Leave out less.")
    return left


def _apart(run: Run, x: Exclusion) -> list[Run]:
    """The parts of a run before and after what is excluded."""
    slack = 1e-6 * run.sample_time
    before, after = run.time < x.low - slack, run.time > x.high + slack
    parts = [run.part(kept) for kept in (before, after) if kept.sum() >= MIN_RUN]
    return [run] if (before | after).all() else parts
