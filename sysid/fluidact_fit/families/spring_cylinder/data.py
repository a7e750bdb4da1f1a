"""Runs as the regression takes them: drive, motion and motion state, and the samples to fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import LogError
from ...estimation.motion_state import choose_dead_band, held_direction, motion_state
from ...experiment import BoolArray, Experiment, FloatArray
from ...specification import Variant
from .equation import SpringLaw
from .instruments import REACH, Instrument, Motion, differentiate, instruments
from .options import SpringOptions


@dataclass(frozen=True)
class Run:
    """One run, ready for the regression: arrays of shape ``(n,)`` [SI].

    ``force`` is NaN where none was recorded, ``kept`` marks the samples that can be fitted.
    ``instruments`` stand in for the columns that carry noise.
    """

    experiment: Experiment
    drive: FloatArray
    position: FloatArray
    velocity: FloatArray
    direction: FloatArray
    force: FloatArray
    kept: BoolArray
    instruments: Mapping[str, Instrument]

    def predict(self, law: SpringLaw) -> FloatArray:
        """Force of the model at every sample [N]."""
        return law.force(self.drive, self.position, self.direction, self.velocity)


def prepare(
    variant: Variant, experiments: Sequence[Experiment], options: SpringOptions
) -> tuple[list[Run], SpringOptions]:
    """All runs; options with one source of the motion state and one dead band for all logs."""
    if options.motion_state == "auto":
        recorded = ["direction" in e for e in experiments]
        if all(recorded):
            options = replace(options, motion_state="direction")
        elif not any(recorded):
            options = replace(options, motion_state="command")
    turning = [_turning(e, variant, options) for e in experiments]
    if options.dead_band is None:
        bands = [choose_dead_band(s) for s in turning if s is not None]
        options = replace(options, dead_band=max(bands, default=None))
    return [_prepare_run(e, variant, s, options) for e, s in zip(experiments, turning)], options


def _turning(e: Experiment, variant: Variant, options: SpringOptions) -> FloatArray | None:
    """Signal whose changes give the motion state; ``None`` where a column does."""
    if "direction" in e and options.motion_state in ("auto", "direction"):
        return None
    if options.motion_state == "direction":
        raise LogError(
            "the motion state is to come from the log, and there is no 'direction'.",
            where=e.name,
            remedy="Give --column direction=HEADER, or leave --motion-state out of the fit.",
        )
    return e.sampled("position" if options.motion_state == "position" else variant.name)


def _prepare_run(
    e: Experiment, variant: Variant, turning: FloatArray | None, options: SpringOptions
) -> Run:
    drive, position = e.sampled(variant.name), e.sampled("position")
    motion = _motion(e, position)
    found = instruments(e, drive, position, motion)
    if turning is None:
        direction = motion_state(e.sampled("direction"))
    else:
        direction = held_direction(turning, options.dead_band or 0.0)
    force = e.sampled("force") if "force" in e else np.full(e.samples, np.nan)
    noise = found["drive"].noise if "drive" in found else 0.0
    if noise <= e.signals[variant.name].resolution:
        noise = 0.0  # rounding
    away = _away_from_reversals(_without_itself(drive) if noise else drive, noise, direction,
                                options.settle)  # fmt: skip
    kept = (direction != 0.0) & motion.inside & away
    return Run(e, drive, position, motion.rate, direction, force, kept, found)


def _motion(e: Experiment, position: FloatArray) -> Motion:
    """Velocity, its own or from position, and where it can be relied upon."""
    everywhere = np.ones(position.size, dtype=bool)
    if "velocity" in e:
        return Motion(e.sampled("velocity"), everywhere, 0.0)
    if e.time.size < 12 or e["position"].size < position.size:
        return Motion(np.zeros(position.size), everywhere, 0.0)
    if e.uniform:
        return differentiate(position, e.sample_time)
    rate = np.asarray(np.gradient(position, e.time))
    return Motion(rate, everywhere, 1.0 / (np.sqrt(2.0) * e.sample_time))


def _without_itself(drive: FloatArray) -> FloatArray:
    """Mean of the samples around each: to choose samples by their own noise would bias the fit."""
    kernel = np.ones(2 * REACH + 1)
    kernel[REACH] = 0.0
    total = np.convolve(drive, kernel, mode="same")
    return np.asarray(total / np.convolve(np.ones(drive.size), kernel, mode="same"))


def _away_from_reversals(
    drive: FloatArray, noise: float, direction: FloatArray, settle: float
) -> BoolArray:
    """Samples whose friction has reversed: the drive has moved far enough since the reversal.

    ``noise`` is the distance from the extreme within which a reversal may have come earlier.
    """
    turned = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1))
    span = float(np.ptp(drive))
    kept = np.ones(drive.size, dtype=bool)
    for begin, end in zip(turned, [*turned[1:], drive.size]):
        if begin:  # the record's start is no reversal
            kept[begin:end] = np.abs(drive[begin:end] - drive[begin]) >= settle * span
        if end < drive.size:  # the dead band notices a reversal late: from the extreme on
            way = direction[begin] or 1.0
            part = way * drive[begin:end]
            last = int(np.argmax(part))
            if noise:
                last = int(np.argmax(part > part[last] - noise)) - 1
            kept[begin + last + 1 : end] = False
    return kept
