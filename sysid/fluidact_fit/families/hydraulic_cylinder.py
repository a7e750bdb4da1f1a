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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import LogError, Notice, NotIdentifiedError
from ..estimation.hydraulics import GRAY_NAMES, Windows
from ..estimation.parametric import Fitted, check_request, quantities, refuse, scalars
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
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
from .hydraulic.block import HydraulicBlock
from .hydraulic.flow import GAIN_UNIT, fit_flow, gain_of_direction, plateau_positions
from .hydraulic.friction import FrictionRows, fit_friction, friction_levels, friction_rows
from .hydraulic.gray import fit_gray, gray_details, resonance, simulate_gray
from .hydraulic.networks import LAYERS, NETWORKS, fit_networks, flow_view
from .hydraulic.stage import (
    Stage,
    all_windows,
    check_volumes,
    read_machine,
    recorded_chambers,
    spec_of,
)

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
            f"valve_gain_{i}", GAIN_UNIT, f"gain of the orifices of chamber {i}, per volt",
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
        for net in NETWORKS
        for layer in LAYERS
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
        chambers = recorded_chambers(experiments)
        machine = read_machine(request.options, chambers)
        check_volumes(machine, experiments)
        stage = Stage(variant.parameters, experiments, request, machine, chambers)
        windows = all_windows(stage)
        gray = stage.gray and (stage.uniform() or "bulk_modulus" in request.fixed)
        if stage.gray and not gray:
            spec = spec_of(stage.specs, "bulk_modulus")
            slow = max(e.sample_time for e in experiments)
            refuse(spec, f"the logs are sampled every {slow * 1e3:.3g} ms, too slowly to follow "
                   "the pressures.")  # fmt: skip
        friction = friction_rows(stage)
        found = _by_gray_box(stage, windows, friction) if gray else None
        settled: dict[str, Any] = {}
        if gray and found is None:
            # what is not used must not stand in the file, or a reader would simulate with it
            settled = dict.fromkeys(("mass", "dead-volume-1", "dead-volume-2"))
            plain = replace(machine, mass=None, dead_volume_1=None, dead_volume_2=None)
            stage, gray = replace(stage, machine=plain), False
            windows, friction = all_windows(stage), friction_rows(stage)
        if found is None:
            found = _by_plateaus(stage, windows, friction)
        measured = [
            np.where(np.isfinite(s), e["position"], np.nan)
            for s, e in zip(found.simulated, experiments)
        ]
        derived = _derived(stage, windows, found.fitted, friction, gray)
        nets, more = fit_networks(stage, windows, found.fitted, friction)
        return Estimate(
            {**found.parameters, **nets}, derived, found.order, found.covariance, found.simulated,
            measured, [*stage.notices, *found.notices], {**found.details, **more}, options=settled,
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
        machine = read_machine(options, chambers or (1, 2))
        if machine.complete and all(n in values for n in GRAY_NAMES):
            return simulate_gray(experiment, machine, values)
        known = tuple(i for i in chambers if f"valve_gain_{i}" in values)
        if not known:
            have = " and ".join(f"pressure_{i}" for i in chambers) or "no pressure"
            fitted = " and ".join(str(i) for i in (1, 2) if f"valve_gain_{i}" in values)
            raise LogError(
                f"it holds {have}, and the model has the valve gain of chamber {fitted} only",
                where=experiment.name,
                remedy=f"Give a log with pressure_{fitted[-1:]}, or fit logs of the other chamber "
                "as well.",
            )
        request = Request(options=options)
        stage = Stage(variant.parameters, [experiment], request, machine, known)
        return plateau_positions(stage, all_windows(stage), values)[0]

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView | None:
        """With ``--flow mlp`` the flow near zero command: measured, network and equations."""
        if "flow_models" not in estimate.details:
            return None
        chambers = recorded_chambers(experiments)
        machine = read_machine(options, chambers)
        request = Request(options=options)
        stage = Stage(variant.parameters, experiments, request, machine, chambers)
        return flow_view(stage, estimate)

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


@dataclass(frozen=True)
class _Found:
    """What one of the two stages found, as `Estimate` takes it."""

    fitted: Fitted
    parameters: dict[str, Quantity]
    order: tuple[str, ...]
    covariance: FloatArray
    simulated: list[FloatArray]
    notices: list[Notice]
    details: dict[str, Any]


def _by_gray_box(stage: Stage, windows: Sequence[Windows], friction: FrictionRows) -> _Found | None:
    """Stage two; None, with a notice, where the equations cannot follow the logs at all."""
    first = fit_flow(stage, windows, lenient=True)
    both = all("pressure_1" in e and "pressure_2" in e for e in stage.experiments)
    try:
        fitted, solution, noise = fit_gray(stage, first, friction)
    except (np.linalg.LinAlgError, NotIdentifiedError) as error:
        if both and isinstance(error, NotIdentifiedError):
            raise
        missing = "" if both else " Each log holds the pressure of one chamber only."
        stage.notices.append(
            Notice(
                "gray-box-left-out",
                "with the given mass and dead volumes the equations of pressure and motion "
                f"cannot follow these logs.{missing} Gains and losses are those of the plateaus; "
                "mass and volumes are not used. Record both pressures in every log, at 1 kHz, "
                "and check volumes, mass and whether the supply pressure is steady.",
            )
        )
        return None
    parameters, order, matrix = quantities(fitted, stage.specs)
    return _Found(
        fitted, parameters, order, matrix, [s[:, 2] for s in solution.states],
        list(fitted.notices), gray_details(fitted, solution, first, noise),
    )  # fmt: skip


def _by_plateaus(stage: Stage, windows: Sequence[Windows], friction: FrictionRows) -> _Found:
    """Stage one alone: flow balance over windows, friction beside it."""
    first = fit_flow(stage, windows, lenient=False)
    parameters, order, matrix, notices = _first_results(stage, first, friction)
    details = {
        "method": "flow balance over windows",
        "windows": int(sum(w.first.size for w in windows)),
        "covariance": first.details()["covariance"],
    }
    simulated = plateau_positions(stage, windows, first.values)
    return _Found(first, parameters, order, matrix, simulated, notices, details)


def _first_results(
    stage: Stage, first: Fitted, rows: FrictionRows
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray, list[Notice]]:
    """Parameters of stage one with the friction beside them."""
    parameters, order, matrix = quantities(first, stage.specs)
    notices = list(first.notices)
    if rows.speed.size >= 4 and rows.moving.sum() >= 4:
        friction = fit_friction(stage, rows)
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


def _derived(
    stage: Stage,
    windows: Sequence[Windows],
    fitted: Fitted,
    rows: FrictionRows,
    gray: bool,
) -> dict[str, Quantity]:
    """Gains by direction, friction levels and, of the gray box, the pressure resonance."""
    out = friction_levels(rows) if rows.speed.size and not gray else {}
    for chamber in stage.chambers:
        for sign, word in ((1.0, "extending"), (-1.0, "retracting")):
            found = gain_of_direction(stage, windows, fitted.values, chamber, sign)
            if found is not None:
                out[f"valve_gain_{chamber}_{word}"] = found
    if gray:
        out.update(resonance(stage, fitted))
    return out
