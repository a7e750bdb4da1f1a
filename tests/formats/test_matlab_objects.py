"""Tables, timetables and dates of MATLAB, as mat-io writes them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.formats import matlab_objects
from fluidact_fit.formats.sink import Sink
from fluidact_fit.logs import Log, read_log
from recordings import T, columns, fates

matio = pytest.importorskip("matio", reason="the extra 'matlab' is not installed")
VERSIONS = pytest.mark.parametrize("version", ["v7", "v7.3"])
ROW_TIMES = pd.Index((T * 1e9).round().astype("m8[ns]"), name="Time")


def cells(texts: Sequence[str]) -> np.ndarray:
    out = np.empty((1, len(texts)), dtype=object)
    for k, text in enumerate(texts):
        out[0, k] = np.array([text])
    return out


def table(frame: pd.DataFrame, units: Sequence[str]) -> Any:
    """A table or timetable with ``VariableUnits``."""
    from matio.utils.converters.mattables import table_to_mat, timetable_to_mat
    from matio.utils.matclass import MatlabOpaque

    if isinstance(frame.index, pd.RangeIndex):
        properties = table_to_mat(frame)
        properties["props"][0, 0]["VariableUnits"] = cells(units)
        return MatlabOpaque(properties=properties, classname="table")
    properties = timetable_to_mat(frame)
    properties["any"][0, 0]["varUnits"] = cells(units)
    return MatlabOpaque(properties=properties, classname="timetable")


def series(values: np.ndarray, unit: str, times: np.ndarray | None = None) -> Any:
    """A time series with the properties that files of MATLAB have; even instants are implied."""
    from matio.utils.matclass import MatlabOpaque

    about = {"Units": np.array(["seconds"]), "Time_": np.empty((0, 0))}
    if times is None:
        about |= {k: np.array([[v]]) for k, v in
                  (("Start_", 0.0), ("Increment_", 0.01), ("Length", float(T.size)))}  # fmt: skip
    else:
        about["Time_"] = times[:, None]
    data = MatlabOpaque(properties={"Units": np.array([unit])}, classname="tsdata.datametadata")
    return MatlabOpaque(
        properties={
            "Name": np.array(["a name"]), "Data_": values, "DataInfo": data,
            "TimeInfo": MatlabOpaque(properties=about, classname="tsdata.timemetadata"),
        },
        classname="timeseries",
    )  # fmt: skip


def signal(name: str, values: Any) -> Any:
    from matio.utils.matclass import MatlabOpaque

    properties = {"Name": np.array([name]), "Values": values}
    return MatlabOpaque(properties=properties, classname="Simulink.SimulationData.Signal")


def write(path: Path, variables: dict[str, Any], version: str) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what has no counterpart in MATLAB
        matio.save_to_mat(path, variables, version=version)
    return path


def read(folder: Path, variables: dict[str, Any], version: str = "v7") -> Log:
    return read_log(write(folder / "log.mat", variables, version))


def units(log: Log) -> dict[str, str | None]:
    return {c.header: c.unit for c in log.columns}


@VERSIONS
def test_a_timetable_has_its_row_times_and_units(tmp_path: Path, version: str) -> None:
    frame = pd.DataFrame({"command": T, "p": T**2, "on": T > 1, "mode": ["a"] * 200}, ROW_TIMES)
    log = read(tmp_path, {"run": table(frame, ["V", "bar", "", ""])}, version)
    assert units(log) == {"time": "s", "command": "V", "p": "bar", "on": None}
    found = columns(log)
    np.testing.assert_allclose(found["time"], T, atol=1e-12)
    np.testing.assert_array_equal(found["p"], T**2)
    assert fates(log) == {
        "run": "a timetable of 200 rows", "mode": "text", "on": "true and false to 1 and 0"
    }  # fmt: skip


@VERSIONS
def test_a_table_has_its_time_among_its_variables(tmp_path: Path, version: str) -> None:
    frame = pd.DataFrame({"t": 1000 * T, "p": T})
    log = read(tmp_path, {"run": table(frame, ["ms", "bar"])}, version)
    assert units(log) == {"t": "ms", "p": "bar"}


@VERSIONS
def test_tables_within_structures_and_cells(tmp_path: Path, version: str) -> None:
    frame = pd.DataFrame({"p": T}, ROW_TIMES)
    record = np.empty((1, 1), dtype=[("rig", object), ("logs", object)])
    record[0, 0]["rig"] = table(frame, ["bar"])
    only = np.empty((1, 1), dtype=object)
    only[0, 0] = table(frame.rename(columns={"p": "y"}), ["V"])
    logs = np.empty((1, 2), dtype=object)
    logs[0, 0], logs[0, 1] = (
        table(frame.rename(columns={"p": name}).iloc[::2], [unit])
        for name, unit in (("x", "mm"), ("f", "kN"))
    )
    record[0, 0]["logs"] = logs
    log = read(tmp_path, {"record": record, "only": only}, version)
    assert sorted(u for u in units(log).values() if u) == ["V", "bar", "kN", "mm", "s"]
    sizes = [values.size for values in columns(log).values()]
    assert sorted(sizes) == [100, 100, 200, 200, 200]


@VERSIONS
def test_time_series_have_even_instants_or_their_own(tmp_path: Path, version: str) -> None:
    uneven = T + 0.002 * (np.arange(T.size) % 2)
    log = read(tmp_path, {
        "u": series(T[:, None], "V"), "p": series(T**2, "bar", uneven),
        "x": series(T.reshape(1, 1, -1), "mm"), "y": series(np.column_stack([T, -T]), "mm"),
        "bad": series(T[:7], "V"),
    }, version)  # fmt: skip
    assert units(log) == {
        "time": "seconds",
        "u": "V",
        "p": "bar",
        "x": "mm",
        "y1": "mm",
        "y2": "mm",
    }
    found = columns(log)
    np.testing.assert_array_equal(found["p"], T**2)
    np.testing.assert_array_equal(found["y2"], -T)
    assert found["time"].size == 300
    assert fates(log)["bad"].startswith("a timeseries of 0 instants")


def test_signals_that_simulink_logged(tmp_path: Path) -> None:
    from matio.utils.matclass import MatlabOpaque

    elements = np.empty((1, 2), dtype=object)
    elements[0, 0] = signal("command", series(T[:, None], "V"))
    elements[0, 1] = signal("outlet", series(T[:, None], "bar"))
    storage = MatlabOpaque(
        properties={"Elements": elements},
        classname="Simulink.SimulationData.Storage.RamDatasetStorage",
    )
    dataset = MatlabOpaque(
        properties={"Name": np.array([""]), "Storage_": storage},
        classname="Simulink.SimulationData.Dataset",
    )
    log = read(tmp_path, {"logsout": dataset})
    assert units(log) == {"time": "seconds", "command": "V", "outlet": "bar"}


def test_dates_and_durations_beside_vectors(tmp_path: Path) -> None:
    since = np.datetime64("2024-05-01T10:00") + (1000 * T).astype("m8[ms]")
    log = read(tmp_path, {"time": since[:, None], "p": T[:, None]})
    assert log.columns[0].clock or log.columns[1].clock
    np.testing.assert_allclose(columns(log)["time"], T, atol=1e-9)
    log = read(tmp_path, {"time": (1000 * T).astype("m8[ms]")[:, None], "p": T[:, None]})
    np.testing.assert_allclose(columns(log)["time"], T, atol=1e-9)
    assert fates(log)["time"] == "a duration to seconds"


@pytest.mark.parametrize(
    ("names", "given", "expected"),
    [
        (["p", "x_1", "x_2"], ["bar", "mm"], ["bar", "mm", "mm"]),
        (["x_1", "x_2", "y_2"], ["mm", "V"], ["mm", "mm", "V"]),
        (["p_1", "p_2"], ["bar", "V"], ["bar", "V"]),
        (["p", "x"], [], [None, None]),
        (["p", "x"], ["bar", "V", "N"], [None, None]),
    ],
)
def test_a_unit_is_that_of_all_columns_of_its_variable(
    names: list[str], given: list[str], expected: list[str | None]
) -> None:
    frame = pd.DataFrame(np.zeros((3, len(names))), columns=names)
    frame.attrs["varUnits"] = given
    assert matlab_objects._units(frame) == expected


def test_without_the_library_the_rest_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(
        tmp_path / "log.mat", {"run": table(pd.DataFrame({"p": T}, ROW_TIMES), ["bar"])}, "v7"
    )
    monkeypatch.setitem(__import__("sys").modules, "matio", None)
    room = tmp_path / "numbers"
    room.touch()
    sink = Sink(str(room), 1 << 20)
    sink.objects.append(("run", "timetable"))
    matlab_objects.read_objects(str(path), sink)
    (left_out,) = sink.left_out
    assert left_out[1] == (
        "a MATLAB object (timetable), read with: pip install 'fluidact-fit[matlab]'"
    )


@VERSIONS
def test_a_file_that_is_cut_anywhere_is_refused(tmp_path: Path, version: str) -> None:
    rng = np.random.default_rng(1)
    frame = pd.DataFrame({"p": rng.normal(size=200)}, ROW_TIMES)
    path = write(tmp_path / "log.mat", {"run": table(frame, ["bar"])}, version)
    raw = path.read_bytes()
    for part in (2, 10, 19):
        path.write_bytes(raw[: len(raw) * part // 20])
        with pytest.raises(LogError):
            read_log(path)


def test_a_fit_of_a_timetable_is_that_of_the_csv(tmp_path: Path) -> None:
    csv = Path(__file__).parents[2] / "datasets/valve/trial1.csv"
    names = {"time": "Zeit", "command": "Sollwert", "outlet": "Druck"}
    time, command, outlet = (c.values for c in read_log(csv).columns)
    index = pd.Index((time * 1e9).round().astype("m8[ns]"), name="Time")
    frame = pd.DataFrame({"command": command, "outlet": outlet}, index)
    log = read(tmp_path, {"run": table(frame, ["V", "bar"])})
    expected = ff.fit("valve", read_log(csv, columns=names))
    result = ff.fit("valve", log)
    for name, parameter in expected.parameters.items():
        assert result.parameters[name].value == pytest.approx(parameter.value, rel=1e-9)
    assert result.document.provenance.logs[0].details == {"format": "MATLAB"}
