"""C99 for controllers: header, source and a self-test with golden vectors."""

from __future__ import annotations

from collections.abc import Mapping

from ..target import Job
from .files import Function, header, self_test, source


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.h``, ``NAME.c`` and ``NAME_selftest.c``."""
    functions = [Function.of(r, job.name) for r in job.block.routines()]
    parts = {"h": header, "c": source}
    files = {f"{job.file}.{end}": make(job, functions) for end, make in parts.items()}
    files[f"{job.file}_selftest.c"] = self_test(job, functions)
    return {name: text.encode("ascii") for name, text in files.items()}
