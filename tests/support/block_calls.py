"""What the blocks of the families give for the arguments of their routines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def one_by_one(f: Callable[..., float], *arrays: Array) -> Array:
    return np.array([f(*map(float, row)) for row in zip(*arrays)])


CALLS: Mapping[str, Mapping[str, Callable[[Any, Mapping[str, Array]], Any]]] = {
    "ball-screw": {
        "feedforward": lambda b, v: one_by_one(b.feedforward, v["velocity"], v["acceleration"]),
        "friction": lambda b, v: one_by_one(b.friction, v["velocity"], v["torque"]),
    },
    "cylinder-friction": {
        "friction": lambda b, v: b(v["velocity"]),
        "friction_rounded": lambda b, v: one_by_one(
            lambda x, s: float(b(x, 1.0 / s)), v["velocity"], v["steepness"] + 1e-9
        ),
    },
    "flow-map": {
        "flow": lambda b, v: b(v["command"], v["pressure_drop"]),
        "command_for": lambda b, v: b.inverse(v["flow"], clamp=True),
        "flow_at_reference": lambda b, v: (
            v["flow"] / np.sqrt(v["pressure_drop"] / b.reference_pressure)
        ),
    },
    "force-map": {"map": lambda b, v: b(**v)},
    "hydraulic-cylinder": {
        "flow_1": lambda b, v: b.flow(1, v["command"], v["pressure_1"]),
        "flow_2": lambda b, v: b.flow(2, v["command"], v["pressure_2"]),
        "speed": lambda b, v: one_by_one(b, v["command"], v["pressure_1"], v["pressure_2"]),
        "friction": lambda b, v: b.friction(v["velocity"]),
    },
    "hydraulic-motor": {
        "speed": lambda b, v: one_by_one(b, v["command"], v["direction"]),
        "command_for": lambda b, v: one_by_one(b.inverse, v["speed"], v["direction"]),
    },
    "potentiometer": {
        "position": lambda b, v: b(v["reading"]),
        "reading_at": lambda b, v: b.inverse(v["position"], clamp=True),
    },
    "spring-cylinder": {
        "force": lambda b, v: b(v["command"], v["position"], v["direction"], v["velocity"]),
        "command_for": lambda b, v: b.inverse(
            v["force"], v["position"], v["direction"], v["velocity"]
        ),
    },
}
