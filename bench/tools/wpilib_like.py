"""What WPILib SysId documents, written anew; the tool itself is a desktop program.

Median-filtered central differences, least squares of acceleration on velocity, input and
the sign of velocity. It has no static friction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from problems import Log
from scipy.signal import medfilt

TITLE = "WPILib SysId's method, emulated"


def version() -> str:
    """No product was run."""
    return "emulated"


def _fit(asymmetric: bool) -> Any:
    def run(log: Log, guess: dict[str, float]) -> dict[str, float | None]:
        v = medfilt(np.gradient(log.y, log.sample_time), 3)
        a = (v[2:] - v[:-2]) / (2.0 * log.sample_time)
        v, u = v[1:-1], log.u[1:-1]
        moving = np.abs(v) > 5.0
        signs = [-1.0 * (v > 0), 1.0 * (v < 0)] if asymmetric else [-np.sign(v)]
        x = np.linalg.lstsq(np.column_stack([v, u, *signs])[moving], a[moving], rcond=None)[0]
        j = 1.0 / x[1]
        return {"J": j, "b": -x[0] * j, "fkp": x[2] * j, "fkn": x[-1] * j, "fsp": None, "fsn": None}

    return run


FITS = {"P4": _fit(False), "P4|one level per direction": _fit(True)}
