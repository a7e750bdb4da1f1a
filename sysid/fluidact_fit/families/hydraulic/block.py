"""Static part of the cylinder for a controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import UsageError
from ...estimation.hydraulics import (
    LOSSES,
    chamber_flow,
)
from ...estimation.parametric import (
    scalars,
)
from ...experiment import FloatArray
from ...family import Block, Value
from .networks import network_of
from .stage import read_machine


class HydraulicBlock(Block):
    """Static part of the cylinder for a controller: flow, speed, and the command for a speed.

    Attributes
    ----------
    parameters
        Values by name [SI].
    """

    family = "hydraulic-cylinder"

    def __init__(self, values: Mapping[str, Value], options: Mapping[str, Any]) -> None:
        self.parameters = dict(values)
        known = [i for i in (1, 2) if f"valve_gain_{i}" in values]
        self._machine = read_machine(options, known)
        self._values = scalars(values)
        self._known = known
        self._nets = {i: network_of(values, f"flow_{i}") for i in (1, 2)}

    def flow(
        self,
        chamber: int,
        command: npt.ArrayLike,
        pressure: npt.ArrayLike,
        *,
        network: bool = False,
    ) -> FloatArray:
        """Flow into chamber 1 or out of chamber 2 [m3/s].

        Parameters
        ----------
        chamber
            1 or 2.
        command, pressure
            [V] and [Pa], scalars or arrays.
        network
            Whether to ask the network (``--flow mlp``) instead of the equation.
        """
        u, p = np.broadcast_arrays(np.asarray(command, float), np.asarray(pressure, float))
        self._need(chamber)
        if network:
            net = self._nets[chamber]
            if net is None:
                raise UsageError(
                    f"the file holds no network of the flow of chamber {chamber}",
                    remedy="Fit with --flow mlp.",
                )
            return net(np.column_stack((u.ravel(), p.ravel()))).reshape(u.shape)
        m = self._machine
        return np.real(chamber_flow(chamber, u, p, self._values, m.supply, m.tank))

    def _need(self, chamber: int) -> None:
        if chamber not in self._known:
            raise UsageError(
                f"the file holds no valve gain of chamber {chamber}",
                remedy="Fit logs that hold its pressure.",
            )

    def _feeding(self, extending: bool) -> int:
        """Chamber that meters the flow in; the other one where that is not known."""
        chamber = 1 if extending else 2
        return chamber if chamber in self._known else self._known[0]

    def __call__(self, command: float, pressure_1: float = 0.0, pressure_2: float = 0.0) -> float:
        """Steady speed for a command and the measured pressures [m/s].

        The flow of the chamber that is being fed sets it; friction and load are in the
        pressures.

        Parameters
        ----------
        command
            [V]
        pressure_1, pressure_2
            [Pa]; only that of the chamber being fed is used.
        """
        chamber = self._feeding(command >= 0.0)
        pressure = pressure_1 if chamber == 1 else pressure_2
        return float(self.flow(chamber, command, pressure)) / self._machine.area(chamber)

    def command_for(
        self, velocity: float, pressure_1: float = 0.0, pressure_2: float = 0.0
    ) -> float:
        """Feed-forward command for a wanted speed: the exact inverse of calling the block.

        Parameters
        ----------
        velocity
            [m/s]
        pressure_1, pressure_2
            [Pa]

        Returns
        -------
        float
            Command [V]; 0 for zero speed, infinite where the pressures leave no drop for it.
        """
        if velocity == 0.0:
            return 0.0
        extending = velocity > 0.0
        chamber = self._feeding(extending)
        pressure = pressure_1 if chamber == 1 else pressure_2
        m, v = self._machine, self._values
        fed = extending == (chamber == 1)
        drop = m.supply - pressure if fed else pressure - m.tank
        flow = abs(velocity) * m.area(chamber)
        loss = v.get(LOSSES[chamber][0 if extending else 1], 0.0)
        rest = drop - loss * flow
        sign = 1.0 if extending else -1.0
        if rest <= 0.0:
            return sign * float("inf")
        edge = v["dead_zone_positive" if extending else "dead_zone_negative"]
        return edge + sign * flow / (v[f"valve_gain_{chamber}"] * float(np.sqrt(rest)))
