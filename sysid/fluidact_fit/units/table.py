"""The units that are read, with the symbols people write for them, and those that never are.

Plain data for :mod:`.reading` and :mod:`.headers`. The list is positive: a unit or a prefix that
no test rig records in is not read, however well known it is elsewhere.
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
    "a length": {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "km": 1e3}
    | {"inch": 0.0254, "thou": 2.54e-5, "ft": 0.3048, "yd": 0.9144, "mile": 1609.344},
    "an area": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "a volume": {"m^3": 1.0, "cm^3": 1e-6, "mm^3": 1e-9, "l": 1e-3, "ml": 1e-6},
    "a mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "t": 1e3, "lb": 0.45359237}
    | {"oz": 0.028349523125},
    "a frequency": {"Hz": 1.0, "1/s": 1.0, "kHz": 1e3},
    "a force": {"N": 1.0, "daN": 10.0, "kN": 1e3, "MN": 1e6, "mN": 1e-3}
    | {"lbf": 4.4482216152605, "kip": 4448.2216152605, "ozf": 0.2780138509537812}
    | {"kgf": 9.80665, "gf": 9.80665e-3, "tf": 9806.65},
    "a torque": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3, "daN m": 10.0, "N cm": 1e-2}
    | {"lbf inch": 0.1129848290276167, "lbf ft": 1.3558179483314004}
    | {"ozf inch": 7.061551814226043e-3, "kgf cm": 0.0980665, "kgf m": 9.80665},
    "a pressure": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}
    | {"bar": 1e5, "mbar": 1e2, "dbar": 1e4, "ubar": 0.1, "kbar": 1e8}
    | {"psi": 6894.757293168361, "ksi": 6894757.293168361, "psf": 47.88025898033584}
    | {"atm": 101325.0, "at": 98066.5, "torr": 101325.0 / 760.0}
    | {"mmHg": 133.322387415, "inHg": 3386.38864034, "mmH2O": 9.80665, "cmH2O": 98.0665}
    | {"inH2O": 249.08891, "mH2O": 9806.65},
    "a voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3},
    "a current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "nA": 1e-9, "kA": 1e3},
    "an angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180}
    | {"arcmin": math.pi / 10800, "arcsec": math.pi / 648000, "gon": math.pi / 200}
    | {"rev": 2 * math.pi},
    "an angular speed": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180}
    | {"rev/s": 2 * math.pi, "rpm": math.pi / 30, "krpm": 1e3 * math.pi / 30},
    "an angular acceleration": {"rad/s^2": 1.0, "deg/s^2": math.pi / 180},
    "a speed": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "m/min": 1.0 / 60}
    | {"mm/min": 1e-3 / 60, "km/h": 1.0 / 3.6, "inch/s": 0.0254, "ft/s": 0.3048},
    "an acceleration": {"m/s^2": 1.0, "mm/s^2": 1e-3},
    "a volume flow": {"m^3/s": 1.0, "m^3/min": 1.0 / 60, "m^3/h": 1.0 / 3600}
    | {"l/s": 1e-3, "l/min": 1e-3 / 60, "l/h": 1e-3 / 3600, "ml/s": 1e-6, "ml/min": 1e-6 / 60}
    | {"cm^3/s": 1e-6, "gallon/min": 3.785411784e-3 / 60}
    | {"imperial_gallon/min": 4.54609e-3 / 60, "ft^3/min": 0.3048**3 / 60},
    "a dynamic viscosity": {"Pa s": 1.0, "mPa s": 1e-3, "cP": 1e-3},
    "a kinematic viscosity": {"m^2/s": 1.0, "mm^2/s": 1e-6, "cSt": 1e-6},
    "a linear damping": {"N s/m": 1.0},
    "an angular damping": {"N m s/rad": 1.0},
    "a stiffness": {"N/m": 1.0, "N/mm": 1e3},
    "a moment of inertia": {"kg m^2": 1.0},
    "a power": {"W": 1.0, "kW": 1e3},
}
NUMBER = "a plain number"
TABLE = {unit: (size, what) for what, units in QUANTITIES.items() for unit, size in units.items()}

# The names that a product or quotient may be made of: those of the table, and these.
ATOMS = {unit for unit in TABLE if re.fullmatch(r"[^\W\d_]\w*", unit)}
ATOMS |= {"imperial_gallon", "gallon", "degC", "degF", "K", "J", "kJ", "mJ", "mW", "MW", "ohm"}
ATOMS |= {"mohm", "kohm", "Mohm", "mHz", "MHz", "cl", "dl", "hl", "ul", "mdeg", "St", "percent"}

# Other symbols, as loggers and people write them; each is looked up after normalisation.
# Among them are some that pint takes for something else: a mil for an angle, "1/min" for a
# frequency, an ounce or a pound times a length for no torque.
_SPELLINGS = {
    "1": "-, count, counts, bit, bits, cnt, cnts, cts, raw, LSB, lsb, digit, digits, ADC, none, "
    "inc, incr, ticks, pulses, steps, Inkremente, Impulse",
    "%": "percent, pct, Prozent, prozent, %FS, % FS, %FSO, %F.S.",
    "s": "S",
    "ms": "mS, MS",
    "us": "uS",
    "inch": "in",
    "thou": "mil, mils",
    "mile/h": "mph",
    "km/h": "kmh, kph",
    "l": "L",
    "ml": "mL, cc, ccm",
    "ul": "uL",
    "l/min": "L/min, lpm, LPM, ltr/min",
    "l/s": "L/s",
    "ml/min": "mL/min, cm^3/min, ccm/min, cc/min",
    "gallon/min": "gpm, gal/min, USgpm, US gpm, US gal/min, gal/min US, gal US/min",
    "imperial_gallon/min": "imp gal/min, imperial gal/min, imperial gallon/min, igpm, imp gpm, "
    "UK gal/min, UK gpm, gal/min UK, gal UK/min, imp gallon/min",
    "N": "Newton, Newtons, newton, newtons",
    "kN": "KN",
    "kip": "kips, klbf, klb",
    "lb": "lbs, lbm",
    "lbf": "lbsf, lb f, lb force",
    "kgf": "kp, kg f",
    "tf": "Mp",
    "N m": "Nm, N.m, N*m",
    "mN m": "mNm, mN*m, Nmm, N mm",
    "kN m": "kNm",
    "daN m": "daNm",
    "N cm": "Ncm",
    "lbf inch": "lbf in, in lbf, lb in, in lb, lbf*in, lb*in, in*lb, in lbs, inlb, inlbs, inlbf, "
    "lbin, inch lb, inch lbs, inch lbf",
    "lbf ft": "ft lbf, lb ft, ft lb, lbf*ft, lb*ft, ft*lb, ft lbs, lbs ft, ftlb, ftlbs, ftlbf, "
    "lbft",
    "ozf inch": "ozf in, in ozf, oz in, in oz, ozf*in, oz*in, in*oz, ozin",
    "kgf cm": "kp cm, kgf*cm",
    "kgf m": "kp m, kpm, kgf*m",
    "torr": "Torr",
    "mmHg": "mm Hg",
    "inHg": "in Hg",
    "mmH2O": "mm H2O, mm WS, mm WC",
    "cmH2O": "cm H2O, cm WC",
    "inH2O": "in H2O, in WC",
    "at": "kp/cm^2, kgf/cm^2, kg/cm^2",
    "psi": "lb/in^2, lbs/in^2, lbf/in^2, psid, lb/inch^2, lbf/inch^2",
    "psf": "lb/ft^2, lbs/ft^2, lbf/ft^2",
    "MPa": "Mpa, MPA",
    "V": "VDC, Vdc, V DC",
    "A": "Amp, Amps, amp, amps",
    "mA": "mADC, mAdc, mA DC",
    "ft^3/min": "cfm, CFM",
    "rev": "revs, turn, turns",
    "rpm": "1/min, min^-1, min-1, U/min, U/Min, rev/min, r/min, r p m, Upm, UPM, Umdr/min, Umin, "
    "tr/min, tr/mn, giri/min, upm",
}
ALIASES = {"": "1"} | {
    spelling: unit for unit, several in _SPELLINGS.items() for spelling in several.split(", ")
}

# Case may be ignored only where no other unit is meant by another case (not: mPa, MPa).
ANY_CASE = {u: u for u in ("bar", "mbar", "dbar", "psi", "ksi", "psf", "rpm", "deg", "rad")}
ANY_CASE |= {u.casefold(): u for u in ("kPa", "hPa", "mmHg", "inHg", "Hz", "kHz", "kg", "kgf")}
ANY_CASE |= {u: u for u in ("lb", "lbf", "kip", "cm", "gon", "percent")}
ANY_CASE |= {"inwc": "inH2O", "mmwc": "mmH2O", "cmwc": "cmH2O", "mmws": "mmH2O", "mws": "mH2O"}
ANY_CASE |= {"lbs": "lb", "kips": "kip", "gpm": "gallon/min", "lpm": "l/min", "l/min": "l/min"}

# A name that is a unit to some and another unit, or nothing, to others, in any case: what it may
# be. Never read.
AMBIGUOUS = {
    **dict.fromkeys(("grad", "grads", "grade", "grades"), "degrees ('deg') or gon ('gon')"),
    **dict.fromkeys(
        ("ton", "tons"), "a mass or a force, and metric ('t', 'tf'), short or long tons"
    ),
    **dict.fromkeys(("tonf", "tonsf"), "a metric ('tf'), short or long ton"),
    **dict.fromkeys(("knot", "knots", "kt", "kts"), "a knot, which no test rig measures in"),
    **dict.fromkeys(("kgcm", "kgm"), "'kgf cm' or 'kgf m' if it is a torque"),
    "kn": "'kN' or a knot",
    "nm": "'nm', a nanometre, or 'N m'",
    **dict.fromkeys(("hp", "ps", "horsepower"), "metric or mechanical horsepower"),
}
# Units all the same, which are not read: no header with one of them is without a unit.
_UNREAD = (
    "dyn dyne dynes slug slugs stone poundal pdl baud db emu erg furlong angstrom angstroms "
    "tenths hundredths thousandths zehntel hundertstel tausendstel pixel pixels px rps samples "
    "jiffies cycles microstrain mkp"
)
UNREAD = set(_UNREAD.split())

# A pressure above the atmosphere, or above vacuum: barg, bar(a), psia, kPa abs.
REFERENCED = re.compile(
    r"(?P<unit>(?i:m?bar|psi)|[hkM]?Pa|at)(?:[ _]|, ?)?"
    r"(?i:\((?P<inside>g|a|abs|rel|ü|gauge|absolute)\.?\)|(?P<behind>g|a|abs|rel|ü|gauge|absolute))"
    r"\.?"
)
GAUGE = ("g", "rel", "ü", "gauge")

# Gas counted as the volume that it would fill at a standard state: NL/min, slpm, sccm, Nm3/h.
STANDARD_FLOW = re.compile(
    r"(?i:slpm|slm|nlpm|nlm|sccm|sccs|scfm|scfh)"
    r"|(?:N ?|[Ss](?:td\.? ?)?)(?:l|L|m\^3)/(?:s|min|h)|(?:l|L|m\^3)_?n/(?:s|min|h)"
)
