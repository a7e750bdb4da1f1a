"""The family ``hydraulic-motor``: roles, parameters, and what its file holds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import Notice, UsageError
from ...estimation.named_model import NamedModel, Values, check_form, check_request
from ...estimation.noise import white_noise
from ...estimation.parametric import Fitted
from ...estimation.response_model import Beginning, Plan, ResponseModel, ResponseTask
from ...estimation.robust_weights import fit_robustly
from ...estimation.sampled import discretise
from ...estimation.unmodelled_effects import output_offset, soft_edges
from ...experiment import Experiment, Hold
from ...family import (
    Curve,
    Family,
    ParameterDocument,
    ParameterSpec,
    PhysicsView,
    Plant,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    StaticView,
    Structure,
    UnmodelledEffect,
    Variant,
)
from ...mechanics.local_motion import delayed
from ...specification import quotient_unit
from .block import MotorBlock, MotorCurve
from .equation import MotorModel, edges, play, static_speed
from .fit import (
    EDGES,
    OFFSET,
    SATURATION,
    MotorOptions,
    edge_names,
    fit_motor,
    plan_motor,
    start_motor,
)
from .static import commands, fit_points, law

STATIC = "static"
_COMMAND = Role(
    "command", "A", "current or voltage of the valve, or width of a pulse", hold="zoh",
    alternatives=("V", "s", "1"),
)  # fmt: skip
_SPEED = Role(
    "speed", "rad/s", "speed of the motor", output=True, alternatives=("V", "m/s", "m3/s", "1")
)
_WIDENED = 3.0  # standard deviations of the noise of a command by which its play looks wider
_OTHER_EDGES = (  # where a search is begun again, in parts of the values that it has ended at
    (("hysteresis",), 0.25),
    ((SATURATION,), 0.75),
    (("dead_zone", *EDGES), 1.3),
)
_SETTLED = 0.005  # of the range of the speed, still to come


def _edge(name: str, about: str, low: float, high: float, general: str = "") -> ParameterSpec:
    return ParameterSpec(
        name, "A", about, neutral=0.0, minimum=low, maximum=high, ratio=("command", "1"),
        curved=True, optional=True, general=general,
        remedy="Record several small commands, going up and coming down.",
    )  # fmt: skip


def _curve(rate: tuple[str, ...], unit: str) -> tuple[ParameterSpec, ...]:
    """Parameters of the steady speed, ``rate`` being what its unit is the quotient of."""
    beyond = "Record three commands or more between dead zone and saturation."
    return (
        _edge("dead_zone", "command at which the motor begins to turn", 0.0, np.inf),
        _edge("dead_zone_negative", "command below which the motor turns backward", -np.inf, 0.0),
        _edge("dead_zone_positive", "command above which the motor turns forward", 0.0, np.inf,
              general="dead_zone"),
        ParameterSpec(
            "command_offset", "A", "command from which all others count: the motor stands still",
            ratio=("command", "1"), optional=True,
            remedy="Record commands on both sides of it, or give it: --fix command_offset=VALUE.",
        ),
        ParameterSpec(
            "gain", f"{unit}/A", "slope of the speed just beyond the dead zone",
            minimum=1e-30, ratio=(*rate, "command"), remedy=beyond,
        ),
        ParameterSpec(
            "curvature", "1/A", "rate at which the slope falls off with the command",
            neutral=0.0, minimum=0.0, ratio=("1", "command"), remedy=beyond,
        ),
        ParameterSpec(
            "saturation_command", "A", "command from which the speed grows no more",
            minimum=1e-30, ratio=("command", "1"), optional=True,
            remedy="Record commands that rise until the speed grows no more.",
        ),
        ParameterSpec(
            "hysteresis", "A", "width of the hysteresis, in command", neutral=0.0,
            minimum=0.0, ratio=("command", "1"),
            remedy="Record the same commands going up and coming down.",
        ),
    )  # fmt: skip


def _variant(name: str, output: Role) -> Variant:
    """Roles and parameters of a motor whose speed, or its integral, was logged over time."""
    integral = output.name != "speed"
    rate = (output.name, "s") if integral else (output.name,)
    return Variant(
        name,
        (
            Role("time", "s", "time of each sample"),
            _COMMAND,
            output,
        ),
        (
            *_curve(rate, f"{output.unit}/s" if integral else output.unit),
            ParameterSpec(
                "time_constant", "s", "time constant of the speed", minimum=1e-9,
                remedy="Record steps of the command, sampled several times within the rise.",
            ),
            ParameterSpec(
                "dead_time", "s", "time before the speed begins to change", neutral=0.0,
                minimum=0.0, curved=True,
                remedy="Record sharp steps of the command at a higher sampling rate.",
            ),
        ),
    )  # fmt: skip


class HydraulicMotor(ResponseModel[MotorOptions], Family[MotorOptions]):
    """Static curve with dead zone, saturation and hysteresis, followed by a lag."""

    name = "hydraulic-motor"
    title = "Hydraulic motor: dead zone, saturation, hysteresis and time constant"
    equation = (
        "time_constant speed' + speed = sgn(w) gain / curvature (1 - exp(-curvature x)), "
        "x = min(|w|, saturation_command) - dead_zone, w = play(command(t - dead_time), hysteresis)"
    )
    variants = (
        _variant("hydraulic-motor", _SPEED),
        _variant("angle", Role("angle", "rad", "angle of the motor", output=True,
                 alternatives=("1",))),
        _variant("position", Role("position", "m", "position of what the motor drives",
                 output=True, alternatives=("V", "1"))),
        Variant(
            STATIC,
            (Role("time", "s", "time of each point", required=False), _COMMAND, _SPEED),
            _curve(("speed",), "rad/s"),
            equation="speed = sgn(w) gain / curvature (1 - exp(-curvature x)), "
            "x = min(|w|, saturation_command) - dead_zone, w = play(command, hysteresis)",
        ),
    )  # fmt: skip
    options_type = MotorOptions
    structures = (
        Structure("no hysteresis, no dead time", {"dead-time": "none"}, {"hysteresis": 0.0}),
        Structure("hysteresis", {"dead-time": "none"}),
        Structure("dead time", {"dead-time": "estimate"}, {"hysteresis": 0.0}),
        Structure("hysteresis, dead time", {"dead-time": "estimate"}, instead=True),
    )
    gain, robust, common_offset = "gain", True, False
    steady_offset, many_minima = True, True

    def variants_for(self, options: MotorOptions) -> tuple[Variant, ...]:
        """Settled points, or samples in time of the speed or its integral."""
        return tuple(v for v in self.variants if (v.name == STATIC) == (options.mode == "static"))

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions]
    ) -> Solution[MotorOptions]:
        """Fit curve, hysteresis and lag; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        _check_dead_zone(request)
        if variant.name == STATIC:
            return self._estimate_points(variant, experiments, request)
        plain = plan_motor(experiments, request, saturated=False)
        found, bend = fit_motor(
            ResponseTask.of(self, variant, experiments, request),
            ResponseTask.of(self, variant, experiments, request, plain),
        )
        fitted = found.fitted
        notices = list(_warn_of_noise(fitted, experiments))
        if SATURATION not in fitted.values:
            notices.append(_remark_on_saturation(fitted.values, bend))
        unit = experiments[0].units[variant.output.name]
        if variant.output.name != "speed":
            unit = quotient_unit(unit, "s")
        return found.solution(
            self.simulate, experiments, variant, found.settled(request.options),
            fitted.derive(defaultdict(lambda: unit), _saturation_speeds), notices,
        )  # fmt: skip

    def _estimate_points(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions]
    ) -> Solution[MotorOptions]:
        found = fit_points(variant, experiments, request)
        solved, unit = found.solved, experiments[0].units["speed"]
        notices = [] if SATURATION in solved.values else [_remark_on_saturation({}, {})]
        return found.solution(
            self.simulate, experiments, variant, request.options, notices,
            solved.derive(defaultdict(lambda: unit), _saturation_speeds),
        )  # fmt: skip

    def plan(self, experiments: Sequence[Experiment], request: Request[MotorOptions]) -> Plan:
        """Everything; see :func:`.fit.fit_motor` for what comes of the saturation."""
        return plan_motor(experiments, request, saturated=True)

    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model as the estimation takes it; see :meth:`ResponseModel.response`."""
        return MotorModel(experiments, begin, variant.output.name).named(names)

    def fastest(self, values: Values) -> float:
        """The only pole [rad/s]."""
        return 1.0 / float(values["time_constant"])

    def starts(
        self, task: ResponseTask[MotorOptions], experiments: Sequence[Experiment], begin: Beginning
    ) -> list[dict[str, float]]:
        """Return starts; see :func:`.fit.start_motor`."""
        return start_motor(task, experiments, begin)

    def elsewhere(self, values: Values, step: float) -> list[dict[str, float]]:
        """Other edges: each level of a held command that one of them passes may make a minimum.

        In an angle what is wrong adds up, and minima far from the best are deep.
        """
        return [
            {n: share * values[n] for n in names if n in values}
            for names, share in _OTHER_EDGES
            if any(n in values for n in names)
        ]

    def simulate(
        self,
        plant: Plant[MotorOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Speed from command; see :meth:`Family.simulate`."""
        if plant.variant.name == STATIC:
            return [Simulated(np.real(law(plant.numbers, x))) for x in commands(experiments)]
        out, output, options = [], plant.variant.output.name, plant.options
        for e in experiments:
            model = MotorModel([e], options.beginning, output)
            if output not in e:
                start = offset or 0.0
                out.append(Simulated(model.response(0, plant.numbers) + start, offset=start))
                continue
            basis = model.columns(0, plant.numbers)
            known = plant.numbers["gain"] * np.asarray(basis.shared[:, 0])
            local = fit_robustly(basis.local, model.measured[0] - known, options.residual_limit)
            simulated = np.full(e.samples, np.nan)
            simulated[model.runs[0].unseen :] = known + basis.local @ local
            level = None if options.offset == "none" else float(local[0])
            out.append(Simulated(simulated, offset=level))
        return out

    def unmodelled_effects(self, plant: Plant[MotorOptions]) -> Sequence[UnmodelledEffect]:
        """Soft edges, and an offset left out on request; see :meth:`Family.unmodelled_effects`."""
        middle = plant.numbers.get(OFFSET, 0.0)
        low, high = edges(plant.numbers)
        output = plant.variant.output.name
        offset = [output_offset(output)] if plant.options.offset == "none" else []
        return [soft_edges(plant, "command", (middle + low, middle + high)), *offset]

    def physics_view(self, plant: Plant[MotorOptions], runs: Runs) -> PhysicsView | None:
        """Settled speed over command, and the loop of play and curve for a slow command.

        Nothing where the speed was not recorded, or was steady anyway.
        """
        if plant.variant.output.name != "speed" or plant.variant.name == STATIC:
            return None
        v, commands, speeds = plant.numbers, [], []
        for e, s in runs:
            commands.append(delayed(e.time, e.sampled("command"), v.get("dead_time", 0.0)))
            rate = np.abs(np.gradient(s.output, e.time)) * v["time_constant"]
            settled = rate <= _SETTLED * float(np.ptp(s.output[np.isfinite(s.output)]))
            speeds.append(np.where(settled, e.sampled("speed") - (s.offset or 0.0), np.nan))
        x = np.concatenate(commands)
        up = np.linspace(np.nanmin(x), np.nanmax(x), 400)
        spool = play(np.concatenate((up[::-1], up, up[::-1])), v.get("hysteresis", 0.0))[0]
        rising, falling = np.split(static_speed(spool, v), 3)[1:]
        units = runs[0][0].units
        return PhysicsView(
            "Steady speed over command", "command", units["command"], "speed", units["speed"],
            Curve("measured", x, np.concatenate(speeds)),
            [Curve("command rising", up, rising), Curve("command falling", up[::-1], falling)],
        )  # fmt: skip

    def derived(self, values: Values, options: MotorOptions) -> Values:
        """Speed at and beyond the saturation; see :meth:`Family.derived`."""
        return _saturation_speeds(values)

    def model(self, plant: Plant[MotorOptions], sample_time: float, hold: Hold) -> dict[str, Any]:
        """The static curve, the lag behind it, and that lag for a speed held between samples."""
        v = plant.numbers
        lag = ("time_constant", "dead_time")
        equation = _equation_of(plant.variant.equation or self.equation, v)
        section: dict[str, Any] = {
            "static": {"equation": equation, **{n: v[n] for n in v if n not in lag}},
        }
        if plant.variant.name == STATIC:
            return section
        section["lag"] = {n: v[n] for n in lag if n in v}
        if sample_time > 0.0:
            integral = [0.0] if plant.variant.output.name != "speed" else []
            section["discrete"] = discretise(
                [1.0], [v["time_constant"], 1.0, *integral], sample_time, v.get("dead_time", 0.0)
            )
        return section

    def static_view(self, plant: Plant[MotorOptions], runs: Runs) -> StaticView | None:
        """Speed over command going up and coming down, of settled points."""
        if plant.variant.name != STATIC:
            return None
        u, units = np.concatenate([e.sampled("command") for e, _ in runs]), runs[0][0].units
        speed, v = np.concatenate([e["speed"] for e, _ in runs]), plant.numbers
        line, half = np.linspace(u.min(), u.max(), 500), 0.5 * v["hysteresis"]
        curves = [Curve(label, line, np.real(static_speed(line + shift, v)))
                  for label, shift in (("rising", -half), ("falling", half))]  # fmt: skip
        return StaticView(
            "command", units["command"], "speed", units["speed"], u, speed,
            np.concatenate([s.output for _, s in runs]), np.isfinite(speed),
            curves if half else curves[:1],
        )  # fmt: skip

    def block(self, variant: Variant, document: ParameterDocument) -> MotorCurve:
        """The static curve and its inverse for a controller, and the motion where it is known."""
        return (MotorCurve if variant.name == STATIC else MotorBlock)(document, variant)


def _equation_of(equation: str, values: Mapping[str, float]) -> str:
    """The equation with the dead zone and the offset that the values have."""
    text = equation
    if OFFSET in values:
        text += f" - {OFFSET}"
    if "dead_zone" not in values:
        low, high = EDGES
        text = text.replace("- dead_zone,", f"- ({high} if w > 0 else -{low}),")
    return text


def _check_dead_zone(request: Request[MotorOptions]) -> None:
    """Refuse numbers of the dead zone that do not go together."""
    options, given = request.options, {**request.fixed, **request.start, **request.bounds}
    check_form(given, "dead_zone", edge_names(options), "dead-zone", options.dead_zone)
    free = options.command_offset == "estimate" and OFFSET not in request.fixed
    if options.dead_zone == "asymmetric" and free:
        raise UsageError(
            "--command-offset=estimate and --dead-zone=asymmetric ask for the same: an offset "
            "moves both edges",
            remedy="Leave one of them out, or say from where the edges count: "
            "--fix command_offset=VALUE.",
        )


def _remark_on_saturation(values: Mapping[str, float], bend: Mapping[str, float]) -> Notice:
    """Say that there is no saturation in the file, and whether there could be one."""
    if not bend:
        return Notice(
            "saturation-not-reached",
            "the speed keeps growing to the end of the commands: the file has no "
            "saturation_command. Raise the command until the speed grows no more, if it is needed.",
        )
    moved = ", ".join(
        f"{n} {bend[n]:.3g} instead of {values[n]:.3g}"
        for n in ("gain", "curvature", "dead_zone", *EDGES)
        if n in bend
    )
    return Notice(
        "saturation-undecided",
        "the logs neither show nor rule out that the speed stops growing at a command of "
        f"{bend[SATURATION]:.3g}; with that saturation the others would be "
        f"{moved}. Raise the command further, rest longer at the highest commands, or give "
        "saturation_command with --fix.",
    )


def _warn_of_noise(fitted: Fitted, experiments: Sequence[Experiment]) -> Iterator[Notice]:
    """Say that the hysteresis is too wide where the command turns back with its noise."""
    name, noise = "hysteresis", max(white_noise(e.sampled("command")) for e in experiments)
    if name in fitted.names and (shift := _WIDENED * noise) > 2.0 * fitted.std_error(name):
        yield Notice(
            "command-noise",
            f"the command carries noise of about {noise:.2g} rms. The hysteresis takes that for "
            f"motion and comes out wider by about {shift:.2g}, {shift / fitted.std_error(name):.0f}"
            " standard errors. Log the command as the controller gives it.",
        )


def _saturation_speeds(v: Values) -> Values:
    """Speed at and beyond the saturation, where it was reached; of two edges for either side."""
    if SATURATION not in v:
        return {}
    beyond = np.real(v.get(OFFSET, 0.0)) + 2.0 * np.real(v[SATURATION]) * np.array([-1.0, 1.0])
    backward, forward = static_speed(beyond, v)
    if "dead_zone" in v:
        return {"saturation_speed": forward}
    return {"saturation_speed_negative": backward, "saturation_speed_positive": forward}
