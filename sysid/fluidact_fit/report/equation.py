"""Equations as they are declared, in one line of text, typeset as MathML.

The text is that of a program with the freedoms of a page: ``a b`` is a product, ``y'`` a
derivative, ``x^2`` a power, ``w[i]`` an entry, ``|x|`` a magnitude, ``f(x)`` a function. What a
comma or a semicolon sets apart and is no equation stays text. Brackets that begin with a sign, as
in ``a (+ b x) (* (c s + 1))``, hold what is there with its parameters only.
"""

from __future__ import annotations

import re
from collections.abc import Set

from .html import code, escape

_TOKEN = re.compile(
    r"(?P<space>\s+)|(?P<name>[^\W\d]\w*)|(?P<number>\d+(?:\.\d+)?)|(?P<prime>'+)"
    r"|(?P<sign>\+-|[-+*/^=<>|()\[\],])"
)
_OPTIONAL = re.compile(r" \(([-+*] (?:[^()]|\([^()]*\))*)\)")
_INDEXED = re.compile(r"(.+?)_?(\d|(?<=_)[a-z])")
_SUMS = ("-", "+", "+-")
_RELATIONS = ("=", "<", ">")
_SIGNS = {"-": "−", "+-": "±", "<": "&lt;", ">": "&gt;"}
_COMMA = '<mo form="infix" lspace="0" rspace="0.3em">,</mo>'
_CLOSING = {"(": ")", "[": "]", "|": "|"}


def typeset(text: str, absent: Set[str] = frozenset()) -> str:
    """An equation as HTML, without parts of ``absent`` parameters; as typed if it cannot be read.

    Terms of a sum are formulas of their own, so that a long equation breaks between them.
    """
    text = _OPTIONAL.sub(
        lambda found: "" if absent & set(re.findall(r"\w+", found[1])) else f" {found[1]}", text
    )
    try:
        return "; ".join(", ".join(map(_clause, _split(part, ","))) for part in _split(text, ";"))
    except _UnreadableError:
        return code(text)


class _UnreadableError(Exception):
    """The text is no equation that this module can read."""


def _split(text: str, mark: str) -> list[str]:
    """Parts between marks that stand outside of brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([") - (letter in ")]")
        if letter == mark and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _clause(text: str) -> str:
    if "=" not in text:
        return escape(text)
    return "<wbr>".join(
        f'<math displaystyle="true">{term}</math>' for term in _Reader(text).terms()
    )


def _sign(sign: str, form: str) -> str:
    return _COMMA if sign == "," else f'<mo form="{form}">{_SIGNS.get(sign, sign)}</mo>'


class _Reader:
    """Reads one clause from left to right."""

    def __init__(self, text: str) -> None:
        self.tokens = [(m.lastgroup or "", m[0]) for m in _TOKEN.finditer(text)]
        if "".join(t for _, t in self.tokens) != text:
            raise _UnreadableError
        self.at, self.bars = 0, 0

    def terms(self) -> list[str]:
        """All terms, each behind its sign."""
        out = self._sum()
        if self.at < len(self.tokens):
            raise _UnreadableError
        return out

    def _next(self) -> str:
        """The sign, number or name that comes next, blanks passed over."""
        while self.at < len(self.tokens) and self.tokens[self.at][0] == "space":
            self.at += 1
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def _take(self, *wanted: str) -> str:
        """The next token where it is one of these; nothing else."""
        found = self._next()
        if not found or found not in wanted:
            return ""
        self.at += 1
        return found

    def _touches(self, *wanted: str) -> bool:
        """Return whether one of these follows without a blank."""
        return self.at < len(self.tokens) and self.tokens[self.at][1] in wanted

    def _sum(self) -> list[str]:
        """Terms behind signs, relations or commas, a sign of their own allowed."""
        out, joint = [], ""
        while True:
            sign = "" if joint in _SUMS else self._take(*_SUMS)
            shown = "".join(_sign(s, f) for s, f in ((joint, "infix"), (sign, "prefix")) if s)
            out.append(f"<mrow>{shown}{self._product()}</mrow>")
            joint = self._take(*_SUMS, *_RELATIONS, ",")
            if not joint:
                return out

    def _product(self) -> str:
        """Factors from left to right; what is divided is all before the stroke."""
        done = self._factor()
        while True:
            following = self._next()
            if following == "*":
                self._take("*")
                done += f"<mo>·</mo>{self._factor()}"
            elif following == "/":
                self._take("/")
                done = (
                    f"<mfrac><mrow>{_bare(done)}</mrow><mrow>{_bare(self._factor())}</mrow></mfrac>"
                )
            elif self._begins(following):
                done += f'<mspace width="0.3em"/>{self._factor()}'
            else:
                return done

    def _begins(self, text: str) -> bool:
        """Return whether a factor begins here; a bar inside of bars ends them."""
        return text in ("(", "[") or (text == "|" and not self.bars) or text[:1].isalnum()

    def _factor(self) -> str:
        base = self._base()
        if self.at < len(self.tokens) and self.tokens[self.at][0] == "prime":
            prime = "′" * len(self.tokens[self.at][1])
            base = f'<mrow>{base}<mo lspace="0" rspace="0">{prime}</mo></mrow>'
            self.at += 1
        if self._take("^"):
            base = f"<msup><mrow>{base}</mrow><mrow>{_bare(self._factor())}</mrow></msup>"
        return base

    def _base(self) -> str:
        opening = self._take("(", "[", "|")
        if opening:
            self.bars += opening == "|"
            inner = "".join(self._sum())
            self.bars -= opening == "|"
            if not self._take(_CLOSING[opening]):
                raise _UnreadableError
            return _bracketed(opening, inner)
        text = self._next()
        if not text[:1].isalnum():
            raise _UnreadableError
        self.at += 1
        if text[0].isdigit():
            return f"<mn>{text}</mn>"
        if text == "sqrt" and self._touches("("):
            return f"<msqrt>{_bare(self._base())}</msqrt>"
        return self._name(text)

    def _name(self, text: str) -> str:
        """A name with its index, or a function with what it takes."""
        indexed = _INDEXED.fullmatch(text)
        name, index = (indexed[1], indexed[2]) if indexed else (text, "")
        shown = f"<mi>{escape(name)}</mi>"
        below = f"<mi>{index}</mi>" if index else ""
        if self._touches("["):
            self.at += 1
            below += "".join(self._sum())
            if not self._take("]"):
                raise _UnreadableError
        if below:
            shown = f"<msub>{shown}<mrow>{below}</mrow></msub>"
        return shown + self._base() if self._touches("(") else shown


def _bracketed(opening: str, inner: str) -> str:
    return f'<mrow data-in="{opening}"><mo>{opening}</mo>{inner}<mo>{_CLOSING[opening]}</mo></mrow>'


def _bare(shown: str) -> str:
    """Strip round brackets that enclose the whole text."""
    begin, end = '<mrow data-in="("><mo>(</mo>', "<mo>)</mo></mrow>"
    inner = shown[len(begin) : -len(end)]
    whole = shown.startswith(begin) and shown.endswith(end) and begin not in inner
    return inner if whole else shown
