"""Flow, speed and command of the cylinder as a controller runs them.

With ``h = k r / 2`` the flow through orifice and line is ``k (sqrt(h^2 + drop) - h)``, which needs
no division; see :func:`.mechanics.hydraulic_cylinder.orifice_flow`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...estimation.scaled_network import ScaledNetwork
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import LOSSES, Machine, chamber_flow
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

_LEAST = 1e-3  # of the supply pressure has to be left to find a command for a speed


def feeding_chamber(known: Sequence[int], extending: bool) -> int:
    """Return the chamber that meters the flow in, or the other one where that is not known."""
    wanted = 1 if extending else 2
    return wanted if wanted in known else known[0]


@dataclass(frozen=True)
class CylinderRoutines:
    """Constants of the routines.

    ``values`` holds gain, losses and dead zone by chamber, ``known`` the arguments with the
    ranges of the logs, ``networks`` those of the file by name.
    """

    machine: Machine
    values: Mapping[int, Mapping[str, float]]
    known: Mapping[str, Argument]
    law: FrictionLaw
    networks: Mapping[str, ScaledNetwork]

    def all(self) -> Sequence[Routine]:
        """Return every routine that the file has the numbers for."""
        chambers = [i for i in self.values if f"pressure_{i}" in self.known]
        found = [self._flow(i) for i in chambers]
        if chambers:
            found += [self._speed(chambers), self._command(chambers)]
        networks = (self._network(name, net) for name, net in self.networks.items())
        return (*found, self._friction(), *networks)

    def flows(self) -> tuple[Routine, Routine]:
        """Return the flows of both chambers, named as those of a plant."""
        one, two = (replace(self._flow(i), name=f"plant_flow_{i}") for i in (1, 2))
        return one, two

    # ------------------------------------------------------------------------------ parts

    def _one_way(self, chamber: int, u: Expression, p: Expression, extending: bool) -> Expression:
        """Size of the flow of a chamber in one direction of the command."""
        v, m = self.values[chamber], self.machine
        edge = v["dead_zone_positive"] if extending else -v["dead_zone_negative"]
        k = maximum((u if extending else -u) - edge, 0.0) * v[f"valve_gain_{chamber}"]
        loss = LOSSES[chamber][0 if extending else 1]
        h = k * constant(f"half_{loss}", 0.5 * v[loss])
        fed = (chamber == 1) == extending
        drop = constant("supply", m.supply) - p if fed else p - constant("tank", m.tank)
        reach = self.known[f"pressure_{chamber}"]
        turns = m.supply < reach.high if fed else reach.low < m.tank
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

    def _take(self, draft: Draft, chambers: Sequence[int]) -> dict[int, Expression]:
        return {i: draft.argument(self.known[f"pressure_{i}"]) for i in chambers}

    def _speed(self, chambers: Sequence[int]) -> Routine:
        draft = Draft("speed", "Steady speed for a command and measured pressures.", "m/s")
        u = draft.argument(self.known["command"])
        p = self._take(draft, chambers)
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
        flow = chamber_flow(chamber, command, ends, self.values[chamber], self.machine)
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
        p, found = self._take(draft, chambers), {}
        for way, i in feeding.items():
            v, sign, m = self.values[i], 1.0 if way else -1.0, self.machine
            name = "forward" if way else "backward"
            area = constant(f"area_{i}", m.area(i))
            flow = draft.let(f"flow_{name}", maximum(speed * sign, 0.0) * area)
            supply = constant("supply", m.supply)
            drop = supply - p[i] if (i == 1) == way else p[i] - constant("tank", m.tank)
            rest = draft.let(f"rest_{name}", drop - v[LOSSES[i][0 if way else 1]] * flow)
            least = constant("least_drop", _LEAST * m.supply)
            draft.flag(choose(flow, ">", 0.0, rest, supply), least)
            per_gain = constant(f"per_valve_gain_{i}", 1.0 / v[f"valve_gain_{i}"])
            beyond = flow * per_gain / sqrt(maximum(rest, least))
            edge = v["dead_zone_positive" if way else "dead_zone_negative"]
            found[way] = edge + sign * beyond
        ends = (
            minimum(found[True], constant("highest", u.high)),
            maximum(found[False], constant("lowest", u.low)),
        )
        return draft.returns(by_sign(speed, *ends))

    def _friction(self) -> Routine:
        seen = [i for i in self.values if f"pressure_{i}" in self.known]
        most = max((self._fastest(i, way) for i in seen for way in (True, False)), default=0.0)
        draft = Draft("friction", "Friction of the moving piston.", "N")
        v = draft.argument(
            Argument("velocity", "m/s", "speed of the piston", -most, most, recorded=False)
        )
        return draft.returns(self.law.routine_value(v))

    def _network(self, name: str, net: ScaledNetwork) -> Routine:
        about = f"{name.replace('_', ' ').capitalize()} by the network of the file."
        draft = Draft(f"{name}_network", about, "N" if name == "friction" else "m3/s")
        if name == "friction":
            of: Sequence[Argument] = self._friction().arguments
        else:
            of = self.known["command"], self.known[f"pressure_{name.removeprefix('flow_')}"]
        return draft.returns(net.draw(draft, [draft.argument(a) for a in of]))
