"""The numbers that C and C++ code is built with: read as text, neither compiled nor run."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ..units import is_unit, looks_like_unit

BRACKETS = re.compile(r"\[([^\[\]]{0,60})\]")
_OPENING = re.compile(r"/\*|//|[\"']")
_QUOTED = {sign: re.compile(rf"{sign}(?:[^{sign}\\\n]|\\.)*+", re.DOTALL) for sign in "\"'"}
_ENDINGS = re.compile(r"[ \t;,})]*+")  # between a declaration and the comment behind it
_ATTRIBUTE = re.compile(r"__attribute__\s*\(\([^()\n]{0,80}(?:\([^()\n]{0,80}\))?\s*\)\)")
_DIRECTIVE = re.compile(r"^[ \t]*#[^\n]*", re.MULTILINE)
_DEFINE = re.compile(
    r"^[ \t]*#[ \t]*define[ \t]+(?P<name>[A-Za-z_]\w*)[ \t]+(?P<value>[-+({.0-9][^\n]*)",
    re.MULTILINE,
)
_QUALIFIERS = "(?:static|extern|const|constexpr|constinit|volatile|inline)"
_NUMBERS = (
    r"(?:(?:long[ \t]+)?double|float(?:32|64)?(?:_t)?|real(?:32|64)?_[tT]|auto"
    r"|(?:std::)?u?int(?:8|16|32|64)?(?:_t)?|std::(?:array|vector)<[^<>;]{1,60}>)"
)
_DECLARED = re.compile(
    rf"(?:^|(?<=[{{}}:\n]))[ \t]*(?P<before>(?:{_QUALIFIERS}[ \t]+)*){_NUMBERS}"
    rf"(?P<behind>(?:[ \t]+{_QUALIFIERS})*)[ \t]+(?:PROGMEM[ \t]+)?(?=[A-Za-z_])"
)
_DECLARATOR = re.compile(
    r"\s*(?P<name>[A-Za-z_]\w*+)\s*+(?:\[[^\]\n]{0,40}\]\s*+)*+(?:[A-Z]{2,}+\s*+)?(?P<value>[={].*)?",
    re.DOTALL,
)
_MEMBER = re.compile(r"(?<=[{,\n])[ \t]*\.(?P<name>[A-Za-z_]\w*)[ \t]*=(?!=)[^,}\n]*")
_NOT_LINE = re.compile(r"[^\n]")
_WHOLE = re.compile(r"[-+( \t]*\d+[uUlL]*[ \t)]*")
_SCALE = "_EXPONENT"  # of fixed point: says how a number is held, not what it is


class Named(NamedTuple):
    """A name with the unit in the comment beside or above it.

    ``surely`` is false of what may be anything: a variable without a value or a unit, a whole
    number.
    """

    name: str
    unit: str
    surely: bool
    value: str = ""


class _Place(NamedTuple):
    """Position of a name, end of its declaration, and whether it is a fractional constant."""

    start: int
    end: int
    name: str
    constant: bool
    value: str


def names_in(text: str) -> Iterator[Named]:
    """Yield macros, constants, variables and members in the order of the text.

    Every branch of ``#if`` is read. What stands in comments, in texts and in the bodies of
    functions is not, nor are arguments of functions.
    """
    text = _ATTRIBUTE.sub(_blank, text.replace("\r\n", "\n").replace("\\\n", "  "))
    units = _Units.of(text)
    for place in sorted({*_macros(units.code), *_declared(units.code)}):
        if not place.name.endswith(_SCALE):
            unit = units.behind(place.end) or units.above(place.start)
            yield Named(place.name, unit, place.constant or bool(unit), place.value)


# ------------------------------------------------------------------------------- comments


@dataclass(frozen=True)
class _Units:
    """Code with blanks for comments and texts, where its lines end, and the comments."""

    code: str
    lines: list[int]
    starts: list[int]
    ends: list[int]
    words: list[str]
    known: dict[tuple[int, int], str] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str) -> _Units:
        found = list(_lexemes(text))
        comments = [x for x in found if text[x.start] == "/"]
        words = [text[x.start + 2 : x.end].removesuffix("*/") for x in comments]
        lines = [-1, *(m.start() for m in re.finditer("\n", text)), len(text)]
        places = [x.start for x in comments], [x.end for x in comments]
        return cls(_blanked(text, found), lines, *places, words)

    def behind(self, end: int) -> str:
        """Unit in the comment that follows a declaration on its line."""
        line, k = bisect_left(self.lines, end), bisect_left(self.starts, end)
        if k == len(self.starts) or self.starts[k] > self.lines[line]:
            return ""
        between = _ENDINGS.match(self.code, end, self.starts[k])
        whole = between is not None and between.end() == self.starts[k]
        return _unit_of(self.words[k]) if whole else ""

    def above(self, start: int) -> str:
        """Unit in the comments that stand alone on the lines above."""
        line, k = bisect_left(self.lines, start) - 1, bisect_left(self.starts, start) - 1
        if (line, k) not in self.known:
            self.known[line, k] = self._above(line, k)
        return self.known[line, k]

    def _above(self, line: int, k: int) -> str:
        while k >= 0 and bisect_left(self.lines, self.ends[k]) == line:
            line = bisect_left(self.lines, self.starts[k]) - 1
            if self.code[self.lines[line] + 1 : self.starts[k]].strip():
                return ""
            unit = _unit_of(self.words[k])
            if unit == "1" or looks_like_unit(unit):
                return unit
            k -= 1
        return ""


class _Lexeme(NamedTuple):
    """Extent of a comment or of a quoted text."""

    start: int
    end: int


def _lexemes(text: str) -> Iterator[_Lexeme]:
    """Yield comments and texts in quotes, in a time proportional to the text.

    A quote that nothing closes on its line belongs to the code, as in ``1'000``; no other of its
    kind can be closed there.
    """
    at, open_until = 0, {'"': 0, "'": 0}
    while found := _OPENING.search(text, at):
        start, sign = found.span()[0], found[0]
        at = start + 1
        if sign in open_until:
            if start < open_until[sign]:
                continue
            body = _QUOTED[sign].match(text, start)
            end = at if body is None else body.end()
            if text[end : end + 1] != sign:
                open_until[sign] = end
                continue
            at = end + 1
        else:
            end = text.find("\n" if sign == "//" else "*/", start + 2)
            at = len(text) if end < 0 else end + 2 * (sign == "/*")
        yield _Lexeme(start, at)


def _blanked(text: str, gone: Sequence[_Lexeme]) -> str:
    """The text with blanks for these places."""
    parts, at = list[str](), 0
    for start, end in gone:
        parts += [text[at:start], _NOT_LINE.sub(" ", text[start:end])]
        at = end
    return "".join([*parts, text[at:]])


def _unit_of(comment: str) -> str:
    """Unit in a comment: the first one in square brackets, or all of it."""
    if found := [b.strip() for b in BRACKETS.findall(comment)]:
        return next((unit for unit in found if is_unit(unit)), found[0])
    words = comment.strip("*/!< \t\n")
    return words if words == "1" or looks_like_unit(words) else ""


def _blank(found: re.Match[str]) -> str:
    return _NOT_LINE.sub(" ", found[0])


# ----------------------------------------------------------------------------------- code


def _macros(code: str) -> Iterator[_Place]:
    for m in _DEFINE.finditer(code):
        value = m["value"].rstrip()
        end = m.start("value") + len(value)
        yield _Place(m.start("name"), end, m["name"], not _WHOLE.fullmatch(value), value)


def _declared(code: str) -> Iterator[_Place]:
    """Yield what statements declare, and members that are given a value by their name."""
    code = _without_bodies(_DIRECTIVE.sub(_blank, code))
    for m in _MEMBER.finditer(code):
        value = m[0].partition("=")[2].strip()
        yield _Place(m.start("name"), m.start() + len(m[0].rstrip()), m["name"], False, value)
    at = 0
    for statement in code.split(";"):
        for start, end, name, constant, value in _declared_by(statement):
            yield _Place(at + start, at + end, name, constant, value)
        at += len(statement) + 1


def _declared_by(statement: str) -> Iterator[_Place]:
    head = _DECLARED.search(statement)
    if head is None:
        return
    constant = "const" in head["before"] + head["behind"]
    for start, end in _parts(statement, head.end()):
        end = start + len(statement[start:end].rstrip())
        found = _DECLARATOR.fullmatch(statement, start, end)
        if found is None:  # a function
            return
        value = (found["value"] or "").strip("={} \t\n")
        fraction = constant and value != "" and not _WHOLE.fullmatch(value)
        yield _Place(found.start("name"), end, found["name"], fraction, value)


def _parts(statement: str, start: int) -> Iterator[tuple[int, int]]:
    """Declarators of a statement: what stands between the commas that no brackets hold."""
    depth = 0
    for m in re.compile(r"[][(){},]").finditer(statement, start):
        depth += {"[": 1, "(": 1, "{": 1, ",": 0}.get(m[0], -1)
        if m[0] == "," and depth == 0:
            yield start, m.start()
            start = m.end()
    yield start, len(statement)


def _without_bodies(code: str) -> str:
    """The code with blanks and a ``;`` for the bodies of functions: braces behind a bracket."""
    parts, at, depth, body = list[str](), 0, 0, -1
    for m in re.finditer(r"(?P<function>\)\s*)?(?P<brace>[{}])", code):
        if m["brace"] == "{":
            if m["function"] and body < 0:
                body = depth
                parts.append(code[at : m.end()])
                at = m.end()
            depth += 1
        else:
            depth -= 1
            if depth == body:
                parts += [_NOT_LINE.sub(" ", code[at : m.start()]), ";"]
                at, body = m.end(), -1
    return "".join([*parts, code[at:]])
