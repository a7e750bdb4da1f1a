"""What the C exports cost on an ATmega328P at 16 MHz, and how far they are from the model.

    python studies/avr.py [--only FAMILY ...] [--write]

Every routine of the golden parameter files and of the force network of the pneumatic paper
(4 inputs, 7 hidden units), in single precision and in fixed point, is compiled with
``avr-gcc -O2`` (and ``-Os``) and run under simavr. Needs gcc, avr-gcc, avr-libc and simavr.
``--write`` writes ``docs/evidence/export-avr.md``.
"""

# ruff: noqa: T201 (it prints its results)
from __future__ import annotations

import argparse
import ctypes
import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

import fluidact_fit as ff
from fluidact_fit.errors import UsageError
from fluidact_fit.export.c import write
from fluidact_fit.export.c.files import Function
from fluidact_fit.export.c.fixed import Fixed, fixed
from fluidact_fit.export.c.fixed_golden import vectors_of
from fluidact_fit.export.golden import golden
from fluidact_fit.export.rounding import CALLS, single
from fluidact_fit.export.target import Arithmetic, Job
from fluidact_fit.routines import Machine, Routine

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "evidence" / "export-avr.md"
NETWORK = "force-network"
CLOCK = 16e6  # Hz
DRAWS = 20_000
_CHIP = ("avr-gcc", "-mmcu=atmega328p", "-std=gnu99", "-ffunction-sections",
         "-fdata-sections", "-Wl,--gc-sections")  # fmt: skip
_EXPLAINED = """\
# What the C exports cost on a small controller

Written by `studies/avr.py`: `export --to c` for the golden parameter files and for the force
network of the pneumatic paper (4 inputs, 7 hidden units, 1 output, fitted to
`datasets/force-map`), compiled with `avr-gcc -O2` for an ATmega328P and run under simavr.

- `cycles`: of one call, the worst over the golden vectors; `ms` at 16 MHz. `-Os`: cycles where it
  is compiled for size, as the Arduino tools do.
- `flash`: what linking the routine adds, with its tables and what it needs of the libraries.
- `RAM`: deepest stack under the call, with what is kept between calls.
- `bound`: largest error that the header states, in per cent of the range of the output; `found`:
  the largest one over random arguments. Where something is kept: over the first 1000 calls.
- What keeps something from call to call cannot be had in fixed point (`q15`). Where 16 bits are
  too few for a factor, as in the flows of the hydraulic cylinder whose roots cancel, factors have
  32: that takes this controller longer than `float32`.

| file | routine | arithmetic | cycles | ms | -Os | flash | RAM | bound | found |
|---|---|---|---|---|---|---|---|---|---|
"""
_MAIN = """
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include "{name}.h"

static const {kind} given[{rows}][{width}] PROGMEM = {{{vectors}}};
static volatile {kind} in[{width}];
static volatile {kind} sink;
static volatile int flag;
{state}
extern unsigned char __heap_start;

static void put(char c)
{{
    while (!(UCSR0A & (1 << UDRE0)));
    UDR0 = (unsigned char)c;
}}

static void put_number(unsigned long number)
{{
    signed char shift;
    for (shift = 28; shift >= 0; shift -= 4) put("0123456789abcdef"[(number >> shift) & 15]);
    put(' ');
}}

static unsigned long measure(void)
{{
    int outside;
    unsigned long cycles;
    TIFR1 = 1 << TOV1;
    TCNT1 = 0;
    {call}
    cycles = TCNT1;
    if (TIFR1 & (1 << TOV1)) cycles += 65536;
    flag = outside;
    return cycles;
}}

static unsigned deepest(void)
{{
    unsigned char *lowest = &__heap_start;
    while (*lowest == 0xa5) lowest++;
    return (unsigned)lowest;
}}

int main(void)
{{
    unsigned k, j;
    unsigned long worst = 0, cycles;
    unsigned char *place;
    UCSR0B = 1 << TXEN0;
    TCCR1B = 1 << CS10;
    {reset}
    for (k = 0; k < {rows}; k++) {{
        for (j = 0; j < {width}; j++) {{
            {kind} value;
            memcpy_P(&value, &given[k][j], sizeof value);
            in[j] = value;
        }}
        for (place = &__heap_start; place < (unsigned char *)SP; place++) *place = 0xa5;
        cycles = measure();
        if (cycles > worst) worst = cycles;
    }}
    put_number(worst);
    put_number((unsigned long)(SP - deepest()));
    put('\\n');
    put('\\n');
    cli();
    sleep_enable();
    sleep_cpu();
    return 0;
}}
"""


@dataclass(frozen=True)
class Called:
    """A routine in one arithmetic: its C name, golden vectors and bound."""

    file: str
    name: str
    routine: Routine
    arithmetic: Arithmetic
    function: str
    rows: Sequence[Sequence[float]]
    units: npt.NDArray[np.float64]
    unit: float
    bound: float

    @property
    def kind(self) -> str:
        """Type of arguments and output."""
        return "float" if self.arithmetic == "float32" else "int16_t"


def blocks(only: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """Every model with its name."""
    files = {f.stem: f for f in sorted((ROOT / "tests" / "golden" / ff.__version__).glob("*.yaml"))}
    files[NETWORK] = Path(__file__).with_name("force_network.yaml")
    for name, file in files.items():
        if only and name not in only:
            continue
        block: Any = ff.load(file, accept_not_identified=True)
        if getattr(block, "sample_time", 1.0) == 0.0:
            block = block.with_sample_time(0.01)
        yield name, block


def called(file: str, block: Any, arithmetic: Arithmetic) -> Iterator[Called]:
    """What a controller calls of a model."""
    name = file.replace("-", "_")
    for r in block.routines():
        one = np.ones(len(r.arguments))
        if arithmetic == "float32":
            f = Function.of(r, name)
            rows = golden(f.routine, lambda *_, f=f: f.error.rounding, single).arguments.tolist()
            yield Called(file, name, f.routine, arithmetic, f.writer.name, rows, one, 1.0, f.bound)
            continue
        q = fixed(r, name)
        if isinstance(q, Fixed):
            found = [row[:-2] for row in vectors_of(q)]
            units = 2.0 ** np.array(q.units)
            yield Called(file, name, q.routine, arithmetic, q.name, found, units, q.output.unit,
                         q.bound)  # fmt: skip


def _run(command: Sequence[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return done.stdout + done.stderr


def _flash(elf: str, folder: Path) -> int:
    text, data = _run(["avr-size", elf], folder).splitlines()[1].split()[:2]
    return int(text) + int(data)


def on_chip(c: Called, folder: Path, size: str) -> tuple[int, int, int]:
    """Cycles of the worst call, bytes of flash and of RAM, compiled with ``-O2`` or ``-Os``."""
    width = len(c.routine.arguments)
    first = "&state, " if c.routine.keeps else ""
    arguments = first + "".join(f"in[{j}], " for j in range(width))
    call = f"sink = {c.function}({arguments}&outside);"
    state = f"static {c.function}_state state;" if c.routine.keeps else ""
    number = "{:.9g}" if c.kind == "float" else "{:.0f}"
    vectors = ", ".join("{" + ", ".join(map(number.format, row)) + "}" for row in c.rows)
    values = {
        "name": c.name, "kind": c.kind, "rows": len(c.rows), "width": width, "vectors": vectors,
        "state": state, "reset": f"{c.function}_reset(&state);" if c.routine.keeps else "",
    }  # fmt: skip
    nothing = "outside = 0; " + " ".join(f"sink = in[{j}];" for j in range(width))
    for file, text in (("main.c", call), ("empty.c", nothing)):
        filled = {**values, "call": text}
        if file == "empty.c":
            filled |= {"state": "", "reset": ""}
        (folder / file).write_text(_MAIN.format(**filled))
    cycles, stack = [], []
    for main in ("main", "empty"):
        _run([*_CHIP, size, f"{main}.c", f"{c.name}.c", "-lm", "-o", f"{main}.elf"], folder)
        said = _run(["simavr", "-m", "atmega328p", "-f", "16000000", f"{main}.elf"], folder)
        words = re.search(r"([0-9a-f]{8}) ([0-9a-f]{8})", said)
        if words is None:
            raise SystemExit(f"{c.function}: nothing came from the simulator\n{said}")
        cycles.append(int(words[1], 16))
        stack.append(int(words[2], 16))
    flash = _flash("main.elf", folder) - _flash("empty.elf", folder)
    kept = sum(4 for _ in c.routine.states)
    kept += sum(4 * len(f.output) for f in c.routine.filters)
    kept += sum(
        4 * (f.delay + 1) * (f.delay > 0 or any(f.late)) + 2 * (f.delay > 0)
        for f in c.routine.filters
    )
    return cycles[0] - cycles[1], flash, stack[0] - stack[1] + kept


def here(c: Called, folder: Path) -> tuple[float, float]:
    """Largest error found on this machine, and range of the output [its unit]."""
    library = ctypes.CDLL(str(folder / f"{c.name}.so"))
    real: Any = ctypes.c_float if c.kind == "float" else ctypes.c_int16
    function = library[c.function]
    function.restype = real
    r, rng = c.routine, np.random.default_rng(7)
    low, high = np.array([[a.low, a.high] for a in r.arguments]).T / c.units
    rows = rng.uniform(low, high, (CALLS if r.keeps else DRAWS, low.size))
    rows = single(rows) if c.kind == "float" else rows.round()
    rows = np.clip(rows, low, high)
    first: list[Any] = []
    if r.keeps:
        first = [ctypes.create_string_buffer(4096)]
        library[f"{c.function}_reset"](*first)
    plain = float if c.kind == "float" else int
    found = np.array(
        [function(*first, *(real(plain(x)) for x in row), None) for row in rows.tolist()]
    )
    machine, names = Machine(r), [a.name for a in r.arguments]
    values = rows * c.units
    if r.keeps:
        wanted = np.array([float(machine(**dict(zip(names, row)))[0]) for row in values])
    else:
        wanted = np.asarray(machine(**dict(zip(names, values.T)))[0])
    return float(np.abs(found * c.unit - wanted).max()), float(np.ptp(wanted))


def main() -> None:
    """Measure and print, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--only", nargs="+", default=())
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    lines = []
    for file, block in blocks(given.only):
        for arithmetic in ("float32", "q15"):
            with TemporaryDirectory() as place:
                for line in table(file, block, arithmetic, Path(place)):
                    print(line, flush=True)
                    lines.append(line)
    if given.write:
        PAGE.write_text(_EXPLAINED + "\n".join(lines) + "\n", encoding="utf-8")


def table(file: str, block: Any, arithmetic: Arithmetic, folder: Path) -> Iterator[str]:
    """Lines of the table for one model in one arithmetic."""
    name = file.replace("-", "_")
    try:
        files = write(Job(name, block, arithmetic))
    except UsageError:
        return
    for part, content in files.items():
        (folder / part).write_bytes(content)
    _run(["gcc", "-O2", "-std=c99", "-shared", "-fPIC", f"{name}.c", "-lm", "-o", f"{name}.so"],
         folder)  # fmt: skip
    for c in called(file, block, arithmetic):
        cycles, flash, ram = on_chip(c, folder, "-O2")
        small, _, _ = on_chip(c, folder, "-Os")
        error, scale = here(c, folder)
        cells = [
            file, f"`{c.routine.name}`", arithmetic, f"{cycles:,}", f"{1e3 * cycles / CLOCK:.3f}",
            f"{small:,}", f"{flash:,}", str(ram), f"{100.0 * c.bound / scale:.2g} %",
            f"{100.0 * error / scale:.2g} %",
        ]  # fmt: skip
        yield "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
