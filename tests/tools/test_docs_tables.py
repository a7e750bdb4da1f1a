"""Generated parts of the pages: what a new family gets, and what a hand edit brings."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

import docs_tables as docs
import fluidact_fit as ff
from fluidact_fit.family import Family, FamilyOptions, ParameterSpec, Role, Variant
from fluidact_fit.options import choice, flag, number, settled

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs" / "families"


@dataclass(frozen=True)
class LeakOptions(FamilyOptions):
    """Options of every kind that the table tells apart."""

    method: str = choice("exact", ("exact", "rough"), "how")
    volume: float | None = number(help="volume of the chamber", unit="m3")
    warm: bool | None = flag(False, help="whether it is warm")
    start: float | None = settled("float", "instant of the first drop", unit="s")


class Leak(Family[LeakOptions]):
    """A chamber that leaks."""

    name = "test-chamber"
    title = "Leak: time constant of a chamber"
    equation = "pressure' = -(pressure - ambient) / time_constant"
    variants = (
        Variant(
            "test-chamber",
            (
                Role("pressure", "Pa", "pressure in the chamber", output=True),
                Role("valve", "V", "a | b", required=False, hold="zoh", alternatives=("A",)),
            ),
            (ParameterSpec("ambient", "Pa", "final pressure", neutral=0.0, optional=True),),
        ),
    )
    options_type = LeakOptions

    estimate = simulate = block = None  # type: ignore[assignment]


@pytest.fixture
def with_leak(monkeypatch: pytest.MonkeyPatch) -> None:
    """The registry with one more family, between its first two."""
    monkeypatch.setattr(Family, "__abstractmethods__", frozenset(), raising=False)
    first, *others = ff.family_names()
    real = ff.get_family
    monkeypatch.setattr(ff, "family_names", lambda: (first, "test-chamber", *others))
    monkeypatch.setattr(ff, "get_family", lambda n: Leak() if n == "test-chamber" else real(n))


def test_every_family_has_its_page() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} == {*ff.family_names(), "index"}


def test_new_family_gets_a_page(with_leak: None, tmp_path: Path) -> None:
    shutil.copytree(PAGES, tmp_path, dirs_exist_ok=True)
    docs.arrange_pages(tmp_path)
    assert "A chamber that leaks." in (tmp_path / "test-chamber.md").read_text(encoding="utf-8")
    kept = [page for page in PAGES.glob("*.md") if (tmp_path / page.name).exists()]
    assert all(page.read_bytes() == (tmp_path / page.name).read_bytes() for page in kept)
    assert len(kept) == len(ff.family_names()), "of the others and the index"


def test_tables_hold_what_the_family_says(with_leak: None) -> None:
    text = docs.family("test-chamber")
    assert "| `pressure` | Pa | | pressure in the chamber (compared with the model) |" in text
    assert "| `valve` | V or A | `zoh` | a \\| b (optional) |" in text
    assert "| `ambient` | Pa | 0 | final pressure (optional) |" in text
    assert "| `--method` | `exact` or `rough`, default `exact` | how |" in text
    assert "| `--volume` | number [m3] | volume of the chamber |" in text
    assert "| `start` | number [s] | instant of the first drop |" in text
    assert Leak.equation in docs.equation("test-chamber")


def test_page_of_a_family_that_is_gone_goes(tmp_path: Path) -> None:
    (tmp_path / "windmill.md").write_text("# windmill\n", encoding="utf-8")
    docs.arrange_pages(tmp_path)
    assert not (tmp_path / "windmill.md").exists()


def test_file_parts_all_say_what_they_hold() -> None:
    assert "| |\n" not in docs.parts()


def check_page(path: Path) -> int:
    command = [sys.executable, "-m", "cogapp", "-P", "-I", str(ROOT / "tools"), "-p",
               "import docs_tables as docs", "--check", str(path)]  # fmt: skip
    return subprocess.run(command, capture_output=True, check=False).returncode


def test_hand_edit_of_a_generated_table_is_found(tmp_path: Path) -> None:
    copy = Path(shutil.copy(ROOT / "docs" / "warnings.md", tmp_path))
    assert check_page(copy) == 0
    text = copy.read_text(encoding="utf-8")
    copy.write_text(text.replace("| `gap` | warning |", "| `gap` | information |"))
    assert check_page(copy) != 0
