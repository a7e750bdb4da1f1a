"""Shapes of excitations: what a command can look like over a run, between -1 and 1.

A waveform is a plain function of the sample count, the sample time and a few numbers. The
numbers that a search may change are times [s] and frequencies [Hz]; everything random
comes from a seed. 1 stands for the upper limit of the amplitude, -1 for the lower one and
0 for rest.

References
----------
.. [1] M. Schroeder, "Synthesis of low-peak-factor signals and binary sequences with low
   autocorrelation", IEEE Trans. Information Theory 16(1), 1970.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..experiment import FloatArray

Numbers = Mapping[str, float]
Shape = Callable[[int, float, Numbers, np.random.Generator], FloatArray]


def steps(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Random levels held for one to three times ``hold`` [s]; ``levels`` of them.

    In all shapes that have it, ``duty`` is how much longer the negative side lasts.
    """
    length = max(numbers["hold"] / step, 1.0)
    levels = np.linspace(-1.0, 1.0, max(int(numbers["levels"]), 2))
    out = np.zeros(count)
    k, last = 0.0, int(rng.integers(levels.size))
    while k < count:
        others = np.delete(np.arange(levels.size), last)
        last = int(rng.choice(others))
        longer = numbers.get("duty", 1.0) if levels[last] < 0.0 else 1.0
        until = k + length * longer * float(rng.choice([1.0, 1.0, 2.0, 3.0]))
        out[round(k) : round(until)] = levels[last]
        k = until
    return out


def square(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Both limits in turn; the half period changes from ``hold`` to ``last`` [s]."""
    hold = np.geomspace(max(numbers["hold"], step), max(numbers["last"], step), count)
    longer = numbers.get("duty", 1.0)
    phase = np.mod(np.cumsum(step / hold) - step / hold[0], 1.0 + longer)
    return np.where(phase < 1.0, 1.0, -1.0)


def two_sizes(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Both limits in turn, then a ``part`` of each; ``hold`` [s] and ``small`` [s] long.

    One size of a square cannot separate a dead zone or a friction level from a slope; two can.
    """
    hold, small = max(numbers["hold"], step), max(numbers["small"], step)
    there_and_back = 1.0 + numbers.get("duty", 1.0)
    place = np.mod(step * np.arange(count), there_and_back * (hold + small))
    part = min(numbers["part"], 1.0)
    marks = (hold, there_and_back * hold, there_and_back * hold + small)
    levels = np.array([1.0, -1.0, part, -part])
    return np.asarray(levels[np.searchsorted(marks, place, side="right")])


def rest_and_go(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Both limits in turn with a ``pause`` [s] at rest after each ``hold`` [s]."""
    hold, pause = max(numbers["hold"], step), max(numbers["pause"], 0.0)
    place = np.mod(step * np.arange(count), 2.0 * (hold + pause))
    up = place < hold
    down = (place >= hold + pause) & (place < 2.0 * hold + pause)
    return up.astype(float) - down


def chirp(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Sine from ``first`` to ``last`` [Hz], logarithmic when ``log`` is one, else linear."""
    first, last = (min(numbers[k], 0.4 / step) for k in ("first", "last"))
    share = np.linspace(0.0, 1.0, count)
    rate = first * (last / first) ** share if numbers["log"] else first + (last - first) * share
    return np.asarray(np.sin(2.0 * np.pi * np.cumsum(rate) * step))


def multisine(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Sines of equal size up to ``last`` [Hz], with the phases of the lowest peak found [1]_."""
    span = count * step
    top = max(min(numbers["last"], 0.4 / step) * span, 2.0)
    lines = np.unique(np.round(np.geomspace(max(numbers["first"] * span, 1.0), top, 24)))
    time = step * np.arange(count)
    angle = 2.0 * np.pi * lines[:, None] / span * time
    number = np.arange(lines.size)
    phases = [-np.pi * number * (number - 1) / lines.size]
    phases += [rng.uniform(0.0, 2.0 * np.pi, lines.size) for _ in range(12)]
    tried = [np.sin(angle + p[:, None]).sum(0) for p in phases]
    best = min(tried, key=lambda u: float(np.abs(u).max()))
    return np.asarray(best / np.abs(best).max())


def triangle(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Slow ramps between both limits through the reversals; ``period`` [s]."""
    phase = np.mod(step * np.arange(count) / numbers["period"] + 0.25, 1.0)
    return np.asarray(4.0 * np.abs(phase - 0.5) * -1.0 + 1.0)


def approach(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """From rest slowly through a static level, a push, and rest again; both directions in turn.

    ``half`` [s] is the time of one direction; ``pause`` and ``push`` are the shares of it
    at rest and under the full push. The slow part goes from ``low`` to ``high`` of the
    direction (``low_positive`` ... as shares of the limit).
    """
    half = min(max(numbers["half"], 20.0 * step), 0.5 * count * step)
    halves = max(2 * round(count * step / (2.0 * half)), 2)
    edges = np.round(np.linspace(0, count, halves + 1)).astype(int)
    out = np.zeros(count)
    for k, (begin, end) in enumerate(pairwise(edges)):
        side, sign = ("positive", 1.0) if k % 2 == 0 else ("negative", -1.0)
        length = end - begin
        rest = int(min(max(numbers["pause"], 0.02), 0.8) * length)
        push = int(min(max(numbers["push"], 0.0), 0.6) * length)
        slow = length - rest - push
        # half a step further in every second turn, so that the levels interleave
        shift = 0.5 * ((k // 2) % 2) / max(slow, 1)
        ramp = np.linspace(0.0, 1.0, max(slow, 1)) + shift
        low, high = numbers[f"low_{side}"], numbers[f"high_{side}"]
        out[begin + rest : begin + rest + slow] = sign * (low + (high - low) * ramp)[:slow]
        out[begin + rest + slow : end] = sign
    return np.clip(out, -1.0, 1.0)


def segments(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Straight pieces one after the other, jumps between them allowed.

    Piece ``k`` takes a share ``length_k`` of the run (of the sum of all) and goes from
    ``begin_k`` to ``end_k``.
    """
    pieces = sum(name.startswith("length_") for name in numbers)
    lengths = np.array([numbers[f"length_{k}"] for k in range(pieces)])
    edges = np.round(count * np.concatenate(([0.0], np.cumsum(lengths) / lengths.sum())))
    out = np.zeros(count)
    for k, (first, last) in enumerate(pairwise(edges.astype(int).tolist())):
        out[first:last] = np.linspace(numbers[f"begin_{k}"], numbers[f"end_{k}"], last - first)
    return np.clip(out, -1.0, 1.0)


_SHAPES: dict[str, Shape] = {
    "steps": steps,
    "square": square,
    "two sizes": two_sizes,
    "rest and go": rest_and_go,
    "chirp": chirp,
    "multisine": multisine,
    "triangle": triangle,
    "approach": approach,
    "segments": segments,
}


@dataclass(frozen=True)
class Waveform:
    """A shape with its numbers; ``then`` follows after a share ``turn`` of the run.

    ``free`` names the numbers that a search may change, by factors; ``size`` is the share
    of the amplitude that is used.
    """

    shape: str
    numbers: Numbers
    free: tuple[str, ...] = ()
    seed: int = 0
    size: float = 1.0
    then: Waveform | None = None
    turn: float = 0.5

    def sample(self, count: int, step: float) -> FloatArray:
        """Values at the samples, shape ``(count,)``, between -1 and 1."""
        rng = np.random.default_rng([self.seed, 77])
        if self.then is None:
            return self.size * _SHAPES[self.shape](count, step, self.numbers, rng)
        first = min(max(int(self.turn * count), 8), count - 8)
        alone = replace(self, then=None)
        return np.concatenate((alone.sample(first, step), self.then.sample(count - first, step)))

    def lengthen(self, duty: float) -> Waveform:
        """The same with another ``duty``; shapes that have none stay as they are."""
        numbers = {**self.numbers, "duty": duty} if "duty" in self.numbers else self.numbers
        then = None if self.then is None else self.then.lengthen(duty)
        return replace(self, numbers=numbers, then=then)

    def describe(self) -> str:
        """In words, for a person."""
        if self.shape == "segments":
            pieces = sum(name.startswith("length_") for name in self.numbers)
            return f"{pieces} straight pieces"
        shown = {k: v for k, v in self.numbers.items()
                 if not k.startswith(("low_", "high_")) and (k, v) != ("duty", 1.0)}  # fmt: skip
        text = ", ".join(f"{k} {v:.3g}" for k, v in shown.items())
        size = "" if self.size == 1.0 else f", {100.0 * self.size:.0f} % of the amplitude"
        head = f"{self.shape} ({text}){size}"
        return head if self.then is None else f"{head}, then {self.then.describe()}"

    def neighbours(self, factor: float) -> list[Waveform]:
        """The same shape with one number changed by ``factor``, either way."""
        out = []
        for name in self.free:
            for f in (factor, 1.0 / factor):
                out.append(replace(self, numbers={**self.numbers, name: self.numbers[name] * f}))
        if self.shape in ("steps", "multisine"):
            out.append(replace(self, seed=self.seed + 1))
        absolute = self.shape == "approach"  # its levels are those of the machine
        if not absolute:
            out += [replace(self, size=min(self.size * f, 1.0)) for f in (factor, 1.0 / factor)]
        if self.then is not None:
            out += [replace(self, then=w) for w in self.then.neighbours(factor)]
            low, high = (0.3, 0.7) if absolute else (0.05, 0.95)
            out += [replace(self, turn=min(max(self.turn * f, low), high))
                    for f in (factor, 1.0 / factor)]  # fmt: skip
        return [w for w in out if w != self]


def to_segments(values: FloatArray, most: int) -> Waveform | None:
    """The straight pieces of a shape, shape ``(n,)``; ``None`` if there are more than ``most``."""
    bends = np.abs(np.diff(values, 2)) > 1e-6
    # a jump bends twice, a corner once or twice
    marks = np.flatnonzero(bends) + 1
    cuts = [0]
    for mark in marks.tolist():
        if mark + 1 - cuts[-1] > 2:
            cuts.append(mark + 1)
    cuts.append(values.size)
    if len(cuts) - 1 > most:
        return None
    numbers: dict[str, float] = {}
    for k, (first, last) in enumerate(pairwise(cuts)):
        numbers[f"begin_{k}"] = float(values[first])
        numbers[f"end_{k}"] = float(values[last - 1])
        numbers[f"length_{k}"] = float(last - first)
    return Waveform("segments", numbers)


def smooth_corners(values: FloatArray, width: int) -> FloatArray:
    """Round the corners with a Hann window of ``width`` samples, as slow as a sensor sees them."""
    if width < 2:
        return values
    window = np.hanning(width + 2)[1:-1]
    padded = np.pad(values, width, mode="edge")
    out = np.convolve(padded, window / window.sum(), mode="same")[width:-width]
    return np.asarray(out)


def limit_slope(values: FloatArray, most: float) -> FloatArray:
    """Follow the values by at most ``most`` per sample."""
    out = values.copy()
    for k in range(1, out.size):
        out[k] = out[k - 1] + min(max(values[k] - out[k - 1], -most), most)
    return out
