"""From a path to clean UTF-8 bytes: everything about files, nothing about tables."""

from __future__ import annotations

import codecs
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from ..errors import LogError

_PROBE = 1 << 16
_CONTROL = bytes([*range(9), *range(14, 27), 28, 29, 30, 31])
# Beginnings of files that people pass by mistake.
_FOREIGN = (
    (b"\x1f\x8b", "a gzip archive", "Unpack it first (gunzip)."),
    (b"PK\x03\x04", "a zip archive or an Excel workbook", "Unpack it, or save it as CSV."),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook", "Save it as CSV."),
    (b"MATLAB 5.0", "a MATLAB file", "Write it as CSV (writematrix)."),
    (b"\x89HDF", "an HDF5 or MATLAB 7.3 file", "Write it as CSV (writematrix)."),
    (b"TDSm", "a TDMS file", "Export it as CSV."),
    (b"MDF  ", "an MDF measurement", "Export it as CSV."),
    (b"%PDF", "a PDF document", "Give the CSV log itself."),
    (b"BZh", "a bzip2 archive", "Unpack it first (bunzip2)."),
    (b"\xfd7zXZ", "an xz archive", "Unpack it first (unxz)."),
)


@dataclass(frozen=True)
class Source:
    """The text of a log: UTF-8 bytes with ``\\n`` line ends, and where they came from."""

    path: Path
    data: bytes
    encoding: str
    sha256: str

    @property
    def name(self) -> str:
        """File name without folders."""
        return self.path.name


def read_source(path: Path) -> Source:
    """Read a text file and turn it into UTF-8 with plain line ends; ``LogError`` if it is none."""
    raw = _read_bytes(path)
    if not raw or raw.isspace():
        remedy = "Record it again, or check that the logger had finished writing."
        raise _refusal("the file is empty.", path.name, remedy)
    encoding, data = _decode(raw, path.name)
    if b"\r" in data:
        # "\r\r\n" is what a terminal log in text mode makes of "\r\n".
        for ending in (b"\r\r\n", b"\r\n", b"\r"):
            data = data.replace(ending, b"\n")
    return Source(path, data, encoding, hashlib.sha256(raw).hexdigest())


def _refusal(what: str, where: str, remedy: str) -> LogError:
    expected = "Expected a text file with columns of numbers (CSV or similar)."
    return LogError(what, where=where, expected=expected, remedy=remedy)


def _read_bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise _refusal("this is a folder.", str(path), "Name a file.")
        if path.exists() and not path.is_file():
            remedy = "Copy the data into a file first."
            raise _refusal("this is not a regular file.", str(path), remedy)
        return path.read_bytes()
    except FileNotFoundError:
        raise LogError(
            "there is no such file.", where=str(path), remedy="Check the path and the spelling."
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogError(
            f"the file cannot be read ({reason}).",
            where=str(path),
            remedy="Check the path and the permissions.",
        ) from None


def _decode(raw: bytes, name: str) -> tuple[str, bytes]:
    """Return the encoding and the same text as UTF-8 without a byte order mark."""
    for magic, what, remedy in _FOREIGN:
        if raw.startswith(magic):
            raise _refusal(f"this is {what}.", name, remedy)
    if raw.startswith(codecs.BOM_UTF8):
        return _checked(raw.removeprefix(codecs.BOM_UTF8), name, "utf-8-sig")
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16", _recode(raw, "utf-16", name)
    head = raw[:_PROBE]
    for encoding, offset in (("utf-16-le", 1), ("utf-16-be", 0)):
        # UTF-16 without a mark: every other byte of Latin text is zero.
        every_other, rest = head[offset::2], head[1 - offset :: 2]
        if len(head) >= 8 and every_other.count(0) > 0.4 * len(every_other) and 0 not in rest:
            return encoding, _recode(raw, encoding, name)
    return _checked(raw, name, "utf-8")


def _checked(raw: bytes, name: str, encoding: str) -> tuple[str, bytes]:
    """Return UTF-8 bytes as they are, anything else as Windows-1252."""
    head = raw[:_PROBE]
    control = len(head) - len(head.translate(None, _CONTROL))
    if b"\0" in raw or control > 0.01 * len(head):
        raise _refusal("this is a binary file.", name, "Export the recording as CSV.")
    if raw.isascii():
        return encoding, raw
    try:
        raw.decode("utf-8")
        return encoding, raw
    except UnicodeDecodeError:
        pass
    page = "cp949" if _is_korean(raw) else "cp1252"
    return page, raw.decode(page, errors="replace").encode()


def _is_korean(raw: bytes) -> bool:
    """Whether bytes beyond ASCII stand in pairs that are mostly Hangul, unlike "größe"."""
    runs = re.findall(rb"[\x80-\xff]+", raw[:_PROBE])
    if sum(len(run) > 1 for run in runs) <= 0.5 * len(runs) or any(len(r) % 2 for r in runs):
        return False
    try:
        raw.decode("cp949")
    except UnicodeDecodeError:
        return False
    text = b"".join(runs).decode("cp949")
    return sum("\uac00" <= sign <= "\ud7a3" for sign in text) > 0.5 * len(text)


def _recode(raw: bytes, encoding: str, name: str) -> bytes:
    try:
        return raw.decode(encoding).encode()
    except UnicodeError:
        # A recording that stopped in the middle of a character still has all lines before.
        text = raw.decode(encoding, errors="replace")
        if text.count("�") > 2:
            what = f"the file starts like {encoding} text but is damaged."
            raise _refusal(what, name, "Export it again, as UTF-8.") from None
        return text.rstrip("�").encode()
