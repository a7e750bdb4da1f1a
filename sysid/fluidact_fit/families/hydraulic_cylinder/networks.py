"""Small networks of the flow and of the friction, beside the equations they compete with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...errors import LogError
from ...estimation.named_model import Values
from ...experiment import BoolArray, FloatArray
from ...family import Curve, PhysicsView, Quantity, StaticView, Value, scalars
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import EDGES, chamber_flow
from .case import Case
from .windows import Windows

NETWORKS = ("flow_1", "flow_2", "friction")
_RAMP = 1.5  # how much shorter the windows of a fast ramp are; speed is noisier there
_FEW = 5  # windows that a comparison needs
_HIDDEN = {"flow": 10, "friction": 6}  # units of the networks
_WINDOWS = 1500  # rows a network is trained on, before those near zero are repeated


class Network(NamedTuple):
    """One hidden layer of rectified linear units with its standardisation.

    ``y = output_offset + output_scale (weights_2 max(weights_1 x + biases_1, 0) + biases_2)``
    with ``x = (input - input_offset) / input_scale``. Shapes are ``(hidden, inputs)``,
    ``(hidden,)``, ``(1, hidden)`` and ``(1,)`` of the layers, ``(inputs,)`` and ``(1,)`` of
    offsets and scales, which have the units of inputs and output.
    """

    weights_1: FloatArray
    biases_1: FloatArray
    weights_2: FloatArray
    biases_2: FloatArray
    input_offset: FloatArray
    input_scale: FloatArray
    output_offset: FloatArray
    output_scale: FloatArray

    def __call__(self, inputs: FloatArray) -> FloatArray:
        """Outputs ``(n,)`` for inputs ``(n, inputs)``, all in their own units."""
        x = (inputs - self.input_offset) / self.input_scale
        layer = np.maximum(x @ self.weights_1.T + self.biases_1, 0.0)
        y = layer @ self.weights_2[0] + self.biases_2[0]
        return np.asarray(self.output_offset[0] + self.output_scale[0] * y)


LAYERS = Network._fields


def _train(inputs: FloatArray, target: FloatArray, hidden: int, seed: int) -> Network:
    """Train on inputs ``(n, inputs)`` and a target ``(n,)`` in any units; see :func:`search`."""
    from ...estimation.network import Training, search

    centre, spread = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), 1e-300)
    middle, size = target.mean(keepdims=True), np.maximum(target.std(keepdims=True), 1e-300)
    rng = np.random.default_rng([seed, hidden, inputs.shape[1]])
    x, y = (inputs - centre) / spread, (target - middle) / size
    net = search(x, y, Training((hidden,), starts=8), rng).best.network
    (w1, w2), (b1, b2) = net.weights, net.biases
    return Network(w1, b1, w2, b2, centre, spread, middle, size)


def network_of(parameters: Mapping[str, Any], name: str) -> Network | None:
    """Read a network back from the parameters of a file; ``None`` when there is none."""
    if f"{name}_weights_1" not in parameters:
        return None
    return Network(*(np.asarray(parameters[f"{name}_{layer}"], dtype=float) for layer in LAYERS))


def fit_networks(case: Case, values: Values) -> tuple[dict[str, Quantity], dict[str, Any]]:
    """Train what was asked for and compare it with the equations on rows held out.

    Returned are the layers, their standardisation in SI units, and the comparisons as rows of
    tables by title, for the file and the report.
    """
    nets: dict[str, Network] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    if case.options.flow == "mlp":
        windows, table = _quiet_windows(case), []
        for chamber in case.chambers:
            own = [w for w in windows if w.chamber == chamber]
            nets[f"flow_{chamber}"], found = _flow_network(case, own, values)
            table += [{"chamber": chamber, **row} for row in found]
        tables["Flow: models on held-out windows"] = table
    if case.options.friction == "mlp":
        nets["friction"], table = _friction_network(case, values)
        tables["Friction: models on held-out windows"] = table
    layers = {
        f"{name}_{layer}": Quantity(numbers.tolist(), "1", "estimated")
        for name, net in nets.items()
        for layer, numbers in net._asdict().items()
    }
    return layers, {title: table for title, table in tables.items() if table}


def _quiet_windows(case: Case) -> list[Windows]:
    """Overlapping windows in which the command hardly moves, shorter ones where it ramps fast.

    The mean flow belongs to the mean command only while the command stays on one side of an
    edge of the dead zone.
    """
    out = []
    for shorter in (1.0, _RAMP):
        found = case.cut(8, shorter)
        most = 0.03 * max(float(np.abs(w.command).max()) for w in found)
        for w in found:
            spread = np.array([np.ptp(w.command[a:b]) for a, b in zip(w.first, w.last)])
            # shorter ones only where a long one would be too long
            needed = spread * shorter > most if shorter > 1.0 else True
            out.append(w.chosen((spread <= most) & needed))
    return [w for w in out if w.first.size]


def _held_out(case: Case, w: Windows) -> BoolArray:
    """Windows that judge: the last of three logs or more, else the last quarter of each log."""
    if len(case.experiments) > 2:
        return np.full(w.first.size, w.experiment == len(case.experiments) - 1)
    return np.asarray(w.first >= 0.75 * case.experiments[w.experiment].samples)


def _near_zero(windows: Sequence[Windows], values: Values) -> float:
    """Command up to which the dead zone matters [V]."""
    volts = max(float(np.abs(w.command).max()) for w in windows)
    edge = max(abs(values[z]) for z in EDGES)
    return min(max(2.0 * edge, 0.05 * volts), 0.3 * volts)


def _flow_network(
    case: Case, windows: Sequence[Windows], values: Values
) -> tuple[Network, list[dict[str, Any]]]:
    """Network of one chamber's flow from command and pressure, beside the equations.

    Rows near zero command are repeated until they are half of all. Their flows are small:
    unweighted, they would hardly count.
    """
    near, held = _near_zero(windows, values), [_held_out(case, w) for w in windows]
    inputs, flow = _flow_rows([w.chosen(~h) for w, h in zip(windows, held)], values)
    rows = np.arange(0, flow.size, max(1, -(-flow.size // _WINDOWS)))
    close = rows[np.abs(inputs[rows, 0]) < near]
    if close.size:
        rows = np.concatenate((rows, np.tile(close, max(rows.size // close.size - 1, 0))))
    net = _train(inputs[rows], flow[rows], _HIDDEN["flow"], case.request.seed)
    tests = [w.chosen(h) for w, h in zip(windows, held)]
    inputs, flow = _flow_rows(tests, values)
    law = np.concatenate([w.flow(values, case.machine) for w in tests])
    errors = {"orifice": law - flow, "network": net(inputs) - flow}
    words = "near zero command", "away from zero command"
    return net, _compare(np.abs(inputs[:, 0]), near, errors, words, "m3/s")


def _flow_rows(windows: Sequence[Windows], values: Values) -> tuple[FloatArray, FloatArray]:
    """Inputs (command, pressure) and flow of every window, ``(m, 2)`` and ``(m,)``."""
    beta = values.get("bulk_modulus", np.inf)
    inputs = [np.column_stack((w.mean_command, w.mean_pressure)) for w in windows]
    return np.concatenate(inputs), np.concatenate([w.motion - w.swelling / beta for w in windows])


def _friction_network(case: Case, values: Values) -> tuple[Network, list[dict[str, Any]]]:
    """Network of the friction over speed, beside Coulomb and viscous friction."""
    speed, force = case.friction.speed, case.friction.force
    if speed.size < 40:
        raise LogError(
            f"only {speed.size} rows of friction can be had from the logs",
            expected="A network needs 40 or more.",
            remedy="Record both pressures in one log and give both areas, or leave out "
            "--friction mlp.",
        )
    held = (np.arange(speed.size) // 20) % 4 == 3
    net = _train(speed[~held, None], force[~held], _HIDDEN["friction"], case.request.seed)
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


def flow_view(case: Case, parameters: Mapping[str, Value]) -> StaticView | None:
    """Flow over the command near zero: measured, network, equations with a dead zone and without.

    The pressure goes up and down with the command's history, so that no single one belongs to a
    command: each curve is a running mean of what a model says of the measured windows.
    ``None`` for a file without a network of the flow, and without a window near zero.
    """
    chamber = case.chambers[0]
    net, values = network_of(parameters, f"flow_{chamber}"), scalars(parameters)
    if net is None:
        return None
    windows = _quiet_windows(case)
    reach = 2.0 * _near_zero(windows, values)
    inputs, flow = _flow_rows([w for w in windows if w.chamber == chamber], values)
    used = np.abs(inputs[:, 0]) <= reach
    if not used.any():
        return None
    seen, pressure = inputs[used].T
    command = np.linspace(seen.min(), seen.max(), 401)
    fitted = net(inputs)
    shut = {**values, **dict.fromkeys(EDGES, 0.0)}
    models = {
        "network": fitted[used],
        "equations, no dead zone": chamber_flow(chamber, seen, pressure, shut, case.machine),
        "equations": chamber_flow(chamber, seen, pressure, values, case.machine),
    }
    return StaticView(
        "command", "V", f"flow_{chamber}", "m3/s", inputs[:, 0], flow, fitted, used,
        [Curve(n, command, _running_mean(command, seen, m)) for n, m in models.items()],
    )  # fmt: skip


def _running_mean(command: FloatArray, seen: FloatArray, flow: FloatArray) -> FloatArray:
    """Mean flow ``(n,)`` of the 2 % of the windows whose command ``(m,)`` is closest."""
    near = max(seen.size // 50, 1)
    closest = np.argpartition(np.abs(command[:, None] - seen), near - 1, axis=1)[:, :near]
    return np.asarray(flow[closest].mean(axis=1))


def flow_curve(case: Case, values: Values) -> PhysicsView | None:
    """Flow of a chamber over the command by the equations, and what was measured beside it.

    The curve is at the median pressure of either direction. A point is the curve plus what the
    flow of a window exceeds that of the equations at its own pressure by. ``None`` where no window
    has a steady command.
    """
    if not case.chambers:
        return None
    chamber = case.chambers[0]
    windows = [w for w in _quiet_windows(case) if w.chamber == chamber]
    if not sum(w.motion.size for w in windows):
        return None
    inputs, flow = _flow_rows(windows, values)
    seen, pressure = inputs.T
    out = seen >= 0.0
    middle = [float(np.median(pressure[way])) if way.any() else 0.0 for way in (out, ~out)]

    def at_middle(command: FloatArray) -> FloatArray:
        level = np.where(command >= 0.0, *middle)
        return np.asarray(chamber_flow(chamber, command, level, values, case.machine))

    beyond = flow - chamber_flow(chamber, seen, pressure, values, case.machine)
    command = np.linspace(seen.min(), seen.max(), 400)
    return PhysicsView(
        f"Flow of chamber {chamber} over command", "command", "V", "flow", "m3/s",
        Curve("measured", seen, at_middle(seen) + beyond),
        [Curve("valve and line", command, at_middle(command))],
    )  # fmt: skip
