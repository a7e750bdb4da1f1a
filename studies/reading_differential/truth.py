"""What a table holds before it is written: instants in seconds and channels in SI."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

_POUND = 0.45359237 * 9.80665  # of force [N]
# What is measured, its SI unit, and units as people write them with their size in SI, from the
# definitions; ``None`` marks what cannot be read for sure and has to be refused.
QUANTITIES: dict[str, tuple[str, dict[str, float | None]]] = {
    "force": ("N", {
        "N": 1.0, "kN": 1e3, "mN": 1e-3, "daN": 10.0, "lbf": _POUND, "kgf": 9.80665,
        "kp": 9.80665, "kip": 1e3 * _POUND, "Newton": 1.0, "Newtons": 1.0, "KN": 1e3,
        "kilonewton": 1e3, "牛": 1.0, "千牛": 1e3, "MN": 1e6, "tf": 9806.65, "1/10 N": 0.1,
        "kn": None, "lb": None, "lbs": None, "tons": None, "Kn": None, "kg": None, "10 kN": None,
        "dyn": None, "slug": None, "xyz": None,
    }),
    "pressure": ("Pa", {
        "Pa": 1.0, "bar": 1e5, "mbar": 1e2, "kPa": 1e3, "MPa": 1e6, "hPa": 1e2, "Bar": 1e5,
        "psi": _POUND / 0.0254**2, "PSI": _POUND / 0.0254**2, "ksi": 1e3 * _POUND / 0.0254**2,
        "psf": _POUND / 0.3048**2, "barg": 1e5, "bar(g)": 1e5, "kp/cm²": 98066.5, "atm": 101325.0,
        "kgf/cm2": 98066.5, "N/mm²": 1e6, "daN/cm2": 1e5, "兆帕": 1e6, "巴": 1e5, "kN/m^2": 1e3,
        "Megapascal": 1e6, "1/100 bar": 1e3, "0.01 bar": 1e3, "0,1 bar": 1e4,
        "mmHg": 133.322387415, "kilopascals": 1e3,
        "mpa": None, "mPa": None, "400 bar": None, "MBar": None, "bra": None, "bar*10": None,
    }),
    "position": ("m", {
        "m": 1.0, "mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "um": 1e-6, "μm": 1e-6, "inch": 0.0254,
        "ft": 0.3048, "dm": 0.1, "Millimeter": 1e-3, "millimetres": 1e-3, "milímetros": 1e-3,
        "millimètres": 1e-3, "millimetri": 1e-3, "毫米": 1e-3, "㎜": 1e-3, "Zoll": 0.0254, "mil":
        2.54e-5, "0.01 mm": 1e-5, "1/1000 mm": 1e-6, "10^-3 mm": 1e-6, "metre": 1.0, "meters": 1.0,
        "MM": None, "Mm": None, "milimetr": None, "100 mm": None, "0-50 mm": None, "pm": None,
    }),
    "angle": ("rad", {
        "rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180, "mrad": 1e-3, "rev": 2 * math.pi,
        "degrees": math.pi / 180, "gon": math.pi / 200, "grados": math.pi / 180, "1/10°":
        math.pi / 1800, "turns": 2 * math.pi, "度": math.pi / 180, "Umdrehungen": 2 * math.pi,
        "Grad": None, "grad": None, "Mrad": None,
    }),
    "speed": ("rad/s", {
        "rad/s": 1.0, "rpm": math.pi / 30, "1/min": math.pi / 30, "U/min": math.pi / 30, "°/s":
        math.pi / 180, "deg/s": math.pi / 180, "tr/min": math.pi / 30, "giri/min": math.pi / 30,
        "min⁻¹": math.pi / 30, "rev/s": 2 * math.pi, "转/分": math.pi / 30, "RPM": math.pi / 30,
        "Umdrehungen pro Minute": math.pi / 30, "Grad/s": None, "Hz": None,
    }),
    "velocity": ("m/s", {
        "m/s": 1.0, "mm/s": 1e-3, "m/min": 1 / 60, "cm/s": 1e-2, "in/s": 0.0254, "m s-1": 1.0,
        "m·s⁻¹": 1.0, "km/h": 1 / 3.6, "mm/sec": 1e-3, "metres per second": 1.0, "ft/s": 0.3048,
        "kt": None, "M/s": None,
    }),
    "flow": ("m^3/s", {
        "l/min": 1e-3 / 60, "L/min": 1e-3 / 60, "m³/h": 1 / 3600, "m^3/s": 1.0, "cm3/s": 1e-6,
        "lpm": 1e-3 / 60, "gal/min": 231 * 0.0254**3 / 60, "imp gal/min": 4.54609e-3 / 60,
        "ml/min": 1e-6 / 60, "升/分": 1e-3 / 60, "GPM": 231 * 0.0254**3 / 60, "NL/min": None,
        "nl/min": None,
    }),
    "torque": ("N m", {
        "N m": 1.0, "Nm": 1.0, "N·m": 1.0, "mNm": 1e-3, "N.m": 1.0, "kNm": 1e3, "Ncm": 1e-2,
        "lbf in": _POUND * 0.0254, "ft-lb": _POUND * 0.3048,
        "Newtonmeter": 1.0, "kgf·cm": 0.0980665, "daNm": 10.0, "mN*m": 1e-3,
        "kgcm": None,
    }),
    "voltage": ("V", {
        "V": 1.0, "mV": 1e-3, "Volt": 1.0, "volts": 1.0, "VDC": 1.0, "伏": 1.0, "MV": None,
        "24 V": None, "±10 V": None,
    }),
}  # fmt: skip
TIME_UNITS = {
    "s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "sec": 1.0, "Sekunden": 1.0, "msec": 1e-3,
    "secondes": 1.0, "milliseconds": 1e-3, "10 ms": 1e-2, "min": 60.0, "秒": 1.0,
    "Millisekunden": 1e-3, "segundos": 1.0, "ns": 1e-9, "100 ns": 1e-7,
}  # fmt: skip
NAMES = {
    "force": ("F", "Force", "Kraft", "fuerza", "力", "load cell", "F_rod"),
    "pressure": ("p", "Druck A", "pressure", "p_1", "Inlet", "pression", "压力", "P2"),
    "position": ("x", "Weg", "position", "stroke", "pos", "posición", "位移"),
    "angle": ("phi", "Winkel", "angle", "Position 1", "angle measured"),
    "speed": ("n", "Drehzahl", "speed", "omega", "vitesse", "转速"),
    "velocity": ("v", "velocity", "Geschwindigkeit", "v_piston"),
    "flow": ("Q", "flow", "Durchfluss", "portata"),
    "torque": ("M", "torque", "Drehmoment", "coppia"),
    "voltage": ("u", "command", "Sollwert", "u_valve", "AI0", "Analog 3"),
}
REMARKS = ("left", "filtered", "measured", "valve side", "encoder 1", "rod", "ist", "AI0")


@dataclass
class Channel:
    """A channel: its quantity, name, unit as written and values in that unit.

    ``size`` is that of the unit in SI: ``None`` where it must be refused, 1 where none is written.
    """

    quantity: str
    name: str
    unit: str
    size: float | None
    values: list[float]
    decimals: int

    @property
    def si(self) -> str:
        """The SI unit."""
        return QUANTITIES[self.quantity][0]


@dataclass
class Truth:
    """A table: instants [s] from the first one on, and the channels."""

    step: float
    times: list[float]
    channels: list[Channel]

    @property
    def readable(self) -> bool:
        """Whether every unit is one that can be read."""
        return all(c.size is not None for c in self.channels)


def draw(rng: random.Random) -> Truth:
    """A table of smooth channels with noise."""
    rows, step = rng.randint(24, 90), rng.choice((0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1))
    picked = rng.sample(sorted(QUANTITIES), rng.randint(1, 4))
    return Truth(step, [k * step for k in range(rows)], [_channel(rng, q, rows) for q in picked])


def _channel(rng: random.Random, quantity: str, rows: int) -> Channel:
    units = QUANTITIES[quantity][1]
    surely = [u for u, size in units.items() if size is not None]
    doubtful = [u for u, size in units.items() if size is None]
    unit = rng.choice(doubtful if rng.random() < 0.04 else surely)
    decimals, level = rng.randint(1, 5), rng.choice((0.2, 3.0, 40.0, 700.0, 25_000.0))
    mean, turn = rng.uniform(-1.0, 1.0) * level, rng.uniform(0.05, 0.6)
    values = [
        round(mean + level * (math.sin(turn * k) + 0.05 * rng.gauss(0.0, 1.0)), decimals)
        for k in range(rows)
    ]
    return Channel(quantity, rng.choice(NAMES[quantity]), unit, units[unit], values, decimals)
