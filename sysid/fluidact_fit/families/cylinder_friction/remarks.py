"""What is said about a fit: warnings, and the details in the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import LogError, Notice
from ...experiment import Experiment, FloatArray
from ...family import Variant
from .filters import DEGREE
from .fit import Fit
from .regression import System
from .samples import Data, half_range, prepare


def warn_of_spikes(fit: Fit) -> list[Notice]:
    """Warn of residuals far outside all others: they bias a least-squares fit."""
    bare = zip(fit.data, fit.found.bare_residuals)
    r = np.concatenate([r[d.kept[d.support]] for d, r in bare])
    spread = 1.4826 * float(np.median(np.abs(r - np.median(r))))
    limit = max(8.0 * spread, 2.0 * abs(half_range(fit.data)))
    count = int(np.sum(np.abs(r - np.median(r)) > limit))
    if not count:
        return []
    message = (
        f"{count} of {r.size} moving samples lie more than {limit:.3g} N off the fit: "
        "spikes of the load cell, or contact at the end of the stroke. Look at the picture "
        "(--plot) and leave them out with --window."
    )
    return [Notice("force-spikes", message)]


def warn_of_disagreement(fit: Fit) -> list[Notice]:
    """Warn of logs whose mean friction is not that of the fit."""
    limit = 0.25 * abs(half_range(fit.data))
    worst: tuple[float, str, str] = (0.0, "", "")
    for d, r in zip(fit.data, fit.found.residuals):
        for s in fit.moved:
            if d.side(s).sum() >= 5:
                off = abs(float(np.mean(r[d.side(s)])))
                worst = max(worst, (off, d.experiment.name, s))
    if len(fit.data) < 2 or worst[0] <= limit:
        return []
    message = (
        f"the logs do not share one friction: in {worst[1]}, {worst[2]} direction, it is "
        f"{worst[0]:.3g} N off the common fit. Friction of seals rises with pressure: fit logs "
        "of different pressure separately."
    )
    return [Notice("logs-disagree", message)]


def warn_of_attenuation(fit: Fit) -> list[Notice]:
    """Warn where viscous friction depends on the noise of the velocity that was subtracted."""
    if "viscous" not in fit.found.names:
        return []
    within = np.concatenate(
        [v - v.mean() for s in fit.moved if (v := _side_speeds(fit.data, s)).size]
    )
    shared = max(d.motion.shared for d in fit.data)
    share = shared**2 / max(float(np.mean(within**2)), 1e-300)
    if share <= 0.05:
        return []
    message = (
        f"{100 * share:.0f} % of the variance of the speed is noise. It would make viscous "
        "friction too small by as much. The bias was removed, but the size of the noise is known "
        "from the log only. Give a longer --filter, or a better velocity."
    )
    return [Notice("velocity-noise", message)]


def _side_speeds(data: Sequence[Data], side: str) -> FloatArray:
    return np.concatenate([d.speed[d.side(side)] for d in data])


def warn_of_flattening(
    fit: Fit, variant: Variant, experiments: Sequence[Experiment]
) -> list[Notice]:
    """Warn where a filter of twice the width gives another viscous friction.

    A measured velocity enters the regression unfiltered, and nothing can flatten it. With a
    position both sides are filtered alike; what is left is motion too fast for its own
    samples. The two estimates share their noise, so their difference varies as their
    variances differ.
    """
    if "viscous" not in fit.found.names or all(d.motion.reach == 0 for d in fit.data):
        return []
    half_width = fit.options.filter or 0.0
    try:
        wider, _ = prepare(variant, experiments, replace(fit.options, filter=2.0 * half_width))
        both = [replace(w, kept=w.kept & d.kept) for w, d in zip(wider, fit.data)]
        if any(2 * w.kept.sum() < d.kept.sum() for w, d in zip(both, fit.data)):
            return []
        again = System(both, fit.found.names, fit.solved.fixed, fit.limits).solve()
    except LogError:
        return []
    first, second = (f.std_error({"viscous": 1.0}) for f in (fit.found, again))
    error = max(np.sqrt(max(second**2 - first**2, 0.0)), 0.5 * first)
    change = again.free_values["viscous"] - fit.found.free_values["viscous"]
    if abs(change) <= 3.0 * error + 1e-3 * abs(fit.found.free_values["viscous"]):
        return []
    message = (
        f"viscous friction changes by {change:+.3g} N s/m when the velocity filter is twice as "
        f"wide (half-width {half_width:.3g} s): the motion is too fast for these samples, or "
        "friction is not linear in speed. Sample faster, move more slowly, or give a measured "
        "velocity; --filter sets the half-width."
    )
    return [Notice("velocity-flattened", message)]


def _instrument(data: Sequence[Data]) -> str:
    """What stands in for the velocity in ``Z' (F - A x) = 0``."""
    if any(d.motion.reach > 0 for d in data):
        return "slope of the position"
    shared = any(d.motion.shared > 0.0 for d in data)
    return "the velocity itself" if shared else "velocity of the neighbouring samples"


def fit_details(fit: Fit, counts: Mapping[str, int]) -> dict[str, Any]:
    """What was done, for the file."""
    order, half_width = fit.found.uncertainty.order, fit.options.filter or 0.0
    matched = any(d.motion.reach > 0 for d in fit.data)
    return {
        "method": "linear regression on moving samples",
        "instrument": _instrument(fit.data),
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
