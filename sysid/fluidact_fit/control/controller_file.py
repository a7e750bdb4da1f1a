"""The controller file: what a closed loop needs beside the parameter files.

A small YAML of numbers and words; it holds no code and names no other file::

    format: fluidact-controller
    format_version: 1
    kind: pd
    sample_time: 0.01
    controller: {proportional: 4.0, damping_ratio: 0.8, friction: static}
    machine: {lever: 5.6e-5, transmission: 27646.0}
    limits: {low: -0.02, high: 0.02}

Sections are declared below, one field a key. All values are SI.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from ..errors import ControllerFileError, ParameterFileError
from ..options import FamilyOptions, choice, describe, number, whole
from ..parameters.load import CONTROLLER_FORMAT
from ..parameters.problems import Location, Problems, format_path, suggest
from ..parameters.yaml_io import read_yaml

FORMAT, VERSION = CONTROLLER_FORMAT, 1
SectionT = TypeVar("SectionT", bound=FamilyOptions)


def _cutoff() -> Any:
    return number(10.0, help="cut-off frequency of the velocity filter", unit="Hz", above=0.0)


@dataclass(frozen=True)
class PDKeys(FamilyOptions):
    """``kind: pd``: gains, or what they follow from."""

    proportional: float | None = number(help="K_p [command per m or rad]", above=0.0)
    derivative: float | None = number(help="K_d [command s per m or rad]", minimum=0.0)
    ramp_error: float | None = number(
        help="error that a ramp of ramp_speed may leave, friction compensated: K_p = A B / e",
        above=0.0,
    )
    ramp_speed: float | None = number(help="slope of that ramp, per second", above=0.0)
    bandwidth: float | None = number(help="natural frequency of the loop", unit="Hz", above=0.0)
    damping_ratio: float | None = number(
        help="K_d follows from it: zeta = (B + K_d) / (2 sqrt(M K_p))", above=0.0
    )
    friction: str = choice(
        "none", ("none", "static"), "static friction of the parameter files that is compensated"
    )
    velocity_tolerance: float = number(
        0.0, help="speed below which it is: what the filtered velocity shows at rest", minimum=0.0
    )
    cutoff: float = _cutoff()


@dataclass(frozen=True)
class ImpedanceKeys(FamilyOptions):
    """``kind: impedance``: what the rod is to feel like, and how pressures share the force."""

    stiffness: float | None = number(help="stiffness", unit="N/m", above=0.0)
    damping: float | None = number(help="damping", unit="N s/m", minimum=0.0)
    damping_ratio: float | None = number(
        help="damping follows from it: 2 zeta sqrt(m k)", above=0.0
    )
    sum_of_pressures: float | None = number(help="P1 + P2", unit="Pa", above=0.0)
    friction: str = choice(
        "none", ("none", "viscous", "all"), "friction of the parameter file that is compensated"
    )
    velocity_tolerance: float = number(
        0.0, help="speed that has a direction for friction: all", unit="m/s", minimum=0.0
    )
    lowest_pressure: float = number(0.0, help="least pressure a valve gives", unit="Pa")
    highest_pressure: float | None = number(help="greatest pressure a valve gives", unit="Pa")
    cutoff: float = _cutoff()


@dataclass(frozen=True)
class ForceKeys(FamilyOptions):
    """``kind: feedforward-force``: smoothing of the instruction."""

    smoothing_steps: int = whole(1, help="n_s of equation 8; 1: no smoothing", minimum=1)
    smoothing: str = choice(
        "held", ("held", "recursive"), "reading of equation 8: a straight line, or as printed"
    )


@dataclass(frozen=True)
class MachineKeys(FamilyOptions):
    """Facts about the machine that no parameter file holds."""

    lever: float | None = number(help="torque per force of the screw, h", unit="m", above=0.0)
    transmission: float | None = number(
        help="angle of the motor per travel, 2 pi n / l", unit="rad/m", above=0.0
    )
    mass: float | None = number(help="moving mass", unit="kg", above=0.0)
    area_1: float | None = number(help="area of chamber 1", unit="m2", above=0.0)
    area_2: float | None = number(help="area of chamber 2, rod taken off", unit="m2", above=0.0)
    volume_1: float | None = number(help="gas in chamber 1 and line", unit="m3", above=0.0)
    volume_2: float | None = number(help="gas in chamber 2 and line", unit="m3", above=0.0)
    atmosphere: float = number(
        101325.0, help="pressure about the rod on the scale of the valves' files; 0: gauge",
        unit="Pa", minimum=0.0,
    )  # fmt: skip
    position: float = number(0.0, help="where the rod of a force loop is held", unit="m")
    travel_from: float | None = number(
        help="where the travel begins, for an exported controller of files that do not hold it"
    )
    travel_to: float | None = number(help="where the travel ends")


@dataclass(frozen=True)
class TissueKeys(FamilyOptions):
    """Tissue in the way of the rod."""

    surface: float | None = number(help="position of its surface", unit="m")
    stiffness: float | None = number(help="stiffness until punctured", unit="N/m", above=0.0)
    puncture_force: float | None = number(help="force that punctures it", unit="N", above=0.0)
    damping: float = number(0.0, help="damping until punctured", unit="N s/m", minimum=0.0)
    residual_stiffness: float = number(0.0, help="stiffness after", unit="N/m", minimum=0.0)


@dataclass(frozen=True)
class ReferenceKeys(FamilyOptions):
    """Course of the reference; what is not given depends on what is controlled."""

    start: float | None = number(help="where it begins, the plant at rest there")
    size: float | None = number(help="how far it goes")
    at: float | None = number(help="when it begins to", unit="s", minimum=0.0)
    speed: float | None = number(help="of triangle and ramp, per second", above=0.0)
    frequency: float | None = number(help="of the sine", unit="Hz", above=0.0)


@dataclass(frozen=True)
class LimitKeys(FamilyOptions):
    """Limits of the command of a PD or force loop, or of the force of an impedance [SI]."""

    low: float | None = number(help="lowest")
    high: float | None = number(help="highest")


ControllerKeys = PDKeys | ImpedanceKeys | ForceKeys
KINDS: Mapping[str, type[ControllerKeys]] = {
    "pd": PDKeys,
    "impedance": ImpedanceKeys,
    "feedforward-force": ForceKeys,
}
_TOP = (
    "format", "format_version", "kind", "sample_time",
    "controller", "machine", "tissue", "reference", "limits",
)  # fmt: skip


@dataclass(frozen=True)
class ControllerFile:
    """A controller file that was read and checked; ``tissue`` is ``None`` without any."""

    kind: str
    sample_time: float
    controller: ControllerKeys
    machine: MachineKeys = field(default_factory=MachineKeys)
    tissue: TissueKeys | None = None
    reference: ReferenceKeys = field(default_factory=ReferenceKeys)
    limits: LimitKeys = field(default_factory=LimitKeys)


def read_controller_file(path: str | os.PathLike[str]) -> ControllerFile:
    """Read and check a controller file.

    Raises
    ------
    ControllerFileError
        When it cannot be read or is not YAML, or naming every problem with its path and line.
    """
    try:
        text = read_yaml(path)
    except ParameterFileError as error:
        raise ControllerFileError(
            "; ".join(words for _, words in error.problems),
            where=error.where,
            expected="Expected a controller file, a YAML of numbers and words.",
        ) from None
    if "family" in text.data and "parameters" in text.data:
        raise ControllerFileError(
            "is a parameter file, not a controller file",
            where=os.fspath(path),
            remedy="Name it among PARAMS, and give --controller a file with the format "
            f"{FORMAT}: docs/closed-loop.md says what is in it.",
        )
    problems = text.problems
    found = _read(text.data, problems)
    if problems.found or found is None:
        listed = problems.listed(text.lines)
        lines = [f"{place}: {words}" if place else words for place, words in listed[:10]]
        raise ControllerFileError(
            "not a valid controller file:\n  " + "\n  ".join(lines), where=os.fspath(path)
        )
    return found


def _read(data: Mapping[str, Any], problems: Problems) -> ControllerFile | None:
    for key in data:
        if key not in _TOP:
            problems.add((key,), "there is no such key" + suggest(str(key), _TOP))
    if data.get("format") != FORMAT:
        problems.add(("format",), f"is not {FORMAT}")
    if data.get("format_version") != VERSION:
        problems.add(("format_version",), f"is not {VERSION}, the only one there is")
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        given = f"{kind!r} " if isinstance(kind, str) and len(kind) < 40 else ""
        problems.add(("kind",), f"{given}is not one of {', '.join(KINDS)}")
        return None
    sample_time = _positive(data.get("sample_time"), problems)
    tissue = None
    if "tissue" in data:
        needed = ("surface", "stiffness", "puncture_force")
        tissue = _section(TissueKeys, data, "tissue", problems, needed)
    found = ControllerFile(
        kind, sample_time,
        _section(KINDS[kind], data, "controller", problems),
        _section(MachineKeys, data, "machine", problems),
        tissue,
        _section(ReferenceKeys, data, "reference", problems),
        _section(LimitKeys, data, "limits", problems),
    )  # fmt: skip
    low, high = found.limits.low, found.limits.high
    if low is not None and high is not None and low >= high:
        problems.add(("limits",), f"low {low:g} is not below high {high:g}")
    _check_choices(found.controller, problems)
    _check_order(found, problems)
    begin, end = found.machine.travel_from, found.machine.travel_to
    if (begin is None) != (end is None) or (begin is not None and end is not None and begin >= end):
        problems.add(("machine",), "travel_from and travel_to belong together, the lower one first")
    return found


def _check_order(found: ControllerFile, problems: Problems) -> None:
    """Check that the lower, smaller or first of two is so."""
    keys, machine = found.controller, found.machine
    if isinstance(keys, ImpedanceKeys) and keys.highest_pressure is not None:
        low, high = keys.lowest_pressure, keys.highest_pressure
        if low >= high:
            what = f"{low:g} Pa is not below highest_pressure, {high:g} Pa"
            problems.add(("controller", "lowest_pressure"), what)
    one, two = machine.area_1, machine.area_2
    if one is not None and two is not None and two > one:
        what = f"{two:g} m2 is larger than area_1, {one:g} m2: the rod takes area off chamber 2"
        problems.add(("machine", "area_2"), what)


def _positive(value: Any, problems: Problems) -> float:
    """The sample time [s]."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-6 <= value <= 10.0:
        problems.add(("sample_time",), "is not a number of seconds from 1e-6 to 10")
        return 1.0
    return float(value)


def _section(
    kind: type[SectionT], data: Mapping[str, Any], name: str, problems: Problems,
    needed: tuple[str, ...] = (),
) -> SectionT:  # fmt: skip
    given = data.get(name)
    if given is None:
        given = {}
    if not isinstance(given, dict):
        problems.add((name,), "is not a mapping of keys to values")
        return kind()
    known = {o.keyword: o for o in describe(kind)}
    values = {}
    for key, value in given.items():
        place: Location = (name, key)
        if key not in known:
            problems.add(place, "there is no such key" + suggest(str(key), known))
            continue
        try:
            if value is None:
                raise ValueError("nothing is given")
            values[key] = known[key].read(value)
        except ValueError as error:
            problems.add(place, f"{error}; expected {known[key].expected}")
    for key in needed:
        if key not in given:
            problems.add((name, key), f"is missing: {known[key].help}")
    return kind(**values)


def _check_choices(keys: ControllerKeys, problems: Problems) -> None:
    """Of what can be given in two ways, one has to be."""

    def one_of(what: str, *names: str) -> None:
        given = [n for n in names if getattr(keys, n) is not None]
        if len(given) != 1:
            places = " and ".join(given) if given else "nothing"
            problems.add(
                ("controller",), f"{what}: {places} is given; expected one of {', '.join(names)}"
            )

    if isinstance(keys, PDKeys):
        one_of("proportional gain", "proportional", "ramp_error", "bandwidth")
        one_of("derivative gain", "derivative", "damping_ratio")
        if (keys.ramp_error is None) != (keys.ramp_speed is None):
            problems.add(("controller",), "ramp_error and ramp_speed belong together")
    if isinstance(keys, ImpedanceKeys):
        one_of("damping", "damping", "damping_ratio")
        for name in ("stiffness", "sum_of_pressures"):
            if getattr(keys, name) is None:
                problems.add(("controller", name), "is missing")


def place_of(section: str, key: str) -> str:
    """Path of a key in a message."""
    return format_path((section, key))
