"""Bags of ROS 1 and ROS 2: fields of messages over the instants of their topic.

Definitions of messages stand in the bag. The library turns them into code, so what they name has
to be plain names before it sees them.
"""

from __future__ import annotations

import keyword
import os
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import LogError
from .sink import Array, Sink, library

_BAGS = {
    b"\x89MCAP0\r\n": ("ROS 2 bag (MCAP)", ".mcap"),
    b"SQLite format 3\0": ("ROS 2 bag (SQLite)", ".db3"),
    b"#ROSBAG V": ("ROS 1 bag", ".bag"),
}
_OF_THE_SYSTEM = {"/rosout", "/rosout_agg", "/parameter_events", "/diagnostics_agg"}
_LARGE = 1 << 16  # bytes of a message, from which it is a picture, a map or a cloud of points
_LONG = 64  # elements of an array, from which they are no channels
_LONGEST = 1 << 20  # elements that a definition may state
_APART = 10 * 10**9  # ns between two clocks, from which they are not the same
_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)
_TIME, _DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
_HEADER = "std_msgs/msg/Header"
_NAMES = ("name", "names", "joint_names", "joint_name", "interface_names")
# Units that the definitions of these messages state
_UNITS = {
    ("sensor_msgs/msg/FluidPressure", "fluid_pressure"): "Pa",
    ("sensor_msgs/msg/Temperature", "temperature"): "degC",
    ("sensor_msgs/msg/Imu", "angular_velocity"): "rad/s",
    ("sensor_msgs/msg/Imu", "linear_acceleration"): "m/s^2",
    ("sensor_msgs/msg/Range", "range"): "m",
    ("sensor_msgs/msg/BatteryState", "voltage"): "V",
    ("sensor_msgs/msg/BatteryState", "current"): "A",
    ("geometry_msgs/msg/Wrench", "force"): "N",
    ("geometry_msgs/msg/Wrench", "torque"): "N m",
    ("geometry_msgs/msg/Twist", "linear"): "m/s",
    ("geometry_msgs/msg/Twist", "angular"): "rad/s",
    ("geometry_msgs/msg/Pose", "position"): "m",
}


def read(path: str, sink: Sink) -> None:
    """Hand over the numbers of the messages in a bag."""
    library("rosbags", "ros")
    with open(path, "rb") as file:
        head = file.read(16)
    sink.dialect, ending = next(kind for magic, kind in _BAGS.items() if head.startswith(magic))
    expected = library("rosbags.rosbag2").ReaderError, library("rosbags.rosbag1").ReaderError
    try:
        with _opened(path, ending) as bag:
            topics = _topics(bag, sink, ending)
    except (LogError, MemoryError):
        raise
    except expected as error:
        raise _unreadable(str(error).replace(path, "it"), sink) from None
    except Exception as error:  # the library checks little of what is damaged
        raise _unreadable(f"{type(error).__name__}: {error}".replace(path, "it"), sink) from None
    _hand_over([t for t in topics if t.values], sink)


def _opened(path: str, ending: str) -> Any:
    """The reader of a bag, which goes by the ending of a name."""
    if ending == ".bag":
        return library("rosbags.rosbag1").Reader(path)
    return library("rosbags.rosbag2").Reader(_Stored(path, ending))


class _Stored:
    """A file under the ending that its reader is chosen by, in place of a ``pathlib.Path``."""

    def __init__(self, path: str, ending: str) -> None:
        self._path, self.suffix = path, ending

    def __str__(self) -> str:
        return "recording"

    def exists(self) -> bool:
        return True

    def is_dir(self) -> bool:
        return False

    def open(self, *args: Any) -> Any:
        return open(self._path, *args)

    def stat(self) -> Any:
        return os.stat(self._path)


def _unreadable(reason: str, sink: Sink) -> LogError:
    remedy = "Repair it: mcap recover LOG -o COPY. Or record it again."
    if "SQLite" in sink.dialect:
        remedy = "Check that it is a bag of ROS 2, and that its recorder had ended."
    elif "ROS 1" in sink.dialect:
        remedy = "Repair it: rosbag reindex LOG. Or record it again."
    elif "Profile" in reason:
        remedy = "Write it with ros2 bag record or ros2 bag convert, or export its topics as CSV."
    return LogError(
        f"the bag cannot be read ({reason[:160].rstrip('.')}).",
        expected=f"Expected a whole {sink.dialect}.",
        remedy=remedy,
    )


class _Topic:
    """The messages of a topic: numbers by field, with the messages that had them."""

    def __init__(self, name: str, kind: str) -> None:
        self.name, self.kind = name, kind
        self.logged, self.stamps = array("q"), array("q")
        self.values: dict[str, array[float]] = {}
        self.rows: dict[str, array[int]] = {}
        self.units: dict[str, str | None] = {}
        self.left_out: dict[str, str] = {}

    def take(self, message: Any, logged: int) -> None:
        """Take the numbers of the next message, which was logged at an instant [ns]."""
        row = len(self.logged)
        for label, value, unit in _leaves(message, f"{self.name}/", ()):
            if isinstance(value, str):
                self.left_out.setdefault(label, value)
                continue
            if label not in self.values:
                self.values[label], self.rows[label] = array("d"), array("q")
                self.units[label] = unit
            self.values[label].append(value)
            self.rows[label].append(row)
        self.logged.append(logged)
        self.stamps.append(_stamp(message))


def _topics(bag: Any, sink: Sink, ending: str) -> list[_Topic]:
    """The topics of a bag with all that their messages hold."""
    store = _Definitions(ending)
    wanted: dict[str, _Topic] = {}
    chosen, unread = [], []  # publishers of one topic may disagree on what a message is
    for connection in bag.connections:
        topic = connection.topic
        if topic in _OF_THE_SYSTEM:
            sink.leave(topic, "messages of the system", signal=False)
        elif why := store.register(connection):
            unread.append((topic, f"{topic} (publisher {connection.id})", why))
        else:
            wanted.setdefault(topic, _Topic(topic, connection.msgtype))
            chosen.append(connection)
    for topic, publisher, why in unread:
        sink.leave(publisher if topic in wanted else topic, why)
    refused: set[str] = set()
    for connection, logged, raw in bag.messages(connections=chosen) if chosen else ():
        name = connection.topic
        if name in refused:
            continue
        if len(raw) > _LARGE:
            sink.leave(name, f"messages of {len(raw)} bytes")
            refused.add(name)
            continue
        if bytes(raw[:4]) == b"\x28\xb5\x2f\xfd":
            raise LogError(
                "its messages are compressed one by one.",
                remedy="Write it without: ros2 bag convert, compression_mode none (or file).",
            )
        wanted[name].take(store.message(raw, connection.msgtype), logged)
    for topic in wanted.values():
        if len(topic.logged) < 2 and topic.name not in refused:
            few = "a single message" if topic.logged else "no messages"
            sink.leave(topic.name, few, signal=False)
    return [t for t in wanted.values() if len(t.logged) > 1 and t.name not in refused]


class _Definitions:
    """Message types of a bag, by the definitions in it."""

    def __init__(self, ending: str) -> None:
        self._types = library("rosbags.typesys")
        self._formats = library("rosbags.interfaces").MessageDefinitionFormat
        self._own = self._types.get_typestore(self._types.Stores.EMPTY)
        self._of_ros = self._types.get_typestore(self._types.Stores.ROS2_HUMBLE)
        self._ros1 = ending == ".bag"
        self._stores: dict[str, Any] = {}

    def register(self, connection: Any) -> str:
        """Learn what a connection transports; returns why it cannot be read, if so."""
        kind, definition = connection.msgtype, connection.msgdef
        if definition.format == self._formats.NONE:
            if kind not in self._of_ros.types:
                return f"the bag does not define {kind}"
            self._stores[kind] = self._of_ros
            return ""
        try:
            if definition.format == self._formats.MSG:
                found = self._types.get_types_from_msg(definition.data, kind)
            else:
                parts = re.split(r"^={80}\nIDL: .*\n", definition.data, flags=re.MULTILINE)
                found = {}
                for part in filter(str.strip, parts):
                    found |= self._types.get_types_from_idl(part)
            _require_plain(found)
            self._own.register(found)
            self._own.get_msgdef(kind)
        except (MemoryError, KeyboardInterrupt):
            raise
        except Exception as error:
            return f"the definition of {kind} cannot be used ({str(error)[:80] or 'damaged'})"
        self._stores[kind] = self._own
        return ""

    def message(self, raw: Any, kind: str) -> Any:
        """A message by its bytes."""
        store = self._stores[kind]
        return store.deserialize_ros1(raw, kind) if self._ros1 else store.deserialize_cdr(raw, kind)


def _require_plain(types: Mapping[str, Any]) -> None:
    """Refuse definitions whose names, constants or sizes are none, as they become code."""
    for kind, (constants, fields) in types.items():
        if "/" not in kind:  # it could hide a name of the code that is made
            raise ValueError("a type has no package")
        names = [kind, *(c[0] for c in constants), *(f[0] for f in fields)]
        for _, (_, what) in fields:
            inner, size = what if isinstance(what, tuple) else (what, 0)
            if isinstance(inner, tuple):  # the elements of an array
                inner = inner[1] if isinstance(inner[1], str) else inner[1][0]
            if not 0 <= size <= _LONGEST:
                raise ValueError(f"an array of {size} elements")
            names.append(inner)
        if not all(map(_NAME.fullmatch, names)):
            raise ValueError("a name is none")
        if not all(isinstance(c[2], bool | int | float | str) for c in constants):
            raise ValueError("a constant is none")


def _leaves(
    message: Any, path: str, names: Sequence[str]
) -> Iterator[tuple[str, float | str, str | None]]:
    """Every number of a message with its name and unit; of what is none, why."""
    fields = vars(message)
    names = _names_in(fields) or names
    for key, value in fields.items():
        if key in vars(type(message)):  # a constant, or what the library adds
            continue
        plain = key.removesuffix("_") if keyword.iskeyword(key.removesuffix("_")) else key
        unit = _UNITS.get((message.__msgtype__, plain))
        for label, number, own in _leaf(value, path + plain, names):
            yield label, number, own or unit


def _leaf(
    value: Any, label: str, names: Sequence[str]
) -> Iterator[tuple[str, float | str, str | None]]:
    kind = getattr(value, "__msgtype__", None)
    if kind in (_HEADER, _TIME):
        return
    if kind == _DURATION:
        yield label, value.sec + value.nanosec / 1e9, "s"
    elif kind is not None:
        yield from _leaves(value, f"{label}.", names)
    elif isinstance(value, str):
        yield label, "text", None
    elif isinstance(value, np.ndarray | list):
        if len(value) > _LONG:
            yield label, f"{len(value)} elements", None
            return
        parts = value.tolist() if isinstance(value, np.ndarray) else value
        for k, part in enumerate(parts):
            index = names[k] if len(names) == len(parts) else k
            yield from _leaf(part, f"{label}[{index}]", names)
    else:
        yield label, float(value), None


def _names_in(fields: Mapping[str, Any]) -> Sequence[str]:
    """Names that a message gives the elements of its arrays, such as those of joints."""
    for key in _NAMES:
        names = fields.get(key)
        if isinstance(names, list) and names and all(isinstance(n, str) and n for n in names):
            return names if len(set(names)) == len(names) and len(names) <= _LONG else ()
    return ()


def _stamp(message: Any) -> int:
    """The instant that a message states [ns], 0 without one."""
    stamp: Any = getattr(getattr(message, "header", message), "stamp", None)
    if getattr(stamp, "__msgtype__", None) != _TIME:
        return 0
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _hand_over(topics: Sequence[_Topic], sink: Sink) -> None:
    """All numbers over the instants of their topic, counted from the first of all."""
    instants = _instants(topics, sink)
    since = min((int(times[0]) for times in instants.values()), default=0)
    for topic in topics:
        for label, why in topic.left_out.items():
            if label not in topic.values:
                sink.leave(label, why, signal=why != "text")
        times = (instants[topic.name] - since) / 1e9
        bases: dict[bytes, int] = {}  # messages that had the same fields share their instants
        for label, values in topic.values.items():
            if len(values) < 2:
                sink.leave(label, "a single number", signal=False)
                continue
            rows = topic.rows[label]
            key = rows.tobytes()
            if key not in bases:
                part = times[np.frombuffer(rows, np.int64)]
                bases[key] = sink.add("time", part, unit="s", since=since, role="instants")
            numbers = np.frombuffer(values, np.float64)
            sink.add(label, numbers, unit=topic.units[label], instants=bases[key])


def _instants(topics: Sequence[_Topic], sink: Sink) -> dict[str, Array]:
    """Instants of every topic [ns]: those of its headers, or of the recorder where it has none.

    Headers of another clock than the recorder's are used only if every topic has some.
    """
    stamped = {t.name: _ordered(t.stamps) for t in topics}
    one_clock = all(stamps is not None for stamps in stamped.values())
    chosen = {}
    for topic in topics:
        stamps, logged = stamped[topic.name], np.frombuffer(topic.logged, np.int64)
        how = "instants of its header"
        if stamps is None:
            stamps, how = logged, "instants of the recorder"
        elif not one_clock and abs(np.median(stamps - logged)) > _APART:
            stamps = logged
            how = "instants of the recorder, as those of its header are of another clock"
        chosen[topic.name] = stamps
        sink.convert(topic.name, f"{topic.kind}, {len(topic.logged)} messages, {how}")
    return chosen


def _ordered(stamps: array[int]) -> Array | None:
    """Stamps in order; ``None`` where some message has none, or they are not in order."""
    found = np.frombuffer(stamps, np.int64)
    return found if bool(np.all(np.diff(found) > 0)) else None
