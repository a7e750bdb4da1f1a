"""From a path to clean UTF-8 bytes: everything about files, nothing about tables."""

from __future__ import annotations

import codecs
import contextlib
import hashlib
import os
import re
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ..errors import LogError
from .archives import unpack

_WORD = 4  # bytes
_PROBE = 1 << 16
_RECORDING = re.compile(r"\.(mcap|db3)(\.zstd|\.zst)?$")  # in the folder of a bag
# The minus sign of print before a number, or its exponent.
_MINUS = re.compile(rb'(?:(?<![^\s,;|"=:])|(?<=\d[eEdD]))\xe2\x88\x92(?=[\d.,])')
# A formula of nothing but a text, which keeps a spreadsheet from changing it: ="0.5"
_FORMULA = re.compile(rb'(?<![^\s;,|])(?:="([^"\n]*)"|"=""([^"\n]*)""")')
_CONTROL = bytes([*range(9), *range(14, 27), 28, 29, 30, 31])


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
        return name_of(self.path)

    @cached_property
    def line_ends(self) -> int:
        """Number of line ends."""
        return self.data.count(b"\n")

    def lines(self) -> list[str]:
        """All lines."""
        return self.data.decode(errors="replace").split("\n")


def name_of(path: Path) -> str:
    """Return the name of a file in messages."""
    return "standard input" if str(path) == "-" else path.name


def files_of(path: Path) -> list[Path]:
    """The files of a log: itself, that of a bag, or those of ``a.csv+b.csv``."""
    several = [_in_bag(Path(part)) for part in str(path).split("+")]
    merged = len(several) > 1 and not path.exists() and all(p.is_file() for p in several)
    return several if merged else [_in_bag(path)]


def _in_bag(path: Path) -> Path:
    """The one recording in a folder that ROS 2 wrote; any other path as it is."""
    parts = _parts_of_bag(path)
    return parts[0] if len(parts) == 1 else path


def _parts_of_bag(path: Path) -> list[Path]:
    """The recordings in a folder that ROS 2 wrote, whatever else it holds."""
    try:
        names = sorted(os.listdir(path)) if (path / "metadata.yaml").is_file() else []
    except (OSError, ValueError):
        return []
    return [path / name for name in names if _RECORDING.search(name)]


def make_source(path: Path, raw: bytes, sha256: str) -> Source:
    """Turn the bytes of a text file into UTF-8 with plain line ends and texts for formulas of them.

    ``LogError`` if they are no text.
    """
    name = name_of(path)
    if not raw or raw.isspace():
        remedy = "Record it again, or check that the logger had finished writing."
        raise _refusal("the file is empty.", name, remedy)
    encoding, data = _decode(raw, name)
    while data.startswith(codecs.BOM_UTF8):
        data = data.removeprefix(codecs.BOM_UTF8)  # some loggers write another mark into the text
    if b"\r" in data:
        # "\r\r\n" is what a terminal log in text mode makes of "\r\n".
        for ending in (b"\r\r\n", b"\r\n", b"\r"):
            data = data.replace(ending, b"\n")
    if "\u2212".encode() in data:
        data = _MINUS.sub(b"-", data)
    if b'="' in data:
        data = _FORMULA.sub(rb'"\1\2"', data)
    return Source(path, data, encoding, sha256)


def _refusal(what: str, where: str, remedy: str) -> LogError:
    expected = "Expected a text file with columns of numbers (CSV or similar)."
    return LogError(what, where=where, expected=expected, remedy=remedy)


def read_bytes(path: Path) -> tuple[bytes, str]:
    """The bytes of a file, unpacked, of standard input for ``-``; and the checksum of the file."""
    raw = _read_raw(path)
    return unpack(raw, name_of(path)), hashlib.sha256(raw).hexdigest()


def _read_raw(path: Path) -> bytes:
    try:
        if str(path) == "-":
            if sys.stdin is None:
                raise _refusal("standard input is closed.", "-", "Give the name of a file.")
            return sys.stdin.buffer.read()
        if path.is_dir():
            raise _refusal("this is a folder.", str(path), _file_in(path))
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


def _file_in(folder: Path) -> str:
    """Suggest what to do about a folder that was given as a log."""
    parts = [part.name for part in _parts_of_bag(folder)]
    if len(parts) > 1:
        return (
            f"It is a bag of {len(parts)} files: name one of them ({', '.join(parts[:3])}), or "
            "write it as one: ros2 bag convert."
        )
    return "Name a file."


def _decode(raw: bytes, name: str) -> tuple[str, bytes]:
    """Return the encoding and the same text as UTF-8 without a byte order mark."""
    if raw.startswith(codecs.BOM_UTF8):
        return _checked(raw.removeprefix(codecs.BOM_UTF8), name, "utf-8-sig")
    if raw.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32", _recode(raw, "utf-32", name)
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
    """Return UTF-8 bytes as they are, anything else as that of a code page."""
    head = raw[:_PROBE]
    control = len(head) - len(head.translate(None, _CONTROL))
    filled = raw.rstrip(b"\0")
    if filled and b"\0" not in filled and filled != raw:
        raise LogError(
            f"the file ends with {len(raw) - len(filled)} zero bytes: the logger pre-allocated "
            "space that it never filled, or lost what it had written.",
            where=name,
            expected="Expected text to the end.",
            remedy="Check that nothing is missing, and remove them: tr -d '\\000' < LOG > COPY.",
        )
    if b"\0" in raw or control > 0.01 * len(head):
        raise _refusal("this is a binary file.", name, "Export the recording as CSV.")
    if raw.isascii():
        return encoding, raw
    try:
        raw.decode("utf-8")
        return encoding, raw
    except UnicodeDecodeError:
        pass
    page = _code_page(raw)
    return page, raw.decode(page, errors="replace").encode()


def _code_page(raw: bytes) -> str:
    """The code page of a text: that of a script whose words its bytes spell, else Windows-1252.

    No Latin text has four bytes beyond ASCII in a row.
    """
    if _is_korean(raw):
        return "cp949"
    if re.search(rb"[\x81-\x9f]", raw[:_PROBE]):
        with contextlib.suppress(UnicodeDecodeError):
            if re.search("[\u3041-\u30ff\u4e00-\u9fff]{2}", raw.decode("cp932")[:_PROBE]):
                return "cp932"
    runs = re.findall(rb"[\x80-\xff]+", raw[:_PROBE])
    if max(map(len, runs), default=0) < _WORD:
        return "cp1252"
    pairs = re.compile(rb"(?:[\xa1-\xfe]{2})+")
    leads = [lead for run in runs for lead in run[::2]]
    common = sum(0xB0 <= lead <= 0xD7 for lead in leads)  # the more common half of GB 2312
    if all(map(pairs.fullmatch, runs)) and common > 0.7 * len(leads):
        return "gb18030"
    letters = b"".join(runs)
    cyrillic = sum(c >= 0xC0 for c in letters)
    return "cp1251" if cyrillic > 0.9 * len(letters) else "cp1252"


def _is_korean(raw: bytes) -> bool:
    """True if bytes beyond ASCII are syllables of Hangul: pairs such as no Latin text has."""
    runs = re.findall(rb"[\x80-\xff]+", raw[:_PROBE])
    syllables = re.compile(rb"([\xb0-\xc8][\xa1-\xfe])+")
    return bool(runs) and all(map(syllables.fullmatch, runs))


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
