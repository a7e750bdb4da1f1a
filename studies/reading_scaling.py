# ruff: noqa: T201, E501 (it prints its table; a piece of text is a line)
"""How the time of reading grows with the size of a text that is made to defeat the reader.

    python studies/reading_scaling.py [--write] [--only TEXT] [--every N] [--jobs N]

Every reader of text (logs, headers and units, stamps, YAML, controller headers, lists of keys and
of jobs) gets frames in which one repeated piece stands where a line, a cell, a name, a comment or a
text in quotes may stand. Sizes grow from 10^3 to 10^6 characters until the time of the processor
can be measured. The exponent is that of the upper sizes: 1 is a time in proportion to the text.
One above ``BOUND`` is timed twice more, as far as the limit on the time allows, and fails the study
if it stays there. Each pattern runs in a process of its own, which a limit ends. ``--write`` writes ``docs/evidence/reading-scaling.md``.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from fluidact_fit.batch.jobs import read_jobs
from fluidact_fit.consumer import read_consumer
from fluidact_fit.control.controller_file import read_controller_file
from fluidact_fit.control.loading import read_document
from fluidact_fit.errors import FluidactError, in_python, visible
from fluidact_fit.logs import describe, read_log
from fluidact_fit.logs.exclusions import find_in_name, parse_constant, parse_exclusion
from fluidact_fit.logs.stamps import read_stamp
from fluidact_fit.units import is_unit, looks_like_unit, normalise_unit, parse_unit_from_header

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "reading-scaling.md"
GOLDEN = ROOT / "tests" / "golden" / "0.1.0"
BOUND = 1.2  # exponent
SIZES = tuple(round(10 ** (3 + k / 2)) for k in range(7))
LIMIT = 5.0  # s of the processor for one size
_STEP = math.sqrt(10.0)  # from one size to the next
_ENOUGH = 0.2  # s; a size of which more is to be expected is not tried
_SURELY = 2.0  # s; the same, where a pattern seems to grow too fast
_MEASURABLE = 0.1  # s; shorter ones tell the state of the machine
_TOGETHER = 100  # patterns that one process times
# What an error that is none of the program's own ends a process with.
_NAMES = ("", "error", "ValueError", "TypeError", "IndexError", "KeyError", "RecursionError",
          "MemoryError", "AttributeError", "OverflowError", "AssertionError")  # fmt: skip
_LEAST = 0.02  # s, of a time that counts for the exponent

SIGNS = " \t\f\v\r\"'`,;:.|+-*/\\^_=<>()[]{}#%&!?@~$§°µ0aeEN1\x1f\u00a0\u2028é"
PAIRS = (
    "a ", " a", "1 ", "1,", ",1", "1.", ".1", "1;", ";1", "1e", "e1", "1:", ":1", "1-", "-1", "1/",
    "1|", "a(", "(a", "a[", "[a", "{a", "a{", "a)", "()", "[]", "{}", ")(", "](", "([", "a/", "a*",
    "a^", "a.", "a,", "a;", "a=", "=1", "a:", ": ", "- ", "-- ", "--a", "--a=", "---", "...", "//",
    "/*", "*/", "/**/", "\\\\", '\\"', '""', '"a', "a\"", '","', '";"', "'a'", ", ", "; ", " / ", " in ",
    "%a", "% of 1 ", "a in b ", "kg.m2/", "(a.", "1,000", "1 000 ", "1'000'", "12:30:00 ", "2020-01-01 ",
    "#define a ", "float a", "float a,", "const ", "double ", "a,b(", "<a", "int<", "std::array<", "a_",
    "__attribute__((", ".a=", "{.a=1,", "[1]", "[1][", "&a ", "*a ", "!a ", "|a", ">a", "? ", "a#",
)  # fmt: skip
LINES = (
    "\n", "\r\n", "\r", "\n\n", "a\n", "1\n", "1;2\n", "1,2\n", "a;b\n", "#a\n", "# a: b\n", "%\n",
    '"\n', "//a\n", "/*\n", "/* a */\n", "// a [\n", "a: 1\n", "- a\n", "%TAG ! a:\n", "%YAML 1.2\n",
    "---\n", "...\n", "a [b]\n", "#define a 1\n", "float a;\n", "float a = 1; // b\n", "  \n", " a\n",
    "{\n", "}\n", "){\n", "\\\n", ";\n", "a,b,c\n", "a.csv\n", "=1\n", "\t\n", "? a\n", "'\n", "*a\n",
)  # fmt: skip


_PAGE = """\
# Time of reading against the size of a text

Written by `studies/reading_scaling.py --write`, a part of `make soak`. Every reader of text gets
frames in which one piece is repeated where a line, a cell, a name, a comment or a text in quotes may
stand (`@` is where). The text grows by half decades from 10^3 characters to {largest}, or to the size
of which the next would take more than {enough} s in proportion. The exponent is the slope of the
processor time over the last decade of sizes; a pattern can be measured where the largest takes {least}
s. One above {bound} is timed twice more, in processes of its own, up to sizes that take {surely} s and
three times each: the shortest times count.

{patterns} patterns{part}, {whole} of them up to {largest} characters and {tenth} up to a tenth or more:
{measured} can be measured, {bad} grow faster than {bound}. ({seconds} s of the processor, beside other
work.) The largest exponents:

{table}
"""


class Pattern(NamedTuple):
    """A reader, the frame of the text, and the piece that is repeated in it."""

    reader: str
    frame: str
    piece: str

    @property
    def name(self) -> str:
        frame = self.frame if len(self.frame) < 60 else self.frame[:28] + "…" + self.frame[-28:]
        return f"{self.reader} | {frame!r} | {self.piece!r}"


class Timing(NamedTuple):
    """Sizes of a pattern and the seconds of the processor that each took."""

    pattern: Pattern
    sizes: tuple[int, ...]
    seconds: tuple[float, ...]
    ended: str

    @property
    def measured(self) -> bool:
        return bool(self.ended) or (bool(self.seconds) and self.seconds[-1] >= _MEASURABLE)

    @property
    def exponent(self) -> float:
        """Slope over the last decade of sizes, infinite where a limit ended the process."""
        if self.ended:
            return math.inf
        pairs = [(n, s) for n, s in zip(self.sizes, self.seconds) if s >= _LEAST][-3:]
        if len(pairs) < 2:
            return 0.0
        (n, s), (m, r) = pairs[0], pairs[-1]
        return math.log(r / s) / math.log(m / n)


def _of_file(suffix: str, read: Callable[[str], object]) -> Callable[[str], object]:
    def call(text: str) -> object:
        with tempfile.NamedTemporaryFile("w", suffix=suffix, newline="", encoding="utf-8",
                                         dir=_scratch()) as file:  # fmt: skip
            file.write(text)
            file.flush()
            return read(file.name)

    return call


def _scratch() -> str | None:
    return "/dev/shm" if os.path.isdir("/dev/shm") else None


def _described(path: str) -> object:
    return describe(read_log(path))


READERS: dict[str, Callable[[str], object]] = {
    "log": _of_file(".csv", _described),
    "header": parse_unit_from_header,
    "unit": lambda text: (is_unit(text), looks_like_unit(text), normalise_unit(text)),
    "stamp": read_stamp,
    "constant": lambda text: parse_constant("a", text),
    "exclusion": parse_exclusion,
    "name of a log": lambda text: find_in_name("a", "a{mm}b", text),
    "message": lambda text: in_python(visible(text)),
    "parameter file": _of_file(".yaml", read_document),
    "controller file": _of_file(".yaml", read_controller_file),
    "jobs.csv": _of_file(".csv", read_jobs),
    "jobs.yaml": _of_file(".yaml", read_jobs),
    "header of a controller": _of_file(".h", read_consumer),
    "list of keys": _of_file(".txt", read_consumer),
    "declaration": _of_file(".yaml", read_consumer),
}

_ROWS = "".join(f"{k};{k / 7:.4f}\n" for k in range(60))
_HALF = _ROWS.replace(";", ",")
_TEXTS = ("@", "a @", "@ a", "1@", "(@", "a [@", '"@', "a (@)")
FRAMES: dict[str, Sequence[str]] = {
    "log": (
        "@", f"@\n{_ROWS}", f"time;x @\n{_ROWS}", f"time;x (@\n{_ROWS}", f"time;x\ns;@\n{_ROWS}",
        f"time;x\n{_ROWS}@\n{_ROWS}", f"time;x\n{_ROWS}1;@\n{_ROWS}", f'time;x\n{_ROWS}1;"@\n{_ROWS}',
        f"time;x\n{_ROWS}@", f'"@\ntime;x\n{_ROWS}', f"time,x\n{_HALF}1,@\n{_HALF}", f'"@"\n{_HALF}',
    ),
    "parameter file": ("@", "a: @", "a: {@", 'a: "@', "a: [@", "a: |\n  @", "@" + "GOOD", "GOOD" + "@"),
    "controller file": ("@", "a: @", 'a: "@'),
    "jobs.csv": ("@", "job,family,logs\n@", "job,family,logs\na,line,@", 'job,family,logs\na,line,"@',
                 "job,family,logs,options\na,line,a.csv,@"),
    "jobs.yaml": ("@", "- {job: a, family: line, logs: a.csv, options: @", '- job: "@', "- @"),
    "header of a controller": (
        "@", "/* @", "// @", "#define a @", "float a = @", "float a[] = {@", "float @", "const @",
        "float a = 1; // [@", "struct a {@", "void a() {@", 'char a[] = "@',
    ),
    "list of keys": ("@", "a [@", "a,@", "a @"),
    "declaration": ("@", "a: @", 'a: {b: {type: double, description: "[@"}}'),
}  # fmt: skip


def patterns(only: str = "") -> Iterator[Pattern]:
    """Yield every reader with every frame and piece."""
    for reader in READERS:
        lined = reader in FRAMES
        for frame in FRAMES.get(reader, _TEXTS):
            for piece in dict.fromkeys((*SIGNS, *PAIRS, *(LINES if lined else ()))):
                pattern = Pattern(reader, frame, piece)
                if only in pattern.name:
                    yield pattern


def text_of(pattern: Pattern, size: int) -> str:
    """Return the text of a pattern with about ``size`` characters of its piece."""
    frame = pattern.frame
    if "GOOD" in frame:
        frame = frame.replace("GOOD", (GOLDEN / "line.yaml").read_text(encoding="utf-8"))
    before, _, behind = frame.partition("@")
    count = max(1, size // len(pattern.piece))
    return f"{before}{pattern.piece * count}{behind}"


def measure(
    patterns: Sequence[Pattern], largest: int = SIZES[-1], enough: float = _ENOUGH
) -> Iterator[Timing]:
    """Time patterns in a process of its own, in another one after each that a limit ended."""
    left = list(patterns)
    while left:
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            try:
                _time_all(left, writing, [n for n in SIZES if n <= largest], enough)
                os._exit(0)
            finally:
                os._exit(1)  # nothing of the parent may go on here
        os.close(writing)
        taken: dict[int, float] = {}
        with os.fdopen(reading, encoding="ascii") as pipe:
            for what, number in map(str.split, pipe):
                if what != "done":
                    taken[int(what)] = float(number)
                    continue
                yield Timing(left.pop(0), *_sorted(taken), "")
                taken = {}
        _, status = os.waitpid(child, 0)
        if status:
            ended = signal.Signals(status & 127).name if status & 127 else _NAMES[status >> 8]
            yield Timing(left.pop(0), *_sorted(taken), f"ended by {ended}")


def _sorted(taken: dict[int, float]) -> tuple[tuple[int, ...], tuple[float, ...]]:
    sizes = tuple(sorted(taken))
    return sizes, tuple(taken[n] for n in sizes)


def _time_all(patterns: Sequence[Pattern], out: int, sizes: Sequence[int], enough: float) -> None:
    """Write size and seconds of every size of every pattern; runs in the child."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, 2)
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    for pattern in patterns:
        _time_sizes(pattern, out, sizes, enough)
        os.write(out, b"done 0\n")


def _time_sizes(pattern: Pattern, out: int, sizes: Sequence[int], enough: float) -> None:
    """Find the largest size that takes long enough, and time it and the decade below it."""
    taken: dict[int, float] = {}

    def take(k: int) -> float:
        if k not in taken:
            tries = 3 if enough > _ENOUGH else 1
            taken[k] = min(_time(pattern, sizes[k]) for _ in range(tries))
            os.write(out, f"{sizes[k]} {taken[k]:.6f}\n".encode())
        return taken[k]

    k, most = 0, len(sizes) - 1
    while k < most and take(k) * _STEP < enough:
        # as far as a time in proportion allows, so that few sizes are timed
        k = min(most, k + max(1, int(math.log(enough / max(take(k), 1e-6), _STEP))))
    take(k)
    for below in range(k - 1, max(k - 3, -1), -1):
        if taken[below + 1] < _LEAST:
            break
        take(below)


def _time(pattern: Pattern, size: int) -> float:
    text = text_of(pattern, size)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    start = time.process_time()
    try:
        READERS[pattern.reader](text)
    except FluidactError:
        pass
    except Exception as error:
        if not isinstance(error, ValueError) or pattern.reader in FRAMES:
            os._exit(_NAMES.index(type(error).__name__) if type(error).__name__ in _NAMES else 1)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return time.process_time() - start


def measure_again(patterns: Sequence[Pattern], largest: int) -> list[Timing]:
    """Time patterns; where one seems to grow too fast, as far as it takes to be sure."""
    found = []
    for timing in measure(patterns, largest):
        for _ in range(2):
            if not timing.measured or timing.exponent <= BOUND:
                break
            (again,) = measure([timing.pattern], largest, _SURELY)
            timing = again if again.ended or again.exponent <= timing.exponent else timing
        found.append(timing)
    return found


def table(timings: Sequence[Timing], most: int = 30) -> str:
    """Return the slowest growth and the slowest texts as Markdown."""
    lines = [
        "| reader | frame | repeated | largest size | seconds | exponent |",
        "|---|---|---|---|---|---|",
    ]
    for t in timings[:most]:
        frame = t.pattern.frame if len(t.pattern.frame) < 40 else t.pattern.frame[:12] + "…"
        cells = [t.pattern.reader, _code(frame), _code(t.pattern.piece),
                 f"{t.sizes[-1]:,}" if t.sizes else "", f"{t.seconds[-1]:.2f}" if t.seconds else "",
                 t.ended or f"{t.exponent:.2f}"]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _code(text: str) -> str:
    return "`" + repr(text)[1:-1].replace("|", "&#124;").replace("`", "'") + "`"


def _up_to(timings: Sequence[Timing], size: float) -> int:
    return sum(t.sizes[-1] >= size for t in timings if t.sizes)


def main() -> int:
    """Return 1 where a pattern grows faster than the bound."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", default="", help="patterns whose name holds this text")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--every", type=int, default=1, help="run every Nth pattern only")
    parser.add_argument("--largest", type=int, default=SIZES[-1], help="characters")
    given = parser.parse_args()
    chosen = list(patterns(given.only))[:: given.every]
    parts = [chosen[k : k + _TOGETHER] for k in range(0, len(chosen), _TOGETHER)]
    timings: list[Timing] = []
    # processes, since a thread that forks leaves the locks of the others locked in its child
    with get_context("fork").Pool(given.jobs) as pool:
        for found in pool.imap(partial(measure_again, largest=given.largest), parts):
            timings += found
            for t in found:
                if t.measured and t.exponent > BOUND:
                    print(t.pattern.name, t.ended or f"{t.exponent:.2f}", t.sizes, t.seconds,
                          file=sys.stderr, flush=True)  # fmt: skip
    known = [t for t in timings if t.measured]
    bad = [t for t in known if t.exponent > BOUND]
    known.sort(key=lambda t: (-t.exponent, -max(t.seconds, default=0.0)))
    part = "" if given.every == 1 else f", every {given.every}th of all"
    seconds = sum(os.times()[:4])
    text = _PAGE.format(
        patterns=len(timings), part=part, measured=len(known), bad=len(bad), bound=BOUND,
        enough=_ENOUGH, surely=_SURELY, least=_MEASURABLE, largest=f"{given.largest:,}", table=table(known),
        whole=_up_to(timings, given.largest), tenth=_up_to(timings, given.largest / 10.0),
        seconds=f"{seconds:.0f}",
    )  # fmt: skip
    print(text)
    if given.write:
        PAGE.write_text(text, encoding="utf-8")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
