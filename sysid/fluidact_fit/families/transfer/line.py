"""Pneumatic or hydraulic transmission line: gain, time constant, dead time.

    Y(s)/U(s) = K exp(-T_d s) / (tau tau_2 s^2 + tau s + 1),  tau_2 = 0 unless asked for

from the pressure at its valve side, or from the command of the valve where that was not recorded:
the gain is then a pressure per command, and valve and line are one lag with one dead time.

The first order stands for filling the volume at the far end, the dead time for the wave
that has to travel there, ``L/c`` for a line of length ``L`` and sound speed ``c`` [1]_. A second
order stands for another lag or for fluid that swings: ``tau`` is the sum of all lags; ``tau_2`` is
about the shorter of two, and above ``tau / 4`` the line swings.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   chapter 4: 14.7 ms measured over 5 m of hose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ...errors import Notice, UsageError
from ...estimation.named_model import Values
from ...estimation.parametric import Fitted
from ...estimation.response_model import Plan, ResponseOptions, Searched
from ...estimation.starts import time_scales
from ...estimation.unmodelled_effects import change_to
from ...experiment import Experiment
from ...family import ParameterSpec, Plant, Request, Role, Structure, UnmodelledEffect, Variant
from ...options import choice, number
from ...units import as_time
from .base import TransferFamily, any_dead_time, dead_time

_SENSORS = ("V", "A", "1")  # of two alike, whose zeros are free and whose gain cancels
_EQUATION = (
    "outlet(s)/{}(s) = gain * exp(-dead_time s) "
    "/ (time_constant s + 1 (+ time_constant second_time_constant s^2))"
)
_SECOND = "second_time_constant"
_PART = 0.1  # of the first time constant, that a second one is tried with
_SOUND_IN_AIR = 343.0  # at 20 °C [m/s]


@dataclass(frozen=True)
class LineOptions(ResponseOptions):
    """Options about the line."""

    length: float | None = number(help="length, to compare the dead time with", unit="m", above=0.0)
    sound_speed: float | None = number(help="sound speed in the line", unit="m/s", above=0.0)
    order: str = choice(
        "first", ("first", "second"), "whether to estimate one time constant, or two"
    )


def _variant(name: str, drive: Role, outlet: Role, gain: dict[str, Any], **more: Any) -> Variant:
    """A line behind what drives it; ``gain`` is what of its spec depends on that."""
    steps = f"Record sharp steps of the {drive.name}, sampled several times within"
    return Variant(
        name,
        (Role("time", "s", "time of each sample"), drive, outlet),
        (
            ParameterSpec(
                "gain", description=f"steady outlet per {drive.name}", **gain,
                remedy=f"Record at least one step of the {drive.name} between two levels.",
            ),
            ParameterSpec(
                "time_constant", "s", "time constant of filling the far volume", minimum=1e-9,
                remedy="Sample faster, or record a step instead of a slow change.",
            ),
            dead_time("time before the outlet begins to move", f"{steps} the time a wave travels."),
            ParameterSpec(
                _SECOND, "s", "of a second order, about its shorter lag; of a first order 0",
                neutral=0.0, minimum=0.0, optional=True,
                remedy=f"{steps} it; or leave --order out.",
            ),
        ),
        **more,
    )  # fmt: skip


class Line(TransferFamily[LineOptions]):
    """Line of first or second order with dead time."""

    name = "line"
    title = "Transmission line: gain, time constant and dead time"
    equation = _EQUATION.format("inlet")
    variants = (
        _variant(
            "line",
            Role("inlet", "Pa", "pressure at the valve side", hold="auto", alternatives=_SENSORS),
            Role("outlet", "Pa", "pressure at the far end, in the unit of the inlet",
                 output=True, alternatives=_SENSORS),
            {"unit": "1", "minimum": 0.0},
            alike=("inlet", "outlet"),
            unlike="If inlet is the command of a valve, name it so: --column command=HEADER.",
        ),
        _variant(
            "command",
            Role("command", "V", "command of the valve before the line", hold="zoh",
                 alternatives=("A", "1")),
            Role("outlet", "Pa", "pressure at the far end", output=True, alternatives=("V", "1")),
            {"unit": "Pa/V", "ratio": ("outlet", "command")},
            equation=_EQUATION.format("command"),
        ),
    )  # fmt: skip
    options_type = LineOptions
    structures = (
        Structure("first order", {"order": "first"}, {"dead_time": 0.0}),
        Structure("first order, dead time", {"order": "first"}),
        Structure("second order", {"order": "second"}, {"dead_time": 0.0}),
        Structure("second order, dead time", {"order": "second"}, instead=True),
    )
    gain = "gain"
    steady_offset = True

    def coefficients(self, values: Values) -> tuple[list[Any], list[Any]]:
        """``1 / (time_constant second_time_constant s^2 + time_constant s + 1)``."""
        slow, fast = values["time_constant"], values.get(_SECOND, 0.0)
        return [1.0], [slow * fast, slow, 1.0] if np.real(fast) else [slow, 1.0]

    def plan(self, experiments: Sequence[Experiment], request: Request[LineOptions]) -> Plan:
        """Search over time constants and dead times."""
        if request.options.sound_speed is not None and request.options.length is None:
            raise UsageError(
                "--sound-speed means nothing without --length",
                remedy="Give the length of the line as well, or leave it out.",
            )
        step, span = time_scales(experiments)
        axis = np.geomspace(0.3 * step, 0.5 * span, 7)
        searched = [
            Searched("time_constant", step, (1e-3 * step, 100.0 * span), axis),
            any_dead_time(step, span),
        ]
        if request.options.order == "second" or _SECOND in request.fixed:
            none = 0.1 * step  # too short for the samples to show it
            searched.append(
                Searched(_SECOND, step, (none, 100.0 * span), axis[::2], no_effect_at=none)
            )
        return Plan(searched, lag=lambda at: at["time_constant"])

    def unmodelled_effects(self, plant: Plant[LineOptions]) -> Sequence[UnmodelledEffect]:
        """A second order, where the first was fitted; see :meth:`Family.unmodelled_effects`.

        A tiny lag could not be told from a dead time with a longer time constant.
        """
        size = _PART * plant.numbers["time_constant"]
        behind = replace(plant, values={**plant.values, _SECOND: size})
        second = UnmodelledEffect(
            "second order", "the response is of second order", "Try --order=second.",
            partial(change_to, plant, behind, size), "s", positive=True, offered=True,
        )  # fmt: skip
        fitted = plant.values.get(_SECOND)
        return [*super().unmodelled_effects(plant), *([] if fitted else [second])]

    derived_units: ClassVar[Mapping[str, str]] = {
        "bandwidth": "rad/s", "rise_time": "s", "wave_travel_time": "s",
        "apparent_sound_speed": "m/s",
    }  # fmt: skip

    def derived(self, values: Values, options: LineOptions) -> dict[str, Any]:
        """Bandwidth, rise time from 10 to 90 %, ``L/c``, and the ``c`` that the dead time means.

        The bandwidth ``w`` of a second order solves ``|(1 - tau tau_2 w^2) + i tau w|^2 = 2``; its
        rise time has no closed form.
        """
        slow, fast = values["time_constant"], values.get(_SECOND, 0.0)
        middle = slow * (0.5 * slow - fast)
        out = {"bandwidth": 1.0 / np.sqrt(middle + np.sqrt(middle**2 + (slow * fast) ** 2))}
        if not fast:
            out["rise_time"] = np.log(9.0) * slow
        if options.length is not None:
            out["wave_travel_time"] = options.length / (options.sound_speed or _SOUND_IN_AIR)
            if np.real(values["dead_time"]) > 0.0:
                out["apparent_sound_speed"] = options.length / values["dead_time"]
        return out

    def notices(self, fitted: Fitted, options: LineOptions) -> list[Notice]:
        """How the dead time compares with ``L/c``."""
        dead_time, known = fitted.values["dead_time"], options.sound_speed
        expected = self.derived(fitted.values, options).get("wave_travel_time", dead_time)
        error = fitted.std_error("dead_time") if "dead_time" in fitted.names else 0.0
        if abs(dead_time - expected) <= max(2.0 * error, 0.05 * expected):
            return []
        assumed = "" if known else " (air at 20 °C assumed; give --sound-speed)"
        cause = "The time stamps or the inlet signal are late."
        if dead_time > expected:
            cause = "It includes delays of valve, sensor or bus, or the slow first part of filling."
        return [
            Notice(
                "dead-time-not-travel-time",
                f"the dead time {as_time(dead_time)} is not the travel time L/c = "
                f"{as_time(expected)} of {options.length:g} m at {known or _SOUND_IN_AIR:g} m/s"
                f"{assumed}. {cause}",
            )
        ]
