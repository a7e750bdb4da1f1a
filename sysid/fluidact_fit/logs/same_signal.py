"""Refuse a log in which two roles are one signal: a column given twice, or copied in another unit.

A copy differs from its original by a factor, and by the rounding of what was printed; two sensors
differ by their noise as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ..errors import LogError
from ..experiment import Experiment, FloatArray
from ..specification import Variant
from .log import Log

_FEWEST = 8  # samples that tell
_FEW = 400  # samples over the log that are looked at first
_ROUNDING = 0.51  # of the steps of both columns, by which a copy is off at most
_EXACT = 1e-9  # of its range, by which arithmetic is off
_COARSE = 1e-3  # of its range: what is rounded more has to be an exact copy
_FACTOR = 1e-4  # part by which the factor between two units is off


def require_two_signals(log: Log, variant: Variant, runs: Sequence[Experiment]) -> None:
    """Refuse a log of which two roles hold the same numbers, or one signal in two units.

    In a machine that moves, input and output are never proportional to the last digit. A static
    map may be a straight line: there only a factor of ten, hundred, ... tells of a copy.

    Raises
    ------
    LogError
        Naming the two roles.
    """
    moving = any(role.name == "time" and role.required for role in variant.roles)
    for one, other in combinations([r.name for r in variant.roles if r.name != "time"], 2):
        both = [e for e in runs if _sampled_alike(e, one, other)]
        factors = [_factor(e, one, other, moving) for e in both]
        if not both or not all(factors):
            continue
        same = all(np.array_equal(e[one], e[other]) for e in both)
        words = "the same numbers" if same else "one signal, in two units or up to a factor"
        raise LogError(
            f"'{one}' and '{other}' hold {words}: a column seems to be given twice.",
            where=log.name,
            expected="Expected a column of its own for each.",
            remedy=f"Name the right ones with --column {one}=... and --column {other}=...",
        )


def _sampled_alike(e: Experiment, one: str, other: str) -> bool:
    if one not in e or other not in e or e[one].size < _FEWEST:
        return False
    return np.array_equal(e.signals[one].time, e.signals[other].time)


def _factor(e: Experiment, one: str, other: str, moving: bool) -> float:
    """By what the second signal is the first one, 0 where it is another one."""
    x, y = e[one], e[other]
    few = slice(None, None, max(x.size // _FEW, 1))  # most are told apart by these
    steps = [e.signals[role].resolution for role in (one, other)]
    if not _proportional(x[few], y[few], steps, moving):
        return 0.0
    return _proportional(x, y, steps, moving)


def _proportional(x: FloatArray, y: FloatArray, steps: Sequence[float], moving: bool) -> float:
    a, b = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    span = float(np.ptp(b))
    if not (np.ptp(a) > 0.0 and span > 0.0 and np.isfinite(a).all() and np.isfinite(b).all()):
        return 0.0
    if np.array_equal(a, b):
        return 1.0
    mean_a, mean_b = (float(v.mean()) for v in (a, b)) if moving else (0.0, 0.0)
    da, db = a - mean_a, b - mean_b
    factor = float(da @ db) / float(da @ da)
    exact = _EXACT * float(np.abs(b).max())
    rounding = _ROUNDING * (steps[1] + abs(factor) * steps[0])
    if np.abs(db - factor * da).max() > exact + (rounding if rounding < _COARSE * span else 0.0):
        return 0.0
    power = np.log10(abs(factor)) if factor else np.inf
    return factor if moving or abs(power - round(power)) < _FACTOR else 0.0
