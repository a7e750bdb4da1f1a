"""The common units, how people spell them, and those that no factor converts.

Plain data for :mod:`.units`, which alone uses it.
"""

from __future__ import annotations

import math
import re

# What is measured, and the common units of it with their factors to SI (the first one).
# The radian counts here although SI calls it dimensionless: "counts" or "Hz" must not pass
# for an angle or a speed in rad/s.
QUANTITIES: dict[str, dict[str, float]] = {
    "a plain number": {"1": 1.0, "%": 0.01},
    "a time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
    | {"d": 86400.0},
    "a length": {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}
    | {"thou": 2.54e-5, "ft": 0.3048},
    "an area": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "a volume": {"m^3": 1.0, "cm^3": 1e-6, "mm^3": 1e-9, "l": 1e-3},
    "a mass": {"kg": 1.0, "g": 1e-3},
    "a frequency": {"Hz": 1.0, "1/s": 1.0, "kHz": 1e3},
    "a force": {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": 4.4482216152605}
    | {"kgf": 9.80665, "gf": 9.80665e-3, "ozf": 0.2780138509537812},
    "a torque": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "N cm": 1e-2}
    | {"lbf in": 0.1129848290276167, "lbf ft": 1.3558179483314004}
    | {"ozf in": 7.061551814226043e-3, "kgf cm": 0.0980665, "kgf m": 9.80665},
    "a pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2}
    | {"psi": 6894.757293168361, "atm": 101325.0, "at": 98066.5, "torr": 101325.0 / 760.0}
    | {"mmHg": 133.322387415, "inHg": 3386.38864034, "mmH2O": 9.80665, "cmH2O": 98.0665}
    | {"inH2O": 249.08891, "mH2O": 9806.65, "dbar": 1e4, "ubar": 0.1, "ksi": 6894757.293168361},
    "a voltage": {"V": 1.0, "mV": 1e-3},
    "a current": {"A": 1.0, "mA": 1e-3},
    "an angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi}
    | {"grad": math.pi / 200},
    "an angular speed": {"rad/s": 1.0, "deg/s": math.pi / 180, "rev/s": 2 * math.pi}
    | {"rpm": math.pi / 30},
    "an angular acceleration": {"rad/s^2": 1.0},
    "a speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "m/min": 1.0 / 60},
    "an acceleration": {"m/s^2": 1.0},
    "a volume flow": {"m^3/s": 1.0, "l/min": 1e-3 / 60, "l/s": 1e-3, "ml/min": 1e-6 / 60}
    | {"m^3/h": 1.0 / 3600, "gallon/min": 3.785411784e-3 / 60, "ft^3/min": 0.3048**3 / 60},
    "a dynamic viscosity": {"Pa s": 1.0},
    "a linear damping": {"N s/m": 1.0},
    "an angular damping": {"N m s/rad": 1.0},
    "a stiffness": {"N/m": 1.0},
    "a moment of inertia": {"kg m^2": 1.0},
    "a power": {"W": 1.0},
}
NUMBER = "a plain number"
TABLE = {unit: (size, what) for what, units in QUANTITIES.items() for unit, size in units.items()}

# Other spellings, as loggers and people use them; each is looked up after normalisation.
# Among them are some that pint takes for something else: a mil for an angle, "1/min" for a
# frequency, an ounce or a pound times a length for no torque.
_SPELLINGS = {
    "1": ("", "-", "count", "counts", "raw", "LSB", "lsb", "digit", "digits", "ADC", "none"),
    "%": ("percent", "pct"),
    "s": ("S",),
    "ms": ("mS", "MS"),
    "us": ("uS",),
    "inch": ("in",),
    "thou": ("mil", "mils"),
    "l": ("L",),
    "l/min": ("L/min", "lpm", "LPM", "ltr/min"),
    "l/s": ("L/s",),
    "ml/min": ("mL/min", "cm^3/min", "ccm"),
    "gallon/min": ("gpm", "GPM", "gal/min", "USgpm"),
    "N": ("Newton", "Newtons", "newton", "newtons"),
    "kN": ("KN",),
    "kgf": ("kp", "Kgf", "KGF"),
    "N m": ("Nm", "N.m", "N*m"),
    "mN m": ("mNm", "mN*m", "Nmm"),
    "kN m": ("kNm",),
    "N cm": ("Ncm",),
    "lbf in": ("in lbf", "lb in", "in lb", "lbf*in", "lb*in", "in*lb"),
    "lbf ft": ("ft lbf", "lb ft", "ft lb", "lbf*ft", "lb*ft", "ft*lb"),
    "ozf in": ("in ozf", "oz in", "in oz", "ozf*in", "oz*in", "in*oz"),
    "kgf cm": ("kp cm", "kgf*cm"),
    "kgf m": ("kp m", "kpm", "kgf*m"),
    "torr": ("Torr",),
    "at": ("kp/cm^2", "kgf/cm^2", "kg/cm^2"),
    "psi": ("lb/in^2", "lbs/in^2", "lbf/in^2", "psid"),
    "MPa": ("Mpa", "MPA"),
    "V": ("VDC", "Vdc", "V DC"),
    "A": ("Amp", "Amps", "amp", "amps"),
    "ft^3/min": ("cfm", "CFM"),
    "grad": ("gon",),
    "rev": ("revs", "turn", "turns"),
    "rpm": ("1/min", "min^-1", "min-1", "U/min", "rev/min", "r/min"),
}
ALIASES = {spelling: unit for unit, several in _SPELLINGS.items() for spelling in several}

# Case may be ignored only where no other unit is meant by another case (not: mPa, MPa).
ANY_CASE = {u: u for u in ("bar", "mbar", "psi", "rpm", "deg", "rad", "percent")}
ANY_CASE |= {"kpa": "kPa", "mmhg": "mmHg", "inwc": "inH2O"}
_WORDS = {
    "s": "sec secs second seconds sek",
    "ms": "msec msecs millisec millisecs millisecond milliseconds millis",
    "us": "usec usecs microsec microsecond microseconds micros",
    "ns": "nsec nanosec nanosecond nanoseconds nanos",
    "min": "minute minutes mins",
    "h": "hour hours hr hrs",
    "d": "day days",
    "V": "volt volts",
    "deg": "degree degrees",
    "inch": "inch inches",
}
ANY_CASE |= {word: unit for unit, words in _WORDS.items() for word in words.split()}

# Units that hardly anybody records in: a capital m or a small n that slipped in.
SLIPPED = re.compile(r"(?<![^\W\d_])(?:M(?:s|sec|m|V|A|l|L|g|rad)|n[lL])(?![^\W\d_])")

# A pressure above the atmosphere, or above vacuum: barg, bar(a), psia, kPa abs.
REFERENCED = re.compile(
    r"(?P<unit>(?i:m?bar|psi)|[hkM]?Pa|at)(?:[ _]|, ?)?"
    r"(?i:\((?P<inside>g|a|abs|rel|ü)\)|(?P<behind>g|a|abs|rel|ü|gauge|absolute))\.?"
)
GAUGE = ("g", "rel", "ü", "gauge")

# Gas counted as the volume that it would fill at a standard state: NL/min, slpm, sccm, Nm3/h.
STANDARD_FLOW = re.compile(
    r"(?i:slpm|slm|nlpm|nlm|sccm|sccs|scfm|scfh)"
    r"|(?:N ?|[Ss](?:td\.? ?)?)(?:l|L|m\^3)/(?:s|min|h)|(?:l|L|m\^3)_?n/(?:s|min|h)"
)

# Suffixes that mean a unit behind an underscore. ``A``, ``a``, ``in``, ``g`` and ``min``
# are not among them: ``p_A``, ``p_in``, ``motor_a`` and ``x_min`` are names.
SUFFIXES = {
    unit.replace("/", "_"): unit
    for units in (
        "rad/s deg/s mm/s m/s s ms us ns m mm cm um N kN mN Nm mNm",
        "Pa kPa MPa bar mbar psi barg bara psig psia V mV mA kg rad deg rpm",
    )
    for unit in units.split()
}
# One small letter may as well be an index (``valve_m``): believed only where it fits the role.
DOUBTFUL_SUFFIXES = {"s", "m"}
# As a whole header, these may as well be names: of a path, of chamber A, of an inlet.
DOUBTFUL_HEADERS = {unit for unit in TABLE if len(unit) == 1}
DOUBTFUL_HEADERS |= {"in", "min", "at", "mil", "L", "S", "day", "second", "minute", "hour"}
# As the last word of a header these are parts of a name: a motor's turn, the second valve.
LAST_WORDS = {"grad", "gon", "rev", "revs", "turn", "turns", "thou", "mils", "ata", "atg"}
