"""Packed files, unpacked within bounds: a few kilobytes may stand for gigabytes of nothing.

What comes out is bounded by how much went in, by memory and by processor time. It is made block by
block and counted before more than a little is kept; sizes that an archive states of itself are not
believed.
"""

from __future__ import annotations

import bz2
import io
import lzma
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ..errors import LogError

_WORKBOOKS = (".xlsx", ".xlsm", ".xls", ".ods")  # archives by their format
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
}
_ALWAYS = 1 << 26  # bytes that any archive may hold
_RATIO = 200  # beyond them, so many for each byte of the archive: logs reach some 50
_LARGEST = 1 << 32
_SECONDS = 8.0  # of processor time that any archive may take
_SPEED = 1e6  # beyond them, bytes of an archive that take a second: bzip2 manages 4e6
_MOST_MEMBERS = 10_000
_DICTIONARY = 1 << 28  # bytes that an xz decoder may ask for; its highest preset needs 65 MB
_IN, _OUT = 1 << 13, 1 << 20  # bytes of a block
_DAMAGED = (OSError, EOFError, ValueError, RuntimeError, zlib.error, lzma.LZMAError,
            zipfile.BadZipFile)  # fmt: skip


class Budget:
    """Number of bytes that the members of an archive may still yield.

    Parameters
    ----------
    packed
        Size of the archive [bytes].
    name
        What messages call it.
    most
        Bytes that no archive may yield.
    """

    def __init__(self, packed: int, name: str, most: int = _LARGEST) -> None:
        self.name = name
        self.bytes = min(max(_ALWAYS, _RATIO * packed), most)
        self._most = self.bytes
        self._until = time.process_time() + _SECONDS + packed / _SPEED

    def spend(self, number: int) -> None:
        """Count bytes that came out; ``LogError`` when it is too many, or took too long."""
        self.bytes -= number
        if self.bytes < 0:
            raise _refusal(f"the archive holds more than {self._most / 1e6:.0f} MB.", self.name)
        if time.process_time() > self._until:
            raise _refusal("the archive takes too long to unpack.", self.name)


def _refusal(what: str, name: str) -> LogError:
    return LogError(
        what,
        where=name,
        expected=f"Expected at most {_RATIO} bytes of log per byte of the archive, or "
        f"{_ALWAYS / 1e6:.0f} MB.",
        remedy="Unpack it, check what it holds, and give that.",
    )


def is_packed(raw: bytes) -> bool:
    """Return whether bytes are those of an archive."""
    return any(map(raw.startswith, _PACKED))


def unpack(raw: bytes, name: str) -> bytes:
    """Unpack an archive; return other bytes unchanged.

    Raises
    ------
    LogError
        When it is damaged, holds too much or another archive, or takes too long.
    """
    kind = next((k for magic, k in _PACKED.items() if raw.startswith(magic)), None)
    if kind is None:
        return raw
    blocks = partial(_zstd, raw) if kind == "zstd" else partial(_members, raw, _DECODERS[kind])
    try:
        unpacked = _gather(blocks, Budget(len(raw), name))
    except _DAMAGED as error:
        raise _damaged(error, name) from None
    if is_packed(unpacked):
        raise LogError(
            "this is a binary file: an archive within an archive.",
            where=name,
            expected="Expected a log, packed once at most.",
            remedy="Unpack it, and give what it holds.",
        )
    return unpacked


def _gather(blocks: Callable[[], Iterator[bytes]], budget: Budget) -> bytes:
    """Blocks in one piece, made again where they are too many to be kept while they are counted."""
    kept: list[bytes] = []
    size = 0
    for block in blocks():
        budget.spend(len(block))
        size += len(block)
        if size <= _ALWAYS:
            kept.append(block)
        else:
            kept.clear()
    return b"".join(kept if size <= _ALWAYS else blocks())


def _damaged(error: Exception, name: str) -> LogError:
    if name.lower().endswith(_WORKBOOKS):
        return LogError(
            "this is not a workbook, whatever its name says, or it is damaged.",
            where=name,
            remedy="Open it in the program that wrote it, and export the table as CSV.",
        )
    return LogError(
        f"the archive is damaged ({str(error)[:200] or type(error).__name__}).",
        where=name,
        remedy="Check the archive, or give the log unpacked.",
    )


_DECODERS: dict[str, Callable[[], Any]] = {
    "gzip": lambda: zlib.decompressobj(wbits=31),
    "bzip2": bz2.BZ2Decompressor,
    "xz": lambda: lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_DICTIONARY),
}


def _members(raw: bytes, decoder: Callable[[], Any]) -> Iterator[bytes]:
    """The members of an archive one after the other, block by block.

    Small blocks go in, as what follows the end of a member is copied.
    """
    source, place, rest = memoryview(raw), 0, b""
    one, begun = decoder(), False
    while True:
        if not rest and getattr(one, "needs_input", True):
            rest = bytes(source[place : place + _IN])
            place += len(rest)
            if not begun and not rest:
                return
        if not begun and not (rest := rest.lstrip(b"\0")):
            continue  # archives are padded with zeros
        out, ended = one.decompress(rest, _OUT), not rest
        yield out
        begun, rest = True, getattr(one, "unconsumed_tail", b"")
        if one.eof:
            rest, one, begun = one.unused_data, decoder(), False
        elif ended and not out:
            raise EOFError("it ends too early")


def _zstd(raw: bytes) -> Iterator[bytes]:
    import pyarrow

    with pyarrow.CompressedInputStream(pyarrow.BufferReader(raw), "zstd") as stream:
        while block := stream.read(_OUT):
            yield block


def open_zip(raw: bytes, name: str) -> zipfile.ZipFile:
    """Return the directory of a zip archive, or of an XLSX workbook; ``LogError`` if damaged."""
    try:
        archive = zipfile.ZipFile(io.BytesIO(raw))
    except (*_DAMAGED, NotImplementedError) as error:
        raise _damaged(error, name) from None
    if len(archive.infolist()) > _MOST_MEMBERS:
        raise _refusal(f"the archive holds {len(archive.infolist())} files.", name)
    return archive


def member_blocks(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, budget: Budget
) -> Iterator[bytes]:
    """Yield what a member of a zip archive holds, counted whatever size it states.

    Raises
    ------
    LogError
        When it is damaged, locked by a password, packed in a rare way, or too large.
    """
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        # zipfile unpacks those without a limit
        raise LogError(
            f"'{member.filename[:60]}' is packed in a way that is not read.",
            where=budget.name,
            remedy="Unpack it, and give the log in it.",
        )
    try:
        with archive.open(member) as file:
            while block := file.read(_OUT):
                budget.spend(len(block))
                yield block
    except _DAMAGED as error:
        raise _damaged(error, budget.name) from None
