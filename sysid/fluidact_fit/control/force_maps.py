"""The maps that a force controller and its machine are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ..block import Port
from ..errors import UsageError
from ..routines import Argument, Machine, Routine
from .controllers.force import ForceMap, ask
from .parts import Parts, refuse, supplies_of


@dataclass(frozen=True)
class ForceMaps:
    """Model of its machine that a force controller uses.

    Attributes
    ----------
    forward, inverse
        Blocks of the force, and of what drives the cylinder to it; one spring is both.
    gain, offset
        Steady drive of ``forward`` per command, and without any: those of valve and line where
        the map takes what comes out of them.
    """

    forward: Any
    inverse: Any
    gain: float = 1.0
    offset: float = 0.0

    @property
    def to_command(self) -> tuple[float, float]:
        """Gain and offset with which ``drive = gain command + offset`` is what ``inverse`` gives.

        A network of the command gives the command itself.
        """
        return (self.gain, self.offset) if self.inverse is self.forward else (1.0, 0.0)

    def inverse_routine(self) -> tuple[Routine, Argument]:
        """Return the routine from a force to its drive or command, and the name of its output.

        Raises
        ------
        UsageError
            When the file of the map does not say which commands its logs held.
        """
        routines = self.inverse.routines()
        found = next((r for r in routines if r.name == "command_for"), routines[0])
        role = self.inverse.input.role if self.inverse is self.forward else self.inverse.target
        covered = self.inverse.validity.get(role)
        if covered is None:
            raise UsageError(
                f"the file of {self.inverse.family} holds no range of {role!r}",
                remedy="Fit it again: files of today hold it.",
            )
        span = covered.high - covered.low
        about = "what command_for gives"
        target = Argument("target", found.unit, about, covered.low - span, covered.high + span,
                          recorded=False)  # fmt: skip
        return replace(found, name="command_for"), target


def force_maps(parts: Parts) -> ForceMaps:
    """The maps of a force controller (``UsageError`` where there are none, or too many)."""
    forward, drive = force_block(parts)
    networks = [b for b in parts.blocks.get("network", ()) if b.target != "force"]
    spring = parts.one("spring")
    if len(networks) > 1 or not (networks or spring):
        raise refuse(parts.kind)
    inverse, supplies = networks[0] if networks else spring, supplies_of(parts)
    if drive.role == "command" or not supplies:
        return ForceMaps(forward, inverse)
    return ForceMaps(forward, inverse, supplies[0].chain.gain, supplies[0].offset)


def force_block(parts: Parts) -> tuple[Any, Port]:
    """The block of the force, and what drives it (``UsageError``)."""
    spring = parts.one("spring")
    if spring is not None:
        return spring, spring.input
    networks = [b for b in parts.blocks.get("network", ()) if b.target == "force"]
    if len(networks) != 1:
        raise refuse(parts.kind)
    network = networks[0]
    role = "pressure" if "pressure" in network.inputs else "command"
    return network, Port(role, network.validity[role].unit if role in network.validity else "")


def forward_of(block: Any) -> ForceMap:
    """Force of a drive, position and motion state: what exports of the block give for them."""
    routine: Routine = block.routines()[0]
    machine, role = Machine(routine), block.input.role

    def force(drive: float, position: float, state: float) -> float:
        known = {role: drive, "position": position, "direction": state}
        return float(ask(machine, known)[0])

    return force
