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
from ...estimation.named_model import Values
from ...estimation.parametric import Fitted
from ...estimation.response import Plan, ResponseOptions, Searched
from ...estimation.starts import time_scales
from ...experiment import Experiment
from ...family import ParameterSpec, Quantity, Request, Role, Variant
from ...options import number
from ...units import as_time
from .base import TransferFamily

_SENSORS = ("V", "A", "1")  # of two alike, whose zeros are free and whose gain cancels
_NEAR = 0.1  # sample times from a sample
_FAST = 0.6  # sample times of a time constant below which samples show little of the response


@dataclass(frozen=True)
class LineOptions(ResponseOptions):
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
                Role("inlet", "Pa", "pressure at the valve side", hold="auto",
                     alternatives=_SENSORS),
                Role("outlet", "Pa", "pressure at the far end, in the unit of the inlet",
                     output=True, alternatives=_SENSORS),
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
            alike=("inlet", "outlet"),
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

    def elsewhere(self, values: Values, step: float) -> list[dict[str, float]]:
        """Other dead times within the sample interval, for a line that has answered at its end.

        Only what is left of a step at the first sample after it, ``exp(-(t - dead_time) /
        time_constant)``, then tells anything: one number for two unknowns.
        """
        lag, late = values["time_constant"], values["dead_time"]
        if lag > _FAST * step:
            return []
        out = []
        # a dead time that ends near a sample belongs to the intervals on both sides of it
        for first in {np.floor(late / step - _NEAR), np.floor(late / step + _NEAR)}:
            left = ((first + 1.0) * step - max(late, first * step)) / lag
            if first < 0.0 or left < 1e-3:
                continue
            for part in (0.05, 0.25, 0.5, 0.75, 0.95):
                rest = (1.0 - part) * step
                dead_time = float((first + 1.0) * step - rest)
                out.append({"time_constant": float(rest / left), "dead_time": dead_time})
        return out

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
                f"the dead time {as_time(dead_time)} is not the travel time "
                f"L/c = {as_time(expected)} of {length:g} m at {speed or 343.0:g} m/s"
                f"{assumed}. A longer dead time includes delays of valve, sensor or bus, or the "
                "slow first part of filling; a shorter one means that the time stamps or the "
                "inlet signal are late.",
            )
        ]
