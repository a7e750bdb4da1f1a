"""IEC 61131-3 Structured Text (TwinCAT): constants, function blocks and their self-test."""

from __future__ import annotations

from collections.abc import Mapping

from ..target import Job
from .files import text_of


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.st``."""
    return {f"{job.file}.st": text_of(job).encode("ascii")}
