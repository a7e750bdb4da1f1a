"""Columns of the regression: what multiplies the parameters, its instruments, and its noise.

Friction is not linear in the Stribeck speed: the unknown is then a change of it from the speed
at which the equation is made linear. A noisy velocity ``w = v + e`` blurs the Stribeck term.
What is taken for it instead is the function of ``w`` whose mean over the noise is the term
itself [1]_, with the variance ``s^2`` of ``e``

    E[v_s / sqrt(q) exp(-w^2 / q)] = exp(-v^2 / v_s^2),   q = v_s^2 - 2 s^2.

References
----------
.. [1] L. A. Stefanski, "Unbiased estimation of a nonlinear function of a normal mean with
   application to measurement error models", Communications in Statistics A18, 1989.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...estimation.stribeck import STRIBECK, slowest_and_fastest
from ...experiment import FloatArray
from ...family import NoiseLevel
from ...mechanics.friction_law import stribeck_share
from ...specification import Variant
from .data import Run
from .equation import GAINS

EQUAL = "coulomb"  # stands for both levels where they are taken to be equal
DROWNED = 2.0  # times the noise of a velocity: below it a speed is not known


@dataclass(frozen=True)
class Rise:
    """Stribeck level and speed [N, m/s] at which the equation is made linear; zeros: none.

    ``exponent`` is 2 except where other shapes are compared.
    """

    level: float = 0.0
    speed: float = 0.0
    exponent: float = 2.0

    def shares(self, d: Run) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Share of the level at the kept samples, and its slopes by its speed and by the velocity.

        Shape ``(kept,)`` each [1, s/m, s/m].
        """
        w, v = d.velocity[d.kept], self.speed
        if v <= 0.0:
            return (np.zeros(w.size),) * 3
        if self.exponent != 2.0:
            share = stribeck_share(w, v, self.exponent)
            return share, np.zeros(w.size), np.zeros(w.size)
        noise = d.instruments["velocity"].noise if "velocity" in d.instruments else 0.0
        # where the speed is drowned in noise it is refused, and no arithmetic helps
        q = max(v**2 - 2.0 * noise**2, 0.5 * v**2)
        share = v / np.sqrt(q) * np.exp(-(w**2) / q)
        return share, share * (1.0 / v - v / q + 2.0 * v * w**2 / q**2), share * -2.0 * w / q


def make_columns(names: Sequence[str], d: Run, rise: Rise) -> FloatArray:
    """Derivative of the force by parameters at the kept samples, shape ``(kept, p)``."""
    s = d.direction[d.kept]
    share, slope, _ = rise.shares(d)
    known = {
        "stiffness": -d.position[d.kept],
        "preload": np.full(s.size, -1.0),
        "coulomb_loading": np.where(s > 0.0, -1.0, 0.0),
        "coulomb_unloading": np.where(s < 0.0, 1.0, 0.0),
        EQUAL: -np.sign(s),
        "viscous": -d.velocity[d.kept],
        "stribeck": -np.sign(s) * share,
        "stribeck_speed": -np.sign(s) * rise.level * slope,
        **dict.fromkeys(GAINS.values(), d.drive[d.kept]),
    }
    return np.stack([known[n] for n in names], axis=1)


def instrumented(d: Run) -> Run:
    """The run with the instruments of its noisy columns in their place."""
    columns: dict[str, Any] = {name: i.values for name, i in d.instruments.items()}
    return replace(d, instruments={}, **columns)


def disturbances(names: Sequence[str], runs: Sequence[Run], rise: Rise) -> Iterator[FloatArray]:
    """What noise of every recorded column adds to what the parameters multiply, ``(n, p)`` each.

    Per unit of white noise of variance 1, to first order.
    """
    for carrier in ("drive", "position", "velocity"):
        parts = []
        for d in runs:
            part = np.zeros((int(d.kept.sum()), len(names)))
            noise = d.instruments[carrier].noise if carrier in d.instruments else 0.0
            for name, slope in _slopes(d, carrier, rise).items():
                if name in names and noise:
                    part[:, names.index(name)] = noise * slope
            parts.append(part)
        yield np.vstack(parts)


def _slopes(d: Run, carrier: str, rise: Rise) -> Mapping[str, FloatArray | float]:
    """Derivative of the columns of :func:`make_columns` by what was recorded."""
    if carrier == "drive":
        return dict.fromkeys(GAINS.values(), 1.0)
    if carrier == "position":
        return {"stiffness": -1.0}
    return {"viscous": -1.0, STRIBECK[0]: -np.sign(d.direction[d.kept]) * rise.shares(d)[2]}


def speed_noise(runs: Sequence[Run]) -> float:
    """Speed below which there is only noise [m/s]."""
    noises = (d.instruments["velocity"].noise for d in runs if "velocity" in d.instruments)
    return DROWNED * max(noises, default=0.0)


def input_noise(variant: Variant, runs: Sequence[Run]) -> dict[str, NoiseLevel]:
    """Noise of the inputs that were recorded, the largest of all runs, by role."""
    out = {}
    for name, role in (("drive", variant.name), ("position", "position"), ("velocity", "velocity")):
        own = [d.instruments[name].noise for d in runs
               if name in d.instruments and role in d.experiment]  # fmt: skip
        out[role] = max(own, default=0.0)
    return {role: NoiseLevel(sigma) for role, sigma in out.items() if sigma}


def fitted_velocities(runs: Sequence[Run]) -> FloatArray:
    """Velocities at the kept samples of all runs [m/s]."""
    return np.concatenate([d.velocity[d.kept] for d in runs])


def speed_range(runs: Sequence[Run]) -> tuple[float, float]:
    """Slowest and fastest motion that the runs show [m/s]."""
    return slowest_and_fastest(fitted_velocities(runs), speed_noise(runs))
