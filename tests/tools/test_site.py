"""The site: built strictly, complete, and without anything that a reader would fetch."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import fluidact_fit as ff

ROOT = Path(__file__).parents[2]
BUILD = """
import sys
from mkdocs.commands.build import build
from mkdocs.config import load_config
config = load_config("mkdocs.yml", site_dir=sys.argv[1], strict=True)
config.extra["pictures"] = sys.argv[2]
build(config)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site with one picture for all: fits are drawn by `make site`."""
    folder, pictures = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("pictures")
    for name in ff.family_names():
        (pictures / f"{name}.png").write_bytes((ROOT / "docs/assets/fit.png").read_bytes())
    command = [sys.executable, "-c", BUILD, str(folder), str(pictures)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def test_strict_build_has_a_page_for_every_markdown_file(site: Path) -> None:
    docs = ROOT / "docs"
    pages = {path.relative_to(docs).with_suffix(".html") for path in docs.rglob("*.md")}
    assert pages <= {path.relative_to(site) for path in site.rglob("*.html")}


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    fetched = re.compile(
        r'<(?:script|link|img|iframe|source)\b[^>]*\b(?:src|href)="?(?:https?:)?//'
    )
    imported = re.compile(r"@import|url\(.?(?:https?:)?//")
    assert not [p for p in site.rglob("*.html") if fetched.search(p.read_text("utf-8"))]
    assert not [p for p in site.rglob("*.css") if imported.search(p.read_text("utf-8"))]


def test_reference_has_every_command_and_every_name(site: Path) -> None:
    from fluidact_fit_cli.program import _COMMANDS

    text = (site / "reference" / "command-line.html").read_text(encoding="utf-8")
    assert [name for name in _COMMANDS if f'id="{name}"' not in text] == []
    assert "--column" in text
    text = (site / "reference" / "python.html").read_text(encoding="utf-8")
    names = [name for name in ff.__all__ if not name.startswith("__")]
    assert [name for name in names if f"fluidact_fit.{name}" not in text] == []


def test_family_pages_show_the_fit(site: Path) -> None:
    for name in ff.family_names():
        text = (site / "families" / f"{name}.html").read_text(encoding="utf-8")
        assert f"../gallery/{name}.png" in text
        assert (site / "gallery" / f"{name}.png").is_file()
