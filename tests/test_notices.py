"""The table of warning codes against the sources that give them out."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from fluidact_fit.assessment import judge
from fluidact_fit.errors import Notice
from fluidact_fit.notices import CODES, GROUPS
from fluidact_fit.outcome import Agreement

ROOT = Path(__file__).parents[1]
SOURCES = sorted([*(ROOT / "sysid").rglob("*.py"), *(ROOT / "cli").rglob("*.py")])


def assigned_texts(tree: ast.Module, name: str) -> Iterator[str]:
    """Texts that a module assigns to a name: ``code = "hold-matters"``."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Constant):
            continue
        if name in {target.id for target in node.targets if isinstance(target, ast.Name)}:
            yield str(node.value.value)


def codes_in(source: str) -> Iterator[str]:
    """First arguments of ``Notice(...)`` and of methods ``notice``, which add one.

    Copies (``Notice(n.code, ...)``) are left out.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, (ast.Name, ast.Attribute)):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        if name not in ("Notice", "notice"):
            continue
        keywords = {keyword.arg: keyword.value for keyword in node.keywords}
        code = node.args[0] if node.args else keywords["code"]
        if isinstance(code, ast.Constant):
            yield str(code.value)
        elif isinstance(code, ast.Name):
            yield from assigned_texts(tree, code.id)
        elif isinstance(code, ast.IfExp):
            yield from (str(ast.literal_eval(part)) for part in (code.body, code.orelse))


def test_scan_finds_codes_of_every_form() -> None:
    source = """
code = "first"
errors.Notice(code, "...")
Notice("second", "...")
Notice("third" if x else "fourth", "...")
Notice(code="fifth", message="...")
Notice(old.code, "...")
self.notice("sixth", "...")
"""
    assert {*codes_in(source)} == {"first", "second", "third", "fourth", "fifth", "sixth"}


def test_table_has_the_codes_of_the_sources_and_no_others() -> None:
    used = {code for path in SOURCES for code in codes_in(path.read_text(encoding="utf-8"))}
    assert used - {*CODES} == set(), "describe these in sysid/fluidact_fit/notices.py"
    assert {*CODES} - used == set(), "nothing gives these out"


def test_groups_share_no_code() -> None:
    assert sum(map(len, GROUPS.values())) == len(CODES)
    for group in GROUPS.values():
        assert [*group] == sorted(group)


@pytest.mark.parametrize("code", CODES)
def test_texts_are_sentences(code: str) -> None:
    entry = CODES[code]
    for text in (entry.meaning, entry.remedy):
        assert text[0].isupper() or text[0] == "`"
        assert text.endswith(".")
        assert "|" not in text.replace("\\|", ""), "would break the table of the page"


@pytest.mark.parametrize("code", CODES)
def test_severity_decides_the_verdict(code: str) -> None:
    verdict, reasons = judge(Agreement(0.0, 100.0, 10, 0.0), [Notice(code, "")])
    assert verdict == ("pass" if CODES[code].severity == "information" else "warn")
    assert reasons == []
