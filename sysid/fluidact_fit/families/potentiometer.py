"""Potentiometer calibration: position as a rational Bezier curve of the raw reading.

    t = (reading - low) / (high - low), clamped to 0..1
    y = sum_i w_i B_i(t) P_i / sum_i w_i B_i(t)

A worn, loaded or saturating potentiometer needs polynomials of high degree, which ripple;
a rational curve of low degree with positive weights bends sharply and cannot have poles
[1]_. Linear in the control points, so the fit is a variable projection over the weights.

References
----------
.. [1] "Bezier Calibration Method", IEEE Instrumentation & Measurement Magazine 26(1), 2023,
   p. 44: handle points and weights fitted to a reference, end points free or fixed.
.. [2] G. Farin, Curves and Surfaces for CAGD, 5th ed., 2002, chapter 13.
.. [3] T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2nd ed.,
   2009, section 7.10: cross-validation and the one-standard-error rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import UsageError
from ..estimation.parametric import check_request
from ..estimation.rational_bezier import Shape, is_monotone, power_coefficients, rational_bezier
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    StaticView,
    Value,
    Variant,
)
from .calibration.block import PotentiometerBlock, curves_of
from .calibration.branches import check_both_directions, find_dead_band, rising_samples
from .calibration.data import check_enough, gather, mean_ends, prepare, scale_samples
from .calibration.results import derived_quantities, fit_details, fit_quantities, simulate_all
from .calibration.selection import (
    bound_notice,
    drop_weights,
    make_monotone,
    search_degree,
    weigh_suspects,
)
from .calibration.spread import find_spread

__all__ = ["Potentiometer", "PotentiometerBlock"]


def _degree_wanted(options: Mapping[str, Any]) -> int:
    """Degree as a number; 0 for ``auto``."""
    text = str(options.get("degree") or "auto").strip().lower()
    if text == "auto":
        return 0
    if text.isdigit() and 1 <= int(text) <= 8:
        return int(text)
    raise UsageError(
        f"--degree {text}: no such degree",
        expected="auto, or a whole number from 1 to 8.",
        remedy="Give --degree auto to have it chosen by cross-validation.",
    )


def _rails_wanted(options: Mapping[str, Any]) -> tuple[float, float] | None:
    given = options.get("rails")
    if given is None:
        return None
    if isinstance(given, str):
        given = [float(side) if side.strip() else None for side in given.split(":")]
    low, high = given
    return (-np.inf if low is None else float(low), np.inf if high is None else float(high))


class Potentiometer(Family):
    """Rational Bezier calibration of a potentiometer."""

    name = "potentiometer"
    title = "Potentiometer: rational Bezier calibration of position from the raw reading"
    equation = (
        "reference = sum(weights[i] B_i(t) control_points[i]) / sum(weights[i] B_i(t)), "
        "t = (reading - reading_range[0]) / (reading_range[1] - reading_range[0])"
    )
    variants = (
        Variant(
            "potentiometer",
            (
                Role("reading", "1", "raw reading, in counts or volts"),
                Role("reference", "m", "true position, by laser or caliper", output=True),
                Role("time", "s", "time of each sample", required=False),
            ),
            (
                ParameterSpec(
                    "control_points", "m", "control points of the curve", rank=1,
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "weights", "1", "weights of the control points, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0,
                    remedy="Record more positions, spread over the whole range.",
                ),
                ParameterSpec(
                    "reading_range", "1", "lowest and highest reading of the calibration",
                    rank=1, length=2, any_unit=True,
                ),
                ParameterSpec(
                    "control_points_falling", "m",
                    "control points of the falling branch (then the others are the rising one)",
                    rank=1, optional=True,
                ),
                ParameterSpec(
                    "weights_falling", "1", "weights of the falling branch, the first is 1",
                    minimum=1e-9, rank=1, neutral=1.0, optional=True,
                ),
                ParameterSpec(
                    "hysteresis_dead_band", "1",
                    "change of the reading after a reversal over which the branches change over",
                    minimum=0.0, optional=True, any_unit=True,
                ),
            ),
        ),
    )  # fmt: skip
    options = (
        Option("degree", "text", "degree of the curve, 1 to 8, or auto for cross-validation",
               default="auto"),
        Option("endpoints", "choice", "free, or fixed at the mean reference of the end readings",
               default="free", choices=("free", "fixed")),
        Option("branches", "choice", "one curve for both directions of motion, or one for each",
               default="pooled", choices=("pooled", "two")),
        Option("monotone", "flag", "keep the curve from turning back (default: unless the data "
               "say that it does)"),
        Option("rails", "range", "readings at or beyond these are clipped and left out"),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit the curve; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        options = request.options
        data, notices = prepare(experiments, _rails_wanted(options))
        two = options.get("branches") == "two"
        band = find_dead_band(data, request) if two else 0.0
        scaled = scale_samples(data, rising_samples(data, band) if two else None)
        if two:
            check_both_directions(scaled.rows)
        ends = mean_ends(scaled.merged) if options.get("endpoints") == "fixed" else None
        shape = Shape(_degree_wanted(options), 2 if two else 1, 0, ends)
        check_enough(scaled.merged, shape if shape.degree else replace(shape, degree=1))
        scaled = weigh_suspects(scaled, data, shape, request)
        fit, scores = search_degree(scaled.merged, shape, request)
        fit, turned = make_monotone(scaled, fit, options.get("monotone"))
        spread = find_spread(fit, scaled, data)
        chosen, unsure = drop_weights(scaled, fit, spread)
        if chosen is not fit:
            fit, turned = make_monotone(scaled, chosen, options.get("monotone"))
            spread = find_spread(fit, scaled, data)
        notices += [*turned, *unsure, *bound_notice(fit)]
        parameters, order, matrix = fit_quantities(fit, spread, scaled)
        parameters["reading_range"] = Quantity(
            [scaled.low, scaled.low + scaled.span], data.unit, "derived"
        )
        if two:
            given = "hysteresis_dead_band" in request.fixed
            parameters["hysteresis_dead_band"] = Quantity(
                band, data.unit, "fixed" if given else "derived"
            )
        values = {k: q.value for k, q in parameters.items()}
        measured = np.where(data.used, data.reference, np.nan)
        return Estimate(
            {s.name: parameters[s.name] for s in variant.parameters if s.name in parameters},
            derived_quantities(fit, spread, scaled),
            order,
            matrix,
            data.split(simulate_all(data, values, two)),
            data.split(measured),
            notices,
            fit_details(fit, spread, scores, scaled),
        )

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from the readings; see :meth:`Family.simulate`."""
        return np.asarray(PotentiometerBlock(parameters)(experiment["reading"]))

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The curve, also as a ratio of polynomials by ascending powers of ``t``."""
        curves = curves_of(parameters)
        section: dict[str, Any] = {
            "type": "rational-bezier",
            "degree": int(curves[0][0].size - 1),
            "monotone": all(is_monotone(p, w) for p, w in curves),
        }
        for branch, (p, w) in zip(("rising", "falling") if len(curves) > 1 else ("",), curves):
            ratio = {
                "ascending_numerator": power_coefficients(w * p).tolist(),
                "ascending_denominator": power_coefficients(w).tolist(),
            }
            section.update({branch: ratio} if branch else ratio)
        return {"curve": section}

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Position over reading: the curve or both branches, and the control points."""
        data = gather(experiments)
        values = {n: q.value for n, q in estimate.parameters.items()}
        low, high = np.asarray(values["reading_range"], dtype=float)
        t = np.linspace(0.0, 1.0, 500)
        branches = curves_of(values)
        names = ("rising", "falling") if len(branches) > 1 else ("fitted curve",)
        points = branches[0][0]
        return StaticView(
            "reading", data.unit, "reference", "m",
            data.reading, data.reference, np.concatenate(list(estimate.simulated)),
            np.isfinite(np.concatenate(list(estimate.measured))),
            [
                Curve(name, low + (high - low) * t, rational_bezier(t, p, w))
                for name, (p, w) in zip(names, branches)
            ],
            # where their pull is strongest when all weights are equal
            Curve("control points", np.linspace(low, high, points.size), points)
            if len(branches) == 1
            else None,
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> PotentiometerBlock:
        """Return the calibration that a controller calls."""
        return PotentiometerBlock({k: v["value"] for k, v in document["parameters"].items()})
