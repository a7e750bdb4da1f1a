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
from typing import Any, cast

import numpy as np
import numpy.typing as npt

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
from .force_map import choose_dead_band, motion_state

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


def _spread(e: Experiment, role: str, size: int) -> FloatArray:
    """Values of a role at every sample; a constant or step is spread out."""
    s = e.signals[role]
    if s.values.size == size:
        return s.values
    if not e.time.size:
        return np.full(size, s.values[-1])
    at = np.searchsorted(s.time, e.time, side="right")
    return np.asarray(np.append(s.before, s.values)[at])


def _velocity(e: Experiment, position: FloatArray) -> tuple[FloatArray, bool]:
    """Velocity, its own or from position, and whether there is any [m/s]."""
    if "velocity" in e:
        return _spread(e, "velocity", position.size), True
    if e.time.size < 12 or e.signals["position"].values.size < position.size:
        return np.zeros(position.size), False
    if e.uniform:
        return smooth(position, e.sample_time, 5).rate, True
    return np.asarray(np.gradient(position, e.time)), True


def _prepare_log(e: Experiment, variant: Variant, options: Mapping[str, Any]) -> _Log:
    size = int(e.time.size) or max(s.values.size for s in e.signals.values())
    drive = _spread(e, variant.name, size)
    position = _spread(e, "position", size)
    velocity, _ = _velocity(e, position)
    direction = _direction(e, drive, position, options)
    force = _spread(e, "force", size) if "force" in e else np.full(size, np.nan)
    kept = direction != 0.0
    kept &= _away_from_reversals(drive, direction, float(options.get("settle") or 0.0))
    return _Log(e, drive, position, velocity, direction, force, kept)


def _direction(
    e: Experiment, drive: FloatArray, position: FloatArray, options: Mapping[str, Any]
) -> FloatArray:
    """Motion state of each sample, 0 where it is not yet known."""
    source = options.get("motion-state") or "auto"
    if "direction" in e and source in ("auto", "direction"):
        return motion_state(_spread(e, "direction", drive.size))
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
    last = turned[np.searchsorted(turned, np.arange(drive.size), side="right") - 1]
    first = last == 0  # the record's start is no reversal
    return np.asarray(first | (np.abs(drive - drive[last]) >= settle * float(np.ptp(drive))))


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
    """A parameter that came out impossible, or with an interval that says nothing."""
    quantile = t_quantile(0.975, found.uncertainty.degrees)
    for name in found.names:
        value, half = found.values[name], quantile * float(np.sqrt(found.variance(name)))
        minimum = 0.0 if name == "coulomb" else specs[name].minimum
        if not np.isfinite(half):
            return name, "the force does not depend on it anywhere in the logs."
        if value < minimum and value + half < minimum and name != "viscous":
            text = f"it would be {value:.3g}, which is below {minimum:g}: check the signs."
            raise LogError(
                f"{name} comes out negative: {text}",
                where=", ".join(),
                remedy="Give --scale ROLE=-1 for a column of the wrong sign.",
            ) if name in _GAINS.values() else _Impossible(name, text)
        if name in ("preload", "coulomb"):
            continue
        if half > _SENSIBLE * abs(value) and half > 0.0 and name != "viscous":
            return name, f"its 95 % interval would be {value:.3g} ± {half:.2g}."
        if name == "viscous" and (value < 0.0 or half > _SENSIBLE * abs(value)):
            return name, f"its 95 % interval would be {value:.3g} ± {half:.2g}."
    return None


class _Impossible(LogError):
    """Placeholder."""
