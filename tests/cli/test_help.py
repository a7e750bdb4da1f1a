"""Every command and option is documented, and help loads nothing heavy."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from fluidact_fit import __version__
from fluidact_fit.families import family_names, family_title, get_family
from fluidact_fit.options import describe
from fluidact_fit_cli.program import program

CONTEXT = click.Context(program, info_name="fluidact-fit")
COMMANDS = program.list_commands(CONTEXT)
# What every fit has, word for word from the contract.
FIT_OPTIONS = {
    "-o", "--output", "-f", "--force", "--column", "--unit", "--scale", "--sample-time", "--step",
    "--window", "--hold", "--fix", "--start", "--bounds", "--noise", "--validate",
    "--controller-sample-time", "--plot", "--report", "--json", "--strict", "--accept-failed",
    "--seed", "-q", "-v", "--debug",
}  # fmt: skip


def command(name: str) -> click.Command:
    found = program.get_command(CONTEXT, name)
    assert found is not None
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_command_has_help_and_every_option_too(name: str, here: Callable[..., Any]) -> None:
    every = "--help-all" if any(p.name == "column" for p in command(name).params) else "--help"
    done = here(name, every)
    assert done.status == 0
    assert done.err == ""
    assert name in done.out.splitlines()[0]
    for param in command(name).params:
        if isinstance(param, click.Option):
            assert (param.help or "").strip().endswith("."), param.name
            assert param.opts[0] in done.out


@pytest.mark.parametrize("name", family_names())
def test_family_help_is_generated_from_the_family(name: str, here: Callable[..., Any]) -> None:
    family, text = get_family(name), here(name, "--help-all").out
    assert family_title(name) == family.title
    assert family.title in " ".join(text.split())
    for variant in family.variants:
        for role in variant.roles:
            assert f" {role.name} " in text
            assert f"[{role.unit}" in text
        for parameter in variant.parameters:
            assert f" {parameter.name} " in text
    for option in describe(family.options_type):
        assert f"--{option.name}" in text
    assert {o for p in command(name).params for o in p.opts} >= FIT_OPTIONS


def test_variants_with_the_same_parameters_list_them_once(here: Callable[..., Any]) -> None:
    text = here("cylinder-friction", "--help").out
    listed = re.findall(r"^ +coulomb_positive +\[(N.*?)\]", text, re.MULTILINE)
    assert listed == ["N", "N m"]  # of a piston and of a shaft


def test_help_is_short_and_says_where_the_rest_is(here: Callable[..., Any]) -> None:
    text = here("line", "--help").out
    shown = set(re.findall(r"^  (?:-[a-z], )?--([a-z-]+)", text, re.MULTILINE))
    own = {option.name for option in describe(get_family("line").options_type)}
    assert shown - own - {"quiet", "verbose", "help-all", "help"} == {
        "output", "force", "column", "unit", "window", "fix", "validate", "plot", "report",
        "strict",
    }  # fmt: skip
    every = here("line", "--help-all").out
    rest = set(re.findall(r"^  (?:-[a-z], )?--([a-z-]+)", every, re.MULTILINE)) - shown
    listed = text.partition("More, see fluidact-fit line --help-all: ")[2]
    assert {name.strip().removeprefix("--") for name in listed.split(",")} == rest


def test_group_help_lists_all_commands(here: Callable[..., Any]) -> None:
    text = here("--help").out
    for name in COMMANDS:
        assert f"\n  {name} " in text
    assert "Exit status" in text


def test_version(here: Callable[..., Any]) -> None:
    assert here("--version").out == f"fluidact-fit {__version__}\n"


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_loads_nothing_heavy(option: str) -> None:
    code = (
        "import sys\n"
        "from fluidact_fit_cli.main import run\n"
        f"assert run(['{option}']) == 0\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'pydantic', 'yaml', 'pint', 'casadi'}\n"
        "loaded = heavy & set(sys.modules)\n"
        "loaded |= {m for m in sys.modules if m.startswith('fluidact_fit.families.')}\n"
        "assert not loaded, loaded\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("args", "hint"),
    [
        (["valv"], "Did you mean 'valve'?"),
        (["frobnicate"], "there is no command"),
        (["valve"], "LOG"),
        (["check"], "PARAMS"),
        (["valve", "x.csv", "--colum", "a=b"], "--column"),
        (["inspect", "x.csv", "--family", "pump"], "hydrostatic"),
    ],
)
def test_usage_errors(args: list[str], hint: str, here: Callable[..., Any]) -> None:
    done = here(*args)
    assert done.status == 2
    assert done.out == ""
    assert hint in done.err
    assert "--help" in done.err


def test_schema_is_printed(here: Callable[..., Any]) -> None:
    import json

    from fluidact_fit.parameters import shipped_schema

    assert json.loads(here("schema").out) == shipped_schema()


def test_without_a_word_there_is_help(here: Callable[..., Any]) -> None:
    done = here()
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("Usage: fluidact-fit ")
    assert "completion" in done.err


def test_a_log_in_place_of_a_command_is_told_what_to_do(
    here: Callable[..., Any], tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,x\n0,1\n")
    assert f"fluidact-fit fit {log}`" in here(log).err
