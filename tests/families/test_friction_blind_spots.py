"""What a friction fit cannot see by itself: it has to say so, or to see it after all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from studies.red_team.attacks import cylinder_friction

import fluidact_fit as ff
from fluidact_fit.mechanics.friction_law import FrictionLaw

Array = NDArray[np.float64]
LAW = {"viscous": 45.0, "coulomb_positive": 2.4, "coulomb_negative": 2.4}
STEP = 0.01


def by_hand(seed: int, n: int = 1000, step: float = STEP) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration of three sines [SI]."""
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    share = 0.016 * np.array([1.0, 0.5, 0.25])
    angle = np.outer(step * np.arange(n), omega) + rng.uniform(0.0, 2.0 * np.pi, 3)
    return (
        np.sin(angle) @ share,
        np.cos(angle) @ (share * omega),
        -np.sin(angle) @ (share * omega**2),
    )


def friction(v: Array, rise: float = 0.0, speed: float = 0.02) -> Array:
    low = rise * np.exp(-((v / speed) ** 2))
    level = np.where(v > 0.0, LAW["coulomb_positive"] + low, -LAW["coulomb_negative"] - low)
    return level + LAW["viscous"] * v


def write(path: Path, role: str, motion: Array, force: Array, step: float = STEP) -> Path:
    unit = "m/s" if role == "velocity" else "m"
    rows = np.column_stack((step * np.arange(force.size), motion, force))
    header = f"time [s],{role} [{unit}],force [N]"
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=header, comments="")
    return path


def moved_by_hand(folder: Path, seed: int = 0, offset: float = 0.0, **law: float) -> Path:
    rng = np.random.default_rng([7, seed])
    _, v, _ = by_hand(seed)
    force = friction(v, **law) + offset + 0.1 * rng.standard_normal(v.size)
    return write(folder / f"hand{seed}.csv", "velocity", v + 1e-3 * rng.standard_normal(v.size),
                 force)  # fmt: skip


def at_constant_speeds(
    folder: Path, speeds: list[float], converter: float = 0.0, sigma: float = 0.1, **law: float
) -> list[Path]:
    rng, out = np.random.default_rng(3), []
    for k, speed in enumerate(speeds):
        v = np.full(400, speed)
        force = friction(v, **law) + sigma * rng.standard_normal(v.size)
        force = converter * np.round(force / converter) if converter else force
        measured = v + 1e-3 * rng.standard_normal(v.size)
        out.append(write(folder / f"speed{k}.csv", "velocity", measured, force))
    return out


def codes(found: Any) -> set[str]:
    return {n.code for n in found.notices}


def holds(found: Any, truth: dict[str, float]) -> bool:
    within = [found.parameters[n].ci95 for n in truth]
    return all(low <= truth[n] <= high for n, (low, high) in zip(truth, within))


def test_one_constant_speed_a_log_is_the_textbook_protocol(tmp_path: Path) -> None:
    logs = at_constant_speeds(tmp_path, [0.03, 0.1, -0.03, -0.1])
    found = ff.fit("cylinder-friction", logs)
    assert found.verdict == "pass"
    assert holds(found, LAW)
    assert found.document.fit.fit_percent > 90.0


def test_a_converter_that_shows_one_reading_a_log_widens_the_intervals(tmp_path: Path) -> None:
    logs = at_constant_speeds(tmp_path, [0.03, 0.1, -0.03, -0.1], converter=0.5, sigma=0.01)
    assert holds(ff.fit("cylinder-friction", logs), LAW)


def test_friction_that_rises_at_low_speed_is_found_and_estimated(tmp_path: Path) -> None:
    log = moved_by_hand(tmp_path, rise=1.2)
    without = ff.fit("cylinder-friction", [log])
    said = next(n for n in without.notices if n.code == "unmodelled-response")
    assert "--stribeck=estimate" in said.message
    found = ff.fit("cylinder-friction", [log], stribeck="estimate")
    truth = {**LAW, "stribeck": 1.2, "stribeck_speed": 0.02}
    assert found.verdict == "pass"
    for name, value in truth.items():
        q = found.parameters[name]
        assert abs(float(q.value) - value) < 4.0 * float(q.std_error)
    v = np.array([-0.05, 0.01, 0.1])
    law = FrictionLaw.of({n: float(q.value) for n, q in found.parameters.items()})
    np.testing.assert_allclose(law.moving(v), friction(v, rise=1.2), rtol=0.03)


def test_constant_speeds_show_the_rise_as_well(tmp_path: Path) -> None:
    speeds = [s * v for v in (0.005, 0.01, 0.02, 0.04, 0.08, 0.15) for s in (1.0, -1.0)]
    logs = at_constant_speeds(tmp_path, speeds, rise=1.2)
    assert "unmodelled-response" in codes(ff.fit("cylinder-friction", logs))
    found = ff.fit("cylinder-friction", logs, stribeck="estimate")
    assert float(found.parameters["stribeck"].value) == pytest.approx(1.2, rel=0.05)


def test_no_rise_is_refused(tmp_path: Path) -> None:
    found = ff.fit("cylinder-friction", [moved_by_hand(tmp_path)], stribeck="estimate")
    assert found.parameters["stribeck"].status == "not_identified"
    assert any("does not rise beyond doubt" in n.message for n in found.notices)


def test_a_rise_at_too_few_speeds_takes_the_levels_with_it(tmp_path: Path) -> None:
    """Without it they were 10 standard errors off: 0 of 200 intervals held."""
    logs = at_constant_speeds(tmp_path, [0.02, 0.05, 0.1, -0.02, -0.05, -0.1], rise=1.2)
    with pytest.raises(ff.NotIdentifiedError) as refused:
        ff.fit("cylinder-friction", logs, stribeck="estimate")
    assert "clearly different speeds" in str(refused.value)
    assert "Record steady strokes" in str(refused.value)


def test_a_load_cell_offset_is_not_passed_off_as_asymmetry(tmp_path: Path) -> None:
    log = moved_by_hand(tmp_path, offset=0.3)
    assert "asymmetry-or-offset" in codes(ff.fit("cylinder-friction", [log]))
    assert "asymmetry-or-offset" not in codes(ff.fit("cylinder-friction", [log], offset="none"))
    equal = ff.fit("cylinder-friction", [log], offset="free")
    assert equal.verdict == "warn"
    assert "force-offset" in codes(equal)


def test_even_levels_are_not_called_uneven(tmp_path: Path) -> None:
    logs = [moved_by_hand(tmp_path, seed) for seed in range(3)]
    assert ff.fit("cylinder-friction", logs).verdict == "pass"


def test_a_drifting_force_is_noticed(tmp_path: Path) -> None:
    log = moved_by_hand(tmp_path)
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    table[:, 2] += 0.05 * table[:, 0]
    write(log, "velocity", table[:, 1], table[:, 2])
    found = ff.fit("cylinder-friction", [log], offset="none")
    assert any("drifts" in n.message for n in found.notices)


def test_a_heavy_mass_on_a_noisy_position_does_not_fail_the_right_answer(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    x, v, a = by_hand(5, n=6000, step=1e-3)
    force = friction(v) + 14.5 * a + 0.1 * rng.standard_normal(v.size)
    log = write(tmp_path / "log.csv", "position", x + 1e-5 * rng.standard_normal(v.size), force,
                1e-3)  # fmt: skip
    found = ff.fit("cylinder-friction", [log], mass=14.5)
    assert found.verdict != "fail"
    assert found.document.fit.fit_percent > 60.0
    assert holds(found, LAW)


def test_one_steady_reading_a_log_tells_no_more_than_its_converter() -> None:
    """Four logs of one value each behind steps of 0.5 N: off by 88 standard errors rms."""
    for seed in range(6):
        rng = np.random.default_rng([43, seed])
        law = {n: v * rng.uniform(0.8, 1.2) for n, v in cylinder_friction.TRUTH.items()}
        logs = cylinder_friction.record(
            rng, law=law, converter=0.5, sigma=0.01, motions=cylinder_friction.CONSTANT
        )  # fmt: skip
        found = ff.fit("cylinder-friction", logs, mass=cylinder_friction.MASS)
        for name, q in found.parameters.items():
            if name == "viscous" and q.status == "estimated":
                assert q.ci95[0] <= law[name] <= q.ci95[1]


def test_logs_that_are_too_slow_are_named_with_what_they_hold(tmp_path: Path) -> None:
    """Eight of 18 logs of a drive were dropped in silence, and friction that falls with them."""
    rng, logs = np.random.default_rng(3), []
    for speed in (0.1, 0.2, 0.4, 1.0, 6.0, 18.0):
        for sign in (1.0, -1.0):
            v = sign * speed + min(0.2 + 0.2 * speed, 0.4) * rng.standard_normal(300)
            level = 1e-3 * (1.0 + 0.5 * np.exp(-((speed / 0.4) ** 2))) + 1.2e-5 * speed
            torque = sign * level + 1.5e-4 * rng.standard_normal(300)
            path = tmp_path / f"{'np'[sign > 0.0]}{speed:g}.csv"
            table = np.column_stack((0.2 * np.arange(300), v, torque))
            np.savetxt(path, table, "%.9g", ",", comments="",
                       header="time [s],angular_velocity [rad/s],torque [N m]")  # fmt: skip
            logs.append(path)
    found = ff.fit("cylinder-friction", logs)
    said = {n.code: n.message for n in found.notices}
    assert found.verdict == "warn"
    assert "p0.1.csv" in said["log-unused"]
    assert "n0.1.csv" in said["log-unused"]
    assert "p18.csv" not in said["log-unused"]
    assert "too slow for the dead band" in said["logs-disagree"]
    (row,) = (r for r in found.document.fit.logs if r.file == "p0.1.csv")
    assert row.samples == 0
    assert row.fit_percent is None
    assert row.rmse is None
