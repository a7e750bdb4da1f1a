"""Hydraulic motor from other logs: angle, position, settled points; two edges, an offset."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motor_simulator import EVEN, STEP, TRUTH, Array, levels, points, run
from studies.red_team.attacks.variants import travelled

import fluidact_fit as ff
from fluidact_fit.errors import LogError, NotIdentifiedError, UsageError
from fluidact_fit.export import export
from fluidact_fit.notices import is_note
from fluidact_fit.result import FitResult
from fluidact_fit.routines import Machine

NOISE = {"speed": 0.7, "angle": 0.01, "position": 0.01}
SCALE = 70.0  # us of a servo pulse per ampere


def staircase() -> Array:
    """Levels up, down and up again, twice at other places."""
    stairs = np.r_[np.linspace(0, 7, 15), np.linspace(6.5, -7, 28), np.linspace(-6.5, 0, 14)]
    return np.r_[stairs, 0.93 * stairs]


def log(output: str, truth: Mapping[str, float], seed: int, count: int = 40) -> dict[str, Array]:
    """A log of held levels with white noise on the output."""
    rng = np.random.default_rng(seed)
    command = levels(rng, count)
    speed, angle = run(command, truth)
    y = (speed if output == "speed" else angle) + NOISE[output] * rng.standard_normal(command.size)
    return {"time": STEP * np.arange(command.size), "command": command, output: y}


def settled(truth: Mapping[str, float], seed: int) -> dict[str, Array]:
    """Settled points with noise."""
    rng, command = np.random.default_rng(seed), staircase()
    noise = NOISE["speed"] * rng.standard_normal(command.size)
    return {"command": command, "speed": points(command, truth) + noise}


def deviations(result: FitResult, truth: Mapping[str, float]) -> dict[str, float]:
    """Errors in standard errors; everything that is true has been estimated."""
    assert set(result.parameters) == set(truth)
    out = {}
    for name, true in truth.items():
        found = result.parameters[name]
        assert found.status == "estimated", name
        out[name] = (found.value - true) / found.std_error  # type: ignore[operator]
    return out


STATIC = {n: v for n, v in TRUTH.items() if n not in ("time_constant", "dead_time")}


@pytest.mark.parametrize("output", ["speed", "angle", "position"])
@pytest.mark.parametrize("even", [True, False])
def test_truth_is_recovered_from_speed_angle_and_position(output: str, even: bool) -> None:
    truth = EVEN if even else TRUTH
    options = {} if even else {"dead_zone": "asymmetric"}
    result = ff.fit("hydraulic-motor", log(output, truth, 3), **options)
    # a position that covers hundreds of metres is doubted, and rightly
    doubted = {"implausible-number"} if output == "position" else set()
    assert {n.code for n in result.notices if not is_note(n.code)} == doubted
    assert max(map(abs, deviations(result, truth).values())) < 4.0
    unit = {"speed": "rad/s/A", "angle": "rad/s/A", "position": "m/s/A"}[output]
    assert result.parameters["gain"].unit == unit
    speeds = [n for n in result.derived if n.startswith("saturation_speed")]
    assert len(speeds) == (1 if even else 2)
    assert result.derived[speeds[-1]].unit == unit.removesuffix("/A")


def servo(seed: int) -> tuple[dict[str, Array], dict[str, float]]:
    """A log of pulses in microseconds about 1500, and its truth in SI."""
    data, per = log("speed", EVEN, seed), 1e-6 * SCALE
    data["command"] = 1500.0 + SCALE * data["command"]
    truth = {**EVEN, "command_offset": 1.5e-3, "gain": EVEN["gain"] / per,
             "curvature": EVEN["curvature"] / per}  # fmt: skip
    for name in ("dead_zone", "saturation_command", "hysteresis"):
        truth[name] *= per
    return data, truth


def test_neutral_of_a_servo_pulse_is_found() -> None:
    data, truth = servo(5)
    result = ff.fit("hydraulic-motor", data, units={"command": "us"}, command_offset="estimate")
    assert result.verdict == "pass"
    assert max(map(abs, deviations(result, truth).values())) < 4.0


def test_neutral_of_a_servo_pulse_may_be_given() -> None:
    data, truth = servo(5)
    result = ff.fit(
        "hydraulic-motor", data, units={"command": "us"}, fixed={"command_offset": 1.5e-3}
    )
    assert result.parameters["command_offset"].status == "fixed"
    del truth["command_offset"]
    for name, true in truth.items():
        found = result.parameters[name]
        assert abs(found.value - true) < 4.0 * found.std_error, name  # type: ignore[operator]


def test_truth_is_recovered_from_settled_points() -> None:
    result = ff.fit("hydraulic-motor", settled(STATIC, 7), mode="static", dead_zone="asymmetric")
    assert result.verdict == "pass"
    assert max(map(abs, deviations(result, STATIC).values())) < 4.0


def test_settled_points_that_never_saturate_have_no_saturation() -> None:
    truth = {**STATIC, "saturation_command": 99.0}
    result = ff.fit("hydraulic-motor", settled(truth, 7), mode="static", dead_zone="asymmetric")
    assert "saturation_command" not in result.parameters
    assert "saturation-not-reached" in {n.code for n in result.notices}
    del truth["saturation_command"]
    assert max(map(abs, deviations(result, truth).values())) < 4.0


def test_intervals_cover_and_are_no_wider_than_they_have_to_be() -> None:
    """Errors in standard errors are standard normal: of 20 logs with settled points, 6 of angle."""
    found = [
        deviations(
            ff.fit("hydraulic-motor", settled(STATIC, k), mode="static", dead_zone="asymmetric"),
            STATIC,
        )
        for k in range(20)
    ]
    found += [deviations(ff.fit("hydraulic-motor", log("angle", EVEN, k, 25)), EVEN)
              for k in range(6)]  # fmt: skip
    z = np.array([value for run in found for value in run.values()])
    # 163 values, those of one log correlated: 95 % of them within 1.96, give or take 5 %
    assert 0.90 <= np.mean(np.abs(z) < 1.96) < 1.0
    assert 0.8 < z.std() < 1.2


def test_an_uneven_dead_zone_is_noticed_by_a_fit_with_one_width() -> None:
    truth = {**TRUTH, "dead_zone_negative": -0.43}
    result = ff.fit("hydraulic-motor", log("speed", truth, 3))
    (said,) = [n.message for n in result.notices if n.code == "unmodelled-response"]
    assert "Try --dead-zone=asymmetric." in said


def test_edges_and_offset_are_not_estimated_together() -> None:
    with pytest.raises(UsageError, match="ask for the same"):
        ff.fit("hydraulic-motor", log("speed", TRUTH, 1, 5), dead_zone="asymmetric",
               command_offset="estimate")  # fmt: skip


@pytest.mark.parametrize(("name", "mode"), [("dead_zone", "asymmetric"),
                                            ("dead_zone_positive", "symmetric")])  # fmt: skip
def test_a_number_of_the_other_dead_zone_is_refused(name: str, mode: str) -> None:
    with pytest.raises(UsageError, match=f"{name} is no parameter"):
        ff.fit("hydraulic-motor", log("speed", TRUTH, 1, 5), dead_zone=mode, fixed={name: 0.1})


def one_sided(seed: int = 2) -> dict[str, Array]:
    """A log whose commands turn the motor forward only."""
    rng = np.random.default_rng(seed)
    command = np.abs(levels(rng, 40))
    speed, _ = run(command, EVEN)
    y = speed + NOISE["speed"] * rng.standard_normal(speed.size)
    return {"time": STEP * np.arange(command.size), "command": command, "speed": y}


def test_an_edge_that_was_never_crossed_is_not_identified() -> None:
    result = ff.fit("hydraulic-motor", one_sided(), dead_zone="asymmetric")
    assert result.parameters["dead_zone_negative"].status == "not_identified"
    assert result.parameters["dead_zone_positive"].status == "estimated"


def test_one_direction_does_not_show_the_offset_of_the_command() -> None:
    with pytest.raises(NotIdentifiedError, match=r"command_offset.*one direction only"):
        ff.fit("hydraulic-motor", one_sided(), command_offset="estimate")


@pytest.mark.parametrize("given", ["bounds", "start"])
def test_a_search_for_a_saturation_that_settled_points_do_not_show_ends(given: str) -> None:
    """Bounds ended in a fault, a start in a refusal; over time it was left out."""
    truth = {**STATIC, "saturation_command": 99.0}
    number = (0.5, 6.9) if given == "bounds" else 5.0
    result = ff.fit("hydraulic-motor", settled(truth, 7), mode="static", dead_zone="asymmetric",
                    **{given: {"saturation_command": number}})  # fmt: skip
    assert "saturation_command" not in result.parameters


def test_a_loaded_file_predicts_settled_points_as_the_fit_does() -> None:
    """The spool is in its middle before the first point, which need not be the lowest command."""
    rng, command = np.random.default_rng(8), staircase()[4:]
    data = {"command": command, "speed": points(command, STATIC)}
    data["speed"] += NOISE["speed"] * rng.standard_normal(command.size)
    result = ff.fit("hydraulic-motor", data, mode="static", dead_zone="asymmetric")
    (run,) = result.fitted
    assert result.model.predict(run.experiment) == pytest.approx(run.simulated, rel=1e-9)


def test_rows_without_time_are_settled_points_on_request_only() -> None:
    with pytest.raises(LogError, match="time"):
        ff.fit("hydraulic-motor", settled(STATIC, 7))
    with pytest.raises(UsageError, match="settled points"):
        ff.fit("hydraulic-motor", settled(STATIC, 7), mode="static", start_state="rest")


FEW = {"dead_zone": 0.09, "gain": 130.0, "curvature": 1.0, "hysteresis": 0.04}


def few_points(seed: int, count: int, power: float = 1.0) -> dict[str, Array]:
    """Two loops of a few settled points, from rest; another ``power`` of what the spool opens."""
    rng = np.random.default_rng([9, seed])
    way = np.linspace(-1.0, 1.0, count // 4)
    command = np.concatenate((way, way[::-1], way, way[::-1]))
    command += 0.02 * rng.uniform(-1.0, 1.0, command.size)
    spool, place = np.empty(command.size), 0.0
    for k, u in enumerate(command.tolist()):
        spool[k] = place = min(max(place, u - 0.02), u + 0.02)
    x = np.maximum(np.abs(spool) - FEW["dead_zone"], 0.0) ** power
    speed = np.sign(spool) * FEW["gain"] * (1.0 - np.exp(-x))
    return {"command": command, "speed": speed + 0.3 * rng.standard_normal(command.size)}


def test_few_points_between_which_an_edge_lies_have_intervals_that_hold() -> None:
    """Noise of one point beside the edge makes a sharp optimum, and often another far from it."""
    held = []
    for seed in range(20):
        found = ff.fit("hydraulic-motor", few_points(seed, 20), mode="static").parameters
        held += [q.ci95[0] <= FEW[n] <= q.ci95[1] for n, q in found.items() if q.ci95]
    assert len(held) >= 72
    assert np.mean(held) > 0.87  # 95 % and three standard deviations of as many as 20 fits show


def test_a_curve_of_another_shape_is_said_without_a_time() -> None:
    said = [
        {n.code for n in ff.fit("hydraulic-motor", few_points(k, 60, p), mode="static").notices}
        for p in (0.8, 1.0)
        for k in range(4)
    ]
    assert all("unmodelled-response" in codes for codes in said[:4])
    assert not any("unmodelled-response" in codes for codes in said[4:])


CASES: dict[str, tuple[dict[str, Array], dict[str, Any]]] = {
    "edges": (log("speed", TRUTH, 3), {"dead_zone": "asymmetric"}),
    "servo": (servo(5)[0], {"command_offset": "estimate", "units": {"command": "us"}}),
    "angle": (log("angle", EVEN, 3), {}),
    "points": (settled(STATIC, 7), {"dead_zone": "asymmetric", "mode": "static"}),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("motors")
    out = {name: folder / f"{name}.yaml" for name in CASES}
    for name, (data, options) in CASES.items():
        ff.fit("hydraulic-motor", data, **options).save(out[name])
    return out


@pytest.mark.parametrize("name", CASES)
def test_a_loaded_file_computes_what_its_routines_and_its_inverse_say(
    name: str, files: Mapping[str, Path]
) -> None:
    block: Any = ff.load(files[name])
    data, _ = CASES[name]
    u = np.asarray(data["command"], dtype=float) * (1e-6 if name == "servo" else 1.0)
    routines = {r.name: Machine(r) for r in block.routines()}
    for way in (-1, 0, 1):
        speed = block(u, way)
        assert routines["speed"](command=u, direction=way)[0] == pytest.approx(speed, abs=1e-6)
        back = block.inverse(speed, way)
        assert routines["command_for"](speed=speed, direction=way)[0] == pytest.approx(back)
        assert block(back, way) == pytest.approx(speed, abs=1e-6)
    if name == "points":
        assert "step" not in routines
        return
    found = [block.step(x) for x in u.tolist()]
    step = [float(routines["step"](command=x)[0]) for x in u.tolist()]
    assert step == pytest.approx(found, abs=1e-7 * np.ptp(found))
    measured = next(data[n] for n in ("speed", "angle") if n in data)
    # the machine may have moved when the log began: the rest of it is the measured one
    late = slice(100, None)
    rest = np.asarray(found)[late] - measured[late]
    assert np.std(rest) < 1.1 * NOISE["angle" if name == "angle" else "speed"]


@pytest.mark.parametrize("name", CASES)
def test_a_file_is_simulated_from_commands_alone(name: str, files: Mapping[str, Path]) -> None:
    data, options = CASES[name]
    model, units = ff.load(files[name]), options.get("units", {})
    (whole,) = model.simulate(data, units=units)
    inputs = {n: x for n, x in data.items() if n in ("time", "command")}
    (alone,) = model.simulate(inputs, units=units)
    assert np.isnan(alone.measured).all()
    late = slice(0 if name == "points" else 100, None)  # the log may begin in motion
    level = 0.0 if name == "points" else float(np.mean((whole.simulated - alone.simulated)[late]))
    # of an angle the level is where the log began
    away = (alone.simulated + level - whole.simulated)[late]
    assert np.std(away) < 1e-6 * np.ptp(whole.simulated[late])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("name", CASES)
def test_exported_code_passes_its_own_test(
    name: str, files: Mapping[str, Path], tmp_path: Path
) -> None:
    export([files[name]], "c", tmp_path)
    sources = [str(p) for p in tmp_path.glob("*.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-o", str(tmp_path / "test")]
    subprocess.run(["gcc", *flags, *sources, "-lm"], check=True)
    assert subprocess.run([str(tmp_path / "test")], check=False).returncode == 0


def test_an_angle_that_slips_one_way_blames_what_the_model_lacks() -> None:
    """A few per cent of another gain add up: the remedy asked for steps that were there."""
    (recording,) = travelled(np.random.default_rng(1), slip=0.05)
    with pytest.raises(NotIdentifiedError, match="model misses the output") as refused:
        ff.fit("hydraulic-motor", recording)
    assert "another gain in the other direction" in str(refused.value)
    assert "Record steps" not in str(refused.value)


def encoder_log(
    truth: Mapping[str, float], rng: np.random.Generator, counts: tuple[int, int], codes: int
) -> dict[str, Array]:
    """A log of held levels, read by an encoder with so many codes a turn and no other noise."""
    command, code = levels(rng, *counts), 2.0 * np.pi / codes
    angle = np.round(run(command, truth)[1] / code) * code
    return {"time": STEP * np.arange(command.size), "command": command, "angle": angle}


@pytest.mark.parametrize(
    ("seed", "zone", "curvature", "top", "hysteresis"),
    [
        (8, 1.697, 0.037, 5.389, 0.468),  # refused: time_constant 0.177 s
        (38, 1.677, 0.245, 4.866, 0.394),  # hysteresis 13 % wide
    ],
)
def test_edges_are_found_among_the_minima_of_an_angle(
    seed: int, zone: float, curvature: float, top: float, hysteresis: float
) -> None:
    """Each level that an edge passes makes a minimum, and all of an angle after it goes astray."""
    truth = {
        "dead_zone": zone, "gain": 20.0, "curvature": curvature, "saturation_command": top,
        "hysteresis": hysteresis, "time_constant": 0.15, "dead_time": 0.03,
    }  # fmt: skip
    rng = np.random.default_rng([seed, 11])
    rng.uniform(size=4)
    result = ff.fit("hydraulic-motor", encoder_log(truth, rng, (30, 35), 4096))
    assert result.verdict == "pass"
    for name, true in truth.items():
        assert result.parameters[name].value == pytest.approx(true, rel=0.02), name


@pytest.mark.parametrize("seeds", [(7, 8), range(12)], ids=["two", "twelve"])
def test_intervals_know_the_codes_of_an_encoder(seeds: Sequence[int]) -> None:
    """Its errors stay while the motor stands still; white ones made 84 % of the intervals hold."""
    truth, off = {**EVEN, "gain": 8.0}, []
    for seed in seeds:
        rng = np.random.default_rng([seed, 7])
        result = ff.fit("hydraulic-motor", encoder_log(truth, rng, (25, 60), 1024))
        found = {n: result.parameters[n] for n in truth if n in result.parameters}
        off += [(p.value - truth[n]) / p.std_error for n, p in found.items() if p.std_error]
    assert np.max(np.abs(off)) < 2.8
