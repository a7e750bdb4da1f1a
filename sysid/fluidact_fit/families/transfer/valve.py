"""Proportional valve: gain, natural frequency, damping ratio.

    Y(s)/U(s) = K wn^2 (T_z s + 1) exp(-T_d s) / (s^2 + 2 zeta wn s + wn^2)

Dead time and zero are optional. Under- and overdamped valves are one model: the poles may
meet and become real without a discontinuity.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equation 20: outlet pressure of a proportional valve behaves as a second-order system.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...estimation.named_model import Values
from ...estimation.response_model import Plan, ResponseOptions, Searched
from ...estimation.starts import time_scales
from ...experiment import Experiment
from ...family import ParameterSpec, Request, Role, Structure, Variant
from ...options import choice
from .base import ASKED, TransferFamily, any_dead_time, dead_time

_RISE = "Record steps of the command, sampled at least ten times within the rise of the outlet."
_SHARP = "Record sharp steps of the command at a higher sampling rate."
_LEAST_DAMPING = 0.02  # damping ratio that a valve has at least
_ZEROS = (0.1, 0.25, 0.5, 1.0, 2.0)  # that are tried, in parts of the mean response time


@dataclass(frozen=True)
class ValveOptions(ResponseOptions):
    """Options: what is estimated beside gain, frequency and damping."""

    dead_time: str = choice("none", ASKED, "whether to estimate a dead time", "dead_time")
    zero: str = choice("none", ASKED, "whether to estimate a zero", "zero_time_constant")


class Valve(TransferFamily[ValveOptions]):
    """Second-order valve with optional dead time and zero."""

    name = "valve"
    title = "Valve: gain, natural frequency and damping ratio"
    equation = (
        "outlet(s)/command(s) = gain * natural_frequency^2 (* (zero_time_constant s + 1)) "
        "* exp(-dead_time s) / (s^2 + 2 damping_ratio natural_frequency s + natural_frequency^2)"
    )
    variants = (
        Variant(
            "valve",
            (
                Role("time", "s", "time of each sample"),
                Role("command", "V", "command that the controller sends", hold="zoh",
                     alternatives=("A", "1")),
                Role("outlet", "Pa", "pressure (or flow) at the outlet", output=True,
                     alternatives=("m3/s", "V", "1")),
            ),
            (
                ParameterSpec(
                    "gain", "Pa/V", "steady outlet per command", ratio=("outlet", "command"),
                    remedy="Record at least two levels of the command, each held until the "
                    "outlet settles.",
                ),
                ParameterSpec(
                    "natural_frequency", "rad/s", "undamped natural frequency", minimum=1e-9,
                    remedy=_RISE,
                ),
                ParameterSpec(
                    "damping_ratio", "1", "damping ratio", minimum=1e-6,
                    remedy=f"{_RISE} Where the outlet rises like a first-order lag, the logs show "
                    "no second order: fit a family of first order.",
                ),
                dead_time("time before the outlet begins to move", _SHARP),
                ParameterSpec(
                    "zero_time_constant", "s", "time constant of the zero", neutral=0.0,
                    optional=True, remedy=_SHARP,
                ),
            ),
        ),
    )  # fmt: skip
    options_type = ValveOptions
    structures = (
        Structure("second order", {"dead-time": "none", "zero": "none"}),
        Structure(
            "second order, dead time", {"dead-time": "estimate", "zero": "none"}, instead=True
        ),
        Structure("second order, zero", {"dead-time": "none", "zero": "estimate"}),
        Structure("second order, dead time, zero", {"dead-time": "estimate", "zero": "estimate"}),
    )
    gain = "gain"
    steady_offset = True

    def coefficients(self, values: Values) -> tuple[list[Any], list[Any]]:
        """``wn^2 (zero s + 1) / (s^2 + 2 zeta wn s + wn^2)``."""
        wn, zeta = values["natural_frequency"], values["damping_ratio"]
        numerator, zero = [wn**2], values.get("zero_time_constant")
        return [zero * wn**2, *numerator] if zero else numerator, [1.0, 2.0 * zeta * wn, wn**2]

    def plan(self, experiments: Sequence[Experiment], request: Request[ValveOptions]) -> Plan:
        """Search over frequencies and dampings."""
        step, span = time_scales(experiments)
        frequencies = np.geomspace(3.0 / span, 2.5 / step, 12)
        searched = [
            Searched("natural_frequency", 1.0 / step, (1e-3 / span, 1e3 / step), frequencies),
            Searched("damping_ratio", 1.0, (1e-6, 1e3), np.array([0.2, 0.7, 2.0])),
            any_dead_time(step, span),
            # near zero it and the dead time change the output alike: it is the one to be given up
            Searched("zero_time_constant", step, (-span, span), max_half_width=0.2 * span),
        ]
        return Plan(searched, lag=lambda at: 2.0 / at["natural_frequency"])

    def follow(self, values: Values, change: Mapping[str, float]) -> dict[str, float]:
        """Along the coefficients of the denominator where the zero moves too.

        A zero near a pole changes the output as little as a pole that moves with it. On the line of
        :func:`_other_zeros` the coefficients are straight; frequency and damping are curved.
        """
        out = super().follow(values, change)
        if {"natural_frequency", "damping_ratio", "zero_time_constant"} <= change.keys():
            share = change["natural_frequency"] / values["natural_frequency"]
            a, b = _coefficients(values)
            a += a * (change["damping_ratio"] / values["damping_ratio"] - share)
            b -= 2.0 * b * share
            if a > 0.0 and b > 0.0:
                out |= _poles(a, b)
        return out

    def alternative_starts(self, values: Values, step: float) -> list[dict[str, float]]:
        """Aliases of an oscillation, everything faster for a fast valve, other zeros.

        Poles ``-a +- jb`` and ``-a +- j(2 pi k / step +- b)`` decay and swing alike at the
        samples; only the size of the first ones tells them apart. Those of what is sampled well
        would hardly be damped at all, as no valve is. A zero may lie on either side of a pole that
        it nearly cancels; see ``docs/theory/responses.md``.
        """
        wn, zeta = values["natural_frequency"], values["damping_ratio"]
        poles = []
        if zeta < 1.0:
            decay, swing = zeta * wn, wn * np.sqrt(1.0 - zeta**2)
            turns = 2.0 * np.pi * np.arange(1, 4) / step
            poles += [(np.hypot(decay, b), decay) for b in np.r_[turns - swing, turns + swing]]
        if wn * step > 0.8:
            fast = np.geomspace(0.8, 20.0, 16) / step
            poles += [(w, z * w) for w in fast for z in (0.03, 0.1, 0.2, 0.3, 0.5, 0.8, 1.6)]
        near = [
            {"natural_frequency": float(w), "damping_ratio": float(a / w)}
            for w, a in poles
            if a > _LEAST_DAMPING * w > 0.0
        ]
        return near + _other_zeros(values)

    derived_units: ClassVar[Mapping[str, str]] = {"frequency": "Hz", "overshoot": "1"}

    def derived(self, values: Values, options: ValveOptions) -> dict[str, Any]:
        """Undamped frequency in hertz, and overshoot of a step where the valve swings.

        ``1 + T_z s`` at a pole has the size and the phase by which a zero changes the swing.
        """
        wn, z = values["natural_frequency"], values["damping_ratio"]
        out = {"frequency": wn / (2.0 * np.pi)}
        if np.real(z) < 1.0:
            root, zero = np.sqrt(1.0 - z * z), wn * values.get("zero_time_constant", 0.0)
            size = np.sqrt(1.0 - 2.0 * z * zero + zero**2)
            phase = 2.0 * np.arctan(zero * root / (1.0 - z * zero + size))
            out["overshoot"] = size * np.exp((phase - np.pi) * z / root)
        return out


def _other_zeros(values: Values) -> list[dict[str, float]]:
    """Zeros with the poles that leave the mean and the spread of the response as they are.

    With ``m = a - T_z`` any ``T_z`` does if ``a`` grows as much and ``b`` ``m`` times as much.
    """
    if "zero_time_constant" not in values:
        return []
    a0, b0 = _coefficients(values)
    mean, out = a0 - values["zero_time_constant"], []
    for other in mean * np.array(_ZEROS):
        a, b = mean + other, b0 + mean * (mean + other - a0)
        if a > 0.0 and b > 0.0:
            out.append({**_poles(a, b), "zero_time_constant": float(other)})
    return out


def _coefficients(values: Values) -> tuple[float, float]:
    """``a`` [s] and ``b`` [s^2] of the denominator ``1 + a s + b s^2``."""
    wn = values["natural_frequency"]
    return 2.0 * values["damping_ratio"] / wn, wn**-2.0


def _poles(a: float, b: float) -> dict[str, float]:
    """Frequency and damping of the denominator ``1 + a s + b s^2``."""
    return {"natural_frequency": b**-0.5, "damping_ratio": 0.5 * a * b**-0.5}
