"""What Octave makes of a .m and .mat file: the same numbers, and the discrete model of the fit."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.export import export

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__


@cache
def octave_is_here() -> bool:
    """Whether there is an Octave with its control package."""
    if shutil.which("octave-cli") is None:
        return False
    command = ["octave-cli", "-q", "--eval", "pkg load control"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def run_octave(code: str, folder: Path) -> list[list[float]]:
    """Run code that calls ``say(matrix)``; return what it said, bit by bit."""
    if not octave_is_here():
        pytest.skip("octave-cli with the control package is not installed")
    (folder / "say.m").write_text(
        "function say(x)\n  h = num2hex(x.'(:));\n  for i = 1:rows(h)\n"
        "    printf('%s ', h(i, :));\n  end\n  printf('\\n');\nend\n",
        encoding="ascii",
    )
    done = subprocess.run(
        ["octave-cli", "-q", "--norc", "--eval", f"pkg load control;\n{code}"],
        cwd=folder, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [
        [np.frombuffer(bytes.fromhex(h), ">f8").item() for h in line.split()]
        for line in done.stdout.splitlines()
    ]


def model_of(family: str) -> dict[str, Any]:
    text = (GOLDEN / f"{family}.yaml").read_text(encoding="utf-8")
    document: dict[str, Any] = yaml.safe_load(text)
    return document


def test_every_number_of_every_family(parameter_file: Path, tmp_path: Path) -> None:
    """From the function and from the .mat file, as bits."""
    export([parameter_file], "matlab", tmp_path)
    name = parameter_file.stem.replace("-", "_")
    due = yaml.safe_load(parameter_file.read_text(encoding="utf-8"))["parameters"]
    said = "".join(f"say({{}}.parameters.{n});\n" for n in due)
    code = f"m = {name}();\n{said.replace('{}', 'm')}"
    code += f"s = load('{name}.mat');\n{said.replace('{}', f's.{name}')}"
    found = run_octave(code, tmp_path)
    values = [np.ravel(entry["value"]).tolist() for entry in due.values()]
    assert found == values * 2


@pytest.mark.parametrize("family", ["valve", "hydrostatic"])
def test_c2d_gives_the_discrete_model(family: str, tmp_path: Path) -> None:
    export([GOLDEN / f"{family}.yaml"], "matlab", tmp_path)
    found = run_octave(
        f"m = {family}(); say(m.discrete.num{{1}}); say(m.discrete.den{{1}});\n"
        "d = c2d(m.continuous, m.discrete.tsam, 'zoh'); say(d.num{1}); say(d.den{1});\n"
        "d = tf(c2d(m.state_space, m.discrete.tsam)); say(d.num{1}); say(d.den{1});\n",
        tmp_path,
    )
    due = model_of(family)["model"]["discrete"]
    numerator, denominator = np.trim_zeros(due["numerator"], "f"), due["denominator"]
    for num, den in zip(found[::2], found[1::2]):
        np.testing.assert_allclose(np.trim_zeros(num, "f"), numerator, rtol=1e-9)
        np.testing.assert_allclose(den, denominator, rtol=1e-9)


def test_c2d_gives_the_discrete_model_of_a_line_with_its_dead_time(tmp_path: Path) -> None:
    """Two parts of a period, each sampled by Octave, make a dead time of one and a half."""
    export([GOLDEN / "line.yaml"], "matlab", tmp_path)
    found = run_octave(
        "m = line(); T = m.discrete.tsam; late = mod(m.dead_time, T);\n"
        "a = ss(c2d(m.state_space, late)); b = ss(c2d(m.state_space, T - late));\n"
        "say(a.c * b.b); say(a.c * b.a * a.b); say(a.a * b.a);\n"
        "say(m.discrete.num{1}); say(m.discrete.den{1}); say(m.dead_time);\n",
        tmp_path,
    )
    new, old, pole, num, den, dead_time = found
    due = model_of("line")["model"]
    assert dead_time == [due["continuous"]["dead_time"]]
    np.testing.assert_allclose(num, np.trim_zeros(due["discrete"]["numerator"], "f"), rtol=0.0)
    # one whole period in the numerator, then what is new and what is left of the older input
    np.testing.assert_allclose(num, [*new, *old], rtol=1e-9)
    np.testing.assert_allclose(den, [1.0, -pole[0], 0.0, 0.0], rtol=1e-9)
