"""The gray box of the single-acting cylinder: equation, inverse, truth, refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies.red_team.attacks import spring_cylinder
from studies.red_team.run import Result, run

import fluidact_fit as ff
from attack_finder import find_attack
from dataset_fits import fit_dataset
from fluidact_fit.errors import LogError, NotIdentifiedError, UsageError
from fluidact_fit.experiment import Experiment, FloatArray, Signal
from fluidact_fit.families.spring_cylinder.block import SpringCylinderBlock
from fluidact_fit.families.spring_cylinder.equation import SpringLaw
from fluidact_fit.families.spring_cylinder.family import SpringCylinder
from fluidact_fit.families.spring_cylinder.instruments import differentiate
from fluidact_fit.families.spring_cylinder.options import SpringOptions
from fluidact_fit.family import Request, Solution
from fluidact_fit.result import FitResult

DATA = Path(__file__).parents[2] / "datasets" / "spring-cylinder"
COLUMNS = {"time": "t [s]", "command": "u [V]", "position": "x [mm]", "force": "F [N]"}
TRUTH = {
    "pressure_gain": 18.09, "stiffness": 300.0, "preload": 5.0, "coulomb_loading": 2.4,
    "coulomb_unloading": 2.4, "viscous": 45.0,
}  # fmt: skip
small = st.floats(-1e3, 1e3)


def fitted() -> FitResult:
    return fit_dataset("spring-cylinder")


def test_truth_of_the_dataset() -> None:
    result = fitted()
    assert result.verdict == "pass", result.notices
    for name, true in TRUTH.items():
        q = result.parameters[name]
        assert q.status == "estimated"
        assert abs(q.value - true) < 4.0 * q.std_error, name  # type: ignore[operator]
    details = result.solution.details
    assert set(details["branches"]) == {"loading", "unloading"}
    assert "--fix preload" in details["levels"]  # what was assumed, and what would tell


@given(small, small, st.sampled_from([-1, 0, 1]), small, st.floats(0.1, 100.0))
def test_inverse_is_exact(force: float, x: float, s: int, v: float, gain: float) -> None:
    law = SpringLaw.of({**TRUTH, "pressure_gain": gain, "coulomb_loading": 3.0})
    u = law.command(force, x, s, v)
    assert law.force(u, x, s, v) == pytest.approx(force, rel=1e-9, abs=1e-6)


def test_block_from_file(tmp_path: Path) -> None:
    block = ff.load(fitted().save(tmp_path / "cylinder.yaml"))
    assert isinstance(block, SpringCylinderBlock)
    wanted = np.array([10.0, 20.0, 30.0])
    command = block.inverse(wanted, 0.01, 1, 0.02)
    assert np.allclose(block(command, 0.01, 1, 0.02), wanted)
    assert float(block.inverse(20.0, 0.01, 1) - block.inverse(20.0, 0.01, -1)) == pytest.approx(
        4.8 / 18.09, rel=0.01
    )
    assert block.outside("position", 1.0)
    assert not block.outside("position", 0.014)
    with pytest.raises(UsageError, match="no range"):
        block.outside("temperature", 1.0)


# --------------------------------------------------------------------- experiments by hand


def make(
    position: Any = None, *, speed: float = 0.0, direction: FloatArray | None = None,
    spikes: int = 0, seed: int = 0, rising: bool = False, sign: float = 1.0,
    loading: float = 3.0, unloading: float = 2.0, timed: bool = True, drive: str = "command",
) -> Experiment:  # fmt: skip
    rng = np.random.default_rng(seed)
    n = 2000
    t = 0.01 * np.arange(n)
    u = 2.0 + np.abs(np.mod(t / 2.0, 2.0) - 1.0)
    if rising:
        u = 2.0 + t / t[-1]
    s = np.sign(np.gradient(u)) if direction is None else direction
    x = np.repeat([0.005, 0.02], n // 2) if position is None else np.full(n, position)
    v = speed * np.sin(np.arange(n) / 37.0)
    levels = {"coulomb_loading": loading, "coulomb_unloading": unloading}
    f = SpringLaw.of({**TRUTH, "pressure_gain": 18.0, **levels}).force(u, x, s, v)
    f = sign * f + 0.05 * rng.standard_normal(n)
    f[rng.choice(n, spikes, replace=False)] += 60.0
    unit, factor = ("V", 1.0) if drive == "command" else ("Pa", 9e4)
    columns = {drive: (factor * u, unit), "position": (x, "m"), "force": (f, "N")}
    columns |= {"velocity": (v, "m/s"), "direction": (s, "1")}
    signals = {k: Signal(k, t, a, w, before=float(a[0])) for k, (a, w) in columns.items()}
    return Experiment("hand.csv", 0, t if timed else np.zeros(0), signals, 0.01 * timed, timed)


def estimate(e: Experiment, variant: int = 0, **request: Any) -> Solution[SpringOptions]:
    family = SpringCylinder()
    options = SpringOptions.read(request.pop("options", {}))
    return family.estimate(family.variants[variant], [e], Request(options=options, **request))


def test_levels_apart_with_a_known_preload() -> None:
    found = estimate(make(speed=0.05), fixed={"preload": 5.0})
    assert found.parameters["coulomb_loading"].value == pytest.approx(3.0, abs=0.02)
    assert found.parameters["coulomb_unloading"].value == pytest.approx(2.0, abs=0.02)
    assert found.parameters["preload"].status == "fixed"
    assert found.details["levels"] == "free"


def test_levels_are_equal_without_and_their_sum_is_right() -> None:
    found = estimate(make(speed=0.05))
    one, two = (found.parameters[f"coulomb_{w}"] for w in ("loading", "unloading"))
    assert one.value == two.value == pytest.approx(2.5, abs=0.02)
    assert found.derived["hysteresis_width"].value == pytest.approx(5.0, abs=0.03)
    assert found.parameters["preload"].value == pytest.approx(5.5, abs=0.05)
    assert found.details["levels"].startswith("taken to be equal")


def test_free_levels_need_a_constant() -> None:
    with pytest.raises(UsageError, match="needs one of the three"):
        estimate(make(), options={"levels": "free"})


@pytest.mark.parametrize("timed", [True, False])
def test_area_from_pressure(timed: bool) -> None:
    found = estimate(make(speed=0.05, drive="pressure", timed=timed), variant=1)
    assert found.parameters["area"].value == pytest.approx(18.0 / 9e4, rel=1e-3)


def test_one_position_leaves_stiffness_open() -> None:
    found = estimate(make(0.01, speed=0.05))
    assert found.parameters["stiffness"].status == "not_identified"
    assert found.parameters["stiffness"].value == 0.0
    (notice,) = [n for n in found.notices if "stiffness" in n.message]
    assert "two positions" in notice.message


def test_one_direction_leaves_both_levels_open() -> None:
    found = estimate(make(speed=0.05, rising=True))
    for way in ("loading", "unloading"):
        assert found.parameters[f"coulomb_{way}"].status == "not_identified"
    assert found.parameters["preload"].value == pytest.approx(8.0, abs=0.3)
    assert "hysteresis_width" not in found.derived


def test_no_speed_leaves_viscous_friction_open() -> None:
    found = estimate(make())
    assert found.parameters["viscous"].status == "not_identified"
    assert "two speeds" in " ".join(n.message for n in found.notices)


def test_spikes_do_not_pull() -> None:
    log = make(speed=0.05, spikes=40)
    found = estimate(log)
    assert found.parameters["pressure_gain"].value == pytest.approx(18.0, rel=2e-3)
    assert 30 <= found.details["spikes"] <= 40
    assert [n.code for n in found.notices] == ["force-spikes", "levels-equal", "valve-hysteresis"]
    family = SpringCylinder()
    (again,) = family.simulate(found.plant, [log])
    # whoever simulates the log leaves out the same samples
    out = found.details["left_out"]["unknown_motion_state_or_reversal"]
    assert np.sum(~again.used) == out + found.details["spikes"]
    assert np.std((again.output - log["force"])[again.used]) == pytest.approx(0.05, rel=0.1)


def test_wrong_sign_is_told() -> None:
    with pytest.raises(LogError, match=r"pressure_gain would be -18") as error:
        estimate(make(speed=0.05, sign=-1.0))
    assert "--scale force=-1" in error.value.remedy


def test_constant_command() -> None:
    e = make(direction=np.repeat([1.0, -1.0], 1000))
    u = Signal("command", e.time, np.full(2000, 2.0), "V", before=2.0)
    with pytest.raises(NotIdentifiedError, match="pressure_gain"):
        estimate(Experiment("c.csv", 0, e.time, {**e.signals, "command": u}, 0.01, True))


def test_direction_column_is_asked_for() -> None:
    e = make()
    signals = {k: s for k, s in e.signals.items() if k != "direction"}
    bare = Experiment("b.csv", 0, e.time, signals, 0.01, True)
    with pytest.raises(LogError, match="direction"):
        estimate(bare, options={"motion-state": "direction"})
    found = estimate(bare)
    assert found.parameters["coulomb_loading"].value == pytest.approx(2.5, abs=0.05)


def test_intervals_hold_the_truth() -> None:
    hits = 0
    for seed in range(60):
        q = estimate(make(speed=0.05, seed=seed)).parameters["stiffness"]
        hits += q.ci95[0] <= 300.0 <= q.ci95[1]  # type: ignore[index]
    assert hits >= 52


@pytest.mark.parametrize("role", ["position", "pressure"])
def test_noise_of_a_column_does_not_shrink_its_coefficient(tmp_path: Path, role: str) -> None:
    rng, t = np.random.default_rng(3), 0.01 * np.arange(4000)
    phase = (t / 4.0) % 1.0
    pressure = 5e5 * np.minimum(2.0 * phase, 2.0 - 2.0 * phase)
    way = np.sign(np.diff(pressure, prepend=-1.0))
    x = 1.5e-3 * (1.0 + np.sin(0.58 * t))
    force = 3.1e-4 * pressure - 850.0 * x - 14.0 - 5.0 * way + 0.3 * rng.standard_normal(t.size)
    columns = {"time": t, "pressure": pressure, "position": x, "force": force}
    size = {"position": 3e-4, "pressure": 1e4}[role]
    columns[role] = columns[role] + size * rng.standard_normal(t.size)
    path = tmp_path / "x.csv"
    header = "time [s],pressure [Pa],position [m],force [N]"
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",",
               header=header, comments="")  # fmt: skip
    result = ff.fit("spring-cylinder", [path], fixed={"viscous": 0.0})
    truth = {"stiffness": 850.0, "area": 3.1e-4, "preload": 14.0, "coulomb_loading": 5.0}
    for name, value in truth.items():
        q = result.parameters[name]
        assert abs(q.number - value) < 3.5 * q.std_error, name
    assert result.parameters["stiffness"].std_error < 0.1 * 850.0
    assert "instruments" in result.document.fit.details["method"]


@pytest.mark.parametrize(("pace", "noise"), [(0.5, 1e-5), (3.0, 1e-5), (8.0, 1e-6), (0.5, 2e-4)])
def test_the_window_of_the_velocity_does_not_flatten_it(pace: float, noise: float) -> None:
    """A quadratic over 11 samples at 100 Hz takes 0.3, 10 and 58 % off 0.5, 3 and 8 Hz."""
    t = np.arange(2000) * 0.01
    place, rate = 0.01 * np.sin(2 * np.pi * pace * t), np.cos(2 * np.pi * pace * t)
    rng = np.random.default_rng(7)
    found = differentiate(place + noise * rng.standard_normal(t.size), 0.01)
    truth = 0.01 * 2 * np.pi * pace * rate
    inside = found.inside
    share = found.rate[inside] @ truth[inside] / (truth[inside] @ truth[inside])
    uncertain = noise * found.gain / np.linalg.norm(truth[inside])
    # five samples, the shortest window, take (w T)**4 / 30 off
    least = 1.5e-3 + (2 * np.pi * pace * 0.01) ** 4 / 30
    assert abs(share - 1.0) < least + 4.0 * uncertain
    error = np.std((found.rate - truth)[inside])
    assert error < 1.2 * noise * found.gain + least * np.std(truth)


def of_a_noisy_rise(noise: str, repetition: int, seed: int) -> Result:
    """A recording whose friction rises by 2 N towards rest, beside noise of its motion."""
    name = f"2 N, 4 mm/s, noise of the {noise}"
    return run(find_attack(spring_cylinder, "Stribeck asked for", name), repetition, seed)


@pytest.mark.slow
def test_noise_of_the_speed_does_not_shift_a_rise() -> None:
    """Its error is skew through the curve; Huber's weights took 0.3 standard errors off."""
    found = [of_a_noisy_rise("velocity, 1 mm/s", k, 1618) for k in range(40)]
    for name in ("stribeck", "stribeck_speed"):
        deviations = [one.errors[name].deviations for one in found]
        assert abs(np.mean(deviations)) < 2.0 / np.sqrt(40)


def test_a_rise_about_too_high_a_level_is_not_settled() -> None:
    """The speed had hardly moved beside a level of a million newtons: 5 mm/s +- 1 nm/s."""
    assert "stribeck_speed" not in of_a_noisy_rise("position, 0.1 mm", 90, 77).errors


@pytest.mark.parametrize("tail", ["laplace", "student"])
def test_noise_with_long_tails_is_no_spike(tail: str) -> None:
    rng = np.random.default_rng(4)
    log = make(speed=0.05)
    n = log.samples
    noise = rng.laplace(size=n) if tail == "laplace" else rng.standard_t(4, size=n)
    noise[n // 3] = 12.0  # whatever the draw
    force = log.signals["force"]
    signals = {**log.signals, "force": replace(force, values=force.values + 0.1 * noise)}
    found = estimate(replace(log, signals=signals))
    assert "force-spikes" not in [w.code for w in found.notices]
    for name, true in {**TRUTH, "pressure_gain": 18.0, "coulomb_loading": 2.5}.items():
        if name in ("coulomb_unloading", "preload"):
            continue  # equal levels share what they differ by with the preload
        q = found.parameters[name]
        assert abs(q.number - true) < 4.0 * float(q.std_error or 0.0), name


def test_levels_from_a_command_are_those_of_the_valve_as_well() -> None:
    """A hysteresis of the valve made friction 80 % too large, and nothing was said."""
    codes = [n.code for n in estimate(make(speed=0.05)).notices]
    assert codes == ["levels-equal", "valve-hysteresis"]
    from_pressure = estimate(make(speed=0.05, drive="pressure"), 1)
    assert [n.code for n in from_pressure.notices] == ["levels-equal"]


ROD = {
    "area": 5e-4, "stiffness": 2000.0, "preload": 20.0, "coulomb_loading": 6.0,
    "coulomb_unloading": 6.0, "viscous": 40.0,
}  # fmt: skip


def moved_rod(
    seed: int, pressure: float | None = None, *, triangles: bool = False
) -> dict[str, FloatArray]:
    """A rod that a test machine moves: friction follows the sign of its speed."""
    rng = np.random.default_rng(seed)
    t = 0.005 * np.arange(3000)
    turn = rng.uniform(0.0, 6.3, (2, 3))
    w, size = 2.0 * np.pi * np.array([0.11, 0.29, 0.63]), np.array([4e-3, 3e-3, 2e-3])
    x = 0.015 + np.sin(np.outer(t, w) + turn[0]) @ size
    v = np.cos(np.outer(t, w) + turn[0]) @ (size * w)
    if triangles:
        phase, rate = np.mod(0.37 * seed * t + rng.random(), 2.0), 0.37 * seed
        x, v = 0.005 + 0.018 * np.abs(phase - 1.0), 0.018 * rate * np.sign(phase - 1.0)
    p = 3e5 + 2e5 * np.sin(0.9 * t + turn[1, 0]) if pressure is None else np.full(t.size, pressure)
    force = SpringLaw.of(ROD).force(p, x, np.sign(v), v) + 0.3 * rng.standard_normal(t.size)
    return {"time": t, "pressure": p, "position": x, "force": force}


def rod_deviations(result: FitResult) -> dict[str, float]:
    return {
        n: (float(q.number) - ROD[n]) / float(q.std_error) for n, q in result.parameters.items()
    }


@pytest.mark.parametrize("triangles", [False, True])
def test_a_rod_that_turns_by_itself_keeps_its_reversals_out_of_the_fit(triangles: bool) -> None:
    """Samples after a reversal were sought in the pressure: friction 8 errors off in silence."""
    logs = [moved_rod(seed, triangles=triangles) for seed in (1, 2)]
    found = ff.fit("spring-cylinder", logs, motion_state="position")
    assert max(map(abs, rod_deviations(found).values())) < 4.0
    assert found.verdict == "pass", found.notices


def test_the_rod_moves_where_the_pressure_is_held() -> None:
    """These logs were refused, and the columns or the sign blamed."""
    logs = [moved_rod(seed, 1e5 * seed) for seed in (2, 4, 6)]
    found = ff.fit("spring-cylinder", logs)
    assert max(map(abs, rod_deviations(found).values())) < 4.0
    assert found.verdict == "pass", found.notices


def test_a_late_position_is_named_as_what_viscous_friction_cannot_be_told_from() -> None:
    """12 ms of a stiff spring are more viscous friction than there is."""
    log = moved_rod(3)
    late = {n: v[:-2] if n == "position" else v[2:] for n, v in log.items()}
    found = ff.fit("spring-cylinder", late, motion_state="position")
    assert float(found.parameters["viscous"].number) > 1.2 * ROD["viscous"]
    (said,) = (n.message for n in found.notices if n.code == "timing-matters")
    assert "were 'position' recorded one sample (5 ms) early or late, viscous would be off" in said


def cycles(
    early: float = 0.0, *, n: int = 4000, sine: bool = False, pace: float = 0.092,
    stroke: float = 0.3, noise: float = 0.0, force_noise: float = 0.3, seed: int = 4,
) -> dict[str, FloatArray]:  # fmt: skip
    """A command up and down in 4 s, begun ``early`` [s], and a rod moved to and fro [Hz]."""
    t, rng = 0.01 * np.arange(n), np.random.default_rng(seed)
    phase = ((t + early) / 4.0) % 1.0
    share = np.minimum(2.0 * phase, 2.0 - 2.0 * phase)
    u = 5.0 * np.sin(0.5 * np.pi * share) ** 2 if sine else 5.0 * share
    way, turn = np.where(phase < 0.5, 1.0, -1.0), 2.0 * np.pi * pace
    x = 0.03 * (0.5 + stroke * np.sin(turn * t))
    v = 0.03 * stroke * turn * np.cos(turn * t)
    y = spring_cylinder.force(spring_cylinder.TRUTH, u, x, v, way)
    y = y + force_noise * rng.standard_normal(n)
    read = x + noise * rng.standard_normal(n)
    return {"time": t, "command": u, "position": read, "force": y}


def test_a_turn_between_two_samples_is_no_delay_of_the_command() -> None:
    """Behind noise of the force the last sample before a turn may be past it, and is no spike."""
    found = [ff.fit("spring-cylinder", cycles(0.004, force_noise=8.0, seed=k)) for k in range(3)]
    assert [f.verdict for f in found] == ["pass"] * 3, [f.notices for f in found]


# the last sample before the command is seen to turn has the friction of the way back, and so have
# those at the end of a record that turns within the dead band
@pytest.mark.parametrize("log", [cycles(0.004), cycles(n=3806, sine=True)])
def test_a_turn_that_the_state_shows_late_or_never_is_no_spike(log: dict[str, FloatArray]) -> None:
    found = ff.fit("spring-cylinder", log)
    assert not [n for n in found.notices if n.code == "force-spikes"]
    assert found.verdict == "pass", found.notices


def test_noise_of_the_position_is_no_difference_between_a_slow_and_a_fast_log() -> None:
    """It shrank viscous friction in the slow log alone: the machine was said to have changed."""
    logs = [
        cycles(k / 3.0, n=1000, pace=pace, stroke=0.4, noise=2e-4, seed=k)
        for k, pace in enumerate((0.37, 0.2))
    ]
    found = ff.fit("spring-cylinder", logs)
    assert "halves-disagree" not in [n.code for n in found.notices]
    assert "instruments" in found.document.fit.details["method"]


def test_bounds_hold_and_a_start_changes_nothing() -> None:
    free, logs = fitted(), [DATA / f"trial{i}.csv" for i in (1, 2, 3)]

    def fit(**request: Any) -> FitResult:
        return ff.fit("spring-cylinder", logs, columns=COLUMNS, **request)

    for request in ({"start": {"stiffness": 1.0}}, {"bounds": {"stiffness": (0.0, 1e9)}}):
        same = fit(**request)
        assert same.verdict == "pass"
        assert same.parameters["stiffness"].value == free.parameters["stiffness"].value
    bounded = fit(bounds={"stiffness": (400.0, 500.0)})
    assert bounded.parameters["stiffness"].value == pytest.approx(400.0, abs=1e-6)
    codes = {n.code for n in bounded.notices}
    # the misfit is that of the bound: another hold of command or position does not mend it
    assert "at-given-bound" in codes
    assert "hold-doubtful" not in codes


def test_bounds_of_two_levels_that_are_one_unknown_have_to_overlap() -> None:
    apart = {"coulomb_loading": (1.0, 2.0), "coulomb_unloading": (3.0, 4.0)}
    with pytest.raises(UsageError, match="no value in common"):
        estimate(make(), bounds=apart)
