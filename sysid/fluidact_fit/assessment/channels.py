"""Every measured channel that the model gives, against what was measured of it.

A position may be followed to its noise by a model whose pressures are wrong by bars: given numbers,
clocks and leaks show there first. A channel is judged by its residual in units of its own noise,
and by whether that is autocorrelated; noise alone is one, and white.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np

from ..errors import Notice
from ..estimation.noise import noise_floor
from ..estimation.uncertainty import whiteness
from ..experiment import FloatArray
from ..family import Family, FamilyOptions, Solution
from ..options import describe
from ..outcome import Simulation

_MISSED = 1.15  # times the noise
_CHANCE = 1e-4  # probability of an autocorrelation that strong in white noise
_FEWEST = 50


def judge_channels(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], fitted: Sequence[Simulation]
) -> tuple[dict[str, Any], list[Notice]]:
    """Judge the channels beside the output: entries for the file, and warnings."""
    table: dict[str, Any] = {}
    missed = []
    for role in dict.fromkeys(role for s in fitted for role in s.also):
        pairs = [s.others[role] for s in fitted if role in s.also]
        found = _judged(pairs, len(solution.names))
        if found is None:
            continue
        table[role] = found
        if found["times_noise"] > _MISSED and found["p_value"] < _CHANCE:
            signal = next(s.experiment.signals[role] for s in fitted if role in s.also)
            missed.append(
                f"'{role}' by {signal.text(found['rmse'])} "
                f"({found['times_noise']:.2g} times its noise)"
            )
    return table, [_notice(family, solution, missed)] if missed else []


def _judged(pairs: Sequence[tuple[FloatArray, FloatArray]], unknowns: int) -> dict[str, Any] | None:
    """Residual of a channel over all runs, in its unit and in its noise."""
    error, floor, residuals = 0.0, 0.0, []
    for measured, simulated in pairs:
        used = np.isfinite(measured) & np.isfinite(simulated)
        if used.sum() < _FEWEST:
            continue
        residuals.append((measured - simulated)[used])
        error += float(residuals[-1] @ residuals[-1])
        floor += float(used.sum()) * _noise(measured[used], residuals[-1]) ** 2
    if not residuals or floor <= 0.0:
        return None
    samples = sum(r.size for r in residuals)
    return {
        "rmse": sqrt(error / samples),
        "times_noise": sqrt(error / floor),
        "p_value": whiteness(residuals, unknowns).p_value,
    }


def _noise(measured: FloatArray, residual: FloatArray) -> float:
    """Noise of a channel: what does not hang together, the steps of a converter included.

    What is left of fast motion in differences of the channel is not in those of the residual.
    """
    return max(
        noise_floor(residual, robust=True),
        min(noise_floor(x, robust=False) for x in (measured, residual)),
    )


def _notice(
    family: Family[FamilyOptions], solution: Solution[FamilyOptions], missed: Sequence[str]
) -> Notice:
    given = [
        f"--{o.name}"
        for o in describe(family.options_type)
        if o.kind == "float" and getattr(solution.options, o.name.replace("-", "_"))
    ]
    numbers = f"the given numbers ({', '.join(given)}), " if given else ""
    return Notice(
        "channel-missed",
        f"the model misses {' and '.join(missed)}, in a way that is not random: something that was "
        "given or recorded is not as the machine was, and the parameters make up for it. Check "
        f"{numbers}scale and zero of the sensors, that one clock stamps all channels, and that "
        "nothing leaks.",
    )
