"""Small networks of the flow and of the friction, beside the equations they compete with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import LogError
from ...estimation.named_model import Values
from ...estimation.network import Training, search
from ...estimation.scaled_network import ScaledNetwork, Scaling
from ...experiment import BoolArray, FloatArray
from ...family import Curve, PhysicsView, Quantity, Value, scalars
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import EDGES, chamber_flow
from .setup import Setup
from .windows import Windows

NETWORKS = ("flow_1", "flow_2", "friction")
LAYERS = (
    "weights_1", "biases_1", "weights_2", "biases_2",
    "input_offset", "input_scale", "output_offset", "output_scale",
)  # fmt: skip
_FEW = 5  # windows that a comparison needs
_HIDDEN = {"flow": 10, "friction": 6}  # units of the networks
_WINDOWS = 1500  # rows a network is trained on, before those near zero are repeated


def _train(inputs: FloatArray, target: FloatArray, hidden: int, seed: int) -> ScaledNetwork:
    """Train on inputs ``(n, inputs)`` and a target ``(n,)`` in any units; see :func:`search`."""
    scaling = Scaling.of(inputs, target)
    rng = np.random.default_rng([seed, hidden, inputs.shape[1]])
    x, y = scaling.inputs(inputs), scaling.output(target)
    return ScaledNetwork(search(x, y, Training((hidden,), starts=8), rng)[0].network, scaling)


def network_of(parameters: Mapping[str, Any], name: str) -> ScaledNetwork | None:
    """Read a network back from the parameters of a file; ``None`` when there is none."""
    if f"{name}_weights_1" not in parameters:
        return None
    return ScaledNetwork.of(parameters, prefix=f"{name}_")


def fit_networks(setup: Setup, values: Values) -> tuple[dict[str, Quantity], dict[str, Any]]:
    """Train what was asked for and compare it with the equations on rows held out.

    Returned are the layers, their standardisation in SI units, and the comparisons as rows of
    tables by title, for the file and the report.
    """
    nets: dict[str, ScaledNetwork] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    if setup.options.flow == "mlp":
        windows, table = _quiet_windows(setup), []
        for chamber in setup.chambers:
            own = [w for w in windows if w.chamber == chamber]
            nets[f"flow_{chamber}"], found = _flow_network(setup, own, values)
            table += [{"chamber": chamber, **row} for row in found]
        tables["Flow: models on held-out windows"] = table
    if setup.options.friction == "mlp":
        nets["friction"], table = _friction_network(setup, values)
        tables["Friction: models on held-out windows"] = table
    layers = {
        f"{name}_{layer}": Quantity(np.atleast_1d(numbers).tolist(), "1", "estimated")
        for name, net in nets.items()
        for layer, numbers in net.numbers().items()
    }
    return layers, {title: table for title, table in tables.items() if table}


def _quiet_windows(setup: Setup) -> list[Windows]:
    """Overlapping windows in which the command hardly moves.

    The mean flow belongs to the mean command only while the command stays on one side of an
    edge of the dead zone.
    """
    windows, out = setup.cut(overlap=8), []
    most = 0.03 * max(float(np.abs(w.command).max()) for w in windows)
    for w in windows:
        spread = [np.ptp(w.command[a:b]) for a, b in zip(w.first, w.last)]
        out.append(w.chosen(np.array(spread) <= most))
    return [w for w in out if w.first.size]


def _held_out(setup: Setup, w: Windows) -> BoolArray:
    """Windows that judge: the last of three logs or more, else the last quarter of each log."""
    if len(setup.experiments) > 2:
        return np.full(w.first.size, w.index == len(setup.experiments) - 1)
    return np.asarray(w.first >= 0.75 * w.experiment.samples)


def _near_zero(windows: Sequence[Windows], values: Values) -> float:
    """Command up to which the dead zone matters [V]."""
    volts = max(float(np.abs(w.command).max()) for w in windows)
    edge = max(abs(values[z]) for z in EDGES)
    return min(max(2.0 * edge, 0.05 * volts), 0.3 * volts)


def _flow_network(
    setup: Setup, windows: Sequence[Windows], values: Values
) -> tuple[ScaledNetwork, list[dict[str, Any]]]:
    """Network of one chamber's flow from command and pressure, beside the equations.

    Rows near zero command are repeated until they are half of all. Their flows are small:
    unweighted, they would hardly count.
    """
    near, held = _near_zero(windows, values), [_held_out(setup, w) for w in windows]
    inputs, flow = _flow_rows([w.chosen(~h) for w, h in zip(windows, held)], values)
    rows = np.arange(0, flow.size, max(1, -(-flow.size // _WINDOWS)))
    close = rows[np.abs(inputs[rows, 0]) < near]
    if close.size:
        rows = np.concatenate((rows, np.tile(close, max(rows.size // close.size - 1, 0))))
    net = _train(inputs[rows], flow[rows], _HIDDEN["flow"], setup.request.seed)
    tests = [w.chosen(h) for w, h in zip(windows, held)]
    inputs, flow = _flow_rows(tests, values)
    law = np.concatenate([w.modelled(values) - w.motion for w in tests])
    errors = {"orifice": law, "network": net(inputs) - flow}
    words = "near zero command", "away from zero command"
    return net, _compare(np.abs(inputs[:, 0]), near, errors, words, "m3/s")


def _flow_rows(windows: Sequence[Windows], values: Values) -> tuple[FloatArray, FloatArray]:
    """Inputs (command, pressure) and flow of every window, ``(m, 2)`` and ``(m,)``."""
    beta = values.get("bulk_modulus", np.inf)
    inputs = [np.column_stack((w.mean_command, w.mean_pressure)) for w in windows]
    return np.concatenate(inputs), np.concatenate([w.motion - w.swelling / beta for w in windows])


def _friction_network(setup: Setup, values: Values) -> tuple[ScaledNetwork, list[dict[str, Any]]]:
    """Network of the friction over speed, beside Coulomb and viscous friction."""
    speed, force = setup.friction.speed, setup.friction.force
    if speed.size < 40:
        raise LogError(
            f"only {speed.size} rows of friction can be had from the logs",
            expected="A network needs 40 or more.",
            remedy="Record both pressures in one log and give both areas, or leave out "
            "--friction mlp.",
        )
    held = (np.arange(speed.size) // 20) % 4 == 3
    net = _train(speed[~held, None], force[~held], _HIDDEN["friction"], setup.request.seed)
    v, f = speed[held], force[held]
    edge = 0.1 * float(np.quantile(np.abs(speed), 0.95))
    errors = {"coulomb": FrictionLaw.of(values).moving(v) - f, "network": net(v[:, None]) - f}
    return net, _compare(np.abs(v), edge, errors, ("slow", "moving"), "N")


def _compare(
    size: FloatArray, limit: float, errors: Mapping[str, FloatArray], words: tuple[str, str],
    unit: str,
) -> list[dict[str, Any]]:  # fmt: skip
    """Root mean squares of the errors below a limit of the input and above it."""
    out = []
    for where, rows in zip(words, (size <= limit, size > limit)):
        if rows.sum() >= _FEW:
            rms = {n: float(np.sqrt(np.mean(e[rows] ** 2))) for n, e in errors.items()}
            part = {"where": where, "limit": limit, "unit": unit, "windows": int(rows.sum())}
            out.append({**part, **rms})
    return out


def flow_curve(setup: Setup, parameters: Mapping[str, Value]) -> PhysicsView | None:
    """Flow of a chamber over the command by the equations, and what was measured beside it.

    A file with a network of the flow shows that as well, and the equations without a dead zone,
    over the small commands where they differ.

    The curves are at the median pressure of either direction. A point is the curve plus what the
    flow of a window exceeds that of the equations at its own pressure by. ``None`` where no window
    has a steady command.
    """
    chamber, values = setup.chambers[0], scalars(parameters)
    windows = [w for w in _quiet_windows(setup) if w.chamber == chamber]
    if not windows:
        return None
    inputs, flow = _flow_rows(windows, values)
    net = network_of(parameters, f"flow_{chamber}")
    if net is not None:
        small = np.abs(inputs[:, 0]) <= 2.0 * _near_zero(windows, values)
        inputs, flow = inputs[small], flow[small]
    if not flow.size:
        return None
    seen, pressure = inputs.T
    out = seen >= 0.0
    middle = [float(np.median(pressure[way])) if way.any() else 0.0 for way in (out, ~out)]
    command = np.linspace(seen.min(), seen.max(), 400)
    level = np.where(command >= 0.0, *middle)

    def equations(u: FloatArray, p: FloatArray, **changed: float) -> FloatArray:
        return np.real(chamber_flow(chamber, u, p, {**values, **changed}, setup.machine))

    curves = [Curve("valve and line", command, equations(command, level))]
    if net is not None:
        shut = equations(command, level, **dict.fromkeys(EDGES, 0.0))
        curves += [
            Curve("valve and line, no dead zone", command, shut),
            Curve("network", command, net(np.column_stack((command, level)))),
        ]
    at_middle = equations(seen, np.where(out, *middle)) + flow - equations(seen, pressure)
    return PhysicsView(
        f"Flow of chamber {chamber} over command", "command", "V", "flow", "m3/s",
        Curve("measured", seen, at_middle), curves,
    )  # fmt: skip
