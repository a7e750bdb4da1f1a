"""Columns that suit the roles of a family, by their units, their names and their order in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..assessment import direction, leads
from ..channels import factor_between
from ..families import get_family
from ..logs import Log
from ..logs.log import Column
from ..specification import Role, Variant
from ..units import same_dimension
from ..units.reading import is_share
from .suggestion import Suggestion

IMPOSSIBLE = -1e6
MEASURED, ALSO, UNKNOWN = 1.0, 0.7, 0.1
_NAMED, _CALLED, _USED = 3.0, 2.0, 1.0
_DOUBT = 0.25  # less for a column that holds what was asked for, or another quantity by its name

# What people call the roles, in the languages of loggers: whole words of a name, without numbers.
_WORDS: dict[str, str] = {
    "command": "cmd command u set setpoint sollwert stellwert soll voltage spannung current strom "
    "valve ventil consigna consigne commande comando i pwm signal",
    "outlet": "outlet out output y response druck pressure p flow q chamber far istwert ist "
    "ausgang speed",
    "inlet": "inlet in input valve source supply upstream vordruck eingang pressure druck p flow q "
    "speed",
    "pressure": "pressure druck p chamber presion pression pressione kammer",
    "pressure_1": "pa p1 pressure1 chamber1 cap bottom",
    "pressure_2": "pb p2 pressure2 chamber2 rod",
    "pressure_drop": "dp delta drop differential differenzdruck",
    "force": "force kraft f load cell fuerza forza last",
    "position": "position pos x y weg hub stroke laser displacement place posicion posizione lage",
    "velocity": "velocity v speed geschwindigkeit vel velocidad vitesse velocita",
    "torque": "torque m moment drehmoment tau couple par coppia",
    "angle": "angle winkel phi theta rotation turn encoder angulo angolo",
    "angular_velocity": "omega speed drehzahl rpm velocity w n",
    "speed": "speed omega drehzahl rpm n velocity v",
    "flow": "flow q volumenstrom durchfluss debit caudal portata speed",
    "reading": "adc counts count raw reading pot poti potentiometer digits",
    "reference": "reference laser caliper true position pos mm gauge deflection",
    "drive": "drive motor antrieb input x",
    "load": "load last abtrieb output phi",
    "length": "length laenge",
    "direction": "direction richtung state",
}

# How people number what there are two of.
_ORDINALS = {"1": frozenset("1a"), "2": frozenset("2b")}

# Words of a column that holds what was asked for, not what was measured; roles that are that.
_REFERENCES = frozenset(
    ("ref", "reference", "soll", "sollwert", "setpoint", "target", "desired", "demand", "cmd")
)
_SET_POINTS = ("command", "reference")
# Words that say what a column is, whatever its unit allows.
_QUANTITIES = frozenset(
    ("torque", "force", "position", "angle", "velocity", "speed", "flow", "pressure")
)


def best_variant(
    name: str, log: Log, signals: Sequence[Column], timed: bool
) -> Iterator[Suggestion]:
    """Yield the variant of a family that uses the columns best, if any can."""
    family = get_family(name)
    variants = family.variants_for(family.options_type())
    candidates = (_assign(name, v, log, signals, timed) for v in variants)
    usable = [s for s in candidates if s is not None]
    if usable:
        yield max(usable, key=lambda s: s.score)


def _assign(
    family: str, variant: Variant, log: Log, columns: Sequence[Column], timed: bool
) -> Suggestion | None:
    """Assign the columns that suit the roles of a variant best."""
    required = required_roles(variant)
    if len(columns) < len(required) or roles_of_others(log, variant):
        return None
    if needs_time(variant) and not timed:
        return None
    scores = np.array([[score_of(log, r, c) for c in columns] for r in required])
    rows, chosen = linear_sum_assignment(scores, maximize=True)
    told = [scores[i, j] for i, j in zip(rows, chosen) if required[i].unit != "1"]
    if scores[rows, chosen].min() <= 0.0 or min(told) < ALSO:
        return None  # neither unit nor name tells of some role what it is
    taken = {required[i].name: columns[j] for i, j in zip(rows, chosen, strict=True)}
    calibrates = not needs_time(variant) and any(r.unit == "1" for r in required)
    if not _alike(variant, taken) or _has_copy(list(taken.values()), calibrates):
        return None
    total = float(scores[rows, chosen].sum())
    for role in (r for r in variant.roles if not r.required and r.name != "time"):
        left = [c for c in columns if c not in taken.values()]
        best = max(left, key=lambda c: score_of(log, role, c), default=None)
        if best is not None and score_of(log, role, best) > MEASURED:
            taken[role.name] = best
            total += score_of(log, role, best)
    unused = [c for c in columns if c not in taken.values() and c.unit]
    taken, unsure = _in_order(log, variant, taken)
    pair, against = (variant.leading, variant.output.name), False
    if set(pair) <= set(taken):
        against = direction(*(taken[r].values for r in pair)) < 0
    return Suggestion(
        family, variant.name, {r: f"#{c.index}" for r, c in taken.items()},
        total / len(taken) + _USED * len(taken) / (len(taken) + len(unused)), unsure,
        against=(pair,) if against else (), asked=tuple(_rated_values(log, required, taken)),
    )  # fmt: skip


def required_roles(variant: Variant) -> list[Role]:
    """Return the required roles of a variant but the time."""
    return [r for r in variant.roles if r.required and r.name != "time"]


def needs_time(variant: Variant) -> bool:
    """Return whether the time is a required role of a variant."""
    return any(r.name == "time" and r.required for r in variant.roles)


def roles_of_others(log: Log, variant: Variant) -> set[str]:
    """Return the roles that the user gave options for and that a variant does not have."""
    given = {*log.bindings, *log.units, *log.scales, *log.holds}
    return given - {role.name for role in variant.roles}


def _rated_values(log: Log, roles: Sequence[Role], taken: Mapping[str, Column]) -> Iterator[str]:
    """Yield the options that say of what a column in percent is the percentage."""
    for role in roles:
        unit = log.units.get(role.name) or taken[role.name].unit
        if unit and _is_share_of_rated(unit, role):
            yield f"--unit '{role.name}=% of RATED {role.unit}'"


def _is_share_of_rated(unit: str, role: Role) -> bool:
    """Return whether a unit is percent where a role is not, as motor controllers record torque."""
    return is_share(unit) and not any(
        same_dimension(unit, known) for known in (role.unit, *role.alternatives)
    )


def varies(column: Column) -> bool:
    """Return whether a column holds at least two different numbers of its own."""
    known = column.values[np.isfinite(column.values)]
    return known.size > 1 and float(np.ptp(known)) > 0.0 and not column.part_of


def is_constant(column: Column) -> bool:
    """Return whether a column holds one number in every row."""
    return column.values.size > 1 and bool((column.values == column.values[0]).all())


def _alike(variant: Variant, taken: Mapping[str, Column]) -> bool:
    """Return whether roles of which only the ratio matters are in one quantity."""
    units = [taken[r].unit or "1" for r in variant.alike if r in taken]
    return all(same_dimension(u, units[0]) for u in units)


def _has_copy(columns: Sequence[Column], calibrates: bool) -> bool:
    """True if one of several columns was computed from another: a family would fit the formula.

    A calibration of a raw reading may be a straight line of two columns, which is all that there
    is to fit.
    """
    return not (calibrates and len(columns) == 2) and any(
        factor_between(a.values, b.values) is not None for a, b in combinations(columns, 2)
    )


def score_of(log: Log, role: Role, column: Column) -> float:
    """Score of a column for a role, by its unit and its name."""
    wanted = log.bindings.get(role.name)
    if wanted is not None:
        named = wanted in (f"#{column.index}", column.header, column.name)
        return 2.0 * _NAMED if named else IMPOSSIBLE
    unit = log.units.get(role.name) or column.unit
    others = [u for u in role.alternatives if unit and same_dimension(unit, u)]
    words = words_of(column)
    if unit is None:
        measured = MEASURED if role.unit == "1" else UNKNOWN
    elif role.unit == "1":
        measured = UNKNOWN  # a raw reading may be in anything
    elif same_dimension(unit, role.unit):
        measured = MEASURED
    elif others or (_is_share_of_rated(unit, role) and _is_called(role.name, words)):
        measured = ALSO
    else:
        return IMPOSSIBLE
    if "_".join(words) == role.name or column.name.casefold() == role.name:
        return measured + _NAMED
    called = _is_called(role.name, words)
    asked_for = role.name not in _SET_POINTS and bool(_REFERENCES & set(words))
    another = not called and bool(_QUANTITIES & set(words))
    return measured + _CALLED * called - _DOUBT * (asked_for or another)


def _is_called(role: str, words: Sequence[str]) -> bool:
    """Return whether words name a role, or what it is and which of two: ``Druck B``."""
    if {*words, "".join(words)} & set(_WORDS.get(role, "").split()):
        return True
    kind, _, number = role.rpartition("_")
    which = _ORDINALS.get(number, frozenset()) & set(words)
    return bool(which) and bool(set(_WORDS.get(kind, "").split()) & set(words))


def words_of(column: Column) -> list[str]:
    """Words of the name of a column, lower case."""
    text = "".join(c if c.isalnum() else " " for c in (column.name or "").casefold())
    return text.split()


def _in_order(
    log: Log, variant: Variant, taken: Mapping[str, Column]
) -> tuple[dict[str, Column], tuple[tuple[str, str], ...]]:
    """Columns of input and output that suit either role as well, in the order of their changes."""
    found, unsure = dict(taken), []
    output = variant.output
    for role in (r for r in variant.driving if r.name in found and output.name in found):
        a, b = found[role.name], found[output.name]
        straight = score_of(log, role, a) + score_of(log, output, b)
        if abs(straight - score_of(log, role, b) - score_of(log, output, a)) > 1e-9:
            continue
        first = leads(a.values, b.values)
        if first is None:
            unsure.append((role.name, output.name))
        elif not first:
            found[role.name], found[output.name] = b, a
    return found, tuple(unsure)
