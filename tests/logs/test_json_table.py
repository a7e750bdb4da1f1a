"""Tables in JSON, however they are written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, describe, read_log

RECORDS = [{"time (ms)": 10 * k, "p (bar)": 0.5 * k, "u": k % 3} for k in range(40)]
FRAME = pd.DataFrame(RECORDS)


def read(folder: Path, text: str, **options: object) -> Log:
    path = folder / "log.json"
    path.write_text(text, encoding="utf-8")
    return read_log(path, **options)


NAMES = ["time", "p", "u"]
UNITS = {"time": "ms", "p": "bar"}
LISTS = dict(zip(NAMES, (FRAME[name].tolist() for name in FRAME)))
CHANNELS = {name: {"unit": UNITS.get(name), "values": LISTS[name]} for name in NAMES}
ROWS = FRAME.to_numpy().tolist()
NESTED = '{"v": ' * 9 + "1" + "}" * 9
FORMS = {
    "records": json.dumps(RECORDS),
    "records, indented": json.dumps(RECORDS, indent=2),
    "lines": "\n".join(map(json.dumps, RECORDS)) + "\n",
    "lines, CRLF": "\r\n".join(map(json.dumps, RECORDS)),
    "lines, blank ones": "\n\n".join(map(json.dumps, RECORDS)) + "\n\n",
    "columns": json.dumps({name: FRAME[name].tolist() for name in FRAME}),
    "rows": json.dumps([list(FRAME), *FRAME.to_numpy().tolist()]),
    "lines of rows": "\n".join(map(json.dumps, [list(FRAME), *FRAME.to_numpy().tolist()])),
    "in an object": json.dumps({"rig": "B", "rate": 100, "data": RECORDS}),
    "columns in an object": json.dumps({"rig": "B", "log": FRAME.to_dict("list")}),
    "columns beside words": json.dumps({"rig": "B", **FRAME.to_dict("list")}),
    "units apart": json.dumps(
        {"units": {"time": "ms", "p": "bar"},
         "data": [dict(zip(["time", "p", "u"], r.values())) for r in RECORDS]}
    ),
    "channels": json.dumps([{"name": k, **channel} for k, channel in CHANNELS.items()]),
    "channels in an object": json.dumps(
        {"rig": "B", "channels": [{"label": k, **channel} for k, channel in CHANNELS.items()]}
    ),
    "channels by name": json.dumps(CHANNELS),
    "time beside signals": json.dumps(
        {"units": UNITS, "time": LISTS["time"], "signals": {k: LISTS[k] for k in ("p", "u")}}
    ),
    "names and rows": json.dumps({"columns": list(FRAME), "rows": ROWS}),
    "fields and values": json.dumps(
        {"fields": [{"name": k, "unit": UNITS.get(k)} for k in NAMES], "values": ROWS}
    ),
    **{f"pandas {o}": FRAME.to_json(orient=o) for o in ("split", "records", "index", "columns")},
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_one_table(tmp_path: Path, form: str) -> None:
    log = read(tmp_path, FORMS[form])
    assert [c.name for c in log.columns] == ["time", "p", "u"]
    assert [c.unit for c in log.columns] == ["ms", "bar", None]
    assert log.rows == 40
    for column, name in zip(log.columns, FRAME):
        np.testing.assert_array_equal(column.values, FRAME[name])
    account = log.account
    assert account.total_lines == (
        account.header_lines + account.data_rows + account.blank_lines + len(account.left_out)
    )
    beside = [n.message for n in log.notices if n.code == "variables-left-out"]
    assert bool(beside) == ("rig" in FORMS[form])


def test_objects_and_short_lists_are_columns_of_their_own(tmp_path: Path) -> None:
    records = [{"t": k, "valve": {"p_bar": 0.5 * k, "x": [k, -k]}} for k in range(40)]
    for text in (json.dumps(records), "\n".join(map(json.dumps, records))):
        log = read(tmp_path, text)
        assert [c.header for c in log.columns] == ["t", "valve.p_bar", "valve.x[0]", "valve.x[1]"]
        assert [c.unit for c in log.columns] == [None, "bar", None, None]
        assert log.columns[3].values[-1] == -39.0


@pytest.mark.parametrize("form", ["epoch", "iso"])
@pytest.mark.parametrize("orient", ["split", "index", "columns"])
def test_an_index_of_instants_is_the_time(tmp_path: Path, orient: str, form: str) -> None:
    instants = pd.Timestamp("2024-05-01 10:00") + pd.to_timedelta(10 * np.arange(40), unit="ms")
    frame = pd.DataFrame({"p": FRAME["p (bar)"].to_numpy()}, index=instants)
    if form == "epoch":
        frame.index = [int(t.timestamp() * 1000) for t in instants]
    else:
        frame.index = [t.isoformat() for t in instants]
    log = read(tmp_path, frame.to_json(orient=orient))
    assert [c.header for c in log.columns] == ["time", "p"]
    time = describe(log)["time"]
    assert (time["column"], time["sample_time"]) == (1, pytest.approx(0.01, rel=1e-5))


def test_lines_count_as_those_of_text(tmp_path: Path) -> None:
    lines = list(map(json.dumps, RECORDS))
    lines.insert(7, "")
    log = read(tmp_path, "\n".join(lines) + "\n")
    assert (log.lines[6], log.lines[7], log.account.blank_lines) == (7, 9, 1)


def test_a_last_line_that_is_cut_is_named(tmp_path: Path) -> None:
    log = read(tmp_path, "\n".join(map(json.dumps, RECORDS))[:-9])
    assert log.rows == 39
    assert log.account.left_out == ((40, "cut short"),)
    assert [n.code for n in log.notices] == ["cut-last-line"]


def test_clock_times_numbers_in_text_and_missing_keys(tmp_path: Path) -> None:
    records = [
        {"time": f"2024-05-01T10:00:{k:02d}.250Z", "p": str(1.5 * k), "s": True} for k in range(40)
    ]
    del records[5]["p"]
    records[6]["p"] = None
    time, p, s = read(tmp_path, json.dumps(records)).columns
    assert (time.clock, time.unit, time.values[-1]) == (True, "s", 39.0)
    assert p.bad == {5: "", 6: ""}
    assert p.values[7] == 10.5
    assert s.bad[0] == "true"


def test_stamps_keep_all_their_digits(tmp_path: Path) -> None:
    start = 1_700_000_000_123_456_789
    log = read(tmp_path, json.dumps([{"t": start + 1000 * k, "p": k} for k in range(40)]))
    np.testing.assert_array_equal(np.diff(log.columns[0].stamps), 1000.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[{"t": 1, "t": 2}, {"t": 3}]', "'t' appears twice"),
        ('{"t": [1, 2, 3], "t": [1, 2, 3]}', "'t' appears twice"),
        (f'[{{"t": 0, "p": {NESTED}}}, {{"t": 1, "p": {NESTED}}}]', "'p.v.v.v.v.v.v.v.v' holds an"),
        (f'[{{"t": 0, "p": {[1] * 17}}}, {{"t": 1, "p": {[1] * 17}}}]', "'p' holds a list"),
        ('[{"p.v": 1, "p": {"v": 1}}, {"t": 1}]', "a record has two values for 'p.v'"),
        ('{"channels": [{"name": "t", "values": [1, 2]}, {"name": "p", "values": [1]}]}', "length"),
        ('{"a":' * 100_000, "nested too deeply"),
        ("[" * 100_000, "nested too deeply"),
        ('{"t": [1, 2, 3], "p": [1, 2]}', "differ in length: 't' 3, 'p' 2"),
        ("[[1, 2, 3], [1, 2]]", "row 2 has 2 values"),
        ('{"a": [{"t": 1}, {"t": 2}], "b": [{"t": 1}, {"t": 2}]}', "2 tables ('a', 'b')"),
        ('{"a": 1, "b": "text"}', "no table"),
        ("{}", "no table"),
        ('[{"t": 1}, {"t": 2}', "cannot be read"),
        ('{"t": 1}\n{"t": 2\n{"t": 3}\n', "line 2"),
        ('{"units": {"q": "bar"}, "data": [{"t": 1}, {"t": 2}]}', "a unit of 'q'"),
        ('{"columns": ["a", "b"], "data": [[1, 2], [3]]}', "row 2 of 'data'"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, text)
    assert told in caught.value.text


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999", "9" * 6000])
def test_what_is_no_finite_number_is_an_invalid_cell(tmp_path: Path, value: str) -> None:
    rows = [f'{{"t": {k}, "p": {value if k == 7 else k}}}' for k in range(40)]
    log = read(tmp_path, f"[{', '.join(rows)}]")
    assert log.columns[1].bad == {7: value}
    assert np.isnan(log.columns[1].values[7])


@pytest.mark.parametrize("options", [{"delimiter": ","}, {"skip_rows": 1}, {"decimal": ","}])
def test_options_of_text_are_refused(tmp_path: Path, options: dict[str, object]) -> None:
    with pytest.raises(LogError, match="do not apply to JSON"):
        read(tmp_path, FORMS["records"], **options)


def test_text_that_begins_as_json_does_is_read_as_before(tmp_path: Path) -> None:
    rows = [f"[{k}] {0.5 * k} {k % 3}" for k in range(40)]
    assert read(tmp_path, "\n".join(rows)).columns[1].values[3] == 1.5
    rows = ["[Header]", "rate=5", "[Data]", "t;p", *(f"{k};{0.5 * k}" for k in range(40))]
    assert [c.header for c in read(tmp_path, "\n".join(rows)).columns] == ["t", "p"]


def test_it_is_fitted_as_the_table_is(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "datasets/line/trial1.csv"
    text = pd.read_csv(source).to_json(orient="records", lines=True)
    columns = {"inlet": "p_valve (bar)", "outlet": "p_chamber (bar)"}
    found = ff.fit("line", [read(tmp_path, text, columns=columns)])
    plain = ff.fit("line", [read_log(source, columns=columns)])
    for name, value in plain.parameters.items():
        assert found.parameters[name].value == pytest.approx(value.value, rel=1e-9)


def test_half_a_character_is_no_fault_of_the_program(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"t": ["\\ud800", 1], "y": [1, 2]}', encoding="ascii")
    assert read_log(path).columns[1].values.tolist() == [1.0, 2.0]
