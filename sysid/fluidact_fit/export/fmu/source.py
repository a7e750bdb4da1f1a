"""The C file of a unit: model and interface in one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.resources import files

from ..target import plain_text
from .model import Model, Unit, start_of, table

INTERFACE = ("fmi2_unit.h", "fmi2_variables.h", "fmi2_steps.h")


def library(name: str) -> str:
    """Text of a file of the library in C that stands beside this module."""
    return files(__package__).joinpath("c", name).read_text(encoding="ascii")


def source(unit: Unit, guid: str) -> str:
    """Return the C of a unit."""
    model = unit.model
    settings = [*model.parameters, *unit.constants]
    starts = [start_of(a) for a in model.inputs] + [s.value for s in settings]
    starts += [0.0] * len(model.outputs)
    least = [-sys.float_info.max] * len(model.inputs)
    least += [-sys.float_info.max if s.minimum is None else s.minimum for s in model.parameters]
    lines = [
        *comment([f"{unit.name}: {unit.about}.", *unit.remarks, "SI and double precision."]),
        '#include "fmi2_types.h"',
        "",
        "#include <math.h>",
        "",
        f'#define MODEL_GUID "{guid}"',
        f"#define MODEL_INPUTS {len(model.inputs)}",
        f"#define MODEL_SETTABLE {len(least)}",
        f"#define MODEL_OUTPUTS {len(model.inputs) + len(settings)}",
        f"#define MODEL_REALS {len(starts)}",
        f"#define MODEL_BOOLEANS {len(model.flags)}",
        "",
        table("model_values", starts),
        table("model_least", least),
        "",
        *model.constants,
        *(f'#include "{header}"' for header in model.headers),
        "",
        *model.functions,
        *_functions(model),
        *(f'#include "{header}"' for header in INTERFACE),
    ]
    return "\n".join(lines) + "\n"


def comment(lines: Sequence[str]) -> list[str]:
    """A block comment."""
    return ["/*", *(f" * {plain_text(line)}".rstrip() for line in lines), " */"]


def _functions(model: Model) -> list[str]:
    """Functions that the interface calls."""
    kept = model.memory or ["int nothing; /* C has no empty struct */"]
    problem = ["const char *problem;"] if any("problem" in s for s in model.advance) else []
    unused = "(void)memory, (void)reals, (void)booleans, (void)time, (void)span;"
    given = "double *reals, int *booleans"
    advance = [*problem, unused, *model.advance, "model_outputs(memory, reals, booleans);"]
    if any("model_outputs" in s for s in model.advance):
        advance.pop()
    return [
        "typedef struct {",
        *(f"    {line}" for line in kept),
        "} model_memory;",
        "",
        "static void model_begin(model_memory *memory, const double *reals)",
        *_body(["(void)memory, (void)reals;", *model.begin]),
        f"static void model_outputs(const model_memory *memory, {given})",
        *_body(["(void)memory;", *model.evaluate]),
        f"static const char *model_advance(model_memory *memory, {given}, double time,",
        "                                 double span)",
        *_body([*advance, "return NULL;"]),
    ]


def _body(lines: Sequence[str]) -> list[str]:
    return ["{", *(f"    {line}" for line in lines), "}", ""]
