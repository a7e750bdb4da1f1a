# ruff: noqa: T201 (it prints its table)
"""Long logs: memory and processor time of one fit over the number of rows.

    python -m studies.long_logs --rows 1e5 1e6 1e7 --results FILE
    python -m studies.long_logs --rows 1e5 1e6 1e7 2e7 --kind "even Parquet" --results FILE --write

The input of every plant is held between random levels, so that its response is known in closed
form, mode by mode, at any instant: nothing of the estimator makes these logs. They are written
block by block and fitted by the command in a fresh process. What FILE holds is not measured
again, and the page shows all of it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import yaml
from pyarrow import csv, parquet

Array = npt.NDArray[Any]
ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "long-logs.md"
PICTURE = ROOT / "docs" / "evidence" / "pictures" / "long-logs.png"
_EXPLAINED = """# Long logs

Written by `python -m studies.long_logs --write`. Every log is sampled at 1 kHz with noise on its
output and made by a closed form; the command runs in a fresh process. Memory is the largest
resident set of that process, or of the one that reads Parquet for it; time is the processor time of
both, on a machine that did other work as well. `times read_csv` is what the rows beyond those of
the line above took, over what `pandas.read_csv` takes for as many more rows of the same log as CSV,
the quickest of three. The exponent is that of the time over the rows, from the line above to
this one; over all rows of a log it stands in the second table. `deviations` is the largest of the
parameters from the truth, in standard errors.

A fit keeps every row of its logs, the derivatives by the parameters among them, some 80 to 140
bytes a row, and takes 2*10^7 samples at most. A potentiometer keeps each distinct reading beside
them, with how many samples have it, their mean and their scatter: little for the readings of a
converter, as here, but some 150 bytes a row where hardly two readings are alike.

"""
_STEP = 1e-3  # s
_BLOCK = 1 << 18  # rows made at once
_JITTER = 0.3  # of a step, of unevenly sampled logs
_GOLDEN = 0.6180339887498949
_MEASURED = (
    "import resource, runpy, sys\n"
    "def used():\n"
    "    both = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN\n"
    "    return sum(sum(resource.getrusage(who)[:2]) for who in both)\n"
    "began = used()\n"
    "sys.argv = sys.argv[1:]\n"
    "try:\n"
    "    if sys.argv[0] == 'read_csv':\n"
    "        import pandas\n"
    "        began = used()\n"
    "        pandas.read_csv(sys.argv[1])\n"
    "    else:\n"
    "        runpy.run_module(sys.argv[0], run_name='__main__')\n"
    "finally:\n"
    "    taken = used() - began\n"
    # ru_maxrss begins with what the process that started this one had
    "    peak = next(x for x in open('/proc/self/status') if x.startswith('VmHWM'))\n"
    "    largest = max(float(peak.split()[1]), resource.getrusage(resource.RUSAGE_CHILDREN)[2])\n"
    "    print(taken, largest / 1024.0, file=sys.stderr)\n"
)


@dataclass(frozen=True)
class Plant:
    """A linear plant by its modes, ``z' = pole z + drive w(u)``, ``y = sum of z`` after a delay.

    ``levels`` draws the held levels of its input, ``acts`` is what of them drives it.
    """

    headers: tuple[str, str]
    truth: dict[str, float]
    poles: tuple[complex, ...]
    drives: tuple[complex, ...]
    dead_time: float
    noise: float
    levels: Callable[[np.random.Generator, int], Array]
    acts: Callable[[Array], Array] = lambda u: u
    options: str = ""

    def blocks(self, rows: int, seed: int, uneven: bool) -> Iterator[list[Array]]:
        """Time, input and output, block by block."""
        rng = np.random.default_rng(seed)
        switched = np.cumsum(rng.integers(20, 200, rows // 20 + 2))
        switched = np.concatenate(([0], switched[switched < rows]))
        levels = self.levels(rng, switched.size)
        effect, when = self.acts(levels), _instants(switched, uneven) + self.dead_time
        states = [
            _at_switches(pole, drive, when, effect)
            for pole, drive in zip(self.poles, self.drives, strict=True)
        ]
        for begin in range(0, rows, _BLOCK):
            k = np.arange(begin, min(begin + _BLOCK, rows))
            t = _instants(k, uneven)
            piece = np.maximum(np.searchsorted(when, t, side="right") - 1, 0)
            since = np.maximum(t - when[piece], 0.0)
            y = sum(
                np.real(_moved(z[piece], pole, drive, since, effect[piece]))
                for z, pole, drive in zip(states, self.poles, self.drives, strict=True)
            )
            y = y + self.noise * rng.standard_normal(k.size)
            u = levels[np.searchsorted(switched, k, side="right") - 1]
            yield [t, u, np.round(y, 6)]


def _instants(k: Array, uneven: bool) -> Array:
    """Instants of samples [s], as they are printed."""
    shifts = _JITTER * (np.mod(k * _GOLDEN, 1.0) - 0.5) if uneven else 0.0
    return np.round(_STEP * (k + shifts), 6)


def _moved(z: Array, pole: complex, drive: complex, by: Array, effect: Array) -> Array:
    """A mode after some time of a constant drive."""
    if pole == 0.0:
        return np.asarray(z + drive * effect * by)
    grown = np.exp(pole * by)
    return np.asarray(z * grown + drive / pole * (grown - 1.0) * effect)


def _at_switches(pole: complex, drive: complex, when: Array, effect: Array) -> Array:
    """A mode at the instants from which a level acts; the first has acted for ever."""
    rest = -drive / pole * effect[0] if pole != 0.0 else 0.0
    states = [complex(rest)]
    steps = np.diff(when)
    grown = np.exp(pole * steps)
    added = _moved(np.zeros(steps.size), pole, drive, steps, effect[:-1])
    for factor, more in zip(grown.tolist(), added.tolist()):
        states.append(states[-1] * factor + more)
    return np.array(states)


@dataclass(frozen=True)
class Curve:
    """A potentiometer: its position is a rational curve of the reading, which is a multisine."""

    headers: tuple[str, str] = ("reading", "reference [mm]")
    points: tuple[float, ...] = (0.0, 35.0, 70.0, 100.0)
    weights: tuple[float, ...] = (1.0, 1.4, 0.8, 1.1)
    noise: float = 0.05
    options: str = "--degree 3"

    @property
    def truth(self) -> dict[str, float]:
        """What does not depend on where the readings happen to end."""
        return {}

    def blocks(self, rows: int, seed: int, uneven: bool) -> Iterator[list[Array]]:
        """Time, reading [V] and position [mm], block by block."""
        rng = np.random.default_rng(seed)
        phases = rng.uniform(0.0, 2.0 * np.pi, 5)
        rates = 2.0 * np.pi * np.array([0.11, 0.23, 0.31, 0.47, 0.73])
        for begin in range(0, rows, _BLOCK):
            t = _instants(np.arange(begin, min(begin + _BLOCK, rows)), uneven)
            swing = sum(np.sin(r * t + p) for r, p in zip(rates, phases)) / 2.6
            place = 0.5 + 0.5 * np.sin(0.5 * np.pi * np.asarray(swing))
            top, below = np.zeros(t.size), np.zeros(t.size)
            for k, (p, w, c) in enumerate(zip(self.points, self.weights, (1, 3, 3, 1))):
                share = c * w * place**k * (1.0 - place) ** (3 - k)
                top, below = top + share * p, below + share
            y = top / below + self.noise * rng.standard_normal(t.size)
            yield [t, np.round(1.0 + 8.0 * place, 6), np.round(y, 5)]


def _two_levels(low: float, high: float) -> Callable[[np.random.Generator, int], Array]:
    def draw(rng: np.random.Generator, count: int) -> Array:
        del rng
        return np.where(np.arange(count) % 2, high, low)

    return draw


def _strokes(rng: np.random.Generator, count: int) -> Array:
    """Forces outside a dead zone of -10 to 12 N by as much to either side, and rests between."""
    size = rng.uniform(8.0, 25.0, count // 4 + 1)
    none = np.zeros_like(size)
    levels = np.column_stack((12.0 + size, none, -10.0 - size, none)).ravel()[:count]
    return np.round(levels, 3)


def _valve() -> Plant:
    gain, frequency, damping = 0.8, 60.0, 0.6
    pole = frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    drive = gain * frequency**2 / (2j * pole.imag)
    return Plant(
        ("command [V]", "outlet [bar]"),
        {"gain": gain * 1e5, "natural_frequency": frequency, "damping_ratio": damping},
        (pole, pole.conjugate()), (drive, drive.conjugate()), 0.0, 0.01, _two_levels(2.0, 6.0),
    )  # fmt: skip


def _hydrostatic() -> Plant:
    mass, damping = 0.8, 40.0
    rate = damping / mass
    return Plant(
        ("force [N]", "position [mm]"),
        {"mass": mass, "damping": damping, "dead_zone_negative": -10.0, "dead_zone_positive": 12.0},
        (0.0, -rate), (1e3 / damping, -1e3 / damping), 0.0, 0.05, _strokes,
        lambda f: np.maximum(f - 12.0, 0.0) + np.minimum(f + 10.0, 0.0),
    )  # fmt: skip


PLANTS: dict[str, Plant | Curve] = {
    "line": Plant(
        ("inlet [bar]", "outlet [bar]"),
        {"gain": 0.98, "time_constant": 0.04, "dead_time": 0.0147},
        (-25.0,), (0.98 * 25.0,), 0.0147, 0.01, _two_levels(1.0, 3.0),
    ),
    "valve": _valve(),
    "hydrostatic": _hydrostatic(),
    "potentiometer": Curve(),
}  # fmt: skip


def write_log(path: Path, family: str, rows: int, uneven: bool, seed: int = 12) -> None:
    """Write a log as CSV or Parquet, by the end of its name."""
    plant = PLANTS[family]
    names = ["time [s]", *plant.headers]
    schema = pa.schema([(name, pa.float64()) for name in names])
    batches = (
        pa.record_batch([pa.array(c) for c in columns], schema=schema)
        for columns in plant.blocks(rows, seed, uneven)
    )
    if path.suffix == ".parquet":
        with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
            for batch in batches:
                writer.write_batch(batch)
        return
    with path.open("wb") as file:
        file.write((",".join(names) + "\n").encode())
        plain = csv.WriteOptions(include_header=False)
        with csv.CSVWriter(file, schema, write_options=plain) as writer:
            for batch in batches:
                writer.write_batch(batch)


@dataclass(frozen=True)
class Taken:
    """What a process took: processor time [s] and largest resident memory [MB]."""

    seconds: float
    memory: float


def measure(*words: str) -> Taken:
    """Run a module, or ``read_csv FILE``, in a fresh process."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, *words], env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    last = done.stderr.strip().splitlines()[-1:] or [""]
    if done.returncode != 0:
        raise SystemExit(f"exit status {done.returncode}: {' '.join(words)}\n{done.stderr}")
    seconds, memory = map(float, last[0].split())
    return Taken(seconds, memory)


def fit(folder: Path, family: str, log: Path) -> tuple[Taken, dict[str, Any]]:
    """Fit a log by the command; what it took, and the document."""
    out = folder / f"{family}.yaml"
    words = ["fluidact_fit_cli.main", family, str(log), "-o", str(out), "--force", "-q"]
    taken = measure(*words, *PLANTS[family].options.split())
    return taken, yaml.safe_load(out.read_text(encoding="utf-8"))


def deviations(family: str, document: dict[str, Any]) -> float:
    """Largest distance of a parameter from the truth, in its standard errors."""
    found = document["parameters"]
    return max(
        (abs(found[n]["value"] - v) / found[n]["std_error"]
         for n, v in PLANTS[family].truth.items()), default=float("nan"),
    )  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One fit of the table."""

    family: str
    kind: str
    rows: int
    taken: Taken
    reading: float
    largest: float

    @property
    def entry(self) -> dict[str, Any]:
        """As it is kept."""
        return {
            "family": self.family, "kind": self.kind, "rows": self.rows, **vars(self.taken),
            "reading": self.reading, "deviations": self.largest,
        }  # fmt: skip

    @classmethod
    def of(cls, entry: dict[str, Any]) -> Row:
        """What was kept."""
        taken = Taken(entry["seconds"], entry["memory"])
        family, kind, rows = (entry[name] for name in ("family", "kind", "rows"))
        return cls(family, kind, rows, taken, entry["reading"], entry["deviations"])


def measure_row(folder: Path, family: str, kind: str, rows: int) -> Row:
    """Write a log, fit it, and read it where that is compared."""
    ending = "parquet" if "Parquet" in kind else "csv"
    log = folder / f"{family}.{ending}"
    write_log(log, family, rows, "uneven" in kind)
    taken, document = fit(folder, family, log)
    reading = np.nan
    if ending == "csv":  # the quickest, as the first to read a file is slow
        reading = min(measure("read_csv", str(log)).seconds for _ in range(3))
    log.unlink()
    return Row(family, kind, rows, taken, reading, deviations(family, document))


def study(
    folder: Path,
    wanted: Sequence[tuple[str, str, int]],
    results: Path | None,
) -> list[Row]:
    """Fit every family at every size, unless that was done; all that was done, in order."""
    kept = results.read_text(encoding="utf-8") if results and results.exists() else ""
    found = [Row.of(json.loads(line)) for line in kept.splitlines()]
    for family, kind, rows in wanted:
        if (family, kind, rows) in {(r.family, r.kind, r.rows) for r in found}:
            continue
        found.append(measure_row(folder, family, kind, rows))
        line = json.dumps(found[-1].entry)
        print(line, flush=True)
        if results:
            with results.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
    order = list(PLANTS)
    return sorted(found, key=lambda r: (r.kind, order.index(r.family), r.rows))


def table(found: Sequence[Row]) -> str:
    """The measurements as Markdown."""
    lines = [
        "| family | log | rows | memory [MB] | time [s] | read_csv [s] | times read_csv | exponent "
        "| deviations |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    before: Row | None = None
    for row in found:
        times = exponent = "-"
        if before is not None and (before.family, before.kind) == (row.family, row.kind):
            more = row.taken.seconds - before.taken.seconds
            if np.isfinite(row.reading):
                times = f"{more / (row.reading - before.reading):.1f}"
            ratio = np.log(row.taken.seconds / before.taken.seconds)
            exponent = f"{ratio / np.log(row.rows / before.rows):.2f}"
        reading = f"{row.reading:.2f}" if np.isfinite(row.reading) else "-"
        largest = f"{row.largest:.1f}" if np.isfinite(row.largest) else "-"
        lines.append(
            f"| {row.family} | {row.kind} | {row.rows:.0e} | {row.taken.memory:.0f} "
            f"| {row.taken.seconds:.1f} | {reading} | {times} | {exponent} | {largest} |"
        )
        before = row
    return "\n".join(lines) + "\n"


def exponents(found: Sequence[Row]) -> str:
    """Exponent of the time over the rows, from the shortest to the longest log, as Markdown."""
    lines = ["| family | log | rows | exponent of time |", "|---|---|---|---|"]
    for family, kind in dict.fromkeys((r.family, r.kind) for r in found):
        own = [r for r in found if (r.family, r.kind) == (family, kind)]
        first, last = own[0], own[-1]
        if last.rows > first.rows:
            ratio = np.log(last.taken.seconds / first.taken.seconds)
            exponent = ratio / np.log(last.rows / first.rows)
            rows = f"{first.rows:.0e} to {last.rows:.0e}"
            lines.append(f"| {family} | {kind} | {rows} | {exponent:.2f} |")
    return "\n".join(lines) + "\n"


def draw(found: Sequence[Row], path: Path) -> None:
    """Time and memory over the rows, both axes logarithmic."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    for family, kind in dict.fromkeys((r.family, r.kind) for r in found):
        own = [r for r in found if (r.family, r.kind) == (family, kind)]
        rows = [r.rows for r in own]
        label = f"{family}, {kind}"
        left.loglog(rows, [r.taken.seconds for r in own], marker="o", markersize=3, label=label)
        right.loglog(rows, [r.taken.memory for r in own], marker="o", markersize=3)
    left.set(xlabel="rows", ylabel="processor time [s]")
    right.set(xlabel="rows", ylabel="largest memory [MB]")
    left.legend(fontsize=6)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, print, and write the page and its picture."""
    parser = argparse.ArgumentParser(prog="python -m studies.long_logs", description=__doc__)
    parser.add_argument("--rows", type=float, nargs="+", default=[1e5, 1e6, 1e7])
    parser.add_argument("--family", nargs="+", default=list(PLANTS), choices=list(PLANTS))
    parser.add_argument("--kind", nargs="+", default=["even CSV"],
                        choices=["even CSV", "uneven CSV", "even Parquet"])  # fmt: skip
    parser.add_argument("--folder", help="for the logs (default: a temporary one)")
    parser.add_argument("--results", type=Path, help="where measurements are kept, JSON lines")
    parser.add_argument("--write", action="store_true", help="write the page and the picture")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        sizes = [round(n) for n in given.rows]
        wanted = [(f, k, n) for k in given.kind for f in given.family for n in sizes]
        found = study(Path(folder), wanted, given.results)
    page = table(found) + "\n" + exponents(found)
    print(page)
    if given.write:
        draw(found, PICTURE)
        PAGE.write_text(
            _EXPLAINED + page + "\n![Time and memory](pictures/long-logs.png)\n",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
