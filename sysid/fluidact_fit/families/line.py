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
from typing import Any

import numpy as np

from ..discrete import discretise
from ..errors import Notice
from ..estimation.information import Information, sensitivity
from ..estimation.parametric import (
    Values,
    bind,
    check_request,
    derive,
    make_unknowns,
    quantities,
    scalars,
)
from ..estimation.transfer import (
    TransferModel,
    dead_time_axis,
    fit_transfer,
    grid_search,
    simulate_transfer,
    time_scales,
)
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    Value,
    Variant,
)


def realise(values: Values) -> tuple[Any, Any, Any]:
    """State space of ``1/(tau s + 1)``."""
    rate = 1.0 / values["time_constant"]
    return np.array([[-rate]]), np.array([rate]), np.array([1.0])


class Line(Family):
    """First-order line with dead time."""

    name = "line"
    title = "Transmission line: gain, time constant and dead time"
    equation = "outlet(s)/inlet(s) = gain * exp(-dead_time s) / (time_constant s + 1)"
    variants = (
        Variant(
            "line",
            (
                Role("time", "s", "time of each sample"),
                Role("inlet", "Pa", "pressure at the valve side", hold="foh"),
                Role("outlet", "Pa", "pressure at the far end", output=True),
            ),
            (
                ParameterSpec(
                    "gain",
                    "1",
                    "steady outlet pressure per inlet pressure",
                    minimum=0.0,
                    remedy="Record at least one step of the inlet between two levels.",
                ),
                ParameterSpec(
                    "time_constant",
                    "s",
                    "time constant of filling the far volume",
                    minimum=1e-9,
                    remedy="Sample faster, or record a step instead of a slow change.",
                ),
                ParameterSpec(
                    "dead_time",
                    "s",
                    "time before the outlet begins to move",
                    neutral=0.0,
                    minimum=0.0,
                    remedy="Record sharp steps of the inlet, sampled several times within "
                    "the time the wave needs to travel.",
                ),
            ),
        ),
    )
    options = (
        Option("length", "float", "length of the line, to compare the dead time with", unit="m",
               minimum=0.0),
        Option("sound-speed", "float", "sound speed in the line", unit="m/s", minimum=0.0),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit gain, time constant and dead time; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        step, span = time_scales(experiments)
        longest = 0.5 * span
        unknowns = make_unknowns(
            variant.parameters,
            ("gain", "time_constant", "dead_time"),
            {"time_constant": step, "dead_time": step},
            request,
            {"time_constant": (1e-3 * step, 100.0 * span), "dead_time": (0.0, longest)},
        )
        names = ("time_constant", "dead_time")
        axes = {"time_constant": np.geomspace(0.3 * step, 0.5 * span, 7)}
        fitted = fit_transfer(
            lambda some, rest: self._model(some, rest).named(names),
            experiments,
            "outlet",
            variant.parameters,
            request,
            unknowns,
            lambda some, rest: grid_search(
                bind(self._model(some, rest).named(names), unknowns, request.fixed),
                axes,
                lambda at: dead_time_axis(step, longest, at["time_constant"]),
                request.fixed,
            ),
            sensible={"dead_time": 0.25 * span},
        )
        parameters, order, covariance = quantities(fitted, variant.parameters)
        table, drift = fitted.compare_logs(experiments)
        notices = [*fitted.notices, *drift]
        derived = derive(
            fitted,
            {"bandwidth": "rad/s", "rise_time": "s"},
            lambda v: {
                "bandwidth": 1.0 / v["time_constant"],
                "rise_time": np.log(9.0) * v["time_constant"],
            },
        )
        notices += self._compare_with_wave(fitted.values["dead_time"], parameters, derived, request)
        return Estimate(
            parameters,
            derived,
            order,
            covariance,
            fitted.solution.simulated,
            [e["outlet"] for e in experiments],
            notices,
            {**fitted.details(), **table},
            fitted.sensitivity(),
        )

    @staticmethod
    def _model(experiments: Sequence[Experiment], rest: bool = False) -> TransferModel:
        return TransferModel(experiments, "inlet", "outlet", realise, gain="gain", rest=rest)

    @staticmethod
    def _compare_with_wave(
        dead_time: float,
        parameters: Mapping[str, Quantity],
        derived: dict[str, Quantity],
        request: Request,
    ) -> list[Notice]:
        """Compare the dead time with ``L/c`` and say when they disagree."""
        length, speed = request.options.get("length"), request.options.get("sound-speed")
        if not length:
            return []
        expected = length / (speed or 343.0)
        derived["wave_travel_time"] = Quantity(expected, "s", "derived")
        if dead_time > 0.0:
            derived["apparent_sound_speed"] = Quantity(length / dead_time, "m/s", "derived")
        se = parameters["dead_time"].std_error
        allowed = max(2.0 * float(se) if isinstance(se, float) else 0.0, 0.05 * expected)
        if abs(dead_time - expected) <= allowed:
            return []
        assumed = "" if speed else " (air at 20 °C assumed; give --sound-speed)"
        return [
            Notice(
                "dead-time-not-travel-time",
                f"the dead time {dead_time * 1e3:.3g} ms is not the travel time "
                f"L/c = {expected * 1e3:.3g} ms of {length:g} m at {speed or 343.0:g} m/s"
                f"{assumed}. A longer dead time holds delays of valve, sensor or bus, or the "
                "slow first part of filling; a shorter one says that the time stamps or the "
                "inlet signal are late.",
            )
        ]

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        values = scalars(parameters)
        names = [n for n in values if n != "gain"]
        model = self._model([experiment])
        return sensitivity(model.named(names), values, values["gain"] * model.levels[0])

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Outlet pressure from inlet pressure; see :meth:`Family.simulate`."""
        return simulate_transfer(self._model([experiment]), parameters)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Continuous and discrete transfer function."""
        v = scalars(parameters)
        num, den = [v["gain"]], [v["time_constant"], 1.0]
        section: dict[str, Any] = {
            "continuous": {"numerator": num, "denominator": den, "dead_time": v["dead_time"]}
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(num, den, sample_time, "zoh", v["dead_time"])
        return section
