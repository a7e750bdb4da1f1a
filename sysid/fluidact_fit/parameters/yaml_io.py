"""The only YAML reader and writer.

What a file can hold is plain data: dicts, lists, text and numbers. The reader takes the safe
core of YAML 1.2 and nothing else; the writer keeps to the text on which YAML 1.1 and YAML 1.2
readers agree.
"""

from __future__ import annotations

import dataclasses
import io
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.resolver import BaseResolver

from ..errors import ParameterFileError, visible
from ..files import open_regular
from .problems import Location, Problems

MAX_BYTES = 10_000_000
MAX_DEPTH = 32
MAX_NODES = 100_000  # keys and values; a fit of a thousand logs has fewer
_MAX_KEY = 200  # YAML allows 1024, but a key of that size is a mistake
_TAG = "tag:yaml.org,2002:"
_DIRECTIVE = re.compile(r"^%([A-Za-z]*)", re.MULTILINE)

# ---------------------------------------------------------------------------- reading


@dataclass(frozen=True)
class YamlText:
    """Content of a YAML text: its data, and the line of every entry, counted from 1.

    ``problems`` is what strict reading objects to: duplicate keys, tags, anchors.
    """

    data: Any
    problems: Problems
    lines: Mapping[Location, int]


def read_yaml(path: str | os.PathLike[str]) -> YamlText:
    """Read a YAML file strictly; ``ParameterFileError`` when it cannot be, as UTF-8 text."""
    where = os.fspath(path)
    if os.path.isdir(where):
        raise _refusal(where, "is a directory", "Give the parameter file inside it.")
    try:
        with open_regular(where) as file:
            content = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _refusal(where, "does not exist", "Check the name of the file.") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        remedy = "Check the name and the permissions of the file."
        raise _refusal(where, f"cannot be read: {reason}", remedy) from None
    if len(content) > MAX_BYTES:
        raise _refusal(where, f"is larger than {MAX_BYTES // 1_000_000} MB, too large to be one")
    if b"\0" in content:
        raise _refusal(where, "is binary, not text", "Give a parameter file (.yaml).")
    try:
        return parse_yaml(content.decode("utf-8-sig"), where)
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        remedy = "Save the file as UTF-8."
        raise _refusal(f"{where}, line {line}", "is not UTF-8 text", remedy) from None


def parse_yaml(text: str, where: str) -> YamlText:
    """Parse YAML strictly; ``where`` names the file in errors (``ParameterFileError``).

    Refused are more than one document, aliases, nesting deeper than ``MAX_DEPTH``, more than
    ``MAX_NODES`` keys and values, and anything but a mapping at the top.
    """
    found = _parse(_Loader, text, where)
    if not isinstance(found.data, dict):
        raise _refusal(where, "is not a mapping of keys to values")
    return found


def parse_yaml_table(text: str, where: str) -> YamlText:
    """Parse YAML as strictly, of any shape and size, with every number as the text it is.

    In a table of names ``0017`` and ``1.50`` are words: no number of digits may be lost.
    """
    return _parse(_TableLoader, text, where)


def _parse(kind: type[_Loader], text: str, where: str) -> YamlText:
    _refuse_directives(text, where)
    try:
        loader: Any = kind(text, where)
        if not loader.check_data():
            raise _refusal(where, "is empty")
        data = loader.get_data()
        if loader.check_data():
            raise _refusal(where, "holds a second document", "Keep one document per file.")
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        reason = f"is not YAML: {error.problem or error.context or 'cannot be parsed'}"
        if "nesting depth" in reason:  # libyaml reads ahead, and has a limit of its own
            reason = f"is nested deeper than {MAX_DEPTH} levels"
        raise _refusal(f"{where}{line}", reason) from None
    except yaml.YAMLError as error:
        raise _refusal(where, f"is not YAML: {str(error).splitlines()[0]}") from None
    return YamlText(data, loader.problems, loader.lines)


def _refuse_directives(text: str, where: str) -> None:
    """Refuse directives other than the version: libyaml compares every tag with all before it."""
    for found in _DIRECTIVE.finditer(text):
        if found[1] != "YAML":
            line = text.count("\n", 0, found.start()) + 1
            raise _refusal(f"{where}, line {line}", "has a directive; remove the lines with %")


def _refusal(where: str, what: str, remedy: str = "") -> ParameterFileError:
    remedy = remedy or "Give a parameter file written by fluidact-fit."
    return ParameterFileError(where, [("", what)], remedy)


class _Loader(Composer, SafeConstructor, BaseResolver):
    """PyYAML's safe loader, stricter, and with the scalars of YAML 1.2.

    It watches the nodes being composed, where places and lines are still known. What is
    only a flaw is noted as a problem, and the entry taken as if it were not there.
    """

    most = MAX_NODES

    def __init__(self, text: str, where: str) -> None:
        # libyaml is ten times faster, but not every PyYAML is built with it.
        parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)(text)
        self.check_event, self.peek_event = parser.check_event, parser.peek_event
        self.get_event = parser.get_event
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        BaseResolver.__init__(self)
        self.where, self.problems = where, Problems()
        self.place: Location = ()
        self.lines: dict[Location, int] = {}
        self.nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        above, key = self.place, isinstance(parent, yaml.MappingNode) and index is None
        if isinstance(event, yaml.AliasEvent):
            remedy = "Write the value out where it is used."
            raise self._fatal(event, f"has an alias, {event.anchor!r}", remedy)
        if key and not isinstance(event, yaml.ScalarEvent):
            raise self._fatal(event, "has a list or mapping as a key", "Keys are words.")
        if parent is not None:
            part = event.value if key else index.value if isinstance(index, yaml.Node) else index
            self.place = (*above, part)
        self.nodes += 1
        if self.nodes > self.most:
            raise self._fatal(event, f"goes beyond {self.most} keys and values, too many for one")
        if len(self.place) > MAX_DEPTH:
            raise self._fatal(event, f"is nested deeper than {MAX_DEPTH} levels")
        self._note(event, key)
        if isinstance(event, yaml.ScalarEvent):
            compose: Any = self.compose_scalar_node  # mistyped in the stubs
            node: yaml.Node | None = compose(event.anchor)
        else:
            node = super().compose_node(parent, index)
        self.place = above
        return node

    def _note(self, event: Any, key: bool) -> None:
        if event.anchor is not None:
            self.problems.add(self.place, f"has an anchor, {event.anchor!r}; remove it")
        if event.tag is not None:
            self.problems.add(self.place, f"has a tag, {event.tag!r}; remove it")
        event.anchor = event.tag = None
        line = event.start_mark.line + 1
        resolve: Any = self.resolve
        if key and resolve(yaml.ScalarNode, event.value, event.implicit) != f"{_TAG}str":
            self.problems.add(self.place, "key is not text; put it in quotes")
        if key and self.place in self.lines and not self._within_problem():
            lines = f"lines {self.lines[self.place]} and {line}"
            self.problems.add(self.place, f"duplicate key in {lines}")
        self.lines.setdefault(self.place, line)

    def _within_problem(self) -> bool:
        """Return whether something above the present place is a problem already."""
        return any(self.place[:size] in self.problems.found for size in range(len(self.place)))

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        mapping: dict[Any, Any] = {}
        for key, value in node.value:  # of two entries of one name the first is kept
            mapping.setdefault(key.value, self.construct_object(value, deep))
        return mapping

    def _fatal(self, event: Any, what: str, remedy: str = "") -> ParameterFileError:
        return _refusal(f"{self.where}, line {event.start_mark.line + 1}", what, remedy)


_DIGITS = "-+0123456789"
for _kind, _form, _first in (
    ("null", r"(~|null|Null|NULL|)\Z", ["~", "n", "N", ""]),
    ("bool", r"(true|True|TRUE|false|False|FALSE)\Z", "tTfF"),
    ("int", r"[-+]?(0|[1-9][0-9]{0,3999})\Z", _DIGITS),
    (
        "float",
        r"[-+]?(([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+"
        r"|[1-9][0-9]{4000,}|\.(inf|Inf|INF))\Z|\.(nan|NaN|NAN)\Z",  # Python reads 4300 digits
        f"{_DIGITS}.",
    ),
):
    _Loader.add_implicit_resolver(f"{_TAG}{_kind}", re.compile(_form), list(_first))


class _TableLoader(_Loader):
    """The same without numbers."""

    most = 50 * MAX_NODES
    yaml_implicit_resolvers = {  # noqa: RUF012 (as the class above has them)
        first: [(tag, form) for tag, form in known if tag not in (f"{_TAG}int", f"{_TAG}float")]
        for first, known in _Loader.yaml_implicit_resolvers.items()
    }


# ---------------------------------------------------------------------------- writing

_HEADER = "# Written by fluidact-fit. All values are SI.\n"
_WIDTH = 175  # a parameter with value, error and interval stays on one line

# What every reader takes for text without quotes. Everything doubtful is quoted.
_PLAIN = re.compile(r"[A-Za-z/_]([A-Za-z0-9_./()+*^%=@ -]*[A-Za-z0-9_./()+*^%=@-])?")
# "y" and "n" are booleans to the letter of YAML 1.1: a unit of N goes in quotes.
_DOUBTFUL = frozenset(("null", "true", "false", "yes", "no", "on", "off", "y", "n", "nan", "inf"))


class _Dumper(yaml.SafeDumper):
    """PyYAML's safe dumper, with doubtful text in quotes and short parts on one line."""

    def represent_str(self, text: str) -> yaml.ScalarNode:
        plain = _PLAIN.fullmatch(text) and text.lower() not in _DOUBTFUL
        return self.represent_scalar(f"{_TAG}str", text, None if plain else '"')

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def check_simple_key(self) -> bool:
        return True  # PyYAML takes only shorter ones for simple

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)  # lists stand farther in than their key


_Dumper.add_representer(str, _Dumper.represent_str)


def _set_style(node: Any, depth: int = 0, column: int = 0) -> int:
    """Choose between one line and several for a node; return its width on one line.

    The top two levels stand on several, so that each parameter has a line of its own;
    below them whatever fits stands on one, and so do the rows of a list of lists.
    """
    if isinstance(node, yaml.ScalarNode):
        return len(node.value) + 2 * bool(node.style)
    if isinstance(node, yaml.MappingNode):
        at = {key: 2 * depth + len(key.value) + 2 for key, _ in node.value}
        width = sum(at[k] - 2 * depth + _set_style(v, depth + 1, at[k]) + 2 for k, v in node.value)
        node.flow_style = not node.value or (depth > 1 and column + width <= _WIDTH)
        return width
    width = sum(_set_style(item, depth + 1, 2 * depth + 2) + 2 for item in node.value)
    inner = {type(item) for item in node.value} - {yaml.ScalarNode}
    node.flow_style = not inner or (yaml.MappingNode not in inner and column + width <= _WIDTH)
    return width


def dump_yaml(document: Mapping[str, Any]) -> str:
    """Return a document as YAML text that every YAML reader reads alike.

    ``ParameterFileError`` when something in it is not finite, or no number, text, list or mapping.
    """
    plain = to_plain(document)
    problems = Problems()
    check_plain(plain, problems)
    if problems.found:
        raise ParameterFileError("the document", problems.listed({}))
    node = _Dumper(io.StringIO(), sort_keys=False).represent_data(plain)
    _set_style(node)
    text: str = yaml.serialize(node, Dumper=_Dumper, width=_WIDTH, allow_unicode=True)
    # What people would not see stands in quotes, where its escape means the same character.
    return _HEADER + visible(text)


# ------------------------------------------------------------------------- plain data


def to_plain(value: Any) -> Any:
    """Return a value as plain dicts, lists, text and numbers.

    Numpy scalars and arrays, tuples, paths and dataclasses are converted; keys whose
    value is ``None`` are left out. Anything else is returned as it is.
    """
    if isinstance(value, Mapping):
        return {to_plain(k): to_plain(v) for k, v in value.items() if v is not None}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, (np.ndarray, np.generic)):
        return to_plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    if isinstance(value, Path):
        value = os.fspath(value)
    if isinstance(value, str):
        # File names may carry bytes that are not UTF-8 as lone surrogates; no YAML holds those.
        return str(value).encode("utf-8", "surrogatepass").decode("utf-8", "replace")
    return value


def check_plain(value: Any, problems: Problems, place: Location = ()) -> None:
    """Note everything in a value that a parameter file cannot hold."""
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                problems.add((*place, str(key)), "key is not text")
            elif len(key) > _MAX_KEY:
                problems.add((*place, key), f"key is longer than {_MAX_KEY} characters")
            else:
                check_plain(item, problems, (*place, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            check_plain(item, problems, (*place, index))
    elif value is None:
        problems.add(place, "is empty; give a value or remove the key")
    elif isinstance(value, float) and not math.isfinite(value):
        problems.add(place, f"{value} is not finite")
    elif not isinstance(value, (str, int, float)):
        problems.add(place, f"a {type(value).__name__} cannot stand in a parameter file")
