"""Flow, speed and command of the cylinder as a controller runs them.

With ``h = k r / 2`` the flow through orifice and line is ``k (sqrt(h^2 + drop) - h)``, which needs
no division; see :func:`.mechanics.hydraulic_cylinder.orifice_flow`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...estimation.named_model import Values
from ...estimation.scaled_network import ScaledNetwork
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import EDGES, LOSSES, Machine, chamber_flow
from ...routines import (
    Argument,
    Draft,
    Expression,
    Routine,
    by_sign,
    choose,
    constant,
    maximum,
    minimum,
    sqrt,
)
from .networks import NETWORKS, network_of

_LEAST = 1e-3  # of the supply pressure has to be left to find a command for a speed


def feeding_chamber(known: Sequence[int], extending: bool) -> int:
    """Return the chamber that meters the flow in, or the other one where that is not known."""
    wanted = 1 if extending else 2
    return wanted if wanted in known else known[0]


@dataclass(frozen=True)
class CylinderRoutines:
    """Routines of a file, whose parameters refuse what is not identified when it is needed.

    ``chambers`` are those of known valve gain, ``known`` the arguments with the ranges of the logs.
    """

    machine: Machine
    values: Values
    chambers: Sequence[int]
    known: Mapping[str, Argument]

    def all(self) -> Sequence[Routine]:
        """Return every routine that the file has the numbers for."""
        chambers = [i for i in self.chambers if f"pressure_{i}" in self.known]
        found = [self._flow(i) for i in chambers]
        if chambers:
            found += [self._speed(chambers), self._command(chambers)]
        friction = self._friction(chambers)
        nets = {n: net for n in NETWORKS if (net := network_of(self.values, n)) is not None}
        return (*found, friction, *(self._network(n, net, friction) for n, net in nets.items()))

    def flows(self) -> tuple[Routine, Routine]:
        """Return the flows of both chambers, named as those of a plant."""
        one, two = (replace(self._flow(i), name=f"plant_flow_{i}") for i in (1, 2))
        return one, two

    # ------------------------------------------------------------------------------ parts

    def _drop(self, chamber: int, p: Expression, extending: bool) -> tuple[Expression, bool]:
        """Pressure over valve and line, and whether the chamber's range of pressures turns it."""
        m, reach = self.machine, self.known[f"pressure_{chamber}"]
        if (chamber == 1) == extending:
            return constant("supply", m.supply) - p, m.supply < reach.high
        return p - constant("tank", m.tank), reach.low < m.tank

    def _one_way(self, chamber: int, u: Expression, p: Expression, extending: bool) -> Expression:
        """Size of the flow of a chamber in one direction of the command."""
        v, way = self.values, 0 if extending else 1
        beyond = u - v[EDGES[1]] if extending else -u - -v[EDGES[0]]
        k = maximum(beyond, 0.0) * v[f"valve_gain_{chamber}"]
        loss = LOSSES[chamber][way]
        h = k * constant(f"half_{loss}", 0.5 * v[loss])
        drop, turns = self._drop(chamber, p, extending)
        flow = sqrt(h * h + maximum(drop, 0.0)) - h
        if turns:  # the pressure was seen beyond that of supply or tank
            flow = flow - (sqrt(h * h + maximum(-drop, 0.0)) - h)
        return k * flow

    def _flow(self, chamber: int) -> Routine:
        about = "Flow into chamber 1." if chamber == 1 else "Flow out of chamber 2."
        draft = Draft(f"flow_{chamber}", about, "m3/s")
        u = draft.argument(self.known["command"])
        p = draft.argument(self.known[f"pressure_{chamber}"])
        there = draft.let(f"forward_{chamber}", self._one_way(chamber, u, p, True))
        back = draft.let(f"backward_{chamber}", self._one_way(chamber, u, p, False))
        return draft.returns(there - back)

    def _speed(self, chambers: Sequence[int]) -> Routine:
        draft = Draft("speed", "Steady speed for a command and measured pressures.", "m/s")
        u = draft.argument(self.known["command"])
        p = {i: draft.argument(self.known[f"pressure_{i}"]) for i in chambers}
        ways = []
        for extending in (True, False):
            i = feeding_chamber(chambers, extending)
            flow = self._one_way(i, u, p[i], extending)
            ways.append(flow * constant(f"per_area_{i}", 1.0 / self.machine.area(i)))
        return draft.returns(ways[0] - ways[1])

    def _fastest(self, chamber: int, extending: bool) -> float:
        """Speed at the end of the command's range, at the pressure that gives most."""
        u, p = self.known["command"], self.known[f"pressure_{chamber}"]
        ends = np.array([p.low, p.high])
        command = np.full(2, u.high if extending else u.low)
        flow = chamber_flow(chamber, command, ends, self.values, self.machine)
        return float(np.abs(flow).max()) / self.machine.area(chamber)

    def _command(self, chambers: Sequence[int]) -> Routine:
        """Inverse of the speed; it ends at the range of the command and tells of that."""
        u = self.known["command"]
        draft = Draft("command_for", "Command for a speed and measured pressures.", u.unit)
        feeding = {way: feeding_chamber(chambers, way) for way in (True, False)}
        slowest, fastest = -self._fastest(feeding[False], False), self._fastest(feeding[True], True)
        speed = draft.argument(
            Argument("velocity", "m/s", "wanted speed", slowest, fastest, recorded=False)
        )
        p, found = {i: draft.argument(self.known[f"pressure_{i}"]) for i in chambers}, {}
        for way, i in feeding.items():
            v, m = self.values, self.machine
            name, sign = ("forward", 1.0) if way else ("backward", -1.0)
            area = constant(f"area_{i}", m.area(i))
            flow = draft.let(f"flow_{name}", maximum(speed * sign, 0.0) * area)
            supply = constant("supply", m.supply)
            drop, _ = self._drop(i, p[i], way)
            rest = draft.let(f"rest_{name}", drop - v[LOSSES[i][0 if way else 1]] * flow)
            least = constant("least_drop", _LEAST * m.supply)
            draft.flag(choose(flow, ">", 0.0, rest, supply), least)
            per_gain = constant(f"per_valve_gain_{i}", 1.0 / v[f"valve_gain_{i}"])
            beyond = flow * per_gain / sqrt(maximum(rest, least))
            found[way] = v[EDGES[way]] + sign * beyond
        ends = (
            minimum(found[True], constant("highest", u.high)),
            maximum(found[False], constant("lowest", u.low)),
        )
        return draft.returns(by_sign(speed, *ends))

    def _friction(self, chambers: Sequence[int]) -> Routine:
        most = max((self._fastest(i, way) for i in chambers for way in (True, False)), default=0.0)
        draft = Draft("friction", "Friction of the moving piston.", "N")
        v = draft.argument(
            Argument("velocity", "m/s", "speed of the piston", -most, most, recorded=False)
        )
        return draft.returns(FrictionLaw.of(self.values).routine_value(v))

    def _network(self, name: str, net: ScaledNetwork, friction: Routine) -> Routine:
        about = f"{name.replace('_', ' ').capitalize()} by the network of the file."
        unit, of = "N", friction.arguments
        if name != "friction":
            pressure = self.known[f"pressure_{name.removeprefix('flow_')}"]
            unit, of = "m3/s", (self.known["command"], pressure)
        draft = Draft(f"{name}_network", about, unit)
        return draft.returns(net.draw(draft, [draft.argument(a) for a in of]))
