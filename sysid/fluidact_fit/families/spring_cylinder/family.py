"""Single-acting cylinder with a return spring: equations 1 to 6 of the paper as a gray box.

Linear in all parameters but the Stribeck speed: one regression, robust against load-cell spikes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...errors import Notice, NotIdentifiedError
from ...estimation.named_model import check_request
from ...estimation.stribeck import rise_words, stribeck_specs, with_speed
from ...estimation.uncertainty import model_of_residuals
from ...estimation.unmodelled_effects import change_to
from ...experiment import Experiment, FloatArray, Hold
from ...family import (
    Curve,
    Family,
    NoiseModel,
    ParameterSpec,
    Plant,
    Request,
    Role,
    Runs,
    Simulate,
    Simulated,
    Solution,
    StaticView,
    Structure,
    UnmodelledEffect,
    Variant,
    make_solution,
)
from .block import SpringCylinderBlock
from .data import Run, input_noise, prepare, speeds
from .equation import GAINS, LEVELS, SpringLaw
from .fit import SpringFit, fit_cylinder, settle_levels
from .options import SpringOptions


def _make_variant(drive: Role, gain: ParameterSpec) -> Variant:
    return Variant(
        drive.name,
        (
            Role("time", "s", "time of each sample", required=False),
            drive,
            Role("position", "m", "position of the piston, growing as the spring is compressed",
                 hold="zoh"),
            Role("force", "N", "force of the rod, positive as it pushes out", output=True),
            Role("velocity", "m/s", "velocity; computed from position and time where not given",
                 required=False, hold="zoh"),
            Role("direction", "1", "motion state: 1 loading, -1 (or 2) unloading; held sign of "
                 "the change of command or pressure where not given", required=False, hold="zoh"),
        ),
        (
            gain,
            ParameterSpec("stiffness", "N/m", "stiffness of the return spring", neutral=0.0,
                          minimum=0.0, remedy="Record the force at two positions or more, as far "
                          "apart as the stroke allows."),
            ParameterSpec("preload", "N", "force of the spring at position zero",
                          remedy="Record at two positions or more, in both directions."),
            *(
                ParameterSpec(f"coulomb_{way}", "N", f"friction while {way} (magnitude)",
                              neutral=0.0, minimum=0.0,
                              remedy="Record cycles of the command, up and down over its range; "
                              "where a test machine moves the rod, give --motion-state position.")
                for way in ("loading", "unloading")
            ),
            ParameterSpec("viscous", "N s/m", "viscous friction", neutral=0.0, minimum=0.0,
                          remedy="Record strokes at two speeds or more, the faster the better, "
                          "with time or velocity."),
            *stribeck_specs("N", "m/s"),
        ),
    )  # fmt: skip


class SpringCylinder(Family[SpringOptions]):
    """Single-acting cylinder: pressure gain or area, spring, friction by motion state."""

    name = "spring-cylinder"
    title = "Single-acting cylinder: pressure gain, return spring and hysteresis"
    equation = (
        "force = pressure_gain * command (or area * pressure) - stiffness * position - preload "
        "- coulomb_loading [loading] + coulomb_unloading [unloading] - viscous * velocity "
        "(- direction * stribeck * exp(-velocity^2 / stribeck_speed^2))"
    )
    variants = (
        _make_variant(
            Role("command", "V", "command of the pressure valve", hold="zoh",
                 alternatives=("A", "1")),
            ParameterSpec("pressure_gain", "N/V", "force per command: valve gain times area",
                          minimum=1e-30, ratio=("force", "command"),
                          remedy="Record the force while the command is raised and lowered, with "
                          "the rod held at several positions: one that is free moves with the "
                          "command."),
        ),
        _make_variant(
            Role("pressure", "Pa", "pressure in the chamber, above atmosphere", hold="zoh",
                 gauge=True),
            ParameterSpec("area", "m2", "piston area", minimum=1e-30,
                          remedy="Record the force while the pressure is raised and lowered, with "
                          "the rod held at several positions: one that is free moves with the "
                          "pressure."),
        ),
    )  # fmt: skip
    options_type = SpringOptions
    block_type = SpringCylinderBlock
    structures = (
        Structure("Coulomb friction", {"stribeck": "none"}),
        Structure("Coulomb friction, Stribeck", {"stribeck": "estimate"}),
    )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[SpringOptions]
    ) -> Solution[SpringOptions]:
        """Solve the regression; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        runs, options = prepare(variant, experiments, request.options)
        options = settle_levels(options, request.fixed)
        samples = sum(int(d.kept.sum()) for d in runs)
        least = 2 * sum(not p.optional for p in variant.parameters)
        if samples < least:
            raise NotIdentifiedError(
                f"{samples} samples with a known motion state cannot determine the cylinder.",
                expected=f"At least {least}.",
                remedy="Record cycles of the command, or check --dead-band and --settle.",
            )
        fit = fit_cylinder(variant, runs, replace(request, options=options))
        found, solved = fit.found, fit.solved
        parameters, order, matrix = solved.quantities(variant.parameters, experiments[0].units)
        derived = {}
        if not any(n in solved.refused for n in LEVELS):  # known whatever is assumed of the preload
            derived = solved.derive({"hysteresis_width": "N"}, lambda v: self.derived(v, options))
        settled = replace(options, spike=found.limit)
        noisy = input_noise(variant, runs) if found.instrumented else {}
        nearby = partial(_simulate_nearby, runs, settled)
        stand_in = partial(nearby, instruments=True) if found.instrumented else None
        noise = NoiseModel(matrix, solved.independent, noisy, simulate_instruments=stand_in)
        return make_solution(
            self.simulate, experiments, variant, settled, parameters, order, noise,
            simulate_near=nearby, derived=derived,
            notices=[*fit.notices, *_notices(fit, runs, variant)], covered=_covered(runs),
            details=_details(fit, runs, options.settle),
        )  # fmt: skip

    def derived(self, values: Mapping[str, Any], options: SpringOptions) -> Mapping[str, Any]:
        """Force between the branches; see :meth:`Family.derived`."""
        return {"hysteresis_width": values[LEVELS[0]] + values[LEVELS[1]]}

    def simulate(
        self,
        plant: Plant[SpringOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Force from command or pressure and motion; see :meth:`Family.simulate`."""
        return _simulate(plant, prepare(plant.variant, experiments, plant.options)[0])

    def unmodelled_effects(self, plant: Plant[SpringOptions]) -> Sequence[UnmodelledEffect]:
        """Viscous friction by direction; see :meth:`Family.unmodelled_effects`."""
        return [
            UnmodelledEffect(
                "viscous friction by direction",
                "viscous friction differs between extending and retracting",
                "The value is a mean of both: fit strokes of one direction by themselves "
                "(--window), and look for a seal or a flow that resists one way.",
                partial(_one_way, plant),
                plant.variant.parameter("viscous").unit,
            )
        ]

    def model(self, plant: Plant[SpringOptions], sample_time: float, hold: Hold) -> dict[str, Any]:
        """The force, and its inverse for feed-forward control."""
        drive = plant.variant.name
        gain = GAINS[drive]
        friction = "coulomb_loading*(s>0) - coulomb_unloading*(s<0) + viscous*v"
        friction += rise_words(plant.values, "s")
        return {
            "cylinder": {
                "force": f"{gain}*{drive} - stiffness*x - preload - ({friction})",
                drive: f"(force + stiffness*x + preload + {friction})/{gain}",
                **plant.numbers,
            }
        }

    def static_view(self, plant: Plant[SpringOptions], runs: Runs) -> StaticView:
        """Force over command or pressure, both branches at the outermost positions."""
        data, _ = prepare(plant.variant, [e for e, _ in runs], plant.options)
        drive, force, position = (
            np.concatenate([getattr(d, k) for d in data]) for k in ("drive", "force", "position")
        )
        used = np.concatenate([s.used if s.used is not None else d.kept
                               for (_, s), d in zip(runs, data)])  # fmt: skip
        law = SpringLaw.of(plant.numbers)
        ends = np.array([drive[used].min(), drive[used].max()])
        places = (("low", float(position[used].min())), ("high", float(position[used].max())))
        curves = [
            Curve(f"{way}, {word} position", ends, law.force(ends, x, s, 0.0))
            for word, x in places
            for way, s in (("loading", 1.0), ("unloading", -1.0))
        ]
        fitted = np.concatenate([s.output for _, s in runs])
        name = plant.variant.name
        return StaticView(
            name, runs[0][0].signals[name].unit, "force", "N",
            drive, force, fitted, used, curves,
        )  # fmt: skip


def _one_way(
    plant: Plant[SpringOptions], experiments: Sequence[Experiment], simulate: Simulate
) -> list[dict[str, FloatArray]]:
    """Derivatives of the force by the viscous friction, where the rod extends only."""
    by = 0.01 * abs(plant.numbers["viscous"]) or 1.0
    more = replace(plant, values={**plant.values, "viscous": plant.numbers["viscous"] + by})
    found = change_to(plant, more, by, experiments, simulate)
    return [{role: np.minimum(change, 0.0) for role, change in one.items()} for one in found]


def _simulate(plant: Plant[SpringOptions], runs: Sequence[Run]) -> list[Simulated]:
    """Force of every run, without the samples that are spikes of the load cell.

    Where most of a run is off the law does not hold there, and nothing of it is a spike.
    """
    law, out = SpringLaw.of(with_speed(plant.numbers, speeds(runs))), []
    for d in runs:
        force = d.predict(law)
        spike = np.abs(d.force - force) > (plant.options.spike or np.inf)  # not so where NaN
        if 2 * np.count_nonzero(spike & d.kept) > np.count_nonzero(d.kept):
            spike = np.zeros_like(spike)
        out.append(Simulated(force, d.kept & ~spike))
    return out


def _covered(runs: Sequence[Run]) -> dict[str, tuple[float, float, str]]:
    """Range of the velocity where it was computed from positions [m/s]."""
    if any("velocity" in d.experiment or not d.experiment.time.size for d in runs):
        return {}
    v = speeds(runs)
    return {"velocity": (float(v.min()), float(v.max()), "m/s")}


def _simulate_nearby(
    fitted: Sequence[Run], options: SpringOptions, plant: Plant[SpringOptions],
    experiments: Sequence[Experiment], instruments: bool = False,
) -> list[Simulated]:  # fmt: skip
    """The force of the runs that were ``fitted``, without preparing them again.

    With ``instruments`` in place of noisy columns; see :attr:`.NoiseModel.instruments`.
    """
    known = {id(d.experiment): d for d in fitted}
    runs = [known[id(e)] for e in experiments if id(e) in known]
    if len(runs) < len(experiments) or plant.options != options:
        runs, _ = prepare(plant.variant, experiments, plant.options)
    return _simulate(plant, [d.instrumented for d in runs] if instruments else runs)


_EQUAL = (
    "taken to be equal: force shows preload + coulomb_loading and preload - coulomb_unloading, not "
    "how they share it; --fix preload=N, from a spring scale, tells"
)


def _details(fit: SpringFit, runs: Sequence[Run], settle: float) -> dict[str, Any]:
    """Details of the method, for the file; with the error of each branch."""
    found, order = fit.found, fit.found.uncertainty.order
    residual = np.concatenate(found.residuals)
    state = np.concatenate([d.direction[d.kept] for d in runs])
    branches = {}
    for way, s in (("loading", 1.0), ("unloading", -1.0)):
        own = residual[state == s]
        if own.size:
            branches[way] = {"samples": own.size, "rmse": float(np.sqrt(np.mean(own**2)))}
    return {
        "method": "linear regression, Huber weights"
        + ", neighbours of noisy columns as instruments" * found.instrumented,
        "levels": _EQUAL if fit.equal else "free",
        "robust_scale": found.scale,
        "spikes": found.spikes(),
        "left_out": {
            "unknown_motion_state_or_reversal": sum(int((~d.kept).sum()) for d in runs),
            "share_of_range_after_reversal": settle,
        },
        "branches": branches,
        "covariance": model_of_residuals(order),
    }


def _notices(fit: SpringFit, runs: Sequence[Run], variant: Variant) -> Iterator[Notice]:
    """Samples without weight, and what the levels are of where no pressure was recorded."""
    found, solved = fit.found, fit.solved
    width = sum(abs(solved.values[n]) for n in LEVELS) + 2.0 * solved.values.get("stribeck", 0.0)
    yield from found.spike_notices(width, lambda force: f"{force:.3g} N", "load cell")
    if fit.equal:
        yield Notice(
            "levels-equal",
            "coulomb_loading and coulomb_unloading are taken to be equal: the force shows "
            "preload + coulomb_loading and preload - coulomb_unloading, not how they share it. "
            "Levels that differ, or a load cell whose zero is off, go into preload and both "
            "levels, beyond their intervals; hysteresis_width holds all the same. Give "
            "--fix preload=N where a spring scale shows it.",
        )
    known = [n for n in LEVELS if n in solved.names and solved.values[n] > solved.half_width(n)]
    if variant.name == "command" and known:
        gain = solved.values[GAINS["command"]]
        yield Notice(
            "valve-hysteresis",
            f"{' and '.join(known)} are of valve and cylinder together: a hysteresis of the valve "
            f"({width / gain:.2g} of the command if it is all of it) acts like friction of the "
            "rod. Record the pressure and give --column pressure=HEADER in place of the command: "
            "the levels are then friction alone.",
        )
