"""Whole processes, cold: help, the fits of ``datasets/``, and logs of a million rows.

    python bench/speed.py [--directory .bench] [--repeat 5] [--rows 1000000]

Every command is a new process. Its files are in the page cache, as they are after they have
been copied from a test bench. Measurements that are compared are taken in turn.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from problems import PROBLEMS, hand_force, hand_moved_mass, line, multistep, valve

ROOT = Path(__file__).resolve().parents[1]
_PROGRAM = [sys.executable, "-c", "from fluidact_fit_cli.main import main; main()"]
_READ = (
    "import sys, time, pandas\n"
    "began, busy = time.perf_counter(), time.process_time()\n"
    "pandas.read_csv(sys.argv[1])\n"
    "print(time.perf_counter() - began, time.process_time() - busy)\n"
)


def timed(command: list[str]) -> tuple[float, float, str]:
    """Run a command; returns wall time, processor time [s] and what it said."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    wall = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(command[3:])}: {done.stderr.strip()[-400:]}")
    return wall, processor, done.stdout


def small_fits() -> dict[str, list[str]]:
    """The commands that the datasets' own descriptions give."""
    found = {}
    for page in sorted((ROOT / "datasets").glob("*/README.md")):
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            words = shlex.split(block.replace("\\\n", " "))
            if words[:1] == ["fluidact-fit"] and "-o" in words:
                at = words.index("-o")
                found.setdefault(words[1], words[1:at] + words[at + 2 :])
    return found


def long_logs(directory: Path, rows: int) -> dict[str, tuple[Path, list[str]]]:
    """Write one long log per family, at 1 kHz; returns paths and what the command adds."""
    directory.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(2026)
    step = 1e-3
    t = np.round(np.arange(rows) * step, 6)
    levels = multistep(rng, rows, step)
    # slow strokes that go on as long as the log does
    force = np.tile(hand_force(rng, 50.0)(np.arange(0.0, 50.0, step)), rows // 50_000 + 1)[:rows]
    position = hand_moved_mass(PROBLEMS["P1"].truth, force, step, fine=1)
    reading = rng.integers(40, 980, rows)
    share = reading / 1023.0
    travel = 50.0 * share * (1.0 + 0.5 * share) / (1.0 + 0.5 * share**2)
    noise = rng.standard_normal(rows)
    tables = {
        "valve": ({"time [s]": t, "command [V]": levels,
                   "outlet [V]": valve(PROBLEMS["P2"].truth, levels, step) + 0.01 * noise}, []),
        "line": ({"time [s]": t, "inlet [bar]": levels,
                  "outlet [bar]": line(PROBLEMS["P3"].truth, levels, step) + 0.01 * noise},
                 ["--hold", "inlet=zoh"]),
        "hydrostatic": ({"time [s]": t, "force [N]": force,
                         "position [mm]": 1e3 * position + 0.02 * noise}, []),
        "potentiometer": ({"reading": reading, "reference [mm]": travel + 0.02 * noise}, []),
    }  # fmt: skip
    out = {}
    for family, (columns, extra) in tables.items():
        path = directory / f"{family}-{rows}.csv"
        if not path.exists():
            pd.DataFrame(columns).to_csv(path, index=False, float_format="%.6g")
        out[family] = (path, extra)
    return out


def main() -> int:
    """Measure and write ``speed.json``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--directory", type=Path, default=ROOT / ".bench")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--rows", type=int, default=1_000_000)
    given = parser.parse_args()
    directory = given.directory.resolve()
    scratch = directory / "logs"
    output = ["-o", str(scratch / "out.yaml"), "-f"]
    long = long_logs(scratch, given.rows)
    cases: dict[str, list[str]] = {"--help": ["--help"]}
    cases |= {name: [*words, *output] for name, words in small_fits().items()}
    short: dict[str, dict[str, list[float]]] = {}
    large: dict[str, dict[str, list[float]]] = {}
    failed: dict[str, str] = {}

    def note(entry: dict[str, list[float]], name: str, wall: float, processor: float) -> None:
        entry.setdefault(name, []).append(wall)
        entry.setdefault(f"{name}, processor", []).append(processor)

    for _ in range(given.repeat):
        for name, words in cases.items():
            try:
                note(short.setdefault(name, {}), "fit", *timed([*_PROGRAM, *words])[:2])
            except RuntimeError as error:
                failed[name] = str(error)
    for _ in range(max(given.repeat // 2 + 1, 2)):
        for family, (path, extra) in long.items():
            entry = large.setdefault(family, {})
            wall, processor, said = timed([sys.executable, "-c", _READ, str(path)])
            note(entry, "process", wall, processor)
            note(entry, "read", *map(float, said.split()))
            try:
                words = [*_PROGRAM, family, str(path), *extra, *output]
                note(entry, "fit", *timed(words)[:2])
            except RuntimeError as error:
                failed[f"{family}, {given.rows} rows"] = str(error)
            sys.stderr.write(f"{family} done\n")
    result = {
        "rows": given.rows, "short": short, "long": large, "failed": failed,
        "load": os.getloadavg()[1],
    }  # fmt: skip
    (directory / "speed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
