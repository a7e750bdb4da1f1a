"""Blocks that run from a parameter file alone."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fluidact_fit as ff
from fluidact_fit.block import Block
from fluidact_fit.errors import ParameterFileError, UsageError
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.families.transfer.block import TransferBlock

FAMILIES = ("line", "valve", "hydrostatic", "ball-screw")
AMPLITUDE = {"line": 4e5, "valve": 5.0, "hydrostatic": 12.0, "ball-screw": 6e-3}
relaxed = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
Writer = Callable[..., Path]

# most records here go beyond the range of the files, which has a test of its own
pytestmark = pytest.mark.filterwarnings("ignore::fluidact_fit.ExtrapolationWarning")


def loaded(path: Path) -> Any:
    return ff.load(path)


def record(samples: int, seed: int, hold: int = 7) -> np.ndarray:
    """A random staircase in -1 .. 1."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.0, 1.0, samples // hold + 1), hold)[:samples]


@pytest.mark.parametrize("family", FAMILIES)
@relaxed
@given(levels=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=60), first=st.floats(-1.0, 1.0))
def test_step_equals_exact_continuous_solution(
    write: Writer, family: str, levels: list[float], first: float
) -> None:
    block = loaded(write(family))
    u = AMPLITUDE[family] * np.array([first, *levels])
    y = block.simulate(u, np.arange(u.size) * block.sample_time)
    if family == "ball-screw":
        block.reset()
    else:
        block.reset(input=float(u[0]))
    stepped = np.array([block.step(v) for v in u.tolist()])
    scale = max(float(np.abs(y).max()), 1e-9)
    np.testing.assert_allclose(stepped, y, rtol=1e-9, atol=1e-9 * scale)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("period", [1e-4, 3.3e-3, 0.05])
def test_any_period_gives_the_same_motion(write: Writer, family: str, period: float) -> None:
    block = loaded(write(family)).with_sample_time(period)
    u = AMPLITUDE[family] * record(400, 3)
    y = block.simulate(u, np.arange(u.size) * period)
    assert block.sample_time == period
    np.testing.assert_allclose(block.simulate(u), y, rtol=1e-6, atol=1e-8 * np.abs(y).max())


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("hold", ["zoh", "foh", "smooth"])
def test_simulate_is_the_model_that_was_fitted(write: Writer, family: str, hold: Any) -> None:
    block = loaded(write(family))
    chosen = get_family(family)
    # uneven, but no step looks as if rows had been lost, which a log may have and a command not
    time = (np.arange(300) + np.random.default_rng(0).uniform(-0.3, 0.3, 300)) * (4.0 / 300)
    time -= time[0]
    t = np.linspace(0.0, 1.0, 300)
    u = AMPLITUDE[family] * np.sin(11.0 * t) * (1.0 - np.exp(-5.0 * t))
    role = block.input
    signal = Signal(role.role, time, u, role.unit, hold, before=float(u[0]))
    e = Experiment("e", 0, time, {role.role: signal}, 0.01, False)
    (found,) = chosen.simulate(block.document.plant(chosen), [e])
    want = found.output
    got = block.simulate(u, time, hold=hold)
    np.testing.assert_allclose(got, want, rtol=1e-8, atol=1e-9 * np.abs(want).max())


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"viscous": 0.0},
        {"breakaway_positive": 2.0e-3, "breakaway_negative": 1.6e-3},
        {"coulomb_positive": 0.0, "coulomb_negative": 0.0,
         "breakaway_positive": 0.0, "breakaway_negative": 0.0},
    ],
)  # fmt: skip
def test_drive_steps_exactly_with_any_friction(write: Writer, values: dict[str, float]) -> None:
    block = loaded(write("ball-screw", values))
    u = 6e-3 * record(3000, 5, hold=3)
    y = block.simulate(u, np.arange(u.size) * 0.01)
    stepped = np.array([block.step(v) for v in u.tolist()])
    np.testing.assert_allclose(stepped, y, rtol=1e-8, atol=1e-9 * np.abs(y).max())


def test_drive_rests_within_the_static_levels_and_leaves_them(write: Writer) -> None:
    block = loaded(write("ball-screw"))
    for _ in range(5):
        assert block.step(2.8e-3) == 0.0
    block.step(3.0e-3)
    assert block.velocity > 0.0
    assert block.step(0.0) > 0.0
    while block.velocity > 0.0:
        block.step(0.0)
    at = block.position
    block.step(-1.8e-3)
    assert block.position == at
    block.step(-2.0e-3)
    assert block.position < at


def test_friction_and_feedforward(write: Writer) -> None:
    block = loaded(write("ball-screw"))
    assert type(block).__name__ == "DriveBlock"
    assert block.friction(10.0) == pytest.approx(2.0e-3 + 2.0e-4)
    assert block.friction(-10.0) == pytest.approx(-1.6e-3 - 2.0e-4)
    assert block.friction(0.0, 1.0e-3) == 1.0e-3
    assert block.friction(0.0, 1.0) == 2.9e-3
    assert block.friction(0.0, -1.0) == -1.9e-3
    assert block.feedforward(0.0) == 0.0
    assert block.feedforward(0.0, 100.0) == pytest.approx(2.0e-3 + 1.171e-4)
    assert block.feedforward(0.1, band=0.2) == pytest.approx(1.0e-3 + 2.0e-6)
    # feed-forward of a constant speed keeps that speed
    block.reset(velocity=10.0)
    block.step(block.feedforward(10.0))
    assert block.velocity == pytest.approx(10.0)


def test_dead_zone_and_its_inverse_do_nothing(write: Writer) -> None:
    block = loaded(write("hydrostatic"))
    assert isinstance(block, TransferBlock)
    assert block.dead_zone == (-3.0, 1.2)
    for force in (-4.0, -1e-9, 0.0, 1e-9, 7.5):
        assert block.actuate(block.dead_zone_inverse(force)) == pytest.approx(force, abs=1e-15)
    assert block.actuate(0.7) == 0.0
    assert block.dead_zone_inverse(0.5, band=1.0) == pytest.approx(0.5 + 0.6)
    assert block.dead_zone_inverse(-0.5, band=1.0) == pytest.approx(-0.5 - 1.5)


def test_reset_starts_at_rest(write: Writer) -> None:
    block = loaded(write("line"))
    block.reset(input=2.0e5)
    assert [block.step(2.0e5) for _ in range(20)] == pytest.approx([1.8e5] * 20)
    block.reset(input=2.0e5, output=1.0e5)
    assert [block.step(2.0e5) for _ in range(20)] == pytest.approx([1.0e5] * 20)
    piston = loaded(write("hydrostatic"))
    piston.reset(output=0.3)
    assert [piston.step(1.0) for _ in range(20)] == pytest.approx([0.3] * 20)


def test_simulate_leaves_the_state_of_step_alone(write: Writer) -> None:
    block = loaded(write("valve"))
    block.step(1.0)
    twin = loaded(write("valve"))
    twin.step(1.0)
    block.simulate(np.ones(50))
    assert block.step(1.0) == twin.step(1.0)


def test_transfer_function(write: Writer) -> None:
    block = loaded(write("valve"))
    assert isinstance(block, TransferBlock)
    tf = block.transfer_function()
    assert tf.denominator == pytest.approx((1.0, 28.0, 400.0))
    assert tf.gain == pytest.approx(1.5e5)
    assert loaded(write("hydrostatic")).transfer_function().gain is None
    num, den = block.difference_equation()
    assert sum(num) / sum(den) == pytest.approx(1.5e5)


@pytest.mark.parametrize("family", FAMILIES)
def test_validity_flags_extrapolation(write: Writer, family: str) -> None:
    block = loaded(write(family))
    assert isinstance(block, Block)
    role = block.input.role
    assert block.validity[role].low == -1.0
    assert not block.outside(role, 2.0)
    assert block.outside(role, 2.1)
    assert block.outside(role, float("nan"))
    with pytest.raises(UsageError, match="no range of 'heat'"):
        block.outside("heat", 1.0)
    assert role in repr(block)


def test_without_discrete_model_the_period_is_asked_for(write: Writer) -> None:
    for family in FAMILIES:
        block = loaded(write(family, sample_time=0.0))
        assert block.sample_time == 0.0
        with pytest.raises(UsageError, match="with_sample_time"):
            block.step(0.0)
        assert block.with_sample_time(0.01).step(0.0) == 0.0
        with pytest.raises(UsageError):
            block.with_sample_time(-1.0)


@pytest.mark.parametrize(
    ("old", "new", "path"),
    [
        ("numerator:", "numerators:", "model"),
        ("value: 53.7", "value: 60.0", "model.continuous"),
        ("dead_zone_positive: 1.2,", "dead_zone_positive: -1.0,", "model.input_nonlinearity"),
        ("sample_time: 0.01", "sample_time: -0.01", "model.discrete.sample_time"),
        ("sample_time: 0.01", "sample_time: 0.02", "model.discrete"),
        ("slope: 1.0", "slope: 2.0", "slope"),
        ("dead_time: 0.0", "dead_time: soon", "model.continuous.dead_time"),
        ("continuous:", "konti:", "model.continuous"),
        ("family: hydrostatic", "family: hydrosta", "family"),
        ("format_version: 1", "format_version: 99", "format_version"),
        ("parameters:", "parameters: {", ""),
    ],
)
def test_damaged_files_are_refused(write: Writer, old: str, new: str, path: str) -> None:
    file = write("hydrostatic")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(ParameterFileError) as caught:
        ff.load(file)
    assert any(path in where for where, _ in caught.value.problems), caught.value.problems
    assert str(file) in str(caught.value)


def test_missing_and_truncated_files_are_refused(write: Writer, tmp_path: Path) -> None:
    with pytest.raises(ParameterFileError):
        ff.load(tmp_path / "none.yaml")
    file = write("line")
    file.write_text(file.read_text()[:150])
    with pytest.raises(ParameterFileError):
        ff.load(file)


@pytest.mark.parametrize(
    ("values", "time"),
    [([1.0, 2.0], [0.0]), ([1.0, np.nan], [0.0, 1.0]), ([1.0, 2.0], [1.0, 1.0]), ([], [])],
)
def test_records_that_make_no_sense_are_refused(write: Writer, values: Any, time: Any) -> None:
    for family in FAMILIES:
        with pytest.raises(UsageError):
            loaded(write(family)).simulate(values, time)
    with pytest.raises(UsageError, match="hold"):
        loaded(write("line")).simulate([0.0, 1.0], [0.0, 1.0], hold="sideways")


def test_fit_save_load_simulate(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    time = np.arange(600) * 0.01
    u = record(600, 4, hold=40)
    u[:10] = 0.0
    truth = np.zeros(600)
    for k in range(1, 600):  # 1/(0.1 s + 1), held input
        truth[k] = truth[k - 1] + (1.0 - np.exp(-0.1)) * (u[k - 1] - truth[k - 1])
    log = tmp_path / "line.csv"
    y = truth + 1e-3 * rng.standard_normal(600)
    lines = [f"{a!r},{b!r},{c!r}" for a, b, c in zip(time.tolist(), u.tolist(), y.tolist())]
    log.write_text("\n".join(["time,inlet,outlet", *lines]) + "\n")
    result = ff.fit("line", [log], hold={"inlet": "zoh"})
    block = loaded(result.save(tmp_path / "line.yaml"))
    simulated = block.simulate(u, time)
    # a log's offset and initial state are its own and not in the file
    rest = result.fitted[0].simulated - simulated
    tau = block.parameters["time_constant"]
    own = np.column_stack((np.ones(600), np.exp(-time / tau)))
    rest -= own @ np.linalg.lstsq(own, rest, rcond=None)[0]
    assert np.abs(rest).max() < 1e-9
    stepped = block.simulate(u)
    np.testing.assert_allclose(stepped, simulated, atol=1e-10)
    assert not block.outside("inlet", float(u[50]))


def test_load_imports_no_plotting(write: Writer) -> None:
    import subprocess

    code = (
        "import sys, fluidact_fit as ff; b = ff.load(sys.argv[1]); b.step(1.0); "
        "print([m for m in ('matplotlib', 'pandas', 'casadi') if m in sys.modules])"
    )
    out = subprocess.run(
        [sys.executable, "-c", code, str(write("line"))],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert out.stdout.strip() == "[]"


def test_a_drive_holds_its_torque_over_steps_of_any_length() -> None:
    """A long step among short ones is a long step: nothing was lost."""
    golden = Path(__file__).parents[1] / "golden" / "0.1.0" / "ball-screw.yaml"
    block: Any = ff.load(golden).with_sample_time(0.001)
    rng = np.random.default_rng(3)
    counts = rng.choice([1, 1, 1, 3], 60)
    torque = rng.uniform(-0.006, 0.006, 60)
    time = 0.001 * np.concatenate(([0.0], np.cumsum(counts)[:-1]))
    stepped = np.array([block.step(u) for u in np.repeat(torque, counts).tolist()])
    places = np.concatenate(([0], np.cumsum(counts)[:-1]))
    found = block.simulate(torque, time)
    np.testing.assert_allclose(found, stepped[places], atol=1e-9 * np.ptp(stepped))
