"""Dates and times of day as a time column: seconds since the first sample."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import Log, describe, experiments, read_log
from fluidact_fit.logs.columns import default_column

ROLES = (Role("time", "s", ""), Role("outlet", "1", "", output=True))


def read(folder: Path, header: str, rows: list[str]) -> Log:
    path = folder / "a.csv"
    path.write_text("\n".join([header, *rows] if header else rows) + "\n", encoding="utf-8")
    log = read_log(path)
    assert log.account.total_lines == len(rows) + bool(header)
    assert log.rows == len(rows)
    return log


def stamps(form: str, start: float = 43_200.0, step: float = 0.125, count: int = 40) -> list[str]:
    """Times of day from a start [s] on, in a form with ``{clock}``, ``{ms}`` and ``{half}``."""
    out = []
    for k in range(count):
        t = round(1000 * (start + k * step)) % 86_400_000
        hour, minute, second, ms = t // 3_600_000, t // 60_000 % 60, t // 1000 % 60, t % 1000
        out.append(
            form.format(
                clock=f"{hour:02}:{minute:02}:{second:02}",
                civil=f"{(hour - 1) % 12 + 1}:{minute:02}:{second:02}",
                half="PM" if hour >= 12 else "AM",
                ms=f"{ms:03}",
                k=k,
            )
        )
    return out


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("time,p", "2024-05-01 {clock}.{ms},{k}.5"),
        ("Timestamp,p", "2024-05-01T{clock}.{ms}Z,{k}.5"),
        ("Timestamp,p", "2024-05-01T{clock}.{ms}+02:00,{k}.5"),
        ("Zeit;p", "01.05.2024 {clock},{ms};{k},5"),
        ("Zeit;p", "21.11.26 {clock},{ms};{k},5"),
        ("time,p", "11/21/26 {civil}.{ms} {half},{k}.5"),
        ("Time;p", "{clock},{ms};{k},5"),
        ("Time;p", "{clock}.{ms};{k}.5"),
        ("Time;p", "{clock}:{ms};{k}.5"),
        ("time,p", "5/1/2024 {civil}.{ms} {half},{k}.5"),
        ("asctime,p", "2024-05-01 {clock},{ms},{k}.5"),
        ("asctime,p", "{clock},{ms},{k}.5"),
        ("Date,Time,p", "2024-05-01,{clock}.{ms},{k}.5"),
        ("Date;Time;p", "01.05.2024;{clock},{ms};{k},5"),
        ("Time;Date;p", "{clock},{ms};01.05.2024;{k},5"),
        ("", "2024-05-01 {clock}.{ms} {k}.5"),
        ("time p", "2024-05-01 {clock}.{ms} {k}.5"),
        ("", "{clock}.{ms}\t{k}.5"),
        ("# time  p", "{clock}.{ms}  {k}.5"),
    ],
)
def test_stamps_are_seconds_since_the_first(tmp_path: Path, header: str, form: str) -> None:
    log = read(tmp_path, header, stamps(form))
    (clock,) = [c for c in log.columns if c.clock]
    assert clock.unit == "s"
    np.testing.assert_array_equal(clock.values, 0.125 * np.arange(40))
    outlet = log.columns[-1]
    assert outlet.values.tolist() == [k + 0.5 for k in range(40)]
    assert outlet.header == ("p" if header else "")
    bound = read_log(log.path, columns={"outlet": f"#{outlet.index}"})
    (one,), _ = experiments(bound, Variant("any", ROLES, ()))
    assert one.sample_time == 0.125
    assert describe(log)["time"]["column"] == clock.index


def test_microseconds_of_a_date_are_kept(tmp_path: Path) -> None:
    rows = [f"2024-05-01 12:00:00.{50 * k:06},{k}" for k in range(60)]
    assert read(tmp_path, "time,p", rows).columns[0].values[7] == 0.00035


def test_a_clock_beside_a_time_is_not_the_time(tmp_path: Path) -> None:
    log = read(tmp_path, "Stamp,t [ms],p", stamps("{clock},{k},1.5", step=1.0))
    bound = read_log(log.path, columns={"outlet": "p"})
    (one,), _ = experiments(bound, Variant("any", ROLES, ()))
    assert one.sample_time == 0.001


@pytest.mark.parametrize("date", ["", "2024-05-01 "])
def test_midnight(tmp_path: Path, date: str) -> None:
    rows = stamps("{clock}.{ms},{k}", start=86_398.0)
    rows = [f"{date.replace('1 ', '2 ') if k >= 16 else date}{row}" for k, row in enumerate(rows)]
    log = read(tmp_path, "time,p", rows)
    np.testing.assert_array_equal(log.columns[0].values, 0.125 * np.arange(40))
    assert [n.code for n in log.notices] == ([] if date else ["clock-midnight"])
    if not date:
        assert "line 18" in log.notices[0].message


@pytest.mark.parametrize("date", ["", "2024-10-27 "])
def test_the_end_of_summer_time(tmp_path: Path, date: str) -> None:
    rows = stamps(date + "{clock}.{ms},{k}", 10_798.0, count=16)
    rows += stamps(date + "{clock}.{ms},{k}", 7_200.0, count=24)
    log = read(tmp_path, "time,p", rows)
    np.testing.assert_array_equal(log.columns[0].values, 0.125 * np.arange(40))
    assert [n.code for n in log.notices] == ["clock-set-back"]


@pytest.mark.parametrize(
    ("days", "known"), [((1, 3, 5), False), ((1, 2, 3), True), ((11, 12, 13), True)]
)
def test_days_and_months_are_not_guessed(
    tmp_path: Path, days: tuple[int, ...], known: bool
) -> None:
    rows = [f"{d}/05/2024 12:00:{s:02},{s}" for d in days for s in range(20)]
    log = read(tmp_path, "time,p", rows)
    assert [n.code for n in log.notices] == ([] if known else ["dates-doubtful"])
    if known:
        assert log.columns[0].values[20] == 86_400.0
    else:
        assert log.columns[0].bad[0] == rows[0].partition(",")[0]


@pytest.mark.parametrize("dates", [("24-05-31", "24-06-01"), ("24-05-01", "24-05-02")])
def test_years_of_two_digits_that_stand_first(tmp_path: Path, dates: tuple[str, str]) -> None:
    rows = [f"{d} 12:00:{s:02},{s}" for d in dates for s in range(20)]
    log = read(tmp_path, "time,p", rows)
    assert [n.code for n in log.notices] == ["dates-doubtful"]


@pytest.mark.parametrize("first", [True, False])
def test_a_log_that_passes_midnight_tells_day_from_month(tmp_path: Path, first: bool) -> None:
    rows = stamps("{clock}.{ms},{k}", start=86_398.0)
    days = ("01/02/2020", "02/02/2020") if first else ("01/02/2020", "01/03/2020")
    rows = [f"{days[k >= 16]} {row}" for k, row in enumerate(rows)]
    log = read(tmp_path, "time,p", rows)
    np.testing.assert_array_equal(log.columns[0].values, 0.125 * np.arange(40))


@pytest.mark.parametrize(
    "cell",
    [
        lambda t: f"{t:g} sec",
        lambda t: f"{1000 * t:g} ms",
        lambda t: f"0 days 00:00:{t:09.6f}" if t else "0 days 00:00:00",
        lambda t: f"04-Mar-2020 11:59:{50 + t:06.3f}",
        lambda t: f"4-Mai-2020 11:59:{50 + t:06.3f}",
        lambda t: f"4-Mär-2020 11:59:{50 + t:06.3f}",
        lambda t: f"PT{t:g}S",
        lambda t: f"P1DT2H{t:g}S",
        lambda t: f"T#{int(t)}s{1000 * (t % 1):g}ms",
        lambda t: f"t#{2 + int(1000 * t)}MS",
        lambda t: f"TIME#49d_1h_{int(t)}s_{1000 * (t % 1):g}ms",
        lambda t: f"LTIME#{int(1000 * t)}ms0us0ns",
        lambda t: f"TOD#11:59:{50 + t:06.3f}",
        lambda t: f"LDT#2020-03-04-11:59:{50 + t:06.3f}",
        lambda t: f"2020-03-04T11:59:{50 + t:06.3f}+01:00[Europe/Berlin]",
        lambda t: f"2020-03-04 11:59:{50 + t:06.3f} Europe/Berlin",
    ],
)
def test_durations_and_names_of_months(tmp_path: Path, cell: Callable[[float], str]) -> None:
    log = read(tmp_path, "Time,p", [f"{cell(0.125 * k)},{k}.5" for k in range(40)])
    np.testing.assert_allclose(log.columns[0].values, 0.125 * np.arange(40), atol=1e-9)


@pytest.mark.parametrize(
    ("first", "step", "unit"),
    [(1583323197, 0.125, "s"), (1583323197000, 125, "ms"), (1583323197000000, 125000, "us"),
     (1583323197000000000, 125000000, "ns"), (43894.5, 0.125 / 86400, "d"),
     (738000.5, 0.125 / 86400, "d"), (2460432.5, 0.125 / 86400, "d"),
     (133616453171234567, 1250000, "100 ns"), (638500000000000000, 1250000, "100 ns")],
)  # fmt: skip
def test_stamps_of_a_calendar_need_no_unit(
    tmp_path: Path, first: float, step: float, unit: str
) -> None:
    """Nanoseconds since 1970 were taken for seconds: a time constant of 7.98e7 s."""
    rows = [f"{first + k * step:.12f},{k}.5" if unit in ("s", "d") else f"{first + k * step},{k}.5"
            for k in range(40)]  # fmt: skip
    bound = read_log(read(tmp_path, "time,p", rows).path, columns={"outlet": "p"})
    (one,), notices = experiments(bound, Variant("any", ROLES, ()))
    assert one.sample_time == pytest.approx(0.125, rel=1e-4)
    assert any(f"time in {unit} ('time'" in n.message for n in notices)
    given = read_log(bound.path, columns={"outlet": "p"}, units={"time": "s"})
    (one,), _ = experiments(given, Variant("any", ROLES, ()))
    assert one.sample_time == pytest.approx(step, rel=1e-4)  # what the user says is believed


@pytest.mark.parametrize("cell", ["T#1ms1s", "T#1s1s", "T#5", "T#1.2.3s", "P1M", "T#s", "D#5"])
def test_durations_that_are_none_are_named(tmp_path: Path, cell: str) -> None:
    """Units of a PLC literal go from large to small, each once; a month has no length."""
    log = read(tmp_path, "Time,p", [f"{cell},{k}.5" for k in range(40)])
    assert not log.columns[0].clock
    assert log.columns[0].bad[0] == cell


def test_a_temperature_is_not_taken_for_the_time(tmp_path: Path) -> None:
    """ "T" was, for a "t", and the log refused."""
    rows = [f"{0.125 * k};{20 + k % 3};{k}.5" for k in range(40)]
    for header in ("t/s;T/°C;p", "t [s];T [degC];p", "t/s;T/Nm;p"):
        assert default_column(read(tmp_path, header, rows), "time").index == 1
    assert default_column(read(tmp_path, "p;T/Nm;x", rows), "time") is None


def test_a_date_beside_a_duration_counts_from_its_own_beginning(tmp_path: Path) -> None:
    """It counted from that of the duration, in 1970, and lost the digits below 0.2 us."""
    rows = [f"2024-05-31 12:00:00.{4 * k:03d},0:00:00.{4 * k:03d},{k}.5" for k in range(40)]
    log = read(tmp_path, "at,elapsed,p", rows)
    for column in log.columns[:2]:
        np.testing.assert_allclose(column.values, 0.004 * np.arange(40), atol=1e-12)
    assert [c.since for c in log.columns[:2]] == [1_717_156_800_000_000_000, 0]


def test_a_clock_that_is_not_read_moves_no_other(tmp_path: Path) -> None:
    """Beside it, another one counted from midnight instead of from its first sample."""
    zones = (" CET", " CEST")
    rows = [f"11:00:{k:02d},12:00:{k:02d}{zones[k % 2]},{k}.5" for k in range(40)]
    log = read(tmp_path, "at,logged,p", rows)
    assert log.columns[1].doubt
    np.testing.assert_array_equal(log.columns[0].values, np.arange(40.0))
    assert [c.since for c in log.columns[:2]] == [39_600 * 10**9, 0]


def test_a_timer_is_not_taken_for_the_time(tmp_path: Path) -> None:
    """The only column of durations was, although another one was called the time."""
    rows = [f"{0.125 * k},T#{k % 8}ms,{k}.5" for k in range(40)]
    assert default_column(read(tmp_path, "Zeit,timer,p", rows), "time").index == 1
    rows = [f"{k},T#{125 * k}ms,{k}.5" for k in range(40)]
    assert default_column(read(tmp_path, "count,elapsed,p", rows), "time").index == 2
    assert default_column(read(tmp_path, "count,at,p", rows), "time").index == 2


def test_a_unit_does_not_apply_to_a_clock(tmp_path: Path) -> None:
    """It made seconds of it milliseconds."""
    path = read(tmp_path, "time,p", stamps("{clock}.{ms},{k}.5")).path
    with pytest.raises(LogError, match="does not apply"):
        experiments(
            read_log(path, columns={"outlet": "p"}, units={"time": "ms"}), Variant("any", ROLES, ())
        )


def test_seconds_of_a_fast_logger_are_not_days(tmp_path: Path) -> None:
    rows = [f"{43894.5 + k * 1e-4:.4f},{k}.5" for k in range(40)]
    bound = read_log(read(tmp_path, "time,p", rows).path, columns={"outlet": "p"})
    (one,), _ = experiments(bound, Variant("any", ROLES, ()))
    assert one.sample_time == pytest.approx(1e-4)


def test_a_stamp_that_is_none_is_named(tmp_path: Path) -> None:
    rows = stamps("{clock}.{ms},{k}")
    rows[7] = "12:61:00.000,7"
    assert read(tmp_path, "time,p", rows).columns[0].bad == {7: "12:61:00.000"}


def test_a_stamp_of_another_century_is_named(tmp_path: Path) -> None:
    rows = [f"2024-05-01 12:00:{s:02},{s}" for s in range(40)]
    rows[7] = "1224-05-01 12:00:07,7"
    log = read(tmp_path, "time,p", rows)
    assert log.columns[0].bad == {7: "1224-05-01 12:00:07"}


def test_ratios_and_versions_are_no_stamps(tmp_path: Path) -> None:
    log = read(tmp_path, "t;mix;p", [f"{k};12:30;1.{k}" for k in range(40)])
    assert not any(c.clock for c in log.columns)


def hms(seconds: float) -> str:
    return f"{int(seconds) // 3600:02}:{int(seconds) // 60 % 60:02}:{int(seconds) % 60:02}"


@pytest.mark.parametrize(
    ("cell", "step"),
    [
        (lambda k: f"0:{hms(3500 + k)}", 1.0),  # days, hours, minutes, seconds
        (lambda k: f"{(86_300 + k) // 86400:02}:{hms((86_300 + k) % 86400)}", 1.0),
        (lambda k: f"001:{hms(43_000 + k // 2)}.{5 * (k % 2)}00", 0.5),  # IRIG
        (lambda k: f"123:{hms(43_000 + 10 * k)}", 10.0),
        (lambda k: f"{(86_300 + k) // 86400}:{hms((86_300 + k) % 86400)}", 1.0),
        (lambda k: f"{hms(900 + k // 100)}:{k % 100:02}", 0.01),  # hundredths
        (lambda k: f"{hms(90 + k // 50)}:{20 * (k % 50)}", 0.02),  # %d of milliseconds
        (lambda k: f"0:0:{k // 50}:{20 * (k % 50)}", 0.02),
        (lambda k: f"{hms(90 + k // 50)}:{20_000 * (k % 50)}", 0.02),
        (lambda k: f"2024-05-01 {hms(90 + k // 50)}:{20 * (k % 50):03}", 0.02),
        (lambda k: f"{(30 + k // 2) // 60}:{(30 + k // 2) % 60:02}.{5 * (k % 2)}", 0.5),
        (lambda k: f"{hms(3590 + k // 2)[3:]}.{5 * (k % 2)}", 0.5),  # over the hour
        (lambda k: f"20240501{hms(43_000 + k).replace(':', '')}", 1.0),
        (lambda k: f"20240501T{hms(43_000 + k).replace(':', '')}.250", 1.0),
        (lambda k: f"20240501_{hms(43_000 + k).replace(':', '')}", 1.0),
        (lambda k: f"2024-123T{hms(43_000 + k)}.5Z", 1.0),
        (lambda k: f"2024-05-01 {hms(43_000 + k)} CEST", 1.0),
        (lambda k: f"2024-05-01 {hms(43_000 + k)}+02", 1.0),
        (lambda k: f"{(46_700 + k) // 3600 % 12 or 12}{hms(46_700 + k)[2:]}", 1.0),
    ],
)  # fmt: skip
def test_forms_of_clocks(tmp_path: Path, cell: Callable[[int], str], step: float) -> None:
    """Days were read as hours and hundredths as seconds; numbers without signs skipped a minute."""
    log = read(tmp_path, "time;p", [f"{cell(k)};{k}.5" for k in range(200)])
    np.testing.assert_allclose(log.columns[0].values, step * np.arange(200), atol=1e-9)


@pytest.mark.parametrize(
    ("cell", "told"),
    [
        (lambda k: f"{hms(3600 + k // 25)}:{k % 25:02}", "frames, 25 to a second"),
        (lambda k: f"{hms(3600 + k // 24)}:{k % 24:02}", "frames, 24 to a second"),
        (lambda k: f"{hms(3600 + k // 30)};{k % 30:02}", "frames, 30 to a second"),
        (lambda k: f"{hms(3600 + k // 30)}:{k % 30}", "frames, 30 to a second"),
        (lambda k: f"{hms(60 + k // 60)}:{k % 60:02}", "may be days, hours, minutes and seconds"),
        (lambda k: f"0:{hms(60 * k)}", "may be days, hours, minutes and seconds, or"),
        (lambda k: f"{hms(3600)}:{k % 20:02}" if k < 20 else f"{hms(3600 + k)}:05", "may be days"),
        (lambda k: f"2024-05-01T{hms(k)}{'Z' * (k % 2)}", "name several zones (UTC, none)"),
        (lambda k: f"2024-10-27 {hms(k)} {'CEST' if k < 99 else 'CET'}", "zones (CEST, CET)"),
    ],
)
def test_clocks_that_may_be_read_in_several_ways_are_refused(
    tmp_path: Path, cell: Callable[[int], str], told: str
) -> None:
    log = read(tmp_path, "time,p", [f"{cell(k)},{k % 9}.5" for k in range(200)])
    assert np.isnan(log.columns[0].values).all()
    assert [n.code for n in log.notices] == ["clock-doubtful"]
    bound = read_log(log.path, columns={"outlet": "p"})
    with pytest.raises(LogError) as caught:
        experiments(bound, Variant("any", ROLES, ()))
    assert told in caught.value.text
    assert "line 2: column 'time' was not read" in caught.value.text
    assert "--sample-time SECONDS" in caught.value.remedy


@pytest.mark.parametrize("cell", [lambda k: hms(k)[3:], lambda k: hms(60 * k)[:5]])
def test_two_numbers_may_be_minutes_or_hours(tmp_path: Path, cell: Callable[[int], str]) -> None:
    log = read(tmp_path, "time,p", [f"{cell(k)},{k}.5" for k in range(60)])
    bound = read_log(log.path, columns={"outlet": "p"})
    with pytest.raises(LogError, match="hours and minutes or minutes and seconds"):
        experiments(bound, Variant("any", ROLES, ()))


@pytest.mark.parametrize("end", ["", ".25"])
@pytest.mark.parametrize(("start", "step"), [(43_000, 1), (3_590, 1), (82_000, 20), (10, 60)])
def test_digits_of_a_clock_are_no_count(tmp_path: Path, start: int, step: int, end: str) -> None:
    """They skip from 115659 to 115700: 41 s where one had passed."""
    rows = [f"{hms(start + step * k).replace(':', '').lstrip('0')}{end},{k}.5" for k in range(200)]
    bound = read_log(read(tmp_path, "time,p", rows).path, columns={"outlet": "p"})
    with pytest.raises(LogError, match="digits of a clock"):
        experiments(bound, Variant("any", ROLES, ()))


@pytest.mark.parametrize("step", [0.5, 1, 7, 20, 50, 100])
def test_seconds_are_no_digits_of_a_clock(tmp_path: Path, step: float) -> None:
    bound = read_log(
        read(tmp_path, "time,p", [f"{k * step},{k}.5" for k in range(60)]).path,
        columns={"outlet": "p"},
    )
    (one,), _ = experiments(bound, Variant("any", ROLES, ()))
    assert one.sample_time == step


@pytest.mark.parametrize("hours", [1, 2, 6])
def test_a_slow_logger_is_not_set_back(tmp_path: Path, hours: int) -> None:
    """Steps of half an hour and more were each lengthened by an hour."""
    rows = [f"2024-05-{1 + k * hours // 24:02} {k * hours % 24:02}:00:00,{k}" for k in range(40)]
    log = read(tmp_path, "time,p", rows)
    np.testing.assert_array_equal(log.columns[0].values, 3600.0 * hours * np.arange(40))
    assert not log.notices


@pytest.mark.parametrize(
    ("name", "first", "step", "unit"),
    [("__time", 1717171717123456789, 10_000_000, "ns"), ("stamp", 45413.5, 1 / 86400, "d"),
     ("epoch time", 1717171717123, 10, "ms")],
)  # fmt: skip
def test_inspect_reads_the_time_as_a_fit_does(
    tmp_path: Path, name: str, first: float, step: float, unit: str
) -> None:
    """It showed nanoseconds and days of a spreadsheet as seconds."""
    rows = [f"{first + k * step:.9f},{k}.5" if unit == "d" else f"{first + k * step},{k}.5"
            for k in range(40)]  # fmt: skip
    log = read(tmp_path, f"{name},p", rows)
    bound = read_log(log.path, columns={"time": "#1", "outlet": "p"})
    (one,), _ = experiments(bound, Variant("any", ROLES, ()))
    shown = describe(log)["time"]
    assert shown["unit"] == unit
    assert shown["start"] == one.time[0]
    assert shown["sample_time"] == pytest.approx(one.sample_time, rel=1e-5)


def test_a_fraction_without_its_zeros_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"10:00:{k // 50:02d}.{k % 50 * 20},{k % 7}" for k in range(100)]
    path.write_text("\n".join(["Time,x", *rows]))
    assert "lost zeros" in read_log(path).columns[0].doubt


def test_a_fraction_without_zeros_behind_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    stamps = [f"10:00:{k // 50:02d}" + f".{k % 50 * 2:02d}".rstrip("0.") for k in range(100)]
    path.write_text("\n".join(["Time,x", *(f"{stamp},{k % 7}" for k, stamp in enumerate(stamps))]))
    log = read_log(path)
    np.testing.assert_allclose(log.columns[0].values, 0.02 * np.arange(100), atol=1e-9)


def test_times_of_day_as_a_spreadsheet_counts_them_are_named(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{0.416666 + k / 86400:.8f},{k % 7}" for k in range(60)]
    path.write_text("\n".join(["Time,x", *rows]))
    notices = {n["code"]: n["message"] for n in describe(read_log(path))["notices"]}
    assert "--unit time=d" in notices["time-unit-doubtful"]
