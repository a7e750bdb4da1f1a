"""Structured Text: it parses, and its arithmetic is that of the routines it was written from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from st_interpreter import Instance
from st_parser import Parser, StructuredTextError, tokens

import fluidact_fit as ff
from fluidact_fit.export.excitation import run, sequences, uniform
from fluidact_fit.export.structured_text import write
from fluidact_fit.export.structured_text.blocks import FunctionBlock
from fluidact_fit.export.structured_text.words import Names, comment, literal
from fluidact_fit.export.target import Job
from fluidact_fit.routines import Argument, Machine, Routine, Solve, choose, exp, log, sqrt
from fluidact_fit.routines.expression import Name
from fluidact_fit.routines.routine import Draft, Filter, Let, as_matrix

GOLDEN = Path(__file__).parents[1] / "golden" / "0.1.0"
FAMILIES = sorted(p.stem for p in GOLDEN.glob("*.yaml"))
HOSTILE = "x'\" *) END_VAR\nFUNCTION_BLOCK evil (* {attribute} \t\u20ac // $N"


def block_of(family: str) -> Any:
    return ff.load(GOLDEN / f"{family}.yaml", accept_not_identified=True)


def exported(job: Job) -> str:
    ((name, content),) = write(job).items()
    assert name == f"{job.name}.st"
    return content.decode("ascii")


@pytest.fixture(scope="module")
def texts() -> Mapping[str, str]:
    return {f: exported(Job("rig_1", block_of(f))) for f in FAMILIES}


def compare(instance: Instance, routine: Routine, inputs: tuple[str, ...], count: int) -> None:
    """Run both over arguments of all kinds; the interpreter knows the text only."""
    rng = np.random.default_rng(count)
    rows = uniform(routine, count, rng)
    if routine.keeps:
        rows = sequences(routine, count, 1, rng, rows)[:, 0]
    far = np.array([3.0 * (a.high - a.low) for a in routine.arguments])
    rows[rng.integers(count, size=4)] += far
    rows[rng.integers(count, size=4)] -= far
    outputs, outside = (x[:, 0] for x in run(routine, rows[:, None]))
    found = []
    for k, row in enumerate(rows.tolist()):
        reset = {"reset": k == 0} if routine.keeps else {}
        out = instance(**dict(zip(inputs, row)), **reset)
        found.append(out["value"])
        assert out["outside"] == outside[k]
    spread = 1e-12 * np.ptp(outputs)
    np.testing.assert_allclose(found, outputs, rtol=0.0, atol=spread)


@pytest.mark.parametrize("family", FAMILIES)
def test_function_blocks_give_what_the_routines_give(family: str, texts: Mapping[str, str]) -> None:
    parser = Parser(texts[family])
    routines = block_of(family).routines()
    assert len(parser.blocks) == len(routines) + 1
    for r in routines:
        instance = Instance(parser, f"FB_rig_1_{r.name}")
        compare(instance, r, tuple(a.name for a in r.arguments), 200)
        compare(instance, r, tuple(a.name for a in r.arguments), 30)  # begins with a reset


@pytest.mark.parametrize("family", FAMILIES)
def test_self_test_passes_and_finds_a_wrong_digit(family: str, texts: Mapping[str, str]) -> None:
    text = texts[family]
    run = Instance(Parser(text), "FB_rig_1_selftest")
    assert run() == run() == {"passed": True, "failures": 0}
    head, sign, rest = text.partition("value := ")
    wrong = f"{head}{sign}0.001 * {rest}"
    assert Instance(Parser(wrong), "FB_rig_1_selftest")()["passed"] is False


@pytest.mark.parametrize("family", FAMILIES)
def test_constants_are_the_parameters(family: str, texts: Mapping[str, str]) -> None:
    block, found = block_of(family), Parser(texts[family]).constants
    assert [n.lower() for n in found] == list(block.parameters)
    for name, value in block.parameters.items():
        assert found[name.upper()].initial == np.ravel(value).tolist()
        assert tuple(high + 1 for _, high in found[name.upper()].ranges) == np.shape(value)
        unit = block.document.parameters[name].unit
        assert re.search(rf"\(\* \[{re.escape(unit)}\] [^*]*\*\)\s+{name} :", texts[family])


# Its parser takes from seconds to half a minute for a file: most are left to `make study`.
@pytest.mark.parametrize(
    "family",
    [f if f == "line" else pytest.param(f, marks=pytest.mark.slow) for f in FAMILIES],
)
def test_blark_parses_every_export(family: str, texts: Mapping[str, str]) -> None:
    parse = pytest.importorskip("blark.parse", reason="blark is not installed")
    result = parse.parse_source_code(texts[family])
    assert result.exception is None
    kinds = [str(part.data) for part in result.tree.children]
    routines = block_of(family).routines()
    assert kinds == [
        "global_var_declarations",
        *["function_block_type_declaration"] * (len(routines) + 1),
    ]


def test_header_says_what_it_is_and_what_was_accepted(texts: Mapping[str, str]) -> None:
    block = block_of("valve")
    header = exported(Job("rig", block, remarks=("Verdict FAIL was accepted.",))).split("*)")[0]
    for words in ("rig: valve", "Verdict of the fit: pass.", "Verdict FAIL was accepted.",
                  "command [V]", "1.04 to 6.81", "FB_rig_step [Pa]"):  # fmt: skip
        assert words in header
    assert "Call it every 0.01 s." in texts["valve"]


def damaged(value: Any) -> Any:
    """Every text of provenance and warnings, made hostile."""
    if isinstance(value, dict):
        return {k: damaged(v) for k, v in value.items()}
    if isinstance(value, list):
        return [damaged(v) for v in value]
    return HOSTILE if isinstance(value, str) else value


def test_texts_of_a_file_stay_texts(tmp_path: Path, texts: Mapping[str, str]) -> None:
    document = yaml.safe_load((GOLDEN / "valve.yaml").read_text(encoding="utf-8"))
    document["provenance"]["command"] = HOSTILE
    document["warnings"] = [{"code": "noise", "message": HOSTILE}]
    for entry in (*document["provenance"]["logs"], *document["fit"]["logs"]):
        entry["file"] = HOSTILE
    for entry in document["provenance"]["logs"]:
        for column in entry["columns"].values():
            column["header"] = HOSTILE
    document["fit"]["details"] = damaged(document["fit"]["details"])
    path = tmp_path / "valve.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    text = exported(Job("rig_1", ff.load(path), remarks=(HOSTILE, ")*) evil (*(", "*")))
    assert tokens(text) == tokens(texts["valve"])
    assert Instance(Parser(text), "FB_rig_1_selftest")()["passed"]


@pytest.mark.parametrize("name", ["END_VAR", "step", "a__b", "x_", "R", "rig_selftest"])
def test_name_of_the_job_gives_valid_identifiers(name: str) -> None:
    blocks = Parser(exported(Job(name, block_of("potentiometer")))).blocks
    assert len(blocks) == 3


def test_hostile_words_end_as_one_comment() -> None:
    for text in (HOSTILE, "*)", "**)", "(*)", "*", ")", "(" * 5 + "*" * 5 + ")" * 5, "\x00\x1b]0;"):
        assert tokens(comment(text)) == []
        assert comment(text).isprintable()


@pytest.mark.parametrize(
    "value",
    [0.0, -0.0, 1.0, 1e-7, -2.5e-300, 1e22, 123456789012345680.0, 1 / 3, 5e-324, 1.7e308],
)
def test_literals_read_back_to_the_last_bit(value: float) -> None:
    text = literal(value)
    kinds = [kind for kind, word in tokens(text) if word != "-"]
    assert kinds == ["real"]
    assert float(text).hex() == value.hex()


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_what_has_no_literal_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="no literal"):
        literal(value)


def test_identifiers_are_free_and_valid() -> None:
    names = Names()
    wanted = ["step", "Force", "force", "FORCE_1", "a__b", "x_", "2nd", "_", "LREAL"]
    found = [names.new(w) for w in wanted]
    assert found == [
        "step_1",
        "Force",
        "force_1",
        "FORCE_1_1",
        "a_b",
        "x",
        "x_2nd",
        "x_1",
        "LREAL_1",
    ]


# --------------------------------------------------------------------- routines made for the test


def run_draft(routine: Routine, count: int = 100) -> tuple[FunctionBlock, Instance]:
    block = FunctionBlock("FB_test", routine)
    parser = Parser("\n".join(block.lines()))
    instance = Instance(parser, "FB_test")
    compare(instance, routine, block.inputs, count)
    return block, instance


def argument(name: str, low: float = -2.0, high: float = 3.0) -> Argument:
    return Argument(name, "1", "made up", low, high)


@pytest.mark.parametrize("activation", ["relu", "tanh", "linear"])
def test_layers(activation: Any) -> None:
    rng = np.random.default_rng(3)
    draft = Draft("map", "", "1")
    x = [draft.argument(argument(n)) for n in "ab"]
    first = draft.layer("one", 3.0 * rng.normal(size=(4, 2)), rng.normal(size=4), x, activation)
    second = draft.layer("two", rng.normal(size=(3, 4)), rng.normal(size=3), first, activation)
    mixed = [second[2], second[0] * 2.0, choose(x[0], "<", 0.0, -1.0, 1.0)]
    third = draft.layer("three", rng.normal(size=(1, 3)), [40.0], mixed, "linear")
    run_draft(draft.returns(third[0] + second[1]))


def test_tanh_neither_overflows_nor_loses_its_sign() -> None:
    draft = Draft("map", "", "1")
    x = draft.argument(argument("a", -1e4, 1e4))
    _, instance = run_draft(draft.returns(draft.layer("one", [[1.0]], [0.0], [x], "tanh")[0]))
    for value in (-1e4, -0.5, -1e-12, 0.0, 1e-12, 0.5, 1e4):
        assert instance(a=value)["value"] == pytest.approx(np.tanh(value), abs=1e-16)


def test_order_of_operations_and_words_that_are_taken() -> None:
    draft = Draft("f", "", "1")
    a, b, i = (draft.argument(argument(n)) for n in ("step", "value", "i"))
    c = draft.let("k", a - (b - i) - -(a * -b) / (3.0 / (i + 7.0)) * (2.0 / 3.0))
    d = draft.let("reset", abs(-(c - 1.0)) + sqrt(abs(c)) - exp(-abs(c)) * log(4.0 + c * c))
    block, _ = run_draft(draft.returns(d - (c + (a - -2.0))))
    assert block.inputs == ("step_1", "value_1", "i")


def test_only_the_chosen_side_is_computed() -> None:
    draft = Draft("f", "", "1")
    a, b = draft.argument(argument("a")), draft.argument(argument("b"))
    inner = choose(
        b, ">=", 1.0, 1.0 / (b + 1.0), choose(b, "<=", choose(a, "<", 0.0, a, 0.5), b, a)
    )
    run_draft(draft.returns(1.0 + choose(a, ">", 0.0, log(abs(a) + 2.0), inner) * 2.0))
    shy = Draft("f", "", "1")  # LN(0) raises in the interpreter
    x = shy.argument(argument("x", 0.0, 1.0))
    block = FunctionBlock("FB_shy", shy.returns(choose(x, ">", 0.0, log(x), 0.0)))
    instance = Instance(Parser("\n".join(block.lines())), "FB_shy")
    assert instance(x=0.0)["value"] == 0.0
    assert instance(x=1.0)["value"] == 0.0


def test_search_by_halving_with_values_of_its_own() -> None:
    draft = Draft("f", "", "1")
    wanted = draft.argument(argument("wanted", -1.0, 9.0))
    outer = draft.let("half", wanted * 0.5)
    body = (Let("half", Name("x") * Name("x")), Let("more", Name("half") + Name("x")))
    for rising in (True, False):
        sign = 1.0 if rising else -1.0
        x = draft.solve(Solve("x", 0.0, 2.0, body, Name("more") * sign, wanted * sign, rising, 40))
        draft.let("seen", outer + x)
    _, instance = run_draft(draft.returns(Name("seen") + Name("half")))
    root = 0.5 * (np.sqrt(1.0 + 4.0 * 2.0) - 1.0)
    assert instance(wanted=2.0)["value"] == pytest.approx(root + 2.0, abs=1e-11)


def test_states_are_kept_until_a_reset_and_hidden_names_do_not_touch_them() -> None:
    draft = Draft("f", "", "1")
    x, total = draft.argument(argument("x")), draft.state("total", 0.25)
    draft.put(total, total + x)
    hidden = draft.let("total", total * 10.0)
    draft.flag(total, -1e9)
    draft.put(Name("total"), hidden / 10.0)
    routine = draft.returns(total)
    _, instance = run_draft(routine)
    assert instance(x=1.0, reset=True)["value"] == 1.25
    assert instance(x=1.0, reset=False)["value"] == 2.25
    assert instance(x=0.0, reset=True)["value"] == 0.25


@pytest.mark.parametrize("period", [0.1, 0.01, 0.0037, 0.00025])
def test_delays_of_whole_and_of_broken_samples(period: float) -> None:
    routine = block_of("line").with_sample_time(period).routines()[0]
    (law,) = routine.filters
    assert law.delay == int(0.0147 / period)
    run_draft(routine, 2 * law.delay + 40)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_difference_equation_with_every_term(delay: int) -> None:
    rng = np.random.default_rng(delay)
    draft = Draft("step", "", "1", 0.01)
    x = draft.argument(argument("u"))
    change = as_matrix(0.2 * rng.normal(size=(3, 3)) - np.eye(3))
    soon, late, output = (tuple(v) for v in rng.normal(size=(3, 3)).tolist())
    y = draft.filter(Filter("moved", change, soon, late, output, delay, x * 2.0, -1.7))
    run_draft(draft.returns(y + 1.0))


def test_what_lies_beyond_a_range_and_what_is_no_number_is_clamped_and_told() -> None:
    draft = Draft("f", "", "1")
    a, b = draft.argument(argument("a")), draft.argument(argument("b"))
    draft.flag(a + b, 0.0)
    routine = draft.returns(a * 2.0 + b)
    _, instance = run_draft(routine)
    machine = Machine(routine)
    for x, y in ((-9.0, 3.0), (9.0, 9.0), (np.nan, 3.0), (3.0, -2.0), (1.0, -1.5), (np.inf, 0.0)):
        value, outside = machine(a=x, b=y)
        assert instance(a=float(x), b=y) == {"value": float(value), "outside": bool(outside)}


@pytest.mark.parametrize(
    "body",
    ["value := 1;", "value := x[2];", "c := 2.0;", "value := y;", "IF x[0] THEN END_IF;",
     "IF i = 1 THEN END_IF", "step := 1.0;", "value := 1.0 + 1;", "value := SQRT(-1.0);",
     "i := i / 2;"],
)  # fmt: skip
def test_interpreter_objects_as_a_compiler_would(body: str) -> None:
    text = (
        "FUNCTION_BLOCK f VAR_OUTPUT value : LREAL; END_VAR VAR i : DINT; "
        "x : ARRAY[0..1] OF LREAL; END_VAR VAR CONSTANT c : LREAL := 1.0; END_VAR "
        f"{body} END_FUNCTION_BLOCK"
    )
    with pytest.raises((StructuredTextError, ValueError)):
        Instance(Parser(text), "f")()
