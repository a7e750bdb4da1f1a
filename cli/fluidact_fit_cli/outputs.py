"""Outputs of a run: checked before any work, rendered in memory, written whole."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import click

from fluidact_fit.errors import OutputError, UsageError
from fluidact_fit.files import check_suffix, refuse_outputs
from fluidact_fit.parameters.atomic import names_directory, write_together

from .errors import Invocation

_SUFFIXES = {
    "--plot": (".png", ".pdf", ".svg"),
    "--report": (".html", ".htm"),
    "--details": (".json",),
}


def check_targets(
    targets: Mapping[str, str], inputs: Iterable[str], force: bool, also: Sequence[str] = ()
) -> None:
    """Refuse outputs that cannot be written, before any work is done.

    ``targets`` maps options to paths; ``inputs`` are files that are read; ``also`` are suffixes
    that this command accepts beside the usual ones. ``UsageError`` when a name is unsuitable,
    taken or given twice, ``OutputError`` when its directory is not writable.
    """
    check_places(targets, inputs, also)
    refuse_existing(targets, force)


def check_places(
    targets: Mapping[str, str], inputs: Iterable[str], also: Sequence[str] = ()
) -> None:
    """Do as :func:`check_targets`, but let files exist."""
    read = [part for path in inputs for part in _parts(path)]
    for option, path in targets.items():
        _check_name(option, path, also)
    refuse_outputs(targets.items(), read)
    for option, path in targets.items():
        _check_place(option, path)
    if (invocation := _invocation()) is not None:
        invocation.read.extend(read)


def refuse_twice(logs: Iterable[str], remedy: str = "Give each log once.") -> None:
    """Refuse a file that is given twice, under whatever name (``UsageError``)."""
    seen = set()
    for path in logs:
        if (real := os.path.realpath(path)) in seen:
            raise UsageError(f"{path} is given twice.", remedy=remedy)
        seen.add(real)


def check_folder(path: str) -> None:
    """Refuse to make a folder of the name that means standard output (``UsageError``)."""
    if path == "-":
        raise UsageError(
            "-o - is not supported: several files are written.",
            remedy="Give the name of a folder, or . for the present one.",
        )


def refuse_existing(targets: Mapping[str, str], force: bool) -> None:
    """Refuse to replace files without --force (``UsageError``)."""
    invocation = _invocation()
    for option, path in targets.items():
        if os.path.isfile(path) and not force:
            remedy = f"Give --force to replace it, or another name with {option}."
            if invocation is not None and invocation.is_job and option == "-o":
                remedy = "Give batch --force to replace it, or move it away."
            raise UsageError(f"{path} already exists; not overwritten.", remedy=remedy)


def _parts(path: str) -> list[str]:
    """The files of a log: itself, those that are merged in it, or what standard input is."""
    if path == "-":
        return ["/dev/stdin"]
    from fluidact_fit.logs.source import files_of

    return [str(part) for part in files_of(Path(path))] if "+" in path else [path]


def _check_name(option: str, path: str, also: Sequence[str] = ()) -> None:
    if path == "-":
        known = {name for p in click.get_current_context().command.params for name in p.opts}
        to_stdout = ", or --json to have the result on standard output"
        raise UsageError(
            f"{option} - is not supported.",
            remedy=f"Give a file name{to_stdout if '--json' in known else ''}.",
        )
    if not path.strip() or "\0" in path:
        raise UsageError(f"{option} has no file name.", remedy="Give one.")
    if option in _SUFFIXES:
        check_suffix(f"{option} {path}", path, (*_SUFFIXES[option], *also))


def _check_place(option: str, path: str) -> None:
    if names_directory(path) or os.path.isdir(path):
        raise UsageError(
            f"{option} {path} names a directory.", remedy="Give a file name inside it."
        )
    parent = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(parent):
        raise UsageError(
            f"{option} {path}: there is no directory {os.path.dirname(path)}.",
            remedy="Create it first, or give another name.",
        )
    if not os.path.exists(path) and not os.access(parent, os.W_OK):
        raise OutputError(
            "cannot be written: no permission for its directory.",
            where=path,
            remedy="Check the permissions of the directory, or give another name.",
        )


def write_all(contents: Mapping[str, bytes | str], force: bool) -> None:
    """Write files, each whole; when one fails, all are as they were before.

    Files that :func:`check_targets` knows as read are never replaced, whatever they have become
    since: a link may lead elsewhere than before the fit.
    """
    invocation = _invocation()
    inputs = invocation.read if invocation is not None else ()
    write_together(contents, overwrite=force, inputs=inputs)
    note_written(contents)


def note_written(paths: Iterable[str]) -> None:
    """Remember files that were written, for the message of an error that comes later."""
    invocation = _invocation()
    if invocation is not None:
        invocation.written.extend(paths)


def _invocation() -> Invocation | None:
    return click.get_current_context().find_object(Invocation)
