"""Plant and controller from blocks and a controller file.

What part a block plays in the machine is read off its parameters: which family it comes from is
not asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, pi, sqrt
from typing import Any

from ..block import Block, Port
from ..errors import UsageError
from ..mechanics.friction_law import FrictionLaw
from ..mechanics.hydraulic_cylinder import HydraulicMachine
from ..mechanics.tissue import Tissue
from ..routines import Machine
from .controller_file import (
    ControllerFile,
    ForceKeys,
    ImpedanceKeys,
    PDKeys,
    place_of,
)
from .controllers import (
    FeedforwardForceController,
    Gains,
    ImpedanceController,
    PDController,
    RoutineController,
    Smoothing,
    Travel,
)
from .controllers.force import Start, ask
from .controllers.impedance import Impedance, KnownFriction, Pressures
from .controllers.pd import StaticFriction
from .force_maps import force_block, force_maps, forward_of
from .parts import Parts, refuse, sort_parts, supplies_of
from .plants.base import UNLIMITED, Limits, Plant
from .plants.drive import Drive, DrivePlant, behind_screw, rigid_line
from .plants.force import Branches, ForcePlant
from .plants.hydraulic import HydraulicPlant
from .plants.linear import Chain, make_chain
from .plants.pneumatic import Chamber, Cylinder, PneumaticPlant

_SAME = 1e-9  # of a damping ratio: what differs by less is rounding


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


def make_controller(
    file: ControllerFile, blocks: Sequence[Block], plant: Plant, start: float | None = None
) -> RoutineController:
    """The controller of the file, its gains and compensation from the blocks it knows.

    Parameters
    ----------
    file, blocks
    plant
        The machine as the blocks describe it (`make_plant`).
    start
        Output at which it begins [its unit]; that of the file where it is not given, else 0.
    """
    begin = (file.reference.start or 0.0) if start is None else start
    travel = _travel(file, blocks, plant.controlled)
    limits = (
        -inf if file.limits.low is None else file.limits.low,
        inf if file.limits.high is None else file.limits.high,
    )
    keys = file.controller
    if isinstance(keys, PDKeys):
        return _pd(file, keys, plant, travel, limits, begin)
    if isinstance(keys, ImpedanceKeys):
        assert isinstance(plant, PneumaticPlant)
        return _impedance(file, keys, plant.cylinder, travel, limits)
    return _force(file, keys, sort_parts(file.kind, blocks), travel, limits, begin)


def _travel(file: ControllerFile, blocks: Sequence[Block], controlled: Port) -> Travel:
    """Range of what is controlled: that of the controller file, or of the logs; else anything."""
    role, unit = controlled
    if file.machine.travel_from is not None and file.machine.travel_to is not None:
        return Travel(role, unit, file.machine.travel_from, file.machine.travel_to)
    known = next((b.validity[role] for b in blocks if role in b.validity), None)
    return Travel(role, unit) if known is None else Travel(role, unit, known.low, known.high)


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
        return HydraulicPlant(
            *hydraulic_cylinder(oil), oil.input, file.sample_time, limits=_limits(oil)
        )
    if axis is None and line is None:
        raise refuse(file.kind)
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
    limits = _limits(line if axis is None else axis)
    return DrivePlant(drive, command, out, file.sample_time, _tissue(file), limits=limits)


def _limits(block: Block) -> Limits:
    """Range of what drives a block, as its exports have it; unlimited in a file without one."""
    known = block.validity.get(block.input.role) if block.input else None
    return UNLIMITED if known is None else (known.low, known.high)


def hydraulic_cylinder(block: Any) -> tuple[HydraulicMachine, dict[str, float]]:
    """What is given of a cylinder and its parameters, where both flows and all volumes are known.

    Raises
    ------
    UsageError
        When the file does not say how the pressures come about.
    """
    machine: HydraulicMachine = block.machine
    if not (machine.complete and {"valve_gain_1", "valve_gain_2"} <= set(block.parameters)):
        raise UsageError(
            "the file of the hydraulic cylinder does not say how its pressures come about",
            remedy="Fit with --mass, --dead-volume-1 and --dead-volume-2 to logs that hold both "
            "pressures.",
        )
    return machine, block.numbers()


def _pneumatic_plant(file: ControllerFile, parts: Parts) -> Plant:
    friction, supplies = parts.one("friction"), supplies_of(parts)
    if friction is None or len(supplies) not in (1, 2):
        raise refuse(file.kind)
    keys, machine = file.controller, file.machine
    assert isinstance(keys, ImpedanceKeys)
    assert keys.sum_of_pressures is not None
    mass, area_1, area_2 = _need(file, "machine", "mass", "area_1", "area_2")
    volumes = machine.volume_1, machine.volume_2
    if volumes != (None, None) and machine.atmosphere == 0.0:
        raise UsageError("a volume of gas needs absolute pressures: machine.atmosphere is 0")
    one, two = supplies[0], supplies[-1]
    chambers = (
        Chamber(one.chain, area_1, one.offset, volumes[0]),
        Chamber(two.chain, area_2, two.offset, volumes[1]),
    )
    law = FrictionLaw.of(friction.numbers())
    cylinder = Cylinder(mass, law, chambers, machine.atmosphere, keys.sum_of_pressures)
    return PneumaticPlant(
        cylinder, one.input, file.sample_time, _tissue(file),
        limits=(_limits(one.first), _limits(two.first)),
    )  # fmt: skip


def _force_plant(file: ControllerFile, parts: Parts) -> Plant:
    supplies = supplies_of(parts)
    if len(supplies) > 1:
        raise refuse(file.kind)
    block, drive = force_block(parts)
    force = forward_of(block)
    place = file.machine.position
    chain, offset, command, limits = make_chain([]), 0.0, drive, _limits(block)
    if supplies:
        chain, offset, command = supplies[0].chain, supplies[0].offset, supplies[0].input
        limits = _limits(supplies[0].first)
    if supplies and drive.role == "command":  # the map knows the valve's gain
        scale, offset = chain.gain, 0.0
        chain = Chain(chain.a, chain.b, chain.c / scale, chain.dead_time)

    def branches(value: float) -> tuple[float, float]:
        one, other = force(value, place, 1.0), force(value, place, -1.0)
        return min(one, other), max(one, other)

    found: Branches = branches
    if file.tissue is not None:
        raise UsageError("the rod of a force loop is held: there is no tissue", remedy="Leave it.")
    return ForcePlant(found, chain, command, file.sample_time, offset=offset, position=place,
                      drive_unit=drive.unit, limits=limits)  # fmt: skip


def _pd(
    file: ControllerFile, keys: PDKeys, plant: Plant, travel: Travel,
    limits: tuple[float, float], start: float,
) -> RoutineController:  # fmt: skip
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
        friction = StaticFriction(*drive.static, keys.velocity_tolerance)
    controller = PDController(
        gains, travel, file.sample_time, friction, cutoff=keys.cutoff, limits=limits,
        holding=drive.holding(start) if drive else 0.0,
    )  # fmt: skip
    controller.unreached = tuple(_unreached(keys, gains, file.sample_time))
    return controller


def _unreached(keys: PDKeys, gains: Gains, sample_time: float) -> Iterator[str]:
    """Check the goals of the file that the gains miss."""
    ratio, wanted = gains.damping_ratio, keys.damping_ratio
    if wanted is not None and not ratio <= wanted * (1.0 + _SAME):
        yield (
            f"damping_ratio {wanted:g} cannot be reached: the viscous friction of the machine "
            f"alone gives {ratio:.3g}, so that K_d is 0. Choose a larger bandwidth or "
            "proportional gain, or expect that damping."
        )
    yield from _too_fast(gains.natural_frequency, gains.derivative, keys.cutoff, sample_time)


def _too_fast(frequency: float, damping: float, cutoff: float, sample_time: float) -> Iterator[str]:
    """Check a natural frequency [Hz] against the sample time and the velocity filter."""
    half = 0.5 / sample_time
    if frequency >= half:
        yield (
            f"a natural frequency of {frequency:.4g} Hz cannot be reached in steps of "
            f"{sample_time:g} s: it is not below half the sampling frequency, {half:g} Hz. Choose "
            "smaller gains or a shorter sample time."
        )
    elif damping > 0.0 and frequency >= cutoff:
        yield (
            f"the damping is not reached at the natural frequency of {frequency:.4g} Hz: "
            f"the velocity filter cuts off at {cutoff:g} Hz. Choose smaller gains or a larger "
            "cutoff."
        )


def _gains(keys: PDKeys, drive: Drive) -> Gains:
    """Gains as given, or by their rule."""
    ratio = keys.damping_ratio or 1.0
    plant = (drive.mass, drive.viscous, drive.leverage)
    if keys.ramp_error is not None and keys.ramp_speed is not None:
        found = Gains.for_ramp(
            *plant, slope=keys.ramp_speed, error=keys.ramp_error, damping_ratio=ratio
        )
    elif keys.bandwidth is not None:
        found = Gains.for_bandwidth(*plant, bandwidth=keys.bandwidth, damping_ratio=ratio)
    else:
        assert keys.proportional is not None
        found = Gains.with_damping(*plant, proportional=keys.proportional, damping_ratio=ratio)
    if keys.derivative is None:
        return found
    return Gains.of(*plant, found.proportional, keys.derivative)


def _impedance(
    file: ControllerFile, keys: ImpedanceKeys, cylinder: Cylinder, travel: Travel,
    limits: tuple[float, float],
) -> RoutineController:  # fmt: skip
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
    controller = ImpedanceController(
        wanted, pressures, file.sample_time, known, travel=travel, cutoff=keys.cutoff,
        limits=limits,
    )  # fmt: skip
    critical = 2.0 * sqrt(cylinder.mass * wanted.stiffness)
    left = 0.5 * (law.viscous_positive + law.viscous_negative) - known.viscous
    frequency = sqrt(wanted.stiffness / cylinder.mass) / (2.0 * pi)
    controller.unreached = (
        *_overdamped(keys.damping_ratio, (wanted.damping + left) / critical),
        *_too_fast(frequency, wanted.damping, keys.cutoff, file.sample_time),
    )
    return controller


def _overdamped(wanted: float | None, ratio: float) -> Iterator[str]:
    """Return whether friction that is not compensated adds to a damping ratio."""
    if wanted is not None and not ratio <= wanted * (1.0 + _SAME):
        yield (
            f"damping_ratio {wanted:g} is not what the rod shows: the viscous friction of the "
            f"machine adds to it, to {ratio:.3g}. Compensate it (friction: viscous), or expect "
            "that damping."
        )


def _force(
    file: ControllerFile, keys: ForceKeys, parts: Parts, travel: Travel,
    limits: tuple[float, float], start: float,
) -> RoutineController:  # fmt: skip
    maps = force_maps(parts)
    (routine, target), (gain, offset) = maps.inverse_routine(), maps.to_command
    known = {"force": start, "position": file.machine.position, "direction": 1.0}
    drive = min(max(float(ask(Machine(routine), known)[0]), target.low), target.high)
    command = (drive - offset) / gain
    begins = Start(start, min(max(command, limits[0]), limits[1]))
    smoothing = Smoothing(keys.smoothing_steps, "held" if keys.smoothing == "held" else "recursive")
    return FeedforwardForceController(
        routine, target, file.sample_time, smoothing, supply=(gain, offset), travel=travel,
        limits=limits, start=begins,
    )  # fmt: skip
