"""What a job is to whoever runs it, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

STATUS = {
    0: "done", 1: "bug", 2: "wrong usage", 3: "unusable", 4: "refused",
}  # fmt: skip
DIED = 1  # exit status of a job whose process was ended by the system


@dataclass(frozen=True)
class Task:
    """One command line to be run.

    Attributes
    ----------
    job
        Name of the job.
    key
        Fingerprint of logs, options and version: what is finished with the same is not run again.
    words
        Family, logs and options, paths as seen from ``folder``.
    folder
        Where the command is run.
    output, record
        Absolute paths of the parameter file and of the text that keeps what was said.
    replace
        Whether ``output`` may be replaced: it is of this batch.
    """

    job: str
    key: str
    words: tuple[str, ...]
    folder: str
    output: str
    record: str
    replace: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of a job.

    ``parameters`` map names to ``value``, ``std_error``, ``unit`` and ``status`` as in the
    parameter file; ``warnings`` are codes; ``reason`` is what was found, without where;
    ``seconds`` are of the processor.
    ``lasting`` is false where another try may end otherwise: a full disk, a process that died, a
    file in the way.
    """

    job: str
    key: str
    exit: int
    verdict: str = ""
    message: str = ""
    reason: str = ""
    warnings: Sequence[str] = ()
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = 0.0
    lasting: bool = True

    @property
    def status(self) -> str:
        """The exit status in words."""
        return STATUS.get(self.exit, "failed")

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def died(task: Task, why: str) -> Outcome:
    """The outcome of a job that took its process with it, however often it was tried."""
    message = (
        f"The process of this job ended {why}. It may need more memory than there is: "
        "fit fewer or shorter logs (--window START:END), or give --workers a smaller number."
    )
    reason = "the process of the job died"
    return Outcome(task.job, task.key, DIED, message=message, reason=reason, lasting=False)
