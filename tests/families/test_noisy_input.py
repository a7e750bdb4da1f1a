"""Families whose measured input carries noise: no bias, no false refusal."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from studies.red_team.attacks import hydrostatic, input_noise
from studies.red_team.run import run, write

import fluidact_fit as ff
from fluidact_fit.simulation import simulate_logs


def fit_line(folder: Path, seed: int, k: int, noise: float, n: int) -> ff.Fit:
    """A line whose inlet carries noise [bar], fitted with the defaults."""
    record = partial(input_noise._line, noise=noise, n=n)
    (log,) = record(np.random.default_rng([seed, k]))
    return ff.fit("line", write(folder / "log.csv", log, input_noise.LINE_UNITS))


def test_noise_does_not_hide_that_an_inlet_is_smooth(tmp_path: Path) -> None:
    """It was taken for straight lines, which clip its peaks: a time constant off by 1.6 errors."""
    found = [fit_line(tmp_path, 31, k, 0.05, 6000) for k in range(8)]
    for name, truth in input_noise.LINE.items():
        each = [
            (float(f.parameters[name].number) - truth) / float(f.parameters[name].std_error)
            for f in found
        ]
        assert abs(np.mean(each)) < 3.0 / np.sqrt(len(each))


def test_two_dead_times_that_noise_of_the_inlet_makes_are_one(tmp_path: Path) -> None:
    """Between samples noise averages out, which made half a sample look better: refused (3 %)."""
    found = fit_line(tmp_path, 3, 24, 0.1, 6000)
    q = found.parameters["dead_time"]
    assert q.status == "estimated"
    assert abs(float(q.number) - input_noise.LINE["dead_time"]) < 4.0 * float(q.std_error)


def test_a_column_that_is_named_keeps_the_hold_of_the_file(tmp_path: Path) -> None:
    """Naming it again had the hold chosen again, from whatever log was simulated."""
    (log,) = input_noise._line(np.random.default_rng(5), noise=0.05)
    path = write(tmp_path / "log.csv", log, input_noise.LINE_UNITS)
    document = ff.fit("line", path, hold={"inlet": "foh"}).document
    columns = {"inlet": "inlet [Pa]", "outlet": "outlet [Pa]"}
    plain, named = (
        simulate_logs(document, [ff.read_log(path, **how)])[0] for how in ({}, {"columns": columns})
    )
    np.testing.assert_array_equal(named.simulated, plain.simulated)


def test_an_edge_that_a_noisy_force_never_reaches_is_refused() -> None:
    """Its derivative is zero, and a correction for the noise of the force has nothing to solve."""
    mass, damping, edges, fine = 84.0, 1210.0, (-10.0, 8.0), 20
    for seed in range(3):
        rng = np.random.default_rng([12, seed])
        t = 1e-3 * np.arange(600 * fine)
        turn = rng.uniform(0.0, 2.0 * np.pi, 3)
        waves = np.sin(2.0 * np.pi * np.array([0.31, 0.83, 1.9]) * t[:, None] + turn).sum(axis=1)
        force = -14.0 + 5.0 * waves
        assert force.max() < edges[1]
        pushed = np.minimum(force - edges[0], 0.0) + np.maximum(force - edges[1], 0.0)
        decay, speed, place, x = np.exp(-1e-3 * damping / mass), 0.0, 0.0, np.empty(t.size)
        for k, push in enumerate(pushed.tolist()):
            x[k] = place
            speed = push / damping + (speed - push / damping) * decay
            place += 1e-3 * speed
        log = {
            "time": t[::fine], "force": force[::fine] + 0.1 * rng.standard_normal(600),
            "position": x[::fine] + 1e-5 * rng.standard_normal(600),
        }  # fmt: skip
        found = ff.fit("hydrostatic", log).parameters
        assert found["dead_zone_positive"].status == "not_identified"
        for name, truth in (("mass", mass), ("damping", damping), ("dead_zone_negative", -10.0)):
            q = found[name]
            assert abs(float(q.number) - truth) < 4.0 * float(q.std_error), name


def test_a_late_force_behind_its_noise_is_not_passed_over() -> None:
    """Noise hides all that the model may lack, and a delay of 20 ms was taken for mass."""
    late = next(
        a for a in hydrostatic.attacks()
        if a.group == "another machine, noisy force" and a.name == "force 20 ms late"
    )  # fmt: skip
    found = run(late, 0, 71_271_127)
    assert abs(found.errors["mass"].deviations) > 4.0
    assert found.codes == ("unexamined",)
