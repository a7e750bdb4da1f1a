"""Files that are read and written: regular ones only, and nothing that is read is replaced."""

from __future__ import annotations

import errno
import os
import shlex
import stat
import unicodedata
from collections.abc import Hashable, Iterable, Iterator, Sequence
from io import BufferedReader
from pathlib import PurePath

from .errors import OutputError, UsageError

PathLike = str | os.PathLike[str]
IRREGULAR = "not a regular file"


def open_regular(path: PathLike) -> BufferedReader:
    """Open a regular file to read its bytes.

    Raises
    ------
    OSError
        When it cannot be opened, or is a device, a pipe or a socket: to read one may wait for
        ever, and has no end.
    """
    _refuse_irregular(os.stat(path).st_mode)  # to open a device may already do something

    def opener(name: str, flags: int) -> int:
        return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))

    file = open(path, "rb", opener=opener)  # noqa: SIM115 (the caller closes it)
    try:
        _refuse_irregular(os.fstat(file.fileno()).st_mode)
    except OSError:
        file.close()
        raise
    return file


def _refuse_irregular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, IRREGULAR)


class FileSet:
    """Files by what they are, not by what they are called.

    Two names are the same file when they lead to one (links of either kind), or differ, in one
    folder, in nothing but case and the composition of characters, which some systems do not tell
    apart.
    """

    def __init__(self, paths: Iterable[PathLike] = ()) -> None:
        self._known: dict[Hashable, str] = {}
        self._folders: dict[str, Hashable] = {}  # asked for ten thousand times by a batch
        for path in paths:
            self.add(path)

    def add(self, path: PathLike, about: str = "") -> None:
        """Add a file; ``about`` is what :meth:`find` says of it, its path if empty."""
        for identity in self._identities(path):
            self._known.setdefault(identity, about or os.fspath(path))

    def find(self, path: PathLike) -> str | None:
        """Return the entry added for the same file; ``None`` if there is none."""
        return next((self._known[i] for i in self._identities(path) if i in self._known), None)

    def _identities(self, path: PathLike) -> Iterator[Hashable]:
        try:
            # a folder behind ".." of a link is another one than the text says
            name = os.path.join(os.getcwd(), os.fspath(path))
            if os.path.islink(name):
                name = os.path.realpath(name)
            folder, base = os.path.split(name)
            if base in ("", os.curdir, os.pardir):
                folder, base = os.path.split(os.path.realpath(name))
            if folder not in self._folders:
                self._folders[folder] = _folder(folder)
            yield self._folders[folder], _folded(base)
            found = os.stat(name)
            yield found.st_dev, found.st_ino
        except (OSError, ValueError):  # there is none, or cannot be
            return


def _folder(path: str) -> Hashable:
    real = os.path.realpath(path)
    try:
        found = os.stat(real)
    except OSError:
        return _folded(real)
    return found.st_dev, found.st_ino


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def refuse_outputs(outputs: Iterable[tuple[str, str]], inputs: Iterable[PathLike]) -> None:
    """Refuse files to write that are read, named twice, or could not be regular files.

    Parameters
    ----------
    outputs
        What asks for a file, an option for example, and its path.
    inputs
        Files that are read.

    Raises
    ------
    UsageError
        Naming both.
    """
    read, seen = FileSet(inputs), FileSet()
    for asked, path in outputs:
        named = f"{asked} {path}".strip()
        if is_irregular(path):
            raise UsageError(f"{named} is {IRREGULAR}.", remedy="Give the name of a file.")
        if (other := read.find(path)) is not None:
            same = "" if other == path else f", {other},"
            raise UsageError(
                f"{named} is one of the files read{same} and would be overwritten.",
                remedy="Give another name.",
            )
        if (other := seen.find(path)) is not None:
            raise UsageError(
                f"{other} and {asked or path} both name {path}.",
                remedy="Give two different files.",
            )
        seen.add(path, asked)


def check_suffix(named: str, path: PathLike, suffixes: Sequence[str]) -> None:
    """Refuse a name to write that ends otherwise (``UsageError``); ``named`` says who asks."""
    name = PurePath(path)
    if name.suffix.lower() not in suffixes:
        raise UsageError(
            f"{named} has an unknown suffix.",
            expected=f"Expected one of {', '.join(suffixes)}.",
            remedy=f"Give for example {name.stem or 'fit'}{suffixes[0]}.",
        )


def is_irregular(path: PathLike) -> bool:
    """Return whether a path leads to what cannot be replaced: a device, a pipe, a loop of links.

    The null device may be written to, and a directory is somebody else's to refuse.
    """
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        return error.errno == errno.ELOOP
    except ValueError:
        return False
    regular = stat.S_ISREG(mode) or stat.S_ISDIR(mode)
    return not (regular or os.path.realpath(path) == os.path.realpath(os.devnull))


def refuse_input(path: PathLike, inputs: Iterable[PathLike]) -> None:
    """Refuse to write a file that is one of ``inputs`` (``OutputError``)."""
    other = FileSet(inputs).find(path)
    if other is not None:
        same = "" if other == os.fspath(path) else f", {other},"
        raise OutputError(
            f"is one of the files read{same} and would be overwritten.",
            where=os.fspath(path),
            remedy="Give another name.",
        )


def shell_command(words: Sequence[str]) -> str:
    """Words as one line that a shell takes apart into the same words.

    A name that is no text stands in the quotes of bash, byte by byte: no file of text holds it.
    """
    return " ".join(map(_quoted, words))


def powershell_command(words: Sequence[str]) -> str:
    """Words as one line of PowerShell: in single quotes, which are doubled inside."""
    plain = set("-_./\\:=+,")
    quoted = (w if w and all(c.isalnum() or c in plain for c in w) and w[0] != "@"
              else "'" + w.replace("'", "''") + "'" for w in words)  # fmt: skip
    return " ".join(quoted)


def _quoted(word: str) -> str:
    try:
        word.encode()
    except UnicodeEncodeError:
        raw = os.fsencode(word)
        plain = (chr(b) if 32 <= b < 127 and b not in b"\\'" else f"\\x{b:02x}" for b in raw)
        return f"$'{''.join(plain)}'"
    return shlex.quote(word)
