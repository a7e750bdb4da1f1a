"""The task of a search: the drive, the unknowns, the limits and the criterion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import NotIdentifiedError, UsageError, check_names
from ..experiment import Experiment, FloatArray, Signal
from ..families import get_family
from ..family import Excitation, Family, FamilyOptions, Information, ParameterDocument
from ..specification import ParameterSpec, Plant, Role, Variant
from .result import NOT_GIVEN, Forecast, Limits

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
    """Design task, and all that a search needs to know, which follows from it.

    ``given`` are the limits as far as they were given.
    """

    document: ParameterDocument
    given: Limits
    criterion: str
    seed: int
    progress: Callable[[str], None]

    def check(self) -> None:
        """Refuse what cannot be designed."""
        if self.excitation.kind == "none":
            raise UsageError(
                f"the next experiment of {self.family.name} cannot be designed: "
                f"{self.excitation.reason}.",
                remedy="Its warnings and refusals say which experiments it needs.",
            )
        _check_limits(self.limits)
        criteria = ("worst", "determinant", *self.names)
        check_names("--criterion", "criterion", [self.criterion], criteria)

    @cached_property
    def family(self) -> Family[FamilyOptions]:
        """That of the file."""
        return get_family(self.document.family)

    @cached_property
    def variant(self) -> Variant:
        """That of the file."""
        return self.family.variant(self.document.variant)

    @cached_property
    def excitation(self) -> Excitation:
        """Design of an experiment of the family."""
        return self.family.excitation(self.variant, self.document)

    @cached_property
    def drive(self) -> Role:
        """The driving role, in the unit and with the hold of the file."""
        role = driving_role(self.variant)
        covered = self.document.validity.get(role.name)
        columns = [source.columns.get(role.name) for source in self.document.provenance.logs]
        hold = next((c.hold for c in columns if c and c.hold), role.hold)
        return replace(role, unit=covered.unit if covered else role.unit, hold=hold)

    @cached_property
    def output(self) -> Role:
        """Measured output, in the unit of the file."""
        units = {role: covered.unit for role, covered in self.document.validity.items()}
        return self.variant.measured_in(units).output

    @cached_property
    def limits(self) -> Limits:
        """Limits of the design; those not given are what the file's logs covered."""
        given, drive, output = self.given, self.drive, self.variant.output.name
        covered = {role: (r.low, r.high) for role, r in self.document.validity.items()}
        amplitude, stroke = given.amplitude, given.stroke
        if amplitude == NOT_GIVEN:
            if drive.name not in covered:
                raise UsageError(
                    f"the file does not say which range of {drive.name} its logs covered.",
                    remedy=f"Give --amplitude LOW:HIGH in {drive.unit}.",
                )
            amplitude = covered[drive.name]
        if stroke is None and driving_role(self.variant).hold is not None:
            stroke = covered.get(output)
        logs = [(log.sample_time or 0.0, log.rows) for log in self.document.provenance.logs]
        longest, step = max(((step * rows, step) for step, rows in logs), default=(0.0, 0.0))
        return replace(
            given, amplitude=amplitude, stroke=stroke, duration=given.duration or longest,
            sample_time=given.sample_time or step,
        )  # fmt: skip

    @cached_property
    def supposed(self) -> dict[str, float]:
        """Plausible values of what was not identified."""
        plant, limits = self.document.plant(self.family), self.limits
        found: dict[str, float] = {}
        for name, entry in self.document.parameters.items():
            if entry.status != "not_identified" or isinstance(entry.value, list):
                continue
            plant = replace(plant, values={**plant.values, **found})
            value = self.family.prior_guess(name, plant, limits.amplitude, limits.sample_time)
            if value is not None:
                found[name] = value
        return found

    @cached_property
    def plant(self) -> Plant[FamilyOptions]:
        """Model to simulate: values and options of the file, plausible values where it has none."""
        known = self.document.plant(self.family)
        return replace(known, values={**known.values, **self.supposed})

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Numbers that are estimated or should be, lists entry by entry."""
        found = []
        for name, entry in self.document.parameters.items():
            value, spread = self.plant.values[name], entry.std_error
            spec = self.variant.parameter(name)
            if isinstance(value, list):
                errors = spread if isinstance(spread, list) else []
                size = float(np.max(np.abs(value)))
                for i, (v, e) in enumerate(zip(value, errors)):
                    if isinstance(v, float) and isinstance(e, float) and e > 0.0:
                        found.append(Unknown(spec, entry.unit, v, size, e, index=i))
            elif entry.status == "estimated" or name in self.supposed:
                present = spread if isinstance(spread, float) else None
                scale = abs(value) or present or 1.0
                supposed = name in self.supposed
                found.append(Unknown(spec, entry.unit, value, scale, present, supposed))
        if not found:
            raise UsageError(
                "the file has no estimated parameter, so there is nothing to design for.",
                remedy="Fit without --fix.",
            )
        return tuple(found)

    @property
    def notes(self) -> list[str]:
        """Notes that apply to any design."""
        notes = [
            f"{name} was not identified; the design supposes {value:.4g}."
            for name, value in self.supposed.items()
        ]
        if self.drive.hold == "zoh" and any(u.spec.threshold for u in self.unknowns):
            notes.append(
                "A static level cannot be known better than the controller's step of "
                f"{self.drive.name} divided by 3.5, which the prediction does not include."
            )
        return notes

    @property
    def sigma(self) -> float:
        """Noise of the output [SI]."""
        return max(self.document.fit.rmse.value, 1e-300)

    def inform(self, run: Experiment) -> Information:
        """The information in a run, of the parameters that are unknown."""
        plant = replace(self.plant, options=self.excitation.options or self.plant.options)
        found = self.family.information(plant, run)
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
        """Objective: the logarithm of the criterion, and a little of all others."""
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
            if u.present is not None and stated is not None:
                ends: Any = stated if u.index is None else stated[u.index]
                present = float(ends[0]), float(ends[1])
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


def make_run(role: Role, time: FloatArray, values: FloatArray) -> Experiment:
    """A run in which a role takes these values [SI], shape ``(n,)``; without time, of a map."""
    signal = Signal(role.name, time, values, role.unit, role.hold, float(values[0]))
    step = float(time[1]) if time.size else 0.0
    return Experiment("design", 0, time, {role.name: signal}, step, bool(time.size))


def driving_role(variant: Variant) -> Role:
    """The role that drives the model; for a static map, what it is sampled over."""
    inputs = [r for r in variant.roles if r.required and not r.output and r.name != "time"]
    driving = [r for r in variant.driving if r.required]
    if not inputs and not driving:
        raise UsageError(
            "the next experiment cannot be designed: nothing drives this model.",
            remedy="Its warnings and refusals say which experiments it needs.",
        )
    return (driving or inputs)[0]


def _check_limits(limits: Limits) -> None:
    for name, pair in (("--amplitude", limits.amplitude), ("--stroke", limits.stroke)):
        if pair is not None and not pair[0] < pair[1]:
            raise UsageError(
                f"{name}={pair[0]:g}:{pair[1]:g}: the lower end is not below the upper."
            )
    if limits.rate is not None and not limits.rate > 0.0:
        raise UsageError(f"--rate={limits.rate:g}: a largest slope is above zero.")
    step, duration = limits.sample_time, limits.duration
    if step and not 20 <= limits.count <= _MOST:
        raise UsageError(
            f"{duration:g} s in steps of {step:g} s are {duration / step:.3g} samples.",
            expected=f"Expected 20 to {_MOST}.",
            remedy="Change --duration or --sample-time.",
        )
