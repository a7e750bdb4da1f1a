"""Where jobs run: processes of this machine, or the workers of a Dask scheduler.

A pool runs a function over tasks and gives the outcomes as they come. What was running in a
process that died is run again; a task that takes its process with it is given up.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Protocol

from ..errors import UsageError
from .outcome import Outcome, Task, died

if TYPE_CHECKING:
    from distributed import Client

Execute = Callable[[Task], Outcome]
_AHEAD = 3  # tasks a process has waiting: none is ever idle, and few are lost with a kill
_AT_SCHEDULER = 2000  # tasks that a scheduler knows of at a time

# Module and class of a cluster, and what a worker of it has to be for one fit at a time. All
# else is in dask's own configuration files.
CLUSTERS: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    "local": ("distributed", "LocalCluster", {"n_workers": 0, "threads_per_worker": 1}),
    "slurm": ("dask_jobqueue", "SLURMCluster", {}),
    "kubernetes": ("dask_kubernetes.operator", "KubeCluster", {}),
}


class Pool(Protocol):
    """Runs tasks."""

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[Outcome]:
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

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[Outcome]:
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
    ) -> Generator[Outcome, None, list[Task]]:
        """Outcomes until nothing waits or a process has died; returns what was lost with it."""
        running: dict[Future[Outcome], Task] = {}
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
        reading, writing = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(workers, context, _prepare, (reading,))
        try:
            yield pool
        except BaseException:
            writing.close()  # the processes leave at once
            raise
        finally:
            pool.shutdown(cancel_futures=True)
            writing.close()
            reading.close()


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


class DaskPool:
    """Workers of a Dask scheduler; they see the same files under the same names."""

    def __init__(self, client: Client) -> None:
        self.client = client

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[Outcome]:
        """See :class:`Pool`. Tasks of a worker that dies are run by another."""
        from distributed import KilledWorker, as_completed

        waiting, given = deque(tasks), {}

        def give() -> list[Any]:
            task = waiting.popleft()
            future = self.client.submit(execute, task, key=f"{task.job}-{task.key}", pure=False)
            given[future.key] = task
            return [future]

        first = [future for _ in range(min(_AT_SCHEDULER, len(tasks))) for future in give()]
        running = as_completed(first, loop=self.client.loop)
        for future in running:
            task = given.pop(future.key)
            try:
                yield future.result()
            except KilledWorker:
                yield died(task, "with every worker that was given it")
            except ImportError as error:
                raise UsageError(
                    f"the workers of the scheduler cannot run this: {error}.",
                    remedy="Install the same version of fluidact-fit for all of them.",
                ) from error
            if waiting:
                running.update(give())


@contextmanager
def dask_pool(scheduler: str | None, cluster: str | None, workers: int) -> Iterator[DaskPool]:
    """Connect to a scheduler, or start a cluster with so many workers and leave it afterwards.

    Parameters
    ----------
    scheduler
        Address, for example ``tcp://node1:8786``.
    cluster
        One of :data:`CLUSTERS`, set up as Dask's own configuration files say.

    Raises
    ------
    UsageError
        When the package is missing, or the scheduler does not answer.
    """
    module, name, about = CLUSTERS[cluster] if cluster else ("distributed", "Client", {})
    try:
        from importlib import import_module

        made = getattr(import_module(module), name)
        client_class = import_module("distributed").Client
    except ImportError as error:
        package = module.partition(".")[0].replace("_", "-")
        raise UsageError(
            f"this needs the package {package}, which is not installed.",
            remedy=f"Install it: pip install {package}",
        ) from error
    try:
        started = made(**about) if cluster else None
        client = client_class(started or scheduler, timeout="15s", set_as_default=False)
    except (OSError, ValueError, RuntimeError, TimeoutError) as error:
        asked = f"--cluster {cluster}" if cluster else f"--scheduler {scheduler}"
        raise UsageError(
            f"{asked} cannot be used: {' '.join(str(error).split())[:200]}.",
            remedy="Check the address, or dask's configuration of the cluster.",
        ) from error
    try:
        if started is not None:
            started.scale(workers)
        yield DaskPool(client)
    finally:
        client.close()
        if started is not None:
            started.close()
