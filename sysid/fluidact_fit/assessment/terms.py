"""The table of terms: everything that a model may lack, as directions of the output.

To examine every fit for something else, add a generator here and yield from it in
:func:`terms_over_time` or :func:`terms_at_any_time`; to examine one family for something, declare
it in :meth:`.Family.unmodelled_effects`. Every term is judged alike
(:mod:`.score_test`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..estimation.least_squares import scaled_least_squares
from ..estimation.noise import noise_floor
from ..estimation.recursion import behind_play, run_recursion
from ..experiment import Experiment, FloatArray, Signal, all_of
from ..family import ParameterSpec, UnmodelledEffect
from ..options import describe
from ..units import after_number, as_time
from . import policy
from .optimum import Optimum, Series, delayed, root_mean_square

_LAGS = (0.5, 2.0, 8.0, 32.0)  # sample times
_INPUT_SHIFT = 0.1  # sample times by which an input is moved to see what a delay does
_SAMPLED_RATIO = 2.0  # of the changes by a whole sample and by that shift, up to which both agree
_ROUGH_CHANNEL = 0.05  # noise of a simulated channel, in standard deviations of its residual
_SHAPE_SIZE = 0.01  # of its range, by which a channel is bent to try a shape; most play of one
_CURVE_NODES = 9  # of a characteristic of straight lines over the range of an input
_LEAST_PLAY = 0.001  # of the range, width of the play tried: a wider one starts late
_PLAY_PER_NOISE = 6.0  # least width of that play, per noise: a narrower one follows the noise
_CLOCK_REMEDY = (
    "Check that one clock stamps all channels; look for delays of filters, buses and valves."
)
_CLOCK_RATE_REMEDY = (
    "Two clocks stamp the channels, and one is faster. Record with one clock, or correct the time "
    "of one channel; within a short --window it matters less."
)
_LAG_REMEDY = (
    "A lag: look for a filter, a slow sensor or late time stamps of the output, and for dynamics "
    "that this family does not have. A lead: look for those of an input, or for a missing mass. "
    "Noise of an input and gaps look alike; resolve those warnings first."
)
_CHANGE_REMEDY = (
    "One set of values does not hold for the whole log: let the machine warm up, hold supply "
    "pressure and load, or fit parts of the log by themselves (--window)."
)
_PLAY_REMEDY = (
    "Check the coupling of the sensor, its hysteresis, and friction beside what the model has: "
    "they look alike."
)
_SHAPE_REMEDY = (
    "Check the characteristic of the sensor or valve (--scale is a straight line), or fit a "
    "smaller range; the family force-map takes any shape."
)
_NO_OPTION_REMEDY = (
    "No option gives that: look for an input that is filtered or stamped late, or for something "
    "else that the model lacks."
)


@dataclass(frozen=True)
class Term:
    """One thing that a model may lack.

    Attributes
    ----------
    name, unit
        As the file has them.
    words, remedy
        Meaning of a size (what follows "the data fit better if"), and what to do.
    columns
        Change of every series per unit of the size, scaled as the residuals are, shape ``(n_i,)``
        each.
    offered
        Whether the family has an option or a parameter that estimates it: it is named first.
    max_size
        Largest size that is believed: beyond it the direction, or the channel, says nothing.
    min_share
        Relative change of a parameter from which the term counts.
    directions
        Number of directions among which the residual itself has chosen this one: by chance it has
        as much of it as of all of them together.
    positive
        Whether the size cannot be negative: the test is then one-sided.
    size_range
        Smallest and largest size that is possible: no option estimates another.
    instruments
        The columns without noise of inputs, where that is known.
    matters_from
        Size from which the term matters even where it moves no parameter.
    changed_parameter
        Parameter of which the size is the change over a log: at either end it is off by half of it.
    """

    name: str
    unit: str
    words: Callable[[float], str]
    remedy: str
    columns: Sequence[FloatArray]
    offered: bool = False
    max_size: float = np.inf
    min_share: float = policy.LEAST
    directions: int = 1
    positive: bool = False
    size_range: tuple[float, float] = (-np.inf, np.inf)
    instruments: Sequence[FloatArray] = ()
    matters_from: float = np.inf
    changed_parameter: str = ""

    def advice(self, size: float) -> str:
        """Return the remedy for a size."""
        low, high = self.size_range
        return self.remedy if low <= size <= high else _NO_OPTION_REMEDY


def terms_over_time(at: Optimum) -> Iterator[Term]:
    """Yield terms that change between logs or within one: judged over whole logs."""
    yield from _log_offsets(at)
    for role in at.roles:
        yield _drift(at, role)
    if all(s.experiment.time.size for s in at.series):
        yield from _changing_parameters(at)


def terms_at_any_time(at: Optimum) -> Iterator[Term]:
    """Yield terms that are always there: parameters and effects of the family, lags, shapes."""
    if len(at.roles) > 1:
        for role in at.roles:
            yield _sensor_zero(at, role)
    yield from _held_parameters(at)
    yield from _family_effects(at)
    inputs = [at.signal(role) for role in at.driving if role not in at.roles]
    for signal in inputs:
        yield from _input_shapes(at, signal)
    if not all(e.time.size for e in at.experiments):
        for signal in inputs:
            yield _input_delay_in_rows(at, signal.role)
        return  # rows that need not be in order
    step = min(e.sample_time for e in at.experiments)
    for role in at.driving:
        yield from _input_delays(at, role, step)
    for role in at.roles:
        yield from _output_lags(at, role, step)
        yield from _output_play(at, role)
    for signal in inputs:
        yield from _input_play(at, signal)


def _log_offsets(at: Optimum) -> Iterator[Term]:
    """Yield an offset of the output of every log, unless each has one of its own in the fit."""
    role = at.variant.output
    logs = {s.experiment.log: s.experiment.log_name for s in at.series}
    if len(logs) < 2 or any(s.own_level for s in at.series):
        return
    signal = at.signal(role.name)
    for log, name in logs.items():
        yield Term(
            f"offset of log {log + 1}", signal.unit,
            partial(_log_offset_words, name, signal), "Check the zero of the sensors, and whether "
            "this log is of the same machine in the same state; fit it by itself.",
            [np.full(int(s.used.sum()), (s.role == role.name and s.experiment.log == log) / s.scale)
             for s in at.series],
        )  # fmt: skip


def _log_offset_words(name: str, signal: Signal, size: float) -> str:
    side = "above" if size > 0.0 else "below"
    return f"'{signal.role}' of {name} lies {signal.text(abs(size))} {side} that of the other logs"


def _sensor_zero(at: Optimum, role: str) -> Term:
    """Wrong zero of one of several channels, whose levels are part of the physics."""
    signal = at.signal(role)
    return Term(
        f"zero of {role}", signal.unit,
        lambda size: f"'{role}' shows {_more_or_less(signal, size)} than there is",
        "Check the zero of the sensor at a known value, and correct the log.",
        [np.full(int(s.used.sum()), (s.role == role) / s.scale) for s in at.series],
    )  # fmt: skip


def _drift(at: Optimum, role: str) -> Term:
    """Drift of a channel: over time, or from the first row of a log to the last."""
    unit, text = at.signal(role).unit, at.signal(role).text
    of, it = ("", "the output") if len(at.roles) == 1 else (f" of {role}", f"'{role}'")
    timed = all(s.experiment.time.size for s in at.series)
    columns = []
    for s in at.series:
        t = s.experiment.time if timed else np.linspace(0.0, 1.0, s.used.size)
        since, size = t[0] if timed else 0.0, (s.role == role) / s.scale
        columns.append((all_of(t, s.used) - since) * size)
    per = "a second" if timed else "from the first row of a log to the last"
    return Term(
        f"drift{of}", f"{unit}/s" if timed else unit,
        lambda size: f"{it} drifts by {text(size)} {per}",
        "Let the sensor warm up, or cut the log with --window." if timed else
        "Go back to the first position at the end and compare. In sorted rows, or in a single "
        "sweep, a drift cannot be told from the curve or from play.", columns,
    )  # fmt: skip


def _changing_parameters(at: Optimum) -> Iterator[Term]:
    """Yield parameters that change linearly from the beginning of every log to its end."""
    ramps = []
    for s in at.series:
        t = all_of(s.experiment.time, s.used)
        ramps.append((t - t.mean()) / max(float(np.ptp(s.experiment.time)), np.finfo(float).tiny))
    seen = [
        k for k, name in enumerate(at.names) if name in at.solution.parameters
        and root_mean_square([j[:, k] for j in at.jacobians]) > 1e-12 * at.sigma
    ]  # fmt: skip
    for k in seen:
        spec = at.variant.parameter(at.names[k])
        words = partial(_change_words, spec.name, at.unit(spec.name))
        yield Term(
            f"change of {spec.name}", spec.unit, words, _CHANGE_REMEDY,
            [ramp * j[:, k] for ramp, j in zip(ramps, at.jacobians)],
            directions=len(seen), changed_parameter=spec.name,
            instruments=[ramp * z[:, k] for ramp, z in zip(ramps, at.instruments)],
        )  # fmt: skip


def _change_words(name: str, unit: str, size: float) -> str:
    return f"{name} changes by {size:+.3g}{unit} from the beginning of a log to its end"


def _held_parameters(at: Optimum) -> Iterator[Term]:
    """Yield parameters of the family that were not estimated."""
    possible = {spec.name for spec in at.variant.parameters}
    freed = {o.frees: o for o in describe(at.family.options_type) if o.frees in possible}
    table = at.solution.parameters
    held = [n for n, q in table.items() if q.status == "fixed" and isinstance(q.value, float)]
    for name in dict.fromkeys((*held, *(n for n in freed if n not in table))):
        spec = at.variant.parameter(name)
        known = table.get(name, table.get(spec.general))
        if known is not None and known.status == "not_identified":
            continue  # its parts are no better known
        value = known.number if known is not None else spec.neutral or 0.0
        slopes = at.slopes(replace(at.plant, values={**at.plant.values, name: value}), name)
        if slopes is None:
            continue
        columns, instruments = slopes
        option = f"another --fix {name}=VALUE"
        if name in freed and (name not in table or value == (spec.neutral or 0.0)):
            option = f"--{freed[name].name}={freed[name].choices[-1]}"
        elif name in freed:
            option += f", or --{freed[name].name}={freed[name].choices[-1]} without it"
        apart = spec.general and name not in table
        words = partial(_distance_words, spec) if apart else partial(_value_words, spec, value)
        size_range = (-np.inf, np.inf) if apart else (spec.minimum - value, spec.maximum - value)
        yield Term(name, spec.unit, words, f"Try {option}.", columns, offered=True,
                   size_range=size_range, instruments=instruments)  # fmt: skip


def _family_effects(at: Optimum) -> Iterator[Term]:
    """Yield effects of a machine of this family that no parameter describes.

    One of several directions, such as initial states, is judged by the one that the residual
    chooses.
    """
    for effect in at.family.unmodelled_effects(at.plant):
        found = effect.response(at.experiments, at.solution.simulate_near)
        if not any(found):
            continue  # not known of these runs
        width = max((c.shape[1] for run in found for c in run.values() if c.ndim == 2), default=0)
        blank = (width,) if width else ()
        channels = [found[s.run].get(s.role, np.zeros((s.used.size, *blank))) for s in at.series]
        columns = at.columns(channels)
        unit = at.signal(effect.of).unit if effect.of else effect.unit
        words = partial(_effect_words, effect, unit)
        directions = 1
        if width:
            combined = _combined_direction(at, columns)
            if combined is None:
                continue
            columns, directions = combined
        size_range = (0.0 if effect.positive else -np.inf, np.inf)
        yield Term(effect.name, unit, words, effect.remedy, columns, positive=effect.positive,
                   size_range=size_range, offered=effect.offered, directions=directions,
                   min_share=policy.LEAST_BY_SHAPE if effect.shaped else policy.LEAST)  # fmt: skip


def _combined_direction(
    at: Optimum, columns: Sequence[FloatArray]
) -> tuple[list[FloatArray], int] | None:
    """Combine several directions, shape ``(n_i, q)``, as the residual does.

    Returns
    -------
    The one direction, in which the largest part is 1, and out of how many it was chosen; ``None``
    where nothing is left of any beside the parameters.
    """
    squares = sum(np.sum(c**2, axis=0) for c in columns)
    size = np.sqrt(squares / at.samples)
    size = np.where(size > 0.0, size, 1.0)
    found = _joint_sizes(at, [c / size for c in columns], 10.0 * at.sigma)
    if found is None:
        return None
    sizes = found[0] / size
    sizes /= max(np.abs(sizes).max(), np.finfo(float).tiny)
    return [c @ sizes for c in columns], found[1]


def _effect_words(effect: UnmodelledEffect, unit: str, size: float) -> str:
    if effect.positive and size < 0.0:
        return _impossible_words(effect.name, size, unit)
    return effect.words(size) if callable(effect.words) else effect.words


def _impossible_words(name: str, value: float, unit: str) -> str:
    return f"{name} were {value:.3g}{after_number(unit)}, which cannot be"


def _value_words(spec: ParameterSpec, value: float, change: float) -> str:
    """Describe another value of a parameter."""
    if not spec.minimum <= value + change <= spec.maximum:
        return _impossible_words(spec.name, value + change, spec.unit)
    return (
        f"{spec.name} is about {value + change:.3g}{after_number(spec.unit)} instead of {value:.3g}"
    )


def _distance_words(spec: ParameterSpec, change: float) -> str:
    """Describe the distance of a parameter from the one that stood for it, which moves too."""
    side = "above" if change > 0.0 else "below"
    return f"{spec.name} is {abs(change):.3g}{after_number(spec.unit)} {side} {spec.general}"


def _input_delays(at: Optimum, role: str, step: float) -> Iterator[Term]:
    """Yield an input that acts later than recorded, by a constant or a growing delay."""

    def words(size: float) -> str:
        when = "later" if size > 0.0 else "earlier"
        return f"'{role}' acts {as_time(abs(size))} {when} than recorded"

    def more(size: float) -> str:
        return f"{words(size)} for every second since the start of the log"

    columns = change_by_delay(at, role, step)
    yield Term(f"delay of {role}", "s", words, _CLOCK_REMEDY, columns)
    begin: dict[int, float] = {}
    for e in at.experiments:
        begin[e.log] = min(float(e.time[0]), begin.get(e.log, np.inf))
    drifting = [(all_of(s.experiment.time, s.used) - begin[s.experiment.log]) * c
                for s, c in zip(at.series, columns, strict=True)]  # fmt: skip
    yield Term(f"clock of {role}", "1", more, _CLOCK_RATE_REMEDY, drifting)


def change_by_delay(at: Optimum, role: str, step: float) -> list[FloatArray]:
    """Derivatives of every series by a delay of an input [per s], shape ``(n_i,)`` each.

    Half the difference of a delay and a lead by one sample where a model reads a held input at its
    samples; as with :func:`_change_by_lag`, noise of the input does not tell it from the residual.
    """
    runs = at.experiments
    near = at.change([delayed(e, role, _INPUT_SHIFT * step) for e in runs])
    if all(e.signals[role].hold == "zoh" for e in runs):
        late = at.change([_shifted(e, role, 1) for e in runs])
        if root_mean_square(late) < _SAMPLED_RATIO * root_mean_square(near):
            early = at.change([_shifted(e, role, -1) for e in runs])
            return [(a - b) / (2.0 * step) for a, b in zip(late, early, strict=True)]
    return [c / (_INPUT_SHIFT * step) for c in near]


def _input_delay_in_rows(at: Optimum, role: str) -> Term:
    """Delay of an input in rows, for logs without a time."""
    late, early = (at.change([_shifted(e, role, k) for e in at.experiments]) for k in (1, -1))

    def words(size: float) -> str:
        return f"'{role}' acts {abs(size):.2g} rows {'later' if size > 0.0 else 'earlier'}"

    columns = [0.5 * (a - b) for a, b in zip(late, early, strict=True)]
    return Term(f"delay of {role}", "1", words, _CLOCK_REMEDY, columns)


def _shifted(experiment: Experiment, role: str, rows: int) -> Experiment:
    """The same run with the readings of an input shifted by rows; its ends are repeated."""
    values = experiment[role]
    source = np.clip(np.arange(values.size) - rows, 0, values.size - 1)
    return experiment.with_readings(role, values[source])


def _output_lags(at: Optimum, role: str, step: float) -> Iterator[Term]:
    """Yield first-order lags of a channel that was fitted."""
    of, response = ("", "the response") if len(at.roles) == 1 else (f" of {role}", f"'{role}'")
    for lag in _LAGS:
        columns = [
            _change_by_lag(at, s, lag * step) if s.role == role else np.zeros(int(s.used.sum()))
            for s in at.series
        ]
        yield Term(
            f"lag{of} of {lag:g} samples", "s",
            lambda size: f"{response} {'lags' if size > 0.0 else 'leads'} by another "
            f"{as_time(abs(size))}",
            _LAG_REMEDY, columns, max_size=policy.FARTHEST_LAG * lag * step,
        )  # fmt: skip


def _change_by_lag(at: Optimum, s: Series, lag: float) -> FloatArray:
    """Change of a simulated channel per second of a first-order ``lag`` [s], shape ``(n_i,)``.

    Half the difference of a lag and a lead: noise of a measured input, which is in the residual as
    well, has no direction in time.
    """
    e, t, step = s.experiment, s.experiment.time, s.experiment.sample_time
    grid, even = None, s.simulated
    if not e.uniform or abs(float(t[-1] - t[0]) - (t.size - 1) * step) > 0.5 * step:
        grid = np.arange(t[0], t[-1] + step, step)
        even = np.interp(grid, t, s.simulated)
    change = _first_order_lag(even, step, lag)
    change -= even
    if noise_floor(even) > _ROUGH_CHANNEL * at.sigma * s.scale:
        lead = _first_order_lag(even[::-1], step, lag)[::-1]
        change = 0.5 * (change - (lead - even))
    if grid is not None:
        change = np.interp(t, grid, change)
    return np.asarray(all_of(change, s.used) / (lag * s.scale))


def _first_order_lag(even: FloatArray, step: float, lag: float) -> FloatArray:
    """Response of a first-order lag [s] to an evenly sampled signal, from rest, shape ``(n,)``.

    The signal follows straight lines between its samples.
    """
    decay = float(np.exp(-step / lag))
    ramp = (1.0 - decay) * lag / step  # mean of the decay over a sample
    driven = (1.0 - ramp) * even
    driven[0] = even[0]
    driven[1:] += (ramp - decay) * even[:-1]
    return np.asarray(run_recursion(driven, [decay]))


def _output_play(at: Optimum, role: str) -> Iterator[Term]:
    """Yield play ``w`` of a sensor: ``x - w/2`` on the way up, ``x + w/2`` on the way down."""
    own = [s.simulated for s in at.series if s.role == role]
    width = _play_width([all_of(values, np.isfinite(values)) for values in own])
    if width is None:
        return
    channels = []
    for s in at.series:
        change = np.zeros(s.simulated.size)
        if s.role == role:
            known = np.isfinite(s.simulated)
            values = all_of(s.simulated, known)
            change[known] = _side_of_play(behind_play(values, width) - values)
        channels.append(change)
    yield _shape_term(at, "play of", role, _play_words, _PLAY_REMEDY, at.columns(channels))


def _side_of_play(shift: FloatArray) -> FloatArray:
    """Side on which play was last taken up, -1/2 after a way up, shape ``(n,)``.

    Between its sides the shift is that of the signal, whose noise the residual has as well.
    """
    taken = np.abs(shift) > (1.0 - 1e-6) * np.abs(shift).max(initial=0.0)
    last = np.maximum.accumulate(np.where(taken, np.arange(shift.size), 0))
    return np.asarray(0.5 * np.sign(shift[last]))


def _shape_term(
    at: Optimum, name: str, role: str, words: Callable[[Signal, float], str], remedy: str,
    columns: Sequence[FloatArray], unit: str = "", *, curved: bool = False,
) -> Term:  # fmt: skip
    """Make a term of the shape of a channel: no larger than its range, and none is quite straight.

    A ``curved`` channel matters by itself from a share of its range: no single gain holds over it.
    """
    signal = at.signal(role)
    ends = [(float(e[role].min()), float(e[role].max())) for e in at.experiments if role in e]
    span = max(high for _, high in ends) - min(low for low, _ in ends)
    return Term(
        f"{name} {role}", unit or signal.unit, partial(words, signal), remedy, columns,
        max_size=1.0 if unit else span, min_share=policy.LEAST_BY_SHAPE,
        matters_from=policy.CURVED * span if curved else np.inf,
    )  # fmt: skip


def _play_width(records: Sequence[FloatArray]) -> float | None:
    """Width of play to test records for, ``None`` where it would be lost in their noise."""
    known = [r for r in records if r.size]
    if not known:
        return None
    span = max(float(r.max()) for r in known) - min(float(r.min()) for r in known)
    width = max(_LEAST_PLAY * span, _PLAY_PER_NOISE * max(noise_floor(r) for r in known))
    return width if 0.0 < width <= _SHAPE_SIZE * span else None


def _input_play(at: Optimum, signal: Signal) -> Iterator[Term]:
    """Yield play of an input."""
    role = signal.role
    width = _play_width([e[role] for e in at.experiments])
    if width is not None:
        change = _change_by_reading(at, role, lambda x: behind_play(x, width), width)
        if change is not None:
            yield _shape_term(at, "play of", role, _play_words, _PLAY_REMEDY, change)


def _input_shapes(at: Optimum, signal: Signal) -> Iterator[Term]:
    """Yield a bow, another gain and an offset below zero, and a curve of straight lines."""
    role, records = signal.role, [e[signal.role] for e in at.experiments]
    span = min(float(r.min()) for r in records), max(float(r.max()) for r in records)
    if span[0] == span[1]:
        return
    places, known = np.linspace(*span, _CURVE_NODES), list[int]()
    reach = _SHAPE_SIZE * (span[1] - span[0])
    table = [np.zeros((r.size, _CURVE_NODES)) for r in at.residuals]
    for k, only in enumerate(np.eye(_CURVE_NODES)):
        bent = partial(_with_curve_added, places=places, by=reach * only)
        hat = _change_by_reading(at, role, bent, reach)
        if hat is None:
            continue
        for c, values in zip(table, hat, strict=True):
            c[:, len(known)] = values
        known.append(k)
    if not known:
        return
    hats = [c[:, : len(known)] for c in table]
    place = np.asarray(places[known], dtype=float)
    bow = 1.0 - (2.0 * (place - span[0]) / (span[1] - span[0]) - 1.0) ** 2
    bowed = [c @ bow for c in hats]
    yield _shape_term(at, "bow of", role, _bow_words, _SHAPE_REMEDY, bowed, curved=True)
    if span[0] < 0.0 < span[1]:
        below = [c @ np.minimum(place, 0.0) for c in hats]
        yield _shape_term(at, "gain below zero of", role, _gain_words, _SHAPE_REMEDY, below, "1")
        aside = _change_by_reading(at, role, lambda x: x + reach * (x < 0.0), reach)
        if aside is not None:
            yield _shape_term(at, "offset below zero of", role, _offset_words, _SHAPE_REMEDY, aside)
    found = _joint_sizes(at, hats, reach)
    if found is None:
        return
    sizes, count = found
    largest = int(np.argmax(np.abs(sizes)))
    words = partial(_curve_words, float(np.sign(sizes[largest])), float(place[largest]))
    shape = sizes / max(abs(sizes[largest]), np.finfo(float).tiny)
    columns = [c @ shape for c in hats]
    curve = _shape_term(at, "characteristic of", role, words, _SHAPE_REMEDY, columns, curved=True)
    yield replace(curve, directions=count)


def _with_curve_added(x: FloatArray, places: FloatArray, by: FloatArray) -> FloatArray:
    return x + np.interp(x, places, by)


def _change_by_reading(
    at: Optimum, role: str, other: Callable[[FloatArray], FloatArray], size: float
) -> list[FloatArray] | None:
    """Change of every series by other readings of an input, per unit of their ``size``.

    ``None`` where the output does not depend on them.
    """
    found = at.change([e.with_readings(role, other(e[role])) for e in at.experiments])
    if not root_mean_square(found) > 1e-12 * at.sigma:
        return None
    return [c / size for c in found]


def _joint_sizes(
    at: Optimum, columns: Sequence[FloatArray], scale: float
) -> tuple[FloatArray, int] | None:
    """Fit the sizes of several directions to the residual at once, beside the parameters.

    What the parameters explain as well is left to them: of sizes that fit alike these are the
    smallest, ``scale`` being the size to be expected.

    Returns
    -------
    The sizes, shape ``(q,)``, and the number of directions that the parameters do not explain;
    ``None`` where there is none.
    """
    p, q = at.jacobians[0].shape[1], columns[0].shape[1]
    found = at.noise.triangle(columns)
    if found is None or found[1] <= p + q + 1:
        return None
    triangle, rows = found
    own, target = triangle[p : p + q, p:-1], triangle[p : p + q, -1]
    whole = np.linalg.norm(triangle[:, p:-1], axis=0).max()
    left = np.linalg.svd(own, compute_uv=False) > policy.DIRECTION_LEFT * whole
    sigma = float(np.linalg.norm(triangle[p + q :, -1])) / np.sqrt(rows - p - q)
    if not left.any():
        return None
    expected = np.eye(q) * (sigma / scale)
    sizes = scaled_least_squares(np.vstack((own, expected)), np.append(target, np.zeros(q)))
    return sizes, int(left.sum())


def _play_words(signal: Signal, size: float) -> str:
    change = _more_or_less(signal, -size)
    return f"'{signal.role}' shows {change} on the way up than on the way down"


def _bow_words(signal: Signal, size: float) -> str:
    change = _more_or_less(signal, size)
    return f"'{signal.role}' is a curve, {change} amid its range than a straight line"


def _offset_words(signal: Signal, size: float) -> str:
    change = _more_or_less(signal, size)
    return f"'{signal.role}' behaves as if {change} than logged where it is negative"


def _gain_words(signal: Signal, size: float) -> str:
    change = f"{abs(100.0 * size):.3g} % {'larger' if size > 0.0 else 'smaller'}"
    return f"the effect of '{signal.role}' is {change} where it is negative than elsewhere"


def _curve_words(sign: float, place: float, signal: Signal, size: float) -> str:
    change = _more_or_less(signal, sign * size)
    return f"'{signal.role}' behaves as if {change} than logged at {signal.text(place)}"


def _more_or_less(signal: Signal, size: float) -> str:
    return f"{signal.text(abs(size))} {'more' if size > 0.0 else 'less'}"
