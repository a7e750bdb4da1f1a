"""``cylinder-friction`` of a shaft: the numbers of a piston, in N m and rad/s."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.check import check_logs
from fluidact_fit.errors import UsageError
from fluidact_fit.excitation import design

LINEAR = {"force": "N", "velocity": "m/s", "position": "m"}
ROTARY = {"torque": "N m", "angular_velocity": "rad/s", "angle": "rad"}
VISCOUS = "N m s/rad"
UNITS = {"viscous": VISCOUS, "coulomb_positive": "N m", "coulomb_negative": "N m"}


def write(path: Path, motion: int, roles: dict[str, str], fast: float = 2.0) -> Path:
    """Strokes at two speeds; ``motion`` is 1 for the speed and 2 for the place."""
    rng, step = np.random.default_rng(3), 0.01
    speeds = [1.0, -1.0, fast, -fast]
    v = np.repeat([s for pair in speeds for s in (pair, 0.0)], [150, 30] * len(speeds))
    v = np.convolve(v, np.ones(15) / 15, "same")
    force = 40.0 * v + np.where(v > 0.0, 8.0, -6.0) * (v != 0.0) + rng.normal(0.0, 0.1, v.size)
    place = step * (np.cumsum(v) - 0.5 * v)
    names = list(roles)
    columns = (step * np.arange(v.size), force, (v, place)[motion - 1])
    header = ",".join(["time [s]", *(f"{names[k]} [{roles[names[k]]}]" for k in (0, motion))])
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    return path


@pytest.mark.parametrize("motion", [1, 2])
def test_a_shaft_has_the_numbers_of_a_piston(motion: int, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"offset": "none"}
    linear = ff.fit("cylinder-friction", write(tmp_path / "l.csv", motion, LINEAR), mass=0.5,
                    **settings)  # fmt: skip
    rotary = ff.fit("cylinder-friction", write(tmp_path / "r.csv", motion, ROTARY), inertia=0.5,
                    **settings)  # fmt: skip
    for name, found in linear.parameters.items():
        shaft = rotary.parameters[name]
        assert shaft.value == found.value
        assert shaft.std_error == found.std_error
        assert shaft.unit == UNITS[name]
    rotary.save(tmp_path / "shaft.yaml")
    block: Any = ff.load(tmp_path / "shaft.yaml")
    values = rotary.parameters
    assert float(block(1.5)) == pytest.approx(
        values["coulomb_positive"].number + 1.5 * values["viscous"].number
    )
    friction = rotary.document.model["friction"]
    assert friction["input"] == {"name": "angular_velocity", "unit": "rad/s"}
    assert friction["output"] == {"name": "torque", "unit": "N m"}
    assert check_logs(rotary.document, [ff.read_log(tmp_path / "r.csv")]).fits


@pytest.mark.parametrize("motion", [1, 2])
def test_messages_are_in_the_units_of_a_shaft(motion: int, tmp_path: Path) -> None:
    found = ff.fit("cylinder-friction", write(tmp_path / "r.csv", motion, ROTARY, fast=1.05))
    text = " ".join(w.message for w in found.document.warnings)
    assert "rad/s" in text
    assert not re.search(r" m/s| N\b(?! m)|force|load cell|piston", text)
    assert found.document.parameters["viscous"].status == "not_identified"


@pytest.mark.parametrize(
    ("roles", "option"),
    [(ROTARY, {"mass": 1.0}), (ROTARY, {"area": 1e-3}), (LINEAR, {"inertia": 1.0})],
)
def test_options_of_the_other_kind_are_refused(
    roles: dict[str, str], option: dict[str, float], tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="does not apply"):
        ff.fit("cylinder-friction", write(tmp_path / "a.csv", 1, roles), **option)


@pytest.mark.parametrize("motion", [1, 2])
def test_the_next_experiment_of_a_shaft_is_in_its_units(motion: int, tmp_path: Path) -> None:
    found = ff.fit("cylinder-friction", write(tmp_path / "r.csv", motion, ROTARY))
    plan = design(found.document, duration=10.0, sample_time=0.01)
    assert plan.units == {"angular_velocity": "rad/s", "angle": "rad"}
    assert " rad/s (" in " ".join(plan.notes)


def test_percent_of_a_rated_torque(tmp_path: Path) -> None:
    path = write(tmp_path / "r.csv", 1, ROTARY)
    text = path.read_text("utf-8")
    path.with_name("p.csv").write_text(
        text.replace("torque [N m]", "torque [% of 10 N m]").replace("[rad/s]", "[rpm]"), "utf-8"
    )
    plain = ff.fit("cylinder-friction", path)
    rated = ff.fit("cylinder-friction", tmp_path / "p.csv")
    factor = 0.1 * plain.parameters["coulomb_positive"].number
    assert rated.parameters["coulomb_positive"].number == pytest.approx(factor, rel=1e-9)
    scaled = ff.read_log(tmp_path / "p.csv", units={"torque": "N m"}, scales={"torque": 0.1})
    same = ff.fit("cylinder-friction", scaled)
    assert same.parameters["viscous"].number == pytest.approx(
        rated.parameters["viscous"].number, rel=1e-9
    )
    assert same.document.warnings == rated.document.warnings
