"""Notes, warnings and errors on standard error: a line each, and below it what to do."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable

from fluidact_fit.errors import Notice, listed, visible
from fluidact_fit.notices import is_note

from .show import paint, tell_painted, width_of

_NAMED = 3  # logs or parameters of which the same is said
_NAME = re.compile(r"(?![\d.,]+ )\S+(?= )")  # what comes first, unless it is a number
_SENTENCE = re.compile(r"(?<![.\s][A-Za-z]\.)(?<=[.?!])\s+(?=[A-Z'\"-])")  # not behind "e.g."
_INDENT, _CONTINUED = "  ", "    "


def echo_notices(notices: Iterable[Notice]) -> None:
    """Print warnings, then notes, on standard error.

    What is said of several logs or parameters, whose names come first, is said once.
    """
    together: dict[tuple[str, str], dict[str, None]] = {}
    for notice in sorted(notices, key=lambda n: is_note(n.code)):
        found = _NAME.match(notice.message)
        name = found[0] if found else ""
        together.setdefault((notice.code, notice.message.removeprefix(name)), {})[name] = None
    for (code, rest), names in together.items():
        first = next(iter(names))
        mark = first[-1] if first.endswith((":", ",")) else ""
        named = listed([name.removesuffix(mark) for name in names], _NAMED)
        tell_message("note" if is_note(code) else "warning", f"{named}{mark}{rest}", code)


def tell_message(word: str, text: str, code: str = "") -> None:
    """Print ``word (code): `` and the first sentence of a text, the rest of it indented below.

    On a terminal lines are wrapped to its width.
    """
    first, *rest = visible(text).split("\n")
    first, *remedy = _SENTENCE.split(first, maxsplit=1)
    start = f"{word} ({code}): " if code else f"{word}: "
    lines = _wrapped(first, start, _CONTINUED)
    for line in (*remedy, *rest):
        own = line[: len(line) - len(line.lstrip())]
        lines += _wrapped(line.lstrip(), _INDENT + own, _INDENT + own)
    tell_painted(paint(word, sys.stderr) + "\n".join(lines).removeprefix(word))


def _wrapped(text: str, first: str, others: str) -> list[str]:
    """Lines of a paragraph; a command to copy stays in one."""
    width = width_of(sys.stderr)
    if width is None or text.startswith("fluidact-fit "):
        return [first + text]
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=others,
                         break_long_words=False, break_on_hyphens=False)  # fmt: skip
