"""The page `docs/chip.md`: every line of it is run, in order."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "chip.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(sh|yaml)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("draws", [4, pytest.param(40, marks=pytest.mark.slow)])
def test_every_line_of_the_page_runs(draws: int, tmp_path: Path) -> None:
    assert "--draws 40" in PAGE
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    for kind, text in BLOCKS:
        if kind == "yaml":
            (tmp_path / "pd.yaml").write_text(text, encoding="utf-8")
            continue
        if text.startswith("avr-gcc") and shutil.which("avr-gcc") is None:
            continue
        text = text.replace("--draws 40", f"--draws {draws}")
        done = subprocess.run(
            ["bash", "-e", "-c", text], cwd=tmp_path, env={**os.environ, "PATH": path},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{text}\n{done.stderr}"
        if "--draws" in text:
            largest = re.search(r"largest error\s+(\S+)", done.stdout)
            margin = re.search(r"gain margin\s+(\S+)", done.stdout)
            assert largest is not None
            assert margin is not None
            assert (f"{1e3 * float(largest[1]):.1f}", f"{float(margin[1]):.1f}") == ("0.2", "3.8")
    made = {p.name for p in tmp_path.rglob("*") if p.is_file() and "datasets" not in p.parts}
    assert {"rig.yaml", "rig.png", "loop.png", "pd.h", "pd.c", "pd_selftest.c", "selftest"} <= made
