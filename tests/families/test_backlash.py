"""Backlash: the play operator, intervals that hold the truth, refusals, noise, right inverse."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fluidact_fit as ff
from fluidact_fit.control import make_block
from fluidact_fit.errors import NotIdentifiedError, UsageError
from fluidact_fit.experiment import FloatArray
from fluidact_fit.families.backlash import BacklashBlock, PlayModel, follow
from fluidact_fit.result import FitResult

RATIO, PLAY, NOISE = 0.8, 2e-3, 2e-5
Log = dict[str, FloatArray]


def by_hand(u: FloatArray, play: float, begins: float = 0.0) -> FloatArray:
    """The load of every sample, one after the other; it begins at a share of the half play."""
    at, out = float(u[0]) + 0.5 * play * begins, []
    for value in u.tolist():
        if value - at > 0.5 * play:
            at = value - 0.5 * play
        if at - value > 0.5 * play:
            at = value + 0.5 * play
        out.append(at)
    return np.array(out)


def stroke(
    seed: int = 0, n: int = 700, play: float = PLAY, ratio: float = RATIO, size: float = 0.02,
    drive_noise: float = 0.0, noise: float = NOISE, late: int = 0, spring: float = 0.0,
) -> Log:  # fmt: skip
    """Two sines; ``late`` samples of the load, ``spring`` the share of the play that it follows."""
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(n)
    turn = 2.0 * np.pi * t / 5.0 + rng.uniform(0.0, 6.0)
    x = size * (np.sin(turn) + 0.3 * np.sin(2.7 * turn))
    y = by_hand(ratio * x, play, rng.uniform(-1.0, 1.0))
    y += spring * (ratio * x - y)
    y = np.concatenate((np.full(late, y[0]), y[: n - late]))
    return {
        "time": t, "drive": x + drive_noise * rng.standard_normal(n),
        "load": y + 3e-3 + noise * rng.standard_normal(n),
    }  # fmt: skip


def codes(result: FitResult) -> set[str]:
    return {w.code for w in result.document.warnings} - {"unit-assumed"}


@cache
def any_block() -> BacklashBlock:
    """A loaded block."""
    block = make_block(ff.fit("backlash", stroke()).document)
    assert isinstance(block, BacklashBlock)
    return block


places = st.lists(st.integers(-20, 20), min_size=1, max_size=60)


@given(places, st.integers(0, 12), st.sampled_from([-1, 1]))
@settings(deadline=None, max_examples=100)
def test_a_path_is_that_of_the_play_taken_step_by_step(
    drive: list[int], play: int, way: int
) -> None:
    """Whole numbers: exact; a drive read as numbers of a converter among them."""
    x = np.array(drive, dtype=float)
    found = follow(x, way, float(play))
    np.testing.assert_array_equal(found.path, by_hand(way * x, float(play)))


@given(places, st.integers(1, 12), st.floats(-1.0, 1.0))
@settings(deadline=None, max_examples=100)
def test_a_recorded_load_is_followed_wherever_it_began(
    drive: list[int], play: int, begins: float
) -> None:
    x = np.array(drive, dtype=float)
    load = by_hand(x, float(play), begins)
    found = follow(x, 1.0, float(play), load)
    rest = (load - found.path)[found.begins :]
    np.testing.assert_allclose(rest, rest[:1].repeat(rest.size), atol=1e-9)
    assert np.ptp(np.append(load[: found.begins], load[0])) < 1e-9


def test_the_derivatives_are_those_of_the_path() -> None:
    log = stroke(4, noise=0.0)
    model = PlayModel([log["drive"]], [log["load"]], [None])
    at, names = {"ratio": 0.81, "play": 2.1e-3}, ("ratio", "play")
    _, slopes = model.slopes(0, at, names)
    for row, name in zip(slopes, names):
        step = 1e-7 * at[name]
        ends = [model.columns(0, {**at, name: at[name] + s * step}).known for s in (1.0, -1.0)]
        found = (ends[0] - ends[1]) / (2.0 * step)
        # a sample that changes its side within the step is none of the derivative
        assert np.mean(np.abs(found - row) > 1e-6 * np.abs(row).max()) < 0.01


def test_intervals_hold_the_truth_and_errors_are_as_small_as_they_can_be() -> None:
    """Every sample tells its side: ``4 s^2 / n`` is the least variance of the width."""
    scores = []
    for seed in range(12):
        result = ff.fit("backlash", [stroke(2 * seed), stroke(2 * seed + 1)])
        assert result.verdict == "pass", codes(result)
        p = result.parameters
        least = 2.0 * NOISE / np.sqrt(1400.0)
        assert 0.99 * least < p["play"].std_error < 1.3 * least
        for name, truth in (("play", PLAY), ("ratio", RATIO)):
            scores.append((p[name].number - truth) / p[name].std_error)
    # of 24 scores: a root mean square within four of its standard errors, none beyond 4
    assert 0.42 < np.sqrt(np.mean(np.square(scores))) < 1.58
    assert np.abs(scores).max() < 4.0


def test_a_load_that_is_geared_backwards_is_as_good() -> None:
    result = ff.fit("backlash", stroke(ratio=-25.0, play=0.05, noise=5e-4))
    p = result.parameters
    assert abs(p["ratio"].number + 25.0) < 4.0 * p["ratio"].std_error
    assert abs(p["play"].number - 0.05) < 4.0 * p["play"].std_error
    lost = result.document.derived["lost_motion"]
    assert lost.value == pytest.approx(p["play"].number / 25.0, rel=1e-3)


def test_without_play_the_interval_begins_at_zero() -> None:
    result = ff.fit("backlash", stroke(play=0.0))
    low, high = result.parameters["play"].ci95
    assert low == 0.0 < high < 3.0 * NOISE
    assert result.verdict == "pass"


@pytest.mark.parametrize("given", [{"ratio": RATIO}, {"play": PLAY}])
def test_a_given_value_is_kept_and_the_other_found(given: dict[str, float]) -> None:
    p = ff.fit("backlash", stroke(), fixed=given).parameters
    ((known, value),) = given.items()
    assert (p[known].status, p[known].number) == ("fixed", value)
    other = next(n for n in p if n != known)
    truth = {"ratio": RATIO, "play": PLAY}[other]
    assert abs(p[other].number - truth) < 4.0 * p[other].std_error


def test_both_may_be_given_and_a_ratio_of_zero_may_not() -> None:
    both = {"ratio": RATIO, "play": PLAY}
    assert ff.fit("backlash", stroke(), fixed=both).verdict == "pass"
    with pytest.raises(NotIdentifiedError, match="ratio of 0"):
        ff.fit("backlash", stroke(), fixed={"ratio": 0.0})


@pytest.mark.parametrize(
    ("spoil", "name", "said"),
    [
        (lambda log: {**log, "load": 0.0 * log["time"]}, "ratio", "rests in every log"),
        (lambda log: {**log, "drive": 0.0 * log["time"]}, "ratio", "rests in every log"),
        (lambda log: stroke(play=0.045), "play", "turns back by"),
        (lambda log: {k: v[:60] for k, v in stroke(5).items()}, "play", ""),
    ],
)
def test_what_the_logs_cannot_tell_is_refused(
    spoil: Callable[[Log], Log], name: str, said: str
) -> None:
    with pytest.raises(NotIdentifiedError, match=f"cannot determine {name}.*{said}"):
        ff.fit("backlash", spoil(stroke()))


def test_reversals_just_short_of_the_play_are_refused() -> None:
    log = stroke()
    t = log["time"]
    x = 2e-3 * t + 1.2e-3 * np.sin(8.0 * t)  # back by less than the lost motion of 2.5 mm
    y = by_hand(RATIO * x, PLAY) + NOISE * np.random.default_rng(2).standard_normal(t.size)
    with pytest.raises(NotIdentifiedError, match="play"):
        ff.fit("backlash", {"time": t, "drive": x, "load": y})


@pytest.mark.parametrize("drive_noise", [2e-6, 2e-5, 6e-5])
def test_noise_of_the_drive_is_in_the_interval_or_is_warned_of(drive_noise: float) -> None:
    """A slow drive with noise looks like 2 to 3 standard deviations more play."""
    for seed in range(5):
        result = ff.fit("backlash", [stroke(seed, drive_noise=drive_noise)])
        p = result.parameters["play"]
        off = abs(p.number - PLAY) / p.std_error
        assert off < 3.5 or codes(result) & {"input-noise-left", "unmodelled-response"}


def test_noise_of_the_drive_that_widens_the_play_is_warned_of() -> None:
    result = ff.fit("backlash", [stroke(1, drive_noise=2e-4)])
    assert "input-noise-left" in codes(result)
    assert result.parameters["play"].number > 1.03 * PLAY


def test_the_interval_allows_for_noise_of_a_drive_that_rests_between_steps() -> None:
    """The load follows the largest noise of every rest: the play comes out too wide."""
    rng, log = np.random.default_rng(3), stroke(3, n=1600)
    x = np.repeat(log["drive"][::16], 16)
    log["load"] = by_hand(RATIO * x, PLAY) + NOISE * rng.standard_normal(x.size)
    log["drive"] = x + NOISE * rng.standard_normal(x.size)
    found = ff.fit("backlash", log)
    assert "input-noise-left" in codes(found)
    play = found.parameters["play"]
    assert abs(play.number - PLAY) < 4.0 * float(play.std_error or 0.0)


def test_codes_of_the_drive_widen_the_interval_of_the_play() -> None:
    """Each reversal is known no better than the drive was read there."""
    log, step = stroke(), 2e-4
    coded = {**log, "drive": np.round(log["drive"] / step) * step}
    exact, found = (ff.fit("backlash", [x]).parameters["play"] for x in (log, coded))
    assert found.std_error > 3.0 * exact.std_error
    assert abs(found.number - PLAY) < 3.5 * found.std_error


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        ({"late": 1}, "unmodelled-response"),
        ({"late": 6}, "unmodelled-response"),
        ({"spring": 0.1}, "unmodelled-response"),
    ],
)
def test_what_looks_like_play_is_said(fault: dict[str, Any], code: str) -> None:
    result = ff.fit("backlash", [stroke(1, **fault), stroke(2, **fault)])
    assert code in codes(result)


def test_a_load_that_is_a_row_late_is_said_without_a_time() -> None:
    log = stroke(1, late=1, noise=2e-5)
    said = ff.fit("backlash", {n: log[n] for n in ("drive", "load")})
    assert "unmodelled-response" in codes(said)
    assert any("rows" in n.message for n in said.notices if n.code == "unmodelled-response")
    right = stroke(1, noise=2e-5)
    assert not codes(ff.fit("backlash", {n: right[n] for n in ("drive", "load")}))


@pytest.mark.parametrize("drive_noise", [5e-6, 2e-5, 1e-4])
def test_noise_of_the_drive_is_no_feedback(drive_noise: float) -> None:
    """It pushes the load in the model, not in the machine: the residual leads its reading."""
    for seed in range(4):
        found = ff.fit("backlash", [stroke(seed, drive_noise=drive_noise)])
        assert "closed-loop" not in codes(found)


def recorded_strokes(seed: int, *, triangle: bool, noise: float, late: int = 0) -> Log:
    """Strokes that the load follows in steps of 1 ms, 20 of them a row: they turn between rows."""
    rng, t = np.random.default_rng(seed), 1e-3 * np.arange(20 * 700)
    phase = t / 7.13 + rng.uniform()
    x = 6e-3 * (4.0 * np.abs(phase % 1.0 - 0.5) - 1.0)
    if not triangle:
        x = 4e-3 * np.sin(6.28 * phase) + 3e-3 * np.sin(31.0 * phase)
    y = by_hand(40.0 * x, 0.0105) + 0.01
    x, y = x[::20], y[::20]
    y = np.concatenate((np.full(late, y[0]), y[: y.size - late]))
    return {"time": t[::20], "drive": x, "load": y + noise * rng.standard_normal(x.size)}


@pytest.mark.parametrize(("triangle", "noise"), [(True, 5e-4), (False, 1e-4)])
def test_a_turn_between_two_rows_is_no_lag(triangle: bool, noise: float) -> None:
    """The load goes as far as the drive went: a lag of 13 ms was said to make a third of play."""
    logs = [recorded_strokes(seed, triangle=triangle, noise=noise) for seed in (1, 2)]
    result = ff.fit("backlash", logs)
    assert result.verdict == "pass", result.notices
    assert (result.document.options or {})["turns"] == "between"
    for name, truth in (("play", 0.0105), ("ratio", 40.0)):
        q = result.parameters[name]
        assert abs(q.number - truth) < 4.0 * float(q.std_error or 0.0), name


def test_a_turn_is_found_between_rows_at_uneven_instants() -> None:
    """The instants are known: what differs from row to row is no noise of the drive."""
    rng, t = np.random.default_rng(4), 1e-3 * np.arange(20 * 500)
    x = 0.05 * (4.0 * np.abs((t / 2.71 + 0.3) % 1.0 - 0.5) - 1.0)
    rows = np.arange(0, t.size - 7, 20) + rng.integers(0, 7, 500)
    load = by_hand(0.5 * x, 2e-3)[rows] + 5e-6 * rng.standard_normal(500)
    result = ff.fit("backlash", {"time": t[rows], "drive": x[rows], "load": load})
    assert codes(result) <= {"uneven-sampling"}
    play = result.parameters["play"]
    assert abs(play.number - 2e-3) < 4.0 * float(play.std_error or 0.0)


def test_a_late_load_is_said_where_the_drive_turns_between_two_rows() -> None:
    late = recorded_strokes(3, triangle=True, noise=5e-4, late=1)
    assert "unmodelled-response" in codes(ff.fit("backlash", late))


def test_a_drive_that_turned_at_a_row_goes_no_farther() -> None:
    """Straight lines from row to row, as a sequence of set points: the load tells."""
    log = {name: values[::10] for name, values in stroke(5).items()}
    noise = 1e-5 * np.random.default_rng(1).standard_normal(log["drive"].size)
    log["load"] = by_hand(RATIO * log["drive"], PLAY) + noise
    result = ff.fit("backlash", log)
    assert (result.document.options or {})["turns"] == "row"
    assert result.verdict == "pass", result.notices


def test_the_offset_is_that_of_the_logs_and_may_be_given() -> None:
    logs = [stroke(1), stroke(2)]
    offset = ff.fit("backlash", logs).parameters["offset"]
    assert abs(offset.number - 3e-3) < 4.0 * offset.std_error
    assert offset.std_error < 2.0 * NOISE / np.sqrt(1400) + 1e-5
    given = ff.fit("backlash", logs, fixed={"offset": 3e-3})
    assert given.parameters["offset"].status == "fixed"
    assert given.verdict == "pass"
    off = ff.fit("backlash", logs, fixed={"offset": 4e-3})
    assert off.document.fit.rmse.value > 5.0 * given.document.fit.rmse.value
    with pytest.raises(UsageError, match="has no bounds"):
        ff.fit("backlash", logs, bounds={"offset": (0.0, 1.0)})
    with pytest.raises(UsageError, match="not searched for"):  # it was ignored
        ff.fit("backlash", logs, start={"offset": 0.0})


def test_drive_and_load_taken_for_each_other_are_refused() -> None:
    log = stroke(drive_noise=NOISE)
    swapped = {**log, "drive": log["load"], "load": log["drive"]}
    with pytest.raises(NotIdentifiedError, match="columns swapped"):
        ff.fit("backlash", swapped)


@given(st.lists(st.floats(-0.02, 0.02), min_size=2, max_size=50))
@settings(deadline=None, max_examples=60)
def test_the_right_inverse_takes_the_load_where_it_is_wanted(wanted: list[float]) -> None:
    block = any_block()
    block.reset()
    block.step(block.drive_for(wanted[0]))
    for y in wanted[1:]:
        before = block._side
        x = block.drive_for(y)
        load = block.step(x)
        if block._side or before:
            assert load == pytest.approx(y, abs=1e-12)


def test_a_block_on_a_known_side_is_its_own_inverse() -> None:
    block, x = any_block(), np.linspace(-0.02, 0.02, 9)
    for side in (-1.0, 0.0, 1.0):
        np.testing.assert_allclose(block.inverse(block(x, side), side), x, atol=1e-12)
    up, down = float(block(0.01, 1.0)), float(block(0.01, -1.0))
    assert down - up == pytest.approx(block.numbers()["play"])
