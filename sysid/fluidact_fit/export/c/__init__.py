"""C99 for controllers: header, source and a self-test with golden vectors."""

from __future__ import annotations

from collections.abc import Mapping

from ..flat import code_of
from ..target import Code, Job
from . import fixed_files
from .constants import macros_of
from .files import Function, header, self_test, source


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.h``, ``NAME.c`` and ``NAME_selftest.c``; see :func:`write_code`."""
    return write_code(code_of(job))


def write_code(code: Code) -> Mapping[str, bytes]:
    """Return the three files of some routines.

    Raises
    ------
    UsageError
        If fixed point is asked for and none of them can be had in it.
    """
    if code.arithmetic == "q15":
        return fixed_files.write(code)
    macros = macros_of(code)
    functions = [Function.of(r, code.name, macros) for r in code.routines]
    files = {
        f"{code.file}.h": header(code, functions, macros),
        f"{code.file}.c": source(code, functions),
        f"{code.file}_selftest.c": self_test(code, functions, macros),
    }
    return {name: text.encode("ascii") for name, text in files.items()}
