"""Results as text: numbers with their uncertainty, tables."""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from typing import Any, TextIO

import click

from fluidact_fit.errors import Notice, OutputError, visible
from fluidact_fit.notices import is_information
from fluidact_fit.tables import format_interval as format_interval
from fluidact_fit.tables import format_number as format_number
from fluidact_fit.tables import format_spread as format_spread

_MOST_ROWS = 24  # of one list parameter
_MANY_RUNS = 10  # more than fit on a screen beside the table
_NAMED = 3  # logs of which the same is said
_NARROWEST = 40  # columns of a terminal


def echo(text: str = "") -> None:
    """Print a line for people on standard output, if there is one."""
    _print(visible(text) + "\n")


def echo_result(text: str) -> None:
    """Print what was asked for, as it is, on standard output; ``OutputError`` without one."""
    if sys.stdout is None:
        raise OutputError(
            "standard output is closed, so the result cannot be shown.",
            remedy="Redirect it to a file or a program.",
        )
    _print(text)


def _print(text: str) -> None:
    try:
        click.echo(text, nl=False)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(
            f"standard output cannot be written: {error.strerror}.",
            remedy="Free some space, or redirect it elsewhere.",
        ) from error


def tell(text: str, *, before: str = "", after: str = "\n") -> None:
    """Print text for people on standard error, between control characters of this program.

    It is lost where standard error is closed or full: a result does not depend on it.
    """
    try:
        click.echo(before + visible(text) + after, nl=False, err=True)
    except OSError:
        drop(sys.stderr)


def drop(stream: TextIO | None) -> None:
    """Point a stream nowhere, so that the interpreter's last flush of it is silent."""
    with suppress(AttributeError, OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[union-attr]
        os.close(nowhere)


def echo_table(rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table, columns aligned; ``right`` lists right-aligned columns."""
    shown = [[visible(cell).replace("\n", "\\n") for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*shown)]
    for row in shown:
        cells = [
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths))
        ]
        echo("  ".join(cells).rstrip())


def echo_json(document: Any) -> None:
    """Print a document as JSON, nothing else."""
    echo_result(json_text(document))


def json_text(document: Any) -> str:
    """Return a document as JSON in ASCII, so that no encoding can spoil it."""
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def echo_notices(notices: Iterable[Notice]) -> None:
    """Print notes and warnings on standard error, what is said alike of several logs once.

    On a terminal they are wrapped to its width.
    """
    together: dict[tuple[str, str], list[str]] = {}
    for notice in notices:
        name, colon, rest = notice.message.partition(": ")
        of_log = bool(colon) and " " not in name
        names = together.setdefault((notice.code, rest if of_log else notice.message), [])
        names += [name] * of_log
    for (code, message), names in together.items():
        word = "note" if is_information(code) else "warning"
        where = f"{_listed(names)}: " if names else ""
        tell(_wrapped(f"{word} ({code}): {where}{message}"))


def _listed(names: Sequence[str]) -> str:
    """The first few of several names."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _wrapped(text: str) -> str:
    if not sys.stderr or not sys.stderr.isatty():
        return text
    width = max(shutil.get_terminal_size().columns - 1, _NARROWEST)
    lines = (textwrap.wrap(line, width, subsequent_indent="  ", break_long_words=False,
                           break_on_hyphens=False) for line in text.splitlines())  # fmt: skip
    return "\n".join(chain.from_iterable(lines))


def quantity_rows(quantities: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return the rows of a table of parameters, lists one entry per row."""
    rows: list[list[str]] = []
    for name, entry in quantities.items():
        value, spread, interval = entry["value"], entry.get("std_error"), entry.get("ci95")
        if not isinstance(value, list):
            rows.append(_row(name, value, spread, interval, entry))
        elif isinstance(value[0], list) or len(value) > _MOST_ROWS:
            shape = f"{len(value)} x {len(value[0])}" if isinstance(value[0], list) else len(value)
            rows.append([name, f"{shape} numbers", "", entry["unit"], "", entry.get("status", "")])
        else:
            for i, number in enumerate(value):
                one = spread[i] if isinstance(spread, list) else None
                ends = interval[i] if isinstance(interval, list) else None
                rows.append(_row(f"{name}[{i}]", number, one, ends, entry))
    return rows


def _row(name: str, value: float, spread: Any, ends: Any, entry: Mapping[str, Any]) -> list[str]:
    return [
        name,
        format_number(value, spread),
        f"± {format_spread(spread)}" if spread else "",
        entry["unit"],
        format_interval(ends, spread),
        str(entry.get("status") or "").replace("_", " "),
    ]


def echo_parameters(document: Mapping[str, Any], verbose: bool = False) -> None:
    """Print the parameters of a document, and how well they fit."""
    from fluidact_fit.outcome import percent_text

    head = ["parameter", "value", "std error", "unit", "95 % interval", "status"]
    rows = quantity_rows(document["parameters"])
    if verbose and document.get("derived"):
        rows += quantity_rows(
            {k: {"status": "derived", **v} for k, v in document["derived"].items()}
        )
    echo_table([head, *rows], right=(1,))
    fit = document["fit"]
    percent, rmse = fit.get("fit_percent"), fit["rmse"]
    agreement = "" if percent is None else f"fit {percent_text(percent)}   "
    echo(
        f"\n{agreement}rmse {rmse['value']:.4g} {rmse['unit']}   samples {fit['samples']}   "
        f"verdict {fit['verdict'].upper()}"
    )
    logs = fit.get("logs", [])
    if len(logs) > _MANY_RUNS and not verbose:
        worst = min(logs, key=lambda entry: entry.get("fit_percent", 100.0))
        echo(f"{len(logs)} runs (-v lists them all), the worst of them:")
        _echo_logs("fitted", [worst])
    elif verbose or len(logs) > 1:
        _echo_logs("fitted", logs)
    _echo_logs("validation", document.get("validation", []))


def _echo_logs(kind: str, entries: Sequence[Mapping[str, Any]]) -> None:
    from fluidact_fit.outcome import percent_text

    for entry in entries:
        percent = entry.get("fit_percent")
        shown = "" if percent is None else f"fit {percent_text(percent)}, "
        rmse = entry.get("rmse")
        error = "" if rmse is None else f"rmse {rmse['value']:.4g} {rmse['unit']}"
        echo(f"{kind} {entry['file']}: {shown}{error}")
