"""A small part of the study that writes random tables, and whether it sees what is wrong."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from studies.reading_differential.__main__ import make, run
from studies.reading_differential.judge import DOUBTED, REFUSED, RIGHT, SILENT, judge

SEED = 40


def test_no_table_is_read_wrongly_in_silence(tmp_path: Path) -> None:
    found = [run(SEED, number, tmp_path) for number in range(120)]
    silent = [f"{w.how}: {o.text}" for w, o in found if o.word == SILENT]
    assert not silent
    words = Counter(o.word for _, o in found)
    assert words[DOUBTED] > 3
    assert words[RIGHT] > 0.8 * len(found)
    texts = Counter(o.word for w, o in found if w.how.startswith("text"))
    assert texts[REFUSED] < 0.05 * texts[RIGHT]


def _first(word: str, folder: Path) -> int:
    return next(k for k in range(60) if run(SEED, k, folder)[1].word == word)


@pytest.mark.parametrize("what", ["value", "unit", "time", "row"])
def test_the_study_sees_a_difference(what: str, tmp_path: Path) -> None:
    """The same file, beside a truth that is another one."""
    truth, written = make(SEED, _first(RIGHT, tmp_path))
    path = tmp_path / f"a{written.suffix}"
    path.write_bytes(written.data)
    assert judge(truth, written, path).word == RIGHT
    channel = truth.channels[0]
    if what == "value":
        channel.values[3] += 1e-3 + abs(channel.values[3])
    elif what == "unit":
        truth = replace(truth, channels=[replace(channel, size=1.5), *truth.channels[1:]])
    elif what == "time":
        truth = replace(truth, times=[1.01 * t for t in truth.times])
    else:
        truth = replace(truth, times=truth.times[:-1])
    assert judge(truth, written, path).word == SILENT


def test_a_table_is_made_again_from_its_number() -> None:
    assert make(SEED, 5)[1].data == make(SEED, 5)[1].data
    assert make(SEED, 5)[1].data != make(SEED, 6)[1].data
