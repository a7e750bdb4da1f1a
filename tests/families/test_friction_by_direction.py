"""Viscous friction by direction: recovered, told apart from one value, refused where not seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fluidact_fit as ff
from fluidact_fit.errors import UsageError
from fluidact_fit.families.cylinder_friction.block import FrictionBlock

Array = NDArray[np.float64]
TRUTH = {
    "viscous_positive": 60.0, "viscous_negative": 35.0,
    "coulomb_positive": 2.4, "coulomb_negative": 2.9,
}  # fmt: skip
DATASET = Path(__file__).parents[2] / "datasets" / "cylinder-friction"
# of the fit of the README before viscous friction could differ by direction
BEFORE = {
    "viscous": (45.006585, 0.024887),
    "coulomb_positive": (2.3957615, 0.0036191),
    "coulomb_negative": (2.3940814, 0.0036172),
}
SIGMA = 0.1  # N


def friction(v: Array, rise: float = 0.0, **law: float) -> Array:
    """Law written out, shape of ``v`` [N]."""
    t = {**TRUTH, **law}
    low = rise * np.exp(-((v / 0.02) ** 2))
    forward = t["coulomb_positive"] + low + t["viscous_positive"] * v
    backward = -t["coulomb_negative"] - low + t["viscous_negative"] * v
    return np.where(v > 0.0, forward, np.where(v < 0.0, backward, 0.0))


def by_hand(seed: int, pace: float = 1.0, **law: float) -> dict[str, Array]:
    """Ten seconds of three sines at 100 Hz with noise of the force [SI]."""
    rng = np.random.default_rng([42, seed])
    time = 0.01 * np.arange(1000)
    omega = 2.0 * np.pi * pace * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    share = 0.016 * np.array([1.0, 0.5, 0.25])
    angle = np.outer(time, omega) + rng.uniform(0.0, 2.0 * np.pi, 3)
    v = np.cos(angle) @ (share * omega)
    force = friction(v, **law) + SIGMA * rng.standard_normal(v.size)
    position = np.sin(angle) @ share + 1e-5 * rng.standard_normal(v.size)
    velocity = v + 1e-3 * rng.standard_normal(v.size)
    return {"time": time, "velocity": velocity, "position": position, "force": force}


def write(path: Path, columns: dict[str, Array], *names: str) -> Path:
    units = {"time": "s", "velocity": "m/s", "position": "m", "force": "N"}
    header = ",".join(f"{n} [{units[n]}]" for n in names)
    rows = np.column_stack([columns[n] for n in names])
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def hand_log(folder: Path, seed: int = 0, role: str = "velocity", **law: float) -> Path:
    return write(folder / f"{role}{seed}.csv", by_hand(seed, **law), "time", role, "force")


def steady_logs(folder: Path, speeds: list[float], **law: float) -> list[Path]:
    """One constant speed a log."""
    rng, out = np.random.default_rng(5), []
    for k, speed in enumerate(speeds):
        v = np.full(400, speed)
        columns = {
            "time": 0.01 * np.arange(v.size),
            "velocity": v + 1e-4 * rng.standard_normal(v.size),
            "force": friction(v, **law) + SIGMA * rng.standard_normal(v.size),
        }
        out.append(write(folder / f"speed{k}.csv", columns, "time", "velocity", "force"))
    return out


def deviations(found: Any, truth: dict[str, float] = TRUTH) -> dict[str, float]:
    """Errors in standard errors."""
    p = found.parameters
    return {n: (p[n].number - t) / float(p[n].std_error) for n, t in truth.items()}


def fit(logs: list[Path], viscous: str = "asymmetric", **options: Any) -> Any:
    return ff.fit("cylinder-friction", logs, viscous=viscous, **options)


@pytest.mark.parametrize("role", ["velocity", "position"])
def test_both_sides_are_recovered_within_their_errors(tmp_path: Path, role: str) -> None:
    found = fit([hand_log(tmp_path, role=role)])
    assert set(found.parameters) == set(TRUTH)
    assert all(q.status == "estimated" for q in found.parameters.values())
    assert all(abs(z) < 4.0 for z in deviations(found).values())
    assert {n.code for n in found.notices} == {"asymmetry-or-offset"}  # the levels do differ


@pytest.mark.parametrize("runs", [15, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize("role", ["velocity", "position"])
def test_intervals_hold_as_often_as_they_say(tmp_path: Path, role: str, runs: int) -> None:
    found = [deviations(fit([hand_log(tmp_path, s, role)])) for s in range(runs)]
    z = np.array([[one[n] for n in TRUTH] for one in found])
    assert np.abs(z.mean(axis=0)).max() < 4.0 / np.sqrt(runs)
    hits = (np.abs(z) < 1.97).mean(axis=0)
    assert hits.min() > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / runs), hits


def test_fast_reversals_of_a_position_are_told_apart(tmp_path: Path) -> None:
    z = []
    for seed in range(12):
        path = write(tmp_path / f"{seed}.csv", by_hand(seed, pace=2.2), "time", "position", "force")
        z.append(list(deviations(fit([path])).values()))
    assert np.abs(np.mean(z, axis=0)).max() < 4.0 / np.sqrt(12)


def test_symmetric_fit_of_the_dataset_is_what_it_was() -> None:
    columns = {"force": "F [N]", "velocity": "v [mm/s]"}
    logs = [ff.read_log(DATASET / f"trial{i}.csv", columns=columns) for i in (1, 2, 3)]
    default = ff.fit("cylinder-friction", logs, mass=0.14)
    asked = ff.fit("cylinder-friction", logs, mass=0.14, viscous="symmetric")
    for found in (default, asked):
        assert set(found.parameters) == set(BEFORE)
        for name, (value, error) in BEFORE.items():
            q = found.parameters[name]
            assert [q.number, q.std_error] == pytest.approx([value, error], rel=1e-9)
    both = ff.fit("cylinder-friction", logs, mass=0.14, viscous="asymmetric")
    truth = {"viscous_positive": 45.0, "viscous_negative": 45.0}
    assert all(abs(z) < 4.0 for z in deviations(both, truth).values())


def test_a_symmetric_fit_of_an_asymmetric_plant_is_told_the_option(tmp_path: Path) -> None:
    found = fit([hand_log(tmp_path)], "symmetric")
    said = next(n for n in found.notices if n.code == "unmodelled-response")
    assert "--viscous=asymmetric" in said.message
    by = float(said.message.split("viscous_positive is ")[1].split()[0])
    assert by == pytest.approx(25.0, abs=1.0)
    same = hand_log(tmp_path, 1, viscous_negative=60.0)
    assert "unmodelled-response" not in {n.code for n in fit([same], "symmetric").notices}


@pytest.mark.parametrize("offset", ["auto", "free"])
def test_with_an_offset_of_the_force(tmp_path: Path, offset: str) -> None:
    columns = by_hand(3, coulomb_negative=2.4)
    columns["force"] += 6.0  # more than the levels: one would be negative
    found = fit([write(tmp_path / "log.csv", columns, "time", "velocity", "force")], offset=offset)
    assert all(abs(z) < 4.0 for z in deviations(found, {**TRUTH, "coulomb_negative": 2.4}).values())
    assert "force-offset" in {n.code for n in found.notices}


def test_with_friction_that_rises_towards_rest(tmp_path: Path) -> None:
    found = fit([hand_log(tmp_path, rise=1.2)], stribeck="estimate")
    truth = {**TRUTH, "stribeck": 1.2, "stribeck_speed": 0.02}
    assert all(abs(z) < 4.0 for z in deviations(found, truth).values())


def test_file_and_block_give_the_law(tmp_path: Path) -> None:
    result = fit([hand_log(tmp_path)])
    path = result.save(tmp_path / "friction.yaml")
    block = ff.load(path)
    assert isinstance(block, FrictionBlock)
    numbers = {n: q.number for n, q in result.parameters.items()}
    v = np.array([-0.1, 0.0, 0.1])
    np.testing.assert_allclose(block(v), friction(v, **numbers))
    friction_map = result.document.model["friction"]
    assert friction_map["viscous_negative"] == numbers["viscous_negative"]
    assert "viscous_positive*v" in friction_map["equation"]
    file = path.read_text().replace("viscous: asymmetric", "viscous: lopsided")
    (tmp_path / "wrong.yaml").write_text(file)
    with pytest.raises(ff.FluidactError, match="viscous"):
        ff.load(tmp_path / "wrong.yaml")


def test_what_does_not_go_together_is_refused(tmp_path: Path) -> None:
    log = hand_log(tmp_path)
    with pytest.raises(UsageError, match="viscous"):
        fit([log], "both")
    with pytest.raises(UsageError, match="viscous_positive"):
        fit([log], "symmetric", fixed={"viscous_positive": 60.0})
    with pytest.raises(UsageError, match="viscous"):
        fit([log], fixed={"viscous": 60.0})
    found = fit([log], fixed={"viscous_positive": 60.0})
    assert found.parameters["viscous_positive"].status == "fixed"
    assert abs(deviations(found, {"viscous_negative": 35.0})["viscous_negative"]) < 4.0


def test_a_direction_that_was_not_recorded_is_not_identified(tmp_path: Path) -> None:
    found = fit(steady_logs(tmp_path, [0.02, 0.05, 0.1]))
    status = {n: q.status for n, q in found.parameters.items()}
    assert status == {
        "viscous_positive": "estimated", "coulomb_positive": "estimated",
        "viscous_negative": "not_identified", "coulomb_negative": "not_identified",
    }  # fmt: skip
    seen = {n: t for n, t in TRUTH.items() if n.endswith("positive")}
    assert all(abs(z) < 4.0 for z in deviations(found, seen).values())
    said = next(n.message for n in found.notices if n.message.startswith("viscous_negative"))
    assert "nothing moves in the negative direction" in said
    assert "in the negative direction" in said.split("not_identified.")[1]


def test_a_direction_with_one_speed_is_not_identified(tmp_path: Path) -> None:
    found = fit(steady_logs(tmp_path, [0.02, 0.05, 0.1, -0.05]))
    assert found.parameters["viscous_positive"].status == "estimated"
    assert found.parameters["viscous_negative"].status == "not_identified"
    level = found.parameters["coulomb_negative"].number
    assert level == pytest.approx(2.9 + 0.05 * 35.0, abs=0.05)
    said = next(n.message for n in found.notices if n.message.startswith("viscous_negative"))
    assert "0.075 m/s or faster" in said
    assert "positive direction" not in said.split("not_identified.")[1]
    assert "asymmetry-or-offset" not in {n.code for n in found.notices}
