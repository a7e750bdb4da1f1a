"""Friction of a cylinder: two Coulomb levels and viscous friction.

    F_f = F_c+ [v > 0] - F_c- [v < 0] + b v
    F_f = F - (A_1 p_1 - A_2 p_2) - m a      with a load cell
    F_f = A_1 p_1 - A_2 p_2 - m a            without: the pressures drive

``F`` is what drives the motion, positive along positive velocity; pressure forces and the
inertia ``m a`` are taken off when the areas and the mass are given. All levels are
magnitudes. The regression sees moving samples only [1]_: near standstill friction is a
matter of presliding and stiction, and a smoothed sign would bias the levels.

A *measured velocity* stands in the equation as it is. Its noise would make ``b`` too small;
the instrument [4]_ in its place is the velocity smoothed over the neighbours of each sample,
without its own reading, whose noise it does not share: ``Z' (F - A x) = 0``.

The *slope of a position* is a weighted mean of the velocity; the force and the sign of the
velocity go through the same mean. Whatever the filter takes off a fast stroke it takes off
its force, so the friction is that of the unfiltered motion, reversals in the window
included. The noise that is left in the slope is taken off the normal equations [3]_, and the
covariance is that of the noise before the filter, carried through it.

Without a second speed in at least one direction, ``b v`` cannot be told from the levels:
``viscous`` is then written as not identified and the levels hold all friction.

References
----------
.. [1] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Nonlinear
   System Identification Benchmarks, 2019: regression on filtered velocity with slow
   samples left out.
.. [2] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 17 to 19: friction levels by direction with a velocity tolerance.
.. [3] W. A. Fuller, Measurement Error Models, 1987, section 1.2: the moment estimator with
   a known variance of the error in the regressor.
.. [4] A. Janot, P.-O. Vandanjon, M. Gautier, "A generic instrumental variable approach for
   industrial robot identification", IEEE Trans. Control Systems Technology 22(1), 2014.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.information import Information
from ..estimation.parametric import check_request, scalars
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Request,
    Role,
    StaticView,
    Value,
    Variant,
)
from .friction.block import FrictionBlock, friction_force
from .friction.fit import LEVELS, Fit
from .friction.options import PRESSURES, Options, motion_role
from .friction.regression import System
from .friction.report import (
    fit_details,
    warn_of_attenuation,
    warn_of_disagreement,
    warn_of_flattening,
    warn_of_spikes,
)
from .friction.samples import (
    SIDES,
    Data,
    check_measured,
    driving_force,
    leave_out_accelerations,
    prepare,
    sides_moved,
)
from .friction.speeds import SECOND_SPEED


def _variant(motion: str, unit: str, time_required: bool, pressures: bool = False) -> Variant:
    """Roles and parameters with velocity or position as the motion, by force or pressures."""
    force = Role(
        "force", "N", "force that drives the motion, positive along positive velocity", output=True
    )
    drive = (
        Role("pressure", "Pa", "pressure that drives positive motion (with --area)", output=True)
        if pressures
        else Role("pressure", "Pa", "pressure whose force is no friction", required=False)
    )
    # with a hold, --step can stand for a pressure of which only the levels are known
    other = Role("pressure_2", "Pa", "pressure of the other chamber", required=False, hold="foh")
    return Variant(
        motion + PRESSURES if pressures else motion,
        (
            Role("time", "s", "time of each sample", required=time_required),
            *(() if pressures else (force,)),
            Role(motion, unit, f"{motion} of the piston"),
            drive,
            other,
        ),
        (
            ParameterSpec(
                "viscous",
                "N s/m",
                "viscous friction",
                neutral=0.0,
                minimum=0.0,
                remedy="Add one stroke, or one log, at another speed in the same direction: "
                f"{SECOND_SPEED:g} times faster or more.",
            ),
            *(
                ParameterSpec(
                    f"coulomb_{s}",
                    "N",
                    f"kinetic friction, {s} direction (magnitude)",
                    neutral=0.0,
                    minimum=0.0,
                    remedy=f"Record at least one stroke in the {s} direction, at steady speed.",
                )
                for s in SIDES
            ),
        ),
    )


class CylinderFriction(Family):
    """Coulomb and viscous friction of a cylinder by regression on moving samples."""

    name = "cylinder-friction"
    title = "Friction of a cylinder: Coulomb levels by direction and viscous friction"
    equation = (
        "force - (area * pressure - area_2 * pressure_2) - mass * acceleration = "
        "coulomb_positive [v > 0] - coulomb_negative [v < 0] + viscous * v; without a force, "
        "area * pressure - area_2 * pressure_2 drives"
    )
    variants = (
        _variant("velocity", "m/s", False),
        _variant("position", "m", True),
        _variant("velocity", "m/s", False, pressures=True),
        _variant("position", "m", True, pressures=True),
    )
    options = (
        Option("area", "float", "piston area that the pressure acts on", unit="m2", minimum=0.0),
        Option("area-2", "float", "area that pressure_2 acts on", unit="m2", minimum=0.0),
        Option("mass", "float", "moving mass, to take inertia off", unit="kg", minimum=0.0),
        Option(
            "filter",
            "float",
            "half-width of the zero-phase velocity filter (default: from the noise)",
            unit="s",
            minimum=0.0,
        ),
        Option(
            "deadband",
            "float",
            "samples slower than this are left out (default: from noise and speed)",
            unit="m/s",
            minimum=0.0,
        ),
        Option(
            "offset",
            "choice",
            "constant offset of the force: estimated where the levels need one, always, or never",
            default="auto",
            choices=("auto", "estimate", "none"),
        ),
    )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit levels and viscous friction; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        options = Options.read(request.options)
        data, half_width, deadband = prepare(variant, experiments, options)
        slow = sum(d.kept.size - int(d.kept.sum()) for d in data)
        sides_moved(data)
        check_measured(data)
        accelerating = 0
        notices: list[Notice] = []
        if options.mass is None:
            data, accelerating, notices = leave_out_accelerations(data)
        fit = Fit(variant, data, request, options)
        notices += [
            *fit.notices,
            *warn_of_spikes(fit),
            *warn_of_disagreement(fit),
            *warn_of_attenuation(fit),
        ]
        notices += warn_of_flattening(fit, variant, experiments, half_width)
        ends = int(sum(d.kept.sum() for d in data) - sum(d.kept.sum() for d in fit.data))
        data = fit.data
        order, matrix = fit.covariance()
        p = scalars({n: q.value for n, q in fit.quantities().items()})
        simulated = [_predict(d, p, fit.log_offset(i), deadband) for i, d in enumerate(data)]
        measured = [np.where(d.kept, d.experiment[variant.output.name], np.nan) for d in data]
        counts = {"slow_or_reversing": slow, "accelerating": accelerating, "stroke_ends": ends}
        details = fit_details(fit, half_width, deadband, counts)
        return Estimate(
            fit.quantities(), fit.derived(), order, matrix, simulated, measured, notices, details
        )

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Force needed for the motion of a log; see :meth:`Family.simulate`.

        Equal levels are levels about an offset of the force, which belongs to the log and
        is then fitted to it.
        """
        chosen = Options.read(options)
        (d,), _, deadband = prepare(variant, [experiment], chosen)
        p = scalars(parameters)
        offset = 0.0
        symmetric = p["coulomb_positive"] == p["coulomb_negative"] > 0.0
        both = all(d.side(s).any() for s in SIDES)
        driven = driving_force(experiment, chosen) is not None
        if driven and symmetric and both and chosen.offset != "none":
            rest = d.friction[d.kept] - friction_force(d.motion.sharp[d.kept], **p)
            offset = 0.5 * float(sum(np.mean(rest[d.side(s)]) for s in SIDES))
        return _predict(d, p, offset, deadband)

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """What a motion would tell; see :meth:`Family.information`.

        The rows are those of the force before any filter, at the samples that a fit would
        keep. Without the mass they are those of steady speed.
        """
        chosen = Options.read(options)
        moved = next(v for v in self.variants if v.name == motion_role(variant))
        chosen = replace(chosen, area=None, area_2=None)
        (d,), _, _ = prepare(moved, [experiment], chosen)
        slope = d.motion.acceleration
        if chosen.mass is None and slope is not None:
            d = replace(d, kept=d.kept & (np.abs(slope) <= 0.01 * float(np.abs(slope).max())))
        names = ("viscous", *LEVELS)
        rows = np.zeros((d.kept.size, len(names)))
        if d.kept.any():
            rows[d.support] = System([d], names, {}, {}).jacobian()
        predicted = friction_force(d.motion.sharp, **scalars(parameters))
        return Information(names, rows, predicted)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The static map for feed-forward compensation."""
        return {
            "friction": {
                "equation": "coulomb_positive*(v>0) - coulomb_negative*(v<0) + viscous*v",
                "input": {"name": "velocity", "unit": "m/s"},
                "output": {"name": "force", "unit": "N"},
                **scalars(parameters),
            }
        }

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Friction over velocity: force less pressure, inertia and offset, and the fitted lines."""
        data, _, _ = prepare(variant, experiments, Options.read(options))
        p = scalars({n: q.value for n, q in estimate.parameters.items()})
        v = np.concatenate([d.motion.sharp for d in data])
        model = friction_force(v, **p)
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        # slow samples are predicted without friction: only what is fitted has its own offset
        friction = np.concatenate([d.friction for d in data])
        drive = np.concatenate([d.known + d.friction for d in data])
        predicted = [d.scale * y for d, y in zip(data, estimate.simulated)]
        rest = drive - np.concatenate(predicted)
        lines = []
        for side, sign in (("positive", 1.0), ("negative", -1.0)):
            speeds = v[used & (v * sign > 0.0)]
            if speeds.size:
                x = np.array([0.0, speeds.max() if sign > 0.0 else speeds.min()])
                level = sign * p[f"coulomb_{side}"]
                lines.append(Curve(f"fitted, {side}", x, level + p["viscous"] * x))
        return StaticView(
            "velocity", "m/s", "friction", "N",
            v, np.where(used, model + rest, friction), model, used, lines,
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> FrictionBlock:
        """The friction map that a controller calls with a velocity."""
        return FrictionBlock({n: p["value"] for n, p in document["parameters"].items()})


def _predict(d: Data, p: Mapping[str, float], offset: float, deadband: float) -> FloatArray:
    """Output that the model predicts at every sample; no friction within the deadband."""
    v = np.where(np.abs(d.motion.velocity) > deadband, d.motion.sharp, 0.0)
    return np.asarray((d.known + friction_force(v, **p) + offset) / d.scale)
