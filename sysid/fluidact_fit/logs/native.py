"""Start the process that reads a binary recording, and take over what it found.

Native libraries read these files, and what is damaged can end the process that reads it. It has
limits of memory and time by the size of the file. The file is opened once: the checksum is that of
the bytes that are read.
"""

from __future__ import annotations

import hashlib
import json
import math
import mmap
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from ..errors import LogError

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv.pop(1)); "
    "from fluidact_fit.formats.worker import main; main()"
)
_ROOM, _ROOM_PER_BYTE = 1 << 27, 64  # bytes of numbers, and so many for each byte of the file
_BASE = 1 << 30  # of memory, with libraries and threads
_SECONDS, _SPEED = 8.0, 5e5  # of processor time, and bytes of the file that take a second more
_WAIT = 30.0  # s on the clock beyond four times that, for disks far away
_LONGEST = 1 << 26  # bytes of a description
_ENVIRONMENT = {
    # threads take room of which there is a limit
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMEXPR_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",  # those of Arrow, too
    "MALLOC_ARENA_MAX": "2",
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # its own one sets a GB aside
    "HDF5_USE_FILE_LOCKING": "FALSE",  # on drives that know none; a change is seen all the same
}


@dataclass(frozen=True)
class Vector:
    """Numbers of one channel of a recording, shape ``(n,)``.

    ``group`` is what holds it, ``instants`` the number of the vector of its instants, ``since``
    the instant [ns] from which a clock counts; ``bad`` has the text of cells that are no number.
    What has the role ``instants`` is no channel itself.
    """

    name: str
    group: str
    unit: str | None
    values: npt.NDArray[Any]
    instants: int | None
    clock: bool
    since: int
    role: str
    bad: Mapping[int, str]


@dataclass(frozen=True)
class Recording:
    """Content of a file.

    ``converted`` has elements with how they were converted, ``left_out`` those that are none of
    its vectors: name, reason, and whether it may have been a signal. ``sha256`` is that of the
    bytes that were read, empty where they were at hand.
    """

    dialect: str
    vectors: tuple[Vector, ...]
    converted: tuple[tuple[str, str], ...]
    left_out: tuple[tuple[str, str, bool], ...]
    notices: tuple[tuple[str, str], ...]
    sha256: str


def read_apart(reader: str, source: Path | bytes, name: str) -> Recording:
    """Read a binary recording in a process of its own.

    Parameters
    ----------
    reader
        Module of ``fluidact_fit.formats``.
    source
        The file, or its bytes.
    name
        What messages call it.

    Raises
    ------
    LogError
        When it cannot be read, or not within the limits, or changes meanwhile.
    """
    try:
        return _read_apart(reader, source, name)
    except (OSError, MemoryError) as error:
        raise LogError(
            f"there is no room to read it ({str(error) or type(error).__name__}).",
            where=name,
            expected="Expected memory for its numbers, and a folder for temporary files.",
            remedy="Free memory, or export the recording in parts.",
        ) from None


def _read_apart(reader: str, source: Path | bytes, name: str) -> Recording:
    with ExitStack() as stack:
        folder: list[str] = []

        def private() -> str:
            if not folder:
                made = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
                folder.append(stack.enter_context(made))
            return folder[0]

        given = stack.enter_context(_given(source, private))
        numbers = stack.enter_context(_blank("numbers", private))
        answer = stack.enter_context(_blank("answer", private))
        before = os.fstat(given.file.fileno())
        size = before.st_size
        task = {"reader": reader, **_limits(size)}
        task |= {"source": given.path, "numbers": numbers.path, "answer": answer.path}
        ended, sha256 = _run(task, (given, numbers, answer), name)
        if isinstance(source, Path):
            _require_unchanged(given, source, before, name)
        described = _description(answer.file, ended, task, name)
        return _recording(described, numbers.file, sha256 if isinstance(source, Path) else "")


def _limits(size: int) -> dict[str, int]:
    """Limits for a file of that many bytes."""
    physical = _physical()
    room = min(_ROOM + _ROOM_PER_BYTE * size, physical)
    memory = min(_BASE + 2 * room, max(_BASE, physical))
    return {"room": room, "memory": memory, "seconds": math.ceil(_SECONDS + size / _SPEED)}


def _physical() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 1 << 34


@dataclass(frozen=True)
class _Shared:
    """A file of both processes, and the path by which the other one opens it."""

    file: Any
    path: str

    @property
    def inherited(self) -> tuple[int, ...]:
        """Return the environment that makes the other process find these modules."""
        return (self.file.fileno(),) if self.path.startswith(_FDS) else ()


_FDS = "/proc/self/fd/"


def _by_descriptor() -> bool:
    return os.path.isdir(_FDS)


@contextmanager
def _given(source: Path | bytes, private: Any) -> Iterator[_Shared]:
    """The recording, opened once."""
    if isinstance(source, bytes):
        with _blank("recording", private) as shared:
            shared.file.write(source)
            shared.file.flush()
            yield shared
        return
    with source.open("rb") as file:
        path = f"{_FDS}{file.fileno()}" if _by_descriptor() else os.path.realpath(source)
        yield _Shared(file, path)


@contextmanager
def _blank(name: str, private: Any) -> Iterator[_Shared]:
    """An empty file without a name; where there is none, one in a private folder."""
    if hasattr(os, "memfd_create") and _by_descriptor():
        with os.fdopen(os.memfd_create(f"fluidact-fit-{name}"), "w+b") as file:
            yield _Shared(file, f"{_FDS}{file.fileno()}")
        return
    path = os.path.join(private(), name)
    with open(path, "w+b") as file:
        yield _Shared(file, path)


def _run(task: Mapping[str, Any], shared: tuple[_Shared, ...], name: str) -> tuple[int, str]:
    """Run the process to its end; returns its status, and the checksum of the first file."""
    words = [sys.executable, "-I", "-c", _START, json.dumps(_paths()), json.dumps(task)]
    environment = {**os.environ, **_ENVIRONMENT}
    descriptors = tuple(number for s in shared for number in s.inherited)
    nothing = subprocess.DEVNULL
    try:
        process = subprocess.Popen(
            words, stdin=nothing, stdout=nothing, stderr=nothing, env=environment,
            pass_fds=descriptors,
        )  # fmt: skip
    except OSError as error:
        raise LogError(
            f"no process can be started to read it ({error.strerror}).",
            where=name,
            remedy="Free memory, or export the recording as CSV.",
        ) from None
    most = _WAIT + 4 * task["seconds"]
    try:
        shared[0].file.seek(0)
        sha256 = hashlib.file_digest(shared[0].file, "sha256").hexdigest()
        return process.wait(timeout=most), sha256
    except subprocess.TimeoutExpired:
        raise _too_slow(f"{most:.0f} s", name) from None
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def _paths() -> list[str]:
    """Return the module search path, never with the folder that happens to be the working
    one."""
    home = str(Path(__file__).parents[2])
    known = [p for p in sys.path if os.path.isabs(p)]
    return known if home in known else [*known, home]


def _too_slow(taken: str, name: str) -> LogError:
    return LogError(
        f"reading it takes more than {taken}.",
        where=name,
        expected="Expected less, by the size of the file: it may be damaged.",
        remedy="Export the recording again, or as CSV.",
    )


def _require_unchanged(given: _Shared, source: Path, before: os.stat_result, name: str) -> None:
    """Refuse a file that was not the same all the time."""
    seen = [before, os.fstat(given.file.fileno())]
    if not given.inherited:  # the other process opened it by its name
        seen.append(os.stat(source))
    if len({(s.st_size, s.st_mtime_ns) for s in seen}) > 1:
        raise LogError(
            "the file changed while it was read.",
            where=name,
            remedy="Record to the end first, or copy the file, and read that.",
        )


def _description(answer: BinaryIO, ended: int, task: Mapping[str, Any], name: str) -> Any:
    """Return what the process wrote of its own accord; ``LogError`` for anything else."""
    answer.seek(0)
    text = answer.read(_LONGEST + 1)
    if ended == 0 and len(text) <= _LONGEST:
        try:
            described = json.loads(text)
        except ValueError:
            described = None
        if described is not None:
            if "error" in described:
                what, expected, remedy = described["error"]
                raise LogError(what, where=name, expected=expected, remedy=remedy)
            return described
    ends = {getattr(signal, n, 0) for n in ("SIGXCPU", "SIGKILL")}
    if -ended in ends:
        raise _too_slow(
            f"{task['seconds']} s of processor time, or more memory than there is", name
        )
    how = f"status {ended}"
    if ended < 0:
        how = signal.Signals(-ended).name if -ended in set(signal.Signals) else f"signal {-ended}"
    raise LogError(
        f"the file is damaged: the library that reads it ended with {how}.",
        where=name,
        expected=f"Expected a whole {task['reader'].upper()} file.",
        remedy="Export the recording again, or as CSV.",
    )


class _Mapping(mmap.mmap):
    """Numbers of a column in memory of both processes, given back when nobody needs them."""

    owner: int | None = None

    def __del__(
        self, remove: int | None = getattr(mmap, "MADV_REMOVE", None), pid: Any = os.getpid
    ) -> None:
        if remove is not None and self.owner == pid():  # a copy of this process shares them
            with suppress(OSError, ValueError):
                self.madvise(remove)


def _recording(described: Mapping[str, Any], numbers: BinaryIO, sha256: str) -> Recording:
    vectors = []
    for entry in described["vectors"]:
        kind, rows = np.dtype(entry["kind"]), int(entry["rows"])
        values: npt.NDArray[Any] = np.empty(0, kind)
        if rows:
            size = rows * kind.itemsize
            mapping = _Mapping(numbers.fileno(), size, offset=entry["begin"])
            mapping.owner = os.getpid() if hasattr(os, "memfd_create") else None
            values = np.frombuffer(mapping, kind)
        if entry["role"] == "text":
            cells = values.tobytes().decode("utf-8", "replace").split("\n")
            values = np.array(cells, dtype=object)
        bad = {int(row): str(text) for row, text in entry["bad"].items()}
        vectors.append(
            Vector(
                entry["name"], entry["group"], entry["unit"], values, entry["instants"],
                entry["clock"], int(entry["since"]), entry["role"], bad,
            )
        )  # fmt: skip
    told = {k: tuple(map(tuple, described[k])) for k in ("converted", "left_out", "notices")}
    return Recording(dialect=described["dialect"], vectors=tuple(vectors), **told, sha256=sha256)
