"""Damaged binary recordings and archives: read, or refused with a message, within limits.

Recordings of every format are cut, bits of them flipped, their sizes forged; HDF5 files are made
that lead elsewhere or state what they do not hold; archives are made that hold far more than logs.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import json
import lzma
import os
import random
import resource
import select
import signal
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.io import netcdf_file, savemat

from fluidact_fit.errors import LogError
from fluidact_fit.formats import worker
from fluidact_fit.logs import Log, read_log

from . import program
from .case import HANG, LIMIT, LONGEST, LOSS, WRONG, Case, Part, Result

_MOST = 1_000_000  # kB of memory that a process may take
_T = 0.01 * np.arange(300)
_SECRET = b"secret" * 400


def _matlab(path: Path) -> None:
    run = {"time": _T, "signals": [{"values": 2 * _T, "label": "F"}]}
    cells = np.array([_T, "b"], dtype=object)
    savemat(path, {"t": _T, "x": _T**2, "out": run, "z": _T + 1j, "c": cells, "who": "me"},
            do_compression=True)  # fmt: skip


def _matlab_4(path: Path) -> None:
    savemat(path, {"t": _T, "x": _T**2}, format="4")


def _fill(file: h5py.File) -> None:
    file["t"] = _T
    packed = file.create_dataset("rig/p", data=np.arange(300, dtype="i2"), chunks=(50,),
                                 compression="gzip")  # fmt: skip
    packed.attrs["scale_factor"], packed.attrs["units"] = 0.01, "bar"
    file["rig/rows"] = np.array(list(zip(_T, _T)), dtype=[("a", "f8"), ("b", "f4")])


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        _fill(file)


def _matlab_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        _fill(file)
        file["cells"] = np.array([file["t"].ref, file["rig/p"].ref], dtype=h5py.ref_dtype)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file")


def _netcdf(path: Path) -> None:
    with netcdf_file(path, "w") as file:
        file.createDimension("time", 300)
        for name in ("time", "p"):
            variable = file.createVariable(name, "f8", ("time",))
            variable[:], variable.units = _T, "s"


def _parquet(path: Path) -> None:
    table = {"t": _T, "x": _T**2, "n": np.arange(300), "w": ["a"] * 300}
    parquet.write_table(pa.table(table), path, row_group_size=100)


def _tdms(path: Path) -> None:
    wave = {"wf_increment": 0.01, "wf_start_time": np.datetime64("2024-05-31T12:00:00", "us")}
    with nptdms.TdmsWriter(str(path)) as writer:
        for _ in range(3):
            writer.write_segment([nptdms.ChannelObject("a", n, _T[:100], wave) for n in "xy"])


def _mdf(path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        for name, step in (("x", 1.0), ("y", 4.0)):
            file.append([asammdf.Signal(samples=_T, timestamps=step * _T, name=name, unit="bar")])
        file.save(path, overwrite=True, compression=2)


_FORMATS: dict[str, Callable[[Path], None]] = {
    "v5.mat": _matlab, "v4.mat": _matlab_4, "v73.mat": _matlab_73, "log.h5": _hdf5,
    "log.nc": _netcdf, "log.parquet": _parquet, "log.tdms": _tdms, "log.mf4": _mdf,
}  # fmt: skip


@cache
def _whole(name: str) -> bytes | None:
    """A recording in order; ``None`` where its library is not installed."""
    with contextlib.suppress(ImportError):
        from tempfile import TemporaryDirectory

        with TemporaryDirectory() as folder:
            path = Path(folder, name)
            _FORMATS[name](path)
            return path.read_bytes()
    return None


# What each function does to the bytes of a recording; it returns what it did.
def _cut(content: bytearray, rng: random.Random) -> str:
    size = len(content)
    at = rng.choice((rng.randrange(200), rng.randrange(size), size - rng.randrange(200)))
    at = max(0, min(at, len(content) - 1))
    del content[at:]
    return f"cut at {at}"


def _flip(content: bytearray, rng: random.Random) -> str:
    count = rng.choice((1, 1, 1, 3, 30))
    places = [rng.randrange(len(content)) for _ in range(count)]
    for at in places:
        content[at] ^= 1 << rng.randrange(8)
    return f"{count} bits flipped, from {min(places)} on"


def _flip_head(content: bytearray, rng: random.Random) -> str:
    at = rng.randrange(min(600, len(content)))
    content[at] ^= 1 << rng.randrange(8)
    return f"a bit of byte {at} flipped"


def _flip_foot(content: bytearray, rng: random.Random) -> str:
    at = len(content) - 1 - rng.randrange(min(1200, len(content)))
    content[at] ^= 1 << rng.randrange(8)
    return f"a bit of byte {at} flipped, near the end"


def _overwrite(content: bytearray, rng: random.Random) -> str:
    at, count = rng.randrange(len(content)), rng.choice((1, 4, 8, 64, 1000))
    new = rng.choice((bytes(count), b"\xff" * count, rng.randbytes(count)))
    content[at : at + count] = new
    return f"{count} bytes at {at} overwritten"


def _forge(content: bytearray, rng: random.Random) -> str:
    """Write another number in the place of one that may be a size."""
    width = rng.choice(("<I", "<Q", ">I"))
    size = struct.calcsize(width)
    sizes = [
        at for at in range(len(content) - size)
        if 0 < struct.unpack_from(width, content, at)[0] <= 4 * len(content)
    ]  # fmt: skip
    if not sizes:
        return _flip(content, rng)
    at = rng.choice(sizes)
    huge = rng.choice((0, 1, 7, 1 << 16, 1 << 24, 1 << 31, (1 << 32) - 1, 1 << 40, (1 << 63) - 1))
    new = huge if huge < 1 << 8 * size else (1 << 8 * size) - 1
    struct.pack_into(width, content, at, new)
    return f"{new} written as {width} at {at}"


def _insert(content: bytearray, rng: random.Random) -> str:
    at = rng.randrange(len(content))
    if rng.random() < 0.5:
        del content[at : at + rng.choice((1, 3, 100))]
        return f"bytes at {at} deleted"
    content[at:at] = rng.choice((b"\0", rng.randbytes(5), bytes(content[at : at + 300])))
    return f"bytes inserted at {at}"


def _twice(content: bytearray, rng: random.Random) -> str:
    content += bytes(content) if rng.random() < 0.5 else bytes(rng.choice((1, 100, 4096)))
    return "the file twice, or zeros behind it"


_DAMAGES = (_cut, _cut, _flip, _flip, _flip_head, _flip_foot, _overwrite, _forge, _forge, _insert,
            _twice)  # fmt: skip


def attack_recording(case: Case) -> Result:
    """Read a recording that is damaged."""
    name = case.rng.choice([n for n in _FORMATS if _whole(n) is not None])
    content = bytearray(_whole(name) or b"")
    damage = case.rng.choice(_DAMAGES)
    about = damage(content, case.rng)
    case.tell(f"{name}: {about}")
    path = case.folder / name
    path.write_bytes(content)
    log, result = _read(case, path)
    if damage is _cut and log is not None:
        _judge_cut(name, log, result)
    return result


@cache
def _rows(name: str) -> int:
    """How many numbers a recording in order holds."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(_whole(name) or b"")
        return _count(read_log(path))


def _count(log: Log) -> int:
    return sum(int(np.isfinite(c.values).sum()) for c in log.columns)


def _judge_cut(name: str, log: Log, result: Result) -> None:
    """Of a file that is cut everything is read, or something is said."""
    if _count(log) < _rows(name) and not log.notices:
        result.fail(LOSS, f"{_rows(name) - _count(log)} numbers lost without a word")


def _most() -> list[int]:
    """Memory that this process and the largest of its children have taken at most [kB]."""
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return [resource.getrusage(who).ru_maxrss for who in whose]


def _read(case: Case, path: Path) -> tuple[Log | None, Result]:
    """Read a file; what is wrong with how that ends."""
    before, held = _used(), _most()
    log, result = None, Result("refused")
    try:
        with _forked():
            log = read_log(path)
        result.outcome = "read"
    except LogError as error:
        result.message = error.text
        if len(error.text) > LONGEST or "/proc/self" in error.text:
            result.fail(WRONG, f"message of {len(error.text)} characters, or with a foreign path")
    taken = _used() - before
    if taken > LIMIT:
        result.fail(HANG, f"{taken:.0f} s of processor time")
    for most, already in zip(_most(), held):  # the largest ever: what was there is not the file's
        if most > max(_MOST, already):
            result.fail(WRONG, f"{most / 1e6:.1f} GB of memory")
    if case.rng.random() < 0.1:
        with _forked() if case.rng.random() < 0.9 else contextlib.nullcontext():
            ended = program.run(["inspect", str(path)])
        program.judge(ended, result, (0, 3))
        if (ended.status == 0) is not (log is not None):
            what = f"inspect ends with {ended.status}, and the file was {result.outcome}"
            result.fail(WRONG, what)
    return log, result


class _Fork:
    """The process of a reader, forked from this one: the libraries are loaded once for all cases.

    Its limits are those of the program, but that what is loaded here does not count as memory.
    """

    def __init__(self, words: Sequence[str], **_: Any) -> None:
        task = json.loads(words[-1])
        self._code: int | None = None
        self._number = os.fork()
        if self._number == 0:
            try:
                for number in (signal.SIGPROF, signal.SIGALRM):
                    signal.signal(number, signal.SIG_DFL)
                pages = int(Path("/proc/self/statm").read_text().split()[0])
                task["memory"] += pages * resource.getpagesize() - _LOADED
                sys.argv[1:] = [json.dumps(task)]
                worker.main()
            finally:
                os._exit(1)
        self._pidfd = os.pidfd_open(self._number)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; returns the status, negative for that of a signal."""
        if self._code is None:
            if not select.select([self._pidfd], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("reader", timeout or 0.0)
            self._code = os.waitstatus_to_exitcode(os.waitpid(self._number, 0)[1])
            os.close(self._pidfd)
        return self._code

    def poll(self) -> int | None:
        """Return the status of a process that ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self._code

    def kill(self) -> None:
        """End it."""
        os.kill(self._number, signal.SIGKILL)


_LOADED = 3 << 27  # bytes of addresses that a reader's process of its own has with its library


@contextlib.contextmanager
def _forked() -> Iterator[None]:
    """Let readers start by a fork; of each hundredth case ``inspect`` starts them as ever."""
    for name in ("asammdf", *(f"fluidact_fit.formats.{n}" for n in (*worker.READERS, "sink"))):
        with contextlib.suppress(ImportError):
            import_module(name)
    pa.set_memory_pool(pa.system_memory_pool())  # the usual one sets a GB of addresses aside
    kept = subprocess.Popen
    subprocess.Popen = _Fork
    try:
        yield
    finally:
        subprocess.Popen = kept


def _used() -> float:
    """Processor time of this process and of those it started."""
    both = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(u.ru_utime + u.ru_stime for u in both)


@dataclass(frozen=True)
class _Hostile:
    """Fills an HDF5 file with what must not be read; ``secret`` lies beside it."""

    name: str
    fill: Callable[[h5py.File, Path, random.Random], Any]


def _external(file: h5py.File, secret: Path, rng: random.Random) -> None:
    place = rng.choice((str(secret), secret.name, f"./{secret.name}", f"../{secret.parent.name}/s"))
    size = rng.choice((1, 200, len(_SECRET)))
    file.create_dataset(rng.choice("xa"), (size,), "u1", external=[(place, 0, size)])


def _linked(file: h5py.File, secret: Path, rng: random.Random) -> None:
    with h5py.File(secret.parent / "other.h5", "w") as other:
        other["secret"] = np.frombuffer(_SECRET, "u1")
    file["z"] = h5py.ExternalLink("other.h5", rng.choice(("secret", "/")))
    file["a"] = h5py.SoftLink(rng.choice(("/z", "/z/secret", "/")))


def _virtual(file: h5py.File, secret: Path, rng: random.Random) -> None:
    with h5py.File(secret.parent / "other.h5", "w") as other:
        other["secret"] = np.frombuffer(_SECRET, "u1")
    layout = h5py.VirtualLayout((len(_SECRET),), "u1")
    source = rng.choice((".", "other.h5", "nothing.h5"))
    layout[:] = h5py.VirtualSource(source, rng.choice(("secret", "v")), (len(_SECRET),))
    file.create_virtual_dataset("v", layout)


def _huge(file: h5py.File, secret: Path, rng: random.Random) -> None:
    shape = rng.choice(((1 << 40,), (1 << 20, 1 << 20), (1 << 28,), (300, 1 << 20)))
    chunks = tuple(min(n, rng.choice((16, 1024, 1 << 12))) for n in shape)
    how = rng.choice(({}, {"compression": "gzip"}, {"fillvalue": 7}))
    dataset = file.create_dataset("x", shape, rng.choice(("u1", "f8")), chunks=chunks, **how)
    if rng.random() < 0.7:
        dataset[(0,) * len(shape)] = 1


def _bomb(file: h5py.File, secret: Path, rng: random.Random) -> None:
    rows = 1 << rng.randrange(20, 25)
    file.create_dataset("x", (rows,), "u1", chunks=(rows,), compression="gzip")[:] = 0


def _maze(file: h5py.File, secret: Path, rng: random.Random) -> None:
    group = file
    for _ in range(rng.choice((5, 40, 300))):
        group = group.create_group("g")
        group["back"] = file
    for k in range(rng.choice((1, 300, 5000))):
        group[f"x{k}"] = np.arange(3.0)


_HOSTILE = (
    _Hostile("external storage", _external), _Hostile("links", _linked),
    _Hostile("a virtual dataset", _virtual), _Hostile("a huge dataset", _huge),
    _Hostile("a chunk of nothing", _bomb), _Hostile("a maze", _maze),
)  # fmt: skip


def attack_hdf5(case: Case) -> Result:
    """Read an HDF5 file that leads elsewhere, or states what it does not hold."""
    hostile = case.rng.choice(_HOSTILE)
    case.tell(hostile.name)
    secret = case.folder / "s"
    secret.write_bytes(_SECRET)
    path = case.folder / "log.h5"
    with h5py.File(path, "w", userblock_size=case.rng.choice((0, 512))) as file:
        file["t"] = _T
        hostile.fill(file, secret, case.rng)
    log, result = _read(case, path)
    if log is not None:
        for column in log.columns:
            if np.isin(column.values, np.frombuffer(b"secrt", "u1")).sum() > 5:
                result.fail(WRONG, f"column '{column.label}' holds what stands in another file")
    return result


def _packed(rng: random.Random) -> tuple[str, bytes]:
    """An archive of a log, or of far more."""
    log = (Path(__file__).parents[2] / "datasets" / "line" / "trial1.csv").read_bytes()
    row = rng.choice((b"0.5;0.25\n", b"1,2,3\n", b"\n", b"\0", b"time;x\n"))
    kind = rng.choice(("gzip", "bzip2", "xz", "zstd"))
    pack: dict[str, Callable[[bytes], bytes]] = {
        "gzip": gzip.compress, "bzip2": bz2.compress, "xz": lzma.compress,
        "zstd": lambda b: pa.compress(b, codec="zstd", asbytes=True),
    }  # fmt: skip
    how = rng.choice(("log", "log", "rows", "members", "nested", "empty members", "zip"))
    some = row * (1 << rng.randrange(10, 20))
    if how == "log":
        content = pack[kind](log)
    elif how == "rows":
        content = pack[kind](some)
    elif how == "members":
        content = pack[kind](some) * rng.choice((2, 100, 1000))
    elif how == "nested":
        content = gzip.compress(pack[kind](pack[kind](some)))
    elif how == "empty members":
        content = pack[kind](b"") * 20_000 + pack[kind](log)
    else:
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", rng.choice((8, 12, 14))) as archive:
            for k in range(rng.choice((1, 3))):
                archive.writestr(f"{k}.csv", some)
        content = out.getvalue()
    return f"{how} by {kind}", content


def attack_archive(case: Case) -> Result:
    """Read an archive that is damaged, or holds far more than a log."""
    about, content = _packed(case.rng)
    damaged = bytearray(content)
    if case.rng.random() < 0.6:
        about += f", {case.rng.choice(_DAMAGES[:-1])(damaged, case.rng)}"
    case.tell(about)
    path = case.folder / "log.csv.packed"
    path.write_bytes(damaged)
    return _read(case, path)[1]


PARTS = (
    Part("recording", "damaged binary recordings", 6000, attack_recording, wait=300.0),
    Part("hdf5", "HDF5 files that lead elsewhere", 1000, attack_hdf5, wait=300.0),
    Part("archive", "archives", 3000, attack_archive, wait=300.0),
)
