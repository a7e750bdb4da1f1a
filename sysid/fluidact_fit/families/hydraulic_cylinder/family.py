"""Servo-hydraulic cylinder: valve gains, line losses, bulk modulus, dead zone, friction.

The equations are those of :mod:`fluidact_fit.mechanics.hydraulic_cylinder`; derivations and what is
fitted when are in ``docs/theory/hydraulic-cylinder.md``.

A run without position is simulated from rest at the mean position of the fitted logs: the gray
box from the command alone and from the pressures of a leaking closed valve, the others from
command and pressure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...errors import Notice
from ...estimation.named_model import check_request
from ...estimation.results import refuse, undetermined_error
from ...estimation.scaled_network import checksums
from ...estimation.stribeck import free_names, rise_words, stribeck_specs
from ...experiment import Experiment, Hold
from ...family import (
    Family,
    NoiseModel,
    ParameterSpec,
    PhysicsView,
    Plant,
    Quantity,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    Structure,
    UnmodelledEffect,
    Variant,
    make_solution,
    scalars,
)
from ...mechanics.hydraulic_cylinder import THETA
from .block import HydraulicBlock
from .gray_fit import fit_gray, resonance
from .networks import LAYERS, NETWORKS, fit_networks, flow_curve
from .options import HydraulicCylinderOptions
from .regression import GAIN_UNIT, directional_gains, fit_flow, fit_friction, friction_levels
from .setup import Setup, known_chambers, make_setup, read_machine
from .simulation import simulate_runs
from .unmodelled import unmodelled_effects

_SLOWEST = 2.5e-3  # s: at slower sampling the pressure resonance cannot be followed
_GAIN_REMEDY = "Record strokes at two commands or more, each held until the speed settles."
_LOSS_REMEDY = "Record strokes at large commands (a few volts) in both directions."
_BULK_REMEDY = (
    "Record steps of the command at 1 kHz or more, or fix it: --fix bulk_modulus=1e9 (typical: "
    "0.5e9 to 1.5e9 Pa). Without --dead-volume-1 and --dead-volume-2 the plateaus alone are used, "
    "which do not need it."
)
_EDGE_REMEDY = (
    "Record slow passes of the command through zero, or several small commands in both directions."
)
_FRICTION_REMEDY = (
    "Record both pressures over strokes in both directions at two speeds or more, and give both "
    "areas."
)
_NEEDS_BOTH = (
    "no part of the logs shows steady motion with both pressures, nor do logs of one pressure each "
    "hold the same commands."
)
_NEEDS_ALL = (
    "it shows in the simulation of pressures and motion, which needs --mass, --dead-volume-1 and "
    "--dead-volume-2, and logs of both pressures that it can follow."
)


def _specs() -> tuple[ParameterSpec, ...]:
    """The parameter table."""
    where = "supply to chamber 1", "supply to chamber 2", "chamber 1 to tank", "chamber 2 to tank"
    gains = [
        ParameterSpec(
            f"valve_gain_{i}", GAIN_UNIT, f"gain of the orifices of chamber {i}, per volt",
            minimum=1e-30, optional=True, remedy=_GAIN_REMEDY,
        )
        for i in (1, 2)
    ]  # fmt: skip
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
            optional=True, rank=2 if layer.startswith("weights") else 1,
        )
        for net in NETWORKS
        for layer in LAYERS
    ]  # fmt: skip
    return (
        *gains,
        *losses,
        ParameterSpec("bulk_modulus", "Pa", "effective bulk modulus of oil and hoses",
                      minimum=1e5, optional=True, remedy=_BULK_REMEDY),
        ParameterSpec("dead_zone_negative", "V", "command below which the valve opens",
                      neutral=0.0, maximum=0.0, curved=True, remedy=_EDGE_REMEDY),
        ParameterSpec("dead_zone_positive", "V", "command above which the valve opens",
                      neutral=0.0, minimum=0.0, curved=True, remedy=_EDGE_REMEDY),
        ParameterSpec("viscous", "N s/m", "viscous friction of the piston",
                      neutral=0.0, minimum=0.0, remedy=_FRICTION_REMEDY),
        ParameterSpec("coulomb", "N", "dry friction of the piston",
                      neutral=0.0, minimum=0.0, remedy=_FRICTION_REMEDY),
        *stribeck_specs("N", "m/s"),
        *networks,
    )  # fmt: skip


_ROLES = (
    Role("time", "s", "time of each sample"),
    Role("command", "V", "control signal of the servo valve", hold="zoh"),
    Role("pressure_1", "Pa", "pressure in the chamber that extends the piston", required=False,
         gauge=True),
    Role("pressure_2", "Pa", "pressure in the chamber on the rod side", required=False, gauge=True),
    Role("position", "m", "position of the piston, growing as it extends", output=True),
)  # fmt: skip


class HydraulicCylinder(Family[HydraulicCylinderOptions]):
    """Servo valve, two chambers and a piston, as physics or with small networks."""

    name = "hydraulic-cylinder"
    title = "Hydraulic cylinder: valve gains, line losses, bulk modulus and friction"
    equation = (
        "mass y'' = p1 area_1 - p2 area_2 - viscous y' - coulomb sgn(y') "
        "(- sgn(y') * stribeck * exp(-y'^2 / stribeck_speed^2)); "
        "p' = +-bulk_modulus / volume (Q - area y'); Q = valve_gain u sqrt(drop - line_loss |Q|)"
    )
    variants = (Variant("hydraulic-cylinder", _ROLES, _specs()),)
    options_type = HydraulicCylinderOptions
    block_type = HydraulicBlock
    structures = (
        Structure(
            "no dead zone", {"stribeck": "none"},
            {"dead_zone_negative": 0.0, "dead_zone_positive": 0.0},
        ),
        Structure("dead zone", {"stribeck": "none"}),
        Structure("dead zone, Stribeck", {"stribeck": "estimate"}),
    )  # fmt: skip
    examined = 30_000

    def estimate(
        self,
        variant: Variant,
        experiments: Sequence[Experiment],
        request: Request[HydraulicCylinderOptions],
    ) -> Solution[HydraulicCylinderOptions]:
        """Fit the cylinder; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        setup = make_setup(variant, experiments, request)
        found = fit_gray(setup) if _is_gray_box(setup) else _by_flow_balance(setup)
        layers, tables = fit_networks(setup, scalars(found.values))
        return replace(
            found,
            parameters={**found.parameters, **layers},
            details={**found.details, **({"comparisons": tables} if tables else {})},
        )

    def simulate(
        self,
        plant: Plant[HydraulicCylinderOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Position from the command, or from command and pressure; see :meth:`Family.simulate`."""
        return simulate_runs(plant, experiments)

    def physics_view(
        self, plant: Plant[HydraulicCylinderOptions], runs: Runs
    ) -> PhysicsView | None:
        """Return the flow of a chamber over the command, by a network too where there is one."""
        setup = make_setup(plant.variant, [e for e, _ in runs], Request(plant.options))
        return flow_curve(setup, plant.values)

    def unmodelled_effects(
        self, plant: Plant[HydraulicCylinderOptions]
    ) -> Sequence[UnmodelledEffect]:
        """Effects and wrong numbers of the gray box; see :meth:`Family.unmodelled_effects`."""
        return [*unmodelled_effects(plant)] if plant.options.stage == "gray-box" else []

    def model(
        self, plant: Plant[HydraulicCylinderOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The equations' numbers, and checksums of the layers of the networks."""
        v = plant.numbers
        read_machine(plant.options, known_chambers(v))  # refuses a file that lacks some of it
        layers = checksums({n: x for n, x in plant.values.items() if n not in v})
        return {
            "hydraulic": {
                "flow": "Q = sgn(u) (-k^2 r + sqrt(k^4 r^2 + 4 k^2 drop)) / 2, k = K |u|, u beyond "
                "the dead zone; r: u >= 0 line_loss_1 (chamber 1), line_loss_4 (chamber 2), "
                "u < 0 line_loss_3, line_loss_2",
                "pressure": "p1' = bulk_modulus / (V1 + A1 y) (Q1 - A1 y'), "
                "p2' = -bulk_modulus / (V2 - A2 y) (Q2 - A2 y')",
                "friction": "viscous y' + coulomb sgn(y')" + rise_words(v, "sgn(y')", "y'"),
                **{n: v[n] for n in THETA if n in v},
            },
            **({"networks": layers} if layers else {}),
        }

    def derived(
        self, values: Mapping[str, Any], options: HydraulicCylinderOptions
    ) -> Mapping[str, Any]:
        """Resonance on the oil, where it was fitted; see :meth:`Family.derived`."""
        return resonance(values, options) if options.stage == "gray-box" else {}


def _is_gray_box(setup: Setup) -> bool:
    """Decide whether to fit all states: where enough is given and recorded."""
    if setup.options.stage == "flow-balance" or not (setup.machine.complete and setup.both):
        return False
    slow = max(e.sample_time for e in setup.experiments)
    if slow > _SLOWEST and "bulk_modulus" not in setup.request.fixed:
        raise undetermined_error(
            setup.variant.parameter("bulk_modulus"),
            f"the logs are sampled every {slow * 1e3:.3g} ms, too slowly to follow the pressures.",
        )
    return True


def _by_flow_balance(setup: Setup) -> Solution[HydraulicCylinderOptions]:
    """Flow balance over windows, friction beside it."""
    from scipy.linalg import block_diag

    low = free_names(setup.options.stribeck == "estimate", setup.request.fixed)
    first, specs = fit_flow(setup, lenient=False), setup.variant.parameters
    parameters, order, matrix = first.quantities(specs)
    notices = [*first.notices]
    if setup.friction.moving.sum() >= 4:
        friction, warnings = fit_friction(setup)
        more, names, block = friction.quantities(specs)
        parameters, order = {**parameters, **more}, (*order, *names)
        matrix = block_diag(matrix, block)
        notices += warnings
    for spec in specs:
        if spec.name in parameters:
            continue
        if spec.name in setup.request.fixed:
            given = float(setup.request.fixed[spec.name])
            parameters[spec.name] = Quantity(given, spec.unit, "fixed")
        elif spec.name in low or not spec.optional:
            reason = _NEEDS_ALL if spec.name in low else _NEEDS_BOTH
            notices.append(refuse(spec, reason))
            parameters[spec.name] = Quantity(spec.neutral or 0.0, spec.unit, "not_identified")
    notices += [
        Notice(
            "chamber-not-recorded",
            f"no log holds pressure_{i}: the file has no valve gain and line losses of chamber "
            f"{i}. Record that pressure, or repeat the run with the sensor at chamber {i} and "
            "give both logs.",
        )
        for i in (1, 2)
        if i not in setup.chambers
    ]
    gains = directional_gains(setup, {n: q.number for n, q in parameters.items()})
    options = replace(
        setup.options, stage="flow-balance", window=setup.window, rest_position=setup.rest_position
    )
    return make_solution(
        simulate_runs, setup.experiments, setup.variant, options, parameters, order,
        NoiseModel(matrix), derived={**friction_levels(setup), **gains},
        notices=notices,
        details={
            "method": "flow balance over windows",
            "windows": sum(w.first.size for w in setup.windows),
            "covariance": first.details()["covariance"],
        },
    )  # fmt: skip
