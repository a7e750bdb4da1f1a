"""A family as text and as options: generated, so that a new family needs no line here."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

import click

from fluidact_fit import family as contract

from .options import Option
from .parse import Parsed, parse_number, parse_range, parse_text

_PREFIX = "family_option_"
_WIDTH = 76


def help_text(family: contract.Family) -> str:
    """Return title, equation, roles and parameters of a family."""
    parts = [family.title + ".", _block(["Equation:", *_indent(family.equation)])]
    several = len(family.variants) > 1
    for variant in family.variants:
        of = f" ({variant.name})" if several else ""
        parts.append(_block([f"Roles{of}:", *_definitions(map(_role, variant.roles))]))
        rows = map(_parameter, variant.parameters)
        parts.append(_block([f"Parameters{of}, as in the file (SI):", *_definitions(rows)]))
    parts.append(
        "Several LOGs are several experiments of the same hardware: parameters are shared, initial "
        "states and output offsets are free per log."
    )
    return "\n\n".join(parts)


def _block(lines: Iterable[str]) -> str:
    """A paragraph that click leaves as it is."""
    return "\n".join(["\b", *lines])


def _indent(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ",
                         break_long_words=False)  # fmt: skip


def _definitions(rows: Iterable[tuple[str, str]]) -> list[str]:
    listed = list(rows)
    width = max(len(name) for name, _ in listed) + 4
    lines = []
    for name, text in listed:
        lines += textwrap.wrap(
            text, _WIDTH, initial_indent=f"  {name}".ljust(width), subsequent_indent=" " * width
        )
    return lines


def _role(role: contract.Role) -> tuple[str, str]:
    unit = " or ".join((role.unit, *role.alternatives))
    remarks = [
        "" if role.required else "optional",
        f"default hold {role.hold}" if role.hold else "",
        "compared with the model" if role.output else "",
    ]
    said = "; ".join(text for text in remarks if text)
    return role.name, f"[{unit}] {role.description}" + (f" ({said})" if said else "")


def _parameter(spec: contract.ParameterSpec) -> tuple[str, str]:
    rank = {0: "", 1: "list: ", 2: "table: "}[spec.rank]
    remarks = [
        "depends on the options" if spec.optional else "",
        "unit depends on the log" if spec.any_unit else "",
        f"not below {spec.minimum:g}" if math.isfinite(spec.minimum) else "",
        f"not above {spec.maximum:g}" if math.isfinite(spec.maximum) else "",
    ]
    said = "; ".join(text for text in remarks if text)
    return spec.name, f"[{spec.unit}] {rank}{spec.description}" + (f" ({said})" if said else "")


def family_options(family: contract.Family) -> list[click.Parameter]:
    """Return the command-line options of a family's own options."""
    return [_option(option) for option in family.options]


def _option(option: contract.Option) -> Option:
    name, dest = f"--{option.name}", _PREFIX + option.name.replace("-", "_")
    default = "" if option.default is None else f" Default: {_shown(option)}."
    unit = f" [{option.unit}]" if option.unit else ""
    text = option.help[:1].upper() + option.help[1:].rstrip(".") + unit + "." + default
    if option.kind == "flag":
        flag = name if option.default is False else f"{name}/--no-{option.name}"
        return Option([flag, dest], is_flag=True, default=None, help=text, group="Model")
    return Option([name, dest], type=_type(option), help=text, group="Model")


def _shown(option: contract.Option) -> str:
    if option.kind == "flag":
        return f"--{option.name}" if option.default else f"--no-{option.name}"
    if isinstance(option.default, (tuple, list)):
        return ":".join(f"{value:g}" for value in option.default)
    return str(option.default)


def _type(option: contract.Option) -> click.ParamType[Any]:
    name = f"--{option.name}"
    if option.kind == "choice":
        return click.Choice(option.choices)
    if option.kind == "int":
        low = int(option.minimum) if math.isfinite(option.minimum) else None
        return click.IntRange(min=low)
    if option.kind == "float":
        return Parsed("NUMBER", f"{name} 1.5", lambda text: _at_least(option, text))
    if option.kind == "range":
        return Parsed("LOW:HIGH", f"{name} 0:10", parse_range)
    return Parsed("TEXT", f"{name} {option.default or 'auto'}", parse_text)


def _at_least(option: contract.Option, text: str) -> float:
    if (value := parse_number(text)) < option.minimum:
        raise ValueError(f"'{text}' is below {option.minimum:g}")
    return value


def chosen_options(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the family options that were given, named as ``fit`` wants them."""
    return {
        name.removeprefix(_PREFIX): value
        for name, value in params.items()
        if name.startswith(_PREFIX) and value is not None
    }
