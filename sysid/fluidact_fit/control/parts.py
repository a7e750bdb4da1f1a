"""Part that a block plays in a machine, read off its parameters, whatever its family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..block import Block, Port
from ..errors import UsageError
from .plants.linear import Chain, make_chain

# A part is what has these parameters; the first that fits.
_SIGNS: tuple[tuple[str, frozenset[str]], ...] = (
    ("cylinder", frozenset({"bulk_modulus"})),
    ("axis", frozenset({"inertia", "coulomb_positive"})),
    ("axis", frozenset({"mass", "coulomb_positive"})),
    ("line", frozenset({"mass", "damping"})),
    ("spring", frozenset({"stiffness", "preload"})),
    ("network", frozenset({"weights_1", "input_offset"})),
    ("friction", frozenset({"coulomb_positive"})),
    ("supply", frozenset({"gain", "natural_frequency"})),
    ("supply", frozenset({"gain", "time_constant"})),
)
_WANTED = {
    "pd": "a ball-screw file, a hydrostatic file, both, or a hydraulic-cylinder file",
    "impedance": "a cylinder-friction file and, for each chamber in turn, a valve file and a line "
    "file; those of one chamber serve both",
    "feedforward-force": "a spring-cylinder file or force-map files (one of the force; one of the "
    "command for the controller), with a valve file and a line file where there are any",
}


@dataclass(frozen=True)
class Parts:
    """Blocks by the part they play, in the order given."""

    kind: str
    blocks: Mapping[str, tuple[Any, ...]]

    def one(self, part: str) -> Any:
        """The only block of a part, ``None`` without any (``UsageError`` for several)."""
        found = self.blocks.get(part, ())
        if len(found) > 1:
            raise UsageError(
                f"{len(found)} of the parameter files are of one kind: {found[0].family}",
                expected=f"A loop of kind {self.kind} takes {_WANTED[self.kind]}.",
            )
        return found[0] if found else None


def sort_parts(kind: str, blocks: Sequence[Block]) -> Parts:
    """Find out what part each block plays (``UsageError`` for one that plays none)."""
    found: dict[str, tuple[Any, ...]] = {}
    for block in blocks:
        names = set(block.parameters)
        part = next((p for p, signs in _SIGNS if signs <= names), None)
        if part == "supply" and not hasattr(block, "transfer_function"):
            part = None  # a motor has a gain and a time constant as well
        if part is None:
            raise UsageError(
                f"a file of {block.family} has no place in a closed loop",
                expected=f"A loop of kind {kind} takes {_WANTED[kind]}.",
            )
        found[part] = (*found.get(part, ()), block)
    return Parts(kind, found)


def refuse(kind: str) -> UsageError:
    """The error for files that make no machine for a kind of controller."""
    return UsageError(
        "the parameter files do not make a machine for this controller",
        expected=f"A loop of kind {kind} takes {_WANTED[kind]}.",
    )


@dataclass(frozen=True)
class Supply:
    """A valve, a line or both: the chain, its output without input, and its first block."""

    chain: Chain
    offset: float
    first: Block

    @property
    def input(self) -> Port:
        """Input of the block."""
        port = self.first.input
        assert port is not None
        return port


def supplies_of(parts: Parts) -> list[Supply]:
    """Chains of valve and line in the order given.

    Each begins with a valve, with a line that was driven by the command of one, or a lone line.
    """
    chains: list[list[Any]] = []
    for block in parts.blocks.get("supply", ()):
        commanded = block.input is not None and block.input.role == "command"
        if commanded or not chains or "natural_frequency" not in chains[-1][-1].parameters:
            chains.append([block])
        else:
            chains[-1].append(block)
    found = []
    for links in chains:
        chain = make_chain([block.transfer_function() for block in links])
        offset = 0.0
        for block in links:
            gain = block.transfer_function().gain
            offset = gain * offset + block.offset
        found.append(Supply(chain, offset, links[0]))
    return found
