"""Processor time of whole processes, as multiples of importing the libraries under them."""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median

from . import measured, readme
from .command import PROGRAM, processor_time
from .figures import Figure, number

GROUP = "times"
MEASURED = "times of measured logs"
FAMILIES = ("valve", "potentiometer", "line", "hydrostatic", "ball-screw")
NOISE = 0.35  # of a ratio: other work on the machine, caches
REPEATS = 3
_IMPORTS = [sys.executable, "-c", "import numpy, scipy.signal, pandas"]


def figures(data: Path, folder: Path) -> list[Figure]:
    """Measure; nothing else of ours may run at the same time."""
    commands = [(GROUP, family, readme.commands()[family]) for family in FAMILIES]
    if (data / "emps").is_dir():
        commands.append((MEASURED, "EMPS symmetric", measured.emps_command(data)))
    processor_time(_IMPORTS)  # reads the files once
    return [_ratio(*command, folder / "timed.yaml") for command in commands]


def _ratio(group: str, name: str, given: list[str], output: Path) -> Figure:
    """Median over alternating pairs."""
    command = [str(PROGRAM), *given, "-q", "-f", "-o", str(output)]
    seen: float | str
    try:
        seen = median(processor_time(command) / processor_time(_IMPORTS) for _ in range(REPEATS))
    except RuntimeError as error:
        seen = str(error)
    what = f"processor time of the fit per that of the imports, median of {REPEATS}"
    return number(group, f"time of {name}", what, "-", seen, "low", share=NOISE)
