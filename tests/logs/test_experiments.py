"""From columns to experiments: roles, units, time, runs, windows, steps and holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fluidact_fit.errors import LogError, Notice, UnitError, UsageError
from fluidact_fit.experiment import Experiment, FloatArray
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import (
    Log,
    StepInput,
    choose_variant,
    describe,
    experiments,
    find_constant_signals,
    provenance,
    read_log,
    share_columns,
)

TIME = Role("time", "s", "")
FORCE = Role("force", "N", "", hold="foh")
POSITION = Role("position", "m", "", output=True)
LINEAR = Variant("linear", (TIME, FORCE, POSITION), ())
ROTARY = Variant(
    "rotary", (TIME, Role("torque", "N m", "", hold="zoh"), Role("angle", "rad", "")), ()
)
STATIC = Variant(
    "static",
    (
        Role("reading", "1", ""),
        Role("reference", "m", "", output=True),
        Role("time", "s", "", required=False),
    ),
    (),
)


def write(tmp_path: Path, text: str, name: str = "a.csv") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def table(stamps: list[float] | list[str], header: str = "time [s],force [N],position [mm]") -> str:
    return header + "\n" + "".join(f"{t},{k % 7},{k}\n" for k, t in enumerate(stamps))


def run(
    path: Path, variant: Variant = LINEAR, **options: object
) -> tuple[list[Experiment], list[Notice]]:
    return experiments(read_log(path, **options), variant)  # type: ignore[arg-type]


def codes(notices: list[Notice]) -> set[str]:
    return {notice.code for notice in notices}


def test_units_of_headers_are_converted(tmp_path: Path) -> None:
    text = table(list(range(0, 200, 10)), "time [ms],Force (kN),position_mm")
    (one,), notices = run(write(tmp_path, text))
    assert one.sample_time == 0.01
    assert one.uniform
    np.testing.assert_array_equal(one.time, np.arange(20) * 0.01)
    assert one["force"][3] == 3000.0
    assert one["position"][3] == pytest.approx(0.003)
    assert one.signals["position"].resolution == pytest.approx(0.001)
    assert (one.signals["force"].hold, one.signals["position"].hold) == ("foh", None)
    assert one.signals["force"].before == one["force"][0]
    assert not notices


def test_user_unit_and_scale_win(tmp_path: Path) -> None:
    (one,), _ = run(
        write(tmp_path, table([k / 100 for k in range(20)])),
        units={"position": "um"},
        scales={"position": -2.0},
    )
    assert one["position"][5] == pytest.approx(-10e-6)


def test_assumed_units_make_one_notice(tmp_path: Path) -> None:
    (one,), notices = run(
        write(tmp_path, table([k / 100 for k in range(20)], "t,force,x")),
        columns={"position": "#3"},
    )
    assert one["position"][5] == 5.0
    (notice,) = notices
    assert notice.code == "unit-assumed"
    for word in ("time", "force", "position", "--unit"):
        assert word in notice.message


def test_doubtful_suffix_is_believed_only_where_it_fits(tmp_path: Path) -> None:
    path = write(tmp_path, table([k / 100 for k in range(20)], "t_s,valve_m,x_m"))
    (one,), notices = run(path, columns={"force": "valve_m", "position": "x_m", "time": "t_s"})
    assert one["force"][1] == 1.0
    assert "force" in notices[0].message
    assert "position" not in notices[0].message


def test_wrong_dimension(tmp_path: Path) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)], "time [s],force [mm],position [m]"))
    with pytest.raises(UnitError) as error:
        run(path)
    for word in ("a.csv", "force [mm]", "a length", "a force"):
        assert word in str(error.value)


@pytest.mark.parametrize(
    "wanted", ["pos A [mm]", "POS a [MM]", "pos A", "pos a", "#3", " pos A [mm] "]
)
def test_ways_to_name_a_column(tmp_path: Path, wanted: str) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)], "time [s],force [N],pos A [mm]"))
    (one,), _ = run(path, columns={"position": wanted})
    assert one["position"][4] == pytest.approx(0.004)


def test_missing_column_lists_what_there_is(tmp_path: Path) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)], "time [s],force [N],travel [mm]"))
    with pytest.raises(LogError) as error:
        run(path, columns={"position": "travl"})
    assert "Did you mean 'travel'?" in str(error.value)
    assert "#2 'force [N]'" in str(error.value)
    with pytest.raises(LogError, match="no column '#²'"):
        run(path, columns={"position": "#²"})
    with pytest.raises(LogError, match="no column #9"):
        run(path, columns={"position": "#9"})
    with pytest.raises(LogError, match="no column is named 'position'"):
        run(path)


def mixed_logs(tmp_path: Path, columns: dict[str, str]) -> list[Log]:
    """One log with a column 'p' and one without, read with the same bindings."""
    out = []
    for name, header in (("a.csv", "time,force,position,p"), ("b.csv", "time,force,position,q")):
        rows = "".join(f"{0.1 * k},{k % 7},{k},{k % 3}\n" for k in range(9))
        (tmp_path / name).write_text(f"{header}\n{rows}")
        out.append(read_log(tmp_path / name, columns=columns))
    return out


PRESSED = Variant("pressed", (*LINEAR.roles, Role("pressure", "Pa", "", required=False)), ())
DRIVEN = Variant("driven", (TIME, POSITION, Role("pressure", "Pa", "", output=True)), ())


def test_some_logs_may_lack_the_column_of_an_optional_role(tmp_path: Path) -> None:
    first, second = share_columns(mixed_logs(tmp_path, {"pressure": "p"}))
    assert choose_variant([first, second], (PRESSED,)) is PRESSED
    assert "pressure" in experiments(first, PRESSED)[0][0]
    assert "pressure" not in experiments(second, PRESSED)[0][0]
    # the header was given: a column that happens to be named like the role does not stand in
    text = (tmp_path / "b.csv").read_text().replace(",q", ",pressure")
    (tmp_path / "b.csv").write_text(text)
    both = [read_log(tmp_path / n, columns={"pressure": "p"}) for n in ("a.csv", "b.csv")]
    assert "pressure" not in experiments(share_columns(both)[1], PRESSED)[0][0]


def test_a_column_that_no_log_holds_is_refused(tmp_path: Path) -> None:
    for wanted in ("x", "#5"):
        logs = share_columns(mixed_logs(tmp_path, {"pressure": wanted}))
        with pytest.raises(LogError, match=r"a\.csv: there is no column"):
            experiments(logs[0], PRESSED)


def test_a_required_role_is_asked_of_the_log_that_lacks_it(tmp_path: Path) -> None:
    logs = share_columns(mixed_logs(tmp_path, {"force": "p"}))
    with pytest.raises(LogError, match=r"b\.csv: there is no column 'p' for the role 'force'"):
        choose_variant(logs, (LINEAR,))
    with pytest.raises(LogError, match=r"b\.csv: there is no column 'p' for the role 'force'"):
        experiments(logs[1], LINEAR)


def test_a_role_that_another_variant_requires_leaves_the_choice_open(tmp_path: Path) -> None:
    logs = share_columns(mixed_logs(tmp_path, {"pressure": "p"}))
    assert choose_variant(logs, (DRIVEN, PRESSED)) is PRESSED
    with pytest.raises(LogError, match=r"b\.csv: there is no column 'p' for the role 'pressure'"):
        choose_variant(logs, (DRIVEN,))


def test_ambiguous_columns(tmp_path: Path) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)], "time [s],force [N],force [kN]"))
    with pytest.raises(LogError, match=r"could be #2 'force \[N\]' and #3 'force \[kN\]'"):
        run(path)
    (one,), _ = run(
        path, columns={"force": "force [kN]", "position": "#2"}, units={"position": "m"}
    )
    assert one["force"][1] == 1000.0


def test_unknown_roles_and_holds(tmp_path: Path) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)]))
    with pytest.raises(UsageError, match="Did you mean 'force'"):
        run(path, columns={"forse": "#2"})
    with pytest.raises(UsageError, match="units names the role"):
        run(path, units={"torque": "N m"})
    with pytest.raises(UsageError, match="means something for force"):
        run(path, holds={"position": "zoh"})
    (one,), _ = run(path, holds={"force": "zoh"})
    assert one.signals["force"].hold == "zoh"


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("10x7", "holds '10x7', which is not a number"),
        ("", "is empty"),
        ("nan", "holds 'nan', which is not a finite"),
    ],
)
def test_bad_cells_in_used_columns(tmp_path: Path, cell: str, words: str) -> None:
    lines = table([k / 100 for k in range(300)], "time,force,position,note").splitlines()
    lines = [lines[0]] + [line + ",7" for line in lines[1:]]
    broken = lines[213].split(",")
    broken[1] = cell
    lines[213] = ",".join(broken)
    path = write(tmp_path, "\n".join(lines) + "\n")
    with pytest.raises(LogError) as error:
        run(path)
    assert str(error.value).startswith(f"a.csv, line 214: column 'force' {words}")
    assert "Give columns={'force': ...} if this is not the force, or remove the line." in str(
        error.value
    )
    (one,), _ = run(path, columns={"force": "note"})
    assert one.samples == 300
    (one,), _ = run(path, window=(None, 1.5))
    assert one.samples == 151


def test_time_is_required_unless_the_sample_time_is_given(tmp_path: Path) -> None:
    path = write(tmp_path, table([0.1 * k for k in range(9)], "a,force [N],position [m]"))
    with pytest.raises(LogError, match="sample_time"):
        run(path)
    (one,), _ = run(path, sample_time=0.002)
    np.testing.assert_allclose(one.time, np.arange(9) * 0.002)
    timed = write(tmp_path, table([0.1 * k for k in range(9)]))
    (one,), notices = run(timed, sample_time=0.5)
    assert one.sample_time == 0.5
    assert codes(notices) == {"time-contradicted"}


def test_static_logs_need_no_time(tmp_path: Path) -> None:
    path = write(tmp_path, "D (mm),ADC\n" + "".join(f"{k},{9 * k}\n" for k in range(9)))
    (one,), notices = run(path, STATIC, columns={"reading": "ADC", "reference": "D"})
    assert one.time.size == 0
    assert one.samples == 9
    assert one["reference"][2] == 0.002
    assert not notices
    with pytest.raises(UsageError, match="window cannot be applied"):
        run(path, STATIC, columns={"reading": "ADC", "reference": "D"}, window=(0.0, 1.0))


def test_unusable_optional_time_is_dropped_with_a_notice(tmp_path: Path) -> None:
    path = write(tmp_path, "time,reading,reference\n" + "0,1,2\n" * 5)
    (one,), notices = run(path, STATIC)
    assert one.time.size == 0
    assert "time-unusable" in codes(notices)
    with pytest.raises(LogError, match="same as on the line before"):
        run(path, STATIC, columns={"time": "time"})


@settings(max_examples=80, deadline=None)
@given(
    step=st.sampled_from([0.001, 0.0015, 0.002, 0.01, 1 / 3, 0.0123, 7.0]),
    start=st.sampled_from([0.0, 1000.0, -2.5]),
    digits=st.integers(3, 9),
    truncated=st.booleans(),
)
def test_printed_grids_are_found(step: float, start: float, digits: int, truncated: bool) -> None:
    from fluidact_fit.logs.grid import make_run, print_resolution

    exact = start + np.arange(400) * step
    power = 10.0**digits
    printed = np.floor(exact * power + 1e-6) if truncated else np.round(exact * power)
    printed = printed / power
    if 0.75 * step < 10.0**-digits:
        return
    found = make_run(np.arange(400), printed, print_resolution(printed), 1.0)
    assert found.uniform
    assert found.sample_time == pytest.approx(step, abs=10.0**-digits / 100 + 1e-9 * step)
    np.testing.assert_allclose(found.time, exact, atol=1.01 * 10.0**-digits)


def test_uneven_sampling_is_kept_and_reported(tmp_path: Path) -> None:
    stamps = np.cumsum(np.random.default_rng(1).choice([0.01, 0.02, 0.03], 50)).round(3)
    stamps[30:] += 1.0
    (one,), notices = run(write(tmp_path, table(stamps.tolist())))
    assert not one.uniform
    np.testing.assert_allclose(one.time, stamps)
    assert codes(notices) == {"gap", "uneven-sampling"}
    (said,) = (n.message for n in notices if n.code == "gap")
    assert "line 31" in said
    assert f"--exclude time={stamps[29]:.6g}:{stamps[30]:.6g}" in said


def test_restarts_become_experiments(tmp_path: Path) -> None:
    stamps = [0, 10, 20, 30, 0, 10, 20, 30, 40, 0, 5, 1, 11, 22, 33]
    found, notices = run(write(tmp_path, table(stamps, "time [ms],force [N],position [m]")))
    assert [e.name for e in found] == ["a.csv#1", "a.csv#2", "a.csv#3"]
    assert [e.samples for e in found] == [4, 5, 4]
    np.testing.assert_allclose(found[2].time, [0.001, 0.012, 0.023, 0.034], atol=1.1e-3)
    assert found[1].attributes["lines"] == (6, 10)
    assert {"time-restarts", "run-too-short"} <= codes(notices)


def test_wrapped_counters(tmp_path: Path) -> None:
    header = "time [ms],force [N],position [m]"
    counter = [(2**32 - 45 + 10 * k) % 2**32 for k in range(20)]
    (one,), notices = run(write(tmp_path, table(counter, header)))
    assert one.uniform
    assert one.time[0] == pytest.approx(-0.045)
    assert one.time[-1] == pytest.approx(0.145)
    assert codes(notices) == {"time-wrapped"}
    cycles = [0, 30, 61, 90, 2**32 - 20, 1, 30, 62, 0, 31, 60, 95]
    found, notices = run(write(tmp_path, table(cycles, header)))
    assert [e.samples for e in found] == [4, 4, 4]
    np.testing.assert_allclose(found[1].time, [-0.020, 0.001, 0.030, 0.062])
    assert {"time-wrapped", "time-restarts"} <= codes(notices)


@pytest.mark.parametrize("wrong", [0.3, 0.48, 99.0])
def test_one_wrong_stamp_is_named(tmp_path: Path, wrong: float) -> None:
    stamps = [0.01 * k for k in range(100)]
    stamps[50] = wrong
    with pytest.raises(LogError, match=r"a\.csv, line 52: time goes backwards"):
        run(write(tmp_path, table([f"{t:.2f}" for t in stamps])))


def test_a_time_in_disorder_is_refused_at_once(tmp_path: Path) -> None:
    stamps = [f"{0.01 * k:.2f}" for k in np.random.default_rng(0).permutation(200)]
    with pytest.raises(LogError, match=r"goes back on \d+ of 199 rows: it is not in order") as told:
        run(write(tmp_path, table(stamps)))
    assert "Sort the rows by time" in told.value.text


def test_a_time_that_decreases_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, table([f"{0.01 * k:.2f}" for k in range(60, 0, -1)]))
    with pytest.raises(LogError, match="decreases on every row") as told:
        run(path)
    assert "Reverse the order of the rows" in told.value.text
    (counted_down,), _ = run(path, scales={"time": -1.0})
    assert counted_down.samples == 60


def test_runs_of_the_least_length_are_read(tmp_path: Path) -> None:
    found, _ = run(write(tmp_path, table([0.0, 0.1, 0.2] * 5)))
    assert [e.samples for e in found] == [3] * 5


def test_equal_stamps(tmp_path: Path) -> None:
    stamps = [0.01 * k for k in range(100)]
    stamps[50] = stamps[49]
    with pytest.raises(LogError, match=r"line 52: the time is the same"):
        run(write(tmp_path, table([f"{t:.2f}" for t in stamps])))
    coarse = np.floor(np.cumsum(np.random.default_rng(0).uniform(0.5, 3.0, 300)))
    (one,), notices = run(write(tmp_path, table(coarse.tolist(), "time [ms],force,position")))
    assert one.samples == 300
    assert (np.diff(one.time) > 0).all()
    np.testing.assert_allclose(one.time, coarse / 1000, atol=0.000999)
    assert "time-ties" in codes(notices)


def test_doubtful_time_unit(tmp_path: Path) -> None:
    path = write(tmp_path, table(list(range(0, 200, 10)), "time,force [N],position [m]"))
    assert "time-unit-doubtful" in codes(run(path)[1])
    assert "time-unit-doubtful" not in codes(run(path, units={"time": "s"})[1])


def test_windows_are_on_the_own_time(tmp_path: Path) -> None:
    path = write(tmp_path, table([f"{1000 + 0.1 * k:.1f}" for k in range(50)]))
    (one,), _ = run(path, window=(1001.0, 1002.0))
    assert one.samples == 11
    assert one.time[0] == pytest.approx(1001.0)
    with pytest.raises(LogError, match=r"runs from 1000 to 1004\.9 s"):
        run(path, window=(0.0, 5.0))


def test_steps_stand_for_unrecorded_inputs(tmp_path: Path) -> None:
    path = write(tmp_path, table([f"{0.1 * k:.1f}" for k in range(50)]))
    log = read_log(path, steps={"force": StepInput(1.0, 5.0, 0.5)}, units={"force": "kN"})
    found, _ = experiments(log, LINEAR)
    signal = found[0].signals["force"]
    assert signal.time.tolist() == [0.5]
    assert (signal.before, signal.values.tolist(), signal.hold) == (1000.0, [5000.0], "zoh")
    entry = provenance(log, found)["columns"]["force"]
    assert entry == {"step": {"from": 1.0, "to": 5.0, "at": 0.5}, "unit": "kN", "hold": "zoh"}
    with pytest.raises(UsageError, match="both"):
        run(path, steps={"force": StepInput(0.0, 1.0)}, columns={"force": "#2"})
    with pytest.raises(UsageError, match="Only an input"):
        run(path, steps={"position": StepInput(0.0, 1.0)})


def test_variants_are_chosen_by_their_columns(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, table([0.1 * k for k in range(9)], "time,torque,angle")))
    assert choose_variant(log, (LINEAR, ROTARY)).name == "rotary"
    bare = read_log(
        write(tmp_path, "1,2,3\n" * 5), columns={"torque": "#2", "angle": "#3", "time": "#1"}
    )
    assert choose_variant([log, bare], (LINEAR, ROTARY)).name == "rotary"
    lacking = read_log(write(tmp_path, table([0.1 * k for k in range(9)], "time,torque,x")))
    with pytest.raises(LogError, match="'angle'"):
        choose_variant(lacking, (LINEAR, ROTARY))
    strange = read_log(write(tmp_path, "1,2\n" * 5), columns={"pressure": "#1"})
    with pytest.raises(UsageError, match="pressure"):
        choose_variant(strange, (LINEAR, ROTARY))


def test_constant_and_clipped_signals(tmp_path: Path) -> None:
    time = [f"{0.01 * k:.2f}" for k in range(400)]
    swing = np.clip(np.sin(np.arange(400) / 20), -2, 0.8).round(6)
    rows = "".join(f"{t},5,{x}\n" for t, x in zip(time, swing))
    found, notices = run(write(tmp_path, "time [s],force [N],position [m]\n" + rows))
    assert codes(notices) == {"saturated"}
    (constant,) = find_constant_signals(LINEAR, found)
    assert "force is always 5 N" in constant.message


def test_a_signal_that_was_set_for_every_log_is_not_called_constant(tmp_path: Path) -> None:
    """Isometric benches hold one position a log; a dead sensor shows one in all of them."""
    both = []
    for index, place in enumerate((5, 7)):
        rows = "".join(f"{0.01 * k:.2f},{k % 7},{place}\n" for k in range(100))
        path = write(tmp_path, "time [s],force [N],position [m]\n" + rows, f"log{index}.csv")
        both += experiments(read_log(path), LINEAR, index=index)[0]
    assert not list(find_constant_signals(LINEAR, both))
    assert len(list(find_constant_signals(LINEAR, both[:1]))) == 1


def test_a_signal_at_rest_on_its_extreme_is_not_said_to_be_clipped(tmp_path: Path) -> None:
    # a drive that starts from rest, swings and comes to rest at its extreme, with a slow stop
    time = 0.01 * np.arange(400)
    stroke = np.clip((time - 0.5) / 3.0, 0.0, 1.0)
    swing = (0.5 - 0.5 * np.cos(np.pi * stroke)).round(6)
    swing[370:] = swing[370] * (1.0 - np.linspace(0.0, 0.2, 30) ** 2)
    rows = "".join(f"{t:.2f},{np.sin(3 * t):.4f},{x}\n" for t, x in zip(time, swing))
    _, notices = run(write(tmp_path, "time [s],force [N],position [m]\n" + rows))
    assert "saturated" not in codes(notices)


def test_provenance_never_tells_folders(tmp_path: Path) -> None:
    log = read_log(
        write(tmp_path, table([f"{0.1 * k:.1f}" for k in range(50)], "time,force,y")),
        columns={"position": "y"},
        scales={"position": 2.0},
        units={"position": "mm"},
    )
    found, _ = experiments(log, LINEAR)
    entry = provenance(log, found)
    assert entry == {
        "file": "a.csv",
        "sha256": log.sha256,
        "rows": 50,
        "sample_time": 0.1,
        "columns": {
            "time": {"header": "time", "unit": "s", "assumed": True},
            "force": {"header": "force", "unit": "N", "assumed": True, "hold": "foh"},
            "position": {"header": "y", "unit": "mm", "scale": 2.0},
        },
    }


def test_describe(tmp_path: Path) -> None:
    seen = describe(read_log(write(tmp_path, table(list(range(0, 200, 10)), "t [ms],F [N],x"))))
    assert seen["rows"] == 20
    assert seen["time"]["sample_time"] == 0.01
    assert [c["header"] for c in seen["columns"]] == ["t [ms]", "F [N]", "x"]
    assert seen["columns"][0]["resolution"] == 10
    assert seen["columns"][2]["invalid_cells"] == 0


K = np.arange(60)
EVEN = 0.02 * K
JITTERED = np.cumsum(10 + 30 * ((7 * K) % 11 == 0))
BENT = 0.008 * 1.06**K  # grows as time does, and is none


@pytest.mark.parametrize(
    ("header", "first", "found"),
    [
        ("", EVEN, True),
        ("", JITTERED % 1000, True),  # a controller prints whole ms, and starts again
        ("", BENT, False),
        ("Zeit,y", EVEN, True),
        ("time_stamp,y", BENT, True),
        ("X [s],y", BENT, True),
        ("deflection,load", EVEN, False),
        ("reading,reference", JITTERED, False),
    ],
)
def test_what_grows_is_time_only_if_its_name_or_its_steps_say_so(
    tmp_path: Path, header: str, first: FloatArray, found: bool
) -> None:
    rows = "".join(f"{t},{np.sin(k):.4f}\n" for k, t in enumerate(first))
    seen = describe(read_log(write(tmp_path, f"{header}\n{rows}".lstrip())))
    assert (seen["time"] is not None) == found


def test_a_sample_time_against_a_column_in_seconds_is_warned_of(tmp_path: Path) -> None:
    """5 s for 10 ms gave a time constant of a minute with the verdict PASS."""
    rows = "".join(f"{10 * k},{k % 7},{k % 5}\n" for k in range(100))
    for header, step, code in (
        ("time [ms]", 5.0, "time-contradicted"),
        ("time [ms]", 0.01, "time-replaced"),
        ("time", 5.0, "time-replaced"),
    ):
        path = write(tmp_path, f"{header},force [N],position [m]\n" + rows)
        (notice,) = (n for n in run(path, sample_time=step)[1] if n.code.startswith("time-"))
        assert notice.code == code
