"""The closed loop: a controller once per sample, and a plant that is followed exactly between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import UsageError
from ..experiment import FloatArray
from .controllers.base import Controller
from .plants.base import Plant

Course = Callable[[FloatArray], FloatArray]
_MOST = 1_000_000
_FAR = 1e4  # times as far off as the reference ever goes: the loop runs away


@dataclass(frozen=True)
class LoopResponse:
    """Response of a closed loop, sample by sample.

    Attributes
    ----------
    time : (n,)
        [s]
    reference, output : (n,)
        [SI unit of the output]
    commands : (n, m)
        Held from each sample on.
    measured
        Everything that was measured, by role, each ``(n,)``.
    """

    time: FloatArray
    reference: FloatArray
    output: FloatArray
    commands: FloatArray
    measured: Mapping[str, FloatArray]

    @property
    def error(self) -> FloatArray:
        """``reference - output``, ``(n,)``."""
        return self.reference - self.output


def count_samples(duration: float, sample_time: float) -> int:
    """Samples from 0 to the end of the duration [s], both included.

    Raises
    ------
    UsageError
        When there are fewer than two or too many.
    """
    samples = round(duration / sample_time) + 1
    if not 2 <= samples <= _MOST:
        raise UsageError(
            f"{duration:g} s in steps of {sample_time:g} s are {samples} samples",
            expected=f"Expected 2 to {_MOST}.",
            remedy="Change --duration, or the sample time of the controller.",
        )
    return samples


def run_loop(
    plant: Plant, controller: Controller, reference: Course, duration: float, start: float
) -> LoopResponse:
    """Run the loop from rest.

    At every sample the plant is measured, the controller steps at once, and its commands are held
    until the next sample: a computation that takes time is a dead time of the plant.

    Parameters
    ----------
    plant, controller
        Both are reset, and have the same sample time.
    reference
        Course of the wanted output.
    duration
        [s]
    start
        Output at the beginning [its unit].

    Raises
    ------
    UsageError
        When the sample times differ, or the loop runs away.
    """
    if abs(plant.sample_time - controller.sample_time) > 1e-9 * plant.sample_time:
        raise UsageError(
            f"the controller steps every {controller.sample_time:g} s and the plant every "
            f"{plant.sample_time:g} s"
        )
    samples = count_samples(duration, controller.sample_time)
    time = controller.sample_time * np.arange(samples, dtype=np.float64)
    wanted = reference(time)
    far = _FAR * float(np.abs(wanted - start).max())
    controller.reset()
    plant.reset(start, controller.begins)
    rows: list[dict[str, float]] = []
    commands: list[tuple[float, ...]] = []
    for r in wanted.tolist():
        measured = dict(plant.measure())
        command = controller.step(measured, r)
        off = abs(r - measured[plant.controlled.role])
        if not (off <= far and all(map(np.isfinite, (*measured.values(), *command)))):
            raise UsageError(
                f"the loop runs away: after {time[len(rows)]:g} s it is {off:.3g} "
                f"{plant.controlled.unit} off its reference",
                remedy="Choose smaller gains, or set limits.",
            )
        rows.append(measured)
        commands.append(command)
        plant.advance(command)
    table = {role: np.array([row[role] for row in rows]) for role in rows[0]}
    return LoopResponse(time, wanted, table[plant.controlled.role], np.array(commands), table)
