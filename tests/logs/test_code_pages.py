"""Headers in the code pages of other scripts, in quotes and in printed tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from fluidact_fit.logs import read_log

ROWS = [f"{k}.5;{k}.25;{k}.75" for k in range(20)]


@pytest.mark.parametrize(
    ("header", "page", "units"),
    [
        ("时间(毫秒);压力(兆帕);力[千牛]", "gbk", ["毫秒", "兆帕", "千牛"]),
        ("时间/ms;压力/MPa;力/kN", "gb18030", ["ms", "MPa", "kN"]),
        ("時間(ミリ秒);圧力(MPa);荷重[kN]", "cp932", ["ミリ秒", "MPa", "kN"]),
        ("시간(밀리초);압력(bar);각도(도)", "cp949", ["밀리초", "bar", "도"]),
        ("Время, мс;Сила, кН;угол, град", "cp1251", ["мс", "кН", "град"]),
        ("Zeit [ms];Größe [µm];Winkel [°]", "cp1252", ["ms", "µm", "°"]),
        ("Größe [mm];Weg [mm];Öße [mm]", "cp1252", ["mm", "mm", "mm"]),
        ("Durée [ms];Contrôle °C [°C];Pièce “é” [mm]", "cp1252", ["ms", "°C", "mm"]),
    ],
)
def test_headers_in_code_pages_keep_their_units(
    tmp_path: Path, header: str, page: str, units: list[str]
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join([header, *ROWS]).encode(page))
    log = read_log(path)
    assert [c.header for c in log.columns] == header.split(";")
    assert [c.unit for c in log.columns] == units


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ('"t [ms],F [kN],x [mm]"', "{0}.5,{0}.25,{0}.75"),
        ('"t [ms],""F [kN]"",x [mm]"', '"{0}.5,{0}.25,{0}.75"'),
        ('"""t [ms]"",""F [kN]"",""x [mm]"""', '"{0}.5,{0}.25,{0}.75"'),
        ("| t [ms] | F [kN] | x [mm] |\n|:--|--:|:-:|", "| {0}.5 | {0}.25 | {0}.75 |"),
    ],
)
def test_headers_in_quotes_or_above_a_ruling_are_read(
    tmp_path: Path, header: str, row: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *(row.format(k) for k in range(20))]))
    assert [c.unit for c in read_log(path).columns] == ["ms", "kN", "mm"]
