"""What a recording shows is named before a parameter that it cannot determine."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from studies.red_team.attack import Attack
from studies.red_team.attacks import hydraulic_motor, rigs, valve
from studies.red_team.run import write

import fluidact_fit as ff
from attack_finder import find_attack
from fluidact_fit.assessment import find_cause
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family

N = 600


def cause_of(output: np.ndarray, force: np.ndarray) -> str:
    """Words about a log of the hydrostatic family."""
    variant = get_family("hydrostatic").variants[0]
    time, signals = 0.01 * np.arange(output.size), {}
    for role, unit, values in (("force", "N", force), ("position", "m", output)):
        signals[role] = Signal(role, time, values, unit, "foh")
    run = Experiment("log", 0, time, signals, 0.01, True)
    found = find_cause(variant, [run])
    return found.words if found else ""


def swept(turns: float, noise: float = 0.0) -> np.ndarray:
    t = np.linspace(0.0, 1.0, N)
    return np.sin(2 * np.pi * turns * t) + noise * np.random.default_rng(1).standard_normal(N)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@settings(max_examples=20, deadline=None)
@given(share=st.floats(0.2, 0.6), turns=st.floats(1.0, 4.0))
def test_a_counter_that_begins_again_is_named_with_its_size(noise, share, turns):
    free = swept(turns, noise)
    words = cause_of((free + 1.5) % (share * 2.0), swept(turns))
    assert "begin again after about" in words
    # a jump falls short of it by what the output moves from sample to sample; three digits are said
    step = 2.0 * np.pi * turns / N + 6.0 * noise + 5e-3
    assert float(words.split("about ")[1].split(" m")[0]) == pytest.approx(2 * share, abs=step)


@pytest.mark.parametrize("end", [0.3, 0.7])
def test_a_stop_is_named_with_its_place(end):
    words = cause_of(np.minimum(swept(3.0), end) + 1e-3 * swept(90.0), swept(3.3))
    assert f"stays at 0.{10 * end:.0f}" in words
    assert "a stop" in words


def test_a_wide_dead_zone_is_no_stop():
    force = swept(7.0) * (1.0 + swept(1.3)) * 0.5
    assert not cause_of(np.cumsum(np.sign(force) * np.maximum(np.abs(force) - 0.6, 0.0)), force)


def test_what_a_right_log_does_is_no_cause():
    square = np.sign(swept(5.0, 0.01))
    assert not cause_of(square + swept(40.0, 0.01) * 0.01, square)
    assert not cause_of(np.cumsum(swept(3.0)) / 100.0, swept(3.0, 0.01))  # velocity by force
    held = np.repeat([0.0, 1.0, 0.4, -1.0, 0.2, 0.9], N // 6)  # rests with its input
    assert "a stop" not in cause_of(held, held)


@pytest.mark.parametrize(("group", "name", "words"), [
    ("hard stop", "beyond 70 % of the way", "there seems to be a stop"),
    ("wraps", "0.3 of the range", "it seems to begin again after about"),
])  # fmt: skip
def test_a_refused_fit_says_it(tmp_path, group, name, words):
    attack = find_attack(rigs, group, name)
    logs = [write(tmp_path / "log.csv", r, attack.units)
            for r in attack.record(np.random.default_rng(3))]  # fmt: skip
    with pytest.raises(ff.NotIdentifiedError, match=words):
        ff.fit(attack.family, logs)


def test_a_valve_faster_than_the_sampling_is_no_counter(tmp_path):
    truth = {"gain": 1.0, "natural_frequency": 2000.0, "damping_ratio": 0.7}
    record = partial(valve.record, truth=truth, step=0.05)
    log = record(np.random.default_rng(1))[0]
    attack = Attack("valve", "", "", truth, record, valve.UNITS)
    with pytest.raises(ff.NotIdentifiedError) as refused:
        ff.fit("valve", [write(tmp_path / "log.csv", log, attack.units)])
    assert "begin again" not in str(refused.value)
    assert "stop" not in str(refused.value)


def test_a_sign_that_is_reversed_is_named():
    force = swept(3.0) + 0.5 * swept(7.3)
    assert "moves against 'force'" in cause_of(-np.cumsum(force) / 100.0, force)
    assert not cause_of(np.cumsum(force) / 100.0, force)


def of_line(*pairs: tuple[np.ndarray, np.ndarray]) -> str:
    """Words about logs of the line family, inlet and outlet each."""
    variant = get_family("line").variants[0]
    runs = []
    for k, (inlet, outlet) in enumerate(pairs):
        time = 0.01 * np.arange(inlet.size)
        signals = {role: Signal(role, time, values, "Pa", "foh")
                   for role, values in (("inlet", inlet), ("outlet", outlet))}  # fmt: skip
        runs.append(Experiment(f"log{k}.csv", k, time, signals, 0.01, True))
    found = find_cause(variant, runs)
    return f"{found.words} {found.remedy}" if found else ""


def filled(inlet: np.ndarray, seed: int = 1) -> np.ndarray:
    """A first-order lag of 12 samples with noise."""
    out, level = np.empty(inlet.size), inlet[0]
    for k, u in enumerate(inlet):
        out[k] = level
        level += (u - level) / 12.0
    return out + 0.005 * np.random.default_rng(seed).standard_normal(inlet.size)


def test_a_line_of_the_other_sign_is_named():
    inlet = np.repeat(np.random.default_rng(3).uniform(-1.0, 1.0, 20), 40)
    assert not of_line((inlet, filled(inlet)))
    assert "--scale inlet=-1 or --scale outlet=-1" in of_line((inlet, -filled(inlet)))
    assert "--scale inlet=-1 or --scale outlet=-1" in of_line((-inlet, filled(inlet) + 3.0))


def test_a_single_log_of_the_other_sign_is_named():
    inlets = [np.repeat(np.random.default_rng(k).uniform(-1.0, 1.0, 20), 40) for k in range(3)]
    logs = [(u, filled(u, k)) for k, u in enumerate(inlets)]
    logs[1] = (logs[1][0], -logs[1][1])
    assert "the other way in log 2 (log1.csv)" in of_line(*logs)


def test_two_sensors_of_one_signal_are_named():
    inlet = swept(3.0, 0.001)
    assert "seem to be of one signal" in of_line((inlet, 2.5 * swept(3.0) + 0.001 * swept(200.0)))


def test_a_failed_fit_says_it_too():
    inlets = [np.repeat(np.random.default_rng(k).uniform(-1.0, 1.0, 20), 40) for k in range(2)]
    logs = [{"time": 0.01 * np.arange(u.size), "inlet": u, "outlet": (-1) ** k * filled(u, k)}
            for k, u in enumerate(inlets)]  # fmt: skip
    try:
        said = " ".join(n.message for n in ff.fit("line", logs, hold={"inlet": "zoh"}).notices)
    except ff.NotIdentifiedError as error:
        said = str(error)
    assert "one of its columns seems to have the other sign" in said


def test_flow_against_its_command_is_refused_with_the_options():
    u = np.repeat(np.linspace(-10.0, 10.0, 21), 20)
    flow = -1e-5 * u + 1e-7 * np.random.default_rng(1).standard_normal(u.size)
    with pytest.raises(ff.LogError, match="runs against the command") as refused:
        ff.fit("flow-map", {"time": 0.05 * np.arange(u.size), "command": u, "flow": flow})
    assert "scales={'flow': -1}" in str(refused.value)


def test_a_negative_gain_is_a_note():
    log = valve.record(np.random.default_rng(1))[0]
    result = ff.fit("valve", {**log, "outlet": -log["outlet"]})
    (said,) = [n for n in result.notices if n.code == "sign-reversed"]
    assert "--scale command=-1 or --scale outlet=-1" in said.message
    assert result.verdict == "pass"
    assert not [n for n in ff.fit("valve", log).notices if n.code == "sign-reversed"]


@pytest.mark.parametrize("more", [0.0, 2.0])
def test_a_machine_that_is_stronger_in_one_direction_is_named(more):
    truth = {**hydraulic_motor.TRUTH, "gain_more": more}
    log = hydraulic_motor.log(np.random.default_rng(1), p=truth, n=1000)[0]
    signals = {r: Signal(r, log["time"], log[r], unit, "zoh")
               for r, unit in (("command", "A"), ("speed", "rad/s"))}  # fmt: skip
    run = Experiment("log", 0, log["time"], signals, 0.02, True)
    variant = get_family("line").variants[0]  # without parameters of one side
    roles = tuple(replace(r, name={"inlet": "command", "outlet": "speed"}.get(r.name, r.name))
                  for r in variant.roles)  # fmt: skip
    found = find_cause(replace(variant, roles=roles), [run])
    assert bool(found and "times as much to one sign of 'command'" in found.words) == bool(more)


def test_a_plateau_that_the_output_has_not_left_yet_is_no_stop():
    rng = np.random.default_rng(3)
    u = 4.0 + 2.0 * np.repeat(rng.choice([-1.0, 1.0], 120), 6)
    y = valve.simulate({"gain": 1.0, "natural_frequency": 900.0, "damping_ratio": 0.9}, u, 0.01)
    y += 0.01 * rng.standard_normal(u.size)
    with pytest.raises(ff.NotIdentifiedError) as refused:
        ff.fit("valve", {"time": 0.01 * np.arange(u.size), "command": u, "outlet": y})
    assert "stop" not in str(refused.value)


def test_smooth_pressures_that_are_swapped_are_named():
    """Differences of neighbouring samples are noise here; what leads shows over more of them."""
    t = 0.005 * np.arange(3000)

    def inlet(t):
        waves = ((14.0, 0.17), (9.0, 0.53), (6.0, 1.3), (5.0, 2.9), (3.0, 6.1), (2.0, 11.3))
        return 60.0 + sum(a * np.sin(2.0 * np.pi * f * t + f) for a, f in waves)

    rng = np.random.default_rng(5)
    fine = np.arange(0.0, 15.0, 1e-4)
    late = lfilter([1.0 - np.exp(-1e-4 / 0.085)], [1.0, -np.exp(-1e-4 / 0.085)],
                   inlet(fine - 0.0127) - inlet(-0.0127)) + inlet(-0.0127)  # fmt: skip
    first = inlet(t) + 0.05 * rng.standard_normal(t.size)
    second = late[::50] + 0.05 * rng.standard_normal(t.size)
    assert ff.fit("line", {"time": t, "inlet": 1e5 * first, "outlet": 1e5 * second}).verdict
    with pytest.raises(ff.FluidactError, match="seem to be swapped"):
        ff.fit("line", {"time": t, "inlet": 1e5 * second, "outlet": 1e5 * first})
