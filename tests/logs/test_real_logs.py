"""Logs that other people recorded; they may not be redistributed and lie beside the repository."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fluidact_fit.errors import UnitError
from fluidact_fit.family import Role, Variant
from fluidact_fit.logs import choose_variant, describe, experiments, read_log

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="recorded logs of other people are not beside this checkout"
)

TIME = Role("time", "s", "")
TUBE = Variant(
    "line", (TIME, Role("inlet", "Pa", "", hold="foh"), Role("outlet", "Pa", "", output=True)), ()
)
DRIVE = Variant(
    "drive",
    (TIME, Role("torque", "N m", "", hold="zoh"), Role("velocity", "rad/s", "", output=True)),
    (),
)
POT = Variant("pot", (Role("reading", "1", ""), Role("reference", "m", "", output=True)), ())


def test_every_log_can_be_described() -> None:
    paths = [p for p in sorted(DATA.rglob("*.*")) if p.suffix in (".csv", ".dat")]
    assert paths
    for path in paths:
        seen = describe(read_log(path))
        assert seen["rows"] >= 10, path
        assert not any(column["invalid_cells"] for column in seen["columns"]), path


def test_nist_preambles() -> None:
    log = read_log(DATA / "nist/Kirby2.dat", columns={"reading": "#2", "reference": "#1"})
    (one,), _ = experiments(log, POT)
    assert log.dialect.first_data_line == 61
    assert one.samples == 151
    assert (one["reading"][0], one["reference"][0]) == (9.65, 0.0082)


def test_epos_exports() -> None:
    columns = {
        "torque": "Torque actual value averaged",
        "velocity": "velocity actual value averaged",
    }
    path = DATA / "screwdrives/driveNo1/steady_state/0.096kg/10.csv"
    log = read_log(path, columns=columns, units={"torque": "mN m"}, scales={"torque": -9.84 / 100})
    (one,), notices = experiments(log, DRIVE)
    assert not notices
    assert one.uniform
    assert one.sample_time == pytest.approx(0.0512)
    assert one["velocity"].mean() == pytest.approx(-10 * np.pi / 30, rel=0.05)
    assert one["torque"][0] == pytest.approx(32.0 * 9.84e-5)
    with pytest.raises(UnitError, match="'%'"):
        experiments(read_log(path, columns=columns), DRIVE)


@pytest.mark.parametrize("name", ["tube_l1_p2_end_1", "tube_l3_p4_start", "tube_l7_p5_end"])
def test_tube_cycles(name: str) -> None:
    log = read_log(
        DATA / f"tubes/{name}.csv",
        columns={"time": "#1", "inlet": "#2", "outlet": "#3"},
        units={"time": "ms", "inlet": "bar", "outlet": "bar"},
    )
    found, notices = experiments(log, choose_variant(log, [TUBE]))
    assert len(found) > 30
    assert "time-restarts" in {n.code for n in notices}
    for one in found:
        assert -0.5 < one.time[0] < 0.05
        assert one.time[-1] < 10
        assert (np.diff(one.time) > 0).all()
    assert sum(one.samples for one in found) > 0.95 * log.rows


def test_every_tube_log_splits() -> None:
    for path in sorted((DATA / "tubes").glob("*.csv")):
        log = read_log(
            path,
            columns={"time": "#1", "inlet": "#2", "outlet": "#3"},
            units={"time": "ms", "inlet": "bar", "outlet": "bar"},
        )
        found, _ = experiments(log, TUBE)
        assert len(found) > 10, path.name


def test_headerless_and_uneven_logs() -> None:
    static = Variant(
        "s", (TIME, Role("command", "Pa", ""), Role("force", "N", "", output=True)), ()
    )
    log = read_log(
        next((DATA / "muscle").glob("*.csv")),
        columns={"force": "#1", "command": "#2", "time": "#3"},
        units={"force": "N", "command": "kPa", "time": "s"},
    )
    (one,), notices = experiments(log, static)
    assert (np.diff(one.time) > 0).all()
    assert one.sample_time == 0.002
    assert "uneven-sampling" in {n.code for n in notices}
