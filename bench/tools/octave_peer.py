"""GNU Octave with its packages control and optim, through ``octave-cli``.

The time is what Octave's own clock says of the fit, without starting Octave.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from problems import Log

TITLE = "GNU Octave"


def version() -> str:
    """Version of Octave; raises when there is none."""
    program = shutil.which("octave-cli")
    if program is None:
        raise FileNotFoundError("octave-cli is not on PATH (Debian: octave octave-control "
                                "octave-optim)")  # fmt: skip
    said = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    return said.stdout.split("\n")[0].split()[-1]


class Timed(dict[str, float]):
    """Estimates with the seconds that the tool itself measured."""

    seconds: float = 0.0


def _fit(name: str) -> Any:
    def run(log: Log, guess: dict[str, float]) -> dict[str, float]:
        with tempfile.TemporaryDirectory() as directory:
            path = Path(directory) / "log.csv"
            np.savetxt(path, np.column_stack([log.t, log.u, log.y]), delimiter=",", fmt="%.17g")
            script = Path(__file__).with_name("octave_fit.m")
            start = "[" + " ".join(f"{v:.17g}" for v in guess.values()) + "]"
            said = subprocess.run(
                ["octave-cli", "-q", "--norc", str(script), name, str(path), start],
                capture_output=True,
                text=True,
            )
        found = re.search(r"THETA \[(.*)\]", said.stdout)
        seconds = re.search(r"SECONDS (\S+)", said.stdout)
        if found is None or seconds is None:
            raise RuntimeError(said.stderr.strip()[:200] or "no answer")
        theta = Timed(zip(guess, map(float, found[1].split())))
        theta.seconds = float(seconds[1])
        return theta

    return run


FITS = {"P1": _fit("P1"), "P2": _fit("P2"), "P2|n4sid": _fit("P2n4sid"), "P3": _fit("P3")}
