"""The installed command line as a process, with a time limit, and the file that it writes."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(sys.executable).with_name("fluidact-fit")
LIMIT = 120.0  # s of processor time, which other work on the machine hardly changes
WALL = 6.0  # the time by the clock may be longer by this factor
_OUT_OF_TIME = (-signal.SIGXCPU, -signal.SIGKILL)


@dataclass(frozen=True)
class Run:
    """How a process ended; ``status`` is None when it did not within its limit [s]."""

    status: int | None
    file: dict[str, Any] | None
    said: str
    limit: float

    @property
    def word(self) -> str:
        """The end in words: ``exit 0`` or ``did not end in 120 s``."""
        if self.status is None:
            return f"did not end in {self.limit:g} s"
        return f"exit {self.status}"

    @property
    def outcome(self) -> str:
        """The end and the verdict: ``exit 0, pass``."""
        return self.word if self.file is None else f"{self.word}, {self.file['fit']['verdict']}"


def execute(words: Sequence[str], limit: float = LIMIT) -> Run:
    """Run ``fluidact-fit`` in the root of the repository."""
    done = _process([str(PROGRAM), *words], limit)
    if done is None:
        return Run(None, None, "", limit)
    return Run(done.returncode, None, done.stderr + done.stdout, limit)


def _process(command: Sequence[str], limit: float) -> subprocess.CompletedProcess[str] | None:
    """Run to the end, or return None after ``limit`` seconds of processor time."""
    limited = ["sh", "-c", f'ulimit -t {limit:.0f} && exec "$@"', "sh", *command]
    try:
        done = subprocess.run(
            limited, cwd=ROOT, capture_output=True, text=True, timeout=WALL * limit, check=False
        )
    except subprocess.TimeoutExpired:
        return None
    return None if done.returncode in _OUT_OF_TIME else done


def fit(words: Sequence[str], output: Path, limit: float = LIMIT) -> Run:
    """Fit into ``output``; the file is None where none was written."""
    output.unlink(missing_ok=True)
    run = execute([*words, "-o", str(output), "-q"], limit)
    if run.status is None or not output.exists():
        return run
    file = yaml.safe_load(output.read_text(encoding="utf-8"))
    return Run(run.status, file, run.said, limit)


def processor_time(command: Sequence[str], limit: float = LIMIT) -> float:
    """User and system time of a process [s]; no other may be under way.

    Raises
    ------
    RuntimeError
        When it fails or does not end.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = _process(command, limit)
    if done is None:
        raise RuntimeError(f"did not end in {limit:g} s")
    if done.returncode != 0:
        raise RuntimeError(f"exit {done.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
