"""What a dialect module may say about a log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass


def _keep(headers: Sequence[str]) -> list[str]:
    return list(headers)


@dataclass(frozen=True)
class Hints:
    """Knowledge of a logger that the text alone does not show.

    Attributes
    ----------
    name
        For messages and ``inspect``.
    data_from
        Index (from 0) of the first line that can hold data, ``None`` when to be found.
    delimiter
        Known separator, ``None`` when to be found.
    serial
        Whether lines may be cut or overprinted.
    session_mark
        Text that begins a line the logger itself writes between data; such lines are no rows.
    rename
        Corrects the header line.
    """

    name: str
    data_from: int | None = None
    delimiter: str | None = None
    serial: bool = False
    session_mark: str | None = None
    rename: Callable[[Sequence[str]], list[str]] = _keep
