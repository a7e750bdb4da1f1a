"""The results as people read them: a line each, and the page of all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from .attack import Result

_EXPLAINED = """\
# Attacks on the numbers

Written by `make red-team`. Every attack simulates logs with a simulator of its own
(`studies/red_team/attacks`), fits them through the public interface with the defaults of a new
user, and compares what is written with the truth.

- `silent`: verdict `pass` and a parameter off by more than 4 of its standard errors and 2 %.
- `held`: how often a 95 % interval of an estimated parameter held the truth, over all files
  with verdict `pass`.
- `falsely refused`: runs in which a parameter was refused that the Cramér-Rao bound determines
  to 20 %.
- `slowest`: processor time of one fit.
"""
_HEAD = (
    "| family | attack | runs | pass | warn | fail | refused | silent | held | falsely refused | "
    "slowest | said most |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|",
)


def shown(r: Result) -> str:
    """One result on one line."""
    errors = ", ".join(
        f"{n} {100.0 * e.relative:+.1f} % ({e.deviations:+.1f} se)" for n, e in r.errors.items()
    )
    mark = "SILENT " if r.silent else ""
    return (
        f"{mark}{r.family} / {r.group} / {r.name}: {r.verdict} {errors} "
        f"{' '.join(r.codes)} {r.message.splitlines()[0] if r.message else ''}"
        f"{' not identified: ' + ', '.join(r.not_identified) if r.not_identified else ''}"
        f" {r.seconds:.1f} s"
    )


def page(results: Sequence[Result], seconds: float, share: float = 1.0) -> str:
    """The page: what it all means, one row per group, and every failure."""
    groups: dict[tuple[str, str], list[Result]] = {}
    for r in results:
        groups.setdefault((r.family, r.group), []).append(r)
    rows = [_row(*key, found) for key, found in sorted(groups.items())]
    bad = [r for r in results if r.silent or r.verdict in ("crash", "endless")]
    asked = sum(len(g) for g in groups.values())
    refused = sum(bool(r.wrongly_refused) for r in results)
    silent, broken = sum(bool(r.silent) for r in results), len([r for r in bad if not r.silent])
    part = "" if share == 1.0 else f" ({share:.0%} of the repetitions)"
    slowest = max((r.seconds for r in results), default=0.0)
    summary = (
        f"{asked} runs{part} in {seconds:.0f} s: {silent} wrong in silence, {refused} falsely "
        f"refused, {broken} broken or endless, slowest {slowest:.1f} s."
    )
    failures = ["", "## What failed", "", *(f"- {shown(r)}" for r in bad)] if bad else []
    apart = {f"{r.family} / {r.group} / {r.name}": r for r in results if r.beyond}
    if apart:
        failures += ["", "## What no log of this kind can show", ""]
        failures += [f"- {r.beyond} {shown(r)}" for r in apart.values()]
    return "\n".join((_EXPLAINED, summary, "", *_HEAD, *rows, *failures, ""))


def _row(family: str, group: str, found: Sequence[Result]) -> str:
    count = Counter(r.verdict for r in found)
    errors = [e for r in found if r.verdict == "pass" for e in r.errors.values()]
    held = f"{100.0 * sum(e.held for e in errors) / len(errors):.0f} %" if errors else ""
    codes = Counter(c for r in found for c in r.codes).most_common(2)
    cells = (
        family, group, len(found), count["pass"], count["warn"], count["fail"],
        count["refused"], sum(bool(r.silent) for r in found), held,
        sum(bool(r.wrongly_refused) for r in found),
        f"{max(r.seconds for r in found):.1f} s",
        ", ".join(f"{c} {n}" for c, n in codes),
    )  # fmt: skip
    return "| " + " | ".join(str(c) for c in cells) + " |"
