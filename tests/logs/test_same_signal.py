"""One column for two roles, or a copy of it in another unit, is refused; two sensors are not."""

from __future__ import annotations

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.families import family_names, get_family
from fluidact_fit.logs import experiments, require_two_signals

RNG = np.random.default_rng(4)
TIME = 0.01 * np.arange(800)
FORCE = 10.0 * np.sin(3.0 * TIME) + 4.0 * np.sin(7.7 * TIME)
STEPS = np.repeat(RNG.uniform(0.0, 5.0, 16), 50)


@pytest.mark.parametrize(
    ("family", "log"),
    [
        ("hydrostatic", {"force": FORCE, "position": FORCE}),
        ("hydrostatic", {"force": FORCE, "position": np.round(FORCE * 1e-3, 6)}),
        ("hydrostatic", {"force": np.round(FORCE, 3), "position": np.round(0.2248 * FORCE, 4)}),
        ("hydrostatic", {"force": FORCE, "position": 3.0 - FORCE}),
        ("valve", {"command": STEPS, "outlet": 1e5 * STEPS}),  # held levels have coarse steps
        ("line", {"inlet": STEPS, "outlet": STEPS}),
        ("cylinder-friction", {"force": 1e3 * FORCE, "velocity": FORCE}),
        ("spring-cylinder", {"command": STEPS, "position": FORCE, "force": 100.0 * FORCE}),
        ("backlash", {"drive": FORCE, "load": np.round(1e3 * FORCE, 1)}),
        ("hydraulic-cylinder",
         {"command": STEPS, "pressure_1": FORCE, "pressure_2": FORCE, "position": TIME}),
        ("potentiometer", {"reading": FORCE, "reference": FORCE}),
    ],
)  # fmt: skip
def test_a_column_given_twice_is_refused_with_both_names(family, log) -> None:
    given = {"area_1": 1e-3, "area_2": 1e-3, "supply_pressure": 5e6}
    timed = log if family == "potentiometer" else {"time": TIME, **log}
    with pytest.raises(ff.LogError, match="a column seems to be given twice") as refused:
        ff.fit(family, timed, **(given if family == "hydraulic-cylinder" else {}))
    named = [role for role in log if f"'{role}'" in str(refused.value)]
    assert len(named) == 2


@pytest.mark.parametrize(
    ("family", "log"),
    [
        ("hydrostatic", {"force": FORCE, "position": FORCE + 0.01 * RNG.standard_normal(800)}),
        ("hydrostatic", {"force": FORCE, "position": np.roll(FORCE, 1)}),
        ("flow-map", {"command": FORCE, "flow": 3.7e-5 * FORCE}),  # a map may be straight
        ("potentiometer", {"reading": np.round(30.0 * FORCE + 512.0), "reference": FORCE}),
    ],
)
def test_two_sensors_and_straight_maps_are_not(family, log) -> None:
    variant = get_family(family).variants[0]
    read = ff.read_log({"time": TIME, **log} if family != "potentiometer" else log)
    runs, _ = experiments(read, variant, index=0)
    require_two_signals(read, variant, runs)


@pytest.mark.parametrize("name", family_names())
def test_the_datasets_are_not(name: str) -> None:
    for log in load_dataset(name).read():
        for variant in get_family(name).variants:
            try:
                runs, _ = experiments(log, variant, index=0)
            except (ff.LogError, ff.UsageError):
                continue  # the other variant
            require_two_signals(log, variant, runs)
