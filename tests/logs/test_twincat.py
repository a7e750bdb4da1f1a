"""TwinCAT Scope exports, written after its public description, in all the ways it writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.experiment import Experiment
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import Log, describe, experiments, read_log

NAMES = {"druck": "bar", "größe": "mm", "weg (1)": ""}


def export(
    bases: list[tuple[float, list[str], int]],
    *,
    sign: str = "\t",
    decimal: str = ".",
    header_decimal: str = ",",
    timed: str = "ms",
    tail: str = "cut",
    eof: bool = False,
    bare: bool = False,
    project: bool = True,
    start: float = 0.0,
    scale: str = "1",
) -> str:
    """An export of groups, each of a sample time [ms], its channels and its number of samples.

    Times are ``timed`` in ms, as ``filetime``, left ``blank`` or ``out``; shorter groups end with
    lines that are ``cut``, or with a ``blank`` in every cell.
    """

    def quoted(text: str) -> str:
        return f'"{text}"' if sign == " " or sign in text else text

    def row(key: str, *cells: str) -> str:
        done, out = 0, []
        for _, channels, _ in bases:
            out += [key, *cells[done : done + len(channels)]]
            done += len(channels)
        return sign.join(map(quoted, out))

    channels = [(period, name) for period, names, _ in bases for name in names]
    lines = []
    if project:
        lines += [
            sign.join(map(quoted, ["Name", "Prüfstand"])),
            sign.join(map(quoted, ["File", "C:\\scope\\a.tcscopex"])),
            sign.join(
                map(quoted, ["Starttime of export", "132959733843760000", "Montag, 2. Mai 2022"])
            ),
            "",
            "",
        ]
    lines.append(row("Name", *(name for _, name in channels)))
    if not bare:
        periods = [f"{period:g}".replace(".", header_decimal) for period, _ in channels]
        lines += [
            row("SymbolComment", *[""] * len(channels)),
            row("Data-Type", *["REAL64"] * len(channels)),
            row("SampleTime[ms]", *periods),
            row("Offset", *["0"] * len(channels)),
            row("ScaleFactor", *[scale] * len(channels)),
            row("Unit", *(NAMES.get(name, "(None)") or "(None)" for _, name in channels)),
        ]
    lines.append("")
    gap = '" "' if sign == " " else " "
    for k in range(max(count for *_, count in bases)):
        cells: list[str] = []
        for g, (period, names, count) in enumerate(bases):
            if k >= count:
                cells += [gap] * (len(names) + (timed != "out"))
                continue
            instant = start + k * period
            stamp = {
                "ms": f"{instant:.6g}",
                "filetime": str(132959733843760000 + round(instant * 1e4)),
            }
            if timed != "out":
                cells.append(stamp.get(timed, ""))
            cells += [f"{k + 0.5 + 100 * (g + c):g}" for c in range(len(names))]
        while tail == "cut" and cells[-1] == gap:
            cells.pop()
        lines.append(sign.join(cell.replace(".", decimal) for cell in cells))
    return "\n".join([*lines, *(["EOF"] if eof else [])]) + "\n"


def read(folder: Path, text: str, encoding: str = "utf-8", **options: str) -> Log:
    path = folder / "scope.csv"
    path.write_bytes(text.encode(encoding))
    log = read_log(path, **options)
    account = log.account
    assert account.total_lines == text.count("\n")
    assert account.total_lines == (
        account.header_lines + account.data_rows + account.blank_lines + len(account.left_out)
    )
    describe(log)
    return log


ONE = [(1.0, ["druck", "weg (1)"], 40)]
TWO = [(0.2, ["druck", "weg (1)"], 100), (0.5, ["größe"], 40)]


@pytest.mark.parametrize(
    ("sign", "decimal", "header_decimal"),
    [
        ("\t", ".", ","),
        ("\t", ",", "."),
        ("\t", ",", ","),
        (";", ",", "."),
        (";", ".", ","),
        (",", ".", ","),
        (" ", ".", ","),
        (":", ",", ","),
    ],
)
@pytest.mark.parametrize("tail", ["cut", "blank"])
@pytest.mark.parametrize("eof", [False, True])
def test_groups_of_two_sample_times(
    tmp_path: Path, sign: str, decimal: str, header_decimal: str, tail: str, eof: bool
) -> None:
    text = export(
        TWO, sign=sign, decimal=decimal, header_decimal=header_decimal, tail=tail, eof=eof
    )
    log = read(tmp_path, text)
    assert log.dialect.name == "TwinCAT Scope"
    assert [c.header for c in log.columns] == ["time", "druck", "weg (1)", "größe"]
    assert [c.unit for c in log.columns] == ["ms", "bar", None, "mm"]
    assert log.account.data_rows == 100
    assert [why for _, why in log.account.left_out] == ["end mark"] * eof
    time, pressure, _, place = (c.values for c in log.columns)
    expected = np.union1d(np.round(0.2 * np.arange(100), 6), 0.5 * np.arange(40))
    np.testing.assert_allclose(time, expected, atol=1e-12)
    assert log.columns[3].sparse
    own = np.isfinite(place)
    np.testing.assert_allclose(time[own], 0.5 * np.arange(40), atol=1e-12)
    assert place[own].tolist() == [k + 100.5 for k in range(40)]
    own = np.isfinite(pressure)
    np.testing.assert_allclose(time[own], 0.2 * np.arange(100), atol=1e-12)
    assert pressure[own].tolist() == [k + 0.5 for k in range(100)]


@pytest.mark.parametrize(
    ("timed", "unit"), [("ms", "ms"), ("filetime", "s"), ("blank", "ms"), ("out", "ms")]
)
@pytest.mark.parametrize("bases", [ONE, TWO])
def test_time_however_it_is_written(
    tmp_path: Path, timed: str, unit: str, bases: list[tuple[float, list[str], int]]
) -> None:
    log = read(tmp_path, export(bases, timed=timed))
    assert log.columns[0].unit == unit
    factor = {"ms": 1.0, "s": 1000.0}[unit]
    for (period, names, count), first in zip(bases, (0, 2)):
        values = log.columns[1 + first].values
        assert log.columns[1 + first].header == names[0]
        instants = log.columns[0].values[np.isfinite(values)] * factor
        np.testing.assert_allclose(instants, period * np.arange(count), atol=1e-9)


def used(log: Log) -> Experiment:
    roles = (
        Role("time", "s", ""),
        Role("command", "Pa", "", hold="zoh"),
        Role("outlet", "1", "", output=True),
    )
    (one,), _ = experiments(log, Variant("any", roles, ()))
    return one


@pytest.mark.parametrize("timed", ["ms", "filetime"])
def test_every_channel_is_used_at_its_own_instants(tmp_path: Path, timed: str) -> None:
    text = export(TWO, timed=timed)
    one = used(read(tmp_path, text, columns={"command": "druck", "outlet": "größe"}))
    assert (one.samples, one.sample_time) == (40, pytest.approx(0.0005))
    assert one.signals["command"].time.size == 100
    assert one.signals["command"].time[1] == pytest.approx(0.0002)
    assert one["command"][0] == 0.5e5


def test_one_time_per_channel(tmp_path: Path) -> None:
    bases = [(1.0, ["druck"], 30), (1.0, ["größe"], 30)]
    log = read(tmp_path, export(bases))
    assert (len(log.columns), log.rows) == (3, 30)
    assert not any(c.sparse for c in log.columns)


def test_samples_before_the_trigger(tmp_path: Path) -> None:
    log = read(tmp_path, export(TWO, start=-3.0))
    assert log.columns[0].values[0] == -3.0


@pytest.mark.parametrize("project", [False, True])
def test_names_only(tmp_path: Path, project: bool) -> None:
    log = read(tmp_path, export(TWO, bare=True, project=project))
    assert [c.header for c in log.columns] == ["time", "druck", "weg (1)", "größe"]
    log = read(tmp_path, export(ONE, bare=True, timed="out"))
    assert [c.header for c in log.columns] == ["druck", "weg (1)"]


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8-sig"])
def test_umlauts(tmp_path: Path, encoding: str) -> None:
    log = read(tmp_path, export(TWO), encoding)
    assert (log.dialect.encoding, log.columns[3].header) == (encoding, "größe")


def test_a_scale_for_display_is_said_and_not_applied(tmp_path: Path) -> None:
    log = read(tmp_path, export(ONE, scale="2,5"))
    assert log.columns[1].values[:2].tolist() == [0.5, 1.5]
    (notice,) = log.notices
    assert notice.code == "display-scale"
    assert "'druck' (ScaleFactor 2.5)" in notice.message


def test_a_broken_line_is_named(tmp_path: Path) -> None:
    lines = export(TWO).splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("0\t"))
    lines[first + 5] = lines[first + 5].rpartition("\t")[0]
    lines[first + 7] = "\t".join(lines[first + 7].split("\t")[:3])
    bases = [(period, names, 20 * count) for period, names, count in TWO]
    more = export(bases).splitlines()[first + 100 :]
    log = read(tmp_path, "\n".join([*lines[: first + 30], *more[-1000:]]) + "\n")
    assert [n for n, _ in log.account.left_out] == [first + 6, first + 8]
    assert [n.code for n in log.notices] == ["partial-lines"]


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(LogError) as caught:
        read(folder, text)
    assert caught.value.remedy
    return caught.value.text


def test_commas_for_everything_are_refused(tmp_path: Path) -> None:
    assert "decimals too" in refusal(tmp_path, export(ONE, sign=",", decimal=","))


def test_what_holds_no_samples_is_refused(tmp_path: Path) -> None:
    head = export(ONE).partition("\n\n0")[0] + "\n"
    assert "without channels or samples" in refusal(tmp_path, head)
    project = head[: head.index("\n\n\n")] + "\n\n0\t1\n1\t2\n2\t3\n"
    assert "without channels or samples" in refusal(tmp_path, project)


def test_time_that_goes_back_is_refused_where_there_are_several(tmp_path: Path) -> None:
    text = export(TWO).replace("\n0.6\t", "\n0.2\t")
    assert "does not increase" in refusal(tmp_path, text)


@pytest.mark.parametrize(("timed", "stamp"), [("ms", "0.6"), ("filetime", "132959733843766000")])
def test_a_sample_without_its_time_is_refused(tmp_path: Path, timed: str, stamp: str) -> None:
    text = export(TWO, timed=timed).replace(f"\n{stamp}\t", "\noops\t")
    assert "holds 'oops'" in refusal(tmp_path, text)
