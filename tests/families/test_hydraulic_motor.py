"""Hydraulic motor: play, static curve, lag, truth, refusals, the real bench."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, make_interp_spline
from studies.red_team.attacks import hydraulic_motor as motor_attacks
from studies.red_team.run import run as run_attack

import fluidact_fit as ff
from attack_finder import find_attack
from dataset_fits import fit_dataset
from fluidact_fit.control import make_block
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import LogError, NotIdentifiedError, UsageError
from fluidact_fit.estimation.transfer_model import AT_REST
from fluidact_fit.experiment import Experiment, FloatArray, Hold, Signal
from fluidact_fit.export.excitation import run as run_routine
from fluidact_fit.export.rounding import error_of, inward
from fluidact_fit.families.hydraulic_motor.block import MotorBlock
from fluidact_fit.families.hydraulic_motor.equation import MotorModel, play, static_speed
from fluidact_fit.families.hydraulic_motor.family import HydraulicMotor
from fluidact_fit.families.hydraulic_motor.fit import MotorOptions
from fluidact_fit.families.hydraulic_motor.routines import MotorRoutines
from fluidact_fit.family import Plant
from fluidact_fit.result import FitResult
from fluidact_fit.routines import Argument
from fluidact_fit.routines.sharing import shared

REAL = Path(__file__).parents[2] / ".." / "shared" / "data" / "hydraulic_motor"
real = pytest.mark.skipif(
    not REAL.is_dir(), reason="recorded logs of other people are not beside this checkout"
)
CURVE = {
    "dead_zone": 0.4,
    "gain": 88.0,
    "curvature": 0.24,
    "saturation_command": 6.2,
    "hysteresis": 0.25,
    "time_constant": 0.07,
}


def fitted() -> FitResult:
    return fit_dataset("hydraulic-motor")


def number(result: FitResult, name: str) -> float:
    value = result.parameters[name].value
    assert isinstance(value, float)
    return value


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=30), st.floats(0.0, 2.0))
@settings(max_examples=100, deadline=None)
def test_play_stays_within_its_width(commands: list[float], width: float) -> None:
    u = np.array(commands)
    w, slope = play(u, width)
    assert np.all(np.abs(w - u) <= 0.5 * width + 1e-12)
    assert {*np.unique(slope)} <= {-0.5, 0.0, 0.5}


def test_play_lags_in_both_directions() -> None:
    w, _ = play(np.array([0.0, 1.0, 2.0, 1.9, 1.0, 0.0]), 0.4)
    assert w == pytest.approx([0.0, 0.8, 1.8, 1.8, 1.2, 0.2])


def test_static_curve() -> None:
    at = np.array([-8.0, -0.3, 0.0, 0.4, 0.41, 6.2, 9.0])
    n = static_speed(at, CURVE)
    assert n[1:4] == pytest.approx(0.0)
    assert (n[4] - n[3]) / 0.01 == pytest.approx(88.0, rel=2e-3)
    assert n[5] == n[6] == -n[0]
    assert np.all(np.diff(static_speed(np.linspace(0, 8, 200), CURVE)) >= 0.0)
    line = static_speed(np.array([1.4]), {**CURVE, "curvature": 0.0})
    assert line[0] == pytest.approx(88.0, rel=1e-9)


LINE = {"dead_zone": 0.0, "gain": 1.0, "curvature": 0.0, "hysteresis": 0.0,
        "time_constant": 0.07, "dead_time": 0.031}  # fmt: skip


def run(time: FloatArray, command: FloatArray, hold: Hold = "zoh", **signals: Signal) -> Experiment:
    """A log of a command, held or moving on straight lines."""
    drive = Signal("command", time, command, "A", hold, before=float(command[0]))
    return Experiment("x.csv", 0, time, {"command": drive, **signals}, 0.02, False)


def speeds(experiment: Experiment, values: dict[str, float]) -> FloatArray:
    """Speeds of a motor at rest before its log."""
    variant = HydraulicMotor().variants[0]
    return MotorModel(variant, [experiment], AT_REST).combined(values)


def uneven(n: int = 65) -> FloatArray:
    return np.cumsum(np.random.default_rng(1).uniform(0.01, 0.03, n))


@pytest.mark.parametrize("time", [0.02 * np.arange(65), uneven()])
def test_lag_is_exact_for_a_step(time: FloatArray) -> None:
    y = speeds(run(time, np.r_[np.zeros(5), np.ones(60)]), LINE)
    t = np.maximum(time - time[5] - 0.031, 0.0)
    assert y == pytest.approx(1.0 - np.exp(-t / 0.07))


@pytest.mark.parametrize("time", [0.02 * np.arange(65), uneven()])
def test_lag_is_exact_for_a_ramp(time: FloatArray) -> None:
    y = speeds(run(time, time - time[0], "foh"), LINE)
    t = np.maximum(time - time[0] - 0.031, 0.0)
    t = np.minimum(t, time[-1] - time[0])
    assert y == pytest.approx(t - 0.07 * (1.0 - np.exp(-t / 0.07)), abs=1e-9)


@pytest.mark.parametrize("hold", ["foh", "smooth"])
def test_corners_between_samples_stay_sharp(hold: Hold) -> None:
    """A command that crosses the dead zone within one sample, against a grid of 4000 points."""
    v = {**LINE, "dead_zone": 0.4, "gain": 10.0, "curvature": 0.5}
    coarse, fine = np.arange(0.0, 4.0, 0.1), np.arange(0.0, 3.9001, 1e-3)
    command = np.sin(4.0 * coarse)
    between = make_interp_spline(coarse, command, k=1)(fine)
    if hold == "smooth":
        between = CubicSpline(coarse, command)(fine)
    y = speeds(run(coarse, command, hold), v)
    exact = speeds(run(fine, between), {**v, "dead_time": 0.0305})
    assert y == pytest.approx(exact[::100], abs=0.02)


def test_a_late_start_does_not_move_the_offset() -> None:
    """The fit weighs it down, and so does whoever simulates the log."""
    time = 0.02 * np.arange(400)
    command = np.where(time < 2.0, 0.0, 2.0)
    speed = speeds(run(time, command), LINE) + 0.5
    speed[100:140] = 0.5
    log = run(time, command, speed=Signal("speed", time, speed, "rad/s"))
    family = HydraulicMotor()
    plant = Plant(family.variants[0], LINE, MotorOptions(start_state="free", residual_limit=1e-3))
    (found,) = family.simulate(plant, [log])
    assert found.offset == pytest.approx(0.5, abs=1e-3)


def test_truth_is_recovered() -> None:
    result = fitted()
    for name, truth in load_dataset("hydraulic-motor").truth.items():
        found = result.parameters[name]
        error = abs(number(result, name) - truth["value"])
        assert error <= 4.0 * found.std_error, name  # type: ignore[operator]
        assert error <= 0.02 * truth["value"], name
    assert result.verdict == "pass"
    assert result.derived["saturation_speed"].value == pytest.approx(275.6, rel=2e-3)


def test_saturation_that_was_not_reached_is_left_out() -> None:
    dataset = load_dataset("hydraulic-motor")
    # the window holds the levels up to 5 A on the way up, and none beyond
    logs = [ff.read_log(p, columns=dict(dataset.columns), window=(0.0, 9.5)) for p in dataset.logs]
    result = ff.fit("hydraulic-motor", logs, fixed={"hysteresis": 0.25})
    assert "saturation_command" not in result.parameters
    assert "saturation-not-reached" in {n.code for n in result.notices}
    assert number(result, "gain") == pytest.approx(88.0, rel=0.02)


def test_one_way_does_not_show_hysteresis() -> None:
    dataset = load_dataset("hydraulic-motor")
    logs = [ff.read_log(p, columns=dict(dataset.columns), window=(0.0, 12.5)) for p in dataset.logs]
    result = ff.fit("hydraulic-motor", logs)
    assert result.parameters["hysteresis"].status == "not_identified"
    assert number(result, "hysteresis") == 0.0
    # without it the dead zone is that of the way up
    assert number(result, "dead_zone") == pytest.approx(0.4 + 0.125, rel=0.03)


def test_steps_are_needed(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    np.savetxt(path, np.column_stack((0.02 * np.arange(50), np.zeros(50), np.zeros(50))),
               delimiter=",", header="time,command,speed", comments="")  # fmt: skip
    with pytest.raises((LogError, NotIdentifiedError)):
        ff.fit("hydraulic-motor", path)


@cache
def loaded() -> MotorBlock:
    block = make_block(fitted().document)
    assert isinstance(block, MotorBlock)
    return block


@given(st.floats(0.5, 6.0), st.sampled_from([-1, 0, 1]))
@settings(max_examples=60, deadline=None)
def test_inverse(command: float, direction: int) -> None:
    block = loaded()
    speed = block(command, direction)
    if float(speed) > 1e-6:
        assert float(block.inverse(speed, direction)) == pytest.approx(command, rel=1e-6)


@pytest.mark.parametrize("curvature", [3.0, 4.0, 7.0, 20.0, 60.0])
def test_where_the_curve_is_flat_the_inverse_holds_in_single_precision(curvature: float) -> None:
    """Nothing was left of 1 - k y: a command 0.43 A off, or one beyond 3.4e38, and no export."""
    command = Argument("command", "A", "command", 0.0, 7.0)
    values = {**CURVE, "curvature": curvature}
    _, inverse = MotorRoutines(values, command, "rad/s").curve()
    error = error_of(inward(shared(inverse)))
    assert error.total < 0.01  # of 7 A
    top = inverse.arguments[0].high
    found = float(run_routine(inverse, np.array([[[top, 0.0]]]))[0][0, 0])
    reached = float(static_speed(np.array([found]), values)[0])
    assert top * (1.0 - 1.1e-5) < reached < top


def test_a_dead_time_of_more_samples_than_can_be_kept_is_refused() -> None:
    """It was taken, and a queue of 30 million commands with it."""
    block = loaded().with_sample_time(1e-9)
    block.parameters._values["dead_time"] = 0.03
    with pytest.raises(UsageError, match="samples is more than"):
        block.step(1.0)


@pytest.mark.parametrize(("dead_time", "period"), [(0.0, 0.02), (0.03, 0.02), (0.0371, 0.01)])
def test_a_step_moves_as_the_continuous_motor_does(dead_time: float, period: float) -> None:
    """Play, curve, dead time and lag on a grid of ten microseconds, which shares no code."""
    block = loaded().with_sample_time(period)
    block.parameters._values["dead_time"] = dead_time
    v = {n: number(fitted(), n) for n in fitted().parameters}
    command = np.random.default_rng(3).uniform(-6.5, 6.5, 40).repeat(3)
    fine, late = 1e-5, round(dead_time / 1e-5)
    spool, steady = 0.0, [0.0] * late
    for u in command.tolist():
        spool = min(max(spool, u - 0.5 * v["hysteresis"]), u + 0.5 * v["hysteresis"])
        size = min(abs(spool), v["saturation_command"]) - v["dead_zone"]
        flow = -np.expm1(-v["curvature"] * max(size, 0.0)) * v["gain"] / v["curvature"]
        steady += [float(np.sign(spool) * flow)] * round(period / fine)
    speed, wanted = 0.0, []
    for n, target in enumerate(steady[: command.size * round(period / fine)]):
        if n % round(period / fine) == 0:
            wanted.append(speed + block.offset)
        speed += (target - speed) * -np.expm1(-fine / v["time_constant"])
    found = [block.step(u) for u in command.tolist()]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-7 * np.ptp(wanted))


def test_a_motor_at_rest_under_a_command_stays_there() -> None:
    block = loaded()
    block.reset(input=3.0)
    steady = float(block(3.0)) + block.offset
    assert [block.step(3.0) for _ in range(5)] == pytest.approx([steady] * 5, rel=1e-12)


@real
def test_real_motor() -> None:
    """Dead zone, saturation and hysteresis of the curve; 50 ms to 100 ms of lag."""
    log = ff.read_log(
        REAL / "MotorRotation.csv",
        columns={"time": "#1", "command": "#2", "speed": "#3"},
        units={"speed": "1"},
    )
    result = ff.fit("hydraulic-motor", log)
    assert 0.25 < number(result, "dead_zone") < 0.45
    assert 6.0 < number(result, "saturation_command") < 7.0
    assert 0.15 < number(result, "hysteresis") < 0.30
    assert 0.05 < number(result, "time_constant") < 0.10
    assert float(result.derived["saturation_speed"].value) == pytest.approx(3.3, abs=0.05)  # type: ignore[arg-type]
    assert (result.document.fit.fit_percent or 0.0) > 98.0


def bench(rng: np.random.Generator, noise: float = 0.0, **more: float) -> dict[str, FloatArray]:
    """Random levels, with noise on the logged command; no saturation unless ``more`` has one."""
    time, levels = 0.02 * np.arange(1200), rng.uniform(-1.0, 1.0, 60)
    command = np.repeat(levels, 20)
    v = {**LINE, "dead_zone": 0.1, "gain": 100.0, "curvature": 0.5, "hysteresis": 0.05, **more}
    speed = speeds(run(time, command), v)
    return {
        "time [s]": time,
        "command [A]": command + noise * rng.standard_normal(time.size),
        "speed [rad/s]": speed + 0.3 * rng.standard_normal(time.size),
    }


def written(path: Path, columns: dict[str, FloatArray]) -> Path:
    np.savetxt(
        path, np.column_stack(list(columns.values())), "%.9g", ",",
        header=",".join(columns), comments="",
    )  # fmt: skip
    return path


@pytest.mark.parametrize("seed", range(4))
def test_a_motor_that_never_saturates_is_fitted_without(tmp_path: Path, seed: int) -> None:
    log = written(tmp_path / "x.csv", bench(np.random.default_rng(seed)))
    result = ff.fit("hydraulic-motor", [log])
    assert "saturation_command" not in result.parameters
    assert result.verdict == "pass"
    assert number(result, "gain") == pytest.approx(100.0, rel=0.03)


@pytest.mark.parametrize("seed", [57721566, 29112901])
def test_a_saturation_that_the_log_does_not_rule_out_is_said_to_be_possible(seed: int) -> None:
    """Without it the curvature is 4.9 and 6 standard errors off, however little it explains."""
    lagging = find_attack(motor_attacks, "at the edge of the search", "half the log")
    found = run_attack(lagging, 0, seed)
    assert not found.silent
    assert "saturation-undecided" in found.codes


def test_values_far_from_usual_are_found(tmp_path: Path) -> None:
    """The search once ended at half the command and at twenty samples."""
    odd = {"dead_zone": 0.6, "dead_time": 0.5, "saturation_command": 0.9}
    log = written(tmp_path / "x.csv", bench(np.random.default_rng(1), **odd))
    result = ff.fit("hydraulic-motor", [log])
    assert number(result, "dead_zone") == pytest.approx(0.6, abs=0.05)
    assert number(result, "dead_time") == pytest.approx(0.5, abs=0.01)


def test_a_short_log_beside_a_long_one_does_not_bound_the_search(tmp_path: Path) -> None:
    """A dead time of 0.5 s was sought up to half the shorter log, and everything else was lost."""
    whole = bench(np.random.default_rng(1), dead_time=0.5)
    part = {n: x[:45] for n, x in bench(np.random.default_rng(2), dead_time=0.5).items()}
    logs = [written(tmp_path / "whole.csv", whole), written(tmp_path / "part.csv", part)]
    result = ff.fit("hydraulic-motor", logs)
    assert number(result, "dead_time") == pytest.approx(0.5, abs=0.01)
    assert number(result, "gain") == pytest.approx(100.0, rel=0.03)


def test_noise_of_the_command_that_looks_like_hysteresis_is_warned_of(tmp_path: Path) -> None:
    """A play follows every flicker: the hysteresis comes out some three deviations wider."""
    log = written(tmp_path / "x.csv", bench(np.random.default_rng(2), noise=5e-3))
    result = ff.fit("hydraulic-motor", [log])
    assert number(result, "hysteresis") > 0.05 + 2.0 * 5e-3
    assert "command-noise" in {w.code for w in result.document.warnings}


def test_jitter_of_the_instants_is_no_noise_of_the_command() -> None:
    """An exact sine at uneven instants was said to carry noise (4 of 4 logs)."""
    rng = np.random.default_rng(0)
    fine = 1e-3 * np.arange(30_100)
    command = 0.9 * np.sin(1.57 * fine) * np.cos(0.19 * fine)
    v = {**LINE, "dead_zone": 0.1, "gain": 100.0, "curvature": 0.5, "hysteresis": 0.05}
    speed = speeds(run(fine, command), v)
    at = 20 * np.arange(1, 1501) + rng.integers(-6, 7, 1500)
    columns = {
        "time [s]": fine[at],
        "command [A]": command[at],
        "speed [rad/s]": speed[at] + 0.3 * rng.standard_normal(at.size),
    }
    result = ff.fit("hydraulic-motor", columns, hold={"command": "foh"})
    assert "command-noise" not in {w.code for w in result.document.warnings}
    known = result.parameters["hysteresis"]
    assert isinstance(known.std_error, float)
    assert abs(known.number - 0.05) < 4.0 * known.std_error
