"""Errors in Python speak Python: no option of the command line stands in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff


def at_rest(trial: Any, path: Path) -> Path:
    """A log in which nothing but time moves."""
    lines = trial.logs[0].read_text(encoding="utf-8").splitlines()
    mark = ";" if ";" in lines[0] else ","
    head, first = lines[0].split(mark), lines[1].split(mark)
    moving = [header == trial.columns.get("time") for header in head]
    rows = [
        mark.join(
            cell if moves else still for cell, still, moves in zip(x.split(mark), first, moving)
        )
        for x in lines[1:]
    ]
    path.write_text("\n".join([lines[0], *rows]) + "\n", encoding="utf-8")
    return path


def mistakes(trial: Any, folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """Calls that cannot succeed."""
    scalars = [s.name for s in trial.variant.parameters if s.rank == 0]
    lists = [s.name for s in trial.variant.parameters if s.rank > 0]
    logs = trial.read()

    def call(**more: Any) -> Callable[[], object]:
        return lambda: ff.fit(trial.family, logs, **{**trial.options, **more})

    yield "unknown fixed", call(fixed={"no_such_parameter": 1.0})
    yield "unknown start", call(start={"no_such_parameter": 1.0})
    yield "unknown bounds", call(bounds={"no_such_parameter": (0.0, 1.0)})
    yield "unknown role", call(hold={"no_such_role": "zoh"})
    yield "unknown hold", call(hold=dict.fromkeys(trial.inputs, "wavy"))
    for name in scalars[:1]:
        yield "bounds reversed", call(bounds={name: (2.0, 1.0)})
        yield "not a number", call(fixed={name: "five"})
    for name in lists[:1]:
        yield "list fixed", call(fixed={name: 1.0})
    (still,) = trial.read([at_rest(trial, folder / "still.csv")])
    yield "log at rest", lambda: ff.fit(trial.family, [still], **trial.options)
    bare = folder / "bare.csv"
    bare.write_text("a,b\n" + "".join(f"{i},{i % 7}\n" for i in range(50)), encoding="utf-8")
    yield "no column", lambda: ff.fit(trial.family, [bare], **trial.options)
    if trial.options:
        yield "no options", lambda: ff.fit(trial.family, logs)


def test_no_message_speaks_of_the_command_line(trial: Any, tmp_path: Path) -> None:
    said, others = {}, {}
    for name, call in mistakes(trial, tmp_path):
        try:
            call()
        except ff.FluidactError as error:
            said[name] = str(error)
        except Exception as error:
            others[name] = repr(error)
    assert {name: text for name, text in said.items() if "--" in text} == {}
    assert not others, "every mistake has a message of its own"
    assert {"unknown fixed", "unknown start", "unknown bounds", "no column"} <= set(said)


@pytest.mark.parametrize("argument", ["fixed", "start", "bounds"])
def test_a_parameter_that_does_not_exist_is_named(trial: Any, argument: str) -> None:
    value = (0.0, 1.0) if argument == "bounds" else 1.0
    with pytest.raises(ff.UsageError, match="no_such_parameter") as caught:
        ff.fit(
            trial.family, trial.read(), **trial.options,
            **{argument: {"no_such_parameter": value}},
        )  # fmt: skip
    assert argument in str(caught.value)
    assert "--" not in str(caught.value)
