"""Bags of ROS: fields by topic, their instants, elements of arrays, and damaged bags."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rosbags import rosbag1

import fluidact_fit as ff
from bags import (
    EPOCH,
    FLOAT,
    JOINTS,
    PRESSURE,
    RIG,
    Messages,
    Row,
    definition,
    write_bag,
    write_ros1,
)
from fluidact_fit.errors import LogError
from fluidact_fit.formats import ros
from fluidact_fit.formats.sink import Sink
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates

MS = 1_000_000
INSTANTS = [EPOCH + round(t * 1e9) for t in T]
ROS2, ROS1 = Messages(), Messages(ros1=True)


def numbers(
    topic: str, values: Any, instants: Any = INSTANTS, messages: Messages = ROS2
) -> list[Row]:
    return [(topic, FLOAT, t, messages.float(float(x))) for t, x in zip(instants, values)]


def states(messages: Messages = ROS2, late: int = MS) -> list[Row]:
    pairs = zip(INSTANTS, T)
    return [("/rig", RIG, t + late, messages.state(t, x, 2 * x)) for t, x in pairs]


def read(folder: Path, rows: list[Row], **how: Any) -> Log:
    return read_log(write_bag(folder / "run1", rows, ROS2, **how))


@pytest.mark.parametrize("kind", ["MCAP", "SQLITE3", "ROS 1"])
def test_fields_are_columns_over_the_instants_of_their_header(tmp_path: Path, kind: str) -> None:
    if kind == "ROS 1":
        log = read_log(write_ros1(tmp_path / "run.bag", states(ROS1), ROS1))
    else:
        log = read(tmp_path, states(), plugin=kind)
    dialects = {"MCAP": "ROS 2 bag (MCAP)", "SQLITE3": "ROS 2 bag (SQLite)", "ROS 1": "ROS 1 bag"}
    assert log.dialect.name == dialects[kind]
    found = columns(log)
    assert [*found] == [
        "time", "/rig/command", "/rig/outlet_bar", "/rig/accelerations[0]",
        "/rig/accelerations[1]", "/rig/accelerations[2]", "/rig/open", "/rig/age",
    ]  # fmt: skip
    np.testing.assert_allclose(found["time"], T, atol=1e-12)
    np.testing.assert_array_equal(found["/rig/outlet_bar"], 2 * T)
    assert {c.header: c.unit for c in log.columns if c.unit} == {
        "time": "s", "/rig/outlet_bar": "bar", "/rig/age": "s"
    }  # fmt: skip
    assert found["/rig/age"][0] == 1.5
    account = fates(log)
    assert account["/rig"] == f"{RIG}, 200 messages, instants of its header"
    assert account["/rig/note"] == "text"
    assert account["/rig/picture"] == "100 elements"


def test_topics_at_rates_of_their_own_keep_their_instants(tmp_path: Path) -> None:
    rows = [*numbers("/fast", T), *numbers("/slow", T[::4], INSTANTS[::4])]
    rows += numbers("/beside", T, [t + 3 * MS for t in INSTANTS])
    found = columns(read(tmp_path, rows))
    assert found["time"].size == 400
    assert (found["/fast/data"].size, found["/slow/data"].size) == (200, 50)
    np.testing.assert_array_equal(found["/slow/data"], T[::4])


def test_joints_are_called_by_their_names(tmp_path: Path) -> None:
    rows: list[Row] = []
    for k, t in enumerate(INSTANTS):
        turned = k % 2 == 1  # the same joints in another order
        names, values = (["wrist", "elbow"], [9.0, T[k]]) if turned else (["elbow"], [T[k]])
        rows.append(("/joint_states", JOINTS, t, ROS2.joints(t, names, values)))
    found = columns(read(tmp_path, rows))
    np.testing.assert_array_equal(found["/joint_states/position[elbow]"], T)
    assert found["/joint_states/position[wrist]"].size == 100


def test_a_unit_stands_in_the_definition_or_behind_the_name(tmp_path: Path) -> None:
    pressure = [
        ("/hpu/bar", PRESSURE, t, ROS2.make(PRESSURE, ROS2.header(t), 1e5 + k, 0.0))
        for k, t in enumerate(INSTANTS)
    ]
    log = read(tmp_path, [*pressure, *numbers("/motor/rpm", T)])
    units = {c.header: c.unit for c in log.columns}
    assert units["/hpu/bar/fluid_pressure"] == "Pa"
    assert units["/motor/rpm/data"] is None
    assert next(c for c in log.columns if c.header == "/hpu/bar/fluid_pressure").name == (
        "/hpu/bar/fluid_pressure"
    )


def test_a_header_of_another_clock_is_not_mixed_with_the_recorder(tmp_path: Path) -> None:
    simulated = [("/rig", RIG, t, ROS2.state(t - EPOCH, 1.0 + t % 7, 0.0)) for t in INSTANTS]
    alone = columns(read(tmp_path / "a", simulated))
    np.testing.assert_allclose(alone["time"], T, atol=1e-12)
    log = read(tmp_path / "b", [*simulated, *numbers("/cmd", T)])
    assert log.columns[0].values.size == 200
    assert "another clock" in fates(log)["/rig"]


def test_the_folder_of_a_bag_is_its_one_file(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "run1", states(), ROS2)
    assert read_log(folder).name == "run1.mcap"
    (folder / "run1_1.mcap").write_bytes(b"")
    with pytest.raises(LogError, match=r"a bag of 2 files: name one of them \(run1.mcap, run1_1"):
        read_log(folder)


def test_a_compressed_bag(tmp_path: Path) -> None:
    log = read(tmp_path / "a", states(), compress="STORAGE")
    assert log.rows == 200
    log = read(tmp_path / "b", states(), plugin="SQLITE3", compress="FILE")
    assert (log.name, log.rows) == ("run1.db3.zstd", 200)
    with pytest.raises(LogError, match="compressed one by one"):
        read(tmp_path / "c", states(), plugin="SQLITE3", compress="MESSAGE")


def test_what_cannot_be_read_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    rows = numbers("/cmd", T)
    rows += [("/camera", RIG, t, ROS2.state(t, 0.0, 0.0, pixels=70_000)) for t in INSTANTS[:2]]
    rows += [("/once", FLOAT, EPOCH, ROS2.float(1.0)), *numbers("/rosout", T)]
    folder = write_bag(tmp_path / "run1", [*rows, *states()], ROS2, plugin="SQLITE3")
    with sqlite3.connect(folder / "run1.db3") as database:
        database.execute("DELETE FROM message_definitions WHERE topic_type LIKE 'rig%'")
    log = read_log(folder)
    assert [c.header for c in log.columns] == ["time", "/cmd/data"]
    account = fates(log)
    assert account["/rig"] == account["/camera"] == f"the bag does not define {RIG}"
    assert account["/once"] == "a single message"
    assert account["/rosout"] == "messages of the system"
    database.close()


def test_large_messages_are_no_channels(tmp_path: Path) -> None:
    rows = [("/camera", RIG, t, ROS2.state(t, 0.0, 0.0, pixels=70_000)) for t in INSTANTS[:3]]
    log = read(tmp_path, [*rows, *numbers("/cmd", T)])
    assert fates(log)["/camera"].startswith("messages of 70")


@pytest.mark.parametrize("kind", ["MCAP", "SQLITE3", "ROS 1"])
def test_a_bag_that_is_cut_anywhere_is_refused(tmp_path: Path, kind: str) -> None:
    if kind == "ROS 1":
        whole = write_ros1(tmp_path / "run.bag", states(ROS1), ROS1)
    else:
        folder = write_bag(tmp_path / "run1", states(), ROS2, plugin=kind)
        whole = next(p for p in folder.iterdir() if p.suffix in (".mcap", ".db3"))
    raw = whole.read_bytes()
    path, room = tmp_path / "cut", tmp_path / "numbers"
    room.touch()
    for part in range(1, 20):
        path.write_bytes(raw[: len(raw) * part // 20])
        with pytest.raises(LogError, match="the bag cannot be read") as caught:
            ros.read(str(path), Sink(str(room), 1 << 27))
        assert str(path) not in caught.value.text
    whole.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(LogError, match=r"Repair it|its recorder had ended"):
        read_log(whole)


def test_a_message_that_states_a_huge_array_is_refused(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "run1", states(), ROS2)
    path = folder / "run1.mcap"
    raw = path.read_bytes()
    pixels = (100).to_bytes(4, "little") + bytes(100)
    assert raw.count(pixels) == 200
    path.write_bytes(raw.replace(pixels, (2**32 - 1).to_bytes(4, "little") + bytes(100), 1))
    with pytest.raises(LogError, match="Invalid sequence length 4294967295"):
        read_log(path)


@pytest.mark.parametrize(
    "text",
    [
        "float64 x\nMSG: a\n",
        "float64 x; import os\n",
        "float64[1000000000] x\n",
        "string[99999999] x\n",
        "rig/Evil[] x\n",
        "rig/Unknown x\n",
        "",
    ],
)
def test_a_definition_that_is_none_leaves_its_topic_out(text: str) -> None:
    connection: Any = SimpleNamespace(msgtype="rig/msg/Evil", msgdef=definition(text), topic="/x")
    why = ros._Definitions(".mcap").register(connection)
    assert why.startswith("the definition of rig/msg/Evil cannot be used") or not text


@pytest.mark.parametrize(
    "types",
    [
        {"rig/msg/A\nimport os": ([], [])},
        {"rig/msg/A": ([], [("x: int = print()", (1, ("float64", 0)))])},
        {"rig/msg/A": ([], [("x", (2, 'rig/msg/B"; print()'))])},
        {"rig/msg/A": ([], [("x", (3, ((2, "rig/msg/B()"), 4)))])},
        {"rig/msg/A": ([("C", "float64", object())], [])},
        {"rig/msg/A": ([], [("x", (3, ((1, ("string", 0)), 1 << 30)))])},
    ],
)
def test_only_plain_names_become_code(types: Any) -> None:
    with pytest.raises(ValueError, match=r"none|elements"):
        ros._require_plain(types)


def test_a_database_of_something_else(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "log.db3") as database:
        database.execute("CREATE TABLE readings (x REAL)")
    database.close()
    with pytest.raises(LogError, match="the bag cannot be read"):
        read_log(tmp_path / "log.db3")


def test_a_fit_of_a_bag_is_that_of_the_csv(tmp_path: Path) -> None:
    csv = Path(__file__).parents[2] / "datasets/valve/trial1.csv"
    names = {"time": "Zeit", "command": "Sollwert", "outlet": "Druck"}
    _, command, outlet = (c.values for c in read_log(csv, columns=names).columns)
    instants = [EPOCH + 10 * MS * k for k in range(command.size)]
    rows = [
        ("/rig", RIG, t + MS, ROS2.state(t, u, y)) for t, u, y in zip(instants, command, outlet)
    ]
    log = read_log(
        write_bag(tmp_path / "run1", rows, ROS2),
        columns={"command": "/rig/command", "outlet": "/rig/outlet_bar"}, units={"command": "V"},
    )  # fmt: skip
    expected = ff.fit("valve", read_log(csv, columns=names))
    result = ff.fit("valve", log)
    for name, parameter in expected.parameters.items():
        assert result.parameters[name].value == pytest.approx(parameter.value, rel=1e-9)
    (source,) = result.document.provenance.logs
    assert source.details == {"format": "ROS 2 bag (MCAP)"}


def test_publishers_that_disagree_on_a_message_are_not_mixed(tmp_path: Path) -> None:
    path = tmp_path / "two.bag"
    with rosbag1.Writer(path) as writer:
        orders = [
            writer.add_connection("/x", "p/msg/A", msgdef=text, md5sum=sign * 32, callerid=sign)
            for sign, text in (("a", "float64 a\nfloat64 b\n"), ("b", "float64 b\nfloat64 a\n"))
        ]
        for k in range(20):
            writer.write(orders[0], 10 * k * MS, struct.pack("<dd", k, 100.0))
            writer.write(orders[1], (10 * k + 5) * MS, struct.pack("<dd", 100.0, k))
    log = read_log(path)
    named = {c.header: c.values for c in log.columns}
    assert named["/x/a"].tolist() == list(range(20))
    assert named["/x/b"].tolist() == [100.0] * 20
    assert any("cannot be used" in how for how in fates(log).values())


def test_constants_of_a_definition_are_no_channels(tmp_path: Path) -> None:
    kind = "sensor_msgs/msg/Range"
    make = ROS2.make
    rows = [("/range", kind, t, make(kind, ROS2.header(t), 0, 0.1, 0.1, 2.0, float(x)))
            for t, x in zip(INSTANTS, T)]  # fmt: skip
    headers = [c.header for c in read(tmp_path, rows).columns]
    assert "/range/range" in headers
    assert not [h for h in headers if h.endswith(("ULTRASOUND", "INFRARED"))]
