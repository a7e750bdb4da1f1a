"""nfoursid: subspace identification of state-space models."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np
import pandas as pd
from conversions import second_order, slowest
from nfoursid.nfoursid import NFourSID
from problems import Log

TITLE = "nfoursid"


def version() -> str:
    """Version of nfoursid."""
    return metadata.version("nfoursid")


def _realise(log: Log, order: int) -> Any:
    frame = pd.DataFrame({"u": log.u, "y": log.y})
    model = NFourSID(frame, output_columns=["y"], input_columns=["u"], num_block_rows=12)
    model.subspace_identification()
    return model.system_identification(rank=order)[0]


def p2(log: Log, guess: dict[str, float]) -> dict[str, float]:
    """Poles of a second-order model."""
    a = np.poly(_realise(log, 2).a)
    return second_order(a[1], a[2], log.sample_time)


def p3(log: Log, guess: dict[str, float]) -> dict[str, float | None]:
    """Slowest pole and steady gain of a fourth-order model; it has no dead time."""
    s = _realise(log, 4)
    gain = (s.c @ np.linalg.solve(np.eye(4) - s.a, s.b) + s.d).item()
    return {"K": gain, "tau": slowest(np.linalg.eigvals(s.a), log.sample_time), "L": None}


FITS = {"P2": p2, "P3": p3}
