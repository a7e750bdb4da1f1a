"""Numbers that no actuator has are named, and those of right logs are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.assessment import find_implausible
from fluidact_fit.demo import load_dataset
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family

N = 400
MACHINE = {
    "area_1": 4.91e-4, "area_2": 2.37e-4, "dead_volume_1": 1.2e-4, "dead_volume_2": 1.0e-4,
    "mass": 12.0, "supply_pressure": 5e6,
}  # fmt: skip


def run(**channels: tuple[str, np.ndarray]) -> Experiment:
    time = 0.001 * np.arange(N)
    signals = {role: Signal(role, time, values, unit) for role, (unit, values) in channels.items()}
    return Experiment("log", 0, time, signals, 0.001, True)


def wave(size: float, level: float = 0.0) -> np.ndarray:
    return level + size * np.sin(np.linspace(0.0, 12.0, N))


def causes(position=0.05, pressure_1=2e6, pressure_2=2e6, level=3e6, **given: float) -> list[str]:
    family = get_family("hydraulic-cylinder")
    options = family.options_type.read({**MACHINE, **given})
    log = run(position=("m", wave(position)), pressure_1=("Pa", wave(pressure_1, level)),
              pressure_2=("Pa", wave(pressure_2, level)))  # fmt: skip
    found = find_implausible(family, options, family.variants[0], [log])
    return [f"{c.words} {c.remedy}" for c in found]


def test_a_right_machine_has_none() -> None:
    assert causes() == []


def test_areas_in_square_centimetres_are_named_with_what_mends_them() -> None:
    one, two = causes(area_1=4.91, area_2=2.37)
    assert "--area-1 4.91 is in m2" in one
    assert "--area-1 0.000491 for 4.91 cm2" in one
    assert "--area-2 0.000237 for 2.37 cm2" in two


def test_volumes_in_litres_are_named() -> None:
    (words,) = causes(dead_volume_1=120.0)
    assert "--dead-volume-1 0.12 for 120 l, or --dead-volume-1 0.00012 for 120 cm3" in words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": 50.0}, "--unit position=mm"),
        ({"pressure_1": 20.0, "pressure_2": 20.0, "level": 30.0}, "--unit pressure_1=bar"),
        ({"level": -3e6}, "--scale pressure_1=-1"),
    ],
)
def test_columns_are_named_with_their_option(change: dict[str, float], words: str) -> None:
    assert words in causes(**change)[0]


def hydraulic_log(**factors: float) -> pd.DataFrame:
    """The committed log in SI without units, some columns multiplied."""
    dataset = load_dataset("hydraulic-cylinder")
    table = pd.read_csv(dataset.logs[0])
    si = {"u [V]": 1.0, "p1 [bar]": 1e5, "p2 [bar]": 1e5, "y [mm]": 1e-3}
    names = ["command", "pressure_1", "pressure_2", "position"]
    out = {"time": table["t [s]"]}
    for (header, size), name in zip(si.items(), names, strict=True):
        out[name] = table[header] * size * factors.get(name, 1.0)
    return pd.DataFrame(out)


@pytest.mark.parametrize(
    ("factors", "given", "words"),
    [
        ({}, {"area_1": 4.91, "area_2": 2.37}, "area_1=0.000491 for 4.91 cm2"),
        ({}, {"supply_pressure": 50.0}, "50 bar are 5e6 Pa"),
        ({"position": 1e3}, {}, "units={'position': 'mm'}"),
    ],
)
def test_a_refusal_begins_with_them(factors, given, words) -> None:
    options = {**dict(load_dataset("hydraulic-cylinder").options), **given}
    options = {name.replace("-", "_"): value for name, value in options.items()}
    with pytest.raises((ff.UsageError, ff.NotIdentifiedError, ff.LogError)) as refused:
        ff.fit("hydraulic-cylinder", hydraulic_log(**factors), **options)
    assert words in str(refused.value)


def test_swapped_chambers_are_refused() -> None:
    options = {
        k.replace("-", "_"): v for k, v in load_dataset("hydraulic-cylinder").options.items()
    }
    table = hydraulic_log().rename(columns={"pressure_1": "pressure_2", "pressure_2": "pressure_1"})
    with pytest.raises(ff.LogError, match="the two columns seem to be swapped"):
        ff.fit("hydraulic-cylinder", table, **options)


def test_a_fit_that_goes_through_is_warned_of_them() -> None:
    dataset = load_dataset("spring-cylinder")
    table = pd.read_csv(dataset.logs[0])
    table.columns = ["time", "command", "position", "force"]  # mm, taken for metres
    result = ff.fit("spring-cylinder", table)
    (said,) = [n for n in result.notices if n.code == "implausible-number"]
    assert "--unit position=mm" in said.message
    assert result.verdict == "warn"


def test_a_given_pressure_in_bar_that_is_read_in_pascals() -> None:
    """A reference of 50 Pa for 50 bar changed every gain, with ``pass``."""
    log = Path(__file__).parents[2] / "datasets" / "flow-map" / "trial1.csv"
    columns = {"command": "u", "flow": "Q", "pressure_drop": "dp"}
    found = ff.fit("flow-map", log, columns=columns, reference_pressure=50.0)
    said = [n.message for n in found.notices if n.code == "implausible-number"]
    assert any("--reference-pressure 50 is in Pa" in message for message in said)
    right = ff.fit("flow-map", log, columns=columns, reference_pressure=50e5)
    assert "implausible-number" not in {n.code for n in right.notices}
