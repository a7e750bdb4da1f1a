"""What is said of a log is said in the units of its columns; what is written is in SI."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.red_team.attacks import line

import fluidact_fit as ff
from attack_finder import find_attack
from fluidact_fit.errors import UnitError
from fluidact_fit.experiment import Signal
from fluidact_fit.families import get_family
from fluidact_fit.logs import experiments, find_constant_signals

T = np.arange(2000) * 0.01
GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"


@pytest.mark.parametrize(
    ("unit", "size", "text", "si"),
    [
        ("Pa", 1e-5, "shows 1.08e+03 Pa less", "Pa"),
        ("bar", 1.0, "shows 0.0108 bar less", "Pa"),
        ("1/100 bar", 0.01, "shows 0.0108 bar less", "Pa"),
        ("psi", 0.06894757293168361, "shows 0.157 psi less", "Pa"),
        ("V", 1.0, "shows 0.0108 V less", "V"),
        ("mV", 1e-3, "shows 10.8 mV less", "V"),
    ],
)
def test_what_the_model_lacks(unit: str, size: float, text: str, si: str) -> None:
    """A gap of 0.01 V was said to be one of 0.01 Pa, and one of 0.01 bar to be 1090 Pa."""
    attack = find_attack(line, "hysteresis of the outlet", "0.5 % of its range")
    (recording,) = attack.record(np.random.default_rng(31))
    time, inlet, outlet = recording.values()
    log = {"time": time, f"inlet [{unit}]": inlet / size, f"outlet [{unit}]": outlet / size}
    found = ff.fit("line", log)
    (message,) = [n.message for n in found.notices if n.code == "unmodelled-response"]
    assert text in message
    missing = found.document.fit.details["missing_response"]
    assert missing["play of outlet"]["unit"] == si


@pytest.mark.parametrize(
    ("unit", "text"), [("bar", "99 bar"), ("V", "99 V"), ("counts", "99 counts")]
)
def test_a_spike(unit: str, text: str) -> None:
    inlet, outlet = np.sin(T) + 2.0, np.sin(T - 0.1) + 2.0
    outlet[700] = 99.0
    log = ff.read_log({"time": T, f"inlet [{unit}]": inlet, f"outlet [{unit}]": outlet})
    messages = _experiment_notices(log)
    assert any(f"({text}" in m for m in messages)


@pytest.mark.parametrize(("unit", "text"), [("mV", "is always 250 mV."), ("counts", "250 counts.")])
def test_a_signal_that_does_not_change(unit: str, text: str) -> None:
    still = np.full(T.size, 250.0)
    log = ff.read_log({"time": T, f"inlet [{unit}]": np.sin(T), f"outlet [{unit}]": still})
    assert any(text in m for m in _experiment_notices(log))


def _experiment_notices(log: ff.Log) -> list[str]:
    variant = get_family("line").variant("line")
    found, notices = experiments(log, variant)
    return [n.message for n in (*notices, *find_constant_signals(variant, found))]


def test_a_fit_in_volts_is_not_judged_by_a_log_in_pascals() -> None:
    """The rmse of one in the unit of the other was 140,000 V, and the verdict PASS."""
    u = np.repeat(np.random.default_rng(1).uniform(1.0, 5.0, 20), 100)
    volts = {"time": T, "inlet [V]": u, "outlet [V]": u}
    with pytest.raises(UnitError, match=r"a voltage, and .* a pressure"):
        ff.fit("line", volts, validate=[{"time": T, "inlet [Pa]": u, "outlet [Pa]": u}])


def test_the_units_of_a_fit_are_those_of_its_logs() -> None:
    """Every role and parameter, and not the first of the units that the family takes."""
    (variant,) = get_family("valve").variants
    known = variant.measured_in({"command": "A", "outlet": "V"})
    assert known.role("command").unit == "A"
    assert known.role("outlet").unit == "V"
    assert known.parameter("gain").unit == "V/A"
    assert known.parameter("damping_ratio").unit == "1"


def test_a_value_in_the_unit_of_the_log() -> None:
    signal = Signal("inlet", T, T, "Pa", logged_in=("bar", 1e5))
    assert signal.text(3.5e5) == "3.5 bar"
    assert Signal("inlet", T, T, "Pa").text(12.0) == "12 Pa"
    assert Signal("reading", T, T, "1").text(12.0) == "12"


def test_an_input_beyond_the_range_of_the_file() -> None:
    """It was said in Pa of a log in bar."""
    document = ff.read_document(GOLDEN / "line.yaml")
    inlet = np.where(T < 5.0, 2.0, 9.0)
    log = {"t (ms)": 1e3 * T, "p_valve (bar)": inlet, "p_chamber (bar)": inlet - np.cos(T)}
    (message,) = [n.message for n in ff.check(document, log).notices if n.code == "beyond-validity"]
    assert "inlet = 9 bar is outside 1.1035 bar to 5.8398 bar" in message
