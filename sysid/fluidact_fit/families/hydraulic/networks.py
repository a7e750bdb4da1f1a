"""Small networks of the flow and of the friction, beside the equations they compete with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import LogError
from ...estimation.hydraulics import (
    Machine,
    Network,
    Windows,
    chamber_flow,
    train_network,
)
from ...estimation.parametric import (
    Fitted,
    scalars,
)
from ...experiment import FloatArray
from ...family import Curve, Estimate, Quantity, StaticView
from .flow import fit_flow
from .friction import FrictionRows, fit_friction
from .stage import Stage, all_windows

LAYERS = ("weights_1", "biases_1", "weights_2", "biases_2", "input_offset", "input_scale",
          "output_offset", "output_scale")  # fmt: skip
NETWORKS = ("flow_1", "flow_2", "friction")
_RAMP = 1.5  # how much shorter the windows of a fast ramp are; speed is noisier there
_FEW = 5  # windows that a comparison needs
_HIDDEN = 10  # units of the networks
_WINDOWS = 1500  # rows a network is trained on, before those near zero are repeated


def fit_networks(
    stage: Stage, windows: Sequence[Windows], fitted: Fitted, rows: FrictionRows
) -> tuple[dict[str, Quantity], dict[str, Any]]:
    """Train what was asked for and compare it with the equations on rows held out."""
    parameters: dict[str, Quantity] = {}
    details: dict[str, Any] = {}
    if stage.request.options.get("flow") == "mlp":
        found, models, table = _flow_networks(stage, _rows_for_networks(stage), fitted.values)
        details["flow_comparison"], details["flow_models"] = table, models
        for name, net in found.items():
            parameters.update(_network_quantities(name, net, ("V", "Pa"), "m3/s"))
    if stage.request.options.get("friction") == "mlp":
        if rows.speed.size < 40:
            raise LogError(
                f"only {rows.speed.size} rows of friction can be had from the logs",
                expected="A network needs 40 or more.",
                remedy="Record both pressures in one log and give both areas, or leave out "
                "--friction mlp.",
            )
        net, table = _friction_network(stage, rows)
        details["friction_comparison"] = table
        parameters.update(_network_quantities("friction", net, ("m/s",), "N"))
    return parameters, details


def _network_quantities(
    name: str, net: Network, units: Sequence[str], output: str
) -> dict[str, Quantity]:
    """The layers as parameters; the standardisation is in the inputs' own SI units."""
    return {
        f"{name}_{layer}": Quantity(getattr(net, layer).tolist(), "1", "estimated")
        for layer in LAYERS
    }


def network_of(parameters: Mapping[str, Any], name: str) -> Network | None:
    """Read a network back from the parameters of a file; ``None`` when there is none."""
    if f"{name}_weights_1" not in parameters:
        return None
    return Network(*(np.asarray(parameters[f"{name}_{layer}"], dtype=float) for layer in LAYERS))


def _rows_for_networks(stage: Stage) -> list[Windows]:
    """Overlapping windows in which the command hardly moves, shorter ones where it ramps fast.

    The mean flow belongs to the mean command only while the command stays on one side of an
    edge of the dead zone.
    """
    out = []
    for shorter in (1.0, _RAMP):
        found = all_windows(stage, 8, shorter)
        most = 0.03 * max(float(np.abs(w.command).max()) for w in found)
        for w in found:
            u = w.command
            spread = np.array([np.ptp(u[a:b]) for a, b in zip(w.first, w.last)])
            # shorter ones only where a long one would be too long
            needed = spread * shorter > most if shorter > 1.0 else True
            out.append(_cut(w, (spread <= most) & needed))
    return [w for w in out if w.first.size]


def _held_out(stage: Stage, w: Windows) -> npt.NDArray[np.bool_]:
    """Windows that judge: the last of three logs or more, else the last quarter of each log."""
    if len(stage.experiments) > 2:
        return np.full(w.first.size, w.experiment == len(stage.experiments) - 1)
    return np.asarray(w.first >= 0.75 * stage.experiments[w.experiment].samples)


def _cut(w: Windows, rows: npt.NDArray[np.bool_]) -> Windows:
    names = ("first", "last", "duration", "motion", "swelling")
    return replace(w, **{n: getattr(w, n)[rows] for n in names})


def _flow_networks(
    stage: Stage, windows: Sequence[Windows], values: Mapping[str, float]
) -> tuple[dict[str, Network], dict[str, dict[str, float]], list[dict[str, Any]]]:
    """Networks of the flow from command and pressure, and how they compare.

    Three models see the same training windows and are judged on the same others: the
    equations without a dead zone (those of the paper), with it, and the network.

    Returns
    -------
    networks
        By name of the flow.
    models
        Parameters of either set of equations, fitted to the same windows.
    table
        Errors by chamber and size of the command.
    """
    shown = [_cut(w, ~_held_out(stage, w)) for w in windows]
    shown = [w for w in shown if w.first.size]
    judged = [_cut(w, _held_out(stage, w)) for w in windows]
    compressed = {n: v for n, v in values.items() if n == "bulk_modulus"}
    known = replace(stage.request, fixed={**stage.request.fixed, **compressed})
    part = replace(stage, request=known, notices=[])
    zones = ("dead_zone_negative", "dead_zone_positive")
    rivals: dict[str, Callable[[Windows], FloatArray]] = {}
    equations: dict[str, dict[str, float]] = {}
    for label, without in (("orifice_without_dead_zone", zones), ("orifice", ())):
        fit = fit_flow(part, shown, lenient=True, without=without).values
        equations[label] = {n: float(v) for n, v in fit.items()}
        rivals[label] = partial(_orifice_flow, fit, stage.machine)
    nets, table = {}, []
    volts = max(float(np.abs(w.command).max()) for w in windows)
    edges = max(abs(values[z]) for z in zones)
    near = min(max(2.0 * edges, 0.05 * volts), 0.3 * volts)
    for chamber in stage.chambers:
        inputs, flow = _flow_rows([w for w in shown if w.chamber == chamber], values)
        net = _train_on_flow(inputs, flow, near, stage.request.seed)
        nets[f"flow_{chamber}"] = net
        models: dict[str, Callable[[Windows], FloatArray]] = {
            **rivals,
            "network": partial(_network_flow, net, values),
        }
        tests = [w for w in judged if w.chamber == chamber and w.first.size]
        if tests:
            table += _compare_flows(models, tests, values, chamber, near, edges, volts)
    return nets, equations, table


def _train_on_flow(inputs: FloatArray, flow: FloatArray, near: float, seed: int) -> Network:
    """Network of the flow, rows near zero command repeated until they are half of all.

    Their flows are small: unweighted, they would hardly count.
    """
    thin = max(1, -(-flow.size // _WINDOWS))
    rows = np.arange(0, flow.size, thin)
    close = rows[np.abs(inputs[rows, 0]) < near]
    if close.size:
        rows = np.concatenate((rows, np.tile(close, max(rows.size // close.size - 1, 0))))
    return train_network(inputs[rows], flow[rows], _HIDDEN, seed)


def _orifice_flow(values: Mapping[str, float], machine: Machine, w: Windows) -> FloatArray:
    return np.asarray(np.real(w.flow(values, machine)))


def _network_flow(net: Network, values: Mapping[str, float], w: Windows) -> FloatArray:
    return net(_flow_rows([w], values)[0])


def _flow_rows(
    windows: Sequence[Windows], values: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Inputs (command, pressure) and flow of every window, ``(m, 2)`` and ``(m,)``."""
    inputs, flows = [], []
    for w in windows:
        pressure = w.mean(0.5 * (w.before + w.after))
        inputs.append(np.column_stack((w.mean(w.command), pressure)))
        swelling = w.swelling / values["bulk_modulus"] if "bulk_modulus" in values else 0.0
        flows.append(w.motion - swelling)
    return np.concatenate(inputs), np.concatenate(flows)


def _compare_flows(
    models: Mapping[str, Callable[[Windows], FloatArray]],
    tests: Sequence[Windows],
    values: Mapping[str, float],
    chamber: int,
    near: float,
    edges: float,
    volts: float,
) -> list[dict[str, Any]]:
    """Error of every model by size of the command, near zero first, as in figure 9."""
    command = np.concatenate([w.mean(w.command) for w in tests])
    flow = _flow_rows(tests, values)[1]
    errors = {n: np.concatenate([f(w) for w in tests]) - flow for n, f in models.items()}
    bands = [("inside the dead zone", 0.0, edges), ("near zero command", 0.0, near),
             ("away from zero command", near, np.inf)]  # fmt: skip
    out = []
    for label, low, high in bands:
        rows = (np.abs(command) >= low) & (np.abs(command) < high)
        if rows.sum() < _FEW:
            continue
        rms = {n: float(np.sqrt(np.mean(e[rows] ** 2))) for n, e in errors.items()}
        out.append({
            "chamber": chamber, "where": label, "command_from": low,
            "command_to": float(min(high, volts)), "windows": int(rows.sum()), "unit": "m3/s",
            **rms, "closest": min(rms, key=lambda n: rms[n]),
            "why": _why(label, rms),
        })  # fmt: skip
    return out


def flow_view(stage: Stage, estimate: Estimate) -> StaticView:
    """Flow over the command near zero: measured, network, equations with a dead zone and without.

    The pressure goes up and down with the command's history, so that no single one belongs to a
    command: each curve is a running mean of what a model says of the measured windows.
    """
    chamber = stage.chambers[0]
    plain = scalars({n: q.value for n, q in estimate.parameters.items()})
    net = network_of({n: q.value for n, q in estimate.parameters.items()}, f"flow_{chamber}")
    assert net is not None
    windows = [w for w in _rows_for_networks(stage) if w.chamber == chamber]
    inputs, flow = _flow_rows(windows, plain)
    table = estimate.details["flow_comparison"]
    near = [r["command_to"] for r in table if r["where"] == "near zero command"]
    reach = 2.0 * max(near, default=0.1 * float(np.abs(inputs[:, 0]).max()))
    used = np.abs(inputs[:, 0]) <= reach
    seen, pressure, fitted = inputs[used, 0], inputs[used, 1], net(inputs)
    command = np.linspace(seen.min(), seen.max(), 401)
    curves = [Curve("network", command, _running_mean(command, seen, fitted[used]))]
    labels = {"orifice_without_dead_zone": "equations, no dead zone", "orifice": "equations"}
    for name, values in estimate.details["flow_models"].items():
        m = stage.machine
        law = np.real(chamber_flow(chamber, seen, pressure, values, m.supply, m.tank))
        curves.append(Curve(labels[name], command, _running_mean(command, seen, law)))
    return StaticView("command", "V", f"flow_{chamber}", "m3/s", inputs[:, 0], flow, fitted, used,
                      curves)  # fmt: skip


def _running_mean(command: FloatArray, seen: FloatArray, flow: FloatArray) -> FloatArray:
    """Mean flow of the 2 % of the windows whose command is closest, ``(n,)`` [m3/s].

    Parameters
    ----------
    command : (n,)
        Where it is wanted [V].
    seen, flow : (m,)
        Of the windows [V], [m3/s].
    """
    near = max(seen.size // 50, 1)
    closest = np.argpartition(np.abs(command[:, None] - seen), near - 1, axis=1)[:, :near]
    return np.asarray(flow[closest].mean(axis=1))


def _why(where: str, rms: Mapping[str, float]) -> str:
    """One sentence on what the numbers of a row come from."""
    plain, zone, net = (rms[n] for n in ("orifice_without_dead_zone", "orifice", "network"))
    if where.startswith("away"):
        if net <= zone:
            return "The network follows what the equations leave out."
        return (
            "The equations have the right shape where the valve is open; the network has to piece "
            "it together from the rows it saw."
        )
    if abs(plain - zone) < 0.1 * plain:
        return "The equations agree on these rows with and without a dead zone: no overlap shows."
    cause = (
        "Overlap of spool and land closes the valve here, and equations without a dead zone "
        "predict flow all the same; "
    )
    if net >= plain:
        return cause + "the network saw too few rows to learn it."
    if zone <= net:
        return cause + "the network has learnt it, equations with a fitted dead zone know it best."
    return cause + "the network follows the shape of the edges, which no dead zone has."


def _friction_network(stage: Stage, rows: FrictionRows) -> tuple[Network, list[dict[str, Any]]]:
    """Network of the friction over speed, beside Coulomb and viscous friction."""
    judged = (np.arange(rows.speed.size) // 20) % 4 == 3
    net = train_network(rows.speed[~judged, None], rows.force[~judged], 6, stage.request.seed)
    shown = FrictionRows(rows.speed[~judged], rows.force[~judged], rows.source)
    found = fit_friction(stage, shown, lenient=True).values
    v, f = rows.speed[judged], rows.force[judged]
    line = found["viscous"] * v + found["coulomb"] * np.sign(v)
    edge = 0.1 * float(np.quantile(np.abs(rows.speed), 0.95))
    table = []
    for label, chosen in (("slow", np.abs(v) <= edge), ("moving", np.abs(v) > edge)):
        if chosen.any():
            pairs = (("coulomb", line), ("network", net(v[:, None])))
            rms = {n: float(np.sqrt(np.mean((m - f)[chosen] ** 2))) for n, m in pairs}
            table.append({"where": label, "speed_limit": edge, "windows": int(chosen.sum()),
                          "unit": "N", **rms})  # fmt: skip
    return net, table
