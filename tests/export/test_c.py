"""C for controllers: it compiles everywhere, and it computes what the model does."""

from __future__ import annotations

import ctypes
import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import fluidact_fit as ff
from fluidact_fit.export.c.files import Function
from fluidact_fit.export.c.fixed import Fixed, fixed
from fluidact_fit.export.rounding import CALLS
from fluidact_fit.routines import Machine, Routine

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__
FAMILIES = sorted(f.stem for f in GOLDEN.glob("*.yaml"))
STATIC = [f for f in FAMILIES if f not in ("line", "valve")]
ALL = [(f, "float32") for f in FAMILIES] + [(f, "q15") for f in STATIC]
SANITIZED = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
LOOSE = 10.0
Array = npt.NDArray[np.float64]


@pytest.mark.parametrize(("family", "arithmetic"), ALL)
def test_the_self_test_passes(family: str, arithmetic: str, as_c: Any) -> None:
    assert as_c(family, arithmetic).self_test("-O2") == 0


@pytest.mark.parametrize(("family", "arithmetic"), ALL)
def test_the_self_test_passes_under_sanitizers(family: str, arithmetic: str, as_c: Any) -> None:
    assert as_c(family, arithmetic).self_test(*SANITIZED) == 0


@pytest.mark.parametrize(("family", "arithmetic"), ALL)
def test_the_self_test_passes_on_an_avr(family: str, arithmetic: str, as_c: Any) -> None:
    assert "0!" in as_c(family, arithmetic).self_test_on_avr()


@pytest.mark.parametrize(
    ("family", "arithmetic", "constant", "wrong"),
    [
        ("potentiometer", "float32", r"(?<=PER_SPAN )0\.\d+(?=f)", 1.01),
        (
            "force-map",
            "float32",
            r"(?<=biases\[2\]\[5\] FORCE_MAP_TABLE = \{\n        \{)-?\d\.\d+",
            1.01,
        ),
        ("force-map", "q15", r"(?<=\* )\d{4,5}", 1.1),
        ("potentiometer", "q15", r"(?<=TABLE = \{\n        )\d+", 1.5),
        ("spring-cylinder", "q15", r"(?<=INT32_C\()\d{5,}", 1.01),
    ],
)
def test_a_corrupted_constant_fails_the_self_test(
    family: str, arithmetic: str, constant: str, wrong: float, as_c: Any
) -> None:
    made = as_c(family, arithmetic)
    source = made.file(".c").read_text()
    found = re.search(constant, source)
    assert found is not None
    number = float(found[0]) * wrong
    text = f"{number:.9g}" if "." in found[0] else f"{number:.0f}"
    made.file(".c").write_text(source[: found.start()] + text + source[found.end() :])
    try:
        assert made.self_test("-O2") != 0
    finally:
        made.file(".c").write_text(source)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_macros_hold_the_parameters(family: str, as_c: Any) -> None:
    made = as_c(family, "float32")
    names = {n: f"{made.name}_{n}".upper() for n in made.block.parameters}
    lists = {n: isinstance(v, list) for n, v in made.block.parameters.items()}
    kept = [
        f"    static const float {n}[] = {macro if lists[n] else f'{{{macro}}}'};"
        for n, macro in names.items()
    ]
    said = [f'    for (k = 0; k < sizeof {n} / 4; k++) printf("%a ", {n}[k]);' for n in names]
    made.file("_print.c").write_text("\n".join([
        f'#include "{made.name}.h"', "#include <stdio.h>", "int main(void)", "{", *kept,
        "    unsigned k;", *said, "    return 0;", "}", "",
    ]))  # fmt: skip
    program = made.compile(sources=(f"{made.name}_print.c",), to="print")
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    found = [float.fromhex(word) for word in printed.split()]
    due = np.concatenate([np.ravel(v) for v in made.block.parameters.values()])
    assert found == due.astype(np.float32).tolist()


# ------------------------------------------------------------------------------ arguments


@dataclass(frozen=True)
class Called:
    """A routine of an export with a function that calls its C for rows of arguments."""

    routine: Routine
    bound: float
    low: Array
    high: Array
    units: Array
    call: Callable[[Array], tuple[Array, npt.NDArray[np.int32]]]


def _driver(name: str, kind: str, count: int, state: str) -> str:
    given = ", ".join(f"in[{count} * k + {j}]" for j in range(count))
    reset = f"if (k % {CALLS} == 0) {name}_reset(&state);" if state else ""
    first = "&state, " if state else ""
    return (
        f"void run_{name}(int n, const {kind} *in, {kind} *out, int *outside);\n"
        f"void run_{name}(int n, const {kind} *in, {kind} *out, int *outside) {{\n"
        f"    int k;\n    {state}\n    for (k = 0; k < n; k++) {{ {reset}\n"
        f"        out[k] = {name}({first}{given}, &outside[k]); }}\n}}\n"
    )


def callables(made: Any) -> list[Called]:
    """Every routine of an export, compiled into a shared library."""
    single = made.arithmetic == "float32"
    kind, number = ("float", np.float32) if single else ("int16_t", np.int16)
    text, parts = f'#include "{made.name}.h"\n', []
    for r in made.block.routines():
        f = Function.of(r, made.name) if single else fixed(r, made.name)
        if not isinstance(f, Function | Fixed):
            continue
        name = f.writer.name if isinstance(f, Function) else f.name
        state = f"{name}_state state;" if r.keeps else ""
        text += _driver(name, kind, len(r.arguments), state)
        parts.append((f, name))
    made.file("_run.c").write_text(text)
    sources = (f"{made.name}.c", f"{made.name}_run.c")
    library = ctypes.CDLL(str(made.compile("-O2", "-shared", "-fPIC", sources=sources, to="l.so")))

    def caller(name: str, scale: float) -> Callable[[Array], tuple[Array, Any]]:
        def call(rows: Array) -> tuple[Array, Any]:
            given = np.ascontiguousarray(rows, dtype=number)
            out, outside = np.empty(len(rows), number), np.empty(len(rows), np.int32)
            pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (given, out, outside)]
            getattr(library, f"run_{name}")(len(rows), *pointers)
            return out.astype(float) * scale, outside

        return call

    found = []
    for f, name in parts:
        units = np.ones(len(f.routine.arguments))
        scale = 1.0
        if isinstance(f, Fixed):
            units, scale = 2.0 ** np.array(f.units), f.output.unit
        low = np.array([a.low for a in f.routine.arguments]) / units
        high = np.array([a.high for a in f.routine.arguments]) / units
        found.append(Called(f.routine, f.bound, low, high, units, caller(name, scale)))
    return found


def model(c: Called, rows: Array) -> tuple[Array, Array]:
    """Output and flag of the model in double precision; states begin anew now and then."""
    names = [a.name for a in c.routine.arguments]
    machine, values = Machine(c.routine), rows * c.units
    if not c.routine.keeps:
        y, outside = machine(**dict(zip(names, values.T)))
        return np.asarray(y), np.broadcast_to(outside, len(rows))
    out = []
    for k, row in enumerate(values):
        if k % CALLS == 0:
            machine.reset()
        out.append(machine(**dict(zip(names, row))))
    return np.array([float(y) for y, _ in out]), np.array([bool(o) for _, o in out])


@pytest.mark.parametrize(("family", "arithmetic"), ALL)
def test_the_bound_holds_and_is_not_absurd(family: str, arithmetic: str, as_c: Any) -> None:
    rng = np.random.default_rng(11)
    for c in callables(as_c(family, arithmetic)):
        count = 2000 if c.routine.keeps else 100_000
        rows = rng.uniform(c.low, c.high, (count, c.low.size))
        edge = rng.uniform(0.0, 1.0, rows.shape)
        rows = np.where(edge < 0.05, c.low, np.where(edge > 0.95, c.high, rows))
        rows = np.where((edge > 0.45) & (edge < 0.5), np.clip(0.0, c.low, c.high), rows)
        exact = rows.astype(np.float32).astype(float) if arithmetic == "float32" else rows.round()
        found, _ = c.call(exact)
        wanted, _ = model(c, exact)
        worst = np.abs(found - wanted).max()
        assert worst <= c.bound, c.routine.name
        if not c.routine.keeps and not Function.of(c.routine, "x").error.jump:
            assert c.bound <= LOOSE * worst, c.routine.name


@pytest.mark.parametrize(("family", "arithmetic"), ALL)
def test_what_lies_beyond_a_range_is_clamped_and_flagged(
    family: str, arithmetic: str, as_c: Any
) -> None:
    for c in callables(as_c(family, arithmetic)):
        if c.routine.keeps:
            continue
        middle = np.round(0.5 * (c.low + c.high))
        middle = np.where((middle < c.low) | (middle > c.high), c.low, middle)
        for k in range(c.low.size):
            ends, far = np.array([middle, middle]), np.array([middle, middle])
            ends[:, k] = c.low[k], c.high[k]
            far[:, k] = c.low[k] - 1.0 - abs(c.low[k]), c.high[k] + 1.0 + abs(c.high[k])
            if arithmetic == "q15":
                far = np.clip(far, -32768, 32767)
            beyond = (far[:, k] < c.low[k]) | (far[:, k] > c.high[k])
            at_ends, inside = c.call(ends)
            at_far, outside = c.call(far)
            assert at_far.tolist() == at_ends.tolist()
            assert np.all(outside[beyond] == 1)
            assert beyond.any()
            if not model(c, ends)[1].any():
                assert inside.tolist() == [0, 0]


@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_not_a_number_is_the_lower_end(family: str, as_c: Any) -> None:
    for c in callables(as_c(family, "float32")):
        nan = np.full((1, c.low.size), np.nan)
        found, outside = c.call(nan)
        assert found[0] == c.call(c.low[None, :])[0][0]
        assert outside[0] == 1
