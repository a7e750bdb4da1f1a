"""The four problems of the head-to-head: truths, excitations, exact simulators, bounds.

    P1  dead zone and 1/(m s^2 + c s), moved by a hand: the force never stops between samples
    P2  valve wn^2/(s^2 + 2 z wn s + wn^2), command held between samples
    P3  line K exp(-L s)/(tau s + 1), dead time a fraction of a sample, input held
    P4  ball screw with stick-slip, torque a chirp, angle read by an encoder

The data come from closed forms between the switches of the input, or from a grid a hundred
times finer than the log with its events solved inside the grid. Nothing here is shared with
``fluidact_fit`` or with any tool; numpy and scipy are all it needs. Everything is
reproducible from a :class:`Problem`, its seed included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm
from scipy.signal import lfilter

Array = npt.NDArray[np.float64]
Theta = Mapping[str, float]

FINE = 100  # steps of the fine grid per sample
COUNT = 2.0 * math.pi / 2000.0  # rad per count of the encoder
WARM_UP = 1000  # number of the trial that is fitted once and not counted


@dataclass(frozen=True)
class Problem:
    """A machine, how it is excited and how it is logged.

    Attributes
    ----------
    name
        ``"P1"`` to ``"P4"``.
    truth, guess
        Parameters in SI units; the guess is all that a tool is told.
    noise
        Standard deviation of the output noise: relative to the standard deviation of the
        output (P1) or to full scale 1 (P2, P3). P4 has its encoder instead.
    sample_time, duration
        Of the log [s].
    seed
        First entry of the seed of every random number.
    """

    name: str
    truth: Theta
    guess: Theta
    noise: float
    sample_time: float = 0.01
    duration: float = 10.0
    seed: int = 2026

    @property
    def samples(self) -> int:
        """Length of a log."""
        return round(self.duration / self.sample_time)

    def scale(self, parameter: str) -> float:
        """What the error of a parameter is relative to: for a dead zone, its width."""
        if parameter.startswith("dz"):
            return self.truth["dz_pos"] - self.truth["dz_neg"]
        return abs(self.truth[parameter])


PROBLEMS: dict[str, Problem] = {
    p.name: p
    for p in (
        Problem(
            "P1",
            {"dz_neg": -3.0, "dz_pos": 1.2, "m": 53.7, "c": 1720.5},
            {"dz_neg": -1.0, "dz_pos": 1.0, "m": 20.0, "c": 1000.0},
            0.01,
        ),
        Problem("P2", {"wn": 20.0, "z": 0.7}, {"wn": 10.0, "z": 1.0}, 0.01),
        Problem(
            "P3",
            {"K": 1.0, "tau": 0.12, "L": 0.0147},
            {"K": 0.8, "tau": 0.3, "L": 0.03},
            0.01,
        ),
        Problem(
            "P4",
            {"J": 1.171e-6, "b": 2e-5, "fkp": 2e-3, "fkn": 1.6e-3, "fsp": 2.9e-3, "fsn": 1.9e-3},
            {"J": 5e-6, "b": 1e-5, "fkp": 1e-3, "fkn": 1e-3, "fsp": 1.5e-3, "fsn": 1.5e-3},
            0.0,
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Log:
    """What a tool sees of a trial: instants, input and measured output, shape ``(n,)``."""

    t: Array
    u: Array
    y: Array
    sample_time: float


@dataclass(frozen=True)
class Trial:
    """A log with what is hidden from the tools: the input in between, the clean output."""

    log: Log
    drive: Array
    clean: Array
    sigma: float


# ---------------------------------------------------------------------------- excitations


def hand_force(rng: np.random.Generator, duration: float) -> Callable[[Array], Array]:
    """Sum of slow sines with a soft start, peak 12 N."""
    hertz = np.array([0.13, 0.31, 0.52, 0.83, 1.27, 1.9]) * rng.uniform(0.9, 1.1, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)

    def raw(t: Array) -> Array:
        waves = hertz[:, None] ** -0.4 * np.sin(2.0 * np.pi * hertz[:, None] * t + phase[:, None])
        return np.asarray(waves.sum(axis=0) * (1.0 - np.exp(-((t / 0.3) ** 2))))

    peak = np.abs(raw(np.arange(0.0, duration, 1e-3))).max()
    return lambda t: 12.0 / peak * raw(t)


def multistep(rng: np.random.Generator, samples: int, sample_time: float) -> Array:
    """Random levels in [-1, 1], each held for 0.3 s to 1 s; starts at rest."""
    u, level, k = np.zeros(samples), 0.0, round(0.1 / sample_time)
    while k < samples:
        new = rng.uniform(-1.0, 1.0)
        while abs(new - level) < 0.3:
            new = rng.uniform(-1.0, 1.0)
        level, until = new, k + round(rng.uniform(0.3, 1.0) / sample_time)
        u[k:until] = level
        k = until
    return u


def chirp(rng: np.random.Generator, duration: float, level: float) -> Callable[[Array], Array]:
    """Torque from 0.2 Hz to 5 Hz, about twice the highest level of friction."""
    amplitude = 2.07 * level * rng.uniform(0.95, 1.05)
    phase = rng.uniform(-0.3, 0.3)
    rate = 4.8 / duration
    return lambda t: amplitude * np.sin(2.0 * np.pi * (0.2 * t + 0.5 * rate * t**2) + phase)


# ----------------------------------------------------------------------------- simulators


def dead_zone(u: Array, low: float, high: float) -> Array:
    """Zero between ``low`` and ``high``, slope one outside."""
    return np.maximum(u - high, 0.0) + np.minimum(u - low, 0.0)


def hand_moved_mass(theta: Theta, drive: Array, step: float, fine: int = FINE) -> Array:
    """P1: position on the log's grid; the force runs straight between fine instants."""
    h = step / fine
    w = dead_zone(drive, theta["dz_neg"], theta["dz_pos"]) / theta["c"]
    lag = theta["m"] / theta["c"]
    a = math.exp(-h / lag)
    speed = lfilter([1.0 - lag / h * (1.0 - a), lag / h * (1.0 - a) - a], [1.0, -a], w)
    travel = np.concatenate(([0.0], np.cumsum(0.5 * h * (w[1:] + w[:-1]))))
    # momentum: m v + c x = integral of the force
    return np.asarray((travel - lag * (speed - speed[0]))[::fine])


def valve(theta: Theta, drive: Array, step: float) -> Array:
    """P2: outlet on the log's grid for a held command, any damping."""
    wn, z = theta["wn"], theta["z"]
    e = expm(np.array([[0.0, 1.0, 0.0], [-(wn**2), -2.0 * z * wn, wn**2], [0.0, 0.0, 0.0]]) * step)
    a1, a2 = -e[0, 0] - e[1, 1], e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0]
    b1 = e[0, 2]
    b2 = e[0, 0] * e[0, 2] + e[0, 1] * e[1, 2] + a1 * b1
    return np.asarray(lfilter([0.0, b1, b2], [1.0, a1, a2], drive))


def line(theta: Theta, drive: Array, step: float) -> Array:
    """P3: outlet on the log's grid for a held inlet and a dead time of any size."""
    gain, tau, dead = theta["K"], theta["tau"], max(theta["L"], 0.0)
    whole = math.floor(dead / step)
    new = math.exp(-(step * (whole + 1) - dead) / tau)  # decay since the newest part arrived
    a = math.exp(-step / tau)
    taps = np.concatenate((np.zeros(whole + 1), [gain * (1.0 - new), gain * (new - a)]))
    return np.asarray(lfilter(taps, [1.0, -a], drive))


def stick_slip(theta: Theta, drive: Array, step: float) -> Array:
    """P4: angle on the log's grid, starting and ending of each motion solved as events.

    ``drive`` holds the torque at the fine instants. Within a fine step a moving axis feels
    the mean torque of the step; an axis at rest breaks away where the straight line between
    the ends passes its level.
    """
    inertia, viscous = theta["J"], max(theta["b"], 1e-12)
    fkp, fkn, fsp, fsn = (theta[k] for k in ("fkp", "fkn", "fsp", "fsn"))
    h, lag = step / FINE, inertia / viscous
    out = np.empty((drive.size - 1) // FINE + 1)
    angle = speed = 0.0
    way = 0
    torque = drive.tolist()
    for i in range(len(torque)):
        if i % FINE == 0:
            out[i // FINE] = angle
        if i == len(torque) - 1:
            break
        begin, end = torque[i], torque[i + 1]
        at = 0.0  # part of the step that is over, as a fraction
        while True:
            if way == 0:
                now = begin + (end - begin) * at
                if now >= fsp or now <= -fsn:
                    way = 1 if now > 0.0 else -1
                elif end > fsp or end < -fsn:
                    way = 1 if end > fsp else -1
                    at = ((fsp if way > 0 else -fsn) - begin) / (end - begin)
                else:
                    break
                speed = 0.0
            rest = h * (1.0 - at)
            mean = begin + 0.5 * (end - begin) * (1.0 + at)
            final = (mean - fkp if way > 0 else mean + fkn) / viscous
            decay = math.exp(-rest / lag)
            new = final + (speed - final) * decay
            if new * way > 0.0:
                angle += final * rest + (speed - final) * lag * (1.0 - decay)
                speed = new
                break
            if speed * way <= 0.0:  # broke away and cannot move: stays until the next step
                way, speed = 0, 0.0
                break
            stop = lag * math.log((speed - final) / -final)
            angle += final * stop + speed * lag
            at += stop / h
            way, speed = 0, 0.0
            if at >= 1.0:
                break
    return out


_SIMULATORS = {"P1": hand_moved_mass, "P2": valve, "P3": line, "P4": stick_slip}


def simulate(problem: Problem, theta: Theta, trial: Trial) -> Array:
    """Noise-free output of a trial for any parameters."""
    return _SIMULATORS[problem.name](theta, trial.drive, problem.sample_time)


# ----------------------------------------------------------------------------------- logs


def make_trial(problem: Problem, number: int) -> Trial:
    """Simulate one trial; the same number always gives the same log."""
    step, n = problem.sample_time, problem.samples
    rng = np.random.default_rng([problem.seed, int(problem.name[1]), number])
    t = np.arange(n) * step
    fine = np.arange((n - 1) * FINE + 1) * (step / FINE)
    if problem.name == "P1":
        force = hand_force(rng, problem.duration)
        u, drive = force(t), force(fine)
    elif problem.name == "P4":
        torque = chirp(rng, problem.duration, max(problem.truth["fsp"], problem.truth["fsn"]))
        u, drive = torque(t), torque(fine)
    else:
        u = drive = multistep(rng, n, step)
    empty = Trial(Log(t, u, u, step), drive, u, 0.0)
    clean = simulate(problem, problem.truth, empty)
    if problem.name == "P4":
        y = np.floor((clean + rng.uniform(0.0, COUNT)) / COUNT) * COUNT
        return Trial(Log(t, u, y, step), drive, clean, COUNT / math.sqrt(12.0))
    sigma = problem.noise * (float(np.std(clean)) if problem.name == "P1" else 1.0)
    return Trial(Log(t, u, clean + sigma * rng.standard_normal(n), step), drive, clean, sigma)


def bound(problem: Problem, trial: Trial) -> dict[str, float]:
    """Cramer-Rao bound of each parameter as a standard deviation [SI].

    Everything else is taken as known (rest at the start, gain of P2), as the tools may. For
    P4 the error of the encoder counts as white with its offset unknown: a yardstick, which
    an estimator that uses the edges of the counts may pass.
    """
    columns = []
    for name, value in problem.truth.items():
        h = 1e-4 * (problem.scale(name) if name.startswith("dz") else abs(value))
        above = simulate(problem, {**problem.truth, name: value + h}, trial)
        below = simulate(problem, {**problem.truth, name: value - h}, trial)
        columns.append((above - below) / (2.0 * h))
    if problem.name == "P4":
        columns.append(np.ones(trial.log.t.size))
    jacobian = np.column_stack(columns)
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / size
    sd = trial.sigma * np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled))) / size
    return dict(zip(problem.truth, sd.tolist()))


# ----------------------------------------------------------------------------- variations


def vary(number: int, seed: int = 2026) -> dict[str, Problem]:
    """The problems with another machine, noise, rate and length, the guess unchanged.

    ``number`` 0 is the benchmark itself. Truths move by up to a factor 1.6 either way, noise
    between 20 dB and 60 dB, logs between 5 s and 20 s, at 50 Hz to 200 Hz (P4: 100 Hz to
    200 Hz, so that the chirp stays sampled ten times per period or more).
    """
    if number == 0:
        return {k: replace(p, seed=seed) for k, p in PROBLEMS.items()}
    rng = np.random.default_rng([seed, 77, number])
    out = {}
    for name, p in PROBLEMS.items():
        truth = {k: v * 1.6 ** rng.uniform(-1.0, 1.0) for k, v in p.truth.items()}
        if name == "P4":  # static levels above the kinetic ones, in their own proportion
            for side in "pn":
                truth[f"fs{side}"] = truth[f"fk{side}"] * rng.uniform(1.1, 1.6)
        out[name] = replace(
            p,
            truth=truth,
            noise=float(10.0 ** rng.uniform(-3.0, -1.0)),
            sample_time=float(rng.choice([0.01, 0.005] if name == "P4" else [0.02, 0.01, 0.005])),
            duration=float(rng.choice([5.0, 10.0, 20.0])),
            seed=seed + 1000 * number,
        )
    out["P4"] = replace(out["P4"], noise=0.0)
    return out
