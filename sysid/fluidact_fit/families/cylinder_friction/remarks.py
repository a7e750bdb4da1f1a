"""What is said about a fit: warnings, and the details in the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import LogError, Notice
from ...estimation.results import Solved
from ...experiment import Experiment
from ...family import Variant
from .axis import LINEAR
from .filters import DEGREE
from .fit import LEVELS, Fit, levels_impossible
from .options import ONE_SIDED
from .regression import System
from .samples import half_range, prepare
from .stribeck import linearise, other_shape

_TOLD = 4.0  # standard errors of half the difference of the levels that is beyond doubt
_NOTABLE = 0.015  # part of their mean that it has to be to matter


def remarks(fit: Fit, variant: Variant, experiments: Sequence[Experiment]) -> Iterator[Notice]:
    """Everything that a reader of the file should be warned of."""
    yield from _explain_levels(fit)
    yield from _warn_of_shape(fit)
    yield from _warn_of_spikes(fit)
    yield from _warn_of_disagreement(fit)
    yield from _warn_of_attenuation(fit)
    yield from _warn_of_flattening(fit, variant, experiments)


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
    """Warn of levels that differ: a constant force gives the same.

    ``F_c+ [v > 0] - F_c- [v < 0]`` is ``(F_c+ + F_c-) / 2 sign(v) + (F_c+ - F_c-) / 2``.
    """
    found = fit.derived()
    if len(fit.solved.refused.keys() & {*ONE_SIDED}) == 1:
        return  # the level of that direction has viscous friction in it, the other has not
    if not all(n in fit.solved.names for n in LEVELS) or "coulomb_offset" not in found:
        return
    half, mean = found["coulomb_offset"].number, found["coulomb_mean"].number
    error = float(np.max(found["coulomb_offset"].std_error or 0.0))
    if abs(half) <= max(_TOLD * error, _NOTABLE * abs(mean)):
        return
    share, unit = abs(200.0 * half / mean), fit.axis.force_unit
    yield Notice(
        "asymmetry-or-offset",
        f"the Coulomb levels differ by {2.0 * half:+.3g} {unit} ({share:.0f} % of their mean, "
        f"{mean:.4g} {unit}, which is measured either way). A constant {fit.axis.drive} of "
        f"{half:+.3g} {unit} (the zero of the {fit.axis.sensor}, a converter that truncates, "
        "weight, a preload) gives the same, and no stroke can tell the two apart. Read the "
        f"{fit.axis.sensor} unloaded: if it shows zero, give --offset=none; if friction is known "
        "to be the same both ways, give --offset=estimate.",
    )


def _warn_of_shape(fit: Fit) -> Iterator[Notice]:
    """Warn where friction rises towards rest in another way."""
    names = fit.found.free.names
    held = {n: v for n, v in fit.found.free.values.items() if n not in names}
    found = other_shape(fit.data, names, held)
    if found is not None:
        yield found


def _warn_of_spikes(fit: Fit) -> Iterator[Notice]:
    """Warn of residuals far outside all others: they bias a least-squares fit."""
    bare = zip(fit.data, fit.found.bare_residuals)
    r = np.concatenate([r[d.kept[d.support]] for d, r in bare])
    off = np.abs(r - np.median(r))
    limit = max(8.0 * 1.4826 * float(np.median(off)), 2.0 * half_range(fit.data))
    count = int(np.sum(off > limit))
    if count:
        yield Notice(
            "force-spikes",
            f"{count} of {r.size} moving samples lie more than {fit.data[0].say(limit)} off "
            f"the fit: spikes of the {fit.axis.sensor}, or contact at the end of the stroke. "
            "Look at the picture (--plot) and leave them out with --window.",
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
        yield Notice(
            "logs-disagree",
            f"the logs do not share one friction: in {log}, {side} direction, it is "
            f"{fit.data[0].say(off)} off the common fit. "
            + "Friction of seals rises with pressure: fit logs of different pressure separately."
            * (fit.axis is LINEAR)
            + "Fit logs of different load or temperature separately." * (fit.axis is not LINEAR),
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


def _warn_of_flattening(
    fit: Fit, variant: Variant, experiments: Sequence[Experiment]
) -> Iterator[Notice]:
    """Warn where a filter of twice the width gives another viscous friction.

    A measured velocity enters the regression unfiltered, and nothing can flatten it. With a
    position both sides are filtered alike; what is left is motion too fast for its own
    samples. The two estimates share their noise, so their difference varies as their
    variances differ.
    """
    first = fit.found.free
    rates = [n for n in fit.options.rates if n in first.names]
    if not rates or all(d.motion.reach == 0 for d in fit.data):
        return
    half_width = fit.options.filter or 0.0
    try:
        wider, _ = prepare(variant, experiments, replace(fit.options, filter=2.0 * half_width))
        both = [replace(w, kept=w.kept & d.kept) for w, d in zip(wider, fit.data)]
        if any(2 * w.kept.sum() < d.kept.sum() for w, d in zip(both, fit.data)):
            return
        held = {n: v for n, v in first.values.items() if n not in first.names}
        stribeck = linearise(both, first.names, held)
        second = System(both, first.names, held, stribeck=stribeck).solve().free
    except LogError:
        return
    changes = {n: second.values[n] - first.values[n] for n in rates if _differs(first, second, n)}
    if changes:
        change = max(changes.values(), key=abs)
        yield Notice(
            "velocity-flattened",
            f"viscous friction changes by {change:+.3g} {fit.axis.viscous} when the velocity "
            f"filter is twice as wide (half-width {half_width:.3g} s): the motion is too fast for "
            "these samples, or friction is not linear in speed. Sample faster, move more slowly, "
            "or give a measured velocity; --filter sets the half-width.",
        )


def _differs(first: Solved, second: Solved, name: str) -> bool:
    """Whether a longer filter changes a value by more than the noise that it removes can."""
    errors = first.std_error(name), second.std_error(name)
    error = max(np.sqrt(max(errors[1] ** 2 - errors[0] ** 2, 0.0)), 0.5 * errors[0])
    change = second.values[name] - first.values[name]
    return bool(abs(change) > 3.0 * error + 1e-3 * abs(first.values[name]))


def fit_details(fit: Fit, counts: Mapping[str, int]) -> dict[str, Any]:
    """What was done, for the file; the instrument is what stands in ``Z' (F - A x) = 0``."""
    order, half_width = fit.found.uncertainty.order, fit.options.filter or 0.0
    matched = any(d.motion.reach > 0 for d in fit.data)
    instrument = "velocity of the neighbouring samples"
    if matched:
        instrument = f"slope of the {fit.axis.place}"
    elif any(d.motion.shared > 0.0 for d in fit.data):
        instrument = "the velocity itself"
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
        "covariance": f"autoregressive residuals of order {order}" if order else "white",
    }
