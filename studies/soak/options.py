"""Hostile values of every option of every command, on a log that is in order."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import click

from fluidact_fit.families import family_names, get_family
from fluidact_fit_cli.commands.fit_family import make_command

from . import program
from .case import WRONG, Case, Part, Result

_NUMBERS = (
    "0", "-0", "-1", "1", "2", "0.01", "0.5", "1e308", "-1e308", "1e-320", "5e-324", "nan", "inf",
    "-inf", "1e999", "", "1,5", "0x10", "1_000", "９", "²", " 5 ", "1e", "--", "2**3", "9" * 400,
    "∞", "\x1b[31m1", "1e-12", "1e12", "1e30", "true", "None", "1/3", "3.", ".5", "1e5", "50%",
    "0.001s", "1;2", "\u202e1",
)  # fmt: skip
_FINITE = (
    "-1", "1", "2", "0.01", "0.5", "1e308", "-1e308", "1e-320", "1e-12", "1e12", "1e30", "1e-5",
    "3", "1e300", "1e-300", "0", "5", "10", "100", "0.3",
)  # fmt: skip
_UNITS = (
    "9^9^9", "9^9^9^9", "9**9**9", "kg", "m/0", "1/0", "", "degC", "%", "mm", "V", "µm", "1e400 m",
    "m**1e9", "((((((", "m^(9^9)", "s" * 1000, "bar", "psi", "delta_degC", "mm^-1", "\x1b]0;x\x07",
    "#²", "m·s", "N m", "ms", "1", "rpm", "deg", "m^0.5", "_", "__import__", "lambda",
    "m if m else s", "kilokilometer", "m**-1e308", "Ω",
)  # fmt: skip
_COLUMNS = (
    "#0", "#1", "#2", "#²", "#-1", "#99", "#1e3", "#", "", "#" + "9" * 30, "*", "time", "#１",
    "x" * 5000, "\x1b[31m", "'", "# 1", "#1 ", "[", "\ud800",
)  # fmt: skip
_FILES = (
    "nodir/", "nodir/x.yaml", "", ".", "..", "x" * 300, "out.png", "out.pdf", "out.svg", "out.html",
    "out.yaml/x", "-", "~", "log.csv", "\x1b[31m.yaml", "a\nb.yaml", "out.bmp", "/dev/null",
    ".yaml", "log.csv/", "folder", "folder/", "/proc/x", "a" * 250 + ".yaml", "\udc80.yaml", "--",
    "out", "nowhere.csv", "file.yaml", "/dev/full", "a\0b",
)  # fmt: skip
_WORDS = (
    "",
    "auto",
    "none",
    "estimate",
    "x",
    "²",
    "1",
    "-1",
    "\x1b[31m",
    "a,b,c",
    "#²",
    "x" * 3000,
)
_DESIGNED = ("valve", "cylinder-friction", "potentiometer")  # one of a kind, and quick about it
_TABLES = ("simulate", "design")  # write a table under any name
_OPTIONAL_FILES = {"output", "plot", "report", "validate", "params_file"}


@cache
def _commands() -> dict[str, click.Command]:
    """All commands that are given options here, by name."""
    found = {name: make_command(name) for name in family_names()}
    for name in ("inspect", "check", "simulate", "design"):
        found[name] = import_module(f"fluidact_fit_cli.commands.{name}").command
    return found


def value(rng: random.Random, option: click.Option, family: str) -> str:
    """A hostile value for an option: of its form or not."""
    name, form = option.name or "", str(option.metavar or option.type.name or "")
    scalar = _scalar(rng, name, family)
    if rng.random() < 0.05:
        return rng.choice((*_NUMBERS, *_WORDS, *_COLUMNS))
    if name in ("column", "unit", "scale", "step", "hold", "input", "noise") or "=" in form:
        names = [*_roles(family)] if "NAME" not in form else [*_parameters(family)]
        key = rng.choice(names) if rng.random() < 0.95 else rng.choice(("", "nosuch", "\x1b[31m"))
        return f"{key}={scalar}"
    if isinstance(option.type, click.Choice) and rng.random() < 0.7:
        return str(rng.choice(list(option.type.choices)))
    return scalar


def _scalar(rng: random.Random, name: str, family: str) -> str:
    def number() -> str:
        return rng.choice(_NUMBERS if rng.random() < 0.4 else _FINITE)

    makers: dict[str, Callable[[], str]] = {
        "column": lambda: rng.choice((*_COLUMNS, *program.columns(family).values())),
        "unit": lambda: rng.choice(_UNITS),
        "hold": lambda: rng.choice(("zoh", "foh", "smooth", "auto", *_WORDS)),
        "step": lambda: f"{number()}:{number()}" + rng.choice(("", "@" + number())),
        "input": lambda: f"{number()}:{number()}" + rng.choice(("", "@" + number())),
        "inputs": lambda: ",".join(rng.choices([*_roles(family), "direction", ""], k=3)),
    }
    if name in makers:
        return makers[name]()
    if name in _OPTIONAL_FILES:
        return rng.choice(_FILES)
    if name == "seed":
        return rng.choice(("0", "1", "-1", "4294967296", number()))
    if name in ("window", "bounds", "amplitude", "stroke", "rails"):
        return f"{number()}:{number()}"
    return number() if rng.random() < 0.8 else rng.choice(_WORDS)


@cache
def _roles(family: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(r.name for v in get_family(family).variants for r in v.roles))


@cache
def _parameters(family: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(p.name for v in get_family(family).variants for p in v.parameters))


def drafted(rng: random.Random) -> tuple[str, str, int, list[str]]:
    """A command line: the command, the family, the rows of the log, and the words."""
    family = rng.choice(family_names())
    command = (
        family if rng.random() < 0.7 else rng.choice(("inspect", "check", "simulate", "design"))
    )
    family = rng.choice(_DESIGNED) if command == "design" else family
    rows = rng.choice((1, 4, 20, 60, 120, 120, 120))
    words = _proper(command, family)
    options = [p for p in _commands()[command].params if isinstance(p, click.Option)]
    options = [p for p in options if p.name != "debug"]  # with it a traceback is what was asked
    for option in rng.choices(options, k=rng.choice((1, 1, 2, 3))):
        flag = option.opts[-1] if rng.random() < 0.2 else option.opts[0]
        if option.is_flag:
            words.append(flag)
        else:
            words += [flag, value(rng, option, family)]
    if rng.random() < 0.05:
        words.append(rng.choice(_FILES))
    return command, family, rows, words


def _proper(command: str, family: str) -> list[str]:
    """The words of a command line that is in order."""
    given = list(program.arguments(family))
    of_reader = [w for pair in given if "=" in pair for w in ("--column", pair)]
    if command == family:
        cheap = ["--starts", "1", "--hidden", "1"] if family == "force-map" else []
        return [family, "log.csv", *given, *cheap, "-o", "out.yaml"]
    return {
        "inspect": ["inspect", "log.csv", "--family", family, *of_reader],
        "check": ["check", "file.yaml", "log.csv", *of_reader],
        "simulate": ["simulate", "file.yaml", "log.csv", *of_reader],
        "design": ["design", family, "--from", "file.yaml", "--duration", "0.2", "-o", "out.csv"],
    }[command]


def attack_options(case: Case) -> Result:
    """Run one command line."""
    command, family, rows, words = drafted(case.rng)
    case.tell(f"{rows} rows of {family}: {' '.join(map(repr, words))[:1500]}")
    program.write_log(family, Path("log.csv"), rows)
    Path("file.yaml").write_text(program.golden()[family], encoding="utf-8")
    Path("folder").mkdir()
    before = _contents(Path())
    ended = program.run(words)
    result = Result(str(ended.status), message=(ended.err + ended.out)[:5000])
    program.judge(ended, result, (0, 2, 3, 4, 5) if command == "check" else program.DOCUMENTED)
    judge_files(before, _contents(Path()), ended.status, words, result)
    return result


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def judge_files(
    before: dict[str, bytes], after: dict[str, bytes], status: int, words: Sequence[str],
    result: Result,
) -> None:  # fmt: skip
    """Add what is wrong with the files left behind."""
    from fluidact_fit import FluidactError, read_document

    forced = any(w in ("-f", "--force") for w in words)
    for name, content in before.items():
        if after.get(name) != content and (name == "log.csv" or not forced or status):
            result.fail(WRONG, f"{name} was changed")
    new = sorted(set(after) - set(before))
    outputs = [b for a, b in pairwise(words) if a in ("-o", "--output")]
    if status == 0 and outputs and not os.path.exists(outputs[-1]):
        result.fail(WRONG, "exit status 0 without the file that was asked for")
    if status not in (0, 5) and new:
        result.fail(WRONG, f"exit status {status}, and a file was written")
    for name in new:
        if name.endswith(".yaml") and words[0] not in _TABLES:
            try:
                read_document(name)
            except FluidactError as error:
                result.fail(WRONG, f"a file was written that is refused: {str(error)[:200]}")


PARTS = (Part("options", "hostile options", 2000, attack_options),)
