"""Forces that the model does not know: found, weighed against the noise, said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import Notice
from ...experiment import FloatArray
from .model import Compared
from .start import Stage

DECISIVE = 3.0  # residual per noise above which forces are at work that the model lacks
DECISIVE_HELD = 2.0  # the same under a drive that is held: it is exact, and explains no residual
_BALANCED = 3  # times that position, speed and acceleration are weighed against each other


def residual_to_noise(stage: Stage) -> tuple[float, Stage]:
    """Residual of the position per noise of the encoder, and the stage where it is least.

    All parameters but those held are fitted. While the ratio is near one, comparing the position
    alone is efficient. Far above, the residual comes from forces that the model does not know.
    """
    found, ended = stage.solve(Compared(), max_iterations=10)
    residual = np.sqrt(found.cost / sum(e.samples for e in stage.experiments))
    noise = stage.noise
    return float(residual / noise) if noise > 0.0 else np.inf, ended


def with_derivatives(stage: Stage) -> tuple[Compared, list[FloatArray]]:
    """Weights for comparing position, speed and acceleration together.

    Each is weighted by its own residual: unknown forces drift in the position, noise is large in
    the acceleration. Speed and acceleration are differences over an eighth of the time constant of
    coasting: shorter ones show vibrations that a rigid mass does not have, longer ones smear the
    reversals.
    """
    start, runs = stage.start, stage.experiments
    viscous = start.get("viscous", start.get("viscous_positive", 0.0))
    coasting = start[stage.axis.inertia] / max(viscous, 1e-300)
    longest = max(min(e.samples for e in runs) // 50, 2)
    step = min(e.sample_time for e in runs)
    compared = Compared((0, 1, 2), int(np.clip(coasting / (8.0 * step), 2, longest)))
    parts = [compared.channels(e.samples) for e in runs]
    weights: list[FloatArray] = []
    now, ended = stage.solve(compared, max_iterations=0, tolerance=0.0)
    for _ in range(_BALANCED):
        plain = [r / w for r, w in zip(now.residuals, weights)] if weights else now.residuals
        weights = _balance(plain, parts)
        now, ended = ended.solve(compared, 15, tolerance=0.02, weights=weights)
    return compared, weights


def _balance(residuals: Sequence[FloatArray], parts: Sequence[list[slice]]) -> list[FloatArray]:
    """Weights that give every compared quantity a unit residual."""
    weights = [np.ones(r.size) for r in residuals]
    for rows in zip(*parts):  # of one quantity, by run
        together = np.concatenate([r[part] for r, part in zip(residuals, rows)])
        size = max(float(np.sqrt(np.mean(together**2))), 1e-300)
        for w, part in zip(weights, rows):
            w[part] = 1.0 / size
    return weights


def unmodelled_forces_notice(known: bool) -> Notice:
    """Warn of forces that the model does not know.

    Where the speed of a curve is not ``known``, friction that falls is one of them.
    """
    more = "" if known else ", friction that falls with the speed"
    remedy = "" if known else " For friction that falls, try --stribeck=estimate."
    return Notice(
        "forces-beyond-model",
        "forces that are not in this model (torque ripple, play, a load that depends on the "
        f"place{more}) move the position by more than its noise. Speed and acceleration were "
        "compared as well, so that they disturb less; what they add to the friction levels "
        f"and to the inertia is not in the intervals. Cover the same stretch in both "
        f"directions at several speeds, or give the static levels with --fix.{remedy}",
    )
