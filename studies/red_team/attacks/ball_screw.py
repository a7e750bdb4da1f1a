"""Attacks on the ball screw: lost rows, noisy torque, friction and play that it has not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao

ROTARY = {"torque": "N m", "angle": "rad"}
LINEAR = {"force": "N", "position": "m"}
COUNT = 2.0 * math.pi / 2000.0  # rad per count of the encoder
FINE = 50  # steps of the simulator per sample
Truth = Mapping[str, float]
Spoil = Callable[[Recording, np.random.Generator], Recording]

SCREW = {
    "inertia": 1.171e-6, "viscous": 2e-5, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
    "breakaway_positive": 2.9e-3, "breakaway_negative": 1.9e-3,
}  # fmt: skip
AXIS = {
    "mass": 95.0, "viscous": 200.0, "coulomb_positive": 20.0, "coulomb_negative": 22.0,
    "breakaway_positive": 26.0, "breakaway_negative": 30.0,
}  # fmt: skip
MICRO = {
    "mass": 2e-3, "viscous": 0.05, "coulomb_positive": 8e-3, "coulomb_negative": 6e-3,
    "breakaway_positive": 1.1e-2, "breakaway_negative": 9e-3,
}  # fmt: skip
HEAVY = {
    "inertia": 2e-4, "viscous": 3e-4, "coulomb_positive": 0.02, "coulomb_negative": 0.024,
    "breakaway_positive": 0.03, "breakaway_negative": 0.034,
}  # fmt: skip
STATIC = ("breakaway_positive", "breakaway_negative")


@dataclass(frozen=True)
class Machine:
    """What the drive has besides the model: all zero for the model itself.

    ``ripple`` [drive] at eight cycles per unit of motion times ``pitch``; Stribeck friction
    falls from the static to the kinetic level over ``stribeck`` [speed]; ``play`` [motion] lies
    between the drive and the encoder; ``gain`` is what the drive makes of its command.
    """

    truth: Truth
    ripple: float = 0.0
    pitch: float = 1.0
    stribeck: float = 0.0
    play: float = 0.0
    gain: float = 1.0


def follow(machine: Machine, drive: Array, step: float, jumps: bool = False) -> Array:
    """Motion at the instants of a drive, ``step`` apart.

    Between two instants the drive is held (``jumps``) or follows a straight line, of which a
    moving axis feels the mean, in closed form with its stop; an axis at rest breaks away where
    the line passes its level.
    """
    p = machine.truth
    inertia, viscous = p.get("inertia", p.get("mass", 0.0)), max(p["viscous"], 1e-12)
    kinetic = {1: p["coulomb_positive"], -1: p["coulomb_negative"]}
    static = {1: p["breakaway_positive"], -1: p["breakaway_negative"]}
    h, lag = step, inertia / viscous
    decays = math.exp(-h / lag)
    out = np.empty(drive.size)
    place = speed = 0.0
    way = 0
    u = (machine.gain * drive).tolist()
    for i, begin in enumerate(u):
        out[i] = place
        if i == len(u) - 1:
            break
        end, at = begin if jumps else u[i + 1], 0.0
        if machine.ripple:
            extra = machine.ripple * math.sin(8.0 * place * machine.pitch)
            begin, end = begin + extra, end + extra
        for _ in range(8):
            if way == 0:
                now = begin + (end - begin) * at
                for side in (1, -1):
                    if side * now > static[side]:
                        way = side
                    elif side * end > static[side]:
                        way, at = side, (side * static[side] - begin) / (end - begin)
                if way == 0:
                    break
                speed = 0.0
            rest = h * (1.0 - at)
            mean = begin + 0.5 * (end - begin) * (1.0 + at)
            level = kinetic[way]
            if machine.stribeck:
                fall = math.exp(-abs(speed) / machine.stribeck)
                level += (static[way] - level) * fall
            final = (mean - way * level) / viscous
            decay = decays if at == 0.0 else math.exp(-rest / lag)
            new = final + (speed - final) * decay
            if new * way > 0.0:
                place += final * rest + (speed - final) * lag * (1.0 - decay)
                speed = new
                break
            if speed * way <= 0.0:  # broke away by a hair and cannot move yet
                way, speed = 0, 0.0
                break
            stop = lag * math.log((speed - final) / -final)
            place += final * stop + speed * lag
            at += stop / h
            way, speed = 0, 0.0
            if at >= 1.0:
                break
    if machine.play:
        carried = out[0]
        for k, x in enumerate(out):
            carried = min(max(carried, x - machine.play), x)
            out[k] = carried
    return out


def chirp(rng: np.random.Generator, duration: float, size: float) -> Callable[[Array], Array]:
    """From 0.2 Hz to 4 Hz, about twice the highest level of friction."""
    amplitude, phase = 2.07 * size * rng.uniform(0.95, 1.05), rng.uniform(-0.3, 0.3)
    rate = 3.8 / duration
    return lambda t: amplitude * np.sin(2.0 * np.pi * (0.2 * t + 0.5 * rate * t**2) + phase)


def levels(rng: np.random.Generator, n: int, step: float, size: float) -> Array:
    """Random levels held for 0.15 s to 0.5 s."""
    u, k = np.zeros(n), 3
    while k < n:
        hold = round(rng.uniform(0.15, 0.5) / step)
        u[k : k + hold] = 2.07 * size * rng.uniform(-1.0, 1.0)
        k += hold
    return u


def pushes(rng: np.random.Generator, n: int, step: float, size: float) -> Array:
    """Half-sines of 0.6 s to 1 s to either side by turns, each anew from rest."""
    u, k, way = np.zeros(n), round(0.1 / step), 1.0
    while k < n:
        rows = round(rng.uniform(0.6, 1.0) / step)
        push = way * size * rng.uniform(1.2, 1.8) * np.sin(np.linspace(0.0, np.pi, rows))
        u[k : k + rows] = push[: n - k]
        k, way = k + rows, -way
    return u


Move = Callable[[Machine, Array, float, bool], Array]


@dataclass(frozen=True)
class Logger:
    """How a motion is recorded; ``loud`` is the drive in parts of the usual one."""

    step: float = 0.01
    duration: float = 8.0
    count: float = COUNT
    noise: float = 0.0  # of the position, beside the counts
    drive_noise: float = 0.0  # of the recorded drive, not of the acting one
    kind: str = "held"  # how the drive moves: held, levels, pushes, lines or continuous
    lost: float = 0.0  # part of the rows
    jitter: float = 0.0  # of the instants, part of a sample
    logs: int = 1
    loud: float = 1.0

    @property
    def jumps(self) -> bool:
        """Whether the drive is held between samples."""
        return self.kind in ("held", "levels", "pushes")


def record(
    rng: np.random.Generator,
    machine: Machine,
    logger: Logger,
    spoil: Spoil | None = None,
    move: Move = follow,
) -> list[Recording]:
    """Logs of a machine that moves as ``move`` says."""
    out = []
    for _ in range(logger.logs):
        recording = _recording(rng, machine, logger, move)
        out.append(spoil(recording, rng) if spoil else recording)
    return out


def _drive(rng: np.random.Generator, machine: Machine, logger: Logger) -> Array:
    n = round(logger.duration / logger.step)
    size = logger.loud * max(machine.truth[s] for s in STATIC)
    fine = np.arange((n - 1) * FINE + 1) / FINE
    wave = chirp(rng, logger.duration, size)
    if logger.kind == "continuous":
        return wave(fine * logger.step)
    if logger.kind == "levels":
        u = levels(rng, n, logger.step, size)
    elif logger.kind == "pushes":
        u = pushes(rng, n, logger.step, size)
    else:  # in the steps of the controller
        u = np.round(wave(np.arange(n) * logger.step) / size * 1000.0) * size / 1000.0
    return np.interp(fine, np.arange(n), u) if logger.kind == "lines" else u[fine.astype(int)]


def _recording(rng: np.random.Generator, machine: Machine, logger: Logger, move: Move) -> Recording:
    drive = _drive(rng, machine, logger)
    motion = move(machine, drive, logger.step / FINE, logger.jumps)
    at = np.arange(0, drive.size, FINE)
    n = at.size
    if logger.jitter:  # sampled a little off the grid, the true instant recorded
        off = np.round(logger.jitter * FINE * rng.uniform(-0.5, 0.5, n)).astype(int)
        at = np.clip(at + off, 0, drive.size - 1)
    y = motion[at] + logger.noise * rng.standard_normal(n)
    if logger.count:
        y = np.floor((y + rng.uniform(0.0, logger.count)) / logger.count) * logger.count
    u = drive[at] + logger.drive_noise * rng.standard_normal(n)
    axis = ROTARY if "inertia" in machine.truth else LINEAR
    recording = dict(zip(("time", *axis), (at * (logger.step / FINE), u, y)))
    if logger.lost:
        kept = rng.uniform(size=n) > logger.lost
        kept[[0, -1]] = True
        recording = {role: x[kept] for role, x in recording.items()}
    return recording


def _bounds(machine: Machine, logger: Logger, names: Sequence[str], move: Move) -> dict[str, float]:
    """Bound of one log; the error of the counts is taken for white noise."""
    drive = _drive(np.random.default_rng(1), machine, logger)

    def simulate(truth: Truth) -> list[Array]:
        changed = replace(machine, truth={**machine.truth, **truth})
        return [move(changed, drive, logger.step / FINE, logger.jumps)[::FINE]]

    sigma = math.hypot(logger.noise, logger.count / math.sqrt(12.0))
    return cramer_rao(simulate, {n: machine.truth[n] for n in names}, sigma)


def make_attack(
    group: str,
    name: str,
    machine: Machine,
    logger: Logger,
    hold: str = "",
    repetitions: int = 3,
    bounds: bool = False,
    spoil: Spoil | None = None,
    beyond: str = "",
    move: Move = follow,
    scales: Mapping[str, float] | None = None,
    **options: str,
) -> Attack:
    """One attack on the screw or the axis; see :class:`Attack`."""
    units = ROTARY if "inertia" in machine.truth else LINEAR
    # a held drive jumps past the static levels: the position does not tell them to a bound
    known = [n for n, v in machine.truth.items() if v and not (logger.jumps and n in STATIC)]
    return Attack(
        "ball-screw", group, name, machine.truth, partial(record, machine=machine, logger=logger,
        spoil=spoil, move=move), units, options=options,
        hold={next(iter(units)): hold} if hold else {}, scales=scales or {},
        bounds=partial(_bounds, machine, logger, known, move) if bounds else {},
        repetitions=repetitions, beyond=beyond,
    )  # fmt: skip


def _glitch(
    recording: Recording, rng: np.random.Generator, role: str, where: float, value: float
) -> Recording:
    spoiled = recording[role].copy()
    spoiled[min(int(where * spoiled.size), spoiled.size - 1)] = value
    return {**recording, role: spoiled}


def _drift(recording: Recording, rng: np.random.Generator, role: str, total: float) -> Recording:
    return {**recording, role: recording[role] + np.linspace(0.0, total, recording[role].size)}


def _cut(recording: Recording, rng: np.random.Generator, role: str, limit: float) -> Recording:
    return {**recording, role: np.clip(recording[role], -limit, limit)}


def attacks() -> Iterator[Attack]:
    """All of them."""
    screw, plain = Machine(SCREW), Logger()
    moving = replace(plain, kind="continuous")
    axis_log = Logger(count=1e-6, duration=10.0, step=0.005)
    micro_log = Logger(count=1e-7, step=0.005, duration=5.0)
    pushed = Logger(step=0.002, duration=6.0, count=2.0 * math.pi / 8192.0, kind="pushes")
    yield make_attack(
        "right model, held drive", "pushes by turns", Machine(HEAVY), pushed, repetitions=4
    )
    yield make_attack("right model, held drive", "chirp", screw, plain, bounds=True, repetitions=8)
    yield make_attack(
        "right model, held drive",
        "levels",
        screw,
        replace(plain, kind="levels"),
        bounds=True,
        repetitions=4,
    )
    yield make_attack(
        "right model, held drive",
        "4 s",
        screw,
        replace(plain, duration=4.0),
        bounds=True,
        repetitions=4,
    )
    yield make_attack(
        "right model, held drive", "linear axis", Machine(AXIS), axis_log, bounds=True
    )
    yield make_attack(
        "right model, held drive", "micro-actuator", Machine(MICRO), micro_log, bounds=True
    )
    lines = replace(plain, kind="lines")
    for hold, log in (("foh", lines), ("smooth", moving)):
        yield make_attack(
            "right model, continuous drive", hold, screw, log, hold, bounds=True, repetitions=8
        )
    yield make_attack(
        "right model, continuous drive",
        "three logs, smooth",
        screw,
        replace(moving, logs=3),
        "smooth",
        repetitions=4,
    )
    yield make_attack("another hold", "curved, taken for lines", screw, moving, "foh")
    yield make_attack("another hold", "curved, taken for held", screw, moving)
    yield make_attack("another hold", "held, taken for lines", screw, plain, "foh")
    yield make_attack("another hold", "lines, taken for held", screw, lines)
    yield make_attack(
        "right model, continuous drive",
        "noise of half a count",
        screw,
        replace(moving, noise=0.5 * COUNT),
        "smooth",
        bounds=True,
        repetitions=4,
    )
    for part in (0.01, 0.05):
        for hold, log in (("", plain), ("foh", lines), ("smooth", moving)):
            yield make_attack(
                "lost rows",
                f"{100 * part:g} % of {log.kind}, {hold or 'default'}",
                screw,
                replace(log, lost=part),
                hold,
            )
        yield make_attack(
            "lost rows",
            f"{100 * part:g} % of levels",
            screw,
            replace(plain, kind="levels", lost=part),
        )
    yield make_attack("jitter", "10 %", screw, replace(moving, jitter=0.1), "smooth", bounds=True)
    yield make_attack("jitter", "40 %", screw, replace(moving, jitter=0.4), "smooth", bounds=True)
    for noise in (1e-6, 1e-5, 1e-4):
        for hold in ("foh", "smooth"):
            yield make_attack(
                "noise of the drive",
                f"{noise:g} N m, {hold}",
                screw,
                replace(moving, drive_noise=noise),
                hold,
            )
        yield make_attack(
            "noise of the drive", f"{noise:g} N m, held", screw, replace(plain, drive_noise=noise)
        )
    for speed in (2.0, 10.0):
        yield make_attack(
            "Stribeck friction", f"{speed:g} rad/s", replace(screw, stribeck=speed), plain
        )
    for size in (5e-5, 2e-4):
        yield make_attack("torque ripple", f"{size:g} N m", replace(screw, ripple=size), plain)
    for play in (2.0 * COUNT, 10.0 * COUNT):
        yield make_attack("backlash", f"{play / COUNT:g} counts", replace(screw, play=play), plain)
    yield make_attack("wrong direction", "torque", replace(screw, gain=-1.0), plain, repetitions=2)
    drive = "torque"
    yield make_attack(
        "logger", "torque clipped", screw, plain, spoil=partial(_cut, role=drive, limit=5e-3)
    )
    yield make_attack(
        "logger", "drift of the angle", screw, plain, spoil=partial(_drift, role="angle", total=1.0)
    )
    yield make_attack(
        "logger",
        "offset of the torque",
        screw,
        plain,
        spoil=lambda r, g: {**r, drive: r[drive] + 1e-4},
        beyond="An offset of the torque is a friction that differs by direction.",
    )
    yield make_attack(
        "logger",
        "torque one sample late",
        screw,
        plain,
        spoil=lambda r, g: {**r, drive: np.roll(r[drive], 1)},
    )
    for where in (0.0, 0.4, 1.0):
        yield make_attack(
            "one bad sample",
            f"angle at {where:g}",
            screw,
            plain,
            repetitions=1,
            spoil=partial(_glitch, role="angle", where=where, value=500.0),
        )
        yield make_attack(
            "one bad sample",
            f"torque at {where:g}",
            screw,
            plain,
            repetitions=1,
            spoil=partial(_glitch, role=drive, where=where, value=0.0),
        )
    yield make_attack(
        "cut in motion", "held", screw, plain, spoil=lambda r, g: {k: x[137:] for k, x in r.items()}
    )
