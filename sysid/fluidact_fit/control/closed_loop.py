"""From files to closed-loop responses: the nominal one, and the band of drawn machines.

The controller knows the parameter files as they are. For the band, the *machine* is drawn from the
covariance of every file, truncated to the ranges that the parameters can have, while the controller
keeps the gains and the compensation that follow from the nominal values: what is seen is the
tracking to expect of the true machine, not of one that the controller happens to know.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..block import Block
from ..errors import LogError, UsageError
from ..experiment import FloatArray
from ..parameters.document import ParameterDocument
from ..parameters.draws import draw_document
from ..units import conversion_factor
from .controller_file import ControllerFile, ReferenceKeys
from .controller_numbers import Entry, numbers_of
from .controllers import Controller
from .extrapolation import extrapolations
from .loading import make_block
from .loop import Course, LoopResponse, run_loop
from .machines import make_controller, make_plant
from .margins import Margins, loop_margins
from .metrics import StepMetrics, TrackingMetrics, step_metrics, tracking_metrics
from .plants.base import Plant
from .references import KINDS, Reference, SampledReference

# What a reference does where the controller file does not say: start, size, at, speed, duration.
_USUAL = {
    "m": (0.0, 5e-4, 0.1, 5e-3, 10.0),
    "N": (0.0, 10.0, 0.1, 20.0, 2.0),
    "rad": (0.0, 1.0, 0.1, 1.0, 10.0),
}
_TRAVEL = {"m": 0.025}  # of triangles, sines and insertions, where it is not the size of a step


@dataclass(frozen=True)
class ClosedLoop:
    """Result of a closed-loop simulation.

    Attributes
    ----------
    plant, controller
        As the parameter files describe them.
    nominal
        Response of that plant.
    drawn
        Responses of the drawn plants; those that ran away or hit a limit are ``failed``.
    step
        Metrics, for a step; else ``None``.
    tracking
        Errors against the reference.
    margins
        ``None`` where the loop is not linear but for its friction.
    drawn_margins
        Those of the drawn machines with the same controller, as far as there are any.
    extrapolated
        Where the nominal response leaves what the logs covered.
    """

    plant: Plant
    controller: Controller
    nominal: LoopResponse
    drawn: tuple[LoopResponse, ...]
    failed: int
    step: StepMetrics | None
    tracking: TrackingMetrics
    margins: Margins | None
    drawn_margins: tuple[Margins, ...] = ()
    extrapolated: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[Entry, ...]:
        """Gains and whatever else the controller was made from."""
        command = self.plant.commands[0].unit
        return tuple(numbers_of(self.controller, self.plant.controlled.unit, command))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the loop."""
        found = list(self.controller.unreached)
        if self.margins is not None and self.margins.warning:
            found.append(self.margins.warning)
        elif unstable := sum(not m.stable for m in self.drawn_margins):
            found.append(
                f"the loop is unstable with {unstable} of {len(self.drawn_margins)} drawn "
                "machines. Choose smaller gains, or fit more logs."
            )
        return (*found, *self.extrapolated)

    def band(self, share: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Lower and upper edge ``(n,)`` of the middle share of the drawn outputs, pointwise."""
        outputs = np.array([r.output for r in self.drawn])
        low, high = np.quantile(outputs, [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=0)
        return low, high

    def spread(self, share: float = 0.9) -> dict[str, tuple[float, float]]:
        """Middle share of tracking metrics and finite margins over the drawn machines, by name."""
        rows = [tracking_metrics(r.reference, r.output).to_dict() for r in self.drawn]
        edges = [0.5 - 0.5 * share, 0.5 + 0.5 * share]
        found = {}
        for name in rows[0]:
            low, high = np.quantile([row[name] for row in rows], edges)
            found[name] = float(low), float(high)
        for name in ("gain", "phase"):
            values = [getattr(m, name) for m in self.drawn_margins]
            if values and np.isfinite(values).all():
                low, high = np.quantile(values, edges)
                found[f"{name}_margin"] = float(low), float(high)
        return found

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trajectories, as plain data."""
        out: dict[str, Any] = {
            "controlled": {"role": self.plant.controlled.role, "unit": self.plant.controlled.unit},
            "samples": self.nominal.time.size,
            "step": self.step.to_dict() if self.step else None,
            "tracking": self.tracking.to_dict(),
            "controller": {e.key: {"value": e.value, "unit": e.unit} for e in self.numbers},
            "margins": None,
            "warnings": list(self.warnings),
        }
        if self.margins is not None:
            out["margins"] = {
                n: v if np.isfinite(v) else None for n, v in vars(self.margins).items()
            } | {"stable": self.margins.stable}
        if self.drawn:
            out["draws"] = {
                "share": 0.9, "responses": len(self.drawn), "failed": self.failed,
                "spread": {n: list(v) for n, v in self.spread().items()},
            }  # fmt: skip
        return out

    def to_csv(self) -> str:
        """Return the trajectories: time, reference, commands, what was measured, and the band."""
        import pandas as pd  # slow to load

        r, unit = self.nominal, self.plant.controlled.unit
        table = {"time [s]": r.time, f"reference [{unit}]": r.reference}
        for port, values in zip(self.plant.commands, r.commands.T):
            table[f"{port.role} [{port.unit}]"] = values
        for role, values in r.measured.items():
            table[_header(role, self.plant)] = values
        if self.drawn:
            low, high = self.band()
            table[f"output_low_90 [{unit}]"] = low
            table[f"output_high_90 [{unit}]"] = high
        text: str = pd.DataFrame(table).to_csv(
            index=False, float_format="%.12g", na_rep="nan", lineterminator="\n"
        )
        return text


_UNITS = {"resistance": "N", "force": "N", "position": "m", "pressure_1": "Pa", "pressure_2": "Pa"}


def _header(role: str, plant: Plant) -> str:
    controlled = plant.controlled
    if role == controlled.role:
        return f"{role} [{controlled.unit}]"
    if role == "speed":
        return f"speed [{controlled.unit}/s]"
    unit = plant.units.get(role, _UNITS.get(role))
    return f"{role} [{unit}]" if unit else role


def simulate_loop(
    documents: Sequence[ParameterDocument], file: ControllerFile, kind: str, *,
    duration: float | None = None, draws: int = 0, seed: int = 0,
    accept: Callable[[Block], None] = lambda block: None,
) -> ClosedLoop:  # fmt: skip
    """Simulate the machine of parameter files under the controller of a controller file.

    Parameters
    ----------
    documents
        The parameter files.
    file
        The controller file.
    kind
        ``"step"``, ``"triangle"``, ``"sine"``, ``"ramp-insertion"``, or the path of a CSV with the
        columns ``time`` and ``reference``.
    duration
        [s]; as long as the reference where it is a CSV, else 10 s, and 2 s for a force.
    draws
        How many machines are drawn from the covariances.
    seed
        Of the draws.
    accept
        Called with every block, to accept what was not identified.

    Raises
    ------
    UsageError
        When the files do not make a machine for that controller, or the nominal loop runs away.
    """

    def build(some: Sequence[ParameterDocument]) -> list[Block]:
        blocks = [make_block(d) for d in some]
        for block in blocks:
            accept(block)
        return blocks

    blocks = build(documents)
    plant = make_plant(file, blocks)
    course, start, length = make_reference(kind, file.reference, plant.controlled.unit)
    if isinstance(course, Reference):
        course.check_sampling(file.sample_time)
    controller = make_controller(file, blocks, plant, start)
    span = length if duration is None else duration
    nominal = run_loop(plant, controller, course, span, start)
    rng, drawn, failed = np.random.default_rng(seed), [], 0
    margins: list[Margins] = []
    for _ in range(draws):
        other = build([draw_document(d, b.variant, rng) for d, b in zip(documents, blocks)])
        machine = make_plant(file, other)
        margins += filter(None, [loop_margins(machine, controller)])
        try:
            drawn.append(run_loop(machine, controller, course, span, start))
        except UsageError:
            failed += 1
    if draws and not drawn:
        raise UsageError(
            f"none of {draws} drawn machines can be followed",
            remedy="The parameters are too uncertain for this loop: fit more logs.",
        )
    metrics = None
    if isinstance(course, Reference) and course.kind == "step":
        metrics = step_metrics(
            nominal.time, nominal.output, course.start + course.size, at=course.at
        )
    return ClosedLoop(
        plant, controller, nominal, tuple(drawn), failed, metrics,
        tracking_metrics(nominal.reference, nominal.output), loop_margins(plant, controller),
        tuple(margins), tuple(extrapolations(blocks, plant, controller, nominal)),
    )  # fmt: skip


def make_reference(kind: str, keys: ReferenceKeys, unit: str) -> tuple[Course, float, float]:
    """Course of the reference, where it begins, and how long it is [s].

    Raises
    ------
    UsageError, LogError
        When it is neither a kind of reference nor a CSV that holds one.
    """
    if kind not in KINDS:
        sampled = _read_reference(kind, unit)
        return sampled, sampled.start, float(sampled.time[-1])
    start, size, at, speed, span = _USUAL.get(unit, (0.0, 1.0, 0.1, 1.0, 10.0))
    if kind != "step":
        size = _TRAVEL.get(unit, size)
    name = next(k for k in KINDS if k == kind)
    reference = Reference(
        name,
        start if keys.start is None else keys.start,
        size if keys.size is None else keys.size,
        at if keys.at is None else keys.at,
        speed if keys.speed is None else keys.speed,
        0.1 if keys.frequency is None else keys.frequency,
    )
    return reference, reference.start, span


def _read_reference(path: str, unit: str) -> SampledReference:
    """Samples of a CSV with the columns ``time`` and ``reference``, in their units or SI."""
    from ..logs import read_log

    if not os.path.exists(path):
        raise UsageError(
            f"--reference {path} is neither a kind of reference nor a file",
            expected=f"Expected {', '.join(KINDS)}, or a CSV with the columns time and reference.",
        )
    log = read_log(path)
    columns = {}
    for name, si in (("time", "s"), ("reference", unit)):
        found = [c for c in log.columns if c.name == name or c.header == name]
        if len(found) != 1 or not np.isfinite(found[0].values).all():
            raise LogError(
                f"it has no column {name!r} of numbers alone",
                where=log.name,
                expected="Expected the columns time and reference, for example 'reference [mm]'.",
            )
        given = found[0].unit
        columns[name] = found[0].values * (conversion_factor(given, si, log.name) if given else 1.0)
    try:
        return SampledReference(columns["time"] - columns["time"][0], columns["reference"])
    except UsageError as error:
        raise LogError(error.what, where=log.name) from error
