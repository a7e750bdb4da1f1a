"""Read recorded logs and turn them into experiments."""

from __future__ import annotations

from .agreement import require_agreement
from .arrays import log_of
from .checks import find_constant_signals
from .columns import share_columns
from .describe import describe, provenance
from .experiments import choose_variant, experiments
from .log import Column, Dialect, Log, StepInput
from .opening import LogLike, Reading, open_logs
from .reader import read_log
from .repeats import find_copied_rows, refuse_fitted_rows
from .same_signal import require_two_signals
from .selection import selected_part

__all__ = [
    "Column",
    "Dialect",
    "Log",
    "LogLike",
    "Reading",
    "StepInput",
    "choose_variant",
    "describe",
    "experiments",
    "find_constant_signals",
    "find_copied_rows",
    "log_of",
    "open_logs",
    "provenance",
    "read_log",
    "refuse_fitted_rows",
    "require_agreement",
    "require_two_signals",
    "selected_part",
    "share_columns",
]
