"""Long logs are looked at block by block: nothing in any block may be seen otherwise than whole."""

import hashlib
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from fluidact_fit import rows
from fluidact_fit.experiment import all_of, at_rows, is_finite
from fluidact_fit.families import get_family
from fluidact_fit.logs import checks, experiments, grid, read_log, repeats, spikes
from fluidact_fit.logs.arrays import log_of
from fluidact_fit.logs.log import Log

LINE = get_family("line").variants[0]


@pytest.fixture(params=[1 << 15, 37])
def rows_of_a_block(request, monkeypatch):
    monkeypatch.setattr(rows, "BLOCK_ROWS", request.param)
    return request.param


def signals(seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    smooth = 3.0 * np.sin(0.05 * np.arange(700) + seed)
    moving = smooth + 0.2 * rng.standard_normal(700)
    held = np.repeat(rng.uniform(0.0, 5.0, 10), 70)
    slow = np.repeat(smooth[::3], 3)[:700]
    return [moving, held, slow, np.round(moving, 1), np.round(slow, 1)]


def test_jumps_of_inputs_are_those_above_the_usual_change(rows_of_a_block):
    for values in (x for seed in range(5) for x in signals(seed)):
        size = np.abs(np.diff(values))
        jump = max(0.3 * size.max(), 3.0 * np.median(size))
        np.testing.assert_array_equal(spikes._jumps(values), np.flatnonzero(size > jump))


def test_what_is_left_without_some_samples(rows_of_a_block):
    values = signals(3)[0]
    order = np.array([0, 36, 37, 699, 350])
    for count in range(1, order.size + 1):
        size = np.abs(np.diff(values))
        for k in order[:count]:
            size[max(k - 1, 0) : k + 1] = 0.0
        assert spikes._left_when_removed(values, order[:count])[-1] == size.max()


@pytest.mark.parametrize("place", [5, 36, 37, 400, 698])
def test_a_spike_is_seen_in_every_block(rows_of_a_block, place):
    values = signals(1)[0]
    values[place] += 60.0
    assert spikes.find_spikes(values, np.zeros(700, dtype=bool)).tolist() == [place]


@pytest.mark.parametrize("led", [False, True])
def test_repeated_readings_are_counted_alike(rows_of_a_block, led):
    found = [repeats.rows_per_reading(x, led) for seed in range(5) for x in signals(seed)]
    assert found[2::5] == pytest.approx([3.0] * 5, abs=0.2)
    assert found[0::5] == found[1::5] == [1.0] * 5


def test_a_clock_of_many_stamps_is_that_of_all(rows_of_a_block, monkeypatch):
    rng = np.random.default_rng(0)
    even = 0.0025 * np.arange(900)
    uneven = np.round(even + 1e-3 * rng.uniform(-0.5, 0.5, 900), 4)
    for stamps in (even, np.round(even, 3), np.round(even, 4), uneven):
        resolution = grid.print_resolution(stamps)
        runs = []
        for many in (10**6, 100):
            monkeypatch.setattr(grid, "_MANY", many)
            runs.append(grid.make_run(np.arange(900), stamps, resolution, 1.0))
        assert runs[0].uniform == runs[1].uniform
        assert runs[0].time.tobytes() == runs[1].time.tobytes()
    assert grid.print_resolution(np.append(even, 2.250001)) == 1e-6


def test_a_cell_far_down_is_looked_at(rows_of_a_block):
    values = np.ones(700)
    assert is_finite(values)
    values[699] = np.nan
    assert not is_finite(values)


def test_values_at_consecutive_rows_are_not_copied():
    values = np.arange(10.0)
    assert np.shares_memory(at_rows(values, np.arange(3, 8)), values)
    np.testing.assert_array_equal(at_rows(values, np.array([1, 2, 5])), [1.0, 2.0, 5.0])
    assert all_of(values, np.ones(10, dtype=bool)) is values


def test_the_last_rows_of_a_long_log_are_judged(tmp_path: Path):
    rng = np.random.default_rng(2)
    t = 0.001 * np.arange(300_000)
    inlet = np.repeat([1.0, 3.0], 150).tolist() * 1000
    outlet = np.round(np.array(inlet) + 0.01 * rng.standard_normal(t.size), 5)
    outlet[-700] = 40.0
    text = "\n".join(f"{a:.3f},{b},{c}" for a, b, c in zip(t, inlet, outlet))
    path = tmp_path / "long.csv"
    path.write_text("time [s],inlet [bar],outlet [bar]\n" + text + "\n", encoding="utf-8")
    log = read_log(path)
    assert log.rows == log.account.data_rows == 300_000
    (found,), notices = experiments(log, LINE)
    assert list(found.signals["outlet"].recorded) == [299_300]
    assert [n.code for n in notices] == ["spikes"]
    path.write_text(path.read_text().replace("299.999,3.0,", "299.999,3.0x,"), encoding="utf-8")
    assert read_log(path).columns[1].bad == {299_999: "3.0x"}


@pytest.mark.parametrize("end", [-1.0, 1.0])
@pytest.mark.parametrize("begin", [0, 30, 33, 300, 692])
def test_a_stay_at_an_end_is_seen_across_blocks(rows_of_a_block, end, begin):
    values = np.sin(0.11 * np.arange(700)) * 0.9
    values[begin : begin + 8] = end
    assert checks._stays_at(values, end)
    values[begin + 4] = 0.0
    assert not checks._stays_at(values, end)


def table_of_all_kinds(rows: int) -> pa.Table:
    rng = np.random.default_rng(2)
    counts = pa.array([None if k % 7 == 3 else k for k in range(rows)], type=pa.int64())
    return pa.table({
        "time [s]": 0.01 * np.arange(rows),
        "counts": counts,
        "pressure [bar]": pa.array(rng.standard_normal(rows).astype(np.float32)),
        "note": [f"row {k}" for k in range(rows)],
        "valve": pa.array([str(k) for k in range(rows)]),
    })  # fmt: skip


def test_parquet_of_several_row_groups_is_the_table(tmp_path):
    table, path = table_of_all_kinds(500), tmp_path / "log.parquet"
    parquet.write_table(table, path, row_group_size=150)
    log = read_log(path)
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert [c.header for c in log.columns] == table.column_names
    for column in log.columns:
        expected = table[column.header].to_numpy()
        if column.header == "note":
            assert np.isnan(column.values).all()
        else:
            np.testing.assert_array_equal(column.values, expected.astype(float))
    assert [k for k in log.columns[1].bad if k < 20] == [3, 10, 17]


def line_log(**columns: np.ndarray) -> Log:
    time = 0.01 * np.arange(400)
    inlet = np.repeat([1.0, 3.0, 2.0, 4.0], 100)
    return log_of({"time [s]": time, "inlet [bar]": inlet, "outlet [bar]": 0.9 * inlet} | columns)


def test_columns_that_are_used_once_give_their_memory_away():
    log = line_log()
    (kept,), _ = experiments(log, LINE)
    assert log.columns[2].values.max() == pytest.approx(3.6)
    (found,), _ = experiments(replace(log, disposable=True), LINE)
    assert np.shares_memory(found["outlet"], log.columns[2].values)
    for role in ("inlet", "outlet"):
        np.testing.assert_array_equal(found[role], kept[role])


def test_a_column_in_two_roles_is_turned_to_si_once():
    both = dict.fromkeys(("inlet", "outlet"), "outlet [bar]")
    log = replace(line_log(), bindings=both, disposable=True)
    (found,), _ = experiments(log, LINE)
    np.testing.assert_array_equal(found["inlet"], found["outlet"])
    assert found["inlet"].max() == pytest.approx(3.6e5)


def test_what_stands_for_none_is_named_in_the_unit_of_its_column():
    outlet = 1.0 + 1e-3 * np.arange(400) % 0.3
    outlet[[50, 60, 61, 62]] = -999.0
    said = []
    for disposable in (False, True):
        log = replace(line_log(**{"outlet [bar]": outlet}), disposable=disposable)
        _, notices = experiments(log, LINE)
        said.append([n.message for n in notices if n.code == "placeholder-values"])
    assert said[0] == said[1]
    assert "holds -999 in 4 rows" in said[0][0]


def test_a_signal_of_two_levels_takes_no_list_of_its_rows():
    values = np.repeat([1.0, 2.0] * 50, 20_000)
    tracemalloc.start()
    try:
        assert not checks.placeholder_rows(values).size
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * values.size  # a mark for each sample; an index takes eight bytes
