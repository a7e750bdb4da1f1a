"""The results as people read them: a row a part, and every class of failure."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence

from .case import KINDS, Part, Result

_EXPLAINED = """\
# Attacks on the reader, the files and the processes

Written by `make soak`, which draws damage at random with a fixed seed (`studies/soak`) and looks
at what comes of it. Logs of `../shared/data` are damaged too where there are any; without them the
numbers of the cases stand for others.

- `traceback`: an error that is none of the program's own, or a process that the system ended.
- `exit 1`: the program calls it a bug of its own.
- `hang`: more than 10 s of processor time.
- `silent loss`: lines of data that are neither rows nor named as left out, with a reason.
- `disagreement`: the quick and the careful reader differ.
- `wrong`: a number read as another, a file accepted that must be refused, a file lost or half
  written, an undocumented exit status, a message without an end or that moves the cursor.
"""


def shown(result: Result) -> str:
    """One result on a few lines."""
    failures = "".join(f"\n  {kind}: {what}" for kind, what in result.failures)
    message = "".join(f"\n  | {line[:200]}" for line in result.message.splitlines()[:40])
    return f"{result.part}:{result.number}: {result.outcome} <- {result.about}{failures}{message}"


def page(parts: Sequence[Part], results: Sequence[Result], seconds: float, scale: float) -> str:
    """The page: what it means, a row a part, and every class of failure."""
    head = ["part", "cases", "outcomes", *KINDS]
    rows = [_row(p, [r for r in results if r.part == p.name]) for p in parts]
    failed = sum(bool(r.failures) for r in results)
    share = "" if scale == 1.0 else f" ({scale:.0%} of the full number)"
    summary = f"{len(results)} cases{share} in {seconds:.0f} s, {failed} of them failed."
    lines = [
        _EXPLAINED,
        summary,
        "",
        f"| {' | '.join(head)} |",
        "|" + "---|" * len(head),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    if failed:
        again = "Run one again: `python -m studies.soak --only PART:NUMBER`."
        lines += ["", "## What failed", "", again, ""]
    return "\n".join([*lines, *_classes(results), ""])


def _row(part: Part, results: Sequence[Result]) -> list[str]:
    count = Counter(kind for r in results for kind in {k for k, _ in r.failures})
    outcomes = Counter(r.outcome for r in results).most_common()
    told = ", ".join(f"{outcome} {n}" for outcome, n in outcomes)
    return [part.title, str(len(results)), told, *(str(count[kind]) for kind in KINDS)]


def _classes(results: Sequence[Result]) -> Iterator[str]:
    """Failures of one kind in one sentence, numbers and quoted text aside."""
    classes: dict[tuple[str, str, str], list[tuple[Result, str]]] = {}
    for result in results:
        for kind, what in result.failures:
            key = result.part, kind, _squashed(what)
            classes.setdefault(key, []).append((result, what))
    order = list(dict.fromkeys(r.part for r in results))
    for (part, kind, _), found in sorted(
        classes.items(), key=lambda item: (order.index(item[0][0]), item[0][1], -len(item[1]))
    ):
        numbers = ", ".join(f"{part}:{r.number}" for r, _ in found[:3])
        what = re.sub(r"[\x00-\x1f\x7f]|\|", "?", found[0][1])[:200]
        yield f"- {kind}, {len(found)}: {what} ({numbers})"


def _squashed(text: str) -> str:
    text = re.sub(r"'[^']*'|\"[^\"]*\"|/\S+", "X", text)
    return re.sub(r"[-+]?\d[\d.e+-]*|\bnan\b", "0", text)[:100]
