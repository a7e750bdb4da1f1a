"""What a run writes: checked before any work, rendered in memory, written whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fluidact_fit.errors import OutputError, UsageError

_PICTURES = (".png", ".pdf", ".svg")


@dataclass(frozen=True)
class Target:
    """A file that an option asks for."""

    option: str
    path: str
    suffixes: tuple[str, ...] = ()


def parameter_target(path: str) -> Target:
    """The parameter file of ``-o``."""
    return Target("-o", path)


def picture_target(path: str) -> Target:
    """The picture of ``--plot``."""
    return Target("--plot", path, _PICTURES)


def page_target(path: str) -> Target:
    """The page of ``--report``."""
    return Target("--report", path, (".html", ".htm"))


def check_targets(targets: Iterable[Target], inputs: Iterable[str], force: bool) -> None:
    """Refuse outputs that cannot be written, before any work is done.

    Raises
    ------
    UsageError
        When a name is unsuitable, taken, or given twice.
    OutputError
        When the directory may not be written to.
    """
    read = {os.path.realpath(path) for path in inputs}
    seen: dict[str, str] = {}
    for target in targets:
        _check_name(target)
        real = os.path.realpath(target.path)
        if real in read:
            raise UsageError(
                f"{target.option} {target.path} is one of the files read and would be overwritten.",
                remedy="Give another name.",
            )
        if real in seen:
            raise UsageError(
                f"{seen[real]} and {target.option} both name {target.path}.",
                remedy="Give two different files.",
            )
        seen[real] = target.option
        _check_place(target, force)


def _check_name(target: Target) -> None:
    if target.path == "-":
        raise UsageError(
            f"{target.option} - is not supported.",
            remedy="Give a file name, or --json to have the result on standard output.",
        )
    if not target.path.strip() or "\0" in target.path:
        raise UsageError(f"{target.option} has no file name.", remedy="Give one.")
    if target.suffixes and Path(target.path).suffix.lower() not in target.suffixes:
        known = ", ".join(target.suffixes)
        raise UsageError(
            f"{target.option} {target.path} has an unknown suffix.",
            expected=f"Expected one of {known}.",
            remedy=f"Give for example {target.option} {Path(target.path).stem or 'fit'}"
            f"{target.suffixes[0]}.",
        )


def _check_place(target: Target, force: bool) -> None:
    if os.path.isdir(target.path):
        raise UsageError(
            f"{target.option} {target.path} is a directory.", remedy="Give a file name inside it."
        )
    if os.path.isfile(target.path) and not force:
        raise UsageError(
            f"{target.path} exists already and was kept.",
            remedy=f"Give --force to replace it, or another name with {target.option}.",
        )
    parent = os.path.dirname(os.path.realpath(target.path))
    if not os.path.isdir(parent):
        raise UsageError(
            f"{target.option} {target.path}: there is no directory {os.path.dirname(target.path)}.",
            remedy="Create it first, or give another name.",
        )
    if not os.path.exists(target.path) and not os.access(parent, os.W_OK):
        raise OutputError(
            "cannot be written: no permission for its directory.",
            where=target.path,
            remedy="Check the permissions of the directory, or give another name.",
        )


def render(path: str, write: Callable[[Path], object]) -> bytes:
    """Return what a function writes into a file of that name."""
    with tempfile.TemporaryDirectory(prefix="fluidact-fit-") as directory:
        temporary = Path(directory) / Path(path).name
        write(temporary)
        return temporary.read_bytes()


def write_all(contents: dict[str, bytes | str], force: bool) -> None:
    """Write files, each whole; when one fails, those that were new are removed again.

    Raises
    ------
    OutputError
        When one cannot be written.
    """
    from fluidact_fit.parameters import write_atomically

    new: list[str] = []
    try:
        for path, content in contents.items():
            existed = os.path.lexists(path)
            write_atomically(path, content, overwrite=force)
            if not existed:
                new.append(path)
    except BaseException:
        for path in new:
            with suppress(OSError):
                os.unlink(path)
        raise
