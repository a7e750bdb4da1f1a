"""What a controller holds: blocks that run from a parameter file alone."""

from __future__ import annotations

from .base import ModelBlock, ValidRange
from .drive import DriveBlock
from .dynamic import DynamicBlock, HammersteinBlock, TransferFunction
from .loading import load

__all__ = [
    "DriveBlock",
    "DynamicBlock",
    "HammersteinBlock",
    "ModelBlock",
    "TransferFunction",
    "ValidRange",
    "load",
]
