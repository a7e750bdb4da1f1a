"""Search for the families that some logs may be of."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..families import family_names
from ..logs import Log, selected_part
from ..logs.columns import time_candidate
from .assignment import best_variant, is_constant, varies
from .command import given_options, with_command
from .suggestion import Suggestion, in_order_of_merit
from .trial import try_fits
from .undecided import assigned_by_order, lacking_one, with_open_roles

_TRIED = 4  # families at most
_SHORTLIST = 0.75  # of the best score, down to which families are tried


def suggest(
    logs: Sequence[Log],
    paths: Sequence[str],
    only: str | None = None,
    *,
    trial: bool = True,
    words: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Suggestion]:
    """Return the families that fit some logs of one machine, the best first.

    Parameters
    ----------
    logs
        As read, with what is known of their columns.
    paths
        What they are called on the command line.
    only
        Judge this family alone.
    trial
        Fit the likeliest ones.
    words
        Logs and options of reading as they were typed, for the commands; without them those of the
        first log.
    progress
        Called with what is being done.
    """
    log, names = logs[0], [only] if only else family_names()
    typed = [*paths, *given_options(log)] if words is None else list(words)
    time = time_candidate(log)
    columns = [c for c in selected_part(log).columns
               if time is None or c.index != time.column.index]  # fmt: skip
    signals = [c for c in columns if varies(c)]
    constant = [c for c in columns if is_constant(c)]
    timed = time is not None or log.sample_time is not None
    found = [s for name in names for s in best_variant(name, log, signals, timed)]
    found.sort(key=lambda s: -s.score)
    found = [s for s in found if s.score >= _SHORTLIST * found[0].score]
    incomplete: list[Suggestion] = []
    if not found:
        found = list(lacking_one(names, log, signals, constant, timed))
    if not found:
        found = list(assigned_by_order(names, log, signals, timed))
        others = [name for name in names if name not in {s.family for s in found}]
        incomplete = with_open_roles(others, log, signals, timed)
    found = found[:_TRIED]
    tried = try_fits(found, logs, progress) if trial else found
    return [with_command(s, logs, typed) for s in [*in_order_of_merit(tried), *incomplete]]
