"""What a machine may have beyond the equations of the gray box, and wrong numbers given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from ...estimation.stribeck import EXPONENT, another_fall
from ...estimation.unmodelled_effects import change_to, soft_edges
from ...family import Plant, UnmodelledEffect
from ...mechanics.hydraulic_cylinder import AIR, EDGES, LEAKAGE, LOAD
from ...options import describe
from ...specification import Response
from ...units import after_number
from .options import HydraulicCylinderOptions

_APART = 0.1  # of the exponent of a fall of friction, between its two simulations and 2
_STEP = 1e-3  # of a given number, and of what an effect is compared with, to see what they do
_GIVEN = (
    "area_1", "area_2", "dead_volume_1", "dead_volume_2", "mass", "supply_pressure",
    "tank_pressure",
)  # fmt: skip
HydraulicPlant = Plant[HydraulicCylinderOptions]


def unmodelled_effects(plant: HydraulicPlant) -> Iterator[UnmodelledEffect]:
    """Yield effects and wrong numbers whose responses all states show.

    Their sizes are changed by a small part of the supply pressure, of its force on the piston, and
    of the flow at one volt.
    """
    v, supply = plant.numbers, float(plant.options.supply_pressure or 0.0)
    yield soft_edges(plant, "command", (v[EDGES[0]], v[EDGES[1]]))
    if plant.values.get("stribeck"):
        less, more = (_with(plant, EXPONENT, 2.0 + by) for by in (-_APART, _APART))
        yield another_fall(partial(change_to, more, less, 2.0 * _APART))
    yield UnmodelledEffect(
        "leakage", "oil leaks past the piston, from one chamber to the other",
        "Look for worn seals and an open bypass: gains, losses and dead zone make up for the "
        "leak, and hold for pressures like those of the logs only.",
        _beyond(plant, LEAKAGE, _STEP * v["valve_gain_1"] / supply**0.5),
        "m3/(s Pa)", positive=True,
    )  # fmt: skip
    yield UnmodelledEffect(
        "load", _load_words,
        "That is the weight on a piston that is not level, friction that differs by direction "
        "(coulomb is a mean of both), or a wrong zero of a pressure: they look alike.",
        _beyond(plant, LOAD, _STEP * supply * float(plant.options.area_1 or 0.0)), "N",
    )  # fmt: skip
    yield UnmodelledEffect(
        "air", "air in the oil makes it softer at low pressure",
        "Bleed the cylinder; bulk_modulus is a mean over the pressures of the logs.",
        _beyond(plant, AIR, _STEP), positive=True,
    )  # fmt: skip
    units = {option.name: option.unit for option in describe(HydraulicCylinderOptions)}
    for name in _GIVEN:
        option, value = name.replace("_", "-"), float(getattr(plant.options, name))
        yield UnmodelledEffect(
            f"given {name}", partial(_instead, name, value, units[option]),
            f"Measure it again and check --{option}, or look for what acts alike.",
            _by_given(plant, name, _STEP * (value or supply)), units[option],
        )  # fmt: skip


def _load_words(size: float) -> str:
    way = "against" if size > 0.0 else "towards"
    return f"a constant force of {abs(size):.3g} N acts on the piston, {way} extension"


def _instead(name: str, value: float, unit: str, change: float) -> str:
    unit = after_number(unit)
    return f"{name} is about {value + change:.4g}{unit}, not {value:.4g}{unit} as was given"


def _by_given(plant: HydraulicPlant, name: str, by: float) -> Response:
    """Derivatives of all channels by a number that was given."""
    given = {name: getattr(plant.options, name) + by}
    return partial(change_to, plant, replace(plant, options=replace(plant.options, **given)), by)


def _beyond(plant: HydraulicPlant, name: str, by: float) -> Response:
    """Derivatives of all channels by an effect that the fit supposes absent."""
    return partial(change_to, plant, _with(plant, name, by), by)


def _with(plant: HydraulicPlant, name: str, value: float) -> HydraulicPlant:
    return replace(plant, values={**plant.values, name: value})
