"""Metrics of a response: step metrics and tracking errors, every definition stated.

Tools differ in them: MATLAB's ``stepinfo`` counts from 0 to the last sample and settles about that,
python-control likewise. Here nothing is taken from the record that can be said.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray

_RESOLVED = 1e-9  # of what a response moves: less is neither solved for nor kept by rounding


@dataclass(frozen=True)
class StepMetrics:
    """Metrics of a step response; ``None`` where the record holds no such thing.

    With ``y_0`` the initial value, ``y_f`` the final value, ``r`` the target and ``t_0`` the time
    of the step, crossings interpolated between samples along straight lines:

    Attributes
    ----------
    initial, final, target
        ``y_0``, ``y_f`` and ``r`` [unit of the output].
    rise_time
        From the first crossing of ``y_0 + 0.1 (y_f - y_0)`` to the first one of
        ``y_0 + 0.9 (y_f - y_0)`` [s].
    settling_time
        From ``t_0`` until the response is within ``band |r - y_0|`` of the *target* for good [s];
        ``None`` where it is outside at the end. With a steady error beyond the band it never is.
    settling_time_final
        The same about ``y_f``, with ``band |y_f - y_0|`` [s].
    steady_state_error
        ``r - y_f`` [unit of the output]. What is below 1e-9 of the step counts as none, here and
        in an overshoot.
    overshoot
        How far the response goes beyond ``y_f``, in percent of ``|y_f - y_0|``; not below 0.
    overshoot_target
        How far it goes beyond ``r``, in percent of ``|r - y_0|``; not below 0.
    peak
        The value farthest on the side of the step [unit of the output].
    peak_time
        Of the peak, from ``t_0`` [s].
    """

    initial: float
    final: float
    target: float
    rise_time: float | None
    settling_time: float | None
    settling_time_final: float | None
    steady_state_error: float
    overshoot: float | None
    overshoot_target: float
    peak: float
    peak_time: float

    def to_dict(self) -> dict[str, float | None]:
        """Return name to value."""
        return asdict(self)


def step_metrics(
    time: FloatArray, output: FloatArray, target: float, *,
    at: float = 0.0, initial: float | None = None, final: float | None = None,
    band: float = 0.02, window: float = 0.1,
) -> StepMetrics:  # fmt: skip
    """Metrics of a response to a step of the reference.

    Parameters
    ----------
    time : (n,)
        Rising [s].
    output : (n,)
    target
        Where the reference went [unit of the output].
    at
        When it did [s].
    initial
        ``y_0``; the output at the last sample not after ``at`` where it is not given.
    final
        ``y_f``; the mean of the last part of the record where it is not given.
    band
        Half width of the settling band, as a share.
    window
        That last part, as a share of the time after the step.

    Raises
    ------
    UsageError
        When the record ends before the step, or the target is where the output began.
    """
    if time[-1] <= at:
        raise UsageError(f"the record ends at {time[-1]:g} s, before the step at {at:g} s")
    begun = int(np.searchsorted(time, at, side="right"))
    begin = float(output[max(begun - 1, 0)]) if initial is None else initial
    if target == begin:
        raise UsageError(f"the target {target:g} is where the output begins: there is no step")
    late = time >= time[-1] - window * (time[-1] - at)
    end = float(np.mean(output[late])) if final is None else final
    t, y = time[begun:] - at, output[begun:]
    t, y = np.append(0.0, t), np.append(begin, y)
    way = np.sign(target - begin)
    top = int(np.argmax(way * y))
    moved, least = abs(end - begin), _RESOLVED * abs(target - begin)
    return StepMetrics(
        begin, end, target, _rise(t, y, begin, end),
        _settle(t, y, target, band * abs(target - begin)),
        _settle(t, y, end, band * moved) if moved > 0.0 else None,
        _told(target - end, least),
        100.0 * max(_told(float(way * (y[top] - end)), least), 0.0) / moved if moved else None,
        100.0 * max(_told(float(way * (y[top] - target)), least), 0.0) / abs(target - begin),
        float(y[top]), float(t[top]),
    )  # fmt: skip


def _told(value: float, least: float) -> float:
    """A value, or 0 where it is smaller than what is resolved."""
    return value if abs(value) > least else 0.0


def _crossing(t: FloatArray, y: FloatArray, level: float, i: int) -> float:
    """Time at which the line from sample ``i`` to the next one crosses a level [s]."""
    rise = y[i + 1] - y[i]
    return float(t[i] + (t[i + 1] - t[i]) * (level - y[i]) / rise) if rise else float(t[i])


def _rise(t: FloatArray, y: FloatArray, begin: float, end: float) -> float | None:
    """Time from 10 to 90 per cent of the way."""
    if end == begin:
        return None
    share = (y - begin) / (end - begin)
    instants = []
    for level in (0.1, 0.9):
        above = np.flatnonzero(share >= level)
        if not above.size or above[0] == 0:
            return None
        instants.append(_crossing(t, share, level, int(above[0]) - 1))
    return instants[1] - instants[0]


def _settle(t: FloatArray, y: FloatArray, about: float, width: float) -> float | None:
    """Time after which the response stays within a band."""
    outside = np.flatnonzero(np.abs(y - about) > width)
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    if last == y.size - 1:
        return None
    level = about + np.copysign(width, y[last] - about)
    return _crossing(t, y, float(level), last)


@dataclass(frozen=True)
class TrackingMetrics:
    """Metrics of an output that follows a moving reference [unit of the output].

    Attributes
    ----------
    rms_error, largest_error
        Of ``reference - output``: root of the mean square, and largest magnitude.
    mean_error
        Positive where the output lags behind a rising reference.
    final_error
        At the last sample.
    """

    rms_error: float
    largest_error: float
    mean_error: float
    final_error: float

    def to_dict(self) -> dict[str, float | None]:
        """Return name to value."""
        return asdict(self)


def tracking_metrics(reference: FloatArray, output: FloatArray) -> TrackingMetrics:
    """Errors of an output ``(n,)`` against its reference ``(n,)``.

    What is below 1e-9 of the range of the output counts as none.
    """
    error = reference - output
    values = (
        float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))),
        float(np.mean(error)), float(error[-1]),
    )  # fmt: skip
    least = _RESOLVED * float(np.ptp(output))
    return TrackingMetrics(*(_told(value, least) for value in values))  # fmt: skip
