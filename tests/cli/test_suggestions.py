"""A mistyped command, option or file gets the word that was meant, or what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import fluidact_fit as ff

Run = Callable[..., Any]


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["valve", "x.csv", "--colum", "a=b"], "'--column'"),
        (["check", "a", "b", "--hlep"], "'--help'"),
        (["valve", "x.csv", "--help-al"], "'--help-all'"),
        (["friction-cylinder", "x.csv"], "'cylinder-friction'"),
        (["vavle", "x.csv"], "'valve'"),
    ],
)
def test_one_word_is_suggested(words: list[str], meant: str, here: Run, inside: Path) -> None:
    done = here(*words)
    assert done.status == 2
    assert f"Did you mean {meant}?" in done.err
    assert "one of" not in done.err


@pytest.mark.parametrize(
    ("words", "owner"),
    [
        (["fit", "x.csv", "--strict"], "the family"),
        (["fit", "x.csv", "--validate", "y.csv"], "the family"),
        (["fit", "x.csv", "--length", "5"], "line"),
        (["valve", "x.csv", "--length", "5"], "line"),
        (
            ["ball-screw", "x.csv", "--offset", "free"],
            "hydrostatic, valve, line, cylinder-friction, hydraulic-motor",
        ),
    ],
)
def test_an_option_of_another_command_is_not_taken_for_a_slip(
    words: list[str], owner: str, here: Run, inside: Path
) -> None:
    done = here(*words)
    assert done.status == 2
    assert f"it belongs to the command of {owner}." in done.err
    assert "Did you mean" not in done.err


@pytest.mark.parametrize("words", [[], ["export"], ["check"], ["valve"]])
def test_every_command_knows_help_all(words: list[str], here: Run) -> None:
    done = here(*words, "--help-all")
    assert done.status == 0
    assert "Usage:" in done.out


@pytest.mark.parametrize("content", [b"time [s],u\n0,1\n", b"a\xff;b\n", b"PK\0\0"])
def test_a_log_in_place_of_a_parameter_file_is_recognised(
    content: bytes, here: Run, inside: Path
) -> None:
    log = inside / "trial.csv"
    log.write_bytes(content)
    done = here("export", log, "--to", "c")
    assert done.status == 3
    assert "looks like a log" in done.err
    assert "fluidact-fit inspect" in done.err
    with pytest.raises(ff.ParameterFileError, match="Fit the log first"):
        ff.load(log)


def test_a_comma_that_separates_and_stands_before_decimals(here: Run, inside: Path) -> None:
    """The remedy, to skip the header and name columns by number, read whole numbers."""
    rows = "".join(f"{10 * k},{3 + k % 2},{1000 + k},4,{2000 + k}\n" for k in range(50))
    (inside / "both.csv").write_text("t [ms],p1 [bar],p2 [bar]\n" + rows)
    done = here("inspect", "both.csv")
    assert done.status == 3
    assert "export the file with semicolons, or with decimal points" in done.err
    assert "--skip-rows" not in done.err
