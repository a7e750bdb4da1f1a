"""What MATLAB's ``nlhw`` and ``d2c('tustin')`` do, written anew; MATLAB cannot be run here.

Dead zone in front of a discrete output-error model whose coefficients are all free, fitted
by Levenberg-Marquardt from several starts; mass and damping by Tustin's rule, as in the
thesis that this project takes its rigs from.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from problems import Log, dead_zone
from scipy.optimize import least_squares
from scipy.signal import lfilter

TITLE = "nlhw route, emulated"


def version() -> str:
    """No product was run."""
    return "emulated"


def _fit(nb: int, nk: int) -> Any:
    def run(log: Log, guess: dict[str, float]) -> dict[str, float]:
        step, size = log.sample_time, float(np.std(log.y))

        def residual(x: np.ndarray) -> np.ndarray:
            force = dead_zone(log.u, x[0], x[1])
            b = np.concatenate((np.zeros(nk), x[2 : 2 + nb]))
            with np.errstate(all="ignore"):
                y = lfilter(b, [1.0, *x[2 + nb :]], force)
            return np.nan_to_num(np.clip(y, -1e3, 1e3), nan=1e3) - log.y / size

        best: Any = None
        for pole in (0.5, 0.7, 0.9, float(np.exp(-step * guess["c"] / guess["m"]))):
            b = step * (1.0 - pole) / guess["c"] / size / nb
            start = [guess["dz_neg"], guess["dz_pos"], *[b] * nb, *np.poly([0.9999, pole])[1:]]
            found = least_squares(residual, start, x_scale="jac", max_nfev=300)
            if best is None or found.cost < best.cost:
                best = found
        pole = float(np.sort(np.real(np.roots([1.0, *best.x[2 + nb :]])))[0])
        c = step * (1.0 - pole) / (size * best.x[2 : 2 + nb].sum())
        lag = step / 2.0 * (1.0 + pole) / (1.0 - pole)
        return {"dz_neg": best.x[0], "dz_pos": best.x[1], "m": lag * c, "c": c}

    return run


FITS = {"P1|nb 1, nk 1": _fit(1, 1), "P1|nb 2, nk 1": _fit(2, 1), "P1|nb 2, nk 0": _fit(2, 0)}
