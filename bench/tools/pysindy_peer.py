"""PySINDy: regression on smoothed derivatives, its library cut down to the true terms."""

from __future__ import annotations

import numpy as np
import pysindy as ps
from problems import Log
from scipy.signal import savgol_filter

TITLE = "PySINDy"


def version() -> str:
    """Version of PySINDy."""
    return ps.__version__


def _regress(states: np.ndarray, u: np.ndarray, step: float, library: object, window: int):
    model = ps.SINDy(
        optimizer=ps.STLSQ(threshold=0.0, alpha=0.0),
        feature_library=library,
        differentiation_method=ps.SmoothedFiniteDifference(
            smoother_kws={"window_length": window, "polyorder": 3}
        ),
    )
    model.fit(states, t=step, u=u.reshape(-1, 1))
    return model


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Outlet and its derivative as states."""
    speed = savgol_filter(log.y, 11, 3, deriv=1, delta=log.sample_time)
    library = ps.PolynomialLibrary(degree=1, include_bias=False)
    states = np.column_stack([log.y, speed])
    c = _regress(states, log.u, log.sample_time, library, 11).coefficients()
    wn = float(np.sqrt(abs(c[1, 0])))
    return {"wn": wn, "z": -c[1, 1] / (2.0 * wn)}


def p4(log: Log, guess: dict[str, float]) -> dict[str, float | None]:
    """Speed as the state, one sign per direction; no static friction."""
    speed = savgol_filter(log.y, 7, 3, deriv=1, delta=log.sample_time)
    library = ps.CustomLibrary(
        library_functions=[lambda x: x, lambda x: 1.0 * (x > 5.0), lambda x: 1.0 * (x < -5.0)],
        function_names=[lambda x: f"lin {x}", lambda x: f"pos {x}", lambda x: f"neg {x}"],
    )
    model = _regress(speed.reshape(-1, 1), log.u * 1e3, log.sample_time, library, 7)
    c = dict(zip(model.get_feature_names(), model.coefficients()[0]))
    j = 1e-3 / c["lin u0"]
    return {
        "J": j, "b": -c["lin x0"] * j, "fkp": -c["pos x0"] * j, "fkn": c["neg x0"] * j,
        "fsp": None, "fsn": None,
    }  # fmt: skip


FITS = {"P2": p2, "P4": p4}
