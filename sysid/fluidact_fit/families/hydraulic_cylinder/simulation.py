"""Position from the inputs, as the fit settled it: all states, or the flow over windows.

A run without position starts from rest at the mean position of the fitted logs. Rest leaves the
pressures open but for their balance; see :meth:`.HydraulicMachine.at_rest`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import LogError, UsageError
from ...estimation.named_model import Values
from ...experiment import Experiment, FloatArray
from ...family import Plant, Simulated
from ...mechanics.hydraulic_cylinder import HydraulicMachine
from .gray_box import CHANNELS, follow
from .options import HydraulicCylinderOptions
from .setup import check_volumes, known_chambers, read_machine
from .windows import cut_windows, mean_command, mean_flow

_NAME = "hydraulic-cylinder"
_LEFT = 0.02  # of a dead volume: on less oil a simulated piston stands still or runs away


def simulate_runs(
    plant: Plant[HydraulicCylinderOptions], experiments: Sequence[Experiment]
) -> list[Simulated]:
    """Simulate runs with the numbers and options of a fit."""
    return [simulate_run(e, plant.numbers, plant.options) for e in experiments]


def simulate_run(e: Experiment, values: Values, options: HydraulicCylinderOptions) -> Simulated:
    """Simulate one run with the options that the fit settled.

    ``values`` are the single-valued parameters; a block refuses what is not identified.

    Raises
    ------
    UsageError, LogError
        When an input is missing, a run has one sample only, or the piston would leave the range
        of the equations.
    """
    known = known_chambers(values)
    machine = read_machine(options, known)
    if "position" in e:
        check_volumes(machine, [e])
    if e.samples < 2:
        raise LogError(
            f"{e.name} holds a single sample.",
            expected="Two or more, for something to move from one to the next.",
            remedy="Record longer; check --window where it was given.",
        )
    if options.stage == "gray-box":
        start = machine.at_rest(options.rest_position or 0.0)
        sigma = [getattr(options, f"residual_{c}") or 1.0 for c in CHANNELS]
        states = follow(e, machine, values, start, sigma)
        if "position" not in e:
            _require_oil(e, machine, states[:, 2])
        also = {role: states[:, c] for c, role in enumerate(CHANNELS[:2])}
        return Simulated(states[:, 2], also=also)
    chambers = [i for i in known if f"pressure_{i}" in e]
    if not chambers:
        raise _no_pressure(e, known)
    if "position" in e:
        return Simulated(_over_windows(e, chambers, machine, values, options.window or 0.0))
    return Simulated(_flow_from_rest(e, chambers[0], machine, values, options.rest_position or 0.0))


def _no_pressure(e: Experiment, known: Sequence[int]) -> UsageError | LogError:
    """Refusal of a log of the other chamber, and of inputs without any pressure."""
    wanted = f"pressure_{known[0]}"
    have = [f"pressure_{i}" for i in (1, 2) if f"pressure_{i}" in e]
    if have:
        return LogError(
            f"it holds {have[0]}, and the model has the valve gain of chamber {known[0]} only",
            where=e.name,
            remedy=f"Give a log with {wanted}, or fit logs of the other chamber as well.",
        )
    return UsageError(
        f"{' or '.join(f'pressure_{i}' for i in known)} is missing: without mass and both dead "
        f"volumes a file of {_NAME} knows how the flow follows from command and pressure, and not "
        "how the pressure comes about.",
        where=e.name,
        remedy=f"Give --input {wanted}=FROM:TO, or a LOG with that column; or fit with --mass, "
        "--dead-volume-1 and --dead-volume-2 to logs that hold both pressures.",
    )


def _require_oil(e: Experiment, machine: HydraulicMachine, position: FloatArray) -> None:
    """Refuse a run in which the piston uses up a chamber, or runs away."""
    full = np.isfinite(position)
    for chamber in (1, 2):
        if (dead := machine.dead_volume(chamber)) is not None:
            full &= machine.volume(chamber, position) > _LEFT * dead
    if not full.all():
        first = int(np.argmin(full))
        raise UsageError(
            f"from {e.time[first]:.3g} s on the piston would be beyond where a chamber holds oil, "
            f"and {_NAME} knows no end of the stroke.",
            where=e.name,
            remedy="Choose a shorter --duration or a smaller command; a log "
            "has to hold the position, which drifts away when it is integrated for long.",
        )


def _over_windows(
    e: Experiment, chambers: Sequence[int], machine: HydraulicMachine, values: Values, length: float
) -> FloatArray:
    """Position by integrating the flow over rows of windows, each about its measured mean.

    NaN between them: what flows there is not known.
    """
    out = np.full(e.samples, np.nan)
    for w in cut_windows([e], sorted(chambers, reverse=True), machine, length):  # chamber 1 wins
        moved = w.modelled(values) * w.duration / machine.area(w.chamber)
        gaps = np.flatnonzero(w.first[1:] != w.last[:-1]) + 1
        for windows in np.split(np.arange(w.first.size), gaps):
            knots = np.append(w.first[windows[0]], w.last[windows])
            rows = slice(int(knots[0]), int(knots[-1]) + 1)
            path = np.append(0.0, np.cumsum(moved[windows]))
            position = np.interp(e.time[rows], e.time[knots], path)
            out[rows] = position + float(np.mean(e["position"][rows] - position))
    return out


def _flow_from_rest(
    e: Experiment, chamber: int, machine: HydraulicMachine, values: Values, start: float
) -> FloatArray:
    """Position by integrating the flow of one chamber from beginning to end."""
    u, p, area = mean_command(e), e.sampled(f"pressure_{chamber}"), machine.area(chamber)
    moved = np.real(mean_flow(chamber, u, p, values, machine)) * np.diff(e.time) / area
    y = start + np.append(0.0, np.cumsum(moved))
    beta = values.get("bulk_modulus")
    for _ in range(3 if beta else 0):  # the volume follows from the position, hardly changed
        oil = machine.swelling(chamber, y, p) / beta
        y = start + np.append(0.0, np.cumsum(moved + oil / area))
    _require_oil(e, machine, y)
    return y
