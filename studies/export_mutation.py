"""Which changed constants the self-tests of exports find, and how tight the stated bounds are.

    python studies/export_mutation.py [--only NAME ...] [--scale SHARE] [--write]

Every constant of the C (float32 and q15) and of the Structured Text that `export` writes for the
golden parameter files and for one controller of each kind is made one per cent larger, one at a
time; the export is compiled (or interpreted) again and its self-test run. Not changed are 0, 1/2,
1 and 2 in expressions, which belong to equations (a mean, a half, "has begun"), sizes, indices and
shifts, and in fixed point powers of two, which are units. A whole number of which one per cent is
less than a half is below the resolution of its format; both are counted. A change that no self-test
finds has no effect where over 10^6 random arguments of every function, ends and edges among them,
no flag is another and no output is off by more than the stated bound, in fixed point by a bit.

The bounds that headers state are compared with the largest error of the compiled code over 10^6
random arguments, those of what keeps something in 1,000 sequences of 1,000 calls.

``--scale`` takes that share of the constants and of the random arguments; ``--write`` writes
`docs/evidence/export-mutation.md`. Needs gcc.
"""

# ruff: noqa: T201 (it prints its results)
from __future__ import annotations

import argparse
import ctypes
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

import fluidact_fit as ff
from fluidact_fit.errors import UsageError
from fluidact_fit.export import c, structured_text
from fluidact_fit.export.c.constants import macros_of
from fluidact_fit.export.c.files import Function
from fluidact_fit.export.c.fixed import Fixed, fixed
from fluidact_fit.export.controller import controller_code
from fluidact_fit.export.excitation import edges, edges_at_rest, run, sequences, uniform
from fluidact_fit.export.flat import code_of
from fluidact_fit.export.rounding import CALLS, both, single
from fluidact_fit.export.target import Arithmetic, Code, Job
from fluidact_fit.routines import Routine

ROOT = Path(__file__).parents[1]
GOLDEN = ROOT / "tests" / "golden" / ff.__version__
PAGE = ROOT / "docs" / "evidence" / "export-mutation.md"
DRAWS = 1_000_000
_HEAD = "format: fluidact-controller\nformat_version: 1\nsample_time: 0.01\n"
_FORCE = (
    "kind: feedforward-force\ncontroller: {smoothing_steps: 12, smoothing: held}\n"
    "machine: {position: 0.012}\nlimits: {low: 0.0, high: 3.0}\n"
)
CONTROLLERS = {
    "pd": (
        "kind: pd\ncontroller: {bandwidth: 6.0, damping_ratio: 0.9, friction: static,\n"
        "  velocity_tolerance: 2.0e-3}\nlimits: {low: -200.0, high: 200.0}\n",
        ["hydrostatic"],
    ),
    "impedance": (
        "kind: impedance\ncontroller: {stiffness: 800.0, damping_ratio: 1.0,\n"
        "  sum_of_pressures: 6.0e+5, friction: all, velocity_tolerance: 1.0e-3,\n"
        "  lowest_pressure: 1.0e+5, highest_pressure: 6.0e+5}\n"
        "machine: {mass: 0.5, area_1: 3.1e-4, area_2: 2.6e-4, atmosphere: 0.0,\n"
        "  travel_from: 0.0, travel_to: 0.02}\n",
        ["cylinder-friction", "valve", "line"],
    ),
    "force": (_FORCE, ["spring-cylinder", "valve"]),
}
# Numbers of C that are no sizes, indices or shifts
_FLOAT = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?f\b")
_FIXED = re.compile(
    r"(?:(?<=INT32_C\()|(?<=INT64_C\())\d+|(?<= )\d+(?=u\b)|(?<=_LOW \()-?\d+|(?<=_HIGH \()-?\d+"
)
_TABLE = re.compile(r"static const int(?:16|32)_t [^=]*= \{\n(.*?)\n *\};", re.DOTALL)
_REAL = re.compile(r"(?<![\w.\[])\d+\.\d+(?:E[-+]?\d+)?")
_COUNTED = ("killed", "survived", "no effect", "structural", "below resolution")
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None  # much is compiled
_GCC = ("gcc", "-std=c99", "-O0", "-w", "-pipe")
_STEPS = 200  # calls of a sequence in which an effect is looked for
_EXPLAINED = """\
# What self-tests find, and how tight the bounds are

Written by `studies/export_mutation.py`. Every constant of every export is made one per cent larger,
one at a time, and its self-test run again.

- `structural`: 0, 1/2, 1 and 2 in expressions, which belong to equations; in fixed point, powers
  of two, which are units and shifts. They are not changed.
- `below resolution`: whole numbers of which one per cent is less than a half: changed by one per
  cent they are the same number.
- `no effect`: no self-test can find the change, because over 10^6 random arguments of every
  function (ends of ranges and edges of comparisons among them; sequences of 200 calls of what keeps
  something) no flag is another and no output is off by more than the stated bound, in fixed point
  by a bit. They guard what the ranges of the arguments do not reach, or begin what a first call
  replaces; they are listed.
- Structured Text is run by the interpreter of the tests; the constants are those of the blocks. The
  global constants, which no block reads, stand beside them for code of your own.
- Bounds of what accumulates, such as the integrator of `hydrostatic`, cover a drive that never
  rests: two of the sequences that they are measured with hold all arguments at an end for all 1,000
  calls, where rounding adds up in one direction. Independent noise cancels, and comes nowhere near
  such a bound; a bound from noise would not hold on a machine that keeps moving.
- MATLAB, ROS 2 and JSON hold numbers alone: tests read them back to the last bit.

"""


@dataclass(frozen=True)
class Model:
    """What is exported: a parameter file or a controller."""

    name: str
    code: Code

    def in_(self, arithmetic: Arithmetic) -> Code:
        """The same in another arithmetic."""
        from dataclasses import replace

        return replace(self.code, arithmetic=arithmetic)


@dataclass
class Count:
    """How many constants came to what, and which survived."""

    times: Counter[str] = field(default_factory=Counter)
    survivors: list[str] = field(default_factory=list)
    equivalent: list[str] = field(default_factory=list)

    def row(self, name: str, kind: str) -> str:
        """A line of the table."""
        changed = self.times["killed"] + self.times["survived"]
        share = f"{100.0 * self.times['killed'] / changed:.1f} %" if changed else "-"
        cells = [name, kind, *(str(self.times[w]) for w in _COUNTED), share]
        return "| " + " | ".join(cells) + " |"


def load(name: str) -> Any:
    """A golden parameter file."""
    block: Any = ff.load(GOLDEN / f"{name}.yaml", accept_not_identified=True)
    if getattr(block, "sample_time", 1.0) == 0.0:
        block = block.with_sample_time(0.01)
    return block


def models(only: Sequence[str]) -> Iterator[Model]:
    """Everything that is exported."""
    for file in sorted(GOLDEN.glob("*.yaml")):
        if not only or file.stem in only:
            job = Job(file.stem.replace("-", "_"), load(file.stem))
            yield Model(file.stem, code_of(job))
    for kind, (text, names) in CONTROLLERS.items():
        if not only or kind in only:
            with TemporaryDirectory() as place:
                path = Path(place, f"{kind}.yaml")
                path.write_text(_HEAD + text, encoding="utf-8")
                yield Model(kind, controller_code(path, [load(n) for n in names]))


# ------------------------------------------------------------------------------- mutation


@dataclass(frozen=True)
class Place:
    """A constant in a file: where its text begins and ends, and whether it is in a table."""

    file: str
    start: int
    end: int
    text: str


def places_in(file: str, text: str, arithmetic: str) -> Iterator[Place]:
    """Every constant of a file of C."""
    code = re.sub(r"/\*.*?\*/", lambda m: " " * len(m[0]), text, flags=re.DOTALL)
    spans = {m.span() for m in _FLOAT.finditer(code)}
    if arithmetic == "q15" and file.endswith(".c"):
        spans |= {m.span() for m in _FIXED.finditer(code)}
        for table in _TABLE.finditer(code):
            at = table.start(1)
            spans |= {(at + m.start(), at + m.end()) for m in re.finditer(r"-?\d+", table[1])}
    for start, end in sorted(spans):
        yield Place(file, start, end, text[start:end])


def changed(place: Place) -> tuple[str, str]:
    """The constant one per cent larger, and what there is to say where it cannot be."""
    if place.text.endswith("f"):
        value = float(place.text[:-1])
        # a number that a macro names belongs to the machine, whatever it is
        if value in (0.0, 0.5, 1.0, 2.0):
            return "", "structural"
        return f"{np.float32(value * 1.01):.9e}f", ""
    number = int(place.text)
    if abs(number) & (abs(number) - 1) == 0:
        return "", "structural"
    other = round(number * 1.01)
    return ("", "below resolution") if other == number else (str(other), "")


def _run(command: Sequence[str], folder: Path) -> int:
    return subprocess.run(
        command, cwd=folder, capture_output=True, check=False, timeout=120
    ).returncode


def mutate_c(code: Code, share: float, rng: np.random.Generator) -> Count:
    """Change every constant of the source and the header."""
    count, effects = Count(), Effects(code, share)
    files = {name: text.decode() for name, text in c.write_code(code).items()}
    source, test = f"{code.file}.c", f"{code.file}_selftest.c"
    with TemporaryDirectory(dir=_MEMORY) as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text)
        assert _run([*_GCC, "-c", test, "-o", "test.o"], folder) == 0
        assert _run([*_GCC, source, "test.o", "-lm", "-o", "test"], folder) == 0
        assert _run(["./test"], folder) == 0, code.name
        places = [
            p for f in (source, f"{code.file}.h") for p in places_in(f, files[f], code.arithmetic)
        ]
        for place in places:
            if rng.uniform() > share:
                continue
            text, why = changed(place)
            if why:
                count.times[why] += 1
                continue
            whole = files[place.file]
            other = whole[: place.start] + text + whole[place.end :]
            (folder / place.file).write_text(other)
            header = place.file.endswith(".h")  # the test includes it too
            parts = [source, test if header else "test.o"]
            built = _run([*_GCC, *parts, "-lm", "-o", "test"], folder)
            if built != 0 or _run(["./test"], folder) != 0:
                count.times["killed"] += 1
            else:
                line = whole.splitlines()[whole[: place.start].count("\n")].strip()
                none = not effects.of({**files, place.file: other})
                count.times["no effect" if none else "survived"] += 1
                kept = count.equivalent if none else count.survivors
                kept.append(f"{place.file} ({code.arithmetic}): {line[:80]}")
            (folder / place.file).write_text(whole)
    return count


class Effects:
    """Outputs and flags of the functions of an export over many arguments."""

    def __init__(self, code: Code, share: float) -> None:
        self.code, self.share = code, share
        self._due: list[tuple[Routine, str, npt.NDArray[np.float64], float]] = []

    def _prepare(self) -> None:
        rng, count = np.random.default_rng(17), max(int(DRAWS * self.share), 1000)
        macros = macros_of(self.code)
        for r in self.code.routines:
            if self.code.arithmetic == "q15":
                f = fixed(r, self.code.name)
                if isinstance(f, Fixed):
                    rows = np.round(_many(f.routine, count, rng) / 2.0 ** np.array(f.units))
                    rows = np.clip(rows + rng.integers(-2, 3, rows.shape), -32768, 32767)
                    self._due.append((f.routine, f.name, rows, 0.0))
                continue
            g = Function.of(r, self.code.name, macros)
            rows = single(_many(g.routine, count, rng))
            self._due.append((g.routine, g.writer.name, rows, g.error.rounding))

    def of(self, files: dict[str, str]) -> bool:
        """Whether a changed export does anything else."""
        if not self._due:
            self._prepare()
            whole = {name: text.decode() for name, text in c.write_code(self.code).items()}
            self._outputs = [_compiled(self.code, r, x, whole, n) for r, n, x, _ in self._due]
        for (r, name, rows, allowed), (due, flags) in zip(self._due, self._outputs):
            found, others = _compiled(self.code, r, rows, files, name)
            with np.errstate(invalid="ignore"):
                off = ~(np.abs(found - due) <= allowed) & ~(np.isnan(found) & np.isnan(due))
            if np.any(off | (flags != others)):
                return True
        return False


def _many(r: Routine, count: int, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Arguments ``(calls, n, k)``, ends and edges among them."""
    some = uniform(r, 400, rng)
    near = np.concatenate([edges(r, some), edges_at_rest(r, some)])
    if r.keeps:
        return sequences(r, _STEPS, max(count // _STEPS, 4), rng, near)
    return np.concatenate([uniform(r, count, rng), near])[None]


def mutate_st(code: Code, share: float, rng: np.random.Generator) -> Count:
    """Change every constant of the function blocks; the interpreter of the tests runs them."""
    sys.path.insert(0, str(ROOT / "tests" / "export"))
    from st_interpreter import Instance
    from st_parser import Parser

    count = Count()
    ((_, content),) = structured_text.write_code(code).items()
    text = content.decode()
    start, stop = text.index("END_VAR\n\n"), text.rindex("FUNCTION_BLOCK FB_")
    plain = re.sub(r"\(\*.*?\*\)", lambda m: " " * len(m[0]), text, flags=re.DOTALL)
    test = f"FB_{code.name}_selftest"
    assert Instance(Parser(text), test)()["passed"]
    for found in _REAL.finditer(plain, start, stop):
        if rng.uniform() > share:
            continue
        value = float(found[0])
        if value in (0.0, 0.5, 1.0, 2.0):
            count.times["structural"] += 1
            continue
        number = repr(value * 1.01).upper()
        other = f"{text[: found.start()]}{number}{text[found.end() :]}"
        try:
            killed = not Instance(Parser(other), test)()["passed"]
        except (ValueError, ArithmeticError):
            killed = True
        count.times["killed" if killed else "survived"] += 1
        if not killed:
            line = text[: found.start()].count("\n")
            count.survivors.append(f"{code.file}.st: {text.splitlines()[line].strip()[:90]}")
    return count


# --------------------------------------------------------------------------------- bounds


def bounds(code: Code, share: float) -> Iterator[str]:
    """Lines of the table of bounds."""
    rng = np.random.default_rng(99)
    macros = macros_of(code)
    for r in code.routines:
        if code.arithmetic == "q15":
            f = fixed(r, code.name)
            if not isinstance(f, Fixed):
                continue
            routine, stated, jump = f.routine, f.bound, 0.0
        else:
            float_function = Function.of(r, code.name, macros)
            routine = float_function.routine
            stated, jump = float_function.error.rounding, float_function.error.jump
        worst = _worst(code, routine, share, rng)
        ratio = stated / worst if worst else float("inf")
        cells = [code.file, f"`{r.name}`", code.arithmetic, f"{stated:.2g}", f"{worst:.2g}",
                 f"{ratio:.1f}", f"{jump:.2g}" if jump else ""]  # fmt: skip
        yield "| " + " | ".join(cells) + " |"


def _worst(code: Code, r: Routine, share: float, rng: np.random.Generator) -> float:
    """Largest error of compiled code over random arguments, jumps taken alike."""
    count = max(int(DRAWS * share), 1000)
    if code.arithmetic == "q15":
        return _worst_fixed(code, r, count, rng)
    if r.keeps:
        rows = single(sequences(r, CALLS, max(count // CALLS, 4), rng, uniform(r, 8, rng)))
    else:
        low, high = np.array([[a.low, a.high] for a in r.arguments]).T
        rows = single(rng.uniform(low, high, (1, count, low.size)))
    exact, _, agree = both(r, rows)
    found, _ = _compiled(code, r, rows)
    off = np.abs(found - exact)[agree & np.isfinite(exact) & np.isfinite(found)]
    return float(off.max(initial=0.0))


def _worst_fixed(code: Code, r: Routine, count: int, rng: np.random.Generator) -> float:
    f = fixed(next(x for x in code.routines if x.name == r.name), code.name)
    assert isinstance(f, Fixed)
    low, high = np.array(f.ends).T
    rows = rng.integers(low, high + 1, (count, low.size))
    units = 2.0 ** np.array(f.units)
    exact, _ = run(f.routine, (rows * units)[None])
    found, _ = _compiled(code, r, rows[None].astype(float), name=f.name)
    return float(np.abs(found * f.output.unit - exact).max())


def _compiled(
    code: Code, r: Routine, rows: npt.NDArray[np.float64],
    files: Mapping[str, str] | None = None, name: str = "",
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int_]]:  # fmt: skip
    """Outputs and flags of the compiled function for sequences of calls, each after a reset."""
    name = name or f"{code.name}_{r.name}"
    kind, real = ("int16_t", np.int16) if code.arithmetic == "q15" else ("float", np.float32)
    calls, count, width = rows.shape
    state = f"    {name}_state state;\n" if r.keeps else ""
    reset = f"{name}_reset(&state);" if r.keeps else ""
    given = ", ".join(["&state"] * r.keeps + [f"in[{j}]" for j in range(width)] + ["flags++"])
    driver = (
        f'#include "{code.file}.h"\n'
        f"void drive(int n, int m, const {kind} *in, {kind} *out, int *flags)\n{{\n"
        f"{state}    for (int i = 0; i < n; i++) {{ {reset}\n"
        f"        for (int k = 0; k < m; k++, in += {width}) *out++ = {name}({given}); }}\n}}\n"
    )
    whole = files or {file: text.decode() for file, text in c.write_code(code).items()}
    with TemporaryDirectory(dir=_MEMORY) as place:
        folder = Path(place)
        for file, text in whole.items():
            (folder / file).write_text(text)
        (folder / "drive.c").write_text(driver)
        sources = [f"{code.file}.c", "drive.c"]
        command = ["gcc", "-std=c99", "-O1", "-w", "-shared", "-fPIC", *sources, "-lm"]
        assert _run([*command, "-o", "drive.so"], folder) == 0
        library = ctypes.CDLL(str(folder / "drive.so"))
        inputs = np.ascontiguousarray(rows.swapaxes(0, 1), dtype=real)
        outputs, flags = np.empty((count, calls), real), np.empty((count, calls), np.intc)
        pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (inputs, outputs, flags)]
        library.drive(count, calls, *pointers)
    return outputs.T.astype(float), flags.T


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--only", nargs="+", default=())
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    rng = np.random.default_rng(5)
    lines, table = [], []
    whole: dict[str, Count] = {}
    survivors, equivalent = [], []
    for model in models(given.only):
        for kind in ("float32", "q15", "st"):
            code = model.in_("q15" if kind == "q15" else "float32")
            try:
                if kind != "st":
                    table += list(bounds(code, given.scale))
                mutate = mutate_st if kind == "st" else mutate_c
                count = mutate(code, given.scale, rng)
            except UsageError:  # nothing of it in fixed point
                continue
            lines.append(count.row(model.name, kind))
            listed = [*count.survivors, *(f"no effect: {s}" for s in count.equivalent)]
            print(lines[-1], *(f"    {s}" for s in listed), sep="\n", flush=True)
            whole.setdefault(kind, Count()).times.update(count.times)
            survivors += count.survivors
            equivalent += count.equivalent
    lines += [count.row("all", kind) for kind, count in whole.items()]
    head = ["export", "constants in", *_COUNTED, "found"]
    parts = [_rows(head, lines), "\n## Constants whose change was not found\n"]
    parts += [f"- `{s}`" for s in survivors] or ["None."]
    parts += ["\n## Constants whose change has no effect\n"]
    parts += [f"- `{s}`" for s in equivalent] or ["None."]
    parts += ["\n## Bounds against errors found\n"]
    parts.append(
        _rows(["export", "routine", "arithmetic", "stated", "found", "ratio", "jump"], table)
    )
    text = "\n".join(parts)
    print(text)
    if given.write:
        taken = f"{100.0 * given.scale:.3g} %"
        share = f"Of the constants and of the random arguments {taken} were taken.\n"
        PAGE.write_text(_EXPLAINED + share + "\n" + text + "\n", encoding="utf-8")


def _rows(head: Sequence[str], lines: Sequence[str]) -> str:
    return "\n".join([f"| {' | '.join(head)} |", "|" + "---|" * len(head), *lines])


if __name__ == "__main__":
    main()
