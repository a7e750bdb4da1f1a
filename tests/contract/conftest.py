"""One fit of every family, shared by the contract tests.

The registry says which families there are, the dataset of a family how it is fitted: its columns,
options and command line. A new family is covered as soon as it has a dataset. Logs are shortened,
because what is tested here is agreement and not precision.
"""

from __future__ import annotations

import contextlib
import copy
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.families import family_names
from fluidact_fit_cli.main import run

ROWS = 400  # of each log


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    status: int
    out: str
    err: str


def run_here(*args: object) -> Outcome:
    """Run the program in this process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run([str(a) for a in args])
    return Outcome(status, out.getvalue(), err.getvalue())


@dataclass(frozen=True)
class Trial:
    """Logs of a family, how they are read and fitted, and where the result stands.

    ``columns`` and ``options`` are for Python, ``arguments`` are the same for the command line.
    """

    family: str
    folder: Path
    logs: tuple[Path, ...]
    columns: Mapping[str, str]
    options: Mapping[str, Any]
    arguments: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The parameter file."""
        return self.folder / f"{self.family}.yaml"

    @property
    def raw(self) -> dict[str, Any]:
        """The parameter file as any YAML library reads it."""
        found: dict[str, Any] = yaml.safe_load(self.path.read_text(encoding="utf-8"))
        return found

    @property
    def document(self) -> Any:
        """The parameter file as the package reads it."""
        return ff.read_document(self.path)

    @property
    def variant(self) -> Any:
        """The variant that was fitted."""
        variants, name = ff.get_family(self.family).variants, self.raw.get("variant")
        return next((v for v in variants if v.name == name), variants[0])

    @property
    def inputs(self) -> list[str]:
        """Names of the roles that the model needs to be simulated."""
        return [
            r.name for r in self.variant.roles if r.required and not r.output and r.name != "time"
        ]

    def command(self, output: Path) -> list[str]:
        """The command line that fits the logs."""
        return [self.family, *map(str, self.logs), *self.arguments, "-o", str(output)]

    def read(self, paths: Sequence[Path] | None = None) -> list[Any]:
        """Read logs as the dataset says, all of them unless told otherwise."""
        paths = self.logs if paths is None else paths
        return [ff.read_log(path, columns=present(path, self.columns)) for path in paths]

    def edit(self, path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
        """Write a copy of the parameter file with something changed by hand."""
        edited = copy.deepcopy(self.raw)
        change(edited)
        path.write_text(yaml.safe_dump(edited, sort_keys=False), encoding="utf-8")
        return path

    def drop_output(self, log: Path, path: Path) -> Path:
        """Write a copy of a log without the column that is compared with the model."""
        columns = self.raw["provenance"]["logs"][0]["columns"]
        header = columns[self.variant.output.name]["header"]
        lines = log.read_text(encoding="utf-8").splitlines()
        mark = delimiter(lines[0])
        gone = lines[0].split(mark).index(header)
        kept = (mark.join(c for i, c in enumerate(x.split(mark)) if i != gone) for x in lines)
        path.write_text("\n".join(kept) + "\n", encoding="utf-8")
        return path


def delimiter(line: str) -> str:
    """What separates the columns of a log."""
    return ";" if ";" in line else ","


def present(path: Path, columns: Mapping[str, str]) -> dict[str, str]:
    """Columns that a log still has."""
    head = path.read_text(encoding="utf-8").splitlines()[0]
    headers = head.split(delimiter(head))
    return {role: header for role, header in columns.items() if header in headers}


def shorten(log: Path, path: Path) -> Path:
    """Write the header and the first rows of a log."""
    lines = log.read_text(encoding="utf-8").splitlines()[: ROWS + 1]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def make_trial(family: str, folder: Path, copy_log: Callable[[Path, Path], Path]) -> Trial:
    """Copy the logs of a family's dataset into a folder."""
    dataset = load_dataset(family)
    truth = (dataset.logs[0].parent / "truth.yaml").read_text(encoding="utf-8")
    return Trial(
        family,
        folder,
        tuple(copy_log(log, folder / log.name) for log in dataset.logs),
        dataset.columns,
        dataset.options,
        tuple(yaml.safe_load(truth)["arguments"]),
    )


@pytest.fixture
def here() -> Callable[..., Outcome]:
    """Run the program in this process."""
    return run_here


@pytest.fixture(scope="session", params=family_names())
def trial(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """A family, its logs and the file that the command line made of them."""
    made = make_trial(request.param, tmp_path_factory.mktemp(request.param), shorten)
    done = run_here(*made.command(made.path))
    assert done.status == 0, done.err
    return made


@pytest.fixture(scope="session")
def joined(trial: Trial) -> Path:
    """All logs of a family in one file; time begins anew where a log began."""
    path = trial.folder / "joined.csv"
    texts = [log.read_text(encoding="utf-8").splitlines() for log in trial.logs]
    rows = [row for lines in texts for row in lines[1:]]
    path.write_text("\n".join([texts[0][0], *rows]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def result(trial: Trial, joined: Path) -> ff.FitResult:
    """The same samples fitted in Python, as runs of one log where time tells them apart."""
    logs = trial.read([joined] if "time" in trial.columns else None)
    return ff.fit(trial.family, logs, **trial.options)


@pytest.fixture
def dataset(tmp_path: Path) -> Callable[..., Trial]:
    """Copies the whole dataset of a family, changed on the way where asked."""

    def keep(log: Path, path: Path) -> Path:
        path.write_bytes(log.read_bytes())
        return path

    def make(family: str, copy_log: Callable[[Path, Path], Path] = keep) -> Trial:
        folder = tmp_path / family
        folder.mkdir()
        return make_trial(family, folder, copy_log)

    return make
