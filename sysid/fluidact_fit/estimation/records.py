"""Arrays given instead of a log: checked, and made into a signal."""

from __future__ import annotations

from typing import get_args

import numpy as np
import numpy.typing as npt

from ..errors import UsageError
from ..experiment import FloatArray, Hold, Signal
from .inputs import choose_hold


def check_record(values: npt.ArrayLike, time: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Instants and values as finite arrays of equal length, instants increasing.

    Raises
    ------
    UsageError
        When they are not.
    """
    u = np.asarray(values, dtype=float)
    t = np.asarray(time, dtype=float)
    if u.ndim != 1 or t.shape != u.shape or u.size == 0:
        raise UsageError(
            f"input of shape {u.shape} at instants of shape {t.shape}",
            expected="Two one-dimensional arrays of the same length, at least one sample.",
        )
    if not (np.isfinite(u).all() and np.isfinite(t).all()):
        raise UsageError("input or instants hold a value that is not finite")
    if t.size > 1 and not (np.diff(t) > 0.0).all():
        raise UsageError("the instants do not increase", remedy="Sort them, drop repeated ones.")
    return t, u


def make_signal(
    role: str, values: npt.ArrayLike, time: npt.ArrayLike, unit: str, hold: Hold
) -> Signal:
    """Signal of a record, its hold settled.

    Raises
    ------
    UsageError
        When the record or the hold is not possible.
    """
    t, u = check_record(values, time)
    if hold not in get_args(Hold):
        raise UsageError(
            f"hold cannot be {hold!r}", expected=f"One of {', '.join(get_args(Hold))}."
        )
    signal = Signal(role, t, u, unit, hold, before=float(u[0]))
    if hold == "auto":
        signal = Signal(role, t, u, unit, choose_hold([signal]), before=float(u[0]))
    return signal
