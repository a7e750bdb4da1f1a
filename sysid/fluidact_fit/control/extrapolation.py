"""Detection of a loop that leaves what the logs of its parameter files covered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..block import Block, ValidRange
from ..experiment import FloatArray
from .controllers import Controller
from .loop import LoopResponse
from .plants.base import Plant

_SLACK = 1e-6  # of a range: what is no farther beyond it is rounding
_SPEEDS = ("velocity", "angular_velocity")


def extrapolations(
    blocks: Sequence[Block], plant: Plant, controller: Controller, response: LoopResponse
) -> Iterator[str]:
    """Yield a line for every role that goes beyond the range of a file.

    Where the machine is the same at every place, not the place counts, but how far it moves.
    """
    (low, high), (role, unit) = controller.travel.reach, plant.controlled
    places = np.append(response.output, response.reference)
    if (places < low).any() or (places > high).any():
        yield (
            f"the {role} goes from {places.min():.4g} to {places.max():.4g} {unit}: more than 10 "
            "strokes beyond the logs, or beyond machine.travel_from and travel_to, where the "
            "controller believes no reading and holds its command"
        )
    driving = _commands(plant, response)
    for block in blocks:
        for role, known in block.validity.items():
            if block.input is not None and role == block.input.role and role in driving:
                yield from _driven(block, role, known, driving[role])
                continue
            values = _seen(role, plant, response)
            if values is not None:
                yield from _reached(block, role, known, values, plant)


def _commands(plant: Plant, response: LoopResponse) -> Mapping[str, FloatArray]:
    """Commands by the role of what they drive; those of both chambers are of one."""
    found: dict[str, FloatArray] = {}
    for port, values in zip(plant.commands, response.commands.T):
        role = port.role.removesuffix("_1").removesuffix("_2")
        found[role] = np.append(found.get(role, np.zeros(0)), values)
    return found


def _seen(role: str, plant: Plant, response: LoopResponse) -> FloatArray | None:
    """Return the measured and wanted values of a role; ``None`` for one that nothing measures."""
    if role == plant.controlled.role:
        return np.append(response.output, response.reference)
    if role in _SPEEDS:
        return response.measured.get("speed")
    if role == "pressure" and plant.units.get("drive") == "Pa":
        return response.measured.get("drive")
    return response.measured.get(role)


def _driven(block: Block, role: str, known: ValidRange, values: FloatArray) -> Iterator[str]:
    if _beyond(known, values):
        yield (
            f"the {role} that is asked for goes {_span(values, known)}: beyond {_logs(known)} of "
            f"{block.family}, at the end of which it is taken, as by every export"
        )


def _reached(
    block: Block, role: str, known: ValidRange, values: FloatArray, plant: Plant
) -> Iterator[str]:
    if role == plant.controlled.role and plant.anywhere:
        moved, covered = float(np.ptp(values)), known.high - known.low
        if moved > covered * (1.0 + _SLACK):
            yield (
                f"the {role} moves over {moved:.4g} {known.unit}: farther than the {covered:.4g} "
                f"{known.unit} that the logs of {block.family} covered, and the model extrapolates"
            )
    elif _beyond(known, values):
        yield (
            f"the {role} goes {_span(values, known)}: beyond {_logs(known)} of {block.family}, and "
            "the model extrapolates, or takes the end of its range"
        )


def _beyond(known: ValidRange, values: FloatArray) -> bool:
    slack = _SLACK * (known.high - known.low)
    return bool(((values < known.low - slack) | (values > known.high + slack)).any())


def _span(values: FloatArray, known: ValidRange) -> str:
    return f"from {values.min():.4g} to {values.max():.4g} {known.unit}"


def _logs(known: ValidRange) -> str:
    return f"the {known.low:.4g} to {known.high:.4g} {known.unit} in the logs"
