"""The registry of model families: one line each, loaded when first asked for."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from ..arguments import require
from ..errors import UsageError, closest

if TYPE_CHECKING:
    from ..family import Family, FamilyOptions

# Where each family lives, and its title: a list of commands must not import families.
_REGISTRY = {
    "potentiometer": (
        "potentiometer.family:Potentiometer",
        "Potentiometer or other sensor: rational Bezier calibration of the raw reading",
    ),
    "ball-screw": (
        "ball_screw.family:BallScrew",
        "Ball-screw drive: inertia, viscous friction and four Coulomb levels",
    ),
    "hydrostatic": (
        "transfer.hydrostatic:Hydrostatic",
        "Hydrostatic transmission: dead zone, mass and damping",
    ),
    "valve": ("transfer.valve:Valve", "Valve: gain, natural frequency and damping ratio"),
    "line": ("transfer.line:Line", "Transmission line: gain, time constant and dead time"),
    "cylinder-friction": (
        "cylinder_friction.family:CylinderFriction",
        "Friction of a cylinder: Coulomb levels by direction and viscous friction",
    ),
    "force-map": (
        "force_map.family:ForceMap",
        "Force map: small networks of command and force with hysteresis",
    ),
    "spring-cylinder": (
        "spring_cylinder.family:SpringCylinder",
        "Single-acting cylinder: pressure gain, return spring and hysteresis",
    ),
    "hydraulic-cylinder": (
        "hydraulic_cylinder.family:HydraulicCylinder",
        "Hydraulic cylinder: valve gains, line losses, bulk modulus and friction",
    ),
    "hydraulic-motor": (
        "hydraulic_motor.family:HydraulicMotor",
        "Hydraulic motor: dead zone, saturation, hysteresis and time constant",
    ),
    "flow-map": (
        "flow_map:FlowMap",
        "Flow map: dead band, gains, leakage and saturation of a proportional valve",
    ),
    "backlash": (
        "backlash:Backlash",
        "Backlash: play and lost motion between a drive and its load",
    ),
}


def family_names() -> tuple[str, ...]:
    """Names of all families, in the order of the documentation."""
    return tuple(_REGISTRY)


def family_title(name: str) -> str:
    """Title of a family, without importing it."""
    return _REGISTRY[name][1]


def fit_function(name: str) -> str:
    """Name of the function of :mod:`.family_fits` that fits a family: ``fit_ball_screw``."""
    return f"fit_{name.replace('-', '_')}"


def get_family(name: str) -> Family[FamilyOptions]:
    """Return the family of that name.

    Raises
    ------
    UsageError
        When there is none; the message lists those there are.
    """
    require("text", family=name)
    return _family(name)


@cache
def _family(name: str) -> Family[FamilyOptions]:
    if name not in _REGISTRY:
        close = closest(name, _REGISTRY)
        hint = f" Did you mean {close!r}?" if close else ""
        raise UsageError(
            f"there is no model family {name!r}.{hint}",
            expected="Families: " + ", ".join(_REGISTRY) + ".",
        )
    module, attribute = _REGISTRY[name][0].split(":")
    family: Family[FamilyOptions] = getattr(import_module(f".{module}", __package__), attribute)()
    return family
