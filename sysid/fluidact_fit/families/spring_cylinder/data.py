"""Runs as the regression takes them: drive, motion and motion state, and the samples to fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import LogError
from ...estimation.motion_state import choose_dead_band, held_direction, motion_state
from ...estimation.regression import Balance, RegressionModel
from ...estimation.stribeck import Rise, friction_columns
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import NoiseLevel
from ...specification import Variant
from .equation import LEVELS, SpringLaw
from .instruments import REACH, Instrument, find_instruments, find_motion, mean_around
from .options import SpringOptions

EQUAL = "coulomb_mean"  # stands for both levels where they are taken to be equal
_DROWNED = 2.0  # times the noise of a velocity: below it a speed is not known


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

    @property
    def instrumented(self) -> Run:
        """The run with the instruments of its noisy columns in their place."""
        columns: dict[str, Any] = {name: i.values for name, i in self.instruments.items()}
        return replace(self, instruments={}, **columns)

    def noise(self, name: str) -> float:
        """Noise of a column [its unit]."""
        return self.instruments[name].noise if name in self.instruments else 0.0

    def columns(self, gain: str, rise: Rise) -> dict[str, FloatArray]:
        """Derivative of the force by parameters at the kept samples, shape ``(kept,)`` each."""
        s, v = self.direction[self.kept], self.velocity[self.kept]
        friction = friction_columns(s, v, rise.columns(s, v, self.noise("velocity")))
        friction |= dict(zip(LEVELS, (friction["coulomb_positive"], friction["coulomb_negative"])))
        return {
            gain: self.drive[self.kept],
            "stiffness": -self.position[self.kept],
            "preload": np.full(s.size, -1.0),
            **{name: -column for name, column in friction.items()},
        }

    def balance(self, gain: str, rise: Rise) -> Balance:
        """The run as a balance of forces about a Stribeck level and speed."""
        quiet = self.instrumented.columns(gain, rise)
        s, one = self.direction[self.kept], np.ones(int(self.kept.sum()))
        by_velocity = rise.shares(self.velocity[self.kept], self.noise("velocity"))[2]
        noises = (
            {gain: self.noise("drive") * one},
            {"stiffness": -self.noise("position") * one},
            {
                "viscous": -self.noise("velocity") * one,
                "stribeck": -self.noise("velocity") * s * by_velocity,
            },
        )
        force = self.experiment.signals["force"]
        return Balance(
            self.columns(gain, rise), self.force[self.kept], self.kept,
            quiet if self.instruments else {}, noises, reading=self.force,
            step=force.resolution, timed=self.experiment.time.size > 0,
        )  # fmt: skip


def spring_model(runs: Sequence[Run], gain: str) -> RegressionModel:
    """Balance of the forces on the rod over all runs."""
    step = max(d.experiment.signals["force"].resolution for d in runs)
    return RegressionModel(
        lambda rise: [d.balance(gain, rise) for d in runs],
        speeds(runs),
        _DROWNED * max(d.noise("velocity") for d in runs),
        float(step / np.sqrt(12.0)),
    )


def speeds(runs: Sequence[Run]) -> FloatArray:
    """Velocities of the fitted samples [m/s]."""
    return np.concatenate([d.velocity[d.kept] for d in runs])


def input_noise(variant: Variant, runs: Sequence[Run]) -> dict[str, NoiseLevel]:
    """Noise of the inputs that were recorded, the largest of all runs, by role."""
    out = {}
    for name, role in (("drive", variant.name), ("position", "position"), ("velocity", "velocity")):
        own = [d.noise(name) for d in runs if role in d.experiment]
        out[role] = max(own, default=0.0)
    return {role: NoiseLevel(sigma) for role, sigma in out.items() if sigma}


def prepare(
    variant: Variant, experiments: Sequence[Experiment], options: SpringOptions
) -> tuple[list[Run], SpringOptions]:
    """All runs; options with one source of the motion state and one dead band for all logs."""
    if options.motion_state == "auto":
        recorded = ["direction" in e for e in experiments]
        if all(recorded):
            options = replace(options, motion_state="direction")
        elif not any(recorded):
            held = all(_rests(e.sampled(variant.name)) for e in experiments)
            options = replace(options, motion_state="position" if held else "command")
    turning = [_turning(e, variant, options) for e in experiments]
    if options.dead_band is None:
        bands = [choose_dead_band(s) for s in turning if s is not None]
        options = replace(options, dead_band=max(bands, default=None))
    return [_prepare_run(e, variant, s, options) for e, s in zip(experiments, turning)], options


def _rests(values: FloatArray) -> bool:
    """Return whether a signal never changes by more than its noise: then the rod was moved."""
    return float(np.ptp(values)) <= 2.0 * choose_dead_band(values)


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
    motion = find_motion(e, position)
    found = find_instruments(e, drive, position, motion)
    if turning is None:
        direction = motion_state(e.sampled("direction"))
    else:
        direction = held_direction(turning, options.dead_band or 0.0)
    force = e.sampled("force") if "force" in e else np.full(e.samples, np.nan)
    turns_itself = options.motion_state == "position"
    name, role = ("position", "position") if turns_itself else ("drive", variant.name)
    moves = drive if turning is None else turning
    noise = found[name].noise if name in found else 0.0
    if noise <= e.signals[role].resolution:
        noise = 0.0  # rounding
    # where the rod itself turns, the nearest velocities are of both directions
    beside = REACH + 1 if turns_itself else 0
    if noise:  # to choose samples by their own noise would bias the fit
        moves = mean_around(moves, REACH)
    away = _away_from_reversals(moves, noise, direction, options.settle, beside)
    kept = (direction != 0.0) & motion.inside & away
    if turns_itself:  # and came back within the dead band
        kept &= direction * motion.rate >= 0.0
    return Run(e, drive, position, motion.rate, direction, force, kept, found)


def _away_from_reversals(
    moves: FloatArray, noise: float, direction: FloatArray, settle: float, beside: int
) -> BoolArray:
    """Samples whose friction has reversed: what moves has come far enough since the reversal.

    ``noise`` is the distance from the extreme within which a reversal may have come earlier.
    The extreme itself may be past the turn, and is left out; unless ``beside`` is 0 so are
    ``beside - 1`` samples on either side.
    """
    turned = np.concatenate(([0], np.flatnonzero(np.diff(direction)) + 1))
    span = float(np.ptp(moves))
    kept = np.ones(moves.size, dtype=bool)
    for begin, end in zip(turned, [*turned[1:], moves.size]):
        if begin:  # the record's start is no reversal
            kept[begin:end] &= np.abs(moves[begin:end] - moves[begin]) >= settle * span
        # the dead band notices a reversal late, one just before the end of the record never: from
        # the extreme on, unless what moves rests there in the end; a rod's rest may hide a turn
        part = (direction[begin] or 1.0) * moves[begin:end]
        last = int(np.argmax(part))
        kept[begin + last] = False
        if end < moves.size or beside or part[-1] < part[last] - noise:
            if noise:
                last = int(np.argmax(part > part[last] - noise)) - 1
            kept[max(begin + last + 1 - beside, begin) : end] = False
            kept[end : begin + last + 1 + beside] = False
    return kept
