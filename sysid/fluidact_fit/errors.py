"""Every error that a user can meet, and the warnings that travel with a result.

Each error carries four things: where it happened, what was found, what was
expected and what to do about it. The command line turns them into a message and
an exit status; a notebook shows the same text.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

# Options whose keyword in Python is not the same word.
_KEYWORDS = {
    "fix": "fixed", "column": "columns", "unit": "units", "scale": "scales", "step": "steps",
    "input": "inputs", "force": "overwrite=True", "set": "constants",
    "accept-failed": "accept_failed=True",
}  # fmt: skip
_MAPPINGS = {
    "fix", "start", "bounds", "noise", "column", "unit", "scale", "step", "hold", "input", "set",
    "from-name", "unwrap",
}  # fmt: skip
# Given once for every part or role on the command line; in Python one keyword holds them all.
_REPEATED = re.compile(r"exclude=('[^']*')(?: exclude='[^']*')+")
_NEIGHBOURS = re.compile(r"\b([a-z_]+)=\{([^{}\n]*)\},? (?:and )?\1=\{([^{}\n]*)\}")
_PART = re.compile(r"exclude=('[^']*')")
_COLON = re.compile(r"([^:@]+):([^:@]+)(?:@([^:@]+))?")
_PLAIN = re.compile(r"[-+0-9.e]+|nan|inf|(?=.*[A-Z])[A-Z0-9:_@]+|[\"'\[].*|\.\.\.|True|False|None")
_VALUE = r"\"[^\"]*\"|'[^']*'|\[[^\]\n]{0,200}\]|\.\.\.|[^\s,;()]*[^\s,;().:]"
_OPTION = re.compile(
    rf"--(?P<name>[a-z][a-z0-9]*(?:-[a-z0-9]+)*)"
    rf"(?: '(?:(?P<log>[^'=]*):)?(?P<role>[A-Za-z_][A-Za-z0-9_]*)=(?P<given>[^']*)'"
    rf"| (?P<sign>'[^']*')"
    rf"|[ =]\"(?P<quoted>[A-Za-z_][A-Za-z0-9_]*)=(?P<text>[^\"]*)\""
    rf"|[ =](?P<key>[A-Za-z_][A-Za-z0-9_]*)=(?P<item>{_VALUE})"
    rf"|=(?P<value>{_VALUE})| (?P<number>-?[0-9][0-9.:e+-]*[0-9]|-?[0-9]|[A-Z][A-Z0-9:_]*)\b)?"
)


# Controls, invisible and direction marks, halves of characters (of file names that are not
# text), line and paragraph separators. Joiners stay: some scripts cannot be written without.
_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
_SEEN = "\n\u200c\u200d"


def visible(text: str) -> str:
    r"""Return text for people with whatever could act on a terminal or a page written out.

    An escape character becomes ``\x1b``, a mark that reverses the direction of writing
    ``\u202e``. Line feeds stay. Headers, file names and keys are anybody's: all text that
    people see goes through here once, and a second time changes nothing.
    """
    if text.isascii() and text.replace("\n", "").isprintable():
        return text
    return "".join(
        repr(c)[1:-1] if unicodedata.category(c) in _UNSEEN and c not in _SEEN else c for c in text
    )


@dataclass(frozen=True)
class Notice:
    """A warning that is written into the parameter file.

    ``code`` is a stable kebab-case word a program can test for, ``message`` says
    what was found, where, and what to do.
    """

    code: str
    message: str

    def __post_init__(self) -> None:
        """Make the message fit to be seen."""
        object.__setattr__(self, "message", visible(bounded(self.message)))


def shortened(text: str, most: int = 300) -> str:
    """Text of at most so many characters; what is longer loses its middle."""
    if len(text) <= most:
        return text
    ahead = most * 2 // 3
    return f"{text[:ahead]} ... {text[len(text) - (most - ahead - 5) :]}"


def listed(names: Sequence[str], most: int) -> str:
    """Names one after the other, the first of many."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


_WIDEST, _MOST_LINES = 1000, 60  # of a message
_WORD = 60  # characters of a name that another is compared with
_SHORT_WORD = 2  # characters, too few to be the beginning of a certain word


def bounded(text: str) -> str:
    """Text for people with long lines and long lists shortened: it may quote what a file holds."""
    lines = text.split("\n", _MOST_LINES)
    if len(lines) > _MOST_LINES:
        lines[-1] = f"... and {lines[-1].count(chr(10)) + 1} more lines"
    return "\n".join(shortened(line, _WIDEST) for line in lines)


def closest(word: str, known: Iterable[str]) -> str:
    """Return the known word that is most like another one, empty without one.

    The same parts in another order come first (``friction-cylinder``), then a word that was cut
    short (``--colum``), then letters in another order (``bra``), then a misspelt one.
    """
    from difflib import get_close_matches  # slow to import, and of the square of the length

    if len(word) > _WORD:
        return ""
    short = [k for k in known if len(k) <= _WORD]
    swapped = [k for k in short if _parts(k) == _parts(word)]
    longer = [k for k in short if len(word) > _SHORT_WORD and k.startswith(word)]
    letters = sorted(word.lower())
    mixed = [k for k in short if len(word) > _SHORT_WORD and sorted(k.lower()) == letters]
    mixed.sort(key=lambda k: k[0] != word[0])
    return next(iter([*swapped, *longer, *mixed, *get_close_matches(word, short, 1)]), "")


def _parts(word: str) -> list[str]:
    return sorted(re.split("[-_ ]", word.lower()))


def check_names(option: str, noun: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that do not exist, with the closest that does (``UsageError``).

    ``option`` is what gives them, ``noun`` what they are names of.
    """
    names = list(dict.fromkeys(known))
    for name in given:
        if name in names:
            continue
        close = closest(name, names)
        raise UsageError(
            f"{option} names the {noun} '{name}', which does not exist here.",
            expected=f"Expected one of {', '.join(names)}." if names else f"There is no {noun}.",
            remedy=f"Did you mean '{close}'?" if close else f"Give {option} with one of them.",
        )


def in_python(text: str) -> str:
    """Turn a message in the words of the command line into those of Python.

    ``--fix mass=54`` becomes ``fixed={'mass': 54}``, ``--dead-time`` becomes ``dead_time=``.
    """

    def keyword(found: re.Match[str]) -> str:
        name = found["name"]
        word = _KEYWORDS.get(name, name.replace("-", "_"))
        if found["sign"] is not None:
            return f"{word}={found['sign']}"
        if found["role"] is not None:
            return _of_log(found["log"], name, word, found["role"], found["given"])
        if found["quoted"] is not None:
            return f"{word}={{{found['quoted']!r}: {found['text']!r}}}"
        if found["key"] is None:
            value = found["value"] or found["number"] or ""
            return f"{word}={_value(word, value)}" if value else word
        return _entry(name in _MAPPINGS, word, found["key"], found["item"])

    text = _REPEATED.sub(_listed, _OPTION.sub(keyword, text))
    while text != (merged := _NEIGHBOURS.sub(r"\1={\2, \3}", text)):
        text = merged
    return text


def _entry(mapping: bool, word: str, key: str, value: str) -> str:
    """A keyword with one entry of a mapping, or with text of both."""
    if mapping:
        return f"{word}={{{key!r}: {_value(word, value)}}}"
    return f"{word}={key + '=' + value!r}"


def _of_log(log: str | None, name: str, word: str, key: str, value: str) -> str:
    """The same, of one log where it is named; ``read_log`` knows only its own ``constants``."""
    if log:
        word, key = ("set" if name == "set" else word), f"{log}:{key}"
    return _entry(name in _MAPPINGS, word, key, value)


def _listed(found: re.Match[str]) -> str:
    return f"exclude=[{', '.join(_PART.findall(found[0]))}]"


def _value(word: str, value: str) -> str:
    """Convert the value of a keyword: a pair or a step where the command line has a colon."""
    found = _COLON.fullmatch(value)
    if found and word in ("bounds", "window", "rails") and not found[3]:
        return f"({found[1]}, {found[2]})"
    if found and word in ("steps", "inputs"):
        return f"StepInput({', '.join(filter(None, found.groups()))})"
    if word == "units" and value not in ("UNIT", "...") and value[0] not in "\"'":
        return repr(value)  # N, V and A are units, not placeholders
    return _quoted(value)


def _quoted(value: str) -> str:
    """Text as Python writes it; numbers, placeholders and what is quoted stay as they are."""
    return value if _PLAIN.fullmatch(value) else repr(value)


class ExtrapolationWarning(UserWarning):
    """A model is used beyond the range that its data covered; given once per block and role."""


class FluidactError(Exception):
    """Base of all user-facing errors.

    Parameters
    ----------
    what
        What was found, a whole sentence.
    where
        File and, when known, line or column, for example ``"pot.csv, line 214"``.
    expected
        What was expected instead.
    remedy
        What the user can do.
    """

    exit_status = 1

    def __init__(self, what: str, *, where: str = "", expected: str = "", remedy: str = "") -> None:
        parts = (what, where, expected, remedy)
        what, where, expected, remedy = (visible(bounded(part)) for part in parts)
        self.what = what
        self.where = where
        self.expected = expected
        self.remedy = remedy
        head = f"{where}: {what}" if where else what
        if "\n" not in what and not what.endswith((".", ":", "?", "!")):
            head += "."
        self.text = "\n".join(part for part in (head, expected, remedy) if part)
        super().__init__(self.text)

    def __str__(self) -> str:
        """The message in the words of Python; ``text`` has those of the command line."""
        return in_python(self.text)


class UsageError(FluidactError):
    """The command or call itself is wrong (exit status 2)."""

    exit_status = 2


class LogError(FluidactError):
    """A log cannot be read or used (exit status 3)."""

    exit_status = 3


class UnitError(LogError):
    """A unit is unknown or has the wrong dimension (exit status 3)."""


class MissingColumnError(LogError):
    """A log has no column for a role that a model needs (exit status 3).

    ``log`` is that log (:class:`.logs.Log`).
    """

    def __init__(self, what: str, *, log: Any, **words: str) -> None:
        super().__init__(what, **words)
        self.log = log


class ParameterFileError(FluidactError):
    """A parameter file is not valid (exit status 3).

    ``problems`` lists every problem as ``(path, message)``, for example
    ``("parameters.mass.unit", "'m' is not a mass")``; of more than ``MOST`` the first ones. The
    message shows ``SHOWN`` of them.
    """

    exit_status = 3
    SHOWN, MOST = 10, 100

    def __init__(self, where: str, problems: list[tuple[str, str]], remedy: str = "") -> None:
        self.problems = problems[: self.MOST]
        found, more = len(problems), len(problems) - self.SHOWN
        lines = [
            shortened(f"{path}: {message}" if path else message)
            for path, message in problems[: self.SHOWN]
        ]
        count = "1 problem" if found == 1 else f"{found} problems"
        if found > self.MOST:
            count = f"more than {self.MOST} problems"
        elif more > 0:
            lines.append(f"... and {more} more")
        what = f"not a valid parameter file ({count}):\n  " + "\n  ".join(lines)
        if found == 1 and not problems[0][0]:  # of the file as a whole
            what = lines[0]
        super().__init__(what, where=where, remedy=remedy)


class ControllerFileError(FluidactError):
    """A controller file cannot be used (exit status 3)."""

    exit_status = 3


class ConsumerError(FluidactError):
    """The parameters that a controller reads cannot be determined (exit status 3)."""

    exit_status = 3


class JobsFileError(FluidactError):
    """A list of jobs cannot be used (exit status 3)."""

    exit_status = 3


class SchedulerError(FluidactError):
    """The scheduler of a batch, or all its workers, went away (exit status 3)."""

    exit_status = 3


class OutputError(FluidactError):
    """A result cannot be written where it was asked for (exit status 3)."""

    exit_status = 3


class ExistingFileError(OutputError):
    """A result would replace a file, and ``--force`` was not given (exit status 2)."""

    exit_status = 2


class NotIdentifiedError(FluidactError):
    """The data cannot determine what was asked (exit status 4).

    ``option`` is one of the command line with which the same logs are described; empty where none
    is known.
    """

    exit_status = 4

    def __init__(self, what: str, *, option: str = "", **words: str) -> None:
        super().__init__(what, **words)
        self.option = option


class StrictError(FluidactError):
    """A warning under ``--strict``, or a failed verdict (exit status 4)."""

    exit_status = 4


class MismatchError(FluidactError):
    """A parameter file no longer describes the machine or suits its controller (exit status 5)."""

    exit_status = 5
