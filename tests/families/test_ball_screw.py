"""The ball screw: recovery, static levels, what a run begins with, what the controller holds.

The logs come from a simulator of their own, on a fine grid, never from the estimator's.
"""

from pathlib import Path

import numpy as np
import pytest
from drive_simulator import SERVO, advance, servo_log
from studies.red_team.attacks import ball_screw as screw

import fluidact_fit as ff
from fluidact_fit import NotIdentifiedError
from fluidact_fit.estimation.solution import moved
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.families.ball_screw.start import first_stage
from fluidact_fit.family import Plant, Request, Simulated, Solution
from fluidact_fit.parameters import make_document

STEP, N = 0.01, 1000
TIME = np.arange(N) * STEP
COUNT = 2 * np.pi / 2000
FAMILY = get_family("ball-screw")
ROTARY = FAMILY.variants[0]
DRIVE = {
    "inertia": 11.71e-7, "viscous": 2e-5, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
    "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
}  # fmt: skip


def chirp(seed: int) -> tuple[np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    u = 6e-3 * np.sin(2 * np.pi * (0.2 * TIME + 0.09 * TIME**2) + rng.uniform(-0.3, 0.3))
    return u, rng


def turn(u: np.ndarray, hold: str, v: float = 0.0) -> np.ndarray:
    """Angle under a torque by semi-implicit Euler at 20 kHz, from a speed."""
    j, b, kp, kn, sp, sn = DRIVE.values()
    h, sub = STEP / 200, 200
    y, p, sign = np.zeros(u.size), 0.0, int(np.sign(v))
    for k in range(u.size - 1):
        slope = (u[k + 1] - u[k]) / STEP if hold == "foh" else 0.0
        for i in range(sub):
            tau = u[k] + slope * (i + 0.5) * h
            if sign == 0:
                sign = 1 if tau > sp else -1 if tau < -sn else 0
                if sign == 0:
                    continue
            new = v + h / j * (tau - b * v - (kp if sign > 0 else -kn))
            if new * sign <= 0:
                v, sign = 0.0, 0
            else:
                p, v = p + 0.5 * h * (v + new), new
        y[k + 1] = p
    return y


def experiment(u: np.ndarray, y: np.ndarray | None, hold: str = "zoh") -> Experiment:
    time = TIME[: u.size]
    signals = {"torque": Signal("torque", time, u, "N m", hold, float(u[0]))}
    if y is not None:
        signals["angle"] = Signal("angle", time, y, "rad", resolution=COUNT)
    return Experiment("drive", 0, time, signals, STEP, True)


def drive_log(seed: int, hold: str = "foh") -> Experiment:
    """A chirp, read by a 2000-count encoder."""
    u, rng = chirp(seed)
    read = np.floor((turn(u, hold) + rng.uniform(0, COUNT)) / COUNT) * COUNT
    return experiment(u, read, hold)


def fit(logs: list[Experiment], **request) -> Solution:
    return FAMILY.estimate(ROTARY, logs, Request(FAMILY.options_type(), **request))


def simulate(values: dict, *logs: Experiment, offset: float | None = None) -> list[Simulated]:
    return FAMILY.simulate(Plant(ROTARY, values, FAMILY.options_type()), logs, offset)


def rms(log: Experiment, found: Simulated) -> float:
    return float(np.sqrt(np.mean((log["angle"] - found.output) ** 2)))


@pytest.mark.parametrize("hold", ["foh", "zoh"])
def test_drive_with_stick_slip(hold: str) -> None:
    """The issue's figures: kinetic 0.5 %, static 3 %, inertia 0.3 %."""
    found = fit([drive_log(1, hold)])
    friction = {}
    for side in ("positive", "negative"):
        friction |= {f"coulomb_{side}": 0.005, f"breakaway_{side}": 0.03}
    limits = {"inertia": 0.003, "viscous": 0.01, **friction}
    for name, limit in limits.items():
        q = found.parameters[name]
        assert q.value == pytest.approx(DRIVE[name], rel=limit), name
        assert q.status == "estimated"
    if hold == "zoh":
        assert found.parameters["breakaway_positive"].method == "bracket"


def servo_experiment(log: dict[str, np.ndarray], hold: str = "zoh") -> Experiment:
    time, torque, angle = log.values()
    signals = {
        "torque": Signal("torque", time, torque, "N m", hold, float(torque[0])),
        "angle": Signal("angle", time, angle, "rad", resolution=np.deg2rad(0.05)),
    }
    return Experiment("servo", 0, time, signals, float(time[1] - time[0]), True)


@pytest.mark.parametrize("case", ["loop", "noise", "uneven", "open"])
def test_inverse_dynamics_begins_near_the_truth(case: str) -> None:
    """A held torque acts half a row after its log says, and the other way at every reversal.

    Inertia was 28 % off, viscous friction ten times too large, and the search stayed there.
    """
    rng = np.random.default_rng(5)
    if case in ("open", "noise"):
        run, true, noise = drive_log(1, "foh"), DRIVE, 0.02 * (case == "noise")
        run = run.with_readings("angle", run["angle"] + noise * rng.standard_normal(N))
    else:
        run, true = servo_experiment(servo_log(rng, 0, step=0.005)), SERVO
    if case == "uneven":
        kept = rng.random(run.samples) > 0.02
        logged = {"time": run.time, "torque": run["torque"], "angle": run["angle"]}
        run = servo_experiment({n: v[kept] for n, v in logged.items()})
    begin = first_stage(ROTARY, [run], Request(FAMILY.options_type()), False).start
    for name in ("inertia", "viscous", "coulomb_positive", "coulomb_negative"):
        limit = 0.1 if name == "viscous" else 0.02
        assert begin[name] == pytest.approx(true[name], rel=limit), name


def test_a_servo_under_its_own_controller() -> None:
    """A search beside wrong static levels left its start: inertia 19 % off, levels refused."""
    rng = np.random.default_rng(2)
    found = ff.fit("ball-screw", [servo_log(rng, path, rows=500) for path in (1, 2)])
    assert found.verdict == "pass"
    for name, true in SERVO.items():
        q = found.parameters[name]
        assert abs(q.number - true) < 4.0 * float(q.std_error), name


def test_a_step_beyond_the_range_ends_on_it_and_breaks_no_search() -> None:
    """Another hold led the inertia to 0, which ended the fit and was blamed on units."""
    log = servo_experiment(servo_log(np.random.default_rng(3), 0, rows=300))
    plant = Plant(ROTARY, SERVO, FAMILY.options_type())
    least = moved(plant, "inertia", -1.0, ROTARY.parameter("inertia"))
    assert least.values["inertia"] == ROTARY.parameter("inertia").minimum
    for inertia in (0.0, 1e-30):
        with pytest.raises(np.linalg.LinAlgError, match="no motion can be followed"):
            simulate({**SERVO, "inertia": inertia}, drive_log(1, "zoh"))
    assert np.all(np.isfinite(simulate({**SERVO, "inertia": 1e-10}, log)[0].output))


def test_a_drive_that_never_turns_back() -> None:
    log = drive_log(1)
    part = slice(0, 130)  # the first half wave of the chirp goes one way only
    push = log["torque"][part].copy()
    push[:3] = -0.5e-3  # a push backwards that the static level withstands
    log = experiment(push, log["angle"][part], "foh")
    found = fit([log], fixed={"inertia": DRIVE["inertia"]})
    for name in ("coulomb_negative", "breakaway_negative"):
        assert found.parameters[name].status == "not_identified"
    said = {n.message.split()[0]: n.message for n in found.notices if n.code == "not-identified"}
    assert "negative direction" in said["coulomb_negative"]
    assert "strongest push that the axis withstood" in said["breakaway_negative"]
    # what is written must not creep backwards under that push
    assert found.parameters["breakaway_negative"].value == pytest.approx(0.5e-3)
    assert rms(log, simulate(found.values, log)[0]) < COUNT


def test_a_static_level_that_nothing_shows_is_written_as_the_kinetic_one() -> None:
    """Moving from the first sample on, and never at rest again."""
    u = 3.6e-3 + 1e-3 * np.sin(2 * np.pi * TIME[:300] * 1.3)
    log = experiment(u, np.floor(turn(u, "foh", 60.0) / COUNT) * COUNT, "foh")
    found = fit([log])
    for side in ("positive", "negative"):
        level, kinetic = (found.parameters[f"{n}_{side}"] for n in ("breakaway", "coulomb"))
        assert level.status == "not_identified"
        assert level.value == pytest.approx(kinetic.value, rel=1e-6)  # that one is rounded
    said = " ".join(n.message for n in found.notices)
    assert "breakaway_positive cannot be determined" in said
    assert "It is written as the kinetic level" in said
    assert "excess" not in said


def test_a_run_begins_where_and_as_fast_as_it_did() -> None:
    """Place and speed at the first sample belong to the run, not to the machine."""
    u = 4e-3 * np.cos(2 * np.pi * TIME[:400] * 0.7)
    log = experiment(u, 3.0 + turn(u, "zoh", 50.0))
    (found,) = simulate(DRIVE, log)
    assert rms(log, found) < 1e-4 * np.ptp(log["angle"])
    assert found.offset == pytest.approx(3.0, abs=0.01)


def test_without_a_record_a_run_begins_at_rest() -> None:
    u, _ = chirp(4)
    still = experiment(u, None)
    (found,) = simulate(DRIVE, still, offset=0.7)
    truth = turn(u, "zoh")
    assert found.offset == 0.7
    assert np.abs(found.output - 0.7 - truth).max() < 2e-3 * np.ptp(truth)


def test_a_torque_that_stepped_acts_before_its_step_too() -> None:
    """One node, as ``simulate --input`` makes it; a level that moves the axis before it."""
    at, before, after = 0.5, 5e-3, -4e-3
    step = Signal("torque", np.array([at]), np.array([after]), "N m", "zoh", before)
    time = TIME[:200]
    (found,) = simulate(DRIVE, Experiment("inputs", 0, time, {"torque": step}, STEP, True))
    truth = turn(np.where(time < at, before, after), "zoh")
    assert np.abs(found.output - truth).max() < 2e-3 * np.ptp(truth)


@pytest.mark.parametrize("seed", range(3))
def test_a_static_level_lies_between_two_that_were_commanded(seed: int) -> None:
    """All that a held torque shows of it: the bracket ends at commands, and holds the truth."""
    log = drive_log(seed, "zoh")
    found = fit([log])
    for name, sign in (("breakaway_positive", 1.0), ("breakaway_negative", -1.0)):
        q = found.parameters[name]
        commanded = np.append(sign * log["torque"], found.parameters[f"coulomb_{name[10:]}"].value)
        for end in q.ci95:
            # the bracket is written to four digits beyond its error
            assert np.abs(commanded - end).min() < 1e-4 * q.std_error
        assert q.ci95[0] < DRIVE[name] < q.ci95[1]
        assert q.std_error == pytest.approx((q.ci95[1] - q.ci95[0]) / np.sqrt(12.0), rel=1e-4)


def test_a_bounded_static_level_is_looked_for_among_the_commanded_ones() -> None:
    """A gradient does not see it: it was refused, and moved inertia by seven standard errors."""
    recording = screw.record(np.random.default_rng(3), screw.Machine(screw.SCREW), screw.Logger())
    found = ff.fit("ball-screw", recording[0], bounds={"breakaway_positive": (2.5e-3, 3.5e-3)})
    for name, true in screw.SCREW.items():
        q = found.parameters[name]
        assert abs(q.number - true) < 4.0 * float(q.std_error), name


def test_a_bad_start_does_not_hide_the_static_levels() -> None:
    """A search that never breaks away, or always does, sees no slope."""
    log = drive_log(1)
    for level in (0.0, 5.5e-3):
        found = fit([log], start={"breakaway_positive": level, "breakaway_negative": level})
        for side in ("positive", "negative"):
            q = found.parameters[f"breakaway_{side}"]
            assert q.value == pytest.approx(DRIVE[f"breakaway_{side}"], rel=0.03)


def test_the_drive_is_fed_forward_without_static_levels() -> None:
    """What a controller needs of the file, and nothing else, has to be identified."""
    open_ones = ("breakaway_positive", "breakaway_negative")
    document = make_document(
        {
            "format": "fluidact-parameters", "format_version": 1, "family": "ball-screw",
            "variant": "rotary", "options": FAMILY.options_type().given(),
            "parameters": {
                n: {"value": v, "unit": ROTARY.parameter(n).unit,
                    "status": "not_identified" if n in open_ones else "fixed"}
                for n, v in DRIVE.items()
            },
            "model": FAMILY.model(Plant(ROTARY, DRIVE, FAMILY.options_type()), STEP, "zoh"),
            "fit": {"samples": 10, "rmse": {"value": 0.1, "unit": "rad"}, "fit_percent": 90.0,
                    "verdict": "pass"},
            "provenance": {"tool": {"name": "fluidact-fit", "version": "0.1.0"},
                           "created": "2026-11-20T22:00:00Z"},
        },
        get_family,
    )  # fmt: skip
    block = FAMILY.block(ROTARY, document)
    assert block.feedforward(10.0) == pytest.approx(2e-3 + 2e-4)
    assert block.friction(-10.0) == pytest.approx(-1.6e-3 - 2e-4)
    for use in (lambda: block.friction(0.0, 1e-3), lambda: block.step(1e-3)):
        with pytest.raises(NotIdentifiedError, match="breakaway_positive"):
            use()
    block.accept(True)
    assert block.step(1e-3) == 0.0


def test_levels_that_differ_may_be_an_offset_of_the_drive() -> None:
    """An amplifier's offset passed as two levels, without a word outside ``derived``."""
    folder = Path(__file__).parents[2] / "datasets" / "ball-screw"
    found = ff.fit_ball_screw(folder / "trial1.csv")
    (said,) = (n for n in found.notices if n.code == "levels-or-offset")
    assert "0.0002 N m" in said.message  # half of 2 and 1.6 mN m
    assert found.verdict == "pass"


def test_two_break_aways_that_hide_each_other_are_found_together() -> None:
    """Both levels lay a cell too high: kinetic friction was 14 standard errors off, with a warning
    of a crooked force. Of 24 such logs 2 ended so.
    """
    rng = np.random.default_rng(202)
    axis = {"inertia": 25.0, "viscous": 180.0, "coulomb_positive": 22.0, "coulomb_negative": 20.0,
            "breakaway_positive": 31.0, "breakaway_negative": 28.0}  # fmt: skip
    time = 2e-3 * np.arange(2000)
    slow = 38.75 * np.sin(2.0 * np.pi * time * rng.uniform(0.45, 0.6) + rng.uniform(-0.3, 0.3))
    chirp = 0.8 * time + 1.6 * time**2 / time[-1]
    fast = 31.0 * rng.uniform(1.8, 2.6) * np.sin(2.0 * np.pi * chirp + rng.uniform(0.0, 6.0))
    steps = np.repeat(31.0 * rng.uniform(-2.5, 2.5, 17), 125)[:2000]
    force = np.concatenate((slow[:666], steps[:666], fast[:668]))
    position, place, speed = np.empty(2000), 0.0, 0.0
    for k, pull in enumerate(force.tolist()):
        position[k] = place
        place, speed = advance(axis, pull, 2e-3, place, speed)
    position += 5e-5 * rng.standard_normal(2000)
    units = {"time": "s", "force": "N", "position": "m"}
    log = {"time": time, "force": force, "position": position}
    found = ff.fit("ball-screw", log, units=units)
    for name, truth in axis.items():
        q = found.parameters[name.replace("inertia", "mass")]
        assert abs(q.value - truth) < 4.0 * q.std_error, name
    assert found.verdict == "pass"


@pytest.mark.parametrize(("seed", "codes"), [(1, 200), (8, 200), (4, 2000)])
def test_levels_between_torques_that_change_from_row_to_row(seed: int, codes: int) -> None:
    """Of many torques next to a level few act at rest, and rows of a rest share one rounding error.

    A level was up to 15 % and hundreds of standard errors off, with ``pass``.
    """
    rng = np.random.default_rng(seed)
    axis = {"inertia": 1.36e-4, "viscous": 5.9e-4, "coulomb_positive": 7.6e-3,
            "coulomb_negative": 6.3e-3, "breakaway_positive": 8.5e-3,
            "breakaway_negative": 8.0e-3}  # fmt: skip
    time = 1e-3 * np.arange(4000)
    w, phase = 2.0 * np.pi * np.array([0.7, 1.9, 4.3]), rng.uniform(0.0, 6.3, 3)
    torque = 0.014 * np.sin(w * rng.uniform(0.8, 1.2, 3) * time[:, None] + phase).sum(axis=1)
    angle, place, speed = np.empty(time.size), 0.0, 0.0
    for k, push in enumerate(torque.tolist()):
        angle[k] = place
        place, speed = advance(axis, push, 1e-3, place, speed)
    code = 2.0 * np.pi / codes
    log = {"time [s]": time, "torque [N m]": torque, "angle [rad]": code * np.round(angle / code)}
    found = ff.fit("ball-screw", log)
    for name, truth in axis.items():
        q = found.parameters[name]
        assert abs(q.number - truth) < 4.0 * float(q.std_error), name
