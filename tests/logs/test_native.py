"""The process that reads a recording: its limits, its end, and a file that changes meanwhile."""

from __future__ import annotations

import hashlib
import io
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import native, read_log

T = 0.01 * np.arange(200)


def write(path: Path, factor: float = 1.0) -> Path:
    pd.DataFrame({"time": T, "x": factor * T}).to_parquet(path)
    return path


@pytest.fixture
def descriptors() -> Iterator[None]:
    before = set(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    yield
    if before is not None:
        assert len(set(os.listdir("/proc/self/fd"))) <= len(before)


def instead(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Run other code in the place of the reader, with the same limits."""
    start = native._START.removesuffix("main()")
    monkeypatch.setattr(
        native, "_START",
        f"{start}import os, time; from fluidact_fit.formats import worker; "
        "task = __import__('json').loads(sys.argv[1]); worker._limit(task); " + code,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("os.kill(os.getpid(), 11)", "damaged: .* SIGSEGV"),
        ("os.abort()", "damaged: .* SIGABRT"),
        ("os._exit(7)", "damaged: .* status 7"),
        ("pass", "damaged: .* status 0"),
        ("open(task['answer'], 'w').write('{')", "damaged: .* status 0"),
        ("print('noise' * 100_000); os.kill(os.getpid(), 9)", "takes more than 1 s"),
        ("[0 for _ in iter(int, 1)]", "takes more than 1 s of processor time"),
        ("time.sleep(60)", "takes more than 4 s"),
    ],
)
def test_a_reader_that_ends_otherwise_is_a_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, descriptors: None, code: str, said: str
) -> None:
    monkeypatch.setattr(native, "_SECONDS", 0.0)
    monkeypatch.setattr(native, "_WAIT", 0.0)
    path = write(tmp_path / "log.parquet")
    instead(monkeypatch, code)
    with pytest.raises(LogError, match=said) as caught:
        read_log(path)
    assert "Export the recording again" in caught.value.text


def test_memory_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("resource")
    path = write(tmp_path / "log.parquet")
    instead(monkeypatch, "task['reader'] = 'x'; worker._answer = lambda t: bytes(2 << 30); "
                         "sys.argv[1:] = sys.argv[1:2]; worker.main()")  # fmt: skip
    with pytest.raises(LogError, match="damaged"):
        read_log(path)


@pytest.mark.parametrize("pathless", [False, True])
def test_where_descriptors_have_no_path_files_have_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pathless: bool
) -> None:
    """As on systems without ``/proc``."""
    path = write(tmp_path / "log.parquet")
    expected = read_log(path)
    monkeypatch.setattr(native, "_FDS", str(tmp_path / "nowhere") + os.sep)
    left = set(os.listdir(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    if pathless:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    log = read_log("-" if pathless else path)
    np.testing.assert_array_equal(log.columns[1].values, expected.columns[1].values)
    assert log.sha256 == expected.sha256
    assert set(os.listdir(tmp_path)) == left


def slowly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "_START", "import time; time.sleep(1); " + native._START)


def test_a_file_that_is_replaced_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was opened is read, and its checksum is kept."""
    path, other = write(tmp_path / "log.parquet"), write(tmp_path / "other.parquet", 5.0)
    first = hashlib.sha256(path.read_bytes()).hexdigest()
    slowly(monkeypatch)
    swap = threading.Timer(0.5, os.replace, (other, path))
    swap.start()
    log = read_log(path)
    swap.join()
    np.testing.assert_array_equal(log.columns[1].values, T)
    assert log.sha256 == first
    assert hashlib.sha256(path.read_bytes()).hexdigest() != first


def test_a_file_that_is_written_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, other = write(tmp_path / "log.parquet"), write(tmp_path / "other.parquet", 5.0)
    slowly(monkeypatch)
    swap = threading.Timer(0.5, path.write_bytes, (other.read_bytes(),))
    swap.start()
    with pytest.raises(LogError, match="changed while it was read"):
        read_log(path)
    swap.join()


def test_a_working_folder_with_modules_of_their_names(tmp_path: Path) -> None:
    """What lies beside a log is not run."""
    write(tmp_path / "log.parquet")
    for name in ("pyarrow", "numpy", "json", "resource"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(9)\n")
    code = "import sys; sys.path.remove(''); from fluidact_fit.logs import read_log; "
    code += "sys.path.insert(0, ''); print(read_log('log.parquet').rows)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout == "200\n", done.stderr


def test_numbers_are_the_parents_own_and_given_back(tmp_path: Path) -> None:
    """They can be written to, and stay as long as any part of them is used."""
    path = tmp_path / "log.parquet"
    pd.DataFrame({"x": np.arange(1e5)}).to_parquet(path)
    log = read_log(path)
    part = log.columns[0].values[500:600]
    del log
    part += 1.0
    np.testing.assert_array_equal(part, 501.0 + np.arange(100))


def test_nothing_waits_for_a_reader_that_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "log.parquet")
    instead(monkeypatch, "time.sleep(60)")
    started: list[Any] = []
    popen = subprocess.Popen

    def start(*words: Any, **how: Any) -> Any:
        started.append(popen(*words, **how))
        started[0].wait = lambda timeout=None: interrupt() if timeout else popen.wait(started[0])
        return started[0]

    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(native.subprocess, "Popen", start)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        read_log(path)
    assert started[0].returncode == -9
    assert time.monotonic() - began < 50.0


def test_no_room_is_a_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: Any, **__: Any) -> Any:
        raise OSError(12, "Cannot allocate memory")

    path = write(tmp_path / "log.parquet")
    monkeypatch.setattr(native, "_recording", none)
    with pytest.raises(LogError, match="no room to read it"):
        read_log(path)
