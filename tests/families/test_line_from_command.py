"""A line whose inlet was not recorded: from the command of the valve to the far pressure."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.control import make_block
from fluidact_fit.control.parts import Parts, supplies_of
from fluidact_fit.errors import UnitError
from fluidact_fit.experiment import FloatArray
from fluidact_fit.export import export
from fluidact_fit.result import FitResult

STEP, FINE = 0.005, 50  # s, steps of the solution between two samples
TRUTH = {"gain": 0.6e5, "time_constant": 0.08, "dead_time": 0.0147}  # of volts
NOISE = 300.0  # Pa


def log(seed: int, count: int = 24) -> dict[str, FloatArray]:
    """Random levels of a command in volts, held for 0.25 s, and the pressure above 1 bar."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(0.0, 10.0, count), 50)
    late = round(TRUTH["dead_time"] / STEP * FINE)
    target = np.repeat(command, FINE)
    target = np.concatenate((np.full(late, target[0]), target))[: target.size]
    keep, y, now = np.exp(-STEP / FINE / TRUTH["time_constant"]), [], float(target[0])
    for aim in target.tolist():
        y.append(now)
        now = aim + keep * (now - aim)
    outlet = TRUTH["gain"] * np.array(y[::FINE]) + 1e5 + NOISE * rng.standard_normal(command.size)
    return {"time": STEP * np.arange(command.size), "command": command, "outlet": outlet}


def deviations(result: FitResult, size: float = 1.0) -> list[float]:
    """Errors in standard errors; ``size`` is a volt in the unit of the command."""
    truth = {**TRUTH, "gain": TRUTH["gain"] / size}
    table = result.parameters
    return [(table[n].value - v) / table[n].std_error for n, v in truth.items()]  # type: ignore[operator]


@pytest.mark.parametrize(
    ("unit", "size", "gain"), [("V", 1.0, "Pa/V"), ("mA", 1.6, "Pa/A"), ("%", 10.0, "Pa"),
                               ("bit", 409.5, "Pa")],
)  # fmt: skip
def test_truth_is_recovered_and_the_gain_is_a_pressure_per_command(
    unit: str, size: float, gain: str
) -> None:
    data = log(1)
    data["command"] = size * data["command"]
    result = ff.fit("line", data, units={"command": unit, "outlet": "Pa"})
    assert result.verdict == "pass"
    assert result.parameters["gain"].unit == gain
    si = {"mA": 1e-3, "%": 1e-2}.get(unit, 1.0)
    assert max(map(abs, deviations(result, size * si))) < 4.0


def test_intervals_cover() -> None:
    """Of 20 logs with 3 numbers each: 95 %, give or take 6 %."""
    found = [deviations(ff.fit("line", log(k, 12))) for k in range(20)]
    z = np.array(found)
    assert 0.88 <= np.mean(np.abs(z) < 1.96) <= 1.0
    assert 0.75 < z.std() < 1.25


def test_a_file_comes_back_and_its_code_passes_its_own_test(tmp_path: Path) -> None:
    result = ff.fit("line", log(1), units={"command": "V", "outlet": "Pa"})
    result.save(tmp_path / "hose.yaml")
    block: Any = ff.load(tmp_path / "hose.yaml")
    assert (str(block.input), str(block.output)) == ("command [V]", "outlet [Pa]")
    (routine,) = block.routines()
    assert (routine.arguments[0].name, routine.arguments[0].unit) == ("command", "V")
    if shutil.which("gcc") is None:
        return
    export([tmp_path / "hose.yaml"], "c", tmp_path)
    sources = [str(p) for p in tmp_path.glob("*.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-o", str(tmp_path / "test")]
    subprocess.run(["gcc", *flags, *sources, "-lm"], check=True)
    assert subprocess.run([str(tmp_path / "test")], check=False).returncode == 0


def test_a_line_that_was_driven_by_a_command_does_not_follow_a_valve() -> None:
    golden = Path(__file__).parents[1] / "golden" / ff.__version__
    valve, line = (ff.load(golden / f"{n}.yaml", accept_not_identified=True)
                   for n in ("valve", "line"))  # fmt: skip
    commanded = make_block(ff.fit("line", log(1)).document)
    assert [len(supplies_of(Parts("impedance", {"supply": (valve, second)})))
            for second in (line, commanded)] == [1, 2]  # fmt: skip


def test_a_command_taken_for_the_inlet_is_refused_with_its_name() -> None:
    data = log(1)
    data["inlet"] = data.pop("command")
    with pytest.raises(UnitError, match=r"command of a valve, name it so: columns=\{'command'"):
        ff.fit("line", data, units={"inlet": "V", "outlet": "bar"})


def test_a_pressure_is_no_command() -> None:
    with pytest.raises(UnitError, match="a voltage such as 'V'"):
        ff.fit("line", log(1), units={"command": "bar", "outlet": "Pa"})
