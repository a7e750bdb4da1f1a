"""First two stages: inverse dynamics, then increments of position."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ...errors import LogError
from ...estimation.separable import Unknown, solve
from ...experiment import Experiment, FloatArray
from ...signals import smooth
from .model import BREAKAWAY, EXCESS, LONG, SIDES, Axis, Compared, increment_lag, leading_part
from .stage import Stage


def inverse_dynamics(
    experiments: Sequence[Experiment], axis: Axis, one_sided: bool
) -> dict[str, float]:
    """First stage: torque regressed on smoothed acceleration, speed and direction.

    The window is the shortest whose residual is within a tenth of the best: longer ones
    smear the reversals, shorter ones drown in the encoder's steps.
    """
    best: tuple[float, FloatArray] | None = None
    for half in (2, 4, 8, 16, 32, 64):
        if any(e.samples < 8 * half for e in experiments) and half > 2:
            break
        rows, drive = [], []
        for e in experiments:
            s = smooth(e[axis.motion], e.sample_time, half)
            u = smooth(e.sampled(axis.drive), e.sample_time, half).value
            fast = float(np.quantile(np.abs(s.rate), 0.99))
            moving = s.inside & (np.abs(s.rate) > 0.12 * fast)
            v, forward = s.rate[moving], s.rate[moving] > 0.0
            columns = [s.curvature[moving], v * forward, v * ~forward]
            if not one_sided:
                columns = [s.curvature[moving], v]
            rows.append(np.column_stack((*columns, forward * 1.0, -1.0 * ~forward)))
            drive.append(u[moving])
        a, tau = np.vstack(rows), np.concatenate(drive)
        if a.shape[0] < 2 * a.shape[1]:
            continue
        x = np.linalg.lstsq(a, tau, rcond=None)[0]
        misfit = float(np.std(tau - a @ x))
        if best is None or (misfit < 0.9 * best[0] and x[0] > 0.0) or best[1][0] <= 0.0:
            best = misfit, x
    if best is None:
        raise LogError(
            f"the {axis.motion} hardly moves in any log",
            remedy="Record motion in both directions, or check --column and --unit.",
        )
    return _as_guess(best[1], experiments, axis, one_sided)


def _as_guess(
    x: FloatArray, experiments: Sequence[Experiment], axis: Axis, one_sided: bool
) -> dict[str, float]:
    """Linear estimate as a start: positive, and never more than the drive can give."""
    drive = max(float(np.abs(e.sampled(axis.drive)).max()) for e in experiments)
    speed = max(float(np.ptp(e[axis.motion]) / np.ptp(e.time)) for e in experiments) or 1.0
    step = min(e.sample_time for e in experiments)
    kinetic = np.clip(x[-2:], 0.02 * drive, 0.9 * drive)
    viscous = np.maximum(x[1:-2], 0.01 * drive / speed)
    inertia = max(x[0], 1e-3 * drive / speed * step)
    guess = {axis.inertia: inertia, **{f"coulomb_{s}": k for s, k in zip(SIDES, kinetic)}}
    names = [f"viscous_{s}" for s in SIDES] if one_sided else ["viscous"]
    guess.update(zip(names, viscous))
    guess.update({EXCESS[s]: 0.2 * k for s, k in zip(SIDES, kinetic)})
    guess.update({BREAKAWAY[s]: 1.2 * k for s, k in zip(SIDES, kinetic)})
    return {k: float(v) for k, v in guess.items()}


def initial_speeds(experiments: Sequence[Experiment], axis: Axis) -> dict[str, float]:
    """Initial speeds of the runs that do not start at rest."""
    out = {}
    for i, e in enumerate(experiments):
        y = e[axis.motion]
        half = min(4, (y.size - 1) // 2)
        if half < 1:
            continue
        head = y[: 2 * half + 1]
        slope = float(np.polyfit(np.arange(head.size) * e.sample_time, head, 1)[0])
        typical = float(np.std(np.gradient(y, e.time))) or 1.0
        noise = max(e.signals[axis.motion].resolution, 1e-300) / (2 * half * e.sample_time)
        if abs(slope) > max(0.2 * typical, 2.0 * noise):
            out[f"initial_speed[{i}]"] = slope
    return out


def search_limits(
    names: Sequence[str], guess: Mapping[str, float], viscous: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Search range of four decades around the linear estimate, inertia first of the names."""
    limits = {n: (0.0, 1e4 * abs(guess[n])) for n in names}
    limits[names[0]] = (1e-3 * guess[names[0]], 1e3 * guess[names[0]])
    for n in viscous:
        limits[n] = (1e-6 * abs(guess[n]), 1e4 * abs(guess[n]))
    return limits


def speed_unknowns(moving: Mapping[str, float]) -> dict[str, Unknown]:
    """Unknowns of the initial speeds."""
    return {n: Unknown(n, scale=abs(v) or 1.0) for n, v in moving.items()}


def fit_increments(stage: Stage, asked: Mapping[str, float]) -> dict[str, float]:
    """Second stage: match increments of position from several break-away guesses.

    ``asked`` is where the user says to start. It is one more candidate: it may be bad.
    """
    axis, held = stage.axis, stage.held
    lively = sorted(stage.experiments, key=lambda e: -float(np.ptp(e[axis.motion])))[:2]
    part = [leading_part(e, LONG) for e in lively]
    problem = replace(stage, experiments=part).problem(Compared(lag=increment_lag(part, axis)))
    order = [u.name for u in problem.nonlinear]
    best = None
    for first in _candidates(stage.start, asked, held):
        eta = np.array([first[n] for n in order])
        found = solve(problem, eta, max_iterations=12, tolerance=0.05)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    if not best.converged:
        best = solve(problem, best.eta, max_iterations=30, tolerance=0.05)
    return {**held, **dict(zip(order, map(float, best.eta)))}


def _candidates(
    guess: Mapping[str, float], asked: Mapping[str, float], held: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    """Starts with small and large static levels in either direction."""
    bases = [(guess, {}), ({**guess, **asked}, asked)] if asked else [(guess, {})]
    for (base, own), *ratios in product(bases, (0.05, 0.6), (0.05, 0.6)):
        first = {**base, **held}
        for s, ratio in zip(SIDES, ratios):
            kinetic = first[f"coulomb_{s}"]
            first[EXCESS[s]] = ratio * kinetic
            if BREAKAWAY[s] in own:
                first[EXCESS[s]] = max(own[BREAKAWAY[s]] - kinetic, 0.0)
        yield first
