"""Friction of the piston from both pressures, by linear regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...estimation.parametric import Fitted, NamedModel, fit_named, make_unknowns
from ...estimation.separable import Basis
from ...estimation.uncertainty import covariance
from ...experiment import Experiment, FloatArray
from ...family import Quantity
from ...signals import smooth
from .case import Case
from .equations import Machine


@dataclass(frozen=True)
class FrictionRows:
    """Speed [m/s] and friction force [N] over short windows or plateaus, one array each."""

    speed: FloatArray
    force: FloatArray
    source: str

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        """Rows fast enough to have a direction."""
        size = np.abs(self.speed)
        return size > 0.1 * np.quantile(size, 0.95) if size.size else size > 0.0


def friction_rows(case: Case) -> FrictionRows:
    """Friction ``p1 A1 - p2 A2 - M a`` wherever it can be had."""
    nothing = FrictionRows(np.zeros(0), np.zeros(0), "none")
    if case.machine.area_1 is None or case.machine.area_2 is None:
        return nothing
    both = [e for e in case.experiments if "pressure_1" in e and "pressure_2" in e]
    if both:
        parts = [_friction_windows(e, case.machine) for e in both]
        speed, force = (np.concatenate(p) for p in zip(*parts))
        return FrictionRows(speed, force, "windows")
    if case.chambers == (1, 2):
        return _paired_plateaus(case)
    return nothing


def _friction_windows(e: Experiment, machine: Machine) -> tuple[FloatArray, FloatArray]:
    """Windows of about 10 ms; without a mass those in which the speed hardly changes."""
    half = max(2, round(0.01 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, half, 3)
    force = e.sampled("pressure_1") * machine.area(1) - e.sampled("pressure_2") * machine.area(2)
    smoothed = smooth(force, e.sample_time, half, 2).value
    speed, rows = motion.rate, np.arange(half, e.samples - half, half)
    if machine.mass is not None:
        smoothed = smoothed - machine.mass * motion.curvature
    else:
        change = np.abs(speed[rows + half - 1] - speed[rows - half])
        rows = rows[change < 0.1 * float(np.quantile(np.abs(speed), 0.95))]
    return speed[rows], smoothed[rows]


def _paired_plateaus(case: Case) -> FrictionRows:
    """Combine logs of one chamber each: plateaus at the same command belong together."""
    means: dict[tuple[int, float], list[tuple[float, float]]] = {}
    for w in case.windows:
        level = np.round(w.mean(w.command), 6)
        for u in np.unique(level):
            rows = level == u
            if u == 0.0 or rows.sum() < 3:
                continue
            pressure = float(np.mean(w.mean(0.5 * (w.before + w.after))[rows]))
            area = case.machine.area(w.chamber)
            speed = float(np.sum((w.motion * w.duration)[rows]) / np.sum(w.duration[rows]) / area)
            means.setdefault((w.chamber, float(u)), []).append((speed, pressure))
    area_1, area_2 = case.machine.area(1), case.machine.area(2)
    pairs = [
        (0.5 * (v1 + v2), p1 * area_1 - p2 * area_2)
        for (chamber, u), found in sorted(means.items()) if chamber == 1
        for (v1, p1), (v2, p2) in zip(found, means.get((2, u), ()))
    ]  # fmt: skip
    speeds, forces = np.array(pairs).reshape(-1, 2).T
    return FrictionRows(speeds, forces, "plateaus of separate logs")


def fit_friction(case: Case, rows: FrictionRows, lenient: bool = False) -> Fitted:
    """Viscous and Coulomb friction by linear regression; an offset where both directions moved."""
    v, f = rows.speed[rows.moving], rows.force[rows.moving]
    both = not lenient and (v > 0.0).any() and (v < 0.0).any()
    table = np.column_stack([v, np.sign(v), *([np.ones(v.size)] if both else ())])
    basis = Basis(np.zeros(v.size), table, np.zeros((v.size, 0)))
    size = max(float(np.abs(f).max()), 1e-300)
    scales = {"viscous": size / float(np.abs(v).max()), "coulomb": size}
    model = NamedModel((), (*scales,), lambda index, values: basis, [f],
                       nuisance=("offset",) if both else (),
                       robust=rows.source == "windows")  # fmt: skip
    unknowns = make_unknowns(case.variant.parameters, (*scales,), scales, case.request)
    sensible = {n: np.inf if lenient else 0.5 * s for n, s in scales.items()}
    return fit_named(model, case.variant.parameters, case.request, unknowns, [{}],
                     sensible=sensible)  # fmt: skip


def friction_levels(rows: FrictionRows) -> dict[str, Quantity]:
    """Mean friction in either direction, signed [N]."""
    out, robust = {}, rows.source == "windows"
    for sign, word in ((1.0, "extending"), (-1.0, "retracting")):
        chosen = rows.force[rows.moving & (sign * rows.speed > 0.0)]
        if chosen.size >= 2:
            one = np.ones((chosen.size, 1))
            found = covariance([one], [chosen - chosen.mean()], robust=robust)
            se = float(np.sqrt(found.covariance[0, 0]))
            out[f"friction_{word}"] = Quantity(float(chosen.mean()), "N", "derived", se)
    return out
