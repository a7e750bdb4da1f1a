"""Problems of a document: where each one is, in the words a user reads."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from ..errors import ParameterFileError, closest

Location = tuple[str | int, ...]

_PLAIN_KEY = re.compile(r"[\w-]+")


def format_path(location: Location) -> str:
    """Return a location as a dotted path, list indices in brackets.

    Examples
    --------
    >>> format_path(("parameters", "weights", "value", 2))
    'parameters.weights.value[2]'
    """
    path = ""
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif _PLAIN_KEY.fullmatch(part):
            path += f".{part}" if path else part
        else:
            path += f"[{part!r}]"
    return path


def find_entries(part: Any, *keys: str, place: Location = ()) -> Iterator[tuple[Location, Any]]:
    """Yield what stands under the keys, as far as it is there; ``*`` is every entry."""
    if not keys:
        yield place, part
    elif keys[0] != "*":
        if isinstance(part, Mapping) and keys[0] in part:
            yield from find_entries(part[keys[0]], *keys[1:], place=(*place, keys[0]))
    elif isinstance(part, (dict, list)):
        for key, item in part.items() if isinstance(part, dict) else enumerate(part):
            yield from find_entries(item, *keys[1:], place=(*place, key))


def suggest(word: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` when another known word is close, else an empty string."""
    close = closest(word, [name for name in known if name != word])
    return f"; did you mean {close!r}?" if close else ""


@dataclass
class Problems:
    """Problems by location, in the order they were found; one per location.

    Checks of meaning run on documents that may be broken elsewhere, so that one reading
    names everything. ``intact`` tells them which parts they can rely on. Once they are ``many``
    nobody reads further ones, and looking for them may end.
    """

    found: dict[Location, str] = field(default_factory=dict)

    def add(self, location: Location, message: str) -> None:
        """Note a problem. The first one at a location is kept."""
        self.found.setdefault(location, message)

    @property
    def many(self) -> bool:
        """Return whether there are more than will be reported."""
        return len(self.found) > ParameterFileError.MOST

    def intact(self, *location: str | int) -> bool:
        """Return whether nothing at, under or above the location is broken."""
        size = len(location)
        return not any(
            place[:size] == location or (place and location[: len(place)] == place)
            for place in self.found
        )

    def listed(self, lines: Mapping[Location, int]) -> list[tuple[str, str]]:
        """Return ``(path, message)`` pairs, with line numbers where they are known.

        Of ``many`` only as many as show that they are.
        """
        pairs = []
        for location, message in islice(self.found.items(), ParameterFileError.MOST + 1):
            # A missing key has no line of its own: take that of the part that lacks it.
            above = (location[:size] for size in range(len(location), 0, -1))
            line = next((lines[part] for part in above if part in lines), None)
            pairs.append((format_path(location), f"{message} (line {line})" if line else message))
        return pairs
