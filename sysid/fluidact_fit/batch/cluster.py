"""Workers of a Dask scheduler, for jobs beyond this machine.

Schedulers and workers go away. Whoever waits for them is told, and is not kept waiting for ever:
what is finished stands in the journal, and the same command goes on from there.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from math import inf
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from ..errors import SchedulerError, UsageError
from .outcome import JobResult, Task, died
from .pools import Execute

if TYPE_CHECKING:
    from distributed import Client

_AT_SCHEDULER = 2000  # tasks that a scheduler knows of at a time
_LOOK = 2.0  # s without an outcome, after which the scheduler is looked at
_PATIENCE = 30.0  # s without a worker, or without a word of the scheduler
_CONNECT = 5.0  # s
_SHAPE = re.compile(r"(?:tcp|tls|ws|wss|ucx)://(?:\[[0-9a-fA-F:.]+\]|[^\s:/@]+):\d{1,5}/?")
_AGAIN = "What is finished is kept: run the same command again, and it goes on from there."

# Module and class of a cluster, and what a worker of it has to be for one fit at a time. All
# else is in dask's own configuration files.
CLUSTERS: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    "local": ("distributed", "LocalCluster", {"n_workers": 0, "threads_per_worker": 1}),
    "slurm": ("dask_jobqueue", "SLURMCluster", {}),
    "kubernetes": ("dask_kubernetes.operator", "KubeCluster", {}),
}


class DaskPool:
    """Workers of a Dask scheduler; they see the same files under the same names.

    Parameters
    ----------
    client
        Connected.
    patience
        Seconds to wait for a first worker; a cluster with a queue takes its time.
    progress
        Told that it waits, and how long already.
    """

    def __init__(
        self, client: Client, patience: float = _PATIENCE,
        progress: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        self.client, self.patience, self.progress = client, patience, progress
        self._idle: float | None = None  # since when there is nobody to work

    def run(self, execute: Execute, tasks: Sequence[Task]) -> Iterator[JobResult]:
        """See :class:`.Pool`. Tasks of a worker that dies are run by another.

        Raises
        ------
        SchedulerError
            When the scheduler or all workers have gone.
        """
        from distributed import KilledWorker

        waiting = deque(tasks)
        given: dict[str, tuple[Task, Any]] = {}
        ended: SimpleQueue[Any] = SimpleQueue()
        while waiting or given:
            while waiting and len(given) < _AT_SCHEDULER:
                task = waiting.popleft()
                with self._lost():
                    future = self.client.submit(
                        execute, task, key=f"{task.job}-{task.key}", pure=False
                    )
                    future.add_done_callback(ended.put)
                given[future.key] = task, future
            task, future = given.pop(self._wait(ended).key)
            try:
                with self._lost():
                    outcome = future.result(timeout=_PATIENCE)
            except KilledWorker:
                outcome = died(task, "with every worker that was given it")
            yield outcome

    def _wait(self, ended: SimpleQueue[Any]) -> Any:
        """The next task that has ended."""
        while True:
            try:
                future = ended.get(timeout=_LOOK)
            except Empty:
                self._look()
            else:
                self._idle, self.patience = None, _PATIENCE
                return future

    def _look(self) -> None:
        """Tell that nobody works, and give up after a while (``SchedulerError``)."""
        try:
            workers = self.client.sync(self.client.scheduler.ncores, callback_timeout=_LOOK)
            missing = "" if workers else "the scheduler has no workers"
        except Exception:  # whatever a connection that is lost may raise
            workers, missing = {}, "the scheduler does not answer"
        if not missing:
            self._idle, self.patience = None, _PATIENCE
            return
        now = time.monotonic()
        self._idle = now if self._idle is None else self._idle
        if now - self._idle > (self.patience if "workers" in missing else _PATIENCE):
            raise SchedulerError(
                f"{missing}, for {now - self._idle:.0f} s already.",
                remedy=f"Start it, or give another one. {_AGAIN}",
            )
        self.progress(f"waiting: {missing}, for {now - self._idle:.0f} s")

    @contextmanager
    def _lost(self) -> Iterator[None]:
        """Turn what a lost connection raises into an error with a remedy."""
        from distributed import KilledWorker

        try:
            yield
        except (KilledWorker, GeneratorExit):
            raise
        except ImportError as error:
            raise UsageError(
                f"the workers of the scheduler cannot run this: {error}.",
                remedy="Install the same version of fluidact-fit for all of them.",
            ) from error
        # jobs themselves raise nothing, and cancellation is no Exception in every version
        except BaseException as error:
            if isinstance(error, (KeyboardInterrupt, SystemExit)):
                raise
            raise SchedulerError(
                f"the scheduler or its workers went away ({type(error).__name__}).", remedy=_AGAIN
            ) from error


@contextmanager
def dask_pool(
    scheduler: str | None,
    cluster: str | None,
    workers: int,
    progress: Callable[[str], None] = lambda text: None,
) -> Iterator[DaskPool]:
    """Connect to a scheduler, or start a cluster with so many workers and leave it afterwards.

    Parameters
    ----------
    scheduler
        Address, for example ``tcp://node1:8786``.
    cluster
        One of :data:`CLUSTERS`, set up as Dask's own configuration files say.
    workers
        How many, of a cluster.
    progress
        Told what it waits for.

    Raises
    ------
    UsageError
        When the package is missing, or the scheduler does not answer.
    """
    module, name, about = CLUSTERS[cluster] if cluster else ("distributed", "Client", {})
    if scheduler is not None:
        _check_address(scheduler)
    try:
        made = getattr(import_module(module), name)
        client_class = import_module("distributed").Client
    except ImportError as error:
        package = module.partition(".")[0].replace("_", "-")
        raise UsageError(
            f"this needs the package {package}, which is not installed.",
            remedy=f"Install it: pip install {package}",
        ) from error
    # What it logs of a lost connection are tracebacks; errors say what is to be known.
    logging.disable(logging.CRITICAL)
    started = client = None
    try:
        try:
            if scheduler is not None:
                asyncio.run(_hail(scheduler))
            started = made(**about) if cluster else None
            client = client_class(
                started or scheduler, timeout=f"{_CONNECT:g}s", set_as_default=False
            )
        except Exception as error:  # of sockets, of certificates, of configuration files
            asked = f"--cluster {cluster}" if cluster else f"--scheduler {scheduler}"
            found = " ".join(str(error).split())[:200]
            if not found or isinstance(error, MemoryError):  # what others say is taken for sizes
                found = "no scheduler of Dask answers"
            raise UsageError(
                f"{asked} cannot be used: {found.removesuffix('.')}.",
                remedy="Check the address, and dask's configuration of clusters and certificates.",
            ) from error
        if started is not None:
            started.scale(workers)
        queued = cluster not in (None, "local")
        yield DaskPool(client, inf if queued else _PATIENCE, progress)
    finally:
        # the work is done or lost, whatever they say in farewell
        for end in (client, started):
            if end is not None:
                with suppress(Exception):
                    end.close(timeout=_LOOK)
        logging.disable(logging.NOTSET)


def _check_address(scheduler: str) -> None:
    """Refuse what is no address: Dask would try for half a minute."""
    if not _SHAPE.fullmatch(scheduler):
        raise UsageError(
            f"--scheduler {scheduler} cannot be used: it is not an address.",
            expected="Expected tcp://HOST:PORT, or tls://HOST:PORT.",
            remedy="Give the address that the scheduler shows when it starts.",
        )


async def _hail(scheduler: str) -> None:
    """Connect once, which a client does for longer and leaves more behind when it fails."""
    from distributed import Security
    from distributed.comm import connect

    about = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(scheduler, timeout=_CONNECT, **about), 1.2 * _CONNECT)
    comm.abort()
