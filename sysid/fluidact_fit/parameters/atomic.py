"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from pathlib import Path

from ..errors import OutputError


def write_atomically(
    path: str | os.PathLike[str], text: str | bytes, *, overwrite: bool = False
) -> Path:
    """Write a file so that a crash or a full disk leaves the old one whole.

    The content goes to a new file beside it, which then takes its place. A symbolic link
    stays one: the file it points to is replaced. A device or pipe is written to directly.

    Parameters
    ----------
    path
        Where to write.
    text
        What to write; text is written as UTF-8 with plain newlines.
    overwrite
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    content = text.encode("utf-8") if isinstance(text, str) else text
    where = os.fspath(path)
    try:
        target = os.path.realpath(where)
        mode = os.stat(target).st_mode if os.path.exists(target) else None
        if mode is not None and stat.S_ISDIR(mode):
            raise OutputError("is a directory.", where=where, remedy="Give a file name inside it.")
        if mode is not None and not stat.S_ISREG(mode):
            with open(where, "wb") as file:
                file.write(content)
        elif mode is not None and not overwrite:
            raise OutputError(
                "exists already and was kept.",
                where=where,
                remedy="Give --force to replace it, or another name.",
            )
        else:
            _replace(target, content, mode)
    except (OSError, ValueError) as error:
        raise _explained(where, error) from error
    return Path(path)


def _replace(target: str, content: bytes, mode: int | None) -> None:
    # Beside the target: only within one file system is a replacement a single step.
    temporary = os.path.join(os.path.dirname(target), f".fluidact-{secrets.token_hex(8)}.tmp")
    # The mode given here is subject to the umask, unlike that of tempfile.
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if mode is not None:
            os.chmod(temporary, stat.S_IMODE(mode))
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
    # Makes the new name survive a power cut. Not every system can do it; the file is whole
    # either way.
    with contextlib.suppress(OSError):
        descriptor = os.open(os.path.dirname(target), os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _explained(where: str, error: OSError | ValueError) -> OutputError:
    if isinstance(error, FileNotFoundError):
        remedy = "Create the directory first, or give another name."
    elif isinstance(error, PermissionError):
        remedy = "Check the permissions of the directory, or give another name."
    else:
        remedy = "Free some space or give another place. An existing file was left as it was."
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    return OutputError(f"cannot be written: {reason}.", where=where, remedy=remedy)
