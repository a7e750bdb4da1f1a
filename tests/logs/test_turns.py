"""Angles that begin again after a full turn are continued where that is certain."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError, UsageError
from fluidact_fit.experiment import Experiment, FloatArray
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import describe, experiments, provenance, read_log
from fluidact_fit_cli.main import run

VARIANT = Variant(
    "any",
    (
        Role("time", "s", ""),
        Role("angle", "rad", "", required=False),
        Role("position", "m", "", required=False),
        Role("torque", "N m", "", output=True),
    ),
    (),
)
TIME = 0.01 * np.arange(900)
# to and fro over several turns, with rests; rad
ANGLE = 12.0 * np.sin(0.9 * TIME) ** 3 + 7.0 * np.sin(0.31 * TIME)


def folded(angle: FloatArray, turn: float, low: float) -> FloatArray:
    return low + np.mod(angle - low, turn)


def read(folder: Path, header: str, column: FloatArray, **how: object) -> Experiment:
    log = read_log(write(folder, header, column), **how)
    (one,), notices = experiments(log, VARIANT)
    codes = [n.code for n in notices if n.code == "angle-wraps"]
    assert len(codes) == (1 if one.attributes["turns"].get(header.split()[0]) else 0)
    return one


def write(folder: Path, header: str, column: FloatArray) -> Path:
    path = folder / "log.csv"
    torque = np.cos(3.0 * TIME[: column.size])
    rows = [f"{t:.2f},{x:.7g},{y:.6f}" for t, x, y in zip(TIME, column, torque)]
    path.write_text("\n".join([f"time [s],{header},torque [N m]", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("unit", "turn"), [("rad", 2 * math.pi), ("deg", 360.0), ("rev", 1.0), ("mrad", 2000 * math.pi)]
)
@pytest.mark.parametrize("centred", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_full_turns(tmp_path: Path, unit: str, turn: float, centred: bool, noise: float) -> None:
    """Half the samples vanished, or the torque acted against the motion."""
    shown = (ANGLE + noise * np.random.default_rng(0).normal(size=900)) / (2 * math.pi) * turn
    one = read(tmp_path, f"angle [{unit}]", folded(shown, turn, -turn / 2 if centred else 0.0))
    found = one["angle"]
    expected = shown * 2 * math.pi / turn
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=2e-5)
    assert one.signals["angle"].resolution > 1e-9


@pytest.mark.parametrize(
    ("counts", "header", "scale"),
    [
        (4096, "angle", 2 * math.pi / 4096),  # on the shaft
        (4096, "angle", -2 * math.pi / 4096),
        (4000, "angle", 2 * math.pi / 4000),
        (4096, "angle", 2 * math.pi / 4096 / 50),  # before a gear
        (65_536, "angle", 1e-3),
        (65_536, "position", 1e-6),
        (1024, "position", 2e-5),
    ],
)
def test_counts_of_an_encoder(tmp_path: Path, counts: int, header: str, scale: float) -> None:
    whole = np.floor(ANGLE / (2 * math.pi) * counts)
    column = folded(whole, counts, 0.0)
    one = read(tmp_path, header, column, scales={header: scale})
    np.testing.assert_allclose(
        one[header] - one[header][0], (whole - whole[0]) * scale, rtol=1e-9, atol=1e-12
    )
    assert one.attributes["turns"] == {header: counts}


@pytest.mark.parametrize("fastest", [60.0, 170.0, 250.0, 700.0])
def test_a_fast_shaft_is_followed(tmp_path: Path, fastest: float) -> None:
    """More than half a turn from sample to sample is told by the speed that led to it."""
    speed = fastest * np.concatenate(
        [np.linspace(0, 1, 300), np.ones(300), np.linspace(1, -1, 300)]
    )
    angle = np.concatenate(([0.0], np.cumsum(speed)[:-1]))
    one = read(tmp_path, "angle [deg]", folded(angle, 360.0, 0.0))
    np.testing.assert_allclose(np.degrees(one["angle"]), angle, atol=2e-2)


def test_a_part_of_a_log_begins_in_motion(tmp_path: Path) -> None:
    speed = 200.0 * np.minimum(np.arange(900) / 300.0, 1.0)
    angle = np.concatenate(([0.0], np.cumsum(speed)[:-1]))
    one = read(tmp_path, "angle [deg]", folded(angle, 360.0, 0.0), window=(5.0, 8.0))
    np.testing.assert_allclose(np.degrees(np.diff(one["angle"])), 200.0, atol=2e-2)


def test_the_first_reading_is_kept(tmp_path: Path) -> None:
    one = read(tmp_path, "angle [deg]", folded(np.degrees(ANGLE) + 300.0, 360.0, 0.0))
    assert one["angle"][0] == pytest.approx(math.radians(300.0))


@pytest.mark.parametrize(
    "column",
    [
        np.degrees(ANGLE),  # goes on
        np.degrees(0.2 * ANGLE),
        np.degrees(ANGLE) % 360.0 // 360.0 + np.degrees(0.1 * ANGLE),
        np.where(np.arange(900) == 400, 0.0, 90.0 + np.degrees(0.2 * ANGLE)),  # a lost reading
        np.where(np.arange(900) % 300 == 200, 0.0, 350.0 + 5.0 * np.sin(TIME)),
        np.where(np.arange(900) // 2 == 200, 0.0, 350.0 + 5.0 * np.sin(TIME)),
        np.where(TIME < 4.0, 10.0, 190.0) + 0.1 * np.sin(TIME),  # a jump
    ],
)
def test_other_angles_stay_as_they_are(tmp_path: Path, column: FloatArray) -> None:
    log = read_log(write(tmp_path, "angle [deg]", column))
    (one,), notices = experiments(log, VARIANT)
    assert not one.attributes["turns"]
    assert "angle-wraps" not in {n.code for n in notices}


@pytest.mark.parametrize(
    ("header", "column"),
    [
        ("angle", folded(np.degrees(ANGLE), 360.0, 0.0)),  # no unit: radians would be assumed
        ("angle [rad]", folded(np.degrees(ANGLE), 360.0, 0.0)),
        ("angle [deg]", folded(ANGLE, 2 * math.pi, 0.0)),
        ("angle [deg]", folded(np.degrees(ANGLE), 180.0, 0.0)),
        ("angle [deg]", folded(np.degrees(ANGLE)[::40], 360.0, 0.0)),  # too fast
        ("angle [deg]", np.convolve(folded(np.degrees(ANGLE), 360.0, 0.0), np.ones(3) / 3)[2:-2]),
    ],
)  # fmt: skip
def test_what_is_not_certain_is_asked(tmp_path: Path, header: str, column: FloatArray) -> None:
    path = write(tmp_path, header, column)
    with pytest.raises(LogError) as caught:
        experiments(read_log(path), VARIANT)
    assert "seems to begin again" in caught.value.text
    assert "--unwrap angle=" in caught.value.remedy
    (one,), _ = experiments(read_log(path, unwrap={"angle": "none"}), VARIANT)
    assert one.attributes["turns"] == {"angle": 0.0}
    assert np.ptp(one["angle"]) <= np.ptp(column) * 1.01 or header != "angle"


def test_what_the_user_says_is_done(tmp_path: Path) -> None:
    path = write(tmp_path, "angle [deg]", folded(np.degrees(ANGLE), 180.0, 0.0))
    (one,), notices = experiments(read_log(path, unwrap={"angle": 180.0}), VARIANT)
    np.testing.assert_allclose(np.diff(one["angle"]), np.diff(ANGLE), atol=2e-5)
    assert "angle-wraps" in {n.code for n in notices}
    for wrong in (-1.0, math.nan, "often"):
        with pytest.raises(UsageError, match="unwrap"):
            read_log(path, unwrap={"angle": wrong})


def test_inspect_says_so(tmp_path: Path) -> None:
    path = write(tmp_path, "angle [deg]", folded(np.degrees(ANGLE), 360.0, 0.0))
    assert "angle-wraps" in {n["code"] for n in describe(read_log(path))["notices"]}


def friction(
    folder: Path, name: str, *, wrapped: bool, speed: float = 1.0, turn: float = 360.0
) -> Path:
    """Strokes of a shaft at several speeds, and its torque."""
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(3000)
    velocity = np.zeros(3000)
    for k, v in enumerate([3.0, -3.0, 6.0, -6.0, 10.0, -10.0]):
        velocity[500 * k : 500 * (k + 1)] = speed * v * np.clip(np.arange(500) / 30, 0, 1)
    angle = 400.0 + np.degrees(np.cumsum(velocity) * 0.01)
    torque = 0.05 * np.sign(velocity) + 0.002 * velocity + 1e-4 * rng.normal(size=3000)
    shown = angle % turn if wrapped else angle
    rows = [f"{t:.2f},{a:.5f},{q:.6f}" for t, a, q in zip(time, shown, torque)]
    path = folder / name
    path.write_text("\n".join(["time [s],angle [deg],torque [N m]", *rows]) + "\n", "utf-8")
    return path


def test_the_fit_the_file_and_the_check_continue_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wrapped = friction(tmp_path, "wrapped.csv", wrapped=True)
    straight = friction(tmp_path, "straight.csv", wrapped=False)
    one, two = (ff.fit("cylinder-friction", path) for path in (wrapped, straight))
    for name, q in two.parameters.items():
        assert one.parameters[name].value == pytest.approx(q.value, rel=1e-5, abs=1e-9)
    assert one.document.validity["angle"].high == pytest.approx(two.document.validity["angle"].high
        - math.radians(360.0), abs=1e-3)  # fmt: skip
    (source,) = one.document.provenance.logs
    assert source.columns["angle"].turn == 360.0
    assert two.document.provenance.logs[0].columns["angle"].turn is None
    one.save("w.yaml")
    fresh = friction(tmp_path, "fresh.csv", wrapped=True, speed=0.9)
    assert run(["check", "w.yaml", str(fresh), "-q"]) == 0
    assert run(["simulate", "w.yaml", str(fresh), "-o", "s.csv", "-q"]) == 0
    simulated = np.genfromtxt("s.csv", delimiter=",", names=True)
    assert np.abs(np.diff(simulated["angle_rad"])).max() < 1.0


def test_the_choice_of_the_user_is_used_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = friction(tmp_path, "straight.csv", wrapped=False)
    assert run(["cylinder-friction", str(path), "--unwrap", "angle=none", "-q"]) == 0
    (source,) = ff.load("cylinder-friction.yaml").document.provenance.logs
    assert source.columns["angle"].turn == 0.0
    log = read_log(friction(tmp_path, "wrapped.csv", wrapped=True), unwrap={"angle": None})
    found, _ = experiments(log, VARIANT)
    assert provenance(log, found)["columns"]["angle"]["turn"] == 0.0


def test_a_turn_that_was_given_is_used_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An angle of the field, which turns twice with the shaft."""
    monkeypatch.chdir(tmp_path)
    friction(tmp_path, "a.csv", wrapped=True, turn=180.0)
    friction(tmp_path, "b.csv", wrapped=True, turn=180.0, speed=0.9)
    assert run(["cylinder-friction", "a.csv", "-q"]) == 3
    assert run(["cylinder-friction", "a.csv", "--unwrap", "angle=180", "-q"]) == 0
    fitted = ff.load("cylinder-friction.yaml").document
    assert fitted.provenance.logs[0].columns["angle"].turn == 180.0
    for log in ("a.csv", "b.csv"):
        for columns in ([], ["--column", "angle=#2"]):
            assert run(["check", "cylinder-friction.yaml", log, *columns, "-q"]) == 0
        assert run(["simulate", "cylinder-friction.yaml", log, "-o", "s.csv", "-f", "-q"]) == 0
