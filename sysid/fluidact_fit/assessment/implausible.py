"""Numbers that no actuator has: given in another unit than SI, or with the other sign.

A value is judged by its unit alone. An implausible one is named at the start of a refusal, or in a
warning where the fit went through.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..errors import Notice
from ..experiment import Experiment
from ..family import Family, FamilyOptions, Variant
from ..options import describe
from . import policy
from .refusal_causes import Cause

# By SI unit: the largest value of a given number, and units in which people have it at hand.
_GIVEN = {
    "m2": (policy.LARGEST_AREA, (("cm2", 1e-4), ("mm2", 1e-6))),
    "m3": (policy.LARGEST_VOLUME, (("l", 1e-3), ("cm3", 1e-6), ("mm3", 1e-9))),
}
_MEASURED = {
    "m": (policy.LONGEST_WAY, "mm"),
    "m/s": (policy.FASTEST, "mm/s"),
}


def find_implausible(
    family: Family[FamilyOptions],
    options: FamilyOptions,
    variant: Variant,
    runs: Sequence[Experiment],
) -> list[Cause]:
    """Find given numbers and columns that are out of all proportion, each with its remedy."""
    return [*_given(family, options), *_measured(variant, runs), *_pressures(variant, runs)]


def implausible_notices(causes: Sequence[Cause]) -> list[Notice]:
    """Turn them into warnings of a fit that went through."""
    return [Notice("implausible-number", f"{c.words.removesuffix(', and')}. {c.remedy}")
            for c in causes]  # fmt: skip


def _given(family: Family[FamilyOptions], options: FamilyOptions) -> Iterator[Cause]:
    """Yield options whose number is out of all proportion in SI."""
    for option in describe(family.options_type):
        value = getattr(options, option.keyword)
        if option.unit == "Pa" and value is not None and 0.0 < value < policy.LEAST_GIVEN:
            yield Cause(
                f"--{option.name} {value:g} is in Pa, too little to move anything: it seems "
                "to be in another unit, and",
                f"Give it in Pa: {value:g} bar are {f'{value * 1e5:g}'.replace('e+0', 'e')} Pa.",
            )
        if option.kind != "float" or option.unit not in _GIVEN or value is None:
            continue
        most, units = _GIVEN[option.unit]
        if value > most:
            meant = (f"--{option.name} {value * size:.6g} for {value:g} {unit}"
                     for unit, size in units if value * size <= most)  # fmt: skip
            yield Cause(
                f"--{option.name} {value:g} is in {option.unit}, larger than any actuator has: it "
                "seems to be in another unit, and",
                f"Give it in {option.unit}: {', or '.join(meant)}.",
            )


def _measured(variant: Variant, runs: Sequence[Experiment]) -> Iterator[Cause]:
    """Yield columns taken as metres, or metres per second, that cannot be in that unit."""
    for role in variant.roles:
        signals = [e.signals[role.name] for e in runs if role.name in e]
        known = [s for s in signals if s.unit in _MEASURED and s.logged_in in (None, (s.unit, 1.0))]
        if not known:
            continue
        most, unit = _MEASURED[known[0].unit]
        span = max(float(np.ptp(s.values)) for s in known)
        if span > most:
            yield Cause(
                f"'{role.name}' covers {span:.3g} {known[0].unit}, more than any actuator does: it "
                f"seems to be in another unit, such as {unit}, and",
                f"Give --unit {role.name}={unit}, or the unit that it is in.",
            )


def _pressures(variant: Variant, runs: Sequence[Experiment]) -> Iterator[Cause]:
    """Yield chamber pressures taken as pascals that cannot be, or that lie below vacuum."""
    for role in variant.roles:
        signals = [e.signals[role.name] for e in runs if role.name in e]
        known = [s for s in signals if s.unit == "Pa"]
        if not known or not role.gauge:
            continue
        low = min(float(s.values.min()) for s in known)
        most = max(-low, *(float(s.values.max()) for s in known))
        if low < -policy.VACUUM:
            yield Cause(
                f"'{role.name}' falls to {known[0].text(low)}, which is below vacuum: it seems to "
                "have the other sign, and",
                f"If so, give --scale {role.name}=-1; else check its column, unit and zero.",
            )
        elif 0.0 < most < policy.LEAST_PRESSURE and known[0].logged_in in (None, ("Pa", 1.0)):
            yield Cause(
                f"'{role.name}' reaches {most:.3g} Pa only, as no chamber does that moves "
                "anything: it seems to be in another unit, such as bar, and",
                f"Give --unit {role.name}=bar, or the unit that it is in.",
            )
