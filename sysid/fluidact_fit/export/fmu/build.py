"""The library of a unit, compiled with the C compiler of the system."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from ...errors import OutputError

_OPTIONS = (
    "-std=c99", "-O2", "-fPIC", "-shared", "-s", "-fvisibility=hidden", "-Wl,--build-id=none",
)  # fmt: skip
_LONGEST = 120.0  # s


def compile_library(name: str, sources: Mapping[str, str]) -> bytes:
    """Return the shared library of ``NAME.c`` for Linux on x86-64.

    Parameters
    ----------
    name
        Identifier of the unit.
    sources
        Files by name, ``NAME.c`` among them.

    Raises
    ------
    OutputError
        Where there is no C compiler, where it makes libraries for another machine, and where it
        fails.
    """
    compiler = _find_compiler()
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="ascii")
        made = f"{name}.so"
        command = [compiler, *_OPTIONS, "-o", made, f"{name}.c", "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, errors="replace",
                timeout=_LONGEST, check=False, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise _failed(compiler, str(problem)) from problem
        if done.returncode != 0:
            raise _failed(compiler, next(iter(done.stderr.splitlines()), "it said nothing"))
        return Path(folder, made).read_bytes()


def _find_compiler() -> str:
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise OutputError(
            f"an FMU holds a library for Linux on x86-64, and this is {platform.system()} on "
            f"{platform.machine()}",
            remedy="Export it on such a machine, or take another target.",
        )
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None:
        raise OutputError(
            "an FMU holds a compiled library, and there is no C compiler here",
            expected="gcc, or a compiler called cc, on the PATH.",
            remedy="Install one (Debian and Ubuntu: gcc and libc6-dev), or take another target.",
        )
    return found


def _failed(compiler: str, said: str) -> OutputError:
    return OutputError(
        f"the C compiler {compiler} did not make the library of the FMU: {said}",
        remedy="Check that it compiles other C (Debian and Ubuntu: gcc and libc6-dev).",
    )
