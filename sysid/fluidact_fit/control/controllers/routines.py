"""The controllers as routines: what ``export`` writes for the machine that runs them.

The same arithmetic as ``step`` of the classes beside, sample by sample.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

import numpy as np

from ...routines import (
    Argument,
    Draft,
    Expression,
    Filter,
    Name,
    Operand,
    Routine,
    by_sign,
    choose,
    constant,
    maximum,
    minimum,
)
from ...routines.routine import as_matrix
from ..filters import Butterworth
from .base import Travel
from .force import FeedforwardForceController, Start
from .impedance import ImpedanceController
from .pd import PDController


def _arguments(travel: Travel) -> tuple[Argument, Argument]:
    """Arguments of the controller; the ranges only exclude what cannot be true."""
    (low, high), role, unit = travel.reach, travel.role, travel.unit
    return (
        Argument("wanted", unit, f"wanted {role}", low, high, recorded=False),
        Argument(role, unit, f"measured {role}", low, high, recorded=False, measured=True),
    )


def routines_of(controller: PDController | ImpedanceController, unit: str) -> tuple[Routine, ...]:
    """Return what has to be called, in order; ``unit`` is that of the commands.

    A force controller needs its maps as well: :func:`force_routines`.
    """
    if isinstance(controller, PDController):
        return (_pd(controller, unit),)
    return (_force(controller), *_commands(controller, unit))


def force_routines(
    controller: FeedforwardForceController, drive_for: Routine, target: Argument,
    supply: tuple[float, float], unit: str,
) -> tuple[Routine, Routine, Routine]:  # fmt: skip
    """Return what a force controller calls, in order: motion state, map and smoothing.

    Parameters
    ----------
    controller
    drive_for, target
        The map from the force, and what it gives as an argument of the last routine.
    supply
        Gain and offset of ``drive = gain command + offset`` for what the map gives.
    unit
        Of the command.
    """
    reference = replace(_arguments(controller.travel)[0], held=True)
    return (
        _direction(reference, controller.start),
        replace(drive_for, careful=True),
        _smoothed(controller, reference, target, supply, unit),
    )


def _rate(draft: Draft, name: str, value: Expression, low_pass: Butterworth, period: float) -> Name:
    """Rate of change of a value: difference, then the filter in the form of a state space."""
    last, begun = draft.state(f"{name}_last"), draft.state(f"{name}_begun")
    now = draft.let(f"{name}_of", value)
    before = draft.let(f"{name}_before", choose(begun, ">", 0.0, last, now))
    change = (now - before) * constant("per_sample_time", 1.0 / period)
    draft.put(last, now)
    draft.put(begun, 1.0)
    draft.interrupt(begun, 0.0)  # the next reading is a first one again
    b, a = np.array(low_pass.numerator), np.array(low_pass.denominator)
    matrix = np.array([[-a[1], 1.0], [-a[2], 0.0]])  # the transposed direct form
    return draft.filter(
        Filter(
            name, as_matrix(matrix - np.eye(2)), tuple((b[1:] - a[1:] * b[0]).tolist()),
            (0.0, 0.0), (1.0, 0.0), 0, change, float(b[0]),
        )
    )  # fmt: skip


def _returned(draft: Draft, value: Expression, begins: float) -> Routine:
    """Keep what is returned, for calls that have nothing to compute from."""
    given = draft.state("given", begins)
    draft.put(given, value)
    return draft.returns(given)


def _limited(value: Expression, limits: tuple[float, float]) -> Expression:
    low, high = limits
    value = maximum(value, constant("lowest", low)) if isfinite(low) else value
    return minimum(value, constant("highest", high)) if isfinite(high) else value


def _pd(c: PDController, unit: str) -> Routine:
    draft = Draft("step", "Command of this sample.", unit, c.sample_time, careful=True)
    reference, measured = map(draft.argument, _arguments(c.travel))
    error = draft.let("error", reference - measured)
    low_pass = Butterworth(c.cutoff, c.sample_time)
    command = constant("proportional", c.gains.proportional) * error
    if c.gains.derivative:
        rate = _rate(draft, "error_rate", error, low_pass, c.sample_time)
        command = command + constant("derivative", c.gains.derivative) * rate
    if c.holding:
        command = command + constant("holding", c.holding)
    f = c.friction
    if f.tolerance > 0.0 and (f.positive or f.negative):
        speed = _rate(draft, "speed", measured, low_pass, c.sample_time)
        up, down = (
            constant("friction_positive", f.positive),
            constant("friction_negative", -f.negative),
        )
        push = by_sign(error, up, down, jumps=True)
        slow = constant("velocity_tolerance", f.tolerance)
        command = command + choose(abs(speed), "<", slow, push, 0.0, jumps=True)
    return _returned(draft, _limited(command, c.limits), c.begins[0])


def _force(c: ImpedanceController) -> Routine:
    about = "Force that is wanted at this sample."
    draft = Draft("force", about, "N", c.sample_time, careful=True)
    reference, measured = map(draft.argument, _arguments(c.travel))
    low_pass = Butterworth(c.cutoff, c.sample_time)
    z, f = c.impedance, c.friction
    coulomb = f.coulomb_positive or f.coulomb_negative
    force = constant("stiffness", z.stiffness) * (reference - measured)
    if z.damping or f.viscous or coulomb:
        speed = _rate(draft, "speed", measured, low_pass, c.sample_time)
    if z.damping:
        wanted = _rate(draft, "wanted_speed", reference, low_pass, c.sample_time)
        force = force + constant("damping", z.damping) * (wanted - speed)
    if f.viscous:
        force = force + constant("viscous", f.viscous) * speed
    if coulomb:
        up = constant("coulomb_positive", f.coulomb_positive)
        down = constant("coulomb_negative", -f.coulomb_negative)
        low, high = (constant("velocity_tolerance", way * f.tolerance) for way in (-1.0, 1.0))
        sign = choose(speed, "<", low, down, 0.0, jumps=True)
        sign = choose(speed, ">", high, up, sign, jumps=True)
        force = force + sign
    return _returned(draft, _limited(force, c.limits), c.limit(0.0))


def _commands(c: ImpedanceController, unit: str) -> tuple[Routine, Routine]:
    """Commands of both valves for a force: equation 22."""
    p = c.pressures
    one, two = p.area
    most = max(p.total, p.atmosphere) * max(one, two)
    bias = p.total * two + p.atmosphere * (one - two)
    found = []
    for chamber in (1, 2):
        draft = Draft(f"command_{chamber}", f"Command of the valve of chamber {chamber}.", unit)
        force = draft.argument(
            Argument("force", "N", "wanted force", -most, most, recorded=False)
        )  # fmt: skip
        pressure = draft.let(
            "pressure", (force + constant("bias", bias)) * constant("per_area", 1.0 / (one + two))
        )
        if chamber == 2:
            pressure = draft.let("other", constant("sum_of_pressures", p.total) - pressure)
        limited = _limited(pressure, p.range)
        gain, offset = p.gain[chamber - 1], p.offset[chamber - 1]
        found.append(
            draft.returns((limited - constant("offset", offset)) * constant("per_gain", 1.0 / gain))
        )
    return found[0], found[1]


def _direction(reference: Argument, start: Start) -> Routine:
    """Motion state of what is wanted; the first value is a change from that of the start."""
    about = "Motion state of the wanted force: 1 loading, -1 unloading."
    draft = Draft("direction", about, "1", careful=True)
    wanted = draft.argument(reference)
    last, state = draft.state("last", start.force), draft.state("moved", 1.0)
    draft.put(state, _by_change(wanted, last, -1.0, 1.0, state))
    draft.put(last, wanted)
    return draft.returns(state)


def _by_change(
    value: Expression, last: Expression, fell: Operand, rose: Operand, rests: Operand
) -> Expression:
    return choose(value, ">", last, rose, choose(value, "<", last, fell, rests))


def _smoothed(
    c: FeedforwardForceController, reference: Argument, target: Argument,
    supply: tuple[float, float], unit: str,
) -> Routine:  # fmt: skip
    """Equation 8, written as a mean of two values, so that what was rounded before fades."""
    draft = Draft("step", "Command of this sample.", unit, c.sample_time, careful=True)
    wanted, drive = draft.argument(reference), draft.argument(target)
    gain, offset = supply
    steps, held = float(c.smoothing.steps), c.smoothing.reading == "held"
    start = c.start
    last, count = draft.state("last", start.force), draft.state("count", steps)
    now = draft.state("now", start.command)
    goal: Expression = drive
    if supply != (1.0, 0.0):
        goal = (drive - constant("offset", offset)) * constant("per_gain", 1.0 / gain)
    goal = draft.let("goal", _limited(goal, c.limits))
    changed = draft.let("changed", _by_change(wanted, last, 1, 1, 0))
    draft.put(last, wanted)
    draft.put(count, choose(changed, ">", 0.0, 1.0, minimum(count + 1.0, constant("steps", steps))))
    base: Expression = now
    if held:
        base = draft.state("start", start.command)
        draft.put(base, choose(changed, ">", 0.0, now, base))
    share = draft.let("share", count * constant("per_steps", 1.0 / steps))
    draft.put(now, base * (1.0 - share) + goal * share)
    return draft.returns(now)
