"""``fluidact-fit inspect``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from fluidact_fit.families import family_names, get_family

from .. import options
from ..show import echo, echo_json, echo_notices, echo_table, format_number

if TYPE_CHECKING:
    from fluidact_fit.logs import Log

_LISTED = 8  # lines that were left out, one by one


@click.command(
    "inspect",
    cls=options.Command,
    params=[
        click.Argument(["log"], metavar="LOG"),
        options.Option(["--family"], type=click.Choice(family_names()), metavar="FAMILY",
                       group="Output",
                       help="Also check whether the log can be used for this model family."),
        options.json_option("The description"),
        *options.READING,
        *options.VERBOSITY,
    ],
)  # fmt: skip
def command(log: str, family: str | None, as_json: bool, **params: Any) -> None:
    """Show what is in a LOG and what is wrong with it.

    Without --family only --column time=..., --unit time=... and --scale time=... matter: the other
    roles are unknown. With --family it also says whether the log can be fitted.
    """
    from fluidact_fit.errors import Notice
    from fluidact_fit.logs import describe
    from fluidact_fit.logs.columns import find_column

    if family is not None:
        variants = get_family(family).variants
        options.check_role_names(params, [r.name for v in variants for r in v.roles])
    (read,) = options.read_logs([log], params)
    # Refuses a column that is not there.
    roles = {find_column(read, role, at).index: role for role, at in read.bindings.items()}
    found = describe(read)
    if family is not None:
        found["family"] = _usable(read, family, found)
    if as_json:
        echo_json(found)
    elif not params["quiet"]:
        _show(found, roles)
    if not params["quiet"] and not as_json:
        echo_notices(Notice(n["code"], n["message"]) for n in found["notices"])


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
    echo(
        f"dialect {dialect['name']}, {dialect['encoding']}, separator {separator}, decimal "
        f"'{dialect['decimal']}', data from line {dialect['first_data_line']}"
    )
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
