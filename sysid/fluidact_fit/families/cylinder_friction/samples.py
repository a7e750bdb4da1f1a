"""Samples of every log: its friction force, which of them are described, what the model gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError
from ...estimation.noise import common_step
from ...estimation.regression import Balance, Estimator, Evidence, RegressionModel, reached
from ...estimation.stribeck import Rise, friction_columns, with_speed
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Plant, Simulated, Variant
from ...mechanics.friction_law import FrictionLaw
from .axis import Axis, axis_of, motion_role
from .motion import SLOW, FilteredMotion, make_motions
from .options import ONE_SIDED, SIDES, FrictionOptions, check_options

LEVELS = ("coulomb_positive", "coulomb_negative")
MASS = "mass"  # an unknown mass, estimated only to see its share of the force
_LINGER = 1.5  # multiple of the passage through zero that the slope predicts: longer is a rest
_SLOWEST = 0.1  # share of the moving samples that the slowest strokes have
_SMALL = 0.05  # share of the friction from which inertia matters
_CORNER = 4.0  # multiple of its usual size that a second difference has at a corner of the velocity
_SHARP = 0.02  # least size of that second difference, as a share of the highest speed
_LARGER = 1.3  # ratio of the residuals at corners to those elsewhere that excludes corners


@dataclass(frozen=True)
class FrictionData:
    """One run, ready for the regression; forces in N and speeds in m/s, or N m and rad/s.

    Attributes
    ----------
    experiment, variant, motion
        The run, its roles, and its motion.
    known, friction
        Part of the drive that is not friction, and the rest, which is zero where no force was
        recorded, shape ``(n,)`` [N].
    moving, kept
        Masks of the samples outside the dead band, and of those that are fitted, shape ``(n,)``.
    scale
        The output is the drive divided by it.
    """

    experiment: Experiment
    variant: Variant
    motion: FilteredMotion
    known: FloatArray
    friction: FloatArray
    moving: BoolArray
    kept: BoolArray
    scale: float

    @cached_property
    def matched(self) -> FloatArray:
        """The friction smoothed like the regressor, shape ``(n,)`` [N]."""
        return self.motion.match_force(self.friction)

    @property
    def axis(self) -> Axis:
        """Names and units of drive and motion."""
        return axis_of(self.variant)

    @property
    def reading(self) -> FloatArray:
        """Logged drive, shape ``(n,)`` [N]."""
        return self.scale * self.experiment.sampled(self.variant.output.name)

    def text(self, force: float, form: str = ".3g") -> str:
        """Format a force or torque [SI] for a message, in the unit of the log where it has one."""
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
        return out | {MASS: self.motion.acceleration[at]}

    def balance(self, rise: Rise, step: float) -> Balance:
        """The run as a balance of forces about a Stribeck level and speed."""
        m, kept, sign = self.motion, self.kept, np.sign(self.motion.velocity)
        bare = m.sharp if m.reach else m.regressor
        noise = m.raw if rise.speed > 0.0 else 0.0
        rising = rise.columns(sign, bare, noise)
        matched = [m.match_force(c) for c in rising]
        columns, target = self._columns(m.regressor, matched, kept), self.matched[kept]
        # what one standard deviation of the motion's noise adds
        felt = np.full(target.size, m.noise if m.reach else m.raw)
        steep = noise * sign * rise.shares(bare, noise)[2]
        adds = friction_columns(sign[kept], felt, (steep[kept],))
        adds = {n: adds[n] for n in ("viscous", *ONE_SIDED, "stribeck")}
        instruments: dict[str, FloatArray] = {}
        evidence: list[Evidence] = []
        if m.reach:
            at = reached(kept, m.kernel.size)
            evidence = [Evidence(self._columns(bare, rising, at), self.friction[at])]
        elif m.regressor is not m.instrument:
            instruments = self._columns(m.instrument, rise.columns(sign, m.instrument), kept)
            quiet = self._columns(m.sharp, rise.columns(sign, m.sharp), kept)
            evidence = [Evidence(columns, target), Evidence(quiet, target)]
        return Balance(
            columns, target, kept, instruments, (adds,), m.kernel, evidence, self.reading, step,
            self.experiment.time.size > 0,
        )  # fmt: skip


def friction_model(data: Sequence[FrictionData]) -> RegressionModel:
    """Balance of the forces in motion over all runs; slow samples are left out already."""
    output = data[0].variant.output.name
    step = known = max(abs(d.scale) * d.experiment.signals[output].resolution for d in data)
    if not known:  # every log may keep a reading of its own
        step = common_step(np.unique(np.concatenate([d.reading for d in data])))
    return RegressionModel(
        lambda rise: [d.balance(rise, step) for d in data],
        speeds(data),
        least_residual=float(known / np.sqrt(12.0)),
    )


def speeds(data: Sequence[FrictionData]) -> FloatArray:
    """Velocities of the samples to fit, of all runs [m/s or rad/s]."""
    return np.concatenate([d.speed for d in data])


def count_kept(data: Sequence[FrictionData], side: str = "") -> int:
    """Number of samples to fit, of one direction or of both."""
    return sum(int((d.side(side) if side else d.kept).sum()) for d in data)


def _choose_deadband(motions: Sequence[FilteredMotion], rises: bool) -> float:
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


def _moving(motion: FilteredMotion, deadband: float) -> BoolArray:
    """Samples that move, and whose filter window holds no rest or reversal, shape ``(n,)``.

    Near a rest the filter spreads motion over samples at rest. At a reversal only what lies within
    the dead band is left out, unless the matched force is a mean over it.
    """
    v, beside = motion.velocity, np.zeros(motion.velocity.size, dtype=bool)
    if motion.reach:
        turns = np.concatenate(([False], np.sign(v[1:]) != np.sign(v[:-1]), [False]))
        beside = turns[1:] | turns[:-1]
    idle, kept = (np.abs(v) <= deadband) | beside, motion.inside.copy()
    edges = np.flatnonzero(np.diff(np.concatenate(([False], idle, [False])).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist()):
        reach = motion.reach if _passes(v, begin, end) else max(motion.reach, motion.half)
        kept[max(begin - reach, 0) : end + reach] = False
    return kept


def _passes(velocity: FloatArray, begin: int, end: int) -> bool:
    """Return whether samples ``begin`` to ``end`` pass from one direction to the other.

    They are no more than a straight line through their neighbours would need.
    """
    if begin < 1 or end + 1 > velocity.size or velocity[begin - 1] * velocity[end] >= 0.0:
        return False
    near = velocity[[max(begin - 2, 0), begin - 1, end, min(end + 1, velocity.size - 1)]]
    entry, across, leave = np.abs(np.diff(near)).tolist()
    run = end - begin
    return bool(run <= 1 or _LINGER * across / (run + 1) >= 0.5 * (entry + leave))


def prepare(
    variant: Variant,
    experiments: Sequence[Experiment],
    options: FrictionOptions,
    known: Sequence[FilteredMotion] = (),
) -> tuple[list[FrictionData], FrictionOptions]:
    """Friction force and described samples per run; options with filter and dead band settled.

    Motions that are ``known`` already are not made again.
    """
    check_options(variant, experiments, options)
    motions, half_width = make_motions(experiments, motion_role(variant), options.filter, known)
    deadband = options.deadband
    if deadband is None:
        deadband = _choose_deadband(motions, options.stribeck == "estimate")
    options = replace(options, filter=half_width, deadband=deadband)
    return [_prepare(variant, e, m, options) for e, m in zip(experiments, motions)], options


def _prepare(
    variant: Variant, e: Experiment, motion: FilteredMotion, options: FrictionOptions
) -> FrictionData:
    """Split the drive of a run; its sign is reversed where pressures move a measured load."""
    first, second = (
        area * e.sampled(role) if area is not None and role in e else np.zeros(e.samples)
        for role, area in (("pressure", options.area), ("pressure_2", options.area_2))
    )
    output = variant.output.name
    if output == "pressure":
        scale, known = float(options.area or 1.0), second
    else:
        scale = -1.0 if options.pressures == "drive" else 1.0
        known = scale * (first - second)
    rest = scale * e.sampled(output) - known if output in e else np.zeros(e.samples)
    inertia = options.moved * motion.quiet_acceleration if options.moved else np.zeros(e.samples)
    rest = rest - inertia
    slow = 0.0 if motion.exact else options.deadband or 0.0
    moving = np.abs(motion.velocity) > slow
    kept = _moving(motion, slow) & described(motion, options)
    return FrictionData(e, variant, motion, known + inertia, rest, moving, kept, scale)


def described(motion: FilteredMotion, options: FrictionOptions) -> BoolArray:
    """Samples within the accelerations and turns that a fit has settled, shape ``(n,)``."""
    limit, within = options.acceleration_limit, np.ones(motion.velocity.size, dtype=bool)
    if options.turn_limit is not None:
        within &= motion.turns <= options.turn_limit
    if limit is not None:
        within &= np.abs(motion.acceleration) <= limit
    return within


def narrow(data: Sequence[FrictionData], options: FrictionOptions) -> list[FrictionData]:
    """Keep the samples that the options describe."""
    return [replace(d, kept=d.kept & described(d.motion, options)) for d in data]


def leave_out_accelerations(
    data: list[FrictionData], options: FrictionOptions
) -> tuple[list[FrictionData], FrictionOptions, list[Notice]]:
    """Leave out samples in which an unknown mass would show, and settle the limit.

    The mass is estimated along with friction, only to see where its force exceeds a share of it.
    """
    step = min(d.experiment.sample_time for d in data)
    if options.moved is not None or options.is_settled or not step:
        return data, options, []
    size = np.concatenate([np.abs(d.motion.acceleration[d.kept]) for d in data])
    if size.max() <= 1e-9 * float(np.abs(speeds(data)).max()) / step:
        return data, options, []  # rounding, no acceleration
    mass = Estimator(friction_model(data), [*LEVELS, "viscous", MASS]).solve().free.values[MASS]
    share = _SMALL * half_range(data)
    if mass * float(np.quantile(size, 0.999)) <= share:
        return data, options, []
    limited = replace(options, acceleration_limit=share / mass)
    quiet = narrow(data, limited)
    if all(count_kept(quiet, s) >= 0.2 * count_kept(data, s) for s in SIDES):
        return quiet, limited, []
    axis = data[0].axis
    message = (
        f"accelerating takes more than {100 * _SMALL:.0f} % of the friction in most of "
        f"the moving samples (about {mass:.3g} {axis.inertia_unit}). Give --{axis.inertia}="
        f"{axis.inertia_unit.replace(' ', '').upper()} to subtract it."
    )
    return data, options, [Notice("inertia-matters", message)]


def leave_out_turns(
    data: list[FrictionData], options: FrictionOptions
) -> tuple[list[FrictionData], FrictionOptions]:
    """Leave out samples near corners of the velocity between two readings, and settle the limit.

    This is done where the residuals are clearly larger there than elsewhere.
    """
    settled = options.stribeck == "estimate" or options.is_settled
    if settled or not all(d.experiment.time.size for d in data):
        return data, options
    usual = float(np.median(np.concatenate([d.motion.turns[d.kept] for d in data])))
    fast = float(np.abs(speeds(data)).max())
    limited = replace(options, turn_limit=max(_CORNER * usual, _SHARP * fast))
    smooth = narrow(data, limited)
    if min(count_kept(data) - count_kept(smooth), *(count_kept(smooth, s) for s in SIDES)) == 0:
        return data, options
    names = [*(f"coulomb_{s}" for s in sides_moved(data)), *options.rates]
    law = FrictionLaw.of(Estimator(friction_model(data), names).solve().values)
    rest = np.concatenate([(d.friction - law.moving(d.motion.sharp))[d.kept] for d in data])
    inside = np.concatenate([s.kept[d.kept] for d, s in zip(data, smooth)])
    if np.std(rest[~inside]) > _LARGER * np.std(rest[inside]):
        return smooth, limited
    return data, options


def simulate_force(
    plant: Plant[FrictionOptions],
    experiments: Sequence[Experiment],
    offset: float | None = None,
    *,
    known: Sequence[FilteredMotion] = (),
) -> list[Simulated]:
    """Force, or first pressure, that the motion of every run needs; see ``Family.simulate``.

    Within the dead band a measured velocity is noise and nothing is known of friction: it
    counts as zero there, and the sample as not described.
    """
    data, options = prepare(plant.variant, experiments, plant.options, known)
    law = FrictionLaw.of(with_speed(plant.numbers, speeds(data)))
    offsets = _find_offsets(data, law, offset) if options.force_offset else {}
    out = []
    for d in data:
        own = offsets.get(d.experiment.log)
        force = d.known + law.moving(np.where(d.moving, d.motion.sharp, 0.0)) + (own or 0.0)
        out.append(Simulated(force / d.scale, d.kept, None if own is None else own / d.scale))
    return out


def _find_offsets(
    data: Sequence[FrictionData], law: FrictionLaw, known: float | None
) -> dict[int, float]:
    """Force offset of every log [N]; see :func:`offset_groups`.

    Both directions count alike, however long each of them lasted: wrong levels then leave it
    as it is. Without both directions it is the ``known`` one of the output, if there is one.
    """
    out = {d.experiment.log: (known or 0.0) * d.scale for d in data}
    for runs in offset_groups([d for d in data if d.variant.output.name in d.experiment]):
        rests = [d.friction[d.kept] - law.moving(d.motion.sharp[d.kept]) for d in runs]
        sides = [np.concatenate([r[d.side(s)] for d, r in zip(runs, rests)]) for s in SIDES]
        means = [side.mean() for side in sides if side.size]
        if means and (known is None or len(means) == len(SIDES)):
            out |= dict.fromkeys((d.experiment.log for d in runs), float(np.mean(means)))
    return out


def group_by_log(data: Sequence[FrictionData]) -> list[list[FrictionData]]:
    """Runs by log."""
    numbers = dict.fromkeys(d.experiment.log for d in data)
    return [[d for d in data if d.experiment.log == k] for k in numbers]


def offset_groups(data: Sequence[FrictionData]) -> list[list[FrictionData]]:
    """Runs that share an offset: those of a log where each shows both directions, else all."""
    logs = group_by_log(data)
    return logs if all(map(both_ways, logs)) else [list(data)]


def both_ways(runs: Sequence[FrictionData]) -> bool:
    """Return whether there is motion in both directions."""
    return all(any(d.side(s).any() for d in runs) for s in SIDES)


def sides_moved(data: Sequence[FrictionData]) -> list[str]:
    """Directions with enough moving samples to average; refused where there is none."""
    counts = {s: count_kept(data, s) for s in SIDES}
    moved = [s for s in SIDES if counts[s] >= max(5.0, 0.005 * sum(counts.values()))]
    if not moved:
        raise NotIdentifiedError(
            "nothing moves in these logs beyond the noise of the motion, and friction shows only "
            "in motion",
            expected="Nothing was written.",
            remedy="Record strokes in both directions, or check --column and --unit of the "
            "motion. Where it does move, sort the rows by time, sample faster or move more slowly "
            "(ten samples or more a stroke: motion that changes from sample to sample looks like "
            "noise), or give --deadband.",
        )
    return moved


def check_measured(data: Sequence[FrictionData]) -> None:
    """Refuse a force that has the same value in all moving samples."""
    force, axis = np.concatenate([d.friction[d.kept] for d in data]), data[0].axis
    if float(np.ptp(force)) <= 1e-12 * float(np.abs(force).max()):
        raise LogError(
            f"the {axis.drive} is {data[0].text(force[0], 'g')} in all {force.size} moving "
            "samples: no sensor does that",
            where=", ".join(d.experiment.name for d in data),
            expected=f"A measured {axis.drive}, with strokes in both directions.",
            remedy=f"Check --column of the {axis.drive} and the {axis.sensor}.",
        )


def half_range(data: Sequence[FrictionData]) -> float:
    """Half the difference of the mean forces of both directions, or the only mean force [N]."""
    force = np.concatenate([d.matched[d.kept] for d in data])
    forward = np.concatenate([d.side("positive") for d in data])
    if forward.all() or not forward.any():
        return abs(float(np.mean(force)))
    return 0.5 * abs(float(np.mean(force[forward]) - np.mean(force[~forward])))
