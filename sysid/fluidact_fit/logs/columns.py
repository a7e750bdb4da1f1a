"""Assignment of columns to roles, with their units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import (
    LogError,
    MissingColumnError,
    Notice,
    UsageError,
    check_names,
    closest,
    visible,
)
from ..experiment import is_finite
from ..specification import Role
from ..units import (
    conversion_factor,
    parse_unit_from_header,
    same_dimension,
    unit_within,
    without_size,
)
from .counters import find_carry
from .log import Column, Log
from .stamps import is_time_name, names_time

TIME = Role("time", "s", "instants of the samples")
# Time is the one role with a symbol that is in general use as a header.
_SYNONYMS = {"time": ("t",)}
_NUMBER = re.compile("#[0-9]{1,9}")
_REMARK = re.compile(r"[(\[{<][^()\[\]{}<>]+[)\]}>]\s*$")
# Counts of the years 2000 to 2103: since 1970, and in 100 ns since 1601 and since the year 1
_SINCE = (
    ("ms", 9.5e11, 4.2e12), ("us", 9.5e14, 4.2e15), ("ns", 9.5e17, 4.2e18),
    ("100 ns", 1.259e17, 1.585e17), ("100 ns", 6.307e17, 6.634e17),
)  # fmt: skip
# Days since 1900, as spreadsheets count from 1982 to 2077, since the year 0 and of Julius Caesar
_IN_DAYS = (30_000.0, 65_000.0), (725_000.0, 770_000.0), (2_440_000.0, 2_490_000.0)
_DAYS_STEP = 2e-5  # below it numbers of that size are hardly seconds: 50,000 rows a second
_UPPER_NAME = re.compile("time|zeit|stamp|clock|epoch|sec|min|hour|stunde|^(?:hh?|mm?|ss?)$", re.I)
_PARTS = 60, 10**3, 10**6, 10**9  # of a minute, an hour or a second
_EVEN = 0.01  # of a step


@dataclass(frozen=True)
class Binding:
    """A role, its column, and the factor from one to the other.

    ``unit`` is that of the scaled column as used: from the user, the header, or ``assumed``.
    ``scale`` is the factor for the raw column, 1 unless given; ``to_si`` the one from the raw
    column to SI, ``scale`` included.
    """

    role: Role
    column: Column
    unit: str
    scale: float
    to_si: float
    assumed: bool

    @property
    def logged_in(self) -> tuple[str, float]:
        """The unit for messages, without a size before it, and what one of it is in SI."""
        unit = without_size(self.unit)
        size = self.to_si / self.scale
        return unit, size if unit == self.unit else conversion_factor(unit, self.role.unit)


def list_columns(log: Log, shown: int = 12) -> str:
    """Return the columns of a log for a message: ``#1 'pos [mm]', #2 'ADC'``."""
    texts = [f"#{c.index} '{c.header}'" if c.header else f"#{c.index}" for c in log.columns]
    if len(texts) > shown:
        texts = [*texts[:shown], f"... (#{len(log.columns)} is the last)"]
    return ", ".join(texts)


def left_out(log: Log) -> list[str]:
    """What was noticed of parts of a log that are not among its columns."""
    return [n.message for n in log.notices if n.code in ("variables-left-out", "recording-cut")]


def _held_by(log: Log) -> str:
    """The columns of a log, and what is not among them, for a message."""
    return "\n".join([f"Its columns are {list_columns(log)}.", *left_out(log)])


def check_roles(log: Log, roles: Iterable[Role]) -> None:
    """Refuse options that name a role the family does not have, or that do not apply to it."""
    known = {role.name: role for role in roles}
    options = {
        "--step": [name for name, step in log.steps.items() if step.start != step.end],
        "--set": [name for name, step in log.steps.items() if step.start == step.end],
        "--column": log.bindings,
        "--unit": log.units,
        "--scale": log.scales,
        "--hold": log.holds,
        "--unwrap": log.turns,
    }
    for option, given in options.items():
        check_names(option, "role", given, known)
    for name, step in log.steps.items():
        option, what = ("--set", "constant") if step.start == step.end else ("--step", "step")
        if name == "time" or known[name].output:
            raise UsageError(
                f"{option} cannot replace '{name}'.", remedy=f"Only an input can be a known {what}."
            )
        if known[name].hold is None:
            raise UsageError(
                f"{option} cannot replace '{name}': it is needed sample by sample.",
                remedy=f"Give --column {name}=HEADER (or #N).",
            )
        if name in log.bindings:
            raise UsageError(
                f"'{name}' has both a column and a constant or step.",
                remedy="Keep one of --column, --step and --set.",
            )
    for name in log.holds:
        if known[name].hold is None:
            driving = [r.name for r in known.values() if r.hold is not None]
            raise UsageError(
                f"--hold does not apply to '{name}', which is taken at its samples alone.",
                expected=f"In this family it means something for {' and '.join(driving)}."
                if driving
                else "",
                remedy=f"Leave --hold {name}={log.holds[name]} out.",
            )


def find_column(log: Log, role: str, wanted: str) -> Column:
    """Return the one column that ``--column role=wanted`` means; ``LogError`` without one."""
    matches = matching(log, wanted)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise _ambiguous(log, role, wanted, matches)
    number = _column_number(wanted)
    if number is None:
        raise _no_column(log, role, wanted)
    raise LogError(
        f"there is no column #{number} for '{role}'.",
        where=log.name,
        expected=f"It has {len(log.columns)}: {list_columns(log)}.",
        remedy=f"Give --column {role}=#N with 1 to {len(log.columns)}.",
    )


def _column_number(wanted: str) -> int | None:
    return int(wanted[1:]) if _NUMBER.fullmatch(wanted) else None


def matching(log: Log, wanted: str) -> list[Column]:
    """Columns that a number or header means: the closest kind of agreement that finds any."""
    number = _column_number(wanted)
    if number is not None:
        return [c for c in log.columns if c.index == number]
    text, folded = wanted.strip(), _fold(wanted)
    named = [c for c in log.columns if c.header]
    return (
        [c for c in log.columns if c.header == text]
        or [c for c in named if _fold(c.header) == folded]
        or [c for c in named if c.name == text]
        or [c for c in named if _fold(c.name) == folded]
        or [c for c in named if folded in map(_fold, c.also)]
    )


def reference_of(log: Log, column: Column, others: Sequence[Log] = ()) -> str:
    """Return a text that ``--column`` takes for a column alone: its header, name or number.

    One that takes a single column of every other log as well is better, if there is any: a name
    without its unit, where the units differ.
    """
    texts = (column.header.strip(), column.name.strip())
    unique = [t for t in texts if t and t == visible(t) and matching(log, t) == [column]]
    everywhere = (t for t in unique if all(len(matching(other, t)) == 1 for other in others))
    return next(everywhere, unique[0] if unique else f"#{column.index}")


def _same_name(log: Log, header: str) -> Column | None:
    """The one column of a name that ``header`` has with another unit."""
    name, unit = parse_unit_from_header(header)
    found = matching(log, name) if unit and name else []
    return found[0] if len(found) == 1 and found[0].unit else None


def share_columns(logs: Sequence[Log]) -> list[Log]:
    """Let logs that were read with the same bindings lack columns that others of them hold.

    Several experiments of one machine need not record the same: one pressure in some, the other
    pressure in others. A header that no log holds is still refused where it is used, and so
    is one of a role that is required. The logs returned have ``elsewhere`` filled in.
    """
    given = [set(log.bindings.items()) for log in logs]
    held = [{(r, w) for r, w in pairs if matching(log, w)} for log, pairs in zip(logs, given)]
    anywhere = set().union(*held)
    out = []
    for log, pairs, here in zip(logs, given, held):
        lacking = {role for role, w in (pairs & anywhere) - here if not _same_name(log, w)}
        out.append(replace(log, elsewhere=frozenset(lacking)) if lacking else log)
    return out


def default_column(log: Log, role: str) -> Column | None:
    """Return the column whose name, unit and case aside, is the role; ``None`` without one.

    Where no other is called so, the time is the column that has another name for it, one of clock
    times before others; else the one column of clock times.
    """
    for name in (role, *_SYNONYMS.get(role, ())):
        named = [c for c in log.columns if c.header and not c.part_of]
        matches = [c for c in named if name in (_fold(c.name), _fold(c.header))]
        if name != role:  # "T" may be a temperature
            matches = [c for c in matches if c.unit is None or same_dimension(c.unit, TIME.unit)]
        if len(matches) > 1:
            raise _ambiguous(log, role, name, matches)
        if matches:
            return matches[0]
        parts = [c for c in log.columns if c.also and _fold(name) in map(_fold, c.also)]
        if len(parts) == 1:
            return parts[0]
    if role != TIME.name:
        return None
    clocks = [c for c in log.columns if c.clock]
    timed = [c for c in log.columns if c.header and not c.part_of and _is_called_time(c)]
    timed = [c for c in timed if not _is_given(log, c)]
    named = [c for c in timed if c.clock]
    return next((found[0] for found in (named, timed, clocks) if len(found) == 1), None)


def _is_called_time(column: Column) -> bool:
    """Return whether a column has another name of time, in a unit of it or in none."""
    named = is_time_name(column.name) or is_time_name(column.header)
    named = named or (column.index == 1 and _fold(column.name) == "x" and _is_even(column))
    return named and (column.unit is None or same_dimension(column.unit, TIME.unit))


def _is_even(column: Column) -> bool:
    """True if all steps are the same but for rounding, as those of the axis of a plot are."""
    steps = np.diff(column.values)
    return steps.size > 2 and bool(np.all(np.abs(steps - steps.mean()) < _EVEN * steps.mean()))


def _is_given(log: Log, column: Column) -> bool:
    """Return whether ``--column`` gives a column to some role."""
    return any(c is column for wanted in log.bindings.values() for c in matching(log, wanted))


def _factor(unit: str, role: Role, where: str) -> float:
    return conversion_factor(unit, role.unit, where, role.name, role.alternatives)


def in_unit(role: Role, unit: str | None) -> Role:
    """A role in that of its SI units which measures what ``unit`` does, else in the first."""
    if not unit or not role.alternatives:
        return role
    alike = (si for si in (role.unit, *role.alternatives) if same_dimension(unit, si))
    return replace(role, unit=next(alike, role.unit))


def bind_role(log: Log, role: Role) -> Binding | None:
    """Bind one role, ``None`` when it has no column."""
    if role.name in log.elsewhere and not role.required:
        return None
    if role.name in log.bindings:
        column: Column | None = find_column(log, role.name, log.bindings[role.name])
    else:
        column = default_column(log, role.name)
        if column is not None and _is_given(log, column):
            return None  # the user says what it is: no other role is meant
    if column is None:
        return None
    if column.part_of and role.name == TIME.name:
        raise LogError(
            f"column '{column.label}' holds no more than fractions of a second.",
            where=log.name,
            expected=f"The seconds are in column #{column.part_of}, with which it was joined.",
            remedy=f"Give --column time=#{column.part_of}.",
        )
    where = f"{log.name}, column '{column.label}' (role '{role.name}')"
    if column.clock and role.name == TIME.name and log.units.get(TIME.name, "s") != "s":
        raise LogError(
            "it holds dates or times of day, which are read as seconds.",
            where=where,
            expected=f"--unit time={log.units[TIME.name]} does not apply.",
            remedy="Leave it out.",
        )
    unit = log.units.get(role.name) or column.unit
    believed = role.name in log.units or not column.doubtful
    if unit and not believed and not same_dimension(unit, role.unit):
        unit = None  # "valve_m" as a voltage: the m was an index
    # A raw reading is used as it is; assuming a unit for it changes nothing.
    assumed = unit is None and role.unit != "1"
    if assumed and role.name == TIME.name and role.name not in log.scales:
        unit = _unit_of_calendar(column)
    if assumed and unit is None and role.name not in log.scales:
        _refuse_stray_unit(log, column, role, where)
    role = in_unit(role, unit)
    scale = log.scales.get(role.name, 1.0)
    return Binding(
        role=role,
        column=column,
        unit=unit or role.unit,
        scale=scale,
        to_si=scale * _factor(unit, role, where) if unit else scale,
        assumed=assumed,
    )


def _refuse_stray_unit(log: Log, column: Column, role: Role, where: str) -> None:
    """Refuse to take a column for SI whose name, or the words beside its numbers, say another."""
    found = [(unit_within(column.header, role.unit), "in the middle of its name")]
    for beside in (c for c in log.columns if c.index == column.index + 1):
        words = {text.strip(" ,;[]()") for text in beside.bad.values()}
        if len(words) == 1 and bool(np.isnan(beside.values).all()):
            found.append((unit_within(words.pop(), role.unit), f"in column #{beside.index}"))
    for unit, place in found:
        if unit is not None:
            raise LogError(
                f"it may be in '{unit}', which appears {place}.",
                where=where,
                expected=f"Expected a unit behind the name, as in '[{unit}]'.",
                remedy=f"Give --unit {role.name}={unit} if that is its unit, "
                f"else --unit {role.name}='{role.unit}'.",
            )


def _unit_of_calendar(column: Column) -> str | None:
    """Unit of stamps that count from 1970, or days as spreadsheets and MATLAB do; else ``None``.

    As seconds they would be centuries, or rows within a microsecond of each other.
    """
    if column.values.size < 2 or not column.values[0] >= _IN_DAYS[0][0]:
        return None  # before anything is looked at whole: most stamps begin near zero
    known = column.values[np.isfinite(column.values)]
    low, high = float(known.min()), float(known.max())
    for unit, first, last in _SINCE:
        if first <= low and high <= last:
            return unit
    steps = np.diff(known)
    in_days = any(first <= low and high <= last for first, last in _IN_DAYS)
    if in_days and np.any(steps > 0.0):
        usual = float(np.median(steps[steps > 0.0]))
        return "d" if usual < _DAYS_STEP else None
    return None


def time_candidate(log: Log) -> Binding | None:
    """Return the time column: named, in a unit of time, or the first that grows as time does."""
    binding = bind_role(log, TIME)
    if binding is not None:
        return binding
    for column in log.columns:
        timed = column.unit is not None and same_dimension(column.unit, "s")
        likely = timed or (column.unit is None and _grows_as_time(column))
        if likely and _grows(column) and counts_for(log, column) is None:
            # as a fit reads it where it is named
            return bind_role(replace(log, bindings={TIME.name: f"#{column.index}"}), TIME)
    return None


def _grows(column: Column) -> bool:
    """Return whether a column of numbers mostly grows."""
    steps = np.diff(column.stamps)
    whole = is_finite(column.values) and steps.size > 0
    return whole and not column.part_of and float(np.mean(steps > 0)) > 0.5


def counts_for(log: Log, column: Column) -> Column | None:
    """The column beside one of which it counts parts, as of seconds or minutes; ``None`` without.

    That goes up by one wherever the other starts again. One that counts runs does so as well, but
    is not called a time, nor do runs take as long as a second or a minute.
    """
    for upper in log.columns:
        named = not upper.header or _UPPER_NAME.search(upper.header)
        if abs(upper.index - column.index) == 1 and named:
            carry = find_carry(upper.values, column.values)
            if carry is not None and any(map(carry.is_at, _PARTS)):
                return upper
    return None


def _grows_as_time(column: Column) -> bool:
    """Return whether a column without a unit grows, and is called so or stamped as clocks stamp.

    A calibration grows as well, as evenly as it was loaded; its name tells, if it has one.
    """
    steps = np.diff(column.stamps)
    if steps.size < 3 or float(np.mean(steps > 0)) <= 0.7:
        return False
    if column.header:
        return names_time(column.header)
    steps = steps[steps > 0]
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) <= 0.1 * usual)) > 0.5
    # a controller prints the first column in whole ms, as its cycles come
    counted = column.index == 1 and bool(np.all(column.values == np.round(column.values)))
    return even or counted


def _needs_column(log: Log, role: Role) -> bool:
    """Return whether neither a step nor a sample time stands for a role."""
    return role.name not in log.steps and (role.name != "time" or log.sample_time is None)


def bind_roles(log: Log, roles: Sequence[Role]) -> dict[str, Binding]:
    """Bind all roles that have a column; a role with a step needs none."""
    bound = {role.name: bind_role(log, role) for role in roles if _needs_column(log, role)}
    return {name: binding for name, binding in bound.items() if binding is not None}


def missing_roles(log: Log, roles: Sequence[Role]) -> list[str]:
    """Return required roles that neither a column, a step nor a sample time fills."""
    return [
        role.name
        for role in roles
        if role.required
        and _needs_column(log, role)
        and (role.name in log.elsewhere or bind_role(log, role) is None)
    ]


def require_roles(log: Log, roles: Sequence[Role]) -> None:
    """Refuse a log that lacks a required role, with the columns that it has (``LogError``)."""
    missing = missing_roles(log, roles)
    if not missing:
        return
    for role in missing:
        if role in log.elsewhere:
            raise _no_column(log, role, log.bindings[role])
    *others, last = (f"'{name}'" for name in missing)
    names = f"{', '.join(others)} and {last}" if others else last
    options = [f"--column {name}=HEADER" for name in missing if name != TIME.name]
    remedies = [f"Give {' '.join(options)} (or #N)."] if options else []
    if TIME.name in missing:
        likely = time_candidate(log)
        given = "HEADER (or #N)"
        if likely is not None:
            given = f"#{likely.column.index}, which looks like it"
        words = f"Give --column time={given}, or --sample-time SECONDS if it was not recorded."
        remedies.insert(0, words)
    raise MissingColumnError(
        f"no column is named {names}.",
        where=log.name,
        expected=_held_by(log),
        remedy="\n".join(remedies),
        log=log,
    )


def assumed_notice(log: Log, bindings: Iterable[Binding]) -> Iterator[Notice]:
    """Report all units that were assumed, in one notice."""
    assumed = [b for b in bindings if b.assumed]
    if assumed:
        texts = ", ".join(f"{b.role.name} in {b.unit} ({_why(b)})" for b in assumed)
        options = " ".join(f"--unit {b.role.name}=UNIT" for b in assumed)
        yield Notice(
            "unit-assumed",
            f"{log.name}: no unit was found, and one was assumed: {texts}. "
            f"If it is another one, give {options}.",
        )


def exchanged_notice(log: Log, roles: Iterable[Role], bound: Mapping[str, Binding]) -> list[Notice]:
    """Warn of raw readings in a quantity that the output would be in, and the output in none."""
    first = next(
        (r.name for r in roles if (r.unit, *r.alternatives) == ("1",) and r.name in bound), ""
    )
    output = next((r for r in roles if r.output and r.name in bound), None)
    if not first or output is None or not same_dimension(bound[output.name].unit, "1"):
        return []
    reading, other = bound[first], bound[output.name].column
    quantities = [u for u in (output.unit, *output.alternatives) if u != "1"]
    if not any(same_dimension(reading.unit, u) for u in quantities):
        return []
    return [Notice(
        "columns-exchanged",
        f"{log.name}: '{reading.column.label}' is in {reading.unit} and was taken for the raw "
        f"'{first}', and '{other.label}', a plain number, for '{output.name}'. If the two "
        f"are exchanged, give --column {first}=#{other.index} --column "
        f"{output.name}=#{reading.column.index}.",
    )]  # fmt: skip


def _why(binding: Binding) -> str:
    """The column whose unit was assumed, and what tells or does not tell it."""
    label = f"'{binding.column.label}'"
    if binding.unit != binding.role.unit:
        return f"{label}, by the size of its numbers"
    remark = _REMARK.search(binding.column.header)
    return f"{label}, in which '{remark[0]}' is no unit that is known" if remark else label


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
    close = closest(wanted.casefold(), headers)
    guess = f"Did you mean '{headers[close]}'? " if close else ""
    if alike := _same_name(log, wanted):
        guess = f"--column '{role}={alike.name}' takes both, each in its own unit. "
    return LogError(
        f"there is no column '{wanted}' for the role '{role}'.",
        where=log.name,
        expected=_held_by(log),
        remedy=f"{guess}Give --column {role}=HEADER (or #N).",
    )
