"""Read one binary recording, within limits, and leave what it holds.

Run as a program with a task in JSON as its only argument. Whatever happens is said in the file for
the answer; a process that leaves none was ended.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from ..errors import LogError

READERS = ("hdf5", "matlab", "mdf", "netcdf", "parquet", "ros", "tdms")


def main() -> None:
    """Do the task; ends the process without tidying up, which some libraries do not survive."""
    task = json.loads(sys.argv[1])
    _limit(task)
    _silence()
    answer = _answer(task)
    with open(task["answer"], "w", encoding="utf-8") as file:
        json.dump(answer, file)
    os._exit(0)


def _limit(task: Mapping[str, Any]) -> None:
    """Bound memory, processor time and files; without a word where the system cannot."""
    try:
        import resource
    except ImportError:  # Windows: there is the limit on the clock
        return
    sizes = {
        "RLIMIT_CORE": 0, "RLIMIT_CPU": task["seconds"], "RLIMIT_AS": task["memory"],
        "RLIMIT_FSIZE": task["memory"],
    }  # fmt: skip
    for name, most in sizes.items():
        try:
            kind = getattr(resource, name)
            _, hard = resource.getrlimit(kind)
            bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (bound, bound))
        except (AttributeError, OSError, ValueError):
            continue


def _silence() -> None:
    """Whatever a library prints is no output of the program."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nowhere, number)


def _answer(task: Mapping[str, Any]) -> dict[str, Any]:
    try:
        if task["reader"] not in READERS:
            raise ValueError(task["reader"])
        sink_module = import_module(f"{__package__}.sink")
        sink = sink_module.Sink(task["numbers"], task["room"])
        import_module(f"{__package__}.{task['reader']}").read(task["source"], sink)
        described: dict[str, Any] = sink.described()
    except LogError as error:
        return {"error": [error.what, error.expected, error.remedy]}
    except MemoryError:
        return {"error": _too_much(task)}
    except Exception as error:
        if "ENOMEM" in str(error) or "memory allocation" in str(error) or "alloc" in str(error):
            return {"error": _too_much(task)}
        said = str(error).replace(task["source"], "it")[:200]
        what = f"the file cannot be read ({type(error).__name__}: {said})."
        return {"error": [what, "", "Export the recording again, or as CSV."]}
    return described


def _too_much(task: Mapping[str, Any]) -> list[str]:
    """Refusal of a file that needs too much memory."""
    return [
        f"reading it takes more than {task['memory'] / 1e9:.1f} GB of memory.",
        "Expected no more, by the size of the file: it may be damaged.",
        "Export the recording again, as CSV, or in parts.",
    ]


if __name__ == "__main__":
    main()
