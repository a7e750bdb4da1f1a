"""Samples of every log: its friction force, which of them are described, what the model gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, NotIdentifiedError
from ...estimation.input_noise import InputNoise
from ...estimation.stribeck import with_speed
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Plant, Simulated, Variant
from ...mechanics.friction_law import FrictionLaw, stribeck_share
from .axis import Axis, axis_of, driven_by_pressure, motion_role
from .filters import sensor_noise
from .motion import SLOW, Motion, make_motions, match_force, quiet_acceleration
from .options import SIDES, FrictionOptions, check_options

_LINGER = 1.5  # times the passage through rest that its slope predicts: longer is a rest
_STEADY = 0.1  # part of its mean that a steady speed may wander
_FEWEST_STEADY = 50  # samples that show it
_PAIRS = 2, 12  # least and most draws of the noise of the motion, each added and subtracted
_ROWS = 600_000  # that all draws together hold


@dataclass(frozen=True)
class Data:
    """One run, ready for the regression; forces in N and speeds in m/s, or N m and rad/s.

    ``known`` is the part of the drive that is not friction, ``friction`` the rest (zero where
    no force was recorded), and ``matched`` that rest smoothed like the regressor, all of shape
    ``(n,)`` [N]; ``reading`` is what was logged of the drive and ``resolution`` its step [N];
    ``direction`` is the sign of the velocity, smoothed alike. ``moving`` marks
    the samples outside the dead band, ``kept`` those that are fitted. The output is the drive
    divided by ``scale``; ``driven`` says whether it was recorded.
    """

    experiment: Experiment
    motion: Motion
    known: FloatArray
    friction: FloatArray
    matched: FloatArray
    reading: FloatArray
    resolution: float
    direction: FloatArray
    moving: BoolArray
    kept: BoolArray
    scale: float
    driven: bool
    axis: Axis

    def say(self, force: float, form: str = ".3g") -> str:
        """A force or torque [SI] for a message, in the unit of the log where it has one."""
        signal = self.experiment.signals.get(self.axis.drive)
        return signal.text(force, form) if signal else f"{force:{form}} {self.axis.force_unit}"

    @property
    def speed(self) -> FloatArray:
        """Velocities of the kept samples [m/s]."""
        return self.motion.velocity[self.kept]

    @property
    def support(self) -> BoolArray:
        """Samples that the fitted ones depend on, shape ``(n,)``."""
        from scipy.ndimage import maximum_filter1d

        return np.asarray(maximum_filter1d(self.kept, 2 * self.motion.reach + 1, mode="constant"))

    def spread(self, columns: FloatArray) -> FloatArray:
        """What multiplies the unfiltered force where ``columns`` multiply the matched one.

        Shapes ``(kept, p)`` and ``(support, p)``.
        """
        if not self.motion.reach:
            return columns
        full = np.zeros((self.kept.size, columns.shape[1]))
        full[self.kept] = columns
        out = [np.convolve(c, self.motion.kernel, "same") for c in full.T]
        return np.column_stack(out)[self.support]

    def low(self, speed: float, exponent: float = 2.0) -> tuple[FloatArray, FloatArray]:
        """Signed Stribeck share and its derivative by the Stribeck speed [s/m], ``(n,)`` each.

        Of the unfiltered motion, as quiet as it is known.
        """
        v = np.abs(self.motion.sharp)
        share = np.sign(self.motion.velocity) * stribeck_share(v, speed, exponent)
        return share, share * exponent * v**exponent / speed ** (exponent + 1.0)

    def smoothed(self, force: FloatArray) -> FloatArray:
        """Smooth a force like the regressor, shape ``(n,)``."""
        return match_force(self.experiment, self.motion, force)

    def forward(self, speed: FloatArray) -> FloatArray:
        """Part of a regressor that is motion in the positive direction, shape ``(n,)`` [m/s].

        The slope of a position is a mean over its window. Where the motion reverses in it,
        some of the mean belongs to either direction.
        """
        ahead = self.motion.velocity > 0.0
        if not self.motion.reach:
            return np.where(ahead, speed, 0.0)
        sharp = self.motion.sharp
        own = self.smoothed(np.maximum(sharp, 0.0))
        return own + np.where(ahead, speed - self.smoothed(sharp), 0.0)

    def side(self, side: str) -> BoolArray:
        """Which of the kept samples move in a direction."""
        return self.speed > 0.0 if side == "positive" else self.speed < 0.0


def count_kept(data: Sequence[Data]) -> int:
    """Number of samples to fit."""
    return sum(int(d.kept.sum()) for d in data)


def count_sides(data: Sequence[Data]) -> dict[str, int]:
    """Number of samples to fit by direction."""
    return {s: sum(int(d.side(s).sum()) for d in data) for s in SIDES}


def _choose_deadband(motions: Sequence[Motion]) -> float:
    """Speed below which a sample may be at rest: noise, or a share of the speed [m/s].

    The slowest log that moves at all sets the share, so that a fast one does not hide it. The
    noise of a log that never comes near rest does not matter.
    """
    near = [m.noise for m in motions if m.slow <= 8.0 * m.noise]
    floor = 4.0 * max(near, default=0.0)
    moving = [m.fast for m in motions if m.fast > floor]
    return float(max(floor, SLOW * min(moving, default=0.0)))


def _moving(motion: Motion, deadband: float) -> BoolArray:
    """Samples that move, and whose filter window holds no rest, shape ``(n,)``.

    Near a rest the filter spreads motion over samples at rest. A reversal without a pause has
    no rest: only what lies within the dead band there is left out, unless the matched force
    is a mean over it. Beside a reversal a speed smoothed from its neighbours may be on the wrong
    side of zero, where the velocity turns sharply; its own reading decides with it.
    """
    v = motion.velocity
    turns = np.concatenate(([False], np.sign(v[1:]) != np.sign(v[:-1]), [False]))
    unsure = (turns[1:] | turns[:-1]) & (np.abs(motion.regressor) <= 0.5 * deadband)
    idle, kept = (np.abs(v) <= deadband) | unsure, motion.inside.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], idle, [False])).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist()):
        reach = motion.reach
        if not _passes(v, begin, end):
            reach = max(reach, motion.half)
        kept[max(begin - reach, 0) : end + reach] = False
    if motion.reach:  # reversals that follow each other so fast leave no cubic to match
        turns = np.concatenate(([0], np.cumsum(np.sign(v[1:]) != np.sign(v[:-1]))))
        at, last = np.arange(v.size), v.size - 1
        span = 2 * motion.reach
        after, before = np.minimum(at + span, last), np.maximum(at - span, 0)
        kept &= turns[after] - turns[before] <= 1
    return kept


def _passes(velocity: FloatArray, begin: int, end: int) -> bool:
    """Whether samples ``begin`` to ``end`` are on the way from one direction to the other."""
    if begin < 1 or end + 1 > velocity.size:
        return False
    before, after = float(velocity[begin - 1]), float(velocity[end])
    if before * after >= 0.0:
        return False
    # as many samples as a straight line through the neighbours of the dead band would need
    run = end - begin
    slope = abs(after - before) / (run + 1)
    entry = abs(before - velocity[max(begin - 2, 0)])
    leave = abs(velocity[min(end + 1, velocity.size - 1)] - after)
    return bool(run <= 1 or _LINGER * slope >= 0.5 * (entry + leave))


def _drive(
    variant: Variant, experiment: Experiment, options: FrictionOptions
) -> tuple[FloatArray | None, FloatArray]:
    """What drives the motion, ``None`` where it was not recorded, and what pressure opposes [N]."""
    first, second = (
        np.zeros(experiment.samples)
        if area is None or role not in experiment
        else area * experiment.sampled(role)
        for role, area in (("pressure", options.area), ("pressure_2", options.area_2))
    )
    recorded = variant.output.name in experiment
    if driven_by_pressure(variant):
        return first if recorded else None, second
    return experiment.sampled(variant.output.name) if recorded else None, first - second


def prepare(
    variant: Variant, experiments: Sequence[Experiment], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions]:
    """Friction force and described samples per run; options with filter and dead band settled."""
    check_options(variant, experiments, options)
    curved = options.stribeck == "estimate"
    motions, half_width = make_motions(experiments, motion_role(variant), options.filter, curved)
    deadband = _choose_deadband(motions) if options.deadband is None else options.deadband
    options = replace(options, filter=half_width, deadband=deadband)
    scale = float(options.area or 1.0) if driven_by_pressure(variant) else 1.0
    out = []
    for e, motion in zip(experiments, motions):
        drive, pressure = _drive(variant, e, options)
        acceleration, inertia = motion.acceleration, np.zeros(motion.velocity.size)
        if options.moved and acceleration is not None:
            acceleration = quiet_acceleration(e, motion, motion_role(variant))
            inertia = options.moved * np.asarray(acceleration)
        rest = np.zeros(inertia.size) if drive is None else drive - pressure
        if acceleration is motion.acceleration:  # filtered as the regressor is
            matched = match_force(e, motion, rest) - inertia
        else:
            matched = match_force(e, motion, rest - inertia)
        direction = match_force(e, motion, np.sign(motion.velocity))
        slow = 0.0 if motion.exact else deadband
        moving = np.abs(motion.velocity) > slow
        kept = _moving(motion, slow) & described(motion, options)
        known, friction, driven = pressure + inertia, rest - inertia, drive is not None
        resolution = scale * e.signals[variant.output.name].resolution if driven else 0.0
        reading = rest if drive is None else drive
        out.append(
            Data(e, motion, known, friction, matched, reading, resolution, direction, moving, kept,
                 scale, driven, axis_of(variant))
        )  # fmt: skip
    return out, options


def draw_noisier(
    variant: Variant, data: Sequence[Data], options: FrictionOptions, seed: int
) -> list[list[Data]]:
    """The runs with the noise of their motion once more, in antithetic pairs.

    Empty where there is none, or no time to tell it by.
    """
    role, rows = motion_role(variant), sum(d.kept.size for d in data)
    pairs = int(np.clip(_ROWS // rows, *_PAIRS))
    noises = [
        InputNoise([e], role, sensor_noise(e, role), seed=seed + k, pairs=pairs)
        for k, e in enumerate(d.experiment for d in data if not d.motion.exact)
        if e.time.size
    ]
    if len(noises) < len(data) or not any(n.sigma for n in noises):
        return []
    drawn = ([n.add(k, sign)[0] for n in noises] for k in range(pairs) for sign in (1.0, -1.0))
    return [prepare(variant, experiments, options)[0] for experiments in drawn]


def described(motion: Motion, options: FrictionOptions) -> BoolArray:
    """Samples within accelerations, turns and speeds that a fit has settled, shape ``(n,)``."""
    near = at_speeds(motion, options.speeds)
    if options.turn_limit is not None:
        near &= motion.turns <= options.turn_limit
    if options.acceleration_limit is None or motion.acceleration is None:
        return near
    if _is_steady(motion.velocity):
        return near
    return near & (np.abs(motion.acceleration) <= options.acceleration_limit)


def _is_steady(velocity: FloatArray) -> bool:
    """Whether a log was recorded at one speed, whose means over its tenths hardly differ.

    Inertia takes nothing from its mean force, which is all that it says of friction; samples
    left out for their acceleration are noise, and the log would count less than the others.
    """
    if velocity.size < _FEWEST_STEADY:
        return False
    means = np.array([part.mean() for part in np.array_split(velocity, 10)])
    return bool(np.ptp(means) <= _STEADY * abs(means.mean()))


def at_speeds(motion: Motion, speeds: Mapping[str, tuple[float, float]]) -> BoolArray:
    """Samples whose speed lies in the range of their direction, if there are such ranges."""
    if not speeds:
        return np.ones(motion.velocity.size, dtype=bool)
    near = np.zeros(motion.velocity.size, dtype=bool)
    for side, (low, high) in speeds.items():
        v = motion.velocity if side == "positive" else -motion.velocity
        near |= (v >= low) & (v <= high)
    return near


def moving_speeds(data: Sequence[Data]) -> FloatArray:
    """Velocities of the kept samples of all runs [m/s]."""
    return np.concatenate([d.speed for d in data])


def simulate_force(
    plant: Plant[FrictionOptions], experiments: Sequence[Experiment], offset: float | None = None
) -> list[Simulated]:
    """Force, or first pressure, that the motion of every run needs; see ``Family.simulate``.

    Within the dead band a measured velocity is noise and nothing is known of friction: it
    counts as zero there, and the sample as not described.
    """
    data, options = prepare(plant.variant, experiments, plant.options)
    law = FrictionLaw.of(with_speed(plant.numbers, moving_speeds(data)))
    offsets: dict[int, float] = {}
    if options.force_offset:
        offsets = {d.experiment.log: (offset or 0.0) * d.scale for d in data}
        offsets |= _find_offsets(data, law, offset is None)
    out = []
    for d in data:
        own = offsets.get(d.experiment.log)
        force = d.known + law.moving(np.where(d.moving, d.motion.sharp, 0.0)) + (own or 0.0)
        out.append(Simulated(force / d.scale, d.kept, None if own is None else own / d.scale))
    return out


def _find_offsets(data: Sequence[Data], law: FrictionLaw, always: bool) -> dict[int, float]:
    """Force offset of every log with motion, one for all where some move one way only [N].

    Both directions count alike, however long each of them lasted: wrong levels then leave it
    as it is. Without both directions it is found if it has to be (``always``) only.
    """
    logs = group_by_log([d for d in data if d.driven])
    groups = logs if all(map(both_ways, logs)) else [[d for runs in logs for d in runs]]
    out: dict[int, float] = {}
    for runs in groups:
        rests = [d.friction[d.kept] - law.moving(d.motion.sharp[d.kept]) for d in runs]
        sides = [np.concatenate([r[d.side(s)] for d, r in zip(runs, rests)]) for s in SIDES]
        means = [side.mean() for side in sides if side.size]
        if means and (always or len(means) == len(SIDES)):
            out |= dict.fromkeys((d.experiment.log for d in runs), float(np.mean(means)))
    return out


def group_by_log(data: Sequence[Data]) -> list[list[Data]]:
    """Runs by log."""
    numbers = dict.fromkeys(d.experiment.log for d in data)
    return [[d for d in data if d.experiment.log == k] for k in numbers]


def both_ways(runs: Sequence[Data]) -> bool:
    """Whether there is motion in both directions."""
    return all(any(d.side(s).any() for d in runs) for s in SIDES)


def sides_moved(data: Sequence[Data]) -> list[str]:
    """Directions with enough moving samples to average; refused where there is none."""
    counts = count_sides(data)
    least = max(5.0, 0.005 * sum(counts.values()))
    moved = [s for s in SIDES if counts[s] >= least]
    if not moved:
        raise NotIdentifiedError(
            "nothing moves in these logs beyond the noise of the motion, and friction shows only "
            "in motion",
            expected="Nothing was written.",
            remedy="Record strokes in both directions, or check --column and --unit of the "
            "motion. Where it does move, sample faster or move more slowly (ten samples or more a "
            "stroke: motion that changes from sample to sample looks like noise), or give "
            "--deadband.",
        )
    return moved


def check_measured(data: Sequence[Data]) -> None:
    """Refuse a force that has one and the same value in all moving samples."""
    force = np.concatenate([d.friction[d.kept] for d in data])
    span = float(np.ptp(force))
    if span > 1e-12 * float(np.abs(force).max()):
        return
    axis = data[0].axis
    raise LogError(
        f"the {axis.drive} is {data[0].say(force[0], 'g')} in all {force.size} moving samples: "
        "no sensor does that",
        where=", ".join(d.experiment.name for d in data),
        expected=f"A measured {axis.drive}, with strokes in both directions. Nothing was written.",
        remedy=f"Check --column of the {axis.drive} and the {axis.sensor}.",
    )


def half_range(data: Sequence[Data]) -> float:
    """Half the difference of the mean forces of both directions, or the only one; size [N]."""
    force = np.concatenate([d.matched[d.kept] for d in data])
    forward = np.concatenate([d.side("positive") for d in data])
    if forward.all() or not forward.any():
        return abs(float(np.mean(force)))
    return 0.5 * abs(float(np.mean(force[forward]) - np.mean(force[~forward])))
