"""Sensitivity of the result to numbers that were given, held or assumed instead of measured.

A mass from a data sheet, a fixed value, and the assumption that all channels were read at the same
instant enter the estimate like data without a standard error; so does the neutral value of a
parameter that the data cannot determine. One simulation tells how far the other parameters would
move with each: ``-(J'J)^-1 J' c`` for a change ``c`` of the output.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.solution import base_name, moved
from ..experiment import FloatArray
from ..options import describe
from ..units import after_number, as_share, as_time
from . import policy
from .optimum import Optimum
from .terms import change_by_delay

_PERCENT = 0.01


def find_reliance(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Effect of an error in every given number, as entries for the file, and a warning of timing.

    An entry has the parameter that would move most, its ``shift``, that in its standard errors, and
    in how many standard errors the residual would show the error.
    """
    part = at.part
    columns = {"one_sample_late": _late(part), "one_percent_more": _other_numbers(part)}
    # significance grows with the square root of the number of samples
    more = float(np.sqrt(at.samples / part.samples))
    table = {
        key: {name: e for name, c in rows if (e := _reliance(part, c, more))}
        for key, rows in columns.items()
    }
    late = table["one_sample_late"]
    return {key: rows for key, rows in table.items() if rows}, list(_timing(part, late))


def _timing(at: Optimum, late: Mapping[str, dict[str, Any]]) -> Iterator[Notice]:
    """Name the parameter that a channel one sample late changes most, unseen."""
    unseen = []
    for role, e in late.items():
        value, shift = at.number(e["parameter"]), abs(e["shift"])
        share = shift / max(abs(value), sys.float_info.min)
        matters = abs(e["standard_errors"]) > policy.TERM_MOVES and share > policy.TIMING_MOVES
        # a parameter that is a time itself is known no better than the instants
        timed = at.variant.parameter(base_name(e["parameter"])).unit == "s"
        if matters and not timed and e["seen_in_residual"] <= policy.TERM_SEEN:
            unseen.append((share, role, e["parameter"], shift, value))
    if not unseen:
        return
    _, role, name, shift, value = max(unseen)
    step = as_time(min(e.sample_time for e in at.experiments))
    yield Notice(
        "timing-matters",
        f"were '{role}' recorded one sample ({step}) early or late, {name} would be off by "
        f"{shift:.2g}{at.unit(name)}{as_share(shift, value)}, and the residuals would not show it. "
        "Read all channels at the same instant, and filter them alike.",
    )


def _late(at: Optimum) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield the change of every series by each input one sample later than recorded."""
    runs = at.experiments
    if all(e.time.size > 1 for e in runs):
        step = min(e.sample_time for e in runs)
        for role in at.driving:
            yield role, [step * c for c in change_by_delay(at, role, step)]


def _other_numbers(at: Optimum) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield the change by each fixed parameter and numerical option one per cent larger."""
    for name, q in at.solution.parameters.items():
        if q.status == "fixed" and isinstance(q.value, float) and q.value:
            yield name, at.change(plant=moved(at.plant, name, _PERCENT * q.value))
    for option in describe(at.family.options_type):
        value = getattr(at.plant.options, option.keyword)
        if option.kind == "float" and value:
            options = replace(at.plant.options, **{option.keyword: value * (1.0 + _PERCENT)})
            yield option.name, at.change(plant=replace(at.plant, options=options))


def _reliance(at: Optimum, columns: Sequence[FloatArray], more: float) -> dict[str, Any]:
    """Return how the parameters compensate for a change of the output, and what remains of it."""
    found = at.regress(columns)
    if found is None:
        return {}
    standard_errors = found.shifts_per_size / at.std_errors
    worst = int(np.argmax(np.abs(standard_errors)))
    return {
        "parameter": at.names[worst],
        "shift": float(found.shifts_per_size[worst]),
        "standard_errors": float(standard_errors[worst]),
        "seen_in_residual": more / max(found.error, 1e-300),
    }


def find_conditional(at: Optimum) -> tuple[dict[str, Any], list[Notice]]:
    """Find parameters whose intervals hold only for the assumed value of an undetermined one.

    The undetermined parameter may lie within two standard errors of its score-test estimate, cut at
    its physical range.
    """
    table: dict[str, Any] = {}
    notices = []
    for name, q in at.solution.parameters.items():
        if q.status == "not_identified" and isinstance(q.value, float):
            found = _dependences(at, name)
            if found:
                table[name] = [_finite(d) for d in found]
                notices.append(_notice(at, name, max(found, key=lambda d: float(d["errors"]))))
    return table, notices


def _finite(entry: dict[str, Any]) -> dict[str, Any]:
    """The entry without infinities, which a file cannot hold."""
    return {k: v for k, v in entry.items() if isinstance(v, str) or np.isfinite(v)}


def _dependences(at: Optimum, held: str) -> list[dict[str, Any]]:
    """Entries of all parameters that would leave their interval for a possible held value."""
    spec, value = at.variant.parameter(held), at.number(held)
    columns, instruments = at.slopes(at.plant, held) or ((), ())
    found = at.regress(columns, instruments) if columns else None
    if found is None or not any(map(np.any, columns)):
        return []
    ends = value + found.size + 2.0 * found.error * np.array([-1.0, 1.0])
    low, high = (float(x) for x in np.clip(ends, spec.minimum, spec.maximum))
    reach = max(low - value, high - value, key=abs)
    shifts = [_possible(at, n, float(s)) for n, s in zip(at.names, found.shifts_per_size * reach)]
    return [
        {"low": low, "high": high, "parameter": name, "shift": shift,
         "errors": abs(shift) / float(error)}
        for name, shift, error in zip(at.names, shifts, at.std_errors)
        if abs(shift) > policy.HELD_MOVES * error
    ]  # fmt: skip


def _possible(at: Optimum, name: str, shift: float) -> float:
    """The shift, cut at the physical range of the parameter."""
    spec, value = at.variant.parameter(base_name(name)), at.number(name)
    return float(np.clip(value + shift, spec.minimum, spec.maximum)) - value


def _notice(at: Optimum, held: str, worst: dict[str, Any]) -> Notice:
    """Warn of the parameter that depends most on a value that was not determined."""
    spec, name = at.variant.parameter(held), worst["parameter"]
    value = at.number(name)
    effect = f"nothing is known of {name}"
    if abs(worst["shift"]) < policy.ANYTHING * abs(value):
        other = value + worst["shift"]
        effect = f"{name} would be {other:.3g} instead of {value:.3g}"
        effect += as_share(worst["shift"], value)
    return Notice(
        "conditional",
        f"the intervals hold only if {held} is {at.number(held):.4g}{after_number(spec.unit)}, "
        f"which the data do not determine: with another one that they allow, {effect}. "
        f"Fix it if you know it (--fix {held}=VALUE), or record what determines it. {spec.remedy}",
    )
