"""What to record next: the excitation that determines the worst parameter best.

    M = J' J / sigma^2,   std_error = sqrt(diag(M^-1))

``J`` is the derivative of the output by the parameters at the values of a parameter file,
``sigma`` the rmse of its fit. Candidates of several shapes within the stated limits are
simulated, the best by Fisher's information [1]_ are improved one number at a time. The
prediction is as good as the file: it takes its values, its white noise and its model as
true.

References
----------
.. [1] G. Goodwin, R. Payne, Dynamic System Identification: Experiment Design and Data
   Analysis, 1977, chapter 6.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import NotIdentifiedError, UsageError
from .estimation.information import Information, cramer_rao, optimal_measure
from .experiment import Experiment, FloatArray, Hold, Signal
from .families import get_family
from .family import Family, Role, Value, Variant
from .waveforms import Waveform, limit_slope, smooth_corners, to_segments

if TYPE_CHECKING:
    from .parameters import ParameterDocument

_QUANTILE = 1.96
_RISE = 8  # samples in which a command that moves on between samples crosses its range
_MOST = 200_000  # samples of a run that is searched
_SPREAD = 0.2  # share of a static design that is spread evenly, to show a wrong model
_TURN = 0.1  # s that the motion takes to reach its speed
_USED = 0.9  # share of the stroke that strokes at constant speed use
_LEADERS = 4  # shapes that are improved
_PIECES = 40  # straight pieces that are shaped one by one
_TRIES = 400  # of changes to the pieces
_TIE = 0.05  # weight of the mean over all parameters beside the worst


@dataclass(frozen=True)
class Limits:
    """What the next experiment has to keep to.

    Attributes
    ----------
    amplitude
        Lowest and highest value of the driving role [SI].
    rate
        Steepest slope of the driving role [SI/s]; ``None``: no limit.
    stroke
        Lowest and highest value of the output [SI]; ``None``: no limit.
    duration, sample_time
        [s]; both 0 for a static map without time.
    """

    amplitude: tuple[float, float]
    rate: float | None
    stroke: tuple[float, float] | None
    duration: float
    sample_time: float

    @property
    def count(self) -> int:
        """Number of samples."""
        return round(self.duration / self.sample_time)


@dataclass(frozen=True)
class Forecast:
    """A parameter before and after the next experiment [``unit``].

    ``present`` is the standard error in the file (``None`` when it was not identified),
    ``predicted`` that of the new experiment alone (``None``: it would not determine it
    either), ``ratio`` their quotient; both intervals are 95 % about ``value``.
    ``supposed`` tells that the value is only plausible.
    """

    name: str
    unit: str
    value: float
    present: float | None
    predicted: float | None
    ratio: float | None
    present_ci95: tuple[float, float] | None
    predicted_ci95: tuple[float, float] | None
    supposed: bool = False


@dataclass(frozen=True)
class Candidate:
    """An excitation that was tried: in words, and its worst relative standard error."""

    description: str
    worst_relative: float | None


@dataclass(frozen=True)
class Design:
    """The next experiment.

    Attributes
    ----------
    family
        Name of the family.
    description
        The excitation in words.
    time
        Instants, shape ``(n,)`` [s]; empty for a static design without time.
    signals, units
        Columns by name, shape ``(n,)`` each [SI], and their units.
    forecasts
        One entry per parameter.
    criterion
        What was made small.
    limits
        What was kept to.
    binding
        The limits that the design reaches; loosening these would help.
    notes
        What a person should know.
    candidates
        The best of each shape, best first.
    """

    family: str
    description: str
    time: FloatArray
    signals: Mapping[str, FloatArray]
    units: Mapping[str, str]
    forecasts: tuple[Forecast, ...]
    criterion: str
    limits: Limits
    binding: tuple[str, ...]
    notes: tuple[str, ...]
    candidates: tuple[Candidate, ...]

    @property
    def predicted(self) -> dict[str, float | None]:
        """Predicted standard errors by name."""
        return {f.name: f.predicted for f in self.forecasts}

    @property
    def present(self) -> dict[str, float | None]:
        """Present standard errors by name."""
        return {f.name: f.present for f in self.forecasts}

    def to_csv(self) -> str:
        """Return the table that a controller plays: a header with units, one row per sample."""
        columns = {f"{n} [{self.units[n]}]": v for n, v in self.signals.items()}
        if self.time.size:
            columns = {"time [s]": self.time, **columns}
        text = io.StringIO()
        text.write(",".join(columns) + "\n")
        for row in zip(*columns.values()):
            text.write(",".join(f"{value:.10g}" for value in row) + "\n")
        return text.getvalue()

    def to_dict(self) -> dict[str, Any]:
        """Return plain mappings, lists, text and numbers, without the samples."""
        return {
            "family": self.family,
            "description": self.description,
            "criterion": self.criterion,
            "samples": int(next(iter(self.signals.values())).size),
            "limits": {
                "amplitude": list(self.limits.amplitude),
                "rate": self.limits.rate,
                "stroke": list(self.limits.stroke) if self.limits.stroke else None,
                "duration": self.limits.duration,
                "sample_time": self.limits.sample_time,
            },
            "binding": list(self.binding),
            "parameters": [{**vars(f)} for f in self.forecasts],
            "notes": list(self.notes),
            "candidates": [{**vars(c)} for c in self.candidates],
        }

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the table atomically and return its path.

        Raises
        ------
        OutputError
            When the file exists and ``overwrite`` is false, or cannot be written.
        """
        from .parameters import write_atomically

        return write_atomically(path, self.to_csv(), overwrite=overwrite)


@dataclass(frozen=True)
class _Unknown:
    """A number that the next experiment should determine."""

    name: str
    unit: str
    value: float
    scale: float
    present: float | None
    supposed: bool = False


@dataclass(frozen=True)
class _Task:
    """Everything a search needs to know."""

    document: ParameterDocument
    family: Family
    variant: Variant
    options: Mapping[str, Any]
    drive: Role
    hold: Hold | None
    unit: str
    values: Mapping[str, Value]
    unknowns: tuple[_Unknown, ...]
    limits: Limits
    criterion: str
    seed: int
    notes: tuple[str, ...]
    progress: Callable[[str], None]

    @property
    def sigma(self) -> float:
        """Noise of the output [SI]."""
        return max(self.document.fit.rmse.value, 1e-300)

    @property
    def rest(self) -> float:
        """Value of the drive at rest: zero where the limits allow it."""
        low, high = self.limits.amplitude
        return 0.0 if low < 0.0 < high else 0.5 * (low + high)


def design(
    document: ParameterDocument | str | os.PathLike[str],
    *,
    amplitude: tuple[float, float] | None = None,
    rate: float | None = None,
    stroke: tuple[float, float] | None = None,
    duration: float | None = None,
    sample_time: float | None = None,
    criterion: str = "worst",
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Design the next experiment for the machine that a parameter file describes.

    Parameters
    ----------
    document
        Parameter file, or what was read from it.
    amplitude, stroke
        Range of the driving role and of the output [SI]; what the file's logs covered.
    rate
        Steepest slope of the driving role [SI/s]; no limit.
    duration, sample_time
        [s]; those of the file's longest log.
    criterion
        ``"worst"`` (the largest relative standard error), ``"determinant"`` (the volume
        of the confidence ellipsoid), or the name of one parameter.
    seed
        For the random shapes.
    progress
        Called with a line of text now and then.

    Returns
    -------
    Design

    Raises
    ------
    ParameterFileError
        When the file is not valid.
    UsageError
        When a limit or the criterion cannot be, or the family cannot be designed for.
    NotIdentifiedError
        When no excitation within the limits determines the parameters.
    """
    from .parameters import ParameterDocument, read_document

    if not isinstance(document, ParameterDocument):
        document = read_document(document)
    family = get_family(document.family)
    variant = next((v for v in family.variants if v.name == document.variant), family.variants[0])
    given = Limits(amplitude or (0.0, 0.0), rate, stroke, duration or 0.0, sample_time or 0.0)
    task = _make_task(
        document, family, variant, given, criterion, seed, progress or (lambda message: None)
    )
    return _design_static(task) if task.drive.hold is None else _design_dynamic(task)


# --------------------------------------------------------------------- what is to be done


def _make_task(
    document: ParameterDocument,
    family: Family,
    variant: Variant,
    given: Limits,
    criterion: str,
    seed: int,
    progress: Callable[[str], None],
) -> _Task:
    drive = _driving_role(variant)
    limits = _fill_limits(document, variant, drive, given)
    unit = document.validity[drive.name].unit if drive.name in document.validity else drive.unit
    values, supposed = _suppose(document, drive, limits)
    unknowns = _find_unknowns(document, values, supposed)
    names = [u.name for u in unknowns]
    if criterion not in ("worst", "determinant", *names):
        raise UsageError(
            f"--criterion {criterion}: there is no such criterion or parameter to estimate.",
            expected=f"One of worst, determinant, {', '.join(names)}.",
        )
    held = [source.columns.get(drive.name, {}).get("hold") for source in document.provenance.logs]
    hold = next((h for h in held if h), drive.hold)
    options = {**{o.name: o.default for o in family.options}, **(document.options or {})}
    notes = tuple(f"{n} was not identified; the design supposes {values[n]:.4g}." for n in supposed)
    if hold == "zoh" and any(n.startswith("breakaway") for n in names):
        notes += (
            f"A static level is known to no better than the controller's own step of {drive.name} "
            "/ 3.5, which the prediction does not know.",
        )
    return _Task(
        document, family, variant, options, drive, hold, unit, values, unknowns, limits,
        criterion, seed, notes, progress,
    )  # fmt: skip


def _driving_role(variant: Variant) -> Role:
    """The role that drives the model; for a static map, what it is sampled over."""
    for role in variant.roles:
        if role.hold is not None and role.required:
            return role
    return next(r for r in variant.roles if r.name != "time" and not r.output and r.required)


def _fill_limits(
    document: ParameterDocument, variant: Variant, drive: Role, given: Limits
) -> Limits:
    """Take what was not said from what the file's logs covered."""
    covered = document.validity
    amplitude = given.amplitude
    if amplitude == (0.0, 0.0):
        if drive.name not in covered:
            raise UsageError(
                f"the file does not say which range of {drive.name} its logs covered.",
                remedy=f"Give --amplitude LOW:HIGH in {drive.unit}.",
            )
        amplitude = covered[drive.name].low, covered[drive.name].high
    stroke = given.stroke
    if stroke is None and drive.hold is not None and variant.output.name in covered:
        stroke = covered[variant.output.name].low, covered[variant.output.name].high
    for name, pair in (("--amplitude", amplitude), ("--stroke", stroke)):
        if pair is not None and not pair[0] < pair[1]:
            raise UsageError(f"{name} {pair[0]:g}:{pair[1]:g}: the lower end is not below.")
    step, duration = _time_base(document, given)
    limits = Limits(amplitude, given.rate, stroke, duration, step)
    if step and not 20 <= limits.count <= _MOST:
        raise UsageError(
            f"{duration:g} s in steps of {step:g} s are {duration / step:.3g} samples.",
            expected=f"Expected 20 to {_MOST}.",
            remedy="Change --duration or --sample-time.",
        )
    return limits


def _time_base(document: ParameterDocument, given: Limits) -> tuple[float, float]:
    """Sample time and duration [s]: said, or those of the longest log; 0 without time."""
    spans = [
        ((source.sample_time or 0.0) * source.rows, source.sample_time or 0.0)
        for source in document.provenance.logs
    ]
    duration, step = max(spans, default=(0.0, 0.0))
    return given.sample_time or step, given.duration or duration


def _suppose(
    document: ParameterDocument, drive: Role, limits: Limits
) -> tuple[dict[str, Value], list[str]]:
    """Values to simulate with: those of the file, plausible ones where it has none."""
    values = dict(document.values())
    supposed = []
    low, high = limits.amplitude
    for name, entry in document.parameters.items():
        if entry.status != "not_identified" or isinstance(entry.value, list):
            continue
        side = low if name.endswith("negative") else high
        if name.startswith("coulomb"):
            values[name] = 0.2 * abs(side)
        elif name.startswith("breakaway"):
            kinetic = values[name.replace("breakaway", "coulomb")]
            assert isinstance(kinetic, float)
            values[name] = 1.3 * kinetic
        elif name.startswith("dead_zone"):
            values[name] = 0.2 * side
        elif name == "dead_time":
            values[name] = 1.5 * limits.sample_time
        elif name.startswith("viscous"):
            values[name] = entry.value
        else:
            continue
        supposed.append(name)
    return values, supposed


def _find_unknowns(
    document: ParameterDocument, values: Mapping[str, Value], supposed: Sequence[str]
) -> tuple[_Unknown, ...]:
    """Numbers that are estimated or should be, lists entry by entry."""
    found = []
    for name, entry in document.parameters.items():
        value, spread = values[name], entry.std_error
        if isinstance(value, list):
            errors = spread if isinstance(spread, list) else []
            size = float(np.max(np.abs(value)))
            for i, (v, e) in enumerate(zip(value, errors)):
                if isinstance(v, float) and isinstance(e, float) and e > 0.0:
                    found.append(_Unknown(f"{name}[{i}]", entry.unit, v, size, e))
        elif entry.status == "estimated" or name in supposed:
            present = spread if isinstance(spread, float) else None
            scale = abs(value) or present or 1.0
            found.append(_Unknown(name, entry.unit, value, scale, present, name in supposed))
    if not found:
        raise UsageError(
            "the file has no estimated parameter, so there is nothing to design for.",
            remedy="Fit without --fix.",
        )
    return tuple(found)


def _score(task: _Task, errors: FloatArray) -> float:
    """What is to be small: the logarithm of the criterion, and a little of all others."""
    if not np.all(np.isfinite(errors)) or not np.all(errors > 0.0):
        return np.inf
    relative = np.log(errors / np.array([u.scale for u in task.unknowns]))
    mean = float(np.mean(relative))
    if task.criterion == "determinant":
        return mean
    if task.criterion == "worst":
        return float(relative.max()) + _TIE * mean
    return float(relative[[u.name for u in task.unknowns].index(task.criterion)]) + _TIE * mean


# -------------------------------------------------------------------------- dynamic models


@dataclass(frozen=True)
class _Trial:
    """An excitation and what it would tell."""

    waveform: Waveform
    command: FloatArray
    output: FloatArray
    errors: FloatArray
    score: float
    balance: float = 0.0


class _Search:
    """Simulates waveforms within the limits and scores them."""

    def __init__(self, task: _Task) -> None:
        self.task = task
        limits = task.limits
        self.time = limits.sample_time * np.arange(limits.count, dtype=np.float64)
        self._inform(np.full(self.time.size, task.rest))  # refuses a family that cannot say
        self.drifts = self._drifts()

    def _drifts(self) -> bool:
        """Whether a push leaves the output elsewhere: its level is then free."""
        n = self.time.size
        push = np.zeros(n)
        push[n // 10 : n // 5] = 1.0
        for sign in (1.0, -1.0):
            y = self._simulate(self._to_command(sign * push, 0.0))
            if abs(y[-1] - y[0]) > 0.05 * float(np.ptp(y)) > 0.0:
                return True
        return False

    def _to_command(self, shape: FloatArray, balance: float) -> FloatArray:
        """Command of a shape [SI]; ``balance`` weakens one direction against the other."""
        task = self.task
        low, high = task.limits.amplitude
        up, down = min(1.0, 1.0 + balance), min(1.0, 1.0 - balance)
        above, below = up * np.maximum(shape, 0.0), down * np.minimum(shape, 0.0)
        u = task.rest + (high - task.rest) * above + (task.rest - low) * below
        rate = task.limits.rate
        if task.hold != "zoh":
            u = smooth_corners(u, self._corner_width(float(np.ptp(u)), rate))
        if rate is not None:
            u = limit_slope(u, rate * task.limits.sample_time)
        return np.asarray(u)

    def _corner_width(self, span: float, rate: float | None) -> int:
        """Samples over which a jump of a moving command is spread."""
        if not rate:
            return _RISE
        # the steepest point of a Hann window is twice its mean
        return max(_RISE, int(np.ceil(2.0 * span / (rate * self.task.limits.sample_time))))

    def _run(self, command: FloatArray) -> Experiment:
        name, step = self.task.drive.name, self.task.limits.sample_time
        before = float(command[0])
        signal = Signal(name, self.time, command, self.task.unit, self.task.hold, before)
        return Experiment("design", 0, self.time, {name: signal}, step, True)

    def _simulate(self, command: FloatArray) -> FloatArray:
        task = self.task
        run = self._run(command)
        y = task.family.simulate(task.variant, task.values, run, task.options)
        return np.asarray(y, dtype=float)

    def _inform(self, command: FloatArray) -> Information:
        task = self.task
        run = self._run(command)
        found = task.family.information(task.variant, task.values, run, task.options)
        if found is None:
            raise UsageError(
                f"the next experiment of {task.family.name} cannot be designed: the family does "
                "not say what an experiment would tell.",
                expected="It can be for ball-screw, hydrostatic, valve, line, cylinder-friction "
                "and potentiometer.",
            )
        return found

    def errors(self, found: Information) -> FloatArray:
        """Predicted standard errors in the order of the task's unknowns, shape ``(p,)``."""
        names = [u.name for u in self.task.unknowns]
        used = [n for n in names if n in found.names]
        jacobian = found.jacobian[:, [found.names.index(n) for n in used]]
        bread = cramer_rao(jacobian.T @ jacobian)
        variance = np.diag(bread) * self.task.sigma**2
        step = (self.task.document.fit.details or {}).get("encoder_resolution")
        if step and step >= self.task.sigma:
            variance = np.maximum(variance, _converter_variance(bread, jacobian, found, step))
        spread = dict(zip(used, np.sqrt(np.maximum(variance, 0.0))))
        return np.array([max(spread.get(n, 0.0), found.floor.get(n, 0.0)) or np.inf for n in names])

    def try_out(self, waveform: Waveform) -> _Trial:
        """Simulate a waveform; smaller until it stays within the stroke."""
        for _ in range(5):
            absolute = waveform.shape == "approach"  # its levels are what matters
            drifts = self.drifts and not absolute
            command, balance = self._balanced(waveform) if drifts else self._command(waveform, 0.0)
            output = self._simulate(command)
            if self._within(output):
                errors = self.errors(self._inform(command))
                return _Trial(waveform, command, output, errors, _score(self.task, errors), balance)
            stroke = self.task.limits.stroke
            if stroke is None:
                break
            share = min(max((stroke[1] - stroke[0]) / float(np.ptp(output)), 0.4), 0.85)
            if absolute and waveform.then is not None:
                then = replace(waveform.then, size=share * waveform.then.size)
                waveform = replace(waveform, then=then)
            else:
                waveform = replace(waveform, size=share * waveform.size)
        nothing = np.full(len(self.task.unknowns), np.inf)
        return _Trial(waveform, command, output, nothing, np.inf)

    def straighten(self, trial: _Trial) -> Waveform | None:
        """The straight pieces that a trial consists of; ``None`` if it does not.

        Neither do slow passages, whose levels hold for whatever the static level is.
        """
        if trial.waveform.shape == "approach":
            return None
        shape, weaken = self._shape(trial.waveform, trial.balance)
        up, down = min(1.0, 1.0 + weaken), min(1.0, 1.0 - weaken)
        return to_segments(np.where(shape > 0.0, up, down) * shape, _PIECES)

    def _shape(self, waveform: Waveform, balance: float) -> tuple[FloatArray, float]:
        """Values between -1 and 1 after a short rest, and the balance that is left to make.

        A shape with a duty is balanced by how long each direction lasts, which costs no
        amplitude; any other by how strong it is.
        """
        turned = waveform.lengthen(float(np.exp(-2.0 * balance)))
        n = self.time.size
        rest = 0 if waveform.shape == "segments" else min(max(n // 50, 2), 20)
        shape = turned.sample(n - rest, self.task.limits.sample_time)
        return np.concatenate((np.zeros(rest), shape)), 0.0 if turned != waveform else balance

    def _command(self, waveform: Waveform, balance: float) -> tuple[FloatArray, float]:
        """Command [SI] and its ``balance``; a positive one drives upwards."""
        return self._to_command(*self._shape(waveform, balance)), balance

    def _balanced(self, waveform: Waveform) -> tuple[FloatArray, float]:
        """Command that ends where it began, within a tenth of the stroke, if that can be."""
        stroke = self.task.limits.stroke
        command, _ = self._command(waveform, 0.0)
        if stroke is None:
            return command, 0.0
        low, high, balance = -0.95, 0.95, 0.0
        for _ in range(6):
            y = self._simulate(command)
            drift = float(y[-1] - y[0])
            if abs(drift) < 0.1 * (stroke[1] - stroke[0]):
                break
            low, high = (low, balance) if drift > 0.0 else (balance, high)
            balance = 0.5 * (low + high)
            command, _ = self._command(waveform, balance)
        return command, balance

    def _within(self, output: FloatArray) -> bool:
        stroke = self.task.limits.stroke
        if stroke is None:
            return True
        if self.drifts:
            return bool(np.ptp(output) <= stroke[1] - stroke[0])
        # the file's range is that of noisy samples and of an offset that belongs to its log
        slack = 0.05 * (stroke[1] - stroke[0]) + 4.0 * self.task.sigma
        return bool(output.min() >= stroke[0] - slack and output.max() <= stroke[1] + slack)


def _candidates(task: _Task) -> list[Waveform]:
    """Shapes to begin with; the search stretches their times and frequencies."""
    span, step = task.limits.duration, task.limits.sample_time
    sizes = ("hold", "small", "part")
    holds = np.geomspace(max(4.0 * step, 0.002 * span), 0.12 * span, 8)
    out = [Waveform("steps", {"hold": h, "levels": n, "duty": 1.0}, ("hold",), task.seed)
           for h in holds for n in (2.0, 5.0)]  # fmt: skip
    out += [Waveform("square", {"hold": h, "last": h * g, "duty": 1.0}, ("hold", "last"))
            for h in holds for g in (1.0, 4.0)]  # fmt: skip
    out += [Waveform("two sizes", {"hold": h, "small": h * g, "part": p, "duty": 1.0}, sizes)
            for h in holds for g, p in ((1.0, 0.5), (2.0, 0.35))]  # fmt: skip
    out += [Waveform("rest and go", {"hold": h, "pause": h * g}, ("hold", "pause"))
            for h in holds for g in (0.3, 1.0)]  # fmt: skip
    bands = [1.0 / (2.0 * h) for h in holds]
    out += [Waveform("chirp", {"first": 1.0 / span, "last": f, "log": k}, ("first", "last"))
            for f in bands[:6] for k in (0.0, 1.0)]  # fmt: skip
    out += [Waveform("multisine", {"first": 1.0 / span, "last": f}, ("last",), task.seed)
            for f in bands[:6]]  # fmt: skip
    out += [Waveform("triangle", {"period": span / n}, ("period",)) for n in (1.0, 2.0, 4.0, 8.0)]
    slow = Waveform("triangle", {"period": 0.25 * span}, ("period",))
    for h in holds[1:6]:
        numbers = {"hold": h, "levels": 2.0, "duty": 1.0}
        out.append(replace(slow, then=Waveform("steps", numbers, ("hold",), task.seed)))
    return [*out, *_mixtures(holds), *_approaches(task)]


def _mixtures(holds: FloatArray) -> list[Waveform]:
    """Slow squares of two sizes, which show levels and slopes, and then a quick one."""
    out = []
    for q in holds[1:6:2]:
        quick = Waveform("square", {"hold": q, "last": q, "duty": 1.0}, ("hold", "last"))
        for h in holds[4:]:
            numbers = {"hold": h, "small": h, "part": 0.6, "duty": 1.0}
            slow = Waveform("two sizes", numbers, ("hold", "small", "part"), then=quick)
            out += [replace(slow, turn=turn) for turn in (0.35, 0.65)]
    return out


def _approaches(task: _Task) -> list[Waveform]:
    """Slow passages through the static levels, for models that have any."""
    levels: dict[str, float] = {}
    for side, limit in zip(("positive", "negative"), reversed(task.limits.amplitude)):
        unknown = next((u for u in task.unknowns if u.name == f"breakaway_{side}"), None)
        if unknown is None or not limit:
            return []
        low, high = _ramp_range(task, unknown, side)
        levels[f"low_{side}"] = low / abs(limit)
        levels[f"high_{side}"] = min(high / abs(limit), 1.0)
    span = task.limits.duration
    free = ("half", "pause", "push")
    out = []
    # A fit of slow passages alone has several optima; lively motion has one.
    for last in (10.0, 40.0):
        band = {"first": 2.0 / span, "last": last / span, "log": 0.0}
        lively = Waveform("chirp", band, ("first", "last"))
        for n in (2.0, 4.0, 6.0):
            for pause in (0.15, 0.3):
                numbers = {"half": 0.5 * span / n, "pause": pause, "push": 0.03, **levels}
                out.append(Waveform("approach", numbers, free, then=lively))
    return out


def _ramp_range(task: _Task, unknown: _Unknown, side: str) -> tuple[float, float]:
    """Levels between which a static level is sure to lie [SI of the drive]."""
    kinetic = task.values.get(f"coulomb_{side}")
    base = kinetic if isinstance(kinetic, float) else 0.0
    if unknown.supposed or unknown.present is None:
        return base, max(2.0 * base, 1.3 * unknown.value)
    half = max(4.0 * unknown.present, 0.02 * unknown.value)
    return max(unknown.value - half, base), unknown.value + half


def _improve(search: _Search, trial: _Trial) -> _Trial:
    """Change one number at a time while that helps."""
    factor = 1.5
    while factor > 1.04:
        before = trial
        for k in range(len(trial.waveform.neighbours(factor))):
            some = trial.waveform.neighbours(factor)
            tried = search.try_out(some[min(k, len(some) - 1)])
            if tried.score < trial.score - 1e-3:
                trial = tried
        if trial is before:
            factor = 1.0 + 0.5 * (factor - 1.0)
    return trial


def _reshape(search: _Search, trial: _Trial) -> _Trial:
    """Change the levels and lengths of a trial's straight pieces one by one while that helps."""
    begun = search.straighten(trial)
    if begun is None:
        return trial
    best = search.try_out(begun)
    level, factor, left = 0.2, 1.25, _TRIES
    while level > 0.02 and left > 0:
        before = best
        for name in begun.numbers:
            if name.startswith("end_"):
                continue
            for sign in (1.0, -1.0):
                tried = search.try_out(_change(best.waveform, name, sign * level, factor**sign))
                left -= 1
                if tried.score < best.score - 1e-4:
                    best = tried
                    break
        if before.score - best.score < 0.005:
            level, factor = 0.5 * level, 1.0 + 0.5 * (factor - 1.0)
    return best if best.score < trial.score else trial


def _change(waveform: Waveform, name: str, shift: float, factor: float) -> Waveform:
    """Stretch one piece by a factor, or shift its level; of a ramp, where it begins."""
    numbers = dict(waveform.numbers)
    kind, _, index = name.partition("_")
    if kind == "length":
        numbers[name] *= factor
        return replace(waveform, numbers=numbers)
    flat = numbers[name] == numbers[f"end_{index}"]
    moved = float(np.clip(numbers[name] + shift, -1.0, 1.0))
    numbers[name] = moved
    if flat:
        numbers[f"end_{index}"] = moved
    return replace(waveform, numbers=numbers)


def _design_dynamic(task: _Task) -> Design:
    if not task.limits.sample_time:
        raise UsageError("the sample time is unknown.", remedy="Give --sample-time and --duration.")
    search = _Search(task)
    waveforms = _candidates(task)
    trials = []
    for number, waveform in enumerate(waveforms, start=1):
        if number % 10 == 1:
            task.progress(f"candidate {number} of {len(waveforms)}")
        trials.append(search.try_out(waveform))
    trials = sorted((t for t in trials if np.isfinite(t.score)), key=lambda t: t.score)
    if not trials:
        raise NotIdentifiedError(
            "no excitation within these limits determines every parameter.",
            expected="Nothing was written.",
            remedy="Widen --amplitude or --stroke, or give a longer --duration.",
        )
    leaders = _best_of_each(trials)
    improved = []
    for number, trial in enumerate(leaders[:_LEADERS], start=1):
        task.progress(f"improving {number} of {min(len(leaders), _LEADERS)}")
        improved.append(_improve(search, trial))
    improved.sort(key=lambda t: t.score)
    task.progress("shaping the best")
    improved[:1] = [_reshape(search, trial) for trial in improved[:1]]
    ranking = sorted([*improved, *leaders[_LEADERS:]], key=lambda t: t.score)
    return _to_design(task, search, ranking)


def _best_of_each(trials: Sequence[_Trial]) -> list[_Trial]:
    """The best trial of every shape, best first."""
    best: dict[tuple[str, str], _Trial] = {}
    for t in trials:
        then = t.waveform.then
        best.setdefault((t.waveform.shape, then.shape if then else ""), t)
    return list(best.values())


def _to_design(task: _Task, search: _Search, ranking: Sequence[_Trial]) -> Design:
    best = ranking[0]
    scales = np.array([u.scale for u in task.unknowns])
    notes = list(task.notes)
    if search.drifts and task.limits.stroke is not None:
        start = task.limits.stroke[0] - float(best.output.min() - best.output[0])
        spare = task.limits.stroke[1] - task.limits.stroke[0] - float(np.ptp(best.output))
        unit = task.variant.output.unit
        notes.append(
            f"Start at {task.variant.output.name} {start + 0.5 * spare:.4g} {unit}: from there the "
            f"run needs {np.ptp(best.output):.4g} {unit} of stroke."
        )
    if task.hold != "zoh" and task.limits.rate is None:
        notes.append(
            f"{task.drive.name} moves on between samples; jumps are spread over {_RISE} samples. "
            "Give --rate if the source is slower."
        )
    candidates = [
        Candidate(t.waveform.describe(), _finite(np.max(t.errors / scales))) for t in ranking
    ]
    name = task.drive.name
    return Design(
        family=task.family.name,
        description=best.waveform.describe(),
        time=search.time,
        signals={name: best.command},
        units={name: task.unit},
        forecasts=_forecasts(task, best.errors),
        criterion=task.criterion,
        limits=task.limits,
        binding=_binding(task, search, best),
        notes=tuple(notes),
        candidates=tuple(candidates),
    )


def _binding(task: _Task, search: _Search, best: _Trial) -> tuple[str, ...]:
    """Limits that the design reaches."""
    limits = task.limits
    out = []
    low, high = limits.amplitude
    margin = 0.01 * (high - low)
    if best.command.min() <= low + margin or best.command.max() >= high - margin:
        out.append("amplitude")
    slope = float(np.abs(np.diff(best.command)).max()) / limits.sample_time
    if limits.rate is not None and slope >= 0.97 * limits.rate:
        out.append("rate")
    if limits.stroke is not None:
        wide = limits.stroke[1] - limits.stroke[0]
        reached = float(np.ptp(best.output)) >= 0.85 * wide
        if search.drifts and (reached or best.waveform.size < 1.0):
            out.append("stroke")
    return (*out, "duration")


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _forecasts(task: _Task, errors: FloatArray) -> tuple[Forecast, ...]:
    """Present and predicted standard errors side by side."""
    specs = {s.name: s for s in task.variant.parameters}
    out = []
    for u, error in zip(task.unknowns, errors):
        predicted = _finite(error)
        spec = specs[u.name.split("[")[0]]

        def interval(
            e: float | None, u: _Unknown = u, low: float = spec.minimum, high: float = spec.maximum
        ) -> tuple[float, float] | None:
            if e is None:
                return None
            return max(u.value - _QUANTILE * e, low), min(u.value + _QUANTILE * e, high)

        present = interval(u.present)
        stated = task.document.parameters.get(u.name)
        if stated is not None and stated.ci95 is not None and u.present is not None:
            ends: Any = stated.ci95
            present = float(ends[0]), float(ends[1])
        ratio = predicted / u.present if predicted is not None and u.present else None
        out.append(Forecast(u.name, u.unit, u.value, u.present, predicted, ratio, present,
                            interval(predicted), u.supposed))  # fmt: skip
    return tuple(out)


# ---------------------------------------------------------------------------- static maps


def _design_static(task: _Task) -> Design:
    """Where to sample a static map."""
    if task.drive.name in ("velocity", "position"):
        return _design_strokes(task)
    grid = np.linspace(*task.limits.amplitude, 161)
    rows = _static_rows(task, grid)
    scales = np.array([u.scale for u in task.unknowns])
    chosen: str | int = task.criterion
    if task.criterion not in ("worst", "determinant"):
        chosen = [u.name for u in task.unknowns].index(task.criterion)
    share = optimal_measure(rows, scales, chosen)
    points, counts = _support(grid, share, _SPREAD)
    weights = counts * _static_samples(task)
    return _positions(task, points, weights, _static_errors(task, points, weights))


def _static_errors(task: _Task, points: FloatArray, weights: FloatArray) -> FloatArray:
    """Predicted standard errors of so many samples at some points, shape ``(p,)``."""
    at = _static_rows(task, points)
    return np.sqrt(np.diag(cramer_rao(at.T @ (weights[:, None] * at)))) * task.sigma


def _static_samples(task: _Task) -> int:
    """Samples of the next static experiment: those of the longest log, or the duration's."""
    limits = task.limits
    if limits.sample_time and limits.duration:
        return limits.count
    return max((source.rows for source in task.document.provenance.logs), default=1000)


def _static_rows(task: _Task, points: FloatArray) -> FloatArray:
    """Derivative of the map by the unknowns at some points, shape ``(n, p)``."""
    rows = []
    for u in task.unknowns:
        size = 1e-5 * u.scale
        up, down = (_evaluate(task, u.name, u.value + s * size, points) for s in (1.0, -1.0))
        rows.append((up - down) / (2.0 * size))
    return np.column_stack(rows)


def _evaluate(task: _Task, name: str, value: float, points: FloatArray) -> FloatArray:
    """The map with one number changed."""
    values: dict[str, Any] = {
        k: list(v) if isinstance(v, list) else v for k, v in task.values.items()
    }
    head, bracket, index = name.partition("[")
    if bracket:
        values[head][int(index[:-1])] = value
    else:
        values[head] = value
    entries = {k: {"value": v} for k, v in values.items()}
    block: Any = task.family.block(task.variant, {"parameters": entries})
    if block is None or not callable(block):
        raise UsageError(f"the next experiment of {task.family.name} cannot be designed.")
    return np.asarray(block(points), dtype=float)


def _support(grid: FloatArray, share: FloatArray, spread: float) -> tuple[FloatArray, FloatArray]:
    """Points that carry the design and their shares; ``spread`` of it goes to an even grid."""
    kept = np.flatnonzero(share > 0.02 * share.max())
    apart = (np.diff(kept) > 2) | (grid[kept[:-1]] * grid[kept[1:]] < 0.0)
    groups = np.split(kept, np.flatnonzero(apart) + 1)
    points = [float(grid[g] @ share[g] / share[g].sum()) for g in groups]
    weights = np.array([float(share[g].sum()) for g in groups])
    weights *= (1.0 - spread) / weights.sum()
    even = np.linspace(grid[0], grid[-1], 21)
    all_points = np.concatenate((points, even))
    all_weights = np.concatenate((weights, np.full(even.size, spread / even.size)))
    merged, where = np.unique(np.round(all_points, 9), return_inverse=True)
    return np.asarray(merged, dtype=float), np.bincount(where.ravel(), all_weights).astype(float)


def _positions(task: _Task, points: FloatArray, weights: FloatArray, errors: FloatArray) -> Design:
    """A list of positions to hold, each for a number of samples."""
    output = task.variant.output
    counts = np.maximum(np.round(weights), 1.0)
    reference = _evaluate(task, task.unknowns[0].name, task.unknowns[0].value, points)
    note = (
        f"{100.0 * _SPREAD:.0f} % of the samples are spread evenly: the rest would not show "
        "whether the curve has another shape."
    )
    return Design(
        family=task.family.name,
        description=f"{points.size} positions to hold",
        time=np.zeros(0),
        signals={output.name: reference, task.drive.name: points, "samples": counts},
        units={output.name: output.unit, task.drive.name: task.unit, "samples": "1"},
        forecasts=_forecasts(task, errors),
        criterion=task.criterion,
        limits=task.limits,
        binding=("amplitude", "duration"),
        notes=(*task.notes, note),
        candidates=(),
    )


# -------------------------------------------------------------------- strokes of a cylinder


@dataclass(frozen=True)
class _Strokes:
    """Pairs of strokes to and fro at constant speed: slow ones, then fast ones.

    ``slow`` and ``fast`` are the speeds forwards and backwards [m/s], magnitudes; ``share``
    is that of the time that the slow pairs take.
    """

    slow: tuple[float, float]
    fast: tuple[float, float]
    share: float

    def speeds(self) -> list[tuple[float, float]]:
        """Signed speed and its share of the time; a pair goes as far to as fro."""
        out = []
        for (to, fro), share in ((self.slow, self.share), (self.fast, 1.0 - self.share)):
            out += [(to, share * fro / (to + fro)), (-fro, share * to / (to + fro))]
        return out

    def play(self, stroke: tuple[float, float] | None, duration: float, step: float) -> FloatArray:
        """Velocity at the samples, shape ``(n,)`` [m/s]; straight ramps at the turns."""
        count, turn = round(duration / step), max(round(_TURN / step), 2)
        pieces: list[FloatArray] = []
        for (to, fro), share in ((self.slow, self.share), (self.fast, 1.0 - self.share)):
            there = share * duration * fro / (to + fro)
            longest = _USED * (stroke[1] - stroke[0]) if stroke else np.inf
            laps = max(int(np.ceil(to * there / longest)), 1) if np.isfinite(longest) else 1
            for _ in range(laps):
                n, m = (max(round(t / laps / step), 2 * turn) for t in (there, there * to / fro))
                pieces += [_stroke(to, n, turn), -_stroke(fro, m, turn)]
        velocity = np.concatenate(pieces)[:count]
        return np.pad(velocity, (0, count - velocity.size))


def _design_strokes(task: _Task) -> Design:
    """Strokes at constant speed whose speeds and shares of the time are searched."""
    low, high = _speed_limits(task)
    slowest = _slowest(task, low, high)
    starts = [
        _Strokes((k * slowest, k * slowest), (high, -low), share)
        for k in (1.0, 2.0, 4.0)
        for share in (0.3, 0.5, 0.7, 0.85)
        if k * slowest < min(high, -low)
    ]
    tried = sorted(((_score(task, _stroke_errors(task, s)), s) for s in starts), key=lambda t: t[0])
    if not tried or not np.isfinite(tried[0][0]):
        raise NotIdentifiedError(
            "no strokes within these limits determine every parameter.",
            expected="Nothing was written.",
            remedy="Widen --amplitude or --stroke, or give a longer --duration.",
        )
    best = min(
        (_improve_strokes(task, s, (low, high), slowest) for _, s in tried[:2]),
        key=lambda s: _score(task, _stroke_errors(task, s)),
    )
    return _describe_strokes(task, best, _least(task, low, high, slowest))


def _speed_limits(task: _Task) -> tuple[float, float]:
    """Lowest and highest velocity [m/s]."""
    if task.drive.name == "velocity":
        return task.limits.amplitude
    details = task.document.fit.details or {}
    # the file of a position knows its stroke as range, and its speeds
    fast = max((abs(v) for pair in details.get("speeds", {}).values() for v in pair), default=0.0)
    return -fast, fast


def _slowest(task: _Task, low: float, high: float) -> float:
    """Speed that is safely beyond the deadband of a fit [m/s]."""
    details = task.document.fit.details or {}
    # a deadband of four standard deviations, and as much again for the noise of a sample
    slow = max(2.0 * float(details.get("deadband") or 0.0), 0.075 * max(high, -low))
    if not (high > slow and -low > slow):
        raise UsageError(
            "the speeds allow no motion in both directions.",
            expected=f"Both ends have to lie beyond {slow:.3g} m/s.",
            remedy="Give --amplitude LOW:HIGH as a range of velocities, for example -0.1:0.1.",
        )
    return slow


def _stroke_limit(task: _Task) -> tuple[float, float] | None:
    """Range of the position, when it was said or the file knows it [m]."""
    covered = task.document.validity.get("position")
    known = None if covered is None else (covered.low, covered.high)
    return task.limits.stroke or known


def _play(task: _Task, strokes: _Strokes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time [s], velocity [m/s] and position [m], shape ``(n,)`` each."""
    step = task.limits.sample_time or 0.01
    stroke = _stroke_limit(task)
    velocity = strokes.play(stroke, task.limits.duration or 10.0, step)
    place = step * (np.cumsum(velocity) - 0.5 * velocity)
    place += (stroke or (0.0, 0.0))[0] - place.min()
    return step * np.arange(velocity.size, dtype=np.float64), velocity, place


def _converter_variance(
    bread: FloatArray, jacobian: FloatArray, found: Information, step: float
) -> FloatArray:
    """Variances by the error of a converter, which lasts as long as a reading, shape ``(p,)``.

    As in :func:`.estimation.uncertainty.covariance`: an axis at rest tells the same error
    over and over again.
    """
    starts = np.flatnonzero(np.diff(np.floor(found.output / step), prepend=np.nan) != 0.0)
    sums = np.add.reduceat(jacobian, starts, axis=0)
    known = np.where(np.isfinite(bread), bread, 0.0)
    return np.diag(known @ (sums.T @ sums) @ known) * step**2 / 12.0


def _stroke_errors(task: _Task, strokes: _Strokes) -> FloatArray:
    """Predicted standard errors of what a fit keeps of the strokes, shape ``(p,)``."""
    time, velocity, place = _play(task, strokes)
    name = task.drive.name
    signal = Signal(name, time, velocity if name == "velocity" else place, task.unit)
    run = Experiment("design", 0, time, {name: signal}, float(time[1]), True)
    details = task.document.fit.details or {}
    options = dict(task.options)
    if name == "position":  # what it takes to quieten the sensor, the simulation cannot know
        options["filter"] = details.get("velocity_filter", {}).get("half_width")
    found = task.family.information(task.variant, task.values, run, options)
    assert found is not None
    rows = found.jacobian[:, [found.names.index(u.name) for u in task.unknowns]]
    return np.sqrt(np.diag(cramer_rao(rows.T @ rows))) * _force_noise(task)


def _force_noise(task: _Task) -> float:
    """Standard deviation of the force about the friction line [N]."""
    return float((task.document.fit.details or {}).get("force_noise") or task.sigma)


def _improve_strokes(
    task: _Task, start: _Strokes, limits: tuple[float, float], slowest: float
) -> _Strokes:
    """Search speeds and shares from a start."""
    low, high = limits

    def make(x: FloatArray) -> _Strokes:
        to, fro = slowest * np.exp(np.abs(x[:2]))
        fast = high * np.exp(-abs(x[3])), -low * np.exp(-abs(x[4]))
        slow = min(float(to), float(fast[0])), min(float(fro), float(fast[1]))
        share = 1.0 / (1.0 + np.exp(-x[2]))
        return _Strokes(slow, (float(fast[0]), float(fast[1])), float(np.clip(share, 0.02, 0.98)))

    at = [np.log(start.slow[0] / slowest), np.log(start.slow[1] / slowest),
          np.log(start.share / (1.0 - start.share)), 0.0, 0.0]  # fmt: skip
    found = _minimise(
        lambda x: _score(task, _stroke_errors(task, make(x))),
        np.array(at),
        np.array([0.3, 0.3, 0.4, 0.15, 0.15]),
        200,
    )
    return make(found)


def _minimise(
    score: Callable[[FloatArray], float], start: FloatArray, spread: FloatArray, most: int
) -> FloatArray:
    """Smallest score near a start, by the simplex of Nelder and Mead."""
    from scipy.optimize import minimize

    def finite(x: FloatArray, *args: Any) -> Any:
        return min(score(x), 1e6)

    options: Any = {
        "initial_simplex": np.vstack((start, start + np.diag(spread))),
        "maxfev": most,
        "xatol": 1e-3,
        "fatol": 1e-5,
    }
    return np.asarray(minimize(finite, start, method="Nelder-Mead", options=options).x)


def _least(task: _Task, low: float, high: float, slowest: float) -> FloatArray:
    """Standard errors of the best shares of the samples at any speeds, turns left out.

    A straight line in either direction is known best from its ends, so the two slowest and
    the two fastest speeds are enough.
    """
    rows = _static_rows(task, np.array([low, -slowest, slowest, high]))
    size = _force_noise(task) / np.sqrt(_static_samples(task))

    def errors(x: FloatArray) -> FloatArray:
        shares = np.exp(np.append(x, 0.0) - np.max(np.append(x, 0.0)))
        shares /= shares.sum()
        return np.asarray(size * np.sqrt(np.diag(cramer_rao(rows.T @ (shares[:, None] * rows)))))

    return errors(_minimise(lambda x: _score(task, errors(x)), np.zeros(3), np.ones(3), 600))


def _describe_strokes(task: _Task, best: _Strokes, ideal: FloatArray) -> Design:
    """The design in words and numbers."""
    time, velocity, place = _play(task, best)
    errors = _stroke_errors(task, best)
    stroke, scales = _stroke_limit(task), np.array([u.scale for u in task.unknowns])
    listed = ", ".join(f"{v:.3g} m/s ({100.0 * s:.0f} %)" for v, s in sorted(best.speeds()))
    notes = [*task.notes, f"Speeds and their shares of the time: {listed}."]
    notes.append(
        f"The worst relative standard error becomes {100.0 * np.max(errors / scales):.3g} %; no "
        f"speeds within the limits could bring it below {100.0 * np.max(ideal / scales):.3g} %."
    )
    notes += _time_to_halve(task, errors)
    if stroke is None:
        notes.append(
            f"The stroke is not in the file: this one needs {np.ptp(place):.3g} m. "
            "Give --stroke LOW:HIGH."
        )
    return Design(
        family=task.family.name,
        description=f"strokes at {len(best.speeds())} constant speeds",
        time=time,
        signals={"velocity": velocity, "position": place},
        units={"velocity": "m/s", "position": "m"},
        forecasts=_forecasts(task, errors),
        criterion=task.criterion,
        limits=replace(task.limits, stroke=stroke),
        binding=("amplitude", *(("stroke",) if stroke else ()), "duration"),
        notes=tuple(notes),
        candidates=(),
    )


def _time_to_halve(task: _Task, errors: FloatArray) -> list[str]:
    """How long these strokes have to last to halve the worst standard error there is now."""
    scales = np.array([u.scale for u in task.unknowns])
    present = [u.present / u.scale for u in task.unknowns if u.present is not None]
    if len(present) < len(task.unknowns):
        return []
    ratio = float(np.max(errors / scales)) / max(present)
    if ratio <= 0.5:
        return []
    duration = (task.limits.duration or 10.0) * (ratio / 0.5) ** 2
    return [
        f"That is {ratio:.2g} times the worst one now. Half of it takes such strokes for "
        f"{duration:.3g} s: give --duration {np.ceil(duration):.0f}, or average more readings of "
        "the force."
    ]


def _stroke(speed: float, count: int, turn: int) -> FloatArray:
    """Speed up, hold, slow down; shape ``(count,)`` [m/s]."""
    ramp = (np.arange(turn) + 0.5) / turn
    middle = np.ones(max(count - 2 * turn, 0))
    return np.asarray(speed * np.concatenate((ramp, middle, ramp[::-1]))[:count])
