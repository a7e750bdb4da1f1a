"""The family ``hydraulic-motor``: roles, parameters, and what its file holds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import Notice, UsageError
from ...estimation.named_map import NamedFit
from ...estimation.named_model import Values, check_form
from ...estimation.noise import white_noise
from ...estimation.response import Response
from ...estimation.response_model import ResponseTask
from ...estimation.results import Solved
from ...estimation.sampled import discretise
from ...estimation.unmodelled_effects import soft_edges
from ...experiment import Experiment, FloatArray, Hold
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
    Solution,
    StaticView,
    Structure,
    UnmodelledEffect,
    Variant,
)
from ...mechanics.local_motion import delayed
from ...specification import quotient_unit
from .block import MotorBlock, MotorCurve
from .equation import edges, static_speed
from .fit import (
    EDGES,
    OFFSET,
    SATURATION,
    STATIC,
    MotorOptions,
    MotorResponse,
    edge_names,
    fit_motor,
    fit_saturated,
    without_saturation,
)
from .static import fit_points

_COMMAND = Role(
    "command", "A", "current or voltage of the valve, or width of a pulse", hold="zoh",
    alternatives=("V", "s", "1"),
)  # fmt: skip
_SPEED = Role(
    "speed", "rad/s", "speed of the motor", output=True, alternatives=("V", "m/s", "m3/s", "1")
)
_WIDENED = 3.0  # standard deviations of the noise of a command by which its play looks wider
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
        (Role("time", "s", "time of each sample"), _COMMAND, output),
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


class HydraulicMotor(MotorResponse, Family[MotorOptions]):
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
    steady_offset = True

    def variants_for(self, options: MotorOptions) -> tuple[Variant, ...]:
        """Settled points, or samples in time of the speed or its integral."""
        return tuple(v for v in self.variants if (v.name == STATIC) == (options.mode == "static"))

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions]
    ) -> Solution[MotorOptions]:
        """Fit curve, hysteresis and lag; see :meth:`Family.estimate`."""
        options, output = request.options, variant.output.name
        _check_options(request)
        task, bend = ResponseTask.of(self, variant, experiments, request), dict[str, float]()
        found: Response[MotorOptions] | NamedFit
        if variant.name == STATIC:
            found = fit_saturated(task, fit_points) or fit_points(without_saturation(task))
            notices = []
        else:
            found, bend = fit_motor(task)
            options = found.settled(options)
            notices = list(_warn_of_noise(found.solved, experiments))
        solved = found.solved
        if SATURATION not in solved.values:
            notices.append(_remark_on_saturation(solved.values, bend))
        unit = experiments[0].units[output]
        unit = unit if output == "speed" else quotient_unit(unit, "s")
        derived = solved.derive(defaultdict(lambda: unit), lambda v: self.derived(v, options))
        return found.solution(self.simulate, experiments, variant, options, derived, notices)

    def unmodelled_effects(self, plant: Plant[MotorOptions]) -> Sequence[UnmodelledEffect]:
        """Soft edges, and beginnings left out on request; see :meth:`Family.unmodelled_effects`."""
        middle, (low, high) = plant.numbers.get(OFFSET, 0.0), edges(plant.numbers)
        soft = soft_edges(plant, "command", (middle + low, middle + high))
        return [soft, *([] if plant.variant.name == STATIC else self.beginnings_left_out(plant))]

    def physics_view(self, plant: Plant[MotorOptions], runs: Runs) -> PhysicsView | None:
        """Settled speed over command, and the curves of a command that rises and falls slowly.

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
        units = runs[0][0].units
        return PhysicsView(
            "Steady speed over command", "command", units["command"], "speed", units["speed"],
            Curve("measured", x, np.concatenate(speeds)),
            _loop(x, v),
        )  # fmt: skip

    def derived(self, values: Values, options: MotorOptions) -> Values:
        """Speed at and beyond the saturation, one for either side; see :meth:`Family.derived`."""
        if SATURATION not in values:
            return {}
        middle, way = np.real(values.get(OFFSET, 0.0)), 2.0 * np.real(values[SATURATION])
        backward, forward = static_speed(middle + way * np.array([-1.0, 1.0]), values)
        if "dead_zone" in values:
            return {"saturation_speed": forward}
        return {"saturation_speed_negative": backward, "saturation_speed_positive": forward}

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
        view = StaticView.over(runs, "command", "speed", ())
        return replace(view, curves=_loop(view.x, plant.numbers))

    def block(self, variant: Variant, document: ParameterDocument) -> MotorCurve:
        """The static curve and its inverse for a controller, and the motion where it is known."""
        return (MotorCurve if variant.name == STATIC else MotorBlock)(document, variant)


def _loop(commands: FloatArray, values: Mapping[str, float]) -> list[Curve]:
    """Steady speed over a command that rises and falls slowly; one curve without hysteresis."""
    line = np.linspace(np.nanmin(commands), np.nanmax(commands), 500)
    half = 0.5 * values["hysteresis"]
    rising = Curve("command rising", line, static_speed(line - half, values))
    falling = Curve("command falling", line[::-1], static_speed(line[::-1] + half, values))
    return [rising, falling] if half else [rising]


def _equation_of(equation: str, values: Mapping[str, float]) -> str:
    """The equation with the dead zone and the offset that the values have."""
    text = equation
    if OFFSET in values:
        text += f" - {OFFSET}"
    if "dead_zone" not in values:
        low, high = EDGES
        text = text.replace("- dead_zone,", f"- ({high} if w > 0 else -{low}),")
    return text


def _check_options(request: Request[MotorOptions]) -> None:
    """Refuse options and numbers that do not go together."""
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
    for name in ("start_state", "offset"):
        if options.mode == "static" and getattr(options, name) is not None:
            raise UsageError(
                f"--{name.replace('_', '-')} means nothing to settled points",
                remedy="Leave out either it or --mode=static.",
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
        f"{n} {x:.3g} instead of {values[n]:.3g}" for n, x in bend.items() if n != SATURATION
    )
    return Notice(
        "saturation-undecided",
        "the logs neither show nor rule out that the speed stops growing at a command of "
        f"{bend[SATURATION]:.3g}; with that saturation the others would be "
        f"{moved}. Raise the command further, rest longer at the highest commands, or give "
        "saturation_command with --fix.",
    )


def _warn_of_noise(fitted: Solved, experiments: Sequence[Experiment]) -> Iterator[Notice]:
    """Say that the hysteresis is too wide where the command turns back with its noise."""
    name = "hysteresis"
    noise = max(white_noise(e.sampled("command"), e.uneven) for e in experiments)
    if name in fitted.names and (shift := _WIDENED * noise) > 2.0 * fitted.std_error(name):
        yield Notice(
            "command-noise",
            f"the command carries noise of about {noise:.2g} rms. The hysteresis takes that for "
            f"motion and comes out wider by about {shift:.2g}, {shift / fitted.std_error(name):.0f}"
            " standard errors. Log the command as the controller gives it.",
        )
