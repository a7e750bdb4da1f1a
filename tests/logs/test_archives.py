"""Packed logs are read, and what a small archive may hold is bounded."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import resource
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pyarrow
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import archives, read_log

CSV = Path(__file__).parents[2] / "datasets/line/trial1.csv"
PLAIN = CSV.read_bytes()


def zstd(content: bytes) -> bytes:
    packed: bytes = pyarrow.compress(content, codec="zstd", asbytes=True)
    return packed


def zipped(*members: tuple[str, bytes], how: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", how) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return out.getvalue()


def read(folder: Path, content: bytes, name: str = "log.csv.packed"):
    path = folder / name
    path.write_bytes(content)
    return read_log(path)


@pytest.mark.parametrize(
    "packed",
    [
        gzip.compress(PLAIN),
        bz2.compress(PLAIN),
        lzma.compress(PLAIN, preset=9),
        zstd(PLAIN),
        gzip.compress(PLAIN[:9000]) + gzip.compress(PLAIN[9000:]) + bytes(700),
        bz2.compress(PLAIN[:9000]) + bz2.compress(PLAIN[9000:]),
        lzma.compress(PLAIN[:9000]) + lzma.compress(PLAIN[9000:]) + bytes(8),
    ],
)
def test_packed_logs_are_read(tmp_path: Path, packed: bytes) -> None:
    plain, log = read_log(CSV), read(tmp_path, packed)
    for a, b in zip(plain.columns, log.columns):
        np.testing.assert_array_equal(a.values, b.values)
    assert log.rows == 1000


ROWS = b"0.25;0.5\n" * (1 << 18)  # 2.4 MB


def bomb(pack, times: int = 100) -> bytes:
    """An archive of 0.24 GB of rows, in members."""
    return pack(ROWS) * times


@pytest.mark.parametrize(
    "make",
    [
        lambda: bomb(bz2.compress),
        lambda: bomb(lzma.compress),
        lambda: bomb(gzip.compress),
        lambda: zstd(ROWS * 50),
    ],
)
def test_what_holds_far_more_than_logs_do_is_refused(tmp_path: Path, make) -> None:
    with pytest.raises(LogError, match=r"holds more than \d+ MB") as caught:
        read(tmp_path, make())
    assert "Unpack it" in caught.value.text


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress])
def test_what_is_refused_was_not_kept(pack) -> None:
    """An archive of 9 MB took 2 GB before it was refused."""
    packed = bomb(pack)
    tracemalloc.start()
    try:
        with pytest.raises(LogError, match=r"holds more than \d+ MB"):
            archives.unpack(packed.ljust(1_000_000, b"\0"), "log")  # 200 MB are allowed
        assert tracemalloc.get_traced_memory()[1] < 1e8
    finally:
        tracemalloc.stop()


def test_a_long_log_that_is_packed_well_is_read(tmp_path: Path) -> None:
    rows = "".join(f"{0.001 * k:.3f};{k % 7};0.000\n" for k in range(100_000))
    assert read(tmp_path, lzma.compress(rows.encode())).rows == 100_000


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress, zstd])
def test_a_small_archive_takes_little_memory(tmp_path: Path, pack) -> None:
    """In a process that may have 1.2 GB, libraries included."""
    path = tmp_path / "log.csv.packed"
    path.write_bytes(pack(PLAIN))
    code = "import sys; from fluidact_fit.logs import read_log; print(read_log(sys.argv[1]).rows)"
    most = 1_200_000_000
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )  # fmt: skip
    assert done.stdout == "1000\n", done.stderr


def test_an_archive_that_takes_too_long_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archives, "_SECONDS", -1.0)
    with pytest.raises(LogError, match="too long to unpack"):
        read(tmp_path, bz2.compress(PLAIN))


def forged_size(content: bytes, size: int) -> bytes:
    """A zip whose directory and member state another size than the member has."""
    real = len(PLAIN).to_bytes(4, "little")
    return content.replace(real, size.to_bytes(4, "little"))


def locked() -> bytes:
    content = bytearray(zipped(("log.csv", PLAIN)))
    content[6] |= 1
    content[content.index(b"PK\1\2") + 8] |= 1
    return bytes(content)


@pytest.mark.parametrize(
    ("packed", "said"),
    [
        (zipped(("log.csv", PLAIN)), "zip archive"),
        (gzip.compress(zipped(("log.csv", PLAIN))), "zip archive"),
        (gzip.compress(PLAIN)[:-20], "damaged"),
        (gzip.compress(PLAIN)[:-8] + bytes(8), "damaged"),
        (gzip.compress(PLAIN) + b"garbage", "damaged"),
        (gzip.compress(bz2.compress(PLAIN)), "archive within an archive"),
        (b"\xfd7zXZ\0" + bytes(50), "damaged"),
        (b"BZh9" + b"x" * 50, "damaged"),
    ],
)
def test_what_cannot_be_unpacked_is_refused(tmp_path: Path, packed: bytes, said: str) -> None:
    with pytest.raises(LogError, match=said):
        read(tmp_path, packed)


def test_many_empty_members_take_little_time(tmp_path: Path) -> None:
    """What follows the end of a member is not copied over and over."""
    log = read(tmp_path, gzip.compress(b"") * 20_000 + gzip.compress(PLAIN))
    assert log.rows == 1000


def test_a_dictionary_that_is_too_large_is_refused(tmp_path: Path) -> None:
    """The head of the first block states 4 GB, with the right checksum."""
    content = bytearray(lzma.compress(PLAIN))
    end = 12 + 4 * (content[12] + 1) - 4
    content[16] = 40
    content[end : end + 4] = zlib.crc32(content[12:end]).to_bytes(4, "little")
    with pytest.raises(LogError, match="damaged"):
        read(tmp_path, bytes(content))


def member_of(content: bytes) -> bytes:
    archive = archives.open_zip(content, "book.xlsx")
    budget = archives.Budget(len(content), "book.xlsx")
    return b"".join(
        b for m in archive.infolist() for b in archives.member_blocks(archive, m, budget)
    )


def test_members_of_a_workbook_are_read_within_one_bound() -> None:
    assert member_of(zipped(("a.xml", b"abc"), ("b.xml", PLAIN))) == b"abc" + PLAIN
    assert member_of(forged_size(zipped(("log.csv", PLAIN)), 1 << 31)) == PLAIN
    with pytest.raises(LogError, match="holds more than 67 MB"):
        member_of(zipped(("a.xml", ROWS * 16), ("b.xml", ROWS * 16)))


@pytest.mark.parametrize(
    ("packed", "said"),
    [
        (zipped(("log.csv", PLAIN), how=zipfile.ZIP_BZIP2), "packed in a way that is not read"),
        (zipped(("log.csv", PLAIN), how=zipfile.ZIP_LZMA), "packed in a way that is not read"),
        (forged_size(zipped(("log.csv", PLAIN)), 100), "damaged"),
        (locked(), "damaged"),
        (zipped(("log.csv", PLAIN))[:-30], "damaged"),
        (zipped(*((f"{k}", b"") for k in range(10_001))), "10001 files"),
    ],
)
def test_damaged_workbooks_are_refused(packed: bytes, said: str) -> None:
    with pytest.raises(LogError, match=said):
        member_of(packed)
