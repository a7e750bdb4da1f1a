"""The frame of every target: what is accepted, named, refused and written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
import yaml
from scipy.io import loadmat

import fluidact_fit as ff
from fluidact_fit.errors import NotIdentifiedError, OutputError, StrictError, UsageError
from fluidact_fit.export import TARGETS, export
from fluidact_fit.parameters import make_document

Edited = Callable[..., Path]


def declare_open(document: dict[str, Any], name: str) -> None:
    """Declare a parameter not identified."""
    entry = document["parameters"][name]
    document["parameters"][name] = {
        "value": entry["value"], "unit": entry["unit"], "status": "not_identified",
    }  # fmt: skip
    part = document["covariance"]
    gone = part["order"].index(name)
    del part["order"][gone], part["matrix"][gone]
    for row in part["matrix"]:
        del row[gone]


def failed(document: dict[str, Any]) -> None:
    document["fit"]["verdict"] = "fail"
    document["accepted_failed"] = True


@pytest.mark.parametrize("to", TARGETS)
def test_a_failed_fit_is_refused_unless_accepted(to: str, edited: Edited, tmp_path: Path) -> None:
    path, folder = edited("valve", failed), tmp_path / "out"
    with pytest.raises(StrictError, match="accept_failed"):
        export([path], to, folder)
    assert not folder.exists()
    assert_says(export([path], to, folder, accept_failed=True), "VERDICT FAIL")


@pytest.mark.parametrize("to", TARGETS)
def test_what_was_not_identified_is_refused_unless_accepted(
    to: str, edited: Edited, tmp_path: Path
) -> None:
    path = edited("line", lambda d: declare_open(d, "dead_time"))
    other = Path(ff.__file__).parents[2] / "tests/golden" / ff.__version__ / "valve.yaml"
    with pytest.raises(NotIdentifiedError, match="dead_time"):
        export([path], to, tmp_path / "out")
    with pytest.raises(NotIdentifiedError, match="dead_time"):
        export([path], to, tmp_path / "out", accept_not_identified=["gain"])
    with pytest.raises(UsageError, match="no-such"):
        export([path], to, tmp_path / "out", accept_not_identified=["no-such"])
    assert not (tmp_path / "out").exists()
    words: tuple[Any, ...] = (True, ["dead_time"])
    for number, word in enumerate(words):
        folder = tmp_path / str(number)
        written = export([path, other], to, folder, accept_not_identified=word)
        ours = [file for file in written if file.name.startswith("edited")]
        assert_says(ours, "NOT IDENTIFIED: dead_time")


SILENT = (".c",)  # stands beside a header that says it


def assert_says(files: list[Path], words: str) -> None:
    """Find the remark in every file, where its format has a place for it."""
    spoken = [file for file in files if file.suffix not in SILENT]
    assert spoken
    for file in spoken:
        if file.suffix == ".mat":
            (model,) = (v for k, v in loadmat(file).items() if not k.startswith("__"))
            assert words in model["remarks"][0, 0][0, 0].item()
        elif file.suffix == ".json":
            document = json.loads(file.read_text(encoding="ascii"))
            assert words in document["warnings"][-1]["message"]
            make_document(document, ff.get_family)  # is still a parameter document
        elif file.suffix == ".fmu":
            with ZipFile(file) as unit:
                assert words in unit.read("modelDescription.xml").decode()
                assert words in unit.read(f"sources/{file.stem}.c").decode()
        else:
            assert words in file.read_text(encoding="ascii").split("\n  model.")[0]


def test_two_files_of_one_name_are_refused(edited: Edited, tmp_path: Path) -> None:
    first = edited("valve", lambda d: None, "a-b.yaml")
    for name in ("a_b.yaml", "A b.yaml"):
        second = edited("line", lambda d: None, name)
        with pytest.raises(UsageError, match="both be exported as"):
            export([first, second], "json", tmp_path / "out")
    with pytest.raises(UsageError, match="both be exported as"):
        export([first, first], "json", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_target_and_an_arithmetic_it_does_not_know(
    edited: Edited, tmp_path: Path
) -> None:
    path = edited("valve", lambda d: None)
    with pytest.raises(UsageError, match=r"rust.*\n.*json"):
        export([path], "rust", tmp_path / "out")
    for arithmetic in ("float32", "q15"):
        with pytest.raises(UsageError, match="does not know"):
            export([path], "json", tmp_path / "out", arithmetic=arithmetic)
    assert not (tmp_path / "out").exists()


def test_existing_files_are_kept_unless_told_otherwise(edited: Edited, tmp_path: Path) -> None:
    path, folder = edited("valve", lambda d: None), tmp_path / "out"
    (folder / "edited.mat").mkdir(parents=True)
    (folder / "edited.mat").rmdir()
    (folder / "edited.mat").write_text("mine")
    with pytest.raises(OutputError, match="already exists"):
        export([path], "matlab", folder)
    assert [p.name for p in folder.iterdir()] == ["edited.mat"]
    assert (folder / "edited.mat").read_text() == "mine"
    export([path], "matlab", folder, overwrite=True)
    assert loadmat(folder / "edited.mat")["edited"]["family"].item() == "valve"


def test_one_file_is_exported_by_its_name_alone(edited: Edited, tmp_path: Path) -> None:
    written = ff.export(str(edited("valve", lambda d: None)), to="json", folder=tmp_path / "out")
    assert written == [tmp_path / "out" / "edited.json"]
    assert str(written[0]) in written.summary()
    assert str(written[0]) in written._repr_html_()


def test_no_file_of_several_stays_half_made(edited: Edited, tmp_path: Path) -> None:
    """The third file of the second parameter file cannot be written."""
    first = edited("line", lambda d: None, "first.yaml")
    second, folder = edited("valve", lambda d: None, "second.yaml"), tmp_path / "out"
    (folder / "second.metadata.yaml").mkdir(parents=True)
    (folder / "second.ros2.yaml").write_text("old")
    with pytest.raises(OutputError, match="directory"):
        export([first, second], "ros2", folder, overwrite=True)
    left = {p.name for p in folder.iterdir()}
    assert {name for name in left if name.startswith("second")} == {
        "second.metadata.yaml", "second.ros2.yaml",
    }  # fmt: skip
    assert (folder / "second.ros2.yaml").read_text() == "old"
    for name in left - {"second.metadata.yaml", "second.ros2.yaml"}:
        assert yaml.safe_load((folder / name).read_text(encoding="utf-8"))


def test_a_file_that_is_read_is_not_overwritten(edited: Edited, tmp_path: Path) -> None:
    path = edited("valve", lambda d: None, "valve.yaml")
    link = tmp_path / "valve.json"
    link.symlink_to(path)
    with pytest.raises(UsageError, match="would be overwritten"):
        export([path], "json", tmp_path, overwrite=True)
    assert ff.read_document(path).family == "valve"


def test_a_folder_that_cannot_be_made(edited: Edited, tmp_path: Path) -> None:
    path = edited("valve", lambda d: None)
    for folder in (path, path / "out"):
        with pytest.raises(OutputError):
            export([path], "json", folder)
    for name in ("a\0b", ""):
        with pytest.raises(UsageError, match="folder"):
            export([path], "json", name)
