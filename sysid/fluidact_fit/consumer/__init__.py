"""What a controller reads, compared with what a parameter file holds."""

from .compare import Comparison, Row, compare
from .read import Key, hashes_in, read_consumer

__all__ = ["Comparison", "Key", "Row", "compare", "hashes_in", "read_consumer"]
