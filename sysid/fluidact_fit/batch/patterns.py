"""The logs that a pattern names: as :mod:`glob` finds them, in time whatever the links do."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from fnmatch import translate
from glob import has_magic
from pathlib import Path

_ANY_FOLDERS = "**"
_SEPARATOR = re.compile(r"[\\/]+" if os.name == "nt" else "/+")


def expand(pattern: str, folder: Path) -> list[str]:
    """Return names that match a pattern, as seen from a folder, in order.

    ``*``, ``?`` and ``[]`` stand for parts of a name, ``**`` for any folders; none of them for a
    dot at the beginning. A folder to which links lead on several ways is looked into once: with
    links in a circle :func:`glob.glob` would look into it for hours.
    """
    drive, rest = os.path.splitdrive(pattern)
    *ahead, last = _SEPARATOR.split(rest)
    places = [drive]
    for part in ahead:
        places = _once(_folders(places, part, folder), folder)
    return sorted(set(_files(places, last, folder)))


def _folders(places: Iterable[str], part: str, folder: Path) -> Iterator[str]:
    """Folders below others that one part of a pattern names, each with its separator."""
    for place in places:
        if part == _ANY_FOLDERS:
            yield from _below(place, folder)
        elif has_magic(part):
            yield from (f"{place}{name}/" for name in _names(place, part, folder, folders=True))
        else:
            yield f"{place}{part}/"


def _files(places: Iterable[str], last: str, folder: Path) -> Iterator[str]:
    for place in places:
        if last == _ANY_FOLDERS:
            for below in _below(place, folder):
                yield from (
                    below + name for name in _names(below, "*", folder)
                    if not (folder / below / name).is_dir()
                )  # fmt: skip
        elif has_magic(last):
            yield from (place + name for name in _names(place, last, folder))
        elif os.path.lexists(folder / (place + last)):
            yield place + last


def _below(place: str, folder: Path) -> list[str]:
    """A folder and all below it; the nearest way to each."""
    found = _once([place], folder)
    level = found
    while level:
        inner = (f"{p}{name}/" for p in level for name in _names(p, "*", folder, folders=True))
        known = found
        found = _once([*known, *inner], folder)
        level = found[len(known) :]
    return found


def _once(places: Iterable[str], folder: Path) -> list[str]:
    """Folders that can be looked into, the first way to each."""
    seen: dict[tuple[int, int], str] = {}
    for place in places:
        try:
            found = os.stat(folder / place)
        except (OSError, ValueError):
            continue
        seen.setdefault((found.st_dev, found.st_ino), place)
    return list(seen.values())


def _names(place: str, part: str, folder: Path, folders: bool = False) -> list[str]:
    match = re.compile(translate(os.path.normcase(part))).match
    try:
        with os.scandir(folder / place) as entries:
            return sorted(
                e.name for e in entries
                if match(os.path.normcase(e.name))
                and (not e.name.startswith(".") or part.startswith("."))
                and (not folders or os.path.isdir(e.path))
            )  # fmt: skip
    except OSError:
        return []
