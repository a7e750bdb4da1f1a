"""Start of a fit: inverse dynamics, and what the logs cannot tell in any case."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import LogError
from ...estimation.inputs import settled_hold
from ...estimation.least_squares import lengths, project_out, scaled_least_squares
from ...estimation.lost_rows import find_lost_rows
from ...estimation.named_model import bind, make_unknowns
from ...estimation.noise import noise_floor
from ...estimation.problem import StationaryPoint, Unknown
from ...estimation.results import Refusal, held_by
from ...estimation.separable import solve
from ...experiment import Experiment, FloatArray
from ...family import FamilyOptions, Request, Variant
from .model import (
    BREAKAWAY,
    SIDES,
    SPEED,
    Axis,
    Compared,
    DriveModel,
    axis_of,
)

_FEWEST = 12  # means of rows, in either direction, that tell inertia from friction
_NEVER = "the axis never breaks away from rest in this direction."


@dataclass(frozen=True)
class Stage:
    """State of a fit between two of its stages.

    Attributes
    ----------
    names, unknowns
        Parameters of the model and initial speeds, those that are held included.
    start
        Where the search now is [SI].
    resting
        Directions in which no log ever moves, and the strongest push there [SI].
    fixed, refusals
        What the user gave (or a bracket found), and what the data cannot determine.
    """

    experiments: Sequence[Experiment]
    axis: Axis
    names: tuple[str, ...]
    unknowns: Mapping[str, Unknown]
    start: Mapping[str, float]
    resting: Mapping[str, float]
    fixed: Mapping[str, float] = field(default_factory=dict)
    refusals: tuple[Refusal, ...] = ()

    @property
    def held(self) -> dict[str, float]:
        """Values that are held while the rest is fitted: what was refused, and what is given."""
        return {**held_by(self.refusals), **self.fixed}

    @property
    def curved(self) -> bool:
        """Return whether friction falls from the static to the kinetic level over the speed."""
        return self.held.get(SPEED, self.start.get(SPEED, 0.0)) > 0.0

    @property
    def largest_drive(self) -> float:
        """Largest torque or force [SI]."""
        return max(float(np.abs(e.sampled(self.axis.drive)).max()) for e in self.experiments)

    @property
    def stepped(self) -> bool:
        """Return whether the drive is held between samples in every run."""
        drives = [e.signals[self.axis.drive] for e in self.experiments]
        return all(settled_hold(s) == "zoh" for s in drives)

    @property
    def unknown_drive(self) -> float:
        """Standard deviation of the drive in rows that were lost [SI]; 0 without any."""
        lost = [find_lost_rows(e.signals[self.axis.drive]) for e in self.experiments]
        return max((float(rows.error.max()) for rows in lost if rows), default=0.0)

    @property
    def rounding(self) -> float:
        """Standard deviation of what the coarsest encoder rounds off [SI]."""
        steps = [e.signals[self.axis.motion].resolution for e in self.experiments]
        return max(steps) / float(np.sqrt(12.0))

    @property
    def noise(self) -> float:
        """Standard deviation of the noise of the position [SI]."""
        motions = [e[self.axis.motion] for e in self.experiments]
        return max(self.rounding, *(noise_floor(y, robust=False) for y in motions))

    @property
    def values(self) -> dict[str, float]:
        """Values of the model where the search now is, those that are held included [SI]."""
        known = {**self.start, **self.held}
        return {n: known[n] for n in self.names}

    def at(self, values: Mapping[str, float]) -> Stage:
        """The stage with the search at other values."""
        return replace(self, start={**self.start, **values})

    def open_sides(self) -> list[str]:
        """Directions whose static level is to be fitted: neither given nor refused."""
        return [s for s in SIDES if BREAKAWAY[s] not in self.held]

    def refuse_levels(self, reason: str, sides: Collection[str]) -> Stage:
        """The stage with the static levels of some directions refused."""
        return self.refuse(*(Refusal(BREAKAWAY[s], reason) for s in sides))

    def refuse(self, *refusals: Refusal) -> Stage:
        """The stage with parameters refused."""
        return replace(self, refusals=(*self.refusals, *refusals))

    def solve(
        self, compared: Compared, max_iterations: int, *, tolerance: float = 0.05,
        weights: Sequence[FloatArray] = (),
    ) -> tuple[StationaryPoint, Stage]:  # fmt: skip
        """Fit everything that is not held from where the search now is; the stage where it ends."""
        model = DriveModel(self.experiments, self.axis, compared)
        problem = bind(model.named(self.names, weights), self.unknowns, self.held)
        eta = problem.vector(self.start)
        found = solve(problem, eta, max_iterations=max_iterations, tolerance=tolerance)
        return found, self.at(problem.named(found.eta))


def first_stage(
    variant: Variant, experiments: Sequence[Experiment], request: Request[FamilyOptions],
    one_sided: bool,
) -> Stage:  # fmt: skip
    """Inverse dynamics, and the sides at rest refused.

    ``one_sided`` asks for viscous friction by direction.
    """
    axis = axis_of(variant)
    viscous = [f"viscous_{s}" for s in SIDES] if one_sided else ["viscous"]
    given = [SPEED] if SPEED in request.fixed else []
    kinetic = [f"coulomb_{s}" for s in SIDES]
    names = (axis.inertia, *viscous, *kinetic, *BREAKAWAY.values(), *given)
    request.progress("inverse dynamics")
    guess = {**_inverse_dynamics(experiments, axis, viscous), **dict.fromkeys(given, 0.0)}
    moving = initial_speeds(experiments, axis)
    unknowns = {
        **make_unknowns(variant.parameters, names, guess, request, _search_limits(names, guess)),
        **speed_unknowns(moving),
    }
    resting = _withstood(experiments, axis)
    start = {**guess, **moving, **request.start}
    stage = Stage(
        experiments, axis, (*names, *moving), unknowns, start, resting, dict(request.fixed)
    )
    return stage.refuse(*_sides_at_rest(stage, variant.role(axis.drive).unit))


def without_idle_levels(stage: Stage) -> Stage:
    """The stage with the static levels refused that no motion shows where the search now is.

    A break-away from rest does. Where friction falls over the speed so does every stop, even one
    at which the axis turns without a rest: slow motion feels nearly the static level.
    """
    motions = DriveModel(stage.experiments, stage.axis).motions(stage.start)
    if stage.curved and any(m.stops for m in motions):
        return stage
    moved = {s for s, n in zip(SIDES, np.sum([m.breakaways for m in motions], axis=0)) if n}
    return stage.refuse_levels(_NEVER, [s for s in stage.open_sides() if s not in moved])


def _inverse_dynamics(
    experiments: Sequence[Experiment], axis: Axis, viscous: Sequence[str]
) -> dict[str, float]:
    """First stage: momentum that the drive gave, regressed on what became of it.

    Of means over more and more rows those are taken that tell the inertia best, as long as enough
    of them move in either direction.
    """
    best: tuple[float, FloatArray] | None = None
    ways = np.zeros(2, dtype=bool)
    for rows in (1, 2, 4, 8, 16, 32, 64):
        parts = [
            _momentum(e, axis, rows, len(viscous)) for e in experiments if e.samples > 8 * rows
        ]
        if not parts:
            break
        table = np.vstack(parts)
        moving = np.count_nonzero(table[:, -3:-1], axis=0)
        if table.shape[0] < _FEWEST or np.any(moving[ways] < _FEWEST * rows):
            continue
        ways = moving > 0
        columns, given = table[:, :-1], table[:, -1]
        x = scaled_least_squares(columns, given)
        misfit = np.sqrt(rows) * max(float(np.std(given - columns @ x)), 1e-200)
        told = abs(x[0]) * lengths(project_out(columns[:, :1], columns[:, 1:]))[0] / misfit
        if best is None or told > 1.1 * best[0]:
            best = float(told), x
    if best is None:
        raise LogError(
            f"the {axis.motion} hardly moves in any log",
            remedy="Record motion in both directions, or check --column and --unit.",
        )
    if best[1][0] < 0.0 and best[1][-2] + best[1][-1] < 0.0:
        raise LogError(
            f"the {axis.drive} acts against the motion: inertia and friction would be negative",
            remedy=f"Turn it round with --scale {axis.drive}=-1, or check --column.",
        )
    return _as_guess(best[1], experiments, axis, viscous)


def _momentum(e: Experiment, axis: Axis, rows: int, viscous: int) -> FloatArray:
    """Gains of speed, ways by ``viscous`` and times by direction, and the impulse of the drive.

    The equation of motion times a hat over two intervals, which is exact for any hold and step but
    for the curvature of the way in one interval; then the mean over ``rows``, weighted by the same
    for all columns. Kept is what moves one way throughout, faster than in a reversal.
    """
    y, u, step = e[axis.motion], e.sampled(axis.drive), np.diff(e.time)
    speed, before, after = np.diff(y) / step, step[:-1], step[1:]
    impulse = 0.5 * (before * u[:-2] + after * u[1:-1])
    if settled_hold(e.signals[axis.drive]) != "zoh":
        impulse = (before * (u[:-2] + 2.0 * u[1:-1]) + after * (2.0 * u[1:-1] + u[2:])) / 6.0
    box = np.full(rows, 1.0 / rows)
    hat = np.convolve(box, np.convolve(box, box))
    gain, way, time, impulse = (
        np.convolve(x, hat, "valid")
        for x in (np.diff(speed), 0.5 * (y[2:] - y[:-2]), 0.5 * (before + after), impulse)
    )
    few = max(rows // 4, 1)  # steps of which noise of the position turns back single ones
    steady = np.convolve(speed, np.full(few, 1.0 / few), "valid")
    steady = np.lib.stride_tricks.sliding_window_view(steady, hat.size + 2 - few)
    least = 0.12 * float(np.quantile(np.abs(way / time), 0.99))
    forward = (steady.min(axis=1) > 0.0) & (way > least * time)
    backward = (steady.max(axis=1) < 0.0) & (way < -least * time)
    ways = [way] if viscous == 1 else [way * forward, way * backward]
    table = np.column_stack((gain, *ways, time * forward, -time * backward, impulse))
    return np.asarray(table[forward | backward])


def _as_guess(
    x: FloatArray, experiments: Sequence[Experiment], axis: Axis, viscous: Sequence[str]
) -> dict[str, float]:
    """Linear estimate as a start: positive, and never more than the drive can give."""
    drive = max(float(np.abs(e.sampled(axis.drive)).max()) for e in experiments)
    speed = fastest(experiments, axis) or 1.0
    step = min(e.sample_time for e in experiments)
    guess = {axis.inertia: max(x[0], 1e-3 * drive / speed * step)}
    guess.update(zip(viscous, np.maximum(x[1:-2], 0.01 * drive / speed)))
    for s, kinetic in zip(SIDES, np.clip(x[-2:], 0.02 * drive, 0.9 * drive)):
        guess[f"coulomb_{s}"] = kinetic
        guess[BREAKAWAY[s]] = 1.2 * kinetic
    return {k: float(v) for k, v in guess.items()}


def fastest(experiments: Sequence[Experiment], axis: Axis) -> float:
    """Speed that is hardly exceeded [rad/s or m/s]."""
    rates = [np.abs(np.gradient(e[axis.motion], e.time)) for e in experiments]
    return max(float(np.quantile(r, 0.99)) for r in rates)


def _search_limits(
    names: Sequence[str], guess: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Search range of four decades around the linear estimate, inertia first of the names."""
    limits = {}
    for n in names:
        least = 1e-6 if n.startswith("viscous") else 0.0
        limits[n] = (least * abs(guess[n]), 1e4 * abs(guess[n]))
    return {**limits, names[0]: (1e-3 * guess[names[0]], 1e3 * guess[names[0]])}


def _withstood(experiments: Sequence[Experiment], axis: Axis) -> dict[str, float]:
    """Directions in which no log ever moves, and the strongest push there [SI], at least 0."""
    travel = dict.fromkeys(SIDES, 0.0)
    push = dict.fromkeys(SIDES, 0.0)
    for e in experiments:
        y, drive = e[axis.motion], e.sampled(axis.drive)
        lag = max(1, y.size // 200)
        step = y[lag:] - y[:-lag]
        for s, sign in zip(SIDES, (1.0, -1.0)):
            travel[s] = max(travel[s], float((sign * step).max()))
            push[s] = max(push[s], float((sign * drive).max()))
    resolution = max(e.signals[axis.motion].resolution for e in experiments)
    least = max(3.0 * resolution, 0.01 * max(travel.values()))
    return {s: push[s] for s in SIDES if travel[s] <= least}


def _sides_at_rest(stage: Stage, unit: str) -> list[Refusal]:
    """Friction of the directions in which no log ever moves, held where it is never left."""
    out = []
    for s, push in stage.resting.items():
        tried = f"at most {push:.3g} {unit} push that way" if push > 0.0 else "nothing pushes"
        reason = f"the {stage.axis.motion} never moves in the {s} direction ({tried})."
        hold = 1.5 * stage.largest_drive
        out += [Refusal(f"coulomb_{s}", reason, hold), Refusal(BREAKAWAY[s], reason)]
        if f"viscous_{s}" in stage.names:
            out.append(Refusal(f"viscous_{s}", reason, 0.0))
    return out


def initial_speeds(experiments: Sequence[Experiment], axis: Axis) -> dict[str, float]:
    """Guesses of the initial speeds of the runs that do not start at rest."""
    out = {}
    for i, e in enumerate(experiments):
        y = e[axis.motion]
        half = min(4, (y.size - 1) // 2)
        if half < 1:
            continue
        head = y[: 2 * half + 1]
        slope = float(np.polyfit(np.arange(head.size) * e.sample_time, head, 1)[0])
        typical = float(np.std(np.gradient(y, e.time))) or 1.0
        noise = max(e.signals[axis.motion].resolution, 1e-300) / (2 * half * e.sample_time)
        if abs(slope) > max(0.2 * typical, 2.0 * noise):
            out[f"initial_speed[{i}]"] = slope
    return out


def speed_unknowns(speeds: Mapping[str, float]) -> dict[str, Unknown]:
    """Unknowns of the initial speeds."""
    return {n: Unknown(n, scale=abs(v)) for n, v in speeds.items()}


def follow(
    experiment: Experiment, axis: Axis, values: Mapping[str, float]
) -> tuple[DriveModel, StationaryPoint, dict[str, float]]:
    """Follow the motion of a run with given values: model, solution, values with its speed.

    It may have been moving when the record began; that speed belongs to the run and is fitted.
    """
    model, moving = DriveModel([experiment], axis), initial_speeds([experiment], axis)
    problem = bind(model.named([*values, *moving]), speed_unknowns(moving), values)
    found = solve(problem, np.array([*moving.values()]))
    return model, found, {**values, **dict(zip(moving, found.eta.tolist()))}
