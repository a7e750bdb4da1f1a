"""Potentiometer calibration: position as a rational Bezier curve of the raw reading.

The same curve calibrates any sensor: an angle, a pressure or a force in place of the position.

    t = (reading - low) / (high - low), clamped to 0..1
    y = sum_i w_i B_i(t) P_i / sum_i w_i B_i(t)

A worn, loaded or saturating potentiometer needs polynomials of high degree, which ripple;
a rational curve of low degree with positive weights bends sharply and cannot have poles
[1]_. Linear in the control points, so the fit is a variable projection over the weights.

References
----------
.. [1] "Bezier Calibration Method", IEEE Instrumentation & Measurement Magazine 26(1), 2023,
   p. 44: handle points and weights fitted to a reference, end points free or fixed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import UsageError
from ...estimation.named_model import check_request
from ...experiment import Experiment, Hold, where_both
from ...family import (
    Curve,
    Excitation,
    Family,
    NoiseModel,
    ParameterSpec,
    Plant,
    Quantity,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    StaticView,
    Status,
    Structure,
    Value,
    Variant,
    make_solution,
)
from .block import PotentiometerBlock
from .calibration import Calibration, over_common_readings
from .data import between, check_both_directions, prepare
from .fit import find_dead_band, fit_curve
from .options import PotentiometerOptions
from .rational_bezier import power_coefficients, rational_bezier
from .results import curve_quantities, derived_quantities, fit_details


class Potentiometer(Family[PotentiometerOptions]):
    """Rational Bezier calibration of a potentiometer."""

    name = "potentiometer"
    title = "Potentiometer or other sensor: rational Bezier calibration of the raw reading"
    equation = (
        "reference = sum(weights[i] B_i(t) control_points[i]) / sum(weights[i] B_i(t)), "
        "t = (reading - reading_range[0]) / (reading_range[1] - reading_range[0])"
    )
    variants = (
        Variant(
            "potentiometer",
            (
                Role("reading", "1", "raw reading, in counts or volts"),
                Role("reference", "m", "true position (or angle, pressure, force), measured apart",
                     output=True, alternatives=("rad", "Pa", "N", "N m", "1")),
                Role("time", "s", "time of each sample", required=False),
            ),
            (
                ParameterSpec(
                    "control_points", "m", "control points of the curve", rank=1,
                    ratio=("reference", "1"),
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "weights", "1", "weights of the control points, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0,
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "reading_range", "1", "lowest and highest reading of the calibration",
                    rank=1, length=2, ratio=("reading", "1"), increasing=True,
                ),
                ParameterSpec(
                    "control_points_falling", "m",
                    "control points of the falling branch (then the others are the rising one)",
                    rank=1, optional=True, ratio=("reference", "1"),
                ),
                ParameterSpec(
                    "weights_falling", "1", "weights of the falling branch, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0, optional=True,
                ),
                ParameterSpec(
                    "hysteresis_dead_band", "1",
                    "change of the reading after a reversal over which the branches change over",
                    minimum=0.0, optional=True, ratio=("reading", "1"), searched=False,
                ),
            ),
        ),
    )  # fmt: skip
    options_type = PotentiometerOptions
    block_type = PotentiometerBlock
    next_experiment = Excitation("points")
    structures = (
        *(Structure(f"degree {n}", {"degree": str(n), "branches": "pooled"}) for n in range(1, 6)),
        Structure("a curve for each direction", {"degree": "auto", "branches": "two"}),
    )

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[PotentiometerOptions],
    ) -> Solution[PotentiometerOptions]:
        """Fit the curve; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        if request.fixed and request.options.branches == "pooled":
            raise UsageError(
                f"--fix {', '.join(request.fixed)}: one curve for both directions has no dead band",
                remedy="Give --branches two as well, or leave it out.",
            )
        data, options, notices = prepare(experiments, request.options)
        request = replace(request, options=options)
        band = find_dead_band(data, request) if options.branches == "two" else None
        if band is not None:
            data = data.with_branches(band)
            check_both_directions(data)
        found = fit_curve(data, request)
        parameters, order, matrix = curve_quantities(found, data)
        low, span = data.readings
        parameters["reading_range"] = Quantity([low, low + span], data.unit, "derived")
        if band is not None:
            status: Status = "fixed" if "hysteresis_dead_band" in request.fixed else "derived"
            parameters["hysteresis_dead_band"] = Quantity(band, data.unit, status)
        calibration = Calibration.of({name: q.value for name, q in parameters.items()})
        monotone = calibration.monotone if options.monotone is None else options.monotone
        degree = str(found.fit.model.degree)
        return make_solution(
            self.simulate,
            experiments,
            variant,
            replace(options, degree=degree, monotone=monotone, dead_band=band),
            {s.name: parameters[s.name] for s in variant.parameters if s.name in parameters},
            order,
            NoiseModel(matrix, np.inf if found.noise else found.spread.independent, found.noise),
            derived=derived_quantities(found, data, calibration),
            notices=[*notices, *found.notices],
            details=fit_details(found, data),
        )

    def simulate(
        self,
        plant: Plant[PotentiometerOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Position from the readings; see :meth:`Family.simulate`."""
        calibration, rails = Calibration.of(plant.values), plant.options.rails
        readings = [e.sampled("reading") for e in experiments]
        return [
            Simulated(
                calibration.position(x), where_both(between(x, rails), calibration.is_described(x))
            )
            for x in readings
        ]

    def model(
        self, plant: Plant[PotentiometerOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The curve, also as a ratio of polynomials by ascending powers of ``t``."""
        c = Calibration.of(plant.values)
        curve: dict[str, Any] = {
            "type": "rational-bezier",
            "degree": int(c.curves[0][0].size - 1),
            "monotone": c.monotone,
            "reading_range": [c.low, c.high],
        }
        ratios = [
            {
                "ascending_numerator": power_coefficients(w * p).tolist(),
                "ascending_denominator": power_coefficients(w).tolist(),
            }
            for p, w in c.curves
        ]
        if len(ratios) == 1:
            return {"curve": curve | ratios[0]}
        rising, falling = ratios
        band = {"hysteresis_dead_band": c.dead_band}
        return {"curve": curve | band | {"rising": rising, "falling": falling}}

    def derived(
        self, values: Mapping[str, Any], options: PotentiometerOptions
    ) -> Mapping[str, Any]:
        """Stroke and width of the hysteresis; see :meth:`Family.derived`."""
        return Calibration.of(values).sizes

    def static_view(self, plant: Plant[PotentiometerOptions], runs: Runs) -> StaticView:
        """Position over reading: the curve or both branches, and the control points."""
        c, t = Calibration.of(plant.values), np.linspace(0.0, 1.0, 500)
        names = ("rising", "falling") if len(c.curves) > 1 else ("fitted curve",)
        curves = [
            Curve(name, c.low + (c.high - c.low) * t, rational_bezier(t, p, w))
            for name, (p, w) in zip(names, c.curves)
        ]
        points = c.curves[0][0]  # where their pull is strongest when all weights are equal
        drawn = Curve("control points", np.linspace(c.low, c.high, points.size), points)
        return StaticView.over(
            runs, "reading", "reference", curves, drawn if len(c.curves) == 1 else None
        )

    def in_common(
        self, values: Sequence[Mapping[str, Value]]
    ) -> tuple[Sequence[Mapping[str, Value]], str]:
        """Curves over the readings that all cover; see :meth:`Family.in_common`."""
        return over_common_readings(values)
