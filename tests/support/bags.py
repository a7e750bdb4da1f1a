"""Bags of ROS for tests, written by the library that reads them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

EPOCH = 1_700_000_000 * 10**9
FLOAT, JOINTS, PRESSURE = (
    "std_msgs/msg/Float64", "sensor_msgs/msg/JointState", "sensor_msgs/msg/FluidPressure",
)  # fmt: skip
RIG = "rig/msg/State"
DEFINITION = """std_msgs/Header header
float64 command
float64 outlet_bar
float32[3] accelerations
uint8[] picture
bool open
string note
duration age
"""


class Messages:
    """Makes messages of ROS 2, or of ROS 1."""

    def __init__(self, *, ros1: bool = False) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.ros1 = ros1
        definition = DEFINITION if ros1 else DEFINITION.replace(
            "duration", "builtin_interfaces/Duration"
        )  # fmt: skip
        self.store.register(get_types_from_msg(definition, RIG))

    def make(self, kind: str, *values: Any) -> Any:
        return self.store.types[kind](*values)

    def header(self, instant: int) -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(instant, 10**9))
        first = [0] if self.ros1 else []
        return self.make("std_msgs/msg/Header", *first, stamp, "rig")

    def float(self, value: float) -> Any:
        return self.make(FLOAT, value)

    def joints(self, instant: int, names: list[str], positions: Sequence[float]) -> Any:
        none = np.zeros(0)
        return self.make(JOINTS, self.header(instant), names, np.array(positions), none, none)

    def state(self, instant: int, command: float, outlet: float, pixels: int = 100) -> Any:
        return self.make(
            RIG, self.header(instant), command, outlet, np.arange(3, dtype=np.float32),
            np.zeros(pixels, np.uint8), True, "a note",
            self.make("builtin_interfaces/msg/Duration", 1, 500_000_000),
        )  # fmt: skip


Row = tuple[str, str, int, Any]  # topic, type, instant of the recorder [ns], message


def write_bag(
    folder: Path,
    rows: Sequence[Row],
    messages: Messages,
    *,
    plugin: str = "MCAP",
    compress: str = "",
) -> Path:
    """Write a bag of ROS 2; returns its folder."""
    bag = rosbag2.Writer(folder, version=9, storage_plugin=StoragePlugin[plugin])
    if compress:
        bag.set_compression(CompressionMode[compress], CompressionFormat.ZSTD)
    with bag as writer:
        _write(writer, rows, messages, messages.store.serialize_cdr)
    return folder


def write_ros1(path: Path, rows: Sequence[Row], messages: Messages) -> Path:
    """Write a bag of ROS 1."""
    with rosbag1.Writer(path) as writer:
        _write(writer, rows, messages, messages.store.serialize_ros1)
    return path


def _write(writer: Any, rows: Sequence[Row], messages: Messages, serialize: Any) -> None:
    known: dict[str, Any] = {}
    for topic, kind, instant, message in rows:
        if topic not in known:
            known[topic] = writer.add_connection(topic, kind, typestore=messages.store)
        writer.write(known[topic], instant, serialize(message, kind))


def definition(text: str) -> MessageDefinition:
    """A definition of a message as it stands in a bag."""
    return MessageDefinition(MessageDefinitionFormat.MSG, text)
