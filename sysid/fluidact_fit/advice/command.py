"""The command that fits what is suggested."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

from ..errors import LogError
from ..files import powershell_command, shell_command
from ..logs import Log
from ..logs.columns import default_column, reference_of
from .suggestion import Suggestion
from .trial import bound_log


def with_command(s: Suggestion, logs: Sequence[Log], typed: Sequence[str]) -> Suggestion:
    """Return a suggestion with its command, for logs whose options were ``typed``."""
    asked = [word for option in s.asked for word in shlex.split(option)]
    named = any(word.startswith(("-o", "--output")) for word in typed)
    output = [] if named else ["-o", f"{s.family}.yaml"]
    words = ["fluidact-fit", s.family, *typed, *column_options(s, logs), *s.options,
             *asked, *output]  # fmt: skip
    return replace(s, command=shell_command(words), powershell=powershell_command(words))


def column_options(s: Suggestion, logs: Sequence[Log]) -> list[str]:
    """``--column`` of every role that a fit would not find by itself."""
    out, log = [], logs[0]
    for role, at in bound_log(log, s).bindings.items():
        if role in log.bindings:
            continue  # the user has given it
        column = next(c for c in log.columns if f"#{c.index}" == at)
        try:
            known = default_column(log, role)
        except LogError:
            known = None
        if known is not column:
            out += ["--column", f"{role}={reference_of(log, column, logs[1:])}"]
    return out


def given_options(log: Log) -> list[str]:
    """Options by which the user described a log."""
    out = []
    by_role = {"column": log.bindings, "unit": log.units, "scale": log.scales, "hold": log.holds}
    for option, values in by_role.items():
        for role, value in values.items():
            text = f"{value:.12g}" if isinstance(value, float) else str(value)
            out += [f"--{option}", f"{role}={text}"]
    if log.sample_time is not None:
        out += ["--sample-time", f"{log.sample_time:.12g}"]
    if log.window_text.strip(":"):
        out += ["--window", log.window_text]
    for part in log.exclude:
        out += ["--exclude", part.text]
    return [*out, "--invalid", log.invalid] if log.invalid is not None else out
