"""The reference controllers of the sources."""

from __future__ import annotations

from .base import Controller, Travel
from .force import FeedforwardForceController, MotionState, Smoothing
from .impedance import ImpedanceController, allocate
from .pd import Gains, PDController

__all__ = [
    "Controller",
    "FeedforwardForceController",
    "Gains",
    "ImpedanceController",
    "MotionState",
    "PDController",
    "Smoothing",
    "Travel",
    "allocate",
]
