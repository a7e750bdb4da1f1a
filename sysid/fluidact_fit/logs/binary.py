"""Recordings that are no text: MATLAB, HDF5, netCDF, Parquet, TDMS, MDF and bags of ROS.

Which it is shows in the first bytes. A library reads it in a process of its own; here its vectors
become the columns of one table.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import LogError, Notice
from ..units import conversion_factor, parse_unit_from_header, same_dimension
from .arrays import Named, joined
from .log import Element, count_of
from .native import Recording, Vector, read_apart
from .source import name_of
from .stamps import is_time_name

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAGIC = {
    b"MATLAB 5.0": "matlab",
    b"MATLAB 7.3": "hdf5",
    _HDF5[:4]: "hdf5",
    b"PAR1": "parquet",
    b"TDSm": "tdms",
    b"MDF  ": "mdf",
    b"CDF\x01": "netcdf",
    b"CDF\x02": "netcdf",
    b"\x89MCAP0\r\n": "ros",
    b"SQLite format 3\0": "ros",
    b"#ROSBAG V": "ros",
}
_UNFIT = {
    b"UnFinMF": ("an MDF file that was never finished", "Finish it with the tool that recorded it"),
    b"TDSh": ("the index of a TDMS file", "Give the .tdms file itself"),
    b"CDF\x05": ("a netCDF file with 64-bit data", "Convert it: nccopy -k nc4 LOG COPY"),
    b"PARE": ("an encrypted Parquet file", "Write it again without encryption"),
    b"ARROW1": ("a Feather or Arrow file", "Write it as Parquet: pandas.DataFrame.to_parquet"),
    b"\x93NUMPY": ("an array of NumPy", "Save named columns: pandas.DataFrame(...).to_parquet"),
    b"\x80\x04": ("a pickle of Python, which can run code", "Save the data as Parquet"),
    b"\x80\x05": ("a pickle of Python, which can run code", "Save the data as Parquet"),
    b"ULog\x01": ("a ULog file of PX4", "Convert it: ulog2csv LOG"),
    b"\xd0\xcf\x11\xe0": ("an old Excel workbook, or one with a password", "Save it as XLSX"),
    b"%PDF": ("a PDF document", "Give the log itself"),
    b"LOGG": ("a BLF trace of a bus", "Decode it into signals, as MDF"),
}
_SHOWN = 8


@dataclass(frozen=True)
class Found:
    """Columns of a recording, how it is written, and what became of each of its elements."""

    dialect: str
    columns: list[Named]
    notices: list[Notice]
    elements: tuple[Element, ...]
    sha256: str


def read_stored(path: Path) -> Found | None:
    """Columns of the binary recording in a file; ``None`` where it is none.

    Raises
    ------
    LogError
        As :func:`read_binary`.
    """
    try:
        if not path.is_file():
            return None
        size = path.stat().st_size
        with path.open("rb") as file:

            def look(place: int, count: int) -> bytes:
                file.seek(place)
                return file.read(count)

            reader = _reader_of(look, size, name_of(path))
    except (OSError, ValueError):  # who reads it all says what is wrong
        return None
    return None if reader is None else _read(reader, path, name_of(path))


def read_binary(raw: bytes, name: str) -> Found | None:
    """Columns of a binary recording, ``None`` where the bytes are none that is known.

    Raises
    ------
    LogError
        When it cannot be read, holds no table, or needs a library that is not installed.
    """
    reader = _reader_of(lambda at, count: raw[at : at + count], len(raw), name)
    return None if reader is None else _read(reader, raw, name)


def _reader_of(look: Callable[[int, int], bytes], size: int, name: str) -> str | None:
    """Choose the reader of a file by its first bytes."""
    head = look(0, 128)
    for magic, (what, remedy) in _UNFIT.items():
        if head.startswith(magic):
            raise LogError(f"this is {what}.", where=name, remedy=f"{remedy}, or export it as CSV.")
    if len(head) > 2 and any(len(head) < len(m) and m.startswith(head) for m in _MAGIC):
        raise LogError(
            f"only {len(head)} bytes are there of what begins as a binary recording.", where=name,
            remedy="Copy or record it again: it was cut.",
        )  # fmt: skip
    found = next((r for magic, r in _MAGIC.items() if head.startswith(magic)), None)
    if found is None and head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
        found = "matlab"
    if found == "matlab" and look(512, 8) == _HDF5:
        found = "hdf5"
    if found is None and (stated := _matlab_4_size(head)):
        if stated > size:
            raise LogError(
                f"this is a MATLAB 4 file that is cut: its first matrix ends at byte {stated}, the "
                f"file at {size}.", where=name, remedy="Copy or save it again.",
            )  # fmt: skip
        found = "matlab"
    if found is None and head[:1] and not head[:64].isascii():
        return None
    if found is None and any(look(512 << k, 8) == _HDF5 for k in range(4)):
        found = "hdf5"  # behind what another program wrote
    return found


def _matlab_4_size(head: bytes) -> int:
    """End of the first matrix of a MATLAB 4 file [bytes]; 0 for any other file."""
    for order in "<>":
        if len(head) < 22:
            return 0
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:20])
        machine, zero, precision, form = kind // 1000, kind // 100 % 10, kind // 10 % 10, kind % 10
        if not (0 <= kind < 5000 and machine <= 4 and zero == 0 and precision <= 5 and form <= 2):
            continue
        if not (imaginary in (0, 1) and 2 <= length <= 64 and rows >= 0 and columns >= 0):
            continue
        width = (8, 4, 4, 2, 2, 1)[precision] * (1 + imaginary)
        label = head[20 : 20 + length]
        if label[-1:] == b"\0" and label[:-1].replace(b"_", b"a").isalnum():
            return 20 + length + rows * columns * width
    return 0


def _read(reader: str, source: Path | bytes, name: str) -> Found:
    return _Assembly(read_apart(reader, source, name), name).found()


class _Assembly:
    """One table of the vectors of a recording."""

    def __init__(self, recording: Recording, name: str) -> None:
        self.recording, self.name = recording, name
        self.vectors = recording.vectors
        self.channels = [k for k, v in enumerate(self.vectors) if v.role != "instants"]
        self.left_out = [Element(n, "left out", why) for n, why, _ in recording.left_out]
        self.missed = [f"{n} ({why})" for n, why, signal in recording.left_out if signal]
        self.invalid: list[str] = []
        self.headers = self._headers()

    def found(self) -> Found:
        """The columns, and an account of all elements."""
        if not self.channels:
            raise self._no_table()
        columns = self._columns()
        notices = [Notice(code, f"{self.name}: {text}.") for code, text in self.recording.notices]
        if self.missed:
            notices.append(Notice("variables-left-out", f"{self.name}: {self._missed()}."))
        if self.invalid:
            text = "; ".join(self.invalid[:_SHOWN])
            text = f"{self.name}: non-numeric samples are not used: {text}."
            notices.append(Notice("samples-invalid", text))
        how = dict(self.recording.converted)
        read = [Element(c.header, "read", "") for c in columns]
        converted = [Element(n, "converted", text) for n, text in how.items()]
        elements = (*read, *converted, *self.left_out)
        return Found(self.recording.dialect, columns, notices, elements, self.recording.sha256)

    def _missed(self) -> str:
        """List elements that may have been signals and are not among the columns."""
        text = "; ".join(self.missed[:_SHOWN])
        more = f" and {len(self.missed) - _SHOWN} more" if len(self.missed) > _SHOWN else ""
        return f"{count_of(len(self.missed), 'element')} left out: {text}{more}"

    def _no_table(self) -> LogError:
        listed = "; ".join(self.missed[:_SHOWN]) or ", ".join(
            f"{e.name} ({e.how})" for e in self.left_out[:_SHOWN]
        )
        listed = "; ".join([text for _, text in self.recording.notices]) or listed
        return LogError(
            f"it holds no vectors of numbers ({listed or 'nothing'}), or no channel of them.",
            where=self.name,
            expected="Expected vectors of equal length, one per column, or a table of numbers.",
            remedy="Save vectors (of a MATLAB object, what it holds), or export it as CSV.",
        )

    def _headers(self) -> dict[int, str]:
        """Return the headers of the columns: groups distinguish duplicate names."""
        dotted = self.recording.dialect in ("HDF5", "MATLAB 7.3")
        names = Counter(self.vectors[k].name for k in self.channels)
        found = {}
        for k in self.channels:
            v = self.vectors[k]
            found[k] = (
                f"{v.group}.{v.name}" if v.group and (dotted or names[v.name] > 1) else v.name
            )
        return found

    def _leave(self, k: int, why: str) -> None:
        self.left_out.append(Element(self.headers[k], "left out", why))
        self.missed.append(f"{self.headers[k]} ({why})")

    def _columns(self) -> list[Named]:
        base_of = self._bases()
        bases = list(dict.fromkeys(b for b in base_of.values() if b is not None))
        bases = self._distinct(bases, base_of)
        if len(bases) > 1:
            return self._joined(bases, base_of)
        return self._table(bases[0] if bases else None)

    def _bases(self) -> dict[int, int | None]:
        """The vector of instants of every channel: stated, or the time beside it."""
        times: dict[tuple[str, int], int] = {}
        for k in self.channels:
            v = self.vectors[k]
            if v.instants is None and v.values.size > 1 and _is_time(v):
                times.setdefault((v.group, v.values.size), k)
        found = {}
        for k in self.channels:
            v = self.vectors[k]
            above = v.group.split(".")
            places = [".".join(above[:n]) for n in range(len(above), -1, -1)]
            keys = ((place, v.values.size) for place in dict.fromkeys(places))
            beside = next((times[key] for key in keys if key in times), None)
            found[k] = v.instants if v.instants is not None else beside
        return found

    def _distinct(self, bases: list[int], base_of: dict[int, int | None]) -> list[int]:
        """Bases that are not the same instants; channels of one that is are moved to the first."""
        kept: list[int] = []
        for base in bases:
            same = next((b for b in kept if self._same(b, base)), None)
            if same is None:
                kept.append(base)
                continue
            for k, b in base_of.items():
                if b == base:
                    base_of[k] = same
            if base in self.channels:
                self.channels.remove(base)
                header = self.headers[base]
                first = self._label(same)
                self.left_out.append(Element(header, "left out", f"the same as {first}"))
        self.headers |= self._headers()
        return kept

    def _label(self, base: int) -> str:
        return self.headers.get(base, "the time")

    def _same(self, a: int, b: int) -> bool:
        x, y = self.vectors[a], self.vectors[b]
        alike = (x.unit, x.since, x.values.size) == (y.unit, y.since, y.values.size)
        return alike and bool(np.array_equal(x.values, y.values))

    def _table(self, base: int | None) -> list[Named]:
        """Columns of one length: that of the time, or the one that most have."""
        sizes = Counter(self.vectors[k].values.size for k in self.channels)
        rows = max(sizes, key=lambda n: (sizes[n], n))
        if base is not None:
            rows = self.vectors[base].values.size
        columns = []
        if base is not None and base not in self.channels:
            columns.append(self._named(base, "time"))
        for k in list(self.channels):
            size = self.vectors[k].values.size
            if size != rows:
                self._leave(k, f"{size} values where the others have {rows}")
            else:
                columns.append(self._named(k, self.headers[k]))
        return columns

    def _named(self, k: int, header: str, sparse: bool = False) -> Named:
        v = self.vectors[k]
        path = self.recording.dialect.startswith("ROS") and v.role != "instants"
        return Named(
            header, v.values, v.unit, sparse, own=True, bad=v.bad, clock=v.clock, since=v.since,
            path=path,
        )  # fmt: skip

    def _joined(self, bases: Sequence[int], base_of: dict[int, int | None]) -> list[Named]:
        """Columns of several time bases, each at its own instants."""
        units = {self._unit_of(b) for b in bases}
        unit = next(iter(units)) if len(units) == 1 else "s"
        first = min(self.vectors[b].since for b in bases)
        parts = []
        for base in bases:
            v = self.vectors[base]
            own = self._unit_of(base)
            times: Any = np.asarray(v.values, dtype=np.float64)
            if own != unit and own is not None:
                times = times * conversion_factor(own, "s")
            if v.since != first:
                times = times + (v.since - first) / 1e9
            if not np.isfinite(times).all():
                raise LogError(
                    f"'{self._label(base)}' holds values that are not times.",
                    where=self.name,
                    expected="Expected times in order, as there are several time bases.",
                    remedy="Export every time base to a file of its own.",
                )
            held = [k for k in self.channels if base_of[k] == base and k != base]
            named = [self._named(k, self.headers[k], sparse=True) for k in held]
            parts.append([Named(self._label(base), times, unit), *named])
        for k in self.channels:
            if base_of[k] is None:
                self._leave(k, "no time beside it")
        self._count_invalid(bases, base_of)
        columns = joined([p for p in parts if len(p) > 1] or parts, self.name)
        return [Named("time", columns[0].values, unit, own=True, since=first), *columns[1:]]

    def _count_invalid(self, bases: Sequence[int], base_of: dict[int, int | None]) -> None:
        """Name samples that are none, where holes mean that nothing was sampled."""
        for k in self.channels:
            values = self.vectors[k].values
            if base_of[k] is None or k in bases or values.dtype.kind != "f":
                continue
            none = int(values.size - np.isfinite(values).sum())
            if none:
                self.invalid.append(f"{none} of '{self.headers[k]}'")

    def _unit_of(self, base: int) -> str | None:
        """Unit of a vector of instants: its own, or that of its header."""
        v = self.vectors[base]
        return v.unit or parse_unit_from_header(v.name)[1]


def _is_time(vector: Vector) -> bool:
    """Return whether a vector is called as instants are, and has no other unit."""
    if vector.clock:
        return True
    name, unit = parse_unit_from_header(vector.name)
    unit = vector.unit or unit
    return is_time_name(name) and (unit is None or same_dimension(unit, "s"))
