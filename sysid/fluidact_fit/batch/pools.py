"""Processes of this machine that run jobs. Others are in :mod:`.cluster`.

A pool runs a function over tasks and gives the outcomes as they come. What was running in a
process that died is run again; a task that takes its process with it is given up.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from typing import Protocol

from .outcome import JobResult, Task, died

Execute = Callable[[Task], JobResult]
_AHEAD = 3  # tasks a process has waiting: none is ever idle, and few are lost with a kill


class Pool(Protocol):
    """Runs tasks."""

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[JobResult]:
        """Outcomes of all tasks, in the order in which they end."""
        ...


class LocalPool:
    """Processes of this machine.

    Parameters
    ----------
    workers
        How many.
    preload
        Modules that are imported once, before the processes are made.
    """

    def __init__(self, workers: int, preload: Sequence[str] = ()) -> None:
        self.workers, self.preload = workers, list(preload)

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[JobResult]:
        """See :class:`Pool`."""
        waiting = deque(tasks)
        while waiting:
            # Any of the lost may have ended the process: each is tried once more, by itself.
            suspects = deque((yield from self._round(execute, waiting, self.workers, _AHEAD)))
            while suspects:
                for task in (yield from self._round(execute, suspects, 1, 1)):
                    yield died(task, "twice")

    def _round(
        self, execute: Execute, waiting: deque[Task], workers: int, ahead: int
    ) -> Generator[JobResult, None, list[Task]]:
        """Outcomes until nothing waits or a process has died; returns what was lost with it."""
        running: dict[Future[JobResult], Task] = {}
        lost: list[Task] = []
        with self._processes(workers) as processes:
            while (waiting or running) and not lost:
                while waiting and len(running) < ahead * workers:
                    try:
                        future = processes.submit(execute, waiting[0])
                    except BrokenProcessPool:
                        if not running:  # it died idle: nothing is lost but the process
                            return lost
                        break
                    running[future] = waiting.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task = running.pop(future)
                    try:
                        yield future.result()
                    except BrokenProcessPool:
                        lost.append(task)
        return [*lost, *running.values()] if lost else []

    @contextmanager
    def _processes(self, workers: int) -> Iterator[ProcessPoolExecutor]:
        # From a server that has the imports done, where there is one: a new process is cheap.
        method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
        context = get_context(method)
        context.set_forkserver_preload(self.preload)
        if method == "forkserver":
            _start_server()
        reading, writing = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(workers, context, _prepare, (reading,))
        try:
            yield pool
        except BaseException:
            writing.close()  # the processes leave at once
            if method == "forkserver":
                _stop_server()
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            writing.close()
            reading.close()


def _start_server() -> None:
    """Start the fork server with Ctrl-C blocked, which would end its imports with a traceback."""
    import signal
    from multiprocessing import resource_tracker
    from multiprocessing.forkserver import ensure_running

    resource_tracker.ensure_running()  # the server needs it, and starting it unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _stop_server() -> None:
    """Stop the fork server: it would go on importing, and then fail on semaphores that are gone."""
    import signal
    from multiprocessing import forkserver

    server = getattr(forkserver, "_forkserver", None)
    pid = getattr(server, "_forkserver_pid", None)
    if pid is not None:
        with suppress(OSError):
            os.kill(pid, signal.SIGKILL)


def _prepare(alive: Connection) -> None:
    """Prepare a process: it leaves when the batch does, and leaves Ctrl-C to the batch."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_after, args=(alive,), daemon=True).start()


def _leave_after(alive: Connection) -> None:
    """Wait until the other end is closed, by the batch or by the end of it."""
    with suppress(EOFError, OSError):
        alive.recv_bytes()
    os._exit(1)
