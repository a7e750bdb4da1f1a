"""The estimator of responses: what runs begin with, dead times, rivals; simulators of their own."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from line_simulator import line_log, sines, steps
from scipy.signal import cont2discrete, lfilter

import fluidact_fit as ff
from fluidact_fit.result import FitResult

Log = Mapping[str, np.ndarray]


def codes(result: FitResult) -> set[str]:
    return {n.code for n in result.notices}


def assert_holds(result: FitResult, truth: Mapping[str, float], errors: float = 4.0) -> None:
    for name, value in truth.items():
        q = result.parameters[name]
        assert q.status == "estimated"
        assert abs(q.number - value) < errors * float(q.std_error), name  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("seed", "truth", "step", "span"),
    [
        (2, {"gain": 1.1, "time_constant": 0.161, "dead_time": 0.240}, 0.0149, 1.7),
        (13, {"gain": 0.9, "time_constant": 0.086, "dead_time": 0.506}, 0.0121, 1.6),
        (37, {"gain": 0.8, "time_constant": 0.100, "dead_time": 0.430}, 0.0103, 1.9),
    ],
)
def test_a_slow_log_that_begins_within_its_dead_time(
    seed: int, truth: dict[str, float], step: float, span: float
) -> None:
    """Until the dead time is over the outlet answers to an inlet that nobody recorded."""
    rng = np.random.default_rng([78, seed])
    reach = truth["time_constant"] + truth["dead_time"]
    log = line_log(
        rng, sines(rng, 0.05 / reach, 0.4 / reach), step=step, span=span, offset=0.2, **truth
    )
    try:
        result = ff.fit("line", log)
    except ff.NotIdentifiedError:
        return  # so short a log may not tell
    assert_holds(result, truth)


def test_a_dead_time_of_hundreds_of_samples_is_found() -> None:
    """Starts are sought along the whole log, not on an excerpt shorter than twice the dead time."""
    rng = np.random.default_rng(5)
    truth = {"gain": 1.0, "time_constant": 0.06, "dead_time": 0.8}
    log = line_log(rng, steps(rng, 0.3, 1.2, 0.001), step=0.001, span=8.0, **truth)
    assert_holds(ff.fit("line", log), truth)


def fills(rng: np.random.Generator, dead_time: float) -> Log:
    """Fills of a tube, one sample at the switch and the next ones every 36 ms; no first order."""
    every = []
    for _ in range(40):
        t = 0.036 * np.arange(14) + rng.uniform(-0.003, 0.005, 14)
        t[0] = 1e-3
        y = 1.0 - np.exp(-((np.maximum(t - dead_time, 0.0) / 0.13) ** 1.3))
        every.append((t, y + 0.003 * rng.standard_normal(t.size)))
    time, outlet = map(np.concatenate, zip(*every))
    return {"time": time, "outlet": outlet}


def test_an_offset_does_not_eat_the_dead_time(tmp_path: Path) -> None:
    """Samples before the response say that there is none; a fit that has one says so."""
    log = fills(np.random.default_rng(3), 0.02)
    path = tmp_path / "fills.csv"
    np.savetxt(
        path,
        np.column_stack(list(log.values())),
        header="time,outlet",
        delimiter=",",
        comments="",
        fmt="%.6f",
    )
    tube = ff.read_log(path, units={"outlet": "Pa"}, steps={"inlet": ff.StepInput(0.0, 1.0, 0.0)})
    found = ff.fit("line", tube)
    free, none = (ff.fit("line", tube, offset=o) for o in ("free", "none"))
    late = [r.parameters["dead_time"].number for r in (free, none)]
    assert late[0] > 1.15 * late[1]
    assert found.document.options["offset"] == "none"
    assert found.document.options["start-state"] == "rest"
    assert "offset-matters" in codes(found)
    assert "offset-matters" in codes(free)


def test_an_offset_that_is_there_is_estimated_without_a_word() -> None:
    rng = np.random.default_rng(4)
    log = line_log(rng, steps(rng, 0.3, 1.0, 0.01), time_constant=0.12, dead_time=0.03, step=0.01,
                   span=8.0, offset=0.3)  # fmt: skip
    found = ff.fit("line", log)
    assert found.document.options["offset"] == "free"
    assert "offset-matters" not in codes(found)


@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_an_offset_that_was_left_out_on_request_is_not_passed_over(offset: float) -> None:
    """A log without an offset of its own has a mean, which the examination takes into account."""
    rng = np.random.default_rng(4)
    logs = []
    for _ in range(2):
        inlet = steps(rng, 0.3, 1.0, 0.01)
        logs.append(
            line_log(rng, lambda t, inlet=inlet: inlet(t) + 1.2, time_constant=0.12,
                     dead_time=0.03, step=0.01, span=8.0, offset=offset)
        )  # fmt: skip
    found = ff.fit("line", logs, offset="none")
    assert ("unmodelled-response" in codes(found)) == bool(offset)
    assert all(log.offset is None for log in found.document.fit.logs)


@pytest.mark.parametrize("still", [True, False])
def test_a_run_that_did_not_begin_at_rest_is_named(still: bool) -> None:
    """The outlet still falls for as long as the log lasts."""
    rng = np.random.default_rng(6)
    t = np.arange(400) * 0.01
    inlet = steps(rng, 0.2, 0.6, 0.01)(t) + 1.0
    log = line_log(
        rng, lambda x: np.interp(x, t, inlet, left=inlet[0] + 0.03 * (not still)),
        time_constant=1.5, dead_time=0.03, step=0.01, span=4.0,
    )  # fmt: skip
    log["inlet"] = inlet
    found = ff.fit("line", log, start_state="rest", offset="none", hold={"inlet": "foh"})
    said = [n.message for n in found.notices if n.code == "unmodelled-response"]
    assert bool(said) != still
    assert all("was not at rest where a log begins" in text for text in said)


def second_order(wn: float, zeta: float, late: float, noise: float, seed: int) -> Log:
    """Outlet of a lightly damped valve behind a dead time, with ripple that it does not explain."""
    from scipy.signal import lsim

    rng = np.random.default_rng(seed)
    t = np.arange(12000) * 1e-3
    u = steps(rng, 0.2, 0.8, 1e-3)(t - late)
    _, y, _ = lsim(([wn**2], [1.0, 2.0 * zeta * wn, wn**2]), u, t, X0=None)
    ripple = np.cumsum(rng.standard_normal(t.size))
    ripple -= np.linspace(ripple[0], ripple[-1], t.size)
    command = steps(np.random.default_rng(seed), 0.2, 0.8, 1e-3)(t)
    return {"time": t, "command": command, "outlet": y + noise * ripple / ripple.std()}


def test_a_pure_delay_is_no_rival_of_a_valve_that_fits_better() -> None:
    """Coloured residuals make costs look alike: that they are larger all along tells them apart."""
    log = second_order(45.0, 0.23, 0.005, 0.3, 2)
    result = ff.fit("valve", log, dead_time="estimate")
    assert result.parameters["natural_frequency"].number == pytest.approx(45.0, rel=0.05)
    assert result.parameters["damping_ratio"].number == pytest.approx(0.23, abs=0.05)


def test_a_long_dead_time_before_a_first_order_is_no_slow_valve() -> None:
    """What the outlet does within the dead time speaks against it, and is to be left out first."""
    rng = np.random.default_rng(3)
    log = line_log(rng, steps(rng, 0.5, 2.0, 0.005), time_constant=0.02, dead_time=1.5,
                   step=0.005, span=30.0)  # fmt: skip
    log["command"] = log.pop("inlet")
    with pytest.raises(ff.NotIdentifiedError, match="natural_frequency"):
        ff.fit("valve", log, dead_time="estimate")


def test_the_aliases_of_a_fast_valve_are_told_apart_on_a_long_log() -> None:
    """A few samples under much noise prefer 1027 rad/s, the rest of the log does not."""
    step, rows, truth = 0.01, 300_000, {"natural_frequency": 400.0, "damping_ratio": 0.05}
    wn, zeta = truth.values()
    rng = np.random.default_rng(1)
    b, a, _ = cont2discrete(([wn**2], [1.0, 2.0 * zeta * wn, wn**2]), step)
    held = rng.integers(5, 60, rows // 5)
    command = np.repeat(rng.uniform(-3.0, 3.0, held.size), held)[:rows]
    outlet = lfilter(b.ravel(), a, command) + rng.standard_normal(rows)
    log = {"time": np.arange(rows) * step, "command": command, "outlet": outlet}
    assert_holds(ff.fit("valve", log), truth)
