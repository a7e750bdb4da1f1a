"""Servo-hydraulic cylinder: valve gains, line losses, bulk modulus, dead zone, friction.

    M y'' = p1 A1 - p2 A2 - B y' - F_c sgn(y')                             (1)
    p1' =  beta / (V1 + A1 y) (Q1 - A1 y')                                 (2)
    p2' = -beta / (V2 - A2 y) (Q2 - A2 y')                                 (3)
    Q1 = K1 u sqrt(p_s - p1 - l1), u >= 0;  K1 u sqrt(p1 - p_0 - l3), u < 0
    Q2 = K2 u sqrt(p2 - p_0 - l4), u >= 0;  K2 u sqrt(p_s - p2 - l2), u < 0    (4)
    l = r |Q|

with ``u`` the command beyond the dead zone of the valve. The equations are those of [1]_ with
its typing errors corrected:

- Equation 5 writes ``f = beta / (v + A y)`` with a dot, and (6) repeats it; ``f`` is a
  shorthand and no derivative (the units of (2) and (6) agree only without the dot).
- Equation 8 has ``M y'`` where Newton's law and equation 1 have ``M y''``.
- Table 1 gives ``l = r Q`` with the sign of the flow. For ``u < 0`` both flows are negative and
  the loss would drive them; a loss brakes, so ``l = r |Q|``. The flow is then implicit and is
  solved in closed form: ``Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 dp)) / 2``, ``k = K |u|``.
- Table 1 gives ``K_v`` in m3/(s sqrt(Pa)); the catalogue's rated flow (24 l/min at 70 bar and
  10 V) gives the same number per volt, and only so do the units of (4) agree.
- Equation 9 trains a network on the flow per volt, which is 0/0 at zero command;
  ``--flow mlp`` trains on the flow.

What is estimated follows from what is given. Areas and supply pressure give gains, losses
and dead zone from the plateaus; the dead volumes add the bulk modulus; the mass adds the gray
box, in which all four states are simulated and compared with both pressures and the position.

References
----------
.. [1] "A hydraulic actuator model using feedforward neural networks", 25th ABCM
   International Congress of Mechanical Engineering (COBEM), 2019, equations 1 to 9, table 1.
.. [2] J. Watton, Fundamentals of Fluid Power Control, 2012.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, UsageError
from ..estimation.hydraulics import (
    GRAY_NAMES,
    LOSSES,
    GrayBox,
    GraySolution,
    Machine,
    Network,
    Windows,
    flow_columns,
    make_gray_log,
    make_windows,
    solve_gray_box,
    train_network,
    window_length,
)
from ..estimation.parametric import (
    Fitted,
    NamedModel,
    Refusal,
    check_request,
    derive,
    fit_named,
    make_unknowns,
    quantities,
    refuse,
    scalars,
)
from ..estimation.separable import Basis, Search, Solution, Unknown
from ..estimation.uncertainty import Uncertainty, covariance, score_covariance, t_quantile
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Block,
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
from ..signals import smooth

_GAIN_UNIT = "m3/(s V Pa^0.5)"
_SLOWEST = 2.5e-3  # s: at slower sampling the pressure resonance cannot be followed
_HIDDEN = 10  # units of the networks
_WINDOWS = 1500  # rows a network is trained on, before those near zero are repeated
_LAYERS = ("weights_1", "biases_1", "weights_2", "biases_2", "input_offset", "input_scale",
           "output_offset", "output_scale")  # fmt: skip
_NETWORKS = ("flow_1", "flow_2", "friction")
_LOSS_REMEDY = "Record strokes at large commands (a few volts) in both directions."
_EDGE_REMEDY = (
    "Record slow passes of the command through zero, or several small commands in both directions."
)
_FRICTION_REMEDY = (
    "Record both pressures over strokes in both directions at two speeds or more, and give both "
    "areas."
)


def _specs() -> tuple[ParameterSpec, ...]:
    """The parameter table."""
    gains = [
        ParameterSpec(
            f"valve_gain_{i}", _GAIN_UNIT, f"gain of the orifices of chamber {i}, per volt",
            minimum=0.0, optional=True,
            remedy="Record strokes at two commands or more, each held until the speed settles.",
        )
        for i in (1, 2)
    ]  # fmt: skip
    where = ("supply to chamber 1", "supply to chamber 2", "chamber 1 to tank",
             "chamber 2 to tank")  # fmt: skip
    losses = [
        ParameterSpec(
            f"line_loss_{i}", "Pa s/m3", f"pressure loss per flow, {text}",
            neutral=0.0, minimum=0.0, optional=True, remedy=_LOSS_REMEDY,
        )
        for i, text in enumerate(where, start=1)
    ]  # fmt: skip
    networks = [
        ParameterSpec(
            f"{net}_{layer}", "1", f"{layer.replace('_', ' ')} of the network of {net}",
            optional=True, rank=2 if layer.startswith("weights") else 1, any_unit=True,
        )
        for net in _NETWORKS
        for layer in _LAYERS
    ]  # fmt: skip
    return (
        *gains,
        *losses,
        ParameterSpec(
            "bulk_modulus", "Pa", "effective bulk modulus of oil and hoses", minimum=1e5,
            optional=True,
            remedy="Record steps of the command at 1 kHz or more, or fix it: --fix "
            "bulk_modulus=1e9 (typical: 0.5e9 to 1.5e9 Pa). Without --dead-volume-1 and "
            "--dead-volume-2 the plateaus alone are used, which do not need it.",
        ),
        ParameterSpec(
            "dead_zone_negative", "V", "command below which the valve opens", neutral=0.0,
            maximum=0.0, remedy=_EDGE_REMEDY,
        ),
        ParameterSpec(
            "dead_zone_positive", "V", "command above which the valve opens", neutral=0.0,
            minimum=0.0, remedy=_EDGE_REMEDY,
        ),
        ParameterSpec(
            "viscous", "N s/m", "viscous friction of the piston", neutral=0.0, minimum=0.0,
            remedy=_FRICTION_REMEDY,
        ),
        ParameterSpec(
            "coulomb", "N", "dry friction of the piston", neutral=0.0, minimum=0.0,
            remedy=_FRICTION_REMEDY,
        ),
        *networks,
    )  # fmt: skip


_ROLES = (
    Role("time", "s", "time of each sample"),
    Role("command", "V", "control signal of the servo valve", hold="zoh"),
    Role("pressure_1", "Pa", "pressure in the chamber that extends the piston", required=False),
    Role("pressure_2", "Pa", "pressure in the chamber on the rod side", required=False),
    Role("position", "m", "position of the piston, growing as it extends", output=True),
)


@dataclass
class _Stage:
    """Everything on the way from experiments to an estimate."""

    specs: tuple[ParameterSpec, ...]
    experiments: Sequence[Experiment]
    request: Request
    machine: Machine
    chambers: tuple[int, ...]
    notices: list[Notice] = field(default_factory=list)

    @property
    def gray(self) -> bool:
        """Whether the gray box can be fitted: everything given, both chambers seen."""
        return self.machine.complete and self.chambers == (1, 2)

    def uniform(self) -> bool:
        """Whether all logs are fast enough for the pressure dynamics."""
        return max(e.sample_time for e in self.experiments) <= _SLOWEST


class HydraulicCylinder(Family):
    """Servo valve, two chambers and a piston, as physics or with small networks."""

    name = "hydraulic-cylinder"
    title = "Hydraulic cylinder: valve gains, line losses, bulk modulus and friction"
    equation = (
        "mass y'' = p1 area_1 - p2 area_2 - viscous y' - coulomb sgn(y'); "
        "p' = +-bulk_modulus / volume (Q - area y'); Q = valve_gain u sqrt(drop - line_loss |Q|)"
    )
    variants = (Variant("hydraulic-cylinder", _ROLES, _specs()),)
    options = (
        Option("area-1", "float", "piston area of chamber 1", unit="m2", minimum=0.0),
        Option("area-2", "float", "piston area of chamber 2, rod taken off", unit="m2",
               minimum=0.0),
        Option("dead-volume-1", "float", "volume of chamber 1 and its line at position 0",
               unit="m3", minimum=0.0),
        Option("dead-volume-2", "float", "volume of chamber 2 and its line at position 0",
               unit="m3", minimum=0.0),
        Option("mass", "float", "moving mass", unit="kg", minimum=0.0),
        Option("supply-pressure", "float", "supply pressure, on the scale of the sensors",
               unit="Pa", minimum=0.0),
        Option("tank-pressure", "float", "tank pressure, on the scale of the sensors",
               default=0.0, unit="Pa"),
        Option("flow", "choice", "orifice equations alone, or networks of the flow beside them",
               "orifice", ("orifice", "mlp")),
        Option("friction", "choice",
               "Coulomb and viscous friction alone, or a network of the speed beside them",
               "coulomb", ("coulomb", "mlp")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit the cylinder; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        chambers = _chambers(experiments)
        machine = _machine(request.options, chambers)
        stage = _Stage(variant.parameters, experiments, request, machine, chambers)
        windows = _all_windows(stage)
        gray = stage.gray and (stage.uniform() or "bulk_modulus" in request.fixed)
        if stage.gray and not gray:
            spec = _spec(stage.specs, "bulk_modulus")
            slow = max(e.sample_time for e in experiments)
            refuse(spec, f"the logs are sampled every {slow * 1e3:.3g} ms, too slowly to follow "
                   "the pressures.")  # fmt: skip
        first = _fit_flow(stage, windows, lenient=gray)
        friction = _friction_rows(stage)
        fitted: Fitted
        if gray:
            fitted, solution = _fit_gray(stage, first, friction)
            parameters, order, matrix = quantities(fitted, stage.specs)
            simulated = [s[:, 2] for s in solution.states]
            notices = list(fitted.notices)
            details = _gray_details(fitted, solution, first)
        else:
            fitted = first
            parameters, order, matrix, notices = _first_results(stage, first, friction)
            simulated = _plateau_positions(stage, windows, fitted.values)
            details = {
                "method": "flow balance over windows",
                "windows": int(sum(w.first.size for w in windows)),
                "covariance": first.details()["covariance"],
            }
        measured = [
            np.where(np.isfinite(s), e["position"], np.nan) for s, e in zip(simulated, experiments)
        ]
        derived = _derived(stage, windows, fitted, friction, gray)
        nets, more = _networks(stage, windows, fitted, friction)
        parameters.update(nets)
        details.update(more)
        return Estimate(
            parameters, derived, order, matrix, simulated, measured,
            [*stage.notices, *notices], details,
        )  # fmt: skip

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from the command, or from command and pressure on the plateaus.

        The gray box needs nothing but the command; its initial state is fitted to the
        experiment. Without volumes or mass the flow over the plateaus is integrated, which
        needs the measured pressure; other samples are NaN.
        """
        values = scalars(parameters)
        chambers = tuple(i for i in (1, 2) if f"pressure_{i}" in experiment)
        machine = _machine(options, chambers or (1, 2))
        if machine.complete and all(n in values for n in GRAY_NAMES):
            return _simulate_gray(experiment, machine, values)
        known = tuple(i for i in chambers if f"valve_gain_{i}" in values)
        if not known:
            return np.full(experiment.samples, np.nan)
        request = Request(options=options)
        stage = _Stage(variant.parameters, [experiment], request, machine, known)
        return _plateau_positions(stage, _all_windows(stage), values)[0]

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The equations' numbers; areas and supply pressure stand among the options."""
        v = scalars(parameters)
        return {
            "hydraulic": {
                "flow": "Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 drop)) / 2, k = K |u|, u beyond "
                "the dead zone; r: u >= 0 line_loss_1 (chamber 1), line_loss_4 (chamber 2), "
                "u < 0 line_loss_3, line_loss_2",
                "pressure": "p1' = bulk_modulus / (V1 + A1 y) (Q1 - A1 y'), "
                "p2' = -bulk_modulus / (V2 - A2 y) (Q2 - A2 y')",
                "friction": "viscous y' + coulomb sgn(y')",
                **{n: v[n] for n in GRAY_NAMES if n in v},
            }
        }

    def block(self, variant: Variant, document: Mapping[str, Any]) -> HydraulicBlock:
        """Flow, velocity and command for a controller."""
        values = {n: p["value"] for n, p in document["parameters"].items()}
        return HydraulicBlock(values, document.get("options", {}))


# ------------------------------------------------------------------------- what was asked for


def _spec(specs: Sequence[ParameterSpec], name: str) -> ParameterSpec:
    return next(s for s in specs if s.name == name)


def _chambers(experiments: Sequence[Experiment]) -> tuple[int, ...]:
    """Chambers whose pressure was recorded anywhere.

    Raises
    ------
    LogError
        When a log has neither pressure.
    """
    for e in experiments:
        if "pressure_1" not in e and "pressure_2" not in e:
            raise LogError(
                "neither chamber's pressure was recorded",
                where=e.name,
                expected="Expected pressure_1, pressure_2 or both.",
                remedy="Give --column pressure_1=... or --column pressure_2=...",
            )
    return tuple(i for i in (1, 2) if any(f"pressure_{i}" in e for e in experiments))


def _machine(options: Mapping[str, Any], chambers: Sequence[int]) -> Machine:
    """Read what is given.

    Raises
    ------
    UsageError
        When something that the recorded chambers need is missing, or cannot be.
    """
    names = ("area-1", "area-2", "dead-volume-1", "dead-volume-2", "mass", "supply-pressure")
    given: dict[str, float | None] = {}
    for name in names:
        value = options.get(name)
        if value is not None and not value > 0.0:
            raise UsageError(
                f"--{name} {value:g}: it has to be positive", remedy=f"Give --{name} in SI units."
            )
        given[name] = None if value is None else float(value)
    needed = [*(f"area-{i}" for i in chambers), "supply-pressure"]
    missing = [f"--{n}" for n in needed if given[n] is None]
    if missing:
        raise UsageError(
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} needed",
            expected="Areas and supply pressure are properties of the machine that the logs "
            "cannot tell; nothing is assumed for them.",
            remedy="Give " + ", ".join(f"{m} NUMBER" for m in missing) + " in SI units (m2, Pa).",
        )
    tank = float(options.get("tank-pressure") or 0.0)
    supply = given["supply-pressure"] or 0.0
    if tank >= supply:
        raise UsageError(
            f"the tank pressure {tank:g} Pa is not below the supply pressure {supply:g} Pa",
            remedy="Correct --tank-pressure or --supply-pressure (Pa).",
        )
    return Machine(
        given["area-1"], given["area-2"], given["dead-volume-1"], given["dead-volume-2"],
        given["mass"], supply, tank,
    )  # fmt: skip


def _all_windows(stage: _Stage, overlap: int = 1) -> list[Windows]:
    """Windows of every recorded chamber of every log.

    Raises
    ------
    LogError
        When none is left.
    """
    length = window_length(stage.experiments)
    found = []
    for k, e in enumerate(stage.experiments):
        for chamber in stage.chambers:
            if f"pressure_{chamber}" in e:
                made = make_windows(e, k, chamber, stage.machine, length, overlap)
                if made is not None and made.first.size:
                    found.append(made)
    if not found:
        raise LogError(
            "no part of the logs says anything of the valve: there is no pressure drop left "
            "across it, or the pressure never settles",
            where=", ".join(e.name for e in stage.experiments),
            expected=f"Supply {stage.machine.supply:g} Pa, tank {stage.machine.tank:g} Pa.",
            remedy="Check --supply-pressure, --tank-pressure and the unit of the pressures; give "
            "the dead volumes to use transients as well.",
        )
    return found


# -------------------------------------------------------------------------------- stage one


def _unknowns(stage: _Stage, windows: Sequence[Windows]) -> dict[str, Unknown]:
    """Sizes and search ranges of the parameters of the flow."""
    head = stage.machine.supply - stage.machine.tank
    volts = max(float(np.abs(w.command).max()) for w in windows)
    if volts == 0.0:
        raise LogError("the command is zero throughout", remedy="Record strokes of the valve.")
    scales: dict[str, float] = {"bulk_modulus": 1e9}
    limits: dict[str, tuple[float, float]] = {
        "dead_zone_negative": (-0.5 * volts, 0.0),
        "dead_zone_positive": (0.0, 0.5 * volts),
        "bulk_modulus": (1e7, 1e11),
    }
    scales["dead_zone_negative"] = scales["dead_zone_positive"] = 0.05 * volts
    names = ["dead_zone_negative", "dead_zone_positive"]
    for chamber in stage.chambers:
        flow = max(_largest(windows, chamber), 1e-12)
        gain = flow / (volts * np.sqrt(0.5 * head))
        scales[f"valve_gain_{chamber}"] = gain
        limits[f"valve_gain_{chamber}"] = (1e-4 * gain, 1e4 * gain)
        names += [f"valve_gain_{chamber}", *LOSSES[chamber]]
        scales |= dict.fromkeys(LOSSES[chamber], 0.3 * head / flow)
        limits |= dict.fromkeys(LOSSES[chamber], (0.0, 2.0 * head / flow))
        if stage.machine.dead_volume(chamber) is not None and "bulk_modulus" not in names:
            names.append("bulk_modulus")
    return make_unknowns(stage.specs, names, scales, stage.request, limits)


def _largest(windows: Sequence[Windows], chamber: int) -> float:
    flows = [np.abs(w.motion) for w in windows if w.chamber == chamber]
    return float(np.quantile(np.concatenate(flows), 0.98)) if flows else 0.0


def _sensible(unknowns: Mapping[str, Unknown]) -> dict[str, float]:
    """Widths beyond which an interval says nothing."""
    out = {}
    for name, u in unknowns.items():
        if name.startswith("line_loss"):
            out[name] = 0.25 * u.high
        elif name.startswith("dead_zone"):
            out[name] = 0.5 * max(abs(u.low), abs(u.high))
    return out


def _one_sided(stage: _Stage, windows: Sequence[Windows]) -> list[Refusal]:
    """Parameters of a direction in which the valve is never opened, or only wide open."""
    out = []
    levels = np.concatenate([w.mean(w.command) for w in windows])
    near = 0.25 * float(np.abs(levels).max())
    for sign, word in ((1.0, "positive"), (-1.0, "negative")):
        side = sign * levels[sign * levels > 0.0]
        edge = f"dead_zone_{word}"
        if not side.size:
            losses = [LOSSES[c][0 if sign > 0 else 1] for c in stage.chambers]
            reason = f"no usable part of the logs has a {word} command."
            out += [Refusal(n, reason) for n in (edge, *losses)]
        elif side.min() > near:
            # a straight line through large commands would be drawn back over volts
            reason = f"the smallest {word} command in use is {side.min():.3g} V, far from the edge."
            out.append(Refusal(edge, reason))
        for chamber in stage.chambers if side.size else ():
            if _one_speed(windows, chamber, sign):
                reason = f"all {word} commands are the same: gain and loss cannot be told apart."
                out.append(Refusal(LOSSES[chamber][0 if sign > 0.0 else 1], reason))
    return [r for r in out if r.parameter not in stage.request.fixed]


def _one_speed(windows: Sequence[Windows], chamber: int, sign: float) -> bool:
    """Whether one chamber saw only one size of command of a sign."""
    levels = [sign * w.mean(w.command) for w in windows if w.chamber == chamber]
    size = np.concatenate(levels) if levels else np.zeros(0)
    size = size[size > 0.0]
    return bool(size.size and np.quantile(size, 0.95) < 1.2 * np.quantile(size, 0.05))


def _fit_flow(
    stage: _Stage, windows: Sequence[Windows], lenient: bool, without: Sequence[str] = ()
) -> Fitted:
    """Regression of the flow over windows.

    ``lenient`` refuses nothing, for a start of the gray box or a comparison; ``without`` names
    parameters that are held at zero.
    """
    unknowns = _unknowns(stage, windows)
    request = stage.request
    if without:
        request = replace(request, fixed={**request.fixed, **dict.fromkeys(without, 0.0)})
    names = tuple(unknowns)
    model = NamedModel(
        nonlinear=names,
        linear=(),
        columns=flow_columns(windows, stage.machine),
        measured=[w.motion for w in windows],
        weights=[1.0 / stage.machine.area(w.chamber) for w in windows],
    )
    starts = []
    for share in (0.0, 1.0):
        start = {n: u.scale for n, u in unknowns.items()}
        for n, u in unknowns.items():
            if n.startswith("line_loss"):
                start[n] = share * u.scale
            elif n.startswith("dead_zone"):
                start[n] = 0.2 * u.scale * (1.0 if n.endswith("positive") else -1.0)
        starts.append({**start, **request.start})
    sensible = dict.fromkeys(names, np.inf) if lenient else _sensible(unknowns)
    if not lenient and "bulk_modulus" in names:
        sensible["bulk_modulus"] = 0.5 * unknowns["bulk_modulus"].scale
    refusals = [r for r in _one_sided(stage, windows) if r.parameter not in request.fixed]
    return fit_named(
        model, stage.specs, request, unknowns, starts, refusals=refusals, sensible=sensible
    )


def _plateau_positions(
    stage: _Stage, windows: Sequence[Windows], values: Mapping[str, float]
) -> list[FloatArray]:
    """Position by integrating the flow of the measured pressure over runs of windows."""
    out = [np.full(e.samples, np.nan) for e in stage.experiments]
    for w in sorted(windows, key=lambda w: -w.chamber):  # chamber 1 overwrites chamber 2
        e, machine = stage.experiments[w.experiment], stage.machine
        flow = w.flow(values, machine)
        if "bulk_modulus" in values:
            flow = flow + w.swelling / values["bulk_modulus"]
        starts = np.flatnonzero(np.r_[True, w.first[1:] != w.last[:-1]])
        for a, b in zip(starts, np.r_[starts[1:], w.first.size]):
            knots = np.r_[w.first[a], w.last[a:b]]
            steps = flow[a:b] * w.duration[a:b] / machine.area(w.chamber)
            path = np.r_[0.0, np.cumsum(steps)]
            rows = slice(int(knots[0]), int(knots[-1]) + 1)
            position = np.interp(e.time[rows], e.time[knots], path)
            out[w.experiment][rows] = position + float(np.mean(e["position"][rows] - position))
    return out


# --------------------------------------------------------------------------------- friction


@dataclass(frozen=True)
class _FrictionRows:
    """Speed [m/s] and friction force [N] over short windows or plateaus, one array each."""

    speed: FloatArray
    force: FloatArray
    source: str

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        """Rows fast enough to have a direction."""
        if not self.speed.size:
            return np.zeros(0, dtype=bool)
        fast = float(np.quantile(np.abs(self.speed), 0.95))
        return np.asarray(np.abs(self.speed) > 0.1 * fast)


def _friction_rows(stage: _Stage) -> _FrictionRows:
    """Friction ``p1 A1 - p2 A2 - M a`` wherever it can be had."""
    nothing = _FrictionRows(np.zeros(0), np.zeros(0), "none")
    if stage.machine.area_1 is None or stage.machine.area_2 is None:
        return nothing
    both = [e for e in stage.experiments if "pressure_1" in e and "pressure_2" in e]
    if both:
        parts = [_friction_windows(e, stage.machine) for e in both]
        speed, force = (np.concatenate(p) for p in zip(*parts))
        return _FrictionRows(speed, force, "windows")
    if stage.chambers == (1, 2):
        return _paired_plateaus(stage)
    return nothing


def _friction_windows(e: Experiment, machine: Machine) -> tuple[FloatArray, FloatArray]:
    """Windows of about 10 ms; without a mass those in which the speed hardly changes."""
    half = max(2, round(0.01 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, half, 3)
    force = e["pressure_1"] * machine.area(1) - e["pressure_2"] * machine.area(2)
    smoothed = smooth(force, e.sample_time, half, 2).value
    speed, rows = motion.rate, np.arange(half, e.samples - half, half)
    if machine.mass is not None:
        smoothed = smoothed - machine.mass * motion.curvature
    else:
        change = np.abs(speed[rows + half - 1] - speed[rows - half])
        rows = rows[change < 0.1 * float(np.quantile(np.abs(speed), 0.95))]
    return speed[rows], smoothed[rows]


def _paired_plateaus(stage: _Stage) -> _FrictionRows:
    """Combine logs of one chamber each: plateaus at the same command belong together."""
    means: dict[tuple[int, float], list[tuple[float, float]]] = {}
    for w in _all_windows(stage):
        level = np.round(w.mean(w.command), 6)
        for u in np.unique(level):
            rows = level == u
            if u == 0.0 or rows.sum() < 3:
                continue
            pressure = float(np.mean(w.mean(0.5 * (w.before + w.after))[rows]))
            area = stage.machine.area(w.chamber)
            speed = float(np.sum((w.motion * w.duration)[rows]) / np.sum(w.duration[rows]) / area)
            means.setdefault((w.chamber, float(u)), []).append((speed, pressure))
    speeds: list[float] = []
    forces: list[float] = []
    for (chamber, u), found in sorted(means.items()):
        other = means.get((2, u))
        if chamber == 1 and other:
            for (v1, p1), (v2, p2) in zip(found, other):
                speeds.append(0.5 * (v1 + v2))
                forces.append(p1 * stage.machine.area(1) - p2 * stage.machine.area(2))
    return _FrictionRows(np.array(speeds), np.array(forces), "plateaus of separate logs")


def _fit_friction(stage: _Stage, rows: _FrictionRows, lenient: bool = False) -> Fitted:
    """Viscous and Coulomb friction by linear regression; an offset where both directions moved."""
    v, f = rows.speed[rows.moving], rows.force[rows.moving]
    columns = [v, np.sign(v)]
    both = (v > 0.0).any() and (v < 0.0).any()
    if both and not lenient:
        columns.append(np.ones(v.size))
    table = np.column_stack(columns)
    basis = Basis(np.zeros(v.size), table, np.zeros((v.size, 0)))
    names = ("viscous", "coulomb")
    size = max(float(np.abs(f).max()), 1e-300)
    model = NamedModel((), names, lambda index, values: basis, [f],
                       nuisance=("offset",) if both and not lenient else ())  # fmt: skip
    unknowns = make_unknowns(
        stage.specs, names, {"viscous": size / float(np.abs(v).max()), "coulomb": size},
        stage.request,
    )  # fmt: skip
    sensible = {"viscous": 0.5 * size / float(np.abs(v).max()), "coulomb": 0.5 * size}
    if lenient:
        sensible = dict.fromkeys(names, np.inf)
    return fit_named(model, stage.specs, stage.request, unknowns, [{}], sensible=sensible,
                     robust=rows.source == "windows")  # fmt: skip


def _levels(rows: _FrictionRows) -> dict[str, Quantity]:
    """Mean friction in either direction, signed [N]."""
    out = {}
    moving = rows.moving
    for sign, word in ((1.0, "extending"), (-1.0, "retracting")):
        chosen = rows.force[moving & (sign * rows.speed > 0.0)]
        if chosen.size >= 2:
            one = np.ones((chosen.size, 1))
            robust = rows.source == "windows"
            found = covariance([one], [chosen - chosen.mean()], robust=robust)
            se = float(np.sqrt(found.covariance[0, 0]))
            out[f"friction_{word}"] = Quantity(float(chosen.mean()), "N", "derived", se)
    return out


def _first_results(
    stage: _Stage, first: Fitted, rows: _FrictionRows
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray, list[Notice]]:
    """Parameters of stage one with the friction beside them."""
    parameters, order, matrix = quantities(first, stage.specs)
    notices = list(first.notices)
    if rows.speed.size >= 4 and rows.moving.sum() >= 4:
        friction = _fit_friction(stage, rows)
        more, names, block = quantities(friction, stage.specs)
        size = matrix.shape[0]
        whole = np.zeros((size + len(names), size + len(names)))
        whole[:size, :size], whole[size:, size:] = matrix, block
        order, matrix = (*order, *names), whole
        parameters.update(more)
        notices += friction.notices
    for spec in stage.specs:
        if spec.name in parameters or spec.rank:
            continue
        if spec.name in stage.request.fixed:
            parameters[spec.name] = Quantity(stage.request.fixed[spec.name], spec.unit, "fixed")
        elif not spec.optional:
            notices.append(refuse(spec, "it needs the pressures of both chambers."))
            parameters[spec.name] = Quantity(spec.neutral or 0.0, spec.unit, "not_identified")
    absent = [i for i in (1, 2) if i not in stage.chambers]
    for i in absent:
        notices.append(
            Notice(
                "chamber-not-recorded",
                f"no log holds pressure_{i}: the file has no valve gain and line losses of chamber "
                f"{i}. Record that pressure, or repeat the run with the sensor at chamber {i} and "
                "give both logs.",
            )
        )
    return parameters, order, matrix, notices


# -------------------------------------------------------------------------------- stage two


def _fit_gray(stage: _Stage, first: Fitted, rows: _FrictionRows) -> tuple[Fitted, GraySolution]:
    """Output error of pressures and position, refusing what the data do not determine."""
    fixed = {n: float(v) for n, v in stage.request.fixed.items() if n in GRAY_NAMES}
    unknowns = dict(first.unknowns)
    start, scales = _gray_start(stage, first, rows)
    extra = make_unknowns(stage.specs, ("viscous", "coulomb"), scales, stage.request)
    unknowns.update(extra)
    logs = [make_gray_log(e, stage.machine) for e in stage.experiments]
    box = GrayBox(logs, stage.machine, (1.3 * scales["coulomb"], 1.3 * scales["viscous"]))
    refused = {r.parameter: r for r in _one_sided(stage, _all_windows(stage))}
    notices = [refuse(_spec(stage.specs, n), r.reason) for n, r in refused.items()]
    sigma, nodes = _noise(stage.experiments), None
    bounds = {n: (u.low, u.high) for n, u in unknowns.items()}
    while True:
        held = {**fixed, **{n: _spec(stage.specs, n).neutral or 0.0 for n in refused}}
        free = [n for n in GRAY_NAMES if n not in held]
        begin = {**start, **held}
        solution = None
        for _ in range(3):  # the weights follow the residuals
            solution = solve_gray_box(
                box, begin, free, {n: unknowns[n].scale for n in free}, bounds, sigma, nodes
            )
            begin, nodes = solution.values, solution.nodes
            stage.request.progress(
                f"gray box: {solution.iterations} steps, weighted error {solution.cost:.6g}"
            )
            new = _spread(logs, solution)
            settled = bool(np.all(np.abs(new / sigma - 1.0) < 0.05))
            sigma = new
            if settled:
                break
        assert solution is not None
        channels = [
            [slice(k * log.samples, (k + 1) * log.samples) for k in range(len(log.channels))]
            for log in logs
        ]
        uncertainty = score_covariance(solution.jacobian, solution.residuals, channels)
        worst = _undetermined(free, solution, uncertainty, unknowns, stage)
        if worst is None:
            break
        notices.append(refuse(_spec(stage.specs, worst[0]), worst[1]))
        refused[worst[0]] = Refusal(*worst)
        start, nodes = solution.values, None
    _check_bulk_modulus(stage, box, solution, free, unknowns, bounds, channels)
    uncertainty = _with_rounding(box, solution, free, unknowns, bounds, uncertainty)
    fitted = _as_fitted(stage, solution, free, fixed, refused, uncertainty, unknowns, notices)
    if not solution.converged:
        fitted.notices.append(
            Notice("not-converged", "the gray box stopped before it had settled: check areas, "
                   "volumes, mass and supply pressure, or give --start values.")
        )  # fmt: skip
    return fitted, solution


def _gray_start(
    stage: _Stage, first: Fitted, rows: _FrictionRows
) -> tuple[dict[str, float], dict[str, float]]:
    """Start values from stage one, and the sizes of the friction."""
    machine = stage.machine
    force = 0.01 * (machine.supply - machine.tank) * machine.area(1)
    speeds = [np.abs(np.diff(e["position"])).sum() / np.ptp(e.time) for e in stage.experiments]
    speed = max(float(np.mean(speeds)), 1e-6)
    values = {"viscous": force / speed, "coulomb": force}
    if rows.moving.sum() >= 8:
        found = _fit_friction(stage, rows, lenient=True).values
        values = {n: found[n] for n in values}
    scales = {
        "viscous": max(values["viscous"], force / speed),
        "coulomb": max(values["coulomb"], force),
    }
    start = {**dict.fromkeys(GRAY_NAMES, 0.0), **first.values, **values}
    start["bulk_modulus"] = float(np.clip(first.values["bulk_modulus"], 2e8, 3e9))
    return {**start, **{n: v for n, v in stage.request.start.items() if n in start}}, scales


def _noise(experiments: Sequence[Experiment]) -> FloatArray:
    """Noise of the three channels from second differences, with a floor [Pa, Pa, m]."""
    out = []
    for role in ("pressure_1", "pressure_2", "position"):
        found = [
            float(np.median(np.abs(np.diff(e[role], 2)))) / 0.6745 / np.sqrt(6.0)
            + max(e.signals[role].resolution, 1e-4 * float(np.ptp(e[role])))
            for e in experiments
            if role in e
        ]
        out.append(max(found, default=1.0))
    return np.array(out)


def _spread(logs: Sequence[Any], solution: GraySolution) -> FloatArray:
    """Root mean square of the residuals of each channel over all logs [Pa, Pa, m]."""
    total, count = np.zeros(3), np.zeros(3)
    for log, states in zip(logs, solution.states):
        for c, y in zip(log.channels, log.measured):
            total[c] += float(np.sum((y - states[:, c]) ** 2))
            count[c] += y.size
    spread = np.sqrt(total / np.maximum(count, 1.0))
    return np.where(spread > 0.0, spread, solution.sigma)


def _undetermined(
    free: Sequence[str],
    solution: GraySolution,
    uncertainty: Uncertainty,
    unknowns: Mapping[str, Unknown],
    stage: _Stage,
) -> tuple[str, str] | None:
    """The parameter whose interval says least, if it says nothing."""
    quantile = t_quantile(0.975, uncertainty.degrees)
    sensible = {**_sensible(unknowns), "viscous": unknowns["viscous"].scale,
                "coulomb": unknowns["coulomb"].scale}  # fmt: skip
    found: list[tuple[bool, float, str, str]] = []
    for k, name in enumerate(free):
        half = quantile * float(np.sqrt(max(uncertainty.covariance[k, k], 0.0)))
        value, spec = solution.values[name], _spec(stage.specs, name)
        if name == "bulk_modulus" and solution.active[k]:
            half = np.inf
        width = sensible.get(name, (0.3 if name == "bulk_modulus" else 0.5) * abs(value))
        if not half <= width:
            reason = (
                f"its 95 % interval would be {value:.3g} ± {half:.2g} {spec.unit}, wide enough "
                "to hold every sensible value."
                if np.isfinite(half)
                else "the pressures and the position hardly depend on it in these logs."
            )
            ratio = half / width if np.isfinite(half) and width > 0.0 else np.inf
            found.append((spec.neutral is not None, ratio, name, reason))
    # what can be left out goes first: a gain may be sure once the losses are gone
    return max(found)[2:] if found else None


def _with_rounding(
    box: GrayBox,
    solution: GraySolution,
    free: Sequence[str],
    unknowns: Mapping[str, Unknown],
    bounds: Mapping[str, tuple[float, float]],
    uncertainty: Uncertainty,
) -> Uncertainty:
    """Add what rounding off the dry friction does to the estimates.

    The error is in proportion to the speed over which friction is rounded: doubling it moves the
    estimates by as much as they are off, which noise alone does not show.
    """
    coarse = copy(box)
    coarse.slip = 2.0 * box.slip
    scales = {n: unknowns[n].scale for n in free}
    other = solve_gray_box(coarse, solution.values, free, scales, bounds, solution.sigma,
                           solution.nodes, max_iterations=5)  # fmt: skip
    shift = np.array([other.values[n] - solution.values[n] for n in free])
    return replace(uncertainty, covariance=uncertainty.covariance + np.outer(shift, shift))


def _check_bulk_modulus(
    stage: _Stage,
    box: GrayBox,
    solution: GraySolution,
    free: Sequence[str],
    unknowns: Mapping[str, Unknown],
    bounds: Mapping[str, tuple[float, float]],
    channels: Sequence[Sequence[slice]],
) -> None:
    """Refuse a bulk modulus that looks certain only because other parameters were held.

    Raises
    ------
    NotIdentifiedError
        When its interval is wide once losses and dead zone may vary again.
    """
    every = [n for n in GRAY_NAMES if n not in stage.request.fixed]
    if "bulk_modulus" not in free or len(every) == len(free):
        return
    scales = {n: unknowns[n].scale for n in every}
    wide = solve_gray_box(box, solution.values, every, scales, bounds, solution.sigma,
                          solution.nodes, max_iterations=0)  # fmt: skip
    found = score_covariance(wide.jacobian, wide.residuals, channels)
    k = every.index("bulk_modulus")
    half = 1.96 * float(np.sqrt(max(found.covariance[k, k], 0.0)))
    if not half <= 0.3 * solution.values["bulk_modulus"]:
        raise_for = _spec(stage.specs, "bulk_modulus")
        refuse(raise_for, "the logs hold no transients of the pressures that would tell it from "
               "valve and losses.")  # fmt: skip


def _as_fitted(
    stage: _Stage,
    solution: GraySolution,
    free: Sequence[str],
    fixed: Mapping[str, float],
    refused: Mapping[str, Refusal],
    uncertainty: Uncertainty,
    unknowns: Mapping[str, Unknown],
    notices: list[Notice],
) -> Fitted:
    status = dict.fromkeys(free, "estimated")
    status |= dict.fromkeys(fixed, "fixed") | dict.fromkeys(refused, "not_identified")
    eta = np.array([solution.values[n] for n in free])
    plain = Solution(
        eta, np.zeros(0), [], solution.cost, solution.residuals,
        [s[:, 2] for s in solution.states], solution.jacobian,
        iterations=solution.iterations, converged=solution.converged,
    )  # fmt: skip
    values = {n: solution.values[n] for n in GRAY_NAMES}
    return Fitted(values, tuple(free), uncertainty, status, Search(plain, 1, 1, ()), plain,
                  notices, unknowns)  # fmt: skip


def _gray_details(fitted: Fitted, solution: GraySolution, first: Fitted) -> dict[str, Any]:
    return {
        "method": "gray-box output error of pressures and position (multiple shooting)",
        "iterations": solution.iterations,
        "converged": solution.converged,
        "covariance": fitted.details()["covariance"],
        "residual_rms": {
            "pressure_1": float(solution.sigma[0]),
            "pressure_2": float(solution.sigma[1]),
            "position": float(solution.sigma[2]),
        },
        "stage_one": {n: float(v) for n, v in first.values.items()},
    }


def _simulate_gray(
    experiment: Experiment, machine: Machine, values: Mapping[str, float]
) -> FloatArray:
    """Position from the command alone, with the initial state fitted."""
    log = make_gray_log(experiment, machine)
    friction = (max(values["coulomb"], 1e-9), values["viscous"])
    box = GrayBox([log], machine, friction)
    some = {n: values[n] for n in GRAY_NAMES}
    solution = solve_gray_box(box, some, (), {}, {}, _noise([experiment]))
    return np.asarray(solution.states[0][:, 2])


# ---------------------------------------------------------------------------------- derived


def _derived(
    stage: _Stage,
    windows: Sequence[Windows],
    fitted: Fitted,
    rows: _FrictionRows,
    gray: bool,
) -> dict[str, Quantity]:
    """Gains by direction, friction levels and, of the gray box, the pressure resonance."""
    out = _levels(rows) if rows.speed.size and not gray else {}
    for chamber in stage.chambers:
        for sign, word in ((1.0, "extending"), (-1.0, "retracting")):
            found = _gain_of_direction(stage, windows, fitted.values, chamber, sign)
            if found is not None:
                out[f"valve_gain_{chamber}_{word}"] = found
    if gray:
        out.update(_resonance(stage, fitted))
    return out


def _gain_of_direction(
    stage: _Stage,
    windows: Sequence[Windows],
    values: Mapping[str, float],
    chamber: int,
    sign: float,
) -> Quantity | None:
    """Gain of one chamber from the windows of one direction, all else as fitted.

    The flow is nearly proportional to the gain; one Gauss-Newton step from the common gain.
    """
    name = f"valve_gain_{chamber}"
    flows, slopes = [], []
    for w in windows:
        chosen = (w.chamber == chamber) & (sign * w.mean(w.command) > 0.0)
        if not np.any(chosen) or w.chamber != chamber:
            continue
        moved = {**values, name: values[name] * (1.0 + 1e-30j)}
        model = w.flow(moved, stage.machine)
        rest = w.motion - np.real(model)
        if "bulk_modulus" in values:
            rest = rest - w.swelling / values["bulk_modulus"]
        flows.append(rest[chosen])
        slopes.append((np.imag(model) / 1e-30)[chosen])
    if not flows or sum(f.size for f in flows) < 5:
        return None
    j, r = np.concatenate(slopes), np.concatenate(flows)
    if not float(j @ j) > 0.0:
        return None
    share = float(j @ r / (j @ j))
    parts = [f - s * share for f, s in zip(flows, slopes)]
    found = covariance([s[:, None] for s in slopes], parts)
    se = float(np.sqrt(found.covariance[0, 0])) * values[name]
    value = values[name] * (1.0 + share)
    q = t_quantile(0.975, found.degrees)
    return Quantity(value, _GAIN_UNIT, "derived", se, [value - q * se, value + q * se], "wald")


def _resonance(stage: _Stage, fitted: Fitted) -> dict[str, Quantity]:
    """Undamped resonance of the piston between the closed chambers, in the middle of the logs."""
    middle = float(np.mean([np.mean(e["position"]) for e in stage.experiments]))
    m = stage.machine
    volumes = [float(np.real(m.volume(i, np.array(middle)))) for i in (1, 2)]  # type: ignore[arg-type]
    compliance = m.area(1) ** 2 / volumes[0] + m.area(2) ** 2 / volumes[1]

    def function(v: Mapping[str, Any]) -> dict[str, Any]:
        omega = np.sqrt(v["bulk_modulus"] * compliance / (m.mass or 1.0))
        ratio = v["viscous"] / (2.0 * (m.mass or 1.0) * omega)
        return {"natural_frequency": omega, "damping_ratio": ratio}

    return derive(fitted, {"natural_frequency": "rad/s", "damping_ratio": "1"}, function)


# --------------------------------------------------------------------------------- networks


def _networks(
    stage: _Stage, windows: Sequence[Windows], fitted: Fitted, rows: _FrictionRows
) -> tuple[dict[str, Quantity], dict[str, Any]]:
    """Train what was asked for and compare it with the equations on rows held out."""
    parameters: dict[str, Quantity] = {}
    details: dict[str, Any] = {}
    if stage.request.options.get("flow") == "mlp":
        found, table = _flow_networks(stage, _rows_for_networks(stage), fitted.values)
        details["flow_comparison"] = table
        for name, net in found.items():
            parameters.update(_network_quantities(name, net, ("V", "Pa"), "m3/s"))
    if stage.request.options.get("friction") == "mlp":
        if rows.speed.size < 40:
            raise LogError(
                f"only {rows.speed.size} rows of friction can be had from the logs",
                expected="A network needs 40 or more.",
                remedy="Record both pressures in one log and give both areas, or leave out "
                "--friction mlp.",
            )
        net, table = _friction_network(stage, rows)
        details["friction_comparison"] = table
        parameters.update(_network_quantities("friction", net, ("m/s",), "N"))
    return parameters, details


def _network_quantities(
    name: str, net: Network, units: Sequence[str], output: str
) -> dict[str, Quantity]:
    """The layers as parameters; the standardisation is in the inputs' own SI units."""
    return {
        f"{name}_{layer}": Quantity(getattr(net, layer).tolist(), "1", "estimated")
        for layer in _LAYERS
    }


def network_of(parameters: Mapping[str, Any], name: str) -> Network | None:
    """Read a network back from the parameters of a file; ``None`` when there is none."""
    if f"{name}_weights_1" not in parameters:
        return None
    return Network(*(np.asarray(parameters[f"{name}_{layer}"], dtype=float) for layer in _LAYERS))


def _rows_for_networks(stage: _Stage) -> list[Windows]:
    """Overlapping windows in which the command does not jump."""
    found = _all_windows(stage, overlap=8)
    volts = max(float(np.abs(w.command).max()) for w in found)
    out = []
    for w in found:
        u = w.command
        spread = np.array([np.ptp(u[a:b]) for a, b in zip(w.first, w.last)])
        out.append(_cut(w, spread <= 0.03 * volts))
    return [w for w in out if w.first.size]


def _held_out(stage: _Stage, w: Windows) -> npt.NDArray[np.bool_]:
    """Windows that judge: the last of three logs or more, else the last quarter of each log."""
    if len(stage.experiments) > 2:
        return np.full(w.first.size, w.experiment == len(stage.experiments) - 1)
    return np.asarray(w.first >= 0.75 * stage.experiments[w.experiment].samples)


def _cut(w: Windows, rows: npt.NDArray[np.bool_]) -> Windows:
    names = ("first", "last", "duration", "motion", "swelling")
    return replace(w, **{n: getattr(w, n)[rows] for n in names})


def _flow_networks(
    stage: _Stage, windows: Sequence[Windows], values: Mapping[str, float]
) -> tuple[dict[str, Network], list[dict[str, Any]]]:
    """Networks of the flow from command and pressure, and how they compare.

    Three models see the same training windows and are judged on the same others: the
    equations without a dead zone (those of the paper), with it, and the network.
    """
    shown = [_cut(w, ~_held_out(stage, w)) for w in windows]
    shown = [w for w in shown if w.first.size]
    judged = [_cut(w, _held_out(stage, w)) for w in windows]
    compressed = {n: v for n, v in values.items() if n == "bulk_modulus"}
    known = replace(stage.request, fixed={**stage.request.fixed, **compressed})
    part = replace(stage, request=known, notices=[])
    zones = ("dead_zone_negative", "dead_zone_positive")
    rivals: dict[str, Callable[[Windows], FloatArray]] = {}
    for label, without in (("orifice_without_dead_zone", zones), ("orifice", ())):
        fit = _fit_flow(part, shown, lenient=True, without=without).values
        rivals[label] = partial(_orifice_flow, fit, stage.machine)
    nets, table = {}, []
    volts = max(float(np.abs(w.command).max()) for w in windows)
    edges = max(abs(values[z]) for z in zones)
    near = min(max(2.0 * edges, 0.05 * volts), 0.3 * volts)
    for chamber in stage.chambers:
        inputs, flow = _flow_rows([w for w in shown if w.chamber == chamber], values)
        net = _train_on_flow(inputs, flow, near, stage.request.seed)
        nets[f"flow_{chamber}"] = net
        models: dict[str, Callable[[Windows], FloatArray]] = {
            **rivals,
            "network": partial(_network_flow, net, values),
        }
        tests = [w for w in judged if w.chamber == chamber and w.first.size]
        if tests:
            table += _compare_flows(models, tests, values, chamber, near, edges, volts)
    return nets, table


def _train_on_flow(inputs: FloatArray, flow: FloatArray, near: float, seed: int) -> Network:
    """Network of the flow, rows near zero command repeated until they are half of all.

    Their flows are small: unweighted, they would hardly count.
    """
    thin = max(1, -(-flow.size // _WINDOWS))
    rows = np.arange(0, flow.size, thin)
    close = rows[np.abs(inputs[rows, 0]) < near]
    if close.size:
        rows = np.concatenate((rows, np.tile(close, max(rows.size // close.size - 1, 0))))
    return train_network(inputs[rows], flow[rows], _HIDDEN, seed)


def _orifice_flow(values: Mapping[str, float], machine: Machine, w: Windows) -> FloatArray:
    return np.asarray(np.real(w.flow(values, machine)))


def _network_flow(net: Network, values: Mapping[str, float], w: Windows) -> FloatArray:
    return net(_flow_rows([w], values)[0])


def _flow_rows(
    windows: Sequence[Windows], values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Inputs (command, pressure) and flow of every window, ``(m, 2)`` and ``(m,)``."""
    inputs, flows = [], []
    for w in windows:
        pressure = w.mean(0.5 * (w.before + w.after))
        inputs.append(np.column_stack((w.mean(w.command), pressure)))
        swelling = w.swelling / values["bulk_modulus"] if "bulk_modulus" in values else 0.0
        flows.append(w.motion - swelling)
    return np.concatenate(inputs), np.concatenate(flows)


def _compare_flows(
    models: Mapping[str, Callable[[Windows], FloatArray]],
    tests: Sequence[Windows],
    values: Mapping[str, float],
    chamber: int,
    near: float,
    edges: float,
    volts: float,
) -> list[dict[str, Any]]:
    """Error of every model by size of the command, near zero first, as in figure 9."""
    command = np.concatenate([w.mean(w.command) for w in tests])
    flow = _flow_rows(tests, values)[1]
    errors = {n: np.concatenate([f(w) for w in tests]) - flow for n, f in models.items()}
    bands = [("inside the dead zone", 0.0, edges), ("near zero command", 0.0, near),
             ("away from zero command", near, np.inf)]  # fmt: skip
    out = []
    for label, low, high in bands:
        rows = (np.abs(command) >= low) & (np.abs(command) < high)
        if not rows.any():
            continue
        rms = {n: float(np.sqrt(np.mean(e[rows] ** 2))) for n, e in errors.items()}
        out.append({
            "chamber": chamber, "where": label, "command_from": low,
            "command_to": float(min(high, volts)), "windows": int(rows.sum()), "unit": "m3/s",
            **rms, "closest": min(rms, key=lambda n: rms[n]),
            "why": _why(label, rms),
        })  # fmt: skip
    return out


def _why(where: str, rms: Mapping[str, float]) -> str:
    """One sentence on what the numbers of a row come from."""
    plain, zone, net = (rms[n] for n in ("orifice_without_dead_zone", "orifice", "network"))
    if where.startswith("away"):
        if net <= zone:
            return "The network follows what the equations leave out."
        return (
            "The equations have the right shape where the valve is open; the network has to piece "
            "it together from the rows it saw."
        )
    if abs(plain - zone) < 0.1 * plain:
        return "The equations agree on these rows with and without a dead zone: no overlap shows."
    cause = (
        "Overlap of spool and land closes the valve here, and equations without a dead zone "
        "predict flow all the same; "
    )
    if net >= plain:
        return cause + "the network saw too few rows to learn it."
    if zone <= net:
        return cause + "the network has learnt it, equations with a fitted dead zone know it best."
    return cause + "the network follows the shape of the edges, which no dead zone has."


def _friction_network(stage: _Stage, rows: _FrictionRows) -> tuple[Network, list[dict[str, Any]]]:
    """Network of the friction over speed, beside Coulomb and viscous friction."""
    judged = (np.arange(rows.speed.size) // 20) % 4 == 3
    net = train_network(rows.speed[~judged, None], rows.force[~judged], 6, stage.request.seed)
    shown = _FrictionRows(rows.speed[~judged], rows.force[~judged], rows.source)
    found = _fit_friction(stage, shown, lenient=True).values
    v, f = rows.speed[judged], rows.force[judged]
    line = found["viscous"] * v + found["coulomb"] * np.sign(v)
    edge = 0.1 * float(np.quantile(np.abs(rows.speed), 0.95))
    table = []
    for label, chosen in (("slow", np.abs(v) <= edge), ("moving", np.abs(v) > edge)):
        if chosen.any():
            pairs = (("coulomb", line), ("network", net(v[:, None])))
            rms = {n: float(np.sqrt(np.mean((m - f)[chosen] ** 2))) for n, m in pairs}
            table.append({"where": label, "speed_limit": edge, "windows": int(chosen.sum()),
                          "unit": "N", **rms})  # fmt: skip
    return net, table


# -------------------------------------------------------------------------------- controller


class HydraulicBlock(Block):
    """Static part of the cylinder for a controller: flow, speed, and the command for a speed.

    Attributes
    ----------
    parameters
        Values by name [SI].
    """

    family = "hydraulic-cylinder"

    def __init__(self, values: Mapping[str, Value], options: Mapping[str, Any]) -> None:
        self.parameters = dict(values)
        known = [i for i in (1, 2) if f"valve_gain_{i}" in values]
        self._machine = _machine(options, known)
        self._values = scalars(values)
        self._known = known
        self._nets = {i: network_of(values, f"flow_{i}") for i in (1, 2)}

    def flow(
        self,
        chamber: int,
        command: npt.ArrayLike,
        pressure: npt.ArrayLike,
        *,
        network: bool = False,
    ) -> FloatArray:
        """Flow into chamber 1 or out of chamber 2 [m3/s].

        Parameters
        ----------
        chamber
            1 or 2.
        command, pressure
            [V] and [Pa], scalars or arrays.
        network
            Whether to ask the network (``--flow mlp``) instead of the equation.
        """
        from ..estimation.hydraulics import chamber_flow

        u, p = np.broadcast_arrays(np.asarray(command, float), np.asarray(pressure, float))
        self._need(chamber)
        if network:
            net = self._nets[chamber]
            if net is None:
                raise UsageError(
                    f"the file holds no network of the flow of chamber {chamber}",
                    remedy="Fit with --flow mlp.",
                )
            return net(np.column_stack((u.ravel(), p.ravel()))).reshape(u.shape)
        m = self._machine
        return np.real(chamber_flow(chamber, u, p, self._values, m.supply, m.tank))

    def _need(self, chamber: int) -> None:
        if chamber not in self._known:
            raise UsageError(
                f"the file holds no valve gain of chamber {chamber}",
                remedy="Fit logs that hold its pressure.",
            )

    def _feeding(self, extending: bool) -> int:
        """Chamber that meters the flow in; the other one where that is not known."""
        chamber = 1 if extending else 2
        return chamber if chamber in self._known else self._known[0]

    def __call__(self, command: float, pressure_1: float = 0.0, pressure_2: float = 0.0) -> float:
        """Steady speed for a command and the measured pressures [m/s].

        The flow of the chamber that is being fed sets it; friction and load are in the
        pressures.

        Parameters
        ----------
        command
            [V]
        pressure_1, pressure_2
            [Pa]; only that of the chamber being fed is used.
        """
        chamber = self._feeding(command >= 0.0)
        pressure = pressure_1 if chamber == 1 else pressure_2
        return float(self.flow(chamber, command, pressure)) / self._machine.area(chamber)

    def command_for(
        self, velocity: float, pressure_1: float = 0.0, pressure_2: float = 0.0
    ) -> float:
        """Feed-forward command for a wanted speed: the exact inverse of calling the block.

        Parameters
        ----------
        velocity
            [m/s]
        pressure_1, pressure_2
            [Pa]

        Returns
        -------
        float
            Command [V]; 0 for zero speed, infinite where the pressures leave no drop for it.
        """
        if velocity == 0.0:
            return 0.0
        extending = velocity > 0.0
        chamber = self._feeding(extending)
        pressure = pressure_1 if chamber == 1 else pressure_2
        m, v = self._machine, self._values
        fed = extending == (chamber == 1)
        drop = m.supply - pressure if fed else pressure - m.tank
        flow = abs(velocity) * m.area(chamber)
        loss = v.get(LOSSES[chamber][0 if extending else 1], 0.0)
        rest = drop - loss * flow
        sign = 1.0 if extending else -1.0
        if rest <= 0.0:
            return sign * float("inf")
        edge = v["dead_zone_positive" if extending else "dead_zone_negative"]
        return edge + sign * flow / (v[f"valve_gain_{chamber}"] * float(np.sqrt(rest)))
