"""Comparison of the parameters in a controller's source with those of a parameter file."""

from .compare import Comparison, Row, compare
from .read import Key, hashes_in, read_consumer

__all__ = ["Comparison", "Key", "Row", "compare", "hashes_in", "read_consumer"]
