"""Samples for the regression: friction force of every log, and those that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError, Notice, NotIdentifiedError
from ...experiment import Experiment, FloatArray
from ...family import Variant
from .filters import Mask
from .motion import SLOW, Motion, make_motions, match_force
from .options import PRESSURES, Options, check_options, motion_role

SIDES = ("positive", "negative")
_LINGER = 1.5  # times the way through rest that its slope foretells: longer is a rest
_SMALL = 0.05  # share of the friction that inertia may have before it matters


@dataclass(frozen=True)
class Data:
    """One log, ready for the regression.

    ``known`` is the part of the drive that is no friction, ``friction`` the rest, and
    ``matched`` that rest smoothed like the regressor, all of shape ``(n,)`` [N];
    ``direction`` is the sign of the velocity, smoothed alike. ``kept`` marks the samples
    that are fitted. The output is the drive divided by ``scale``.
    """

    experiment: Experiment
    motion: Motion
    known: FloatArray
    friction: FloatArray
    matched: FloatArray
    direction: FloatArray
    kept: Mask
    scale: float

    @property
    def speed(self) -> FloatArray:
        """Velocities of the kept samples [m/s]."""
        return self.motion.velocity[self.kept]

    @property
    def support(self) -> Mask:
        """Samples that the fitted ones depend on, shape ``(n,)``."""
        reach, n = self.motion.reach, self.kept.size
        if not reach:
            return self.kept
        count = np.concatenate(([0], np.cumsum(self.kept)))
        at = np.arange(n)
        return np.asarray(
            count[np.minimum(at + reach + 1, n)] > count[np.maximum(at - reach, 0)], dtype=bool
        )

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

    def side(self, side: str) -> Mask:
        """Which of the kept samples move in a direction."""
        return self.speed > 0.0 if side == "positive" else self.speed < 0.0


def _choose_deadband(motions: Sequence[Motion]) -> float:
    """Speed below which a sample may be at rest: noise, or a share of the speed [m/s].

    The slowest log that moves at all sets the share, so that a fast one does not hide it.
    """
    floor = 4.0 * max(m.noise for m in motions)
    moving = [m.fast for m in motions if m.fast > floor]
    return float(max(floor, SLOW * min(moving, default=0.0)))


def _moving(motion: Motion, deadband: float) -> Mask:
    """Samples that move, and whose filter window holds no rest, shape ``(n,)``.

    Near a rest the filter spreads motion over samples that stand still. A reversal in
    passing has no rest: what lies within the deadband there is left out alone, unless the
    matched force is a mean over it.
    """
    v = motion.velocity
    idle = np.abs(v) <= deadband
    lost = np.zeros(v.size + 1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], idle, [False])).astype(int)))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist()):
        reach = motion.reach
        if not _passes(v, begin, end, deadband):
            reach = max(reach, motion.half)
        lost[max(begin - reach, 0)] += 1.0
        lost[min(end + reach, v.size)] -= 1.0
    kept = (np.cumsum(lost[:-1]) < 0.5) & motion.inside
    if motion.reach:  # reversals that follow each other so fast leave no cubic to match
        turns = np.concatenate(([0], np.cumsum(np.sign(v[1:]) != np.sign(v[:-1]))))
        at, last = np.arange(v.size), v.size - 1
        span = 2 * motion.reach
        after, before = np.minimum(at + span, last), np.maximum(at - span, 0)
        kept &= turns[after] - turns[before] <= 1
    return np.asarray(kept)


def _passes(velocity: FloatArray, begin: int, end: int, deadband: float) -> bool:
    """Whether samples ``begin`` to ``end`` are on the way from one direction to the other."""
    if begin < 1 or end + 1 > velocity.size:
        return False
    before, after = float(velocity[begin - 1]), float(velocity[min(end, velocity.size - 1)])
    if before * after >= 0.0:
        return False
    # as many samples as a straight line through the neighbours of the deadband would need
    run = end - begin
    slope = abs(after - before) / (run + 1)
    edge = [abs(velocity[begin - 1] - velocity[max(begin - 2, 0)]),
            abs(velocity[min(end + 1, velocity.size - 1)] - after)]  # fmt: skip
    return bool(run <= 1 or _LINGER * slope >= 0.5 * (edge[0] + edge[1]))


def _pressure_force(experiment: Experiment, options: Options) -> FloatArray | float:
    """Force of the chambers, ``A_1 p_1 - A_2 p_2`` [N]."""
    out: FloatArray | float = 0.0
    for role, area, sign in (("pressure", options.area, 1.0), ("pressure_2", options.area_2, -1.0)):
        if area is not None and role in experiment:
            out = out + sign * area * experiment.sampled(role)
    return out


def driving_force(experiment: Experiment, options: Options) -> FloatArray | None:
    """What drives the motion [N]: the force, or the first chamber's without one."""
    if "force" in experiment:
        return experiment["force"]
    if "pressure" in experiment and options.area is not None:
        return np.asarray(options.area * experiment["pressure"])
    return None


def prepare(
    variant: Variant,
    experiments: Sequence[Experiment],
    options: Options,
    half_width: float | None = None,
) -> tuple[list[Data], float, float]:
    """Friction force and moving samples per log; filter half-width [s], deadband [m/s]."""
    check_options(variant, experiments, options)
    role = motion_role(variant)
    driven = variant.name.endswith(PRESSURES)
    wanted = options.half_width if half_width is None else half_width
    motions, half_width = make_motions(experiments, role, wanted)
    deadband = _choose_deadband(motions) if options.deadband is None else options.deadband
    out = []
    for e, motion in zip(experiments, motions):
        inertia: FloatArray | float = 0.0
        kept = _moving(motion, deadband)
        if options.mass is not None and motion.acceleration is not None:
            inertia = options.mass * motion.acceleration
        pressure = _pressure_force(e, options)
        drive = driving_force(e, options)
        if driven:
            assert options.area is not None
            pressure = options.area * e.sampled("pressure") - pressure  # that of the other one
        size = motion.velocity.size
        rest = np.zeros(size) if drive is None else drive - pressure
        known = np.broadcast_to(pressure + inertia, (size,))
        scale = float(options.area or 1.0) if driven else 1.0
        matched = match_force(e, role, motion, rest) - inertia
        direction = match_force(e, role, motion, np.sign(motion.velocity))
        out.append(Data(e, motion, known, rest - inertia, matched, direction, kept, scale))
    return out, half_width, deadband


def sides_moved(data: Sequence[Data]) -> list[str]:
    """Directions with enough moving samples to average.

    Raises
    ------
    NotIdentifiedError
        When nothing moves.
    """
    counts = {s: sum(int(d.side(s).sum()) for d in data) for s in SIDES}
    least = max(5.0, 0.005 * sum(counts.values()))
    moved = [s for s in SIDES if counts[s] >= least]
    if not moved:
        raise NotIdentifiedError(
            "nothing moves in these logs, and friction shows in motion only",
            expected="Nothing was written.",
            remedy="Record strokes in both directions, or check --column and --unit of the "
            "motion, or give a smaller --deadband.",
        )
    return moved


def check_measured(data: Sequence[Data]) -> None:
    """Refuse a force that never changes while the piston moves.

    Raises
    ------
    LogError
        When all moving samples hold one and the same value.
    """
    force = np.concatenate([d.friction[d.kept] for d in data])
    span = float(np.ptp(force))
    if span > 1e-12 * float(np.abs(force).max()):
        return
    raise LogError(
        f"the force is {force[0]:g} N in all {force.size} moving samples: no sensor reads so",
        where=", ".join(d.experiment.name for d in data),
        expected="A measured force, with strokes in both directions. Nothing was written.",
        remedy="Check --column of the force and the load cell.",
    )


def half_range(data: Sequence[Data]) -> float:
    """Half the distance of the mean forces of the two directions, or the one there is [N]."""
    force = np.concatenate([d.matched[d.kept] for d in data])
    forward = np.concatenate([d.side("positive") for d in data])
    if forward.all() or not forward.any():
        return abs(float(np.mean(force)))
    return 0.5 * float(np.mean(force[forward]) - np.mean(force[~forward]))


def leave_out_accelerations(data: Sequence[Data]) -> tuple[list[Data], int, list[Notice]]:
    """Leave out samples in which an unknown mass would show.

    The mass is estimated along with friction, only to see where its force exceeds a share
    of the friction.
    """
    if any(d.motion.acceleration is None for d in data):
        return list(data), 0, []
    rows, force = [], np.concatenate([d.matched[d.kept] for d in data])
    for d in data:
        assert d.motion.acceleration is not None
        signs, regressor = d.direction[d.kept], d.motion.regressor[d.kept]
        acceleration = d.motion.acceleration[d.kept]
        rows.append(np.column_stack((1.0 + signs, 1.0 - signs, regressor, acceleration)))
    a = np.vstack(rows)
    step = min(d.experiment.sample_time for d in data)
    if np.abs(a[:, 3]).max() <= 1e-9 * np.abs(a[:, 2]).max() / step:
        return list(data), 0, []  # rounding, no acceleration
    a = a[:, np.any(a != 0.0, axis=0)]
    scale = np.linalg.norm(a, axis=0)
    mass = float((np.linalg.lstsq(a / scale, force, rcond=None)[0] / scale)[-1])
    limit = _SMALL * abs(half_range(data))
    if mass * float(np.quantile(np.abs(a[:, -1]), 0.999)) <= limit:
        return list(data), 0, []
    quiet = [
        replace(d, kept=d.kept & (np.abs(np.asarray(d.motion.acceleration)) * mass <= limit))
        for d in data
    ]
    for s in SIDES:
        before, after = (sum(int(d.side(s).sum()) for d in some) for some in (data, quiet))
        if after < 0.2 * before:
            message = (
                f"accelerating takes more than {100 * _SMALL:.0f} % of the friction in most of "
                f"the moving samples (about {mass:.3g} kg). Give --mass KG to take it off."
            )
            return list(data), 0, [Notice("inertia-matters", message)]
    return quiet, int(sum(d.kept.sum() for d in data) - sum(d.kept.sum() for d in quiet)), []
