"""Logs with a known truth, and two ways to run the program: in this process and in one of its own.

All logs here are synthetic: first- and second-order responses of simple input patterns, made by
exact recursions of the test itself.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fluidact_fit_cli.main import run


@dataclass(frozen=True)
class Outcome:
    """What a run left behind."""

    status: int
    out: str
    err: str


def run_here(*args: str) -> Outcome:
    """Run the program in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([str(a) for a in args])
    return Outcome(status, out.getvalue(), err.getvalue())


def run_apart(*args: str, cwd: Path | None = None, timeout: float = 180.0) -> Outcome:
    """Run the program in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "fluidact_fit_cli.main", *map(str, args)],
        capture_output=True, text=True, cwd=cwd, timeout=timeout, check=False,
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    return Outcome(done.returncode, done.stdout, done.stderr)


def write_table(path: Path, headers: Sequence[str], columns: Sequence[np.ndarray]) -> Path:
    """Write a CSV log."""
    rows = [",".join(f"{v:.9g}" for v in row) for row in zip(*columns)]
    path.write_text("\n".join([",".join(headers), *rows]) + "\n", encoding="utf-8")
    return path


def valve_log(path: Path, gain: float = 1000.0, noise: float = 2.0, seed: int = 1) -> Path:
    """Second-order valve, 20 rad/s, damping 0.5, held command, 100 Hz."""
    rng = np.random.default_rng(seed)
    wn, zeta, step = 20.0, 0.5, 0.01
    command = np.repeat(rng.choice([0.0, 2.0, 4.0], 16), 20)
    # Exact response to a held input: x' = Ax + Bu by the exponential of A over one step.
    a = np.array([[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]])
    values, vectors = np.linalg.eig(a)
    phi = np.real(vectors @ np.diag(np.exp(values * step)) @ np.linalg.inv(vectors))
    x, outlet = np.zeros(2), []
    for u in command:
        outlet.append(x[0])
        rest = np.array([gain * u, 0.0])
        x = rest + phi @ (x - rest)
    measured = np.array(outlet) + noise * rng.normal(size=len(outlet))
    time = step * np.arange(command.size)
    return write_table(path, ["time [s]", "command [V]", "outlet [Pa]"], [time, command, measured])


@pytest.fixture
def here() -> Callable[..., Outcome]:
    """Run the program in this process."""
    return run_here


@pytest.fixture
def apart() -> Callable[..., Outcome]:
    """Run the program in a process of its own."""
    return run_apart


@pytest.fixture(scope="session")
def write_valve() -> Callable[..., Path]:
    """Writes a valve log wherever it is told to."""
    return valve_log


@pytest.fixture
def valve(tmp_path: Path) -> Callable[..., Path]:
    """Writes a valve log into the test's directory."""
    return lambda name="valve.csv", **kwargs: valve_log(tmp_path / name, **kwargs)


@pytest.fixture
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work inside the test's directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
