"""pysid: discrete output-error models with integer delays."""

from __future__ import annotations

from importlib import metadata

import numpy as np
from conversions import delayed_first_order, second_order
from problems import Log
from pysid.identification.pemethod import oe
from scipy.signal import lfilter

TITLE = "pysid"


def version() -> str:
    """Version of pysid."""
    return metadata.version("pysid")


def _fit(log: Log, nb: int, nf: int, nk: int) -> tuple[np.ndarray, np.ndarray]:
    model = oe(nb, nf, nk, log.u.reshape(-1, 1), log.y.reshape(-1, 1))
    return np.asarray(model.B[0, 0], float), np.asarray(model.F[0, 0], float)


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Two poles, two free numerator coefficients."""
    _, a = _fit(log, 1, 2, 1)
    return second_order(a[1], a[2], log.sample_time)


def p3(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Best of five whole delays, the fraction from the numerator."""
    fits = [(nk, *_fit(log, 1, 1, nk)) for nk in (1, 2, 3, 4, 5)]
    nk, b, a = min(fits, key=lambda f: float(np.sum((lfilter(f[1], f[2], log.u) - log.y) ** 2)))
    return delayed_first_order(b[nk], b[nk + 1], a[1], nk, log.sample_time)


FITS = {"P2": p2, "P3": p3}
