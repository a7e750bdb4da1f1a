"""jax-sysid: the user writes ``x+ = f(x, u, theta)`` in JAX; L-BFGS-B on the simulation error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from conversions import second_order
from jax.scipy.linalg import expm
from jax_sysid.models import LinearModel, Model
from problems import Log, line

jax.config.update("jax_platform_name", "cpu")
jax.config.update("jax_enable_x64", True)

TITLE = "jax-sysid"
Guess = dict[str, float]


def version() -> str:
    """Version of jax-sysid."""
    return metadata.version("jax-sysid")


def _fit(
    log: Log,
    guess: Guess,
    step: Callable[..., Any],
    positive: Sequence[str],
    inputs: np.ndarray,
    size: float = 1.0,
    adam: int = 0,
    epochs: int = 2000,
) -> Guess:
    """Two states at rest, output the first; parameters relative to the guess."""

    def decode(q: Any) -> dict[str, Any]:
        return {
            k: g * (jnp.exp(q[i]) if k in positive else q[i])
            for i, (k, g) in enumerate(guess.items())
        }

    model = Model(
        2, 1, inputs.shape[1],
        state_fcn=lambda x, u, p: step(x, u, decode(p[0])),
        output_fcn=lambda x, u, p: x[0:1] / size,
    )  # fmt: skip
    model.init(params=[np.array([0.0 if k in positive else 1.0 for k in guess])], x0=np.zeros(2))
    model.loss(rho_x0=0.0, rho_th=0.0, train_x0=False)
    model.optimization(adam_epochs=adam, lbfgs_epochs=epochs, iprint=-1, lbfgs_tol=1e-16)
    model.fit((log.y / size).reshape(-1, 1), inputs)
    return {k: float(v) for k, v in decode(np.asarray(model.params[0])).items()}


def _pairs(log: Log) -> np.ndarray:
    return np.column_stack([log.u, np.append(log.u[1:], log.u[-1])])


def p1(log: Log, guess: Guess) -> Guess:
    """Exact for a dead-zoned force that runs straight between samples."""
    ts = log.sample_time

    def step(x: Any, u: Any, p: Any) -> Any:
        lag = p["m"] / p["c"]
        w0, w1 = (
            (jnp.maximum(v - p["dz_pos"], 0.0) + jnp.minimum(v - p["dz_neg"], 0.0)) / p["c"]
            for v in u
        )
        a = jnp.exp(-ts / lag)
        r = lag / ts * (1 - a)
        speed = a * x[1] + (r - a) * w0 + (1 - r) * w1
        return jnp.array([x[0] + 0.5 * ts * (w0 + w1) - lag * (speed - x[1]), speed])

    return _fit(log, guess, step, ("m", "c"), _pairs(log), float(np.std(log.y)))


def p2(log: Log, guess: Guess) -> Guess:
    """Exact for a held command."""

    def step(x: Any, u: Any, p: Any) -> Any:
        wn, z = p["wn"], p["z"]
        a = jnp.array([[0, 1.0, 0], [-(wn**2), -2 * z * wn, wn**2], [0, 0, 0]])
        e = expm(a * log.sample_time)
        return e[:2, :2] @ x + e[:2, 2] * u[0]

    return _fit(log, guess, step, ("wn", "z"), log.u.reshape(-1, 1))


def p2_linear(log: Log, guess: Guess) -> Guess:
    """The library's own linear model."""
    model = LinearModel(2, 1, 1, y_in_x=False, seed=0)
    model.loss(rho_x0=1e-6, rho_th=1e-8)
    model.optimization(adam_epochs=500, lbfgs_epochs=3000, iprint=-1)
    model.fit(log.y.reshape(-1, 1), log.u.reshape(-1, 1))
    a = np.poly(model.ssdata()[0])
    return second_order(a[1], a[2], log.sample_time)


def p3(log: Log, guess: Guess) -> Guess:
    """A fraction of a sample per whole delay; the user scans the whole delays."""
    ts = log.sample_time
    best: tuple[float, Guess] | None = None

    def step(x: Any, u: Any, p: Any) -> Any:
        a, new = jnp.exp(-ts / p["tau"]), jnp.exp(-(1 - p["f"]) * ts / p["tau"])
        return jnp.array([a * x[0] + p["K"] * ((1 - new) * u[0] + (new - a) * x[1]), u[0]])

    for whole in range(4):
        late = np.concatenate((np.zeros(whole), log.u[: log.u.size - whole])).reshape(-1, 1)
        first = {"K": guess["K"], "tau": guess["tau"], "f": 0.5}
        found = _fit(log, first, step, ("tau",), late, epochs=500)
        theta = {"K": found["K"], "tau": found["tau"], "L": (whole + found["f"]) * ts}
        if 0.0 <= found["f"] <= 1.0:
            cost = float(np.sum((line(theta, log.u, ts) - log.y) ** 2))
            if best is None or cost < best[0]:
                best = (cost, theta)
    if best is None:
        raise RuntimeError("no whole delay gave a fraction between 0 and 1")
    return best[1]


def p4(log: Log, guess: Guess) -> Guess:
    """Friction smoothed with tanh, ten semi-implicit steps per sample."""
    sub, width, bump = 10, 0.5, 1.5
    h = log.sample_time / sub

    def step(x: Any, u: Any, p: Any) -> Any:
        angle, w = x[0], x[1]
        for i in range(sub):
            tau = u[0] + (u[1] - u[0]) * (i + 0.5) / sub
            stiction, sign = jnp.exp(-((w / bump) ** 2)), jnp.tanh(w / width)
            forward = p["fkp"] + (p["fsp"] - p["fkp"]) * stiction
            backward = p["fkn"] + (p["fsn"] - p["fkn"]) * stiction
            level = jnp.where(w > 0, forward, backward)
            slope = p["b"] + level / width * (1 - sign**2)
            w = w + h * (tau - p["b"] * w - level * sign) / (p["J"] + h * slope)
            angle = angle + h * w
        return jnp.array([angle, w])

    return _fit(log, guess, step, tuple(guess), _pairs(log), 10.0, adam=300, epochs=1500)


FITS = {"P1": p1, "P2": p2, "P2|LinearModel": p2_linear, "P3": p3, "P4|tanh": p4}
