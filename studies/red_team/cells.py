"""Coverage of the intervals where the data are hard, parameter by parameter.

The attacks below are recorded so often that a coverage of 95 % can be told from one of 90 %. An
interval counts wherever a parameter is written as estimated, whatever the verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .attack import Attack, Result

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "red-team-coverage.md"
CELLS = (
    ("hydrostatic", "nothing wrong: P1"),
    ("valve", "nothing wrong: P2"),
    ("line", "nothing wrong: P3"),
    ("hydrostatic", "edge never crossed", "force down to -2 of -3 N"),
    ("hydrostatic", "edge barely crossed", "force down to -3.5 of -3 N"),
    ("hydrostatic", "noise on the force", "0.1 N of 12"),
    ("line", "noise on the inlet", "multisine, 0.1 bar of 2"),
    ("line", "noise on the inlet", "multisine, 0.2 bar of 2"),
    ("spring-cylinder", "noise of the position", "0.2 mm, stroke 3 mm"),
    ("spring-cylinder", "Stribeck asked for", "2 N, 4 mm/s"),
    ("spring-cylinder", "Stribeck asked for", "2 N, 4 mm/s, noise of the position, 0.02 mm"),
    ("spring-cylinder", "Stribeck asked for", "2 N, 4 mm/s, noise of the velocity, 1 mm/s"),
    ("hydraulic-cylinder", "Stribeck asked for", "100 N, 0.01 m/s"),
    ("hydraulic-cylinder", "Stribeck asked for", "60 N, 0.02 m/s"),
    ("hydraulic-cylinder", "Stribeck asked for", "900 N, 300 N, 0.01 m/s"),
    ("hydraulic-motor", "noise of the command", "0.05 % of range"),
    ("line", "cut in motion, long dead time"),
    ("cylinder-friction", "force in steps", "0.05 N, quiet, strokes"),
    ("cylinder-friction", "force in steps", "0.2 N, quiet, strokes"),
    ("cylinder-friction", "force in steps", "0.2 N, noise 0.1 N, hand"),
    ("cylinder-friction", "force in steps", "0.5 N, quiet, hand"),
    ("cylinder-friction", "20 Hz", "fast, velocity, quiet force"),
    ("cylinder-friction", "20 Hz", "strokes, position, quiet force"),
    ("cylinder-friction", "Stribeck asked for", "1.2 N, 0.02 m/s, hand"),
    ("cylinder-friction", "Stribeck asked for", "2.4 N, 0.01 m/s, hand"),
    ("cylinder-friction", "Stribeck asked for", "1.2 N, 0.02 m/s, strokes"),
    ("cylinder-friction", "right model", "one speed a log"),
    ("ball-screw", "right model, continuous drive", "three logs, smooth"),
    ("ball-screw", "lost rows", "5 % of lines, foh"),
    ("ball-screw", "lost rows", "5 % of continuous, smooth"),
    ("ball-screw", "noise of the drive", "1e-05 N m, smooth"),
    ("ball-screw", "Stribeck asked for", "held"),
    ("ball-screw", "Stribeck asked for", "continuous, smooth"),
    ("ball-screw", "Stribeck, noise", "half a count"),
    ("hydraulic-motor", "no saturation", "up to 0.8 A, curvature 0.5"),
    ("hydraulic-motor", "no saturation", "straight"),
    ("hydraulic-motor", "moving command", "as foh"),
    ("hydraulic-motor", "uneven sampling", "jitter 4 %"),
    ("potentiometer", "right model", "degree 3, 600 samples"),
    ("potentiometer", "right model", "degree 3 given"),
    ("potentiometer", "right model", "degree 3 given, fixed ends"),
)  # fmt: skip
_EXPLAINED = """\
# Coverage where the data are hard

Written by `make red-team RED_TEAM='--cells RUNS --write'`: attacks of `docs/evidence/red-team.md`,
recorded and fitted many times, each with other noise.

- `quiet`: verdict `pass` and no warning.
- `estimated`: how often the parameter was written as estimated; otherwise it was refused.
- `held`: how often its 95 % interval then held the truth, whatever the verdict.
- `held, quiet`: the same over the quiet files alone, of which nobody was warned.
- `/ stated`: root mean square of the errors over their stated standard errors, 1 where these are of
  the right size.
- `/ bound`: root mean square error over the Cramér-Rao bound, where the attack knows it.

Errors of a coarse and quiet converter are bounded, not normal: such intervals hold a little more
often than they say. What errors of a recorded drive do (ball screw: rows that were lost, rounding,
noise) is found by adding as much to the record, in draws of its own for every log.

| attack | runs | quiet | parameter | estimated | held | held, quiet | / stated | / bound |
|---|---|---|---|---|---|---|---|---|
"""


def is_cell(attack: Attack) -> bool:
    """Whether an attack, or its whole group, is among the cells."""
    key = attack.family, attack.group, attack.name
    return key in CELLS or key[:2] in CELLS


def page(attacks: Sequence[Attack], results: Sequence[Result]) -> str:
    """One row for every parameter of every cell."""
    rows = []
    for a in attacks:
        own = [r for r in results if (r.family, r.group, r.name) == (a.family, a.group, a.name)]
        quiet = sum(r.quiet for r in own)
        bounds = a.bounds() if callable(a.bounds) else a.bounds
        head = f"{a.family}: {a.group}, {a.name} | {len(own)} | {100.0 * quiet / len(own):.0f} %"
        for name in dict.fromkeys(n for r in own for n in r.errors):
            errors = [r.errors[name] for r in own if name in r.errors]
            held = _share([e.held for e in errors])
            unwarned = _share([r.errors[name].held for r in own if r.quiet and name in r.errors])
            size = np.sqrt(np.mean([e.deviations**2 for e in errors])) if errors else np.nan
            ratio = ""
            if bounds.get(name):
                rms = np.sqrt(np.mean([(e.relative * a.scale(name)) ** 2 for e in errors]))
                ratio = f"{rms / bounds[name]:.2f}"
            rows.append(f"| {head} | {name} | {len(errors)} | {held} | {unwarned} | "
                        f"{size:.2f} | {ratio} |")  # fmt: skip
            head = " | | "
    return _EXPLAINED + "\n".join(rows) + "\n"


def _share(held: Sequence[bool]) -> str:
    return f"{100.0 * np.mean(held):.1f} %" if held else ""
