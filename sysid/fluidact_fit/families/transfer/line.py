"""Pneumatic or hydraulic transmission line: gain, time constant, dead time.

    Y(s)/U(s) = K exp(-T_d s) / (tau s + 1)

The first order stands for filling the volume at the far end, the dead time for the wave
that has to travel there, ``L/c`` for a line of length ``L`` and sound speed ``c`` [1]_.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   chapter 4: 14.7 ms measured over 5 m of hose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Notice
from ...estimation.parametric import Fitted, Values
from ...experiment import Experiment
from ...family import ParameterSpec, Quantity, Request, Role, Variant
from ...options import number
from .base import Plan, Searched, TransferFamily, TransferOptions
from .model import time_scales


@dataclass(frozen=True)
class LineOptions(TransferOptions):
    """What is known about the line."""

    length: float | None = number(
        help="length of the line, to compare the dead time with", unit="m", above=0.0
    )
    sound_speed: float | None = number(help="sound speed in the line", unit="m/s", above=0.0)


class Line(TransferFamily[LineOptions]):
    """First-order line with dead time."""

    name = "line"
    title = "Transmission line: gain, time constant and dead time"
    equation = "outlet(s)/inlet(s) = gain * exp(-dead_time s) / (time_constant s + 1)"
    variants = (
        Variant(
            "line",
            (
                Role("time", "s", "time of each sample"),
                Role("inlet", "Pa", "pressure at the valve side", hold="auto"),
                Role("outlet", "Pa", "pressure at the far end", output=True),
            ),
            (
                ParameterSpec(
                    "gain", "1", "steady outlet pressure per inlet pressure", minimum=0.0,
                    remedy="Record at least one step of the inlet between two levels.",
                ),
                ParameterSpec(
                    "time_constant", "s", "time constant of filling the far volume", minimum=1e-9,
                    remedy="Sample faster, or record a step instead of a slow change.",
                ),
                ParameterSpec(
                    "dead_time", "s", "time before the outlet begins to move",
                    neutral=0.0, minimum=0.0, curved=True,
                    remedy="Record sharp steps of the inlet, sampled several times within "
                    "the time the wave needs to travel.",
                ),
            ),
        ),
    )  # fmt: skip
    options_type = LineOptions
    gain = "gain"
    steady_offset = True

    @staticmethod
    def realise(values: Values) -> tuple[Any, Any, Any]:
        """State space of ``1/(tau s + 1)``."""
        rate = 1.0 / values["time_constant"]
        return np.array([[-rate]]), np.array([rate]), np.array([1.0])

    def coefficients(self, values: Mapping[str, float]) -> tuple[list[float], list[float]]:
        """``gain / (time_constant s + 1)``."""
        return [values["gain"]], [values["time_constant"], 1.0]

    def plan(self, experiments: Sequence[Experiment], request: Request[LineOptions]) -> Plan:
        """Search over time constants and dead times."""
        step, span = time_scales(experiments)
        axis = np.geomspace(0.3 * step, 0.5 * span, 7)
        searched = (
            Searched("time_constant", step, (1e-3 * step, 100.0 * span), axis),
            Searched("dead_time", step, (0.0, 0.5 * span), sensible=0.25 * span),
        )
        return Plan(searched, lag=lambda at: at["time_constant"])

    def derive(
        self, fitted: Fitted, options: LineOptions
    ) -> tuple[dict[str, Quantity], list[Notice]]:
        """Bandwidth, rise time from 10 to 90 %, and how the dead time compares with ``L/c``."""
        derived = fitted.derive(
            {"bandwidth": "rad/s", "rise_time": "s"},
            lambda v: {
                "bandwidth": 1.0 / v["time_constant"],
                "rise_time": np.log(9.0) * v["time_constant"],
            },
        )
        length, speed = options.length, options.sound_speed
        if length is None:
            return derived, []
        dead_time, expected = float(fitted.values["dead_time"]), length / (speed or 343.0)
        derived["wave_travel_time"] = Quantity(expected, "s", "derived")
        if dead_time > 0.0:
            derived["apparent_sound_speed"] = Quantity(length / dead_time, "m/s", "derived")
        error = fitted.std_error("dead_time") if "dead_time" in fitted.names else 0.0
        allowed = max(2.0 * error, 0.05 * expected)
        if abs(dead_time - expected) <= allowed:
            return derived, []
        assumed = "" if speed else " (air at 20 °C assumed; give --sound-speed)"
        return derived, [
            Notice(
                "dead-time-not-travel-time",
                f"the dead time {dead_time * 1e3:.3g} ms is not the travel time "
                f"L/c = {expected * 1e3:.3g} ms of {length:g} m at {speed or 343.0:g} m/s"
                f"{assumed}. A longer dead time includes delays of valve, sensor or bus, or the "
                "slow first part of filling; a shorter one means that the time stamps or the "
                "inlet signal are late.",
            )
        ]
