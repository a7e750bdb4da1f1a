"""Fixed point: what can be had in it, its tables, and its errors against full scale."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.errors import UsageError
from fluidact_fit.export.c import write
from fluidact_fit.export.c.fixed import WANTED, Fixed, Omitted, fixed
from fluidact_fit.export.c.fixed_table import exponent_for, tabulate
from fluidact_fit.export.target import Job
from fluidact_fit.routines import Argument, Draft, Routine, choose, exp, log, sqrt

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__
FAMILIES = sorted(f.stem for f in GOLDEN.glob("*.yaml"))


def load(family: str) -> Any:
    block: Any = ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)
    return block.with_sample_time(0.01) if getattr(block, "sample_time", 1.0) == 0.0 else block


@pytest.mark.parametrize("family", FAMILIES)
def test_every_static_routine_is_within_a_tenth_of_a_per_cent(family: str) -> None:
    for routine in load(family).routines():
        found = fixed(routine, "x")
        assert isinstance(found, Omitted) == routine.keeps
        if isinstance(found, Fixed):
            assert 0.0 < found.bound <= WANTED * found.scale, routine.name


@pytest.mark.parametrize("family", ["line", "valve"])
def test_a_file_of_nothing_but_difference_equations_is_refused(family: str) -> None:
    with pytest.raises(UsageError, match="step, because it keeps something from call to call") as e:
        write(Job("x", load(family), "q15"))
    assert e.value.exit_status == 2
    assert "float32" in str(e.value)


def test_the_header_says_what_was_left_out_and_what_the_integers_mean() -> None:
    files = write(Job("dead", load("hydrostatic"), "q15"))
    header = files["dead.h"].decode()
    assert "Left out: step, because it keeps something from call to call." in header
    assert "dead_dead_zone_inverse_q15(int16_t wanted, int16_t steepness" in header
    assert "dead_step" not in header.replace("Left out: step", "")
    bound = re.search(r"by at most (\S+), (\S+) % of", header)
    assert bound is not None
    found = fixed(load("hydrostatic").routines()[1], "x")
    assert isinstance(found, Fixed)
    assert found.bound <= float(bound[1]) < 1.1 * found.bound
    assert float(bound[2]) < 0.1


def draft(low: float = -1.0, high: float = 1.0) -> tuple[Draft, Any, Any]:
    d = Draft("f", "A function.", "1")
    x = d.argument(Argument("x", "1", "first", low, high))
    return d, x, d.argument(Argument("y", "1", "second", low, high))


def test_what_has_no_bound_within_a_per_cent_is_left_out_with_the_figure() -> None:
    d, x, y = draft()
    jump = choose(x * y, ">", 0.3, 1.0, 0.0)  # where x y is rounded the other side may be taken
    found = fixed(d.returns(jump), "x")
    assert isinstance(found, Omitted)
    assert re.fullmatch(r"its error could be [\d.e+]+ % of full scale", found.why)
    d, x, y = draft()
    found = fixed(d.returns(1.0 / (abs(x - y) + 1e-12)), "x")
    assert isinstance(found, Omitted)
    assert "divisor" in found.why


def test_cancellation_takes_wider_factors() -> None:
    d, x, y = draft(1.0, 3000.0)
    narrow = fixed(d.returns(x + y), "x")
    d, x, y = draft(1.0, 3000.0)
    wide = fixed(d.returns(sqrt(x * x + y) - x), "x")
    assert isinstance(narrow, Fixed)
    assert isinstance(wide, Fixed)
    assert (narrow.code.width.bits, wide.code.width.bits) == (15, 31)
    assert wide.bound < WANTED * wide.scale


@pytest.mark.parametrize("span", [1, 2, 3, 255, 256, 257, 4095, 4096, 65535])
def test_a_table_follows_a_curve_over_every_length(span: int) -> None:
    u = np.arange(span + 1) / max(span, 1)
    values = np.sin(3.0 * u) + 0.2 * u
    table = tabulate(-span // 2, values, set())
    assert table.error <= 2.0**-11 * np.ptp(values)
    assert sum(p.cells + 1 for p in table.pieces) == len(table.entries) <= 257
    assert max(map(abs, table.entries)) <= 32767


def test_a_jump_splits_a_table_and_leaves_no_error() -> None:
    d = Draft("f", "A jump and a corner.", "1")
    x = d.argument(Argument("x", "1", "place", -1.0, 1.0))
    value = choose(x, ">", 0.0, 1.0 + 0.5 * x, choose(x, "<", 0.0, -2.0 + 0.25 * x, 0.0))
    found = fixed(d.returns(value), "x")
    assert isinstance(found, Fixed)
    assert found.bound <= 1.5 * found.output.unit
    ((entries),) = found.code.tables
    assert len(entries) == 5  # two straight lines and one value between them


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("relation", ["<", "<=", ">", ">="])
def test_a_comparison_of_an_argument_with_a_number_is_exact(
    relation: Any, turned: bool, compiled: Any
) -> None:
    d, x, y = draft()
    level = 0.25 if relation in ("<", ">=") else 1.0 / 3.0  # on a mantissa, and between two
    sides = (level, relation, x) if turned else (x, relation, level)
    found = compiled(d.returns(choose(*sides, y, 1.0 - 0.5 * y)))
    assert found.bound <= 1.5 * found.output.unit


@pytest.mark.parametrize("reach", [1.0, 0.99999, 32767.0, 32767.4, 32767.6, 1e-9, 3e12])
def test_an_exponent_is_the_smallest_that_holds(reach: float) -> None:
    e = exponent_for(reach)
    assert round(reach / 2.0**e) <= 32767 < round(reach / 2.0 ** (e - 1))


def network(activation: Any) -> Routine:
    rng = np.random.default_rng(3)
    d, x, y = draft()
    hidden = d.layer("first", rng.normal(size=(6, 2)), rng.normal(size=6), (x, y), activation)
    last = d.layer("last", rng.normal(size=(1, 6)), [0.3], hidden, "linear")
    return d.returns(last[0])


@pytest.mark.parametrize("kind", ["tanh", "relu", "linear"])
def test_networks_of_every_activation_run(kind: str, compiled: Any) -> None:
    found = compiled(network(kind))
    assert found.bound < WANTED * found.scale


def test_functions_of_two_arguments_run(compiled: Any) -> None:
    d, x, y = draft(0.5, 4.0)
    one = exp(-(x * y)) / (x + 1.0) + sqrt(x * x + y * y) * abs(x - y) + log(x + y)
    found = compiled(d.returns(one))
    assert found.bound < WANTED * found.scale
