"""A cylinder that moves along a line, or a drive that turns: names and units of one equation."""

from __future__ import annotations

from dataclasses import dataclass

from ...specification import Variant

PRESSURES = "-pressures"  # variants without a load cell


@dataclass(frozen=True)
class Axis:
    """Names of drive, motion and inertia of one kind of axis, with their SI units.

    ``drive``, ``speed`` and ``place`` are roles; ``viscous`` is the unit of viscous friction,
    ``body`` the name of the moving part and ``sensor`` that of the sensor of the drive.
    """

    drive: str
    speed: str
    place: str
    force_unit: str
    place_unit: str
    viscous: str
    inertia: str
    inertia_unit: str
    body: str
    sensor: str

    @property
    def speed_words(self) -> str:
        """The speed as people write it."""
        return self.speed.replace("_", " ")

    @property
    def speed_unit(self) -> str:
        """Unit of the speed."""
        return f"{self.place_unit}/s"


LINEAR = Axis(
    "force", "velocity", "position", "N", "m", "N s/m", "mass", "kg", "piston", "load cell"
)
ROTARY = Axis(
    "torque", "angular_velocity", "angle", "N m", "rad", "N m s/rad", "inertia", "kg m2", "shaft",
    "torque sensor",
)  # fmt: skip


def motion_role(variant: Variant) -> str:
    """Name of the role that a variant takes the motion from."""
    return variant.name.removesuffix(PRESSURES)


def axis_of(variant: Variant) -> Axis:
    """The axis that a variant is about."""
    return ROTARY if motion_role(variant) in (ROTARY.speed, ROTARY.place) else LINEAR


def is_place(role: str) -> bool:
    """Return whether a role is a position or angle, and not a speed."""
    return role in (LINEAR.place, ROTARY.place)
