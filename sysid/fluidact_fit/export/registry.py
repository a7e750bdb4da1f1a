"""The registry of export targets: one line each, loaded when first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import NamedTuple

from ..errors import UsageError
from .target import Arithmetic, Target


class Entry(NamedTuple):
    """Where a target lives, and what it can be asked for.

    ``module`` has a function ``write``; ``arithmetics`` are those that it can be told to use,
    the first where it is not told.
    """

    module: str
    title: str
    arithmetics: tuple[Arithmetic, ...] = ()


TARGETS: Mapping[str, Entry] = {
    "c": Entry("c", "C99: header, source and self-test", ("float32", "q15")),
    "st": Entry("structured_text", "IEC 61131-3 Structured Text for TwinCAT: constants and blocks"),
    "ros2": Entry("ros2", "ROS 2 parameters, their declaration and metadata"),
    "matlab": Entry("matlab", "MATLAB, Simulink, dSPACE and Octave: a function and a .mat file"),
    "fmu": Entry("fmu", "a unit for FMI 2.0 co-simulation: sources and a library for Linux"),
    "json": Entry("plain_json", "the whole document as JSON"),
}


def get_target(name: str) -> Target:
    """Return the function that makes the files of a target.

    Raises
    ------
    UsageError
        When there is no such target.
    """
    if name not in TARGETS:
        raise UsageError(
            f"there is no export target {name!r}.", expected=f"Targets: {', '.join(TARGETS)}."
        )
    target: Target = import_module(f".{TARGETS[name].module}", __package__).write
    return target
