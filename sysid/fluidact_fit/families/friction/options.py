"""Options of the family, and which of them do not fit the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import NotIdentifiedError, UsageError
from ...experiment import Experiment
from ...family import Variant

PRESSURES = "-pressures"  # variants without a load cell


@dataclass(frozen=True)
class Options:
    """The family's options."""

    area: float | None
    area_2: float | None
    mass: float | None
    half_width: float | None
    deadband: float | None
    offset: str

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> Options:
        """The options as given."""
        return cls(
            given.get("area"),
            given.get("area-2"),
            given.get("mass"),
            given.get("filter"),
            given.get("deadband"),
            given.get("offset") or "auto",
        )


def motion_role(variant: Variant) -> str:
    """Name of the role that a variant takes the motion from."""
    return variant.name.removesuffix(PRESSURES)


def check_options(variant: Variant, experiments: Sequence[Experiment], options: Options) -> None:
    """Reject options that do not fit the logs."""
    driven = variant.name.endswith(PRESSURES)
    if driven:
        _check_chambers(experiments)
    for role, area, name, example in (
        ("pressure", options.area, "area", " (bore 25 mm: --area 4.9087e-4)"),
        ("pressure_2", options.area_2, "area-2", " (bore less rod)"),
    ):
        without = [e.name for e in experiments if role not in e]
        if area is None and len(without) < len(experiments):
            raise UsageError(
                f"there is a {role}, but no area to turn it into a force",
                remedy=f"Give --{name} M2{example}"
                + (
                    "."
                    if driven
                    else ", or leave the pressure out if the force is that of the piston rod alone."
                ),
            )
        if area is not None and without:
            raise UsageError(
                f"--{name} was given, but {without[0]} has no {role}",
                remedy=f"Give --column {role}=HEADER, or leave --{name} out.",
            )
    if driven and not options.area:
        raise UsageError("--area is zero", remedy="Give the piston area in m2.")
    untimed = [e.name for e in experiments if not e.time.size]
    for name, value in (("mass", options.mass), ("filter", options.half_width)):
        if value is not None and untimed:
            raise UsageError(
                f"--{name} needs time, and {untimed[0]} has none",
                remedy=f"Give --column time=HEADER or --sample-time S, or leave --{name} out.",
            )


def _check_chambers(experiments: Sequence[Experiment]) -> None:
    """Without a load cell, the pressures of both chambers have to be known.

    Raises
    ------
    NotIdentifiedError
        When the second one is missing.
    """
    for e in experiments:
        if "pressure_2" in e:
            continue
        raise NotIdentifiedError(
            "there is no force, and the pressure of one chamber only: friction is the difference "
            "of both chambers' forces",
            where=e.name,
            expected="Nothing was written.",
            remedy="Give the other chamber's as --column pressure_2=HEADER with --area-2 M2. If it "
            "was recorded in a repeat of the same command, put both columns into one log, or give "
            "its mean before and after a reversal at T seconds: --step pressure_2=FROM:TO@T (Pa). "
            "A chamber open to the air, gauge pressures: --step pressure_2=0:0.",
        )
