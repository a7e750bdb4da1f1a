"""From parameter files to the files of a target: read, accept, make, write."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, cast

from ..arguments import require, require_given
from ..block import Block
from ..control import load, make_block
from ..errors import (
    ExistingFileError,
    Notice,
    NotIdentifiedError,
    OutputError,
    StrictError,
    UsageError,
)
from ..families import get_family
from ..files import PathLike, refuse_outputs
from ..parameters import ParameterDocument, dump_document
from ..parameters.atomic import write_together
from ..parameters.load import parse_document
from ..presentation import ParametersLike, Presented, document_of, weak_file
from .registry import TARGETS, get_controller_target, get_target
from .target import Arithmetic, Job, Origin, make_job, origin_of, sha256_of


class Exported(list[Path]):
    """Paths of the files that an export wrote; ``notices`` name files with a weak verdict."""

    notices: Sequence[Notice] = ()

    def summary(self) -> str:
        """Return the paths, one per line."""
        return "\n".join(map(str, self))

    def _repr_html_(self) -> str:
        """The same for notebooks."""
        return "<ul>" + "".join(f"<li>{escape(str(path))}</li>" for path in self) + "</ul>"


def export(
    paths: Iterable[ParametersLike] | ParametersLike,
    to: str,
    folder: PathLike = ".",
    *,
    overwrite: bool = False,
    arithmetic: Arithmetic | None = None,
    accept_failed: bool = False,
    accept_not_identified: bool | Collection[str] = False,
    controller: PathLike | None = None,
) -> Exported:
    """Export parameter files for a controller, or the controller itself.

    Everything is read and made before anything is written, and the files of one parameter
    file are written all or none. What the target cannot hold is left out and named at the end.

    Parameters
    ----------
    paths
        Parameter files, one or several, or results. The exports are named after the files, that of
        a result after its family.
    to
        Name of a target: one of ``TARGETS``.
    folder
        Where to write (default: here); made when it does not exist.
    overwrite
        Whether existing files may be replaced.
    arithmetic
        ``"float32"`` (as without it) or ``"q15"``, of the targets that know both.
    accept_failed
        Export files whose verdict is FAIL; the export says so.
    accept_not_identified
        Names of parameters to export although the data could not determine them, or ``True``
        for all; the export says so.
    controller
        A controller file: it is exported instead, named after it, with what the parameter files
        together say of its machine.

    Returns
    -------
    Exported
        The paths of what was written, as a list.

    Raises
    ------
    ParameterFileError
        When a file cannot be read or does not agree with itself.
    StrictError, NotIdentifiedError
        When a fit failed, or a parameter was not identified, and that was not accepted.
    ControllerFileError
        When the controller file cannot be used.
    UsageError
        When the target is not known, or knows no such arithmetic or no controllers, when it
        cannot hold a file (:class:`NotExportedError` where there were several: what it can hold
        is written), when two exports would have one name, or when one would replace a file that
        is read.
    OutputError
        When a file exists and may not be replaced, or cannot be written.
    """
    one = isinstance(paths, str | Presented | ParameterDocument) or not isinstance(paths, Iterable)
    given: list[Any] = [paths] if one else list(cast("Iterable[Any]", paths))
    if not given:
        raise UsageError("no parameter file was given.", remedy="Give one or several.")
    require("truth", overwrite=overwrite, accept_failed=accept_failed)
    require("path", folder=folder)
    require_given("text", arithmetic=arithmetic)
    held = {}  # results and models by the names of the files that they would be saved to
    files = []
    for item in given:
        if isinstance(item, Presented | ParameterDocument):
            document = document_of(item, get_family)
            held[f"{document.family}.yaml"] = document
            files.append(f"{document.family}.yaml")
        else:
            require("path", paths=item)
            files.append(os.fspath(item))
    if not os.fspath(folder).strip() or "\0" in os.fspath(folder):
        raise UsageError("-o has no folder name.", remedy="Give one, or . for the present one.")
    target = get_target(to)
    known = TARGETS[to].arithmetics
    if arithmetic is not None and arithmetic not in known:
        raise UsageError(
            f"--arithmetic {arithmetic} was given, which --to {to} does not know.",
            expected=f"It knows: {', '.join(known) or 'none, every number is written in full'}.",
            remedy="Leave it out, or choose another target.",
        )
    loaded = [_load(path, held.get(path)) for path in files]
    blocks = [block for block, _ in loaded]
    _refuse_unaccepted(files, blocks, accept_failed, accept_not_identified)
    failures: list[tuple[str, UsageError]] = []
    if controller is None:
        jobs = [make_job(p, b, arithmetic or "float32", s) for p, (b, s) in zip(files, loaded)]
        _refuse_same_names(files, jobs)
        contents = []
        for path, job in zip(files, jobs):
            try:
                contents.append(target(job))
            except UsageError as error:
                failures.append((path, error))
    else:
        origins = [origin_of(p, s, b) for p, (b, s) in zip(files, loaded)]
        contents = [_controller(to, controller, blocks, arithmetic or "float32", origins)]
        files.append(os.fspath(controller))
    if failures and not contents:
        raise failures[0][1] if len(files) == 1 else NotExportedError(failures, Exported())
    made = [{str(Path(folder, n)): data for n, data in c.items()} for c in contents]
    _refuse_same_files(made)
    _check_places(made, files, overwrite)
    _make_folder(folder)
    written = Exported(
        p for c in made for p in write_together(c, overwrite=overwrite, inputs=files)
    )
    written.notices = [
        n for path, b in zip(files, blocks) for n in weak_file(b.document, os.path.basename(path))
    ]
    if failures:
        raise NotExportedError(failures, written)
    return written


class NotExportedError(UsageError):
    """Some files cannot be had in the target; the others were written.

    ``written`` names what was written.
    """

    def __init__(self, failures: Sequence[tuple[str, UsageError]], written: Exported) -> None:
        some = "file was" if len(failures) == 1 else "files were"
        super().__init__(
            f"{len(failures)} {some} not exported{'; the others were' if written else ''}.",
            expected="\n".join(f"{path}: {error.what}" for path, error in failures),
            remedy=failures[0][1].remedy,
        )
        self.written = written


def _load(path: str, held: ParameterDocument | None) -> tuple[Block, str]:
    """A block, and the SHA-256 of the file that it is in, or would be in."""
    if held is None:
        block = load(path, accept_failed=True, accept_not_identified=True)
        return block, sha256_of(path)
    text = dump_document(held)
    block = make_block(parse_document(text, get_family), accept_failed=True)
    block.accept(True)
    return block, hashlib.sha256(text.encode()).hexdigest()


def _controller(
    to: str, path: PathLike, blocks: Sequence[Block], arithmetic: Arithmetic,
    origins: Sequence[Origin],
) -> Mapping[str, bytes]:  # fmt: skip
    from .controller import controller_code

    own = origin_of(path, sha256_of(path))
    return get_controller_target(to)(controller_code(path, blocks, arithmetic, [own, *origins]))


def _refuse_unaccepted(
    files: Sequence[str],
    blocks: Sequence[Block],
    accept_failed: bool,
    accept_not_identified: bool | Collection[str],
) -> None:
    """Refuse failed fits and parameters without a value, unless they were accepted."""
    everything = accept_not_identified is True
    accepted = set() if isinstance(accept_not_identified, bool) else {*accept_not_identified}
    known = {name for block in blocks for name in block.parameters}
    if unknown := sorted(accepted - known):
        raise UsageError(
            f"--accept-not-identified {unknown[0]} names no parameter of these files.",
            expected=f"Parameters: {', '.join(sorted(known))}.",
        )
    for path, block in zip(files, blocks):
        if block.verdict == "fail" and not accept_failed:
            raise StrictError(
                "the fit of this file failed: its model does not describe the logs it was "
                "fitted to.",
                where=path,
                remedy="Fit again, or give --accept-failed to export it anyway.",
            )
        open_ones = [n for n in block.not_identified if not everything and n not in accepted]
        if open_ones:
            raise NotIdentifiedError(
                f"not identified: {', '.join(open_ones)}.",
                where=path,
                expected=block.variant.parameter(open_ones[0]).remedy,
                remedy=f"To export the value of the file anyway, give --accept-not-identified "
                f"{open_ones[0]} (or all).",
            )


def _refuse_same_names(files: Sequence[str], jobs: Sequence[Job]) -> None:
    first: dict[str, str] = {}
    for path, job in zip(files, jobs):
        other = first.setdefault(job.name.lower(), path)  # some file systems ignore case
        if other != path or files.count(path) > 1:
            raise UsageError(
                f"{other} and {path} would both be exported as {job.name}.",
                remedy="Rename one of them, or export them to different folders.",
            )


def _refuse_same_files(made: Iterable[Mapping[str, bytes]]) -> None:
    """Refuse two files of one name, as ``a.yaml`` and ``a_selftest.yaml`` would make them."""
    seen: set[str] = set()
    for path in (path for contents in made for path in contents):
        if path.lower() in seen:  # some file systems ignore case
            raise UsageError(
                f"two of the parameter files would both be exported to {path}.",
                remedy="Rename one of them, or export them to different folders.",
            )
        seen.add(path.lower())


def _check_places(
    made: Iterable[Mapping[str, bytes]], files: Iterable[str], overwrite: bool
) -> None:
    """Refuse before anything is written what would replace a file without leave."""
    paths = [path for contents in made for path in contents]
    refuse_outputs([("", path) for path in paths], files)
    for path in paths:
        if os.path.lexists(path) and not overwrite:
            raise ExistingFileError(
                "already exists; not overwritten.",
                where=path,
                remedy="Give --force to replace it, or another folder.",
            )


def _make_folder(folder: PathLike) -> None:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise OutputError(
            f"cannot be made: {reason}.",
            where=os.fspath(folder),
            remedy="Give the name of a folder that exists, or that can be made.",
        ) from error
