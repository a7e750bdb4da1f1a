"""The task of a search: the drive, the unknowns, the limits and the criterion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import NotIdentifiedError, UsageError
from ..experiment import Experiment, FloatArray, Hold, Signal
from ..family import (
    Excitation,
    Family,
    FamilyOptions,
    Information,
    ParameterDocument,
    ParameterSpec,
    Role,
    Value,
    Variant,
)
from .result import Forecast, Limits

_MOST = 200_000  # samples of a run that is searched
_TIE = 0.05  # weight of the mean over all parameters beside the worst
_QUANTILE = 1.96


@dataclass(frozen=True)
class Unknown:
    """A number that the next experiment should determine; ``spec`` is that of its parameter.

    ``index`` is its place in a list. ``present`` is the standard error in the file; relative
    errors are shares of ``scale``.
    """

    spec: ParameterSpec
    unit: str
    value: float
    scale: float
    present: float | None
    supposed: bool = False
    index: int | None = None

    @property
    def name(self) -> str:
        """As in the covariance of the file, ``control_points[2]`` for an entry of a list."""
        return self.spec.name if self.index is None else f"{self.spec.name}[{self.index}]"

    def interval(self, error: float | None) -> tuple[float, float] | None:
        """95 % interval about the value, within the physical range."""
        if error is None:
            return None
        half = _QUANTILE * error
        return max(self.value - half, self.spec.minimum), min(self.value + half, self.spec.maximum)


@dataclass(frozen=True)
class Task:
    """Everything a search needs to know."""

    document: ParameterDocument
    family: Family[FamilyOptions]
    variant: Variant
    options: FamilyOptions
    excitation: Excitation
    drive: Role
    hold: Hold | None
    unit: str
    values: Mapping[str, Value]
    unknowns: tuple[Unknown, ...]
    limits: Limits
    criterion: str
    seed: int
    notes: tuple[str, ...]
    progress: Callable[[str], None]

    @property
    def sigma(self) -> float:
        """Noise of the output [SI]."""
        return max(self.document.fit.rmse.value, 1e-300)

    def run(self, time: FloatArray, drive: FloatArray, hold: Hold | None = None) -> Experiment:
        """A run in which the drive takes these values [SI], shape ``(n,)``."""
        signal = Signal(self.drive.name, time, drive, self.unit, hold, float(drive[0]))
        return Experiment("design", 0, time, {self.drive.name: signal}, float(time[1]), True)

    def inform(self, run: Experiment, options: FamilyOptions) -> Information:
        """The information in a run, of the parameters that are unknown."""
        found = self.family.information(self.variant, self.values, run, options)
        assert found is not None, f"{self.family.name} has a design but no information"
        used = [n for n in self.names if n in found.names]
        columns = found.jacobian[:, [found.names.index(n) for n in used]]
        return replace(found, names=tuple(used), jacobian=columns)

    @property
    def rest(self) -> float:
        """Value of the drive at rest: zero where the limits allow it."""
        low, high = self.limits.amplitude
        return 0.0 if low < 0.0 < high else 0.5 * (low + high)

    @property
    def names(self) -> list[str]:
        """Of the unknowns."""
        return [u.name for u in self.unknowns]

    @property
    def scales(self) -> FloatArray:
        """Sizes that the standard errors are compared with, shape ``(p,)``."""
        return np.array([u.scale for u in self.unknowns])

    def worst(self, errors: FloatArray) -> float:
        """Largest relative standard error."""
        return float(np.max(errors / self.scales))

    def score(self, errors: FloatArray) -> float:
        """What to minimise: the logarithm of the criterion, and a little of all others."""
        if not np.all(np.isfinite(errors)) or not np.all(errors > 0.0):
            return np.inf
        relative = np.log(errors / self.scales)
        mean = float(np.mean(relative))
        if self.criterion == "determinant":
            return mean
        if self.criterion == "worst":
            return float(relative.max()) + _TIE * mean
        return float(relative[self.names.index(self.criterion)]) + _TIE * mean

    def forecasts(self, errors: FloatArray) -> tuple[Forecast, ...]:
        """Present and predicted standard errors side by side."""
        out = []
        for u, error in zip(self.unknowns, errors):
            predicted = finite_or_none(error)
            ratio = predicted / u.present if predicted is not None and u.present else None
            present, stated = u.interval(u.present), self.document.parameters[u.spec.name].ci95
            if u.index is None and u.present is not None and stated is not None:
                low, high = np.array(stated).tolist()
                present = low, high
            out.append(Forecast(u.name, u.unit, u.value, u.present, predicted, ratio, present,
                                u.interval(predicted), u.supposed))  # fmt: skip
        return tuple(out)


def finite_or_none(value: float) -> float | None:
    """A number, or ``None`` if it is infinite or none."""
    return float(value) if np.isfinite(value) else None


def undetermined(excitation: str) -> NotIdentifiedError:
    """The error when no excitation of a kind determines every parameter."""
    return NotIdentifiedError(
        f"no {excitation} within these limits determines every parameter.",
        expected="Nothing was written.",
        remedy="Widen --amplitude or --stroke, or give a longer --duration.",
    )


def make_task(
    document: ParameterDocument,
    family: Family[FamilyOptions],
    given: Limits,
    criterion: str,
    seed: int,
    progress: Callable[[str], None],
) -> Task:
    """The task that a parameter file and the limits given make."""
    variant = family.variant(document.variant)
    excitation = family.excitation(variant, document)
    if excitation.kind == "none":
        raise UsageError(
            f"the next experiment of {family.name} cannot be designed: {excitation.reason}.",
            remedy="Its warnings and refusals say which experiments it needs.",
        )
    drive = _driving_role(variant)
    limits = _fill_limits(document, variant, drive, given)
    unit = document.validity[drive.name].unit if drive.name in document.validity else drive.unit
    values, supposed = _suppose(document, family, limits)
    unknowns = _find_unknowns(document, variant, values, supposed)
    names = [u.name for u in unknowns]
    if criterion not in ("worst", "determinant", *names):
        raise UsageError(
            f"--criterion={criterion}: there is no such criterion or parameter to estimate.",
            expected=f"One of worst, determinant, {', '.join(names)}.",
        )
    columns = [source.columns.get(drive.name) for source in document.provenance.logs]
    hold = next((c.hold for c in columns if c and c.hold), drive.hold)
    options = family.settled_options(document)
    notes = tuple(f"{n} was not identified; the design supposes {values[n]:.4g}." for n in supposed)
    if hold == "zoh" and any(u.spec.threshold for u in unknowns):
        notes += (
            f"A static level cannot be known better than the controller's step of {drive.name} "
            "divided by 3.5, which the prediction does not include.",
        )
    return Task(
        document, family, variant, options, excitation, drive, hold, unit, values, unknowns,
        limits, criterion, seed, notes, progress,
    )  # fmt: skip


def _driving_role(variant: Variant) -> Role:
    """The role that drives the model; for a static map, what it is sampled over."""
    inputs = [r for r in variant.roles if r.required and not r.output and r.name != "time"]
    driving = [r for r in variant.driving if r.required]
    if not inputs and not driving:
        raise UsageError(
            "the next experiment cannot be designed: nothing drives this model.",
            remedy="Its warnings and refusals say which experiments it needs.",
        )
    return (driving or inputs)[0]


def _fill_limits(
    document: ParameterDocument, variant: Variant, drive: Role, given: Limits
) -> Limits:
    """Take what was not given from what the file's logs covered."""
    covered = document.validity
    amplitude, stroke = given.amplitude, given.stroke
    if amplitude == (0.0, 0.0):
        if drive.name not in covered:
            raise UsageError(
                f"the file does not say which range of {drive.name} its logs covered.",
                remedy=f"Give --amplitude LOW:HIGH in {drive.unit}.",
            )
        amplitude = covered[drive.name].low, covered[drive.name].high
    if stroke is None and drive.hold is not None and variant.output.name in covered:
        stroke = covered[variant.output.name].low, covered[variant.output.name].high
    for name, pair in (("--amplitude", amplitude), ("--stroke", stroke)):
        if pair is not None and not pair[0] < pair[1]:
            raise UsageError(
                f"{name}={pair[0]:g}:{pair[1]:g}: the lower end is not below the upper."
            )
    logs = [(source.sample_time or 0.0, source.rows) for source in document.provenance.logs]
    longest, step = max(((step * rows, step) for step, rows in logs), default=(0.0, 0.0))
    step, duration = given.sample_time or step, given.duration or longest
    limits = Limits(amplitude, given.rate, stroke, duration, step)
    if step and not 20 <= limits.count <= _MOST:
        raise UsageError(
            f"{duration:g} s in steps of {step:g} s are {duration / step:.3g} samples.",
            expected=f"Expected 20 to {_MOST}.",
            remedy="Change --duration or --sample-time.",
        )
    return limits


def _suppose(
    document: ParameterDocument, family: Family[FamilyOptions], limits: Limits
) -> tuple[dict[str, Value], list[str]]:
    """Values to simulate with: those of the file, plausible ones where it has none."""
    values = dict(document.values())
    supposed = []
    for name, entry in document.parameters.items():
        if entry.status != "not_identified" or isinstance(entry.value, list):
            continue
        value = family.suppose(name, values, limits.amplitude, limits.sample_time)
        if value is not None:
            values[name] = value
            supposed.append(name)
    return values, supposed


def _find_unknowns(
    document: ParameterDocument,
    variant: Variant,
    values: Mapping[str, Value],
    supposed: Sequence[str],
) -> tuple[Unknown, ...]:
    """Numbers that are estimated or should be, lists entry by entry."""
    found = []
    for name, entry in document.parameters.items():
        value, spread, spec = values[name], entry.std_error, variant.parameter(name)
        if isinstance(value, list):
            errors = spread if isinstance(spread, list) else []
            size = float(np.max(np.abs(value)))
            for i, (v, e) in enumerate(zip(value, errors)):
                if isinstance(v, float) and isinstance(e, float) and e > 0.0:
                    found.append(Unknown(spec, entry.unit, v, size, e, index=i))
        elif entry.status == "estimated" or name in supposed:
            present = spread if isinstance(spread, float) else None
            scale = abs(value) or present or 1.0
            found.append(Unknown(spec, entry.unit, value, scale, present, name in supposed))
    if not found:
        raise UsageError(
            "the file has no estimated parameter, so there is nothing to design for.",
            remedy="Fit without --fix.",
        )
    return tuple(found)
