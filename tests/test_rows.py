"""Rows that are made where they are asked for, against the arrays they stand for."""

import pickle

import numpy as np
import pytest

from fluidact_fit import rows
from fluidact_fit.experiment import all_of, is_finite, where_finite
from fluidact_fit.rows import (
    Rows,
    Streamed,
    by_rows,
    counted,
    ends_of,
    evenly,
    median_of,
    square_sum,
    stand_in,
)

N = 1000


@pytest.fixture
def long_from_100_rows(monkeypatch):
    monkeypatch.setattr(rows, "LONG", 100)
    monkeypatch.setattr(rows, "BLOCK_ROWS", 37)


@pytest.fixture
def table():
    return np.random.default_rng(3).standard_normal((N, 3))


def streamed(table):
    """The table in pieces of 37 rows, and how often the first of them was made."""
    begun = []

    def make():
        begun.append(True)
        yield from (table[k : k + 37] for k in range(0, N, 37))

    return Rows(table.shape, Streamed(make).cut), begun


SLICES = [
    slice(0, 37), slice(30, 80), slice(74, 111), slice(980, None), slice(400, 401), slice(3, 2),
    slice(0, None), slice(None, 37), slice(-5, None), slice(500, 500),
]  # fmt: skip


@pytest.mark.parametrize("at", SLICES)
def test_slices_are_those_of_the_array(at, table, long_from_100_rows):
    found, _ = streamed(table)
    for _ in range(2):  # from wherever the last one has ended
        np.testing.assert_array_equal(np.asarray(found[at]), table[at])
        np.testing.assert_array_equal(np.asarray(found[at, 1]), table[at, 1])


def test_other_places_are_those_of_the_array(table, long_from_100_rows):
    found, _ = streamed(table)
    wanted = np.array([5, 999, 400, 400])
    for at in (7, -1, wanted, table[:, 0] > 0.0, (slice(None), slice(0, 2))):
        np.testing.assert_array_equal(np.asarray(found[at]), table[at])
    np.testing.assert_array_equal(found.T, table.T)
    np.testing.assert_array_equal(found - 2.0 * table, -table)


def test_rows_in_order_are_made_once(table):
    found, begun = streamed(table)
    # as whitening asks for them: some of the rows before come again
    for begin in range(0, N, 37):
        np.testing.assert_array_equal(found[max(begin - 25, 0) : begin + 37],
                                      table[max(begin - 25, 0) : begin + 37])  # fmt: skip
    assert len(begun) == 1


@pytest.mark.parametrize(("first", "step"), [(0.0, 0.001), (-3.7, 0.1), (1e6, 1e-3 / 3.0)])
def test_a_sequence_is_the_array_it_stands_for(first, step, long_from_100_rows):
    long = evenly(first, step, N)
    array = first + np.arange(N) * step
    assert isinstance(long, Rows)
    np.testing.assert_array_equal(np.asarray(long), array)
    np.testing.assert_array_equal(np.asarray(long[300:900]), array[300:900])
    assert long[300:900][-1] == array[899]
    rng = np.random.default_rng(1)
    near = rng.uniform(array[0] - 5 * step, array[-1] + 5 * step, 500)
    beside = np.nextafter(array, np.inf), np.nextafter(array, -np.inf)
    wanted = np.concatenate((array, *beside, near))
    for side in ("left", "right"):
        for some, of in ((long, array), (long[200:], array[200:])):
            np.testing.assert_array_equal(
                np.searchsorted(some, wanted, side=side), np.searchsorted(of, wanted, side=side)
            )
        assert np.searchsorted(long, array[5], side=side) == (5 if side == "left" else 6)


def test_counted_rows_are_whole_numbers(long_from_100_rows):
    found = counted(3, 1003)
    assert found[999] == 1002
    assert found.dtype == np.int64
    np.testing.assert_array_equal(np.asarray(found), np.arange(3, 1003))


def test_sums_and_ends(table, long_from_100_rows):
    left, right = table[:, 0], table[:, 1]
    less = by_rows(np.subtract, left, right)
    assert not rows.is_kept(less)
    np.testing.assert_array_equal(np.asarray(less), left - right)
    assert square_sum(less) == pytest.approx(float(np.sum((left - right) ** 2)), rel=1e-12)
    assert ends_of(less) == ends_of(left - right)
    assert all_of(less, where_finite(less)) is less


@pytest.mark.parametrize("share", [0.5, 0.9, 0.98, 1.0])
def test_a_quantile_is_that_of_the_array(table, share, long_from_100_rows):
    rising = np.sort(table[:, 0])  # the blocks that are looked at first are not like the others
    for values in (table[:, 0], rising, rising[::-1], np.zeros(N), np.round(table[:, 1])):
        parts = [by_rows(np.positive, values[:300]), by_rows(np.positive, values[300:])]
        assert not any(map(rows.is_kept, parts))
        found = rows.upper_quantile(parts, share)
        assert found == pytest.approx(np.quantile(values, share), rel=1e-15, abs=1e-300)


@pytest.mark.parametrize("count", [1, 2, 36, 37, 999, 1000])
def test_a_median_is_that_of_the_array(table, count):
    drifting = table[:count, 0] + 0.01 * np.arange(count)  # some parts say little of the others
    few = np.round(table[:count, 1])
    for values in (table[:count, 2], drifting, drifting[::-1], few, np.abs(few)):
        found = median_of(lambda x=values: (x[k : k + 7] for k in range(0, count, 7)))
        assert found == np.median(values)


def test_a_median_of_what_is_no_number_is_none(table):
    table[500, 0] = np.nan
    assert np.isnan(median_of(lambda: iter(np.split(table[:, 0], 10))))


def test_a_hole_is_seen_wherever_it_is(table, long_from_100_rows):
    for place in (0, 36, 37, 999):
        values = table[:, 0].copy()
        values[place] = np.nan
        made = stand_in(Rows((N,), lambda a, b, x=values: x[a:b]))
        assert not is_finite(made)
        assert np.flatnonzero(~where_finite(made)).tolist() == [place]
        assert all_of(made, where_finite(made)).size == N - 1


def test_what_is_stored_is_an_array(table, long_from_100_rows):
    for values in (evenly(0.0, 0.1, N), by_rows(np.negative, table)):
        again = pickle.loads(pickle.dumps(values))
        assert isinstance(again, np.ndarray)
        np.testing.assert_array_equal(again, np.asarray(values))


def test_short_records_stay_arrays(table):
    assert isinstance(evenly(0.0, 1.0, N), np.ndarray)
    assert isinstance(counted(0, N), np.ndarray)
    assert isinstance(by_rows(np.negative, table), np.ndarray)
