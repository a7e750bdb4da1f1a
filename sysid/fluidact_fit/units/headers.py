"""Names and units of headers.

What is written as a unit is one, whether it can be read or not: a unit that is not understood is
refused where its column is used, and never taken for SI. A remark (``Force (left)``) is part of the
name.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

from .conversion import conversion_factor, same_dimension
from .reading import is_common_unit, is_unit, means_unit, pressure_reference
from .spelling import LONGEST, normalise_unit
from .table import REFERENCED, TABLE
from .words import CHARACTERS, REMARKS, UNIT_NAMES, fold

_WIDE = str.maketrans("［］【】〔〕（）｛｝＜＞", "[][][](){}<>")
_CLOSING = {"[": "]", "(": ")", "{": "}", "<": ">"}
_GROUPS = 16  # pairs of brackets, from the last, in which a unit is looked for
_LONG = 400  # characters of a name that are looked at
_TIME = "t"  # not a tonne where it stands as a name
_WORDS_BEHIND = 4  # words that a unit may have without brackets
# A name, what separates it from its unit, and that: "Zeit / ms", "Inlet, psi", "time in ms".
_MARK = re.compile(r" / |(?<!\d),|, | in | en |: ?| - | = |\|")
_SAYS_UNIT = re.compile(
    r"(?:units?|einheit|unit[eéà]|unidad|单位)\s*[:=：]?\s*|in\s+", re.IGNORECASE
)
# A size that stands with the name: "10 x pressure [bar]", "p*100 [bar]".
_SIZE = re.compile(
    r"(?:[*×]|(?<![^\W\d_])x) ?(?:1/)?(?:10{1,9}|1[eE]-?[0-9]|0[.,]0{0,9}1)(?![\d.,])"
    r"|(?<![\w.,/])(?:1/)?10{1,9} ?(?:[*×]|x(?!\w))|(?:^|(?<= ))/ ?10{1,9}(?![\w.,])"
)

# The symbol of a quantity behind its name, and the unit: "Strom I/mA", "Druck p_A/bar".
_SYMBOL = re.compile(r"(?P<symbol>[^\W\d_]\w{0,3})/(?P<unit>\S+)")

_SIZES = r"[0-9]{1,9}/[0-9]{1,9}|0?[.,][0-9]{1,9}|1e-[0-9]|10\^-?[0-9]|10{1,9}"

# Suffixes that mean a unit behind an underscore. ``A``, ``a``, ``in``, ``g`` and ``min``
# are not among them: ``p_A``, ``p_in``, ``motor_a`` and ``x_min`` are names.
_SUFFIX_SPELLINGS = "barg bara psig psia Nm mNm kNm daNm rev/min lbs inches"
_NO_SUFFIXES = {"at", "oz", "cP", "gf", "tf", "nm", "min", "ml", "gon", "rev", "thou"}
SUFFIXES = {
    re.sub("[/ ]", "_", unit.replace("^", "")): unit
    for unit in (*sorted(TABLE, key=lambda u: "/" not in u), *_SUFFIX_SPELLINGS.split())
    if len(unit) > 1 and unit[0] != "1" and unit not in _NO_SUFFIXES
} | {"N": "N", "V": "V", "s": "s", "m": "m"}
# One small letter may as well be an index (``valve_m``): believed only where it fits the role.
_DOUBTFUL_SUFFIXES = {"s", "m"}
# As a whole header, these may as well be names: of a path, of chamber A, of an inlet.
_DOUBTFUL_HEADERS = {unit for unit in TABLE if len(unit) == 1}
_DOUBTFUL_HEADERS |= {"in", "min", "at", "mil", "L", "S", "day", "second", "minute", "hour"}
# Behind a name these are parts of it (a motor's turn, a gain kp), those of the second line and
# "raw" in brackets, too.
_WORDS_OF_NAMES = "rev revs turn turns tour tours thou mils ata atg foot metro kp Mp cc"
_PARTS = {*_WORDS_OF_NAMES.split(), "steps", "inc", "raw", "none", "ADC"}
# What tells that such a word is the unit after all.
_OF = {
    "min h d day days hour second minute": re.compile(
        r"(?:.*[_ ])?(?:t|time|zeit|temps|tiempo|tempo|(?:time)?stamp|elapsed)", re.IGNORECASE
    ),
    "in": re.compile(r"(?:.*[_ ])?(?:pos|position|stroke|displacement|travel|length)", re.I),
}


class _Group(NamedTuple):
    """Text between brackets, and its extent from the opening to behind the closing one."""

    opening: str
    text: str
    start: int
    end: int


def parse_unit_from_header(header: str) -> tuple[str, str | None]:
    """Split a header into name and unit.

    ``pos [mm]``, ``pos (mm)``, ``pos / mm``, ``pos, mm``, ``pos in mm``, ``pos mm`` and ``pos_mm``
    are a position in millimetres. Square brackets at the end always hold a unit. Elsewhere a text
    is a unit where it is one of the list, or is written as one: an abbreviation that is no remark,
    a number and a unit, a misspelt name. Such a unit is returned, to be refused; without brackets
    only surer ones are. A header that is nothing but a common unit (``ms``, ``rpm``) is name and
    unit at once.

    Returns
    -------
    tuple
        Name, and unit or ``None``.
    """
    text = header.strip().translate(_WIDE)
    groups = [g for g in _groups(text) if not _is_index(g, text)]
    if groups and (found := _in_brackets(text, groups)):
        return found
    if groups:
        # "Inlet, psi (LGR S/N: 1)": a remark
        outside = text[: groups[-1].start].strip()
        behind = _of_words(outside) if groups[-1].end == len(text) else (text, None)
        named = behind[1] is not None and (behind[0] != outside or len(outside) > 1)
        return behind if named else (text, None)
    return _of_words(text)


def names_input(headers: Iterable[str]) -> bool:
    """Return whether a header ``in`` is an input, as in ``time, in, out``, and not in inches.

    It is a unit where the others are nothing but units as well: ``s, in, lbf``.
    """
    texts = {header.strip() for header in headers}
    return "in" in texts and not all(
        looks_like_unit(text) or text.casefold() in ("", "t", "time") for text in texts
    )


def _groups(text: str) -> list[_Group]:
    """The outermost brackets of a text with what is between them; the last ones of very many."""
    found: list[_Group] = []
    closing, start, depth = "", 0, 0
    for i, c in enumerate(text):
        if not depth and c in _CLOSING:
            closing, start, depth = _CLOSING[c], i, 1
        elif depth and c == text[start]:
            depth += 1
        elif depth and c == closing:
            depth -= 1
            if not depth:
                found.append(_Group(text[start], text[start + 1 : i], start, i + 1))
    return found[-_GROUPS:]


def _in_brackets(text: str, groups: list[_Group]) -> tuple[str, str | None] | None:
    """Name and unit of a header with a unit in brackets, ``None`` where they hold remarks only."""
    last = groups[-1]
    if REFERENCED.fullmatch(f"bar({last.text})") and last.end == len(text):
        behind = _of_words(text[: last.start].strip())  # "p bar(g)", "p [bar] (abs)"
        inner = groups[-2] if len(groups) > 1 and groups[-2].end == len(behind[0]) else None
        if inner and is_common_unit(inner.text):
            behind = text[: inner.start].strip(), inner.text
        if behind[1] and REFERENCED.fullmatch(f"{normalise_unit(behind[1])}({last.text})"):
            return behind[0], f"{behind[1]}({last.text})"
    sure = [g for g in groups if _is_surely_unit(g, text)]
    # "chamber (A) [bar]", "x [mm] [1]"
    units = [g for g in sure if len(g.text.strip()) > 1 or g.opening + g.text in ("[N", "[V", "[m")]
    units = units or sure[-1:]
    if not units and last.opening == "[" and last.end == len(text):
        units = [last]
    if not units:
        units = [
            g for g in groups if g.text.strip() and not is_remark(_SAYS_UNIT.sub("", g.text, 1))
        ]
    if not units:
        return None
    chosen = units[-1]
    unit: str | None = _inner(chosen.text)
    name = f"{text[: chosen.start].rstrip(' /')} {text[chosen.end :].strip()}".strip()
    others = {normalise_unit(_inner(g.text)) for g in units}
    if len(others) > 1:
        unit = " or ".join(_inner(g.text) for g in units)  # not read as a unit
    elif size := _SIZE.search(name[:LONGEST] + name[-LONGEST:]):
        unit = f"{size[0].strip()} {unit}"  # nor is this
    elif chosen is last and unit:
        return _with_size(name, unit, r"1/10{1,9}|0[.,]0{1,9}1")
    return name, unit or None


def _is_index(group: _Group, text: str) -> bool:
    """Return whether brackets hold the number of an element: ``position[0]``."""
    return (
        group.text.isdigit() and group.opening == "[" and text[group.start - 1 : group.start] > " "
    )


def _inner(text: str) -> str:
    """A unit between brackets without the words that say that it is one."""
    text = text.strip()
    said = _SAYS_UNIT.match(text)
    if said and normalise_unit(text) not in TABLE and means_unit(text[said.end() :]):
        return text[said.end() :].strip()
    return text


def _is_surely_unit(group: _Group, text: str) -> bool:
    """Return whether a unit that is read, or is one although it is not, stands in brackets."""
    unit = _inner(group.text)
    if not unit or unit in ("1", "none"):
        return group.opening == "[" and bool(unit)
    if group.opening == "[" and group.end == len(text):
        return is_unit(unit)
    if unit == _TIME and text[: group.start].strip() and text[group.start - 1] != " ":
        return False  # x(t)
    return means_unit(unit)


def is_remark(text: str) -> bool:
    """Return whether a text that is no unit is plainly not meant as one.

    Numbers (``1``, ``#3``), indices (``AI0``) and words are; abbreviations that are not known as
    remarks, signs, and what holds a unit beside other things are not.
    """
    if len(text) > 4 * LONGEST:
        return True
    if re.search("[\ufffd?°µμ%‰]", text) or _holds_unit(text) or _SIZE.search(text):
        return False
    words = re.findall(r"[^\W\d_]+\d*", text)
    if not words:
        return any(map(str.isdigit, text))
    if re.search("[:=]", text):
        return True
    return any(map(_is_plain, words)) or all(len(word) == 1 and word.isascii() for word in words)


def _holds_unit(text: str) -> bool:
    """True if a part of a text is surely a unit: behind a number, or a name of two letters."""
    if re.search(r"\d ?(?:[mkMdu]?[NVAlm]|[°%s])\b|H2O|Hg\b", text):
        return True
    top, stroke, bottom = text.partition("/")
    if stroke and " " not in text and text != "S/N" and (is_unit(top) or is_unit(bottom)):
        return bool(top) and bool(bottom)
    words = re.findall(r"[^\W\d_]+", text)
    return any(
        len(word) > 1
        and word not in _DOUBTFUL_HEADERS | _PARTS
        and fold(word) not in REMARKS
        and ((means_unit(word) and normalise_unit(word) != "1") or _is_nearly_unit(word))
        for word in words
    )


@lru_cache(maxsize=4096)  # the words of a header are those of many
def _is_nearly_unit(word: str) -> bool:
    """Return whether a word is the misspelt name of a unit: ``milimeter``."""
    names = [name for name in UNIT_NAMES if abs(len(name) - len(word)) < 3]
    return len(word) > 4 and bool(difflib.get_close_matches(fold(word), names, 1, 0.87))


def _is_plain(word: str) -> bool:
    """Return whether a word is a remark and no abbreviation of a unit."""
    if fold(word) in REMARKS or word[-1].isdigit():
        return True
    if ord(max(word)) > 0x2E80:
        return not CHARACTERS.issuperset(word)
    return len(word) > 3


def unit_within(header: str, si_unit: str) -> str | None:
    """Return a unit of what ``si_unit`` measures, other than that, in the middle of a name.

    ``kN`` of ``F_kN_filtered``, ``timeMs`` and ``kN Force``: nobody knows whether the column is in
    it. Short words that name other things as well are left alone.
    """
    words: list[str] = []
    for run in re.findall("[A-Za-zµμ]+|[^\x00-\x7f]+", header[:_LONG]):
        words += [run] if is_common_unit(run) else re.split("(?<=[a-z])(?=[A-Z])", run)
    for word in words:
        unit = word if is_common_unit(word) or not word.istitle() else word.lower()
        if len(unit) < 2 or unit in _DOUBTFUL_HEADERS | _PARTS | _NO_SUFFIXES:
            continue
        known = fold(unit) not in REMARKS and is_common_unit(unit)
        if known and same_dimension(unit, si_unit) and conversion_factor(unit, si_unit) != 1.0:
            return unit
    return None


def looks_like_unit(text: str) -> bool:
    """Return whether text that may as well be a name is a unit, one that is not read included."""
    if len(text) > LONGEST:
        return False
    unit = normalise_unit(text)
    if unit in ("degC", "degF", "K") or is_common_unit(text) or _is_certain(text):
        return True
    return bool(re.search(r"[/*^]", unit)) and "(" not in unit and means_unit(text)


def _of_words(text: str) -> tuple[str, str | None]:
    """Name and unit of a header without brackets."""
    if text == _TIME or _is_numbered(text):
        return text, None
    if looks_like_unit(text) and not re.search("[/*^]", text):
        return text, text
    quotient = re.search("[/*^]", text) and looks_like_unit(text) and not _is_of_counts(text)
    found = _suffix(text) or _marked(text)
    if found is None and not quotient:
        found = _stroke(text) or _last_words(text) or _amid(text)
    if found is None:
        return text, text if quotient else None
    return _with_size(*found, _SIZES)


def _is_numbered(text: str) -> bool:
    """Return whether a header is the second or third of its name (``M2``), not a power of a unit.

    Areas and volumes in a unit of length have no other name, but an ``in2`` is an inlet.
    """
    found = re.fullmatch(r"([^\W\d_]+)\d", text)
    if found is None or is_common_unit(text):
        return False
    length = is_unit(found[1]) and same_dimension(found[1], "m")
    return not length or found[1] in ("in", "m")


def _is_of_counts(text: str) -> bool:
    """Return whether a quotient may as well be a name: of counts, or of the time by its unit."""
    names = re.findall(r"[^\W\d_]+", text)
    return not names or names[0] == _TIME or any(normalise_unit(n) == "1" for n in names)


def _with_size(name: str, unit: str, sizes: str) -> tuple[str, str]:
    """Name and unit, with the end of the name where it belongs to the unit: "p 1/100", "q imp"."""
    found = re.search(rf"(?:(?<=[\s_,;:/-])|^)(?:{sizes}|imp|imperial|UK)[ .]?$", name[-LONGEST:])
    if found is None or unit[:1].isdigit() or found[0] == name:
        return name, unit
    return name.removesuffix(found[0]).rstrip(" _/"), f"{found[0].strip(' .')} {unit}"


def _suffix(text: str) -> tuple[str, str] | None:
    """Name and unit of ``pos_mm``, ``v_mm_s``, ``v_mm/s``, ``F_kip`` or ``pos.mm``."""
    parts = re.split("([_.-])", text[-LONGEST:])
    for k in (5, 3, 1):  # three words, two, one
        unit, sign = "".join(parts[-k:]), parts[-k - 1] if len(parts) > k + 1 else ""
        name = text[: len(text) - len(unit) - len(sign)]
        if not sign or not name.strip("_.- "):
            continue
        if sign != "_" and (k > 1 or len(unit) < 2 or " " in text or name[-1].isdigit()):
            continue  # "Position - mm", "x_0.01mm"
        if unit in SUFFIXES:
            return name, SUFFIXES[unit]
        if k == 3 and pressure_reference(unit):
            return name, unit
    name, _, unit = text.rpartition("_")
    if not name.strip("_"):
        return None
    quotient = "/" in unit[1:] and " " not in unit and is_unit(unit) and not _is_of_counts(unit)
    product = " " in unit and is_common_unit(unit)  # "M_N cm"
    return (name, unit) if quotient or product or _is_certain(unit) or _fits(unit, name) else None


def _is_certain(word: str) -> bool:
    """Return whether one word cannot be anything but a unit, be it read or refused."""
    if word in _DOUBTFUL_HEADERS | _PARTS | _NO_SUFFIXES or fold(word) in REMARKS:
        return False
    if re.search("[ /]", word):
        return False
    letters = word.lstrip("0123456789.,")
    if normalise_unit(letters) == "1":
        return False
    if letters != word:
        return means_unit(word) and (letters in ("V", "N", "s") or len(letters) > 1)
    if len(word) < 3 and ord(max(word, default=" ")) < 0x2E80:
        return fold(word) in ("kn", "mm") or (len(word) == 2 and is_common_unit(word))
    return means_unit(word)


def _amid(text: str) -> tuple[str, str] | None:
    """Name and unit of ``p_bar_1`` and ``F kN left``: a symbol before a remark or an index."""
    words = re.split("[ _]", text[:LONGEST])
    found = [k for k, word in enumerate(words[:-1]) if len(word) > 1 and word in SUFFIXES]
    if len(found) != 1 or not any(words[: found[0]]):
        return None
    if not all(map(is_remark, words[found[0] + 1 :])):
        return None
    start = len(" ".join(words[: found[0]]))
    unit = words[found[0]]
    return text[:start] + text[start + 1 + len(unit) :], unit


def _fits(word: str, name: str) -> bool:
    """Return whether a word that is doubtful as a unit fits the name before it: ``time_min``."""
    return any(
        word in words.split() and form.fullmatch(name[-LONGEST:]) for words, form in _OF.items()
    )


def _marked(text: str) -> tuple[str, str] | None:
    """Name and unit of a header with a sign between them: the longest unit that is surely one."""
    tail = text[-2 * LONGEST :]
    cut = len(text) - len(tail)
    marks = [(cut + m.start(), text[cut + m.end() :].strip()) for m in _MARK.finditer(tail)]
    marks = [(at, unit) for at, unit in marks if unit and text[:at].strip()]
    for at, unit in marks:
        signed = len(unit) > 1 and re.search(r"[/*^\d ]", unit) and means_unit(unit)
        counts = len(unit) > 2 and normalise_unit(unit) == "1" and unit not in _PARTS
        if is_common_unit(unit) or signed or counts:
            return text[:at].strip(), unit
    for at, unit in marks:
        if unit not in _PARTS and len(unit) > 1 and not is_remark(unit):
            return text[:at].strip(), unit
    return None


def _stroke(text: str) -> tuple[str, str] | None:
    """Name and unit of ``t/ms``, ``F/kn`` and ``Strom I/mA``, but not of ``m/s``."""
    words, space, last = text[-2 * LONGEST :].rpartition(" ")
    if space and words.strip() and (symbol := _SYMBOL.fullmatch(last)):
        unit = symbol["unit"]
        said = unit not in _PARTS and fold(unit) not in REMARKS and means_unit(unit)
        if said and normalise_unit(symbol["symbol"]) not in TABLE and not means_unit(last):
            return text[: len(text) - len(unit) - 1], unit
    name, sign, unit = text.partition("/")
    if not (sign and name.isalpha()) or (name != _TIME and normalise_unit(name) in TABLE):
        return None
    if name == _TIME and unit in ("s", "h", "d"):
        return name, unit
    if unit in _DOUBTFUL_HEADERS | _PARTS or fold(unit) in REMARKS or not unit:
        return None
    return (name, unit) if is_common_unit(unit) or (len(unit) > 1 and means_unit(unit)) else None


def _last_words(text: str) -> tuple[str, str] | None:
    """Name and unit of ``Flow l/min``, ``Torque N m``, ``speed 1/min``."""
    words = text[-2 * LONGEST :].split(" ")
    for k in range(min(_WORDS_BEHIND, len(words) - 1), 0, -1):
        unit = " ".join(words[-k:])
        name = text[: -len(unit)].strip()
        if not name or unit in _DOUBTFUL_HEADERS - {"%"} | _PARTS:
            if name and _fits(unit, name):
                return name, unit
            continue
        numbered = k > 1 and words[-k][:1].isdigit()
        if not numbered and is_common_unit(unit) and (len(unit) > 1 or unit in "%°"):
            return (name, unit) if normalise_unit(name) not in TABLE else None
        quotient = "/" in unit[1:] and is_unit(unit) and not _is_of_counts(unit)
        if all(map(_is_certain, words[-k:])) or (k == 1 and quotient):
            return name, unit  # "kg cm" is a product, not the "kg" in "cm"
    return None


def is_doubtful_suffix(header: str) -> bool:
    """Return whether what was read as a unit may as well be a name or an index.

    One small letter behind an underscore, or a header of one letter or an English word.
    """
    text = header.strip()
    if text in _DOUBTFUL_HEADERS:
        return True
    suffix = text.rpartition("_")[2]
    return suffix in _DOUBTFUL_SUFFIXES and parse_unit_from_header(header)[1] == suffix
