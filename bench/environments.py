"""Private environments of the other tools, from the pinned ``requirements-*.txt``.

    python bench/environments.py [--directory .bench]

An environment is made once and made anew when its requirements change. One that cannot be
made is remembered with what pip said, and its tools are listed with that reason.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
OWN = "fluidact"

# tool: environment
TOOLS = {
    OWN: "",
    "scipy_reference": "core",
    "lmfit_peer": "core",
    "casadi_peer": "core",
    "jaxsysid_peer": "jaxsysid",
    "gekko_peer": "gekko",
    "control_peer": "core",
    "nfoursid_peer": "nfoursid",
    "sippy_peer": "sippy",
    "pysid_peer": "pysid",
    "sysidentpy_peer": "sysidentpy",
    "pysindy_peer": "pysindy",
    "tfest_peer": "tfest",
    "nlhw_like": "core",
    "wpilib_like": "core",
    "octave_peer": "core",
}


def python_of(tool: str, directory: Path) -> str:
    """Interpreter that runs a tool; raises ``RuntimeError`` with the reason it has none."""
    name = TOOLS[tool]
    if not name:
        return sys.executable
    failed = directory / name / "failed.txt"
    if failed.exists():
        raise RuntimeError(failed.read_text(encoding="utf-8").strip())
    if not (directory / name / "installed.txt").exists():
        raise RuntimeError("its environment has not been made")
    return str(directory / name / "bin" / "python")


def make(name: str, directory: Path) -> None:
    """Make one environment unless it stands already."""
    place = directory / name
    wanted = (HERE / f"requirements-{name}.txt").read_text(encoding="utf-8")
    installed, failed = place / "installed.txt", place / "failed.txt"
    if installed.exists() and installed.read_text(encoding="utf-8") == wanted:
        return
    sys.stderr.write(f"{name}: installing\n")
    subprocess.run([sys.executable, "-m", "venv", "--clear", str(place)], check=True)
    pip = [str(place / "bin" / "python"), "-m", "pip", "install", "--quiet"]
    pip += ["--disable-pip-version-check"]
    first = HERE / f"requirements-{name}-first.txt"
    commands = [[*pip, "-r", str(HERE / f"requirements-{name}.txt")]]
    if first.exists():  # a package whose setup needs others to be there already
        commands = [[*pip, "-r", str(first)], [*commands[0], "--no-build-isolation"]]
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            break
    if done.returncode == 0:
        installed.write_text(wanted, encoding="utf-8")
        return
    errors = [t for t in done.stderr.splitlines() if t.strip().lower().startswith("error")]
    reason = errors[-1].strip() if errors else f"pip ended with status {done.returncode}"
    failed.write_text(f"pip cannot install it: {reason}"[:300] + "\n", encoding="utf-8")
    sys.stderr.write(f"{name}: {reason}\n")


def main() -> int:
    """Make all environments, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--directory", type=Path, default=HERE.parent / ".bench")
    directory = parser.parse_args().directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    for name in dict.fromkeys(filter(None, TOOLS.values())):
        make(name, directory)
    return 0


if __name__ == "__main__":
    sys.exit(main())
