"""What every target of ``export`` is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from ..block import Block

Arithmetic = Literal["float32", "q15"]


@dataclass(frozen=True)
class Job:
    """One parameter file on its way to a target.

    Attributes
    ----------
    name
        Identifier in every target: ASCII letters, digits and ``_``, first a letter.
    block
        The loaded model.
    arithmetic
        Of the code, where the target knows more than one.
    remarks
        What was accepted (a verdict FAIL, parameters that were not identified), and where the
        numbers come from: lines of harmless ASCII text that stand in what is written.
    """

    name: str
    block: Block
    arithmetic: Arithmetic = "float32"
    remarks: tuple[str, ...] = ()


Target = Callable[[Job], Mapping[str, bytes]]
