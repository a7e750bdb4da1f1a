"""A family as text and as options: generated, so that a new family needs no line here."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import click

from fluidact_fit.options import Option as FamilyOption
from fluidact_fit.options import describe
from fluidact_fit.specification import Described, ParameterSpec, Role
from fluidact_fit.units.quantities import in_si, parse_number

from .options import Option, flag
from .parse import Parsed, parse_range, parse_text

_PREFIX = "family_option_"
_WIDEST = 80  # columns of a help text, as click has them


def help_text(family: Described) -> str:
    """Return title, equation, roles and parameters of a family."""
    equation = textwrap.wrap(family.equation, _width(), initial_indent="  ",
                             subsequent_indent="    ", break_long_words=False,
                             break_on_hyphens=False)  # fmt: skip
    parts = [family.title + ".", _block(["Equation:", *equation])]
    roles = {v.name: _definitions(map(_role, v.roles)) for v in family.variants}
    parts += _by_variant("Roles{of}:", roles)
    parameters = {v.name: _definitions(map(_parameter, v.parameters)) for v in family.variants}
    parts += _by_variant("Parameters{of}, as in the file (SI):", parameters)
    parts.append(
        "Several LOGs are experiments on the same hardware: they share the parameters, and each "
        "has its own initial state and output offset."
    )
    return "\n\n".join(parts)


def _by_variant(heading: str, lines: Mapping[str, Sequence[str]]) -> list[str]:
    """Lines of every variant under a heading: once where variants have the same."""
    named: dict[tuple[str, ...], list[str]] = {}
    for variant, of_it in lines.items():
        named.setdefault(tuple(of_it), []).append(variant)
    blocks = []
    for text, variants in named.items():
        of = f" ({', '.join(variants)})" if len(named) > 1 else ""
        head = textwrap.wrap(heading.format(of=of), _width(), subsequent_indent="  ",
                             break_on_hyphens=False)  # fmt: skip
        blocks.append(_block([*head, *text]))
    return blocks


def _width() -> int:
    return max(min(shutil.get_terminal_size().columns, _WIDEST) - 4, 40)


def _block(lines: Iterable[str]) -> str:
    """A paragraph that click leaves as it is."""
    return "\n".join(["\b", *lines])


def _definitions(rows: Iterable[tuple[str, str]]) -> list[str]:
    listed = list(rows)
    width = max(len(name) for name, _ in listed) + 4
    lines = []
    for name, text in listed:
        lines += textwrap.wrap(
            text,
            _width(),
            initial_indent=f"  {name}".ljust(width),
            subsequent_indent=" " * width,
            break_on_hyphens=False,
        )
    return lines


def _role(role: Role) -> tuple[str, str]:
    unit = " or ".join((role.unit, *role.alternatives))
    remarks = [
        "" if role.required else "optional",
        f"default hold {role.hold}" if role.hold else "",
        "compared with the model" if role.output else "",
    ]
    return role.name, f"[{unit}] {role.description}{_in_brackets(remarks)}"


def _parameter(spec: ParameterSpec) -> tuple[str, str]:
    rank = {0: "", 1: "list: ", 2: "table: "}[spec.rank]
    remarks = [
        "depends on the options" if spec.optional else "",
        "unit depends on the log" if spec.ratio else "",
        f"not below {spec.minimum:g}" if math.isfinite(spec.minimum) else "",
        f"not above {spec.maximum:g}" if math.isfinite(spec.maximum) else "",
    ]
    return spec.name, f"[{spec.unit}] {rank}{spec.description}{_in_brackets(remarks)}"


def _in_brackets(remarks: Iterable[str]) -> str:
    said = "; ".join(text for text in remarks if text)
    return f" ({said})" if said else ""


def family_options(family: Described) -> list[click.Parameter]:
    """Return the command-line options of a family's own options."""
    return [_option(option) for option in describe(family.options_type)]


def _option(option: FamilyOption) -> Option:
    yes, no = f"--{option.name}", f"--no-{option.name}"
    dest = _PREFIX + option.keyword
    default = option.default
    if isinstance(default, bool):
        default = yes if default else no
    unit = f" [{option.unit}]" if option.unit else ""
    text = option.help[:1].upper() + option.help[1:].rstrip(".") + unit + "."
    if default is not None:
        text += f" Default: {default}."
    if option.kind == "flag":
        return flag(yes if option.default is False else f"{yes}/{no}", dest,
                    default=None, help=text, group="Model")  # fmt: skip
    return Option([yes, dest], type=_type(option), help=text, group="Model")


def _type(option: FamilyOption) -> click.ParamType[Any]:
    """Type by which the text is parsed; the option itself decides what may be given."""
    if option.kind == "choice":
        return click.Choice(option.choices)
    forms: dict[str, tuple[str, str, Callable[[str], Any]]] = {
        "int": ("N", "4", _whole),
        "float": (
            "NUMBER",
            f"1.5{option.units[0].replace(' ', '')}" if option.unit else "1.5",
            lambda text: in_si(text, *option.units),
        ),
        "range": ("LOW:HIGH", "0:10", parse_range),
        "text": ("TEXT", str(option.default or "auto"), parse_text),
    }
    metavar, example, parse = forms[option.kind]
    return Parsed(metavar, f"--{option.name} {example}", lambda text: option.read(parse(text)),
                  option.expected)  # fmt: skip


def _whole(text: str) -> int:
    if (value := parse_number(text)) != int(value):
        raise ValueError(f"'{text}' is not a whole number")
    return int(value)


def chosen_options(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the family options that were given, named as ``fit`` wants them."""
    return {
        name.removeprefix(_PREFIX): value
        for name, value in params.items()
        if name.startswith(_PREFIX) and value is not None
    }
