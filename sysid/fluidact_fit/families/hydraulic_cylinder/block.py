"""Static part of the cylinder for a controller: in Python, and as the code that one runs.

With ``h = k r / 2`` the flow through orifice and line is ``k (sqrt(h^2 + drop) - h)``, which needs
no division; see :func:`.mechanics.hydraulic_cylinder.orifice_flow`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import FlowBlock
from ...errors import UsageError
from ...estimation.named_model import Values
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import Experiment, FloatArray
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import EDGES, LOSSES, ROUTINES, HydraulicMachine, chamber_flow
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
from .options import HydraulicCylinderOptions
from .setup import known_chambers, read_machine
from .simulation import simulate_run

_FAR = 100.0  # supply pressures: nothing that oil does goes as far
_LEAST = 1e-3  # of the supply pressure has to be left to find a command for a speed
_ABOUT = {1: "Flow into chamber 1.", 2: "Flow out of chamber 2."}
_ROLES = ("command", "pressure_1", "pressure_2")


class HydraulicBlock(FlowBlock):
    """Static part of the cylinder for a controller: flow, speed, and the command for a speed."""

    @cached_property
    def _options(self) -> HydraulicCylinderOptions:
        return self.document.settled_options(HydraulicCylinderOptions)

    @cached_property
    def _known(self) -> list[int]:
        return known_chambers(self.parameters)

    @cached_property
    def machine(self) -> HydraulicMachine:
        """What is given of the machine (``UsageError`` where the file lacks what it needs)."""
        return read_machine(self._options, self._known)

    @property
    def _values(self) -> Values:
        """Single-valued parameters; one that was not identified is refused where it is needed."""
        return self.parameters

    @cached_property
    def _measured(self) -> dict[str, Argument]:
        """Arguments of the routines with the ranges of the logs, by role."""
        return {n: self.argument(n, "measured") for n in _ROLES if n in self.validity}

    def _check_chamber(self, chamber: int) -> None:
        if chamber not in self._known:
            raise UsageError(
                f"the file holds no valve gain of chamber {chamber}",
                remedy="Fit logs that hold its pressure.",
            )

    def _network(self, name: str, option: str) -> ScaledNetwork:
        net = network_of(self.parameters, name)
        if net is None:
            raise UsageError(
                f"the file holds no network of the {name.replace('_', ' of chamber ')}",
                remedy=f"Fit with --{option}=mlp.",
            )
        return net

    def flow(
        self, chamber: int, command: npt.ArrayLike, pressure: npt.ArrayLike, *,
        network: bool = False,
    ) -> FloatArray:  # fmt: skip
        """Flow into chamber 1 or out of chamber 2 [m3/s].

        Parameters
        ----------
        command, pressure
            [V] and [Pa], scalars or arrays.
        network
            Whether to ask the network (``--flow mlp``) instead of the equation.
        """
        self._check_chamber(chamber)
        self.watch(**{"command": command, f"pressure_{chamber}": pressure})
        u, p = np.broadcast_arrays(np.asarray(command, float), np.asarray(pressure, float))
        if network:
            net = self._network(f"flow_{chamber}", "flow")
            return net(np.column_stack((u.ravel(), p.ravel()))).reshape(u.shape)
        return chamber_flow(chamber, u, p, self.parameters, self.machine)

    def friction(self, velocity: npt.ArrayLike, *, network: bool = False) -> FloatArray:
        """Friction of the moving piston [N] at velocities [m/s]: of the law, or of the network."""
        v = np.asarray(velocity, float)
        if network:
            return self._network("friction", "friction")(v.reshape(-1, 1)).reshape(v.shape)
        return FrictionLaw.of(self.parameters).moving(v)

    def __call__(self, command: float, pressure_1: float = 0.0, pressure_2: float = 0.0) -> float:
        """Steady speed for a command [V] and the measured pressures [Pa], in m/s.

        The flow of the chamber that is being fed sets it, and only that pressure is used:
        friction and load are in it.
        """
        chamber = _feeding(self._known, command >= 0.0)
        pressure = (pressure_1, pressure_2)[chamber - 1]
        return float(self.flow(chamber, command, pressure)) / self.machine.area(chamber)

    def command_for(
        self, velocity: float, pressure_1: float = 0.0, pressure_2: float = 0.0
    ) -> float:
        """Feed-forward command [V] for a speed [m/s]: the exact inverse of calling the block.

        It is 0 for zero speed and infinite where the pressures [Pa] leave no drop for it.
        """
        if velocity == 0.0:
            return 0.0
        way, sign = (0, 1.0) if velocity > 0.0 else (1, -1.0)
        chamber, m = _feeding(self._known, velocity > 0.0), self.machine
        pressure = (pressure_1, pressure_2)[chamber - 1]
        drop = float(m.pressure_drop(chamber, velocity, pressure))
        v, flow = self._values, abs(velocity) * m.area(chamber)
        rest = drop - v[LOSSES[chamber][way]] * flow
        if rest <= 0.0:
            return sign * float("inf")
        opening = flow / (v[f"valve_gain_{chamber}"] * float(np.sqrt(rest)))
        return float(v[EDGES[1 - way]] + sign * opening)

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Flows, speed and friction by the equations; see :meth:`.Block.methods`."""
        flows = {f"flow_{i}": partial(self.flow, i) for i in (1, 2)}
        return {**flows, "speed": self, "friction": self.friction}

    def routines(self) -> Sequence[Routine]:
        """Flows, steady speed, the command for a speed, friction, and the networks of the file."""
        u = self._measured["command"]
        pressures = {i: self._measured[n] for i in self._known
                     if (n := f"pressure_{i}") in self._measured}  # fmt: skip
        found = [self._flow(i, u, p) for i, p in pressures.items()]
        if pressures:
            found += [self._speed(u, pressures), self._command(u, pressures)]
        friction = self._friction(u, pressures)
        nets = {n: net for n in NETWORKS if (net := network_of(self.parameters, n)) is not None}
        return (*found, friction, *(self._drawn(n, net, friction) for n, net in nets.items()))

    def plant_flows(self) -> tuple[Routine, Routine]:
        """Flows of both chambers at any pressure; see :meth:`.FlowBlock.plant_flows`."""
        far, u, found = _FAR * self.machine.supply, self.argument("command", "of the valve"), []
        for i in (1, 2):
            self._check_chamber(i)
            draft = Draft(f"plant_flow_{i}", _ABOUT[i], "m3/s")
            pressure = Argument(
                f"pressure_{i}", "Pa", "of the chamber", -far, far, recorded=False
            )  # fmt: skip
            of = draft.argument(u), draft.argument(pressure)
            flow = chamber_flow(i, *of, self._values, self.machine, ROUTINES)
            found.append(draft.returns(flow))
        return found[0], found[1]

    def predict(self, experiment: Experiment) -> FloatArray:
        """Position from the inputs of an experiment; see :meth:`.Block.predict`.

        The gray box asks for the command alone, a file without mass and volumes for the
        pressure as well. The run starts from rest in the middle of the fitted logs.
        """
        inputs = {r: s for r, s in experiment.signals.items() if r != "position"}
        run = replace(experiment, signals=inputs)
        return simulate_run(run, self.parameters, self._options).output

    # ------------------------------------------------------------------- parts of routines

    def _drop(
        self, chamber: int, p: Expression, reach: Argument, extending: bool
    ) -> tuple[Expression, bool]:
        """Pressure over valve and line, and whether the range of pressures turns it."""
        m = self.machine
        if (chamber == 1) == extending:
            return constant("supply", m.supply) - p, m.supply < reach.high
        return p - constant("tank", m.tank), reach.low < m.tank

    def _one_way(
        self, chamber: int, u: Expression, p: Expression, reach: Argument, extending: bool
    ) -> Expression:
        """Size of the flow of a chamber in one direction of the command."""
        v, way = self._values, 0 if extending else 1
        beyond = u - v[EDGES[1]] if extending else -u - -v[EDGES[0]]
        k = maximum(beyond, 0.0) * v[f"valve_gain_{chamber}"]
        loss = LOSSES[chamber][way]
        h = k * constant(f"half_{loss}", 0.5 * v[loss])
        drop, turns = self._drop(chamber, p, reach, extending)
        flow = sqrt(h * h + maximum(drop, 0.0)) - h
        if turns:  # the pressure was seen beyond that of supply or tank
            flow = flow - (sqrt(h * h + maximum(-drop, 0.0)) - h)
        return k * flow

    def _flow(self, chamber: int, command: Argument, pressure: Argument) -> Routine:
        draft = Draft(f"flow_{chamber}", _ABOUT[chamber], "m3/s")
        u, p = draft.argument(command), draft.argument(pressure)
        ways = (self._one_way(chamber, u, p, pressure, way) for way in (True, False))
        there, back = (
            draft.let(f"{n}_{chamber}", x) for n, x in zip(("forward", "backward"), ways)
        )
        return draft.returns(there - back)

    def _speed(self, command: Argument, pressures: Mapping[int, Argument]) -> Routine:
        draft = Draft("speed", "Steady speed for a command and measured pressures.", "m/s")
        u, p = draft.argument(command), {i: draft.argument(x) for i, x in pressures.items()}
        ways = []
        for extending in (True, False):
            i = _feeding([*pressures], extending)
            flow = self._one_way(i, u, p[i], pressures[i], extending)
            ways.append(flow * constant(f"per_area_{i}", 1.0 / self.machine.area(i)))
        return draft.returns(ways[0] - ways[1])

    def _fastest(self, chamber: int, u: Argument, p: Argument, extending: bool) -> float:
        """Speed at the end of the command's range, at the pressure that gives most."""
        command, ends = np.full(2, u.high if extending else u.low), np.array([p.low, p.high])
        flow = chamber_flow(chamber, command, ends, self.parameters, self.machine)
        return float(np.abs(flow).max()) / self.machine.area(chamber)

    def _command(self, u: Argument, pressures: Mapping[int, Argument]) -> Routine:
        """Inverse of the speed; it ends at the range of the command and tells of that."""
        draft = Draft("command_for", "Command for a speed and measured pressures.", u.unit)
        feeding = {way: _feeding([*pressures], way) for way in (True, False)}
        fastest, slowest = (self._fastest(i, u, pressures[i], w) for w, i in feeding.items())
        speed = draft.argument(
            Argument("velocity", "m/s", "wanted speed", -slowest, fastest, recorded=False)
        )
        p, found = {i: draft.argument(x) for i, x in pressures.items()}, {}
        for way, i in feeding.items():
            v, m = self._values, self.machine
            name, sign = ("forward", 1.0) if way else ("backward", -1.0)
            area = constant(f"area_{i}", m.area(i))
            flow = draft.let(f"flow_{name}", maximum(speed * sign, 0.0) * area)
            supply = constant("supply", m.supply)
            drop, _ = self._drop(i, p[i], pressures[i], way)
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

    def _friction(self, command: Argument, pressures: Mapping[int, Argument]) -> Routine:
        speeds = [
            self._fastest(i, command, p, w) for i, p in pressures.items() for w in (True, False)
        ]
        most = max(speeds, default=0.0)
        draft = Draft("friction", "Friction of the moving piston.", "N")
        v = draft.argument(
            Argument("velocity", "m/s", "speed of the piston", -most, most, recorded=False)
        )
        return draft.returns(FrictionLaw.of(self.parameters).routine_value(v))

    def _drawn(self, name: str, net: ScaledNetwork, friction: Routine) -> Routine:
        about = f"{name.replace('_', ' ').capitalize()} by the network of the file."
        unit, of = "N", friction.arguments
        if name != "friction":
            pressure = self._measured[f"pressure_{name.removeprefix('flow_')}"]
            unit, of = "m3/s", (self._measured["command"], pressure)
        draft = Draft(f"{name}_network", about, unit)
        return draft.returns(net.draw(draft, [draft.argument(a) for a in of]))


def _feeding(known: Sequence[int], extending: bool) -> int:
    """Return the chamber that meters the flow in, or the other one where that is not known."""
    wanted = 1 if extending else 2
    return wanted if wanted in known else known[0]
