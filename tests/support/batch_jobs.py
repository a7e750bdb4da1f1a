"""What the tests of a batch run instead of fits: must be importable in other processes."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

from fluidact_fit.batch.outcome import JobResult, Task


def note(task: Task) -> JobResult:
    """Note that the job ran, and end as its options say."""
    with Path(task.folder, "ran.txt").open("a", encoding="utf-8") as file:
        file.write(task.job + "\n")
    if "die" in task.words:
        os.kill(os.getpid(), signal.SIGKILL)
    if "idle" in task.words:  # the process dies when it has nothing to do
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGKILL)).start()
    if "late" in task.words and Path(task.folder, "ran.txt").read_text().count(task.job) == 1:
        Path(task.output).write_text(task.key, encoding="utf-8")  # and dies before it says so
        os.kill(os.getpid(), signal.SIGKILL)
    if "slow" in task.words:
        time.sleep(0.05)
    failed = 4 if "refuse" in task.words else 0
    if Path(task.output).exists() and not task.replace:
        failed = 2
    if not failed:
        Path(task.output).write_text(task.key, encoding="utf-8")
    return JobResult(task.job, task.key, failed, lasting="again" not in task.words)
