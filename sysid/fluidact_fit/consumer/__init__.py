"""What a controller reads, compared with what a parameter file holds."""

from .compare import Comparison, Row, compare
from .read import Key, read_consumer

__all__ = ["Comparison", "Key", "Row", "compare", "read_consumer"]
