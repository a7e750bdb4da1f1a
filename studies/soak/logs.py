"""Damaged logs: every line accounted for, every number as it was, one meaning for both readers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from fluidact_fit.errors import FluidactError
from fluidact_fit.logs import Log, read_log, table

from .case import DISAGREEMENT, LONGEST, LOSS, WRONG, Case, Part, Result
from .damage import ON_CELLS, ON_LINES, damaged
from .drafts import Draft, dressed, recorded, sources


def attack_reader(case: Case) -> Result:
    """Read one damaged log."""
    return _read(case, damaged(dressed(case.rng), case.rng, (*ON_LINES, *ON_CELLS)))


def attack_whole(case: Case) -> Result:
    """Read one log that nothing was done to but to write it in another dialect."""
    draft = dressed(case.rng)
    result = _read(case, draft)
    if result.outcome == "refused" and not ambiguous(draft):
        result.fail(WRONG, "a log with nothing wrong is refused")
    return result


def ambiguous(draft: Draft) -> bool:
    """Whether every decimal sign of a log may as well group thousands."""
    cells = [c.strip(' "') for i in draft.rows() for c in draft.cells(i)]
    signed = [c for c in cells if draft.decimal in c]
    return all(re.fullmatch(r"[+-]?[1-9]\d{0,2}\D\d{3}", c) for c in signed) and bool(signed)


def attack_recorded(case: Case) -> Result:
    """Read one of the logs as it was recorded."""
    draft = recorded(case.rng.choice(sources()))
    draft.about.append(draft.name)
    result = _read(case, draft)
    if result.outcome == "refused":
        result.fail(WRONG, "a recorded log is refused")
    return result


def compare_readers(case: Case) -> Result:
    """Read one damaged log with the quick reader where it will, and with the careful one."""
    rng = case.rng
    draft = dressed(rng)
    kinds = ON_CELLS if rng.random() < 0.8 else ON_LINES
    path = case.folder / "log.csv"
    _write(case, draft if rng.random() < 0.1 else damaged(draft, rng, kinds))
    found = []
    was = table.FAST_FROM_BYTES
    try:
        for bytes_ in (0, math.inf):
            table.FAST_FROM_BYTES = bytes_
            try:
                found.append(read_log(path))
            except FluidactError as error:
                found.append(error)
    finally:
        table.FAST_FROM_BYTES = was
    quick, careful = found
    refused = [isinstance(f, FluidactError) for f in found]
    result = Result("both refuse" if all(refused) else "refused" if any(refused) else "both read")
    for what in differences(quick, careful):
        result.fail(DISAGREEMENT, what)
    result.message = "\n".join(str(f) for f in found if isinstance(f, FluidactError))
    return result


def differences(quick: Log | FluidactError, careful: Log | FluidactError) -> Iterator[str]:
    """Where two readings of one text differ."""
    if isinstance(quick, FluidactError) or isinstance(careful, FluidactError):
        if isinstance(quick, Log):
            yield "the quick reader reads what the careful one refuses"
        if isinstance(careful, Log):
            yield "the careful reader reads what the quick one refuses"
        return
    if not np.array_equal(quick.lines, careful.lines):
        yield f"rows: {quick.rows} quick, {careful.rows} careful"
        return
    for a, b in zip(quick.columns, careful.columns):
        other = ~((a.values == b.values) | (np.isnan(a.values) & np.isnan(b.values)))
        if other.any():
            row = int(np.argmax(other))
            text = {**a.bad, **b.bad}.get(row, "")
            yield f"value of a cell: {a.values[row]} quick, {b.values[row]} careful ({text[:20]!r})"
        elif dict(a.bad) != dict(b.bad):
            yield "text of bad cells"


def _write(case: Case, draft: Draft) -> None:
    case.tell("; ".join(draft.about))
    (case.folder / "log.csv").write_bytes(draft.encoded())


def _read(case: Case, draft: Draft) -> Result:
    _write(case, draft)
    try:
        log = read_log(case.folder / "log.csv")
    except FluidactError as error:
        result = Result("refused", message=str(error))
        if len(str(error)) > LONGEST:
            result.fail(WRONG, f"message of {len(str(error))} characters")
        if not error.remedy:
            result.fail(WRONG, f"no word on what to do: {error}")
        return result
    result = Result("read", message="\n".join(n.message for n in log.notices))
    for kind, what in judge(draft, log):
        result.fail(kind, what)
    return result


def judge(draft: Draft, log: Log) -> Iterator[tuple[str, str]]:
    """What is wrong with a reading of a draft: rows lost in silence, and wrong numbers."""
    lost, explained = losses(draft, log)
    if len(lost) > explained:
        shown = ", ".join(map(str, lost[:5]))
        yield LOSS, f"{len(lost) - explained} lines of data lost without a word (from {shown})"
    if log.lines.size and (log.lines.min() < 1 or log.lines.max() > len(draft.lines)):
        yield WRONG, "rows of lines that do not exist"
        return
    yield from _unbalanced(draft, log)
    if np.unique(log.lines).size != log.lines.size:
        yield WRONG, "a line is read twice"
    seen = set()
    for row, line in enumerate(log.lines.tolist()):
        what = _wrong_row(draft, log, row, line)
        if what and what[0] not in seen:
            seen.add(what[0])
            yield WRONG, f"{what[0]}: line {line}, {what[1]}"


def _unbalanced(draft: Draft, log: Log) -> Iterator[tuple[str, str]]:
    """What is wrong with the account: its parts make up the whole, and that is the file."""
    a = log.account
    parts = a.header_lines + a.data_rows + a.blank_lines + len(a.left_out)
    if parts != a.total_lines:
        yield WRONG, f"the account has {parts} lines in parts and {a.total_lines} in all"
    if a.data_rows != log.rows:
        yield WRONG, f"the account has {a.data_rows} rows where {log.rows} are read"
    filled = max((i + 1 for i, line in enumerate(draft.lines) if line.text.strip()), default=0)
    if not filled <= a.total_lines <= len(draft.lines) + 1:
        yield WRONG, f"the account has {a.total_lines} lines, the file {len(draft.lines)}"


def losses(draft: Draft, log: Log) -> tuple[list[int], int]:
    """Lines of data that are not among the rows, and how many of them were accounted for.

    A spoiled row above all others cannot be told from a preamble and does not count.
    """
    first = next((i for i, line in enumerate(draft.lines) if line.whole), len(draft.lines))
    due = [
        i + 1
        for i, line in enumerate(draft.lines)
        if i >= first and line.kind == "row" and line.text.strip()
    ]
    read = set(log.lines.tolist())
    lost = [line for line in due if line not in read]
    named = {line for line, _ in log.account.left_out}
    return lost, sum(line in named for line in lost)


def _wrong_row(draft: Draft, log: Log, row: int, line: int) -> tuple[str, str] | None:
    """What is wrong with one row: a class, and the case."""
    meant = draft.lines[line - 1]
    read = [float(c.values[row]) for c in log.columns]
    if meant.kind != "row":
        if meant.kind != "other" and all(map(math.isfinite, read)):
            return f"a line of the {meant.kind} is read as data", repr(meant.text[:60])
        return None
    if None not in meant.values and len(read) < len(meant.values):
        return "other columns", f"{len(read)} instead of {len(meant.values)}"
    for column, value, due in zip(log.columns, read, meant.values):
        if due is None or value == due:
            continue
        if not math.isnan(value):
            if math.isclose(value, due, rel_tol=1e-14):
                continue
            return "a number is read as another", f"{value} instead of {due}"
        if row not in column.bad and len(column.bad) < 1000:
            return "a number is lost without its text", f"{due}"
    return None


PARTS = (
    Part("recorded", "logs as recorded", 100, attack_recorded),
    Part("dialects", "whole logs in other dialects", 1000, attack_whole),
    Part("logs", "damaged logs", 10_000, attack_reader),
    Part("readers", "quick against careful reader", 4000, compare_readers),
)
