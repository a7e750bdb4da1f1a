"""C99 for controllers: header, source and a self-test with golden vectors."""

from __future__ import annotations

from collections.abc import Mapping

from ..target import Job
from . import fixed_files
from .files import Function, header, self_test, source


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.h``, ``NAME.c`` and ``NAME_selftest.c``.

    Raises
    ------
    UsageError
        If fixed point is asked for and no routine of the file can be had in it.
    """
    if job.arithmetic == "q15":
        return fixed_files.write(job)
    functions = [Function.of(r, job.name) for r in job.block.routines()]
    parts = {"h": header, "c": source}
    files = {f"{job.file}.{end}": make(job, functions) for end, make in parts.items()}
    files[f"{job.file}_selftest.c"] = self_test(job, functions)
    return {name: text.encode("ascii") for name, text in files.items()}
