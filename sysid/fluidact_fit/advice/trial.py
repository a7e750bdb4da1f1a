"""Trial fits of a suggestion, and views of its data without a model."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import FluidactError, LogError, NotIdentifiedError, UsageError
from ..estimation.inputs import settle_holds
from ..experiment import Experiment
from ..families import get_family
from ..fitting import fit
from ..logs import Log, experiments, selected_part
from ..logs.columns import find_column, reference_of, time_candidate
from ..model_free import Views, view_fit, view_runs
from ..presentation import why_not_identified
from .suggestion import Suggestion

_OPTION = re.compile(r"--[a-z][a-z0-9-]*[ =][A-Z][A-Z0-9]+\b")
_DROP = "--invalid=drop"
_ROWS = 50_000  # of all logs, beyond which none is tried


def try_fits(
    suggestions: Sequence[Suggestion],
    logs: Sequence[Log],
    progress: Callable[[str], None] | None = None,
) -> list[Suggestion]:
    """Return suggestions with the outcome of a fit; very long logs are not tried."""
    rows = sum(selected_part(log).rows for log in logs)
    if rows > _ROWS:
        reason = f"not tried: {rows} rows are more than {_ROWS}"
        return [replace(s, reason=reason) for s in suggestions]
    return [s if s.asked else _try_fit(s, logs, progress) for s in suggestions]


def _try_fit(
    s: Suggestion, logs: Sequence[Log], progress: Callable[[str], None] | None
) -> Suggestion:
    """Return a suggestion with the outcome of a fit."""
    if progress is not None:
        progress(f"trying {s.family}")
    if _DROP in s.options:
        logs = [replace(log, invalid="drop") for log in logs]
    pairs = (option.removeprefix("--").split("=") for option in s.options if option != _DROP)
    chosen: dict[str, Any] = {name.replace("-", "_"): value for name, value in pairs}
    try:
        result = fit(s.family, bound_logs(logs, s), **chosen)
    except NotIdentifiedError as error:
        if error.option and not chosen:
            why = f"without {error.option}, {error.what}"
            return _try_with(error.option, why, s, logs, progress)
        return replace(s, verdict="refused", reason=_one_line(error, logs))
    except (UsageError, LogError) as error:
        unsaid = not s.options and all(log.invalid is None for log in logs)
        if _DROP in error.remedy and unsaid:
            why = f"{error.where}: {error.what} No row is dropped unless you ask for it."
            return _try_with(_DROP, why, s, logs, progress)
        return replace(s, reason=_one_line(error, logs), asked=tuple(_OPTION.findall(error.remedy)))
    free = [q for q in result.parameters.values() if q.status == "estimated"]
    return replace(
        s, verdict=str(result.verdict), fit_percent=result.document.fit.fit_percent,
        parameters=sum(np.size(q.value) for q in free),
        not_identified=why_not_identified(result.document),
        result=result,
    )  # fmt: skip


def _try_with(
    option: str,
    why: str,
    s: Suggestion,
    logs: Sequence[Log],
    progress: Callable[[str], None] | None,
) -> Suggestion:
    """The same with an option that the first trial asked for; the reason says why."""
    tried = _try_fit(replace(s, options=(*s.options, option)), logs, progress)
    return replace(tried, reason=f"{why} {tried.reason}".strip())


def _one_line(error: FluidactError, logs: Sequence[Log]) -> str:
    """Refusal and remedy in one line, in the words of the command line; of several logs which."""
    where = f"{error.where}: " if error.where and len(logs) > 1 else ""
    said = [f"{where}{error.what}", error.expected.replace("Nothing was written.", "")]
    said.append(error.remedy)
    ended = (text if text.rstrip().endswith((".", ":")) else f"{text}." for text in said if text)
    return " ".join(" ".join(ended).split())


def bound_log(log: Log, s: Suggestion) -> Log:
    """Return a log with the columns of a suggestion bound to its roles."""
    bindings = {**log.bindings, **s.columns}
    time = time_candidate(log)
    if time is not None and log.sample_time is None:
        bindings.setdefault("time", f"#{time.column.index}")
    roles = {r.name for r in get_family(s.family).variant(s.variant).roles}
    return replace(log, bindings={r: at for r, at in bindings.items() if r in roles})


def bound_logs(logs: Sequence[Log], s: Suggestion) -> list[Log]:
    """Return logs bound as by the command of a suggestion: by the headers of the first."""
    first = bound_log(logs[0], s)
    words = {
        role: reference_of(first, find_column(first, role, at), logs[1:])
        for role, at in first.bindings.items()
    }
    return [replace(log, bindings={**words, **log.bindings}) for log in logs]


def views_of(s: Suggestion, logs: Sequence[Log]) -> Views | None:
    """Response of the output without a model, and that of the trial's model."""
    if s.result is not None:
        return view_fit(s.result)
    variant = get_family(s.family).variant(s.variant)
    runs: list[Experiment] = []
    try:
        for index, log in enumerate(bound_logs(logs, s)):
            runs += experiments(log, variant, index=index)[0]
        return view_runs(variant, settle_holds(runs))
    except (LogError, UsageError):
        return None
