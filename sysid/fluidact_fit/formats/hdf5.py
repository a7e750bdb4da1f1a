"""HDF5 files: netCDF-4, MATLAB 7.3 and whatever else is written in it.

Only what stands in the file itself is read: datasets that lie in other files, links into them and
datasets put together of others are refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import LogError
from .matlab_objects import read_objects
from .sink import DEEPEST, MOST_CELLS, Array, Sink, full, library
from .tables import add_array, add_packed

_MOST_OBJECTS = 20_000
_LONG = 1 << 20  # numbers, from which they are not there twice
_CLASSES = {"double", "single", "logical", "int8", "int16", "int32", "int64", "uint8", "uint16",
            "uint32", "uint64"}  # fmt: skip


def read(path: str, sink: Sink) -> None:
    """Hand over the datasets of numbers of an HDF5 file."""
    h5py = library("h5py", "hdf5")
    with h5py.File(path, "r") as file:
        reader = _Reader(h5py, file, sink)
        sink.dialect = "MATLAB 7.3" if reader.of_matlab else "HDF5"
        reader.walk(file, "", 0)
    read_objects(path, sink, counted=True)


class _Reader:
    """Goes through a file, each object once."""

    def __init__(self, h5py: Any, file: Any, sink: Sink) -> None:
        self.h5py, self.file, self.sink = h5py, file, sink
        self.of_matlab = _is_matlab(file)
        self.seen: set[Any] = set()

    def walk(self, group: Any, path: str, depth: int) -> None:
        """Everything in a group, groups within it included."""
        if depth > DEEPEST:
            raise LogError(
                f"groups are nested more than {DEEPEST} deep.",
                remedy="Export the recording again.",
            )
        names = list(group)
        lengths = self._lengths(group, names)
        for name in names:
            if depth == 0 and name.startswith("#"):
                continue  # where MATLAB keeps what others refer to
            link = group.get(name, getlink=True)
            if isinstance(link, self.h5py.SoftLink):
                # what it leads to has a name of its own, unless it leads out of the file
                self.sink.leave(name, f"a link to {link.path[:60]}", group=path, signal=False)
                continue
            if not isinstance(link, self.h5py.HardLink):
                raise _elsewhere(full(path, name), "stands in another file")
            node = group[name]
            if not self._is_new(node):
                self.sink.leave(name, "another name of what was read", group=path, signal=False)
                continue
            if isinstance(node, self.h5py.Group):
                self._take_group(node, name, path, depth)
            elif isinstance(node, self.h5py.Dataset):
                self._take(node, name, path, lengths, depth)
            else:
                self.sink.leave(name, "a named type", group=path, signal=False)

    def _is_new(self, node: Any) -> bool:
        address = self.h5py.h5o.get_info(node.id).addr
        if address in self.seen:
            return False
        self.seen.add(address)
        if len(self.seen) > _MOST_OBJECTS:
            raise LogError(
                f"it holds more than {_MOST_OBJECTS} objects.",
                remedy="Export the channels that are needed.",
            )
        return True

    def _lengths(self, group: Any, names: list[str]) -> list[int]:
        """Lengths of the vectors in a group, one of which tables beside them have."""
        found = []
        for name in names:
            link = group.get(name, getlink=True)
            if isinstance(link, self.h5py.HardLink) and not name.startswith("#"):
                node = group.get(name)
                if isinstance(node, self.h5py.Dataset) and node.shape:
                    sizes = [n for n in node.shape if n != 1]
                    found += sizes if len(sizes) == 1 else []
        return found

    def _take_group(self, node: Any, name: str, path: str, depth: int) -> None:
        attributes = _attributes(node)
        if "MATLAB_sparse" in attributes:
            self.sink.leave(name, "a sparse matrix", group=path)
        elif "MATLAB_object_decode" in attributes:
            self.sink.objects.append((full(path, name), _word(attributes)))
        else:
            self.walk(node, full(path, name), depth + 1)

    def _take(self, node: Any, name: str, path: str, lengths: list[int], depth: int) -> None:
        """One dataset."""
        if node.external or node.id.get_create_plist().get_external_count():
            raise _elsewhere(full(path, name), "lies in another file")
        if node.is_virtual:
            raise _elsewhere(full(path, name), "is put together of other datasets")
        attributes = _attributes(node)
        if _is_object(attributes):
            self.sink.objects.append((full(path, name), _word(attributes)))
            return
        why = self._why_not(node, attributes)
        if why:
            signal = why not in ("text", "empty", "a list of scales")
            self.sink.leave(name, why, group=path, signal=signal)
            return
        if self.h5py.check_ref_dtype(node.dtype) is not None:
            self._follow(node, name, path, lengths, depth)
            return
        self._bound(node, full(path, name))
        long = node.dtype == np.float64 and node.ndim == 1 and node.size > _LONG
        if long and not attributes and _never_written(node) is None:
            node.read_direct(self.sink.room(name, node.size, group=path))
            return
        values = node[()]
        if node.dtype.names:
            for field in node.dtype.names:
                part = np.asarray(values[field])
                add_array(self.sink, field, part, group=full(path, name), samples=[len(values)])
            return
        values = np.asarray(values)
        blank = _never_written(node)
        if self.of_matlab:
            values, blank = values.T, None if blank is None else blank.T
        add_packed(self.sink, name, values, attributes, group=path, samples=lengths, blank=blank)

    def _why_not(self, node: Any, attributes: Mapping[str, Any]) -> str:
        """Explain why a dataset holds no signal; empty where it may."""
        if node.shape is None or attributes.get("MATLAB_empty"):
            return "empty"
        word = _word(attributes)
        if word == "char" or node.dtype.kind in "SU" or self.h5py.check_string_dtype(node.dtype):
            return "text"
        if self.h5py.check_vlen_dtype(node.dtype) is not None:
            return "rows of different length"
        if str(attributes.get("NAME", "")).startswith("This is a netCDF dimension but not"):
            return "a list of scales"
        if node.size and node.id.get_storage_size() == 0:
            return "nothing was ever written to it"
        return ""

    def _bound(self, node: Any, name: str) -> None:
        """Refuse what is far larger than its file can be, before any of it is made."""
        if node.size * 8 > self.sink.left:
            raise self.sink.too_large(name, int(node.size))

    def _follow(self, node: Any, name: str, path: str, lengths: list[int], depth: int) -> None:
        """Follow the references of a MATLAB cell array or structure array."""
        if node.size > MOST_CELLS or depth > DEEPEST:
            self.sink.leave(name, f"{node.size} references", group=path)
            return
        for k, reference in enumerate(np.ravel(node[()]), start=1):
            target = self.file[reference] if reference else None
            if target is None or not self._is_new(target):
                self.sink.leave(f"{name}{k}", "a reference", group=path, signal=False)
            elif isinstance(target, self.h5py.Group):
                self._take_group(target, f"{name}{k}", path, depth)
            elif isinstance(target, self.h5py.Dataset):
                self._take(target, f"{name}{k}", path, lengths, depth + 1)


def _never_written(node: Any) -> Array | None:
    """Cells of chunks that were never written, which read as zeros; ``None`` without any."""
    if node.chunks is None:
        return None
    expected = math.prod(-(-n // c) for n, c in zip(node.shape, node.chunks))
    count = node.id.get_num_chunks()
    if count >= expected:
        return None
    blank = np.ones(node.shape, dtype=np.bool_)
    for k in range(count):
        corner = node.id.get_chunk_info(k).chunk_offset
        blank[tuple(slice(at, at + n) for at, n in zip(corner, node.chunks))] = False
    return blank


def _is_matlab(file: Any) -> bool:
    """Return whether MATLAB wrote a file: it says so in what stands before the HDF5 part."""
    size = file.userblock_size
    if size < 128:
        return False
    with open(file.filename, "rb") as raw:
        return raw.read(6) == b"MATLAB"


def _attributes(node: Any) -> dict[str, Any]:
    """Attributes of an object; those that cannot be read are none."""
    found: dict[str, Any] = {}
    for name in node.attrs:
        try:
            found[name] = node.attrs[name]
        except (OSError, TypeError, ValueError, KeyError):
            continue
    return found


def _is_object(attributes: Mapping[str, Any]) -> bool:
    """Return whether a dataset is what MATLAB keeps of an object."""
    word = _word(attributes)
    plain = not word or word in {*_CLASSES, "cell", "char"} or attributes.get("MATLAB_empty")
    return "MATLAB_object_decode" in attributes or not plain


def _word(attributes: Mapping[str, Any]) -> str:
    word = attributes.get("MATLAB_class", b"")
    return word.decode("ascii", "replace") if isinstance(word, bytes) else str(word)


def _elsewhere(name: str, what: str) -> LogError:
    return LogError(
        f"'{name}' {what}, which is not read.",
        expected="Expected a recording whose numbers stand in the file itself.",
        remedy="Copy it into one file: h5repack LOG COPY, or export it as CSV.",
    )
