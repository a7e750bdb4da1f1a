"""Warnings of a fit, and its details in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...errors import LogError, Notice
from ...estimation.uncertainty import model_of_residuals
from ...mechanics.friction_law import FrictionLaw, unequal_levels
from .axis import LINEAR
from .filters import DEGREE
from .fit import FrictionFit, levels_impossible
from .options import ONE_SIDED, SIDES
from .samples import LEVELS, half_range

_BEYOND_DOUBT = 4.0  # standard errors of a parameter by which logs differ beyond doubt


def fit_notices(fit: FrictionFit) -> Iterator[Notice]:
    """Yield everything that a reader of the file should be warned of."""
    yield from _explain_levels(fit)
    width = 2.0 * half_range(fit.data)
    yield from fit.found.spike_notices(width, fit.data[0].text, fit.axis.sensor)
    yield from _warn_of_disagreement(fit)


def _explain_levels(fit: FrictionFit) -> Iterator[Notice]:
    """Name the offset of the force, or what of the levels could be one."""
    drive, sensor, linear = fit.axis.drive, fit.axis.sensor, fit.axis is LINEAR
    derived, choice = fit.derived(), fit.options.offset
    if fit.options.force_offset:
        size = f"{derived[fit.offset].number:.4g} {fit.axis.force_unit}"
        lead = (
            f"the {drive} has an offset ({'another chamber, ' * linear}gravity, a preload or the "
            "sensor's zero), without which a level would be negative. "
        )
        yield Notice(
            "force-offset",
            f"{lead * (choice == 'auto')}The levels are taken as equal about an offset of "
            f"{size}: only their mean is measured, and a difference between them cannot be "
            f"separated from the offset. Remove the offset (zero the {sensor} unloaded"
            + ", or subtract the other chamber's pressure" * linear
            + ") and give --offset=none.",
        )
    elif levels_impossible(fit.found):
        if choice == "none":
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
    elif choice == "auto" and all(n in fit.solved.names for n in LEVELS):
        if len(fit.solved.refused.keys() & {*ONE_SIDED}) == 1:
            return  # the level of that direction has viscous friction in it, the other has not
        for text in unequal_levels(
            derived, drive,
            f"the zero of the {sensor}, a converter that truncates, weight, a preload",
            f"Read the {sensor} unloaded: if it shows zero, give --offset=none; if friction is "
            "known to be the same both ways, give --offset=free.",
        ):  # fmt: skip
            yield Notice("asymmetry-or-offset", text)


def _warn_of_disagreement(fit: FrictionFit) -> Iterator[Notice]:
    """Warn of the log whose mean friction is least that of the fit.

    Of one too slow to be fitted the mean speed is known where that of a sample is lost in noise.
    """
    law, unit = FrictionLaw.of(fit.solved.values), fit.axis.speed_unit
    offset = fit.derived()[fit.offset].number if fit.options.force_offset else 0.0
    off = []
    for d, rest in zip(fit.data, fit.found.residuals):
        for side, sign in zip(SIDES, (1.0, -1.0)):
            if side in fit.ranges and (own := rest[d.side(side)]).size >= 5:
                off.append((sign * float(own.mean()), d, f"in the {side} direction"))
        if not d.kept.any():
            v = d.motion.regressor
            speed, least = (
                float(v.mean()),
                _BEYOND_DOUBT * np.sqrt((2 * d.motion.reach + 1) / v.size),
            )
            more = np.sign(speed) * (float(d.friction.mean()) - offset - float(law.moving(speed)))
            if abs(speed) > least * v.std() and abs(more) > least * d.friction.std():
                off.append((float(more), d, f"at {abs(speed):.2g} {unit}"))
    off = [o for o in off if abs(o[0]) > 0.25 * half_range(fit.data)]
    if len(fit.data) > 1 and off:
        more, d, where = max(off, key=lambda o: abs(o[0]))
        remedy = f"Fit logs of different {'pressure' if fit.axis is LINEAR else 'load'} separately."
        if not d.kept.any():
            remedy = (
                "That log is too slow for the dead band, and the levels are those of faster motion "
                "only: record such speeds with less noise and give --stribeck=estimate."
            )
        yield Notice(
            "logs-disagree",
            f"the logs do not share one friction: in {d.experiment.name} it is {d.text(abs(more))} "
            f"{'more' if more > 0.0 else 'less'} than the fit gives {where}. {remedy}",
        )


def fit_details(fit: FrictionFit, left_out: Mapping[str, int]) -> dict[str, Any]:
    """Details of the method, for the file; the instrument is the one in ``Z' (F - A x) = 0``."""
    order, half_width = fit.found.uncertainty.order, fit.options.filter or 0.0
    matched = any(d.motion.reach > 0 for d in fit.data)
    instrument = "the velocity itself, whose noise shifts nothing"
    if matched:
        instrument = f"slope of the {fit.axis.place}"
    elif fit.found.instrumented:
        instrument = "velocity of the neighbouring samples"
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
        "left_out": dict(left_out),
        "force_noise": fit.found.uncertainty.sigma,
        "speeds": {s: [low, high] for s, (low, high) in fit.ranges.items()},
        "covariance": model_of_residuals(order),
    }
