"""Writes ``docs/evidence/benchmark.md`` from what ``run.py`` and ``speed.py`` have measured.

python bench/report.py [--directory .bench] [--output docs/evidence/benchmark.md]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
OWN = "fluidact"
EQUAL = 0.1  # difference of two medians, in bounds, below which they count as equal
SIGNIFICANT = 2.0  # standard errors of the paired difference

_ABOUT = {
    "P1": "dead zone and 1/(m s² + c s), force moved by a hand, position measured",
    "P2": "valve ωₙ²/(s² + 2ζωₙ s + ωₙ²), command held",
    "P3": "line K e^(−Ls)/(τs + 1), dead time a fraction of a sample, inlet held",
    "P4": "ball screw with stick-slip, torque chirp, encoder of 2000 counts",
}
_HEAD = """# Benchmark

Written by `make bench`; do not edit. {date}, {cores} cores, Python {python}, one thread per
process, seed {seed}.

This project against other tools and against scripts, side by side in one run: every trial is
a new log, every tool fits the same log before the next one is made, and the order moves on
with each trial. Problems, simulators and one script per tool are in `bench/`; nothing of them
is shared with `fluidact_fit`. A tool sees instants, input and measured output, and starts
from the same guess. This project is given no start values, except where a row says so.

- **Error**: median of |estimate − truth| over the trials, as a multiple of the Cramér–Rao
  bound, and in % of the truth (dead zones: of the width of the dead zone). An efficient
  estimator has a median of 0.67. The bound takes the initial state, and the gain of P2, as
  known. For P4 it takes the error of the encoder for white noise, which it is not: a
  yardstick.
- **Time**: of the fit alone, without imports and reading, after one fit that was not
  counted; as the median ratio to this project's time on the same log, and in seconds. Other
  work on the machine (load average over 15 minutes at the end: {load}) shows in it.
- **Bold** is the best of a column, with everything that differs from it by less than
  {equal:g} bounds. For the time, bold is the fastest of those that reach the best accuracy
  in every column.
- A dash: the tool does not give this parameter. *n* is the number of trials; a fit longer
  than 5 s gets three, longer than 20 s one, and {limit:g} s is the end of any.
"""


class Cell:
    """Errors of one parameter by one row, over the trials that worked."""

    def __init__(self, row: dict[str, Any], name: str) -> None:
        self.by_trial: dict[Any, float] = {}
        self.relative: list[float] = []
        for t in row["trials"]:
            error = t.get("errors", {}).get(name)
            if error is not None and np.isfinite(error):
                self.by_trial[t["trial"]] = abs(error) / t["bounds"][name]
                self.relative.append(100.0 * abs(error) / t["scales"][name])

    @property
    def median(self) -> float:
        """In bounds; infinite when there is no estimate."""
        return float(np.median(list(self.by_trial.values()))) if self.by_trial else np.inf

    def text(self, best: float, percent: bool = True) -> str:
        """As it stands in the table."""
        if not self.by_trial:
            return "–"
        number = _short(self.median)
        if self.median <= best + EQUAL:
            number = f"**{number}**"
        return number + (f" ({_short(float(np.median(self.relative)))} %)" if percent else "")

    def ahead(self, other: Cell) -> tuple[float, bool]:
        """How far this is ahead of another [bounds], and whether the trials can tell."""
        both = sorted(set(self.by_trial) & set(other.by_trial))
        mine, theirs = (np.array([c.by_trial[k] for k in both]) for c in (self, other))
        if mine.size == 0:
            return -np.inf, False
        lead = float(np.median(theirs) - np.median(mine))
        if mine.size < 3:
            return lead, False
        error = float(np.std(theirs - mine, ddof=1)) / np.sqrt(mine.size)
        return lead, bool(np.mean(theirs - mine) > SIGNIFICANT * error)


def _short(value: float) -> str:
    if value >= 9999.5:
        return f"{value:.1e}"
    return (
        f"{value:.2f}"
        if value >= 0.095 and value < 99.5
        else f"{value:.2g}"
        if value < 1
        else f"{value:.0f}"
    )


def _title(row: dict[str, Any]) -> str:
    fit = row["fit"].partition("|")[2]
    return row["title"] + (f" · {fit}" if fit else "")


def _own(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return next(r for r in rows if r["tool"] == OWN and "|" not in r["fit"])


def _seconds(row: dict[str, Any]) -> dict[Any, float]:
    return {t["trial"]: t["seconds"] for t in row["trials"] if "seconds" in t}


def _ratio(row: dict[str, Any], own: dict[str, Any]) -> float:
    a, b = _seconds(row), _seconds(own)
    both = [a[k] / b[k] for k in a if k in b]
    return float(np.median(both)) if both else np.nan


def _table(
    rows: Sequence[dict[str, Any]], names: Sequence[str], percent: bool = True
) -> tuple[list[str], list[str], list[str]]:
    """Table of one problem, cells where others are ahead, rows that are much faster."""
    own = _own(rows)
    cells = {id(r): {n: Cell(r, n) for n in names} for r in rows}
    best = {n: min(cells[id(r)][n].median for r in rows) for n in names}

    def accurate(row: dict[str, Any]) -> bool:
        return all(cells[id(row)][n].median <= 1.1 * best[n] + EQUAL for n in names)

    def as_good_as_own(row: dict[str, Any]) -> bool:
        mine, other = cells[id(own)], cells[id(row)]
        return all(other[n].median <= 1.1 * mine[n].median + EQUAL for n in names)

    ratios = {id(r): _ratio(r, own) for r in rows}
    fastest = min((ratios[id(r)] for r in rows if accurate(r)), default=np.nan)
    lines = [
        "| | " + " | ".join(names) + " | time | n |",
        "|---" * (len(names) + 3) + "|",
    ]
    lost, faster = [], []
    for row in rows:
        worked = [t for t in row["trials"] if "error" not in t]
        if not worked:
            continue
        mine = cells[id(row)]
        time = f"{_short(ratios[id(row)])}×"
        if ratios[id(row)] == fastest:
            time = f"**{time}**"
        if percent:
            time += f" ({_short(float(np.median(list(_seconds(row).values()))))} s)"
        failed = len(row["trials"]) - len(worked)
        count = str(len(worked)) + (f", {failed} failed" if failed else "")
        lines.append(
            f"| {_title(row)} | "
            + " | ".join(mine[n].text(best[n], percent) for n in names)
            + f" | {time} | {count} |"
        )
        if row["tool"] == OWN:
            continue
        for n in names:
            gain, sure = mine[n].ahead(cells[id(own)][n])
            if gain > EQUAL:
                tell = "and the trials can tell" if sure else "within what the trials can tell"
                lost.append(
                    f"{row['problem']} {n}: {_title(row)} is ahead by {_short(gain)} bounds, {tell}"
                )
        if as_good_as_own(row) and ratios[id(row)] < 0.5:
            faster.append(
                f"{row['problem']}: {_title(row)} is as accurate in {_short(ratios[id(row)])}"
                " of the time"
            )
    return lines, lost, faster


def _list(entries: Iterable[str], none: str) -> list[str]:
    return [f"- {e}" for e in entries] or [f"- {none}"]


def head_to_head(data: dict[str, Any]) -> list[str]:
    """Main tables, what was lost, what did not run."""
    lost: list[str] = []
    faster: list[str] = []
    lines = []
    for name, problem in data["problems"].items():
        rows = [r for r in data["rows"] if r["problem"] == name]
        table, some, quick = _table(rows, list(problem["truth"]))
        truth = ", ".join(f"{k} = {v:.4g}" for k, v in problem["truth"].items())
        lines += ["", f"### {name}: {_ABOUT[name]}", "", f"True values (SI): {truth}.", "", *table]
        lost, faster = lost + some, faster + quick
    lines += ["", "### Where another tool is ahead in accuracy", ""]
    lines += _list(lost, "In no cell.")
    lines += ["", "### Where a tool of the same accuracy takes less than half the time", ""]
    lines += _list(faster, "In no problem.")
    lines += ["", "### What did not run", ""]
    failures = [f"{tool}: {reason}" for tool, reason in data["missing"].items()]
    for row in data["rows"]:
        for reason in dict.fromkeys(t["error"] for t in row["trials"] if "error" in t):
            failures.append(f"{_title(row)} on {row['problem']}: {reason}")
    lines += _list((f.replace("\n", " ") for f in failures), "Everything ran.")
    lines += ["", "### Versions", ""]
    versions = {k.strip("*"): v for k, v in data["versions"].items() if v != "emulated"}
    lines += [", ".join(f"{k} {v}" for k, v in versions.items()) + "."]
    lines += [
        "",
        "MATLAB and WPILib SysId cannot be run here: what is marked as emulated is their "
        "published method, written anew.",
    ]
    return lines


def variations(data: dict[str, Any]) -> list[str]:
    """One table per problem over all variations."""
    if not data["variations"]:
        return []
    lines = [
        "",
        "## Other machines, other logs",
        "",
        f"The same over {len(data['variations'])} random variations of true values (up to a "
        "factor 1.6 either way), noise (0.1 % to 10 %), sample time (5 ms to 20 ms) and length "
        "(5 s to 20 s), three trials of each: medians over all of them, in bounds, with the "
        f"guess unchanged. For the fits that took less than {data['quick']:g} s above.",
    ]
    lost: list[str] = []
    for name in data["problems"]:
        merged: dict[tuple[str, str], dict[str, Any]] = {}
        names: list[str] = []
        for number, some in data["variations"].items():
            names = list(some["problems"][name]["truth"])
            for row in some["rows"]:
                if row["problem"] == name:
                    one = merged.setdefault((row["tool"], row["fit"]), {**row, "trials": []})
                    one["trials"] += [
                        {**t, "trial": f"{number}.{t['trial']}"} for t in row["trials"]
                    ]
        if not any(tool == OWN for tool, _ in merged):
            lines += ["", f"### {name}, varied", "", "This project was left out of this run."]
            continue
        table, some_lost, _ = _table(list(merged.values()), names, percent=False)
        lost += some_lost
        lines += ["", f"### {name}, varied", "", *table]
    lines += ["", "### Where another tool is ahead over the variations", ""]
    return lines + _list(lost, "In no cell.")


def speed(data: dict[str, Any]) -> list[str]:
    """Whole processes."""

    def spread(values: Sequence[float]) -> str:
        return " / ".join(f"{f(values):.2f}" for f in (min, np.median, max))

    lines = [
        "",
        "## Whole processes",
        "",
        "Seconds from start to end of a new process, files in the page cache: smallest / median "
        "/ largest. Wall time holds whatever else the machine had to do (load average over 5 "
        f"minutes at the end: {data['load']:.1f}); processor time does not.",
        "",
        "| command | runs | wall time, s | processor time, s |",
        "|---|---|---|---|",
    ]
    for name, times in data["short"].items():
        what = "`--help`" if name == "--help" else f"`{name}`, the logs of `datasets/{name}`"
        lines.append(
            f"| {what} | {len(times['fit'])} | {spread(times['fit'])} | "
            f"{spread(times['fit, processor'])} |"
        )
    lines += [
        "",
        f"One log of {data['rows']:,} rows, against `pandas.read_csv` of the same file, in turn. "
        "*Call*: `read_csv` alone in a new process that has imported pandas. *Process*: a new "
        "Python process that imports pandas, reads the file and ends. Ratios are of medians.",
    ]
    for clock, suffix in (("Wall", ""), ("Processor", ", processor")):
        lines += [
            "",
            f"{clock} time, s:",
            "",
            "| family | runs | fit, whole process | `read_csv`, call | ratio | process | ratio |",
            "|---|---|---|---|---|---|---|",
        ]
        for family, times in data["long"].items():
            if "fit" not in times:
                continue
            every = [times[k + suffix] for k in ("fit", "read", "process")]
            fit, read, process = (float(np.median(v)) for v in every)
            lines.append(
                f"| `{family}` | {len(every[0])} | {spread(every[0])} | {spread(every[1])} | "
                f"{fit / read:.1f} | {spread(every[2])} | {fit / process:.1f} |"
            )
    if data["failed"]:
        lines += ["", "Failed:", "", *_list((f"{k}: {v}" for k, v in data["failed"].items()), "")]
    return lines


def main() -> int:
    """Write the document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--directory", type=Path, default=ROOT / ".bench")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "evidence" / "benchmark.md")
    given = parser.parse_args()
    data = json.loads((given.directory / "head-to-head.json").read_text(encoding="utf-8"))
    lines = [_HEAD.format(equal=EQUAL, **{"load": "not recorded", **data}), "## Head to head"]
    if data["variation"]:
        lines[-1] += f", variation {data['variation']}"
    parts: list[Callable[[dict[str, Any]], list[str]]] = [head_to_head, variations]
    for part in parts:
        lines += part(data)
    times = given.directory / "speed.json"
    if times.exists():
        lines += speed(json.loads(times.read_text(encoding="utf-8")))
    given.output.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
