"""``fluidact-fit inspect``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.families import family_names, get_family

from .. import options
from ..progress import Progress
from ..show import echo, echo_json, echo_notices, echo_table, format_number

if TYPE_CHECKING:
    from fluidact_fit.advice import Suggestion
    from fluidact_fit.logs import Log

_LISTED = 8  # lines that were left out, one by one


@click.command(
    "inspect",
    cls=options.Command,
    params=[
        click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True),
        options.Option(["--family"], type=click.Choice(family_names()), metavar="FAMILY",
                       group="Output",
                       help="Judge the log for this model family alone, and refuse it where it "
                       "cannot be used."),
        options.flag("--trial/--no-trial", group="Output", default=True,
                     help="Fit the likeliest families to see what they determine. Default: yes, "
                     "of logs of up to 50,000 rows."),
        options.json_option("The description"),
        *options.READING,
        *options.VERBOSITY,
    ],
)  # fmt: skip
def command(
    logs: tuple[str, ...], family: str | None, trial: bool, as_json: bool, **params: Any
) -> None:
    """Show what is in a LOG, what is wrong with it, and which families fit it.

    Several LOGs are experiments on one machine. Families are chosen by the units and names of the
    columns, and tried: what they determine, what they do not, and the command to run next. Without
    --family only --column time=..., --unit time=... and --scale time=... matter for the time.
    """
    from fluidact_fit.advice import suggest
    from fluidact_fit.errors import Notice
    from fluidact_fit.logs import describe
    from fluidact_fit.logs.columns import find_column

    if family is not None:
        variants = get_family(family).variants
        options.check_role_names(params, [r.name for v in variants for r in v.roles])
    read = options.read_logs(logs, params)
    every = []
    for log in read:
        # Refuses a column that is not there.
        roles = {find_column(log, role, at).index: role for role, at in log.bindings.items()}
        found = describe(log)
        if family is not None:
            found["family"] = _usable(log, family, found)
        every.append(found)
        if not as_json and not params["quiet"]:
            _show(found, roles)
            echo_notices(Notice(n["code"], n["message"]) for n in found["notices"])
    with closing(Progress(params["quiet"], params["verbose"])) as progress:
        advice = suggest(read, logs, family, trial=trial, progress=progress)
    if as_json:
        listed = {"suggestions": [asdict(s) for s in advice]}
        echo_json({**every[0], **listed} if len(every) == 1 else {"logs": every, **listed})
    elif not params["quiet"]:
        show_advice(advice)


def show_advice(advice: Sequence[Suggestion]) -> None:
    """Say which families fit, what they do not determine, and what to run."""
    from fluidact_fit.outcome import percent_text

    echo()
    if not advice:
        echo("no family has all that it needs among these columns, by their units and names: say")
        echo("what they are with --column ROLE=#N and --unit ROLE=UNIT (FAMILY --help lists roles)")
        return
    head = ["family", "verdict", "fit", "columns"]
    rows = [
        [s.family, s.verdict.upper() or "not tried", percent_text(s.fit_percent),
         " ".join(f"{role}={at}" for role, at in s.columns.items())]
        for s in advice
    ]  # fmt: skip
    echo_table([head, *rows], right=(2,))
    best = advice[0]
    for name, message in best.not_identified.items():
        echo(f"not determined: {message or name}")
    if best.reason:
        echo(f"{best.family}: {best.reason}")
    for one, other in best.unsure:
        echo(f"{one} and {other} could be exchanged: check which column is which")
    echo("next:")
    echo(f"  {best.powershell if os.name == 'nt' else best.command}")


def _usable(log: Log, name: str, found: dict[str, Any]) -> dict[str, Any]:
    """Prepare the log for a family; adds its notices, raises what makes it unusable."""
    from fluidact_fit.logs import choose_variant, experiments

    variant = choose_variant(log, get_family(name).variants)
    runs, notices = experiments(log, variant)
    known = {n["message"] for n in found["notices"]}
    found["notices"] += [
        {"code": n.code, "message": n.message} for n in notices if n.message not in known
    ]
    return {
        "name": name,
        "variant": variant.name,
        "runs": [{"name": e.name, "samples": e.samples} for e in runs],
    }


def _show(found: Mapping[str, Any], roles: Mapping[int, str]) -> None:
    dialect = found["dialect"]
    separator = {"\t": "tab", " ": "white space"}.get(dialect["delimiter"], dialect["delimiter"])
    echo(f"{found['file']}: {found['rows']} rows, {len(found['columns'])} columns")
    text = f", {dialect['encoding']}, separator {separator}, decimal '{dialect['decimal']}', "
    text += f"data from line {dialect['first_data_line']}"
    echo(f"format: {dialect['name']}{text if separator else ''}")
    if found["elements"]:
        _show_elements(found["elements"])
    else:
        _show_lines(found["lines"], found["rows"])
    _show_time(found["time"])
    if "family" in found:
        runs = found["family"]["runs"]
        samples = sum(run["samples"] for run in runs)
        echo(f"usable for {found['family']['name']}: {len(runs)} run(s), {samples} samples")
    echo()
    head = ["column", "name", "unit", "low", "high", "resolution", "invalid", "role"]
    echo_table([head, *(_column_row(c, roles) for c in found["columns"])], right=(0, 3, 4, 5, 6))


def _show_lines(lines: Mapping[str, Any], rows: int) -> None:
    """Say what every line of the file was taken for."""
    left_out = lines["left_out"]
    parts = [f"{lines['header']} above the data", f"{rows} data"]
    parts += [f"{lines['blank']} empty"] if lines["blank"] else []
    parts += [f"{len(left_out)} left out"] if left_out else []
    echo(f"{lines['total']} lines: {', '.join(parts)}")
    for entry in left_out[:_LISTED]:
        echo(f"  line {entry['line']} left out: {entry['reason']}")
    if len(left_out) > _LISTED:
        echo(f"  and {len(left_out) - _LISTED} more (--json lists them all)")


def _show_elements(elements: Sequence[Mapping[str, str]]) -> None:
    """Say what became of every element of a recording."""
    count = Counter(element["fate"] for element in elements)
    echo(", ".join(f"{n} {fate}" for fate, n in count.items()))
    told = [element for element in elements if element["fate"] != "read"]
    for element in told[:_LISTED]:
        echo(f"  {element['name']} {element['fate']}: {element['how']}")
    if len(told) > _LISTED:
        echo(f"  and {len(told) - _LISTED} more (--json lists them all)")


def _show_time(time: Mapping[str, Any] | None) -> None:
    if time is None:
        echo("no time column was found (--column time=..., or --sample-time for a fit)")
        return
    even = "even" if time["uniform"] else "uneven"
    assumed = " (assumed)" if time["assumed"] else ""
    echo(
        f"time in column #{time['column']}, unit {time['unit']}{assumed}: {time['runs']} run(s), "
        f"{time['start']:g} to {time['end']:g} s, every {time['sample_time']:g} s, {even}"
    )


def _column_row(column: Mapping[str, Any], roles: Mapping[int, str]) -> list[str]:
    ends = [column["low"], column["high"], column["resolution"]]
    return [
        f"#{column['number']}",
        column["name"] or "",
        column["unit"] or "",
        *("" if value is None else format_number(value) for value in ends),
        str(column["invalid_cells"] or ""),
        roles.get(column["number"], ""),
    ]
