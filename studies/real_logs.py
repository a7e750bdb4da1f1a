# ruff: noqa: T201 (it prints its table)
"""Every recorded log of other people, read without an edit and fitted.

    python studies/real_logs.py [DIRECTORY] [--write]

Each file goes through ``inspect`` and a fit of a family that fits it, as an engineer would call
them. ``--write`` writes ``docs/evidence/real-logs.md``. The logs are not part of this repository
(../shared/data); the study says so where they are missing.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fluidact_fit_cli.main import run

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "real-logs.md"
_EXPLAINED = """\
# Recorded logs

Written by `studies/real_logs.py --write`: logs that other people recorded, each read by `inspect`
and fitted as it is, without an edit. They are not part of this repository. What was left out are
lines that `inspect` names, with the reason; the logs of terminals begin in the middle of one.
Exit 4 says that the data cannot determine what was asked, and what.

| logs | files | dialect | rows | left out | fit | outcome |
|---|---|---|---|---|---|---|
"""
_COMMANDS = """
## Commands

What follows the names of the logs; `PRESSURE` is that in the name of each.

| logs | command |
|---|---|
"""


def _columns(**headers: str) -> list[str]:
    """``--column`` of each role, and ``--unit`` where a unit stands behind a blank."""
    words = []
    for role, given in headers.items():
        header, _, unit = given.partition("; ")
        words += ["--column", f"{role}={header}"]
        words += ["--unit", f"{role}={unit}"] if unit else []
    return words


@dataclass(frozen=True)
class Task:
    """Files of one kind and the words of their fit; ``together`` in one fit or each alone.

    ``pattern`` may hold several, with blanks between; logs of ``judged`` validate. ``PRESSURE`` in
    the words is that of the file: 1.5 of ``tube_l1_p1.5_end.csv``.
    """

    title: str
    pattern: str
    words: Sequence[str]
    together: bool = False
    judged: str = ""


_EPOS = _columns(
    torque="Torque actual value averaged; % of 9.84 mN m",
    angular_velocity="velocity actual value averaged",
)
_TURNED = ["--scale", "torque=-1", "--scale", "angular_velocity=-1"]
_MEASURED = ["line", *_columns(time="#1; ms", inlet="#2; bar", outlet="#3; bar")]
_STEPPED = ["line", *_columns(time="#1; ms", outlet="#3; bar"), "--unit", "inlet=bar"]
_FILLED = [*_STEPPED, "--step", "inlet=0:PRESSURE"]
_VENTED = [*_STEPPED, "--step", "inlet=PRESSURE:0"]
TASKS = (
    Task("EMPS axis", "emps/*.csv",
         ["ball-screw", *_columns(position="q_m", force="force_N")]),
    Task("tube of 1 m, filled", "tubes/tube_l1*_start*.csv", _FILLED),
    Task("tube of 3 m, filled", "tubes/tube_l3*_start*.csv", _FILLED),
    Task("tube of 5 m, filled", "tubes/tube_l5*_start*.csv", _FILLED),
    Task("tube of 7 m, filled", "tubes/tube_l7*_start*.csv", _FILLED),
    Task("tube of 1 m, vented", "tubes/tube_l1*_end*.csv", _VENTED),
    Task("tube of 3 m, vented", "tubes/tube_l3*_end*.csv", _VENTED),
    Task("tube of 5 m, vented", "tubes/tube_l5*_end*.csv", _VENTED),
    Task("tube of 7 m, vented", "tubes/tube_l7*_end*.csv", _VENTED),
    Task("tube of 1 m, filled and vented, measured inlet",
         "tubes/tube_l1_p2.csv tubes/tube_l1_p[24]_[123].csv", _MEASURED),
    Task("hydraulic cylinder, A", "hydcyl/pA*.csv",
         ["hydraulic-cylinder", "--area-1", "2.0106e-4", "--area-2", "1.2252e-4",
          "--supply-pressure", "4.45e6",
          *_columns(time="t_s; s", command="u_valve_V; V", position="x_m; m",
                    pressure_1="pA_Pa; Pa")], together=True),
    Task("hydraulic cylinder, B", "hydcyl/pB*.csv",
         ["hydraulic-cylinder", "--area-1", "2.0106e-4", "--area-2", "1.2252e-4",
          "--supply-pressure", "4.45e6",
          *_columns(time="t_s; s", command="u_valve_V; V", position="x_m; m",
                    pressure_2="pB_Pa; Pa")], together=True),
    Task("pneumatic cylinder, seals", "pneucyl/*.csv",
         ["cylinder-friction", "--area", "4.9087e-4", "--exclude", "lines=1:15",
          *_columns(time="#1; ms", position="#5; mm", pressure="#6; bar", force="#7; N")]),
    Task("muscles, one repeat fitted, one validated", "muscle/*Test8.csv",
         ["force-map", "--target", "force", "--inputs", "command,position,length,direction",
          "--hidden", "4", *_columns(force="#1; N", command="#2; kPa", direction="#4; 1"),
          "--from-name", "position=kinked{%}", "--set", "*Unkink*:position=0 %",
          "--from-name", "length=_{cm}cm"], together=True, judged="muscle/*Test9.csv"),
    Task("dryer, first part fitted, second validated", "dryer/*.dat",
         ["valve", "--sample-time", "0.08", "--window", ":20", "--validate-window", "20.08:",
          "--dead-time", "estimate", *_columns(command="#1; V", outlet="#2; V")]),
    Task("NIST Kirby2", "nist/Kirby2.dat",
         ["potentiometer", "--degree", "2", *_columns(reading="#2", reference="#1; mm")]),
    Task("NIST Pontius", "nist/Pontius.csv",
         ["potentiometer", *_columns(reading="load_lb", reference="deflection; mm")]),
    Task("hydraulic motor bench", "hydraulic_motor/*.csv",
         ["hydraulic-motor", *_columns(time="#1; s", command="#2; A", speed="#3; rad/s")]),
    Task("linear potentiometer", "linpot/*.csv",
         ["potentiometer", "--rails", "0:1022", *_columns(reading="ADC", reference="D (mm)")]),
    Task("screw drive 1, steady", "screwdrives/driveNo1/steady_state/*/*.csv",
         ["cylinder-friction", *_EPOS, *_TURNED], together=True),
    Task("screw drive 2, steady", "screwdrives/driveNo2/steady_state/*/*.csv",
         ["cylinder-friction", *_EPOS, *_TURNED], together=True),
    Task("screw drives, start and stop", "screwdrives/*/start_stop/*.csv",
         ["cylinder-friction", *_EPOS, *_TURNED]),
)  # fmt: skip


def _say(words: Sequence[str]) -> tuple[int, str, str]:
    """Exit status, output and messages of a run of the program."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(list(words))
    return status, out.getvalue(), err.getvalue()


def inspect(path: Path) -> dict[str, Any]:
    """What ``inspect`` says of a file."""
    status, out, err = _say(["inspect", str(path), "--json"])
    if status:
        raise SystemExit(f"{path}: exit {status}\n{err}")
    found: dict[str, Any] = json.loads(out)
    return found


def find(data: Path, pattern: str) -> list[Path]:
    """Logs of a pattern, in order."""
    return sorted(p for one in pattern.split() for p in data.glob(one))


def fit(task: Task, paths: Sequence[Path], judged: Sequence[Path], target: Path) -> str:
    """Verdict of a fit, or exit status and the first sentence of the refusal."""
    pressure = re.search(r"_p([0-9.]+)", paths[0].stem)
    given = [w.replace("PRESSURE", pressure[1]) if pressure else w for w in task.words]
    words = [given[0], *map(str, paths), *given[1:], "--json", "-q", "-o", str(target), "--force"]
    for path in judged:
        words += ["--validate", str(path)]
    status, out, err = _say(words)
    if status == 0:
        return f"verdict {json.loads(out)['fit']['verdict']}"
    refusal = err.splitlines()[0]
    print(f"  {refusal}")
    return f"exit {status} ({refusal.removeprefix(f'{paths[0].name}: ').split(':')[0]})"


def row(data: Path, task: Task, folder: Path) -> str:
    """One line of the table."""
    paths, judged = find(data, task.pattern), find(data, task.judged)
    if not paths:
        raise SystemExit(f"no log is called {task.pattern} in {data}")
    seen = [inspect(p) for p in (*paths, *judged)]
    groups = [paths] if task.together else [[p] for p in paths]
    outcomes = Counter(fit(task, group, judged, folder / "fit.yaml") for group in groups)
    dialects = ", ".join(sorted({s["dialect"]["name"] for s in seen}))
    rows, left = (sum(s["rows"] for s in seen), sum(len(s["lines"]["left_out"]) for s in seen))
    outcome = ", ".join(f"{n} x {o}" if n > 1 else o for o, n in outcomes.items())
    cells = (task.title, len(seen), dialects, rows, left, task.words[0], outcome)
    return "| " + " | ".join(map(str, cells)) + " |"


def commands() -> str:
    """The table of what was said for which logs."""
    said = {task.title: shlex.join([task.words[0], "LOG", *task.words[1:]]) for task in TASKS}
    return "".join(f"| {title} | `{words}` |\n" for title, words in said.items())


def main() -> None:
    """Read, fit, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="?", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    if not given.data.is_dir():
        raise SystemExit(f"there are no logs in {given.data}: nothing was read")
    rows = []
    with TemporaryDirectory(prefix="real-logs-") as folder:
        for task in TASKS:
            rows.append(row(given.data, task, Path(folder)))
            print(rows[-1], flush=True)
    if given.write:
        table = "".join(f"{line}\n" for line in rows)
        PAGE.write_text(_EXPLAINED + table + _COMMANDS + commands(), encoding="utf-8")


if __name__ == "__main__":
    main()
