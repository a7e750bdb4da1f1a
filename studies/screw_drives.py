# ruff: noqa: T201 (it prints its results)
"""Friction of two screw drives at constant speeds, one a log, with ``cylinder-friction``.

    python studies/screw_drives.py [DIRECTORY of the logs]

``driveNo1`` and ``driveNo2`` of Mablekos-Alexiou et al. (IEEE Trans. Robotics, 2021), as EPOS
Studio exported them: averaged velocity in rpm, averaged torque in percent of 9.84 mN m, both with
the sign inverted. The figure is the root mean square over all logs of a drive, those
below the dead band too, of their mean torque less the friction at their mean speed. It is
given for the samples as recorded and for the mean speed of each log in place of its samples.

The logs are not part of this repository (../shared/data/screwdrives) and the study says so where
they are missing. Published are two levels and two viscous coefficients, 0.126 and 0.090 mN m,
which is the least that this law can reach.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path

import numpy as np

import fluidact_fit as ff
from fluidact_fit.experiment import Experiment, FloatArray
from fluidact_fit.logs import experiments
from fluidact_fit.mechanics.friction_law import FrictionLaw

LOGS = Path(__file__).parents[1] / ".." / "shared" / "data" / "screwdrives"
COLUMNS = {
    "torque": "Torque actual value averaged",
    "angular_velocity": "Velocity actual value averaged",
}
SCALES = {"torque": -1.0, "angular_velocity": -1.0}
UNITS = {"torque": "% of 9.84 mN m"}
DRIVES = ("driveNo1", "driveNo2")


def read_drive(folder: Path) -> list[ff.Log]:
    """One log for every constant speed of a drive."""
    paths = sorted((folder / "steady_state").rglob("*.csv"))
    return [ff.read_log(p, columns=COLUMNS, units=UNITS, scales=SCALES) for p in paths]


def runs_of(logs: Sequence[ff.Log]) -> list[Experiment]:
    """The logs as arrays in N m and rad/s."""
    variant = ff.get_family("cylinder-friction").variant("angular_velocity")
    return [run for log in logs for run in experiments(log, variant)[0]]


def means_of(logs: Sequence[ff.Log]) -> tuple[FloatArray, FloatArray]:
    """Mean speed [rad/s] and mean torque [N m] of every log, shape ``(n,)``."""
    runs = runs_of(logs)
    speeds = np.array([run["angular_velocity"].mean() for run in runs])
    return speeds, np.array([run["torque"].mean() for run in runs])


def at_mean_speeds(logs: Sequence[ff.Log], folder: Path) -> list[Path]:
    """The same logs with the mean of each velocity in place of its samples."""
    out = []
    for k, run in enumerate(runs_of(logs)):
        v = np.full(run.samples, run["angular_velocity"].mean())
        out.append(folder / f"{k}.csv")
        rows = np.column_stack((run.time, v, run["torque"]))
        header = "time [s],angular_velocity [rad/s],torque [N m]"
        np.savetxt(out[-1], rows, fmt="%.9g", delimiter=",", header=header, comments="")
    return out


def misfit(result: ff.FitResult, logs: Sequence[ff.Log]) -> float:
    """Root mean square over the logs of what friction leaves of their mean torque [mN m]."""
    law = FrictionLaw.of({n: q.number for n, q in result.parameters.items()})
    speeds, torques = means_of(logs)
    return 1e3 * float(np.sqrt(np.mean((torques - law.moving(speeds)) ** 2)))


def least_misfit(logs: Sequence[ff.Log]) -> float:
    """The least that one line for each direction can leave of the mean torques [mN m]."""
    speeds, torques = means_of(logs)
    lines = [c * (speeds * side > 0.0) for side in (1.0, -1.0) for c in (np.sign(speeds), speeds)]
    values = np.linalg.lstsq(np.column_stack(lines), torques, rcond=None)[0]
    return 1e3 * float(np.sqrt(np.mean((torques - values @ lines) ** 2)))


def fit_drive(folder: Path) -> Iterator[tuple[str, str, str, float, ff.FitResult]]:
    """Every way to take the logs of a drive with every law, and its figure."""
    logs = read_drive(folder)
    with tempfile.TemporaryDirectory() as place:
        steady = at_mean_speeds(logs, Path(place))
        ways = {"as recorded": logs, "mean speeds": steady}
        laws = product(("symmetric", "asymmetric"), ("none", "estimate"))
        for (way, given), (viscous, rise) in product(ways.items(), laws):
            found = ff.fit("cylinder-friction", given, viscous=viscous, stribeck=rise)
            yield way, viscous, rise, misfit(found, logs), found


def main() -> None:
    """Print a row for every drive, way and law."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("directory", type=Path, nargs="?", default=LOGS)
    folder = parser.parse_args().directory
    if not folder.is_dir():
        parser.exit(2, f"{folder}: the logs are not there\n")
    print("| drive | logs | --viscous | --stribeck | RMS of means [mN m] | [mN m], [rad/s] |")
    print("| --- | --- | --- | --- | --- | --- |")
    for drive in DRIVES:
        for way, viscous, rise, rms, found in fit_drive(folder / drive):
            numbers = {n: q.number for n, q in found.parameters.items() if q.status == "estimated"}
            words = [f"{n} {v if n == 'stribeck_speed' else 1e3 * v:.4g}"
                     for n, v in numbers.items()]  # fmt: skip
            print(f"| {drive} | {way} | {viscous} | {rise} | {rms:.4f} | {', '.join(words)} |")


if __name__ == "__main__":
    main()
