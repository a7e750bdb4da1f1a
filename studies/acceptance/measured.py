"""Logs that other people measured, where ``../shared/data`` holds them.

They are no part of the repository. What is published of each stands in the reference of its
rows; the other numbers are the project's own and have to stay.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .command import Run, fit
from .figures import Figure, codes, number, parameter, rmse, value, words
from .task import Task

BORE, ROD = np.pi / 4.0 * 0.016**2, np.pi / 4.0 * 0.010**2  # hydcyl [m2]
PNEUMATIC = np.pi / 4.0 * 0.025**2  # pneucyl [m2]
RANGES = {
    "O-ring": {1: 7.8, 3: 10.9, 5: 13.8, 7: 15.6},
    "NAPN": {1: 6.7, 3: 13.7, 5: 19.0, 7: 23.1},
}  # half the range of F - pA about its mean, both directions together [N]


def tasks(data: Path) -> list[Task]:
    """All that the folder holds, by group."""
    made: list[tuple[str, str, float, Callable[[Path, Path], list[Figure]]]] = [
        ("emps", "asymmetric", 200.0, _emps_asymmetric),
        ("emps", "symmetric", 20.0, _emps),
        ("tubes", "tubes", 80.0, _tubes),
        ("hydcyl", "gains", 5.0, _hydraulic_cylinder),
        ("hydcyl", "friction", 5.0, _hydraulic_friction),
        ("pneucyl", "friction", 15.0, _pneumatic_friction),
        ("muscle", "8 units", 60.0, partial(_muscle, 8, 8.5)),
        ("muscle", "16 units", 150.0, partial(_muscle, 16, 6.3)),
        ("dryer", "dryer", 5.0, _dryer),
        ("nist", "Kirby2", 2.0, _kirby),
        ("hydraulic_motor", "motor", 10.0, _motor),
        ("linpot", "potentiometer", 3.0, _linear_potentiometer),
    ]
    return [
        Task(group, name, seconds, partial(figures, data / group))
        for group, name, seconds, figures in made
        if (data / group).is_dir()
    ]


GROUPS = ("emps", "tubes", "hydcyl", "pneucyl", "muscle", "dryer", "nist", "hydraulic_motor",
          "linpot")  # fmt: skip


def columns(**headers: str) -> list[str]:
    """``--column ROLE=HEADER`` of each; a unit follows after a blank."""
    out = []
    for role, given in headers.items():
        header, _, unit = given.partition(" ")
        out += ["--column", f"{role}={header}"]
        out += ["--unit", f"{role}={unit}"] if unit else []
    return out


def _ends(group: str, name: str, run: Run, verdict: str) -> list[Figure]:
    wanted = f"exit 0, {verdict}"
    return [
        words(group, f"{name}: end", "exit status and verdict", run.outcome, wanted),
        words(group, f"{name}: warnings", "codes", codes(run.file, run.word)),
    ]


def emps_command(data: Path) -> list[str]:
    """The fit of the EMPS axis."""
    log = data / "emps" / "emps_train.csv"
    return ["ball-screw", str(log), "--column", "position=q_m", "--column", "force=force_N"]


def _emps(data: Path, folder: Path) -> list[Figure]:
    run = fit(emps_command(data.parent), folder / "emps.yaml")
    published = {"mass": 95.1089, "viscous": 203.5034, "coulomb_mean": 20.3935,
                 "coulomb_offset": -3.1648}  # fmt: skip
    return [
        *_ends("emps", "EMPS symmetric", run, "warn"),
        *(
            parameter("emps", f"EMPS symmetric: {name}", run.file, name, run.word, aim=true,
                      reference=f"published {true:g}")
            for name, true in published.items()
        ),
        number("emps", "EMPS symmetric: rmse", "position rms [m]",
               "published 6.74e-3, refitted 2.71e-3", rmse(run.file, run.word), "low",
               share=1e-3, limit=2.71e-3),
    ]  # fmt: skip


def _emps_asymmetric(data: Path, folder: Path) -> list[Figure]:
    given = [*emps_command(data.parent), "--viscous", "asymmetric"]
    run = fit(given, folder / "emps-asymmetric.yaml")
    return [
        words("emps", "EMPS asymmetric: end", "exit status and verdict", run.outcome,
              "exit 0, warn"),
        number("emps", "EMPS asymmetric: rmse", "position rms [m]", "at most 1.7e-3",
               rmse(run.file, run.word), "low", share=1e-2, limit=1.7e-3),
    ]  # fmt: skip


def _tubes(data: Path, folder: Path) -> list[Figure]:
    """A first-order line with dead time for each log of the valve side, as a step."""
    published = {1: 23.3, 3: 51.7, 5: 93.9, 7: 129.9}
    lags: dict[int, list[float]] = {length: [] for length in published}
    errors, ends = [], []
    for path in sorted(data.glob("*_start*.csv")):
        name = re.match(r"tube_l(\d)_p([\d.]+)_start", path.name)
        assert name is not None
        given = ["line", str(path), *columns(time="#1 ms", outlet="#3 bar"),
                 "--step", f"inlet=0:{name[2]}@0", "--unit", "inlet=bar"]  # fmt: skip
        run = fit(given, folder / "tube.yaml")
        ends.append(run.word)
        if run.file is not None:
            lags[int(name[1])].append(1e3 * float(run.file["parameters"]["time_constant"]["value"]))
            errors.append(1e-5 * float(run.file["fit"]["rmse"]["value"]))
    fitted = f"{len(errors)} of {len(ends)} logs fitted"
    out = [words("tubes", "tubes: logs", "logs fitted", fitted, "28 of 28 logs fitted")]
    for length, true in published.items():
        seen = float(np.median(lags[length])) if lags[length] else "no log fitted"
        out.append(number("tubes", f"tubes: {length} m", "median time constant [ms]",
                          f"published {true:g}, within 10 %", seen, true, share=0.005,
                          limit=0.1 * true))  # fmt: skip
    seen = float(np.mean(errors)) if errors else "no log fitted"
    out.append(number("tubes", "tubes: rms", "mean rms [bar]", "at most 0.117", seen, "low",
                      share=0.005, limit=0.117))  # fmt: skip
    return out


def _hydraulic_cylinder(data: Path, folder: Path) -> list[Figure]:
    """Gains of the A logs, then gains and friction of A and B together."""
    given = [
        *columns(time="t_s s", command="u_valve_V V", position="x_m m", pressure_1="pA_Pa Pa"),
        "--area-1", str(BORE), "--area-2", str(BORE - ROD), "--supply-pressure", "4.45e6",
    ]  # fmt: skip
    logs = {c: [str(p) for p in sorted(data.glob(f"p{c}_*.csv"))] for c in "AB"}
    alone = fit(["hydraulic-cylinder", *logs["A"], *given], folder / "hydcyl-a.yaml")
    both = [*logs["A"], *logs["B"], *given, *columns(pressure_2="pB_Pa Pa")]
    run = fit(["hydraulic-cylinder", *both], folder / "hydcyl.yaml")
    gain = "published 5.5e-9 to 5.8e-9"
    rows = [
        ("A logs", alone, "valve_gain_1", 5.65e-9, gain, 0.15e-9),
        ("all logs", run, "valve_gain_1_extending", 5.65e-9, gain, 0.15e-9),
        ("all logs", run, "valve_gain_1", 5.65e-9, gain, 0.15e-9),
        ("all logs", run, "valve_gain_2", "stay", "-", None),
        ("all logs", run, "friction_extending", 66.0, "published 62 to 70", 4.0),
        ("all logs", run, "friction_retracting", -77.0, "published -73 to -81", 4.0),
    ]
    return [
        *_ends("hydcyl", "hydcyl A logs", alone, "warn"),
        *_ends("hydcyl", "hydcyl all logs", run, "warn"),
        *(
            parameter("hydcyl", f"hydcyl {title}: {name}", r.file, name, r.word, aim=aim,
                      reference=reference, limit=limit)
            for title, r, name, aim, reference, limit in rows
        ),
    ]  # fmt: skip


def _hydraulic_friction(data: Path, folder: Path) -> list[Figure]:
    """Friction from both pressures: the A run with the pressure of its B repeat beside it."""
    out = []
    for run_number in (1, 2):
        pair = [np.loadtxt(data / f"p{c}_4V_s{run_number}.csv", delimiter=",", skiprows=1)
                for c in "AB"]  # fmt: skip
        n = min(map(len, pair))
        log = folder / f"hydcyl-4V-{run_number}.csv"
        table = np.column_stack([pair[0][:n, [0, 2, 3]], pair[1][:n, 3]])
        header = "time [s],position [m],pressure [Pa],pressure_2 [Pa]"
        np.savetxt(log, table, delimiter=",", header=header, comments="", fmt="%.9g")
        given = ["cylinder-friction", str(log), "--area", str(BORE), "--area-2", str(BORE - ROD)]
        run = fit(given, log.with_suffix(".yaml"))
        name = f"hydcyl 4 V, run {run_number}"
        out.append(words("hydcyl", f"{name}: viscous", "status at one speed",
                         str(value(run.file, "viscous", run.word)), "not identified"))  # fmt: skip
        for side, aim, published in (
            ("positive", 66.0, "62 to 70"),
            ("negative", 77.0, "73 to 81"),
        ):
            key = f"coulomb_{side}"
            out.append(parameter("hydcyl", f"{name}: {key}", run.file, key, run.word, aim=aim,
                                 reference=f"published {published}", limit=4.0))  # fmt: skip
    return out


def _pneumatic_friction(data: Path, folder: Path) -> list[Figure]:
    out = []
    for seal, ranges in RANGES.items():
        for bar, published in ranges.items():
            given = [
                "cylinder-friction", str(data / f"{seal}_{bar}bar.csv"), "--area", str(PNEUMATIC),
                "--exclude", "lines=1:15",
                *columns(time="#1 ms", position="#5 mm", pressure="#6 bar", force="#7 N"),
            ]  # fmt: skip
            run = fit(given, folder / f"{seal}-{bar}.yaml")
            sides = [value(run.file, f"coulomb_{s}", run.word) for s in ("positive", "negative")]
            trouble = [side for side in sides if isinstance(side, str)]
            seen = trouble[0] if trouble else sum(map(float, sides))
            name = f"pneucyl {seal} {bar} bar"
            viscous = str(value(run.file, "viscous", run.word))
            out.append(words("pneucyl", f"{name}: viscous", "status at one speed", viscous,
                             "not identified"))  # fmt: skip
            out.append(number("pneucyl", f"{name}: range", "sum of both Coulomb levels [N]",
                              f"published {published:g}", seen, published, share=0.002,
                              limit=0.03 * published))  # fmt: skip
    return out


def _muscle(units: int, limit: float, data: Path, folder: Path) -> list[Figure]:
    """Trained on Test8 of all muscles, judged on every row of their Test9."""
    given = [
        "--target", "force", "--inputs", "command,position,length,direction",
        "--hidden", str(units), *columns(force="#1 N", command="#2 kPa", direction="#4 1"),
        "--from-name", "position=kinked{%}", "--set", "*Unkink*:position=0 %",
        "--from-name", "length=_{cm}cm",
    ]  # fmt: skip
    for log in sorted(data.glob("*_Test9.csv")):
        given += ["--validate", str(log)]
    logs = [str(log) for log in sorted(data.glob("*_Test8.csv"))]
    run = fit(["force-map", *logs, *given], folder / f"muscle-{units}.yaml", limit=300.0)
    name, seen = f"muscle {units} units", run.word
    if run.file is not None:
        found = [(v["samples"], float(v["rmse"]["value"])) for v in run.file["validation"]]
        seen = float(np.sqrt(np.average([e**2 for _, e in found], weights=[n for n, _ in found])))
    return [
        words("muscle", f"{name}: end", "exit status and verdict", run.outcome, "exit 0, warn"),
        number("muscle", f"{name}: Test9", "rms of the repeat that was not fitted [N]",
               f"at most {limit:g}", seen, "low", share=0.03, limit=limit),
        number("muscle", f"{name}: Test8", "rms of the fitted logs [N]", "-",
               rmse(run.file, run.word), "low", share=0.03),
    ]  # fmt: skip


def _dryer(data: Path, folder: Path) -> list[Figure]:
    """Fitted to 300 samples, judged on the 200 that follow."""
    given = [str(data / "dryer_first500.dat"), "--sample-time", "0.08",
             "--window", ":23.95", "--validate-window", "23.95:"]  # fmt: skip
    # a line takes pressures: volts stand for pascals
    runs = {
        "first order": ["line", *given, *columns(inlet="#1 Pa", outlet="#2 Pa"),
                        "--hold", "inlet=zoh"],
        "second order": ["valve", *given, *columns(command="#1 V", outlet="#2 V"),
                         "--dead-time", "estimate"],
    }  # fmt: skip
    published = {"first order": 81.0, "second order": 85.8}
    out = []
    for name, words_of_run in runs.items():
        run = fit(words_of_run, folder / "dryer.yaml")
        title = f"dryer {name}"
        seen = run.word if run.file is None else float(run.file["validation"][0]["fit_percent"])
        out += [
            words("dryer", f"{title}: end", "exit status and verdict", run.outcome),
            number("dryer", f"{title}: fit", "fit of 200 samples that were not fitted [%]",
                   f"published {published[name]:g} (other samples)", seen, "high", noise=0.1,
                   limit=-published[name]),
        ]  # fmt: skip
    return out


def _kirby(data: Path, folder: Path) -> list[Figure]:
    given = ["potentiometer", str(data / "Kirby2.dat"), *columns(reading="#2", reference="#1"),
             "--unit", "reference=1", "--degree", "2"]  # fmt: skip
    run = fit(given, folder / "kirby.yaml")
    certified = 3.9050739624
    seen = run.word if run.file is None else (
        float(run.file["fit"]["rmse"]["value"]) ** 2 * run.file["fit"]["samples"])  # fmt: skip
    noise = 1e-6 * certified
    return [
        *_ends("nist", "Kirby2", run, "warn"),
        number("nist", "Kirby2: sum", "residual sum of squares", f"certified {certified:.11g}",
               seen, certified, noise=noise, limit=noise),
    ]  # fmt: skip


def _motor(data: Path, folder: Path) -> list[Figure]:
    given = ["hydraulic-motor", str(data / "MotorRotation.csv"),
             *columns(time="#1 s", command="#2 A", speed="#3 rad/s")]  # fmt: skip
    run = fit(given, folder / "motor.yaml")
    noted = {"time_constant": "0.05 to 0.1 by eye"}
    names = ("dead_zone", "gain", "curvature", "saturation_command", "hysteresis",
             "time_constant", "dead_time")  # fmt: skip
    return [
        *_ends("hydraulic_motor", "motor bench", run, "warn"),
        *(
            parameter("hydraulic_motor", f"motor bench: {name}", run.file, name, run.word,
                      reference=noted.get(name, "-"))
            for name in names
        ),
        number("hydraulic_motor", "motor bench: rmse", "rmse [rad/s]", "-",
               rmse(run.file, run.word), "low", share=1e-3),
    ]  # fmt: skip


def _linear_potentiometer(data: Path, folder: Path) -> list[Figure]:
    given = ["potentiometer", str(data / "linear_pot_adc.csv"), "--column", "reading=ADC",
             "--column", "reference=D (mm)"]  # fmt: skip
    open_ends = fit(given, folder / "linpot-open.yaml")
    run = fit([*given, "--rails", "0:1022"], folder / "linpot.yaml")
    warned = codes(open_ends.file, open_ends.word)
    return [
        # its positions were approached from one side, so that nobody knows its play
        words("linpot", "linear potentiometer: clipped ends", "codes without `--rails`", warned,
              "one-direction rails-suspected"),
        words("linpot", "linear potentiometer: end", "exit status, verdict and codes",
              f"{run.outcome}: {codes(run.file, run.word)}", "exit 0, warn: one-direction rails"),
        number("linpot", "linear potentiometer: rmse", "rmse with `--rails` [m]",
               "linear 5.75e-5, quadratic 4.69e-5", rmse(run.file, run.word), "low",
               share=1e-3, limit=4.69e-5),
    ]  # fmt: skip
