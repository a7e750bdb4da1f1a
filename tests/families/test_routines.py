"""What a controller calls, as routines: the same numbers as the blocks they come from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import fluidact_fit as ff
from fluidact_fit.routines import Machine, Routine

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
Array = npt.NDArray[np.float64]


def routine_of(block: Any, name: str) -> Routine:
    found: Routine = next(r for r in block.routines() if r.name == name)
    return found


def draw(routine: Routine, count: int) -> dict[str, Array]:
    """Arguments within their ranges, with both ends and zero where it lies between."""
    rng = np.random.default_rng(5)
    values = {}
    for a in routine.arguments:
        v = rng.uniform(a.low, a.high, count)
        v[:3] = a.low, a.high, np.clip(0.0, a.low, a.high)
        values[a.name] = np.sign(v) + (v == 0.0) if a.name == "direction" else v
    return values


@pytest.mark.parametrize("family", ff.family_names())
def test_a_routine_gives_what_its_method_gives(family: str) -> None:
    block = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
    routines = {r.name: r for r in block.routines()}
    assert block.methods().keys() <= routines.keys()
    for name, method in block.methods().items():
        routine, machine = routines[name], Machine(routines[name])
        values = draw(routine, 300)
        rows = np.column_stack(list(values.values())).tolist()
        wanted = np.array([float(method(*row)) for row in rows])
        if routine.keeps:
            calls = [machine(**dict(zip(values, row))) for row in rows]
            found, outside = np.array([[float(y), bool(o)] for y, o in calls]).T
        else:
            found, outside = machine(**values)
        tolerance = 2e-9 if name in ("reading_at", "friction_rounded") else 1e-11
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=tolerance * np.abs(wanted).max())
        assert not np.any(outside)


def test_what_all_but_a_step_compute_is_a_method_as_well() -> None:
    """Else no test would hold what is exported against what a loaded file gives."""
    left = set()
    for family in ff.family_names():
        block = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
        left |= {r.name for r in block.routines()} - block.methods().keys()
    assert left == {"step", "dead_zone_inverse", "command_for"}


@pytest.mark.parametrize("family", ["valve", "line", "hydrostatic", "hydraulic-motor"])
def test_a_step_gives_what_the_difference_equation_gives(family: str) -> None:
    loaded: Any = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
    for period in (0.01, 0.0037):
        block = loaded.with_sample_time(period)
        routine = routine_of(block, "step")
        (u,) = draw(routine, 400).values()
        machine = Machine(routine)
        block.reset()
        found = np.array([float(machine(**{routine.arguments[0].name: x})[0]) for x in u])
        wanted = np.array([block.step(x) for x in u.tolist()])
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-9 * np.ptp(wanted))


def test_the_command_for_a_speed_gives_that_speed_again() -> None:
    block: Any = ff.load(GOLDEN / "hydraulic-cylinder.yaml", accept_not_identified=True)
    back, there = routine_of(block, "command_for"), routine_of(block, "speed")
    values = draw(back, 400)
    command, outside = Machine(back)(**values)
    speed, _ = Machine(there)(command=command, **{k: values[k] for k in values if k[0] == "p"})
    (limit,) = (a for a in there.arguments if a.name == "command")
    within = ~outside & (command > limit.low) & (command < limit.high)
    assert within.sum() > 100
    np.testing.assert_allclose(speed[within], values["velocity"][within], rtol=1e-9, atol=1e-12)


def test_what_lies_beyond_a_range_is_clamped_and_told() -> None:
    routine = routine_of(ff.load(GOLDEN / "potentiometer.yaml"), "position")
    (a,) = routine.arguments
    machine = Machine(routine)
    ends = machine(reading=[a.low, a.high])
    far = machine(reading=[a.low - 100.0, a.high + 1.0])
    assert far[0].tolist() == ends[0].tolist()
    assert (ends[1].tolist(), far[1].tolist()) == ([False, False], [True, True])
    assert machine(reading=np.nan) == (ends[0][0], True)


def test_a_play_and_a_tracked_direction_are_kept_between_calls() -> None:
    motor: Any = ff.load(GOLDEN / "hydraulic-motor.yaml", accept_not_identified=True)
    routine = motor.linear_model().curve
    machine = Machine(routine)
    high = routine.arguments[0].high
    up = [float(machine(command=u)[0]) for u in np.linspace(0.0, high, 50)]
    down = [float(machine(command=u)[0]) for u in np.linspace(high, 0.0, 50)]
    np.testing.assert_allclose(up[5:], motor(np.linspace(0.0, high, 50)[5:], 1), rtol=1e-9)
    np.testing.assert_allclose(down[10:], motor(np.linspace(high, 0.0, 50)[10:], -1), rtol=1e-9)
    machine.reset()
    assert float(machine(command=0.0)[0]) == up[0]


@pytest.mark.parametrize(
    ("family", "ports"),
    [
        ("force-map", ("force", "command")),
        ("cylinder-friction", ("velocity", "force")),
        ("spring-cylinder", ("command", "force")),
        ("potentiometer", ("reading", "reference")),
        ("line", ("inlet", "outlet")),
    ],
)
def test_a_block_says_what_drives_it_and_what_it_gives(family: str, ports: tuple[str, str]) -> None:
    block = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
    assert block.input is not None
    assert (block.input.role, block.output.role) == ports


def test_an_integrator_stays_one() -> None:
    """What is left of ``A - 1`` in its column is nothing, not a rounding error."""
    loaded: Any = ff.load(GOLDEN / "hydrostatic.yaml", accept_not_identified=True)
    for period in (1e-4, 0.0037, 0.01, 0.5):
        (equation,) = routine_of(loaded.with_sample_time(period), "step").filters
        assert [row[0] for row in equation.change] == [0.0, 0.0]
