"""Small networks of the flow and of the friction, beside the equations they compete with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
_FEW = 5  # rows that a comparison needs
_TRAINED = 40  # rows that a network needs
_MOST = 1500  # rows a network is trained on, before those near zero are repeated
_Rows = tuple[FloatArray, FloatArray, FloatArray, BoolArray]


@dataclass(frozen=True)
class _Rival:
    """Units of a network, and the words for what it competes with: law, unit, either range."""

    units: int
    law: str
    unit: str
    near: str
    away: str


_RIVALS = {
    "flow": _Rival(10, "orifice", "m3/s", "near zero command", "away from zero command"),
    "friction": _Rival(6, "coulomb", "N", "slow", "moving"),
}


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
    layers: dict[str, Quantity] = {}
    tables: dict[str, list[dict[str, Any]]] = {}

    def enter(name: str, about: Mapping[str, Any], rows: _Rows, near: float) -> None:
        option = name.partition("_")[0]
        net, table = _compete(option, rows, near, setup.request.seed)
        for layer, numbers in net.numbers().items():
            layers[f"{name}_{layer}"] = Quantity(np.atleast_1d(numbers).tolist(), "1", "estimated")
        title = f"{option.capitalize()}: models on held-out windows"
        if table:
            tables[title] = [*tables.get(title, []), *({**about, **row} for row in table)]

    windows = _quiet_windows(setup) if setup.options.flow == "mlp" else []
    for c in setup.chambers if windows else ():
        own = [w for w in windows if w.chamber == c]
        errors = np.concatenate([w.modelled(values) - w.motion for w in own])
        rows = *_flow_rows(own, values), errors, _held_out(own)
        enter(f"flow_{c}", {"chamber": c}, rows, _near_zero(own, values))
    if setup.options.friction == "mlp":
        speed, force = setup.friction.speed, setup.friction.force
        errors, held = FrictionLaw.of(values).moving(speed) - force, np.arange(speed.size) // 20
        enter("friction", {}, (speed[:, None], force, errors, held % 4 == 3), setup.friction.slow)
    return layers, tables


def _held_out(windows: Sequence[Windows]) -> BoolArray:
    """Windows that judge: the last of three logs or more, else the last quarter of each log."""
    logs = [w for w in windows if w.first.size]
    if len(logs) > 2:
        return np.concatenate([np.full(w.first.size, w is logs[-1]) for w in windows])
    return np.concatenate([w.first >= 0.75 * w.experiment.samples for w in windows])


def _compete(
    option: str, rows: _Rows, near: float, seed: int
) -> tuple[ScaledNetwork, list[dict[str, Any]]]:
    """Train a network, and give root mean squares of its errors and those of the equation.

    ``rows`` are inputs, ``(n, q)``, target, errors of the equation and a mask of what is held out,
    ``(n,)`` each. Training rows whose first input is below ``near`` are repeated until they are
    half of all: their targets are small and would hardly count.
    """
    inputs, target, errors, held = rows
    rival, size, chosen = _RIVALS[option], np.abs(inputs[:, 0]), np.flatnonzero(~held)
    if chosen.size < _TRAINED:
        raise LogError(
            f"only {chosen.size} rows of {option} can be had from the logs",
            expected=f"A network needs {_TRAINED} or more. Nothing was written.",
            remedy="Record both pressures in one log over strokes at steady commands and give both "
            f"areas, or leave out --{option} mlp.",
        )
    chosen = chosen[:: -(-chosen.size // _MOST)]
    close = chosen[size[chosen] < near]
    if close.size:
        chosen = np.concatenate((chosen, np.tile(close, max(chosen.size // close.size - 1, 0))))
    scaling = Scaling.of(inputs[chosen], target[chosen])
    x, y = scaling.inputs(inputs[chosen]), scaling.output(target[chosen])
    rng = np.random.default_rng([seed, rival.units, x.shape[1]])
    found = search(x, y, Training((rival.units,), starts=8), rng)[0]
    net, table = ScaledNetwork(found.network, scaling), []
    both = {rival.law: errors, "network": net(inputs) - target}
    for where, part in ((rival.near, held & (size <= near)), (rival.away, held & (size > near))):
        if part.sum() >= _FEW:
            rms = {n: float(np.sqrt(np.mean(e[part] ** 2))) for n, e in both.items()}
            of = {"where": where, "limit": near, "unit": rival.unit, "windows": int(part.sum())}
            table.append({**of, **rms})
    return net, table


def _quiet_windows(setup: Setup) -> list[Windows]:
    """Overlapping windows in which the command hardly moves, of every chamber of every log.

    The mean flow belongs to the mean command only while the command stays on one side of an
    edge of the dead zone.
    """
    windows, out = setup.cut(overlap=8), []
    most = 0.03 * max(float(np.abs(w.command).max()) for w in windows)
    for w in windows:
        spread = [np.ptp(w.command[a:b]) for a, b in zip(w.first, w.last)]
        out.append(w.chosen(np.array(spread) <= most))
    return out


def _near_zero(windows: Sequence[Windows], values: Values) -> float:
    """Command up to which the dead zone matters [V]."""
    volts = max(float(np.abs(w.command).max()) for w in windows)
    edge = max(abs(values[z]) for z in EDGES)
    return min(max(2.0 * edge, 0.05 * volts), 0.3 * volts)


def _flow_rows(windows: Sequence[Windows], values: Values) -> tuple[FloatArray, FloatArray]:
    """Inputs (command, pressure) and flow of every window, ``(m, 2)`` and ``(m,)``."""
    beta = values.get("bulk_modulus", np.inf)
    inputs = [np.column_stack((w.mean_command, w.mean_pressure)) for w in windows]
    return np.concatenate(inputs), np.concatenate([w.motion - w.swelling / beta for w in windows])


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
