"""GEKKO: dynamic estimation by collocation, with the solver it brings along."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np
from gekko import GEKKO
from problems import Log

TITLE = "GEKKO"
Guess = dict[str, float]


def version() -> str:
    """Version of GEKKO."""
    return metadata.version("gekko")


def _model(log: Log, guess: Guess, limits: dict[str, tuple[float, float]]) -> tuple[Any, Any]:
    m = GEKKO(remote=False)
    m.time = log.t
    p = {k: m.FV(value=guess[k], lb=low, ub=high) for k, (low, high) in limits.items()}
    for v in p.values():
        v.STATUS = 1
    m.options.IMODE, m.options.EV_TYPE, m.options.NODES = 5, 2, 3
    m.options.SOLVER, m.options.MAX_ITER = 3, 300
    return m, p


def _measured(m: Any, y: np.ndarray) -> Any:
    cv = m.CV(value=y)
    cv.FSTATUS = 1
    return cv


def _solve(m: Any, p: Any) -> Guess:
    try:
        m.solve(disp=False, debug=0)
        return {k: v.NEWVAL for k, v in p.items()}
    finally:
        m.cleanup()


def p1(log: Log, guess: Guess) -> Guess:
    """Position in millimetres; GEKKO holds the input within an interval."""
    limits = {"dz_neg": (-8, 0), "dz_pos": (0, 8), "m": (1, 500), "c": (100, 1e4)}
    m, p = _model(log, guess, limits)
    u, y, v = m.Param(log.u), _measured(m, 1e3 * log.y), m.Var(0)
    force = m.max2(u - p["dz_pos"], 0) + m.min2(u - p["dz_neg"], 0)
    m.Equation(y.dt() == v)
    m.Equation(p["m"] * v.dt() == 1e3 * force - p["c"] * v)
    return _solve(m, p)


def p2(log: Log, guess: Guess) -> Guess:
    """Second order."""
    m, p = _model(log, guess, {"wn": (1, 200), "z": (0.05, 5)})
    u, y, x, v = m.Param(log.u), _measured(m, log.y), m.Var(0), m.Var(0)
    m.Equation(x.dt() == v)
    m.Equation(v.dt() == p["wn"] ** 2 * (u - x) - 2 * p["z"] * p["wn"] * v)
    m.Equation(y == x)
    return _solve(m, p)


def p3(log: Log, guess: Guess) -> Guess:
    """Whole samples of delay only, scanned by the user."""
    best: tuple[float, Guess] | None = None
    for whole in range(4):
        m, p = _model(log, guess, {"K": (0.1, 5), "tau": (0.01, 2)})
        late = np.concatenate((np.zeros(whole), log.u[: log.u.size - whole]))
        u, y, x = m.Param(late), _measured(m, log.y), m.Var(0)
        m.Equation(p["tau"] * x.dt() == -x + p["K"] * u)
        m.Equation(y == x)
        theta = {**_solve(m, p), "L": whole * log.sample_time}
        if best is None or best[0] > m.options.OBJFCNVAL:
            best = (m.options.OBJFCNVAL, theta)
    assert best is not None
    return best[1]


FITS = {"P1": p1, "P2": p2, "P3": p3}
