"""Stage one: valve gains, losses, dead zone and bulk modulus from the flow over windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import LogError
from ...estimation.parametric import Fitted, NamedModel, fit_named, make_unknowns
from ...estimation.results import Refusal
from ...estimation.separable import Basis, Unknown
from ...estimation.uncertainty import covariance, t_quantile
from ...family import Quantity
from .case import Case
from .equations import LOSSES
from .windows import Windows

GAIN_UNIT = "m3/(s V Pa^0.5)"


def _unknowns(case: Case) -> dict[str, Unknown]:
    """Sizes and search ranges of the parameters of the flow."""
    windows = case.windows
    head = case.machine.supply - case.machine.tank
    volts = max(float(np.abs(w.command).max()) for w in windows)
    if volts == 0.0:
        raise LogError("the command is zero throughout", remedy="Record strokes of the valve.")
    names = ["dead_zone_negative", "dead_zone_positive"]
    scales = {**dict.fromkeys(names, 0.05 * volts), "bulk_modulus": 1e9}
    limits = {
        "dead_zone_negative": (-0.5 * volts, 0.0),
        "dead_zone_positive": (0.0, 0.5 * volts),
        "bulk_modulus": (1e7, 1e11),
    }
    for chamber in case.chambers:
        flows = [np.abs(w.motion) for w in windows if w.chamber == chamber]
        flow = max(float(np.quantile(np.concatenate(flows), 0.98)) if flows else 0.0, 1e-12)
        gain = flow / (volts * np.sqrt(0.5 * head))
        scales[f"valve_gain_{chamber}"] = gain
        limits[f"valve_gain_{chamber}"] = (1e-4 * gain, 1e4 * gain)
        names += [f"valve_gain_{chamber}", *LOSSES[chamber]]
        scales |= dict.fromkeys(LOSSES[chamber], 0.3 * head / flow)
        limits |= dict.fromkeys(LOSSES[chamber], (0.0, 2.0 * head / flow))
        if case.machine.dead_volume(chamber) is not None and "bulk_modulus" not in names:
            names.append("bulk_modulus")
    return make_unknowns(case.variant.parameters, names, scales, case.request, limits)


def sensible_widths(unknowns: Mapping[str, Unknown]) -> dict[str, float]:
    """Widths beyond which an interval says nothing."""
    reach = {n: max(abs(u.low), abs(u.high)) for n, u in unknowns.items()}
    shares = {"line_loss": 0.25, "dead_zone": 0.5}
    return {n: share * r for kind, share in shares.items() for n, r in reach.items()
            if n.startswith(kind)}  # fmt: skip


def one_sided(case: Case) -> list[Refusal]:
    """Parameters of a direction in which the valve is never opened, or only wide open."""
    out, windows = [], case.windows
    levels = np.concatenate([w.mean(w.command) for w in windows])
    near = 0.25 * float(np.abs(levels).max())
    for sign, word in ((1.0, "positive"), (-1.0, "negative")):
        side = sign * levels[sign * levels > 0.0]
        edge = f"dead_zone_{word}"
        if not side.size:
            losses = [LOSSES[c][0 if sign > 0 else 1] for c in case.chambers]
            reason = f"no usable part of the logs has a {word} command."
            out += [Refusal(n, reason) for n in (edge, *losses)]
        elif side.min() > near:
            # a straight line through large commands would be drawn back over volts
            reason = f"the smallest {word} command in use is {side.min():.3g} V, far from the edge."
            out.append(Refusal(edge, reason))
        for chamber in case.chambers if side.size else ():
            if _one_speed(windows, chamber, sign):
                reason = f"all {word} commands are the same: gain and loss cannot be told apart."
                out.append(Refusal(LOSSES[chamber][0 if sign > 0.0 else 1], reason))
    return [r for r in out if r.parameter not in case.request.fixed]


def _one_speed(windows: Sequence[Windows], chamber: int, sign: float) -> bool:
    """Whether one chamber saw only one size of command of a sign."""
    levels = [sign * w.mean(w.command) for w in windows if w.chamber == chamber]
    size = np.concatenate(levels) if levels else np.zeros(0)
    size = size[size > 0.0]
    return bool(size.size and np.quantile(size, 0.95) < 1.2 * np.quantile(size, 0.05))


def fit_flow(case: Case, lenient: bool) -> Fitted:
    """Regression of the flow over windows; ``lenient`` refuses nothing, for a start."""
    windows, unknowns = case.windows, _unknowns(case)
    names = tuple(unknowns)

    def columns(index: int, values: Mapping[str, Any]) -> Basis:
        flow = windows[index].modelled(values, case.machine)
        empty = np.zeros((flow.size, 0))
        return Basis(flow, empty, empty)

    model = NamedModel(
        names, (), columns, [w.motion for w in windows],
        weights=[1.0 / case.machine.area(w.chamber) for w in windows],
    )  # fmt: skip
    edges = {"dead_zone_negative": -0.2, "dead_zone_positive": 0.2}
    starts = []
    for loss in (0.0, 1.0):
        shares = {**edges, **{n: loss for n in names if n.startswith("line_loss")}}
        start = {n: u.scale * shares.get(n, 1.0) for n, u in unknowns.items()}
        starts.append({**start, **case.request.start})
    sensible = dict.fromkeys(names, np.inf) if lenient else sensible_widths(unknowns)
    if not lenient and "bulk_modulus" in names:
        sensible["bulk_modulus"] = 0.5 * unknowns["bulk_modulus"].scale
    return fit_named(
        model, case.variant.parameters, case.request, unknowns, starts,
        refusals=one_sided(case), sensible=sensible,
    )  # fmt: skip


def gain_of_direction(
    case: Case, values: Mapping[str, float], chamber: int, sign: float
) -> Quantity | None:
    """Gain of one chamber from the windows of one direction, all else as fitted.

    The flow is nearly proportional to the gain; one Gauss-Newton step from the common gain.
    """
    name = f"valve_gain_{chamber}"
    moved = {**values, name: values[name] * (1.0 + 1e-30j)}
    residuals, slopes = [], []
    for w in case.windows:
        chosen = sign * w.mean(w.command) > 0.0
        if w.chamber == chamber and chosen.any():
            model = w.modelled(moved, case.machine)
            residuals.append((w.motion - np.real(model))[chosen])
            slopes.append((np.imag(model) / 1e-30)[chosen])
    j, r = (np.concatenate(x) if x else np.zeros(0) for x in (slopes, residuals))
    if j.size < 5 or not float(j @ j) > 0.0:
        return None
    share = float(j @ r / (j @ j))
    parts = [r - s * share for r, s in zip(residuals, slopes)]
    found = covariance([s[:, None] for s in slopes], parts)
    se = float(np.sqrt(found.covariance[0, 0])) * values[name]
    value = values[name] * (1.0 + share)
    q = t_quantile(0.975, found.degrees)
    return Quantity(value, GAIN_UNIT, "derived", se, [value - q * se, value + q * se], "wald")
