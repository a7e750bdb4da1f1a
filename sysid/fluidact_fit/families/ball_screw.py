"""Ball-screw (or any) drive: inertia, viscous friction and four Coulomb levels.

    J theta'' = tau - b theta' - F_k(sign theta')       moving
    theta' = 0 while -F_s- <= tau <= F_s+               stuck

Kinetic and static level may differ and both may differ by direction [1]_. A linear axis is
the same with mass, force and position. The motion is solved with events
(:mod:`..estimation.stick_slip`); nothing is smoothed in the estimate.

Three stages: the inverse dynamics by linear least squares on smoothed derivatives, then
increments of position (no drift), then position. A one-shot fit of the position from a
guess ends in a local minimum.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 1 and 7, table 3.
.. [2] A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS",
   Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError, Notice
from ..estimation.information import Information, sensitivity
from ..estimation.inputs import PiecewiseInput, interpolation, piecewise
from ..estimation.linear import Grid, make_grid
from ..estimation.parametric import (
    Fitted,
    NamedModel,
    Refusal,
    Values,
    bind,
    check_request,
    derive,
    fit_named,
    make_unknowns,
    quantities,
    scalars,
)
from ..estimation.separable import Basis, Slopes, Unknown, solve
from ..estimation.stick_slip import Motion, StickSlip, simulate_stick_slip
from ..experiment import Experiment, FloatArray, Hold
from ..family import (
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
from ..signals import smooth

Array = npt.NDArray[Any]
_NEAR = 4  # commanded levels on either side of a bracket that are tried as well
_SIDES = ("positive", "negative")
_LONG = 40_000  # samples beyond which the early stages look at a part of the log


def _variant(name: str, drive: str, drive_unit: str, motion: str, motion_unit: str,
             inertia: str, inertia_unit: str, viscous_unit: str) -> Variant:  # fmt: skip
    """Roles and parameters of the rotary or the linear axis."""
    slow = "Record slow reversals from rest in this direction, several of them."
    return Variant(
        name,
        (
            Role("time", "s", "time of each sample"),
            Role(drive, drive_unit, f"{drive} the drive applies", hold="zoh"),
            Role(motion, motion_unit, f"{motion} of the axis", output=True),
        ),
        (
            ParameterSpec(inertia, inertia_unit, f"{inertia} of everything that moves",
                          minimum=1e-30,
                          remedy="Record quicker accelerations, or a higher sampling rate."),
            ParameterSpec("viscous", viscous_unit, "viscous friction", neutral=0.0, minimum=0.0,
                          optional=True, remedy="Record motion at two clearly different speeds."),
            *(ParameterSpec(f"viscous_{s}", viscous_unit, f"viscous friction, {s} direction",
                            neutral=0.0, minimum=0.0, optional=True,
                            remedy=f"Record motion at two clearly different speeds in the {s} "
                            "direction.") for s in _SIDES),
            *(ParameterSpec(f"coulomb_{s}", drive_unit, f"kinetic friction, {s} direction",
                            neutral=0.0, minimum=0.0,
                            remedy=f"Record motion in the {s} direction.") for s in _SIDES),
            *(ParameterSpec(f"breakaway_{s}", drive_unit, f"static friction, {s} direction",
                            neutral=0.0, minimum=0.0, remedy=slow) for s in _SIDES),
        ),
    )  # fmt: skip


@dataclass(frozen=True)
class _Axis:
    """The names that differ between a rotary and a linear axis."""

    drive: str
    motion: str
    inertia: str


def _axis(variant: Variant) -> _Axis:
    rotary = variant.name == "rotary"
    return _Axis("torque", "angle", "inertia") if rotary else _Axis("force", "position", "mass")


@dataclass(frozen=True)
class Compared:
    """What of the position is compared with the measurement.

    ``lag`` samples: differences over that many samples. ``half_width`` samples: position,
    and besides it the speed and acceleration of a local quadratic of that half-width.
    Neither: position alone.
    """

    lag: int = 0
    half_width: int = 0

    def reduce(self, y: Array) -> Array:
        """Turn positions, shape ``(..., n)``, into the compared rows, last axis."""
        if self.lag:
            return y[..., self.lag :] - y[..., : -self.lag]
        if not self.half_width:
            return y
        windows = np.lib.stride_tricks.sliding_window_view(y, 2 * self.half_width + 1, axis=-1)
        return np.concatenate((y, windows @ self._kernel(1), windows @ self._kernel(2)), axis=-1)

    def _kernel(self, order: int) -> FloatArray:
        offsets = np.arange(-self.half_width, self.half_width + 1)
        return np.linalg.pinv(np.vander(offsets, 3, increasing=True))[order]

    def offset(self, samples: int, rows: int) -> FloatArray:
        """Column of an unknown offset of the position, shape ``(rows, 0 or 1)``."""
        if self.lag:
            return np.zeros((rows, 0))
        column = np.zeros((rows, 1))
        column[:samples] = 1.0
        return column

    def channels(self, samples: int) -> list[slice]:
        """Rows of each compared quantity."""
        if self.lag or not self.half_width:
            return [slice(0, samples - self.lag)]
        inner = samples - 2 * self.half_width
        return [
            slice(0, samples),
            slice(samples, samples + inner),
            slice(samples + inner, samples + 2 * inner),
        ]


class DriveModel:
    """Stick-slip response of one or several logs as a named model.

    Static levels enter as ``stiction_* = breakaway_* - coulomb_* >= 0`` unless a
    ``breakaway_*`` value is given. ``initial_speed[i]`` is a nuisance value of the logs
    that do not start at rest.
    """

    def __init__(
        self, experiments: Sequence[Experiment], axis: _Axis, compared: Compared | None = None
    ) -> None:
        self.axis, self.compared = axis, compared or Compared()
        self.inputs: list[tuple[PiecewiseInput, Grid, npt.NDArray[np.intp]]] = []
        for e in experiments:
            self.inputs.append(_on_samples(piecewise(e.signals[axis.drive]), e.time))
        outputs = [e[axis.motion] for e in experiments if axis.motion in e]
        self.measured = [self.compared.reduce(y) for y in outputs]
        self.resolutions = [
            e.signals[axis.motion].resolution for e in experiments if axis.motion in e
        ]

    def _parameters(self, index: int, values: Values) -> tuple[StickSlip, Array]:
        """Rows of parameters and of the initial speed."""
        rows = {k: np.atleast_1d(v) for k, v in values.items()}
        inertia = rows[self.axis.inertia]
        size = max(v.size for v in rows.values())

        def row(name: str, otherwise: Array | None = None) -> Array:
            value = rows.get(name, otherwise)
            assert value is not None
            return np.broadcast_to(value, (size,))

        static = []
        for s in _SIDES:
            kinetic = row(f"coulomb_{s}")
            if f"breakaway_{s}" in rows:
                given = row(f"breakaway_{s}")
                static.append(np.where(np.real(given) > np.real(kinetic), given, kinetic))
            else:
                static.append(kinetic + row(f"stiction_{s}"))
        forward = row("viscous_positive", rows.get("viscous"))
        backward = row("viscous_negative", rows.get("viscous"))
        p = StickSlip(
            np.broadcast_to(inertia, (size,)), forward, row("coulomb_positive"),
            row("coulomb_negative"), static[0], static[1], backward,
        )  # fmt: skip
        return p, row(f"initial_speed[{index}]", np.zeros(1))

    def motion(self, index: int, values: Values) -> tuple[Motion, npt.NDArray[np.intp]]:
        """Simulated motion of one log and the nodes that are its samples."""
        p, speed = self._parameters(index, values)
        u, grid, samples = self.inputs[index]
        return simulate_stick_slip(p, u, grid, initial_speed=speed), samples

    def _rows(self, index: int, values: Values) -> tuple[Array, int]:
        motion, samples = self.motion(index, values)
        return self.compared.reduce(motion.position[:, samples]), samples.size

    def columns(self, index: int, values: Values) -> Basis:
        """Simulated position and the offset column."""
        y, samples = self._rows(index, values)
        return self._basis(y[0], samples)

    def _basis(self, y: Array, samples: int) -> Basis:
        return Basis(y, np.zeros((y.size, 0)), self.compared.offset(samples, y.size))

    def slopes(self, index: int, values: Values, names: Sequence[str]) -> tuple[Basis, Slopes]:
        """Position with its exact derivatives, all in one pass through the events."""
        p = len(names)
        rows: dict[str, Any] = {}
        steps = np.array([1e-30 * max(abs(float(values[n])), 1e-12) for n in names])
        for name, value in values.items():
            row = np.full(p + 1, complex(value))
            if name in names:
                k = names.index(name)
                row[k] += 1j * steps[k]
            rows[name] = row
        y, samples = self._rows(index, rows)
        basis = self._basis(np.real(y[p]), samples)
        n = basis.known.size
        slopes = np.imag(y[:p]) / steps[:, None]
        local = np.zeros((p, n, basis.local.shape[1]))
        return basis, Slopes(slopes, np.zeros((p, n, 0)), local)

    def named(self, names: Sequence[str], weights: Sequence[FloatArray] = ()) -> NamedModel:
        """The model in the form the estimation takes."""
        return NamedModel(
            tuple(names),
            (),
            self.columns,
            self.measured,
            self.slopes,
            weights,
            resolutions=self.resolutions,
        )


def _on_samples(
    u: PiecewiseInput, time: FloatArray
) -> tuple[PiecewiseInput, Grid, npt.NDArray[np.intp]]:
    """Split the input at the samples, so that every sample is a node."""
    if u.nodes.shape == time.shape and np.array_equal(u.nodes, time):
        return u, make_grid(time), np.arange(time.size)
    nodes = np.union1d(u.nodes, time)
    piece = np.searchsorted(u.nodes, nodes, side="right") - 1
    coefficients = np.where(piece[:, None] >= 0, u.coefficients[np.maximum(piece, 0)], 0.0)
    return PiecewiseInput(nodes, coefficients), make_grid(nodes), np.searchsorted(nodes, time)


class BallScrew(Family):
    """Stick-slip drive with asymmetric kinetic and static friction."""

    name = "ball-screw"
    title = "Ball-screw drive: inertia, viscous friction and four Coulomb levels"
    equation = (
        "inertia * angle'' = torque - viscous * angle' - coulomb(direction), stuck below breakaway"
    )
    variants = (
        _variant("rotary", "torque", "N m", "angle", "rad", "inertia", "kg m2", "N m s/rad"),
        _variant("linear", "force", "N", "position", "m", "mass", "kg", "N s/m"),
    )
    options = (
        Option("viscous", "choice", "one viscous value, or one per direction", "symmetric",
               ("symmetric", "asymmetric")),
    )  # fmt: skip

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Fit inertia and friction in three stages; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        axis = _axis(variant)
        one_sided = request.options["viscous"] == "asymmetric"
        viscous = [f"viscous_{s}" for s in _SIDES] if one_sided else ["viscous"]
        direct = {*request.fixed, *request.bounds}
        static = [
            f"breakaway_{s}" if f"breakaway_{s}" in direct else f"stiction_{s}" for s in _SIDES
        ]
        names = [axis.inertia, *viscous, *(f"coulomb_{s}" for s in _SIDES), *static]
        specs = [*variant.parameters, *_stiction_specs(variant)]
        request.progress("inverse dynamics")
        guess = _inverse_dynamics(experiments, axis, one_sided)
        moving = _initial_speeds(experiments, axis)
        unknowns = self._unknowns(specs, names, guess, moving, request)
        refusals = _sides_at_rest(experiments, axis, viscous)
        start = self._increments(experiments, axis, names, unknowns, guess, request, refusals)
        start = {**start, **moving}
        model = DriveModel(experiments, axis)
        refusals += _without_breakaway(model, start, static, refusals)
        request.progress("fitting positions")
        start, names, request, refusals, brackets = self._static_levels(
            experiments, axis, [*names, *moving], static, unknowns, start, request, refusals
        )
        beyond = _forces_beyond_model(experiments, axis, names, unknowns, start, request, refusals)
        drive = max(float(np.abs(e[axis.drive]).max()) for e in experiments)
        resolution = max(e.signals[axis.motion].resolution for e in experiments)
        sensible = {
            **dict.fromkeys(unknowns, drive),
            **_widths(experiments, axis, drive, viscous),
            axis.inertia: start[axis.inertia],
            **dict.fromkeys(moving, np.inf),
        }
        compared = Compared()
        weights: list[FloatArray] = []
        if beyond:
            compared, weights = self._with_derivatives(
                experiments, axis, names, unknowns, start, request, refusals
            )
        fitted = fit_named(
            DriveModel(experiments, axis, compared).named(names, weights),
            specs,
            request,
            unknowns,
            [start],
            refusals=refusals,
            sensible=sensible,
            sigma_floor=0.0 if compared.half_width else resolution / np.sqrt(12.0),
            channels=[compared.channels(e.samples) for e in experiments],
        )
        fitted = _to_breakaway(fitted)
        table, drift = fitted.compare_logs(experiments)
        parameters, order, covariance = quantities(fitted, variant.parameters)
        for name, bracket in brackets.items():
            parameters[name] = bracket.quantity(parameters[name].unit)
            order = (*order, name)
            covariance = _append_variance(covariance, bracket.std_error**2)
        last = "position, speed and acceleration" if compared.half_width else "position"
        details = {**fitted.details(), **table, "encoder_resolution": resolution,
                   "stages": ["inverse dynamics", "increments", last]}  # fmt: skip
        return Estimate(
            parameters,
            _derived(fitted, axis, variant),
            order,
            covariance,
            [y[: e.samples] for y, e in zip(fitted.solution.simulated, experiments)],
            [e[axis.motion] for e in experiments],
            [
                *_rename_notices(fitted.notices, variant),
                *drift,
                *(_beyond_notice(parameters) if beyond else ()),
            ],
            details,
            fitted.sensitivity(),
        )

    @staticmethod
    def _static_levels(
        experiments: Sequence[Experiment],
        axis: _Axis,
        names: list[str],
        static: Sequence[str],
        unknowns: Mapping[str, Unknown],
        start: dict[str, float],
        request: Request,
        refusals: list[Refusal],
    ) -> tuple[dict[str, float], list[str], Request, list[Refusal], dict[str, _Bracket]]:
        """Bracket the static levels of a drive commanded in steps, when that can be done.

        Once forces beyond the model decide the instant of break-away, no level is left to
        bracket and it is refused.
        """
        nothing: dict[str, _Bracket] = {}
        before = start, names, request, refusals, nothing
        if any(interpolation(e.signals[axis.drive]) != "zoh" for e in experiments):
            return before
        request.progress("bracketing the static levels")
        brackets, refitted = _bracket_static(experiments, axis, start, static, unknowns, refusals)
        if not brackets:
            return before
        held, free, asked = _hold_brackets(brackets, {**start, **refitted}, names, request)
        if _forces_beyond_model(experiments, axis, free, unknowns, held, asked, refusals):
            return start, names, request, [*refusals, *_static_out_of_reach(static, refusals)], {}
        return held, free, asked, refusals, brackets

    @staticmethod
    def _with_derivatives(
        experiments: Sequence[Experiment],
        axis: _Axis,
        names: Sequence[str],
        unknowns: Mapping[str, Unknown],
        start: Mapping[str, float],
        request: Request,
        refusals: Sequence[Refusal],
    ) -> tuple[Compared, list[FloatArray]]:
        """Weights for comparing position, speed and acceleration together.

        Forces the model does not know drift in the position and are small in the
        acceleration; noise does the opposite. Each quantity is weighted by its own
        residual, so that neither the drift of one nor the noise of another decides.
        """
        held = {**{r.parameter: float(r.hold or 0.0) for r in refusals}, **request.fixed}
        request.progress("forces beyond the model: comparing speed and acceleration too")
        compared = Compared(half_width=_window(experiments, start, axis))
        model = DriveModel(experiments, axis, compared)
        parts = [compared.channels(e.samples) for e in experiments]
        plain = bind(model.named(names), unknowns, held)
        eta = np.array([start[u.name] for u in plain.nonlinear])
        now = solve(plain, eta, max_iterations=0)
        weights: list[FloatArray] = []
        raw = now.residuals
        for _ in range(4):
            weights = _balance(raw, parts)
            weighted = bind(model.named(names, weights), unknowns, held)
            now = solve(weighted, eta, max_iterations=15, tolerance=0.02)
            eta = now.eta
            raw = [r / w for r, w in zip(now.residuals, weights)]
        return compared, weights

    @staticmethod
    def _unknowns(
        specs: Sequence[ParameterSpec],
        names: Sequence[str],
        guess: Mapping[str, float],
        moving: Mapping[str, float],
        request: Request,
    ) -> dict[str, Unknown]:
        """Unknowns with a search range of four decades around the linear estimate."""
        limits = {n: (0.0, 1e4 * abs(guess[n])) for n in names}
        limits[names[0]] = (1e-3 * guess[names[0]], 1e3 * guess[names[0]])
        for n in names:
            if n.startswith("viscous"):
                limits[n] = (1e-6 * abs(guess[n]), 1e4 * abs(guess[n]))
        unknowns = make_unknowns(specs, names, guess, request, limits)
        for name, speed in moving.items():
            unknowns[name] = Unknown(name, speed, scale=abs(speed) or 1.0)
        return unknowns

    @staticmethod
    def _increments(
        experiments: Sequence[Experiment],
        axis: _Axis,
        names: Sequence[str],
        unknowns: Mapping[str, Unknown],
        guess: Mapping[str, float],
        request: Request,
        refusals: Sequence[Refusal],
    ) -> dict[str, float]:
        """Second stage: match increments of position from several break-away guesses."""
        request.progress("fitting increments of position")
        lively = sorted(experiments, key=lambda e: -float(np.ptp(e[axis.motion])))[:2]
        part = [_leading(e, _LONG) for e in lively]
        model = DriveModel(part, axis, Compared(lag=_increment_lag(part, axis))).named(names)
        held = {**{r.parameter: float(r.hold or 0.0) for r in refusals}, **request.fixed}
        problem = bind(model, unknowns, held)
        order = [u.name for u in problem.nonlinear]
        best = None
        # a start that the user gives is one more candidate: his guess may be a bad one
        bases = [guess, {**guess, **request.start}] if request.start else [guess]
        for base, up, down in product(bases, (0.05, 0.6), (0.05, 0.6)):
            first = {**base, **held}
            for s, ratio in zip(_SIDES, (up, down)):
                first.setdefault(f"breakaway_{s}", (1 + ratio) * first[f"coulomb_{s}"])
                first[f"stiction_{s}"] = ratio * first[f"coulomb_{s}"]
                if base is not guess and f"breakaway_{s}" in request.start:
                    asked = request.start[f"breakaway_{s}"] - first[f"coulomb_{s}"]
                    first[f"stiction_{s}"] = max(asked, 0.0)
            eta = np.array([first[n] for n in order])
            found = solve(problem, eta, max_iterations=12, tolerance=0.05)
            if best is None or found.cost < best.cost:
                best = found
        assert best is not None
        if not best.converged:
            best = solve(problem, best.eta, max_iterations=30, tolerance=0.05)
        return {**held, **dict(zip(order, map(float, best.eta)))}

    def information(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> Information:
        """Sensitivities by complex steps; see :meth:`Family.information`."""
        values = scalars(parameters)
        axis = _axis(variant)
        model = DriveModel([experiment], axis)
        held = interpolation(experiment.signals[axis.drive]) == "zoh"
        names = [n for n in values if not (held and n.startswith("breakaway"))]
        found = sensitivity(model.named(names), values)
        if not held:
            return found
        motion, samples = model.motion(0, values)
        drive = experiment.sampled(axis.drive)
        speed = np.real(motion.velocity[0, samples])
        return replace(found, floor=_bracket_widths(drive, speed, values))

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Position from the drive's torque or force; see :meth:`Family.simulate`."""
        axis = _axis(variant)
        values: dict[str, Any] = dict(scalars(parameters))
        if axis.motion in experiment:
            values["initial_speed[0]"] = _initial_speeds([experiment], axis).get(
                "initial_speed[0]", 0.0
            )
        model = DriveModel([experiment], axis)
        y = np.real(model.columns(0, values).known)
        if axis.motion in experiment:
            y = y + float(np.mean(experiment[axis.motion] - y))
        return y

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """Linear part of the drive; friction is compensated from the parameters."""
        from ..discrete import discretise

        v = scalars(parameters)
        b = v.get(
            "viscous", 0.5 * (v.get("viscous_positive", 0.0) + v.get("viscous_negative", 0.0))
        )
        num, den = [1.0], [v[_axis(variant).inertia], b, 0.0]
        section: dict[str, Any] = {
            "continuous": {"numerator": num, "denominator": den, "dead_time": 0.0}
        }
        if sample_time > 0.0:
            section["discrete"] = discretise(num, den, sample_time, "zoh")
        return section


def _stiction_specs(variant: Variant) -> list[ParameterSpec]:
    """Specifications of the internal static excess over the kinetic level."""
    return [
        replace(s, name=s.name.replace("breakaway", "stiction"))
        for s in variant.parameters
        if s.name.startswith("breakaway")
    ]


def _leading(experiment: Experiment, samples: int) -> Experiment:
    """The first samples of a log."""
    if experiment.samples <= samples:
        return experiment
    part = slice(0, samples)
    signals = {
        r: replace(s, time=s.time[part], values=s.values[part]) if s.values.size > 1 else s
        for r, s in experiment.signals.items()
    }
    return replace(experiment, time=experiment.time[part], signals=signals)


def _increment_lag(experiments: Sequence[Experiment], axis: _Axis) -> int:
    """Samples over which an increment is well above the encoder's resolution."""
    e = experiments[0]
    y = e[axis.motion]
    resolution = e.signals[axis.motion].resolution
    lag = 1
    while lag < y.size // 100 and np.std(y[lag:] - y[:-lag]) < 10.0 * resolution:
        lag *= 2
    return lag


def _forces_beyond_model(
    experiments: Sequence[Experiment],
    axis: _Axis,
    names: Sequence[str],
    unknowns: Mapping[str, Unknown],
    start: Mapping[str, float],
    request: Request,
    refusals: Sequence[Refusal],
) -> bool:
    """Whether the residual of the position is far above the noise of the encoder.

    While it is not, comparing the position alone is efficient. A residual far above the
    noise comes from forces that the model does not know.
    """
    held = {**{r.parameter: float(r.hold or 0.0) for r in refusals}, **request.fixed}
    problem = bind(DriveModel(experiments, axis).named(names), unknowns, held)
    eta = np.array([start[u.name] for u in problem.nonlinear])
    found = solve(problem, eta, max_iterations=10, tolerance=0.05)
    residual = np.sqrt(found.cost / sum(e.samples for e in experiments))
    return bool(residual > 3.0 * max(_noise_floor(e, axis) for e in experiments))


def _static_out_of_reach(static: Sequence[str], known: Sequence[Refusal]) -> list[Refusal]:
    """Static levels of a drive commanded in steps, when unknown forces decide its start."""
    refused = {r.parameter for r in known}
    reason = (
        "the motion is dominated by forces beyond this model, which move the instant of "
        "break-away more than the static level does."
    )
    return [
        Refusal(name, reason, 0.0)
        for name in static
        if name.startswith("stiction") and name not in refused
    ]


def _noise_floor(experiment: Experiment, axis: _Axis) -> float:
    """Noise of the position that no motion can explain: third differences, or the encoder."""
    y = experiment[axis.motion]
    spread = float(np.sqrt(np.mean(np.diff(y, 3) ** 2) / 20.0)) if y.size > 8 else 0.0
    return max(spread, experiment.signals[axis.motion].resolution / np.sqrt(12.0))


def _window(experiments: Sequence[Experiment], start: Values, axis: _Axis) -> int:
    """Half-width of the window for speed and acceleration, in samples.

    A quarter of the coasting time constant in all: shorter windows look at vibrations
    that a rigid mass does not have, longer ones smear the reversals.
    """
    viscous = start.get("viscous", start.get("viscous_positive", 0.0))
    step = min(e.sample_time for e in experiments)
    shortest = min(e.samples for e in experiments)
    coasting = start[axis.inertia] / max(viscous, 1e-300)
    return int(np.clip(coasting / (8.0 * step), 2, max(shortest // 50, 2)))


def _balance(residuals: Sequence[FloatArray], parts: Sequence[list[slice]]) -> list[FloatArray]:
    """Weights that give every compared quantity a unit residual."""
    sizes = [
        np.sqrt(np.mean(np.concatenate([r[p[k]] for r, p in zip(residuals, parts)]) ** 2))
        for k in range(len(parts[0]))
    ]
    out = []
    for r, p in zip(residuals, parts):
        w = np.ones(r.size)
        for k, rows in enumerate(p):
            w[rows] = 1.0 / max(float(sizes[k]), 1e-300)
        out.append(w)
    return out


def _inverse_dynamics(
    experiments: Sequence[Experiment], axis: _Axis, one_sided: bool
) -> dict[str, float]:
    """First stage: torque regressed on smoothed acceleration, speed and direction.

    The window is the shortest whose residual is within a tenth of the best: longer ones
    smear the reversals, shorter ones drown in the encoder's steps.
    """
    best: tuple[float, FloatArray] | None = None
    for half in (2, 4, 8, 16, 32, 64):
        if any(e.samples < 8 * half for e in experiments) and half > 2:
            break
        rows, drive = [], []
        for e in experiments:
            s = smooth(e[axis.motion], e.sample_time, half)
            u = smooth(e.sampled(axis.drive), e.sample_time, half).value
            fast = float(np.quantile(np.abs(s.rate), 0.99))
            moving = s.inside & (np.abs(s.rate) > 0.12 * fast)
            v, forward = s.rate[moving], s.rate[moving] > 0.0
            columns = [s.curvature[moving], v * forward, v * ~forward]
            if not one_sided:
                columns = [s.curvature[moving], v]
            rows.append(np.column_stack((*columns, forward * 1.0, -1.0 * ~forward)))
            drive.append(u[moving])
        a, tau = np.vstack(rows), np.concatenate(drive)
        if a.shape[0] < 2 * a.shape[1]:
            continue
        x = np.linalg.lstsq(a, tau, rcond=None)[0]
        misfit = float(np.std(tau - a @ x))
        if best is None or (misfit < 0.9 * best[0] and x[0] > 0.0) or best[1][0] <= 0.0:
            best = misfit, x
    if best is None:
        raise LogError(
            f"the {axis.motion} hardly moves in any log",
            remedy="Record motion in both directions, or check --column and --unit.",
        )
    return _as_guess(best[1], experiments, axis, one_sided)


def _as_guess(
    x: FloatArray, experiments: Sequence[Experiment], axis: _Axis, one_sided: bool
) -> dict[str, float]:
    """Linear estimate as a start: positive, and never more than the drive can give."""
    drive = max(float(np.abs(e[axis.drive]).max()) for e in experiments)
    speed = max(float(np.ptp(e[axis.motion]) / np.ptp(e.time)) for e in experiments) or 1.0
    step = min(e.sample_time for e in experiments)
    kinetic = np.clip(x[-2:], 0.02 * drive, 0.9 * drive)
    viscous = np.maximum(x[1:-2], 0.01 * drive / speed)
    inertia = max(x[0], 1e-3 * drive / speed * step)
    guess = {axis.inertia: inertia, **{f"coulomb_{s}": k for s, k in zip(_SIDES, kinetic)}}
    names = [f"viscous_{s}" for s in _SIDES] if one_sided else ["viscous"]
    guess.update(zip(names, viscous))
    guess.update({f"stiction_{s}": 0.2 * k for s, k in zip(_SIDES, kinetic)})
    guess.update({f"breakaway_{s}": 1.2 * k for s, k in zip(_SIDES, kinetic)})
    return {k: float(v) for k, v in guess.items()}


def _initial_speeds(experiments: Sequence[Experiment], axis: _Axis) -> dict[str, float]:
    """Initial speeds of the logs that do not start at rest."""
    out = {}
    for i, e in enumerate(experiments):
        y = e[axis.motion]
        half = min(4, (y.size - 1) // 2)
        head = y[: 2 * half + 1]
        slope = float(np.polyfit(np.arange(head.size) * e.sample_time, head, 1)[0])
        typical = float(np.std(np.gradient(y, e.time))) or 1.0
        noise = max(e.signals[axis.motion].resolution, 1e-300) / (2 * half * e.sample_time)
        if abs(slope) > max(0.2 * typical, 2.0 * noise):
            out[f"initial_speed[{i}]"] = slope
    return out


def _sides_at_rest(
    experiments: Sequence[Experiment], axis: _Axis, viscous: Sequence[str]
) -> list[Refusal]:
    """Friction of a direction in which no log ever moves."""
    travel = dict.fromkeys(_SIDES, 0.0)
    for e in experiments:
        y = e[axis.motion]
        lag = max(1, y.size // 200)
        d = y[lag:] - y[:-lag]
        travel["positive"] = max(travel["positive"], float(d.max()))
        travel["negative"] = max(travel["negative"], float(-d.min()))
    drive = max(float(np.abs(e[axis.drive]).max()) for e in experiments)
    resolution = max(e.signals[axis.motion].resolution for e in experiments)
    largest = max(travel.values())
    out = []
    for s in _SIDES:
        if travel[s] <= max(3.0 * resolution, 0.01 * largest):
            sign = 1.0 if s == "positive" else -1.0
            reach = max(float((sign * e[axis.drive]).max()) for e in experiments)
            unit = experiments[0].signals[axis.drive].unit
            tried = f"at most {reach:.3g} {unit} push that way" if reach > 0.0 else "nothing pushes"
            reason = f"the {axis.motion} never moves in the {s} direction ({tried})."
            out += [
                Refusal(n, reason, 1.5 * drive if "coulomb" in n else 0.0)
                for n in (f"coulomb_{s}", f"stiction_{s}", f"viscous_{s}")
                if not n.startswith("viscous") or n in viscous
            ]
    return out


def _without_breakaway(
    model: DriveModel,
    start: Mapping[str, float],
    static: Sequence[str],
    known: Sequence[Refusal],
) -> list[Refusal]:
    """Static levels of directions in which the axis never breaks away from rest."""
    counts = np.zeros(2, dtype=int)
    for i in range(len(model.inputs)):
        counts += np.array(model.motion(i, start)[0].breakaways)
    refused = {r.parameter for r in known}
    reason = "the axis never breaks away from rest in this direction."
    return [
        Refusal(name, reason, 0.0)
        for name, count in zip(static, counts)
        if count == 0 and name.startswith("stiction") and name not in refused
    ]


@dataclass(frozen=True)
class _Bracket:
    """A static level between the highest torque that held and the lowest that did not."""

    low: float
    high: float

    @property
    def value(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def std_error(self) -> float:
        return (self.high - self.low) / float(np.sqrt(12.0))

    def quantity(self, unit: str) -> Quantity:
        """The level with its bracket as interval."""
        ends = [self.low, self.high]
        return Quantity(self.value, unit, "estimated", self.std_error, ends, "bracket")


def _bracket_static(
    experiments: Sequence[Experiment],
    axis: _Axis,
    start: Mapping[str, float],
    static: Sequence[str],
    unknowns: Mapping[str, Unknown],
    refusals: Sequence[Refusal],
) -> tuple[dict[str, _Bracket], dict[str, float]]:
    """Bracket the static levels of a drive that is commanded in steps.

    A held torque jumps past the static level, so the motion does not depend on where
    between two commanded levels it lies: the cost is a staircase, which a gradient does
    not see. It is searched level by level, the other parameters refitted in between;
    those are returned as well.
    """
    held = {r.parameter: float(r.hold or 0.0) for r in refusals}
    sides = [
        s for s, name in zip(_SIDES, static) if name.startswith("stiction") and name not in held
    ]
    values = {k: v for k, v in start.items() if not k.startswith(("stiction", "breakaway"))}
    for s in _SIDES:
        inner = f"stiction_{s}"
        values[f"breakaway_{s}"] = start.get(
            f"breakaway_{s}", start[f"coulomb_{s}"] + start.get(inner, 0.0)
        )
    part = [_leading(e, _LONG) for e in experiments]
    model = DriveModel(part, axis, Compared(lag=_increment_lag(part, axis)))
    others = [n for n in unknowns if n in values and n not in held and "breakaway" not in n]
    brackets: dict[str, _Bracket] = {}
    seen: list[tuple[float, float]] = []
    for _ in range(4):
        for s in sides:
            near = brackets.get(f"breakaway_{s}")
            brackets[f"breakaway_{s}"] = bracket = _search_level(model, part, axis, values, s, near)
            values[f"breakaway_{s}"] = bracket.value
        fixed = {n: v for n, v in values.items() if n not in others}
        problem = bind(model.named(list(values)), {**unknowns, **_as_unknowns(values)}, fixed)
        eta = np.array([values[u.name] for u in problem.nonlinear])
        found = solve(problem, eta, max_iterations=15, tolerance=0.05)
        values.update(zip((u.name for u in problem.nonlinear), map(float, found.eta)))
        now = [(b.low, b.high) for b in brackets.values()]
        if now == seen:
            break
        seen = now
    values = _narrow(DriveModel(part, axis), part, axis, brackets, values, others, unknowns)
    return brackets, {n: values[n] for n in others}


def _narrow(
    model: DriveModel,
    experiments: Sequence[Experiment],
    axis: _Axis,
    brackets: dict[str, _Bracket],
    values: dict[str, float],
    others: Sequence[str],
    unknowns: Mapping[str, Unknown],
) -> dict[str, float]:
    """Choose among neighbouring brackets by the position itself, all else refitted.

    One break-away a sample late displaces all that follows by less than a step of the
    encoder: increments do not see it, the position does, and it would bend every other
    parameter. ``brackets`` is changed; the refitted values are returned.
    """
    samples = sum(y.size for y in model.measured)
    known = {**unknowns, **_as_unknowns(values)}
    fixed = [n for n in values if n not in others]

    def refit(tried: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        problem = bind(model.named(list(values)), known, {n: tried[n] for n in fixed})
        eta = np.array([tried[u.name] for u in problem.nonlinear])
        found = solve(problem, eta, max_iterations=12, tolerance=0.05)
        order = [u.name for u in problem.nonlinear]
        return found.cost, {**tried, **dict(zip(order, map(float, found.eta)))}

    best, values = refit(values)
    for _ in range(3):
        before = best
        for name, bracket in list(brackets.items()):
            sign = 1.0 if name.endswith("positive") else -1.0
            drive = np.concatenate([sign * e.sampled(axis.drive) for e in experiments])
            levels = np.unique(drive[drive > values[f"coulomb_{name.removeprefix('breakaway_')}"]])
            if levels.size < 2:
                continue
            low = max(int(np.searchsorted(levels, bracket.low)) - _NEAR, 0)
            high = min(int(np.searchsorted(levels, bracket.high)) + _NEAR, levels.size - 1)
            edges = levels[low : high + 1]
            middles = 0.5 * (edges[1:] + edges[:-1])
            plain = np.array([_position_cost(model, {**values, name: x}) for x in middles])
            # cells of the same cost have the same events: one refit stands for all of them
            steps = np.flatnonzero(np.diff(plain) != 0.0) + 1
            groups = np.split(np.arange(middles.size), steps)
            found = [refit({**values, name: float(middles[g[g.size // 2]])}) for g in groups]
            costs = np.array([cost for cost, _ in found])
            k = int(np.argmin(costs))
            if costs[k] >= best:
                costs, k = np.append(costs, best), len(groups)
            good = [g for g, c in zip(groups, costs) if c <= costs[k] * (1.0 + 4.0 / samples)]
            if not good:
                continue
            brackets[name] = _Bracket(float(edges[good[0][0]]), float(edges[good[-1][-1] + 1]))
            if k < len(groups):
                best, values = found[k]
            values = {**values, name: brackets[name].value}
        if best >= before:
            break
    return values


def _position_cost(model: DriveModel, values: Values) -> float:
    """Sum of the squared errors of the position, the offset of every log taken out."""
    total = 0.0
    for i, y in enumerate(model.measured):
        r = y - np.real(model.columns(i, values).known)
        r = r - r.mean()
        total += float(r @ r)
    return total


def _as_unknowns(values: Mapping[str, float]) -> dict[str, Unknown]:
    return {n: Unknown(n, v) for n, v in values.items() if n.startswith("breakaway")}


def _bracket_widths(drive: FloatArray, speed: FloatArray, values: Values) -> dict[str, float]:
    """Standard errors that held torques leave to the static levels.

    A level lies between the highest torque that held and the lowest that broke away;
    without a break-away nothing is known of it.
    """
    out = {}
    stuck, holds = speed[:-1] == 0.0, speed[1:] == 0.0
    for s, sign in zip(_SIDES, (1.0, -1.0)):
        u = sign * drive[:-1]
        broke = u[stuck & ~holds & (u > 0.0)]
        low = max(u[stuck & holds].max(initial=0.0), values[f"coulomb_{s}"])
        high = broke.min(initial=np.inf)
        out[f"breakaway_{s}"] = max(float(high) - low, 0.0) / float(np.sqrt(12.0))
    return out


def _search_level(
    model: DriveModel,
    experiments: Sequence[Experiment],
    axis: _Axis,
    values: Mapping[str, float],
    side: str,
    near: _Bracket | None = None,
) -> _Bracket:
    """Find the step of the staircase that fits best, coarse to fine.

    ``near`` is where an earlier pass found it: only its neighbourhood is searched again.
    """
    sign = 1.0 if side == "positive" else -1.0
    drive = np.concatenate([sign * e.sampled(axis.drive) for e in experiments])
    kinetic = values[f"coulomb_{side}"]
    levels = np.unique(drive[drive > kinetic])
    levels = np.concatenate(([kinetic], levels))
    low, high = 0, levels.size - 1
    if near is not None:
        margin = 0.15 * near.value
        low = max(int(np.searchsorted(levels, near.low - margin)) - 1, 0)
        high = min(int(np.searchsorted(levels, near.high + margin)), levels.size - 1)

    def cost(level: float) -> float:
        tried = {**values, f"breakaway_{side}": level}
        total = 0.0
        for i, y in enumerate(model.measured):
            r = y - model.columns(i, tried).known
            total += float(r @ r)
        return total

    samples = sum(y.size for y in model.measured)
    while high - low > 1:
        marks = np.unique(np.linspace(low, high, 15 if near else 21).astype(int))
        costs = np.array([cost(0.5 * (levels[a] + levels[b])) for a, b in pairwise(marks)])
        good = np.flatnonzero(costs <= costs.min() * (1.0 + 4.0 / samples))
        finest = marks.size == high - low + 1
        # a coarse cell is judged by its middle, so the right level may lie next to it
        margin = 0 if finest else 1
        low = int(marks[max(good[0] - margin, 0)])
        high = int(marks[min(good[-1] + 1 + margin, marks.size - 1)])
        if finest or good.size + 2 >= marks.size - 1:
            break
    return _Bracket(float(levels[low]), float(levels[high]))


def _hold_brackets(
    brackets: Mapping[str, _Bracket],
    start: Mapping[str, float],
    names: Sequence[str],
    request: Request,
) -> tuple[dict[str, float], list[str], Request]:
    """Hold bracketed levels while the rest is fitted."""
    levels = {n: b.value for n, b in brackets.items()}
    replaced = {n.replace("breakaway", "stiction") for n in levels}
    kept = {n: v for n, v in start.items() if n not in replaced}
    free = [n if n not in replaced else n.replace("stiction", "breakaway") for n in names]
    return {**kept, **levels}, free, replace(request, fixed={**request.fixed, **levels})


def _append_variance(covariance: FloatArray, variance: float) -> FloatArray:
    """Add an independent parameter to a covariance."""
    size = covariance.shape[0]
    out = np.zeros((size + 1, size + 1))
    out[:size, :size] = covariance
    out[size, size] = variance
    return out


def _widths(
    experiments: Sequence[Experiment], axis: _Axis, drive: float, viscous: Sequence[str]
) -> dict[str, float]:
    """Viscous friction that alone would use up the whole drive at the highest speed."""
    speed = max(
        float(np.quantile(np.abs(np.gradient(e[axis.motion], e.time)), 0.99)) for e in experiments
    )
    return dict.fromkeys(viscous, drive / max(speed, 1e-300))


def _to_breakaway(fitted: Fitted) -> Fitted:
    """Turn ``stiction`` into ``breakaway = coulomb + stiction``, covariance included."""
    names = list(fitted.names)
    turn = np.eye(len(names))
    values, status = dict(fitted.values), dict(fitted.status)
    for s in _SIDES:
        inner, outer, base = f"stiction_{s}", f"breakaway_{s}", f"coulomb_{s}"
        if inner not in values:
            continue
        values[outer] = values[base] + values.pop(inner)
        status[outer] = status.pop(inner)
        if inner in names:
            k = names.index(inner)
            names[k] = outer
            if base in names:
                turn[k, names.index(base)] = 1.0
        elif status[base] == "not_identified":
            status[outer] = "not_identified"
    u = fitted.uncertainty
    turned = replace(u, covariance=turn @ u.covariance @ turn.T)
    return replace(fitted, names=tuple(names), values=values, status=status, uncertainty=turned)


def _beyond_notice(parameters: Mapping[str, Quantity]) -> list[Notice]:
    """Warn of forces that the model does not know, and of the static levels they hide."""
    wide = [
        f"{name} ({100.0 * float(q.std_error) / abs(float(q.value)):.0f} %)"
        for name, q in parameters.items()
        if name.startswith("breakaway")
        and isinstance(q.std_error, float)
        and isinstance(q.value, float)
        and q.std_error > 0.02 * abs(q.value)
    ]
    hidden = f" They hide the static level most: {', '.join(wide)} standard error." if wide else ""
    return [
        Notice(
            "forces-beyond-model",
            "forces that are not in this model (torque ripple, play, a load that depends on the "
            "place) move the position by more than its noise. Speed and acceleration were "
            "compared as well, so that they disturb less; what they add to the friction levels "
            f"and to the inertia is not in the intervals.{hidden} Cover the same stretch in both "
            "directions at several speeds, or give the static levels with --fix.",
        )
    ]


def _rename_notices(notices: Sequence[Notice], variant: Variant) -> list[Notice]:
    """Say in the file's own words what was refused."""
    out = []
    for n in notices:
        if n.code == "not-identified" and n.message.startswith("stiction_"):
            side = "positive" if n.message.startswith("stiction_positive") else "negative"
            reason = n.message.split(": ", 1)[1].split(" It is written")[0]
            remedy = next(s for s in variant.parameters if s.name == f"breakaway_{side}").remedy
            message = (
                f"breakaway_{side} cannot be determined from these data: {reason} It is written "
                f"as the kinetic level, status not_identified. {remedy}"
            )
            out.append(Notice(n.code, message))
        else:
            out.append(n)
    return out


def _derived(fitted: Fitted, axis: _Axis, variant: Variant) -> Mapping[str, Any]:
    """Offset and mean of the kinetic levels, and the time constant of coasting."""
    unit = variant.role(axis.drive).unit

    def function(v: Values) -> dict[str, Any]:
        out = {
            "coulomb_mean": 0.5 * (v["coulomb_positive"] + v["coulomb_negative"]),
            "coulomb_offset": 0.5 * (v["coulomb_positive"] - v["coulomb_negative"]),
        }
        if fitted.values.get("viscous", 0.0) > 0.0:
            out["time_constant"] = v[axis.inertia] / v["viscous"]
        return out

    units = {"coulomb_mean": unit, "coulomb_offset": unit, "time_constant": "s"}
    return derive(fitted, units, function)
