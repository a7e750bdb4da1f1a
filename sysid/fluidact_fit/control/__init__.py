"""What a controller uses: blocks that run from a parameter file alone."""

from __future__ import annotations

from ..block import Block, ValidRange
from .loading import load, make_block

__all__ = ["Block", "ValidRange", "load", "make_block"]
