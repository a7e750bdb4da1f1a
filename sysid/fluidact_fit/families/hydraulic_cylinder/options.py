"""What is known of the machine, what is asked for, and what the fit settles."""

from __future__ import annotations

from dataclasses import dataclass

from ...options import FamilyOptions, choice, number, settled

STAGES = ("gray-box", "flow-balance", "plateaus")


@dataclass(frozen=True)
class HydraulicCylinderOptions(FamilyOptions):
    """Properties of the machine, and networks beside the equations."""

    area_1: float | None = number(help="piston area of chamber 1", unit="m2", above=0.0)
    area_2: float | None = number(
        help="piston area of chamber 2, rod taken off", unit="m2", above=0.0
    )
    dead_volume_1: float | None = number(
        help="volume of chamber 1 and its line at position 0", unit="m3", above=0.0
    )
    dead_volume_2: float | None = number(
        help="volume of chamber 2 and its line at position 0", unit="m3", above=0.0
    )
    mass: float | None = number(help="moving mass", unit="kg", above=0.0)
    supply_pressure: float | None = number(
        help="supply pressure, on the scale of the sensors", unit="Pa", above=0.0
    )
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
    stage: str | None = settled(
        "choice",
        "what was fitted: all states, the flow over short windows with the compression of the oil "
        "where its volume is given, or the flow over plateaus with mass and volumes left aside",
        choices=STAGES,
    )
    window: float | None = settled(
        "float", "length of the windows over which the flow is compared", unit="s", above=0.0
    )
    rest_position: float | None = settled(
        "float", "mean position of the logs, where a run without one begins", unit="m"
    )
    slip: float | None = settled(
        "float", "speed over which the gray box rounds off dry friction", unit="m/s", above=0.0
    )
    residual_pressure_1: float | None = settled(
        "float", "residuals of pressure 1, the measure of its weight", unit="Pa", above=0.0
    )
    residual_pressure_2: float | None = settled(
        "float", "residuals of pressure 2, the measure of its weight", unit="Pa", above=0.0
    )
    residual_position: float | None = settled(
        "float", "residuals of the position, the measure of its weight", unit="m", above=0.0
    )
