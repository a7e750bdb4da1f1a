"""How exact the ball-screw fit is, and how honest. Part of ``make study``.

    python studies/ball_screw.py [--trials 40] [--output docs/evidence/stick-slip.md]

P4 of the benchmark (``bench/problems.py``: a torque chirp that never stands still, events
solved in continuous time, an encoder of 2000 counts, 100 Hz, 10 s), fitted one log at a
time; then the same with a torque ripple of 0.2 mN m at eight cycles per turn, which no part
of the model knows, three logs at a time.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fluidact_fit.estimation.inputs import settle_holds
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.families import get_family
from fluidact_fit.family import Request, Solution

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "bench"))

from problems import COUNT, FINE, PROBLEMS, Trial, make_trial  # noqa: E402

Array = npt.NDArray[np.float64]
NAMES = {
    "J": "inertia", "b": "viscous", "fkp": "coulomb_positive", "fkn": "coulomb_negative",
    "fsp": "breakaway_positive", "fsn": "breakaway_negative",
}  # fmt: skip
RIPPLE = 2e-4  # N m
P4 = PROBLEMS["P4"]


def with_ripple(trial: Trial, amplitude: float, rng: np.random.Generator) -> Array:
    """Encoder readings when a torque ``amplitude sin(8 angle)`` acts as well.

    Semi-implicit steps of a hundredth of a sample; the error of the steps is far below the
    ripple's effect.
    """
    t, h = P4.truth, P4.sample_time / FINE
    angle = speed = 0.0
    way, out = 0, []
    for i, torque in enumerate(trial.drive.tolist()):
        if i % FINE == 0:
            out.append(angle)
        drive = torque + amplitude * np.sin(8.0 * angle)
        if way == 0:
            way = int(drive > t["fsp"]) - int(drive < -t["fsn"])
            if way == 0:
                continue
        level = t["fkp"] if way > 0 else -t["fkn"]
        new = (speed + h / t["J"] * (drive - level)) / (1.0 + h * t["b"] / t["J"])
        if new * way <= 0.0:
            speed, way = 0.0, 0
        else:
            angle += 0.5 * h * (speed + new)
            speed = new
    return np.floor((np.array(out) + rng.uniform(0.0, COUNT)) / COUNT) * COUNT


def experiment(trial: Trial, y: Array, number: int) -> Experiment:
    """The log as the fit sees it."""
    u = trial.log.u
    torque = Signal("torque", trial.log.t, u, "N m", "auto", float(u[0]))
    angle = Signal("angle", trial.log.t, y, "rad", resolution=COUNT)
    signals = {"torque": torque, "angle": angle}
    return Experiment(f"log{number}", number, trial.log.t, signals, P4.sample_time, True)


def fit(experiments: list[Experiment]) -> Solution:
    """Fit the rotary drive."""
    family = get_family("ball-screw")
    request = Request(options=family.options_type())
    return family.estimate(family.variants[0], settle_holds(experiments), request)


def table(estimates: list[Solution]) -> list[str]:
    """Errors, standard errors and coverage per parameter, a row each."""
    rows = []
    for key, name in NAMES.items():
        truth = P4.truth[key]
        found = [e.parameters[name] for e in estimates]
        known = [q for q in found if q.status == "estimated"]
        error = 100.0 * np.array([float(q.value) / truth - 1.0 for q in known])
        if not known:
            rows.append(f"| {name} | | | | | 0 of {len(found)} |")
            continue
        claimed = 100.0 * np.array([float(q.std_error or np.nan) / truth for q in known])
        held = [q.ci95 is not None and q.ci95[0] <= truth <= q.ci95[1] for q in known]
        rows.append(
            f"| {name} | {np.median(np.abs(error)):.4f} | {np.sqrt(np.mean(error**2)):.4f} | "
            f"{np.abs(error).max():.4f} | {np.nanmedian(claimed):.4f} | "
            f"{100.0 * np.mean(held):.0f} % of {len(known)} |"
        )
    return rows


HEAD = """# How exact the ball-screw fit is

Written by `python studies/ball_screw.py` (`make study`), {date}. P4 of the benchmark (seed
{seed}): torque chirp, stick-slip, encoder of 2000 counts, 100 Hz, 10 s. Errors in % of the truth:
median and root mean square over the fits, and the worst; the standard error as the fit states it
(median); how often the 95 % interval held the truth, and how many fits gave one at all.

"""
COLUMNS = """| parameter | median | rms | worst | stated | interval held |
|---|---|---|---|---|---|
"""


def main() -> None:
    """Run the study and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "evidence" / "stick-slip.md")
    given = parser.parse_args()
    trials = [make_trial(P4, k) for k in range(given.trials)]
    plain = [fit([experiment(t, t.log.y, 0)]) for t in trials]
    rng = np.random.default_rng(P4.seed)
    rough = [experiment(t, with_ripple(t, RIPPLE, rng), k) for k, t in enumerate(trials)]
    groups = [rough[k : k + 3] for k in range(0, len(rough) - 2, 3)]
    rippled = [fit(group) for group in groups]
    page = HEAD.format(date=time.strftime("%Y-%m-%d"), seed=P4.seed)
    page += f"## One log, {given.trials} fits\n\n{COLUMNS}" + "\n".join(table(plain))
    page += (
        f"\n\n## Torque ripple of {1e3 * RIPPLE:g} mN m, three logs together, {len(groups)} fits"
        f"\n\nThe model knows nothing of the ripple.\n\n{COLUMNS}" + "\n".join(table(rippled))
    )
    given.output.write_text(page + "\n", encoding="utf-8")
    sys.stdout.write(page + "\n")


if __name__ == "__main__":
    main()
