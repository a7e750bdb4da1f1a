"""The result of a fit as tables: parameters in the units of the log, agreement by log."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from .show import (
    echo,
    echo_painted,
    echo_table,
    echo_text,
    format_interval,
    format_number,
    format_spread,
    width_of,
)

_MOST_ROWS = 24  # of one list parameter
_MANY_RUNS = 10  # more than fit on a screen beside the table
_HEAD = [
    "parameter",
    "value",
    "std error",
    "unit",
    "error %",
    "95 % interval",
    "in SI",
    "status",
]
_RIGHT, _DROP = (1, 4), (6, 5, 4)


def echo_parameters(document: Mapping[str, Any], verbose: bool = False) -> None:
    """Print parameters and derived values of a document, and how well they fit."""
    logs = document["provenance"].get("logs", [])
    units = [c.get("unit", "") for log in logs for c in log.get("columns", {}).values()]
    rows = list(_rows(document["parameters"], units))
    derived = document.get("derived", {})
    rows += _rows({k: q for k, q in derived.items() if verbose or _is_number(q)}, units, "derived")
    if dropped := echo_table([_HEAD, *rows], right=_RIGHT, drop=_DROP):
        echo_text(f"A wider terminal also shows: {', '.join(dropped)}.")
    echo()
    fit = document["fit"]
    runs = f" in {len(fit['logs'])} runs" if len(fit.get("logs", [])) > 1 else ""
    agreement = [_percent(fit), _rmse(fit, units), f"{fit['samples']} samples{runs}"]
    _echo_verdict(fit["verdict"].upper(), _joined(agreement))
    _echo_logs(document, units, verbose)


def _echo_verdict(verdict: str, agreement: str) -> None:
    """Print the verdict and how well the model fits, in two lines where one is too narrow."""
    width = width_of(sys.stdout)
    if width is None or len(f"verdict {verdict}   {agreement}") <= width:
        echo_painted("verdict ", verdict, "   ", agreement)
    else:
        echo_painted("verdict ", verdict)
        echo_text(agreement)


def _rows(
    quantities: Mapping[str, Mapping[str, Any]], units: Sequence[str], status: str = ""
) -> Iterator[list[str]]:
    """Rows of the table, those of a list one entry each."""
    for name, entry in quantities.items():
        value, spread, interval = entry["value"], entry.get("std_error"), entry.get("ci95")
        entry = {"status": status, **entry}
        if not isinstance(value, list):
            yield _row(name, value, spread, interval, entry, units)
        elif isinstance(value[0], list) or len(value) > _MOST_ROWS:
            shape = f"{len(value)} x {len(value[0])}" if isinstance(value[0], list) else len(value)
            yield [name, f"{shape} numbers", "", entry["unit"], "", "", "", _status(entry)]
        else:
            for i, number in enumerate(value):
                one = spread[i] if isinstance(spread, list) else None
                ends = interval[i] if isinstance(interval, list) else None
                yield _row(f"{name}[{i}]", number, one, ends, entry, units)


def _row(
    name: str,
    value: float,
    spread: float | None,
    ends: Sequence[float] | None,
    entry: Mapping[str, Any],
    units: Sequence[str],
) -> list[str]:
    from fluidact_fit.units import display_unit

    every = entry["value"] if isinstance(entry["value"], list) else [value]
    shown = display_unit(entry["unit"], max(map(abs, every)), units)
    error = spread * shown.factor if spread else None
    interval = [end * shown.factor for end in ends] if ends else None
    in_si = f"{format_number(value, spread)} {entry['unit']}"
    return [
        name,
        format_number(value * shown.factor, error),
        f"± {format_spread(error)}" if error else "",
        shown.unit,
        _relative(value, spread),
        format_interval(interval, error),
        in_si if shown.factor != 1.0 else "",
        _status(entry),
    ]


def _relative(value: float, spread: float | None) -> str:
    """The standard error in percent of the value."""
    if not spread or not value:
        return ""
    percent = 100.0 * spread / abs(value)
    if percent > 1000.0:
        return "> 1000"
    return f"{percent:.2g}" if percent < 99.5 else f"{percent:.0f}"


def _status(entry: Mapping[str, Any]) -> str:
    """Anything but the usual."""
    status = str(entry.get("status") or "").replace("_", " ")
    return "" if status == "estimated" else status


def _is_number(entry: Mapping[str, Any]) -> bool:
    return not isinstance(entry["value"], list)


def _joined(parts: Sequence[str]) -> str:
    return "   ".join(part for part in parts if part)


def _percent(fit: Mapping[str, Any]) -> str:
    from fluidact_fit.tables import percent_text

    percent = fit.get("fit_percent")
    return "" if percent is None else f"fit {percent_text(percent)}"


def _rmse(fit: Mapping[str, Any], units: Sequence[str]) -> str:
    from fluidact_fit.units import display_unit

    if (rmse := fit.get("rmse")) is None:
        return ""
    shown = display_unit(rmse["unit"], rmse["value"], units)
    return f"rmse {rmse['value'] * shown.factor:.4g} {shown.unit}"


def _echo_logs(document: Mapping[str, Any], units: Sequence[str], verbose: bool) -> None:
    """Print how well every run is met, where there are several."""
    fitted, validated = document["fit"].get("logs", []), document.get("validation", [])
    if len(fitted) + len(validated) < 2 and not verbose:
        return
    if len(fitted) > _MANY_RUNS and not verbose:
        echo(f"The worst of {len(fitted)} runs (-v lists them all):")
        fitted = [min(fitted, key=lambda entry: entry.get("fit_percent", 100.0))]
    used = [("fitted", entry) for entry in fitted] + [("validated", entry) for entry in validated]
    rows = [[entry["file"], use, *_numbers(entry, units)] for use, entry in used]
    echo()
    echo_table([["log", "use", "fit", "rmse"], *rows], right=(2,))


def _numbers(entry: Mapping[str, Any], units: Sequence[str]) -> tuple[str, str]:
    return _percent(entry).removeprefix("fit "), _rmse(entry, units).removeprefix("rmse ")
