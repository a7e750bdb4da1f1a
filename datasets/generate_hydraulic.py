"""Generate the synthetic logs of the hydraulic families.

    python datasets/generate_hydraulic.py [--output DIRECTORY]

The cylinder is simulated from Table 1 of "A hydraulic actuator model using feedforward neural
networks" (COBEM 2019) on a grid 25 times finer than the log; the motor has a closed form between
the samples. Nothing but numpy is needed and no code is shared with ``fluidact_fit``, so that
a fit which recovers the truth proves something. Running it again writes the same bytes.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SEED = 20191
TRIALS = 3
TABLE = "hydraulic paper 2019, table 1"
CYLINDER_STEP = 1e-3  # s: 1 kHz
CYLINDER_SAMPLES = 2200
FINE = 25  # simulation steps per sample
MOTOR_STEP = 0.02  # s: 50 Hz


@dataclass(frozen=True)
class Truth:
    """A true value in SI; ``origin`` is where it was published, empty when invented."""

    value: float
    unit: str
    origin: str = ""
    note: str = ""


@dataclass(frozen=True)
class Dataset:
    """One directory: how to simulate a trial and everything its README says."""

    family: str
    title: str
    number: int
    simulate: Callable[[np.random.Generator, int], list[Array]]
    columns: tuple[tuple[str, str, int], ...]
    roles: dict[str, str]
    truth: dict[str, Truth]
    conditions: tuple[str, ...]
    options: dict[str, float]


# ----------------------------------------------------------------------------------- cylinder

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


# -------------------------------------------------------------------------------------- motor

_MOTOR = "chosen near the curve of a bench with a small hydraulic motor"
MOTOR = {
    "dead_zone": Truth(0.4, "A", note=_MOTOR),
    "gain": Truth(88.0, "rad/s/A", note=_MOTOR),
    "curvature": Truth(0.24, "1/A", note=_MOTOR),
    "saturation_command": Truth(6.2, "A", note=_MOTOR),
    "hysteresis": Truth(0.25, "A", note=_MOTOR),
    "time_constant": Truth(0.07, "s", note=_MOTOR),
    "dead_time": Truth(0.03, "s", note=_MOTOR),
}


def staircase(trial: int) -> Array:
    """Levels 0 to 7 and back, 1.6 s each; the trials differ by where the levels lie [A]."""
    levels = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    shift = (0.0, 0.35, -0.3)[trial]
    up = [max(level + shift, 0.0) if 0.0 < level < 7.0 else level for level in levels]
    return np.repeat(np.array([*up, *up[-2::-1]]), 80)


def motor_curve(command: Array) -> Array:
    """Speed over the command that the spool sees [rad/s]."""
    t = {n: v.value for n, v in MOTOR.items()}
    x = np.clip(np.minimum(command, t["saturation_command"]) - t["dead_zone"], 0.0, None)
    return np.asarray(t["gain"] / t["curvature"] * (1.0 - np.exp(-t["curvature"] * x)))


def simulate_motor(rng: np.random.Generator, trial: int) -> list[Array]:
    """Play, static curve and first-order lag after a held command."""
    command = staircase(trial)
    half = 0.5 * MOTOR["hysteresis"].value
    seen, spool = np.empty_like(command), 0.0
    for k, u in enumerate(command.tolist()):
        spool = min(max(spool, u - half), u + half)
        seen[k] = spool
    # half steps: the dead time is one and a half samples
    target = np.repeat(motor_curve(seen), 2)
    late = np.concatenate((np.full(3, target[0]), target[:-3]))
    keep = math.exp(-0.5 * MOTOR_STEP / MOTOR["time_constant"].value)
    fine, now = np.empty_like(late), 0.0
    for k, aim in enumerate(late.tolist()):
        fine[k] = now
        now = aim + keep * (now - aim)
    speed = fine[::2]
    measured = 1.5 + speed + 0.7 * rng.standard_normal(speed.size)
    return [MOTOR_STEP * np.arange(speed.size, dtype=np.float64), command, measured]


# --------------------------------------------------------------------------------- the datasets

DATASETS = (
    Dataset(
        "hydraulic-cylinder",
        "Servo-hydraulic cylinder: valve command, chamber pressures and position",
        1,
        simulate_cylinder,
        (
            ("t [s]", "time of the sample", 3),
            ("u [V]", "command of the servo valve, held until the next sample", 3),
            ("p1 [bar]", "pressure in chamber 1, on the piston side", 2),
            ("p2 [bar]", "pressure in chamber 2, on the rod side", 2),
            ("y [mm]", "position of the piston, growing with chamber 1", 2),
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
            "losses enter with the amount of the flow, so that they brake in both directions",
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
    ),
    Dataset(
        "hydraulic-motor",
        "Hydraulic motor behind a proportional valve: staircase of the valve current",
        2,
        simulate_motor,
        (
            ("t [s]", "time of the sample", 2),
            ("i [A]", "current of the valve, held until the next sample", 2),
            ("omega [rad/s]", "speed of the motor", 2),
        ),
        {"time": "t [s]", "command": "i [A]", "speed": "omega [rad/s]"},
        MOTOR,
        (
            "50 Hz, staircase from 0 A to 7 A and back, 1.6 s per level; the levels of the three "
            "trials interlace",
            "sensor noise 0.7 rad/s RMS, zero error 1.5 rad/s (invented)",
        ),
        {},
    ),
)


def number(value: float) -> str:
    """A float as the parameter files write it."""
    if value != 0.0 and not 1e-3 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.16e}".split("e")
        short = next(s for d in range(1, 17) if float(s := f"{value:.{d}e}") == value or d == 16)
        mantissa, exponent = short.split("e")
        return f"{mantissa}e{int(exponent):+03d}"
    return repr(float(value))


def arguments(data: Dataset) -> list[str]:
    """Options of the command line."""
    out = [w for role, header in data.roles.items() for w in ("--column", f"{role}={header}")]
    for name, value in data.options.items():
        out += [f"--{name.replace('_', '-')}", number(value)]
    return out


def truth_text(data: Dataset, logs: list[str]) -> str:
    """The text of ``truth.yaml``."""
    quoted = ", ".join(f'"{a}"' for a in arguments(data))
    lines = [
        "# Written by datasets/generate_hydraulic.py. Synthetic logs; these values made them.",
        f"family: {data.family}",
        "synthetic: true",
        f"seed: [{SEED}, {data.number}]",
        f"logs: [{', '.join(logs)}]",
        "columns:",
        *(f'  {role}: "{header}"' for role, header in data.roles.items()),
        f"arguments: [{quoted}]",
        "options:" if data.options else "options: {}",
        *(f"  {name}: {number(value)}" for name, value in data.options.items()),
        "parameters:",
    ]
    for name, t in data.truth.items():
        origin = "published" if t.origin else "invented"
        extra = f', source: "{t.origin}"' if t.origin else ""
        extra += f', note: "{t.note}"' if t.note else ""
        lines.append(
            f'  {name}: {{value: {number(t.value)}, unit: "{t.unit}", origin: {origin}{extra}}}'
        )
    return "\n".join(lines) + "\n"


def command_text(data: Dataset, logs: list[str]) -> str:
    """The command that fits the directory."""
    words = arguments(data)
    pairs = [f"{a} {b if a != '--column' else chr(34) + b + chr(34)}" for a, b in
             zip(words[::2], words[1::2])]  # fmt: skip
    paths = " ".join(f"datasets/{data.family}/{log}" for log in logs)
    parts = [f"fluidact-fit {data.family}", paths, *pairs, f"-o {data.family}.yaml"]
    return " \\\n    ".join(parts)


def readme_text(data: Dataset, logs: list[str]) -> str:
    """The text of a directory's README."""
    rows = []
    for name, t in data.truth.items():
        origin = f"published ({t.origin})" if t.origin else "**invented**"
        note = f"; {t.note}" if t.note else ""
        rows.append(f"| `{name}` | {number(t.value)} {t.unit} | {origin}{note} |")
    given = [f"| `--{n.replace('_', '-')}` | {number(v)} |" for n, v in data.options.items()]
    head = ["## Given by options", "", "| option | value (SI) |", "|---|---|", *given, ""]
    return "\n".join(
        [
            f"# {data.title}",
            "",
            "**Synthetic**: nobody measured these logs. `datasets/generate_hydraulic.py` writes "
            "this directory;",
            f"seed `[{SEED}, {data.number}, trial]`.",
            "",
            "## Conditions",
            "",
            *(f"- {c}" for c in data.conditions),
            "",
            "## Columns",
            "",
            "| header | meaning |",
            "|---|---|",
            *(f"| `{header}` | {meaning} |" for header, meaning, _ in data.columns),
            "",
            "Separator `,`, decimal `.`, UTF-8, one header line.",
            "",
            *(head if given else []),
            "## True parameters",
            "",
            "| parameter | value | origin |",
            "|---|---|---|",
            *rows,
            "",
            "The same, for programs: `truth.yaml`.",
            "",
            "## Fit",
            "",
            "```sh",
            command_text(data, logs),
            "```",
            "",
        ]
    )


def log_text(data: Dataset, values: list[Array]) -> str:
    """The text of one log."""
    lines = [",".join(header for header, _, _ in data.columns)]
    digits = [d for _, _, d in data.columns]
    for row in zip(*(v.tolist() for v in values)):
        lines.append(",".join(f"{v + 0.0:.{d}f}" for v, d in zip(row, digits)))
    return "\n".join(lines) + "\n"


def write_datasets(directory: Path) -> list[Path]:
    """Write both datasets below ``directory``; return the files."""
    written = []
    for data in DATASETS:
        folder = directory / data.family
        folder.mkdir(parents=True, exist_ok=True)
        logs = [f"trial{i + 1}.csv" for i in range(TRIALS)]
        texts = {"README.md": readme_text(data, logs), "truth.yaml": truth_text(data, logs)}
        for trial, name in enumerate(logs):
            rng = np.random.default_rng([SEED, data.number, trial])
            texts[name] = log_text(data, data.simulate(rng, trial))
        for name, text in sorted(texts.items()):
            path = folder / name
            path.write_bytes(text.encode("utf-8"))
            written.append(path)
    return written


def main() -> None:
    """Write the datasets."""
    parser = argparse.ArgumentParser(description="Write the synthetic hydraulic datasets.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent)
    write_datasets(parser.parse_args().output)


if __name__ == "__main__":
    main()
