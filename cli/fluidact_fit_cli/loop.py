"""``fluidact-fit simulate --controller``: a machine of parameter files in closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import click

from .options import READING
from .outputs import check_targets, write_all
from .show import echo, echo_json, echo_table, tell

if TYPE_CHECKING:
    from fluidact_fit.control.closed_loop import ClosedLoop


def simulate_closed_loop(
    files: Sequence[str], output: str | None, force: bool, params: Mapping[str, Any]
) -> None:
    """Simulate, and show or write what came of it."""
    from fluidact_fit.control import read_document
    from fluidact_fit.control.closed_loop import simulate_loop
    from fluidact_fit.control.controller_file import read_controller_file

    kind = _check(params)
    targets = {o: p for o, p in (("-o", output), ("--plot", params["plot"])) if p is not None}
    check_targets(targets, [*files, params["controller"], kind], force)
    file = read_controller_file(params["controller"])
    documents = [read_document(path) for path in files]
    found = simulate_loop(
        documents, file, kind, duration=params["duration"], draws=params["draws"] or 0,
        seed=params["seed"] or 0, accept=lambda b: b.accept(params["accept_not_identified"]),
    )  # fmt: skip
    contents: dict[str, bytes | str] = {}
    if output is not None:
        contents[output] = found.to_csv()
    if params["plot"] is not None:
        contents[params["plot"]] = _picture(found, params["plot"])
    write_all(contents, force)
    for words in found.warnings:
        tell(f"warning: {words}")
    if params["as_json"]:
        echo_json(found.to_dict())
    elif not params["quiet"]:
        _show(found, list(contents), params["verbose"])


def _check(params: Mapping[str, Any]) -> str:
    """The reference; refuses what reads a log (``click.UsageError``)."""
    for option in READING:
        if params[str(option.name)]:
            raise click.UsageError(
                f"{option.opts[0]} is about reading a LOG, and a closed loop has none. Leave it "
                "out; the sample time is in the controller file."
            )
    if params["input"]:
        raise click.UsageError("--input is for a simulation without --controller. Leave it out.")
    if params["reference"] is None:
        raise click.UsageError("--controller needs --reference, for example --reference step.")
    return str(params["reference"])


def _picture(found: ClosedLoop, path: str) -> bytes:
    from pathlib import Path

    from fluidact_fit.report import plot_response, render

    r, controlled = found.nominal, found.plant.controlled
    commands = list(zip(found.plant.commands, r.commands.T))
    band = found.band() if found.drawn else None
    figure = plot_response(r.time, r.reference, r.output, controlled, commands, band)
    return render(figure, Path(path).suffix.lower().removeprefix("."))


def _show(found: ClosedLoop, written: Sequence[str], verbose: bool) -> None:
    """Metrics, margins and what the draws say, as a table, and the controller."""
    unit = found.plant.controlled.unit
    echo(f"{found.plant.controlled}: {found.nominal.time.size} samples in closed loop\n")
    units = {"rise_time": "s", "settling_time": "s", "settling_time_final": "s", "peak_time": "s",
             "overshoot": "%", "overshoot_target": "%"}  # fmt: skip
    rows = [["metric", "value", "unit", "90 % of draws" if found.drawn else ""]]
    spread = found.spread() if found.drawn else {}
    metrics = {**(found.step.to_dict() if found.step else {}), **found.tracking.to_dict()}
    for name, value in metrics.items():
        shown = "never" if value is None else f"{value:.5g}"
        low_high = f"{spread[name][0]:.4g} .. {spread[name][1]:.4g}" if name in spread else ""
        rows.append([name.replace("_", " "), shown, units.get(name, unit), low_high])
    if found.margins is not None:
        m = found.margins
        for name, value, of in (("gain margin", m.gain, ""), ("phase margin", m.phase, "degrees")):
            low, high = spread.get(name.replace(" ", "_"), (None, None))
            edges = "" if low is None else f"{low:.4g} .. {high:.4g}"
            rows.append([name, _finite(value, m.stable), of, edges])
        rows.append(["spectral radius", f"{m.spectral_radius:.4g}", "", ""])
    echo_table(rows, right=(1,))
    echo("")
    controller = [["controller", "value", "unit", ""]]
    for e in found.numbers:
        number = e.value if isinstance(e.value, str) else f"{e.value:.6g}"
        controller.append([e.key.replace("_", " "), number, e.unit, e.about if verbose else ""])
    echo_table(controller, right=(1,))
    if found.failed:
        echo(f"\n{found.failed} of {found.failed + len(found.drawn)} drawn machines run away")
    for path in written:
        echo(f"written to {path}")


def _finite(margin: float, stable: bool) -> str:
    """A margin; where nothing limits it, whether that is good."""
    return f"{margin:.4g}" if isfinite(margin) or stable else "none"
