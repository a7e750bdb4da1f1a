"""Suggestions where units and names do not say what every column is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..assessment import leads
from ..channels import factor_between
from ..families import get_family
from ..logs import Log
from ..logs.log import Column, name_columns
from ..specification import Role, Variant
from ..units import dimension_name, same_dimension, unit_doubt
from .assignment import (
    MEASURED,
    UNKNOWN,
    needs_time,
    required_roles,
    roles_of_others,
    score_of,
    words_of,
)
from .suggestion import Suggestion

_CLEARLY = 0.75  # of the score, by which a column suits a role better than the others do


def unit_lines(log: Log, *, doubtful: bool = False) -> Iterator[str]:
    """Say what the unit of every column is read as; of ``doubtful`` ones only, where wanted."""
    for column in log.columns:
        doubt = unit_doubt(column.unit) if column.unit else ""
        if doubt:
            yield f"#{column.index}: {doubt}"
        elif column.unit and not doubtful:
            yield f"#{column.index}: '{column.unit}' is {dimension_name(column.unit)}"


def lacking_one(
    names: Sequence[str],
    log: Log,
    signals: Sequence[Column],
    constant: Sequence[Column],
    timed: bool,
) -> Iterator[Suggestion]:
    """Yield families that have all but one of their roles in the columns, and use all of these.

    The one that is lacking may be in a column that is ``constant``.
    """
    signals = _without_copies(signals)
    for name in names:
        for variant in get_family(name).variants:
            required, uses_time = required_roles(variant), needs_time(variant)
            if len(required) != len(signals) + 1 or not signals or (uses_time and not timed):
                continue
            if roles_of_others(log, variant):
                continue
            scores = np.array([[score_of(log, r, c) for c in signals] for r in required])
            rows, chosen = linear_sum_assignment(scores, maximize=True)
            if scores[rows, chosen].min() < MEASURED:
                continue
            lacking = next(r for k, r in enumerate(required) if k not in rows)
            if lacking.output:
                continue  # what is fitted has to be recorded
            columns = {required[i].name: f"#{signals[j].index}" for i, j in zip(rows, chosen)}
            score = float(scores[rows, chosen].mean())
            same = [c for c in constant if score_of(log, lacking, c) >= MEASURED]
            if len(same) == 1:
                at = f"#{same[0].index}"
                yield Suggestion(
                    name, variant.name, {**columns, lacking.name: at}, score,
                    basis=f"{lacking.name} is the same in every row ({at}): what would show only "
                    "where it changes cannot be determined.",
                )  # fmt: skip
                break
            alone = uses_time and lacking in variant.driving
            option = f"--step {lacking.name}=FROM:TO" if alone else f"--set {lacking.name}=VALUE"
            how = "stepped" if alone else "was constant"
            yield Suggestion(
                name, variant.name, columns, score, asked=(option,),
                basis=f"{name} needs {lacking.name} as well: record it, or give {option} where it "
                f"{how}.",
            )  # fmt: skip
            break


def assigned_by_order(
    names: Sequence[str], log: Log, signals: Sequence[Column], timed: bool
) -> Iterator[Suggestion]:
    """Yield families of two plain numbers, where nothing tells what they are: the leader drives."""
    pair = _without_copies(signals)
    named = {*log.bindings, *log.units, *log.scales, *log.holds} - {"time"}
    if len(pair) != 2 or named or any(c.unit or words_of(c) for c in pair):
        return
    first = leads(pair[0].values, pair[1].values)
    pair = pair if first is not False else pair[::-1]
    basis = "Neither names nor units tell what the columns are"
    basis += "" if first is None else f"; #{pair[0].index} leads #{pair[1].index} and may drive it"
    for name in names:
        for variant in get_family(name).variants[:1]:
            required, uses_time = required_roles(variant), needs_time(variant)
            plain = all("1" in (r.unit, *r.alternatives) for r in required[:-1])
            if len(required) != 2 or uses_time is (first is None) or not plain:
                continue
            yield Suggestion(
                name, variant.name, {r.name: f"#{c.index}" for r, c in zip(required, pair)}, 0.0,
                basis=f"{basis}.",
                unsure=((required[0].name, required[1].name),) if first is None else (),
                asked=("--sample-time SECONDS",) if uses_time and not timed else (),
            )  # fmt: skip


def with_open_roles(
    names: Sequence[str], log: Log, signals: Sequence[Column], timed: bool
) -> list[Suggestion]:
    """Return families whose roles may be among the columns, with the candidates of each role.

    Of several variants of a family, those stand there of which units and names tell most. The
    families of which they tell most come first, then those that use the time where there is one,
    then those that have the least to be asked for.
    """
    signals = _without_copies(signals)
    ranked = []
    for name in names:
        family = get_family(name)
        variants = family.variants_for(family.options_type())
        found = [(v, s) for v in variants if (s := _with_candidates(name, v, log, signals, timed))]
        best = max((s.score for _, s in found), default=0.0)
        ranked += [(v, s) for v, s in found if s.score == best]
    ranked.sort(key=lambda pair: (-pair[1].score, needs_time(pair[0]) is not timed,
                                  len(pair[1].asked)))  # fmt: skip
    return [s for _, s in ranked]


def _with_candidates(
    family: str, variant: Variant, log: Log, signals: Sequence[Column], timed: bool
) -> Suggestion | None:
    """Return a variant with the candidates of each of its roles; ``None`` if a role has none."""
    required = required_roles(variant)
    if roles_of_others(log, variant) or len(signals) < len(required):
        return None
    scores = np.array([[score_of(log, r, c) for c in signals] for r in required])
    nameless = np.array([[MEASURED if r.unit == "1" else UNKNOWN] for r in required])
    suits = (scores > 0.0) & (scores > scores.max(axis=1, keepdims=True) - _CLEARLY)
    rows, chosen = linear_sum_assignment(suits, maximize=True)
    if not suits[rows, chosen].all():
        return None
    by_role = {
        r.name: [c for c, fits in zip(signals, row) if fits] for r, row in zip(required, suits)
    }
    by_role = _eliminated(by_role)
    open_roles = [r for r in required if len(by_role[r.name]) > 1]
    asked = [f"--column {r.name}=#N" for r in open_roles]
    asked += [f"--unit {r.name}=UNIT" for r in required if _needs_unit(log, r, by_role[r.name])]
    asked += ["--sample-time SECONDS"] if needs_time(variant) and not timed else []
    return Suggestion(
        family, variant.name,
        {r: f"#{found[0].index}" for r, found in by_role.items() if len(found) == 1},
        float(np.maximum(scores - nameless, 0.0).max(axis=1).mean()),
        asked=tuple(asked), basis=_basis(by_role),
        candidates={r.name: tuple(f"#{c.index}" for c in by_role[r.name]) for r in open_roles},
    )  # fmt: skip


def _eliminated(candidates: Mapping[str, Sequence[Column]]) -> dict[str, list[Column]]:
    """Candidates less those columns that are the only ones for another role."""
    out = {role: list(columns) for role, columns in candidates.items()}
    settled: set[str] = set()
    while alone := {r for r, columns in out.items() if len(columns) == 1} - settled:
        settled |= alone
        taken = [out[r][0].index for r in alone]
        for role in out.keys() - settled:
            out[role] = [c for c in out[role] if c.index not in taken]
    return out


def _needs_unit(log: Log, role: Role, candidates: Iterable[Column]) -> bool:
    """Return whether nothing tells the unit of a role that is no plain number."""
    plain = "1" in (role.unit, *role.alternatives)
    return not plain and role.name not in log.units and not any(c.unit for c in candidates)


def _basis(candidates: Mapping[str, Sequence[Column]]) -> str:
    """Say which columns no unit and no name assigns to a role."""
    columns = {c.index: c for found in candidates.values() if len(found) > 1 for c in found}
    if not columns:
        return "Names and units leave one column for each role, but do not tell its unit."
    names = name_columns([columns[index] for index in sorted(columns)])
    return f"Neither names nor units tell what {names} are."


def _without_copies(signals: Sequence[Column]) -> list[Column]:
    """Columns less copies: of those computed from each other the first in a physical unit."""
    out: list[Column] = []
    for column in sorted(signals, key=_is_raw):
        if all(factor_between(c.values, column.values) is None for c in out):
            out.append(column)
    return sorted(out, key=lambda c: c.index)


def _is_raw(column: Column) -> bool:
    """Return whether a converter may have read a column: a plain number, a voltage, a current."""
    return column.unit is None or any(same_dimension(column.unit, u) for u in ("1", "V", "A"))
