"""A unit that stands anywhere in a log is never taken for SI."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from fluidact_fit.errors import LogError, UnitError
from fluidact_fit.family import Role
from fluidact_fit.logs import read_log
from fluidact_fit.logs.columns import bind_role
from fluidact_fit.units import conversion_factor, parse_unit_from_header, unit_within

FORCE = Role("force", "N", "")


@pytest.mark.parametrize(
    ("header", "si", "unit"),
    [
        ("F_kN_filtered", "N", "kN"),
        ("F_kN_1", "N", "kN"),
        ("kN Force", "N", "kN"),
        ("forceKN", "N", "KN"),
        ("pBar", "Pa", "Bar"),
        ("pressureMPa", "Pa", "MPa"),
        ("p1bar", "Pa", "bar"),
        ("pA~bar", "Pa", "bar"),
        ("压力MPa", "Pa", "MPa"),
        ("timeMs", "s", "ms"),
        ("t_ms_rel", "s", "ms"),
        ("时间ms", "s", "ms"),
        ("pos2mm_act", "m", "mm"),
        ("TimeInSeconds", "s", None),
        ("p_in", "Pa", None),
        ("x_in_1", "m", None),
        ("x_min_1", "s", None),
        ("force_N_raw", "N", None),
        ("angle_rev_2", "rad", None),
    ],
)
def test_a_unit_in_the_middle_of_a_name_is_found(header: str, si: str, unit: str | None) -> None:
    assert unit_within(header, si) == unit


@pytest.mark.parametrize(
    "header", ["F [N]/10", "10*F [N]", "F*1e5 [N]", "F (N x1000)", "F / 10 [N]", "10 x F [N]"]
)
def test_a_factor_beside_a_unit_is_not_dropped(header: str) -> None:
    _, unit = parse_unit_from_header(header)
    assert unit is not None
    with pytest.raises(UnitError):
        conversion_factor(unit, "N")


def test_a_column_with_a_unit_in_its_name_is_refused_until_the_unit_is_said(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 100:.2f},{math.sin(k):.4f}" for k in range(30)]
    path.write_text("\n".join(["time,forceKN", *rows]))
    binding = {"columns": {"force": "#2"}}
    with pytest.raises(LogError, match="may be in 'KN'"):
        bind_role(read_log(path, **binding), FORCE)
    bound = bind_role(read_log(path, **binding, units={"force": "kN"}), FORCE)
    assert bound is not None
    assert bound.to_si == 1e3
    scaled = bind_role(read_log(path, **binding, scales={"force": 1e3}), FORCE)
    assert scaled is not None
    assert scaled.to_si == 1e3


def test_units_in_a_column_of_their_own_are_not_dropped(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text("\n".join(f"{k * 10},ms,{math.sin(k):.4f},kN" for k in range(30)))
    with pytest.raises(LogError, match=r"may be in 'kN', which appears in column #4"):
        bind_role(read_log(path, columns={"force": "#3"}), FORCE)


@pytest.mark.parametrize(
    ("header", "si", "factor"),
    [
        ("угол, град", "rad", math.pi / 180),
        ("각도(도)", "rad", math.pi / 180),
        ("n, об/мин", "rad/s", math.pi / 30),
        ("Время, мс", "s", 1e-3),
        ("時間(ミリ秒)", "s", 1e-3),
        ("Сила (кН)", "N", 1e3),
    ],
)
def test_units_in_other_scripts_are_read(header: str, si: str, factor: float) -> None:
    unit = parse_unit_from_header(header)[1]
    assert unit is not None
    assert conversion_factor(unit, si) == pytest.approx(factor)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("time,in,out", None),
        ("time,in,pressure [bar]", None),
        ("s,in,lbf", "in"),
        ("time,in,lbf", "in"),
        ("time,in [in],out", "in"),
    ],
)
def test_an_input_is_not_in_inches(header: str, unit: str | None, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(header + "\n" + "".join(f"{0.1 * k:.1f},{k},{2 * k}\n" for k in range(20)))
    assert read_log(path).columns[1].unit == unit
    named = {name: [0.1 * k for k in range(20)] for name in header.split(",")}
    assert read_log(named).columns[1].unit == unit
