"""Channels one below the other, with their names in a column of their own."""

from __future__ import annotations

from pathlib import Path

import pytest

from fluidact_fit.errors import LogError
from fluidact_fit.logs import read_log

PAIRS = [(name, k) for k in range(20) for name in ("p1", "p2")]


@pytest.mark.parametrize(
    "header", ["SeriesName", "VarName", "Channel", "variable", "_field", "Tag"]
)
@pytest.mark.parametrize("turn_by_turn", [True, False])
def test_channels_below_each_other_are_refused(
    tmp_path: Path, header: str, turn_by_turn: bool
) -> None:
    pairs = PAIRS if turn_by_turn else sorted(PAIRS)
    path = tmp_path / "log.csv"
    rows = [f"{name};{k * 4};{k * k}" for name, k in pairs]
    path.write_text("\n".join([f"{header};X;Y", *rows]))
    with pytest.raises(LogError, match="stand one below the other"):
        read_log(path)


@pytest.mark.parametrize(
    ("header", "rows"),
    [
        ("Signal;t;x", [f"{'up' if k % 6 < 3 else 'down'};{k};{k * k % 7}" for k in range(40)]),
        ("Channel;t;x", [f"A;{k % 20};{k * k % 7}" for k in range(40)]),
        ("Trial;t;x", [f"T{k // 20};{k % 20};{k * k % 7}" for k in range(40)]),
    ],
)
def test_words_beside_one_channel_are_read(tmp_path: Path, header: str, rows: list[str]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *rows]))
    assert read_log(path).rows == 40
