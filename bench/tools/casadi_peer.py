"""CasADi: the user writes the equations; least squares by multiple shooting and IPOPT.

As in CasADi's own system-identification example: Runge-Kutta steps, states at every sample
as unknowns, exact Hessian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from problems import Log
from scipy.signal import savgol_filter

TITLE = "CasADi script"
Guess = dict[str, float]
_QUIET = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.max_cpu_time": 50.0}


def version() -> str:
    """Version of CasADi."""
    return ca.__version__


def _shoot(
    log: Log,
    guess: Guess,
    ode: Callable[..., Any],
    moving: bool,
    sizes: Sequence[float],
    positive: Sequence[str],
    sub: int = 2,
    most: int = 200,
) -> Guess:
    """Fit ``x' = ode(x, u, p)``, output the first state, which starts at rest."""
    n = log.t.size
    after = np.append(log.u[1:], log.u[-1]) if moving else log.u
    q, x, u = ca.MX.sym("q", len(guess)), ca.MX.sym("x", 2), ca.MX.sym("u", 2)
    p = {
        k: g * ca.exp(q[i]) if k in positive else g * q[i] for i, (k, g) in enumerate(guess.items())
    }
    new, h = x, log.sample_time / sub
    for i in range(sub):
        begin, middle, end = (u[0] + (u[1] - u[0]) * (i + s) / sub for s in (0.0, 0.5, 1.0))
        k1 = ode(new, begin, p)
        k2 = ode(new + h / 2 * k1, middle, p)
        k3 = ode(new + h / 2 * k2, middle, p)
        k4 = ode(new + h * k3, end, p)
        new = new + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = ca.Function("step", [x, u, q], [new])
    states = ca.MX.sym("states", 2, n)
    size = ca.repmat(ca.DM(list(sizes)), 1, n)
    inputs = np.vstack([log.u, after])
    ends = step.map(n - 1)(size[:, 1:] * states[:, :-1], inputs[:, :-1], ca.repmat(q, 1, n - 1))
    gaps = ends / size[:, 1:] - states[:, 1:]
    error = (sizes[0] * states[0, :].T - log.y) / float(np.std(log.y))
    problem = {
        "x": ca.vertcat(q, ca.vec(states)),
        "f": 0.5 * ca.sumsqr(error),
        "g": ca.vertcat(ca.vec(gaps), states[:, 0]),
    }
    speed = savgol_filter(log.y, 21, 2, deriv=1, delta=log.sample_time)
    first = np.array([0.0 if k in positive else 1.0 for k in guess])
    start = np.vstack([log.y, speed]) / np.array(sizes)[:, None]
    solver = ca.nlpsol("fit", "ipopt", problem, {**_QUIET, "ipopt.max_iter": most})
    found = solver(x0=np.concatenate((first, start.T.ravel())), lbg=0, ubg=0)
    values = ca.Function("p", [q], list(p.values()))(found["x"][: len(guess)])
    return {k: float(v) for k, v in zip(guess, values)}


def p1(log: Log, guess: Guess) -> Guess:
    """Force straight between samples."""

    def ode(x: Any, u: Any, p: Any) -> Any:
        force = ca.fmax(u - p["dz_pos"], 0) + ca.fmin(u - p["dz_neg"], 0)
        return ca.vertcat(x[1], (force - p["c"] * x[1]) / p["m"])

    return _shoot(log, guess, ode, True, (float(np.std(log.y)), 5e-3), ("m", "c"))


def p2(log: Log, guess: Guess) -> Guess:
    """Command held between samples."""

    def ode(x: Any, u: Any, p: Any) -> Any:
        return ca.vertcat(x[1], p["wn"] ** 2 * (u - x[0]) - 2 * p["z"] * p["wn"] * x[1])

    return _shoot(log, guess, ode, False, (1.0, 10.0), ("wn", "z"), sub=4)


def p3(log: Log, guess: Guess) -> Guess:
    """The exact recursion, one smooth problem per whole delay (the user's scan)."""
    step, n = log.sample_time, log.t.size
    best: tuple[float, Guess] | None = None
    for whole in range(4):
        q, x, u = ca.MX.sym("q", 3), ca.MX.sym("x"), ca.MX.sym("u", 2)
        gain, tau, part = guess["K"] * q[0], guess["tau"] * ca.exp(q[1]), q[2]
        a, new = ca.exp(-step / tau), ca.exp(-(1 - part) * step / tau)
        once = ca.Function("f", [x, u, q], [a * x + gain * ((1 - new) * u[0] + (new - a) * u[1])])
        late = np.concatenate((np.zeros(whole + 1), log.u))
        inputs = np.vstack([late[1:n], late[: n - 1]])
        y = ca.horzcat(0, once.mapaccum(n - 1)(0, inputs, ca.repmat(q, 1, n - 1)))
        problem = {"x": q, "f": 0.5 * ca.sumsqr(y.T - log.y)}
        solver = ca.nlpsol("fit", "ipopt", problem, _QUIET)
        found = solver(x0=[1, 0, 0.5], lbx=[0, -4, 0], ubx=[10, 3, 1])
        v = np.array(found["x"]).ravel()
        if best is None or float(found["f"]) < best[0]:
            theta = {"K": guess["K"] * v[0], "tau": guess["tau"] * np.exp(v[1])}
            best = (float(found["f"]), {**theta, "L": (whole + v[2]) * step})
    assert best is not None
    return best[1]


def p4(log: Log, guess: Guess) -> Guess:
    """Friction smoothed with tanh, as gradient-based tools need it."""

    def ode(x: Any, u: Any, p: Any) -> Any:
        stiction, sign = ca.exp(-((x[1] / 4.0) ** 2)), ca.tanh(x[1] / 2.0)
        forward = p["fkp"] + (p["fsp"] - p["fkp"]) * stiction
        backward = p["fkn"] + (p["fsn"] - p["fkn"]) * stiction
        friction = sign * 0.5 * ((1 + sign) * forward + (1 - sign) * backward)
        return ca.vertcat(x[1], (u - p["b"] * x[1] - friction) / p["J"])

    return _shoot(log, guess, ode, True, (10.0, 100.0), tuple(guess), sub=10, most=80)


FITS = {"P1": p1, "P2": p2, "P3": p3, "P4|tanh": p4}
