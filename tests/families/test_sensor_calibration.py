"""The curve of the potentiometer for other sensors: angles, pressures, forces."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError, UnitError
from fluidact_fit.experiment import FloatArray
from fluidact_fit.export import export
from fluidact_fit.families.potentiometer.rational_bezier import rational_bezier
from fluidact_fit.result import FitResult
from fluidact_fit.simulation import simulate_logs, to_csv

POINTS, WEIGHTS = np.array([-0.2, 0.25, 1.0]), np.array([1.0, 2.5, 0.8])
LOW, HIGH = 50.0, 950.0
# unit of the log, of the file, factor, what the code of a controller calls it
SENSORS = [
    ("deg", "rad", np.pi / 180.0, "angle"), ("bar", "Pa", 1e5, "pressure"),
    ("kN", "N", 1e3, "force"), ("N m", "N m", 1.0, "torque"), ("mm", "m", 1e-3, "position"),
    ("%", "1", 1e-2, "value"),
]  # fmt: skip


def readings(seed: int, full: float = 200.0, sigma: float = 0.002) -> dict[str, FloatArray]:
    """A sweep there and back over the whole range, with noise on the reference."""
    rng = np.random.default_rng(seed)
    t = np.r_[np.linspace(0.0, 1.0, 150), np.linspace(1.0, 0.0, 150)]
    y = rational_bezier(t, POINTS, WEIGHTS) + sigma * rng.standard_normal(t.size)
    return {"reading": LOW + (HIGH - LOW) * t, "reference": full * y}


def fit(seed: int, unit: str, **options: Any) -> FitResult:
    return ff.fit("potentiometer", readings(seed), units={"reference": unit}, degree="2", **options)


def deviations(result: FitResult, size: float) -> FloatArray:
    """Errors of control points and free weights, in standard errors."""
    p, w = result.parameters["control_points"], result.parameters["weights"]
    points = (np.array(p.value) - size * POINTS) / np.array(p.std_error)
    # intervals of weights are those of their logarithms
    logs = np.log(np.array(w.value) / WEIGHTS)[1:] / (np.array(w.std_error) / np.array(w.value))[1:]
    return np.concatenate((points, logs))


@pytest.mark.parametrize(("unit", "si", "factor", "name"), SENSORS)
def test_a_curve_in_any_quantity_is_recovered_and_says_its_unit(
    unit: str, si: str, factor: float, name: str, tmp_path: Path
) -> None:
    result = fit(1, unit)
    assert result.verdict == "pass"
    assert np.abs(deviations(result, 200.0 * factor)).max() < 4.0
    assert result.parameters["control_points"].unit == si
    assert result.derived["stroke"].unit == si
    assert result.document.fit.rmse.unit == si
    result.save(tmp_path / "sensor.yaml")
    block: Any = ff.load(tmp_path / "sensor.yaml")
    assert block.output.unit == si
    assert {r.name for r in block.routines()} == {name, "reading_at"}
    routine = next(r for r in block.routines() if r.name == name)
    assert routine.unit == si
    middle = block(500.0)
    assert middle == pytest.approx(
        200.0 * factor * float(rational_bezier(np.array(0.5), POINTS, WEIGHTS)), rel=5e-3
    )
    assert block.inverse(middle) == pytest.approx(500.0)
    if si != "1":
        with pytest.raises(ValueError, match=f"{si} is outside the calibrated range"):
            block.inverse(1e9)
    (run,) = simulate_logs(result.document, [ff.read_log(readings(2), units={"reference": unit})])
    assert to_csv(result.document, [run]).splitlines()[0].endswith(f"reference_simulated [{si}]")


def test_intervals_cover() -> None:
    """Of 30 repetitions with 5 numbers each, which hang together: 95 % give or take 6 %."""
    z = np.concatenate([deviations(fit(k, "deg"), 200.0 * np.pi / 180.0) for k in range(30)])
    assert 0.89 <= np.mean(np.abs(z) < 1.96) < 1.0
    assert 0.8 < z.std() < 1.2


def test_messages_speak_in_the_unit_of_the_log() -> None:
    data = readings(1)
    data["reference"][150:] += 4.0  # play of four degrees
    result = ff.fit("potentiometer", data, units={"reference": "deg"}, degree="2")
    (said,) = [n.message for n in result.notices if n.code == "directions-differ"]
    assert "differs by 3.9" in said
    assert " deg " in said


def test_without_a_unit_metres_are_assumed_and_noted() -> None:
    result = ff.fit("potentiometer", readings(1), degree="2")
    assert result.parameters["control_points"].unit == "m"
    assert "unit-assumed" in {n.code for n in result.notices}


def test_logs_of_different_quantities_are_refused() -> None:
    logs = [ff.read_log(readings(k), units={"reference": unit})
            for k, unit in enumerate(("deg", "bar"))]  # fmt: skip
    with pytest.raises((LogError, UnitError), match="a pressure"):
        ff.fit("potentiometer", logs)


def test_a_quantity_that_it_does_not_take_is_refused_with_those_it_does() -> None:
    with pytest.raises(UnitError, match="a length such as 'm', an angle such as 'rad', a pressure"):
        ff.fit("potentiometer", readings(1), units={"reference": "V"})


def test_a_file_of_another_quantity_is_refused() -> None:
    result = fit(1, "bar")
    with pytest.raises(UnitError, match="length"):
        simulate_logs(result.document, [ff.read_log(readings(2), units={"reference": "mm"})])


def test_points_of_a_turntable_in_any_order_do_not_begin_again() -> None:
    data = readings(1, full=290.0)
    order = np.random.default_rng(0).permutation(data["reading"].size)
    data = {name: values[order] for name, values in data.items()}
    result = ff.fit("potentiometer", data, units={"reference": "deg"}, degree="2")
    assert "angle-wraps" not in {n.code for n in result.notices}
    assert np.abs(deviations(result, 290.0 * np.pi / 180.0)).max() < 4.0


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("arithmetic", ["float32", "q15"])
def test_exported_code_passes_its_own_test(arithmetic: Any, tmp_path: Path) -> None:
    fit(1, "bar").save(tmp_path / "sensor.yaml")
    export([tmp_path / "sensor.yaml"], "c", tmp_path, arithmetic=arithmetic)
    sources = [str(p) for p in tmp_path.glob("*.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-o", str(tmp_path / "test")]
    subprocess.run(["gcc", *flags, *sources, "-lm"], check=True)
    assert subprocess.run([str(tmp_path / "test")], check=False).returncode == 0
    header = (tmp_path / "sensor.h").read_text(encoding="utf-8")
    assert "sensor_pressure" in header
