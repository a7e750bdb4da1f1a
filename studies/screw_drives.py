"""Friction of two screw drives from logs of one constant speed each, with ``cylinder-friction``.

    python studies/screw_drives.py DIRECTORY

``DIRECTORY`` holds ``driveNo1`` and ``driveNo2`` of Mablekos-Alexiou et al. (IEEE Trans. Robotics,
2021) as EPOS Studio exported them: averaged velocity in rpm, averaged torque in percent of
9.84 mN m, both with the sign inverted. A torque stands for the force and an angle for the path, so
that newtons are N m and m/s are rad/s. All logs of a drive are fitted together. The figure is
the root mean square over the logs of the mean torque less the mean of the model.
"""

from __future__ import annotations

import argparse
from itertools import product
from pathlib import Path

import numpy as np

import fluidact_fit as ff

COLUMNS = {"force": "Torque actual value averaged", "velocity": "Velocity actual value averaged"}
SCALES = {"force": -9.84e-5, "velocity": -np.pi / 30.0}
UNITS = {"force": "N", "velocity": "m/s"}
PUBLISHED = {"driveNo1": 0.126, "driveNo2": 0.090}  # lumped and asymmetric [mN m]


def read_drive(folder: Path) -> list[ff.Log]:
    """One log for every constant speed of a drive."""
    paths = sorted((folder / "steady_state").rglob("*.csv"))
    return [ff.read_log(p, columns=COLUMNS, units=UNITS, scales=SCALES) for p in paths]


def misfit(result: ff.FitResult, logs: list[ff.Log]) -> float:
    """Root mean square over the logs of what is left of their mean torque [mN m]."""
    rests = []
    for log in logs:
        (run,) = result.simulate(log)
        rests.append(float(np.mean(run.measured - run.simulated)))
    return 1e3 * float(np.sqrt(np.mean(np.square(rests))))


def main() -> None:
    """Print a row for every drive and law."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("directory", type=Path)
    folder = parser.parse_args().directory
    print("| drive | viscous | stribeck | RMS of means [mN m] | published |")
    print("| --- | --- | --- | --- | --- |")
    laws = list(product(("symmetric", "asymmetric"), ("none", "estimate")))
    for drive, published in PUBLISHED.items():
        logs = read_drive(folder / drive)
        for viscous, stribeck in laws:
            fit = ff.fit("cylinder-friction", logs, viscous=viscous, stribeck=stribeck)
            row = f"{drive} | {viscous} | {stribeck} | {misfit(fit, logs):.4f} | {published:.3f}"
            print(
                f"| {row} |",
                {n: round(1e3 * q.number, 5) for n, q in fit.parameters.items()},
                sorted({n.code for n in fit.notices}),
            )


if __name__ == "__main__":
    main()
