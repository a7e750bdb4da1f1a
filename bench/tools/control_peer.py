"""python-control: Markov parameters and the eigensystem realisation."""

from __future__ import annotations

import numpy as np
from conversions import second_order, slowest
from problems import Log

import control

TITLE = "python-control"


def version() -> str:
    """Version of python-control."""
    return control.__version__


def _realise(log: Log, order: int) -> control.StateSpace:
    markov = control.markov(log.y, log.u, 100, dt=log.sample_time, truncate=True)
    taps = np.asarray(markov).reshape(1, 1, -1)
    return control.eigensys_realization(taps, order, m=40, n=40, dt=log.sample_time)[0]


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Poles of a second-order realisation."""
    a = np.poly(_realise(log, 2).A)
    return second_order(a[1], a[2], log.sample_time)


def p3(log: Log, guess: dict[str, float]) -> dict[str, float | None]:
    """Slowest pole and steady gain of a fourth-order one; it has no dead time."""
    system = _realise(log, 4)
    tau = slowest(np.linalg.eigvals(system.A), log.sample_time)
    return {"K": float(np.real(control.dcgain(system))), "tau": tau, "L": None}


FITS = {"P2": p2, "P3": p3}
