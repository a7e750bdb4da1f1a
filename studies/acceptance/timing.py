"""Processor time of whole processes, as multiples of a process of imports and plain computation."""

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
# A fit is imports, arrays, small decompositions and interpreted Python. Imports alone are no
# yardstick for it: machines differ by half in how imports and computation compare.
_YARDSTICK_CODE = """\
import numpy as np, scipy.linalg, scipy.signal
noise = np.random.default_rng(1).normal(size=(4000, 8))
for _ in range(240):
    rows = scipy.signal.lfilter([0.1], [1.0, -0.9], noise, axis=0)
    values = scipy.linalg.lstsq(rows, noise[:, 0])[0]
    total = sum(i * i for i in range(20000))
"""
_YARDSTICK = [sys.executable, "-c", _YARDSTICK_CODE]


def figures(data: Path, folder: Path) -> list[Figure]:
    """Measure; nothing else of ours may run at the same time."""
    commands = [(GROUP, family, readme.commands()[family]) for family in FAMILIES]
    if (data / "emps").is_dir():
        commands.append((MEASURED, "EMPS symmetric", measured.emps_command(data)))
    processor_time(_YARDSTICK)  # reads the files once
    return [_ratio(*command, folder / "timed.yaml") for command in commands]


def _ratio(group: str, name: str, given: list[str], output: Path) -> Figure:
    """Median over alternating pairs."""
    command = [str(PROGRAM), *given, "-q", "-f", "-o", str(output)]
    seen: float | str
    try:
        seen = median(processor_time(command) / processor_time(_YARDSTICK) for _ in range(REPEATS))
    except RuntimeError as error:
        seen = str(error)
    what = f"processor time of the fit per that of the yardstick, median of {REPEATS}"
    return number(group, f"time of {name}", what, "-", seen, "low", share=NOISE)
