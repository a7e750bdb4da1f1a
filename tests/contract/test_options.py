"""Options of a family mean the same in Python and on the command line, each in its own words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fluidact_fit as ff


def wrong_values(option: Any) -> Iterator[tuple[Any, str | None]]:
    """Values that an option cannot have, in Python and, where they can be said, as text."""
    if option.kind in ("float", "int"):
        yield "five", "five"
        yield math.nan, "nan"
        yield True, None
        for value in (option.minimum - 1.0, option.above, option.maximum + 1.0):
            if math.isfinite(value):
                yield value, f"{value:.9g}"
    if option.kind == "int":
        yield 2.5, "2.5"
    if option.kind == "choice":
        yield "no-such-choice", "no-such-choice"
    if option.kind == "range":
        yield "five", "five"
        yield (2.0, 1.0), "2:1"
    if option.kind == "flag":
        yield "maybe", None
    if option.kind == "text":
        yield 2.5, None


def cases(trial: Any) -> Iterator[tuple[str, Any, str | None]]:
    """Name of an option, and a value that it cannot have, twice."""
    from fluidact_fit.options import describe

    for option in describe(ff.get_family(trial.family).options_type):
        for value, text in wrong_values(option):
            yield option.name, value, text


def complaint_in_python(trial: Any, **options: Any) -> str:
    """What ``fit`` says of options; empty when it takes them."""
    try:
        ff.fit(trial.family, trial.read(), **{**trial.options, **options})
    except ff.UsageError as error:
        return str(error)
    except Exception as error:
        return f"{type(error).__name__} instead of a UsageError: {error}"
    return ""


def test_python_refuses_wrong_values(trial: Any) -> None:
    wrong = []
    for name, value, _ in cases(trial):
        word = name.replace("-", "_")
        said = complaint_in_python(trial, **{word: value})
        if f"{word}=" not in said or "--" in said:
            wrong.append((word, value, said))
    assert not wrong


def test_the_command_line_refuses_the_same_values(
    trial: Any, here: Callable[..., Any], tmp_path: Path
) -> None:
    target, wrong = tmp_path / "never.yaml", []
    for name, _, text in cases(trial):
        if text is None:
            continue
        done = here(*trial.command(target), f"--{name}={text}")
        if done.status != 2 or f"--{name}" not in done.err:
            wrong.append((name, text, done.status, done.err))
    assert not wrong
    assert not target.exists()


def test_an_unknown_option_is_refused_alike(
    trial: Any, here: Callable[..., Any], tmp_path: Path
) -> None:
    done = here(*trial.command(tmp_path / "never.yaml"), "--no-such-option", "1")
    assert done.status == 2
    assert "--no-such-option" in done.err
    said = complaint_in_python(trial, no_such_option=1)
    assert "no_such_option" in said
    assert "--" not in said


def test_help_and_description_name_the_same_options(trial: Any, here: Callable[..., Any]) -> None:
    from fluidact_fit.options import describe

    text = here(trial.family, "--help-all").out
    for option in describe(ff.get_family(trial.family).options_type):
        assert f"--{option.name}" in text
        assert option.help
