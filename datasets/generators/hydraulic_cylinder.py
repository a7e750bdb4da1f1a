"""Servo-hydraulic cylinder from table 1 of the hydraulic paper, on a grid 25 times finer.

"A hydraulic actuator model using feedforward neural networks" (COBEM 2019).
"""

from __future__ import annotations

import math

import numpy as np

from .writing import Array, Column, Dataset, Truth

TABLE = "hydraulic paper 2019, table 1"
CYLINDER_STEP = 1e-3  # s: 1 kHz
CYLINDER_SAMPLES = 2200
FINE = 25  # simulation steps per sample

GAIN = math.sqrt(2.0) * 15.11e-9
_PER_VOLT = "the catalogue's flow shows that it is per volt"
CYLINDER = {
    "valve_gain_1": Truth(GAIN, "m3/(s V Pa^0.5)", TABLE, _PER_VOLT),
    "valve_gain_2": Truth(GAIN, "m3/(s V Pa^0.5)", TABLE, _PER_VOLT),
    "line_loss_1": Truth(5.68e10, "Pa s/m3", TABLE),
    "line_loss_2": Truth(4.35e10, "Pa s/m3", TABLE),
    "line_loss_3": Truth(3.59e10, "Pa s/m3", TABLE),
    "line_loss_4": Truth(3.59e10, "Pa s/m3", TABLE),
    "bulk_modulus": Truth(1.0e9, "Pa", TABLE),
    "dead_zone_negative": Truth(-0.12, "V", note="the paper shows that there is one, not its size"),
    "dead_zone_positive": Truth(0.18, "V", note="the paper shows that there is one, not its size"),
    "viscous": Truth(3600.0, "N s/m", TABLE),
    "coulomb": Truth(35.0, "N", note="the paper speaks of dry friction and gives no level"),
}
AREA_1, AREA_2 = 4.91e-4, 2.37e-4  # m2, table 1
DEAD_1, DEAD_2 = 1.2446e-4, 9.9060e-5  # m3, table 1, taken as the volumes at position 0
MASS, SUPPLY = 14.54, 50e5  # kg, Pa, table 1


def edge(u: float) -> float:
    """Command beyond the dead zone [V]."""
    low, high = CYLINDER["dead_zone_negative"].value, CYLINDER["dead_zone_positive"].value
    return u - high if u > high else u - low if u < low else 0.0


def orifice(k: float, drop: float, loss: float) -> float:
    """Flow ``q = k sqrt(drop - loss q)``: positive root of ``x^2 + loss k x = drop``, times k."""
    size = abs(drop)
    x = 0.5 * (math.sqrt(loss * loss * k * k + 4.0 * size) - loss * k)
    return math.copysign(k * x, drop)


def flows(u: float, p1: float, p2: float) -> tuple[float, float]:
    """Flow into chamber 1 and out of chamber 2 [m3/s]."""
    e, c = edge(u), {n: t.value for n, t in CYLINDER.items()}
    k1, k2 = c["valve_gain_1"] * abs(e), c["valve_gain_2"] * abs(e)
    if e >= 0.0:
        return orifice(k1, SUPPLY - p1, c["line_loss_1"]), orifice(k2, p2, c["line_loss_4"])
    return -orifice(k1, p1, c["line_loss_3"]), -orifice(k2, SUPPLY - p2, c["line_loss_2"])


def rates(x: tuple[float, ...], u: float, direction: float) -> tuple[float, float, float, float]:
    """Time derivatives of (p1, p2, y, v); ``direction`` is that of the dry friction."""
    p1, p2, y, v = x
    q1, q2 = flows(u, p1, p2)
    beta = CYLINDER["bulk_modulus"].value
    dp1 = beta / (DEAD_1 + AREA_1 * y) * (q1 - AREA_1 * v)
    dp2 = -beta / (DEAD_2 - AREA_2 * y) * (q2 - AREA_2 * v)
    push = p1 * AREA_1 - p2 * AREA_2
    if direction == 0.0:
        return dp1, dp2, 0.0, 0.0
    rest = push - CYLINDER["viscous"].value * v - CYLINDER["coulomb"].value * direction
    return dp1, dp2, v, rest / MASS


def advance(x: tuple[float, ...], u: float, h: float) -> tuple[float, ...]:
    """One Runge-Kutta step with stick-slip (Karnopp): the piston rests until it breaks away."""
    p1, p2, _, v = x
    push = p1 * AREA_1 - p2 * AREA_2
    if v != 0.0:
        direction = math.copysign(1.0, v)
    else:
        slips = abs(push) > CYLINDER["coulomb"].value
        direction = math.copysign(1.0, push) if slips else 0.0
    a = rates(x, u, direction)
    b = rates(tuple(s + 0.5 * h * r for s, r in zip(x, a)), u, direction)
    c = rates(tuple(s + 0.5 * h * r for s, r in zip(x, b)), u, direction)
    d = rates(tuple(s + h * r for s, r in zip(x, c)), u, direction)
    new = [s + h / 6.0 * (i + 2.0 * (j + k) + m) for s, i, j, k, m in zip(x, a, b, c, d)]
    if direction == 0.0 or (v != 0.0 and new[3] * v < 0.0):
        new[3] = 0.0
    return tuple(new)


class Commander:
    """Commands of the three trials: held random levels, then slow passes through zero."""

    def __init__(self, rng: np.random.Generator, trial: int) -> None:
        self.rng, self.trial, self.until, self.level = rng, trial, 0, 0.0

    def __call__(self, k: int, position: float) -> float:
        if k < 30:
            return 0.0
        if k > 1500:  # slow triangles across the dead zone
            phase = ((k - 1500) / 350.0 + 0.25 + 0.1 * self.trial) % 1.0
            return round(0.9 * (4.0 * abs(phase - 0.5) - 1.0), 3)
        if k >= self.until:
            size = float(np.exp(self.rng.uniform(math.log(0.25), math.log(9.0))))
            sign = math.copysign(1.0, 0.1 - position)
            if abs(position - 0.1) < 0.035:
                sign = math.copysign(1.0, -self.level) if self.level else 1.0
            self.level = round(sign * size, 3)
            self.until = k + int(self.rng.uniform(40, 160))
        return self.level


def simulate_cylinder(rng: np.random.Generator, trial: int) -> list[Array]:
    """Cylinder after a held command; rows of time, command, two pressures and position."""
    command = Commander(rng, trial)
    x: tuple[float, ...] = (1.2e6, 1.2e6 * AREA_1 / AREA_2, 0.1 + 0.01 * trial, 0.0)
    rows = np.empty((CYLINDER_SAMPLES, 4))
    for k in range(CYLINDER_SAMPLES):
        u = command(k, x[2])
        rows[k] = u, x[0], x[1], x[2]
        for _ in range(FINE):
            x = advance(x, u, CYLINDER_STEP / FINE)
    noise = rng.standard_normal((CYLINDER_SAMPLES, 3))
    return [
        CYLINDER_STEP * np.arange(CYLINDER_SAMPLES, dtype=np.float64),
        rows[:, 0],
        1e-5 * (rows[:, 1] + 2e4 * noise[:, 0]),
        1e-5 * (rows[:, 2] + 2e4 * noise[:, 1]),
        1e3 * (rows[:, 3] + 5e-5 * noise[:, 2]),
    ]


DATASET = Dataset(
    "hydraulic-cylinder",
    "Servo-hydraulic cylinder: valve command, chamber pressures and position",
    "the rig of the hydraulic paper of 2019",
    (20191, 1),
    simulate_cylinder,
    (
        Column("t [s]", "time of the sample", 3),
        Column("u [V]", "command of the servo valve, held until the next sample", 3),
        Column("p1 [bar]", "pressure in chamber 1, on the piston side", 2),
        Column("p2 [bar]", "pressure in chamber 2, on the rod side", 2),
        Column("y [mm]", "position of the piston, growing with chamber 1", 2),
    ),
    {
        "time": "t [s]",
        "command": "u [V]",
        "pressure_1": "p1 [bar]",
        "pressure_2": "p2 [bar]",
        "position": "y [mm]",
    },
    CYLINDER,
    (
        "1 kHz, 2200 samples; held random levels of 0.25 V to 9 V, then slow triangles of "
        "0.9 V across the dead zone",
        "areas, volumes, mass and supply pressure of table 1, the volumes taken at position 0",
        "losses enter with the magnitude of the flow, so that they brake in both directions",
        "sensor noise 0.2 bar and 0.05 mm RMS (invented), tank pressure 0",
        "the piston sticks while the force lies within the Coulomb level",
    ),
    {
        "area_1": AREA_1,
        "area_2": AREA_2,
        "dead_volume_1": DEAD_1,
        "dead_volume_2": DEAD_2,
        "mass": MASS,
        "supply_pressure": SUPPLY,
    },
)
