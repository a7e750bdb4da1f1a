"""One typed function per family, for ``sysid/fluidact_fit/family_fits.py`` (``make docs``).

Signature and help come from the declared options of the family; what all families share is
explained once, by ``fit``, ``read_log`` and ``Reading``.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator

import fluidact_fit as ff
from fluidact_fit.families import fit_function
from fluidact_fit.family import Family, FamilyOptions, Variant
from fluidact_fit.logs import Reading
from fluidact_fit.options import Option, describe

_WIDTH = 100
_NOT_SHARED = {"family", "logs", "options", "command", "holds"}  # a fit has hold
_KINDS = {"float": "float", "int": "int", "flag": "bool", "text": "str | int",
          "range": "tuple[float, float]"}  # fmt: skip
_OF_FIT = "As in :func:`.fit`."
_OF_LOGS = "How logs are read: as in :func:`.read_log` and :class:`.logs.Reading`."


def names() -> str:
    """The value of ``__all__``."""
    listed = ", ".join(f'"{fit_function(name)}"' for name in sorted(ff.family_names()))
    return "\n".join(["__all__ = [", *_wrapped(listed, 4), "]"])


def functions() -> str:
    """The functions of all families, in the order of the registry."""
    return "\n".join(line for name in ff.family_names() for line in _function(ff.get_family(name)))


def _function(family: Family[FamilyOptions]) -> Iterator[str]:
    options = describe(family.options_type)
    yield ""
    yield ""
    yield f"def {fit_function(family.name)}("
    parts = [f"logs: {_annotation('logs')}", "*", *map(_keyword, options), *_shared().values()]
    yield from _filled(parts)
    yield ") -> FitResult:"
    title = family.title.rstrip(".")
    yield f'    """{title}.'
    yield ""
    yield "    ::"
    yield ""
    yield from _wrapped(family.equation, 8)
    for variant in family.variants:
        of = f" ({variant.name})" if len(family.variants) > 1 else ""
        yield ""
        yield from _wrapped(f"Roles{of}: {_roles(variant)}.", 4)
        yield ""
        parameters = ", ".join(f"``{p.name}`` [{p.unit}]" for p in variant.parameters)
        yield from _wrapped(f"Parameters of the result{of}: {parameters}.", 4)
    yield from ["", "    Parameters", "    ----------"]
    yield from _entry("logs", "Paths, DataFrames, mappings of header to array, or read logs.")
    for option in options:
        yield from _entry(option.name.replace("-", "_"), _about(option))
    for text in (_OF_FIT, _OF_LOGS):
        shared = [n for n in _shared() if (n in Reading.__annotations__) is (text == _OF_LOGS)]
        for line in _wrapped(", ".join(shared), 4):
            yield from _entry(line.strip().rstrip(","), text)
    yield from ["", "    Returns", "    -------", "    FitResult"]
    yield from ["", "    Raises", "    ------"]
    yield from (f"    {line}" for line in _section(ff.fit, "Raises"))
    yield '    """'
    yield f'    return fit("{family.name}", **locals())'


def _roles(variant: Variant) -> str:
    units = [" or ".join((role.unit, *role.alternatives)) for role in variant.roles]
    optional = ["" if role.required else " (optional)" for role in variant.roles]
    return ", ".join(
        f"``{role.name}`` [{unit}]{said}"
        for role, unit, said in zip(variant.roles, units, optional)
    )


# ------------------------------------------------------------------------------- keywords


def _keyword(option: Option) -> str:
    choices = ", ".join(f'"{choice}"' for choice in option.choices)
    kind = f"Literal[{choices}]" if choices else _KINDS[option.kind]
    if option.kind == "float" and option.unit:
        kind += " | str"  # with its unit
    default = f'"{option.default}"' if isinstance(option.default, str) else repr(option.default)
    optional = " | None" if option.default is None else ""
    return f"{option.name.replace('-', '_')}: {kind}{optional} = {default}"


def _about(option: Option) -> str:
    """Help of an option, with the range and unit of a number."""
    said = f": {option.expected}" if option.kind in ("float", "int", "range") else ""
    return f"{option.help[:1].upper()}{option.help[1:]}{said}."


def _annotation(name: str) -> str:
    return str(inspect.signature(ff.fit).parameters[name].annotation)


def _shared() -> dict[str, str]:
    """What every fit takes: keyword to its declaration."""
    own = inspect.signature(ff.fit).parameters
    found = {n: f"{n}: {p.annotation} = {p.default!r}" for n, p in own.items()}
    for name, kind in Reading.__annotations__.items():
        found.setdefault(name, f"{name}: {kind.__forward_arg__} = None")
    return {name: text for name, text in found.items() if name not in _NOT_SHARED}


def _section(documented: Callable[..., object], title: str) -> list[str]:
    """Lines of a section of a docstring."""
    text = inspect.getdoc(documented) or ""
    body = re.search(rf"^{title}\n-+\n(.*?)(?=\n\n|\Z)", text, re.DOTALL | re.MULTILINE)
    return body[1].splitlines() if body else []


# ------------------------------------------------------------------------------- lines


def _entry(name: str, text: str) -> list[str]:
    return [f"    {name}", *_wrapped(text, 8)]


def _wrapped(text: str, indent: int) -> list[str]:
    margin = " " * indent
    return textwrap.wrap(text, _WIDTH, initial_indent=margin, subsequent_indent=margin,
                         break_long_words=False, break_on_hyphens=False)  # fmt: skip


def _filled(parts: list[str]) -> Iterator[str]:
    """Parameters of a signature, as many on a line as it holds."""
    line = "   "
    for part in parts:
        if len(line) + len(part) + 2 > _WIDTH:
            yield line
            line = "   "
        line += f" {part},"
    yield line
