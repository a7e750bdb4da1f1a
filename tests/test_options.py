"""A family's options: read alike from Python, the command line and a file."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fluidact_fit.errors import UsageError
from fluidact_fit.families import family_names, get_family
from fluidact_fit.options import (
    FamilyOptions,
    choice,
    describe,
    flag,
    interval,
    number,
    settled,
    text,
    whole,
)


def upper(value: str) -> str:
    if value == "bad":
        raise ValueError("no such text")
    return value.upper()


@dataclass(frozen=True)
class Example(FamilyOptions):
    shape: str = choice("round", ("round", "flat"), "what it looks like")
    length: float | None = number(help="how long", unit="m", above=0.0)
    share: float = number(0.5, help="how much", minimum=0.0, maximum=1.0)
    count_of: int = whole(3, help="how many", minimum=1)
    open: bool | None = flag(help="whether it is open")
    word: str | None = text(help="a word", check=upper)
    rails: tuple[float, float] | None = interval(help="ends")
    found: float | None = settled("float", "what the fit found")
    end: str | None = choice(None, ("left", "right"), "which end", formerly="side")


def test_a_file_may_have_the_name_of_before_and_nobody_else() -> None:
    assert Example.read({"side": "left"}, from_file=True) == Example(end="left")
    with pytest.raises(UsageError, match="no option side"):
        Example.read({"side": "left"})


def test_defaults_and_values() -> None:
    given_values = Example.read({"length": np.float64(2.0), "count-of": 4.0, "rails": [0, 1]})
    assert given_values == Example(length=2.0, count_of=4, rails=(0.0, 1.0))
    assert given_values.given() == {
        "shape": "round", "length": 2.0, "share": 0.5, "count-of": 4, "rails": [0.0, 1.0],
    }  # fmt: skip


def test_what_a_file_holds_reads_back() -> None:
    settled_values = replace(Example(), found=0.25, word="WORD", open=False, rails=(-1.0, 1.0))
    assert Example.read(settled_values.given(), from_file=True) == settled_values


def test_a_number_is_taken_with_its_unit_from_people_and_not_from_files() -> None:
    assert Example.read({"length": "250 cm"}).length == pytest.approx(2.5)
    assert Example.read({"length": "2.5"}).length == 2.5
    with pytest.raises(UsageError, match="unit 'V' is a voltage"):
        Example.read({"length": "2.5 V"})
    with pytest.raises(UsageError, match="not a number"):
        Example.read({"length": "2.5 m"}, from_file=True)


@pytest.mark.parametrize(
    ("given_values", "said"),
    [
        ({"length": -5}, "length=-5: out of range"),
        ({"length": 0}, "length=0: out of range"),
        ({"length": "five"}, "length='five': 'five' is not a number"),
        ({"length": True}, "length=True: not a number"),
        ({"length": float("nan")}, "length=nan: not finite"),
        ({"length": [1.0, 2.0]}, "not a number"),
        ({"share": 1.5}, "share=1.5: out of range"),
        ({"count_of": 2.5}, "count_of=2.5: not a whole number"),
        ({"shape": "square"}, "shape='square': there is no such choice"),
        ({"open": 1}, "open=1: neither true nor false"),
        ({"word": "bad"}, "word='bad': no such text"),
        ({"word": 1.5}, "word=1.5: not text"),
        ({"rails": (1.0, 0.0)}, "1 is not below 0"),
        ({"rails": "0:1"}, "not a pair of numbers"),
        ({"lenght": 1.0}, "Did you mean length"),
        ({"found": 1.0}, "there is no option found"),
    ],
)
def test_what_cannot_be_is_refused_in_the_words_of_python(
    given_values: dict[str, object], said: str
) -> None:
    with pytest.raises(UsageError) as caught:
        Example.read(given_values)
    assert said in str(caught.value)
    assert "--" not in str(caught.value)
    assert "--" in caught.value.text


@given(st.dictionaries(st.text(max_size=8), st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3), max_leaves=4), max_size=3))  # fmt: skip
def test_whatever_a_file_holds_is_read_or_refused(values: dict[str, object]) -> None:
    try:
        found = Example.read(values, from_file=True)
    except UsageError:
        return
    assert Example.read(found.given(), from_file=True) == found


@pytest.mark.parametrize("name", family_names())
def test_every_family_describes_its_options(name: str) -> None:
    options = get_family(name).options_type
    for option in describe(options, every=True):
        assert option.help
        assert option.help[0].islower() or option.help.startswith("Coulomb")
        assert not option.help.endswith(".")
        if option.default is not None:
            assert option.read(option.default) == option.default
        if option.settled:
            assert option.default is None
    assert options.read(options().given(), from_file=True) == options()


def test_an_option_takes_the_same_words_in_every_family() -> None:
    words: dict[str, set[str]] = {}
    for name in family_names():
        for option in describe(get_family(name).options_type):
            own = set(option.choices or ()) - {"auto"}
            assert words.setdefault(option.name, own) == own, f"{name} --{option.name}"
