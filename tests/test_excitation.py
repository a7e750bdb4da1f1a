"""The next experiment: predictions against fits, limits, and what a design promises."""

from __future__ import annotations

import importlib.util
import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.errors import NotIdentifiedError, OutputError, UsageError
from fluidact_fit.estimation.information import cramer_rao, optimal_measure
from fluidact_fit.excitation import Design, design
from fluidact_fit.excitation.strokes import Strokes
from fluidact_fit.excitation.waveforms import Waveform, limit_slope, smooth_corners, to_segments
from fluidact_fit.families import get_family
from fluidact_fit.parameters import ParameterDocument, make_document

ROOT = Path(__file__).parents[1]


@cache
def fit_trial(family: str, trial: int = 0) -> ff.FitResult:
    """Fit one log of a dataset; its inputs are taken as exact, as a design takes them."""
    data = load_dataset(family)
    log = ff.read_log(data.logs[trial], columns=dict(data.columns))
    exact = {"line": {"inlet": 0.0}, "hydrostatic": {"force": 0.0}}.get(family)
    return ff.fit(family, log, noise=exact, **data.options)


def document_of(result: ff.FitResult) -> ParameterDocument:
    """The result's document as a reader would see it."""
    return make_document(result.document.to_dict(), get_family)


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short search, where what is asserted holds for any design and not for the best."""
    monkeypatch.setattr("fluidact_fit.excitation.command._LEADERS", 1)
    monkeypatch.setattr("fluidact_fit.excitation.command._TRIES", 40)


@pytest.fixture(scope="module")
def valve() -> ff.FitResult:
    """A fit of the valve."""
    return fit_trial("valve")


@pytest.fixture(scope="module")
def valve_design(valve: ff.FitResult) -> Design:
    """Its next experiment."""
    return design(document_of(valve))


@pytest.mark.parametrize("family", ["valve", "line", "hydrostatic"])
def test_information_predicts_the_standard_errors_of_a_fit(family: str) -> None:
    result = fit_trial(family)
    plant = result.solution.plant
    found = get_family(family).information(plant, result.experiments[0])
    assert found is not None
    names = [n for n in found.names if result.parameters[n].status == "estimated"]
    jacobian = found.jacobian[:, [found.names.index(n) for n in names]]
    sigma = result.document.fit.rmse.value
    errors = sigma * np.sqrt(np.diag(cramer_rao(jacobian.T @ jacobian)))
    stated = [result.parameters[n].std_error for n in names]
    np.testing.assert_allclose(errors, np.asarray(stated, dtype=float), rtol=0.02)


def test_static_levels_are_bracketed_as_in_a_fit() -> None:
    result = fit_trial("ball-screw", 1)
    plant = result.solution.plant
    found = get_family("ball-screw").information(plant, result.experiments[0])
    assert found is not None
    for name, width in found.floor.items():
        assert width == pytest.approx(result.parameters[name].std_error, rel=0.1)


def test_families_that_cannot_say_are_refused_with_the_reason() -> None:
    with pytest.raises(UsageError, match="cannot be designed"):
        design(document_of(fit_trial("spring-cylinder")))


def test_design_halves_the_worst_error(valve_design: Design) -> None:
    worst = max(valve_design.forecasts, key=lambda f: (f.present or 0.0) / abs(f.value))
    assert worst.ratio is not None
    assert worst.ratio < 0.5
    assert worst.predicted_ci95 is not None
    assert worst.predicted_ci95[0] < worst.value < worst.predicted_ci95[1]


def test_design_keeps_to_the_files_limits(valve: ff.FitResult, valve_design: Design) -> None:
    covered = valve.document.validity["command"]
    command = valve_design.signals["command"]
    assert covered.low - 1e-9 <= command.min() < command.max() <= covered.high + 1e-9
    assert command.size == valve_design.time.size == 1000
    assert np.allclose(np.diff(valve_design.time), 0.01)
    assert "amplitude" in valve_design.binding


def test_the_designed_experiment_delivers_what_was_predicted(
    valve: ff.FitResult, valve_design: Design, tmp_path: Path
) -> None:
    study = load_study()
    data = next(d for d in study.load_generator().DATASETS if d.family == "valve")
    rng = np.random.default_rng(5)
    columns = study.play_valve(study.load_generator(), valve_design, rng)
    again = study.fit_columns(data, columns, tmp_path)
    for name in ("natural_frequency", "damping_ratio"):
        measured = again.parameters[name].std_error
        assert measured == pytest.approx(valve_design.predicted[name], rel=0.2)
        truth = study.load_generator().scalar(data.truth, name)
        assert abs(again.parameters[name].value - truth) < 4.0 * measured


def load_study() -> Any:
    """``studies/design.py`` as a module."""
    name = "fluidact_studies_design"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ROOT / "studies" / "design.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@pytest.mark.usefixtures("hurried")
def test_same_seed_same_design(valve: ff.FitResult) -> None:
    first, again = (design(document_of(valve), duration=0.4, seed=3) for _ in range(2))
    assert first.to_csv() == again.to_csv()
    assert first.to_dict() == again.to_dict()


@pytest.mark.usefixtures("hurried")
def test_rate_and_stroke_are_kept() -> None:
    data = fit_trial("hydrostatic")
    found = design(document_of(data), rate=60.0, stroke=(0.0, 0.004), duration=1.0)
    slope = np.abs(np.diff(found.signals["force"])) / 0.01
    assert slope.max() <= 60.0 * (1.0 + 1e-9)
    run = data.experiments[0]
    signal = replace(
        run.signals["force"], time=found.time, values=found.signals["force"], hold="smooth"
    )
    played = replace(run, time=found.time, signals={"force": signal})
    (simulated,) = get_family("hydrostatic").simulate(data.solution.plant, [played])
    assert np.ptp(simulated.output) <= 0.004
    assert any("Start at position" in note for note in found.notes)


@pytest.mark.usefixtures("hurried")
def test_a_static_level_that_was_not_identified_becomes_so() -> None:
    result = fit_trial("ball-screw", 1)
    raw = document_of(result).to_dict()
    entry = raw["parameters"]["breakaway_positive"]
    entry.update(value=raw["parameters"]["coulomb_positive"]["value"], status="not_identified")
    for key in ("std_error", "ci95", "method"):
        entry.pop(key)
    del raw["covariance"]
    found = design(make_document(raw, get_family), duration=3.0)
    forecast = next(f for f in found.forecasts if f.name == "breakaway_positive")
    assert forecast.supposed
    assert forecast.present is None
    assert forecast.predicted is not None
    assert forecast.predicted < 0.02 * forecast.value
    assert forecast.value == pytest.approx(1.3 * 2.0e-3, rel=1e-3)
    assert any("breakaway_positive was not identified" in note for note in found.notes)


@pytest.fixture(scope="module")
def strokes() -> Design:
    """The next experiment after the second log of the cylinder."""
    return design(document_of(fit_trial("cylinder-friction", 1)), stroke=(0.0, 0.055))


def test_cylinder_friction_gets_strokes_at_constant_speeds(strokes: Design) -> None:
    velocity, position = strokes.signals["velocity"], strokes.signals["position"]
    assert velocity.min() < -0.12
    assert velocity.max() > 0.12
    assert 0.0 <= position.min() < position.max() <= 0.055
    assert np.abs(np.diff(position) - 0.005 * (velocity[1:] + velocity[:-1])).max() < 1e-12
    worst = max(f.predicted / f.value for f in strokes.forecasts if f.predicted)
    present = max(f.present / f.value for f in strokes.forecasts if f.present)
    assert worst < 0.75 * present


def test_strokes_predict_the_standard_errors_of_a_fit(strokes: Design, tmp_path: Path) -> None:
    v = strokes.signals["velocity"]
    drive = 45.0 * v + 2.4 * np.sign(v) + 0.14 * np.gradient(v, 0.01)
    found: dict[str, list[float]] = {}
    for seed in range(7):
        rng = np.random.default_rng(seed)
        force, noisy = drive + 0.1 * rng.normal(size=v.size), v + 1e-3 * rng.normal(size=v.size)
        path = tmp_path / f"{seed}.csv"
        table = np.column_stack((strokes.time, force, noisy))
        np.savetxt(path, table, delimiter=",", header="time,force,velocity", comments="")
        result = ff.fit("cylinder-friction", ff.read_log(path), mass=0.14)
        for name in strokes.predicted:
            found.setdefault(name, []).append(result.parameters[name].std_error)  # type: ignore[arg-type]
    for name, predicted in strokes.predicted.items():
        assert np.median(found[name]) == pytest.approx(predicted, rel=0.15)


@given(
    st.floats(0.004, 0.5), st.floats(0.004, 0.5), st.floats(0.5, 1.0), st.floats(0.05, 0.95),
    st.floats(0.2, 20.0), st.sampled_from([0.001, 0.01, 0.05]), st.floats(0.3, 20.0),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_strokes_keep_to_the_travel_and_to_the_rate(
    to: float, fro: float, part: float, share: float, duration: float, step: float, rate: float
) -> None:
    """Pairs with two speeds crept by what their turns lack, 38 % beyond the end of a stroke."""
    travel = 0.1
    most = min(0.9 * travel / 0.1, np.sqrt(0.9 * travel * rate))
    to, fro = min(to, most), min(fro, most)
    pairs = Strokes((part * to, part * fro), (to, fro), share)
    velocity = pairs.play(travel, duration, step, rate)
    place = step * (np.cumsum(velocity) - 0.5 * velocity)
    # a sample of a ramp more, where the sample time is coarse
    assert np.ptp(place) <= travel + step * max(to, fro)
    assert velocity.max() <= to * (1.0 + 1e-9)
    assert velocity.min() >= -fro * (1.0 + 1e-9)
    assert np.abs(np.diff(velocity)).max() <= rate * step * (1.0 + 1e-9)


def test_a_design_with_a_rate_stays_within_stroke_and_rate() -> None:
    found = design(
        document_of(fit_trial("cylinder-friction", 1)), stroke=(0.0, 0.055), rate=0.5,
        amplitude=(-0.02, 0.1),
    )  # fmt: skip
    velocity, position = found.signals["velocity"], found.signals["position"]
    assert 0.0 <= position.min() < position.max() <= 0.055
    assert np.abs(np.diff(velocity) / np.diff(found.time)).max() <= 0.5 * (1.0 + 1e-9)
    assert "rate" in found.binding


def test_a_parameter_that_may_be_zero_does_not_take_the_whole_experiment() -> None:
    """Of 1494 samples 1214 stood at rest for a leakage of 0.0014 ± 0.0015: all else got worse."""
    rng, rows = np.random.default_rng(1), np.arange(1500)
    command = 10.0 * np.sin(2.0 * np.pi * rows / 1500)
    opening = np.clip(np.abs(command), 0.0, 8.0) - 0.5
    flow = np.sign(command) * 1e-5 * np.maximum(opening, 0.0) + 1e-7 * rng.standard_normal(1500)
    fitted = ff.fit("flow-map", {"command [V]": command, "flow [m3/s]": flow})
    leakage = fitted.parameters["leakage"]
    assert abs(leakage.value) < 2.0 * leakage.std_error
    found = design(document_of(fitted))
    assert np.median([f.ratio for f in found.forecasts if f.ratio]) < 1.0


def test_strokes_say_what_no_speeds_could_better_and_how_long_halving_takes(
    strokes: Design,
) -> None:
    (line,) = [n for n in strokes.notes if "no speeds within the limits" in n]
    reached, least = (float(n) for n in re.findall(r"([0-9.]+) %", line))
    assert least < reached < 1.25 * least
    # a level is known no better than from half the samples (0.1 N of the force, 45 N s/m of
    # 1 mm/s of the velocity)
    assert least > 100.0 * np.hypot(0.1, 0.045) / np.sqrt(500.0) / 2.45
    (line,) = [n for n in strokes.notes if "--duration" in n]
    ratio, duration = (
        float(n) for n in re.findall(r"is ([0-9.]+) times.* take ([0-9.]+) s", line)[0]
    )
    assert duration == pytest.approx(10.0 * (ratio / 0.5) ** 2, rel=0.02)


def test_potentiometer_gets_positions_to_hold() -> None:
    found = design(document_of(fit_trial("potentiometer")), criterion="determinant")
    assert not found.time.size
    assert found.signals["samples"].sum() == pytest.approx(1000, abs=20)
    way = np.diff(found.signals["planned_reference"])
    up = np.flatnonzero(way > 0.0)
    assert up.tolist() == list(range(up.size)), "up first, and then back"
    assert np.all(way[up.size + 1 :] < 0.0)
    assert np.count_nonzero(way < 0.0) > 0.8 * up.size
    ratios = [f.ratio for f in found.forecasts if f.ratio is not None]
    assert np.mean(ratios) < 1.0


def test_save_refuses_to_overwrite(valve_design: Design, tmp_path: Path) -> None:
    path = valve_design.save(tmp_path / "next.csv")
    assert path.read_text(encoding="utf-8").startswith("time [s],command [V]\n0,")
    with pytest.raises(OutputError):
        valve_design.save(path)
    valve_design.save(path, overwrite=True)
    log = ff.read_log(path, columns={"time": "time [s]", "outlet": "command [V]"})
    assert log is not None


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"criterion": "mass"}, "names the criterion 'mass'"),
        ({"amplitude": (2.0, 1.0)}, "2.0 is not below 1.0"),
        ({"amplitude": ("1 V",)}, "amplitude=('1 V',) is not a pair of numbers"),
        ({"amplitude": "1 V"}, "amplitude='1 V' is not a pair of numbers"),
        ({"amplitude": ()}, "amplitude=() is not a pair of numbers"),
        ({"amplitude": (None, 1.0)}, "amplitude=(None, 1.0) is not a number"),
        ({"amplitude": (float("nan"), 1.0)}, "amplitude=(nan, 1.0) is not finite"),
        ({"stroke": 1.0}, "stroke=1.0 is not a pair of numbers"),
        ({"rate": (1.0, 2.0)}, "rate=(1.0, 2.0) is not a number"),
        ({"rate": True}, "rate=True is"),
        ({"duration": 0.05}, "samples"),
        ({"duration": float("nan")}, "duration=nan is not finite"),
        ({"duration": (1.0,)}, "duration=(1.0,) is not a number"),
        ({"sample_time": "1 mm"}, "unit 'mm' is a length"),
        ({"criterion": None}, "criterion=None is not text"),
        ({"seed": -1}, "seed=-1 is not a whole number from 0"),
        ({"progress": "x"}, "progress='x' is not a function"),
    ],
)
def test_impossible_wishes_are_refused(
    valve: ff.FitResult, limits: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=re.escape(message)):
        design(document_of(valve), **limits)


@pytest.mark.parametrize("document", [None, {"mass": 1.0}, ["valve.yaml"]])
def test_what_is_no_parameter_file_is_refused(document: Any) -> None:
    with pytest.raises(UsageError, match="is not a file name"):
        design(document)


def test_a_range_that_a_slow_sensor_cannot_cross_is_refused_at_once() -> None:
    """Corners rounded over as long as the crossing takes would be 1e20 samples."""
    line = document_of(fit_trial("line"))
    with pytest.raises(NotIdentifiedError, match="leaves its range"):
        design(line, duration=0.3, sample_time=0.01, amplitude=(0.0, 1e9), rate=1e-9)


def test_optimal_measure_of_a_line_is_its_two_ends() -> None:
    # D-optimal for a straight line on [-1, 1]: half of the samples at each end (textbook).
    x = np.linspace(-1.0, 1.0, 41)
    share = optimal_measure(np.column_stack((np.ones(41), x)), np.ones(2), "determinant")
    np.testing.assert_allclose(share[[0, -1]], 0.5, atol=1e-3)


def test_cramer_rao_is_infinite_where_nothing_is_known() -> None:
    bound = cramer_rao(np.array([[4.0, 0.0], [0.0, 0.0]]))
    assert bound[0, 0] == pytest.approx(0.25)
    assert np.isinf(bound[1, 1])


@pytest.mark.parametrize(
    "waveform",
    [
        Waveform("steps", {"hold": 0.1, "levels": 3.0}),
        Waveform("square", {"hold": 0.1, "last": 0.4}),
        Waveform("two sizes", {"hold": 0.2, "small": 0.1, "part": 0.4}),
        Waveform("rest and go", {"hold": 0.2, "pause": 0.1}),
        Waveform("chirp", {"first": 0.1, "last": 10.0, "log": 1.0}),
        Waveform("multisine", {"first": 0.1, "last": 10.0}),
        Waveform("triangle", {"period": 1.0}),
    ],
)
@pytest.mark.parametrize("duty", [1.0, 1.5])
def test_waveforms_stay_within_one(waveform: Waveform, duty: float) -> None:
    values = waveform.sample(500, 0.01, duty)
    assert values.shape == (500,)
    assert np.abs(values).max() <= 1.0 + 1e-12
    assert values.max() > 0.3
    assert values.min() < -0.3
    assert waveform.describe().startswith(waveform.shape)


def test_corners_and_slopes() -> None:
    jump = np.repeat([0.0, 1.0], 50)
    assert np.abs(np.diff(smooth_corners(jump, 8))).max() < 0.3
    assert smooth_corners(jump, 8)[-1] == pytest.approx(1.0)
    assert np.abs(np.diff(limit_slope(jump, 0.1))).max() <= 0.1 + 1e-12


def test_straight_pieces_are_those_of_the_shape() -> None:
    rng = np.random.default_rng(0)
    held = np.repeat(rng.uniform(-1.0, 1.0, 9), rng.integers(20, 60, 9))
    ramps = np.concatenate((held, np.linspace(-1.0, 1.0, 50), np.linspace(1.0, 0.0, 30)))
    pieces = to_segments(ramps, 40)
    assert pieces is not None
    assert np.abs(pieces.sample(ramps.size, 0.01) - ramps).max() < 0.05
    assert np.median(np.abs(pieces.sample(ramps.size, 0.01) - ramps)) < 1e-12
    assert to_segments(np.sin(np.arange(500.0)), 40) is None


def test_worst_criterion_reaches_the_least_largest_error() -> None:
    # friction of two directions over speed: a direct search over all shares is the yardstick
    speed = np.linspace(-0.1, 0.1, 21)
    rows = np.column_stack([(speed > 0.0) * 1.0, (speed < 0.0) * 1.0, speed])
    scales = np.array([10.0, 14.0, 300.0])

    def largest(share: npt.NDArray[np.float64]) -> float:
        x = rows * scales
        return float(np.max(np.diag(np.linalg.inv(x.T @ (share[:, None] * x)))))

    found = largest(optimal_measure(rows, scales, "worst"))
    direct = minimize(
        lambda logits: np.log(largest(np.exp(logits) / np.exp(logits).sum())),
        np.zeros(speed.size), method="SLSQP", bounds=[(-6.0, 6.0)] * speed.size,
    )  # fmt: skip
    # a norm of order eight of three numbers is at most 3 ** (1 / 8) times the largest
    assert found <= 3.0 ** (1.0 / 8.0) * np.exp(direct.fun)


def test_a_design_takes_units_and_says_what_the_command_line_prints() -> None:
    file = Path(__file__).parent / "golden" / "0.1.0" / "line.yaml"
    found = design(file, amplitude=("1 bar", "6 bar"), duration=2.0)
    assert found.limits.amplitude == (1e5, 6e5)
    assert design(file, amplitude=["1 bar", "6 bar"], duration=2.0).limits == found.limits
    assert repr(found.table()) in str(found)
    assert f"line: {found.description}" in str(found)
    assert "binding limits: " in str(found)
    with pytest.raises(UsageError, match="unit 'mm' is a length"):
        design(file, amplitude=("1 mm", "6 mm"))
