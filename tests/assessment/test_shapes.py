"""Play, hysteresis and bowed characteristics, which no parameter stands for, are named."""

from __future__ import annotations

import numpy as np
import pytest
from studies.red_team.attack import Attack
from studies.red_team.attacks import hydraulic_motor, line, spring_cylinder

import fluidact_fit as ff


def find(module: object, group: str, name: str) -> Attack:
    (found,) = (a for a in module.attacks() if (a.group, a.name) == (group, name))  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize(
    ("module", "group", "name", "words"),
    [
        # dead time 10 % off at 9 standard errors, PASS
        (line, "hysteresis of the outlet", "0.5 % of its range", "'outlet' shows"),
        # viscous friction 50 % off at 11
        (spring_cylinder, "recording", "play of the position", "'position' shows"),
        # preload 20 % off at 10
        (spring_cylinder, "recording", "curved valve", "'command' is a curve"),
        # dead zone 29 % off at 12 standard errors
        (hydraulic_motor, "valve of another shape", "opens softly", "'command' acts by and by"),
        # gain 16 % off at 19
        (hydraulic_motor, "valve of another shape", "saturates by and by", "'command' acts as"),
        # dead zone 5 % off at 12
        (
            hydraulic_motor,
            "valve of another shape",
            "dead zone 10 % wider one way",
            "'command' acts as",
        ),
    ],
)
def test_a_channel_that_is_not_straight_is_named(
    module: object, group: str, name: str, words: str
) -> None:
    attack = find(module, group, name)
    (recording,) = attack.record(np.random.default_rng(31))
    found = ff.fit(attack.family, recording)
    said = [n.message for n in found.notices if n.code == "unmodelled-response"]
    assert len(said) == 1
    assert words in said[0]


@pytest.mark.parametrize(
    ("module", "group", "name"),
    [
        (line, "right model", "smooth"),
        (spring_cylinder, "right model", "command"),
        (hydraulic_motor, "right model", "stairs"),
    ],
)
def test_straight_channels_are_not(module: object, group: str, name: str) -> None:
    attack = find(module, group, name)
    for seed in range(6):
        (recording,) = attack.record(np.random.default_rng([31, seed]))
        assert ff.fit(attack.family, recording).verdict == "pass"
