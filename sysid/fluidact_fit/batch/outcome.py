"""A job as seen by whoever runs it, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, NotRequired

from typing_extensions import TypedDict

from ..parameters.atomic import write_atomically

STATUS = {
    0: "done", 1: "bug", 2: "wrong usage", 3: "unusable", 4: "refused",
}  # fmt: skip
DIED = 1  # exit status of a job whose process was ended by the system
USAGE = 2
Numbers = float | list[float] | list[list[float]]


class Number(TypedDict):
    """A parameter as a summary shows it."""

    value: Numbers
    std_error: NotRequired[Numbers]
    unit: str
    status: str


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
    pictures
        Paths of the files that its options name.
    replace_any
        Whether its options allow to replace files of anybody.
    refusal
        Why it must not run; empty where it may.
    replace
        Whether its files are the batch's own: one that is there when it runs, such as that of an
        attempt whose process died, is replaced.
    """

    job: str
    key: str
    words: tuple[str, ...]
    folder: str
    output: str
    record: str
    pictures: tuple[str, ...] = ()
    replace_any: bool = False
    refusal: str = ""
    replace: bool = False

    @property
    def files(self) -> tuple[str, ...]:
        """All files that it writes."""
        return (self.output, self.record, *self.pictures)


@dataclass(frozen=True)
class JobResult:
    """Result of a job.

    ``parameters`` map names to ``value``, ``std_error``, ``unit`` and ``status`` as in the
    parameter file; ``warnings`` are codes; ``reason`` is what was found, without where;
    ``seconds`` are of the processor.
    ``lasting`` is false where another try may end otherwise: a full disk, a process that died, a
    file in the way.
    ``files`` are those that it wrote, as seen from the folder of the batch, with their checksums.
    """

    job: str
    key: str
    exit: int
    verdict: str = ""
    message: str = ""
    reason: str = ""
    warnings: Sequence[str] = ()
    parameters: Mapping[str, Number] = field(default_factory=dict)
    seconds: float = 0.0
    lasting: bool = True
    files: Mapping[str, str] = field(default_factory=dict)

    # what is read from a journal is of these types or damaged
    __pydantic_config__: ClassVar = {"strict": True, "extra": "forbid", "allow_inf_nan": False}

    @property
    def status(self) -> str:
        """The exit status in words."""
        return STATUS.get(self.exit, "failed")

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def died(task: Task, why: str) -> JobResult:
    """The outcome of a job that took its process with it, however often it was tried."""
    message = (
        f"The process of this job ended {why}. It may need more memory than there is: "
        "fit fewer or shorter logs (--window START:END), or give --workers a smaller number."
    )
    reason = "the process of the job died"
    return JobResult(task.job, task.key, DIED, message=message, reason=reason, lasting=False)


def refused(task: Task, why: str, remedy: str) -> JobResult:
    """The outcome of a job that may not run: it would write where it must not."""
    message = f"{why}\n{remedy}"
    return JobResult(task.job, task.key, USAGE, message=message, reason=why, lasting=False)


def write_record(task: Task, command: str, said: str, outcome: JobResult) -> None:
    """Write the text that keeps what a job said.

    Raises
    ------
    OutputError
        When it cannot be written.
    """
    parts = (f"$ {command}", said.strip(), outcome.message,
             f"exit status {outcome.exit}, {outcome.status}")  # fmt: skip
    text = "\n".join(part for part in parts if part) + "\n"
    write_atomically(task.record, text.encode("utf-8", "backslashreplace"), overwrite=True)
