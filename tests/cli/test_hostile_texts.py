"""Small texts that once cost minutes end, with a message that can be read."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
ROWS = "".join(f"{k / 100};{k % 7}\n" for k in range(50))
Run = Callable[..., Any]

LOGS = {
    "semicolons behind a quote": '"' + ";" * 4000 + "\n" + ROWS,
    "rows of semicolons behind a quote": ('"' + ";" * 4000 + "\n") * 60,
    "brackets above blanks": "time  " + "a(" * 40_000 + "\n" + ROWS.replace(";", "  "),
    "dashes above blanks": "time  x\n" + "-" * 40_000 + "x\n" + ROWS.replace(";", "  "),
    "rows of nothing": "time;x\n" + ROWS + ";\n" * 10_000 + ROWS,
    "entries below": "time;x\n" + ROWS + "a: 1\n" * 2000,
    "form feeds below": ROWS + "\f" * 60_000 + "x\n" + ROWS,
    "brackets that never close": "time;" + "a(" * 40_000 + "\n" + ROWS,
    "dashes": "time;x\n" + "-" * 40_000 + "\n" + ROWS,
    "form feeds": "time;x" + "\f" * 60_000 + "\n" + ROWS,
    "a cell of dashes": "time;x\n" + ROWS + "1;" + "-" * 40_000 + "\n" + ROWS,
    "blanks in a name": "time;a" + " " * 60_000 + "b\n" + ROWS,
    "nested brackets": "time;" + "[" * 40_000 + "\n" + ROWS,
    "quotes": "time;x\n" + '"' * 40_001 + "\n" + ROWS,
    "signs of a unit": "time;x (" + "m/" * 20_000 + ")\n" + ROWS,
    "a number without end": "time;x\n" + ROWS + "1;" + "1" * 40_000 + "x\n" + ROWS,
}


@pytest.mark.parametrize("name", LOGS)
def test_a_hostile_log_ends(name: str, apart: Run, inside: Path) -> None:
    (inside / "log.csv").write_text(LOGS[name])
    done = apart("inspect", "log.csv", timeout=60)
    assert done.status in (0, 3), done.err
    assert "Traceback" not in done.err
    assert len(done.err) < 20_000


HEADERS = {
    "comments": "// a\n" * 16_000,
    "comments and names": "/* a [m */\n" * 3000 + "float " + "a, " * 15_000 + "b; // [s]\n",
    "many keys": "".join(f"#define KEY_OF_SOME_LENGTH_{k} 1.0f // [m]\n" for k in range(2500)),
    "quotes that are escaped": '\\"' * 40_000,
    "capitals": "float " + "A" * 40_000 + "(",
    "brackets": "float a[] = {" + "{[(" * 30_000,
    "open comment": "/*" * 40_000,
}


@pytest.mark.parametrize("name", HEADERS)
def test_a_hostile_header_of_a_controller_ends(name: str, apart: Run, inside: Path) -> None:
    shutil.copy(GOLDEN / "line.yaml", "line.yaml")
    (inside / "c.h").write_text(HEADERS[name])
    done = apart("check-consumer", "line.yaml", "c.h", timeout=60)
    assert done.status in (3, 5), done.err
    assert len(done.err) < 20_000
    assert "Traceback" not in done.err


def tagged(text: str) -> str:
    tags = "".join(f"%TAG !t{k}! tag:example.org,2000:{k}\n" for k in range(50_000))
    return f"{tags}---\n{text}"


@pytest.mark.parametrize("behind", [False, True])
def test_directives_of_yaml_are_refused(behind: bool, apart: Run, inside: Path) -> None:
    text = (GOLDEN / "line.yaml").read_text()
    hostile = f"{text}...\n{tagged('a: 1')}" if behind else tagged(text)
    (inside / "bad.yaml").write_text(hostile)
    (inside / "good.yaml").write_text(text)
    for command in (
        ("export", "bad.yaml", "--to", "json"), ("report", "bad.yaml"),
        ("simulate", "good.yaml", "--controller", "bad.yaml", "--reference", "step"),
        ("batch", "bad.yaml", "-o", "jobs"), ("check-consumer", "good.yaml", "bad.yaml"),
    ):  # fmt: skip
        done = apart(*command, timeout=60)
        assert done.status == 3, (command, done)
        assert "directive" in done.err
        assert len(done.err) < 2000


def test_a_version_of_yaml_is_read(apart: Run, inside: Path) -> None:
    text = (GOLDEN / "line.yaml").read_text()
    (inside / "a.yaml").write_text(f"%YAML 1.2\n---\n{text}")
    assert apart("export", "a.yaml", "--to", "json").status == 0
