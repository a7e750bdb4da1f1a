"""Readings that stand twice: in a channel slower than its log, and in two logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drive_simulator import SERVO, advance
from hypothesis import given, settings
from hypothesis import strategies as st

import fluidact_fit as ff
from fluidact_fit import LogError
from fluidact_fit.logs.repeats import rows_of_a_line, rows_per_reading

STEP = 0.01  # s


def motion(rng: np.random.Generator, rows: int = 2000) -> np.ndarray:
    t = np.arange(rows) * STEP
    omega = 2.0 * np.pi * np.array([0.3, 0.7, 1.3]) * rng.uniform(0.9, 1.1, 3)
    return np.sin(np.outer(t, omega) + rng.uniform(0.0, 6.0, 3)).sum(axis=1)


def slow(values: np.ndarray, rate: float) -> np.ndarray:
    """What a logger at 100 Hz reads of a converter at another rate [Hz]."""
    return values[
        np.floor(np.floor(np.arange(values.size) * STEP * rate) / rate / STEP).astype(int)
    ]


def stuck_swing(rng: np.random.Generator, step: float, rows: int = 1200) -> np.ndarray:
    """Angle of a drive under five sines of torque, which stops at many reversals."""
    t = np.arange(rows) * step
    waves = np.outer(t, 2.0 * np.pi * np.array([0.3, 0.7, 1.3, 2.1, 3.7])) + rng.uniform(0, 6, 5)
    angle, place, speed = np.empty(rows), 0.0, 0.0
    for k, torque in enumerate(2.7e-3 * np.sin(waves).sum(axis=1)):
        angle[k] = place
        place, speed = advance(SERVO, float(torque), step, place, speed)
    return np.round(angle / np.deg2rad(0.01)) * np.deg2rad(0.01)


@given(st.integers(0, 2**32 - 1), st.floats(20.0, 92.0))
@settings(max_examples=40)
def test_a_converter_slower_than_the_log_is_seen(seed: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    seen = slow(motion(rng) + 1e-4 * rng.standard_normal(2000), rate)
    assert rows_per_reading(seen) == pytest.approx(100.0 / rate, rel=0.1)


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-3, 1e-2, 0.1]), st.sampled_from([0.0, 0.05])
)
@settings(max_examples=60)
def test_a_coarse_or_noisy_motion_is_not(seed: int, step: float, noise: float) -> None:
    rng = np.random.default_rng(seed)
    values = motion(rng) + noise * rng.standard_normal(2000)
    assert rows_per_reading(np.round(values / step) * step if step else values) == 1.0


@pytest.mark.parametrize("every", [2, 3, 5])
@pytest.mark.parametrize("noise", [1e-3, 0.3])
def test_a_noisy_output_that_repeats_every_reading_is_seen(every: int, noise: float) -> None:
    """A position at half the rate of its log: mass 16 % off at 10 standard errors, PASS.

    Its noise goes to and fro, which levels that are set one by one do too.
    """
    rng = np.random.default_rng(every)
    values = motion(rng) + noise * rng.standard_normal(2000)
    assert rows_per_reading(np.repeat(values, every), led=True) == pytest.approx(every, rel=0.01)
    for step in (1e-3, 0.05):
        assert rows_per_reading(np.round(values / step) * step, led=True) == 1.0


@pytest.mark.parametrize("step", [0.01, 0.02, 0.04])
def test_rests_of_an_axis_that_sticks_are_not(step: float) -> None:
    """Rests of one or two rows at reversals were late readings: 3 of 3 right logs warned of."""
    for seed in range(4):
        swing = stuck_swing(np.random.default_rng(seed), step)
        assert rows_per_reading(swing, led=True) == 1.0
        assert rows_per_reading(slow(swing, 45.0), led=True) == pytest.approx(100.0 / 45.0, rel=0.2)


@pytest.mark.parametrize("clock", [1, 2, 5])
def test_levels_that_are_set_are_not(clock: int) -> None:
    rng = np.random.default_rng(7)
    assert rows_per_reading(np.repeat(rng.uniform(-1.0, 1.0, 400), clock)) == 1.0
    assert rows_per_reading(np.repeat(rng.integers(0, 2, 400).astype(float), clock)) == 1.0


def line_log(seed: int, rows: int = 600) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    t, u, y = np.arange(rows) * STEP, motion(rng, rows), np.zeros(rows)
    decay = np.exp(-STEP / 0.12)
    for k in range(1, rows):
        y[k] = decay * y[k - 1] + (1.0 - decay) * 0.5 * (u[k] + u[k - 1])
    return {"time [s]": t, "inlet [bar]": u, "outlet [bar]": y + 0.01 * rng.standard_normal(rows)}


def test_a_slow_inlet_is_named_in_the_fit() -> None:
    """Every reading twice: a dead time 65 % off at 50 standard errors, PASS."""
    log = line_log(0)
    assert "readings-repeated" not in {n.code for n in ff.fit("line", log).notices}
    found = ff.fit("line", {**log, "inlet [bar]": slow(log["inlet [bar]"], 50.0)})
    (said,) = (n.message for n in found.notices if n.code == "readings-repeated")
    assert "inlet" in said
    assert "every 2 rows (0.02 s)" in said
    assert found.verdict == "warn"


def test_readings_at_rest_are_not_repeated_ones() -> None:
    """Forty positions with five readings each, in the order in which they were taken."""
    place = np.repeat(np.linspace(0.0, 0.06, 40), 5)
    rng = np.random.default_rng(2)
    for noise in (0.0, 0.3):
        reading = np.round(1000.0 * place / 0.06 + noise * rng.standard_normal(place.size))
        log = {"time [s]": np.arange(200) * STEP, "reading": reading, "reference [m]": place}
        found = ff.fit("potentiometer", log)
        assert "readings-repeated" not in {n.code for n in found.notices}


def test_a_log_given_twice_is_refused() -> None:
    """Five times the same log made intervals that held 55 times in 100."""
    one, two = line_log(1), line_log(2)
    ff.fit("line", [one, two])
    with pytest.raises(LogError, match="hold the same rows"):
        ff.fit("line", [one, two, dict(one)])


def test_a_copy_in_other_digits_or_units_is_the_same_log() -> None:
    """Exported once more in kPa with three decimals, errors were too small by the root of two."""
    one = line_log(1)
    printed = {n: np.array([float(f"{x:.7g}") for x in v]) for n, v in one.items()}
    other = {n.replace("bar", "kPa"): np.round(100.0 * v, 3) for n, v in one.items()}
    other["time [s]"] = one["time [s]"]
    part = {n: v[200:] for n, v in other.items()}
    for copy in (printed, other, part):
        with pytest.raises(LogError, match="hold the same rows"):
            ff.fit("line", [one, copy])
        with pytest.raises(LogError, match="which are fitted"):
            ff.fit("line", one, validate=[copy])


def test_recordings_of_one_command_by_coarse_converters_are_no_copies() -> None:
    """A valve steps through the same levels, its pressure in codes as large as the noise."""
    logs = []
    for seed in (1, 2):
        rng, time = np.random.default_rng(seed), STEP * np.arange(600)
        command = np.repeat([0.0, 2.0, 4.0, 1.0, 3.0, 0.0], 100)
        lag = np.exp(-np.arange(600) * STEP / 0.1)
        outlet = 1e5 * command
        for decay in (lag[1], lag[2]):  # second order, held command
            outlet = (1.0 - decay) * np.convolve(outlet, decay ** np.arange(600))[:600]
        outlet = 2e3 * np.round((outlet + 1e3 * rng.standard_normal(600)) / 2e3)
        logs.append({"time [s]": time, "command [V]": command, "outlet [Pa]": outlet})
    ff.fit("valve", logs)


def test_rows_that_are_fitted_do_not_validate(tmp_path: Path) -> None:
    log = line_log(1)
    path = tmp_path / "log.csv"
    pd.DataFrame(log).to_csv(path, index=False)
    part = {n: v[300:] for n, v in log.items()}
    for fitted, judged in ((log, log), (log, part), (path, path), (path, [log])):
        with pytest.raises(LogError, match=r"holds rows.* which are fitted"):
            ff.fit("line", fitted, validate=judged)
    ff.fit("line", path, window=(None, 4.0), validate=path, validate_window=(4.0, None))


def test_logs_that_overlap_are_refused() -> None:
    whole = line_log(3, 900)
    first = {n: v[:600] for n, v in whole.items()}
    second = {n: v[400:] - (v[400] if n == "time [s]" else 0.0) for n, v in whole.items()}
    with pytest.raises(LogError, match="cut what they share"):
        ff.fit("line", [first, second])
    apart = {n: v[600:] for n, v in whole.items()}
    ff.fit("line", [first, apart])


def test_runs_of_one_log_that_are_copies_are_refused() -> None:
    log = line_log(4)
    pasted = {n: np.tile(v, 2) for n, v in log.items()}
    with pytest.raises(LogError, match=r"#1 and .*#2 hold the same rows"):
        ff.fit("line", pasted)


@pytest.mark.parametrize("timed", [True, False])
def test_rows_that_stand_twice_in_a_run_are_named(timed: bool) -> None:
    """Pasted below, static strokes counted twice: intervals too short by the root of two."""
    rng = np.random.default_rng(6)
    speed = np.repeat([0.02, 0.05, 0.1, 0.2, -0.02, -0.05, -0.1, -0.2], 15)
    speed = speed * (1.0 + 0.05 * rng.standard_normal(speed.size))
    force = 300.0 * speed + 15.0 * np.sign(speed) + rng.standard_normal(speed.size)
    whole = {"velocity [m/s]": speed, "force [N]": force}
    pasted = {n: np.insert(v, 70, v[10:70]) for n, v in whole.items()}
    if timed:
        pasted = {"time [s]": np.arange(180) * STEP, **pasted}
    found = ff.fit("cylinder-friction", pasted)
    (said,) = (n.message for n in found.notices if n.code == "rows-repeated")
    assert "rows 71 to 130 hold the same readings as rows 11 to 70" in said
    assert found.verdict != "pass"
    assert "rows-repeated" not in {n.code for n in ff.fit("cylinder-friction", whole).notices}


def test_lines_that_stand_twice_with_their_time_are_to_be_removed(tmp_path: Path) -> None:
    """Another sample time was the remedy, which stretches the time."""
    rng = np.random.default_rng(1)
    rows = [f"{0.01 * k:.2f},{a:.4f},{b:.4f}" for k, (a, b) in enumerate(rng.normal(size=(60, 2)))]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["time [s],command [V],outlet [Pa]", *rows[:21], *rows[20:]]) + "\n")
    with pytest.raises(ff.LogError, match="repeat the line before in every column") as refused:
        ff.fit("valve", log)
    assert "sample_time" not in str(refused.value)


def _motion(seed: int, rows: int = 1500) -> np.ndarray:
    """A smooth motion with noise of an analogue sensor, unit range."""
    rng = np.random.default_rng(seed)
    t = 0.01 * np.arange(rows)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = [np.sin(2.0 * np.pi * f * t + p) for f, p in zip((0.3, 0.9, 2.1), phases, strict=True)]
    return np.asarray(0.3 * sum(waves) + 3e-3 * rng.standard_normal(rows))


@pytest.mark.parametrize("apart", [2.0, 2.5, 3.0, 4.7, 10.0])
@pytest.mark.parametrize("code", [0.0, 2e-3])
def test_lines_between_readings_are_seen(apart: float, code: float) -> None:
    """Printed with five digits; the readings themselves may be codes of a converter."""
    motion = _motion(1)
    if code:
        motion = code * np.round(motion / code)
    at = np.arange(0.0, motion.size - 1.0, 1.0 / apart)
    drawn = np.round(np.interp(at, np.arange(motion.size), motion), 5)
    assert rows_of_a_line(drawn) == pytest.approx(apart, rel=0.15)


@given(st.integers(0, 10_000), st.sampled_from([0.0, 1e-5, 1e-3, 5e-3, 2e-2]))
@settings(max_examples=60, deadline=None)
def test_no_lines_are_seen_in_what_was_recorded(seed: int, code: float) -> None:
    motion = _motion(seed)
    assert rows_of_a_line(code * np.round(motion / code) if code else motion) == 0.0


@pytest.mark.parametrize("wave", ["triangle", "steps", "rest"])
def test_what_moves_in_lines_itself_is_not_computed(wave: str) -> None:
    t = np.arange(4000)
    values = {
        "triangle": np.abs(t % 400 - 200.0),
        "steps": np.repeat(np.random.default_rng(0).integers(0, 9, 40), 100).astype(float),
        "rest": np.zeros(4000),
    }[wave]
    assert rows_of_a_line(values) == 0.0


def test_an_output_in_lines_is_named_in_the_fit() -> None:
    """The valve's frequency was 0.5 % off, and only a term that is missing was named."""
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(-1.0, 1.0, 30), 50)
    t = 0.005 * np.arange(command.size)
    lag = 0.02
    outlet, level = np.empty(t.size), 0.0
    for k, u in enumerate(command):
        outlet[k] = level
        level = u + (level - u) * np.exp(-0.005 / lag)
    outlet += 1e-2 * rng.standard_normal(t.size)
    fine = np.arange(0.0, t[-1], 0.002)
    log = {
        "time": fine, "inlet [bar]": np.interp(fine, t, command),
        "outlet [bar]": np.interp(fine, t, outlet).round(5),
    }  # fmt: skip
    result = ff.fit("line", log)
    (found,) = [n for n in result.notices if n.code == "readings-interpolated"]
    assert "outlet" in found.message
    assert "2.5 rows apart" in found.message
