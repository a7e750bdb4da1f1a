"""Options of the potentiometer."""

from __future__ import annotations

from dataclasses import dataclass

from ...family import FamilyOptions
from ...options import choice, flag, interval, settled, text


def _check_degree(given: str) -> str:
    word = given.lower()
    if word == "auto" or (word.isdecimal() and 1 <= int(word) <= 8):
        return word
    raise ValueError("no such degree")


@dataclass(frozen=True)
class PotentiometerOptions(FamilyOptions):
    """Options of the curve: chosen by the user, and settled by the fit.

    Once ``clipped`` is settled no rails are looked for: ``rails`` are those to go by, with the
    margin beside a rail that clips a noisy reading.
    """

    degree: str = text(
        "auto", help="degree of the curve, 1 to 8, or auto for cross-validation",
        check=_check_degree, form="auto, or a whole number from 1 to 8",
    )  # fmt: skip
    endpoints: str = choice(
        "free", ("free", "fixed"), "free, or fixed at the mean reference of the end readings"
    )
    branches: str = choice(
        "pooled", ("pooled", "two"), "one curve for both directions of motion, or one for each"
    )
    monotone: bool | None = flag(
        help="keep the curve from turning back (default: unless the data say that it does)"
    )
    rails: tuple[float, float] | None = interval(
        help="readings at or beyond these are clipped and left out"
    )
    clipped: bool | None = settled("flag", "whether samples were left out for a clipped reading")
    dead_band: float | None = settled(
        "float", "change of the reading over which the branches change over", minimum=0.0
    )

    @property
    def degree_wanted(self) -> int:
        """Degree as a number; 0 for ``auto``."""
        return 0 if self.degree == "auto" else int(self.degree)
