"""Messages in the words of the caller."""

from __future__ import annotations

import pytest

from fluidact_fit.errors import UsageError, closest, in_python
from fluidact_fit.families import family_names


@pytest.mark.parametrize(
    ("command_line", "python"),
    [
        ("Give --fix mass=54.", "Give fixed={'mass': 54}."),
        (
            "--column x=#1 --column y=#2 --column z=#3.",
            "columns={'x': '#1', 'y': '#2', 'z': '#3'}.",
        ),
        ("--unit force=UNIT.", "units={'force': UNIT}."),
        ("--unit x=mm and --unit y=N.", "units={'x': 'mm', 'y': 'N'}."),
        ("--fix a=1 or --fix b=2", "fixed={'a': 1} or fixed={'b': 2}"),
        ("--hold force=zoh, as", "hold={'force': 'zoh'}, as"),
        ("--scale force=-1 turns it.", "scales={'force': -1} turns it."),
        ("--column reading=... if", "columns={'reading': ...} if"),
        ('--column "reference=D (mm)"', "columns={'reference': 'D (mm)'}"),
        ("--length=-5: out of range", "length=-5: out of range"),
        ("--dead-time=estimate.", "dead_time='estimate'."),
        ("Leave out --fix, --start and --bounds;", "Leave out fixed, start and bounds;"),
        ("give --sound-speed)", "give sound_speed)"),
        ("--sample-time S, or", "sample_time=S, or"),
        ("--area M2.", "area=M2."),
        ("Give --force to replace it", "Give overwrite=True to replace it"),
        ("--input speed=FROM:TO, or", "inputs={'speed': StepInput(FROM, TO)}, or"),
        ("well-known, 3--4, a -- b", "well-known, 3--4, a -- b"),
    ],
)
def test_options_become_keywords(command_line: str, python: str) -> None:
    assert in_python(command_line) == python


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("vavle", "valve"),
        ("friction-cylinder", "cylinder-friction"),
        ("Cylinder_Spring", "spring-cylinder"),
        ("potentio", "potentiometer"),
        ("hydraulic_motor", "hydraulic-motor"),
        ("li", "line"),
        ("xyz", ""),
    ],
)
def test_a_misspelt_cut_or_swapped_family_is_recognised(word: str, meant: str) -> None:
    assert closest(word, family_names()) == meant


def test_an_error_speaks_python_and_keeps_the_words_of_the_command_line() -> None:
    error = UsageError("--mass was given", where="a.csv", remedy="Leave --mass out.")
    assert str(error) == "a.csv: mass was given.\nLeave mass out."
    assert error.text == "a.csv: --mass was given.\nLeave --mass out."


@pytest.mark.parametrize(
    ("told", "python"),
    [
        ("--exclude lines=7.", "exclude='lines=7'."),
        ("--exclude lines=7 --exclude lines=9:12 and", "exclude=['lines=7', 'lines=9:12'] and"),
        ("--exclude 'trial1.csv:run=2'.", "exclude='trial1.csv:run=2'."),
        ("--set 'a.csv:position=25 %'.", "set={'a.csv:position': '25 %'}."),
        ("--set 'position=25 %'.", "constants={'position': '25 %'}."),
        ("--from-name 'position=kinked{%}'.", "from_name={'position': 'kinked{%}'}."),
        ("--thousands ' '.", "thousands=' '."),
        ("--invalid=drop", "invalid='drop'"),
        ("--unwrap angle=TURN (or", "unwrap={'angle': TURN} (or"),
        ("--step inlet=0:1@2 (Pa)", "steps={'inlet': StepInput(0, 1, 2)} (Pa)"),
        ("--step inlet=FROM:TO@T.", "steps={'inlet': StepInput(FROM, TO, T)}."),
        ("--bounds gain=LOW:HIGH.", "bounds={'gain': (LOW, HIGH)}."),
        ("--window 0.5:3,", "window=(0.5, 3),"),
        ("--window START:END)", "window=(START, END))"),
        ("--rails 3:1020 to", "rails=(3, 1020) to"),
    ],
)
def test_advice_is_one_that_python_takes(told: str, python: str) -> None:
    assert in_python(told) == python


def test_a_fit_takes_what_a_message_advises() -> None:
    """`exclude=` was advised by a fit, which did not take it."""
    import inspect

    from fluidact_fit.logs import Reading, read_log

    of_several = {"exclude_rows", "set"}
    assert {*Reading.__annotations__} - of_several == {*inspect.signature(read_log).parameters} - {
        "path"
    }


@pytest.mark.parametrize(("what", "text"), [
    ("does not exist", "a.yaml: does not exist."),
    ("is empty.", "a.yaml: is empty."),
    ("is no log, is it?", "a.yaml: is no log, is it?"),
    ("not valid (2 problems):\n  one\n  two", "a.yaml: not valid (2 problems):\n  one\n  two"),
])  # fmt: skip
def test_what_was_found_is_a_sentence(what: str, text: str) -> None:
    assert UsageError(what, where="a.yaml").text == text
