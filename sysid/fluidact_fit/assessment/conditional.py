"""What hangs on a parameter that was not determined.

A parameter that the data cannot determine is held at its neutral value while the others are
fitted, and their intervals take that value for true. Where the output does say something of it,
some of them would go along with it: its own range, as wide as the data leave it, times their
dependence on it is an error that no interval of theirs holds.

With ``c`` the derivative of the output by the held parameter, ``J`` those by the others and all
whitened, the others move by ``-(J'J)^-1 J' c`` for each unit of it, and the data leave it in
``r +- 2 s``: ``r`` is the least-squares fit of what ``J`` leaves of ``c`` to the residual and
``s`` its standard error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.least_squares import scaled_least_squares
from ..family import ParameterSpec
from ..units import after_number, as_share
from .optimum import Optimum

_MATTERS = 5.0  # standard errors by which a parameter would move: far out of its interval
_ANY = 10.0  # times its value by which a parameter could move when nothing is known of it
_WIDE = 2.0  # standard errors of the held parameter that count as possible


@dataclass(frozen=True)
class Dependence:
    """How far a parameter could move with one that was held: at most by ``shift`` [its unit].

    ``errors`` is that in its standard errors, ``low`` and ``high`` are what the data leave of
    the one that was held.
    """

    low: float
    high: float
    parameter: str
    shift: float
    errors: float


def find_conditional(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Parameters whose intervals take a value for true that nobody knows."""
    table: dict[str, Any] = {}
    notices = []
    for name in _held(at):
        found = list(_dependences(at, at.variant.parameter(name)))
        if found:
            table[name] = [_entry(d) for d in found]
            notices.append(_notice(at, name, max(found, key=lambda d: d.errors)))
    return table, notices


def _entry(d: Dependence) -> dict[str, Any]:
    """For the file, which holds no infinity."""
    return {k: v for k, v in asdict(d).items() if isinstance(v, str) or np.isfinite(v)}


def _held(at: Optimum) -> Iterator[str]:
    for name, q in at.solution.parameters.items():
        if q.status == "not_identified" and isinstance(q.value, float):
            yield name


def _dependences(at: Optimum, spec: ParameterSpec) -> Iterator[Dependence]:
    """Every parameter that would leave its interval for a possible value of the held one."""
    value = at.number(spec.name)
    column = at.slopes(at.plant, spec.name)
    if column is None:
        return
    beside = at.beside_residual(column)
    if not beside.finite:
        return
    white = beside.whiten()
    j, c, r = white[:, :-2], white[:, -2], white[:, -1]
    if not np.any(c):
        return
    along = -scaled_least_squares(j, c)
    own = c + j @ along  # what the others leave of it
    degrees = max(beside.rows - j.shape[1] - 1, 1)
    power = float(own @ own)
    if power <= np.finfo(float).eps * float(c @ c):
        ends = np.array([-np.inf, np.inf])
    else:
        size = float(own @ r) / power
        error = float(np.linalg.norm(r - size * own)) / np.sqrt(degrees * power)
        ends = size + np.array([-_WIDE, _WIDE]) * error
    low, high = np.clip(value + ends, spec.minimum, spec.maximum)
    reach = max(low - value, high - value, key=abs)
    for name, slope, error in zip(at.names, along, at.errors):
        shift = float(slope) * float(reach)
        if abs(shift) > _MATTERS * error:
            yield Dependence(float(low), float(high), name, shift, abs(shift) / float(error))


def _notice(at: Optimum, held: str, worst: Dependence) -> Notice:
    """A warning of what hangs most on a value that was not determined."""
    spec, value = at.variant.parameter(held), at.number(worst.parameter)
    shift = f"{value + worst.shift:.3g} instead of {value:.3g}"
    if not abs(worst.shift) < _ANY * abs(value):
        shift = "anything"
    else:
        shift += as_share(worst.shift, value)
    return Notice(
        "conditional",
        f"the intervals hold only if {held} is {at.number(held):.4g}{after_number(spec.unit)}, "
        "which the data do not determine: with another one that they allow "
        f"{worst.parameter} would be {shift}. "
        f"Fix it if you know it (--fix {held}=VALUE), or record what determines it. {spec.remedy}",
    )
