"""Given and recorded data of a fit: machine, chambers, windows, friction."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import LogError, UsageError
from ...experiment import BoolArray, Experiment, FloatArray
from ...family import Request, Variant
from ...mechanics.hydraulic_cylinder import SIGN, HydraulicMachine
from ...signals import smooth
from .options import HydraulicCylinderOptions
from .windows import Windows, cut_windows

_PRESSURES = "pressure_1", "pressure_2"
_CROSSED = 4.0  # times the force that swapped pressures leave, at which they are swapped
_WINDOW, _FEWEST = 0.02, 4.0  # s and samples, that a window has at least
_ABOVE_SUPPLY = 10.0  # times the supply pressure, more than any rod side is raised to


@dataclass(frozen=True)
class FrictionRows:
    """Speed [m/s] and friction force [N] over short windows or plateaus, one array each.

    ``in_time``: one row follows the other, so that their errors hang together.
    """

    speed: FloatArray
    force: FloatArray
    in_time: bool = False

    @property
    def slow(self) -> float:
        """Speed up to which a row has no certain direction [m/s]."""
        return 0.1 * float(np.quantile(np.abs(self.speed), 0.95)) if self.speed.size else 0.0

    @property
    def moving(self) -> BoolArray:
        """Rows fast enough to have a direction."""
        return np.abs(self.speed) > self.slow


@dataclass(frozen=True)
class Setup:
    """Data that a fit works on, as far as they were recorded.

    ``machine`` is without what the stage of the fit leaves aside, ``chambers`` are those whose
    pressure any log holds, ``window`` is the length of the windows [s].
    """

    variant: Variant
    experiments: Sequence[Experiment]
    request: Request[HydraulicCylinderOptions]
    machine: HydraulicMachine
    chambers: tuple[int, ...]
    window: float

    @property
    def options(self) -> HydraulicCylinderOptions:
        """The options of the request."""
        return self.request.options

    @property
    def both(self) -> bool:
        """Return whether every log holds both pressures."""
        return all(_holds_both(e) for e in self.experiments)

    @property
    def rest_position(self) -> float:
        """Mean position of the logs [m]."""
        return float(np.mean([np.mean(e["position"]) for e in self.experiments]))

    @cached_property
    def windows(self) -> list[Windows]:
        """Windows of every recorded chamber of every log."""
        return self.cut()

    def cut(self, overlap: int = 1) -> list[Windows]:
        """Cut the logs into windows, of which ``overlap`` begin within one length."""
        machine = self.machine
        windows = cut_windows(self.experiments, self.chambers, machine, self.window, overlap)
        if not windows:
            raise LogError(
                "no part of the logs says anything of the valve: there is no pressure drop left "
                "across it, or the pressure never settles",
                where=", ".join(e.name for e in self.experiments),
                expected=f"Supply {machine.supply:g} Pa, tank {machine.tank:g} Pa.",
                remedy="Check --supply-pressure, --tank-pressure and the unit of the pressures; "
                "give the dead volumes to use transients as well.",
            )
        return windows

    @cached_property
    def friction(self) -> FrictionRows:
        """Friction ``p1 A1 - p2 A2 - M a`` wherever it can be had."""
        if self.chambers != (1, 2):
            return FrictionRows(np.zeros(0), np.zeros(0))
        parts = [_friction_windows(e, self.machine) for e in self.experiments if _holds_both(e)]
        if not parts:
            return _paired_plateaus(self.windows, self.machine)
        speed, force = (np.concatenate(p) for p in zip(*parts))
        return FrictionRows(speed, force, in_time=True)


def _holds_both(e: Experiment) -> bool:
    return all(role in e for role in _PRESSURES)


def _friction_windows(e: Experiment, machine: HydraulicMachine) -> tuple[FloatArray, FloatArray]:
    """Windows of about 10 ms; without a mass those in which the speed hardly changes."""
    half = max(2, round(0.01 / e.sample_time))
    motion = smooth(e["position"], e.sample_time, half, 3)
    force = e.sampled("pressure_1") * machine.area(1) - e.sampled("pressure_2") * machine.area(2)
    smoothed = smooth(force, e.sample_time, half, 2).value
    speed, rows = motion.rate, np.arange(half, e.samples - half, half)
    if machine.mass is not None:
        smoothed = smoothed - machine.mass * motion.curvature
    else:
        change = np.abs(speed[rows + half - 1] - speed[rows - half])
        rows = rows[change < 0.1 * float(np.quantile(np.abs(speed), 0.95))]
    return speed[rows], smoothed[rows]


def _paired_plateaus(windows: Sequence[Windows], machine: HydraulicMachine) -> FrictionRows:
    """Combine logs of one chamber each: plateaus at the same command belong together."""
    means: dict[tuple[int, float], list[tuple[float, float]]] = {}
    for w in windows:
        area, level = machine.area(w.chamber), np.round(w.mean_command, 6)
        for u in np.unique(level):
            rows = level == u
            if u == 0.0 or rows.sum() < 3:
                continue
            force = area * float(np.mean(w.mean_pressure[rows]))
            speed = float(np.sum((w.motion * w.duration)[rows]) / np.sum(w.duration[rows]) / area)
            means.setdefault((w.chamber, float(u)), []).append((speed, force))
    pairs = [
        (0.5 * (v1 + v2), f1 - f2)
        for (chamber, u), found in sorted(means.items()) if chamber == 1
        for (v1, f1), (v2, f2) in zip(found, means.get((2, u), ()))
    ]  # fmt: skip
    return FrictionRows(*np.array(pairs).reshape(-1, 2).T)


def make_setup(
    variant: Variant,
    experiments: Sequence[Experiment],
    request: Request[HydraulicCylinderOptions],
) -> Setup:
    """Put together what a fit begins with.

    Raises
    ------
    UsageError, LogError
        When something that the logs need is missing, or cannot be.
    """
    for e in experiments:
        if not any(role in e for role in _PRESSURES):
            raise LogError(
                "neither chamber's pressure was recorded",
                where=e.name,
                expected="Expected pressure_1, pressure_2 or both.",
                remedy="Give --column pressure_1=... or --column pressure_2=...",
            )
    chambers = tuple(i for i in (1, 2) if any(f"pressure_{i}" in e for e in experiments))
    machine = read_machine(request.options, chambers)
    _check_pressures(machine, experiments)
    check_volumes(machine, experiments)
    shortest = _FEWEST * max(e.sample_time for e in experiments)
    window = request.options.window or max(_WINDOW, shortest)
    return Setup(variant, experiments, request, machine, chambers, window)


def _check_pressures(machine: HydraulicMachine, experiments: Sequence[Experiment]) -> None:
    """Refuse pressures far above the supply, and those that seem to be swapped.

    A rod side multiplies the supply by a few. ``p_1 A_1 - p_2 A_2`` moves the mass against
    friction: a small part of either force, unless the areas are those of the other chamber.
    """
    most, role = max((float(e[r].max()), r) for e in experiments for r in _PRESSURES if r in e)
    if most > _ABOVE_SUPPLY * machine.supply:
        raise UsageError(
            f"--supply-pressure {machine.supply:g} Pa is far below the {most:.3g} Pa that "
            f"{role} reaches",
            expected="Expected a pressure in Pa: 50 bar are 5e6 Pa.",
            remedy="Check --supply-pressure and the units of the pressures and of the areas.",
        )
    both = [e for e in experiments if _holds_both(e)]
    if not both:
        return
    p1, p2 = (np.concatenate([e.sampled(r) for e in both]) for r in _PRESSURES)
    area_1, area_2 = machine.area(1), machine.area(2)
    net = float(np.linalg.norm(area_1 * p1 - area_2 * p2))
    if net > _CROSSED * float(np.linalg.norm(area_2 * p1 - area_1 * p2)):
        raise LogError(
            "'pressure_1' and 'pressure_2' do not balance the piston, and would the other way "
            "round: the two columns seem to be swapped",
            remedy="Check --column pressure_1=... and --column pressure_2=...",
        )


def known_chambers(names: Collection[str]) -> list[int]:
    """Chambers of which a file has the valve gain, by the names of its parameters."""
    return [i for i in (1, 2) if f"valve_gain_{i}" in names]


def read_machine(options: HydraulicCylinderOptions, chambers: Sequence[int]) -> HydraulicMachine:
    """Read what is given.

    Raises
    ------
    UsageError
        When something that the recorded chambers need is missing, or cannot be.
    """
    o = options
    needed = {f"--area-{i}": getattr(o, f"area_{i}") for i in chambers}
    needed["--supply-pressure"] = o.supply_pressure
    missing = [n for n, value in needed.items() if value is None]
    if missing:
        raise UsageError(
            f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} needed",
            expected="Areas and supply pressure are properties of the machine that the logs "
            "cannot tell; nothing is assumed for them.",
            remedy="Give "
            + ", ".join(f"{m} NUMBER" for m in missing)
            + " in SI units (m2, Pa), or with a unit on the command line (4.91cm2, 50bar).",
        )
    supply = o.supply_pressure or 0.0
    if o.tank_pressure >= supply:
        raise UsageError(
            f"the tank pressure {o.tank_pressure:g} Pa is not below the supply pressure "
            f"{supply:g} Pa",
            remedy="Correct --tank-pressure or --supply-pressure (Pa).",
        )
    if o.area_1 is not None and o.area_2 is not None and o.area_2 > o.area_1:
        raise UsageError(
            f"the area of chamber 2, {o.area_2:g} m2, is larger than that of chamber 1, "
            f"{o.area_1:g} m2: the rod takes area off chamber 2",
            remedy="Correct --area-1 or --area-2 (m2), or exchange the chambers.",
        )
    machine = HydraulicMachine(
        o.area_1, o.area_2, o.dead_volume_1, o.dead_volume_2, o.mass, supply, o.tank_pressure
    )
    if o.stage == "gray-box" and not machine.complete:
        raise UsageError(
            "--mass, --dead-volume-1 and --dead-volume-2 are needed with --stage gray-box",
            remedy="Give them, or fit again.",
        )
    return machine


def check_volumes(machine: HydraulicMachine, experiments: Sequence[Experiment]) -> None:
    """Refuse dead volumes that would leave a chamber without oil.

    Raises
    ------
    UsageError
        With the position at which a volume is used up, and the least that it has to be.
    """
    for chamber, sign in SIGN.items():
        dead = machine.dead_volume(chamber)
        if dead is None or getattr(machine, f"area_{chamber}") is None:
            continue
        deepest, name = min((float((sign * e["position"]).min()), e.name) for e in experiments)
        taken = -machine.area(chamber) * deepest
        if dead <= taken:
            raise UsageError(
                f"--dead-volume-{chamber} {dead:g}: chamber {chamber} would hold nothing at the "
                f"position {sign * deepest:.4g} m of {name}",
                expected=f"It is the volume at position 0 and more than {taken:.3g} m3 here.",
                remedy="Give the volume of chamber and line with the piston at position 0 (m3), "
                "and check the units of the areas (m2), and sign and unit of the position.",
            )
