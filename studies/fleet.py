# ruff: noqa: T201 (it prints its table)
"""A synthetic fleet run as a batch: rate, two workers against one, kills, a Dask scheduler.

    python -m studies.fleet --jobs 10000 --write

Every unit is a transmission line, ``tau y' = K u(t - d) - y``, of which one log of 1,000 rows is
written: its inlet is held between random levels, so the response is known in closed form. Gain,
time constant and dead time vary from unit to unit; 2 % of the units are outliers (a time constant
half as long again), 1 % of the logs are broken.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "fleet.md"
_EXPLAINED = """# A fleet of actuators as one batch

Written by `python -m studies.fleet --jobs 10000 --write`. Every unit is a transmission line with
one log of 1,000 rows, made by its closed form; gain, time constant and dead time vary from unit to
unit. 2 % of the units are outliers (a time constant half as long again), 1 % of the logs are
broken. The logs take up some 20 kB each, the batch another 3 kB a job.

"""
_PROGRAM = [sys.executable, "-m", "fluidact_fit_cli.main"]
_STEP, _ROWS, _HELD = 0.01, 1000, 50  # s, rows, rows of one level
_NOISE = 0.002  # bar
_TYPICAL = {"gain": 0.98, "time_constant": 0.12, "dead_time": 0.0147}
_BETWEEN = {"gain": 0.01, "time_constant": 0.003, "dead_time": 0.0005}
_OUTLIER, _BROKEN = 0.02, 0.01
_OPTIONS = "--unit time=s --unit inlet=bar --unit outlet=bar --hold inlet=zoh"


def make_fleet(folder: Path, jobs: int, seed: int) -> None:
    """Write the logs, ``jobs.csv`` and ``truth.csv``."""
    rng = np.random.default_rng(seed)
    (folder / "units").mkdir(parents=True)
    truth = []
    with (folder / "jobs.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("job", "family", "logs", "options"))
        for k in range(jobs):
            name = f"unit{k:05d}"
            p = {key: _TYPICAL[key] + _BETWEEN[key] * rng.standard_normal() for key in _TYPICAL}
            kind = rng.choice(("outlier", "broken", "good"), p=(_OUTLIER, _BROKEN, 0.97))
            if kind == "outlier":
                p["time_constant"] *= 1.5
            _write_log(folder / "units" / f"{name}.csv", p, rng, kind == "broken")
            table.writerow((name, "line", f"units/{name}.csv", _OPTIONS))
            truth.append({"job": name, "kind": kind, **p})
    pd.DataFrame(truth).to_csv(folder / "truth.csv", index=False)


def _write_log(path: Path, p: dict[str, float], rng: np.random.Generator, broken: bool) -> None:
    t = _STEP * np.arange(_ROWS)
    levels = rng.uniform(1.0, 3.0, _ROWS // _HELD)
    switched = _STEP * _HELD * np.arange(levels.size)
    rises = np.diff(levels, prepend=levels[0])
    since = t[:, None] - switched - p["dead_time"]
    steps = np.where(since > 0.0, -np.expm1(-np.maximum(since, 0.0) / p["time_constant"]), 0.0)
    outlet = p["gain"] * (levels[0] + steps @ rises) + _NOISE * rng.standard_normal(_ROWS)
    inlet = np.repeat(levels, _HELD)
    lines = [f"{a:.3f},{b:.4f},{c:.5f}" for a, b, c in zip(t, inlet, outlet)]
    if broken:  # one way or another
        lines = (
            lines[: rng.integers(0, 3)]
            if rng.random() < 0.5
            else [line.replace(",", ";x;") for line in lines]
        )
    path.write_text("time,inlet,outlet\n" + "\n".join(lines) + "\n", encoding="utf-8")


class Run:
    """One batch as a process, with what it took."""

    def __init__(self, fleet: Path, out: Path, *options: str) -> None:
        self.words = [*_PROGRAM, "batch", str(fleet / "jobs.csv"), "-o", str(out), *options]
        self.out = out

    def start(self) -> subprocess.Popen[bytes]:
        """Start it in a session of its own, so that all of it can be killed."""
        return subprocess.Popen(
            [*self.words, "-q"], start_new_session=True, stdout=subprocess.DEVNULL
        )

    def whole(self) -> float:
        """Run it to its end; returns seconds."""
        began = time.perf_counter()
        process = self.start()
        if process.wait() != 0:
            raise SystemExit(f"exit status {process.returncode}: {self.words}")
        return time.perf_counter() - began

    def summary(self) -> str:
        """The summary as text."""
        return (self.out / "summary.csv").read_text(encoding="utf-8")

    def finished(self) -> list[dict[str, Any]]:
        """What the journal has of every job that ended."""
        lines = (self.out / "journal.jsonl").read_bytes().split(b"\n")
        whole = [line for line in lines if line.startswith(b'{"job"') and line.endswith(b"}")]
        return [json.loads(line) for line in whole]


def killed_and_resumed(run: Run, after: Sequence[float]) -> None:
    """Kill the whole session at instants [s], then let it finish."""
    for seconds in after:
        process = run.start()
        time.sleep(seconds)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    run.whole()


def on_dask(fleet: Path, out: Path, jobs: int) -> Run:
    """Run on a scheduler with three workers, and kill one of them on the way."""
    with tempfile.TemporaryDirectory() as folder:
        about = Path(folder) / "scheduler.json"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        scheduler = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_scheduler", "--scheduler-file", str(about),
             "--port", "0", "--no-dashboard"], **quiet,
        )  # fmt: skip
        while not about.exists():
            time.sleep(0.1)
        address = json.loads(about.read_text())["address"]
        workers = [
            subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1",
                 "--no-nanny", "--no-dashboard"], **quiet,
            ) for _ in range(3)
        ]  # fmt: skip
        try:
            run = Run(fleet, out, "--scheduler", address)
            process = run.start()
            while not _lines(out) > jobs // 3:
                time.sleep(0.2)
            workers[0].kill()
            if process.wait() != 0:
                raise SystemExit(f"exit status {process.returncode} on Dask")
        finally:
            for process in (*workers, scheduler):
                process.kill()
                process.wait()
    return run


def _lines(out: Path) -> int:
    journal = out / "journal.jsonl"
    return journal.read_bytes().count(b'{"job"') if journal.exists() else 0


def judge(fleet: Path, run: Run) -> dict[str, str]:
    """What the batch found, against the truth."""
    found = pd.read_csv(run.out / "summary.csv").merge(pd.read_csv(fleet / "truth.csv"), on="job",
                                                      suffixes=("", "_true"))  # fmt: skip
    done = found[found["status"] == "done"]
    held = {
        name: float((abs(done[name] - done[f"{name}_true"])
                     <= 1.96 * done[f"{name}_std_error"]).mean())
        for name in _TYPICAL
    }  # fmt: skip
    broken = found[found["kind"] == "broken"]
    return {
        "jobs by status": ", ".join(f"{n} {s}" for s, n in found["status"].value_counts().items()),
        "broken logs without a file": f"{int((broken['exit'] != 0).sum())} of {len(broken)}",
        "good logs without a file": str(int(((found["kind"] != "broken") & (found["exit"] != 0))
                                            .sum())),
        "95 % intervals that hold the truth": ", ".join(
            f"{name} {100 * share:.1f} %" for name, share in held.items()
        ),
    }  # fmt: skip


def measure(folder: Path, fleet: Path, jobs: int, rng: np.random.Generator) -> dict[str, str]:
    """Run the fleet in every way; a row of the table each."""
    began = time.perf_counter()
    whole = Run(fleet, folder / "whole", "--workers", "2")
    seconds = whole.whole()
    _say("two workers", began)
    alone = Run(fleet, folder / "alone", "--workers", "1").whole()
    _say("one worker", began)
    resumed = Run(fleet, folder / "resumed")
    kills = sorted(rng.uniform(2.0, 0.4 * seconds, 3))
    killed_and_resumed(resumed, kills)
    _say("killed and resumed", began)
    on = on_dask(fleet, folder / "dask", jobs)
    _say("on Dask", began)
    often = Counter(Counter(entry["job"] for entry in resumed.finished()).values())
    used = sum(entry["seconds"] for entry in whole.finished())
    rate = jobs / used
    return {
        "jobs": f"{jobs}",
        **judge(fleet, whole),
        "two workers": f"{seconds:.0f} s, {used:.0f} s of processor time in the jobs",
        "one worker": f"{alone:.0f} s, {alone / seconds:.2f} times as long",
        "rate per core": f"{rate:.1f} jobs a second",
        "10⁶ logs on 100 cores, from that rate": f"{1e6 / rate / 100 / 60:.0f} minutes",
        "killed (kill -9, all processes) after": ", ".join(f"{k:.0f} s" for k in kills),
        "jobs finished once, more often": f"{often[1]}, {sum(often.values()) - often[1]}",
        "summary after the kills": _same(resumed.summary(), whole.summary()),
        "summary of Dask, one of three workers killed": _same(on.summary(), whole.summary()),
    }


def _same(one: str, other: str) -> str:
    if one == other:
        return "the same, to the byte"
    lines = zip(one.splitlines(), other.splitlines())
    return f"{sum(a != b for a, b in lines)} lines differ"


def _say(what: str, began: float) -> None:
    print(f"{what}: done at {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)


def main() -> None:
    """Make the fleet, run it in every way, print or write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.fleet", description=__doc__)
    parser.add_argument("--jobs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument("--write", action="store_true", help="write the page")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    with tempfile.TemporaryDirectory() as folder:
        fleet = Path(folder) / "fleet"
        make_fleet(fleet, given.jobs, given.seed)
        rows = measure(Path(folder), fleet, given.jobs, rng)
    table = "| | |\n|---|---|\n" + "".join(f"| {a} | {b} |\n" for a, b in rows.items())
    print(table)
    if given.write:
        PAGE.write_text(_EXPLAINED + table, encoding="utf-8")


if __name__ == "__main__":
    main()
