"""Nothing that a command writes touches what it reads, and only regular files are either."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import OutputError
from fluidact_fit.files import FileSet
from hanging import ended_after

Log = Callable[..., Path]
Run = Callable[..., Any]
posix = pytest.mark.skipif(os.name != "posix", reason="POSIX links, devices and pipes")


@pytest.fixture(autouse=True)
def patience() -> Iterator[None]:
    """End a test that waits for ever."""
    with ended_after(60):
        yield


@contextmanager
def kept(folder: Path) -> Iterator[None]:
    """Every file of a folder is as it was before, and there is no other."""

    def content() -> dict[str, bytes]:
        return {str(p): p.read_bytes() for p in folder.rglob("*") if p.is_file()}

    before = content()
    yield
    assert content() == before


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, two halves of it, and a parameter file."""
    folder = tmp_path_factory.mktemp("fitted")
    rng = np.random.default_rng(0)
    u, y = np.repeat(rng.choice([1.0, 2.0, 4.0], 30), 10), [1.0]
    for value in u[:-1]:
        y.append(y[-1] + (value - y[-1]) * 0.1)
    rows = zip(0.01 * np.arange(u.size), u, np.array(y) + 0.001 * rng.normal(size=u.size))
    table = [
        ["time [s]", "inlet [Pa]", "outlet [Pa]"],
        *([f"{v:.9g}" for v in row] for row in rows),
    ]
    for name, columns in (("a.csv", (0, 1, 2)), ("p.csv", (0, 1)), ("q.csv", (0, 2))):
        text = "".join(",".join(row[k] for k in columns) + "\n" for row in table)
        (folder / name).write_text(text)
    ff.fit("line", [folder / "a.csv"]).save(folder / "line.yaml")
    return folder


@pytest.fixture
def files(inside: Path, fitted: Path) -> Path:
    """The same, with links."""
    shutil.copytree(fitted, inside, dirs_exist_ok=True)
    os.link("a.csv", "hard.csv")
    os.symlink("a.csv", "soft.csv")
    os.mkdir("sub")
    os.symlink("..", "sub/up")
    return inside


@posix
@pytest.mark.parametrize("words", [
    "line a.csv -o a.csv",
    "line a.csv -o hard.csv",
    "line a.csv -o soft.csv",
    "line a.csv -o sub/../a.csv",
    "line a.csv -o sub/up/a.csv",
    "line a.csv -o A.CSV",
    "line soft.csv -o a.csv",
    "line p.csv+q.csv -o q.csv",
    "line ./p.csv+sub/up/q.csv -o p.csv",
    "line p.csv --validate q.csv -o q.csv",
    "line p.csv --validate a.csv+q.csv -o a.csv",
    "simulate line.yaml a.csv -o line.yaml",
    "simulate line.yaml a.csv -o hard.csv",
    "simulate line.yaml p.csv+q.csv -o p.csv",
    "design line --from line.yaml -o line.yaml",
    "export line.yaml --to json -o . --accept-not-identified all",
    "line a.csv -o fit.yaml --plot fit.svg --report fit.html",
])  # fmt: skip
def test_no_output_touches_an_input(words: str, files: Path, here: Run) -> None:
    if "export" in words:
        os.symlink("line.yaml", "line.json")
    if "--report" in words:
        os.symlink("fit.svg", "fit.html")
    with kept(files):
        done = here(*words.split(), "-f")
    assert done.status == 2, done.err
    assert "read" in done.err or "both name" in done.err


@posix
@pytest.mark.parametrize("kind", ["pipe", "socket", "loop", "device"])
@pytest.mark.parametrize("words", [
    "line a.csv -o X",
    "line a.csv -o v.yaml --plot X.svg",
    "simulate line.yaml a.csv -o X",
    "design line --from line.yaml -o X",
    "report line.yaml -o X.html",
    "line X", "line a.csv --validate X", "line X+a.csv", "inspect X", "compare a.csv X",
    "check X a.csv", "check line.yaml X", "simulate X a.csv", "report X", "export X --to c",
    "check-consumer line.yaml X", "check-consumer X line.yaml", "design line --from X",
    "compare line.yaml X.yaml", "batch X -o out", "batch X.yaml -o out",
    "simulate line.yaml --controller X --reference step",
])  # fmt: skip
def test_only_regular_files_are_read_and_written(
    words: str, kind: str, files: Path, here: Run
) -> None:
    places = [word for word in words.replace("+", " ").split() if word.startswith("X")]
    for place in places:
        if kind == "pipe":
            os.mkfifo(place)
        elif kind == "socket":
            with socket.socket(socket.AF_UNIX) as made:
                made.bind(place)
        else:
            os.symlink(place if kind == "loop" else "/dev/zero", place)
    with kept(files):
        done = here(*words.split(), *(["-f"] if words.startswith("line") or " -o" in words else []))
    assert done.status in (2, 3), done.err
    assert "Traceback" not in done.err
    assert any(place in done.err for place in places)


def test_a_link_that_turns_during_a_fit_is_seen(
    files: Path, here: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fluidact_fit_cli.commands import fit_family as fit

    os.symlink("new.yaml", "out.yaml")
    real = fit.render_files

    def render(*args: Any) -> Any:
        os.unlink("out.yaml")
        os.symlink("a.csv", "out.yaml")
        return real(*args)

    monkeypatch.setattr(fit, "render_files", render)
    before = (files / "a.csv").read_bytes()
    done = here("line", "a.csv", "-o", "out.yaml", "-f")
    assert done.status == 3
    assert "would be overwritten" in done.err
    assert (files / "a.csv").read_bytes() == before


def test_a_result_knows_its_logs(files: Path) -> None:
    result = ff.fit(
        "line", ["p.csv+q.csv"], window=(0, 2), validate=["a.csv"], validate_window=(2, None)
    )
    with kept(files):
        for name in ("p.csv", "q.csv", "a.csv", str(files / "a.csv"), "soft.csv"):
            with pytest.raises(OutputError, match="would be overwritten"):
                result.save(name, overwrite=True)


@posix
def test_what_comes_by_standard_input_is_read(files: Path) -> None:
    words = [sys.executable, "-m", "fluidact_fit_cli.main", "line", "-", "-f", "-o"]
    for name in ("a.csv", "hard.csv", "soft.csv"):
        with kept(files), (files / "a.csv").open("rb") as log:
            done = subprocess.run(
                [*words, name], stdin=log, capture_output=True, text=True, check=False
            )
        assert done.returncode == 2
        assert "would be overwritten" in done.stderr


def test_files_of_one_name_and_names_of_one_file(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    known = FileSet([tmp_path / "a", tmp_path / "Später.csv"])
    known.add("b", "the other")
    assert known.find(tmp_path / "x" / ".." / "a") == str(tmp_path / "a")
    assert known.find(tmp_path / "SPÄTER.csv")
    assert known.find(tmp_path / "Spa\u0308ter.csv")
    assert known.find(Path.cwd() / "b") == "the other"
    assert known.find(tmp_path / "b") is None


def test_a_file_called_like_standard_input(files: Path, here: Run) -> None:
    os.rename("p.csv", "-")
    done = here("inspect", "./-")
    assert done.status == 0, done.err
    assert done.out.startswith("-: 300 rows")


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        ("line a.csv -o -", "Give a file name, or --json"),
        ("report line.yaml -o -", "Give a file name."),
        ("export line.yaml --to c -o -", "Give the name of a folder, or . for"),
        ("batch --family line --logs a.csv -o -", "Give the name of a folder, or . for"),
    ],
)
def test_a_dash_is_no_name_of_an_output(words: str, remedy: str, files: Path, here: Run) -> None:
    with kept(files):
        done = here(*words.split())
    assert done.status == 2
    assert "-o - is not supported" in done.err.replace("--output", "-o")
    assert remedy in done.err


def test_a_simulation_goes_to_standard_output_by_a_dash_too(files: Path, here: Run) -> None:
    with kept(files):
        with_dash = here("simulate", "line.yaml", "a.csv", "-o", "-")
        without = here("simulate", "line.yaml", "a.csv")
    assert with_dash.status == 0, with_dash.err
    assert with_dash.out == without.out
