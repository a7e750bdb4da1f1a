"""Schedulers and workers that are not there, or go away: said in time, and nothing is lost."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from batch_jobs import note
from fluidact_fit.batch import Job, cluster, run_batch
from fluidact_fit.batch.cluster import dask_pool
from fluidact_fit.errors import SchedulerError, UsageError

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals"),
    pytest.mark.filterwarnings("ignore"),  # of Dask, about what was killed
]
SUPPORT = Path(__file__).parents[1] / "support"


@contextmanager
def _process(*words: str) -> Iterator[subprocess.Popen[str]]:
    paths = [str(SUPPORT), *sys.path]
    process = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + words[0], *words[1:]],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def _free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port: int = found.getsockname()[1]
        return port


@contextmanager
def _scheduler() -> Iterator[tuple[subprocess.Popen[str], str]]:
    port = _free_port()
    words = ("--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
    with _process("dask_scheduler", *words) as process:
        while True:
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
                break
            assert process.poll() is None
            time.sleep(0.1)
        yield process, f"tcp://127.0.0.1:{port}"


def _worker(address: str) -> contextmanager[subprocess.Popen[str]]:
    words = ("--nthreads", "1", "--no-dashboard", "--no-nanny")
    return _process("dask_worker", address, *words)


@pytest.mark.parametrize("address", [
    "nonsense", "", "tcp://", "tcp://localhost", "http://localhost:1", "localhost:8786",
    "tcp://a b:1", "tls://127.0.0.1:9", "tcp://127.0.0.1:{closed}", "tcp://127.0.0.1:{silent}",
    "tcp://no.such.host.invalid:1", "tcp://localhost:99999",
])  # fmt: skip
def test_addresses_that_cannot_be_used(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_CONNECT", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = address.format(closed=_free_port(), silent=silent.getsockname()[1])
        with (
            pytest.raises(UsageError, match="cannot be used") as caught,
            dask_pool(address, None, 1),
        ):
            pass
    assert caught.value.exit_status == 2
    assert caught.value.remedy


@pytest.mark.parametrize("killed", ["scheduler", "only worker"])
def test_what_goes_away_midway(
    killed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_PATIENCE", 2.0)
    monkeypatch.setattr(cluster, "_LOOK", 0.5)
    (tmp_path / "a.csv").touch()
    jobs = [Job(f"j{k}", "line", ("a.csv",), ("slow",)) for k in range(60)]
    said: list[str] = []
    with _scheduler() as (scheduler, address), _worker(address) as worker:
        process = scheduler if killed == "scheduler" else worker

        def progress(text: str) -> None:
            said.append(text)
            if text.startswith("5 of 60"):
                os.killpg(process.pid, signal.SIGKILL)

        with (
            pytest.raises(SchedulerError) as caught,
            dask_pool(address, None, 1, progress) as pool,
        ):
            run_batch(jobs, tmp_path, tmp_path / "out", note, pool, progress=progress)
    assert caught.value.exit_status == 3
    assert "run the same command again" in caught.value.text
    if killed == "only worker":
        assert any("no workers" in text for text in said)
    ran = (tmp_path / "ran.txt").read_text().split()
    (tmp_path / "ran.txt").unlink()
    with _scheduler() as (_, address), _worker(address), dask_pool(address, None, 1) as pool:
        outcomes = run_batch(jobs, tmp_path, tmp_path / "out", note, pool)
    assert [o.exit for o in outcomes] == [0] * 60
    again = (tmp_path / "ran.txt").read_text().split()
    assert {*ran, *again} == {job.name for job in jobs}
    assert len(again) <= 56


def test_a_job_that_the_scheduler_gives_to_another_worker_replaces_its_own_file(
    tmp_path: Path,
) -> None:
    """It found the file that the worker wrote before it died, and refused it."""
    (tmp_path / "a.csv").touch()
    job = Job("j", "line", ("a.csv",), ("late",))
    with (
        _scheduler() as (_, address), _worker(address), _worker(address),
        dask_pool(address, None, 1) as pool,
    ):  # fmt: skip
        (outcome,) = run_batch([job], tmp_path, tmp_path / "out", note, pool)
    assert outcome.exit == 0
    assert (tmp_path / "ran.txt").read_text().split() == ["j", "j"]
