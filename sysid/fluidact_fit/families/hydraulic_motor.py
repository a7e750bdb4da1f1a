"""Hydraulic motor behind a proportional valve: dead zone, saturation, hysteresis, lag.

    w          = play(u, h)                            spool command, hysteresis of width h
    n_0        = sgn(w) g / k (1 - exp(-k x)),  x = min(|w|, u_s) - d, 0 below the dead zone
    tau n' + n = n_0(t - T_d)

with dead zone ``d``, slope ``g`` at its edge, curvature ``k`` (0: a straight line) and saturation
from the command ``u_s`` on. The bend is that of a valve whose pressure drop shrinks as the
flow grows, the sharp end that of a pump or a spool at its stop. The play is that of
magnetisation and friction of the spool: going up the valve opens ``h/2`` later, going down
it closes ``h/2`` later. A motor that breaks away late from rest is no lag: residuals far outside
the others count less (Huber weights).

References
----------
.. [1] J. Watton, Fundamentals of Fluid Power Control, 2012, chapters 3 and 5.
.. [2] M. Krasnoselskii, A. Pokrovskii, Systems with Hysteresis, 1989: the play operator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice, UsageError
from ..estimation.parametric import (
    Fitted,
    NamedModel,
    Refusal,
    Values,
    check_request,
    derive,
    fit_named,
    make_unknowns,
    quantities,
    scalars,
)
from ..estimation.separable import Basis
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

Array = npt.NDArray[Any]
_NAMES = ("dead_zone", "gain", "curvature", "saturation_command", "hysteresis", "time_constant",
          "dead_time")  # fmt: skip
_ROUNDS = 6  # of reweighting


def play(command: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Play of a given width, and its derivative by the width.

    ``w_k = min(max(w_{k-1}, u_k - h/2), u_k + h/2)``, starting at the first command.

    Parameters
    ----------
    command : (n,)
        [unit of the command]
    width
        ``h`` [unit of the command].
    """
    half = 0.5 * width
    out, slope = np.empty(command.size), np.empty(command.size)
    now, by = float(command[0]), 0.0
    for k, u in enumerate(command.tolist()):
        if u - half > now:
            now, by = u - half, -0.5
        elif u + half < now:
            now, by = u + half, 0.5
        out[k], slope[k] = now, by
    return out, slope


def static_speed(spool: Array, values: Values) -> Array:
    """Steady speed over the spool's command, odd about zero.

    Parameters
    ----------
    spool : (n,)
        Command behind the play [unit of the command].
    values
        Dead zone, gain, curvature and, where it was reached, saturation command by name.
    """
    sign = np.where(np.real(spool) >= 0.0, 1.0, -1.0)
    size, top = spool * sign, values.get("saturation_command", np.inf)
    x = np.where(np.real(size) < np.real(top), size, top) - values["dead_zone"]
    x = np.where(np.real(x) > 0.0, x, 0.0)
    k = values["curvature"] + 1e-12  # the limit of a straight line
    return np.asarray(sign * values["gain"] / k * -np.expm1(-k * x))


def lag(target: Array, step: float, time_constant: complex, dead_time: complex) -> Array:
    """First-order lag with dead time of a held target, exact at the samples; from the first value.

    Parameters
    ----------
    target : (n,)
        [any unit]
    step
        Sample time [s].
    time_constant, dead_time
        [s]
    """
    from scipy.signal import lfilter

    whole = int(np.real(dead_time) / step)
    part = dead_time / step - whole
    keep = np.exp(-step / time_constant)
    early = np.exp(-step * (1.0 - part) / time_constant)
    head = np.full(whole + 2, target[0])
    padded = np.concatenate((head, target))
    drive = (1.0 - early) * padded[1 : target.size + 1] + (early - keep) * padded[: target.size]
    if whole == 0 and np.real(part) == 0.0 and not np.iscomplexobj(part):
        drive = (1.0 - keep) * padded[1 : target.size + 1]
    out, _ = lfilter([1.0], [1.0, -keep], drive, zi=np.array([keep * target[0]]))
    return np.asarray(out)


def _columns(e: Experiment, values: Values) -> Basis:
    """Speed of one log, with an offset and the fading initial deviation as local unknowns."""
    width = values["hysteresis"]
    spool, slope = play(e.sampled("command"), float(np.real(width)))
    moved = spool + slope * (width - np.real(width))
    target = static_speed(moved, values)
    tau = values["time_constant"]
    known = lag(target, e.sample_time, tau, values.get("dead_time", 0.0))
    local = np.column_stack((np.ones(e.samples), np.exp(-(e.time - e.time[0]) / tau)))
    return Basis(known, np.zeros((e.samples, 0)), local)


class HydraulicMotor(Family):
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
                    minimum=0.0, any_unit=True,
                    remedy="Record several small commands, going up and coming down.",
                ),
                ParameterSpec(
                    "gain", "rad/s/A", "slope of the speed just beyond the dead zone",
                    minimum=0.0, any_unit=True,
                    remedy="Record three commands or more between dead zone and saturation.",
                ),
                ParameterSpec(
                    "curvature", "1/A", "rate at which the slope falls off with the command",
                    neutral=0.0, minimum=0.0, any_unit=True,
                    remedy="Record three commands or more between dead zone and saturation.",
                ),
                ParameterSpec(
                    "saturation_command", "A", "command from which the speed grows no more",
                    minimum=0.0, any_unit=True, optional=True,
                    remedy="Record commands that rise until the speed grows no more.",
                ),
                ParameterSpec(
                    "hysteresis", "A", "width of the hysteresis, in command", neutral=0.0,
                    minimum=0.0, any_unit=True,
                    remedy="Record the same commands going up and coming down.",
                ),
                ParameterSpec(
                    "time_constant", "s", "time constant of the speed", minimum=1e-9,
                    remedy="Record steps of the command, sampled several times within the rise.",
                ),
                ParameterSpec(
                    "dead_time", "s", "time before the speed begins to change", neutral=0.0,
                    minimum=0.0,
                    remedy="Record sharp steps of the command at a higher sampling rate.",
                ),
            ),
        ),
    )  # fmt: skip
    options = (
        Option("dead-time", "choice", "whether to estimate a dead time", "estimate",
               ("estimate", "none")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit curve, hysteresis and lag; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        used = [_on_grid(e) for e in experiments]
        longest = max(float(np.ptp(e.time)) for e in used)
        if request.fixed.get("dead_time", 0.0) > longest:
            raise UsageError(
                f"--fix dead_time={request.fixed['dead_time']:g} is longer than the logs",
                expected=f"Their longest takes {longest:g} s.",
                remedy="Give the dead time in seconds.",
            )
        if request.options["dead-time"] == "none":
            request = replace(request, fixed={"dead_time": 0.0, **request.fixed})
        notices: list[Notice] = []
        fitted, weights = _fit(variant.parameters, used, request, _NAMES)
        if "saturation_command" not in request.fixed and not _saturates(fitted, used):
            names = tuple(n for n in _NAMES if n != "saturation_command")
            fitted, weights = _fit(variant.parameters, used, request, names)
            notices.append(Notice("saturation-not-reached", "the speed keeps growing to the end "
                           "of the commands: the file has no saturation_command. Raise the "
                           "command until the speed grows no more, if it is needed."))  # fmt: skip
        parameters, order, matrix = quantities(fitted, variant.parameters)
        signals = experiments[0].signals
        units = signals["command"].unit, signals["speed"].unit
        derived = derive(fitted, {"saturation_speed": units[1]}, _saturation_speed)
        counts = [int(np.sum(w < 1.0)) for w in weights]
        return Estimate(
            _with_units(parameters, *units), derived, order, matrix, fitted.solution.simulated,
            [e["speed"] for e in experiments], [*notices, *fitted.notices],
            {**fitted.details(), "offsets": [float(v[0]) for v in fitted.solution.local],
             "samples_of_less_weight": counts},
        )  # fmt: skip

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Speed from command; see :meth:`Family.simulate`."""
        e = _on_grid(experiment)
        b = _columns(e, scalars(parameters))
        if "speed" not in experiment:
            return np.asarray(b.known)
        local = np.linalg.lstsq(b.local, e["speed"] - b.known, rcond=None)[0]
        return np.asarray(b.known + b.local @ local)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The static curve and the lag behind it."""
        v = scalars(parameters)
        names = ("dead_zone", "gain", "curvature", "saturation_command", "hysteresis")
        section: dict[str, Any] = {
            "static": {"equation": self.equation, **{n: v[n] for n in names if n in v}},
            "lag": {"time_constant": v["time_constant"], "dead_time": v.get("dead_time", 0.0)},
        }
        if sample_time > 0.0:
            keep = float(np.exp(-sample_time / v["time_constant"]))
            section["lag"]["discrete"] = {"sample_time": sample_time, "keep": keep}
        return section

    def block(self, variant: Variant, document: Mapping[str, Any]) -> MotorBlock:
        """The static curve and its inverse for a controller."""
        return MotorBlock({n: p["value"] for n, p in document["parameters"].items()})


def _on_grid(e: Experiment) -> Experiment:
    """The log on its even grid; the lag is exact only there.

    Raises
    ------
    LogError
        When the sampling is uneven.
    """
    if e.sample_time <= 0.0:
        raise LogError("the log has no usable time", where=e.name, remedy="Give --sample-time.")
    steps = np.diff(e.time)
    if np.max(np.abs(steps - e.sample_time)) > 0.05 * e.sample_time:
        raise LogError(
            f"sampling is uneven: steps of {steps.min():.4g} to {steps.max():.4g} s",
            where=e.name,
            expected=f"Expected one sample every {e.sample_time:.4g} s.",
            remedy="Use --window to choose an even part, or --sample-time.",
        )
    return e


def _fit(
    specs: Sequence[ParameterSpec],
    experiments: Sequence[Experiment],
    request: Request,
    names: tuple[str, ...],
) -> tuple[Fitted, list[FloatArray]]:
    """Fit with Huber weights: a late break-away must not pass for a slow lag."""
    scales, limits, starts = _sizes(experiments)
    unknowns = make_unknowns(specs, names, scales, request, limits)
    sensible = {
        "dead_zone": 0.3 * scales["saturation_command"],
        "hysteresis": 0.3 * scales["saturation_command"],
        "curvature": 3.0 / scales["saturation_command"],
        "dead_time": limits["dead_time"][1],
    }
    weights = [np.ones(e.samples) for e in experiments]
    begin: Sequence[Mapping[str, float]] = [{**s, **request.start} for s in starts]
    for _ in range(_ROUNDS):
        model = NamedModel(
            names, (), lambda i, values: _columns(experiments[i], values),
            [e["speed"] for e in experiments], weights=weights,
        )  # fmt: skip
        fitted = fit_named(
            model,
            specs,
            request,
            unknowns,
            begin,
            sensible=sensible,
            refusals=_one_way(experiments),
        )
        rest = [e["speed"] - m for e, m in zip(experiments, fitted.solution.simulated)]
        spread = 1.4826 * float(np.median(np.abs(np.concatenate(rest))))
        new = [np.sqrt(np.minimum(1.0, 4.0 * spread / np.maximum(np.abs(r), 1e-300)))
               for r in rest]  # fmt: skip
        change = max(float(np.abs(a - b).max()) for a, b in zip(new, weights))
        weights, begin = new, [fitted.values]
        if change < 0.05:
            break
    return fitted, weights


def _one_way(experiments: Sequence[Experiment]) -> list[Refusal]:
    """Refuse the hysteresis where no log raises and lowers the command by a fair amount.

    Going one way it only shifts the curve, which dead zone and saturation do as well.
    """
    top = max(float(np.abs(e.sampled("command")).max()) for e in experiments)
    for e in experiments:
        u = np.abs(e.sampled("command"))
        up = float(np.max(u - np.minimum.accumulate(u)))
        down = float(np.max(np.maximum.accumulate(u) - u))
        if min(up, down) > 0.25 * top:
            return []
    return [Refusal("hysteresis", "every log moves the command in one direction only.")]


def _saturates(fitted: Fitted, experiments: Sequence[Experiment]) -> bool:
    """Whether the commands go beyond the saturation by more than its uncertainty."""
    if "saturation_command" not in fitted.names:
        return False
    top = max(float(np.abs(e.sampled("command")).max()) for e in experiments)
    reach = top - 0.5 * fitted.values["hysteresis"]
    return (
        fitted.values["saturation_command"] + 2.0 * fitted.std_error("saturation_command") < reach
    )


def _saturation_speed(v: Values) -> dict[str, Any]:
    """Speed at and beyond the saturation, where it was reached."""
    if "saturation_command" not in v:
        return {}
    k = v["curvature"] + 1e-12
    span = v["saturation_command"] - v["dead_zone"]
    return {"saturation_speed": v["gain"] / k * -np.expm1(-k * span)}


def _sizes(
    experiments: Sequence[Experiment],
) -> tuple[dict[str, float], dict[str, tuple[float, float]], list[dict[str, float]]]:
    """Typical sizes, search ranges and starts."""
    top = max(float(np.abs(e.sampled("command")).max()) for e in experiments)
    speed = max(float(np.ptp(e["speed"])) for e in experiments)
    if top == 0.0 or speed == 0.0:
        raise LogError(
            "command or speed does not change in any log",
            remedy="Record a staircase of the command from zero to saturation and back.",
        )
    step = max(e.sample_time for e in experiments)
    span = min(float(np.ptp(e.time)) for e in experiments)
    scales = {
        "dead_zone": 0.1 * top, "gain": 2.0 * speed / top, "saturation_command": top,
        "curvature": 1.0 / top, "hysteresis": 0.05 * top, "time_constant": 3.0 * step,
        "dead_time": step,
    }  # fmt: skip
    limits = {
        "dead_zone": (0.0, 0.5 * top), "gain": (0.1 * speed / top, 100.0 * speed / top),
        "saturation_command": (0.5 * top, top), "curvature": (0.0, 20.0 / top),
        "hysteresis": (0.0, 0.5 * top), "time_constant": (0.1 * step, 0.5 * span),
        "dead_time": (0.0, 20.0 * step),
    }  # fmt: skip
    starts = [
        {
            "dead_zone": 0.05 * top, "gain": gain * speed / top, "curvature": bend / top,
            "saturation_command": 0.93 * top, "hysteresis": 0.03 * top,
            "time_constant": tau * step, "dead_time": 0.5 * step,
        }
        for gain, bend in ((1.2, 0.3), (2.0, 1.5))
        for tau in (2.0, 10.0)
    ]  # fmt: skip
    return scales, limits, starts


def _with_units(
    parameters: Mapping[str, Quantity], command: str, speed: str
) -> dict[str, Quantity]:
    """Units of the log's own command and speed."""
    gain = speed if command == "1" else f"{speed}/{command}"
    units = {
        "dead_zone": command, "saturation_command": command, "hysteresis": command,
        "gain": gain, "curvature": "1" if command == "1" else f"1/{command}",
    }  # fmt: skip
    return {n: replace(q, unit=units.get(n, q.unit)) for n, q in parameters.items()}


class MotorBlock(Block):
    """Static curve of the motor: steady speed for a command, and the command for a speed.

    Attributes
    ----------
    parameters
        Values by name [unit of the file].
    """

    family = "hydraulic-motor"

    def __init__(self, values: Mapping[str, Value]) -> None:
        self.parameters = dict(values)
        self._values = scalars(values)

    def __call__(self, command: npt.ArrayLike, direction: int = 0) -> FloatArray:
        """Steady speed, vectorised.

        Parameters
        ----------
        command
            [unit of the command]
        direction
            1 where the command was last raised, -1 where it was lowered, 0 for the middle of
            the hysteresis.
        """
        u = np.asarray(command, dtype=float)
        shift = 0.5 * np.sign(direction) * self._values["hysteresis"]
        return np.asarray(static_speed(u - shift, self._values))

    def inverse(self, speed: npt.ArrayLike, direction: int = 0) -> FloatArray:
        """Command for a steady speed, vectorised; cut at the saturation.

        Parameters
        ----------
        speed
            [unit of the speed]
        direction
            As when calling; use the sign of the wanted change.
        """
        n, v = np.asarray(speed, dtype=float), self._values
        k = v["curvature"] + 1e-12
        share = np.minimum(np.abs(n) * k / v["gain"], 1.0 - 1e-12)
        size = v["dead_zone"] - np.log1p(-share) / k
        size = np.minimum(size, v.get("saturation_command", np.inf))
        shift = 0.5 * np.sign(direction) * v["hysteresis"]
        return np.asarray(np.where(n == 0.0, 0.0, np.sign(n) * size + shift))
