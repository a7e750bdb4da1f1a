"""The demo: what it writes, what it says, and that it refuses to overwrite."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import fluidact_fit as ff
from fluidact_fit import demo

QUICK = ("line", "valve")


@pytest.fixture
def two_families(monkeypatch: pytest.MonkeyPatch) -> None:
    """All six take half a minute; two show the same."""
    monkeypatch.setattr(demo, "family_names", lambda: QUICK)


@pytest.mark.usefixtures("two_families")
def test_demo_writes_files_and_a_table(tmp_path: Path) -> None:
    said: list[str] = []
    target = tmp_path / "new" / "demo"
    assert demo.run_demo(target, said.append) == 0
    assert sorted(p.name for p in target.iterdir()) == [
        f"{family}{end}" for family in QUICK for end in (".png", ".yaml")
    ]
    for family in QUICK:
        assert ff.read_document(target / f"{family}.yaml").family == family
        assert (target / f"{family}.png").read_bytes().startswith(b"\x89PNG")
    text = "\n".join(said)
    for word in ("time_constant", "dead_time", "damping_ratio", "±", "standard errors"):
        assert word in text


@pytest.mark.usefixtures("two_families")
def test_demo_keeps_files_of_an_earlier_run(tmp_path: Path) -> None:
    (tmp_path / "valve.yaml").write_text("mine", encoding="utf-8")
    with pytest.raises(ff.OutputError, match=r"valve\.yaml already exists"):
        demo.run_demo(tmp_path, lambda line: None)
    assert (tmp_path / "valve.yaml").read_text(encoding="utf-8") == "mine"
    assert demo.run_demo(tmp_path, lambda line: None, overwrite=True) == 0
    assert ff.read_document(tmp_path / "valve.yaml").family == "valve"


def test_demo_names_a_directory_it_cannot_make(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ff.OutputError, match="cannot be created"):
        demo.run_demo(tmp_path / "file" / "below", lambda line: None)


@pytest.mark.usefixtures("two_families")
def test_demo_fails_when_a_truth_is_missed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = demo.load_dataset

    def lie(family: str) -> demo.Dataset:
        dataset = real(family)
        truth = {k: {**v, "value": 1.1 * v["value"]} for k, v in dataset.truth.items()}
        return dataclasses.replace(dataset, truth=truth)

    monkeypatch.setattr(demo, "load_dataset", lie)
    said: list[str] = []
    assert demo.run_demo(tmp_path, said.append) == 1
    assert "\n".join(said).count("<- missed") == 6
    assert "6 of 6 true values were missed" in said[-1]


@pytest.mark.parametrize("family", ff.family_names())
def test_dataset_names_what_the_family_knows(family: str) -> None:
    dataset, known = demo.load_dataset(family), ff.get_family(family)
    assert len(dataset.logs) == 3
    assert known.options_type.read(dataset.options)
    parameters = {p.name for v in known.variants for p in v.parameters}
    assert set(dataset.truth) <= parameters
    for log in dataset.read():
        assert log.rows >= 400


def test_missing_datasets_are_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "files", lambda package: tmp_path)
    monkeypatch.setattr(demo, "__file__", str(tmp_path / "a" / "b" / "demo.py"))
    with pytest.raises(ff.OutputError, match="not part of this installation"):
        demo.find_datasets()
