"""``fluidact-fit inspect``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..advice_lines import echo_advice
from ..channel_lines import echo_channels, echo_relations, troubles
from ..errors import Invocation
from ..messages import echo_notices
from ..outputs import check_targets, write_all
from ..progress import Progress
from ..show import echo, echo_json, echo_text

if TYPE_CHECKING:
    from fluidact_fit.advice import Suggestion
    from fluidact_fit.logs import Log

# Options of this command that a fit does not have, and whether a value follows them.
_NO_FIT = {
    **dict.fromkeys(("--family", "--plot"), True),
    **dict.fromkeys(("--trial", "--no-trial", "--json", "--force", "-f", "--quiet", "-q",
                     "--verbose", "-v", "--debug"), False),
}  # fmt: skip
_LISTED = 8  # lines that were left out, one by one


@click.command(
    "inspect",
    cls=options.Command,
    params=[
        click.Argument(["logs"], metavar="LOG...", nargs=-1, required=True),
        options.family_option("Judge the log for this model family alone, and refuse it where it "
                              "cannot be used.", "Output"),
        options.flag("--trial/--no-trial", group="Output", default=True,
                     help="Fit the likeliest families to see what they determine. Default: yes, "
                     "of logs of up to 50,000 rows."),
        options.Option(["--plot"], metavar="FILE", group="Output",
                       help="Pictures of the channels and, of one input and one output, of the "
                       "responses without a model (.html, .svg, .png or .pdf)."),
        options.FORCE,
        options.json_option("The description"),
        *options.READING,
        *options.VERBOSITY,
    ],
)  # fmt: skip
def command(
    logs: tuple[str, ...], family: str | None, trial: bool, plot: str | None, force: bool,
    as_json: bool, **params: Any,
) -> None:  # fmt: skip
    """Show what is in a LOG, what is wrong with it, and which families fit it.

    Several LOGs are experiments on one machine. Families are chosen by the units and names of the
    columns, and tried: what they determine, what they do not, and the command to run next. Without
    --family only --column time=..., --unit time=... and --scale time=... matter for the time.
    """
    from fluidact_fit.advice import suggest
    from fluidact_fit.inspection import Inspection, describe_log
    from fluidact_fit.logs.columns import find_column

    invocation = click.get_current_context().find_object(Invocation)
    words = options.typed_words(invocation, "inspect", _NO_FIT) if invocation else None
    if plot is not None:
        paths = {"--plot": plot}
        if Path(plot).suffix.lower() not in (".html", ".htm"):
            paths["--plot (responses)"] = str(_beside(Path(plot)))
        check_targets(paths, logs, force, also=(".html", ".htm"))
    with Progress(params["quiet"], params["verbose"]) as progress:
        progress("reading")
        read = options.read_logs(logs, params)
    every, roles = [], {}
    for log in read:
        # Refuses a column that is not there.
        roles = {find_column(log, role, at).index: role for role, at in log.bindings.items()}
        every.append(describe_log(log, family))
    shown = not as_json and not params["quiet"]
    if shown:
        _show(every[0], roles)
        for other in every[1:]:
            _show_briefly(other)
        echo_notices(Inspection(tuple(every), ()).notices)
    with Progress(params["quiet"], params["verbose"]) as progress:
        advice = suggest(read, logs, family, trial=trial, words=words, progress=progress)
    if as_json:
        echo_json(Inspection(tuple(every), tuple(advice)).to_dict())
    elif shown:
        echo_advice(advice, read[0])
    if plot is not None:
        pictures = _pictures(read, advice, plot)
        write_all(pictures, force)
        if shown:
            echo(f"pictures written to {' and '.join(pictures)}")


def _pictures(
    logs: Sequence[Log], advice: Sequence[Suggestion], path: str
) -> dict[str, bytes | str]:
    """The files of the pictures: a page of both, or one file each."""
    from fluidact_fit.advice import views_of
    from fluidact_fit.channels import describe_channels, time_of
    from fluidact_fit.logs import selected_part
    from fluidact_fit.report import inspection_page, plot_channels, plot_views, render

    log = selected_part(logs[0])
    time, channels = time_of(log), describe_channels(log)
    at = None if time is None else time[0]
    shown = [(c, found) for c in log.columns
             if c.index != at and (found := channels[c.index]) is not None]  # fmt: skip
    figures = [("channels", plot_channels(log.name, shown, None if time is None else time[1]))]
    views = views_of(advice[0], logs) if advice else None
    if views is not None:
        figures.append(("responses", plot_views(views)))
    kind = Path(path).suffix.lower()
    if kind in (".html", ".htm"):
        return {path: inspection_page(f"inspect {log.name}", figures)}
    names = [path] if len(figures) == 1 else [path, str(_beside(Path(path)))]
    return {n: render(f, kind[1:]) for n, (_, f) in zip(names, figures, strict=True)}


def _beside(path: Path) -> Path:
    """Path of the picture of the responses: ``a-responses.png`` for ``a.png``."""
    return path.with_name(f"{path.stem}-responses{path.suffix}")


def _show(found: Mapping[str, Any], roles: Mapping[int, str]) -> None:
    dialect = found["dialect"]
    separator = {"\t": "tab", " ": "white space"}.get(dialect["delimiter"], dialect["delimiter"])
    echo(f"{found['file']}: {_rows(found)}, {_count(len(found['columns']), 'column')}")
    text = f", {dialect['encoding']}, separator {separator}, decimal '{dialect['decimal']}', "
    text += f"data from line {dialect['first_data_line']}"
    echo_text(f"format: {dialect['name']}{text if separator else ''}")
    if found["elements"]:
        _show_elements(found["elements"])
    else:
        _show_lines(found["lines"], found["rows"])
    _show_time(found["time"])
    if "family" in found:
        runs = found["family"]["runs"]
        samples = sum(run["samples"] for run in runs)
        echo(
            f"usable for {found['family']['name']}: {_count(len(runs), 'run')}, "
            f"{_count(samples, 'sample')}"
        )
    echo()
    at = found["time"]["column"] if found["time"] else None
    echo_channels([c for c in found["columns"] if c["number"] != at], roles)
    if found["relations"]:
        echo()
        echo_relations(found["relations"], found["time"])


def _show_briefly(found: Mapping[str, Any]) -> None:
    """Say of a further log what differs: its rows, its time and what is wrong with a channel."""
    time = found["time"]
    every = f", every {time['sample_time']:g} s" if time else ""
    echo(f"{found['file']}: {_rows(found)}{every}")
    for column in found["columns"]:
        if said := troubles(column):
            echo_text(f"#{column['number']}: {'; '.join(said)}", "    ")


def _rows(found: Mapping[str, Any]) -> str:
    """Return the number of rows, and of those that ``--window`` and ``--exclude`` leave."""
    used = f", {found['rows_used']} of them used" if "rows_used" in found else ""
    return f"{_count(found['rows'], 'row')}{used}"


def _count(number: int, noun: str) -> str:
    from fluidact_fit.logs.log import count_of

    return count_of(number, noun)


def _show_lines(lines: Mapping[str, Any], rows: int) -> None:
    """Say what every line of the file was taken for."""
    left_out = lines["left_out"]
    parts = [f"{lines['header']} above the data", f"{rows} data"]
    parts += [f"{lines['blank']} empty"] if lines["blank"] else []
    parts += [f"{len(left_out)} left out"] if left_out else []
    echo(f"{lines['total']} lines: {', '.join(parts)}")
    _list([f"line {entry['line']} left out: {entry['reason']}" for entry in left_out])


def _show_elements(elements: Sequence[Mapping[str, str]]) -> None:
    """Say what became of every element of a recording."""
    count = Counter(element["fate"] for element in elements)
    echo(", ".join(f"{n} {fate}" for fate, n in count.items()))
    _list([f"{e['name']} {e['fate']}: {e['how']}" for e in elements if e["fate"] != "read"])


def _list(lines: Sequence[str]) -> None:
    """Print the first of many lines."""
    for line in lines[:_LISTED]:
        echo(f"  {line}")
    if len(lines) > _LISTED:
        echo(f"  and {len(lines) - _LISTED} more (--json lists them all)")


def _show_time(time: Mapping[str, Any] | None) -> None:
    if time is None:
        echo_text("no time column was found (--column time=..., or --sample-time for a fit)")
        return
    step = time["sample_time"]
    even = "even" if time["uniform"] else f"uneven by up to {time['jitter']:.2g} s"
    assumed = " (assumed)" if time["assumed"] else ""
    rate = f" ({1.0 / step:.4g} Hz)" if step else ""
    told = "" if time["named"] else f" (likely; a fit needs --column time=#{time['column']})"
    echo_text(
        f"time in column #{time['column']}{told}, unit {time['unit']}{assumed}: "
        f"{_count(time['runs'], 'run')}, {time['start']:g} to {time['end']:g} s, "
        f"every {step:g} s{rate}, {even}"
    )
