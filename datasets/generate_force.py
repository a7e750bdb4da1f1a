"""Generate the synthetic logs of the single-acting pneumatic cylinder.

    python datasets/generate_force.py [--output DIRECTORY]

``force-map`` imitates the experiments of "Data-Driven Feedforward Force Control of a
Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis Characteristic" (Actuators 14,
162, 2025): six positions to train on, four staggered ones to test, 0 to 60 N in steps of
1 N, 10-bit position, 100 Hz. The paper gives no parameters of the cylinder: those are
invented. ``spring-cylinder`` obeys equations 1 to 6 exactly. Nothing but numpy is needed and
no code is shared with ``fluidact_fit``. Running it again writes the same bytes.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

SEED = 20251
STEP = 0.01  # s: 100 Hz, as in the paper
PAPER = "pneumatic force control paper, 2025"
THESIS = "thesis"
POSITIONS = (
    (1.3, 11.6, 21.3),
    (6.5, 16.6, 26.9),
    (4.2, 13.6, 23.2, 26.5),
)  # mm: trials 1 and 2 train, trial 3 tests
HELD = 4  # samples per step of 1 N
CYCLES = 2
SLACK = 1.0  # N wanting after a cycle: the rod leaves the sensor, as the paper's figure 12B shows
INNER = 100  # steps of integration per sample: 0.1 ms
ADC = 60.0 / 1023.0  # mm: 10 bits over the potentiometer's 60 mm


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
    physics: dict[str, Truth] = field(default_factory=dict)


# ---------------------------------------------------------------------------------- force map

PHYSICS = {
    "valve_gain": Truth(9.0e4, "Pa/V"),
    "area": Truth(2.01e-4, "m2", note="bore of 16 mm"),
    "stiffness": Truth(300.0, "N/m"),
    "stiffening": Truth(4000.0, "N/m2", note="the paper says that the spring is nonlinear"),
    "preload": Truth(5.0, "N"),
    "coulomb": Truth(
        6.0,
        "N",
        note="both ways, at the retracted end and without pressure; makes an ideal command miss "
        "by 5 N at a reversal, as the paper's figure 12 shows",
    ),
    "coulomb_per_position": Truth(12.0, "N/m"),
    "coulomb_per_pressure_force": Truth(0.004, "1"),
    "creep": Truth(
        3.3e-5,
        "m",
        note="way over which the seal's friction changes over after a reversal: 95 % after the "
        "paper's 0.1 mm",
    ),
    "mass": Truth(0.06, "kg", note="piston and rod"),
    "viscous": Truth(20.0, "N s/m"),
    "contact_damping": Truth(80.0, "N s/m"),
    "contact_stiffness": Truth(1.5e5, "N/m"),
    "valve_lag": Truth(0.004, "s"),
    "force_noise": Truth(0.05, "N"),
}


def value(name: str) -> float:
    """A number of the simulated cylinder."""
    return PHYSICS[name].value


def spring(x: Array | float) -> Array | float:
    """Force of the stiffening return spring [N]."""
    return value("preload") + value("stiffness") * x + value("stiffening") * x * x


def friction(x: float, push: float) -> float:
    """Coulomb level at a position and pressure force [N]."""
    level = value("coulomb") + value("coulomb_per_position") * x
    return level + value("coulomb_per_pressure_force") * push


def staircase() -> Array:
    """Wanted force: 0 to 60 N and back in steps of 1 N; the rod leaves the sensor [N]."""
    up = np.arange(0.0, 61.0)
    cycle = np.concatenate((up[1:], up[-2::-1], [-SLACK]))
    return np.repeat(np.concatenate(([0.0], *([cycle] * CYCLES))), HELD)


def integrate(command: Array, x0: float) -> tuple[Array, Array]:
    """Rod and force sensor while the valve follows the command.

    ``m dv/dt = push - spring(x) - stiction - viscous v - force``, with the seal as a bristle
    (Dahl): ``d stiction = (sign(v) level - stiction) |dx| / creep``. The rod presses on the
    sensor at ``x0`` and leaves it when the pressure no longer carries the spring.

    Returns
    -------
    position [m], force [N]
        Shapes ``(n,)``, at the end of each sample.
    """
    p = {name: t.value for name, t in PHYSICS.items()}
    gain, step = p["valve_gain"] * p["area"], STEP / INNER
    keep = math.exp(-step / p["valve_lag"])
    push = float(spring(x0)) - friction(x0, float(spring(x0)))
    x, v, stiction, rows = x0, 0.0, -friction(x0, push), []
    for u in command.tolist():
        force = 0.0
        for _ in range(INNER):
            push = gain * u + (push - gain * u) * keep
            depth = x - x0
            force = max(p["contact_stiffness"] * depth + p["contact_damping"] * v, 0.0)
            force = force if depth > 0.0 else 0.0
            total = push - float(spring(x)) - stiction - p["viscous"] * v - force
            v += step * total / p["mass"]
            moved = step * v
            x += moved
            goal = math.copysign(friction(x, push), moved)
            stiction = goal + (stiction - goal) * math.exp(-abs(moved) / p["creep"])
            if x < 0.0:  # the retracted end
                x, v = 0.0, 0.0
        rows.append((x, force))
    position, measured = (np.array(c) for c in zip(*rows))
    return position, measured


def simulate_position(rng: np.random.Generator, x0: float) -> list[Array]:
    """Command, position and force at one position of the force sensor."""
    wanted = staircase()
    gain, commands, state = value("valve_gain") * value("area"), [], 1.0
    for k, target in enumerate(wanted.tolist()):
        if k and target != wanted[k - 1]:
            state = 1.0 if target > wanted[k - 1] else -1.0
        x = x0 + target / value("contact_stiffness")
        need = target + float(spring(x))
        ideal = (need + state * friction(x, need)) / gain
        commands.append(round(ideal + 0.004 * float(rng.standard_normal()) * (k % HELD == 0), 3))
    command = np.array(commands)
    position, force = integrate(command, x0)
    counts = np.round(1e3 * position / ADC + 0.2 * rng.standard_normal(position.size))
    noise = value("force_noise") * rng.standard_normal(position.size)
    return [command, counts * ADC, np.round((force + noise) / 0.01) * 0.01]


def simulate_map(rng: np.random.Generator, trial: int) -> list[Array]:
    """All positions of a trial, one after the other."""
    parts = [simulate_position(rng, 1e-3 * x) for x in POSITIONS[trial]]
    columns = [np.concatenate(c) for c in zip(*parts)]
    return [STEP * np.arange(columns[0].size, dtype=np.float64), *columns]


# ---------------------------------------------------------------------------- spring cylinder

CYLINDER = {
    "pressure_gain": Truth(18.09, "N/V", note="valve of 0.9 bar/V, bore of 16 mm"),
    "stiffness": Truth(300.0, "N/m"),
    "preload": Truth(5.0, "N"),
    "coulomb_loading": Truth(2.4, "N", THESIS, "of another pneumatic cylinder"),
    "coulomb_unloading": Truth(2.4, "N", THESIS, "of another pneumatic cylinder"),
    "viscous": Truth(45.0, "N s/m", THESIS, "of another pneumatic cylinder"),
}


def triangle(t: Array, period: float, phase: float) -> Array:
    """Straight lines between -1 and 1."""
    return np.asarray(4.0 * np.abs(np.mod(t / period + phase, 1.0) - 0.5) - 1.0)


def simulate_cylinder(rng: np.random.Generator, trial: int) -> list[Array]:
    """A stage moves the rod to and fro while the command goes up and down."""
    t = STEP * np.arange(1000, dtype=np.float64)
    period = (4.0, 2.3, 1.1)[trial] * rng.uniform(0.95, 1.05)
    command = np.round(2.6 + 1.4 * triangle(t, period, rng.uniform()), 3)
    state = np.sign(np.diff(command, prepend=command[0]))
    for k in range(1, state.size):
        state[k] = state[k] or state[k - 1]
    state[0] = state[1]
    swing = np.array([0.009, 0.011, 0.008])[trial]
    pace = (5.0, 3.1, 1.3)[trial] * rng.uniform(0.95, 1.05)
    angle = 2.0 * np.pi * t / pace + rng.uniform(0.0, 2.0 * np.pi)
    position = 0.014 + swing * np.sin(angle)
    speed = swing * 2.0 * np.pi / pace * np.cos(angle)
    c = {k: v.value for k, v in CYLINDER.items()}
    level = np.where(state > 0.0, c["coulomb_loading"], -c["coulomb_unloading"])
    force = c["pressure_gain"] * command - c["stiffness"] * position - c["preload"]
    force = force - level - c["viscous"] * speed + 0.05 * rng.standard_normal(t.size)
    measured = 1e3 * (position + 10e-6 * rng.standard_normal(t.size))
    return [t, command, measured, force]


# ------------------------------------------------------------------------------ the collection

_COLUMNS = (
    ("t [s]", "time of the sample", 2),
    ("u [V]", "command of the pressure valve, held until the next sample", 3),
    ("x [mm]", "position of the piston rod", 3),
    ("F [N]", "force sensor at the rod", 2),
)
_ROLES = {"time": "t [s]", "command": "u [V]", "position": "x [mm]", "force": "F [N]"}
DATASETS = (
    Dataset(
        "force-map",
        "Single-acting pneumatic cylinder: command, position and force with hysteresis",
        1,
        simulate_map,
        _COLUMNS,
        _ROLES,
        {},
        (
            "100 Hz; six positions to train on (trial 1: 1.3, 11.6, 21.3 mm; trial 2: 6.5, 16.6, "
            "26.9 mm), four staggered ones to test (trial 3: 4.2, 13.6, 23.2, 26.5 mm), as in "
            "the paper",
            "force 0 to 60 N and back in steps of 1 N (paper), 40 ms each, twice (invented; the "
            "paper repeats it five times)",
            "position by a 10-bit converter over 60 mm (paper) with 0.2 counts RMS noise; force "
            "with 0.05 N RMS noise in steps of 0.01 N (invented)",
            "after a reversal the friction of the seal changes over gradually, within 0.1 mm, and "
            "between two cycles the rod leaves the sensor and meets it again: the two transient "
            "waves of the paper's figure 12. A command that knows spring and friction misses the "
            "force by up to 5 N there, by 0.9 N RMS over all",
        ),
        PHYSICS,
    ),
    Dataset(
        "spring-cylinder",
        "Single-acting pneumatic cylinder on a moving stage: equations 1 to 6",
        2,
        simulate_cylinder,
        _COLUMNS,
        _ROLES,
        CYLINDER,
        (
            "100 Hz, 1000 samples, 10 s",
            "a stage moves the rod between 3 and 25 mm, slowly, faster and fast (trials 1, 2, 3), "
            "while the command goes up and down between 1.2 and 4 V",
            "the motion state is the sign of the command's change (equation 3)",
            "force noise 0.05 N RMS, position noise 10 um RMS (invented)",
        ),
    ),
)


# -------------------------------------------------------------------------- writing it down


def number(x: float) -> str:
    """A float as the parameter files write it."""
    if x != 0.0 and not 1e-3 <= abs(x) < 1e6:
        mantissa, exponent = f"{x:.6e}".split("e")
        return f"{float(mantissa)!r}e{int(exponent):+03d}"
    return repr(float(x))


def arguments(data: Dataset) -> list[str]:
    """Options of the command line."""
    return [w for role, header in data.roles.items() for w in ("--column", f"{role}={header}")]


def truth_lines(truth: dict[str, Truth]) -> list[str]:
    """Entries of ``truth.yaml``."""
    out = []
    for name, t in truth.items():
        origin = "published" if t.origin else "invented"
        extra = f', source: "{t.origin}"' if t.origin else ""
        extra += f', note: "{t.note}"' if t.note else ""
        out.append(
            f'  {name}: {{value: {number(t.value)}, unit: "{t.unit}", origin: {origin}{extra}}}'
        )
    return out


def truth_text(data: Dataset, logs: list[str]) -> str:
    """The text of ``truth.yaml``."""
    quoted = ", ".join(f'"{a}"' for a in arguments(data))
    lines = [
        "# Written by datasets/generate_force.py. Synthetic logs; these values made them.",
        f"family: {data.family}",
        "synthetic: true",
        f"seed: [{SEED}, {data.number}]",
        f"logs: [{', '.join(logs)}]",
        "columns:",
        *(f'  {role}: "{header}"' for role, header in data.roles.items()),
        f"arguments: [{quoted}]",
        "options: {}",
        "parameters:" if data.truth else "parameters: {}",
        *truth_lines(data.truth),
    ]
    if data.physics:
        lines += ["# The network has no true weights. The cylinder that made the logs:", "physics:"]
        lines += truth_lines(data.physics)
    return "\n".join(lines) + "\n"


def command_text(data: Dataset, logs: list[str]) -> str:
    """The command that fits the directory."""
    words = arguments(data)
    pairs = [f'{a} "{b}"' for a, b in zip(words[::2], words[1::2])]
    paths = " ".join(f"datasets/{data.family}/{log}" for log in logs)
    parts = [f"fluidact-fit {data.family}", paths, *pairs, f"-o {data.family}.yaml"]
    return " \\\n    ".join(parts)


def readme_text(data: Dataset, logs: list[str]) -> str:
    """The text of a directory's README."""
    rows = []
    for name, t in (data.truth or data.physics).items():
        origin = f"published ({t.origin})" if t.origin else "**invented**"
        note = f"; {t.note}" if t.note else ""
        rows.append(f"| `{name}` | {number(t.value)} {t.unit} | {origin}{note} |")
    title = "True parameters" if data.truth else "The cylinder that made the logs"
    return "\n".join(
        [
            f"# {data.title}",
            "",
            "**Synthetic**: nobody measured these logs. `datasets/generate_force.py` writes this "
            "directory;",
            f"seed `[{SEED}, {data.number}, trial]`. They imitate the rig of the {PAPER}.",
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
            f"## {title}",
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
        cells = (f"{v:.{d}f}" for v, d in zip(row, digits))
        lines.append(",".join(f"{0.0:.{len(c) - 3}f}" if float(c) == 0.0 and c[0] == "-" else c
                              for c in cells))  # fmt: skip
    return "\n".join(lines) + "\n"


def write_datasets(directory: Path) -> list[Path]:
    """Write both datasets below ``directory``; return the files."""
    written = []
    for data in DATASETS:
        folder = directory / data.family
        folder.mkdir(parents=True, exist_ok=True)
        logs = [f"trial{i + 1}.csv" for i in range(3)]
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
    parser = argparse.ArgumentParser(description="Write the synthetic datasets of the cylinder.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent)
    write_datasets(parser.parse_args().output)


if __name__ == "__main__":
    main()
