"""Stage one: valve and oil from the flow over windows, friction from both pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ...errors import LogError, Notice
from ...estimation.named_model import NamedModel, Values, make_unknowns
from ...estimation.parametric import Fitted, fit_named
from ...estimation.problem import Basis, Unknown
from ...estimation.regression import Balance, Estimator, Regression, RegressionModel
from ...estimation.results import Refusal, Solved, determine, find_uninformative
from ...estimation.stribeck import STRIBECK
from ...estimation.uncertainty import t_quantile
from ...experiment import FloatArray
from ...family import Quantity
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import LOSSES
from ...specification import STEP
from .setup import Setup

GAIN_UNIT = "m3/(s V Pa^0.5)"
_DIRECTIONS = ((1.0, "extending"), (-1.0, "retracting"))


def flow_unknowns(setup: Setup) -> dict[str, Unknown]:
    """Sizes and search ranges of the parameters of the flow."""
    head = setup.machine.supply - setup.machine.tank
    volts = max(float(np.abs(w.command).max()) for w in setup.windows)
    if volts == 0.0:
        raise LogError("the command is zero throughout", remedy="Record strokes of the valve.")
    sizes = {  # typical one, and the ends of the range
        "dead_zone_negative": (0.05 * volts, -0.95 * volts, 0.0),
        "dead_zone_positive": (0.05 * volts, 0.0, 0.95 * volts),
    }
    for chamber in setup.chambers:
        flows = [np.abs(w.motion) for w in setup.windows if w.chamber == chamber]
        flow = max(float(np.quantile(np.concatenate(flows), 0.98)) if flows else 0.0, 1e-12)
        gain = flow / (volts * np.sqrt(0.5 * head))
        sizes[f"valve_gain_{chamber}"] = (gain, 1e-4 * gain, 1e4 * gain)
        sizes |= dict.fromkeys(LOSSES[chamber], (0.3 * head / flow, 0.0, 2.0 * head / flow))
        if setup.machine.dead_volume(chamber) is not None:
            sizes["bulk_modulus"] = (1e9, 1e7, 1e11)
    scales = {n: scale for n, (scale, _, _) in sizes.items()}
    limits = {n: (low, high) for n, (_, low, high) in sizes.items()}
    return make_unknowns(setup.variant.parameters, (*sizes,), scales, setup.request, limits)


def allowed_half_widths(unknowns: dict[str, Unknown]) -> dict[str, float]:
    """Widths beyond which an interval says nothing."""
    reach = {n: max(abs(u.low), abs(u.high)) for n, u in unknowns.items()}
    shares = {"line_loss": 0.25, "dead_zone": 0.5}
    return {n: share * r for kind, share in shares.items() for n, r in reach.items()
            if n.startswith(kind)}  # fmt: skip


def not_shown(setup: Setup) -> list[Refusal]:
    """Parameters of a direction in which the valve is never opened, or only wide open."""
    levels = np.concatenate([w.mean_command for w in setup.windows])
    out: dict[str, str] = {}
    near = 0.25 * float(np.abs(levels).max())
    for way, (sign, word) in enumerate(((1.0, "positive"), (-1.0, "negative"))):
        side, edge = sign * levels[sign * levels > 0.0], f"dead_zone_{word}"
        if not side.size:
            reason = f"no usable part of the logs has a {word} command."
            out |= dict.fromkeys([edge, *(LOSSES[c][way] for c in setup.chambers)], reason)
            continue
        if side.min() > near:
            # a straight line through large commands would be drawn back over volts
            reason = f"the smallest {word} command in use is {side.min():.3g} V, far from the edge."
            out[edge] = reason
        for c in setup.chambers:
            own = [sign * w.mean_command for w in setup.windows if w.chamber == c]
            size = np.concatenate([u[u > 0.0] for u in own]) if own else side[:0]
            if size.size and np.quantile(size, 0.95) < 1.2 * np.quantile(size, 0.05):
                reason = f"all {word} commands are the same: gain and loss cannot be told apart."
                out[LOSSES[c][way]] = reason
    return [Refusal(n, reason) for n, reason in out.items() if n not in setup.request.fixed]


def fit_flow(setup: Setup, lenient: bool) -> Fitted:
    """Regression of the flow over windows; ``lenient`` accepts any interval, for a start."""
    windows, unknowns = setup.windows, flow_unknowns(setup)
    names = tuple(unknowns)

    def columns(index: int, values: Values) -> Basis:
        return Basis(windows[index].modelled(values))

    model = NamedModel(
        names, (), columns, [w.motion for w in windows],
        weights=[1.0 / setup.machine.area(w.chamber) for w in windows],
    )  # fmt: skip
    starts = []
    for loss, edge in ((0.0, 0.2), (1.0, 0.2), (0.0, 8.0)):
        shares = {"dead_zone_negative": -edge, "dead_zone_positive": edge}
        shares |= {n: loss for n in names if n.startswith("line_loss")}
        starts.append({n: u.scale * shares.get(n, 1.0) for n, u in unknowns.items()})
    max_half_widths = {**allowed_half_widths(unknowns), "bulk_modulus": 0.5e9}
    if lenient:
        max_half_widths = dict.fromkeys(names, np.inf)
    return fit_named(
        model, setup.variant.parameters, setup.request, unknowns, starts,
        refusals=not_shown(setup), max_half_widths=max_half_widths,
    )  # fmt: skip


def directional_gains(setup: Setup, values: Values) -> dict[str, Quantity]:
    """Gain of every chamber from the windows of one direction, all else as fitted.

    One Gauss-Newton step from the common gain, to which the flow is nearly proportional.
    """
    out = {}
    for chamber, (sign, word) in product(setup.chambers, _DIRECTIONS):
        name = f"valve_gain_{chamber}"
        moved = {**values, name: values[name] * (1.0 + 1j * STEP)}
        pairs = [
            (w.modelled(moved)[chosen], w.motion[chosen])
            for w in setup.windows
            if w.chamber == chamber and (chosen := sign * w.mean_command > 0.0).any()
        ]
        slopes = [np.imag(model) / STEP for model, _ in pairs]
        if sum(s.size for s in slopes) < 5 or not any(s.any() for s in slopes):
            continue
        rest = [y - np.real(model) for model, y in pairs]
        share, error, degrees = _proportional(slopes, rest)
        value, se = values[name] * (1.0 + share), values[name] * error
        half = t_quantile(0.975, degrees) * se
        ends = [value - half, value + half]
        out[f"{name}_{word}"] = Quantity(value, GAIN_UNIT, "derived", se, ends, "wald")
    return out


def _proportional(
    columns: Sequence[FloatArray], targets: Sequence[FloatArray], timed: bool = True
) -> tuple[float, float, int]:
    """Factor of one column over several logs, its standard error, degrees of freedom."""
    runs = [
        Balance({"factor": c}, t, np.ones(t.size, dtype=bool), timed=timed)
        for c, t in zip(columns, targets)
    ]
    found = Estimator(RegressionModel(lambda _: runs), ["factor"]).solve().free
    return found.values["factor"], found.std_error("factor"), found.degrees


def fit_friction(setup: Setup) -> tuple[Solved, list[Notice]]:
    """Viscous and Coulomb friction by linear regression; an offset where both directions moved."""
    rows, fixed = setup.friction, setup.request.fixed
    v, f = rows.speed[rows.moving], rows.force[rows.moving]
    f = f - FrictionLaw.of({n: fixed.get(n, 0.0) for n in STRIBECK}).moving(v)
    both = (v > 0.0).any() and (v < 0.0).any()
    size = max(float(np.abs(f).max()), 1e-300)
    scales = {"viscous": size / float(np.abs(v).max()), "coulomb": size}
    max_half_widths = {n: 0.5 * s for n, s in scales.items()}
    specs = {s.name: s for s in setup.variant.parameters if s.name in scales}
    limits = {n: setup.request.bounds.get(n, (s.minimum, s.maximum)) for n, s in specs.items()}
    columns = {"viscous": v, "coulomb": np.sign(v), "offset": np.ones(v.size)}
    balance = Balance(columns, f, np.ones(v.size, dtype=bool), timed=rows.in_time)
    model = RegressionModel(lambda _: [balance])

    def solve(held: Mapping[str, float]) -> Regression:
        given = {n: x for n, x in held.items() if n in specs}
        names = [n for n in (*specs, *(["offset"] if both else [])) if n not in given]
        return Estimator(model, names, given, limits).solve()

    end = determine(
        solve,
        lambda found: find_uninformative(found.free, specs, max_half_widths),
        specs,
        fixed=fixed,
    )
    found = end.solution
    solved = replace(found.free, values=found.values, fixed=fixed, refused=end.refused)
    return solved, end.notices


def friction_levels(setup: Setup) -> dict[str, Quantity]:
    """Mean friction in either direction, signed [N]."""
    out, rows = {}, setup.friction
    for sign, word in _DIRECTIONS:
        chosen = rows.force[rows.moving & (sign * rows.speed > 0.0)]
        if chosen.size >= 2:
            mean, se, _ = _proportional([np.ones(chosen.size)], [chosen], rows.in_time)
            out[f"friction_{word}"] = Quantity(mean, "N", "derived", se)
    return out
