"""A mass with dry friction, driven by a linear system and stopped by tissue.

    M v' = F(z) - F_e(x, v) - b v - F_k sgn v     while it moves,
    v = 0  while  -F_s- <= F - F_e <= F_s+        while it rests,

``z = (x, v, ..., 1)``. Break-away, stop, contact, loss of contact and puncture are events of
:mod:`.hybrid`: their instants are solved for and nothing is smoothed. Where kinetic friction falls
with the speed (a Stribeck curve), :mod:`.falling` follows the mass while it moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...estimation.friction_law import FrictionLaw
from ...experiment import FloatArray
from .falling import FallingMode
from .hybrid import Mode
from .tissue import Contact, Tissue

_EVENTS = 64  # in one go; a mass that rattles faster than this rests for what is left of it
_Cause = Literal["stop", "forward", "backward"] | tuple[Literal["contact"], Contact]
_Piece = tuple[Mode | FallingMode, list[_Cause]]


@dataclass(frozen=True)
class Dynamics:
    """What does not change from mode to mode.

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
    """

    mass: float
    friction: FrictionLaw
    drive: FloatArray
    actuator: FloatArray
    span: float
    tissue: Tissue | None = None


class Body:
    """The motion of :class:`Dynamics` from event to event.

    Attributes
    ----------
    state : (n,)
        Position, velocity, what else there is, and 1. Held inputs may be set between calls of
        :meth:`advance`.
    events
        Stops, break-aways and changes of contact so far.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics
        self._modes: dict[tuple[int, Contact, bool], _Piece] = {}
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
        for _ in range(_EVENTS):
            mode, causes = self._mode(self.way, self.contact)
            self.state, span, guard = mode.advance(self.state, span)
            if guard is None:
                return
            self.events += 1
            self._change(causes[guard])
        self.way, self.state[1] = 0, 0.0
        mode, _ = self._mode(0, self.contact, held=True)
        self.state, _, _ = mode.advance(self.state, span)

    def _change(self, cause: _Cause) -> None:
        """Go on in another mode."""
        if cause == "stop":
            self.state[1] = 0.0
            self.way = self._leaving()
        elif isinstance(cause, tuple):
            self.contact = cause[1]
        else:
            self.way = 1 if cause == "forward" else -1

    def _leaving(self) -> int:
        """Which way a body at rest is pushed beyond its static friction; 0: it rests."""
        net, law = float(self._net(self.contact) @ self.state), self.dynamics.friction
        if net > law.breakaway_positive:
            return 1
        return -1 if net < -law.breakaway_negative else 0

    def _net(self, contact: Contact) -> FloatArray:
        """Row of the force without friction."""
        d = self.dynamics
        return d.drive - d.tissue.force(contact, d.drive.size) if d.tissue else d.drive

    def _mode(self, way: int, contact: Contact, held: bool = False) -> _Piece:
        key = (way, contact, held)
        if key not in self._modes:
            rows = [] if held else self._guards(way, contact)
            size = self.dynamics.drive.size
            table = np.array([row for row, _ in rows]).reshape(-1, size)
            mode = self._make_mode(way, self._matrix(way, contact), table)
            self._modes[key] = mode, [cause for _, cause in rows]
        return self._modes[key]

    def _make_mode(self, way: int, matrix: FloatArray, guards: FloatArray) -> Mode | FallingMode:
        d, rise = self.dynamics, self.dynamics.friction.rise(way)
        if way == 0 or rise <= 0.0:
            return Mode(matrix, guards, d.span)
        speed = d.friction.stribeck_speed
        return FallingMode(matrix, guards, d.span, -way * rise / d.mass, speed)

    def _matrix(self, way: int, contact: Contact) -> FloatArray:
        d = self.dynamics
        matrix = d.actuator.copy()
        matrix[:2] = 0.0
        if way == 0:
            matrix[:, 1] = 0.0
            return matrix
        law, row = d.friction, self._net(contact).copy()
        row[1] -= law.viscous_positive if way > 0 else law.viscous_negative
        row[-1] -= law.coulomb_positive if way > 0 else -law.coulomb_negative
        matrix[0, 1] = 1.0
        matrix[1] = row / d.mass
        return matrix

    def _guards(self, way: int, contact: Contact) -> list[tuple[FloatArray, _Cause]]:
        d, rows = self.dynamics, list[tuple[FloatArray, _Cause]]()
        if way == 0:
            forward, backward = -self._net(contact), self._net(contact).copy()
            forward[-1] += d.friction.breakaway_positive
            backward[-1] += d.friction.breakaway_negative
            rows += [(forward, "forward"), (backward, "backward")]
        else:
            speed = np.zeros(d.drive.size)
            speed[1] = way
            rows.append((speed, "stop"))
        if d.tissue is not None:
            found = d.tissue.guards(contact, d.drive.size)
            rows += [(row, ("contact", following)) for row, following in found]
        return rows
