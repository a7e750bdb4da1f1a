"""A drive with friction that falls over the speed, followed by a general solver with events.

It shares no line with the simulators of the package.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fluidact_fit.estimation.inputs import piecewise
from fluidact_fit.experiment import Experiment, Signal

# the thesis' drive, its curve well inside the speeds of the chirp below
SCREW = {
    "inertia": 11.71e-7, "viscous": 2e-5, "coulomb_positive": 2e-3, "coulomb_negative": 1.6e-3,
    "breakaway_positive": 2.9e-3, "breakaway_negative": 2.2e-3, "stribeck_speed": 4.0,
}  # fmt: skip
COUNT = 2.0 * np.pi / 2000.0
STEP = 0.01


def reference(values: Mapping[str, float], torque: Signal, time: np.ndarray) -> np.ndarray:
    """Place at the instants of a torque, from rest: DOP853 from event to event."""
    u = piecewise(torque)
    j, curve = values["inertia"], values.get("stribeck_speed", 0.0)
    shape = values.get("stribeck_exponent", 2.0)
    law = {
        way: [values.get(f"{n}_{side}", values.get(n, 0.0)) for n in ("viscous", "coulomb",
                                                                      "breakaway")]
        for way, side in ((1, "positive"), (-1, "negative"))
    }  # fmt: skip
    place, speed, way, out = 0.0, 0.0, 0, [0.0]
    for k, span in enumerate(np.diff(time)):
        c, at = u.coefficients[k], 0.0

        def drive(o: float, c: np.ndarray = c) -> float:
            return float(np.polyval(c[::-1], o))

        while at < span:
            if way == 0:
                speed = 0.0
                way = next((w for w in (1, -1) if w * drive(at) > law[w][2]), 0)
                later = next((w for w in (1, -1) if w * drive(span) > law[w][2]), 0)
                if way == 0 and later == 0:
                    break
                if way == 0:
                    way, level = later, later * law[later][2]
                    at = brentq(lambda o, f=drive, x=level: f(o) - x, at, span, xtol=1e-15)
            viscous, kinetic, static = law[way]

            def slope(
                o: float, y: np.ndarray, f=drive, w=way, b=viscous, low=kinetic, high=static
            ) -> list[float]:
                left = np.exp(-((abs(y[1]) / curve) ** shape)) if curve > 0.0 else 0.0
                return [y[1], (f(o) - b * y[1] - w * (low + (high - low) * left)) / j]

            def stop(o: float, y: np.ndarray, begin=at, w=way) -> float:
                return w * y[1] + (1e-13 if o < begin + 1e-9 else 0.0)

            stop.terminal, stop.direction = True, -1.0
            found = solve_ivp(slope, (at, span), [place, speed], method="DOP853", rtol=1e-11,
                              atol=1e-13, events=stop)  # fmt: skip
            place, speed = found.y[:, -1]
            at = found.t[-1]
            if found.status == 1:
                way = next((w for w in (1, -1) if w * drive(at) > law[w][2]), 0)
                speed = 0.0
        out.append(place)
    return np.array(out)


def torque_of(values: np.ndarray, hold: str, time: np.ndarray) -> Signal:
    return Signal("torque", time, values, "N m", hold, float(values[0]))


def drive_log(
    seed: int, hold: str, values: Mapping[str, float] = SCREW, n: int = 600, noise: float = 0.0
) -> Experiment:
    """A chirp with reversals, read by a 2000-count encoder or with white noise [rad]."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * STEP
    u = 5e-3 * np.sin(2.0 * np.pi * (0.2 * time + 0.09 * time**2) + rng.uniform(-0.3, 0.3))
    # in mN m, so that the solver's tolerances are small parts of everything
    larger = {name: v * (1.0 if name.startswith("stribeck") else 1e3) for name, v in values.items()}
    y = reference(larger, torque_of(1e3 * u, hold, time), time)
    if noise:
        read = y + noise * rng.standard_normal(n)
    else:
        read = np.floor((y + rng.uniform(0.0, COUNT)) / COUNT) * COUNT
    signals = {
        "torque": torque_of(u, hold, time),
        "angle": Signal("angle", time, read, "rad", resolution=0.0 if noise else COUNT),
    }
    return Experiment("drive", 0, time, signals, STEP, True)
