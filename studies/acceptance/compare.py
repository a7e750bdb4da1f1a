"""What was committed beside what was seen, and the table of both."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .figures import Figure

GROWN = 1.1  # of a standard error: beyond this factor it counts as worse
_HEADER = ("row", "what", "reference", "committed value", "noise allowed", "seen", "ok")


@dataclass(frozen=True)
class Judgement:
    """A row with its verdict.

    ``word`` is ``ok``, ``wrong today`` (misses its reference and did so when the table was
    committed), ``better``, ``moved`` (changed beyond the noise, no worse), ``new``,
    ``skipped`` or ``worse``; only the last one fails.
    """

    was: Figure | None
    now: Figure | None
    word: str
    why: str = ""

    @property
    def row(self) -> str:
        """Name of the row."""
        return next(figure.row for figure in (self.now, self.was) if figure is not None)

    def cells(self) -> tuple[str, ...]:
        """Cells of the table."""
        named = self.now or self.was
        assert named is not None
        verdict = f"{self.word}: {self.why}" if self.why else self.word
        return (
            named.row,
            named.what,
            named.reference,
            "-" if self.was is None else self.was.text(),
            (self.was or named).noise_text(),
            "-" if self.now is None else self.now.text(),
            verdict,
        )


def compare(
    committed: Sequence[Figure], seen: Sequence[Figure], skipped: Mapping[str, str]
) -> list[Judgement]:
    """Judge every row, the committed ones that are missing too; those worse come last.

    Parameters
    ----------
    committed, seen
        The rows of the table and those of this run.
    skipped
        Groups that were not run, with the reason.
    """
    was = {figure.row: figure for figure in committed}
    now = {figure.row: figure for figure in seen}
    out = []
    for row in [*was, *(row for row in now if row not in was)]:
        before, after = was.get(row), now.get(row)
        if after is None and before is not None and before.group in skipped:
            out.append(Judgement(before, None, "skipped", skipped[before.group]))
        else:
            out.append(Judgement(before, after, *judge(before, after)))
    return sorted(out, key=lambda judgement: judgement.word == "worse")


def judge(was: Figure | None, now: Figure | None) -> tuple[str, str]:
    """Verdict on a row and, where there is one, its reason."""
    if now is None:
        return "worse", "the row is missing"
    if was is None:
        return "new", "not in the committed table"
    if isinstance(was.seen, str) or isinstance(now.seen, str):
        return _judge_words(was, now)
    return _judge_numbers(was, now, was.seen, now.seen)


def _judge_words(was: Figure, now: Figure) -> tuple[str, str]:
    if now.seen == was.seen:
        return ("wrong today", "") if now.wrong else ("ok", "")
    if not isinstance(now.seen, str):
        return "better", "it still misses its reference" if now.wrong else ""
    if now.wanted and now.seen == now.wanted:
        return "better", ""
    return "worse", now.seen


def _judge_numbers(was: Figure, now: Figure, before: float, after: float) -> tuple[str, str]:
    worse_by = was.badness(after, before) - was.badness(before, before)
    if worse_by > was.noise:
        return "worse", f"by {worse_by:.3g}, {was.noise:.2g} is noise"
    if was.spread is not None and now.spread is None:
        return "worse", "it has no standard error"
    if was.spread and now.spread and now.spread > GROWN * was.spread:
        return "worse", f"its standard error was {was.spread:.2g} and is {now.spread:.2g}"
    if now.wrong and not was.wrong:
        return "worse", "it misses its reference"
    if worse_by < -was.noise:
        return "better", "it still misses its reference" if now.wrong else ""
    if abs(after - before) > was.noise:
        return "moved", "no worse"
    return ("wrong today", "") if now.wrong else ("ok", "")


def markdown(judgements: Sequence[Judgement]) -> list[str]:
    """Lines of the table."""
    rows = [_HEADER, tuple("---" for _ in _HEADER), *(j.cells() for j in judgements)]
    return [f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows]


def summary(judgements: Sequence[Judgement]) -> list[str]:
    """What there is to say below the table; the rows that are worse by name."""
    worse = [j.row for j in judgements if j.word == "worse"]
    counts = {word: sum(j.word == word for j in judgements) for word in sorted(_words(judgements))}
    lines = [", ".join(f"{count} {word}" for word, count in counts.items())]
    return [*lines, *(f"worse: {row}" for row in worse)]


def _words(judgements: Sequence[Judgement]) -> set[str]:
    return {judgement.word for judgement in judgements}


def save(path: Path, figures: Sequence[Figure]) -> None:
    """Write rows for later comparisons, one a line."""
    lines = [json.dumps(dataclasses.asdict(f), ensure_ascii=False) for f in figures]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


def load(path: Path) -> list[Figure]:
    """Read rows; none when the file is not there."""
    if not path.exists():
        return []
    return [Figure(**entry) for entry in json.loads(path.read_text(encoding="utf-8"))]
