"""The keys of a controller: from a ROS 2 declaration, a C header or a plain list."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

from ..errors import ConsumerError, ParameterFileError
from ..files import open_regular
from ..parameters.yaml_io import parse_yaml
from .c_header import BRACKETS, names_in

_MAX_BYTES = 10_000_000
_HEADERS = (".h", ".hpp", ".hh", ".hxx", ".c", ".cpp", ".cc", ".ino")
_YAML = (".yaml", ".yml")

_HASH = re.compile(r"SHA-256 of the file: ([0-9a-f]{64})\b")
_LISTED = re.compile(
    r"(?P<name>[A-Za-z_][\w.-]*)\s*(?:\[(?P<unit>[^\]]*)\]|[,;\t](?P<cell>.*))?\s*"
)


@dataclass(frozen=True)
class Key:
    """A key that a controller reads; ``unit`` is empty where its list does not say.

    ``surely`` is false of what C code may hold for any purpose: a key only where the parameter
    file has one of that name. ``value`` is what the code gives it, as it is written.
    """

    name: str
    unit: str = ""
    surely: bool = True
    value: str = field(default="", compare=False)


def hashes_in(path: str | os.PathLike[str]) -> frozenset[str]:
    """SHA-256 of the files that a controller's file says it was exported from."""
    return frozenset(_HASH.findall(_text(os.fspath(path))))


def read_consumer(path: str | os.PathLike[str]) -> list[Key]:
    """Read the keys of a controller.

    Parameters
    ----------
    path
        A declaration of generate_parameter_library (``.yaml``), with units in square brackets in
        the descriptions; a C or C++ header, with units in the comments beside or above; or a
        list of ``name [unit]`` or ``name,unit``.

    Returns
    -------
    list of Key
        In the order of the file.

    Raises
    ------
    ConsumerError
        When the file cannot be read or holds no keys.
    """
    where = os.fspath(path)
    text, suffix = _text(where), PurePath(where).suffix.lower()
    if suffix in _YAML:
        keys = list(_declared(_mapping(text, where)))
        kind = "keys with a type, as a declaration of generate_parameter_library has them"
    elif suffix in _HEADERS:
        keys = [Key(*found) for found in names_in(text)]
        kind = "#define NAME value, constants, variables or members"
    else:
        keys = list(_lines(text, where))
        kind = "name [unit] on each line"
    if not keys:
        raise ConsumerError("holds no keys.", where=where, expected=f"Expected {kind}.")
    return list({(key, key.value): key for key in keys}.values())


def _text(where: str) -> str:
    try:
        with open_regular(where) as file:
            content = file.read(_MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise ConsumerError(
            f"cannot be read: {reason}.", where=where, remedy="Check the name of the file."
        ) from None
    if len(content) > _MAX_BYTES or b"\0" in content:
        raise ConsumerError(
            "is binary, or too large for a list of keys.",
            where=where,
            remedy="Give the declaration, header or list that the controller is built with.",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


# --------------------------------------------------------------------------- ROS 2


def _mapping(text: str, where: str) -> Mapping[str, Any]:
    try:
        return parse_yaml(text, where).data
    except ParameterFileError as error:
        raise ConsumerError(
            "; ".join(words for _, words in error.problems) + ".",
            where=error.where,
            expected="Expected a declaration of generate_parameter_library.",
        ) from None


def _declared(tree: Mapping[str, Any]) -> Iterator[Key]:
    """Yield the leaves below the namespace: mappings with a type."""
    for part in tree.values():
        if isinstance(part, Mapping):
            yield from _leaves(part, "")


def _leaves(tree: Mapping[str, Any], above: str) -> Iterator[Key]:
    for name, part in tree.items():
        if not isinstance(part, Mapping):
            continue
        if isinstance(part.get("type"), str):
            units = BRACKETS.findall(str(part.get("description", "")))
            unit = units[-1].strip() if units else ""
            yield Key(above + name, unit, value=_default(part.get("default_value")))
        else:
            yield from _leaves(part, f"{above}{name}.")


def _default(value: Any) -> str:
    """A default value of a declaration as code writes it; empty for what is no number or text."""
    if isinstance(value, str):
        return value
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in numbers):
        return ""
    return ", ".join(map(repr, numbers))


# ---------------------------------------------------------------------------- list


def _lines(text: str, where: str) -> Iterator[Key]:
    for number, line in enumerate(text.splitlines(), 1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        match = _LISTED.fullmatch(line)
        if match is None:
            raise ConsumerError(
                f"{line[:60]!r} is not a key.",
                where=f"{where}, line {number}",
                expected="Expected name [unit] or name,unit on each line.",
            )
        unit = match["unit"] if match["unit"] is not None else match["cell"] or ""
        key = Key(match["name"], unit.strip().strip('"[]').strip())
        if (key.name.lower(), key.unit.lower()) not in (("name", "unit"), ("key", "unit")):
            yield key
