"""The registry of export targets: one line each, loaded when first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import NamedTuple

from ..arguments import require
from ..errors import UsageError
from .target import Arithmetic, ControllerTarget, Target


class Entry(NamedTuple):
    """Module of a target, and the options that it takes.

    ``module`` has a function ``write``, and ``write_code`` where it knows ``controllers``;
    ``arithmetics`` are those that it can be told to use, the first where it is not told.
    """

    module: str
    title: str
    arithmetics: tuple[Arithmetic, ...] = ()
    controllers: bool = False


# fmt: off
TARGETS: Mapping[str, Entry] = {
    "c": Entry("c", "C99: header, source and self-test", ("float32", "q15"), True),
    "st": Entry("structured_text", "IEC 61131-3 Structured Text for TwinCAT: constants and blocks",
                controllers=True),
    "ros2": Entry("ros2", "ROS 2 parameters, their declaration and metadata", controllers=True),
    "matlab": Entry("matlab", "MATLAB, Simulink, dSPACE and Octave: a function and a .mat file"),
    "fmu": Entry("fmu", "a unit for FMI 2.0 co-simulation: sources and a library for Linux"),
    "json": Entry("plain_json", "the whole document as JSON"),
}
# fmt: on


def get_target(name: str) -> Target:
    """Return the function that makes the files of a target.

    Raises
    ------
    UsageError
        When there is no such target.
    """
    require("text", to=name)
    if name not in TARGETS:
        raise UsageError(
            f"there is no export target {name!r}.", expected=f"Targets: {', '.join(TARGETS)}."
        )
    target: Target = import_module(f".{TARGETS[name].module}", __package__).write
    return target


def get_controller_target(name: str) -> ControllerTarget:
    """Return the function that makes the files of a controller.

    Raises
    ------
    UsageError
        When the target knows no controllers.
    """
    if not TARGETS[name].controllers:
        known = ", ".join(n for n, entry in TARGETS.items() if entry.controllers)
        raise UsageError(
            f"--to {name} does not know controllers.",
            expected=f"Targets that do: {known}.",
            remedy="Choose one of them, or give no --controller.",
        )
    target: ControllerTarget = import_module(f".{TARGETS[name].module}", __package__).write_code
    return target
