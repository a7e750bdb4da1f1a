"""What a parameter file has to satisfy, beyond being readable.

Structure (keys, types, finite numbers) is left to the models in ``document``; what it
means for the family is checked here. Both always run, so that every problem is named.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..errors import FluidactError
from ..experiment import FloatArray
from ..family import Family
from ..specification import ParameterSpec, Variant
from .document import TAG, ParameterDocument, Part
from .plain import check_plain
from .problems import Location, Problems, suggest

Lookup = Callable[[str], Family]

# Rounding of printed numbers is no reason to reject a file.
_RELATIVE = 1e-9
_EIGENVALUE = 1e-8

_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
}


def validate(
    document: dict[str, Any], problems: Problems, lookup: Lookup | None = None
) -> ParameterDocument | None:
    """Check a plain document of the current version.

    Parameters
    ----------
    document
        Plain dicts, lists, text and numbers.
    problems
        Problems known so far; those found here are added.
    lookup
        Finds a family by name; the registry by default.

    Returns
    -------
    ParameterDocument or None
        With the variant filled in and the parameters in the family's order; ``None``
        when there is any problem.
    """
    check_plain(document, problems)
    checked = _check_structure(document, problems)
    family = _find_family(document, problems, lookup)
    variant = _find_variant(document, family, problems) if family else None
    if variant:
        _check_parameters(document, variant, problems)
        _check_roles(document, variant, problems)
    _check_uncertainty(document, problems)
    _check_covariance(document, problems)
    _check_derived_units(document, variant, problems)
    if problems.found or checked is None or family is None or variant is None:
        return None
    name = variant.name if len(family.variants) > 1 else checked.variant
    known = [spec.name for spec in variant.parameters]
    ordered = {n: checked.parameters[n] for n in known if n in checked.parameters}
    return checked.model_copy(update={"variant": name, "parameters": ordered})


def _default_lookup(name: str) -> Family:
    from ..families import get_family

    return get_family(name)


# -------------------------------------------------------------------------- structure


def _check_structure(document: dict[str, Any], problems: Problems) -> ParameterDocument | None:
    try:
        return ParameterDocument.model_validate(document)
    except ValidationError as error:
        for item in error.errors(include_url=False):
            location = tuple(p for p in item["loc"] if not str(p).startswith(TAG))
            problems.add(location, _explain(location, dict(item)))
    return None


def _explain(location: Location, item: dict[str, Any]) -> str:
    """Return pydantic's objection in the words of this program."""
    kind, found, context = item["type"], item["input"], item.get("ctx", {})
    if kind == "missing":
        return "missing"
    if kind == "extra_forbidden":
        return f"unknown key{suggest(str(location[-1]), _known_keys())}"
    if kind in _KINDS:
        if kind == "float_type" and isinstance(found, str) and _is_number(found):
            return f"{found!r} is text, not a number; write it without quotes, as in 1.0e-07"
        return f"{_name(found)} is not {_KINDS[kind]}"
    if kind == "literal_error":
        return f"{_name(found)} is not known; expected {context['expected']}"
    if kind in ("too_short", "too_long"):
        return f"has {context['actual_length']} entries; {str(item['msg']).lower()}"
    if kind == "string_pattern_mismatch":
        return f"{_name(found)} does not look right; expected {context['pattern']}"
    return f"{_name(found)}: {item['msg'].lower()}"


def _known_keys() -> set[str]:
    # Near enough for "did you mean": every key that any part of a document has.
    parts = Part.__subclasses__()
    return {name for part in parts for name in part.model_fields}


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _name(found: Any) -> str:
    if found is None:
        return "an empty value"
    if isinstance(found, bool):
        return "true" if found else "false"
    if isinstance(found, dict):
        return "a mapping"
    if isinstance(found, list):
        return "a list"
    text = repr(found)
    return text if len(text) <= 60 else text[:57] + "..."


def _mapping(document: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Return a part of the document; empty when it is absent or no mapping."""
    part: Any = document
    for key in keys:
        part = part.get(key) if isinstance(part, Mapping) else None
    return part if isinstance(part, dict) else {}


# ----------------------------------------------------------------------------- family


def _find_family(
    document: dict[str, Any], problems: Problems, lookup: Lookup | None
) -> Family | None:
    name = document.get("family")
    if not isinstance(name, str):
        return None
    try:
        return (lookup or _default_lookup)(name)
    except FluidactError as error:
        hint = " ".join(part for part in (error.expected, error.remedy) if part)
        problems.add(("family",), f"{error.what} {hint}".strip())
    except KeyError:
        problems.add(("family",), f"{name!r} is not a known family")
    return None


def _find_variant(document: dict[str, Any], family: Family, problems: Problems) -> Variant | None:
    """Return the variant named, or the one that the parameters fit best."""
    name = document.get("variant")
    if name is not None:
        for variant in family.variants:
            if variant.name == name:
                return variant
        known = ", ".join(variant.name for variant in family.variants)
        problems.add(("variant",), f"{_name(name)} is not a variant of it; known: {known}")
        return None
    present = set(_mapping(document, "parameters"))

    def misfit(variant: Variant) -> int:
        names = {spec.name for spec in variant.parameters}
        required = {spec.name for spec in variant.parameters if not spec.optional}
        return len(present - names) + len(required - present)

    return min(family.variants, key=misfit)


def _check_parameters(document: dict[str, Any], variant: Variant, problems: Problems) -> None:
    if not isinstance(document.get("parameters"), dict):
        return  # said already
    parameters = _mapping(document, "parameters")
    specs = {spec.name: spec for spec in variant.parameters}
    for name, spec in specs.items():
        if name in parameters:
            if isinstance(parameters[name], dict):
                _check_parameter(parameters[name], spec, problems)
        elif not spec.optional:
            problems.add(("parameters", name), "missing")
    for name in parameters:
        if name not in specs:
            hint = suggest(name, specs)
            problems.add(("parameters", name), f"unknown to family {document['family']!r}{hint}")


def _check_parameter(entry: dict[str, Any], spec: ParameterSpec, problems: Problems) -> None:
    here: Location = ("parameters", spec.name)
    if isinstance(entry.get("unit"), str):
        _check_unit(entry["unit"], spec.unit, (*here, "unit"), problems, free=spec.any_unit)
    place = (*here, "value")
    if "value" not in entry or not problems.intact(*place):
        return
    value = entry["value"]
    rank = _rank(value)
    if rank != spec.rank:
        kinds = ("a number", "a list", "a list of lists")
        problems.add(place, f"is {kinds[rank]}; expected {kinds[spec.rank]}")
        return
    if spec.length is not None and spec.rank and len(value) != spec.length:
        problems.add(place, f"has {len(value)} entries; expected {spec.length}")
    for location, number in _entries(value, place):
        if not spec.minimum <= number <= spec.maximum:
            problems.add(location, f"{number!r} is outside {_range(spec)}")


def _range(spec: ParameterSpec) -> str:
    if math.isinf(spec.maximum):
        return f"its range: at least {float(spec.minimum)!r} {spec.unit}".rstrip()
    if math.isinf(spec.minimum):
        return f"its range: at most {float(spec.maximum)!r} {spec.unit}".rstrip()
    return f"its range {float(spec.minimum)!r} to {float(spec.maximum)!r} {spec.unit}".rstrip()


def _rank(value: Any) -> int:
    if not isinstance(value, list):
        return 0
    return 2 if value and isinstance(value[0], list) else 1


def _entries(value: Any, place: Location) -> Iterable[tuple[Location, float]]:
    if isinstance(value, list):
        for index, item in enumerate(value):
            yield from _entries(item, (*place, index))
    else:
        yield place, float(value)


# ------------------------------------------------------------------------------ units


def _check_unit(
    unit: str, expected: str, place: Location, problems: Problems, *, free: bool = False
) -> None:
    if unit == expected:
        return
    from .. import units  # slow to load, and not needed for a file that is right

    if not units.is_known_unit(unit):
        problems.add(place, f"{unit!r} is not a known unit; expected {expected!r}")
    elif free:
        return
    elif units.same_dimension(unit, expected):
        problems.add(place, f"{unit!r} is not the unit of this file; give SI, in {expected!r}")
    else:
        problems.add(place, f"{unit!r} has the wrong dimension; expected {expected!r}")


def _check_roles(document: dict[str, Any], variant: Variant, problems: Problems) -> None:
    """Check what is given per role: the validity, and the errors of the output."""
    units = {role.name: (role.unit, *role.alternatives) for role in variant.roles}
    accepted = {unit for several in units.values() for unit in several}
    for name, entry in _mapping(document, "validity").items():
        place: Location = ("validity", name)
        if name not in units:
            problems.add(place, f"is not a role of the family{suggest(name, units)}")
        elif isinstance(entry, dict):
            _check_range(entry, units[name], place, problems)
    for place, entry in _measures(document):
        unit = entry.get("unit")
        if isinstance(unit, str) and unit not in accepted:
            # Which role is the output may depend on an option (a force map turned round).
            _check_output_unit(unit, variant, (*place, "unit"), problems)


def _check_range(
    entry: dict[str, Any], accepted: tuple[str, ...], place: Location, problems: Problems
) -> None:
    # A role in "1" holds raw readings, in whatever the converter gives: counts or volts.
    unit = entry.get("unit")
    if isinstance(unit, str) and accepted[0] != "1" and unit not in accepted:
        _check_unit(unit, accepted[0], (*place, "unit"), problems)
    low, high = entry.get("low", 0.0), entry.get("high", 0.0)
    if {"low", "high"} <= set(entry) and _is_numeric([low, high]) and low > high:
        problems.add((*place, "low"), f"{low!r} is above high, {high!r}")


def _measures(document: dict[str, Any]) -> Iterable[tuple[Location, dict[str, Any]]]:
    yield ("fit", "rmse"), _mapping(document, "fit", "rmse")
    lists: tuple[tuple[Location, Any], ...] = (
        (("fit", "logs"), _mapping(document, "fit").get("logs")),
        (("validation",), document.get("validation")),
    )
    for place, entries in lists:
        for index, entry in enumerate(entries if isinstance(entries, list) else ()):
            if isinstance(entry, dict):
                yield (*place, index, "rmse"), _mapping(entry, "rmse")


def _check_output_unit(unit: str, variant: Variant, place: Location, problems: Problems) -> None:
    from .. import units

    alike = [role.unit for role in variant.roles if units.same_dimension(unit, role.unit)]
    outputs = [role.unit for role in variant.roles if role.output]
    _check_unit(unit, (alike or outputs or ["1"])[0], place, problems)


def _check_derived_units(
    document: dict[str, Any], variant: Variant | None, problems: Problems
) -> None:
    known = {spec.unit for spec in variant.parameters} if variant else set()
    for name, entry in _mapping(document, "derived").items():
        unit = entry.get("unit") if isinstance(entry, dict) else None
        if not isinstance(unit, str) or unit in known:
            continue
        from .. import units

        if not units.is_known_unit(unit):
            problems.add(("derived", name, "unit"), f"{unit!r} is not a known unit")


# ------------------------------------------------------------------------ uncertainty


def _check_uncertainty(document: dict[str, Any], problems: Problems) -> None:
    for section in ("parameters", "derived"):
        for name, entry in _mapping(document, section).items():
            if not isinstance(entry, dict) or not _is_numeric(entry.get("value")):
                continue
            value = _array(entry["value"])
            if value is None:
                problems.add((section, name, "value"), "its rows differ in length")
                continue
            _check_std_error(entry, value, (section, name, "std_error"), problems)
            _check_interval(entry, value, (section, name, "ci95"), problems)


def _is_numeric(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(_is_numeric(item) for item in value)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    # Whole numbers have no largest one, floats do.
    return number and abs(value) <= sys.float_info.max


def _array(value: Any) -> FloatArray | None:
    """Return numbers as an array, ``None`` when they are ragged or no numbers."""
    if not _is_numeric(value):
        return None
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, OverflowError):
        return None


def _check_std_error(
    entry: dict[str, Any], value: FloatArray, place: Location, problems: Problems
) -> None:
    if "std_error" not in entry or not problems.intact(*place):
        return
    error = _array(entry["std_error"])
    if error is None or error.shape != value.shape:
        problems.add(place, "does not have the shape of the value")
        return
    for location, number in _entries(entry["std_error"], place):
        if number < 0.0:
            problems.add(location, f"{number!r} is negative")


def _check_interval(
    entry: dict[str, Any], value: FloatArray, place: Location, problems: Problems
) -> None:
    if "ci95" not in entry or not problems.intact(*place):
        return
    interval = _array(entry["ci95"])
    if interval is None or interval.shape != (*value.shape, 2):
        problems.add(place, "is not one [low, high] for each number of the value")
        return
    low, high = interval[..., 0], interval[..., 1]
    slack = _RELATIVE * np.maximum(np.abs(value), np.maximum(np.abs(low), np.abs(high)))
    disordered = np.argwhere(low > high)
    outside = np.argwhere((value < low - slack) | (value > high + slack))
    for index in disordered:
        problems.add((*place, *map(int, index)), "low is above high")
    for index in outside:
        number = float(value[tuple(index)])
        problems.add((*place, *map(int, index)), f"does not contain the value {number!r}")


# ------------------------------------------------------------------------- covariance


def _check_covariance(document: dict[str, Any], problems: Problems) -> None:
    covariance = document.get("covariance")
    if not isinstance(covariance, dict):
        return
    order, rows = covariance.get("order"), covariance.get("matrix")
    known = isinstance(document.get("parameters"), dict)
    if known and isinstance(order, list) and problems.intact("covariance", "order"):
        _check_order(order, document, problems)
    if not isinstance(rows, list) or not problems.intact("covariance", "matrix"):
        return
    place = ("covariance", "matrix")
    matrix = _array(rows) if rows else np.zeros((0, 0))
    if matrix is None or matrix.shape != (len(rows), len(rows)):
        problems.add(place, f"is not square: {len(rows)} rows of {_widths(rows)} entries")
        return
    if isinstance(order, list) and len(order) != len(rows):
        problems.add(place, f"has {len(rows)} rows, but order has {len(order)} names")
    _check_matrix(matrix, place, problems)


def _widths(rows: list[Any]) -> str:
    widths = sorted({len(row) for row in rows})
    return " or ".join(map(str, widths))


def _check_order(order: list[str], document: dict[str, Any], problems: Problems) -> None:
    names: set[str] = set()
    for name, entry in _mapping(document, "parameters").items():
        value = entry.get("value") if isinstance(entry, dict) else None
        for indices, _ in _entries(value, ()) if _is_numeric(value) else ():
            names.add(name + "".join(f"[{index}]" for index in indices))
    seen: set[str] = set()
    for index, name in enumerate(order):
        place = ("covariance", "order", index)
        if name in seen:
            problems.add(place, f"{name!r} stands there twice")
        elif name not in names and not _is_broken(name.partition("[")[0], document):
            hint = suggest(name.partition("[")[0], _mapping(document, "parameters"))
            problems.add(place, f"{name!r} is not a number among the parameters{hint}")
        seen.add(name)


def _is_broken(name: str, document: dict[str, Any]) -> bool:
    """Return whether a parameter is there, but its value is a problem of its own."""
    entry = _mapping(document, "parameters").get(name)
    return entry is not None and not (isinstance(entry, dict) and _is_numeric(entry.get("value")))


def _check_matrix(matrix: FloatArray, place: Location, problems: Problems) -> None:
    variances = np.diag(matrix)
    for index in np.flatnonzero(variances < 0.0):
        problems.add((*place, int(index), int(index)), "is a negative variance")
    # Parameters differ by many powers of ten: what is small is only known after scaling.
    scale = np.sqrt(np.abs(variances))
    with np.errstate(all="ignore"):
        skew = np.abs(matrix - matrix.T) > _RELATIVE * scale[:, None] * scale[None, :]
    if np.any(skew):
        row, column = map(int, np.argwhere(skew)[0])
        problems.add(place, f"is not symmetric: [{row}][{column}] and [{column}][{row}] differ")
    elif np.all(variances >= 0.0) and not _is_semidefinite(matrix, scale):
        problems.add(place, "is not positive semidefinite")


def _is_semidefinite(matrix: FloatArray, scale: FloatArray) -> bool:
    certain = scale == 0.0
    if np.any(matrix[certain]):
        return False  # what does not vary cannot vary along with anything
    spread = scale[~certain]
    with np.errstate(all="ignore"):
        correlation = matrix[np.ix_(~certain, ~certain)] / spread[:, None] / spread[None, :]
    if not np.all(np.abs(correlation) <= 1.0 + _EIGENVALUE):
        return False
    return not spread.size or float(np.linalg.eigvalsh(correlation)[0]) >= -_EIGENVALUE
