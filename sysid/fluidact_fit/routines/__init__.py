"""Routines that a controller calls, translated by every target of ``export``."""

from .evaluate import Machine
from .expression import (
    Expression,
    Name,
    Operand,
    by_sign,
    choose,
    constant,
    exp,
    log,
    maximum,
    minimum,
    polynomial,
    sqrt,
)
from .routine import Argument, Draft, Filter, Routine, Solve

__all__ = [
    "Argument", "Draft", "Expression", "Filter", "Machine", "Name", "Operand", "Routine", "Solve",
    "by_sign", "choose", "constant", "exp", "log", "maximum", "minimum", "polynomial", "sqrt",
]  # fmt: skip
