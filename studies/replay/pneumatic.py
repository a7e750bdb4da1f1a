"""The pneumatic rig of the thesis: an impedance controlled through the pressures of a cylinder."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from math import pi

import numpy as np

from fluidact_fit.block import Port
from fluidact_fit.control.controllers import ImpedanceController
from fluidact_fit.control.controllers.impedance import Impedance, KnownFriction, Pressures
from fluidact_fit.control.loop import LoopResponse, run_loop
from fluidact_fit.control.margins import loop_margins
from fluidact_fit.control.plants.linear import make_chain
from fluidact_fit.control.plants.pneumatic import Chamber, Cylinder, PneumaticPlant
from fluidact_fit.control.references import Reference
from fluidact_fit.errors import UsageError
from fluidact_fit.mechanics.friction_law import FrictionLaw

from .hydrostatic import NEEDLE, puncture
from .table import STEP, Transfer, row, second_order

AREA_1 = 15.7e-6 / 0.05  # chamber of 15.7 ml over a stroke of 50 mm: a bore of 20 mm
AREA_2 = AREA_1 - pi / 4.0 * 8e-3**2
VOLUME = 24.5e-6 + 0.5 * 15.7e-6  # line and half a chamber
FRICTION = KnownFriction(45.0)


@dataclass(frozen=True)
class Setting:
    """A trial: sum of the pressures [Pa] and stiffness [N/m], what the thesis saw, what differs.

    ``friction`` is what is compensated, ``gas`` the share of the volume that is supposed.
    """

    total: float
    stiffness: float
    source: str
    differs: str = ""
    friction: KnownFriction = FRICTION
    gas: float = 1.0
    test: str = "of the order of the settings"


SETTINGS = (
    Setting(8e5, 4000.0, "lag 1.5 mm, overshoot < 0.5 mm, jump 2.5 mm"),
    Setting(8e5, 4000.0, "the same", ", Coulomb friction compensated",
            KnownFriction(45.0, 2.4, 2.4, tolerance=1e-3),
            test="no: changed to see what it does to the lag"),
    Setting(8e5, 4000.0, "the same", ", half of the gas", gas=0.5,
            test="no: halved after the line above ran"),
    Setting(4e5, 4000.0, "overshoot 1 mm, jump 2.5 mm"),
    Setting(4e5, 4000.0, "the same", ", half of the gas", gas=0.5,
            test="no: halved after the line above ran"),
    Setting(8e5, 1000.0, "poor tracking, no overshoot, jump 3 mm"),
)  # fmt: skip


@dataclass(frozen=True)
class Insertion:
    """An insertion at one setting; without a response where the loop runs away."""

    setting: Setting
    gain_margin: float
    response: LoopResponse | None

    @property
    def name(self) -> str:
        """Its name in table and picture."""
        at = self.setting
        return f"P_sum {at.total / 1e5:g} bar, k {at.stiffness:g} N/m{at.differs}"


def pneumatic(total: float, volume: float = VOLUME) -> PneumaticPlant:
    """Cylinder of the thesis; valve and lines as in the synthetic datasets."""
    supply = make_chain([second_order(20.0, 0.7), Transfer((1.0,), (0.12, 1.0), 0.0147)])
    chambers = (Chamber(supply, AREA_1, 0.0, volume), Chamber(supply, AREA_2, 0.0, volume))
    law = FrictionLaw(2.4, 2.4, 45.0, 45.0)
    cylinder = Cylinder(0.14, law, chambers, 101325.0, total)
    return PneumaticPlant(cylinder, Port("command", "Pa"), STEP, NEEDLE)


def impedance(stiffness: float, total: float, friction: KnownFriction) -> ImpedanceController:
    """Critically damped; pressures from 1 to 10 bar."""
    pressures = Pressures((AREA_1, AREA_2), total, 101325.0, range=(101325.0, 10e5))
    wanted = Impedance.with_damping_ratio(0.14, stiffness, 1.0)
    return ImpedanceController(wanted, pressures, STEP, friction)


def run() -> list[Insertion]:
    """Ramp insertion at every setting."""
    found = []
    for at in SETTINGS:
        plant = pneumatic(at.total, at.gas * VOLUME)
        controller = impedance(at.stiffness, at.total, at.friction)
        ramp = Reference("ramp-insertion", 0.01, 0.03, speed=7.5e-3)
        response = None
        with suppress(UsageError):  # the rod left its range
            response = run_loop(plant, controller, ramp, 6.0, 0.01)
        found.append(Insertion(at, loop_margins(plant, controller).gain, response))
    return found


def rows(runs: list[Insertion]) -> list[str]:
    """Lag and overshoot at the puncture against the thesis."""
    return [row(i.name, i.setting.source, _said(i), i.setting.test) for i in runs]


def _said(i: Insertion) -> str:
    margin = f"(gain margin {i.gain_margin:.2f})"
    if i.response is None:
        return f"runs away {margin}"
    at, error = puncture(i.response), 1e3 * i.response.error
    beyond = max(-error[at : at + 100].min(), 0.0)
    wider = np.abs(error[-100:]).max() > 2.0 * np.abs(error[at : at + 100]).max()
    swings = ", then swings ever wider" if wider else ""
    jump = error[at] - error[at : at + 100].min()
    said = f"lag {error[at]:.1f} mm, overshoot {beyond:.1f} mm, jump {jump:.1f} mm"
    return f"{said}{swings} {margin}"
