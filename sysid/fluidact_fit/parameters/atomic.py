"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import IO

from ..arguments import require
from ..errors import ExistingFileError, OutputError
from ..files import IRREGULAR, PathLike, is_irregular, refuse_input

try:
    import fcntl
except ImportError:  # Windows, where a file that is open cannot be removed
    fcntl = None  # type: ignore[assignment]

_OURS = re.compile(r"\.fluidact-[0-9a-f]{16}\.tmp")
_DAY = 86400.0  # seconds; a write takes far less


def write_atomically(
    path: PathLike, text: str | bytes, *, overwrite: bool = False, inputs: Iterable[PathLike] = ()
) -> Path:
    """Write a file so that a crash or a full disk leaves the old one whole.

    The content goes to a new file beside it, which then takes its place; of two programs that
    write the same new file at once, one does and the other is refused. What an earlier write
    left behind when it was killed is removed from that directory. A symbolic link
    stays one: the file it points to is replaced. The null device is written to; other devices,
    pipes and sockets are refused.

    Parameters
    ----------
    path
        Where to write.
    text
        What to write; text is written as UTF-8 with plain newlines.
    overwrite
        Whether an existing file may be replaced.
    inputs
        What the content was made from; none of these files is ever replaced.

    Raises
    ------
    OutputError
        When the file exists and may not be replaced, is an input, or cannot be written.
    """
    require("path", path=path)
    require("truth", overwrite=overwrite)
    where = os.fspath(path)
    try:
        content = text.encode("utf-8") if isinstance(text, str) else text
        target = os.path.realpath(where)
        mode = os.stat(target).st_mode if os.path.exists(target) else None
        if names_directory(where) or (mode is not None and stat.S_ISDIR(mode)):
            raise OutputError("is a directory.", where=where, remedy="Give a file name inside it.")
        if is_irregular(where):
            raise OutputError(f"is {IRREGULAR}.", where=where, remedy="Give the name of a file.")
        refuse_input(where, inputs)
        if mode is not None and not stat.S_ISREG(mode):
            with open(where, "wb") as file:
                file.write(content)
        elif mode is not None and not overwrite:
            raise FileExistsError
        else:
            _replace(target, content, mode, overwrite)
    except FileExistsError as error:
        raise ExistingFileError(
            "already exists; not overwritten.",
            where=where,
            remedy="Give --force to replace it, or another name.",
        ) from error
    except (OSError, ValueError) as error:
        raise _explained(where, error) from error
    return Path(path)


def write_together(
    contents: Mapping[str, str | bytes], *, overwrite: bool = False, inputs: Iterable[PathLike] = ()
) -> list[Path]:
    """Write several files, each whole; when one cannot be, all are as they were before.

    Parameters
    ----------
    contents
        Where to write what, as in :func:`write_atomically`.
    overwrite
        Whether existing files may be replaced.
    inputs
        What the contents were made from; none of these files is ever replaced.

    Returns
    -------
    list of Path
        The files, in the order given.

    Raises
    ------
    OutputError
        When a file exists and may not be replaced, or cannot be written.
    """
    written: list[tuple[str, bool, bytes | None]] = []
    inputs = tuple(inputs)
    try:
        for path in map(os.fspath, contents):
            existed, before = os.path.lexists(path), _present(path)
            write_atomically(path, contents[path], overwrite=overwrite, inputs=inputs)
            written.append((path, existed, before))
    except BaseException:
        for path, existed, before in reversed(written):
            with contextlib.suppress(OSError, OutputError):
                if before is not None:
                    write_atomically(path, before, overwrite=True)
                elif not existed:
                    os.unlink(path)
        raise
    return [Path(path) for path, *_ in written]


def _present(path: str) -> bytes | None:
    """Content of a file; ``None`` where there is none that could be read."""
    try:
        return Path(path).read_bytes() if os.path.isfile(path) else None
    except (OSError, ValueError):
        return None


def names_directory(path: str) -> bool:
    """Return whether a path can only mean a directory: it ends with a slash, ``.`` or ``..``."""
    return os.path.basename(path) in ("", os.curdir, os.pardir)


def _replace(target: str, content: bytes, mode: int | None, overwrite: bool) -> None:
    # Beside the target: only within one file system is a replacement a single step.
    folder = os.path.dirname(target)
    _remove_abandoned(folder)
    with _temporary(folder) as (temporary, file):
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
        if fcntl is None:
            file.close()
        if mode is not None:
            os.chmod(temporary, stat.S_IMODE(mode))
        if overwrite:
            os.replace(temporary, target)
        else:
            _give_name(temporary, target)
    # Makes the new name survive a power cut. Not every system can do it; the file is whole
    # either way.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _give_name(temporary: str, target: str) -> None:
    """Give a whole file its name unless it is taken (``FileExistsError``)."""
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links: an empty file reserves the name for one moment.
        os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        try:
            os.replace(temporary, target)
        except BaseException:
            os.unlink(target)
            raise


@contextlib.contextmanager
def _temporary(folder: str) -> Iterator[tuple[str, IO[bytes]]]:
    """A new file, open and locked while it is in use, and gone afterwards."""
    while True:
        path = os.path.join(folder, f".fluidact-{secrets.token_hex(8)}.tmp")
        # The mode given here is subject to the umask, unlike that of tempfile.
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            with os.fdopen(descriptor, "wb") as file:
                # Until it is locked, another run may take it for an abandoned one.
                if locked(descriptor) is not False and os.path.exists(path):
                    yield path, file
                    return
        finally:
            with contextlib.suppress(OSError):
                os.unlink(path)


def locked(descriptor: int) -> bool | None:
    """Lock a file until it is closed or its process ends; ``None`` where that is impossible."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


@cache  # once a process: in a folder of ten thousand files each look takes milliseconds
def _remove_abandoned(folder: str) -> None:
    """Remove what killed runs left: files named as here that no process has locked."""
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            path = os.path.join(folder, name)
            # Another run may remove it first; that of another user stays.
            with contextlib.suppress(OSError):
                if _OURS.fullmatch(name) and stat.S_ISREG(os.lstat(path).st_mode):
                    _remove_if_abandoned(path)


def _remove_if_abandoned(path: str) -> None:
    old = time.time() - os.lstat(path).st_mtime > _DAY
    if fcntl is None:
        if old:
            os.unlink(path)
        return
    descriptor = os.open(path, os.O_RDWR)
    try:
        # Removed while it is locked: its owner would otherwise lock it in between.
        if locked(descriptor) or (old and locked(descriptor) is None):
            os.unlink(path)
    finally:
        os.close(descriptor)


def _explained(where: str, error: OSError | ValueError) -> OutputError:
    if isinstance(error, FileNotFoundError):
        remedy = "Create the directory first, or give another name."
    elif isinstance(error, PermissionError):
        remedy = "Check the permissions of the directory, or give another name."
    elif isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        remedy = "Give a shorter name."
    else:
        remedy = "Free some space or give another place. An existing file was left as it was."
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    return OutputError(f"cannot be written: {reason}.", where=where, remedy=remedy)
