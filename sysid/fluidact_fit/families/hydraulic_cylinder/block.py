"""Static part of the cylinder for a controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import FlowBlock
from ...errors import UsageError
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import Experiment, FloatArray
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import EDGES, LOSSES, Machine, chamber_flow
from ...routines import Argument, Routine
from ...specification import scalars
from .networks import network_of
from .options import HydraulicCylinderOptions
from .routines import CylinderRoutines, feeding_chamber
from .setup import known_chambers, read_machine
from .simulation import simulate_run

_FAR = 100.0  # supply pressures: nothing that oil does goes as far


class HydraulicBlock(FlowBlock):
    """Static part of the cylinder for a controller: flow, speed, and the command for a speed."""

    @cached_property
    def _options(self) -> HydraulicCylinderOptions:
        return self.document.settled_options(HydraulicCylinderOptions)

    @cached_property
    def _known(self) -> list[int]:
        return known_chambers(self.parameters)

    @cached_property
    def _machine(self) -> Machine:
        return read_machine(self._options, self._known)

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
        return chamber_flow(chamber, u, p, self.parameters, self._machine)

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
        chamber = feeding_chamber(self._known, command >= 0.0)
        pressure = (pressure_1, pressure_2)[chamber - 1]
        return float(self.flow(chamber, command, pressure)) / self._machine.area(chamber)

    def command_for(
        self, velocity: float, pressure_1: float = 0.0, pressure_2: float = 0.0
    ) -> float:
        """Feed-forward command [V] for a speed [m/s]: the exact inverse of calling the block.

        It is 0 for zero speed and infinite where the pressures [Pa] leave no drop for it.
        """
        if velocity == 0.0:
            return 0.0
        way, sign = (0, 1.0) if velocity > 0.0 else (1, -1.0)
        chamber, m = feeding_chamber(self._known, velocity > 0.0), self._machine
        pressure = (pressure_1, pressure_2)[chamber - 1]
        drop = float(m.pressure_drop(chamber, np.array(velocity > 0.0), pressure))
        loss, edge, gain = LOSSES[chamber][way], EDGES[1 - way], f"valve_gain_{chamber}"
        v = scalars({n: self.parameters[n] for n in (loss, edge, gain)})
        flow = abs(velocity) * m.area(chamber)
        rest = drop - v[loss] * flow
        if rest <= 0.0:
            return sign * float("inf")
        return v[edge] + sign * flow / (v[gain] * float(np.sqrt(rest)))

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Flows, speed and friction by the equations; see :meth:`.Block.methods`."""
        flows = {f"flow_{i}": partial(self.flow, i) for i in (1, 2)}
        return {**flows, "speed": self, "friction": self.friction}

    def routines(self) -> Sequence[Routine]:
        """Flows, steady speed, the command for a speed, friction, and the networks of the file."""
        names = ("command", "pressure_1", "pressure_2")
        known = {n: self.argument(n, "measured") for n in names if n in self.validity}
        return CylinderRoutines(self._machine, self.parameters, self._known, known).all()

    def plant_flows(self) -> tuple[Routine, Routine]:
        """Flows of both chambers at any pressure; see :meth:`.FlowBlock.plant_flows`."""
        far, known = (
            _FAR * self._machine.supply,
            {"command": self.argument("command", "of the valve")},
        )
        for chamber in (1, 2):
            self._check_chamber(chamber)
            name = f"pressure_{chamber}"
            known[name] = Argument(name, "Pa", "of the chamber", -far, far, recorded=False)
        return CylinderRoutines(self._machine, self.parameters, self._known, known).flows()

    def predict(self, experiment: Experiment) -> FloatArray:
        """Position from the inputs of an experiment; see :meth:`.Block.predict`.

        The gray box asks for the command alone, a file without mass and volumes for the
        pressure as well. The run starts from rest in the middle of the fitted logs.
        """
        inputs = {r: s for r, s in experiment.signals.items() if r != "position"}
        run = replace(experiment, signals=inputs)
        return simulate_run(run, self.parameters, self._options).output
