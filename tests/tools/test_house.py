"""The figures of ``make house``, counted by hand on a house of one room."""

from __future__ import annotations

from pathlib import Path

import pytest

import house

SOURCE = '''
from typing import (
    Any,
)


class Room:
    def wide(self, a: Any, b, c, d, *, e, f, g: dict[str, Any]) -> Any:
        """Any text."""  # Any comment


def narrow(self, b, c, d, e, f, g, *rest, **more): ...
'''


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for package in ("sysid", "cli"):
        (tmp_path / package).mkdir()
    (tmp_path / "sysid" / "room.py").write_text(SOURCE, encoding="utf-8")
    return tmp_path


def test_counts(root: Path) -> None:
    (module,) = house.survey(root)
    assert module.lines == 12
    assert [f.parameters for f in module.functions] == [6, 7]
    assert [f.lines for f in module.functions] == [1, 2]
    assert module.any_lines == (8, 8, 8)


def test_text_names_places_within_the_root(root: Path) -> None:
    text = house.describe(house.survey(root), root)
    assert str(root) not in text
    assert "1 functions (0 with more than 7)" in text
    assert "2 lines, sysid/room.py:8 wide" in text


def test_tuning_constants_are_counted_by_package(root: Path) -> None:
    (root / "sysid" / "fluidact_fit").mkdir()
    source = "A, B = 1.0, -2e-3\nC = (1, 2 * 3)\nD = True\nE = 'x'\nF = f(1)\ndef g():\n    H = 1\n"
    (root / "sysid" / "fluidact_fit" / "hall.py").write_text(source, encoding="utf-8")
    hall = house.measure(root / "sysid" / "fluidact_fit" / "hall.py")
    assert hall.constants == ("A", "B", "C")
    text = house.describe_packages(house.survey(root), root).splitlines()
    assert text[-1].split() == ["all", "19", "3"]
