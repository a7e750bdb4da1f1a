"""Logs as tables of inputs and outputs, what a network gives for them, and what they lack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...errors import LogError, Notice, NotIdentifiedError
from ...estimation.map import lone_samples
from ...estimation.motion_state import (
    choose_dead_band,
    fill_start,
    held_direction,
    motion_state,
    settled_samples,
)
from ...estimation.scaled_network import ScaledNetwork
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Simulated
from ...signals import smooth
from ...units import after_number
from .options import ForceMapOptions, default_inputs

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

    @cached_property
    def levels(self) -> npt.NDArray[np.intp]:
        """Number of the position level of each used sample: gaps of 3 % of the range divide them.

        A few samples by themselves, as noise makes them, are no level but belong to the one below,
        and so do those whose gap is lost in the scatter of the level on either side.
        """
        position = self.position[self.used]
        order = np.argsort(position, kind="stable")
        ascending = position[order]
        label = np.concatenate(([0], np.cumsum(np.diff(ascending) > 0.03 * np.ptp(position))))
        own = np.bincount(label) >= max(5, position.size // 100)
        level = np.maximum(np.cumsum(own) - 1, 0)[label]
        first = np.flatnonzero(np.diff(level)) + 1
        scatter = np.array([part.std() for part in np.split(ascending, first)])
        wide = np.maximum(scatter[:-1], scatter[1:])
        apart = ascending[first] - ascending[first - 1] > wide
        out = np.empty(position.size, dtype=np.intp)
        out[order] = np.concatenate(([0], np.cumsum(apart)))[level]
        return out


def settle_dead_bands(
    experiments: Sequence[Experiment], options: ForceMapOptions
) -> ForceMapOptions:
    """Changes of command and force that are no noise in any log, where a log's own state lacks."""
    apart = [e for e in experiments if "direction" not in e]
    bands = {"command": options.dead_band, "force": options.force_dead_band}
    for role in (role for role, band in bands.items() if band is None and apart):
        bands[role] = max(choose_dead_band(column_of(e, role)) for e in apart)
    return replace(options, dead_band=bands["command"], force_dead_band=bands["force"])


def gather(
    experiments: Sequence[Experiment], names: tuple[str, ...], options: ForceMapOptions
) -> Data:
    """All logs in one table, with the motion state of every sample."""
    directions, settled = zip(*(branch_of(e, options) for e in experiments))
    table = np.vstack([input_table(e, names, options) for e in experiments])
    y, position = (
        np.concatenate([column_of(e, role) for e in experiments])
        for role in (options.target, "position")
    )
    computed = {"velocity": "m/s", "direction": "1"}
    units = tuple(experiments[0].units.get(n) or computed[n] for n in names)
    return Data(
        names, units, table, y, is_known(table, names) & np.isfinite(y),
        np.concatenate(directions), np.concatenate(settled), position,
        np.repeat([e.log for e in experiments], [e.samples for e in experiments]),
    )  # fmt: skip


def input_table(e: Experiment, names: Sequence[str], options: ForceMapOptions) -> FloatArray:
    """Inputs of one experiment, shape ``(n, inputs)`` [SI]; a motion state of 0 is unknown."""
    source = "command" if "command" in e else "force"
    return np.column_stack(
        [_direction(e, source, options) if n == "direction" else column_of(e, n) for n in names]
    )


def state_column(names: Sequence[str]) -> int | None:
    """Number of the motion state among the inputs."""
    return names.index("direction") if "direction" in names else None


def is_known(table: FloatArray, names: Sequence[str]) -> BoolArray:
    """Rows whose inputs are all there, the motion state too."""
    known = np.isfinite(table).all(axis=1)
    state = state_column(names)
    return np.asarray(known if state is None else known & (table[:, state] != 0.0))


def branch_of(e: Experiment, options: ForceMapOptions) -> tuple[FloatArray, BoolArray]:
    """Motion state by the command, and the samples that are well within a branch."""
    command, direction = column_of(e, "command"), _direction(e, "command", options)
    least = _SETTLED * float(np.ptp(command))
    return direction, settled_samples(command, direction, least)


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


def _direction(e: Experiment, source: str, options: ForceMapOptions) -> FloatArray:
    """Motion state of each sample: the log's own, or the held sign of a change."""
    if "direction" in e:
        return motion_state(column_of(e, "direction"))
    return held_state(column_of(e, source), source, options)


def held_state(values: FloatArray, source: str, options: ForceMapOptions) -> FloatArray:
    """Held sign of the change of a command or a force."""
    band = options.dead_band if source == "command" else options.force_dead_band
    if band is None:  # no log of the fit needed one
        band = choose_dead_band(values)
    return held_direction(values, band)


def predict_runs(
    network: ScaledNetwork, experiments: Sequence[Experiment], options: ForceMapOptions
) -> list[Simulated]:
    """Output of every run; rows without a motion state and lone samples are not described.

    The first motion state is that of the beginning, too; one that is never known is loading.
    """
    out = []
    for e in experiments:
        names = options.names or default_inputs(options, [e])
        x = input_table(e, names, options)
        used, state = is_known(x, names), state_column(names)
        if state is not None:
            fill_start(x[:, state])
            x[:, state] = np.where(x[:, state] < 0.0, -1.0, 1.0)
        y = network(x)
        if options.target in e:
            measured = column_of(e, options.target)
            there = np.isfinite(measured)
            level, rest = np.where(there, (measured - network.scaling.base, measured - y), 0.0)
            used &= there & ~lone_samples(level, rest, branch_of(e, options)[1])
        out.append(Simulated(y, used))
    return out


def check_data(data: Data, options: ForceMapOptions) -> None:
    """Refuse data that no network can be trained on."""
    rows = int(data.used.sum())
    units = options.layers or (2,)
    needed = 2 * (sum(units) * (data.x.shape[1] + 2) + 1)
    if rows < needed:
        raise NotIdentifiedError(
            f"{rows} samples cannot determine a network of {needed // 2} weights or so.",
            expected=f"At least {needed} samples with a known motion state.",
            remedy="Record longer, give fewer --hidden units, or check --dead-band.",
        )
    moving = [data.y[data.used]]
    if options.driver in data.names:
        moving.append(data.x[data.used, data.names.index(options.driver)])
    if any(np.ptp(values) == 0.0 for values in moving):
        raise NotIdentifiedError(
            f"command or force does not change in these {rows} samples.",
            remedy="Record the force while the command is raised and lowered over its range.",
        )


def data_notices(data: Data) -> list[Notice]:
    """Warnings about what the data cannot tell."""
    x = data.x[data.used]
    return [
        Notice(
            "input-constant",
            f"{name} is {column[0]:.6g}{after_number(unit)} in all samples: the network says "
            f"nothing about another {name}. Record more of them, or leave it out of --inputs.",
        )
        for name, unit, column in zip(data.names, data.units, x.T)
        if np.ptp(column) == 0.0
    ]
