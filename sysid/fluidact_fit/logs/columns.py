"""Which column plays which role, in which unit."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, UsageError
from ..experiment import FloatArray
from ..family import Role
from ..units import conversion_factor, is_known_unit, same_dimension
from .log import Column, Log, name_lines

# Time is the one role with a symbol that is in general use as a header.
_SYNONYMS = {"time": ("t",)}


@dataclass(frozen=True)
class Binding:
    """A role, its column, and the factors from one to the other.

    Attributes
    ----------
    unit
        Unit of the scaled column as used: from the user, the header, or assumed.
    scale
        Factor for the raw column, 1 unless given.
    factor
        From ``unit`` to SI.
    assumed
        Whether no unit was given.
    explicit
        Whether the user named the column.
    """

    role: Role
    column: Column
    unit: str
    scale: float
    factor: float
    assumed: bool
    explicit: bool

    @property
    def to_si(self) -> float:
        """Factor from the raw column to SI."""
        return self.scale * self.factor

    @property
    def values(self) -> FloatArray:
        """The whole column in SI, shape ``(n_rows,)``."""
        return self.column.values if self.to_si == 1.0 else self.column.values * self.to_si


def list_columns(log: Log, shown: int = 12) -> str:
    """Return the columns of a log for a message: ``#1 'pos [mm]', #2 'ADC'``."""
    texts = [f"#{c.index} '{c.header}'" if c.header else f"#{c.index}" for c in log.columns]
    if len(texts) > shown:
        texts = [*texts[:shown], f"... (#{len(log.columns)} is the last)"]
    return ", ".join(texts)


def check_roles(log: Log, roles: Iterable[Role]) -> None:
    """Refuse options that name a role the family does not have.

    Raises
    ------
    UsageError
        With the roles there are, and the closest one.
    """
    known = {role.name: role for role in roles}
    options = {
        "--column": log.bindings,
        "--unit": log.units,
        "--scale": log.scales,
        "--step": log.steps,
        "--hold": log.holds,
    }
    for option, given in options.items():
        for name in given:
            if name in known:
                continue
            close = difflib.get_close_matches(name, known, n=1)
            raise UsageError(
                f"{option} names the role '{name}', which this family does not have.",
                expected=f"Its roles are {', '.join(known)}.",
                remedy=f"Did you mean '{close[0]}'?"
                if close
                else f"Give {option} with one of them.",
            )
    for name in log.steps:
        if name == "time" or known[name].output:
            raise UsageError(
                f"--step cannot replace '{name}'.", remedy="Only an input can be a known step."
            )
        if known[name].hold is None:
            raise UsageError(
                f"--step cannot replace '{name}': it is needed sample by sample.",
                remedy=f"Give --column {name}=HEADER (or #N).",
            )
        if name in log.bindings:
            raise UsageError(
                f"'{name}' has both a --column and a --step.", remedy="Keep one of them."
            )
    for name in log.holds:
        if known[name].hold is None:
            driving = [r.name for r in known.values() if r.hold is not None]
            raise UsageError(
                f"--hold does not apply to '{name}', which is not an input of the model.",
                remedy=f"Give it for {' or '.join(driving)}."
                if driving
                else "Leave --hold out: no role of this family needs it.",
            )


def find_column(log: Log, role: str, wanted: str) -> Column:
    """Return the column that ``--column role=wanted`` means.

    Raises
    ------
    LogError
        When there is none, or more than one.
    """
    if wanted.startswith("#") and wanted[1:].isdigit():
        number = int(wanted[1:])
        if 1 <= number <= len(log.columns):
            return log.columns[number - 1]
        raise LogError(
            f"there is no column #{number} for '{role}'.",
            where=log.name,
            expected=f"It has {len(log.columns)}: {list_columns(log)}.",
            remedy=f"Give --column {role}=#N with 1 to {len(log.columns)}.",
        )
    matches = _matching(log, wanted)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise _ambiguous(log, role, wanted, matches)
    raise _no_column(log, role, wanted)


def _matching(log: Log, wanted: str) -> list[Column]:
    """Columns that a header means: the closest kind of agreement that finds any."""
    text, folded = wanted.strip(), _fold(wanted)
    for matches in (
        [c for c in log.columns if c.header == text],
        [c for c in log.columns if c.header and _fold(c.header) == folded],
        [c for c in log.columns if c.header and c.name == text],
        [c for c in log.columns if c.header and _fold(c.name) == folded],
    ):
        if matches:
            return matches
    return []


def _holds(log: Log, wanted: str) -> bool:
    """Whether ``--column role=wanted`` means any column of a log."""
    if wanted.startswith("#") and wanted[1:].isdigit():
        return 1 <= int(wanted[1:]) <= len(log.columns)
    return bool(_matching(log, wanted))


def share_columns(logs: Sequence[Log]) -> list[Log]:
    """Let logs that were read with the same bindings lack columns that others of them hold.

    Several experiments of one machine need not record the same: one pressure in some, the other
    pressure in others. A header that no log holds is still refused where it is used, and so
    is one of a role that is required.

    Parameters
    ----------
    logs
        The set.

    Returns
    -------
    list of Log
        With ``elsewhere`` filled in.
    """
    held = {
        (role, wanted)
        for log in logs
        for role, wanted in log.bindings.items()
        if _holds(log, wanted)
    }
    out = []
    for log in logs:
        lacking = {r for r, w in log.bindings.items() if (r, w) in held and not _holds(log, w)}
        out.append(replace(log, elsewhere=frozenset(lacking)) if lacking else log)
    return out


def default_column(log: Log, role: str) -> Column | None:
    """Return the column whose name, unit and case aside, is the role; ``None`` without one."""
    for name in (role, *_SYNONYMS.get(role, ())):
        matches = [c for c in log.columns if c.header and name in (_fold(c.name), _fold(c.header))]
        if len(matches) > 1:
            raise _ambiguous(log, role, name, matches)
        if matches:
            return matches[0]
    return None


def bind_role(log: Log, role: Role) -> Binding | None:
    """Bind one role, ``None`` when it has no column."""
    explicit = role.name in log.bindings
    if role.name in log.elsewhere and not role.required:
        return None
    if explicit:
        column = find_column(log, role.name, log.bindings[role.name])
    else:
        found = default_column(log, role.name)
        if found is None:
            return None
        column = found
    where = f"{log.name}, column '{column.label}' (role '{role.name}')"
    unit = log.units.get(role.name) or column.unit
    if (
        role.name not in log.units
        and column.doubtful
        and unit is not None
        and not same_dimension(unit, role.unit)
    ):
        unit = None  # "valve_m" as a voltage: the m was an index
    role = in_accepted_unit(role, unit)
    factor = conversion_factor(unit, role.unit, where) if unit else 1.0
    return Binding(
        role=role,
        column=column,
        unit=unit or role.unit,
        scale=log.scales.get(role.name, 1.0),
        factor=factor,
        # A raw reading is used as it is; assuming a unit for it changes nothing.
        assumed=unit is None and role.unit != "1",
        explicit=explicit,
    )


def in_accepted_unit(role: Role, unit: str | None) -> Role:
    """The role in whichever of its SI units has the dimension of a given unit."""
    if unit is None or not role.alternatives or not is_known_unit(unit):
        return role
    for accepted in (role.unit, *role.alternatives):
        if same_dimension(unit, accepted):
            return replace(role, unit=accepted)
    return role


def bind_roles(log: Log, roles: Sequence[Role]) -> dict[str, Binding]:
    """Bind all roles that have a column; a role with a step needs none."""
    bindings = {}
    for role in roles:
        if role.name in log.steps or (role.name == "time" and log.sample_time is not None):
            continue
        binding = bind_role(log, role)
        if binding is not None:
            bindings[role.name] = binding
    return bindings


def missing_roles(log: Log, roles: Sequence[Role]) -> list[str]:
    """Return required roles that neither a column, a step nor a sample time fills."""
    required = [role for role in roles if role.required and role.name not in log.elsewhere]
    bound = bind_roles(log, required)
    given = {*bound, *log.steps, *(("time",) if log.sample_time is not None else ())}
    return [role.name for role in roles if role.required and role.name not in given]


def missing_error(log: Log, missing: Sequence[str]) -> LogError:
    """Return the error for roles without a column."""
    for role in missing:
        if role in log.elsewhere:
            return _no_column(log, role, log.bindings[role])
    names = " and ".join(f"'{name}'" for name in missing)
    remedy = f"Give --column {missing[0]}=HEADER (or #N)."
    if missing[0] == "time":
        remedy = (
            "Give --column time=HEADER (or #N), or --sample-time SECONDS if it was not recorded."
        )
    return LogError(
        f"no column is named {names}.",
        where=log.name,
        expected=f"Its columns are {list_columns(log)}.",
        remedy=remedy,
    )


def assumed_notice(log: Log, bindings: Iterable[Binding]) -> list[Notice]:
    """Return one notice for all units that were assumed."""
    assumed = [b for b in bindings if b.assumed]
    if not assumed:
        return []
    texts = ", ".join(f"{b.role.name} in {b.unit} ('{b.column.label}')" for b in assumed)
    return [
        Notice(
            "unit-assumed",
            f"{log.name}: no unit was given, SI was assumed: {texts}. "
            f"Name it with --unit {assumed[0].role.name}=UNIT.",
        )
    ]


def require_numbers(log: Log, binding: Binding, rows: npt.NDArray[np.intp]) -> None:
    """Refuse cells of a used column that are no finite number.

    Raises
    ------
    LogError
        Naming line, column and text of the first one.
    """
    wrong = rows[~np.isfinite(binding.column.values[rows])]
    if not wrong.size:
        return
    line = int(log.lines[wrong[0]])
    text = binding.column.bad.get(int(wrong[0]))
    if text is None:
        found = "holds something that is not a number."
    elif not text:
        found = "is empty."
    else:
        found = f"holds '{text[:60]}', which is not a{' finite' if _is_nan(text) else ''} number."
    if wrong.size > 1:
        found += f" {wrong.size - 1} more such cells ({name_lines(log.lines[wrong[1:]])})."
    raise LogError(
        f"column '{binding.column.label}' {found}",
        where=f"{log.name}, line {line}",
        remedy=(
            f"Give --column {binding.role.name}=... if this is not the {binding.role.name}, "
            "or remove the line."
        ),
    )


def _is_nan(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _fold(text: str) -> str:
    return "_".join(text.strip().casefold().replace("-", " ").split())


def _ambiguous(log: Log, role: str, wanted: str, matches: Sequence[Column]) -> LogError:
    texts = " and ".join(f"#{c.index} '{c.header}'" for c in matches)
    return LogError(
        f"'{wanted}' for the role '{role}' could be {texts}.",
        where=log.name,
        remedy=f"Give the number: --column {role}=#{matches[0].index}.",
    )


def _no_column(log: Log, role: str, wanted: str) -> LogError:
    headers = {h.casefold(): h for c in log.columns for h in (c.name, c.header) if h}
    close = difflib.get_close_matches(wanted.casefold(), headers, n=1)
    guess = f"Did you mean '{headers[close[0]]}'? " if close else ""
    return LogError(
        f"there is no column '{wanted}' for the role '{role}'.",
        where=log.name,
        expected=f"Its columns are {list_columns(log)}.",
        remedy=f"{guess}Give --column {role}=HEADER (or #N).",
    )
