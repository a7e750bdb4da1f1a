"""Parameter files at work: blocks, reference controllers, plants and the closed loop."""

from __future__ import annotations

from .loading import load, make_block, read_document

__all__ = ["load", "make_block", "read_document"]
