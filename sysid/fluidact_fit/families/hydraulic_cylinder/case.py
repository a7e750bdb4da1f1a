"""What was given and what was recorded: machine, chambers, windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import LogError, UsageError
from ...experiment import Experiment
from ...family import Request, Variant
from .equations import Machine
from .options import HydraulicCylinderOptions
from .windows import Windows, make_windows, window_length


@dataclass(frozen=True)
class Case:
    """What a fit works on, as it came and as far as it was recorded.

    ``machine`` is without what the stage of the fit leaves aside, ``chambers`` are those whose
    pressure any log holds, ``window`` is the length of the windows [s].
    """

    variant: Variant
    experiments: Sequence[Experiment]
    request: Request[HydraulicCylinderOptions]
    machine: Machine
    chambers: tuple[int, ...]
    window: float

    @property
    def options(self) -> HydraulicCylinderOptions:
        """The options of the request."""
        return self.request.options

    @property
    def both(self) -> bool:
        """Whether every log holds both pressures."""
        return all("pressure_1" in e and "pressure_2" in e for e in self.experiments)

    @cached_property
    def windows(self) -> list[Windows]:
        """Windows of every recorded chamber of every log."""
        return self.cut()

    def cut(self, overlap: int = 1, shorter: float = 1.0) -> list[Windows]:
        """Cut the logs into windows so much ``shorter``, of which ``overlap`` begin within one.

        Raises
        ------
        LogError
            When none is left.
        """
        made = [
            make_windows(e, k, chamber, self.machine, self.window / shorter, overlap)
            for k, e in enumerate(self.experiments)
            for chamber in self.chambers
            if f"pressure_{chamber}" in e
        ]
        found = [w for w in made if w is not None and w.first.size]
        if not found:
            raise LogError(
                "no part of the logs says anything of the valve: there is no pressure drop left "
                "across it, or the pressure never settles",
                where=", ".join(e.name for e in self.experiments),
                expected=f"Supply {self.machine.supply:g} Pa, tank {self.machine.tank:g} Pa.",
                remedy="Check --supply-pressure, --tank-pressure and the unit of the pressures; "
                "give the dead volumes to use transients as well.",
            )
        return found

    def rest_position(self) -> float:
        """Mean position of the logs [m]."""
        return float(np.mean([np.mean(e["position"]) for e in self.experiments]))


def make_case(
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[HydraulicCylinderOptions],
) -> Case:
    """Put together what a fit begins with.

    Raises
    ------
    UsageError, LogError
        When something that the logs need is missing, or cannot be.
    """
    for e in experiments:
        if "pressure_1" not in e and "pressure_2" not in e:
            raise LogError(
                "neither chamber's pressure was recorded",
                where=e.name,
                expected="Expected pressure_1, pressure_2 or both.",
                remedy="Give --column pressure_1=... or --column pressure_2=...",
            )
    chambers = tuple(i for i in (1, 2) if any(f"pressure_{i}" in e for e in experiments))
    options = request.options
    machine = read_machine(options, chambers)
    check_volumes(machine, experiments)
    if options.stage == "plateaus":
        machine = machine.plain()
    window = options.window or window_length(experiments)
    return Case(variant, experiments, request, machine, chambers, window)


def read_machine(options: HydraulicCylinderOptions, chambers: Sequence[int]) -> Machine:
    """Read what is given.

    Raises
    ------
    UsageError
        When something that the recorded chambers need is missing, or cannot be.
    """
    o = options
    needed = {f"--area-{i}": getattr(o, f"area_{i}") for i in chambers}
    needed["--supply-pressure"] = o.supply_pressure
    missing = [n for n, value in needed.items() if value is None]
    if missing:
        raise UsageError(
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} needed",
            expected="Areas and supply pressure are properties of the machine that the logs "
            "cannot tell; nothing is assumed for them.",
            remedy="Give " + ", ".join(f"{m} NUMBER" for m in missing) + " in SI units (m2, Pa).",
        )
    supply = o.supply_pressure or 0.0
    if o.tank_pressure >= supply:
        raise UsageError(
            f"the tank pressure {o.tank_pressure:g} Pa is not below the supply pressure "
            f"{supply:g} Pa",
            remedy="Correct --tank-pressure or --supply-pressure (Pa).",
        )
    return Machine(
        o.area_1, o.area_2, o.dead_volume_1, o.dead_volume_2, o.mass, supply, o.tank_pressure
    )


def check_volumes(machine: Machine, experiments: Sequence[Experiment]) -> None:
    """Refuse dead volumes that would leave a chamber without oil.

    Raises
    ------
    UsageError
        With the position at which a volume is used up, and the least that it has to be.
    """
    for chamber, sign in ((1, 1.0), (2, -1.0)):
        dead = machine.dead_volume(chamber)
        if dead is None or getattr(machine, f"area_{chamber}") is None:
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
