# ruff: noqa: T201 (it prints its table)
"""Write random tables, read them back and compare.

    python -m studies.reading_differential [--tables N] [--seed S] [--show N] [--only N] [--write]

A table that is read to other values, another scale or other instants than were written, without a
word, makes the study fail. Table ``k`` of a seed is always the same one. ``--write`` writes
``docs/evidence/reading-differential.md``.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

from . import binary, text
from .judge import DOUBTED, REFUSED, RIGHT, SILENT, Outcome, judge
from .text import Written
from .truth import Truth, draw

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "reading-differential.md"
_SHARE = 0.75  # of tables that are text
WORDS = (RIGHT, DOUBTED, REFUSED, SILENT)


def make(seed: int, number: int) -> tuple[Truth, Written]:
    """Table ``number`` of a seed, and its file."""
    rng = random.Random(f"{seed} {number}")
    truth = draw(rng)
    writer = text.write if rng.random() < _SHARE else binary.write
    return truth, writer(rng, truth)


def run(seed: int, number: int, folder: Path) -> tuple[Written, Outcome]:
    """Write a table into a folder, read it and judge."""
    truth, written = make(seed, number)
    path = folder / f"t{number}{written.suffix}"
    path.write_bytes(written.data)
    outcome = judge(truth, written, path)
    if outcome.word != SILENT:
        path.unlink()
    return written, outcome


def main() -> None:
    """Run the study and print its table; exit 1 where a table was read wrongly in silence."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="one table; its file stays in the current folder")
    parser.add_argument("--show", type=int, default=12, help="how many messages are listed")
    parser.add_argument("--write", action="store_true", help="write the page")
    given = parser.parse_args()
    if given.only is not None:
        written, outcome = run(given.seed, given.only, Path())
        print(written.how, outcome.word, outcome.text, sep="\n")
        (Path() / f"t{given.only}{written.suffix}").write_bytes(written.data)
        return
    counts: dict[str, Counter[str]] = {}
    refused: Counter[str] = Counter()
    example, silent = {}, []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.tables):
            written, outcome = run(given.seed, number, Path(folder))
            counts.setdefault(written.how.split()[0], Counter())[outcome.word] += 1
            if outcome.word == REFUSED:
                refused[outcome.kind] += 1
                example.setdefault(outcome.kind, number)
            if outcome.word == SILENT:
                silent.append(f"- {number}: {written.how}: {outcome.text}")
    total = sum(counts.values(), Counter())
    rows = [f"| {how} | " + " | ".join(str(c[w]) for w in WORDS) + " |"
            for how, c in (*sorted(counts.items()), ("all", total))]  # fmt: skip
    page = "\n".join([
        "# Tables written and read back", "",
        f"{given.tables} random tables (seed {given.seed}), written by code that shares nothing "
        "with the reader, read as a fit reads them, and compared in SI with what was written. A "
        "doubt is a unit that means two things or nothing, and has to be refused.", "",
        "| format | " + " | ".join(WORDS) + " |", "|---" * 5 + "|", *rows, "",
        "Readable tables that were refused, by message:", "",
        *(f"- {n} × {k} (table {example[k]})" for k, n in refused.most_common(given.show)),
        *(["", "Silently different:", "", *silent[: given.show]] if silent else []), "",
    ])  # fmt: skip
    if given.write and not silent:
        PAGE.write_text(page, encoding="utf-8")
    print(page)
    sys.exit(1 if silent else 0)


if __name__ == "__main__":
    main()
