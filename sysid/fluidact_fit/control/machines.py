"""Plant and controller from blocks and a controller file.

What part a block plays in the machine is read off its parameters: which family it comes from is
not asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from ..block import Block, Port
from ..errors import UsageError
from ..estimation.friction_law import FrictionLaw
from .controller_file import (
    ControllerFile,
    ForceKeys,
    ImpedanceKeys,
    PDKeys,
    place_of,
)
from .controllers import (
    Controller,
    FeedforwardForceController,
    Gains,
    ImpedanceController,
    PDController,
    Smoothing,
)
from .controllers.force import ForceMap
from .controllers.impedance import Impedance, KnownFriction, Pressures
from .controllers.pd import StaticFriction
from .plants.base import Plant
from .plants.drive import Drive, DrivePlant, behind_screw, rigid_line
from .plants.force import Branches, ForcePlant
from .plants.hydraulic import HydraulicCylinder, HydraulicPlant
from .plants.linear import Chain, make_chain
from .plants.pneumatic import Chamber, Cylinder, PneumaticPlant
from .plants.tissue import Tissue

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
        if part is None:
            raise UsageError(
                f"a file of {block.family} has no place in a closed loop",
                expected=f"A loop of kind {kind} takes {_WANTED[kind]}.",
            )
        found[part] = (*found.get(part, ()), block)
    return Parts(kind, found)


def make_plant(file: ControllerFile, blocks: Sequence[Block]) -> Plant:
    """The machine of the parameter files and the controller file.

    Raises
    ------
    UsageError
        When the files do not make a machine for that kind of controller.
    NotIdentifiedError
        When a parameter that is needed was not identified.
    """
    parts = sort_parts(file.kind, blocks)
    maker = {"pd": _position_plant, "impedance": _pneumatic_plant}.get(file.kind, _force_plant)
    return maker(file, parts)


def make_controller(file: ControllerFile, blocks: Sequence[Block], plant: Plant) -> Controller:
    """The controller of the file, its gains and compensation from the blocks it knows.

    ``plant`` is the machine as the blocks describe it (`make_plant`).
    """
    limits = (
        -inf if file.limits.low is None else file.limits.low,
        inf if file.limits.high is None else file.limits.high,
    )
    keys = file.controller
    if isinstance(keys, PDKeys):
        return _pd(file, keys, plant, limits)
    if isinstance(keys, ImpedanceKeys):
        assert isinstance(plant, PneumaticPlant)
        return _impedance(file, keys, plant.cylinder, limits)
    return _force(file, keys, sort_parts(file.kind, blocks), limits)


def _need(file: ControllerFile, section: str, *names: str) -> list[float]:
    """Keys that have to be given (``UsageError``)."""
    holder = getattr(file, section)
    missing = [n for n in names if getattr(holder, n) is None]
    if missing:
        raise UsageError(
            f"the controller file lacks {', '.join(place_of(section, n) for n in missing)}",
            remedy="Give them in SI; no parameter file holds them.",
        )
    return [float(getattr(holder, n)) for n in names]


def _refuse(kind: str) -> UsageError:
    return UsageError(
        "the parameter files do not make a machine for this controller",
        expected=f"A loop of kind {kind} takes {_WANTED[kind]}.",
    )


def _tissue(file: ControllerFile) -> Tissue | None:
    t = file.tissue
    if t is None or t.surface is None or t.stiffness is None or t.puncture_force is None:
        return None
    return Tissue(t.surface, t.stiffness, t.puncture_force, t.damping, t.residual_stiffness)


def _position_plant(file: ControllerFile, parts: Parts) -> Plant:
    axis, line, oil = parts.one("axis"), parts.one("line"), parts.one("cylinder")
    if oil is not None and axis is None and line is None:
        if file.tissue is not None:
            raise UsageError("the hydraulic cylinder knows no tissue", remedy="Leave it out.")
        return HydraulicPlant(_hydraulic(oil), oil.input, file.sample_time)
    if axis is None and line is None:
        raise _refuse(file.kind)
    if axis is None:
        drive, command, out = rigid_line(line.numbers()), line.input, line.output
    elif line is None:
        values = axis.numbers()
        mass = values["inertia"] if "inertia" in values else values["mass"]
        drive, command, out = Drive(mass, FrictionLaw.of(values)), axis.input, axis.output
    else:
        if "inertia" not in axis.parameters:
            raise UsageError("a screw before a line is one with torque and angle")
        lever, transmission = _need(file, "machine", "lever", "transmission")
        behind = rigid_line(line.numbers())
        drive = behind_screw(axis.numbers(), behind, lever, transmission)
        command, out = axis.input, line.output
    return DrivePlant(drive, command, out, file.sample_time, _tissue(file))


def _hydraulic(block: Any) -> HydraulicCylinder:
    given = block.document.options or {}
    names = ("area-1", "area-2", "dead-volume-1", "dead-volume-2", "mass", "supply-pressure")
    if any(given.get(n) is None for n in names) or "valve_gain_2" not in block.parameters:
        raise UsageError(
            "the file of the hydraulic cylinder does not say how its pressures come about",
            remedy="Fit with --mass, --dead-volume-1 and --dead-volume-2 to logs that hold both "
            "pressures.",
        )
    one, two, volume_1, volume_2, mass, supply = (float(given[n]) for n in names)
    values = block.numbers()
    law = FrictionLaw.of(values)
    return HydraulicCylinder(
        (one, two), (volume_1, volume_2), mass, values["bulk_modulus"], supply,
        float(given.get("tank-pressure") or 0.0), law,
        lambda chamber, u, p: float(block.flow(chamber, u, p)),
    )  # fmt: skip


def _supplies(parts: Parts) -> list[tuple[Chain, float, Port]]:
    """Chains of valve and line in the order given; each begins with a valve or a lone line."""
    chains: list[list[Any]] = []
    for block in parts.blocks.get("supply", ()):
        valve = "natural_frequency" in block.parameters
        if valve or not chains or "natural_frequency" not in chains[-1][-1].parameters:
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
        found.append((chain, offset, links[0].input))
    return found


def _pneumatic_plant(file: ControllerFile, parts: Parts) -> Plant:
    friction, supplies = parts.one("friction"), _supplies(parts)
    if friction is None or len(supplies) not in (1, 2):
        raise _refuse(file.kind)
    keys, machine = file.controller, file.machine
    assert isinstance(keys, ImpedanceKeys)
    assert keys.sum_of_pressures is not None
    mass, area_1, area_2 = _need(file, "machine", "mass", "area_1", "area_2")
    volumes = machine.volume_1, machine.volume_2
    if volumes != (None, None) and machine.atmosphere == 0.0:
        raise UsageError("a volume of gas needs absolute pressures: machine.atmosphere is 0")
    (first, offset_1, command), (second, offset_2, _) = supplies[0], supplies[-1]
    chambers = (
        Chamber(first, area_1, offset_1, volumes[0]),
        Chamber(second, area_2, offset_2, volumes[1]),
    )
    law = FrictionLaw.of(friction.numbers())
    cylinder = Cylinder(mass, law, chambers, machine.atmosphere, keys.sum_of_pressures)
    return PneumaticPlant(cylinder, command, file.sample_time, _tissue(file))


def _force_plant(file: ControllerFile, parts: Parts) -> Plant:
    supplies = _supplies(parts)
    if len(supplies) > 1:
        raise _refuse(file.kind)
    force, drive = force_map(parts)
    place = file.machine.position
    chain, offset, command = supplies[0] if supplies else (make_chain([]), 0.0, drive)
    if supplies and drive.role == "command":  # the map knows the valve's gain
        scale, offset = chain.gain, 0.0
        chain = Chain(chain.a, chain.b, chain.c / scale, chain.dead_time)

    def branches(value: float) -> tuple[float, float]:
        one, other = force(value, place, 1.0), force(value, place, -1.0)
        return min(one, other), max(one, other)

    found: Branches = branches
    if file.tissue is not None:
        raise UsageError("the rod of a force loop is held: there is no tissue", remedy="Leave it.")
    return ForcePlant(found, chain, command, file.sample_time, offset=offset, position=place)


def _call_network(block: Any, **values: float) -> float:
    return float(block(**{name: values.get(name, 0.0) for name in block.inputs}))


def force_map(parts: Parts) -> tuple[ForceMap, Port]:
    """Force of a drive, position and motion state, and what the drive is (``UsageError``)."""
    spring = parts.one("spring")
    if spring is not None:
        return lambda u, x, s: float(spring(u, x, s)), spring.input
    networks = [b for b in parts.blocks.get("network", ()) if b.target == "force"]
    if len(networks) != 1:
        raise _refuse(parts.kind)
    network = networks[0]
    role = "pressure" if "pressure" in network.inputs else "command"
    port = Port(role, network.validity[role].unit if role in network.validity else "")
    return (
        lambda u, x, s: _call_network(network, **{role: u}, position=x, direction=s),
        port,
    )


def _pd(
    file: ControllerFile, keys: PDKeys, plant: Plant, limits: tuple[float, float]
) -> Controller:
    drive = plant.drive if isinstance(plant, DrivePlant) else None
    if drive is None and (keys.damping_ratio is not None or keys.friction != "none"):
        raise UsageError(
            "the gains of a hydraulic cylinder do not follow from a mass, nor is its friction "
            "added to the command of a valve",
            remedy="Give controller.proportional and controller.derivative, and friction: none.",
        )
    gains = _gains(keys, drive) if drive else Gains(keys.proportional or 0.0, keys.derivative or 0)
    friction = StaticFriction()
    if keys.friction == "static" and drive is not None:
        law = drive.friction
        friction = StaticFriction(
            law.breakaway_positive / drive.leverage, law.breakaway_negative / drive.leverage,
            keys.velocity_tolerance,
        )  # fmt: skip
    return PDController(
        gains, plant.controlled.role, file.sample_time, friction,
        cutoff=keys.cutoff, limits=limits,
    )  # fmt: skip


def _gains(keys: PDKeys, drive: Drive) -> Gains:
    """Gains as given, or by their rule."""
    ratio = keys.damping_ratio or 1.0
    plant = (drive.mass, drive.damping, drive.leverage)
    if keys.ramp_error is not None and keys.ramp_speed is not None:
        found = Gains.for_ramp(
            *plant, slope=keys.ramp_speed, error=keys.ramp_error, damping_ratio=ratio
        )
    elif keys.bandwidth is not None:
        found = Gains.for_bandwidth(*plant, bandwidth=keys.bandwidth, damping_ratio=ratio)
    else:
        assert keys.proportional is not None
        found = Gains.with_damping(*plant, proportional=keys.proportional, damping_ratio=ratio)
    return found if keys.derivative is None else Gains(found.proportional, keys.derivative)


def _impedance(
    file: ControllerFile, keys: ImpedanceKeys, cylinder: Cylinder, limits: tuple[float, float]
) -> Controller:
    assert keys.stiffness is not None
    if keys.damping is not None:
        wanted = Impedance(keys.stiffness, keys.damping)
    else:
        ratio = keys.damping_ratio or 1.0
        wanted = Impedance.with_damping_ratio(cylinder.mass, keys.stiffness, ratio)
    law, known = cylinder.friction, KnownFriction()
    if keys.friction != "none":
        viscous = 0.5 * (law.viscous_positive + law.viscous_negative)
        known = KnownFriction(viscous)
        if keys.friction == "all":
            known = KnownFriction(
                viscous, law.coulomb_positive, law.coulomb_negative, keys.velocity_tolerance
            )
    one, two = cylinder.chambers
    high = inf if keys.highest_pressure is None else keys.highest_pressure
    pressures = Pressures(
        (one.area, two.area), cylinder.sum_of_pressures, cylinder.atmosphere,
        (one.supply.gain, two.supply.gain), (one.offset, two.offset),
        (keys.lowest_pressure, high),
    )  # fmt: skip
    return ImpedanceController(
        wanted, pressures, file.sample_time, known, cutoff=keys.cutoff, limits=limits
    )


def _force(
    file: ControllerFile, keys: ForceKeys, parts: Parts, limits: tuple[float, float]
) -> Controller:
    observer, drive = force_map(parts)
    supplies = _supplies(parts)
    chain, offset, _ = supplies[0] if supplies else (make_chain([]), 0.0, drive)
    gain = 1.0 if drive.role == "command" else chain.gain
    offset = 0.0 if drive.role == "command" else offset
    networks = [b for b in parts.blocks.get("network", ()) if b.target != "force"]
    spring = parts.one("spring")
    if len(networks) > 1 or not (networks or spring):
        raise _refuse(file.kind)

    def command_for(force: float, place: float, state: float) -> float:
        if networks:
            return _call_network(networks[0], force=force, position=place, direction=state)
        return (float(spring.inverse(force, place, state)) - offset) / gain

    def observe(command: float, place: float, state: float) -> float:
        return observer(gain * command + offset, place, state)

    smoothing = Smoothing(keys.smoothing_steps, "held" if keys.smoothing == "held" else "recursive")
    return FeedforwardForceController(
        command_for, file.sample_time, smoothing, observe, limits=limits
    )
