"""A controller on its way to the machine: gains and compensation that parameter files gave it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from ..block import Block
from ..control.controller_file import ControllerFile, read_controller_file
from ..control.controller_numbers import numbers_of
from ..control.controllers import Controller
from ..control.machines import make_controller, make_plant
from ..control.margins import loop_margins
from ..control.plants.base import Plant
from ..errors import UsageError
from .target import Arithmetic, Code, Entry, Origin, file_stem, plain_text, remarks_of, safe_name


def controller_code(
    path: str | os.PathLike[str], blocks: Sequence[Block], arithmetic: Arithmetic = "float32",
    origins: Sequence[Origin] = (),
) -> Code:  # fmt: skip
    """Return the routines of a controller file for the machine that the blocks describe.

    Raises
    ------
    ControllerFileError, UsageError
        When the file cannot be used or does not fit the machine.
    """
    file = read_controller_file(path)
    plant = make_plant(file, blocks)
    controller = make_controller(file, blocks, plant)
    travel, command = controller.travel, plant.commands[0].unit
    if not isfinite(travel.high):
        raise UsageError(
            f"no parameter file holds a range of {travel.role!r}, which the controller measures",
            remedy="Give machine.travel_from and machine.travel_to in the controller file.",
        )
    name, families = Path(path).name, plain_text(", ".join(b.family for b in blocks))
    remarks = [r for b in blocks for r in remarks_of(b)] + _stability(plant, controller)
    remarks += [*controller.unreached, *_beginning(file, controller, command)]
    return Code(
        safe_name(name), file_stem(name), f"{file.kind} controller of {families}",
        controller.routines(command),
        arithmetic, tuple(map(plain_text, remarks)),
        tuple(Entry(*number) for number in numbers_of(controller, travel.unit, command)),
        origin=tuple(origins),
    )  # fmt: skip


def _beginning(file: ControllerFile, controller: Controller, unit: str) -> list[str]:
    """State after a reset of a controller that holds the machine somewhere."""
    travel, held = controller.travel, controller.begins
    if len(held) > 1 or not any(held):
        return []
    place = file.reference.start or 0.0
    return [f"A reset begins at {place:g} {travel.unit}, with a command of {held[0]:.6g} {unit}"]


def _stability(plant: Plant, controller: Controller) -> list[str]:
    """Warnings about the margins; none for a loop without margins."""
    margins = loop_margins(plant, controller)
    return [f"UNSTABLE: {margins.warning}"] if margins and margins.warning else []
