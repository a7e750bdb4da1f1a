"""What a file knows of the columns of its logs, applied to logs whose headers say otherwise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lsim

import fluidact_fit as ff

STEP, GAIN = 0.01, 1.2e5


def record(seed: int, wired: float = 1.0, noise: float = 300.0) -> dict[str, Any]:
    """A valve of 1.2 bar/V, driven by random levels; the command is wired with that sign."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(900)
    command = np.repeat(rng.uniform(1.0, 4.0, 30), 30)
    command[:20] = command[0]
    pressure = (
        GAIN * command[0]
        + lsim(([GAIN * 900.0], [1.0, 42.0, 900.0]), command - command[0], time, interp=False)[1]
    )
    return {"time": time, "command": wired * command,
            "outlet": pressure + noise * rng.standard_normal(time.size)}  # fmt: skip


def table(log: dict[str, Any], **headers: tuple[str, float]) -> pd.DataFrame:
    """A log with other headers, each with the factor from SI to what it holds."""
    named = {"time": ("time [s]", 1.0), **headers}
    return pd.DataFrame({named[n][0]: values * named[n][1] for n, values in log.items()})


def test_a_factor_is_that_of_the_sensor_whatever_its_header() -> None:
    volts = table(
        record(0, wired=-1.0), command=("command (V)", 1.0), outlet=("outlet (bar)", 1e-5)
    )
    file = ff.fit("valve", [volts], scales={"command": -1.0})
    assert file.parameters["gain"].value == pytest.approx(GAIN, rel=0.01)
    millivolts = table(
        record(1, wired=-1.0), command=("command (mV)", 1e3), outlet=("outlet (kPa)", 1e-3)
    )
    renamed = table(record(2, wired=-1.0), command=("u (V)", 1.0), outlet=("outlet (bar)", 1e-5))
    assert ff.check(file, [millivolts]).fits
    assert ff.check(file, [renamed], columns={"command": "u (V)"}).fits
    assert not ff.check(file, [renamed], columns={"command": "u (V)"}, scales={"command": 1.0}).fits


def test_a_factor_that_may_be_a_unit_is_not_guessed() -> None:
    plain = table(record(0), command=("command", 1.0), outlet=("outlet", 1e-5))
    file = ff.fit("valve", [plain], scales={"outlet": 1e5})
    stated = table(record(1), command=("command", 1.0), outlet=("outlet (bar)", 1e-5))
    with pytest.raises(ff.UsageError, match="state no unit") as refused:
        ff.check(file, [stated])
    assert "scales={'outlet': 1} if" in str(refused.value)
    assert ff.check(file, [stated], scales={"outlet": 1.0}).fits


@pytest.mark.parametrize("header", ["outlet (kPa)", "outlet [kPa]", "outlet_kPa"])
def test_a_header_with_a_unit_wins_over_the_unit_of_the_file(header: str) -> None:
    plain = table(record(0), command=("command", 1.0), outlet=("outlet", 1e-5))
    file = ff.fit("valve", [plain], units={"outlet": "bar"})
    assert ff.check(file, [plain]).fits
    stated = table(record(1), command=("command", 1.0), outlet=(header, 1e-3))
    assert ff.check(file, [stated]).fits


@pytest.mark.parametrize(
    ("step", "scales"),
    [
        (ff.StepInput(0.0, 2500.0, 0.5, "mV"), {}),
        (ff.StepInput(0.0, 1.25, 0.5), {"command": 2.0}),
        (ff.StepInput(0.0, 1250.0, 0.5, "mV"), {"command": 2.0}),
    ],
)
def test_a_step_is_recalled_in_its_unit_and_with_its_factor(
    step: ff.StepInput, scales: dict[str, float]
) -> None:
    time = STEP * np.arange(300)
    outlet = GAIN * lsim(([900.0], [1.0, 42.0, 900.0]), 2.5 * (time >= 0.5), time, interp=False)[1]
    outlet += 300.0 * np.random.default_rng(8).standard_normal(time.size)
    log = {"time": time, "outlet": outlet}
    file = ff.fit("valve", log, steps={"command": step}, scales=scales)
    assert file.parameters["gain"].value == pytest.approx(GAIN, rel=0.01)
    assert file.document.provenance.logs[0].columns["command"].step.end in (2.5, 2500.0)
    assert ff.check(file, [log]).fits


def test_the_noisiest_log_of_a_file_fits_it() -> None:
    logs = [record(k) for k in range(4)] + [record(4, noise=3000.0)]
    file = ff.fit("valve", logs)
    found = ff.check(file, [logs[-1], record(5, noise=3000.0)])
    assert found.fits, found.reasons


def test_disjoint_parts_of_a_log_share_no_errors(
    here: Callable[..., Any], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table(record(0), command=("command", 1.0), outlet=("outlet", 1.0)).to_csv("a.csv", index=False)
    for name, window in (("one", "0:4.5"), ("two", "4.5:"), ("all", "2:6")):
        assert here("valve", "a.csv", "--window", window, "-o", f"{name}.yaml").status == 0
    assert "both were fitted" not in here("compare", "one.yaml", "two.yaml").out
    assert "both were fitted" in here("compare", "one.yaml", "all.yaml").out
