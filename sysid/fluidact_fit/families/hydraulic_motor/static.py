"""Settled points: the curve of the motor and its hysteresis, without the lag.

The rows are points at which the motor turned steadily, in the order in which they were visited: the
play needs to know from which side each was approached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ...errors import NotIdentifiedError, UsageError
from ...estimation.named_map import NamedFit, NamedRows, fit_named_map
from ...estimation.named_model import Values
from ...estimation.significance import DECISIVE
from ...experiment import Array, Experiment, FloatArray
from ...specification import Request, Variant
from .equation import play, static_speed
from .fit import (
    MIDDLES,
    OFFSET,
    SATURATION,
    MotorOptions,
    curve_axes,
    highest_command,
    is_reached,
    middle_of_commands,
    refused_beforehand,
    require_motion,
    searched_curve,
)

_BEST = 3  # starts of a search


def law(values: Values, x: FloatArray) -> Array:
    """Steady speeds; ``x`` holds the commands and the number of the log of each, ``(n, 2)``.

    Before the first point the motor stood still, its spool in the middle.
    """
    width, spool = values["hysteresis"], []
    size, middle = float(np.real(width)), float(np.real(values.get(OFFSET, 0.0)))
    for number in np.unique(x[:, 1]):
        place, slope = play(np.append(middle, x[x[:, 1] == number, 0]), size)
        spool.append((place + slope * (width - size))[1:])
    return static_speed(np.concatenate(spool), values)


def commands(experiments: Sequence[Experiment]) -> list[FloatArray]:
    """Commands of all runs with the number of each, ``(n_i, 2)``."""
    return [
        np.column_stack((e.sampled("command"), np.full(e.samples, k)))
        for k, e in enumerate(experiments)
    ]


def gather(experiments: Sequence[Experiment]) -> NamedRows:
    """Commands and speeds of all runs, in order."""
    return NamedRows.of(
        commands(experiments), [e.signals["speed"] for e in experiments], in_order=True
    )


def fit_points(
    variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions]
) -> NamedFit:
    """Fit the curve, with a saturation where the points show one.

    Raises
    ------
    UsageError
        For options that speak of samples in time.
    """
    options = request.options
    for name in ("start_state", "offset"):
        if getattr(options, name) is not None:
            raise UsageError(
                f"--{name.replace('_', '-')} means nothing to settled points",
                remedy="Leave it out, or --mode=static.",
            )
    require_motion(experiments)
    if SATURATION in {**request.fixed, **request.start}:
        return _fit(variant, experiments, request, saturated=True)
    plain = _fit(variant, experiments, request, saturated=False)
    try:
        bent = _fit(variant, experiments, request, saturated=True)
    except NotIdentifiedError:
        return plain
    rise = bent.data.y.size * (plain.fit.cost / max(bent.fit.cost, 1e-300) - 1.0)
    return bent if rise > DECISIVE and is_reached(experiments, bent.solved) else plain


def _fit(
    variant: Variant, experiments: Sequence[Experiment], request: Request[MotorOptions],
    saturated: bool,
) -> NamedFit:  # fmt: skip
    """The fit with or without a saturation."""
    data, searched = gather(experiments), searched_curve(experiments, request, saturated)
    names = {s.name for s in searched} | {"gain"}
    known = {n: v for n, v in request.fixed.items() if n in names}
    start = {n: v for n, v in request.start.items() if n in names}

    def starts(held: Mapping[str, float]) -> list[dict[str, float]]:
        return _starts(experiments, data, replace(request, fixed=held), names)

    return fit_named_map(
        law, tuple(p for p in variant.parameters if p.name in names), data, starts,
        {s.name: s.limits for s in searched}, replace(request, fixed=known, start=start),
        max_half_widths={s.name: s.sensible for s in searched if s.sensible is not None},
        refusals=[r for r in refused_beforehand(experiments, request) if r.parameter not in known],
    )  # fmt: skip


def _starts(
    experiments: Sequence[Experiment], data: NamedRows, request: Request[MotorOptions],
    names: set[str],
) -> list[dict[str, float]]:  # fmt: skip
    """Best of a grid of curves; the gain follows from each."""
    middle = middle_of_commands(experiments, request)
    top = highest_command(experiments, middle)
    axes = {n: axis for n, axis in curve_axes(top).items() if n in names}
    if OFFSET in names:
        axes[OFFSET] = [middle + s * top for s in MIDDLES]
    axes |= {n: [v] for n, v in request.fixed.items() if n in axes}
    found = []
    for point in product(*axes.values()):
        values = dict(zip(axes, point))
        shape = np.real(law({**values, "gain": 1.0}, data.x))
        power = float(shape @ shape)
        gain = request.fixed.get("gain", max(float(shape @ data.y), 0.0) / max(power, 1e-300))
        rest = data.y - gain * shape
        found.append((float(rest @ rest), {**values, "gain": max(gain, 1e-30)}))
    found.sort(key=lambda pair: pair[0])
    return [values for _, values in found[:_BEST]]
