"""tfest (PyPI): transfer function from an empirical frequency response."""

from __future__ import annotations

from importlib import metadata

import numpy as np
from problems import Log
from tfest import tfest

TITLE = "tfest"


def version() -> str:
    """Version of tfest."""
    return metadata.version("tfest")


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Two poles; its frequencies are in hertz and its start is random."""
    np.random.seed(0)  # noqa: NPY002  the package draws from the global generator
    model = tfest(log.u, log.y)
    options = {"xatol": 1e-6, "maxiter": 4000, "disp": False}
    model.estimate(0, 2, method="h1", time=float(log.t[-1] + log.sample_time), options=options)
    a = model.res.x[1:] / model.res.x[1]
    root = float(np.sqrt(abs(a[2])))
    return {"wn": 2.0 * np.pi * root, "z": a[1] / (2.0 * root)}


FITS = {"P2": p2}
