"""IEC 61131-3 Structured Text (TwinCAT): constants, function blocks and their self-test."""

from __future__ import annotations

from collections.abc import Mapping

from ..flat import code_of
from ..target import Code, Job
from .files import text_of


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.st``."""
    return write_code(code_of(job))


def write_code(code: Code) -> Mapping[str, bytes]:
    """Return the file of some routines."""
    return {f"{code.file}.st": text_of(code).encode("ascii")}
