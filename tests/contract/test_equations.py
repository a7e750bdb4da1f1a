"""Equations speak of the roles and parameters of the variant that they stand beside."""

from __future__ import annotations

import re

import pytest

from fluidact_fit.families import family_names, get_family
from fluidact_fit.specification import Variant

VARIANTS = [(name, v) for name in family_names() for v in get_family(name).variants]


@pytest.mark.parametrize(("family", "variant"), VARIANTS, ids=lambda x: getattr(x, "name", x))
def test_no_name_of_another_axis_stands_in_an_equation(family: str, variant: Variant) -> None:
    equation = variant.equation
    if not equation:
        return  # that of the family serves all of its variants
    own = {r.name for r in variant.roles} | {p.name for p in variant.parameters}
    rotary = bool(own & {"torque", "angle", "angular_velocity", "inertia"})
    words = set(re.findall(r"[a-z]+(?: velocity)?", equation))
    strange = {"mass", "position", "force", "velocity"} if rotary else {
        "inertia", "angle", "torque", "angular velocity"}  # fmt: skip
    assert not words & strange


def test_both_axes_of_a_drive_have_their_own() -> None:
    rotary, linear = get_family("ball-screw").variants
    assert rotary.equation.startswith("inertia * angle'' = torque")
    assert linear.equation.startswith("mass * position'' = force")
