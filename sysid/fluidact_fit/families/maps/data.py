"""All logs in one table of inputs and outputs, its checks and its scaling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...branches import BoolArray, choose_dead_band, motion_state, settled_samples
from ...errors import LogError, Notice, NotIdentifiedError
from ...experiment import Experiment, FloatArray
from ...signals import held_direction, smooth
from .options import Options

_SETTLED = 0.1  # share of the range after a reversal within which branches change over


@dataclass(frozen=True)
class Data:
    """All logs in one table.

    ``x`` has shape ``(n, inputs)``, all others ``(n,)`` [SI]. ``used`` marks what is fitted,
    ``settled`` what lies well within a branch.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    x: FloatArray
    y: FloatArray
    used: BoolArray
    direction: FloatArray
    settled: BoolArray
    position: FloatArray
    log: npt.NDArray[np.intp]
    parts: tuple[slice, ...]
    unit: str

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Values per experiment."""
        return [values[p] for p in self.parts]


def gather(experiments: Sequence[Experiment], names: tuple[str, ...], options: Options) -> Data:
    """All logs in one table, with the motion state of every sample."""
    x, y, directions, settled, positions, logs = [], [], [], [], [], []
    parts, begin = [], 0
    for e in experiments:
        x.append(input_table(e, names, options))
        y.append(column_of(e, options.target))
        command = column_of(e, "command")
        direction = _direction(e, "command", options.dead_band)
        directions.append(direction)
        settled.append(settled_samples(command, direction, _SETTLED * float(np.ptp(command))))
        positions.append(column_of(e, "position"))
        logs.append(np.full(e.samples, e.log))
        parts.append(slice(begin, begin + e.samples))
        begin += e.samples
    table = np.vstack(x)
    state = np.concatenate(directions)
    used = np.isfinite(table).all(axis=1) & np.isfinite(np.concatenate(y))
    if "direction" in names:
        used &= state != 0.0
    units = tuple(
        "m/s" if n == "velocity" and n not in experiments[0] else
        "1" if n == "direction" else experiments[0].signals[n].unit for n in names
    )  # fmt: skip
    return Data(
        names, units, table, np.concatenate(y), used, state, np.concatenate(settled),
        np.concatenate(positions), np.concatenate(logs), tuple(parts),
        experiments[0].signals[options.target].unit,
    )  # fmt: skip


def input_table(e: Experiment, names: Sequence[str], options: Options) -> FloatArray:
    """Inputs of one experiment, shape ``(n, inputs)`` [SI]."""
    source = options.source if options.source in e else "force"
    return np.column_stack(
        [
            _direction(e, source, options.dead_band if source == "command" else None)
            if n == "direction"
            else column_of(e, n)
            for n in names
        ]
    )


def column_of(e: Experiment, role: str) -> FloatArray:
    """Values of a role at every sample; a constant given by ``--step`` is spread out.

    Raises
    ------
    LogError
        When the log does not hold it and it cannot be computed.
    """
    if role == "velocity" and "velocity" not in e:
        return _velocity(e)
    if role not in e:
        raise LogError(
            f"the network needs '{role}', and there is none.",
            where=e.name,
            remedy=f"Give --column {role}=HEADER, --step {role}=VALUE:VALUE for a constant, or "
            "--inputs without it.",
        )
    return e.sampled(role)


def _velocity(e: Experiment) -> FloatArray:
    """Velocity from position: local polynomials, or differences on uneven time [m/s]."""
    if e.time.size < 5 or "position" not in e:
        raise LogError(
            "the network needs 'velocity', and without time it cannot be computed.",
            where=e.name,
            remedy="Give --column velocity=HEADER or --column time=HEADER, or --inputs without it.",
        )
    position = column_of(e, "position")
    if e.uniform:
        return smooth(position, e.sample_time, 5).rate
    return np.asarray(np.gradient(position, e.time))


def _direction(e: Experiment, source: str, dead_band: float | None) -> FloatArray:
    """Motion state of each sample: the log's own, or the held sign of a change."""
    if "direction" in e:
        return motion_state(column_of(e, "direction"))
    values = column_of(e, source)
    band = choose_dead_band(values) if dead_band is None else dead_band
    return held_direction(values, band).astype(float)


def check_data(data: Data, options: Options) -> None:
    """Refuse data that no network can be trained on."""
    rows = int(data.used.sum())
    units = options.hidden or (2,)
    needed = 2 * (sum(units) * (data.x.shape[1] + 2) + 1)
    if rows < needed:
        raise NotIdentifiedError(
            f"{rows} samples cannot determine a network of {needed // 2} weights or so.",
            expected=f"At least {needed} samples with a known motion state.",
            remedy="Record longer, give fewer --hidden units, or check --dead-band.",
        )
    moving = [k for k, n in enumerate(data.names) if n != "direction"]
    spread = [float(np.ptp(data.x[data.used, k])) for k in moving]
    main = (
        data.names.index("force" if options.target == "command" else "command")
        if ({"force", "command"} & set(data.names))
        else -1
    )
    still = main >= 0 and spread[moving.index(main)] == 0.0
    if still or float(np.ptp(data.y[data.used])) == 0.0:
        raise NotIdentifiedError(
            f"command or force does not change in these {rows} samples.",
            remedy="Record the force while the command is raised and lowered over its range.",
        )


def data_notices(data: Data) -> list[Notice]:
    """Warnings about what the data cannot tell."""
    out = []
    for k, name in enumerate(data.names):
        if np.ptp(data.x[data.used, k]) > 0.0:
            continue
        value, unit = data.x[data.used][0, k], data.units[k]
        out.append(
            Notice(
                "input-constant",
                f"{name} is {value:.6g} {unit} in all samples: the network says nothing about "
                f"another {name}. Record more of them, or leave it out of --inputs.",
            )
        )
    return out


@dataclass(frozen=True)
class Scaling:
    """From SI to order one: ``z = (x - offset) / scale``, the output alike."""

    offset: FloatArray
    scale: FloatArray
    base: float
    span: float

    @classmethod
    def of(cls, data: Data) -> Scaling:
        """Scaling that gives the used samples zero mean and unit deviation."""
        x, y = data.x[data.used], data.y[data.used]
        offset, scale = x.mean(axis=0), x.std(axis=0)
        for k, name in enumerate(data.names):
            if name == "direction":  # 1 and -1 are of order one, and stay readable
                offset[k], scale[k] = 0.0, 1.0
        scale = np.where(scale > 1e-12 * np.maximum(np.abs(offset), 1e-300), scale, 1.0)
        return cls(offset, scale, float(y.mean()), float(y.std()))

    def inputs(self, x: FloatArray) -> FloatArray:
        """Inputs in SI as standardised ones."""
        return np.asarray((x - self.offset) / self.scale)

    def output(self, y: FloatArray) -> FloatArray:
        """Outputs in SI as standardised ones."""
        return np.asarray((y - self.base) / self.span)
