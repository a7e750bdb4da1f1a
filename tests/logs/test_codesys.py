"""Traces of CODESYS: channels one below the other, each with its own instants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import LogError
from fluidact_fit.logs import Log, read_log

TOP = ["[key]; [value]", "Version; 0x03050000", "Name; Application.Trace", "EveryNCycles; 1"]


def channel(
    number: int, name: str, start: float = 2, step: float = 20, count: int = 50, **keys: str
) -> list[str]:
    head = [f"{number}.Variable; {name}", f"{number}.Class; 14", f"{number}.Size; 4"]
    head += [f"{number}.{key}; {value}" for key, value in keys.items()]
    rows = [f"; {start + step * k:g}; {100 * number + k}.250000" for k in range(count)]
    return [*head, f"{number}.Data; ", *rows]


def read(folder: Path, lines: list[str], **options: object) -> Log:
    path = folder / "two.trace.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    log = read_log(path, **options)
    account = log.account
    assert (
        account.total_lines
        == len(lines)
        == (account.header_lines + account.data_rows + account.blank_lines + len(account.left_out))
    )
    return log


TWO = [*TOP, *channel(0, "GVL.p"), *channel(1, "GVL.q", start=12, step=40, count=30)]


@pytest.mark.parametrize("sign", [";", "\t", ","])
@pytest.mark.parametrize("decimal", [".", ","])
def test_channels_with_instants_of_their_own(tmp_path: Path, sign: str, decimal: str) -> None:
    if sign == decimal:
        return
    lines = [line.replace("; ", sign + " ").replace(";", sign) for line in TWO]
    lines = [line.replace(".25", f"{decimal}25") for line in lines]
    log = read(tmp_path, lines)
    assert log.dialect.name == "CODESYS trace"
    assert [c.header for c in log.columns] == ["time", "GVL.p", "GVL.q"]
    assert log.columns[0].unit == "ms"
    time, p, q = (c.values for c in log.columns)
    np.testing.assert_array_equal(time[np.isfinite(p)], 2 + 20 * np.arange(50))
    np.testing.assert_array_equal(p[np.isfinite(p)], np.arange(50) + 0.25)
    np.testing.assert_array_equal(time[np.isfinite(q)], 12 + 40 * np.arange(30))
    np.testing.assert_array_equal(q[np.isfinite(q)], 100 + np.arange(30) + 0.25)
    assert log.columns[1].sparse
    assert log.columns[2].sparse
    assert {why for _, why in log.account.left_out} == {"header of a channel"}
    assert log.account.data_rows == 80


def test_channels_of_one_raster_are_no_holes(tmp_path: Path) -> None:
    log = read(tmp_path, [*TOP, *channel(0, "a"), "", *channel(1, "b"), *channel(2, "c")])
    assert log.rows == 50
    assert not any(c.bad for c in log.columns)


def test_one_channel_and_its_unit(tmp_path: Path) -> None:
    log = read(tmp_path, [*TOP, "Resolution; 1 us", *channel(0, "p", Unit="bar")])
    assert [c.unit for c in log.columns] == ["us", "bar"]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([*TOP, "Resolution; fine", *channel(0, "p")], "not a unit of time"),
        ([*TOP, *channel(0, "p")[:4]], "without samples"),
        ([*TWO, "2.Variable; GVL.r", "2.Class; 14"], "channel 2 without '2.Data'"),
        ([*TOP, *channel(0, "p"), *channel(1, "q")[1:]], "channel 1 without a name"),
        ([*TOP, *channel(0, "p"), "; 3; 4.5"], "does not increase"),
        (
            [*TOP, *channel(0, "p"), *(f"; {k + 5000}; 4.5; 6" for k in range(9))],
            "the columns change",
        ),
    ],
)
def test_what_does_not_add_up_is_refused(tmp_path: Path, lines: list[str], told: str) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, lines)
    assert told in caught.value.text


def test_a_channel_without_samples_is_named(tmp_path: Path) -> None:
    log = read(tmp_path, [*TOP, *channel(0, "p"), *channel(1, "q", count=0), *channel(2, "r")])
    assert [c.header for c in log.columns] == ["time", "p", "r"]
    assert [n.code for n in log.notices] == ["variables-left-out"]


def test_a_cell_that_is_no_number_is_kept(tmp_path: Path) -> None:
    lines = [*TWO]
    lines[20] = lines[20].rpartition(";")[0] + "; TRUE"
    bad = read(tmp_path, lines).columns[1].bad
    assert "TRUE" in bad.values()


def test_a_trace_is_fitted(tmp_path: Path) -> None:
    """Two channels a cycle apart, as a controller takes them in turn."""
    rng = np.random.default_rng(1)
    cycle = np.arange(0, 30_000, 10)
    u = np.repeat(rng.uniform(0, 5, cycle.size // 50), 50)
    y = np.zeros(cycle.size)
    for k in range(1, cycle.size):
        y[k] = y[k - 1] + (1 - np.exp(-10 / 700)) * (0.4 * u[k - 1] - y[k - 1])
    lines = [*TOP]
    for number, values, at in ((0, u, cycle % 20 == 0), (1, y, cycle % 20 == 10)):
        samples = zip(cycle[at], values[at])
        lines += [f"{number}.Variable; GVL.c{number}", f"{number}.Data; "]
        lines += [f"; {t}; {v:.6f}" for t, v in samples]
    log = read(tmp_path, lines, columns={"inlet": "GVL.c0", "outlet": "GVL.c1"})
    result = ff.fit("line", [log], hold={"inlet": "zoh"})
    assert result.parameters["time_constant"].value == pytest.approx(0.7, rel=0.03)
