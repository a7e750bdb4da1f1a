"""Options of the ball screw, and what its fit settles among them."""

from __future__ import annotations

from dataclasses import dataclass

from ...options import FamilyOptions, choice, settled


@dataclass(frozen=True)
class BallScrewOptions(FamilyOptions):
    """Symmetry of the friction, and what the fit compares."""

    viscous: str = choice(
        "symmetric", ("symmetric", "asymmetric"), "one viscous value, or one per direction"
    )
    # The score test of a missing response does not offer it (``frees``): near zero the motion is
    # not linear in the speed of the curve. The warning of forces beyond the model names it.
    stribeck: str = choice(
        "none", ("none", "estimate"), "whether to estimate how friction rises at low speed"
    )
    compared: str | None = settled(
        "choice", "whether speed and acceleration were compared beside the position",
        choices=("position", "derivatives"),
    )  # fmt: skip
