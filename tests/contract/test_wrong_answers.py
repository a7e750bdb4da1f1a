"""Answers that once were wrong, each in the words of a user: they stay right."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff

Change = Callable[[np.ndarray], np.ndarray]


def change_column(header: str, change: Change) -> Callable[[Path, Path], Path]:
    """A way to copy the first rows of a log with one column changed."""

    def copy_log(log: Path, path: Path) -> Path:
        head, *lines = log.read_text(encoding="utf-8").splitlines()[:501]
        mark, point = (";", ",") if ";" in head else (",", ".")
        at, rows = head.split(mark).index(header), [line.split(mark) for line in lines]
        values = change(np.array([float(row[at].replace(point, ".")) for row in rows]))
        for row, value in zip(rows, values):
            row[at] = f"{value:.5f}".replace(".", point)
        path.write_text("\n".join([head, *map(mark.join, rows)]) + "\n", encoding="utf-8")
        return path

    return copy_log


def add_noise(share: float) -> Change:
    """Noise of a share of the range; another one for every log."""
    rng = np.random.default_rng(20260)
    return lambda values: values + share * np.ptp(values) * rng.normal(size=values.size)


def fit_file(trial: Any, here: Callable[..., Any]) -> Any:
    done = here(*trial.command(trial.path))
    assert done.status == 0, done.err
    return trial


def simulated_rmse(trial: Any) -> float:
    """RMSE over all logs of what the parameters in the file give."""
    from fluidact_fit.simulation import simulate_logs

    runs = simulate_logs(trial.document, trial.read())
    rest = np.concatenate([r.measured - r.simulated for r in runs])
    return float(np.sqrt(np.nanmean(rest**2)))


def test_friction_of_the_readme_fits_its_own_logs(
    dataset: Callable[..., Any], here: Callable[..., Any]
) -> None:
    trial = fit_file(dataset("cylinder-friction"), here)
    done = here("check", trial.path, *trial.logs)
    assert done.status == 0, done.err
    assert "the model still fits" in done.out


def test_the_dead_band_of_the_velocity_stands_in_the_file(
    dataset: Callable[..., Any], here: Callable[..., Any]
) -> None:
    trial = fit_file(dataset("cylinder-friction"), here)
    settled = {name.replace("-", ""): value for name, value in trial.raw["options"].items()}
    assert settled["deadband"] > 0.0


@pytest.mark.parametrize(
    ("family", "header", "share"),
    [
        ("line", "p_valve (bar)", 0.02),
        ("hydrostatic", "F [N]", 0.02),
        ("valve", "Sollwert [V]", 0.02),
    ],
)
def test_a_noisy_input_gives_the_rmse_of_the_parameters_written(
    family: str, header: str, share: float, dataset: Callable[..., Any], here: Callable[..., Any]
) -> None:
    trial = dataset(family, change_column(header, add_noise(share)))
    done = here(*trial.command(trial.path), "--accept-failed")
    assert done.status == 0, done.err
    due = trial.raw["fit"]["rmse"]["value"]
    assert simulated_rmse(trial) == pytest.approx(due, rel=1e-9, abs=0.0)


def test_the_inlet_of_a_fit_is_taken_as_the_fit_took_it(
    dataset: Callable[..., Any], here: Callable[..., Any]
) -> None:
    from fluidact_fit.simulation import simulate_logs

    trial = fit_file(dataset("line"), here)
    holds = {log["columns"]["inlet"]["hold"] for log in trial.raw["provenance"]["logs"]}
    assert holds == {"smooth"}
    for log in trial.logs:
        (run,) = simulate_logs(trial.document, trial.read([log]))
        assert run.experiment.signals["inlet"].hold == "smooth"


@pytest.mark.parametrize("length", [-5, "five"])
def test_the_length_of_a_line_is_a_length(dataset: Callable[..., Any], length: Any) -> None:
    trial = dataset("line")
    with pytest.raises(ff.UsageError, match="length=") as caught:
        ff.fit("line", trial.read(), length=length, sound_speed=340.0)
    assert "--" not in str(caught.value)


def test_a_cylinder_is_simulated_with_a_step_of_the_command(
    trial: Any, here: Callable[..., Any]
) -> None:
    if "command" not in trial.inputs or "pressure_1" not in trial.columns:
        pytest.skip("has no chambers")
    done = here(
        "simulate", trial.path, "--input", "command=0:2@0.1", "--duration", "0.5",
        "--sample-time", "0.001",
    )  # fmt: skip
    assert done.status == 0, done.err
    at = done.out.splitlines()[0].split(",").index("position_simulated [m]")
    position = np.array([float(line.split(",")[at]) for line in done.out.splitlines()[1:]])
    assert position[:100] == pytest.approx(position[0], abs=1e-3), "the cylinder rests first"
    assert abs(position[-1] - position[0]) > 5e-3, "and moves then"


def test_a_step_of_the_velocity_gives_the_levels_of_the_friction(
    dataset: Callable[..., Any], here: Callable[..., Any]
) -> None:
    trial = fit_file(dataset("cylinder-friction"), here)
    done = here(
        "simulate", trial.path, "--input", "velocity=-0.1:0.1@0.5", "--duration", "1",
        "--sample-time", "0.01",
    )  # fmt: skip
    assert done.status == 0, done.err
    head, *lines = done.out.splitlines()
    at = head.split(",").index("force_simulated [N]")
    force = np.array([float(line.split(",")[at]) for line in lines])
    p = {name: entry["value"] for name, entry in trial.raw["parameters"].items()}
    offset = trial.raw["model"].get("output_offset", 0.0)
    negative = offset - p["coulomb_negative"] - 0.1 * p["viscous"]
    positive = offset + p["coulomb_positive"] + 0.1 * p["viscous"]
    away = np.abs(np.arange(force.size) - 50) > 1  # the step itself is an impulse of the mass
    due = np.where(np.arange(force.size) < 50, negative, positive)
    assert force[away] == pytest.approx(due[away], rel=1e-6, abs=0.0)
    block = ff.load(trial.path)
    assert offset + np.asarray(block(np.array([-0.1, 0.1]))) == pytest.approx([negative, positive])


@pytest.mark.parametrize(
    ("family", "header"), [("line", "p_chamber (bar)"), ("valve", "Druck [bar]")]
)
def test_the_offset_of_a_sensor_reaches_the_controller(
    family: str, header: str, dataset: Callable[..., Any], here: Callable[..., Any], tmp_path: Path
) -> None:
    from fluidact_fit.simulation import simulate_logs

    trial = fit_file(dataset(family, change_column(header, lambda values: values + 0.5)), here)
    plain = trial.raw
    offsets = [entry["offset"] for entry in plain["fit"]["logs"]]
    assert {entry["unit"] for entry in offsets} == {"Pa"}
    mean = np.mean([entry["value"] for entry in offsets])
    assert plain["model"]["output_offset"] == pytest.approx(mean, rel=1e-9, abs=0.0)
    assert mean == pytest.approx(0.5e5, abs=0.1e5)
    block = ff.load(trial.path, accept_not_identified=True)
    assert block.offset == plain["model"]["output_offset"]
    for number, log in enumerate(trial.logs):
        (measured,) = simulate_logs(trial.document, trial.read([log]))
        inputs = trial.drop_output(log, tmp_path / f"inputs{number}.csv")
        (run,) = simulate_logs(trial.document, trial.read([inputs]))
        rest = block.predict(run.experiment) - measured.experiment[trial.variant.output.name]
        assert abs(np.median(rest)) < 0.02e5, "the block says what the sensor says"
