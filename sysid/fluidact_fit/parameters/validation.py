"""Validation of a parameter file; every problem is reported with its place.

Structure, and what follows from it alone, is left to the document itself; what it means
for the family is checked here. Both always run, so that every problem is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, product
from typing import Any

import numpy as np
from pydantic import ValidationError

from .. import units
from ..errors import FluidactError, UsageError
from ..specification import Described, ParameterSpec, Variant
from ..units.reading import read_unit
from .document import TAG, ParameterDocument, Part
from .problems import Location, Problems, find_entries, suggest
from .sizes import check_sizes
from .yaml_io import check_plain

Lookup = Callable[[str], Described]

# pydantic's objections in the words of this program.
_WORDS = {
    "objection": "{words}",
    "missing": "missing",
    "extra_forbidden": "unknown key{hint}",
    "float_type": "{found} is not a number",
    "int_type": "{found} is not a whole number",
    "string_type": "{found} is not text",
    "bool_type": "{found} is not true or false",
    "list_type": "{found} is not a list",
    "dict_type": "{found} is not a mapping",
    "model_type": "{found} is not a mapping",
    "literal_error": "{found} is not known; expected {expected}",
    "too_short": "has {size}; expected at least {min_length}",
    "too_long": "has {size}; expected at most {max_length}",
    "string_too_long": "has too many characters; expected at most {max_length}",
    "greater_than_equal": "{found} is too small; expected at least {ge:.16g}",
    "less_than_equal": "{found} is too large; expected at most {le:.16g}",
    "finite_number": "{found} is not a finite number",
    "value_error": "{error}",
    "string_pattern_mismatch": "{found} does not look right; expected {pattern}",
}


def validate(
    document: dict[str, Any], problems: Problems, lookup: Lookup
) -> ParameterDocument | None:
    """Check a plain document of the current version; ``lookup`` finds a family by name.

    Problems are added to those known so far, and where there is any ``None`` is returned; else the
    document, its variant filled in and its parameters in the family's order.
    """
    check_plain(document, problems)
    checked = _check_structure(document, problems)
    family = _find_family(document, problems, lookup)
    variant = _find_variant(document, family, problems) if family else None
    if family and variant:
        check_sizes(document, problems)
        _check_parameters(document, variant, problems)
        _check_units(document, family.variants, variant, problems)
        _check_options(document, family, problems)
    if problems.found or checked is None or family is None or variant is None:
        return None
    name = variant.name if len(family.variants) > 1 else checked.variant
    known = [spec.name for spec in variant.parameters]
    ordered = {n: checked.parameters[n] for n in known if n in checked.parameters}
    return checked.model_copy(update={"variant": name, "parameters": ordered})


# -------------------------------------------------------------------------- structure


def _check_structure(document: dict[str, Any], problems: Problems) -> ParameterDocument | None:
    try:
        return ParameterDocument.model_validate(document)
    except ValidationError as error:
        for item in error.errors(include_url=False):
            place = tuple(part for part in item["loc"] if not str(part).startswith(TAG))
            if problems.many:  # the place alone: other checks must not rely on it
                problems.add(place, "")
                continue
            found, key = item["input"], str(place[-1]) if place else ""
            form = _WORDS.get(item["type"], "{found}: {said}")
            if item["type"] == "float_type" and isinstance(found, str) and _is_number(found):
                form = "{found} is text, not a number; write it without quotes, as in 1.0e-07"
            # Near enough for "did you mean": every key that any part of a document has.
            keys = {name for part in Part.__subclasses__() for name in part.model_fields}
            words = {"hint": suggest(key, keys), "said": item["msg"].lower(), "found": _name(found)}
            details = item.get("ctx", {})
            words["size"] = _entries(details.get("actual_length", 0))
            problems.add(place, form.format(**words, **details))
    return None


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _entries(size: int) -> str:
    return "1 entry" if size == 1 else f"{size} entries"


def _name(found: Any) -> str:
    if found is None:
        return "an empty value"
    if isinstance(found, bool):
        return "true" if found else "false"
    if isinstance(found, (dict, list)):
        return "a mapping" if isinstance(found, dict) else "a list"
    text = repr(found)
    return text if len(text) <= 60 else text[:57] + "..."


# ----------------------------------------------------------------------------- family


def _find_family(document: dict[str, Any], problems: Problems, lookup: Lookup) -> Described | None:
    name = document.get("family")
    if not isinstance(name, str):
        return None
    try:
        return lookup(name)
    except FluidactError as error:
        hint = " ".join(part for part in (error.expected, error.remedy) if part)
        problems.add(("family",), f"{error.what} {hint}".strip())
    return None


def _find_variant(
    document: dict[str, Any], family: Described, problems: Problems
) -> Variant | None:
    """Return the variant named, or the one that the parameters fit best."""
    name = document.get("variant")
    if name is not None:
        for variant in family.variants:
            if variant.name == name:
                return variant
        known = ", ".join(variant.name for variant in family.variants)
        problems.add(("variant",), f"{_name(name)} is not a variant of it; known: {known}")
        return None
    present = {place[-1] for place, _ in find_entries(document, "parameters", "*")}

    def misfit(variant: Variant) -> int:
        names = {spec.name for spec in variant.parameters}
        required = {spec.name for spec in variant.parameters if not spec.optional}
        return len(present - names) + len(required - present)

    return min(family.variants, key=misfit)


def _check_parameters(document: dict[str, Any], variant: Variant, problems: Problems) -> None:
    parameters = document.get("parameters")
    if not isinstance(parameters, dict):
        return  # said already
    specs = {spec.name: spec for spec in variant.parameters}
    units_of = _units_of_roles(document, variant)
    for name, spec in specs.items():
        if name not in parameters and not spec.optional:
            problems.add(("parameters", name), "missing")
    for name, entry in parameters.items():
        if problems.many:
            return
        here: Location = ("parameters", name)
        if name not in specs:
            hint = suggest(name, specs)
            problems.add(here, f"unknown to family {document['family']!r}{hint}")
            continue
        for place, unit in find_entries(entry, "unit", place=here):
            known, free = _possible_units(specs[name], units_of)
            if unit not in known:
                _check_unit(unit, known[0], place, problems, free=free)
        for place, value in find_entries(entry, "value", place=here):
            if problems.intact(*place):
                _check_value(value, specs[name], place, problems)


def _check_value(value: Any, spec: ParameterSpec, place: Location, problems: Problems) -> None:
    array = np.array(value, dtype=np.float64)
    if array.ndim != spec.rank:
        kinds = ("a number", "a list", "a list of lists")
        problems.add(place, f"is {kinds[array.ndim]}; expected {kinds[spec.rank]}")
        return
    if spec.length is not None and spec.rank and len(array) != spec.length:
        problems.add(place, f"has {_entries(len(array))}; expected {spec.length}")
    low, high = float(spec.minimum), float(spec.maximum)
    if math.isinf(low) or math.isinf(high):
        limits = f": at most {high!r}" if math.isinf(low) else f": at least {low!r}"
    else:
        limits = f" {low!r} to {high!r}"
    if spec.increasing and array.size and np.any(np.diff(array) <= 0.0):
        problems.add(place, "its entries do not increase")
    for index in np.argwhere((array < low) | (array > high)):
        number = float(array[tuple(index)])
        message = f"{number!r} is outside its range{limits} {spec.unit}".rstrip()
        problems.add((*place, *map(int, index)), message)


def _check_options(document: dict[str, Any], family: Described, problems: Problems) -> None:
    options = document.get("options", {})
    if not isinstance(options, dict):
        return  # said already
    wrong = together = _refused(options, family)
    for name, value in options.items() if wrong else ():
        if problems.many:
            return
        if words := _refused({name: value}, family):
            problems.add(("options", name), words)
            together = ""
    if together:
        problems.add(("options",), together)


def _refused(options: dict[str, Any], family: Described) -> str:
    """Return what the family objects to in some options; empty when nothing."""
    try:
        family.options_type.read(options, from_file=True)
    except UsageError as error:
        return f"{error.what}. {error.expected}".strip()
    return ""


# ------------------------------------------------------------------------------ units


def _check_unit(
    unit: Any, expected: str, place: Location, problems: Problems, *, free: bool = False
) -> None:
    if unit == expected or not isinstance(unit, str) or problems.many:
        return  # without asking what units are, which may be slow
    if not units.is_known_unit(unit):
        problems.add(place, f"{unit!r} is not a known unit; expected {expected!r}")
    elif free:
        return
    elif units.same_dimension(unit, expected):
        problems.add(place, f"{unit!r} is not the unit of this file; give SI, in {expected!r}")
    else:
        problems.add(place, f"{unit!r} has the wrong dimension; expected {expected!r}")


def _units_of_roles(document: dict[str, Any], variant: Variant) -> dict[str, tuple[str, ...]]:
    """SI units that each role may have: that of its range in the file, else all that it takes.

    None for a raw reading without a range, which may be in any unit.
    """
    units_of = {}
    for role in variant.roles:
        accepted = (role.unit, *role.alternatives)
        raw = role.unit == "1"
        given = next((u for _, u in find_entries(document, "validity", role.name, "unit")), None)
        if isinstance(given, str) and (raw or given in accepted):
            accepted = (given,)
        elif raw:
            accepted = ()
        units_of[role.name] = accepted
    return units_of


def _possible_units(
    spec: ParameterSpec, units_of: dict[str, tuple[str, ...]]
) -> tuple[list[str], bool]:
    """Units that a parameter may have, and whether any other will do."""
    roles = spec.roles_of_unit
    choices = product(*(units_of.get(role, ()) for role in roles))
    known = [spec.unit_for(dict(zip(roles, chosen))) for chosen in choices]
    return known or [spec.unit], not known


def _check_units(
    document: dict[str, Any], variants: Sequence[Variant], variant: Variant, problems: Problems
) -> None:
    """Check what is given per role, and the units of everything else.

    What one variant takes from the log another computes from it: both have a range.
    """
    accepted = {role.name: (role.unit, *role.alternatives) for role in variant.roles}
    others = {r.name: (r.unit, *r.alternatives) for v in variants for r in v.roles}
    ranges = {**others, **accepted}
    columns = find_entries(document, "provenance", "logs", "*", "columns", "*")
    for place, _ in chain(find_entries(document, "validity", "*"), columns):
        known_roles = ranges if place[0] == "validity" else {**accepted, "time": ("s",)}
        if place[-1] not in known_roles and not problems.many:
            message = f"is not a role of the family{suggest(str(place[-1]), known_roles)}"
            problems.add(place, message)
    for place, unit in find_entries(document, "validity", "*", "unit"):
        known = ranges.get(str(place[1]), ())
        # A role in "1" holds raw readings, in whatever the converter gives: counts or volts.
        if known and known[0] != "1" and unit not in known:
            _check_unit(unit, known[0], place, problems)
    outputs = {unit for several in accepted.values() for unit in several}
    for place, unit in _measured(document):
        if isinstance(unit, str) and unit not in outputs:
            # Which role is the output may depend on an option (a force map turned round).
            alike = (r.unit for r in variant.roles if units.same_dimension(unit, r.unit))
            first = (r.unit for r in variant.roles if r.output)
            _check_unit(unit, next(chain(alike, first, ["1"])), place, problems)
    usual = {spec.unit for spec in variant.parameters}
    for place, unit in find_entries(document, "derived", "*", "unit"):
        if isinstance(unit, str) and unit not in usual:
            _check_unit(unit, "1", place, problems, free=True)
            if units.is_known_unit(unit) and read_unit(unit).factor != 1.0 and not problems.many:
                problems.add(place, f"{unit!r} is not the unit of this file; give SI")


def _measured(document: dict[str, Any]) -> Iterator[tuple[Location, Any]]:
    """Yield the units of everything that is in the unit of the output."""
    yield from find_entries(document, "fit", "rmse", "unit")
    for logs in (("fit", "logs"), ("validation",)):
        for what in ("rmse", "offset"):
            yield from find_entries(document, *logs, "*", what, "unit")
