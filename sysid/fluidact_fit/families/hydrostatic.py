"""Hydrostatic transmission: a dead zone in series with a moving mass of fluid.

    m x'' + c x' (+ k x) = DZ(F),   DZ(F) = max(F - F+, 0) + min(F - F-, 0)

A Hammerstein model whose static part has slope one by construction, so that mass and
damping keep their physical meaning. The thesis [1]_ found 53.7 kg and 1720.5 N s/m for two
lines of 2.36 m.

The force is measured while a hand moves it: it goes on moving between samples. Taking it
as held moves the mass by ``-c Ts / 2`` (8.6 kg at 100 Hz), so ``foh`` is the default.
``--method thesis`` reproduces the discrete route of [1]_ for comparison
(:class:`DiscreteRoute`).

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 8 to 10 and figure 18.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..discrete import discretise
from ..errors import LogError, Notice, UsageError
from ..estimation.information import Information, sensitivity
from ..estimation.inputs import PiecewiseInput, apply_dead_zone
from ..estimation.linear import scan
from ..estimation.parametric import (
    Fitted,
    NamedModel,
    Refusal,
    Values,
    bind,
    check_request,
    derive,
    make_unknowns,
    quantities,
    scalars,
)
from ..estimation.separable import Basis, Unknown, solve
from ..estimation.transfer import (
    TransferModel,
    dead_time_axis,
    fit_transfer,
    grid_search,
    simulate_transfer,
    time_scales,
)
from ..experiment import Experiment, FloatArray, Hold
from ..family import Estimate, Family, Option, ParameterSpec, Request, Role, Value, Variant


def realise(values: Values) -> tuple[Any, Any, Any]:
    """State space of ``1/(m s^2 + c s + k)``, position and velocity."""
    m = values["mass"]
    a = np.array([[0.0, 1.0], [-values.get("stiffness", 0.0) / m, -values["damping"] / m]])
    return a, np.array([0.0, 1.0 / m]), np.array([1.0, 0.0])


def _position_is_offset(values: Values) -> tuple[int, ...]:
    """Without a spring the initial position is the same as an offset."""
    return () if np.real(values.get("stiffness", 0.0)) != 0.0 else (0,)


class Hydrostatic(Family):
    """Dead zone followed by mass, damping and an optional spring."""

    name = "hydrostatic"
    title = "Hydrostatic transmission: dead zone, mass and damping"
    equation = "mass x'' + damping x' (+ stiffness x) = dead_zone(force)"
    variants = (
        Variant(
            "hydrostatic",
            (
                Role("time", "s", "time of each sample"),
                Role("force", "N", "force on the master piston", hold="foh"),
                Role("position", "m", "position of the piston", output=True),
            ),
            (
                ParameterSpec(
                    "mass", "kg", "apparent mass of pistons and fluid", minimum=1e-12,
                    remedy="Move faster: the mass shows above damping/mass rad/s. Record the "
                    "force at a higher rate, or fix the mass with --fix mass=...",
                ),
                ParameterSpec(
                    "damping", "N s/m", "viscous damping of the lines", minimum=1e-12,
                    remedy="Record strokes with a force well outside the dead zone.",
                ),
                ParameterSpec(
                    "stiffness", "N/m", "stiffness of a spring at the piston", minimum=0.0,
                    neutral=0.0, optional=True,
                    remedy="Record strokes that stop at several positions.",
                ),
                ParameterSpec(
                    "dead_zone_negative", "N", "force below which the piston moves", maximum=0.0,
                    neutral=0.0,
                    remedy="Record strokes in the negative direction that pass the edge of the "
                    "dead zone slowly, several times.",
                ),
                ParameterSpec(
                    "dead_zone_positive", "N", "force above which the piston moves", minimum=0.0,
                    neutral=0.0,
                    remedy="Record strokes in the positive direction that pass the edge of the "
                    "dead zone slowly, several times.",
                ),
                ParameterSpec(
                    "dead_time", "s", "dead time between force and position", minimum=0.0,
                    neutral=0.0, optional=True,
                    remedy="Record sharp changes of the force at a higher sampling rate.",
                ),
            ),
        ),
    )  # fmt: skip
    options = (
        Option("stiffness", "choice", "whether to estimate a spring", "none",
               ("none", "estimate")),
        Option("dead-time", "choice", "whether to estimate a dead time", "none",
               ("none", "estimate")),
        Option("method", "choice", "output error, or the thesis' discrete route", "output-error",
               ("output-error", "thesis")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit dead zone, mass and damping; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        names = ["mass", "damping", "dead_zone_negative", "dead_zone_positive"]
        for option, name in (("stiffness", "stiffness"), ("dead-time", "dead_time")):
            if request.options[option] == "estimate" or name in request.fixed:
                names.append(name)
        scales, limits, sensible = self._scales(experiments)
        unknowns = make_unknowns(variant.parameters, names, scales, request, limits)
        refusals = _edges_out_of_reach(experiments, request)
        thesis = request.options["method"] == "thesis"
        if thesis and {"stiffness", "dead_time"} & set(names):
            raise UsageError(
                "--method thesis knows neither stiffness nor dead time",
                remedy="Leave out --stiffness and --dead-time, or use --method output-error.",
            )
        if thesis:
            unknowns["integrator_pole"] = Unknown("integrator_pole", 1.0, 0.5, 1.5, 1e-2)
        fitted = fit_transfer(
            (lambda some, rest: DiscreteRoute(some).named(names))
            if thesis
            else (lambda some, rest: self._model(some, rest).named(names)),
            experiments,
            "position",
            variant.parameters,
            request,
            unknowns,
            lambda some, rest: _starts(some, names, rest),
            sensible=sensible,
            refusals=refusals,
        )
        parameters, order, covariance = quantities(fitted, variant.parameters)
        table, drift = fitted.compare_logs(experiments)
        return Estimate(
            parameters,
            _derived(fitted),
            order,
            covariance,
            fitted.solution.simulated,
            [e["position"] for e in experiments],
            [*fitted.notices, *drift, *(_thesis_notice(fitted, experiments) if thesis else ())],
            {
                **fitted.details(),
                **table,
                **({"method": "thesis: discrete route"} if thesis else {}),
            },
            fitted.sensitivity(),
        )

    @staticmethod
    def _scales(
        experiments: Sequence[Experiment],
    ) -> tuple[dict[str, float], dict[str, tuple[float, float]], dict[str, float]]:
        """Typical sizes, search range and the widest useful interval."""
        step, span = time_scales(experiments)
        high = max(float(e["force"].max()) for e in experiments)
        low = min(float(e["force"].min()) for e in experiments)
        speeds = np.concatenate([np.abs(np.gradient(e["position"], e.time)) for e in experiments])
        speed = float(np.quantile(speeds, 0.98))
        force = max(high, -low)
        if force <= 0.0 or speed <= 0.0:
            raise LogError(
                "force or position does not change in any log",
                remedy="Record strokes with a force that moves the piston.",
            )
        damping = force / speed
        scales = {
            "mass": damping * step,
            "damping": damping,
            "dead_zone_negative": force,
            "dead_zone_positive": force,
            "stiffness": damping / span,
            "dead_time": step,
        }
        limits = {
            "mass": (1e-4 * damping * step, 1e3 * damping * span),
            "damping": (1e-4 * damping, 1e4 * damping),
            "dead_zone_negative": (min(low, 0.0), 0.0),
            "dead_zone_positive": (0.0, max(high, 0.0)),
            "dead_time": (0.0, 0.5 * span),
        }
        sensible = {
            "dead_zone_negative": 0.5 * force,
            "dead_zone_positive": 0.5 * force,
            "dead_time": 0.25 * span,
            "stiffness": force / max(float(np.ptp(experiments[0]["position"])), 1e-12),
        }
        return scales, limits, sensible

    @staticmethod
    def _model(experiments: Sequence[Experiment], rest: bool = False) -> TransferModel:
        return TransferModel(
            experiments,
            "force",
            "position",
            realise,
            dead_zone=True,
            confounded=_position_is_offset,
            rest=rest,
        )

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        values = scalars(parameters)
        names = [n for n in values if n != "gain"]
        return sensitivity(self._model([experiment]).named(names), values)

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from force; see :meth:`Family.simulate`."""
        return simulate_transfer(self._model([experiment]), parameters)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Dead zone, continuous transfer function and three discrete ones."""
        v = scalars(parameters)
        num, den = [1.0], [v["mass"], v["damping"], v.get("stiffness", 0.0)]
        dead_time = v.get("dead_time", 0.0)
        section: dict[str, Any] = {
            "input_nonlinearity": {
                "dead_zone_negative": v["dead_zone_negative"],
                "dead_zone_positive": v["dead_zone_positive"],
                "slope": 1.0,
            },
            "continuous": {"numerator": num, "denominator": den, "dead_time": dead_time},
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(num, den, sample_time, "zoh", dead_time)
            section["discrete_foh"] = discretise(num, den, sample_time, "foh", dead_time)
            section["discrete_tustin"] = discretise(num, den, sample_time, "tustin", dead_time)
        return section


class DiscreteRoute:
    """The thesis' discrete model, written in mass and damping.

    ``X(z)/F(z) = b / ((z - q) (1 - a / z))`` with a held force: an output-error model
    with one numerator coefficient and two free poles, of which ``q`` comes out near one
    and is then dropped, brought to continuous time by the bilinear transform:
    ``a = (2 - p T)/(2 + p T)``, ``p = c/m``, ``b = (1 - a) T / c``.
    """

    def __init__(self, experiments: Sequence[Experiment]) -> None:
        self.experiments = experiments

    def columns(self, index: int, values: Values) -> Basis:
        """Position of the discrete model, and the columns of initial speed and offset."""
        e = self.experiments[index]
        step = e.sample_time
        rate = values["damping"] / values["mass"] * step
        a = (2.0 - rate) / (2.0 + rate)
        b = (1.0 - a) * step / values["damping"]
        held = PiecewiseInput(e.time, e["force"][:, None])
        w = apply_dead_zone(held, values["dead_zone_negative"], values["dead_zone_positive"])
        push = b * w.coefficients[:-1, :1] * np.ones(2)
        pole = values["integrator_pole"]
        phi = np.array([[pole, a], [0.0 * a, a]])
        rest = np.zeros(2)
        y = scan(phi, push, rest)[:, 0]
        speed = scan(phi, np.zeros((y.size - 1, 2)), np.array([0.0, 1.0]))[:, 0]
        return Basis(y, np.zeros((y.size, 0)), np.column_stack((speed, np.ones(y.size))))

    def named(self, names: Sequence[str]) -> NamedModel:
        """The model in the form the estimation takes."""
        measured = [e["position"] for e in self.experiments]
        return NamedModel((*names, "integrator_pole"), (), self.columns, measured)


def _thesis_notice(fitted: Fitted, experiments: Sequence[Experiment]) -> list[Notice]:
    """What the discrete route does to the mass, and the standard error it claims."""
    mass = fitted.values["mass"]
    claimed = f" ± {fitted.std_error('mass'):.2g}" if "mass" in fitted.names else ""
    pole = fitted.values["integrator_pole"]
    shift = -0.5 * fitted.values["damping"] * time_scales(experiments)[0]
    return [
        Notice(
            "thesis-method",
            f"the discrete route gives a mass of {mass:.4g}{claimed} kg and a pole at "
            f"{pole:.6g} that it takes for one. It holds only for one numerator coefficient at a "
            "delay of one sample, where the errors of the held force "
            f"({shift:+.3g} kg) and of the bilinear transform cancel; every further coefficient "
            "brings that shift back into the mass. Use --method output-error (the default).",
        )
    ]


def _edges_out_of_reach(experiments: Sequence[Experiment], request: Request) -> list[Refusal]:
    """Edges on a side to which the force never goes."""
    high = max(float(e["force"].max()) for e in experiments)
    low = min(float(e["force"].min()) for e in experiments)
    scale = max(high, -low)
    out = []
    for name, reach, word in (
        ("dead_zone_negative", -low, "negative"),
        ("dead_zone_positive", high, "positive"),
    ):
        if reach <= 1e-3 * scale and name not in request.fixed:
            edge = 0.0 if reach <= 0.0 else reach
            hold = -edge if word == "negative" else edge
            reason = (
                f"the force stays between {low:.3g} and {high:.3g} N: never on the {word} side."
            )
            out.append(Refusal(name, reason, hold))
    return out


def _realise_per_damping(values: Values) -> tuple[Any, Any, Any]:
    """State space of ``1/(tau s^2 + s + k/c)``: the response per ``1/c`` is linear."""
    tau = values["mass"]
    a = np.array([[0.0, 1.0], [-values.get("stiffness", 0.0) / tau, -1.0 / tau]])
    return a, np.array([0.0, 1.0 / tau]), np.array([1.0, 0.0])


def _starts(
    experiments: Sequence[Experiment], names: Sequence[str], rest: bool
) -> list[dict[str, float]]:
    """Profile over time constant, edges and the rest; ``1/damping`` is eliminated."""
    step, span = time_scales(experiments)
    high = max(float(e["force"].max()) for e in experiments)
    low = min(float(e["force"].min()) for e in experiments)
    shares = np.array([0.04, 0.2, 0.5])
    axes = {
        "mass": np.geomspace(0.5 * step, 0.05 * span, 4),
        "dead_zone_negative": min(low, 0.0) * shares,
        "dead_zone_positive": max(high, 0.0) * shares,
        "stiffness": np.array([0.1, 1.0, 10.0]) * 2.0 * np.pi / span,
    }
    used = [n for n in names if n != "damping"]
    model = TransferModel(
        experiments, "force", "position", _realise_per_damping, gain="mobility",
        dead_zone=True, confounded=_position_is_offset, rest=rest,
    )  # fmt: skip
    unknowns = {n: Unknown(n, 0.0) for n in (*used, "mobility")}
    unknowns["mobility"] = Unknown("mobility", 1.0, 1e-300)
    problem = bind(model.named(used), unknowns, {})
    out = []
    for found in grid_search(
        problem, axes, lambda at: dead_time_axis(step, 8.0 * step, 3.0 * step)
    ):
        eta = np.array([found[n] for n in used])
        damping = 1.0 / max(solve(problem, eta, max_iterations=0).linear[0], 1e-300)
        start = {**found, "damping": damping, "mass": found["mass"] * damping}
        start["integrator_pole"] = 1.0  # only the discrete route has one
        if "stiffness" in found:
            start["stiffness"] = found["stiffness"] * damping
        out.append(start)
    return out


def _derived(fitted: Any) -> Mapping[str, Any]:
    """Time constant, half-width and centre of the dead zone.

    The centre cannot be told from an offset of the load cell, the half-width can.
    """
    units = {
        "time_constant": "s",
        "dead_zone_half_width": "N",
        "dead_zone_centre": "N",
    }
    return derive(
        fitted,
        units,
        lambda v: {
            "time_constant": v["mass"] / v["damping"],
            "dead_zone_half_width": 0.5 * (v["dead_zone_positive"] - v["dead_zone_negative"]),
            "dead_zone_centre": 0.5 * (v["dead_zone_positive"] + v["dead_zone_negative"]),
        },
    )
