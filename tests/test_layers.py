"""The layers of ``pyproject.toml``: kept as the code is, broken by an import upwards."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINT = Path(sys.executable).with_name("lint-imports")
PLANTED = {
    "Data flow one way": ("sysid/fluidact_fit/units.py", "fluidact_fit.fitting"),
    "Plants and controllers know neither each other nor the loop": (
        "sysid/fluidact_fit/control/plants/body.py",
        "fluidact_fit.control.loop",
    ),
    "Families know nothing of each other": (
        "sysid/fluidact_fit/families/hydraulic_motor.py",
        "fluidact_fit.families.potentiometer",
    ),
    "The library knows nothing of the command line": (
        "sysid/fluidact_fit/demo.py",
        "fluidact_fit_cli.show",
    ),
    "Only report draws": ("sysid/fluidact_fit/fitting.py", "matplotlib.figure"),
    "No circles": ("sysid/fluidact_fit/signals.py", "fluidact_fit.units"),
}


def lint_imports(root: Path) -> subprocess.CompletedProcess[str]:
    """Run import-linter on the sources under a directory."""
    paths = os.pathsep.join(str(root / name) for name in ("sysid", "cli"))
    return subprocess.run(
        [str(LINT), "--no-cache", "--no-logo"],
        cwd=root,
        env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The sources and their contracts, to be damaged."""
    for name in ("sysid", "cli"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def plant(root: Path, path: str, module: str) -> None:
    """Add an import to the end of a file, within a function as lazy ones are."""
    with (root / path).open("a", encoding="utf-8") as file:
        file.write(f"\n\ndef planted():\n    import {module}\n")


def test_contracts_hold(copy: Path) -> None:
    done = lint_imports(copy)
    assert done.returncode == 0, done.stdout
    assert "0 broken" in done.stdout


@pytest.mark.parametrize("contract", PLANTED)
def test_planted_import_is_found(contract: str, copy: Path) -> None:
    plant(copy, *PLANTED[contract])
    if contract == "No circles":
        plant(copy, "sysid/fluidact_fit/units.py", "fluidact_fit.signals")
    done = lint_imports(copy)
    assert done.returncode == 1
    assert f"{contract} BROKEN" in done.stdout


def test_module_without_a_layer_is_found(copy: Path) -> None:
    (copy / "sysid" / "fluidact_fit" / "utils.py").write_text("", encoding="utf-8")
    done = lint_imports(copy)
    assert done.returncode == 1
    assert "fluidact_fit.utils" in done.stdout
