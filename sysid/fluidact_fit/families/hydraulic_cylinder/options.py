"""Options: facts about the machine, choices, and what the fit settles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...estimation.stribeck import stribeck_choice
from ...options import FamilyOptions, choice, number, settled

STAGES = ("gray-box", "flow-balance")


def _given(help: str, unit: str) -> Any:
    return number(help=help, unit=unit, above=0.0)


def _found(help: str, unit: str) -> Any:
    return settled("float", help, unit=unit, above=0.0)


def _residual(channel: str, unit: str) -> Any:
    return _found(f"residuals of {channel}, the measure of its weight", unit)


@dataclass(frozen=True)
class HydraulicCylinderOptions(FamilyOptions):
    """Properties of the machine, and networks beside the equations."""

    area_1: float | None = _given("piston area of chamber 1", "m2")
    area_2: float | None = _given("piston area of chamber 2, rod taken off", "m2")
    dead_volume_1: float | None = _given("volume of chamber 1 and its line at position 0", "m3")
    dead_volume_2: float | None = _given("volume of chamber 2 and its line at position 0", "m3")
    mass: float | None = _given("moving mass", "kg")
    supply_pressure: float | None = _given("supply pressure, on the scale of the sensors", "Pa")
    tank_pressure: float = number(0.0, help="tank pressure, on the scale of the sensors", unit="Pa")
    flow: str = choice(
        "orifice",
        ("orifice", "mlp"),
        "orifice equations alone, or networks of the flow beside them",
    )
    friction: str = choice(
        "coulomb",
        ("coulomb", "mlp"),
        "Coulomb and viscous friction alone, or a network of the speed beside them",
    )
    stribeck: str = stribeck_choice()
    stage: str | None = settled(
        "choice",
        "what was fitted: all states, or the flow over short windows with the compression of the "
        "oil where its volume is given",
        choices=STAGES,
    )
    window: float | None = _found("length of the windows over which the flow is compared", "s")
    rest_position: float | None = settled(
        "float", "mean position of the logs, where a run without one begins", unit="m"
    )
    residual_pressure_1: float | None = _residual("pressure 1", "Pa")
    residual_pressure_2: float | None = _residual("pressure 2", "Pa")
    residual_position: float | None = _residual("the position", "m")
