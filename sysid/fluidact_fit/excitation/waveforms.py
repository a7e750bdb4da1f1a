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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..experiment import FloatArray

Numbers = Mapping[str, float]
Shape = Callable[[int, float, Numbers, np.random.Generator], FloatArray]


def steps(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Random levels held for one to three times ``hold`` [s]; ``levels`` of them.

    Here and in the shapes below, ``duty`` is how much longer the negative side lasts.
    """
    length = max(numbers["hold"] / step, 1.0)
    levels = np.linspace(-1.0, 1.0, max(int(numbers["levels"]), 2))
    out = np.zeros(count)
    k, last = 0.0, int(rng.integers(levels.size))
    while k < count:
        others = np.delete(np.arange(levels.size), last)
        last = int(rng.choice(others))
        longer = numbers["duty"] if levels[last] < 0.0 else 1.0
        until = k + length * longer * float(rng.choice([1.0, 1.0, 2.0, 3.0]))
        out[round(k) : round(until)] = levels[last]
        k = until
    return out


def square(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Both limits in turn; the half period changes from ``hold`` to ``last`` [s]."""
    hold = np.geomspace(max(numbers["hold"], step), max(numbers["last"], step), count)
    phase = np.mod(np.cumsum(step / hold) - step / hold[0], 1.0 + numbers["duty"])
    return np.where(phase < 1.0, 1.0, -1.0)


def two_sizes(count: int, step: float, numbers: Numbers, rng: np.random.Generator) -> FloatArray:
    """Both limits in turn, then a ``part`` of each; ``hold`` [s] and ``small`` [s] long.

    One size of a square cannot separate a dead zone or a friction level from a slope; two can.
    """
    hold, small = max(numbers["hold"], step), max(numbers["small"], step)
    there_and_back = 1.0 + numbers["duty"]
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


class Piece(NamedTuple):
    """A straight piece; its length is a share of the run, of the sum of all."""

    begin: float
    end: float
    length: float

    def change(self, stretch: float, shift: float) -> Piece:
        """Another length, or another level within the limits; of a ramp, where it begins."""
        begin = min(max(self.begin + shift, -1.0), 1.0)
        end = begin if self.begin == self.end else self.end
        return Piece(begin, end, stretch * self.length)


def join(pieces: Sequence[Piece], count: int) -> FloatArray:
    """Straight pieces one after the other, jumps between them allowed; shape ``(count,)``."""
    lengths = np.array([piece.length for piece in pieces])
    edges = np.round(count * np.concatenate(([0.0], np.cumsum(lengths) / lengths.sum())))
    sizes = np.diff(edges.astype(int)).tolist()
    lines = [np.linspace(p.begin, p.end, size) for p, size in zip(pieces, sizes)]
    return np.clip(np.concatenate(lines), -1.0, 1.0)


# every shape, and the numbers of it that a search may change by factors
_SHAPES: dict[str, tuple[Shape, tuple[str, ...]]] = {
    "steps": (steps, ("hold",)),
    "square": (square, ("hold", "last")),
    "two sizes": (two_sizes, ("hold", "small", "part")),
    "rest and go": (rest_and_go, ("hold", "pause")),
    "chirp": (chirp, ("first", "last")),
    "multisine": (multisine, ("last",)),
    "triangle": (triangle, ("period",)),
    "approach": (approach, ("half", "pause", "push")),
}


@dataclass(frozen=True)
class Waveform:
    """A shape with its numbers, or straight pieces; ``then`` follows after a share ``turn``.

    ``size`` is the share of the amplitude that is used.
    """

    shape: str
    numbers: Numbers = field(default_factory=dict)
    seed: int = 0
    size: float = 1.0
    then: Waveform | None = None
    turn: float = 0.5
    pieces: tuple[Piece, ...] = ()

    @property
    def absolute(self) -> bool:
        """True if its levels are those of the machine, so that a share of them is useless."""
        return self.shape == "approach"

    @property
    def has_duty(self) -> bool:
        """Return whether the two directions can last differently long."""
        own = self.shape in ("steps", "square", "two sizes")
        return own or (self.then is not None and self.then.has_duty)

    def sample(self, count: int, step: float, duty: float = 1.0) -> FloatArray:
        """Values at the samples, shape ``(count,)``, between -1 and 1.

        ``duty`` is how much longer the negative side lasts, of shapes that have one.
        """
        if self.pieces:
            return self.size * join(self.pieces, count)
        if self.then is None:
            rng = np.random.default_rng([self.seed, 77])
            make, _ = _SHAPES[self.shape]
            return self.size * make(count, step, {**self.numbers, "duty": duty}, rng)
        first = min(max(int(self.turn * count), 8), count - 8)
        alone = replace(self, then=None).sample(first, step, duty)
        return np.concatenate((alone, self.then.sample(count - first, step, duty)))

    def describe(self) -> str:
        """In words, for a person."""
        if self.pieces:
            return f"{len(self.pieces)} {self.shape}"
        shown = (f"{k} {v:.3g}" for k, v in self.numbers.items()
                 if not k.startswith(("low_", "high_")))  # fmt: skip
        size = "" if self.size == 1.0 else f", {100.0 * self.size:.0f} % of the amplitude"
        head = f"{self.shape} ({', '.join(shown)}){size}"
        return head if self.then is None else f"{head}, then {self.then.describe()}"

    def shrink(self, share: float) -> Waveform:
        """The same at a share of its size."""
        if self.absolute and self.then is not None:
            return replace(self, then=self.then.shrink(share))
        return replace(self, size=share * self.size)

    def neighbours(self, factor: float) -> list[Waveform]:
        """The same shape with one number changed by ``factor``, either way."""
        out, either = [], (factor, 1.0 / factor)
        for name in _SHAPES[self.shape][1]:
            value = self.numbers[name]
            out += [replace(self, numbers={**self.numbers, name: value * f}) for f in either]
        if self.shape in ("steps", "multisine"):
            out.append(replace(self, seed=self.seed + 1))
        if not self.absolute:
            out += [replace(self, size=min(self.size * f, 1.0)) for f in either]
        if self.then is not None:
            out += [replace(self, then=w) for w in self.then.neighbours(factor)]
            low, high = (0.3, 0.7) if self.absolute else (0.05, 0.95)
            out += [replace(self, turn=min(max(self.turn * f, low), high)) for f in either]
        return [w for w in out if w != self]


def to_segments(values: FloatArray, most: int) -> Waveform | None:
    """The straight pieces of a shape, shape ``(n,)``; ``None`` if there are more than ``most``."""
    cuts = [0]
    # a jump bends twice, a corner once or twice
    for bend in np.flatnonzero(np.abs(np.diff(values, 2)) > 1e-6).tolist():
        if bend + 2 - cuts[-1] > 2:
            cuts.append(bend + 2)
    cuts.append(values.size)
    if len(cuts) - 1 > most:
        return None
    pieces = [
        Piece(float(values[first]), float(values[last - 1]), float(last - first))
        for first, last in pairwise(cuts)
    ]
    return Waveform("straight pieces", pieces=tuple(pieces))


def smooth_corners(values: FloatArray, width: int) -> FloatArray:
    """Round the corners with a Hann window of ``width`` samples, as slow as a sensor sees them."""
    if width < 2:
        return values
    from scipy.signal import convolve  # slow to load, and held commands have no corners to smooth

    window = np.hanning(width + 2)[1:-1]
    padded = np.pad(values, width, mode="edge")
    smooth = convolve(padded, window / window.sum(), mode="same")
    return np.asarray(smooth[width:-width], dtype=np.float64)


def limit_slope(values: FloatArray, most: float) -> FloatArray:
    """Follow the values by at most ``most`` per sample."""
    out = values.copy()
    for k in range(1, out.size):
        out[k] = out[k - 1] + min(max(values[k] - out[k - 1], -most), most)
    return out
