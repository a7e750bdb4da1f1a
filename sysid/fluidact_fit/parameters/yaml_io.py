"""The only YAML reader and writer.

The reader takes the safe core of YAML 1.2 and nothing else. The writer keeps to the text
on which YAML 1.1 and YAML 1.2 readers agree.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..errors import ParameterFileError
from .problems import Location, Problems

MAX_BYTES = 10_000_000
MAX_DEPTH = 32
HEADER = "# Written by fluidact-fit. All values are SI."

# ---------------------------------------------------------------------------- reading

_INT = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+")
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), math.inf),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), -math.inf),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), math.nan),
}


@dataclass(frozen=True)
class YamlText:
    """What a YAML text holds.

    Attributes
    ----------
    data
        The top-level mapping.
    problems
        What strict reading objects to: duplicate keys, tags, anchors.
    lines
        Line of every entry, counted from 1.
    """

    data: dict[str, Any]
    problems: Problems
    lines: Mapping[Location, int]


def read_yaml(path: str | os.PathLike[str]) -> YamlText:
    """Read a YAML file strictly.

    Raises
    ------
    ParameterFileError
        When the file cannot be read, or is not UTF-8 YAML with a mapping at the top.
    """
    where = os.fspath(path)
    content = _read_bytes(where)
    if b"\0" in content:
        raise _refusal(where, "is binary, not text", "Give a parameter file (.yaml).")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise _refusal(
            f"{where}, line {line}", "is not UTF-8 text", "Save the file as UTF-8."
        ) from None
    return parse_yaml(text, where)


def parse_yaml(text: str, where: str) -> YamlText:
    """Parse YAML strictly; ``where`` names the file in errors.

    Raises
    ------
    ParameterFileError
        When the text is not YAML, has more than one document, an alias, nesting deeper
        than ``MAX_DEPTH``, or anything but a mapping at the top.
    """
    # libyaml is ten times faster, but not every PyYAML is built with it.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        return _Composer(where, yaml.parse(text, Loader=loader)).compose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        reason = error.problem or error.context or "cannot be parsed"
        raise _refusal(f"{where}{line}", f"is not YAML: {reason}") from None
    except yaml.YAMLError as error:
        reason = str(error).splitlines()[0]
        raise _refusal(where, f"is not YAML: {reason}") from None


def _read_bytes(where: str) -> bytes:
    if os.path.isdir(where):
        raise _refusal(where, "is a directory", "Give the parameter file inside it.")
    try:
        with open(where, "rb") as file:
            content = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _refusal(where, "does not exist", "Check the name of the file.") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise _refusal(
            where, f"cannot be read: {reason}", "Check the name and the permissions of the file."
        ) from None
    if len(content) > MAX_BYTES:
        raise _refusal(where, f"is larger than {MAX_BYTES // 1_000_000} MB, too large to be one")
    return content


def _refusal(where: str, what: str, remedy: str = "") -> ParameterFileError:
    return ParameterFileError(
        where, [("", what)], remedy or "Give a parameter file written by fluidact-fit."
    )


class _Composer:
    """Builds plain data from parse events.

    PyYAML's own composer follows aliases and merges, and drops duplicate keys and line
    numbers; working from its events leaves none of that to undo.
    """

    def __init__(self, where: str, events: Iterator[Any]) -> None:
        self.where = where
        self.events = events
        self.problems = Problems()
        self.lines: dict[Location, int] = {}

    def compose(self) -> YamlText:
        next(self.events)  # stream start
        if isinstance(next(self.events), yaml.StreamEndEvent):
            raise _refusal(self.where, "is empty")
        data = self._node(next(self.events), ())
        next(self.events)  # document end
        following = next(self.events)
        if not isinstance(following, yaml.StreamEndEvent):
            raise self._fatal(following, "holds a second document", "Keep one document per file.")
        if not isinstance(data, dict):
            raise _refusal(self.where, "is not a mapping of keys to values")
        return YamlText(data, self.problems, self.lines)

    def _node(self, event: Any, location: Location) -> Any:
        self._check(event, location)
        self.lines.setdefault(location, event.start_mark.line + 1)
        if isinstance(event, yaml.ScalarEvent):
            return event.value if event.style else _resolve(event.value)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
                items.append(self._node(event, (*location, len(items))))
            return items
        return self._mapping(location)

    def _mapping(self, location: Location) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            key = self._key(event, location)
            place = (*location, key)
            line = event.start_mark.line + 1
            if key not in mapping:
                self.lines[place] = line
                mapping[key] = self._node(next(self.events), place)
                continue
            first = self.lines[place]
            # The first one stands, and so do its lines.
            kept, self.lines = self.lines, {}
            self._node(next(self.events), place)
            self.lines = kept
            self.problems.add(place, f"duplicate key in lines {first} and {line}")
        return mapping

    def _key(self, event: Any, location: Location) -> str:
        if not isinstance(event, yaml.ScalarEvent):
            if isinstance(event, yaml.AliasEvent):
                self._check(event, location)
            raise self._fatal(event, "has a list or mapping as a key", "Keys are words.")
        self._check(event, (*location, event.value))
        if not event.style and not isinstance(_resolve(event.value), str):
            self.problems.add((*location, event.value), "key is not text; put it in quotes")
        return str(event.value)

    def _check(self, event: Any, location: Location) -> None:
        if isinstance(event, yaml.AliasEvent):
            raise self._fatal(
                event, f"has an alias (*{event.anchor})", "Write the value out where it is used."
            )
        if len(location) > MAX_DEPTH:
            raise self._fatal(event, f"is nested deeper than {MAX_DEPTH} levels")
        if event.anchor is not None:
            self.problems.add(location, f"has an anchor (&{event.anchor}); remove it")
        if event.tag is not None:
            self.problems.add(location, f"has a tag ({event.tag}); remove it")

    def _fatal(self, event: Any, what: str, remedy: str = "") -> ParameterFileError:
        return _refusal(f"{self.where}, line {event.start_mark.line + 1}", what, remedy)


def _resolve(text: str) -> Any:
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        try:
            return int(text)
        except ValueError:  # more digits than Python converts
            return math.inf
    if _FLOAT.fullmatch(text):
        return float(text)
    return text


# ---------------------------------------------------------------------------- writing

_WIDTH = 100
_MAPPING_WIDTH = 160  # a parameter with value, error and interval stays on one line
_MAX_KEY = 200  # YAML allows 1024, but a key of that size is a mistake

# What every reader takes for text without quotes. Everything doubtful is quoted.
_PLAIN = re.compile(r"[A-Za-z/_]([A-Za-z0-9_./()+*^%=@ -]*[A-Za-z0-9_./()+*^%=@-])?")
# "y" and "n" are booleans to the letter of YAML 1.1: a unit of N goes in quotes.
_DOUBTFUL = frozenset(("null", "true", "false", "yes", "no", "on", "off", "y", "n", "nan", "inf"))
_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}


def to_plain(value: Any) -> Any:
    """Return a value as plain dicts, lists, text and numbers.

    Numpy scalars and arrays, tuples, paths and dataclasses are converted; keys whose
    value is ``None`` are left out. Anything else is returned as it is.
    """
    if isinstance(value, Mapping):
        return {_clean(k): to_plain(v) for k, v in value.items() if v is not None}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, np.ndarray):
        return to_plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value)
    if isinstance(value, Path):
        return _clean(os.fspath(value))
    return _clean(value)


def _clean(value: Any) -> Any:
    # File names may carry bytes that are not UTF-8 as lone surrogates; no YAML holds those.
    if isinstance(value, str):
        return str(value).encode("utf-8", "surrogatepass").decode("utf-8", "replace")
    return value


def check_plain(value: Any, problems: Problems, location: Location = ()) -> None:
    """Note everything in a value that a parameter file cannot hold."""
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                problems.add((*location, str(key)), "key is not text")
            elif len(key) > _MAX_KEY:
                problems.add((*location, key), f"key is longer than {_MAX_KEY} characters")
            else:
                check_plain(item, problems, (*location, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            check_plain(item, problems, (*location, index))
    elif value is None:
        problems.add(location, "is empty; give a value or remove the key")
    elif isinstance(value, float):
        if not math.isfinite(value):
            problems.add(location, f"{value} is not finite")
    elif not isinstance(value, (str, int)):
        problems.add(location, f"a {type(value).__name__} cannot stand in a parameter file")


def dump_yaml(document: Mapping[str, Any]) -> str:
    """Return a document as YAML text that every YAML reader reads alike.

    Short mappings and lists stand on one line; those at the top two levels do not, so
    that each parameter has a line of its own.

    Raises
    ------
    ParameterFileError
        When something in it is not finite, or neither number, text, list nor mapping.
    """
    plain = to_plain(document)
    problems = Problems()
    check_plain(plain, problems)
    if problems.found:
        raise ParameterFileError("the document", problems.listed({}))
    return "\n".join((HEADER, *_mapping_lines(plain, 0))) + "\n"


def _mapping_lines(mapping: dict[str, Any], depth: int) -> list[str]:
    lines: list[str] = []
    keys = {key: _scalar(key) for key in mapping}
    texts = {key: _one_line(item, depth + 1) for key, item in mapping.items()}
    table = len(mapping) > 1 and all(isinstance(item, dict) for item in mapping.values())
    pad = max(map(len, keys.values())) if table and None not in texts.values() else 0
    for key, item in mapping.items():
        text = texts[key]
        if text is None:
            lines.append(f"{keys[key]}:")
            lines += ["  " + line for line in _lines(item, depth + 1)]
        else:
            lines.append(f"{keys[key] + ':':<{pad + 1}} {text}")
    return lines


def _lines(value: Any, depth: int) -> list[str]:
    text = _one_line(value, depth)
    if text is not None:
        return [text]
    if isinstance(value, dict):
        return _mapping_lines(value, depth)
    if not any(isinstance(item, (dict, list)) for item in value):
        return _wrapped([_flow(item) for item in value])
    lines: list[str] = []
    for item in value:
        first, *rest = _lines(item, depth + 1)
        lines += ["- " + first, *("  " + line for line in rest)]
    return lines


def _one_line(value: Any, depth: int) -> str | None:
    """Return the value on one line, ``None`` when it reads better on several."""
    if isinstance(value, dict):
        if value and depth < 2:
            return None
        text = _flow(value)
        return text if len(text) <= _MAPPING_WIDTH else None
    if isinstance(value, list):
        if any(isinstance(item, dict) for item in value):
            return None
        text = _flow(value)
        return text if len(text) <= _WIDTH else None
    return _scalar(value)


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_scalar(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return _scalar(value)


def _wrapped(items: list[str]) -> list[str]:
    lines, line = [], "["
    for item, following in pairwise((*items, "")):
        if len(line) > 1 and len(line) + len(item) > _WIDTH:
            lines.append(line.rstrip())
            line = " "
        line += item + (", " if following else "]")
    return [*lines, line]


def _scalar(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _float(value)
    if isinstance(value, int):
        return str(value)
    text = str(value)
    if _PLAIN.fullmatch(text) and text.lower() not in _DOUBTFUL:
        return text
    return '"' + "".join(map(_escape, text)) + '"'


def _float(value: float) -> str:
    # YAML 1.1 takes 1e-07 for text: it wants both a decimal point and a signed exponent.
    mantissa, mark, exponent = repr(value).partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return mantissa + mark + exponent


def _escape(character: str) -> str:
    if character in _ESCAPES:
        return _ESCAPES[character]
    if character.isprintable():
        return character
    code = ord(character)
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
