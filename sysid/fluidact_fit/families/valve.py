"""Proportional valve: gain, natural frequency, damping ratio.

    Y(s)/U(s) = K wn^2 (T_z s + 1) exp(-T_d s) / (s^2 + 2 zeta wn s + wn^2)

Dead time and zero are optional. Under- and overdamped valves are one model: the poles
may meet and turn real without a seam.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equation 20: outlet pressure of a proportional valve behaves as a second-order system.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..discrete import discretise
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
from ..family import Estimate, Family, Option, ParameterSpec, Request, Role, Value, Variant


def realise(values: Values) -> tuple[Any, Any, Any]:
    """State space of the valve with unit gain, balanced by scaling time with ``wn``."""
    wn, zeta = values["natural_frequency"], values["damping_ratio"]
    a = wn * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    b = wn * np.array([0.0, 1.0])
    c = np.array([1.0, values.get("zero_time_constant", 0.0) * wn])
    return a, b, c


class Valve(Family):
    """Second-order valve with optional dead time and zero."""

    name = "valve"
    title = "Valve: gain, natural frequency and damping ratio"
    equation = (
        "outlet(s)/command(s) = gain * natural_frequency^2 * (zero_time_constant s + 1) "
        "* exp(-dead_time s) / (s^2 + 2 damping_ratio natural_frequency s + natural_frequency^2)"
    )
    variants = (
        Variant(
            "valve",
            (
                Role("time", "s", "time of each sample"),
                Role("command", "V", "what the controller sends", hold="zoh",
                     alternatives=("A", "1")),
                Role("outlet", "Pa", "pressure (or flow) at the outlet", output=True,
                     alternatives=("m3/s", "V", "1")),
            ),
            (
                ParameterSpec(
                    "gain", "Pa/V", "steady outlet per command", any_unit=True,
                    remedy="Record at least two levels of the command, each held until the "
                    "outlet settles.",
                ),
                ParameterSpec(
                    "natural_frequency", "rad/s", "undamped natural frequency", minimum=1e-9,
                    remedy="Record steps of the command, sampled at least ten times within the "
                    "rise of the outlet.",
                ),
                ParameterSpec(
                    "damping_ratio", "1", "damping ratio", minimum=1e-6,
                    remedy="Record steps of the command, sampled at least ten times within the "
                    "rise of the outlet.",
                ),
                ParameterSpec(
                    "dead_time", "s", "time before the outlet begins to move",
                    neutral=0.0, minimum=0.0,
                    remedy="Record sharp steps of the command at a higher sampling rate.",
                ),
                ParameterSpec(
                    "zero_time_constant", "s", "time constant of the zero", neutral=0.0,
                    optional=True,
                    remedy="Record sharp steps of the command at a higher sampling rate.",
                ),
            ),
        ),
    )  # fmt: skip
    options = (
        Option("dead-time", "choice", "whether to estimate a dead time", "none",
               ("none", "estimate")),
        Option("zero", "choice", "whether to estimate a zero", "none", ("none", "estimate")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit the valve; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        zero = request.options["zero"] == "estimate" or "zero_time_constant" in request.fixed
        if request.options["dead-time"] == "none":
            request = replace(request, fixed={"dead_time": 0.0, **request.fixed})
        names = ["natural_frequency", "damping_ratio", "dead_time"]
        names += ["zero_time_constant"] if zero else []
        step, span = time_scales(experiments)
        longest = 0.5 * span
        unknowns = make_unknowns(
            variant.parameters,
            ("gain", *names),
            {"natural_frequency": 1.0 / step, "dead_time": step, "zero_time_constant": step},
            request,
            {
                "natural_frequency": (1e-3 / span, 1e3 / step),
                "damping_ratio": (1e-6, 1e3),
                "dead_time": (0.0, longest),
                "zero_time_constant": (-span, span),
            },
        )
        axes = {
            "natural_frequency": np.geomspace(3.0 / span, 2.5 / step, 12),
            "damping_ratio": np.array([0.2, 0.7, 2.0]),
            "zero_time_constant": np.zeros(1),
        }
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
                lambda at: dead_time_axis(step, longest, 2.0 / at["natural_frequency"]),
                request.fixed,
            ),
            sensible={"dead_time": 0.25 * span, "zero_time_constant": span},
        )
        parameters, order, covariance = quantities(fitted, variant.parameters)
        first = experiments[0].signals
        unit = _ratio(first["outlet"].unit, first["command"].unit)
        parameters["gain"] = replace(parameters["gain"], unit=unit)
        table, drift = fitted.compare_logs(experiments)
        return Estimate(
            parameters,
            self._derived(fitted),
            order,
            covariance,
            fitted.solution.simulated,
            [e["outlet"] for e in experiments],
            [*fitted.notices, *drift],
            {**fitted.details(), **table},
            fitted.sensitivity(),
        )

    @staticmethod
    def _derived(fitted: Any) -> Mapping[str, Any]:
        """Undamped frequency in hertz, and overshoot where there is one."""
        units = {"frequency": "Hz"}
        zeta = fitted.values["damping_ratio"]

        def function(v: Values) -> dict[str, Any]:
            out = {"frequency": v["natural_frequency"] / (2.0 * np.pi)}
            if zeta < 1.0:
                z = v["damping_ratio"]
                out["overshoot"] = np.exp(-np.pi * z / np.sqrt(1.0 - z * z))
            return out

        if zeta < 1.0:
            units["overshoot"] = "1"
        return derive(fitted, units, function)

    @staticmethod
    def _model(experiments: Sequence[Experiment], rest: bool = False) -> TransferModel:
        return TransferModel(experiments, "command", "outlet", realise, gain="gain", rest=rest)

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
        """Outlet from command; see :meth:`Family.simulate`."""
        return simulate_transfer(self._model([experiment]), parameters)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Continuous and discrete transfer function."""
        v = scalars(parameters)
        wn, zeta = v["natural_frequency"], v["damping_ratio"]
        num = [v["gain"] * wn**2]
        if v.get("zero_time_constant"):
            num = [num[0] * v["zero_time_constant"], num[0]]
        den = [1.0, 2.0 * zeta * wn, wn**2]
        section: dict[str, Any] = {
            "continuous": {"numerator": num, "denominator": den, "dead_time": v["dead_time"]}
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(num, den, sample_time, "zoh", v["dead_time"])
        return section


def _ratio(top: str, bottom: str) -> str:
    """Unit of a quotient."""
    if top == bottom:
        return "1"
    return top if bottom == "1" else f"{top}/{bottom}"
