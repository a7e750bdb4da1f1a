"""The family ``hydraulic-motor``: roles, parameters, and what its file holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import Notice, UsageError
from ...estimation.discrete import discretise
from ...estimation.named_model import NamedModel, Values, check_request
from ...estimation.parametric import Fitted
from ...estimation.response import Beginning, Plan, ResponseFit, ResponseModel, fit_robustly
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
    Simulated,
    Solution,
    UnmodelledEffect,
    Variant,
)
from .block import MotorBlock
from .command import command_noise, held_levels
from .equation import MotorModel, play, static_speed
from .fit import SATURATION, MotorOptions, fit_motor, plan_motor, start_motor

_WIDENED = 3.0  # standard deviations of a moving command's noise by which a play looks wider
_SETTLED = 0.005  # of the range of the speed, still to come


class HydraulicMotor(ResponseModel[MotorOptions], Family[MotorOptions]):
    """Static curve with dead zone, saturation and hysteresis, followed by a lag."""

    name = "hydraulic-motor"
    title = "Hydraulic motor: dead zone, saturation, hysteresis and time constant"
    equation = (
        "time_constant speed' + speed = sgn(w) gain / curvature (1 - exp(-curvature x)), "
        "x = min(|w|, saturation_command) - dead_zone, w = play(command(t - dead_time), hysteresis)"
    )
    variants = (
        Variant(
            "hydraulic-motor",
            (
                Role("time", "s", "time of each sample"),
                Role("command", "A", "current or voltage of the valve", hold="zoh",
                     alternatives=("V", "1")),
                Role("speed", "rad/s", "speed of the motor", output=True,
                     alternatives=("V", "m/s", "m3/s", "1")),
            ),
            (
                ParameterSpec(
                    "dead_zone", "A", "command at which the motor begins to turn", neutral=0.0,
                    minimum=0.0, ratio=("command", "1"), curved=True,
                    remedy="Record several small commands, going up and coming down.",
                ),
                ParameterSpec(
                    "gain", "rad/s/A", "slope of the speed just beyond the dead zone",
                    minimum=1e-30, ratio=("speed", "command"),
                    remedy="Record three commands or more between dead zone and saturation.",
                ),
                ParameterSpec(
                    "curvature", "1/A", "rate at which the slope falls off with the command",
                    neutral=0.0, minimum=0.0, ratio=("1", "command"),
                    remedy="Record three commands or more between dead zone and saturation.",
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
        ),
    )  # fmt: skip
    options_type = MotorOptions
    gain, robust, common_offset = "gain", True, False
    steady_offset = True

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions]
    ) -> Solution[MotorOptions]:
        """Fit curve, hysteresis and lag; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        _check_dead_time(experiments, request)
        notices: list[Notice] = []
        noise = request.options.command_noise or command_noise(experiments)
        levels = held_levels(experiments, noise) if noise else None
        logs = levels or experiments
        found, bend = fit_motor(
            ResponseFit.of(self, variant, logs, request),
            ResponseFit.of(
                self, variant, logs, request, plan_motor(logs, request.options, saturated=False)
            ),
        )
        fitted = found.fitted
        if noise and levels is None:
            notices += _warn_of_noise(fitted, noise)
        if SATURATION not in fitted.values:
            notices.append(_remark_on_saturation(fitted, bend))
        settled = replace(found.settled(request.options), command_noise=noise if levels else None)
        unit = experiments[0].units["speed"]
        return found.solution(
            self.simulate, experiments, variant, settled,
            fitted.derive({"saturation_speed": unit}, _saturation_speed), notices,
        )  # fmt: skip

    def plan(self, experiments: Sequence[Experiment], request: Request[MotorOptions]) -> Plan:
        """Everything; see :func:`.fit.fit_motor` for what comes of the saturation."""
        return plan_motor(experiments, request.options, saturated=True)

    def response(
        self, variant: Variant, experiments: Sequence[Experiment], begin: Beginning,
        names: tuple[str, ...],
    ) -> NamedModel:  # fmt: skip
        """The model as the estimation takes it; see :meth:`ResponseModel.response`."""
        return MotorModel(experiments, begin).named(names)

    def fastest(self, values: Values) -> float:
        """The only pole [rad/s]."""
        return 1.0 / float(values["time_constant"])

    def starts(
        self, fit: ResponseFit[MotorOptions], experiments: Sequence[Experiment], begin: Beginning
    ) -> list[dict[str, float]]:
        """Where to begin; see :func:`.fit.start_motor`."""
        return start_motor(fit, experiments, begin)

    def simulate(
        self,
        plant: Plant[MotorOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Speed from command; see :meth:`Family.simulate`."""
        options, noise = plant.options, plant.options.command_noise
        experiments = (held_levels(experiments, noise) if noise else None) or experiments
        out = []
        for e in experiments:
            model = MotorModel([e], options.beginning)
            if "speed" not in e:
                start = offset or 0.0
                out.append(Simulated(model.speed(0, plant.numbers) + start, offset=start))
                continue
            basis = model.columns(0, plant.numbers)
            known = plant.numbers["gain"] * np.asarray(basis.shared[:, 0])
            local = fit_robustly(basis.local, model.measured[0] - known, options.residual_limit)
            output = np.full(e.samples, np.nan)
            output[model.runs[0].unseen :] = known + basis.local @ local
            level = None if options.offset == "none" else float(local[0])
            out.append(Simulated(output, offset=level))
        return out

    def unmodelled_effects(self, plant: Plant[MotorOptions]) -> Sequence[UnmodelledEffect]:
        """Soft edges, and an offset left out on request; see :meth:`Family.unmodelled_effects`."""
        edge = plant.numbers["dead_zone"]
        offset = [output_offset("speed")] if plant.options.offset == "none" else []
        return [soft_edges(plant, "command", (-edge, edge)), *offset]

    def physics_view(
        self,
        plant: Plant[MotorOptions],
        experiments: Sequence[Experiment],
        simulated: Sequence[Simulated],
    ) -> PhysicsView:
        """Settled speed over command, and the loop of play and curve for a slow command."""
        v, commands, speeds = plant.numbers, [], []
        for e, s in zip(experiments, simulated, strict=True):
            late = e.time - v.get("dead_time", 0.0)
            command, source = e.sampled("command"), np.searchsorted(e.time, late, "right") - 1
            commands.append(np.where(source < 0, np.nan, command[np.maximum(source, 0)]))
            rate = np.abs(np.gradient(s.output, e.time)) * v["time_constant"]
            settled = rate <= _SETTLED * float(np.ptp(s.output[np.isfinite(s.output)]))
            speeds.append(np.where(settled, e.sampled("speed") - (s.offset or 0.0), np.nan))
        x = np.concatenate(commands)
        up = np.linspace(np.nanmin(x), np.nanmax(x), 400)
        spool = play(np.concatenate((up[::-1], up, up[::-1])), v.get("hysteresis", 0.0))[0]
        rising, falling = np.split(static_speed(spool, v), 3)[1:]
        units = experiments[0].units
        return PhysicsView(
            "Steady speed over command", "command", units["command"], "speed", units["speed"],
            Curve("measured", x, np.concatenate(speeds)),
            [Curve("command rising", up, rising), Curve("command falling", up[::-1], falling)],
        )  # fmt: skip

    def model(self, plant: Plant[MotorOptions], sample_time: float, hold: Hold) -> dict[str, Any]:
        """The static curve, the lag behind it, and that lag for a speed held between samples."""
        v = plant.numbers
        lag = ("time_constant", "dead_time")
        section: dict[str, Any] = {
            "static": {"equation": self.equation, **{n: v[n] for n in v if n not in lag}},
            "lag": {n: v[n] for n in lag if n in v},
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(
                [1.0], [v["time_constant"], 1.0], sample_time, v.get("dead_time", 0.0)
            )
        return section

    def block(self, variant: Variant, document: ParameterDocument) -> MotorBlock:
        """The static curve and its inverse for a controller."""
        return MotorBlock(document, variant)


def _check_dead_time(experiments: Sequence[Experiment], request: Request[MotorOptions]) -> None:
    """Refuse a dead time longer than the logs."""
    longest = max(float(np.ptp(e.time)) for e in experiments)
    given = request.fixed.get("dead_time", 0.0)
    if given > longest:
        raise UsageError(
            f"--fix dead_time={given:g} is longer than the logs",
            expected=f"Their longest takes {longest:g} s.",
            remedy="Give the dead time in seconds.",
        )


def _remark_on_saturation(fitted: Fitted, bend: Mapping[str, float]) -> Notice:
    """Say that there is no saturation in the file, and whether there could be one."""
    if not bend:
        return Notice(
            "saturation-not-reached",
            "the speed keeps growing to the end of the commands: the file has no "
            "saturation_command. Raise the command until the speed grows no more, if it is needed.",
        )
    moved = ", ".join(
        f"{n} {bend[n]:.3g} instead of {fitted.values[n]:.3g}"
        for n in ("gain", "curvature", "dead_zone")
    )
    return Notice(
        "saturation-undecided",
        "the logs neither show nor rule out that the speed stops growing at a command of "
        f"{bend[SATURATION]:.3g}; with that saturation the others would be "
        f"{moved}. Raise the command further, rest longer at the highest commands, or give "
        "saturation_command with --fix.",
    )


def _warn_of_noise(fitted: Fitted, noise: float) -> Iterator[Notice]:
    """Say that the hysteresis is too wide where noise makes a moving command turn back."""
    name = "hysteresis"
    if name in fitted.names and (shift := _WIDENED * noise) > 2.0 * fitted.std_error(name):
        yield Notice(
            "command-noise",
            f"the command carries noise of about {noise:.2g} rms. The hysteresis takes that for "
            f"motion and comes out wider by about {shift:.2g}, {shift / fitted.std_error(name):.0f}"
            " standard errors. Log the command as the controller gives it, or record one that "
            "rests at levels of several samples: their means are then taken.",
        )


def _saturation_speed(v: Values) -> Values:
    """Speed at and beyond the saturation, where it was reached."""
    if SATURATION not in v:
        return {}
    return {"saturation_speed": static_speed(np.array([np.inf]), v)[0]}
