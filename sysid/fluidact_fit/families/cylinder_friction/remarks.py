"""Remarks on a fit: warnings, and the details in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...errors import LogError, Notice
from ...estimation.uncertainty import model_of_residuals
from ...mechanics.friction_law import FrictionLaw, unequal_levels
from .axis import LINEAR
from .filters import DEGREE
from .fit import Fit, levels_impossible
from .options import ONE_SIDED
from .samples import LEVELS, half_range

_TOLD = 4.0  # standard errors of a parameter by which logs differ beyond doubt


def remarks(fit: Fit) -> Iterator[Notice]:
    """Everything that a reader of the file should be warned of."""
    yield from _explain_levels(fit)
    width = 2.0 * half_range(fit.data)
    yield from fit.found.spike_notices(width, fit.data[0].say, fit.axis.sensor)
    yield from _warn_of_slow_logs(fit)
    yield from _warn_of_disagreement(fit)
    yield from _warn_of_attenuation(fit)


def _explain_levels(fit: Fit) -> Iterator[Notice]:
    """Name the offset of the force, or what of the levels could be one."""
    drive, unit = fit.axis.drive, fit.axis.force_unit
    chamber = "another chamber, " * (fit.axis is LINEAR)
    if fit.options.force_offset:
        size = fit.derived()[fit.offset].number
        lead = (
            f"the {drive} has an offset of {size:.4g} {unit} ({chamber}gravity, a preload or "
            "the sensor's zero), so a level about zero would be negative. "
        )
        asked = fit.options.offset == "estimate"
        yield Notice(
            "force-offset",
            lead
            * (not asked)
            + f"The levels are taken as equal about the offset of {size:.4g} {unit}: only their "
            "mean is measured, and a difference between them cannot be separated from the offset. "
            f"Remove the offset (zero the {fit.axis.sensor} unloaded"
            + ", or subtract the other chamber's pressure" * bool(chamber)
            + ") and give --offset=none.",
        )
    elif levels_impossible(fit.found):
        if fit.options.offset == "none":
            raise LogError(
                f"a Coulomb level would be negative: the {drive} has an offset",
                where=", ".join(d.experiment.name for d in fit.data),
                remedy=f"Leave out --offset=none to estimate it, or subtract it from the {drive}.",
            )
        yield Notice(
            "negative-friction",
            f"a Coulomb level would be negative and was held at zero: the {drive} has an offset, "
            "or friction is not linear in speed. Record strokes in both directions at several "
            "speeds.",
        )
    elif fit.options.offset == "auto":
        yield from _warn_of_asymmetry(fit)


def _warn_of_asymmetry(fit: Fit) -> Iterator[Notice]:
    """Warn of levels that differ."""
    derived, sensor = fit.derived(), fit.axis.sensor
    if len(fit.solved.refused.keys() & {*ONE_SIDED}) == 1:
        return  # the level of that direction has viscous friction in it, the other has not
    if all(n in fit.solved.names for n in LEVELS) and "coulomb_offset" in derived:
        for text in unequal_levels(
            derived, fit.axis.drive,
            f"the zero of the {sensor}, a converter that truncates, weight, a preload",
            f"Read the {sensor} unloaded: if it shows zero, give --offset=none; if friction is "
            "known to be the same both ways, give --offset=estimate.",
        ):  # fmt: skip
            yield Notice("asymmetry-or-offset", text)


def _warn_of_slow_logs(fit: Fit) -> Iterator[Notice]:
    """Warn where logs too slow to be fitted hold another friction than the law gives.

    Their mean speed is known where that of a sample is lost in noise.
    """
    law = FrictionLaw.of(fit.solved.values)
    offset = fit.derived()[fit.offset].number if fit.options.force_offset else 0.0
    off = []
    for d in fit.data:
        m = d.motion
        if d.kept.any() or not d.driven or not m.regressor.size:
            continue
        speed, force = float(m.regressor.mean()), float(d.friction.mean()) - offset
        errors = np.array([m.regressor.std(), d.friction.std()])
        errors *= _TOLD * np.sqrt((2 * m.reach + 1) / m.regressor.size)
        more = np.sign(speed) * (force - float(law.moving(speed)))
        if abs(speed) > errors[0] and abs(more) > max(errors[1], 0.25 * half_range(fit.data)):
            off.append((float(more), speed, d))
    if off:
        more, speed, d = max(off, key=lambda found: abs(found[0]))
        word = "more" if more > 0.0 else "less"
        yield Notice(
            "friction-at-low-speed",
            f"{len(off)} logs that are too slow for the dead band hold another friction: "
            f"{d.say(abs(more))} {word} than the fit gives at {abs(speed):.2g} "
            f"{fit.axis.speed_unit} ({d.experiment.name})."
            + " Friction falls with speed there, and the levels are those of faster motion only."
            * (more > 0.0)
            + " Record these speeds with less noise of the motion and give --stribeck=estimate.",
        )


def _warn_of_disagreement(fit: Fit) -> Iterator[Notice]:
    """Warn of logs whose mean friction is not that of the fit."""
    means = [
        (abs(float(np.mean(r[d.side(s)]))), d.experiment.name, s)
        for d, r in zip(fit.data, fit.found.residuals)
        for s in fit.ranges
        if d.side(s).sum() >= 5
    ]
    off, log, side = max(means, default=(0.0, "", ""))
    if len(fit.data) > 1 and off > 0.25 * half_range(fit.data):
        cause = "pressure" if fit.axis is LINEAR else "load or temperature"
        yield Notice(
            "logs-disagree",
            f"the logs do not share one friction: in {log}, {side} direction, it is "
            f"{fit.data[0].say(off)} off the common fit. Fit logs of different {cause} "
            "separately.",
        )


def _warn_of_attenuation(fit: Fit) -> Iterator[Notice]:
    """Warn where viscous friction depends on the noise of the velocity that was subtracted."""
    rates = [n for n in fit.options.rates if n in fit.found.free.names]
    if not rates:
        return
    sides = [s for s in fit.ranges if rates[0] == "viscous" or f"viscous_{s}" in rates]
    speeds = [np.concatenate([d.speed[d.side(s)] for d in fit.data]) for s in sides]
    within = [v - v.mean() for v in speeds]
    if rates[0] == "viscous":  # one value feels the spread of all speeds
        within = [np.concatenate(within)]
    shared = max(d.motion.shared for d in fit.data)
    share = shared**2 / max(min(float(np.mean(v**2)) for v in within), 1e-300)
    if share > 0.05:
        yield Notice(
            "velocity-noise",
            f"{100 * share:.0f} % of the variance of the speed is noise. It would make viscous "
            "friction too small by as much. The bias was removed, but the size of the noise is "
            "known from the log only. Give a longer --filter, or a better velocity.",
        )


def fit_details(fit: Fit, counts: Mapping[str, int]) -> dict[str, Any]:
    """Details of the method, for the file; the instrument is the one in ``Z' (F - A x) = 0``."""
    order, half_width = fit.found.uncertainty.order, fit.options.filter or 0.0
    matched = any(d.motion.reach > 0 for d in fit.data)
    if matched:
        instrument = f"slope of the {fit.axis.place}"
    elif any(d.motion.shared > 0.0 for d in fit.data):
        instrument = "the velocity itself"
    elif fit.found.instrumented:
        instrument = "velocity of the neighbouring samples"
    else:
        instrument = "the velocity itself, whose noise shifts nothing"
    return {
        "method": "linear regression on moving samples",
        "instrument": instrument,
        "velocity_filter": {
            "type": "zero-phase local polynomial" if half_width > 0.0 else "none",
            "half_width": half_width,
            "degree": DEGREE,
        },
        "force_filter": "matched to the velocity filter" if matched else "none",
        "deadband": fit.options.deadband,
        "left_out": dict(counts),
        "force_noise": fit.found.uncertainty.sigma,
        "speeds": {s: [low, high] for s, (low, high) in fit.ranges.items()},
        "covariance": model_of_residuals(order),
    }
