"""Agreement of the units of a fit: over its logs, among its roles, and with its options."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ..errors import Notice, UnitError
from ..specification import Variant
from ..units import (
    conversion_factor,
    dimension_name,
    is_known_unit,
    is_share,
    pressure_reference,
    same_dimension,
)
from .columns import Binding, bind_roles, in_unit
from .log import Log


@dataclass(frozen=True)
class _Stated:
    """A role in one log: the SI unit it is used in, and the unit that stands for it."""

    log: Log | None  # None: the file that a fit wrote
    role: str
    si: str
    unit: str
    assumed: bool = False

    @property
    def place(self) -> str:
        """Describe the place."""
        return "the parameter file" if self.log is None else self.log.name

    def text(self, beside: _Stated) -> str:
        """For a message: ``'inlet' in bar (a.csv)``, without the log where both are of one."""
        remarks = [self.place] * (self.log is not beside.log) + ["assumed"] * self.assumed
        return f"'{self.role}' in {self.unit}" + f" ({', '.join(remarks)})" * bool(remarks)


def require_agreement(
    logs: Sequence[Log], variant: Variant, known: Mapping[str, str] | None = None
) -> None:
    """Refuse logs whose columns cannot be taken together (``UnitError``).

    A role in volts here and in pascals there, two roles of which only the ratio matters in
    different quantities, and gauge pressures beside absolute ones. ``known`` are the units in
    which a fit took the roles, where the logs are for what it found.
    """
    stated = [s for log in logs for s in _stated(log, variant)]
    if known:
        names = [r.name for r in variant.roles if r.name in known]
        stated += [
            _Stated(None, n, in_unit(variant.role(n), known[n]).unit, known[n]) for n in names
        ]
    for role in variant.roles:
        _require_one_quantity([s for s in stated if s.role == role.name])
    _require_one_quantity([s for s in stated if s.role in variant.alike], variant.unlike)
    _require_one_reference(stated)


def _stated(log: Log, variant: Variant) -> Iterator[_Stated]:
    for name, b in bind_roles(log, variant.roles).items():
        yield _Stated(log, name, b.role.unit, b.unit, b.assumed)
    for name in (r.name for r in variant.roles if r.name in log.steps):
        unit = log.steps[name].unit or log.units.get(name)
        role = in_unit(variant.role(name), unit)
        yield _Stated(log, name, role.unit, unit or role.unit, unit is None)


def _require_one_quantity(stated: Sequence[_Stated], remedy: str = "") -> None:
    """Refuse two quantities where one is needed."""
    other = next((s for s in stated if s.si != stated[0].si), None)
    if other is None:
        return
    first = stated[0]
    wrong = first if first.assumed or other.log is None else other  # the file is as it is
    right = other if wrong is first else first
    raise UnitError(
        f"{first.text(other)} is {dimension_name(first.unit)}, and {other.text(first)} "
        f"{dimension_name(other.unit)}.",
        where=_where(first, other),
        expected="Expected one and the same quantity.",
        remedy=f"Give --unit {wrong.role}={right.unit} if that is its unit, or, to convert it, "
        f"--scale {wrong.role}=FACTOR and --unit {wrong.role}={right.unit}. {remedy}".strip(),
    )


def _require_one_reference(stated: Sequence[_Stated]) -> None:
    """Refuse pressures above the atmosphere beside pressures above vacuum."""
    found = {ref: s for s in stated if (ref := pressure_reference(s.unit))}
    if len(found) < 2:
        return
    gauge, absolute = found["gauge"], found["absolute"]
    raise UnitError(
        f"{gauge.text(absolute)} is counted from the atmosphere, and {absolute.text(gauge)} from "
        "vacuum: they differ by the pressure of the air, which is about 1.013 bar and not in the "
        "log.",
        where=_where(gauge, absolute),
        expected="Expected all pressures of a fit to be counted from the same.",
        remedy="Subtract the pressure of the air on that day from the absolute column. Where a "
        f"constant offset of it does not matter, give --unit {absolute.role}=UNIT without the a.",
    )


def _where(first: _Stated, other: _Stated) -> str:
    return ", ".join(dict.fromkeys(s.log.name for s in (first, other) if s.log is not None))


def absolute_notice(log: Log, bindings: Iterable[Binding]) -> Iterator[Notice]:
    """Warn of absolute pressures where the model counts from the atmosphere."""
    for b in bindings:
        if b.role.gauge and pressure_reference(b.unit) == "absolute":
            yield Notice(
                "absolute-pressure",
                f"{log.name}: '{b.role.name}' is in {b.unit}, above vacuum, and the model counts "
                "pressures from the atmosphere. It was used as it is, about 1.013 bar too high. "
                "Subtract the pressure of the air on that day.",
            )


def overridden_notice(log: Log, bindings: Mapping[str, Binding]) -> Iterator[Notice]:
    """Warn of a unit in the header that ``--unit`` contradicts.

    Not of another spelling, nor where ``--scale`` makes the difference: so a sensor's volts
    become pascals.
    """
    for role, b in bindings.items():
        given, header = log.units.get(role), b.column.unit
        if given is None or header is None or (said := _contradiction(given, header, b)) is None:
            continue
        yield Notice(
            "unit-overridden",
            f"{log.name}: the header of '{b.column.label}' says {header}, and --unit {role}="
            f"{given} was used: {said}. Leave --unit out if the header is right.",
        )


def _contradiction(given: str, header: str, binding: Binding) -> str | None:
    """Describe how two units of a column contradict each other, ``None`` where they do not."""
    if same_dimension(given, header):
        factor = conversion_factor(given, header)
        references = {pressure_reference(given), pressure_reference(header)} - {""}
        if len(references) > 1:
            return "one is above the atmosphere and one above vacuum"
        if factor == 1.0 or math.isclose(abs(binding.scale) * factor, 1.0, rel_tol=1e-6):
            return None
        return f"1 {given} is {factor:.6g} {header}"
    if is_share(given) and is_share(header):
        return None  # the one says of what the other is
    if binding.column.doubtful or abs(binding.scale) != 1.0 or not is_known_unit(header):
        return None
    return f"{given} is {dimension_name(given)} and {header} {dimension_name(header)}"
