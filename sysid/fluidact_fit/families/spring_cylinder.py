"""Single-acting cylinder with a return spring: equations 1 to 6 of the paper as a gray box.

    F   = p A - F_s(x) - F_r                       (1)
    F_s = k x + F_0                                (2)
    p   = k_u u                                    (4)
    F_r = c_l while loading, -c_u while unloading, plus b v

so that ``F = k_F u - k x - F_0 - c_l [s > 0] + c_u [s < 0] - b v`` with the pressure gain
``k_F = k_u A`` [N/V], or the area ``A`` [m2] where the pressure was measured [1]_. ``F`` is
the force of the rod, positive as it pushes out. Linear in all parameters: one regression,
robust against load-cell spikes.

The command for a wanted force is the exact inverse (equation 5)

    u = (F + k x + F_0 + c_l [s > 0] - c_u [s < 0] + b v) / k_F.

Two readings of the print are corrected. Equation 3, ``s = u_j - u_(j-1)``, is taken as the
*held sign* of the change: as a difference it vanishes whenever the command rests, and the
friction with it. The line over ``k_u s_a`` in equation 5 is a division.

Three constants meet two branches: ``F_0``, ``c_l`` and ``c_u`` only show as ``F_0 + c_l`` and
``F_0 - c_u``. Unless the preload (or a level) is given with ``--fix``, the two levels are
taken to be equal.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force
   Control of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis
   Characteristic", Actuators 14, 162, 2025.
.. [2] P. J. Huber, E. Ronchetti, Robust Statistics, 2nd ed., 2009, chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..branches import choose_dead_band, motion_state
from ..errors import LogError, Notice, NotIdentifiedError, UsageError
from ..estimation.parametric import check_request, refuse, scalars
from ..estimation.uncertainty import Uncertainty, covariance, t_quantile
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
    Block,
    Curve,
    Estimate,
    Family,
    Option,
    ParameterSpec,
    Quantity,
    Request,
    Role,
    StaticView,
    Status,
    Value,
    Variant,
)
from ..signals import held_direction, smooth

BoolArray = npt.NDArray[np.bool_]

_LEVELS = ("coulomb_loading", "coulomb_unloading")
_GAINS = {"command": "pressure_gain", "pressure": "area"}
_SETTLED = 0.05  # share of the command's range after a reversal that is left out
_HUBER = 2.5  # threshold in robust standard deviations
_SPIKE = 8.0  # robust standard deviations beyond which a lone sample counts as a spike
_SENSIBLE = 2.0  # interval half-width in values of its own beyond which nothing is known


# ------------------------------------------------------------------------- the equation


def cylinder_force(
    drive: npt.ArrayLike, position: npt.ArrayLike, direction: npt.ArrayLike,
    velocity: npt.ArrayLike, gain: float, stiffness: float, preload: float,
    coulomb_loading: float, coulomb_unloading: float, viscous: float,
) -> FloatArray:  # fmt: skip
    """Force of the rod (equation 6).

    Parameters
    ----------
    drive
        Command [V] or pressure [Pa].
    position
        Compression of the spring beyond its preload [m].
    direction
        Motion state: positive loading, negative unloading, 0 between (no friction).
    velocity
        [m/s]
    gain
        Force per drive [N/V] or area [m2].
    stiffness, preload, coulomb_loading, coulomb_unloading, viscous
        [N/m], [N], [N], [N], [N s/m]
    """
    friction = friction_level(direction, coulomb_loading, coulomb_unloading)
    friction = friction + viscous * np.asarray(velocity, dtype=float)
    spring = stiffness * np.asarray(position, dtype=float) + preload
    return np.asarray(gain * np.asarray(drive, dtype=float) - spring - friction)


def cylinder_command(
    force: npt.ArrayLike, position: npt.ArrayLike, direction: npt.ArrayLike,
    velocity: npt.ArrayLike, gain: float, stiffness: float, preload: float,
    coulomb_loading: float, coulomb_unloading: float, viscous: float,
) -> FloatArray:  # fmt: skip
    """Command or pressure for a wanted force (equation 5), inverse of `cylinder_force`."""
    friction = friction_level(direction, coulomb_loading, coulomb_unloading)
    friction = friction + viscous * np.asarray(velocity, dtype=float)
    spring = stiffness * np.asarray(position, dtype=float) + preload
    return np.asarray((np.asarray(force, dtype=float) + spring + friction) / gain)


def friction_level(direction: npt.ArrayLike, loading: float, unloading: float) -> FloatArray:
    """Coulomb friction by motion state [N]: against the motion, zero where it is unknown."""
    s = np.asarray(direction, dtype=float)
    return np.asarray(loading * (s > 0.0) - unloading * (s < 0.0))


class SpringCylinderBlock(Block):
    """Force of the cylinder, and the command for a wanted force.

    ``direction`` is the motion state: 1 loading, -1 unloading, 0 the middle of both.
    """

    family = "spring-cylinder"

    def __init__(
        self, parameters: Mapping[str, Value],
        validity: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:  # fmt: skip
        self.parameters = dict(parameters)
        self.validity = dict(validity or {})
        self._numbers = _arguments(self.parameters)

    def __call__(
        self, drive: npt.ArrayLike, position: npt.ArrayLike, direction: npt.ArrayLike = 0.0,
        velocity: npt.ArrayLike = 0.0,
    ) -> FloatArray:  # fmt: skip
        """Force [N] at a command [V] or pressure [Pa], position [m] and velocity [m/s]."""
        return cylinder_force(drive, position, direction, velocity, **self._numbers)

    def inverse(
        self, force: npt.ArrayLike, position: npt.ArrayLike, direction: npt.ArrayLike = 0.0,
        velocity: npt.ArrayLike = 0.0,
    ) -> FloatArray:  # fmt: skip
        """Command [V] or pressure [Pa] for a wanted force [N]; exact."""
        return cylinder_command(force, position, direction, velocity, **self._numbers)

    def outside(self, **values: npt.ArrayLike) -> Any:
        """Whether any of the quantities lies outside the range that the data covered."""
        out: Any = False
        for name, value in values.items():
            if name not in self.validity:
                raise UsageError(
                    f"the parameter file holds no range of {name!r}",
                    expected="Ranges it holds: " + (", ".join(self.validity) or "none") + ".",
                )
            low, high = self.validity[name]
            v = np.asarray(value, dtype=float)
            out = out | ~((v >= low) & (v <= high))
        return bool(out) if np.ndim(out) == 0 else out


def _arguments(parameters: Mapping[str, Value]) -> dict[str, float]:
    """Parameters of a file as arguments of the equation."""
    p = scalars(parameters)
    gain = p.pop("area") if "area" in p else p.pop("pressure_gain")
    return {"gain": gain, **p}


# ----------------------------------------------------------------------------- the data


@dataclass(frozen=True)
class _Log:
    """One log, ready for the regression: arrays of shape ``(n,)`` [SI]."""

    experiment: Experiment
    drive: FloatArray
    position: FloatArray
    velocity: FloatArray
    direction: FloatArray
    force: FloatArray
    kept: BoolArray


def _velocity(e: Experiment, position: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Velocity, its own or from position [m/s], and where it can be relied upon."""
    everywhere = np.ones(position.size, dtype=bool)
    if "velocity" in e:
        return e.sampled("velocity"), everywhere
    if e.time.size < 12 or e.signals["position"].values.size < position.size:
        return np.zeros(position.size), everywhere
    if e.uniform:
        motion = smooth(position, e.sample_time, 5)
        return motion.rate, np.asarray(motion.inside)
    return np.asarray(np.gradient(position, e.time)), everywhere


def _prepare_log(e: Experiment, variant: Variant, options: Mapping[str, Any]) -> _Log:
    drive, position = e.sampled(variant.name), e.sampled("position")
    velocity, inside = _velocity(e, position)
    direction = _direction(e, drive, position, options)
    force = e.sampled("force") if "force" in e else np.full(e.samples, np.nan)
    kept = (direction != 0.0) & inside
    kept &= _away_from_reversals(drive, direction, float(options.get("settle") or 0.0))
    return _Log(e, drive, position, velocity, direction, force, kept)


def _direction(
    e: Experiment, drive: FloatArray, position: FloatArray, options: Mapping[str, Any]
) -> FloatArray:
    """Motion state of each sample, 0 where it is not yet known."""
    source = options.get("motion-state") or "auto"
    if "direction" in e and source in ("auto", "direction"):
        return motion_state(e.sampled("direction"))
    if source == "direction":
        raise LogError(
            "the motion state was to come from the log, and there is no 'direction'.",
            where=e.name,
            remedy="Give --column direction=HEADER, or leave --motion-state out.",
        )
    values = position if source == "position" else drive
    band = options.get("dead-band")
    return held_direction(values, choose_dead_band(values) if band is None else band).astype(float)


def _away_from_reversals(drive: FloatArray, direction: FloatArray, settle: float) -> BoolArray:
    """Samples whose friction has changed over: the drive has moved on since the reversal."""
    turned = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1))
    span = float(np.ptp(drive))
    kept = np.ones(drive.size, dtype=bool)
    for begin, end in zip(turned, [*turned[1:], drive.size]):
        if begin:  # the record's start is no reversal
            kept[begin:end] = np.abs(drive[begin:end] - drive[begin]) >= settle * span
        if end < drive.size:  # the dead band notices a reversal late: from the extreme on
            way = direction[begin] or 1.0
            kept[begin + int(np.argmax(way * drive[begin:end])) + 1 : end] = False
    return kept


# ------------------------------------------------------------------------ the regression


@dataclass(frozen=True)
class _Solved:
    """A robust regression: values and names, residuals and weights per log, covariance."""

    names: tuple[str, ...]
    values: dict[str, float]
    residuals: list[FloatArray]
    uncertainty: Uncertainty
    scale: float
    spikes: int

    def variance(self, name: str) -> float:
        k = self.names.index(name)
        return max(float(self.uncertainty.covariance[k, k]), 0.0)


def _column_of(name: str, d: _Log) -> FloatArray:
    """Derivative of the force by a parameter, at the kept samples."""
    s = d.direction[d.kept]
    if name in _GAINS.values():
        return d.drive[d.kept]
    if name == "stiffness":
        return np.asarray(-d.position[d.kept])
    if name == "preload":
        return np.full(s.size, -1.0)
    if name == "coulomb_loading":
        return np.asarray(-(s > 0.0).astype(float))
    if name == "coulomb_unloading":
        return np.asarray((s < 0.0).astype(float))
    if name == "coulomb":
        return np.asarray(-np.sign(s))
    return np.asarray(-d.velocity[d.kept])


def _solve(
    logs: Sequence[_Log], names: tuple[str, ...], held: Mapping[str, float], minimum: float
) -> _Solved:
    """Huber regression by iterated reweighting [2]_; lone spikes get no weight at all."""
    columns = [np.column_stack([_column_of(n, d) for n in names]) for d in logs]
    sides = [
        d.force[d.kept] - sum((v * _column_of(n, d) for n, v in held.items()), np.zeros(1))
        for d in logs
    ]
    a, y = np.vstack(columns), np.concatenate(sides)
    norm = np.linalg.norm(a, axis=0)
    norm[norm == 0.0] = 1.0
    weight, p, scale = np.ones(y.size), np.zeros(len(names)), 0.0
    for _ in range(30):
        root = np.sqrt(weight)[:, None]
        now = np.linalg.lstsq(root * a / norm, root[:, 0] * y, rcond=1e-12)[0] / norm
        r = y - a @ now
        scale = max(1.4826 * float(np.median(np.abs(r))), minimum)
        size = np.abs(r)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-300))
        weight[size > _SPIKE * scale] = 0.0
        done = np.all(np.abs(now - p) <= 1e-10 * (np.abs(now) + scale / norm))
        p = now
        if done:
            break
    lengths = np.cumsum([s.size for s in sides])[:-1]
    root = np.sqrt(weight)
    uncertainty = covariance(
        np.split(root[:, None] * a, lengths), np.split(root * (y - a @ p), lengths),
        robust=all(d.experiment.time.size > 0 for d in logs),
    )  # fmt: skip
    values = {**held, **dict(zip(names, p.tolist()))}
    return _Solved(
        names, values, np.split(y - a @ p, lengths), uncertainty, scale, int((weight == 0.0).sum())
    )


# ------------------------------------------------------------------------- identifiability


@dataclass(frozen=True)
class _Gate:
    """What the data cannot tell, by parameter with the reason, and whether levels are one."""

    refused: dict[str, str]
    equal: bool


def _gate(
    logs: Sequence[_Log], variant: Variant, fixed: Mapping[str, float], options: Mapping[str, Any]
) -> _Gate:
    """Compare what varies in the logs with what each parameter needs."""
    gain = _GAINS[variant.name]
    drive, position, state, speed = (
        np.concatenate([getattr(d, k)[d.kept] for d in logs])
        for k in ("drive", "position", "direction", "velocity")
    )
    refused: dict[str, str] = {}
    if not drive.size or float(np.ptp(drive)) == 0.0:
        refused[gain] = f"the {variant.name} never changes."
    if position.size and float(np.ptp(position)) <= 1e-9 + 1e-6 * float(np.abs(position).max()):
        refused["stiffness"] = "all samples are at one position, where it is part of the preload."
    for name, sign, other in zip(_LEVELS, (1.0, -1.0), ("unloading", "loading")):
        if not np.any(state == sign):
            refused[name] = f"the logs only hold {other}."
    if any(n in refused for n in _LEVELS) and "preload" not in fixed:
        for name in _LEVELS:  # the one level there is cannot be told from the preload
            refused.setdefault(name, "with one direction it is part of the preload.")
    if not _speed_matters(speed):
        refused["viscous"] = "the piston hardly moves in any log."
    refused = {k: v for k, v in refused.items() if k not in fixed}
    levels = options.get("levels") or "auto"
    known = any(n in fixed for n in ("preload", *_LEVELS))
    if levels == "free" and not known:
        raise UsageError(
            "--levels free needs one of the three constants",
            expected="Preload and the two friction levels only show as two branches.",
            remedy="Give --fix preload=N (a spring scale tells it), or leave --levels out.",
        )
    equal = levels == "equal" or (levels == "auto" and not known)
    return _Gate(refused, equal and not any(n in refused or n in fixed for n in _LEVELS))


def _speed_matters(speed: FloatArray) -> bool:
    """Whether the piston moves at all: 1 mm/s or more, for long enough to count."""
    return bool(speed.size) and float(np.quantile(np.abs(speed), 0.9)) > 1e-3


def _regress(
    variant: Variant, logs: Sequence[_Log], request: Request
) -> tuple[_Solved, _Gate, list[Notice]]:
    """Solve, and solve again without what turns out to be undetermined or impossible."""
    specs = {s.name: s for s in variant.parameters}
    gate = _gate(logs, variant, request.fixed, request.options)
    notices = [refuse(specs[n], why) for n, why in gate.refused.items()]
    refused = dict(gate.refused)
    resolution = max(d.experiment.signals["force"].resolution for d in logs) / np.sqrt(12.0)
    while True:
        held = {**dict.fromkeys(refused, 0.0), **dict(request.fixed)}
        free = [n for n in specs if n not in held]
        if gate.equal:
            free = ["coulomb" if n == _LEVELS[0] else n for n in free if n != _LEVELS[1]]
        found = _solve(logs, tuple(free), held, resolution)
        worst = _worst(found, specs)
        if worst is None:
            return found, replace(gate, refused=refused), notices
        name, why = worst
        for each in _LEVELS if name == "coulomb" else (name,):
            notices.append(refuse(specs[each], why))
            refused[each] = why
        gate = replace(gate, equal=gate.equal and name != "coulomb")


def _worst(found: _Solved, specs: Mapping[str, ParameterSpec]) -> tuple[str, str] | None:
    """A parameter whose interval says nothing, or that lies where it cannot."""
    quantile = t_quantile(0.975, found.uncertainty.degrees)
    for name in found.names:
        value, half = found.values[name], quantile * float(np.sqrt(found.variance(name)))
        if not np.isfinite(half):
            return name, "the force does not depend on it anywhere in the logs."
        if name == "preload":  # zero is a value like any other
            continue
        if value + half < 0.0 and name in (*_GAINS.values(), "stiffness"):
            column = "position" if name == "stiffness" else "force"
            raise LogError(
                f"{name} would be {value:.3g} {specs[name].unit}, and it cannot be negative.",
                expected="Expected a rod that pushes harder with more pressure and with a "
                "shorter spring.",
                remedy=f"Check the sign of the {column}: --scale {column}=-1 turns it.",
            )
        if value <= 0.0 or half > _SENSIBLE * abs(value):
            return name, f"its 95 % interval would be {value:.3g} ± {half:.2g}."
    return None


# ----------------------------------------------------------------------------- the result


def _values(found: _Solved, specs: Mapping[str, ParameterSpec]) -> dict[str, float]:
    """All parameters of the file by name."""
    both = found.values.get("coulomb")
    return {
        n: float(both) if both is not None and n in _LEVELS else float(found.values[n])
        for n in specs
    }


def _covariance(
    found: _Solved, specs: Mapping[str, ParameterSpec], held: Sequence[str]
) -> tuple[tuple[str, ...], FloatArray]:
    """Names and covariance of what was estimated; equal levels share one unknown."""
    order = tuple(n for n in specs if n not in held)
    source = ["coulomb" if n in _LEVELS and "coulomb" in found.names else n for n in order]
    rows = [found.names.index(n) for n in source]
    return order, found.uncertainty.covariance[np.ix_(rows, rows)]


def _quantities(
    found: _Solved, specs: Mapping[str, ParameterSpec], fixed: Mapping[str, float],
    refused: Mapping[str, str], unit: Mapping[str, str],
) -> tuple[dict[str, Quantity], tuple[str, ...], FloatArray]:  # fmt: skip
    order, matrix = _covariance(found, specs, [*fixed, *refused])
    quantile = t_quantile(0.975, found.uncertainty.degrees)
    out = {}
    for name, value in _values(found, specs).items():
        if name not in order:
            status: Status = "fixed" if name in fixed else "not_identified"
            out[name] = Quantity(value, unit[name], status)
            continue
        k = order.index(name)
        error = float(np.sqrt(max(matrix[k, k], 0.0)))
        low, high = value - quantile * error, value + quantile * error
        ci = [max(low, specs[name].minimum), high]
        out[name] = Quantity(value, unit[name], "estimated", error, ci, "wald")
    return out, order, matrix


def _derived(
    found: _Solved, values: Mapping[str, float], refused: Mapping[str, str]
) -> dict[str, Quantity]:
    """Width of the hysteresis: known whatever is assumed of the preload."""
    if any(n in refused for n in _LEVELS):
        return {}
    weights = {"coulomb": 2.0, **dict.fromkeys(_LEVELS, 1.0)}
    w = np.array([weights.get(n, 0.0) for n in found.names])
    error = float(np.sqrt(max(float(w @ found.uncertainty.covariance @ w), 0.0)))
    return {"hysteresis_width": Quantity(sum(values[n] for n in _LEVELS), "N", "derived", error)}


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _details(found: _Solved, gate: _Gate, logs: Sequence[_Log], settle: float) -> dict[str, Any]:
    """What was done, for the file; the branches scored apart."""
    residual = np.concatenate(found.residuals)
    state = np.concatenate([d.direction[d.kept] for d in logs])
    order = found.uncertainty.order
    branches = {
        name: {"samples": int((state == s).sum()), "rmse": _rms(residual[state == s])}
        for name, s in (("loading", 1.0), ("unloading", -1.0))
        if (state == s).any()
    }
    return {
        "method": "linear regression, Huber weights",
        "levels": "equal about the preload" if gate.equal else "free",
        "robust_scale": found.scale,
        "spikes": found.spikes,
        "left_out": {
            "unknown_motion_state_or_reversal": int(sum((~d.kept).sum() for d in logs)),
            "share_of_range_after_reversal": settle,
        },
        "branches": branches,
        "covariance": f"autoregressive residuals of order {order}" if order else "white",
    }


def _spike_notice(found: _Solved, samples: int) -> list[Notice]:
    if not found.spikes:
        return []
    return [
        Notice(
            "force-spikes",
            f"{found.spikes} of {samples} samples lie more than {_SPIKE:g} robust standard "
            f"deviations ({_SPIKE * found.scale:.3g} N) off the fit and were given no weight: "
            "spikes of the load cell, or a spring or friction that is not that of the equation. "
            "Look at the plot; `force-map` takes any shape.",
        )
    ]


# ----------------------------------------------------------------------------- the family


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
                              remedy="Record cycles of the command, up and down over its range.")
                for way in ("loading", "unloading")
            ),
            ParameterSpec("viscous", "N s/m", "viscous friction", neutral=0.0, minimum=0.0,
                          remedy="Record strokes at two speeds or more, the faster the better, "
                          "with time or velocity."),
        ),
    )  # fmt: skip


class SpringCylinder(Family):
    """Single-acting cylinder: pressure gain or area, spring, friction by motion state."""

    name = "spring-cylinder"
    title = "Single-acting cylinder: pressure gain, return spring and hysteresis"
    equation = (
        "force = pressure_gain * command (or area * pressure) - stiffness * position - preload "
        "- coulomb_loading [loading] + coulomb_unloading [unloading] - viscous * velocity"
    )
    variants = (
        _make_variant(
            Role("command", "V", "command of the pressure valve", hold="zoh",
                 alternatives=("A", "1")),
            ParameterSpec("pressure_gain", "N/V", "force per command: valve gain times area",
                          minimum=1e-300, any_unit=True,
                          remedy="Record the force while the command is raised and lowered."),
        ),
        _make_variant(
            Role("pressure", "Pa", "pressure in the chamber, above atmosphere", hold="zoh"),
            ParameterSpec("area", "m2", "piston area", minimum=1e-300,
                          remedy="Record the force while the pressure is raised and lowered."),
        ),
    )  # fmt: skip
    options = (
        Option("levels", "choice", "friction levels: equal, free (needs --fix preload=...), or "
               "auto: free where a constant is fixed", default="auto",
               choices=("auto", "equal", "free")),
        Option("motion-state", "choice", "where loading and unloading are told from: a direction "
               "column, the command or pressure, or the position; auto takes the column if there "
               "is one", default="auto", choices=("auto", "direction", "command", "position")),
        Option("dead-band", "float", "change that reverses the motion state, in SI (default: "
               "from the noise)", minimum=0.0),
        Option("settle", "float", "share of the range of command or pressure after a reversal "
               "that is left out, while the seal still creeps", default=_SETTLED, minimum=0.0),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Solve the regression; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        if request.bounds or request.start:
            raise UsageError(
                "a linear regression takes no --start and no --bounds",
                remedy="Give --fix NAME=VALUE for what is known.",
            )
        specs = {s.name: s for s in variant.parameters}
        logs = [_prepare_log(e, variant, request.options) for e in experiments]
        samples = sum(int(d.kept.sum()) for d in logs)
        if samples < 2 * len(specs):
            raise NotIdentifiedError(
                f"{samples} samples with a known motion state cannot determine the cylinder.",
                expected=f"At least {2 * len(specs)}.",
                remedy="Record cycles of the command, or check --dead-band and --settle.",
            )
        found, gate, notices = _regress(variant, logs, request)
        unit = {n: s.unit for n, s in specs.items()}
        drive = experiments[0].signals[variant.name].unit
        if variant.name == "command" and drive != "V":
            unit["pressure_gain"] = "N" if drive == "1" else f"N/{drive}"
        parameters, order, matrix = _quantities(found, specs, request.fixed, gate.refused, unit)
        notices += _spike_notice(found, samples)
        values = _values(found, specs)
        numbers = _arguments(values)
        simulated = [_predict(d, numbers) for d in logs]
        measured = [_measured(d, r, found) for d, r in zip(logs, found.residuals)]
        settle = float(request.options.get("settle") or 0.0)
        return Estimate(
            parameters, _derived(found, values, gate.refused), order, matrix, simulated, measured,
            notices, _details(found, gate, logs, settle),
        )  # fmt: skip

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Force from command or pressure and motion; see :meth:`Family.simulate`."""
        return _predict(_prepare_log(experiment, variant, options), _arguments(parameters))

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The force, and its inverse for feed-forward control."""
        gain = _GAINS[variant.name]
        friction = "coulomb_loading*(s>0) - coulomb_unloading*(s<0) + viscous*v"
        return {
            "cylinder": {
                "force": f"{gain}*{variant.name} - stiffness*x - preload - ({friction})",
                variant.name: f"(force + stiffness*x + preload + {friction})/{gain}",
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
        """Force over command or pressure, both branches at the outermost positions."""
        logs = [_prepare_log(e, variant, options) for e in experiments]
        drive, force, position = (
            np.concatenate([getattr(d, k) for d in logs]) for k in ("drive", "force", "position")
        )
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        numbers = _arguments({n: q.value for n, q in estimate.parameters.items()})
        ends = np.array([drive[used].min(), drive[used].max()])
        places = (("low", float(position[used].min())), ("high", float(position[used].max())))
        curves = [
            Curve(f"{way}, {word} position", ends, cylinder_force(ends, x, s, 0.0, **numbers))
            for word, x in places
            for way, s in (("loading", 1.0), ("unloading", -1.0))
        ]
        return StaticView(
            variant.name, experiments[0].signals[variant.name].unit, "force", "N",
            drive, force, np.concatenate(list(estimate.simulated)), used, curves,
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> SpringCylinderBlock:
        """The force of the cylinder and its exact inverse."""
        ranges = {n: (r["low"], r["high"]) for n, r in (document.get("validity") or {}).items()}
        return SpringCylinderBlock(
            {n: p["value"] for n, p in document["parameters"].items()}, ranges
        )


def _predict(d: _Log, numbers: Mapping[str, float]) -> FloatArray:
    return cylinder_force(d.drive, d.position, d.direction, d.velocity, **numbers)


def _measured(d: _Log, residual: FloatArray, found: _Solved) -> FloatArray:
    """Force of the samples that were fitted, NaN at all others."""
    out = np.full(d.force.size, np.nan)
    out[d.kept] = np.where(np.abs(residual) > _SPIKE * found.scale, np.nan, d.force[d.kept])
    return out
