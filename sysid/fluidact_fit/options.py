"""A family's own options: one typed dataclass, from which everything else is made.

The command line, keyword arguments of ``fit``, the ``options`` part of a parameter file, its
schema and the tables of the documentation are all read off the fields. A field is declared
with one of the helpers below::

    @dataclass(frozen=True)
    class LineOptions(FamilyOptions):
        length: float | None = number(help="length of the line", unit="m", above=0.0)

Values that a fit settles (a dead band found from the noise) replace ``None`` or ``"auto"``, and
the file holds the settled ones: everything later reads them there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

from .errors import UsageError, closest
from .units.quantities import in_si, plausible

Kind = Literal["choice", "float", "int", "flag", "text", "range"]
_FORMS = {
    "float": "a number",
    "int": "a whole number",
    "flag": "true or false",
    "text": "text",
    "range": "two numbers, the lower one first",
}


@dataclass(frozen=True)
class Option:
    """One option: what may be given, and what it means.

    Attributes
    ----------
    name
        As on the command line, without the hyphens before it.
    kind, help, default, choices, unit
        ``default`` is ``None`` where the fit chooses or the option is not needed.
    minimum, maximum
        Closed range of a number; ``above`` is an open lower end.
    check
        Returns a text in its proper form, or raises ``ValueError`` saying what is wrong.
    form
        What text it has to be, in words.
    settled
        Found by the fit and kept in the file; nothing a user gives.
    frees
        Parameter that is estimated with the last of the choices. Otherwise it has the value of
        the one that stands for it, or its neutral value.
    formerly
        What files written before call it.
    """

    name: str
    kind: Kind
    help: str
    default: Any = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    above: float = -math.inf
    check: Callable[[str], str] | None = None
    form: str = ""
    settled: bool = False
    frees: str = ""
    formerly: str = ""

    @property
    def keyword(self) -> str:
        """Name of the field and keyword argument, with underscores for hyphens."""
        return self.name.replace("-", "_")

    @property
    def units(self) -> list[str]:
        """SI units that a number may be in: of linear and of rotary motion where it has both."""
        return self.unit.split(" or ") if self.unit else ["1"]

    @property
    def expected(self) -> str:
        """Describe the accepted values."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        words = [self.form or _FORMS[self.kind]]
        if math.isfinite(self.above):
            words.append(f"above {self.above:g}")
        if math.isfinite(self.minimum):
            words.append(f"not below {self.minimum:g}")
        if math.isfinite(self.maximum):
            words.append(f"not above {self.maximum:g}")
        unit = f" [{self.unit}]" if self.unit else ""
        return " ".join((words[0], ", ".join(words[1:]))).strip() + unit

    def read(self, value: Any) -> Any:
        """Return the value in its proper type.

        Raises
        ------
        ValueError
            Saying what is wrong with it.
        """
        if value is None:
            return None
        if self.kind == "text":
            return self._read_text(value)
        if self.kind == "range":
            return self._read_range(value)
        if self.kind in ("float", "int"):
            return self._read_number(value)
        if self.kind == "choice" and value not in self.choices:
            raise ValueError("there is no such choice")
        if self.kind == "flag" and not isinstance(value, bool):
            raise ValueError("neither true nor false")
        return value

    def _read_text(self, value: Any) -> str:
        if isinstance(value, bool) or not isinstance(value, str | int):
            raise ValueError("not text")
        text = str(value).strip()
        return self.check(text) if self.check else text

    def _read_range(self, value: Any) -> tuple[float, float]:
        if isinstance(value, str) or not hasattr(value, "__len__") or len(value) != 2:
            raise ValueError("not a pair of numbers")
        low, high = (self._read_number(v) for v in value)
        if not low < high:
            raise ValueError(f"{low:g} is not below {high:g}")
        return float(low), float(high)

    def _read_number(self, value: Any) -> float | int:
        if isinstance(value, bool) or not isinstance(value, int | float):
            value = getattr(value, "item", lambda: value)()  # a numpy scalar
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError("not a number")
        plausible(value)
        if self.kind == "int" and value != int(value):
            raise ValueError("not a whole number")
        if value <= self.above or value < self.minimum or value > self.maximum:
            raise ValueError("out of range")
        return int(value) if self.kind == "int" else float(value)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def choice(
    default: str | None, values: tuple[str, ...], help: str, frees: str = "", formerly: str = ""
) -> Any:
    """One word out of several; ``frees`` names the parameter that the last of them frees."""
    return _field("choice", help, default, choices=values, frees=frees, formerly=formerly)


def number(default: float | None = None, *, help: str, unit: str = "", **limits: float) -> Any:
    """A number [``unit``] from ``minimum`` to ``maximum``, or one above ``above``."""
    return _field("float", help, default, unit=unit, **limits)


def whole(default: int | None = None, *, help: str, **limits: float) -> Any:
    """A whole number from ``minimum`` to ``maximum``."""
    return _field("int", help, default, **limits)


def flag(default: bool | None = None, *, help: str) -> Any:
    """Yes or no; ``None`` where the fit decides."""
    return _field("flag", help, default)


def text(
    default: str | None = None,
    *,
    help: str,
    check: Callable[[str], str] | None = None,
    form: str = "",
) -> Any:
    """Text, brought into its proper form by ``check``; ``form`` says in words what it is."""
    return _field("text", help, default, check=check, form=form)


def interval(*, help: str, unit: str = "") -> Any:
    """``LOW:HIGH``."""
    return _field("range", help, None, unit=unit)


def settled(kind: Kind, help: str, **limits: Any) -> Any:
    """Declare an option that no user gives: the fit finds it and the file holds it."""
    return _field(kind, help, None, settled=True, **limits)


def _field(kind: Kind, help: str, default: Any, **more: Any) -> Any:
    return field(default=default, metadata={"option": Option("", kind, help, default, **more)})


def describe(options: type[FamilyOptions], *, every: bool = False) -> tuple[Option, ...]:
    """Options of a family in the order of the class; ``every`` adds the settled ones."""
    found = (replace(f.metadata["option"], name=f.name.replace("_", "-")) for f in fields(options))
    return tuple(o for o in found if every or not o.settled)


@dataclass(frozen=True)
class FamilyOptions:
    """Base of every family's options; without fields, a family without options."""

    @classmethod
    def read(cls, given: Mapping[str, Any], *, from_file: bool = False) -> Self:
        """Check options by name and fill in the defaults.

        Parameters
        ----------
        given
            Name, with hyphens or underscores, to value; ``None`` means: not given. A number may be
            text with a unit, ``"4.91 cm2"``, but not in a file.
        from_file
            Whether they are those of a parameter file: settled values are among them.

        Raises
        ------
        UsageError
            Naming the option, what may be given, and the closest name there is.
        """
        known = {o.name: o for o in describe(cls, every=from_file)}
        former = {o.formerly: o.name for o in known.values() if o.formerly and from_file}
        values = {}
        for name, value in given.items():
            key = name.replace("_", "-")
            key = former.get(key, key)
            if key not in known:
                close = closest(key, known)
                options = ", ".join(f"--{n}" for n in known) or "none"
                raise UsageError(
                    f"there is no option --{key}",
                    expected=f"The options are: {options}.",
                    remedy=f"Did you mean --{close}?" if close else "",
                )
            try:
                if known[key].kind == "float" and not from_file:
                    value = in_si(value, *known[key].units)
                read = known[key].read(value)
            except ValueError as error:
                raise UsageError(
                    f"--{key}={_shown(value)}: {error}",
                    expected=f"Expected {known[key].expected}.",
                ) from None
            if read is not None:
                values[key.replace("-", "_")] = read
        return cls(**values)

    @property
    def unasked(self) -> set[str]:
        """Parameters that one of the options frees, but that are not estimated with these."""
        freeing, given = [o for o in describe(type(self)) if o.frees], self.given()
        return {o.frees for o in freeing if given.get(o.name) != o.choices[-1]}

    def given(self) -> dict[str, Any]:
        """Return every option that has a value, named as in the file; pairs as lists."""
        found = {f.name.replace("_", "-"): getattr(self, f.name) for f in fields(self)}
        return {
            k: list(v) if isinstance(v, tuple) else v for k, v in found.items() if v is not None
        }
