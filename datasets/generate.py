"""Generate the synthetic logs of this directory.

    python datasets/generate.py [--output DIRECTORY]

Every log is simulated with the small solvers below: closed forms between events, or a grid
100 times finer than the log. They need nothing but numpy and share no code with
``fluidact_fit``, so that a fit which recovers the truth proves something. Running the
script again writes the same bytes. Run it last: it also writes ``SHA256SUMS``, over the
datasets of all generators.
"""

from __future__ import annotations

import argparse
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SEED = 20131
STEP = 0.01  # s: 100 Hz, as on the rigs
SAMPLES = 1000  # 10 s, the recording limit of the rig
FINE = 100  # steps of the fine grid per sample
TRIALS = 3

THESIS = "thesis"  # D. B. Comber 2013
FORCE_PAPER = "pneumatic force control paper, 2025"


# ---------------------------------------------------------------- what a dataset consists of


@dataclass(frozen=True)
class Truth:
    """A true value in SI; ``origin`` is where it was published, empty when invented."""

    value: float | list[float]
    unit: str
    origin: str = ""
    note: str = ""


@dataclass(frozen=True)
class Column:
    """A column of a log: header, meaning, digits after the point."""

    header: str
    meaning: str
    digits: int


@dataclass(frozen=True)
class Dataset:
    """One directory: how to simulate a trial and everything its README says."""

    family: str
    title: str
    number: int
    simulate: Callable[[np.random.Generator, int], list[Array]]
    columns: tuple[Column, ...]
    roles: dict[str, str]
    truth: dict[str, Truth]
    conditions: tuple[str, ...]
    options: dict[str, float | str] = field(default_factory=dict)
    curve: bool = False
    delimiter: str = ","
    decimal: str = "."


# ------------------------------------------------------------------------------- excitation


def sample_instants() -> Array:
    """Instants of the samples, shape ``(1000,)`` [s]."""
    return STEP * np.arange(SAMPLES, dtype=np.float64)


def fine_instants() -> Array:
    """Instants of the fine grid; every hundredth is a sample [s]."""
    return STEP / FINE * np.arange((SAMPLES - 1) * FINE + 1, dtype=np.float64)


def make_steps(rng: np.random.Generator, low: float, high: float, digits: int) -> Array:
    """Held levels of 0.3 s to 1.1 s, one value per sample, after 0.2 s of rest."""
    values = np.full(SAMPLES, round(0.5 * (low + high), digits))
    k = 20
    while k < SAMPLES:
        level = round(rng.uniform(low, high), digits)
        while abs(level - values[k - 1]) < 0.2 * (high - low):
            level = round(rng.uniform(low, high), digits)
        values[k:] = level
        k += int(rng.uniform(0.3, 1.1) / STEP)
    return values


def quantise(values: Array, step: float) -> Array:
    """Round to the nearest step of a converter."""
    return np.round(values / step) * step


# ------------------------------------------------------------------------------ hydrostatic

HYDROSTATIC = {
    "mass": Truth(53.7, "kg", THESIS),
    "damping": Truth(1720.5, "N s/m", THESIS),
    "dead_zone_negative": Truth(-3.0, "N", note="lost in the only copy of the thesis (figure 18)"),
    "dead_zone_positive": Truth(1.2, "N", note="lost in the only copy of the thesis (figure 18)"),
}


def scalar(truth: dict[str, Truth], name: str) -> float:
    """A true value as a number."""
    value = truth[name].value
    assert isinstance(value, float)
    return value


def hand_force(rng: np.random.Generator, time: Array) -> Array:
    """Force of a hand within +-12 N: six sines of 0.1 Hz to 2 Hz that fade in [N]."""
    frequency = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    total = np.zeros_like(time)
    for f, p in zip(frequency, phase):
        total += f**-0.4 * np.sin(2.0 * np.pi * f * time + p)
    total *= 1.0 - np.exp(-((time / 0.3) ** 2))
    return 12.0 / float(np.abs(total).max()) * total


def simulate_hydrostatic(rng: np.random.Generator, trial: int) -> list[Array]:
    """Dead zone, mass and damping; exact for a force on straight lines of 0.1 ms."""
    force = hand_force(rng, fine_instants())
    low, high = (scalar(HYDROSTATIC, f"dead_zone_{s}") for s in ("negative", "positive"))
    net = np.maximum(force - high, 0.0) + np.minimum(force - low, 0.0)
    damping = scalar(HYDROSTATIC, "damping")
    tau = scalar(HYDROSTATIC, "mass") / damping
    speed = lag_of_straight_lines(net / damping, tau)
    # m v + c x = integral of the net force
    h = STEP / FINE
    impulse = np.concatenate(([0.0], np.cumsum(0.5 * h * (net[1:] + net[:-1]))))
    position = (impulse / damping - tau * speed)[::FINE]
    measured_force = force[::FINE] + 0.02 * rng.standard_normal(SAMPLES)
    measured = 0.025 + position + 10e-6 * rng.standard_normal(SAMPLES)
    return [
        sample_instants(),
        quantise(measured_force, 100.0 / 2**16),
        1e3 * quantise(measured, 55e-3 / 2**16),
    ]


def lag_of_straight_lines(u: Array, tau: float) -> Array:
    """First-order lag, exact for straight lines between points of the fine grid; from rest."""
    h = STEP / FINE
    keep = math.exp(-h / tau)
    old = tau / h * (1.0 - keep) - keep
    new = 1.0 - tau / h * (1.0 - keep)
    out = np.empty_like(u)
    y = out[0] = u[0]
    for k, drive in enumerate((old * u[:-1] + new * u[1:]).tolist(), start=1):
        y = keep * y + drive
        out[k] = y
    return out


# ------------------------------------------------------------------------------------ valve

VALVE = {
    "gain": Truth(9.0e4, "Pa/V", note="equation 20 has lost its numbers"),
    "natural_frequency": Truth(20.0, "rad/s", note="equation 20 has lost its numbers"),
    "damping_ratio": Truth(0.7, "1", note="equation 20 has lost its numbers"),
}


def second_order(command: Array, omega: float, zeta: float, h: float) -> Array:
    """Answer of an underdamped second order to held values, closed form; from rest."""
    wd = omega * math.sqrt(1.0 - zeta**2)
    fade = math.exp(-zeta * omega * h)
    c, s = math.cos(wd * h), math.sin(wd * h)
    out = np.empty_like(command)
    y, v = float(command[0]), 0.0
    for k, u in enumerate(command.tolist()):
        out[k] = y
        x = y - u
        y = u + fade * ((c + zeta * omega / wd * s) * x + s / wd * v)
        v = fade * (-(omega**2) / wd * s * x + (c - zeta * omega / wd * s) * v)
    return out


def simulate_valve(rng: np.random.Generator, trial: int) -> list[Array]:
    """Second order after the held command of a 100 Hz controller."""
    command = make_steps(rng, 1.0, 7.0, 2)
    omega, zeta = scalar(VALVE, "natural_frequency"), scalar(VALVE, "damping_ratio")
    pressure = 1e-5 * scalar(VALVE, "gain") * second_order(command, omega, zeta, STEP)
    measured = 0.03 + pressure + 0.01 * rng.standard_normal(SAMPLES)
    return [sample_instants(), command, quantise(measured, 10.0 / 2**12)]


# ------------------------------------------------------------------------------------- line

LINE = {
    "gain": Truth(0.98, "1", note="equation 21 has lost its numbers"),
    "time_constant": Truth(0.12, "s", note="equation 21 has lost its numbers"),
    "dead_time": Truth(0.0147, "s", THESIS),
}


def simulate_line(rng: np.random.Generator, trial: int) -> list[Array]:
    """Dead time and first order after a pressure that a valve moves without pause."""
    target = np.repeat(make_steps(rng, 1.0, 6.0, 2), FINE)[: fine_instants().size]
    inlet = second_order(target, 40.0, 0.8, STEP / FINE)
    late = round(scalar(LINE, "dead_time") / (STEP / FINE))  # 147 steps of the fine grid, exactly
    delayed = np.concatenate((np.full(late, inlet[0]), inlet[:-late]))
    outlet = scalar(LINE, "gain") * lag_of_straight_lines(delayed, scalar(LINE, "time_constant"))
    valve_side = inlet[::FINE] + 0.002 * rng.standard_normal(SAMPLES)
    far_side = outlet[::FINE] + 0.005 * rng.standard_normal(SAMPLES)
    return [
        1e3 * sample_instants(),
        quantise(valve_side, 10.0 / 2**14),
        quantise(far_side, 10.0 / 2**14),
    ]


# ------------------------------------------------------------------------------- ball-screw

_ORDER = "the level is published, which of the four it is was invented: table 3 lost its symbols"
BALL_SCREW = {
    "inertia": Truth(11.71e-7, "kg m2", THESIS),
    "viscous": Truth(1.0e-5, "N m s/rad", note="the thesis says only that it is about zero"),
    "coulomb_positive": Truth(2.0e-3, "N m", THESIS, _ORDER),
    "coulomb_negative": Truth(1.6e-3, "N m", THESIS, _ORDER),
    "breakaway_positive": Truth(2.9e-3, "N m", THESIS, _ORDER),
    "breakaway_negative": Truth(1.9e-3, "N m", THESIS, _ORDER),
}


def drive_torque(rng: np.random.Generator, trial: int) -> Array:
    """A chirp, slow reversals, or half of each; in steps of 0.003 mN m [mN m]."""
    t = sample_instants()
    size, phase = rng.uniform(0.95, 1.05), rng.uniform(-0.3, 0.3)
    chirp = 6.0 * size * np.sin(2.0 * np.pi * (0.2 * t + 0.19 * t**2) + phase)
    ramp = np.abs(np.mod(t / 2.5 + 0.25 + 0.05 * phase, 1.0) - 0.5)
    reversals = 4.0 * size * (4.0 * ramp - 1.0) * np.minimum(t / 0.3, 1.0)
    chosen = (chirp, reversals, np.where(t < 5.0, reversals, chirp))[trial]
    return quantise(chosen, 0.003)  # no step falls on a friction level


def stick_slip(torque: Sequence[float]) -> Array:
    """Angle at the samples for a torque held between them; every event in closed form."""
    inertia, viscous = scalar(BALL_SCREW, "inertia"), scalar(BALL_SCREW, "viscous")
    kinetic = {
        1: scalar(BALL_SCREW, "coulomb_positive"),
        -1: scalar(BALL_SCREW, "coulomb_negative"),
    }
    static = {
        1: scalar(BALL_SCREW, "breakaway_positive"),
        -1: scalar(BALL_SCREW, "breakaway_negative"),
    }
    coast = inertia / viscous
    angle, speed, direction = 0.0, 0.0, 0
    out = []
    for tau in torque:
        out.append(angle)
        left = STEP
        while left > 0.0:
            if direction == 0:
                direction = 1 if tau > static[1] else -1 if tau < -static[-1] else 0
                if direction == 0:
                    break
            final = (tau - direction * kinetic[direction]) / viscous
            stop = math.inf
            if direction * final < 0.0:
                stop = coast * math.log((speed - final) / -final)
            span = min(left, stop)
            fade = math.exp(-span / coast)
            angle += final * span + (speed - final) * coast * (1.0 - fade)
            speed = final + (speed - final) * fade
            left -= span
            if span == stop:
                speed, direction = 0.0, 0
    return np.array(out)


def simulate_ball_screw(rng: np.random.Generator, trial: int) -> list[Array]:
    """Stick-slip under a held torque, read by an encoder of 2000 counts."""
    torque = drive_torque(rng, trial)
    turns = stick_slip((1e-3 * torque).tolist()) / (2.0 * np.pi)
    counts = np.floor(2000.0 * turns + rng.uniform())
    return [sample_instants(), torque, 0.18 * counts]


# ---------------------------------------------------------------------------- potentiometer

POTENTIOMETER = {
    "control_points": Truth([0.0, 0.022, 0.038, 0.06], "m", note="the curve was not published"),
    "weights": Truth([1.0, 2.5, 2.5, 1.0], "1", note="the curve was not published"),
    "reading_range": Truth([31.0, 992.0], "1", note="10-bit readings"),
}


def true_position(reading: Array) -> Array:
    """Position of a reading: a rational Bezier curve of degree three, written out [m]."""
    points, weights, span = (
        np.asarray(POTENTIOMETER[k].value) for k in ("control_points", "weights", "reading_range")
    )
    t = (reading - span[0]) / (span[1] - span[0])
    basis = np.array([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    weighted = weights[:, None] * basis
    return np.asarray((points[:, None] * weighted).sum(0) / weighted.sum(0))


def simulate_potentiometer(rng: np.random.Generator, trial: int) -> list[Array]:
    """Reciprocating motion over the whole stroke, read by a 10-bit converter and a laser."""
    t = sample_instants()
    slow, quick = rng.uniform(0.08, 0.12), rng.uniform(0.5, 0.9)
    start = rng.uniform(0.0, 2.0 * np.pi)
    swing = np.sin(2.0 * np.pi * quick * t + start)
    reach = 0.9 + 0.1 * np.sin(2.0 * np.pi * slow * t)
    position = 0.030 + 0.0298 * reach * swing
    table = np.linspace(31.0, 992.0, 200_001)  # inverse of a monotone curve by a fine table
    reading = np.interp(position, true_position(table), table)
    counts = np.round(reading + 0.3 * rng.standard_normal(SAMPLES))
    laser = position + 1e-4 * rng.standard_normal(SAMPLES)
    return [counts, 1e3 * laser]


# ------------------------------------------------------------------------ cylinder friction

CYLINDER = {
    "viscous": Truth(45.0, "N s/m", THESIS),
    "coulomb_positive": Truth(2.4, "N", THESIS),
    "coulomb_negative": Truth(2.4, "N", THESIS),
}
CYLINDER_MASS = 0.140  # kg, published: 80 g piston and 60 g load cell


def simulate_cylinder(rng: np.random.Generator, trial: int) -> list[Array]:
    """Piston moved by hand, slow, medium and fast; the motion is given in closed form."""
    t = sample_instants()
    base, size = ((0.4, 0.014), (1.0, 0.016), (2.2, 0.018))[trial]
    frequency = base * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    share = size * np.array([1.0, 0.5, 0.25])
    omega = 2.0 * np.pi * frequency[:, None]
    angle = omega * t + phase[:, None]
    position = (share[:, None] * np.sin(angle)).sum(0)
    speed = (share[:, None] * omega * np.cos(angle)).sum(0)
    acceleration = (-share[:, None] * omega**2 * np.sin(angle)).sum(0)
    coulomb = np.where(
        speed > 0.0, scalar(CYLINDER, "coulomb_positive"), -scalar(CYLINDER, "coulomb_negative")
    )
    force = CYLINDER_MASS * acceleration + scalar(CYLINDER, "viscous") * speed + coulomb
    measured_force = force + 0.1 * rng.standard_normal(SAMPLES)
    measured_position = 0.0275 + position + 10e-6 * rng.standard_normal(SAMPLES)
    measured_speed = speed + 1e-3 * rng.standard_normal(SAMPLES)
    return [
        t,
        quantise(measured_force, 100.0 / 2**16),
        1e3 * quantise(measured_position, 55e-3 / 2**16),
        1e3 * measured_speed,
    ]


# --------------------------------------------------------------------------- the collection

_RIG = "100 Hz, 1000 samples, 10 s: the recording limit of the rig (thesis)"
DATASETS = (
    Dataset(
        "potentiometer",
        "Calibration of a linear potentiometer against a laser",
        0,
        simulate_potentiometer,
        (
            Column("ADC", "reading of the 10-bit converter [counts]", 0),
            Column("laser (mm)", "position from the laser [mm]", 3),
        ),
        {"reading": "ADC", "reference": "laser (mm)"},
        POTENTIOMETER,
        (
            "60 mm potentiometer, 10-bit converter with 0.3 counts RMS noise (noise invented)",
            "laser of 0.2 mm repeatability, taken as two standard deviations: 0.1 mm RMS",
            "reciprocating motion over the whole stroke; no hysteresis; no time column",
            "the readings crowd at both ends (saturation), as the paper's figure 3 shows; the "
            "shape of the curve is invented and lies inside the model family",
        ),
        {"degree": "auto"},
        curve=True,
    ),
    Dataset(
        "ball-screw",
        "Servo motor with ball-screw: torque and angle",
        1,
        simulate_ball_screw,
        (
            Column("time [s]", "time of the sample", 2),
            Column("torque [mN m]", "torque command, held until the next sample", 3),
            Column("angle [deg]", "motor shaft angle, 2000 counts per turn (0.18 deg)", 2),
        ),
        {"time": "time [s]", "torque": "torque [mN m]", "angle": "angle [deg]"},
        BALL_SCREW,
        (
            _RIG,
            "the torque is exactly held between the samples of the log (`zoh`) and exactly the "
            "logged number",
            "trial 1: chirp of 0.2 Hz to 4 Hz, about 6 mN m; trial 2: slow reversals up to "
            "4 mN m, period 2.5 s, in which the break-away shows; trial 3: 5 s of each",
            "encoder of 2000 counts per turn, no other noise; starts at rest",
        ),
    ),
    Dataset(
        "hydrostatic",
        "Hydrostatic transmission moved by hand: force and position",
        2,
        simulate_hydrostatic,
        (
            Column("t [s]", "time of the sample", 2),
            Column("F [N]", "load cell on the piston", 4),
            Column("x [mm]", "position sensor of the piston", 4),
        ),
        {"time": "t [s]", "force": "F [N]", "position": "x [mm]"},
        HYDROSTATIC,
        (
            _RIG,
            "hand force within +-12 N: six sines of 0.1 Hz to 2 Hz. It moves on between the "
            "samples (`foh`)",
            "load cell 0.02 N RMS noise, 16 bits over 100 N; position 10 um RMS noise, 16 bits "
            "over 55 mm (noise and bits invented)",
            "two lines of 2.36 m, 2.5 mm inner diameter (thesis); starts at rest",
        ),
    ),
    Dataset(
        "valve",
        "Proportional pressure valve: command and outlet pressure",
        3,
        simulate_valve,
        (
            Column("Zeit [s]", "time of the sample", 2),
            Column("Sollwert [V]", "command of the controller, held until the next sample", 2),
            Column("Druck [bar]", "outlet pressure by the valve's own sensor", 4),
        ),
        {"time": "Zeit [s]", "command": "Sollwert [V]", "outlet": "Druck [bar]"},
        VALVE,
        (
            _RIG,
            "steps of the command between 1 V and 7 V, held for 0.3 s to 1.1 s (`zoh`)",
            "sensor noise 0.01 bar RMS, 12 bits over 10 bar, zero error 0.03 bar (invented)",
            "semicolons and decimal commas, as a German spreadsheet writes them",
        ),
        delimiter=";",
        decimal=",",
    ),
    Dataset(
        "line",
        "Pneumatic line of 5 m: pressure at the valve and at the chamber",
        4,
        simulate_line,
        (
            Column("t (ms)", "time of the sample", 0),
            Column("p_valve (bar)", "pressure at the valve side", 4),
            Column("p_chamber (bar)", "pressure at the chamber", 4),
        ),
        {"time": "t (ms)", "inlet": "p_valve (bar)", "outlet": "p_chamber (bar)"},
        LINE,
        (
            _RIG,
            "the valve follows steps between 1 bar and 6 bar as a second order of 40 rad/s and "
            "0.8 damping (invented); its pressure moves on between the samples (`foh`)",
            "noise 0.002 bar RMS at the valve, 0.005 bar at the chamber, 14 bits over 10 bar "
            "(invented)",
            "5 m of 2.5 mm inner diameter (thesis); the dead time is 1.47 samples",
        ),
    ),
    Dataset(
        "cylinder-friction",
        "Pneumatic cylinder moved by hand: force, position and velocity",
        5,
        simulate_cylinder,
        (
            Column("t [s]", "time of the sample", 2),
            Column("F [N]", "load cell between hand and piston", 4),
            Column("x [mm]", "position sensor of the piston", 4),
            Column("v [mm/s]", "velocity of the piston", 3),
        ),
        {"time": "t [s]", "force": "F [N]", "velocity": "v [mm/s]"},
        CYLINDER,
        (
            _RIG,
            "open chambers; trials 1, 2, 3: slow, medium and fast strokes, up to about 0.4 m/s "
            "as in the thesis' figure 43",
            "moving mass 0.140 kg (80 g piston, 60 g load cell, thesis)",
            "load cell 0.1 N RMS noise, 16 bits over 100 N; position 10 um RMS, velocity "
            "1 mm/s RMS (invented)",
        ),
        {"mass": CYLINDER_MASS},
    ),
)


# --------------------------------------------------------------------------- writing it down


def format_log(data: Dataset, columns: Sequence[Array]) -> str:
    """The text of a log."""
    lines = [data.delimiter.join(c.header for c in data.columns)]
    for row in zip(*(c.tolist() for c in columns)):
        cells = (f"{v:.{c.digits}f}" for v, c in zip(row, data.columns))
        lines.append(data.delimiter.join(cell.replace(".", data.decimal) for cell in cells))
    # "-0.00" depends on rounding in the last place of the machine's sine
    text = "\n".join(lines) + "\n"
    for c in data.columns:
        zero = f"{0.0:.{c.digits}f}".replace(".", data.decimal)
        for before, after in ((data.delimiter, data.delimiter), (data.delimiter, "\n")):
            text = text.replace(f"{before}-{zero}{after}", f"{before}{zero}{after}")
    return text


def name_logs(data: Dataset) -> list[str]:
    """File names of the logs."""
    return [f"trial{i + 1}.csv" for i in range(TRIALS)]


def quote(text: str) -> str:
    """An argument for the shell."""
    return f'"{text}"' if any(c in text for c in " ()[]") else text


def make_arguments(data: Dataset) -> list[str]:
    """Family options and columns for the command line; what it finds itself is left out."""
    out = []
    for role, header in data.roles.items():
        if header.split(" ")[0] not in (role, "t" if role == "time" else role):
            out += ["--column", f"{role}={header}"]
    for name, value in data.options.items():
        out += [f"--{name}", str(value)]
    return out


def format_command(data: Dataset) -> str:
    """The command that fits the dataset, for a shell in the root of the repository."""
    arguments = make_arguments(data)
    lines = [
        f"fluidact-fit {data.family}",
        " ".join(f"datasets/{data.family}/{n}" for n in name_logs(data)),
    ]
    lines += [f"{a} {quote(b)}" for a, b in zip(arguments[::2], arguments[1::2])]
    lines.append(f"-o {data.family}.yaml")
    return " \\\n    ".join(lines)


def format_number(value: float) -> str:
    """A number that every YAML reader takes as a float."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def format_value(value: float | list[float]) -> str:
    """A number or a list of numbers."""
    if isinstance(value, list):
        return "[" + ", ".join(format_number(v) for v in value) + "]"
    return format_number(value)


def format_truth(data: Dataset) -> str:
    """The text of ``truth.yaml``."""
    lines = [
        "# Written by datasets/generate.py. The logs are synthetic; these values made them.",
        f"family: {data.family}",
        "synthetic: true",
        f"seed: [{SEED}, {data.number}]",
        f"logs: [{', '.join(name_logs(data))}]",
        "columns:",
        *(f'  {role}: "{header}"' for role, header in data.roles.items()),
        f"arguments: [{', '.join(f'{chr(34)}{a}{chr(34)}' for a in make_arguments(data))}]",
    ]
    if data.options:
        lines.append("options:")
        for name, option in data.options.items():
            text = option if isinstance(option, str) else format_number(option)
            lines.append(f"  {name}: {text}")
    else:
        lines.append("options: {}")
    if data.curve:
        lines += [
            "# The curve counts, not the numbers that draw it: degrees may differ.",
            "curve: {tolerance: 1.0e-04, unit: m}",
        ]
    lines.append("parameters:")
    for name, truth in data.truth.items():
        origin = "published" if truth.origin else "invented"
        extra = f', source: "{truth.origin}"' if truth.origin else ""
        extra += f', note: "{truth.note}"' if truth.note else ""
        value = format_value(truth.value)
        lines.append(f'  {name}: {{value: {value}, unit: "{truth.unit}", origin: {origin}{extra}}}')
    return "\n".join(lines) + "\n"


def format_readme(data: Dataset) -> str:
    """The text of a directory's README."""
    rows = []
    for name, truth in data.truth.items():
        value = format_value(truth.value)
        origin = f"published ({truth.origin})" if truth.origin else "**invented**"
        rows.append(
            f"| `{name}` | {value} {truth.unit} | {origin}{'; ' * bool(truth.note)}{truth.note} |"
        )
    columns = [f"| `{c.header}` | {c.meaning} |" for c in data.columns]
    paper = FORCE_PAPER if data.family == "potentiometer" else "D. B. Comber's thesis of 2013"
    form = f"Separator `{data.delimiter}`, decimal `{data.decimal}`, UTF-8, one header line."
    return "\n".join(
        [
            f"# {data.title}",
            "",
            "**Synthetic**: nobody measured these logs. They imitate the rig of "
            + f"{paper}, with the numbers it published",
            "where they are known. `datasets/generate.py` writes this directory; seed "
            + f"`[{SEED}, {data.number}, trial]`.",
            "",
            "## Conditions",
            "",
            *(f"- {c}" for c in data.conditions),
            "",
            "## Columns",
            "",
            "| header | meaning |",
            "|---|---|",
            *columns,
            "",
            f"{form}",
            "",
            "## True parameters",
            "",
            "| parameter | value | origin |",
            "|---|---|---|",
            *rows,
            "",
            "The same, for programs: `truth.yaml`.",
            "",
            "## Fit",
            "",
            "```sh",
            format_command(data),
            "```",
            "",
        ]
    )


def write_datasets(directory: Path) -> None:
    """Write all datasets below ``directory``."""
    for data in DATASETS:
        folder = directory / data.family
        folder.mkdir(parents=True, exist_ok=True)
        texts = {"README.md": format_readme(data), "truth.yaml": format_truth(data)}
        for trial, name in enumerate(name_logs(data)):
            rng = np.random.default_rng([SEED, data.number, trial])
            texts[name] = format_log(data, data.simulate(rng, trial))
        for name, text in sorted(texts.items()):
            (folder / name).write_bytes(text.encode("utf-8"))


def write_checksums(directory: Path) -> None:
    """Write the checksums of all datasets, those of other generators included."""
    sums = [
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.relative_to(directory).as_posix()}\n"
        for p in sorted(directory.glob("*/*.*"))
        if p.suffix != ".pyc"
    ]
    (directory / "SHA256SUMS").write_bytes("".join(sums).encode("utf-8"))


def main() -> None:
    """Write the datasets."""
    parser = argparse.ArgumentParser(description="Write the synthetic datasets.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent)
    directory = parser.parse_args().output
    write_datasets(directory)
    write_checksums(directory)


if __name__ == "__main__":
    main()
