"""Units as people write them, in the spelling of the table."""

from __future__ import annotations

import re
import unicodedata

from .table import ALIASES, ATOMS, GAUGE, REFERENCED, STANDARD_FLOW, TABLE
from .words import WORDS, fold

_RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-"))
_POWERS = re.compile(f"[{''.join(_RAISED)}]+")
_LETTERS = str.maketrans(
    {"μ": "u", "µ": "u", "°": "deg", "Ω": "ohm", "·": " ", "⋅": " ", "∙": " ", "•": " "}
    | dict.fromkeys("−‐‑–", "-") | {"∗": "*", "º": "deg"}
)  # fmt: skip
_PER = re.compile(r" (?:per|pro|par|por|al|je|por cada) ", re.IGNORECASE)
NAME = r"[^\W\d_]\w*"
LONGEST = 60  # characters; nothing longer is a unit

_SIEMENS = {"S", "mS", "uS", "MS"}  # taken for seconds where they stand alone only
_IN_PRODUCTS = {
    spelling: unit
    for spelling, unit in ALIASES.items()
    if re.fullmatch(NAME, spelling) and unit not in ("1", "%") and spelling not in _SIEMENS
}


def plain_powers(text: str) -> str:
    """A text with ``^2`` for ``²``, and one sign of division."""
    text = re.sub("[∕⁄÷]", "/", text)
    return _POWERS.sub(lambda m: "^" + "".join(map(_RAISED.__getitem__, m[0])), text)


def normalise_unit(unit: str) -> str:
    """Return a unit in the spelling of the table: ``µ`` as ``u``, ``m²`` and ``m2`` as ``m^2``.

    What is too long for a unit stays as it is.
    """
    text = unit.strip()
    if len(text) > LONGEST:
        return text
    text = plain_powers(text)
    text = unicodedata.normalize("NFKC", text.translate(_LETTERS)).translate(_LETTERS)
    text = _PER.sub("/", re.sub(r"\s+", " ", text.replace("**", "^")))
    text = re.sub(r" ?([/*^]) ?", r"\1", text.replace(". ", " "))
    text = re.sub(r"(?<=[^\W\d_])-(?=[^\W\d_])", " ", text)  # in-lb
    text = re.sub(r"(?<=[^\W_])\.(?=[^\W\d_])", " ", text)  # kg.m2
    text = text[:-1] if text.endswith(".") else text
    # "m2", "s-2": an exponent that lost its caret. "1/s" and "1" stay as they are.
    text = re.sub(r"(?<=[A-Za-z])(-[123]|[23])\b", r"^\1", text)
    if text in TABLE or text in ALIASES or STANDARD_FLOW.fullmatch(text):
        return ALIASES.get(text, text)
    word = WORDS.get(fold(text))
    if word is not None and not _is_slip(text, word):
        return word
    text = re.sub(NAME, lambda m: _one_name(m[0], whole=m[0] == text), text)
    return ALIASES.get(text, text)


def _is_slip(text: str, symbol: str) -> bool:
    """Return whether a capital M stands for milli: "Mbar", and not "MBAR" or "Millibar"."""
    same = text.casefold() == symbol.casefold()
    return same and text[0] == "M" and symbol[0] == "m" and not text.isupper()


def _one_name(name: str, whole: bool) -> str:
    """A name in a product or quotient as the table spells it; in brackets where it is a product."""
    if name in ATOMS:
        return name
    known = _IN_PRODUCTS.get(name) or WORDS.get(fold(name), name)
    known = name if _is_slip(name, known) else known
    return known if whole or re.fullmatch(r"\w*", known) else f"({known})"


def split_reference(text: str) -> tuple[str, str]:
    """Return a unit of pressure without what it is counted from, and that."""
    match = REFERENCED.fullmatch(text)
    if match is None:
        return text, ""
    letter = (match["inside"] or match["behind"]).casefold()
    return normalise_unit(match["unit"]), "gauge" if letter in GAUGE else "absolute"
