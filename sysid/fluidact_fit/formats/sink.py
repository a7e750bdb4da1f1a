"""Output of the reader of a recording: vectors of numbers, and an account of the rest."""

from __future__ import annotations

import mmap
import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import LogError

Array = npt.NDArray[Any]
MOST_COLUMNS = 4096  # of any log
DEEPEST = 32  # groups, structures or cells within one another
MOST_CELLS = 1000  # of an array of cells or references
_MOST_ELEMENTS = 20_000
KEPT = 5000  # texts of cells that are no number, of one vector
_MOST_KEPT = 50_000  # of all
_EXACT = 1 << 53  # whole numbers that double precision holds


class Sink:
    """Destination of what a reader finds; numbers go to a file at once.

    Parameters
    ----------
    path
        The file for the numbers.
    room
        Bytes that they may take.
    """

    def __init__(self, path: str, room: int) -> None:
        self._file = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
        self._end, self._room, self._texts = 0, room, 0
        self.dialect = ""
        self.vectors: list[dict[str, Any]] = []
        self.converted: list[tuple[str, str]] = []
        self.left_out: list[tuple[str, str, bool]] = []
        self.notices: list[tuple[str, str]] = []
        self.objects: list[tuple[str, str]] = []  # of MATLAB, with their class

    def room(
        self,
        name: str,
        rows: int,
        dtype: npt.DTypeLike = np.float64,
        *,
        group: str = "",
        unit: str | None = None,
        instants: int | None = None,
        clock: bool = False,
        since: int = 0,
        role: str = "values",
    ) -> Array:
        """Return the place of a vector in the file, to be filled.

        ``group`` is the structure or group that holds it, ``instants`` the number of the vector
        of its instants; of a ``clock`` the values are seconds since ``since`` [ns]. ``role`` is
        ``instants`` for what is no channel itself.

        Raises
        ------
        LogError
            When all of them take more than they may.
        """
        if len(self.vectors) >= MOST_COLUMNS:
            raise LogError(
                f"it holds more than {MOST_COLUMNS} channels.",
                remedy="Export those that are needed.",
            )
        kind = np.dtype(dtype)
        size, step = rows * kind.itemsize, mmap.ALLOCATIONGRANULARITY
        begin = -(-self._end // step) * step
        if begin + size > self._room:
            raise self.too_large(name, rows)
        entry: dict[str, Any] = {
            "name": shown(name), "group": shown(group), "unit": unit and shown(unit), "rows": rows,
            "kind": kind.str, "begin": begin, "instants": instants, "clock": clock, "since": since,
            "role": role, "bad": {},
        }  # fmt: skip
        self.vectors.append(entry)
        if not rows:
            return np.empty(0, kind)
        self._end = begin + size
        os.ftruncate(self._file, self._end)
        return np.frombuffer(mmap.mmap(self._file, size, offset=begin), kind)

    @property
    def left(self) -> int:
        """Bytes that numbers may still take."""
        return self._room - self._end

    def too_large(self, name: str, count: int) -> LogError:
        """Refusal of a vector or table that takes more."""
        return LogError(
            f"'{shown(name)}' has {count} values, more than a file of this size may hold.",
            expected=f"Expected at most {self._room / 1e6:.0f} MB of numbers.",
            remedy="If the recording is real, export it uncompressed, or in parts.",
        )

    def add(
        self,
        name: str,
        values: Array,
        *,
        bad: Mapping[int, str] | None = None,
        how: str = "",
        **described: Any,
    ) -> int:
        """Hand over a vector of real numbers, shape ``(n,)``, as :meth:`room` describes it.

        ``bad`` has the text of cells that are no number, ``how`` says how it was converted.
        Truth values become numbers. Returns its number.
        """
        if values.dtype.kind == "b":
            values, how = values.astype(np.float64), how or "true and false to 1 and 0"
        exact = values.dtype.kind not in "iu" or values.dtype.itemsize < 8 or not values.size
        if not exact and max(abs(int(values.min())), abs(int(values.max()))) <= _EXACT:
            exact = True
        # what doubles do not hold is handed over as it is
        place = self.room(
            name, values.size, np.float64 if exact else values.dtype.newbyteorder("="), **described
        )
        place[:] = values
        self.mark(len(self.vectors) - 1, bad or {})
        if how:
            self.convert(name, how, described.get("group", ""))
        return len(self.vectors) - 1

    def holds_numbers(self, name: str, values: Array, group: str = "") -> bool:
        """Return whether values are real numbers or truth values; others are left out."""
        kind = values.dtype.kind
        if kind in "fiub":
            return True
        text = kind in "SU" or (
            kind == "O" and all(isinstance(v, str | bytes) for v in values.flat)
        )
        why = "text" if text else "complex numbers" if kind == "c" else ""
        self.leave(name, why or f"values of type {values.dtype}", group=group, signal=not text)
        return False

    def put_texts(self, number: int, cells: Sequence[str | None]) -> None:
        """Hand over cells in the place of a vector that holds no number: they may be instants."""
        joined = "\n".join((cell or "").replace("\n", " ")[:200] for cell in cells)
        raw = np.frombuffer(joined.encode("utf-8", "replace"), np.uint8)
        self.room(self.vectors[number]["name"], raw.size, np.uint8, role="text")[:] = raw
        self.vectors[number] = self.vectors.pop()

    def mark(self, number: int, bad: Mapping[int, str]) -> None:
        """Note the texts of cells that are no number."""
        kept = self.vectors[number]["bad"]
        for row, text in bad.items():
            if len(kept) >= KEPT or self._texts >= _MOST_KEPT:
                return
            self._texts += row not in kept
            kept[int(row)] = text[:60]

    def convert(self, name: str, how: str, group: str = "") -> None:
        """Note that an element was converted."""
        self._count()
        self.converted.append((shown(full(group, name)), how))

    def leave(self, name: str, why: str, *, group: str = "", signal: bool = True) -> None:
        """Note that an element is left out, and whether it may have been a signal."""
        self._count()
        self.left_out.append((shown(full(group, name)), why, signal))

    def notice(self, code: str, message: str) -> None:
        """Add a notice."""
        self.notices.append((code, message))

    def _count(self) -> None:
        if len(self.converted) + len(self.left_out) >= _MOST_ELEMENTS:
            raise LogError(
                f"it holds more than {_MOST_ELEMENTS} elements.",
                remedy="Export the channels that are needed.",
            )

    def described(self) -> dict[str, Any]:
        """All of it but the numbers."""
        return {
            "dialect": self.dialect, "vectors": self.vectors, "converted": self.converted,
            "left_out": self.left_out, "notices": self.notices,
        }  # fmt: skip


def full(group: str, name: str) -> str:
    """The name of an element with what holds it."""
    return f"{group}.{name}" if group else name


def shown(text: str) -> str:
    """A name at a length that people read."""
    return text if len(text) <= 200 else f"{text[:150]}...{text[-40:]}"


def library(module: str, extra: str = "") -> Any:
    """A library that not everybody has; ``LogError`` without it."""
    try:
        return import_module(module)
    except ImportError as error:
        if not extra:
            raise
        raise LogError(
            f"reading it needs the Python package {module.partition('.')[0]}, which is not "
            f"installed ({str(error)[:100]}).",
            remedy=f"Run: pip install 'fluidact-fit[{extra}]', or export the recording as CSV.",
        ) from None


def seconds_of(values: Array) -> tuple[Array, int, dict[int, str]]:
    """Instants as seconds since the first, durations as seconds.

    ``values`` of kind ``M`` or ``m``, shape ``(n,)``. Also returns the first instant [ns since
    1970], and what is none by its row.
    """
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    if np.datetime_data(values.dtype)[0] in ("Y", "M"):  # which differ in length
        values = values.astype(f"{values.dtype.kind}8[s]")
    none, whole = np.isnat(values), values.view(np.int64)
    first = np.flatnonzero(~none)[:1]
    since = int(whole[first[0]]) if values.dtype.kind == "M" and first.size else 0
    tick: Any = np.array(1).astype(values.dtype.str.replace("M", "m"))
    seconds = (whole - since) / (np.timedelta64(1, "s") / tick)
    seconds[none] = np.nan
    since *= int(tick / np.timedelta64(1, "ns"))
    return seconds, since, {int(row): "" for row in np.flatnonzero(none)[:KEPT]}


def numbers_of(texts: Sequence[str | None]) -> tuple[Array, dict[int, str]]:
    """Texts as numbers; those that are none by their row."""
    values = np.full(len(texts), np.nan)
    bad: dict[int, str] = {}
    for row, text in enumerate(texts):
        try:
            values[row] = float(text if text is not None and "_" not in text else "")
        except ValueError:
            if len(bad) < KEPT:
                bad[row] = (text or "")[:60]
    return values, bad
