"""Samples of every log: its friction force, which of them are described, what the model gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError
from ...estimation.noise import common_step
from ...estimation.regression import Balance, Estimator, Evidence, reached
from ...estimation.stribeck import Rise, friction_columns, with_speed
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Plant, Simulated, Variant
from ...mechanics.friction_law import FrictionLaw
from .axis import Axis, axis_of, driven_by_pressure, motion_role
from .motion import SLOW, Motion, make_motions, match_force, quiet_acceleration
from .options import SIDES, FrictionOptions, check_options

LEVELS = ("coulomb_positive", "coulomb_negative")
MASS = "mass"  # what an unknown mass would add, estimated only to see what it takes
_LINGER = 1.5  # times the passage through rest that its slope predicts: longer is a rest
_STEADY = 0.1  # part of its mean that a steady speed may wander
_FEWEST_STEADY = 50  # samples that show it
_SLOWEST = 0.1  # of the moving samples are those of the slowest strokes
_SMALL = 0.05  # share of the friction that inertia may have before it matters
_CORNER = 4.0  # times its usual size that a second difference has at a corner of the velocity
_SHARP = 0.02  # of the highest speed that it is there at least
_LARGER = 1.3  # times as far off as elsewhere that the force is at corners


@dataclass(frozen=True)
class Data:
    """One run, ready for the regression; forces in N and speeds in m/s, or N m and rad/s.

    ``known`` is the part of the drive that is not friction, ``friction`` the rest (zero where
    no force was recorded), and ``matched`` that rest smoothed like the regressor, all of shape
    ``(n,)`` [N]; ``reading`` is what was logged of the drive and ``resolution`` its step [N];
    ``moving`` marks the samples outside the dead band, ``kept`` those that are fitted. The output
    is the drive divided by ``scale``; ``driven`` says whether it was recorded.
    """

    experiment: Experiment
    motion: Motion
    known: FloatArray
    friction: FloatArray
    matched: FloatArray
    reading: FloatArray
    resolution: float
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

    def side(self, side: str) -> BoolArray:
        """Mask of the kept samples that move in a direction."""
        return self.speed > 0.0 if side == "positive" else self.speed < 0.0

    def _columns(
        self, speed: FloatArray, rise: Sequence[FloatArray], at: BoolArray
    ) -> dict[str, FloatArray]:
        """Columns of the equation at some samples; no window of a fitted one holds a reversal."""
        out = friction_columns(np.sign(self.motion.velocity[at]), speed[at], [c[at] for c in rise])
        one = np.ones(int(at.sum()))
        out |= {"offset": one, f"offset[{self.experiment.log}]": one}
        if self.motion.acceleration is not None:
            out[MASS] = self.motion.acceleration[at]
        return out

    def balance(self, rise: Rise, step: float) -> Balance:
        """The run as a balance of forces about a Stribeck level and speed."""
        m, kept = self.motion, self.kept
        bare = m.sharp if m.reach else m.regressor
        noise = m.raw if rise.speed > 0.0 else 0.0

        def rising(speed: FloatArray, noise: float = 0.0) -> list[FloatArray]:
            share, by_speed, _ = rise.shares(speed, noise)
            sign = np.sign(m.velocity)
            return [sign * share, rise.level * sign * by_speed]

        smoothed = [match_force(self.experiment, m, c) for c in rising(bare, noise)]
        columns = self._columns(m.regressor, smoothed, kept)
        own = m.regressor is not m.velocity  # an instrument other than the column itself
        instruments = self._columns(m.velocity, rising(m.velocity), kept) if own else {}
        felt = m.shared if m.reach else m.raw
        by_velocity = np.sign(m.velocity) * rise.shares(bare, noise)[2]
        adds: dict[str, FloatArray] = {
            "viscous": np.full(int(kept.sum()), felt),
            "stribeck": noise * by_velocity[kept],
        }
        adds |= {f"viscous_{s}": np.where(self.side(s), felt, 0.0) for s in SIDES}
        shared = () if own or m.exact else (adds,)
        evidence: list[Evidence] = []
        if m.reach:
            at = reached(kept, m.kernel.size)
            plain = self._columns(bare, rising(bare, noise), at)
            evidence = [Evidence(plain, self.friction[at])]
        elif own:
            quiet = self._columns(m.sharp, rising(m.sharp), kept)
            evidence = [Evidence(columns, self.matched[kept]), Evidence(quiet, self.matched[kept])]
        return Balance(
            columns, self.matched[kept], kept, instruments, (adds,), shared,
            m.kernel, evidence, self.reading, step,
            self.experiment.time.size > 0,
        )  # fmt: skip


@dataclass(frozen=True)
class FrictionBalance:
    """Balance of the forces in motion over all runs."""

    data: Sequence[Data]

    @cached_property
    def speed(self) -> FloatArray:
        """Velocities of the fitted samples [m/s or rad/s]."""
        return np.concatenate([d.speed for d in self.data])

    @property
    def least_speed(self) -> float:
        """Speed below which there is only noise: the dead band has cut it away."""
        return 0.0

    @property
    def least_residual(self) -> float:
        """Error that the converter of the drive makes [N or N m]."""
        return float(max(d.resolution for d in self.data) / np.sqrt(12.0))

    @cached_property
    def _step(self) -> float:
        """Step of what logged the drive [N]; 0 where there was none, or nothing shows it."""
        step = max(d.resolution for d in self.data)
        if step > 0.0 or not all(d.driven for d in self.data):
            return step
        return common_step(np.unique(np.concatenate([d.reading for d in self.data])))

    def balances(self, rise: Rise) -> list[Balance]:
        """Every run about a Stribeck level and speed."""
        return [d.balance(rise, self._step) for d in self.data]


def count_kept(data: Sequence[Data]) -> int:
    """Number of samples to fit."""
    return sum(int(d.kept.sum()) for d in data)


def count_sides(data: Sequence[Data]) -> dict[str, int]:
    """Number of samples to fit by direction."""
    return {s: sum(int(d.side(s).sum()) for d in data) for s in SIDES}


def _choose_deadband(motions: Sequence[Motion], rises: bool) -> float:
    """Speed below which a sample may be at rest: noise, or a share of the speed [m/s].

    The slowest log that moves at all sets the share, so that a fast one does not hide it. The
    noise of a log that never comes near rest does not matter. Friction that ``rises`` towards rest
    is known from slow strokes: the share is then no more than half the speed of the slowest.
    """
    near = [m.noise for m in motions if m.speed_at(0.02) <= 8.0 * m.noise]
    floor = 4.0 * max(near, default=0.0)
    moving = [m for m in motions if m.fast > floor]
    share = SLOW * min((m.fast for m in moving), default=0.0)
    if rises:
        speeds = (np.abs(m.velocity[m.inside]) for m in moving)
        share = min([share, *(0.5 * np.quantile(v[v > floor], _SLOWEST) for v in speeds)])
    return float(max(floor, share))


def _moving(motion: Motion, deadband: float) -> BoolArray:
    """Samples that move, and whose filter window holds no rest or reversal, shape ``(n,)``.

    Near a rest the filter spreads motion over samples at rest. At a reversal only what lies within
    the dead band is left out, unless the matched force is a mean over it; a speed smoothed from its
    neighbours may be on the wrong side of zero there, so its own reading decides with it.
    """
    v = motion.velocity
    turns = np.concatenate(([False], np.sign(v[1:]) != np.sign(v[:-1]), [False]))
    beside = turns[1:] | turns[:-1]
    if not motion.reach:
        beside &= np.abs(motion.regressor) <= 0.5 * deadband
    idle, kept = (np.abs(v) <= deadband) | beside, motion.inside.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], idle, [False])).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist()):
        reach = motion.reach
        if not _passes(v, begin, end):
            reach = max(reach, motion.half)
        kept[max(begin - reach, 0) : end + reach] = False
    return kept


def _passes(velocity: FloatArray, begin: int, end: int) -> bool:
    """True if samples ``begin`` to ``end`` are on the way from one direction to the other."""
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
    """Return the drive, ``None`` if it was not recorded, and the opposing pressure force [N].

    Where the pressures move the piston against a measured load, both with the other sign.
    """
    first, second = (
        np.zeros(experiment.samples)
        if area is None or role not in experiment
        else area * experiment.sampled(role)
        for role, area in (("pressure", options.area), ("pressure_2", options.area_2))
    )
    recorded = variant.output.name in experiment
    if driven_by_pressure(variant):
        return first if recorded else None, second
    sign = _sign(options)
    drive = sign * experiment.sampled(variant.output.name) if recorded else None
    return drive, sign * (first - second)


def _sign(options: FrictionOptions) -> float:
    """Sign of a measured force that drives the motion, or is that of a load."""
    return -1.0 if options.pressures == "drive" else 1.0


def prepare(
    variant: Variant, experiments: Sequence[Experiment], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions]:
    """Friction force and described samples per run; options with filter and dead band settled."""
    check_options(variant, experiments, options)
    motions, half_width = make_motions(experiments, motion_role(variant), options.filter)
    deadband = options.deadband
    if deadband is None:
        deadband = _choose_deadband(motions, options.stribeck == "estimate")
    options = replace(options, filter=half_width, deadband=deadband)
    scale = float(options.area or 1.0) if driven_by_pressure(variant) else _sign(options)
    out = []
    for e, motion in zip(experiments, motions):
        drive, pressure = _drive(variant, e, options)
        inertia = np.zeros(motion.velocity.size)
        rest = np.zeros(inertia.size) if drive is None else drive - pressure
        acceleration = motion.acceleration
        if options.moved and acceleration is not None:
            acceleration = quiet_acceleration(e, motion, motion_role(variant))
            inertia = options.moved * np.asarray(acceleration)
        if acceleration is motion.acceleration:  # filtered as the regressor is
            matched = match_force(e, motion, rest) - inertia
        else:
            matched = match_force(e, motion, rest - inertia)
        slow = 0.0 if motion.exact else deadband
        moving = np.abs(motion.velocity) > slow
        kept = _moving(motion, slow) & described(motion, options)
        driven = drive is not None
        resolution = abs(scale) * e.signals[variant.output.name].resolution if driven else 0.0
        reading = rest if drive is None else drive
        out.append(
            Data(e, motion, pressure + inertia, rest - inertia, matched, reading, resolution,
                 moving, kept, scale, driven, axis_of(variant))
        )  # fmt: skip
    return out, options


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
    """Return whether a log was recorded at one speed, whose means over its tenths hardly differ.

    Inertia takes nothing from its mean force: leaving out accelerations would leave out noise.
    """
    if velocity.size < _FEWEST_STEADY:
        return False
    means = np.array([part.mean() for part in np.array_split(velocity, 10)])
    return bool(np.ptp(means) <= _STEADY * abs(means.mean()))


def at_speeds(motion: Motion, speeds: Mapping[str, tuple[float, float]]) -> BoolArray:
    """Samples whose speed lies in the range of their direction, if there are such ranges."""
    near = np.full(motion.velocity.size, not speeds)
    for side, (low, high) in speeds.items():
        v = motion.velocity if side == "positive" else -motion.velocity
        near |= (v >= low) & (v <= high)
    return near


def leave_out_accelerations(
    data: list[Data], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions, list[Notice]]:
    """Leave out samples in which an unknown mass would show, and settle which these are.

    The mass is estimated along with friction, only to see where its force exceeds a share
    of the friction.
    """
    slopes = [d.motion.acceleration for d in data]
    if any(a is None for a in slopes):
        return data, options, []
    size = np.concatenate([np.abs(a[d.kept]) for d, a in zip(data, slopes) if a is not None])
    fast = max(float(np.abs(d.speed).max(initial=0.0)) for d in data)
    if size.max() <= 1e-9 * fast / min(d.experiment.sample_time for d in data):
        return data, options, []  # rounding, no acceleration
    mass = Estimator(FrictionBalance(data), [*LEVELS, "viscous", MASS]).solve().free.values[MASS]
    share = _SMALL * half_range(data)
    if mass * float(np.quantile(size, 0.999)) <= share:
        return data, options, []
    limited = replace(options, acceleration_limit=share / mass)
    quiet = [replace(d, kept=d.kept & described(d.motion, limited)) for d in data]
    before, after = count_sides(data), count_sides(quiet)
    if all(after[s] >= 0.2 * before[s] for s in SIDES):
        return quiet, limited, []
    axis = data[0].axis
    message = (
        f"accelerating takes more than {100 * _SMALL:.0f} % of the friction in most of "
        f"the moving samples (about {mass:.3g} {axis.inertia_unit}). Give --{axis.inertia}="
        f"{axis.inertia_unit.replace(' ', '').upper()} to subtract it."
    )
    return data, options, [Notice("inertia-matters", message)]


def leave_out_turns(
    data: list[Data], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions]:
    """Leave out samples about corners of the velocity that lie between two readings.

    They are left out where the force is clearly further off there than elsewhere.
    """
    if not all(d.experiment.time.size for d in data):
        return data, options
    turns = [d.motion.turns for d in data]
    usual = float(np.median(np.concatenate([t[d.kept] for d, t in zip(data, turns)])))
    fast = max(float(np.abs(d.speed).max(initial=0.0)) for d in data)
    settled = replace(options, turn_limit=max(_CORNER * usual, _SHARP * fast))
    smooth = [replace(d, kept=d.kept & described(d.motion, settled)) for d in data]
    if count_kept(smooth) == count_kept(data) or min(count_sides(smooth).values()) == 0:
        return data, options
    names = [*(f"coulomb_{s}" for s in sides_moved(data)), *options.rates]
    law = FrictionLaw.of(Estimator(FrictionBalance(data), names).solve().values)
    rest = np.concatenate([(d.friction - law.moving(d.motion.sharp))[d.kept] for d in data])
    inside = np.concatenate([s.kept[d.kept] for d, s in zip(data, smooth)])
    if np.std(rest[~inside]) > _LARGER * np.std(rest[inside]):
        return smooth, settled
    return data, options


def simulate_force(
    plant: Plant[FrictionOptions], experiments: Sequence[Experiment], offset: float | None
) -> list[Simulated]:
    """Force, or first pressure, that the motion of every run needs; see ``Family.simulate``.

    Within the dead band a measured velocity is noise and nothing is known of friction: it
    counts as zero there, and the sample as not described.
    """
    data, options = prepare(plant.variant, experiments, plant.options)
    law = FrictionLaw.of(with_speed(plant.numbers, FrictionBalance(data).speed))
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
    """Return whether there is motion in both directions."""
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
