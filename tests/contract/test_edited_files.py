"""What was changed by hand is noticed by whoever reads the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff


def change_value(value: Any) -> Any:
    """Double a number, and of a list the entry that weighs most; zero becomes one."""
    if not isinstance(value, list):
        return 2.0 * value if value else 1.0
    sizes = [abs(v) if not isinstance(v, list) else max(map(abs, v)) for v in value]
    most = sizes.index(max(sizes))
    return [change_value(v) if i == most else v for i, v in enumerate(value)]


def edited(trial: Any, folder: Path) -> Iterator[tuple[str, Path]]:
    """One file for each parameter, that parameter changed.

    Its interval goes as well: a value outside its own interval shows without any model.
    """
    for name in trial.raw["parameters"]:

        def change(raw: dict[str, Any], name: str = name) -> None:
            entry = raw["parameters"][name]
            entry["value"] = change_value(entry["value"])
            entry.pop("ci95", None)

        yield name, trial.edit(folder / f"{name}.yaml", change)


def is_named(name: str, message: str) -> bool:
    return name in message or "model" in message


def test_an_edited_parameter_is_refused(trial: Any, tmp_path: Path) -> None:
    silent, unnamed = [], []
    for number, (name, path) in enumerate(edited(trial, tmp_path)):
        try:
            (ff.load if number else ff.read_document)(path)
        except ff.ParameterFileError as error:
            if not is_named(name, str(error)):
                unnamed.append(name)
        else:
            silent.append(name)
    assert not silent, "read as if nobody had touched them"
    assert not unnamed, "refused without saying what disagrees"


@pytest.mark.parametrize("command", ["check", "simulate", "design"])
def test_commands_refuse_an_edited_parameter(
    trial: Any, here: Callable[..., Any], tmp_path: Path, command: str
) -> None:
    name, path = next(edited(trial, tmp_path))
    words = {
        "check": ["check", path, *trial.logs],
        "simulate": ["simulate", path, trial.logs[0]],
        "design": ["design", trial.family, "--from", path, "--duration", "0.5"],
    }
    done = here(*words[command])
    assert done.status == 3, done.err
    assert path.name in done.err
    assert is_named(name, done.err.replace(path.name, ""))


def test_a_failed_fit_is_loaded_only_when_accepted(trial: Any, tmp_path: Path) -> None:
    def fail(raw: dict[str, Any]) -> None:
        raw["fit"]["verdict"] = "fail"
        raw["accepted_failed"] = True

    path = trial.edit(tmp_path / "failed.yaml", fail)
    with pytest.raises(ff.FluidactError, match="accept_failed"):
        ff.load(path)
    assert ff.load(path, accept_failed=True).verdict == "fail"


def test_an_untouched_file_is_loaded(trial: Any) -> None:
    assert ff.load(trial.path).family == trial.family


def test_a_covariance_that_was_removed_is_missed(trial: Any, tmp_path: Path) -> None:
    """Machines drawn from such a file were all the same: a band of no width."""
    if "covariance" not in trial.raw:
        pytest.skip("the family gives no standard errors")
    path = trial.edit(tmp_path / "a.yaml", lambda raw: raw.pop("covariance"))
    with pytest.raises(ff.ParameterFileError, match="covariance: missing"):
        ff.read_document(path)
