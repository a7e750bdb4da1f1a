"""Equations of the valve and its two chambers, and what is given of the machine.

Numbers of equations are those of the paper that :mod:`.family` names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...experiment import FloatArray

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
GRAY_NAMES = (
    "valve_gain_1", "valve_gain_2", "line_loss_1", "line_loss_2", "line_loss_3", "line_loss_4",
    "bulk_modulus", "dead_zone_negative", "dead_zone_positive", "viscous", "coulomb",
)  # fmt: skip
LOSSES = {1: ("line_loss_1", "line_loss_3"), 2: ("line_loss_4", "line_loss_2")}


def effective_command(command: Array, negative: complex, positive: complex) -> Array:
    """Command beyond the dead zone [V]: ``max(u - u+, 0) + min(u - u-, 0)``, shape ``(n,)``.

    The edges are complex in derivatives.
    """
    above = np.where(np.real(command - positive) > 0.0, command - positive, 0.0)
    below = np.where(np.real(command - negative) < 0.0, command - negative, 0.0)
    return np.asarray(above + below)


def orifice_flow(command: Array, drop: Array, gain: complex, loss: complex) -> Array:
    """Flow through an orifice in series with a line, solved in closed form.

    ``Q = K u sqrt(drop - r |Q|)`` holds the flow on both sides. With ``k = K |u|`` its
    solution is ``Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 drop)) / 2``, written here as
    ``sgn(u) 2 k drop / (k r + sqrt(k^2 r^2 + 4 drop))`` which loses no digits at small flow.

    Parameters
    ----------
    command, drop : (n,)
        Beyond the dead zone [V]; pressure across valve and line [Pa]: flow turns back where it
        is negative.
    gain, loss
        ``K`` [m3/(s V Pa^0.5)] and ``r`` [Pa s/m3].

    Returns
    -------
    (n,) flow with the sign of the command [m3/s].
    """
    sign = np.where(np.real(command) >= 0.0, 1.0, -1.0)
    k = gain * command * sign
    size = np.where(np.real(drop) >= 0.0, drop, -drop) + 1e-9
    root = np.sqrt((k * loss) ** 2 + 4.0 * size)
    return np.asarray(sign * 2.0 * k * drop / (k * loss + root))


def pressure_drop(
    chamber: int, extending: Mask, pressure: Array | float, supply: float, tank: float
) -> Array:
    """Pressure drop [Pa] over the open edge: chamber 1 is fed while ``extending``, 2 while not."""
    fed = extending if chamber == 1 else ~extending
    return np.asarray(np.where(fed, supply - pressure, pressure - tank))


def chamber_flow(
    chamber: int, command: Array, pressure: Array, values: Mapping[str, Any],
    supply: float, tank: float,
) -> Array:  # fmt: skip
    """Flow into chamber 1 or out of chamber 2, ``K_i u g_i`` of equation 4.

    Parameters
    ----------
    chamber
        1 or 2.
    command, pressure : (n,)
        [V], [Pa]
    values
        Valve gain, the two losses of the chamber and the dead zone, by name.
    supply, tank
        [Pa]

    Returns
    -------
    (n,) flow, positive while the piston extends [m3/s].
    """
    beyond = effective_command(command, values["dead_zone_negative"], values["dead_zone_positive"])
    extending = np.real(beyond) >= 0.0
    drop = pressure_drop(chamber, extending, pressure, supply, tank)
    forward, backward = LOSSES[chamber]
    loss = np.where(extending, values[forward], values[backward])
    return orifice_flow(beyond, drop, values[f"valve_gain_{chamber}"], loss)


@dataclass(frozen=True)
class Machine:
    """What is given, not estimated: areas [m2], volumes [m3], mass [kg], pressures [Pa].

    ``None`` where nobody said.
    """

    area_1: float | None = None
    area_2: float | None = None
    dead_volume_1: float | None = None
    dead_volume_2: float | None = None
    mass: float | None = None
    supply: float = 0.0
    tank: float = 0.0

    def area(self, chamber: int) -> float:
        """Piston area of a chamber [m2]."""
        area = self.area_1 if chamber == 1 else self.area_2
        assert area is not None
        return area

    def dead_volume(self, chamber: int) -> float | None:
        """Volume of a chamber and its line at position 0 [m3]."""
        return self.dead_volume_1 if chamber == 1 else self.dead_volume_2

    def volume(self, chamber: int, position: Array) -> Array | None:
        """``V1 + A1 y`` or ``V2 - A2 y`` [m3]."""
        dead = self.dead_volume(chamber)
        if dead is None:
            return None
        sign = 1.0 if chamber == 1 else -1.0
        return np.asarray(dead + sign * self.area(chamber) * position)

    def swelling(self, chamber: int, position: Array, pressure: Array) -> Array:
        """``-+ V dp`` between samples: ``beta`` times the oil that adds to the motion [m3 Pa].

        Zero where the dead volume is not known.
        """
        volume = self.volume(chamber, position)
        if volume is None:
            return np.zeros(position.size - 1)
        sign = -0.5 if chamber == 1 else 0.5
        return np.asarray(sign * (volume[1:] + volume[:-1]) * np.diff(pressure))

    @property
    def complete(self) -> bool:
        """Whether the gray box can be simulated."""
        given = (self.area_1, self.area_2, self.dead_volume_1, self.dead_volume_2, self.mass)
        return all(v is not None for v in given)

    def plain(self) -> Machine:
        """The machine without mass and volumes: what the plateaus alone use."""
        return replace(self, dead_volume_1=None, dead_volume_2=None, mass=None)

    def at_rest(self, position: float) -> FloatArray:
        """Pressures, position and speed at rest with the valve closed, ``(4,)``.

        ``p1 A1 = p2 A2`` leaves one pressure open. The lands of a closed valve leak, equally
        and in proportion to the pressure, from the supply and to the tank: creeping, the piston
        gives one chamber what the other loses, and the pressures settle at the point of that
        line that is closest to half-way between supply and tank.
        """
        area_1, area_2 = self.area(1), self.area(2)
        share = 0.5 * (self.supply + self.tank) * (area_1 + area_2) / (area_1**2 + area_2**2)
        return np.array([share * area_2, share * area_1, position, 0.0])


def mean_flow(
    chamber: int, command: Array, ends: tuple[Array, Array], values: Mapping[str, Any],
    machine: Machine,
) -> Array:  # fmt: skip
    """`chamber_flow` over intervals, the mean of that at the pressures of both ends."""
    before, after = (
        chamber_flow(chamber, command, p, values, machine.supply, machine.tank) for p in ends
    )
    return 0.5 * (before + after)
