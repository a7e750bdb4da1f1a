"""Options of the family, those that the fit settles, and checks of options against the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from ...errors import NotIdentifiedError, UsageError
from ...estimation.stribeck import stribeck_choice
from ...experiment import Experiment
from ...options import FamilyOptions, choice, number, settled
from ...specification import Variant
from .axis import ROTARY, axis_of

SIDES = ("positive", "negative")
ONE_SIDED = ("viscous_positive", "viscous_negative")


@dataclass(frozen=True)
class FrictionOptions(FamilyOptions):
    """Options about the cylinder, and about the samples of a log that are described."""

    area: float | None = number(help="piston area that the pressure acts on", unit="m2", above=0)
    area_2: float | None = number(help="area that pressure_2 acts on", unit="m2", minimum=0)
    pressures: str = choice(
        "resist",
        ("resist", "drive"),
        "beside a measured force: whether that moves the piston against the pressures, or they "
        "move it against the force of a load",
    )
    mass: float | None = number(help="moving mass, to subtract inertia", unit="kg", minimum=0)
    inertia: float | None = number(
        help="moment of inertia of what turns, to subtract it", unit="kg m2", minimum=0
    )
    filter: float | None = number(
        help="half-width of the zero-phase velocity filter (default: from the noise)", unit="s",
        minimum=0,
    )  # fmt: skip
    deadband: float | None = number(
        help="samples slower than this are left out (default: from noise and speed)",
        unit="m/s or rad/s", minimum=0,
    )  # fmt: skip
    offset: str = choice(
        "auto",
        ("auto", "none", "free"),
        "constant offset of what drives: estimated where the levels need one, never, or always",
    )
    stribeck: str = stribeck_choice()
    viscous: str = choice(
        "symmetric",
        ("symmetric", "asymmetric"),
        "one viscous value, or one per direction",
        "viscous_positive",
    )
    force_offset: bool | None = settled(
        "flag", "whether every log has a force offset, about which the levels are equal"
    )
    acceleration_limit: float | None = settled(
        "float", "acceleration above which an unknown mass would show", unit="m/s2 or rad/s2"
    )
    turn_limit: float | None = settled(
        "float", "second difference of the velocity above which it turns between readings",
        unit="m/s or rad/s",
    )  # fmt: skip

    @property
    def rates(self) -> tuple[str, ...]:
        """Names of the viscous coefficients: one for both directions, or one for each."""
        return ONE_SIDED if self.viscous == "asymmetric" else ("viscous",)

    @property
    def moved(self) -> float | None:
        """Accelerated mass [kg] or moment of inertia [kg m2]."""
        return self.inertia if self.mass is None else self.mass

    @property
    def unpressed(self) -> Self:
        """The options without pressures, on which the information of a motion does not depend."""
        return replace(self, area=None, area_2=None, pressures="resist")

    @property
    def is_settled(self) -> bool:
        """Return whether a fit has settled everything: nothing is left to choose."""
        return self.force_offset is not None


def check_options(
    variant: Variant, experiments: Sequence[Experiment], options: FrictionOptions
) -> None:
    """Reject options that do not fit the logs; the output may be missing from them.

    Raises
    ------
    UsageError, NotIdentifiedError
        Naming the option, and what to give instead.
    """
    axis = axis_of(variant)
    foreign = ("mass", "area", "area_2") if axis is ROTARY else ("inertia",)
    for name in (n for n in foreign if getattr(options, n) is not None):
        raise UsageError(
            f"--{name.replace('_', '-')} does not apply to the {axis.drive} of a {axis.body}",
            remedy=f"Leave it out; what moves is given as --{axis.inertia} [{axis.inertia_unit}].",
        )
    _check_chambers(variant, experiments, options)
    untimed = [e.name for e in experiments if not e.time.size]
    for name in (n for n in ("mass", "inertia", "filter") if getattr(options, n) is not None):
        if untimed and not options.is_settled:
            raise UsageError(
                f"--{name} needs time, and {untimed[0]} has none",
                remedy="Give --column time=HEADER or --sample-time SECONDS, "
                f"or leave --{name} out.",
            )


def _check_chambers(
    variant: Variant, experiments: Sequence[Experiment], options: FrictionOptions
) -> None:
    """Reject pressures without their areas, and areas without their pressures.

    Where the pressures drive, that of the first chamber is the output.
    """
    driven = variant.output.name == "pressure"
    beside = not driven and any("pressure" in e for e in experiments)
    if options.pressures == "drive" and not (beside or options.is_settled):
        raise UsageError(
            "--pressures=drive is about logs of a force and of what the pressures do beside it.",
            remedy="Give --column force=HEADER and --column pressure=HEADER, or leave it out.",
        )
    chambers, bare = (("pressure", "area"), ("pressure_2", "area_2")), list[tuple[str, str]]()
    for role, name in chambers:
        option, area = f"--{name.replace('_', '-')}", getattr(options, name)
        without = [e.name for e in experiments if role not in e]
        if driven and without and role == "pressure_2":
            raise NotIdentifiedError(
                "there is no force, and the pressure of one chamber only: friction is the "
                "difference of both chambers' forces",
                where=without[0],
                expected="Nothing was written.",
                remedy="Give the other pressure as --column pressure_2=HEADER with --area-2=M2. If "
                "it was recorded in a repeat of the same command, put both columns into one log, "
                "or give its mean before and after a reversal at T seconds: --step "
                "pressure_2=FROM:TO@T (Pa). For a chamber open to the air and gauge pressures: "
                "--step pressure_2=0:0.",
            )
        if area is None and len(without) < len(experiments):
            bare.append((f"'{role}'", f"{option}=M2"))
        if area is not None and without and role != variant.output.name:
            raise UsageError(
                f"{option} was given, but {without[0]} has no {role}",
                remedy=f"Give --column {role}=HEADER (or --input {role}=FROM:TO@T, to simulate), "
                f"or leave {option} out of the fit.",
            )
    if bare:
        roles, missing = zip(*bare)
        raise UsageError(
            f"{' and '.join(roles)} {'were' if roles[1:] else 'was'} given without a piston area",
            remedy=f"Give {' '.join(missing)} (bore 25 mm: --area=4.9087e-4; less the rod on its "
            "side)" + ("." if driven else ", and --pressures=drive if it moves the piston against "
            "the measured force; or leave it out if it is all that moves the piston."),
        )  # fmt: skip
