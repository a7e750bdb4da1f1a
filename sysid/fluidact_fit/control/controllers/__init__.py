"""The reference controllers of the sources."""

from __future__ import annotations

from .base import Controller, RoutineController, Travel
from .force import FeedforwardForceController, Smoothing
from .impedance import ImpedanceController
from .pd import Gains, PDController

__all__ = [
    "Controller",
    "FeedforwardForceController",
    "Gains",
    "ImpedanceController",
    "PDController",
    "RoutineController",
    "Smoothing",
    "Travel",
]
