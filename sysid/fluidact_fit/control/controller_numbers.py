"""The numbers that a controller was made from: as given, and as they follow from the machine."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import NamedTuple

from .controllers import (
    Controller,
    FeedforwardForceController,
    ImpedanceController,
    PDController,
)


class Entry(NamedTuple):
    """A number or word by its key, with its unit (SI) and what it is."""

    key: str
    value: float | int | str
    unit: str
    about: str


def numbers_of(controller: Controller, output: str, command: str) -> Iterator[Entry]:
    """Yield the numbers of a controller; ``output`` and ``command`` are units."""
    yield Entry("sample_time", controller.sample_time, "s", "period of the calls")
    match controller:
        case PDController():
            yield from _pd(controller, output, command)
            yield from _limits("command", command, controller.limits)
        case ImpedanceController():
            yield from _impedance(controller, command)
            yield from _limits("force", "N", controller.limits)
        case FeedforwardForceController():
            steps, reading = controller.smoothing.steps, controller.smoothing.reading
            yield Entry("smoothing_steps", steps, "", "samples from one command to the next")
            yield Entry("smoothing", reading, "", "reading of the smoothing: held or recursive")
            yield from _limits("command", command, controller.limits)


def _pd(c: PDController, output: str, command: str) -> Iterator[Entry]:
    gains, friction = c.gains, c.friction
    yield Entry("proportional", gains.proportional, f"{command}/{output}", "proportional gain")
    yield Entry("derivative", gains.derivative, f"{command} s/{output}", "derivative gain")
    if isfinite(gains.damping_ratio):
        frequency, ratio = gains.natural_frequency, gains.damping_ratio
        about = "both gains on the machine, hold and filter apart"
        yield Entry("natural_frequency", frequency, "Hz", f"natural frequency of {about}")
        yield Entry("damping_ratio", ratio, "1", f"damping ratio of {about}")
    for name in ("positive", "negative"):
        about = f"static friction added at rest, {name} direction"
        yield Entry(f"friction_{name}", float(getattr(friction, name)), command, about)
    about = "speed below which it is at rest"
    yield Entry("velocity_tolerance", friction.tolerance, f"{output}/s", about)
    yield Entry("cutoff", c.cutoff, "Hz", "cut-off frequency of the velocity filter")


def _impedance(c: ImpedanceController, command: str) -> Iterator[Entry]:
    z, p, f = c.impedance, c.pressures, c.friction
    yield Entry("stiffness", z.stiffness, "N/m", "stiffness of the rod")
    yield Entry("damping", z.damping, "N s/m", "damping of the rod")
    yield Entry("viscous", f.viscous, "N s/m", "viscous friction compensated")
    for name in ("positive", "negative"):
        level = float(getattr(f, f"coulomb_{name}"))
        yield Entry(
            f"coulomb_{name}", level, "N", f"Coulomb friction compensated, {name} direction"
        )
    yield Entry("velocity_tolerance", f.tolerance, "m/s", "speed that has a direction")
    yield Entry("cutoff", c.cutoff, "Hz", "cut-off frequency of the velocity filter")
    yield Entry("sum_of_pressures", p.total, "Pa", "sum of the pressures of both chambers")
    yield Entry("atmosphere", p.atmosphere, "Pa", "pressure about the rod")
    for number, area, gain, offset in zip((1, 2), p.area, p.gain, p.offset):
        chamber = f"of chamber {number}"
        per = "1" if command == "Pa" else f"Pa/{command}"
        yield Entry(f"area_{number}", area, "m2", f"area {chamber}")
        yield Entry(f"gain_{number}", gain, per, f"steady pressure {chamber} per command")
        yield Entry(f"offset_{number}", offset, "Pa", f"pressure {chamber} without a command")
    yield from _limits("pressure", "Pa", p.range)


def _limits(what: str, unit: str, limits: tuple[float, float]) -> Iterator[Entry]:
    """Limits that there are."""
    for name, about, value in zip(("low", "high"), ("lowest", "highest"), limits):
        if isfinite(value):
            yield Entry(f"{what}_{name}", float(value), unit, f"{about} {what}")
