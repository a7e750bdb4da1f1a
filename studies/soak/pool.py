"""Cases in processes of their own, which are ended when they take too long.

Nothing within a process can stop a computation that never returns to Python, so the system does:
it ends the process at the limit of its time, and another one takes its place.
"""

from __future__ import annotations

import os
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import connection, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .case import HANG, TRACEBACK, Case, Part, Result, numbers

Task = tuple[Part, int]
_TOO_LONG = (signal.SIGPROF, signal.SIGALRM)


def run_case(
    part: Part, number: int, seed: int, folder: Path, tell: Callable[[str], None] = lambda _: None
) -> Result:
    """Run one case in this process; what it raises is a failure of the case."""
    told: list[str] = []

    def note(about: str) -> None:
        told.append(about)
        tell(about)

    folder.mkdir(parents=True, exist_ok=True)
    before = os.getcwd()
    os.chdir(folder)
    try:
        result = part.run(Case(numbers(part, number, seed), folder, part.limit, note))
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.name}"
        result = Result("traceback", message=traceback.format_exc())
        result.fail(TRACEBACK, f"{type(error).__name__} in {where}: {error}")
    finally:
        os.chdir(before)
    result.part, result.number, result.about = part.name, number, "; ".join(told)
    return result


class _Worker:
    """A process that runs one case after the other, and what it is at."""

    def __init__(self, seed: int, folder: Path) -> None:
        context = get_context("fork")  # a part holds functions that cannot be sent
        self.end, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, seed, folder))
        self.process.start()
        other.close()
        self.task: Task | None = None
        self.about = ""
        self.gone = False

    def start(self, task: Task) -> None:
        """Begin a case."""
        self.task, self.about = task, ""
        self.end.send(task[1])

    def stop(self) -> None:
        """End the process, at once if it is not idle."""
        if self.task is None:
            self.end.send(None)
        else:
            self.process.terminate()
        self.process.join()

    def died(self) -> Result:
        """What the end of the process says of its case."""
        self.process.join()
        self.gone = True
        code = self.process.exitcode or 0
        result = Result("hang" if -code in _TOO_LONG else "traceback", about=self.about)
        if -code in _TOO_LONG:
            result.fail(HANG, "ended at the limit of its time")
        else:
            result.fail(TRACEBACK, f"the process ended with status {code}")
        assert self.task is not None
        result.part, result.number = self.task[0].name, self.task[1]
        return result


_PARTS: list[Part] = []  # of the cases under way; the processes are forked with it


def _serve(end: Any, seed: int, folder: Path) -> None:
    for number in _TOO_LONG:
        signal.signal(number, signal.SIG_DFL)
    part = _PARTS[-1]
    while (number := end.recv()) is not None:
        signal.setitimer(signal.ITIMER_PROF, part.limit)
        signal.setitimer(signal.ITIMER_REAL, part.wait)
        with TemporaryDirectory(dir=folder) as place:
            result = run_case(part, number, seed, Path(place), lambda t: end.send(("about", t)))
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        end.send(("done", result))


def run_part(part: Part, cases: Sequence[int], seed: int, jobs: int) -> Iterator[Result]:
    """Run cases of a part, yielding each result as it comes."""
    _PARTS.append(part)
    waiting = [(part, number) for number in reversed(cases)]
    with TemporaryDirectory(prefix="soak-") as name:
        folder = Path(name)
        workers: list[_Worker] = []
        try:
            while waiting or any(w.task for w in workers):
                while waiting and len(workers) < jobs:
                    workers.append(_Worker(seed, folder))
                for worker in workers:
                    if worker.task is None and waiting:
                        worker.start(waiting.pop())
                busy = [w for w in workers if w.task]
                ready = connection.wait([w.end for w in busy])
                for worker in [w for w in busy if w.end in ready]:
                    result = _hear(worker)
                    if result is not None:
                        yield result
                    if worker.gone:
                        workers.remove(worker)
        finally:
            _PARTS.pop()
            for worker in workers:
                with suppress(OSError):
                    worker.stop()


def _hear(worker: _Worker) -> Result | None:
    """Take one message of a worker; a result when its case is over."""
    try:
        kind, content = worker.end.recv()
    except (EOFError, ConnectionResetError):
        return worker.died()
    if kind == "about":
        worker.about = "; ".join(filter(None, (worker.about, content)))
        return None
    worker.task = None
    return content
