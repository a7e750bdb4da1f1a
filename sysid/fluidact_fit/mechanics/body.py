"""A mass with dry friction, driven by a linear system and stopped by tissue.

    M v' = F(z) - R - b v - F_k sgn v,    R = k x + c v + F_e(x, v)     while it moves,
    v = 0  while  -F_s- <= F - R <= F_s+                                while it rests,

``z = (x, v, ..., 1)``. Break-away, stop, contact, loss of contact and puncture are events of
:mod:`.hybrid`: their instants are solved for and nothing is smoothed. Where kinetic friction falls
with the speed (a Stribeck curve), :mod:`.falling` follows the mass while it moves.

Between a mass ``M_a`` ahead, which has the friction, and a mass ``m`` behind, which has the
resistance ``R``, there may be a dead zone ``D``, as a hydrostatic line has one:

    m v' + R = D(F - b v - F_k sgn v - M_a v'),    M = M_a + m.

Solved for ``v'``, with ``P = F - b v - F_k sgn v + (M_a / m) R``,

    M v' = F - R - b v - F_k sgn v - e    where P is beyond the edge e of the zone,
    m v' = -R                             where it is within.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..experiment import FloatArray
from .falling import FallingMode
from .friction_law import FrictionLaw
from .hybrid import Mode
from .tissue import Contact, Tissue

_EVENTS = 64  # in one go; a mass that rattles faster than this rests for what is left of it
# What begins: rest, a motion, a state of contact, or a side of the dead zone.
_Cause = Literal["stop", "forward", "backward"] | tuple[Literal["contact"], Contact] | int
_Piece = tuple[Mode | FallingMode, list[_Cause]]


@dataclass(frozen=True)
class Dynamics:
    """Properties that do not change from mode to mode.

    Attributes
    ----------
    mass
        [kg] or [kg m2]
    friction
    drive : (n,)
        Row that gives the driving force from the state [N or N m].
    actuator : (n, n)
        Right side of all states but the first two; rows of what is held are zero.
    span
        Longest time that is followed at once [s].
    tissue
        In the way, or ``None``.
    stiffness, damping
        ``k`` and ``c`` of the resistance [N/m, N s/m].
    edges
        Of the dead zone [N]; ``None`` without one.
    ahead
        Part of the mass that is ahead of the dead zone.
    """

    mass: float
    friction: FrictionLaw
    drive: FloatArray
    actuator: FloatArray
    span: float
    tissue: Tissue | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    edges: tuple[float, float] | None = None
    ahead: float = 0.0


class Body:
    """The motion of :class:`Dynamics` from event to event.

    Attributes
    ----------
    state : (n,)
        Position, velocity, what else there is, and 1. Held inputs may be set between calls of
        :meth:`advance`.
    events
        Stops, break-aways, changes of contact and passages of the dead zone so far.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self._modes: dict[tuple[int, Contact, int, bool], _Piece] = {}
        start = np.zeros(dynamics.drive.size)
        start[-1] = 1.0
        self.reset(start)

    def reset(self, state: FloatArray) -> None:
        """Be in a state, with tissue that is whole."""
        self.state = state.copy()
        self.events = 0
        tissue = self.dynamics.tissue
        self.contact: Contact = tissue.begin(float(state[0])) if tissue else "off"
        self.way = int(np.sign(state[1]))

    @property
    def resistance(self) -> float:
        """Force of the tissue on the body [N]."""
        tissue = self.dynamics.tissue
        return float(tissue.force(self.contact, self.state.size) @ self.state) if tissue else 0.0

    def advance(self, span: float) -> None:
        """Follow the motion for a time [s]."""
        if self.way == 0:
            self.way = self._leaving()
        zone = self._zone()
        for _ in range(_EVENTS):
            mode, causes = self._mode(self.way, self.contact, zone)
            self.state, span, guard = mode.advance(self.state, span)
            if guard is None:
                return
            self.events += 1
            zone = self._change(causes[guard])
        self.way, self.state[1] = 0, 0.0
        mode, _ = self._mode(0, self.contact, 1, held=True)
        self.state, _, _ = mode.advance(self.state, span)

    def _change(self, cause: _Cause) -> int:
        """Go on in another mode; returns the side of the dead zone."""
        if cause == "stop":
            self.state[1] = 0.0
            self.way = self._leaving()
        elif isinstance(cause, tuple):
            self.contact = cause[1]
        elif isinstance(cause, int):
            return cause
        else:
            self.way = 1 if cause == "forward" else -1
        return self._zone()

    def _leaving(self) -> int:
        """Direction in which a body at rest is pushed beyond its static friction; 0: it rests."""
        law, load = self.dynamics.friction, float(self._load(self.contact) @ self.state)
        net = float(self.dynamics.drive @ self.state) - load
        low, high = self.dynamics.edges or (0.0, 0.0)
        # under a load the line is pressed against one edge of its dead zone
        low, high = (high, high) if load > 0.0 else (low, low) if load < 0.0 else (low, high)
        if net > high + law.breakaway_positive:
            return 1
        return -1 if net < low - law.breakaway_negative else 0

    def _load(self, contact: Contact) -> FloatArray:
        """Row of the resistance."""
        d = self.dynamics
        row = d.tissue.force(contact, d.drive.size) if d.tissue else np.zeros(d.drive.size)
        row[0] += d.stiffness
        row[1] += d.damping
        return row

    def _driven(self, way: int) -> FloatArray:
        """Row of the driving force less the friction of a motion."""
        d, row = self.dynamics, self.dynamics.drive.copy()
        law = d.friction
        row[1] -= law.viscous_positive if way > 0 else law.viscous_negative
        row[-1] -= law.coulomb_positive if way > 0 else -law.coulomb_negative
        return row

    def _push(self, way: int, contact: Contact) -> FloatArray:
        """Row of ``P``, which passes the dead zone or does not."""
        d = self.dynamics
        return self._driven(way) + d.ahead / (d.mass - d.ahead) * self._load(contact)

    def _zone(self) -> int:
        """Side of the dead zone on which the mass is driven; 0 within, 1 without a dead zone."""
        if self.dynamics.edges is None or self.way == 0:
            return 1
        push = float(self._push(self.way, self.contact) @ self.state)
        low, high = self.dynamics.edges
        return 1 if push > high else -1 if push < low else 0

    def _mode(self, way: int, contact: Contact, zone: int, held: bool = False) -> _Piece:
        key = (way, contact, zone, held)
        if key not in self._modes:
            rows = [] if held else self._guards(way, contact, zone)
            size = self.dynamics.drive.size
            table = np.array([row for row, _ in rows]).reshape(-1, size)
            mode = self._make_mode(way, self._matrix(way, contact, zone), table)
            self._modes[key] = mode, [cause for _, cause in rows]
        return self._modes[key]

    def _make_mode(self, way: int, matrix: FloatArray, guards: FloatArray) -> Mode | FallingMode:
        d, rise = self.dynamics, self.dynamics.friction.rise(way)
        if way == 0 or rise <= 0.0:
            return Mode(matrix, guards, d.span)
        speed = d.friction.stribeck_speed
        return FallingMode(matrix, guards, d.span, -way * rise / d.mass, speed)

    def _matrix(self, way: int, contact: Contact, zone: int) -> FloatArray:
        d = self.dynamics
        matrix = d.actuator.copy()
        matrix[:2] = 0.0
        if way == 0:
            matrix[:, 1] = 0.0
            return matrix
        matrix[0, 1] = 1.0
        matrix[1] = -self._load(contact) / (d.mass if zone else d.mass - d.ahead)
        if zone:
            matrix[1] += self._driven(way) / d.mass
            low, high = d.edges or (0.0, 0.0)
            matrix[1, -1] -= (high if zone > 0 else low) / d.mass
        return matrix

    def _guards(self, way: int, contact: Contact, zone: int) -> list[tuple[FloatArray, _Cause]]:
        d, rows = self.dynamics, list[tuple[FloatArray, _Cause]]()
        if way:
            speed = np.zeros(d.drive.size)
            speed[1] = way
            rows.append((speed, "stop"))
            rows += self._edges(way, contact, zone)
        elif d.edges is None:  # ahead of a dead zone nothing moves by itself: rest is left at once
            net = d.drive - self._load(contact)
            forward, backward = -net, net.copy()
            forward[-1] += d.friction.breakaway_positive
            backward[-1] += d.friction.breakaway_negative
            rows += [(forward, "forward"), (backward, "backward")]
        if d.tissue is not None:
            found = d.tissue.guards(contact, d.drive.size)
            rows += [(row, ("contact", following)) for row, following in found]
        return rows

    def _edges(self, way: int, contact: Contact, zone: int) -> list[tuple[FloatArray, _Cause]]:
        """Guards of the edges of the dead zone next to a side of it."""
        if self.dynamics.edges is None:
            return []
        rows = list[tuple[FloatArray, _Cause]]()
        for edge, side in zip(self.dynamics.edges, (-1, 1)):
            if zone in (0, side):
                row = self._push(way, contact) * (side if zone else -side)
                row[-1] -= edge * (side if zone else -side)
                rows.append((row, 0 if zone else side))
        return rows
