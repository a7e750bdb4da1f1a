"""The committed logs: unchanged, reproducible, small, and fitted to their truth."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from dataset_fits import fit_dataset
from fluidact_fit.demo import compare, load_dataset
from fluidact_fit.experiment import Experiment, Signal
from fluidact_fit.family import Plant
from fluidact_fit.notices import CODES

ROOT = Path(__file__).parents[1] / "datasets"
FAMILIES = ff.family_names()
GENERATORS = [ROOT / "generate.py", *sorted((ROOT / "generators").glob("*.py"))]
NORMAL_999 = 3.2905  # two-sided 99.9 % quantile of the normal distribution
NORMAL_95 = 1.95996


def test_every_family_has_a_dataset() -> None:
    for family in FAMILIES:
        assert (ROOT / family / "truth.yaml").is_file(), family


def test_checksums() -> None:
    lines = (ROOT / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    listed = dict(reversed(line.split("  ")) for line in lines)
    kinds = (".csv", ".md", ".yaml")
    present = {p.relative_to(ROOT).as_posix() for p in ROOT.glob("*/*.*") if p.suffix in kinds}
    assert set(listed) == present, "run datasets/generate.py"
    for name, expected in listed.items():
        assert hashlib.sha256((ROOT / name).read_bytes()).hexdigest() == expected, name


def test_generators_write_the_same_bytes(tmp_path: Path) -> None:
    subprocess.run([sys.executable, str(GENERATORS[0]), "--output", str(tmp_path)], check=True)
    made = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file())
    assert len(made) >= 5 * len(FAMILIES) + 1
    for path in made:
        assert (tmp_path / path).read_bytes() == (ROOT / path).read_bytes(), path


@pytest.mark.parametrize("script", GENERATORS, ids=lambda script: script.name)
def test_generator_shares_no_code_with_the_package(script: Path) -> None:
    lines = script.read_text(encoding="utf-8").splitlines()
    imports = [line for line in lines if line.startswith(("import ", "from "))]
    assert not any("fluidact_fit" in line or "scipy" in line for line in imports)


def test_files_are_small() -> None:
    for path in ROOT.rglob("*.csv"):
        assert path.stat().st_size <= 100_000, path


@pytest.mark.parametrize("family", FAMILIES)
def test_readme_says_where_the_numbers_come_from(family: str) -> None:
    text = (ROOT / family / "README.md").read_text(encoding="utf-8")
    dataset = load_dataset(family)
    assert "**Synthetic**" in text
    assert "seed" in text
    for name in dataset.truth:
        row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
        assert ("| published" in row) != ("| **invented**" in row)
    for header in dataset.columns.values():
        assert f"`{header}`" in text


@pytest.mark.parametrize("family", FAMILIES)
def test_truth_is_recovered(family: str) -> None:
    # A network has no true weights: it has to fit. Which of several optima its training ends in
    # hangs on the last digit of a sum, which processors round differently: 97.6 to 98.1 % of six.
    if not load_dataset(family).truth:
        assert fit_dataset(family).document.fit.fit_percent > 97.0
        return
    rows = compare(load_dataset(family), fit_dataset(family))
    assert rows
    assert not any(row[-1] for row in rows), [row for row in rows if row[-1]]


@pytest.mark.parametrize("family", [f for f in FAMILIES if f != "potentiometer"])
def test_truth_lies_in_the_interval(family: str) -> None:
    result = fit_dataset(family)
    for name, truth in load_dataset(family).truth.items():
        found = result.parameters[name]
        assert found.status == "estimated", name
        assert isinstance(found.value, float)
        low, high = (
            found.value + (end - found.value) * NORMAL_999 / NORMAL_95 for end in found.ci95
        )
        assert low <= truth["value"] <= high, name


@pytest.mark.parametrize("family", FAMILIES)
def test_logs_raise_no_warning(family: str) -> None:
    result = fit_dataset(family)
    warned = [n.message for n in result.notices if CODES[n.code].severity == "warning"]
    assert warned == []
    assert result.verdict == "pass"


def test_potentiometer_curve_is_the_true_one_everywhere() -> None:
    dataset, result = load_dataset("potentiometer"), fit_dataset("potentiometer")
    family = ff.get_family("potentiometer")
    true = {name: entry["value"] for name, entry in dataset.truth.items()}
    reading = np.arange(40.0, 985.0)
    signal = Signal("reading", np.zeros(0), reading, "1")
    run = Experiment("readings", 0, np.zeros(0), {"reading": signal}, 0.0, False)
    curves = [
        family.simulate(Plant(result.variant, values, result.solution.options), [run])[0].output
        for values in (result.solution.values, true)
    ]
    difference = curves[0] - curves[1]
    assert np.sqrt(np.mean(difference**2)) < 2e-5
