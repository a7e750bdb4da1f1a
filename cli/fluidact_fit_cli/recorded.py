"""The command line as a parameter file keeps it: it can be run again, and gives nobody away."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

from fluidact_fit.files import shell_command

_READ = ("logs", "validate", "prior")
_WRITTEN = ("output", "plot", "report", "details")
_HOME = re.compile(r"(?:^|(?<=[=:+/\\]))/?(?:home|Users|Documents and Settings)[/\\][^/\\:+]+[/\\]")


def recorded_command(args: Sequence[str], params: Mapping[str, Any]) -> str:
    """Return the command line for the file, as a shell takes it.

    A parameter file is passed on; the folders of the machine that wrote it are private and
    would make equal runs differ. Absolute paths of files to read become relative: to the present
    folder where they are in it, else to the folder that they have in common. Files to write stand
    in the present folder.
    """
    short = dict.fromkeys(_paths(params, _WRITTEN), "")
    short = {path: os.path.basename(path) for path in short if _is_private(path)}
    short |= _relative([path for path in _paths(params, _READ) if _is_private(path)])
    return shell_command(["fluidact-fit", *(_shortened(arg, short) for arg in args)])


def _paths(params: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    found: list[str] = []
    for name in names:
        given = params.get(name)
        found += [given] if isinstance(given, str) else list(given or ())
    return found


def _is_private(path: str) -> bool:
    """True if a path, or one of several that are merged, says where this machine keeps it."""
    home = os.path.expanduser("~").strip("/\\")
    inside = f"/{home}/" in f"/{path.lstrip('/')}"
    return any(map(os.path.isabs, path.split("+"))) or inside or bool(_HOME.search(path))


def _relative(paths: Sequence[str]) -> dict[str, str]:
    """Paths as seen from a folder that need not be told."""
    parts = {p: [p] if os.path.exists(p) else p.split("+") for p in paths}
    place = _common([os.path.dirname(part) for of in parts.values() for part in of])
    return {path: "+".join(_seen_from(place, part) for part in of) for path, of in parts.items()}


def _seen_from(place: str, path: str) -> str:
    for start in (os.getcwd(), place):
        try:
            found = os.path.relpath(path, start)
        except ValueError:  # another drive
            continue
        if not found.startswith(os.pardir) and not _is_private(found):
            return found
    return os.path.basename(path)


def _common(folders: Sequence[str]) -> str:
    try:
        return os.path.commonpath([os.path.abspath(folder) for folder in folders])
    except ValueError:
        return os.getcwd()


def _shortened(arg: str, short: Mapping[str, str]) -> str:
    """An argument without private folders."""
    path = next((p for p in sorted(short, key=len, reverse=True) if arg.endswith(p)), None)
    if path is None:
        return _HOME.sub("", arg)
    name = short[path]
    # a name that begins with a dash would be an option, and a dash alone standard input
    return arg.removesuffix(path) + (f"./{name}" if name.startswith("-") else name)
