"""Which moving samples a fit leaves out because of how they move, before it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import Notice
from ...experiment import FloatArray
from .options import SIDES, FrictionOptions
from .samples import Data, count_sides, described, half_range

_SMALL = 0.05  # share of the friction that inertia may have before it matters
_CORNER = 4.0  # times its usual size that a second difference has at a corner of the velocity
_SHARP = 0.02  # of the highest speed that it is there at least
_BETTER = 0.5  # of the standard errors with corners that there have to be without them
_BIASED = 3.0  # standard errors of a difference that is no chance


def _columns(d: Data) -> FloatArray:
    """Columns of both levels and the speed at the kept samples, shape ``(kept, 3)``."""
    signs, regressor = d.direction[d.kept], d.motion.regressor[d.kept]
    return np.column_stack((1.0 + signs, 1.0 - signs, regressor))


def _within(data: Sequence[Data], options: FrictionOptions) -> list[Data]:
    """The runs with the samples that the options describe alone."""
    return [replace(d, kept=d.kept & described(d.motion, options)) for d in data]


def leave_out_accelerations(
    data: Sequence[Data], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions, list[Notice]]:
    """Leave out samples in which an unknown mass would show, and settle which these are.

    The mass is estimated along with friction, only to see where its force exceeds a share
    of the friction.
    """
    unchanged, axis = (list(data), options), data[0].axis
    rows = []
    for d in data:
        if d.motion.acceleration is None:
            return *unchanged, []
        rows.append(np.column_stack((_columns(d), d.motion.acceleration[d.kept])))
    a, force = np.vstack(rows), np.concatenate([d.matched[d.kept] for d in data])
    step = min(d.experiment.sample_time for d in data)
    if np.abs(a[:, 3]).max() <= 1e-9 * np.abs(a[:, 2]).max() / step:
        return *unchanged, []  # rounding, no acceleration
    a = a[:, np.any(a != 0.0, axis=0)]
    scale = np.linalg.norm(a, axis=0)
    mass = float((np.linalg.lstsq(a / scale, force, rcond=None)[0] / scale)[-1])
    share = _SMALL * half_range(data)
    if mass * float(np.quantile(np.abs(a[:, -1]), 0.999)) <= share:
        return *unchanged, []
    options = replace(options, acceleration_limit=share / mass)
    quiet = _within(data, options)
    before, after = count_sides(data), count_sides(quiet)
    if any(after[s] < 0.2 * before[s] for s in SIDES):
        message = (
            f"accelerating takes more than {100 * _SMALL:.0f} % of the friction in most of "
            f"the moving samples (about {mass:.3g} {axis.inertia_unit}). Give --{axis.inertia}="
            f"{axis.inertia_unit.replace(' ', '').upper()} to subtract it."
        )
        return *unchanged, [Notice("inertia-matters", message)]
    return quiet, options, []


def leave_out_turns(
    data: Sequence[Data], options: FrictionOptions
) -> tuple[list[Data], FrictionOptions]:
    """Leave out samples about corners of the velocity that lie between two readings.

    The force changes with the acceleration there, at an instant that readings far apart do not
    show; samples of a few ramps then have nearly all of the error. They are left out where the
    others, fewer and missed by far less, tell levels and slope far better, and where with them
    these are others beyond doubt [1]_.

    .. [1] J. Hausman, "Specification tests in econometrics", Econometrica 46, 1978.
    """
    if not all(d.experiment.time.size for d in data):
        return list(data), options
    usual = float(np.median(np.concatenate([d.motion.turns[d.kept] for d in data])))
    fast = max(float(np.abs(d.speed).max(initial=0.0)) for d in data)
    limit = max(_CORNER * usual, _SHARP * fast)
    settled = replace(options, turn_limit=limit)
    smooth = _within(data, settled)
    every, others = (np.vstack([_columns(d) for d in runs]) for runs in (data, smooth))
    if others.shape[0] == every.shape[0] or min(count_sides(smooth).values()) == 0:
        return list(data), options
    force, rest = (np.concatenate([d.matched[d.kept] for d in runs]) for runs in (data, smooth))
    law = np.linalg.lstsq(others, rest, rcond=None)[0]
    moved = np.linalg.lstsq(every, force, rcond=None)[0] - law
    with_them = float(np.mean((force - every @ law) ** 2))
    without = float(np.mean((rest - others @ law) ** 2))
    told, left = _information(every), _information(others)
    biased = moved**2 * told * left > _BIASED**2 * without * (told - left)
    better = without * told < _BETTER**2 * with_them * left
    asked = told > 0.0
    if np.all(better[asked]) or np.any(biased[asked] & (left[asked] > 0.0)):
        return smooth, settled
    return list(data), options


def _information(columns: FloatArray) -> FloatArray:
    """What the samples say of every column beside the others, shape ``(3,)``."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    table = columns / size
    with np.errstate(divide="ignore"):
        return np.asarray(size**2 / np.diag(np.linalg.pinv(table.T @ table)))
