"""Attacks on the cylinder friction: converters, slow sampling, Stribeck, offsets, constant speeds.

The motion is prescribed in closed form (sines of a hand, or strokes whose speed changes on
straight lines), so force and motion are exact at any instant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao

UNITS = {"force": "N", "velocity": "m/s", "position": "m"}
TRUTH = {"viscous": 45.0, "coulomb_positive": 2.4, "coulomb_negative": 2.4}
MASS = 0.14
Moved = tuple[Array, Array, Array]
Motion = Callable[[np.random.Generator, Array], Moved]
Spoil = Callable[[Recording, np.random.Generator], Recording]


def by_hand(rng: np.random.Generator, t: Array, base: float = 1.0, size: float = 0.016) -> Moved:
    """Position, velocity and acceleration of three sines [SI]."""
    omega = 2.0 * np.pi * base * np.array([1.0, 0.37, 1.61]) * rng.uniform(0.95, 1.05, 3)
    share = size * np.array([1.0, 0.5, 0.25])
    angle = np.outer(t, omega) + rng.uniform(0.0, 2.0 * np.pi, 3)
    return (
        np.sin(angle) @ share,
        np.cos(angle) @ (share * omega),
        -np.sin(angle) @ (share * omega**2),
    )


def in_strokes(
    rng: np.random.Generator, t: Array, speeds: Sequence[float], length: float, ramp: float
) -> Moved:
    """Strokes to and fro [SI]: each speed is reached on a straight line of ``ramp`` seconds."""
    times, velocities = [0.0, 0.1 * rng.uniform(0.5, 1.5)], [0.0, 0.0]
    k = 0
    while times[-1] < t[-1]:
        speed = speeds[(k // 2) % len(speeds)] * (1.0 if k % 2 == 0 else -1.0)
        steady = max(length / abs(speed) - ramp, ramp)
        times += [times[-1] + ramp, times[-1] + ramp + steady]
        velocities += [speed, speed]
        k += 1
    knots, v = np.array(times), np.array(velocities)
    at = np.interp(t, knots, v)
    slope = np.diff(v) / np.diff(knots)
    part = np.clip(np.searchsorted(knots, t, "right") - 1, 0, slope.size - 1)
    before = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(knots))))
    since = t - knots[part]
    return before[part] + v[part] * since + 0.5 * slope[part] * since**2, at, slope[part]


def steadily(rng: np.random.Generator, t: Array, speed: float) -> Moved:
    """One constant speed [SI]."""
    return speed * t, np.full(t.size, speed), np.zeros(t.size)


def friction(law: Mapping[str, float], v: Array) -> Array:
    """Coulomb levels, viscous friction, and what is added at low speed (Bo and Pavelescu)."""
    low = law.get("stribeck", 0.0) * np.exp(
        -((np.abs(v) / law.get("stribeck_speed", 1.0)) ** law.get("shape", 2.0))
    )
    level = np.where(v > 0.0, law["coulomb_positive"] + low, -law["coulomb_negative"] - low)
    return np.where(v == 0.0, 0.0, level) + law["viscous"] * v


def coloured(rng: np.random.Generator, n: int, colour: float) -> Array:
    """First-order autoregression of variance one."""
    white = rng.standard_normal(n)
    out = white.copy()
    for k in range(1, n):
        out[k] = colour * out[k - 1] + np.sqrt(1.0 - colour**2) * white[k]
    return out


def rounded(values: Array, step: float) -> Array:
    """What a converter gives."""
    return step * np.round(values / step) if step else values


def bent(r: Recording, rng: np.random.Generator, share: float, every: float = 0.05) -> Recording:
    """Friction that varies along the travel by a share of its level, again ``every`` so far [m]."""
    place = np.convolve(np.pad(r["position"], 4, "edge"), np.ones(9) / 9.0, "valid")
    more = share * TRUTH["coulomb_positive"] * np.sin(2.0 * np.pi * place / every)
    return {**r, "force": r["force"] + np.sign(np.gradient(place)) * more}


def record(
    rng: np.random.Generator,
    *,
    motions: Sequence[Motion] = (by_hand,),
    law: Mapping[str, float] = TRUTH,
    mass: float = MASS,
    step: float = 0.01,
    n: int = 1000,
    role: str = "velocity",
    sigma: float = 0.1,
    noise: float | None = None,
    colour: float = 0.0,
    converter: float = 0.0,
    truncated: bool = False,
    counts: float = 0.0,
    jitter: float = 0.0,
    drift: float = 0.0,
    offsets: Sequence[float] = (0.0,),
    spoil: Spoil | None = None,
) -> list[Recording]:
    """Logs of force and velocity or position.

    ``sigma`` and ``noise`` are those of force and motion, ``converter`` and ``counts`` their
    steps, ``drift`` what the force gains over a log; ``jitter`` is a share of the sample time.
    """
    out = []
    for k, motion in enumerate(motions):
        t = step * np.arange(n) + jitter * step * rng.uniform(-0.5, 0.5, n)
        x, v, a = motion(rng, t)
        force = friction(law, v) + mass * a + sigma * coloured(rng, n, colour)
        force += drift * np.arange(n) / n + offsets[k % len(offsets)]
        force = rounded(force - 0.5 * converter * truncated, converter)
        size = noise if noise is not None else (1e-3 if role == "velocity" else 1e-5)
        moved = (v if role == "velocity" else x) + size * rng.standard_normal(n)
        recording: Recording = {"time": t, "force": force, role: rounded(moved, counts)}
        out.append(spoil(recording, rng) if spoil else recording)
    return out


def lose(recording: Recording, rng: np.random.Generator, share: float) -> Recording:
    """Leave out rows at random."""
    kept = rng.uniform(size=recording["time"].size) > share
    return {role: values[kept] for role, values in recording.items()}


def late(recording: Recording, rng: np.random.Generator, by: int) -> Recording:
    """Log the force some samples late."""
    n = recording["time"].size
    return {r: v[: n - by] if r == "force" else v[by:] for r, v in recording.items()}


def glitch(recording: Recording, rng: np.random.Generator, role: str, factor: float) -> Recording:
    """Set one sample to ``factor`` times the largest."""
    spoiled = recording[role].copy()
    spoiled[spoiled.size // 3] = factor * float(np.abs(spoiled).max())
    return {**recording, role: spoiled}


def clip(recording: Recording, rng: np.random.Generator, level: float) -> Recording:
    """Clip the force."""
    return {**recording, "force": np.clip(recording["force"], -level, level)}


def bound(law: Mapping[str, float], motions: Sequence[Motion], sigma: float, noise: float,
          step: float = 0.01, n: int = 1000) -> dict[str, float]:  # fmt: skip
    """Cramer-Rao deviations without an offset; noise of the velocity counts as that of force."""
    rng, t = np.random.default_rng(1), step * np.arange(n)
    speeds = [m(rng, t)[1] for m in motions]
    total = float(np.hypot(sigma, law["viscous"] * noise))
    return cramer_rao(
        lambda p: [friction(p, v) for v in speeds], law, total, lambda k: np.zeros((k, 1))
    )


SLOW = partial(by_hand, base=0.4, size=0.014)
FAST = partial(by_hand, base=2.2, size=0.018)
STROKES = partial(in_strokes, speeds=(0.02, 0.05, 0.1), length=0.06, ramp=0.05)
CONSTANT = tuple(partial(steadily, speed=v) for v in (0.03, 0.1, -0.03, -0.1))


def _attack(group: str, name: str, truth: Mapping[str, float] = TRUTH, repetitions: int = 2,
            options: Mapping[str, object] | None = None, bounds: Mapping[str, float] | None = None,
            varied: bool = False, **recorded: object) -> Attack:  # fmt: skip
    how = {"law": truth, **recorded}
    given = {"mass": how.get("mass", MASS)} if options is None else options
    wanted = {n: v for n, v in truth.items() if n != "shape"}

    def another(rng: np.random.Generator) -> Attack:
        level, rate = rng.uniform(0.8, 1.2, 2)
        law = {n: v * (rate if n == "viscous" else level) for n, v in truth.items()}
        return _attack(group, name, law, repetitions, options, **recorded)

    return Attack("cylinder-friction", group, name, wanted, partial(record, **how), UNITS,
                  options=given, bounds=bounds or {}, repetitions=repetitions,
                  another=another if varied else None)  # fmt: skip


def _right() -> Iterator[Attack]:
    """Machines that the model describes, of many sizes."""
    good = partial(_attack, "right model", repetitions=3)
    for words, motion in (
        ("slow", SLOW),
        ("medium", by_hand),
        ("fast", FAST),
        ("strokes", STROKES),
    ):
        limits = bound(TRUTH, [motion], 0.1, 1e-3)
        yield good(f"{words}, velocity", motions=(motion,), bounds=limits)
        yield good(f"{words}, position", motions=(motion,), bounds=limits, role="position")
    limits = bound(TRUTH, CONSTANT, 0.1, 1e-3)
    yield good("one speed a log", motions=CONSTANT, bounds=limits)
    yield good("one speed a log, position", motions=CONSTANT, bounds=limits, role="position")
    yield good("coloured", motions=(by_hand, STROKES), colour=0.9)
    press = {"viscous": 9e4, "coulomb_positive": 4e3, "coulomb_negative": 4e3}
    slow = partial(in_strokes, speeds=(0.01, 0.03, 0.08), length=0.1, ramp=0.2)
    yield good("press of 100 kN", press, motions=(slow,), n=6000, sigma=100.0, mass=800.0,
               bounds=bound(press, [slow], 100.0, 1e-3, n=6000))  # fmt: skip
    micro = {"viscous": 2.0, "coulomb_positive": 0.02, "coulomb_negative": 0.02}
    small = partial(by_hand, base=2.0, size=1e-3)
    yield good("micro-actuator of 0.1 N", micro, motions=(small,), step=1e-3, n=4000, sigma=1e-3,
               mass=2e-3, noise=1e-4,
               bounds=bound(micro, [small], 1e-3, 1e-4, 1e-3, 4000))  # fmt: skip
    yield good("1 kHz", motions=(by_hand,), step=1e-3, n=10_000)
    yield good("without mass", motions=(SLOW,), options={}, mass=0.0)


def _sensors() -> Iterator[Attack]:
    """Converters, sampling, clocks."""
    coarse = partial(_attack, "force in steps", varied=True)
    for size in (0.05, 0.2, 0.5):
        for words, sigma in (("noise 0.1 N", 0.1), ("quiet", 0.01)):
            for motion, moved in (("hand", by_hand), ("strokes", STROKES)):
                yield coarse(f"{size} N, {words}, {motion}", converter=size, sigma=sigma,
                             motions=(moved,))  # fmt: skip
        yield coarse(f"{size} N, quiet, slow", converter=size, sigma=0.01, motions=(SLOW,))
        yield coarse(f"{size} N, quiet, position", converter=size, sigma=0.01, role="position")
    # truncation is an offset of the force, which may make any other machine look even
    even = {**TRUTH, "coulomb_negative": TRUTH["coulomb_positive"]}
    for size in (0.2, 0.5):
        yield coarse(f"{size} N, truncated", even, converter=size, truncated=True)
        yield coarse(f"{size} N, one speed a log", converter=size, sigma=0.01, motions=CONSTANT)
    for role in ("velocity", "position"):
        for words, motion in (("slow", SLOW), ("medium", by_hand), ("strokes", STROKES)):
            yield _attack("20 Hz", f"{words}, {role}", role=role, step=0.05, n=400,
                          motions=(motion,), repetitions=3)  # fmt: skip
        for words, motion in (("fast", FAST), ("slow", SLOW), ("strokes", STROKES)):
            yield _attack("20 Hz", f"{words}, {role}, quiet force", role=role, step=0.05, n=1200,
                          motions=(motion,), sigma=0.02)  # fmt: skip
    for step, n in ((0.1, 300), (0.03, 500)):
        yield _attack("20 Hz", f"every {step} s, position", role="position", step=step, n=n)
    for counts in (1e-5, 1e-4, 3e-4):
        yield _attack("motion in steps", f"{1e3 * counts:g} mm", role="position", counts=counts,
                      noise=0.0)  # fmt: skip
    for counts in (2e-3, 1e-2):
        yield _attack("motion in steps", f"{1e3 * counts:g} mm/s", counts=counts, noise=0.0)
    for role in ("velocity", "position"):
        yield _attack("uneven", f"jitter, {role}", role=role, jitter=0.4)
        yield _attack("uneven", f"5 % lost, {role}", role=role, spoil=partial(lose, share=0.05))
    yield _attack("noisy motion", "10 mm/s", noise=10e-3)
    yield _attack("noisy motion", "30 mm/s", noise=30e-3)
    yield _attack("noisy motion", "0.2 mm", role="position", noise=2e-4)
    for noise in (1e-5, 5e-5):
        for words, motion in (("medium", by_hand), ("strokes", STROKES)):
            yield _attack("heavy mass", f"14.5 kg, 2.4 N, {1e6 * noise:g} um, {words}", mass=14.5,
                          role="position", noise=noise, motions=(motion,))  # fmt: skip
    for step, noise in ((1e-3, 1e-5), (1e-3, 5e-5), (2e-3, 2e-4)):
        yield _attack("heavy mass", f"14.5 kg, 2.4 N, {1e6 * noise:g} um, every {step} s",
                      mass=14.5, role="position", noise=noise, step=step, n=10_000)  # fmt: skip
    heavy = {"viscous": 450.0, "coulomb_positive": 60.0, "coulomb_negative": 60.0}
    for noise in (1e-5, 5e-5):
        yield _attack("heavy mass", f"14.5 kg, {1e6 * noise:g} um", heavy, mass=14.5, sigma=1.0,
                      role="position", noise=noise,
                      bounds=bound(heavy, [by_hand], 1.0, 0.0))  # fmt: skip


def _machines() -> Iterator[Attack]:
    """What the model has not, and numbers that are given wrong."""
    for rise, speed in ((1.2, 0.02), (2.4, 0.01), (0.6, 0.05)):
        law = {**TRUTH, "stribeck": rise, "stribeck_speed": speed}
        for words, motion in (("hand", by_hand), ("strokes", STROKES)):
            name = f"{rise:g} N, {speed:g} m/s, {words}"
            yield _attack("Stribeck", name, law, motions=(motion,))
            yield _attack("Stribeck asked for", name, law, motions=(motion,),
                          options={"mass": MASS, "stribeck": "estimate"})  # fmt: skip
    law = {**TRUTH, "stribeck": 1.2, "stribeck_speed": 0.02}
    speeds = [s * v for v in (0.005, 0.01, 0.02, 0.04, 0.08, 0.15) for s in (1.0, -1.0)]
    several = tuple(partial(steadily, speed=v) for v in speeds)
    yield _attack("Stribeck", "one speed a log", law, motions=several)
    yield _attack("Stribeck asked for", "one speed a log", law, motions=several,
                  options={"stribeck": "estimate"})  # fmt: skip
    yield _attack("Stribeck asked for", "there is none", options={"stribeck": "estimate"}, mass=0.0)
    uneven = {**TRUTH, "coulomb_negative": 1.8}
    for options in ({}, {"offset": "free"}, {"offset": "none"}):
        words = options.get("offset", "auto")
        given = {"mass": MASS, **options}
        yield _attack("asymmetry", f"friction, {words}", uneven, options=given)
        if words != "none":
            yield _attack("asymmetry", f"load cell, {words}", offsets=(0.3,), options=given)
    yield _attack("asymmetry", "load cell, three logs", motions=(by_hand,) * 3,
                  offsets=(0.1, 0.3, -0.2))  # fmt: skip
    yield _attack("asymmetry", "load cell, one speed a log", motions=CONSTANT, offsets=(0.3,))
    yield _attack("drift of the force", "0.5 N", drift=0.5)
    yield _attack("drift of the force", "2 N", drift=2.0)
    yield _attack("given wrong", "mass doubled", options={"mass": 2.0 * MASS}, motions=(FAST,))
    yield _attack("given wrong", "no mass, fast", options={}, mass=1.0, motions=(FAST,))
    for by in (1, 3):
        yield _attack("given wrong", f"force {by} samples late", spoil=partial(late, by=by))
    yield _attack("one bad sample", "force", spoil=partial(glitch, role="force", factor=30.0))
    yield _attack("one bad sample", "velocity", spoil=partial(glitch, role="velocity", factor=5.0))
    slow_and_fast = [
        partial(in_strokes, speeds=(v,), length=length, ramp=0.05)
        for v, length in ((0.005, 0.02), (0.1, 0.1))
    ]
    for share in (0.05, 0.1, 0.2):
        yield _attack("friction along the travel", f"{100 * share:g} %", role="position",
                      motions=slow_and_fast, n=2000, spoil=partial(bent, share=share))  # fmt: skip
    yield _attack("clipped", "at 5 N", spoil=partial(clip, level=5.0))
    options = {"mass": MASS, "stribeck": "estimate"}
    for words, shape in (("another shape", 1.0), ("a sudden fall", 4.0)):
        other = {**TRUTH, "shape": shape, "stribeck": 1.2, "stribeck_speed": 0.02}
        yield _attack("Stribeck asked for", words, other, options=options)


def attacks() -> Iterator[Attack]:
    """All of them."""
    yield from _right()
    yield from _sensors()
    yield from _machines()
