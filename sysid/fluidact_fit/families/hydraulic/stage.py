"""What was asked for and what was given: machine, chambers, windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...errors import LogError, Notice, UsageError
from ...estimation.hydraulics import (
    Machine,
    Windows,
    make_windows,
    window_length,
)
from ...experiment import Experiment
from ...family import ParameterSpec, Request

_SLOWEST = 2.5e-3  # s: at slower sampling the pressure resonance cannot be followed


@dataclass
class Stage:
    """Everything on the way from experiments to an estimate."""

    specs: tuple[ParameterSpec, ...]
    experiments: Sequence[Experiment]
    request: Request
    machine: Machine
    chambers: tuple[int, ...]
    notices: list[Notice] = field(default_factory=list)

    @property
    def gray(self) -> bool:
        """Whether the gray box can be fitted: everything given, both chambers seen."""
        return self.machine.complete and self.chambers == (1, 2)

    def uniform(self) -> bool:
        """Whether all logs are fast enough for the pressure dynamics."""
        return max(e.sample_time for e in self.experiments) <= _SLOWEST


def spec_of(specs: Sequence[ParameterSpec], name: str) -> ParameterSpec:
    """Entry of the parameter table by name."""
    return next(s for s in specs if s.name == name)


def recorded_chambers(experiments: Sequence[Experiment]) -> tuple[int, ...]:
    """Chambers whose pressure was recorded anywhere.

    Raises
    ------
    LogError
        When a log has neither pressure.
    """
    for e in experiments:
        if "pressure_1" not in e and "pressure_2" not in e:
            raise LogError(
                "neither chamber's pressure was recorded",
                where=e.name,
                expected="Expected pressure_1, pressure_2 or both.",
                remedy="Give --column pressure_1=... or --column pressure_2=...",
            )
    return tuple(i for i in (1, 2) if any(f"pressure_{i}" in e for e in experiments))


def read_machine(options: Mapping[str, Any], chambers: Sequence[int]) -> Machine:
    """Read what is given.

    Raises
    ------
    UsageError
        When something that the recorded chambers need is missing, or cannot be.
    """
    names = ("area-1", "area-2", "dead-volume-1", "dead-volume-2", "mass", "supply-pressure")
    given: dict[str, float | None] = {}
    for name in names:
        value = options.get(name)
        if value is not None and not value > 0.0:
            raise UsageError(
                f"--{name} {value:g}: it has to be positive", remedy=f"Give --{name} in SI units."
            )
        given[name] = None if value is None else float(value)
    needed = [*(f"area-{i}" for i in chambers), "supply-pressure"]
    missing = [f"--{n}" for n in needed if given[n] is None]
    if missing:
        raise UsageError(
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} needed",
            expected="Areas and supply pressure are properties of the machine that the logs "
            "cannot tell; nothing is assumed for them.",
            remedy="Give " + ", ".join(f"{m} NUMBER" for m in missing) + " in SI units (m2, Pa).",
        )
    tank = float(options.get("tank-pressure") or 0.0)
    supply = given["supply-pressure"] or 0.0
    if tank >= supply:
        raise UsageError(
            f"the tank pressure {tank:g} Pa is not below the supply pressure {supply:g} Pa",
            remedy="Correct --tank-pressure or --supply-pressure (Pa).",
        )
    return Machine(
        given["area-1"], given["area-2"], given["dead-volume-1"], given["dead-volume-2"],
        given["mass"], supply, tank,
    )  # fmt: skip


def check_volumes(machine: Machine, experiments: Sequence[Experiment]) -> None:
    """Refuse dead volumes that would leave a chamber without oil.

    Raises
    ------
    UsageError
        With the position at which a volume is used up, and the least that it has to be.
    """
    for chamber, sign in ((1, 1.0), (2, -1.0)):
        dead = machine.dead_volume(chamber)
        if dead is None:
            continue
        place = min((float((sign * e["position"]).min()), e.name) for e in experiments)
        taken = -machine.area(chamber) * place[0]
        if dead <= taken:
            raise UsageError(
                f"--dead-volume-{chamber} {dead:g}: chamber {chamber} would hold nothing at the "
                f"position {sign * place[0]:.4g} m of {place[1]}",
                expected=f"It is the volume at position 0 and more than {taken:.3g} m3 here.",
                remedy="Give the volume of chamber and line with the piston at position 0 (m3), "
                "and check the sign and the unit of the position.",
            )


def all_windows(stage: Stage, overlap: int = 1, shorter: float = 1.0) -> list[Windows]:
    """Windows of every recorded chamber of every log.

    Parameters
    ----------
    stage
        The fit.
    overlap
        How many windows begin within the length of one.
    shorter
        By what to divide the usual length.

    Raises
    ------
    LogError
        When none is left.
    """
    length = window_length(stage.experiments) / shorter
    found = []
    for k, e in enumerate(stage.experiments):
        for chamber in stage.chambers:
            if f"pressure_{chamber}" in e:
                made = make_windows(e, k, chamber, stage.machine, length, overlap)
                if made is not None and made.first.size:
                    found.append(made)
    if not found:
        raise LogError(
            "no part of the logs says anything of the valve: there is no pressure drop left "
            "across it, or the pressure never settles",
            where=", ".join(e.name for e in stage.experiments),
            expected=f"Supply {stage.machine.supply:g} Pa, tank {stage.machine.tank:g} Pa.",
            remedy="Check --supply-pressure, --tank-pressure and the unit of the pressures; give "
            "the dead volumes to use transients as well.",
        )
    return found
