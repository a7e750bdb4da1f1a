"""The hydrostatic rig of the thesis: a screw drives a rod through a line of water."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from fluidact_fit.block import Port
from fluidact_fit.control.controllers import Gains, PDController, Travel
from fluidact_fit.control.controllers.pd import StaticFriction
from fluidact_fit.control.loop import Response, run_loop
from fluidact_fit.control.margins import loop_margins
from fluidact_fit.control.metrics import StepMetrics, step_metrics
from fluidact_fit.control.plants.drive import DrivePlant, behind_screw, rigid_line
from fluidact_fit.control.plants.tissue import Tissue
from fluidact_fit.control.references import Reference, SampledReference

from .table import STEP, row

LEVER, TRANSMISSION = 0.056e-3, 2.0 * pi * 4.4 / 1e-3
SCREW = {
    "inertia": 11.71e-7, "viscous": 0.0, "coulomb_positive": 2.0e-3, "coulomb_negative": 1.6e-3,
    "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
}  # fmt: skip
DRIVE = behind_screw(SCREW, rigid_line({"mass": 53.7, "damping": 1720.5}), LEVER, TRANSMISSION)
BREAKING = 0.6e-3  # middle of the 0.5 to 0.7 mm that the thesis read off its sine
RATIO = 0.7
TOLERANCE = 1e-3
NEEDLE = Tissue(0.02, 1000.0, 5.0, 0.0, 50.0)
TARGET, AT = 7e-3, 1.0  # of the step [m], [s]
JOLT = 0.7e-3  # of the operator's hand at the puncture


def screw(tissue: Tissue | None = None) -> DrivePlant:
    """Ball screw and hydrostatic line of the thesis."""
    return DrivePlant(DRIVE, Port("torque", "N m"), Port("position", "m"), STEP, tissue)


def pd(compensation: float = 1.0, tolerance: float = TOLERANCE) -> PDController:
    """K_p from the breaking distance, K_d from the damping ratio; share of friction added."""
    proportional = 0.5 * (SCREW["breakaway_positive"] + SCREW["breakaway_negative"]) / BREAKING
    gains = Gains.with_damping(
        DRIVE.mass, DRIVE.viscous, DRIVE.leverage, proportional=proportional, damping_ratio=RATIO
    )
    positive, negative = SCREW["breakaway_positive"], SCREW["breakaway_negative"]
    friction = StaticFriction(compensation * positive, compensation * negative, tolerance)
    return PDController(gains, Travel("position"), STEP, friction)


@dataclass(frozen=True)
class Runs:
    """Every experiment of the rig.

    ``coarse`` is the step with ten times the velocity tolerance, ``plain`` the sine without
    compensation, ``jolt`` the insertion with the operator's hand.
    """

    step: Response
    coarse: Response
    triangle: Response
    plain: Response
    sine: Response
    insertion: Response
    jolt: Response


def run() -> Runs:
    """Run them all."""
    small = Reference("step", 6.5e-3, TARGET - 6.5e-3, AT)
    triangle = Reference("triangle", 0.01, 0.025, speed=5e-3)
    sine = Reference("sine", 0.01, 4e-3, frequency=0.2)
    insertion = run_loop(
        screw(NEEDLE), pd(), Reference("ramp-insertion", 0.01, 0.03, speed=7.5e-3), 5.0, 0.01
    )
    return Runs(
        run_loop(screw(), pd(), small, 10.0, 6.5e-3),
        run_loop(screw(), pd(tolerance=10.0 * TOLERANCE), small, 10.0, 6.5e-3),
        run_loop(screw(), pd(), triangle, 10.0, 0.01),
        run_loop(screw(), pd(0.0), sine, 10.0, 0.01),
        run_loop(screw(), pd(), sine, 10.0, 0.01),
        insertion,
        run_loop(screw(NEEDLE), pd(), _hand(insertion), 5.0, 0.01),
    )


def puncture(r: Response) -> int:
    """Number of the sample at which the tissue resists most."""
    return int(r.measured["resistance"].argmax())


def _hand(insertion: Response) -> SampledReference:
    """Ramp until the puncture, then a jolt of the hand that holds on."""
    at = puncture(insertion)
    place, end = insertion.reference[at], insertion.time[-1]
    time = np.array([0.0, insertion.time[at], insertion.time[at] + 0.1, end])
    return SampledReference(time, np.array([0.01, place, place + JOLT, place + JOLT]))


def plateau(r: Response) -> float:
    """Largest error at the end of a rest of three samples or more [m]."""
    still = np.diff(r.output) == 0.0
    ends = [k for k in range(3, still.size) if still[k - 3 : k].all() and not still[k]]
    return float(np.abs(r.error[[k for k in ends if r.time[k] > 1.0]]).max(initial=0.0))


def rows(runs: Runs) -> list[str]:
    """Step, triangle, sine and insertion against the thesis."""
    step, coarse = (_metrics(r) for r in (runs.step, runs.coarse))
    margins = loop_margins(screw(), pd())
    return [
        row("0.5 mm step: overshoot", "about 0.3 mm", f"{1e3 * (step.peak - TARGET):.2f} mm"),
        row("0.5 mm step: steady error", "about 0.1 mm above",
            f"{-1e3 * step.steady_state_error:.3f} mm above"),
        row("the same with a velocity tolerance of 10 mm/s: overshoot", "about 0.3 mm",
            f"{1e3 * (coarse.peak - TARGET):.2f} mm"),
        row("triangle, 5 mm/s: largest error", "within 1 mm",
            f"{1e3 * np.abs(runs.triangle.error).max():.2f} mm"),
        row("slow sine, uncompensated: breaking distance", "0.5 to 0.7 mm",
            f"{1e3 * plateau(runs.plain):.2f} mm"),
        row("slow sine, compensated: breaking distance", "minimised",
            f"{1e3 * plateau(runs.sine):.2f} mm"),
        row("slow sine: rms error, without and with", "improved",
            f"{_rms(runs.plain):.3f} and {_rms(runs.sine):.3f} mm"),
        *_insertion_rows(runs),
        row("margins", "none given", f"gain {margins.gain:.2g}, phase {margins.phase:.0f} deg"),
    ]  # fmt: skip


def _metrics(r: Response) -> StepMetrics:
    return step_metrics(r.time, r.output, TARGET, at=AT)


def _rms(r: Response) -> float:
    return 1e3 * float(np.sqrt(np.mean(r.error[r.time > 1.0] ** 2)))


def _insertion_rows(runs: Runs) -> list[str]:
    at, error = puncture(runs.insertion), 1e3 * runs.insertion.error
    before, after = error[at - 20 : at].mean(), error[at : at + 50].min()
    place = runs.insertion.reference[at]
    beyond = 1e3 * (runs.jolt.output.max() - place - JOLT)
    return [
        row("ramp insertion, 5 N: change of the error at the puncture", "little effect",
            f"{before - after:.2f} mm"),
        row("puncture with a jolt of 0.7 mm: overshoot", "0.45 mm", f"{beyond:.2f} mm"),
        row("puncture with that jolt: in all", "about 1.2 mm", f"{0.7 + beyond:.2f} mm"),
    ]  # fmt: skip
