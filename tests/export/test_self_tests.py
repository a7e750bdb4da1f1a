"""What the self-tests of exports find, what their headers state, and how their code reads."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fluidact_fit as ff
from fluidact_fit.control.loading import make_block, read_document
from fluidact_fit.export import excitation, export
from fluidact_fit.export.c import write, write_code
from fluidact_fit.export.c.constants import macros_of
from fluidact_fit.export.c.files import Function
from fluidact_fit.export.controller import controller_code
from fluidact_fit.export.golden import golden
from fluidact_fit.export.mutants import mutants_of
from fluidact_fit.export.rounding import difference, error_of, inward, robust, single
from fluidact_fit.export.target import Code, Entry, Job
from fluidact_fit.families.potentiometer.block import routines_of as potentiometer_routines
from fluidact_fit.families.potentiometer.calibration import Calibration
from fluidact_fit.parameters.draws import with_values
from fluidact_fit.routines import (
    Draft,
    Filter,
    Machine,
    Routine,
    constant,
    maximum,
    minimum,
    polynomial,
)
from fluidact_fit.routines.evaluate import SINGLE
from fluidact_fit.routines.routine import Argument
from fluidact_fit.routines.sharing import shared

GOLDEN = Path(__file__).parents[1] / "golden" / ff.__version__
FAMILIES = sorted(f.stem for f in GOLDEN.glob("*.yaml"))
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
PD = (
    "format: fluidact-controller\nformat_version: 1\nsample_time: 0.01\nkind: pd\n"
    "controller: {bandwidth: 6.0, damping_ratio: 0.9, friction: static,\n"
    "  velocity_tolerance: 2.0e-3}\nlimits: {low: -200.0, high: 200.0}\n"
)


def written(name: str, folder: Path, arithmetic: Any = "float32") -> list[Path]:
    """A family or a controller as C."""
    file, controller = GOLDEN / f"{name}.yaml", None
    if name == "pd":
        controller = folder / "pd.yaml"
        controller.write_text(PD, encoding="utf-8")
        file = GOLDEN / "hydrostatic.yaml"
    return export(
        [file], "c", folder / "out", arithmetic=arithmetic, accept_not_identified=True,
        controller=controller,
    )  # fmt: skip


def potentiometer(degree: int, branches: int) -> tuple[Routine, ...]:
    """Weights over decades: what intervals make of the quotient has no bound."""
    rng = np.random.default_rng(degree)
    curves = []
    for branch in range(branches):
        weights = np.exp(rng.uniform(-3.0, 3.0, degree + 1))
        curves.append((np.linspace(0.001 * branch, 0.06, degree + 1), weights))
    return tuple(potentiometer_routines(Calibration(tuple(curves), 32.0, 991.0, 64.0), "1"))


def run(files: list[Path], *flags: str) -> int:
    """Exit status of a self-test, compiled with all warnings as errors."""
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-pedantic", "-Wconversion"]
    program = files[0].parent / "test"
    sources = [str(f) for f in files if f.suffix == ".c"]
    command = ["gcc", *strict, *flags, *sources, "-lm", "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return subprocess.run([program], check=False).returncode


@needs_gcc
@pytest.mark.parametrize(("degree", "branches"), [(6, 2), (8, 1), (9, 2), (12, 1)])
def test_curves_of_high_degree_compile_and_hold(degree: int, branches: int, tmp_path: Path) -> None:
    routines = potentiometer(degree, branches)
    assert len(routines) == 1 + branches
    code = Code("pot", "pot", "a potentiometer", routines)
    for name, content in write_code(code).items():
        (tmp_path / name).write_bytes(content)
        assert not re.search(rb"\b(nan|inf)", content)
    assert run([tmp_path / f"pot{end}" for end in (".h", ".c", "_selftest.c")]) == 0


@needs_gcc
def test_branches_without_a_dead_band_compile_and_hold(tmp_path: Path) -> None:
    weights = np.ones(2)
    curves = ((np.array([0.0, 0.06]), weights), (np.array([0.001, 0.061]), weights))
    calibration = Calibration(curves, 32.0, 991.0)
    code = Code("pot", "pot", "a", tuple(potentiometer_routines(calibration, "1")))
    files = []
    for name, content in write_code(code).items():
        files.append(tmp_path / name)
        files[-1].write_bytes(content)
    assert run(files) == 0


@needs_gcc
@pytest.mark.parametrize("arithmetic", ["float32", "q15"])
@pytest.mark.parametrize(
    ("family", "names"),
    [
        ("hydrostatic", ["dead_zone_negative", "dead_zone_positive"]),
        ("cylinder-friction", ["coulomb_positive", "coulomb_negative"]),
        ("spring-cylinder", ["stiffness", "viscous"]),
    ],
)
def test_arguments_that_nothing_depends_on_compile(
    family: str, names: list[str], arithmetic: Any, tmp_path: Path
) -> None:
    document = with_values(read_document(GOLDEN / f"{family}.yaml"), dict.fromkeys(names, 0.0))
    files = []
    for name, content in write(Job("zero", make_block(document), arithmetic)).items():
        files.append(tmp_path / name)
        files[-1].write_bytes(content)
    assert run(files) == 0


NUMBER = re.compile(r"(?<![\w.])\d+\.\d+(?:e[-+]?\d+)?(?=f\b)")


@needs_gcc
@pytest.mark.parametrize("name", ["hydrostatic", "ball-screw", "spring-cylinder", "pd"])
def test_a_constant_that_is_one_per_cent_off_is_found(name: str, tmp_path: Path) -> None:
    files = written(name, tmp_path)
    for path in files[:2]:
        text = path.read_text(encoding="ascii")
        for m in NUMBER.finditer(text):
            if float(m[0]) in (0.0, 0.5, 1.0, 2.0) or "/*" in text[: m.start()].split("*/")[-1]:
                continue
            other = f"{text[: m.start()]}{float(m[0]) * 1.01:.9e}{text[m.end() :]}"
            path.write_text(other, encoding="ascii")
            assert run(files, "-O0") != 0, text[: m.end()].splitlines()[-1]
        path.write_text(text, encoding="ascii")


def routines_of(name: str, folder: Path) -> list[Routine]:
    if name == "pd":
        path = folder / "pd.yaml"
        path.write_text(PD, encoding="utf-8")
        block = ff.load(GOLDEN / "hydrostatic.yaml")
        return list(controller_code(path, [block]).routines)
    block = ff.load(GOLDEN / f"{name}.yaml", accept_not_identified=True)
    return list(block.routines())


@pytest.mark.parametrize("name", [*FAMILIES, "pd"])
def test_golden_vectors_tell_mutants_from_the_routine(name: str, tmp_path: Path) -> None:
    """Run again from the vectors alone: sequence by sequence, with the reset that they say."""
    seen = missed = 0
    for routine in map(inward, routines_of(name, tmp_path)):
        vectors = golden(routine, difference, single)
        rows = vectors.arguments.reshape(-1, vectors.length, vectors.arguments.shape[1])
        given = rows.swapaxes(0, 1)
        due, flags = excitation.run(routine, given)
        np.testing.assert_allclose(due.T.ravel(), vectors.outputs, rtol=1e-12)
        for mutant in mutants_of(routine):
            other, beyond = excitation.run(mutant.routine, given)
            off = np.abs(other - due) > vectors.tolerance
            seen += 1
            missed += not (off.any() or (beyond != flags).any())
    assert seen > 8
    assert missed <= 0.05 * seen


@pytest.mark.parametrize("name", FAMILIES)
def test_a_bound_is_no_more_than_ten_times_what_is_found(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(77)
    for routine in routines_of(name, tmp_path):
        if routine.keeps:
            continue
        f = Function.of(routine, "x")
        low, high = np.array([[a.low, a.high] for a in f.routine.arguments]).T
        rows = single(rng.uniform(low, high, (300_000, low.size)))
        names = [a.name for a in f.routine.arguments]
        with np.errstate(all="ignore"):
            exact = Machine(f.routine)(**dict(zip(names, rows.T)))[0]
            near = Machine(f.routine, SINGLE)(**dict(zip(names, rows.T)))[0]
        worst = np.abs(near.astype(float) - exact).max()
        assert worst <= f.error.total, routine.name
        assert f.error.rounding <= 10.0 * worst, routine.name  # a jump is rarely met


def test_the_jump_of_compensation_is_part_of_the_bound(tmp_path: Path) -> None:
    (routine,) = routines_of("pd", tmp_path)
    error = Function.of(routine, "x").error
    assert error.jump == pytest.approx(1.19893904 + 3.00053811, rel=1e-6)
    assert error.rounding < 0.05
    header = written("pd", tmp_path)[0].read_text(encoding="ascii")
    stated = re.search(r"by\s+at most ([\d.]+)", header.replace("\n * ", " "))
    assert stated is not None
    assert float(stated[1]) >= error.total


def test_a_dead_time_of_thousands_of_samples_is_waited_for() -> None:
    draft = Draft("late", "", "1", 0.01)
    x = draft.argument(Argument("x", "1", "x", -2.0, 2.0))
    lag = Filter("lag", ((-0.2,),), (0.15,), (0.05,), (1.0,), 2000, x * constant("a", 3.0))
    routine = draft.returns(draft.filter(lag))
    vectors = golden(routine, difference, single)
    assert vectors.length > 2000
    outputs = vectors.outputs.reshape(-1, vectors.length)
    assert not outputs[:, :2000].any()
    assert np.abs(outputs[:, 2001:]).max() > 0.1
    assert error_of(routine).rounding > 1e-8  # of what comes out, not of the rest before


def test_both_sides_of_an_end_are_tried_where_nothing_else_sets_the_flag() -> None:
    draft = Draft("f", "", "1")
    x, y = (draft.argument(Argument(n, "1", n, 0.0, 1.0)) for n in "xy")
    draft.flag(0.1, y)  # only a tenth of the places is without a flag
    vectors = golden(draft.returns(x), difference, single)
    for end in (0.0, 1.0):
        flags = vectors.outside[vectors.arguments[:, 0] == end]
        assert not flags.all()
        beside = np.abs(vectors.arguments[:, 0] - end) < 1e-5
        assert vectors.outside[beside].any()


def test_what_two_choices_share_is_compared_once() -> None:
    """The search for edges takes as many runs for a long polynomial as for a short one."""
    runs = []
    for terms in (2, 14):
        draft = Draft("f", "", "1")
        u = draft.argument(Argument("u", "1", "u", -2.0, 2.0))
        x = maximum(minimum(u, constant("top", 1.5)) - 0.25, 0.0)
        routine = Function.of(draft.returns(polynomial([1.0] * terms, x, "c")), "x").routine
        runs.append(excitation.edges(routine, np.linspace(-2.0, 2.0, 50)[:, None]).shape)
    assert runs[0] == runs[1]


# ------------------------------------------------------------------------------- the text


@pytest.mark.parametrize("arithmetic", ["float32", "q15"])
@pytest.mark.parametrize("name", [*FAMILIES, "pd"])
def test_the_code_can_be_read(name: str, arithmetic: str, tmp_path: Path) -> None:
    if arithmetic == "q15" and name in ("line", "valve", "pd"):
        pytest.skip("nothing of it in fixed point")
    header, source, test = (p.read_text(encoding="ascii") for p in written(
        name, tmp_path, arithmetic))  # fmt: skip
    for text in (header, source, test):
        assert max(map(len, text.splitlines())) <= 100
    assert 'extern "C" {' in header
    code = re.sub(r"/\*.*?\*/", "", source, flags=re.DOTALL)
    for nothing in ("% 1)", "% 1;", "* 1.0f", "+ 0.0f)", "+ 0.0f;", "- 0.0f", "v12"):
        assert nothing not in code
    for m in re.finditer(r"\? ([^:?]+) : ([^;:?)]+)", code):
        assert m[1].strip() != m[2].strip(), m[0]
    if arithmetic == "float32":  # numbers have names: macros and tables
        body = re.sub(r"#define .*|static const float [^;]*;", "", code)
        left = {m[0] for m in NUMBER.finditer(body)} - {"0.0", "0.5", "1.0", "2.0"}
        assert not left


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_a_program_in_cpp_links(tmp_path: Path) -> None:
    header, source, _ = written("line", tmp_path)
    (tmp_path / "main.cpp").write_text(
        f'#include "{header}"\nint main() {{ line_step_state s; line_step_reset(&s);\n'
        "  int outside = 0; return line_step(&s, 2e5f, &outside) < 0.0f ? outside + 1 : 0; }\n"
    )
    for command in (
        ["gcc", "-c", str(source), "-o", "line.o"],
        ["g++", "-Wall", "-Werror", "main.cpp", "line.o", "-lm", "-o", "main"],
        ["./main"],
    ):
        subprocess.run(command, cwd=tmp_path, check=True)


ARGUED = {"float32": {"2.5"}, "q15": {"2.5", "10.1", "10.4", "10.8"}}


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="cppcheck is not installed")
@pytest.mark.parametrize("arithmetic", ["float32", "q15"])
@pytest.mark.parametrize("name", ["hydraulic-motor", "force-map", "hydrostatic"])
def test_rules_of_misra_that_are_not_argued_hold(
    name: str, arithmetic: Any, tmp_path: Path
) -> None:
    _, source, test = written(name, tmp_path, arithmetic)
    command = ["cppcheck", "--addon=misra", "--std=c99", "-q", str(source), str(test)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "addon" in done.stderr and "misra-c2012" not in done.stderr and "rror" in done.stderr:
        pytest.skip("the addon of cppcheck cannot be run")
    broken = set(re.findall(r"misra-c2012-([\d.]+)", done.stderr))
    assert broken <= ARGUED[arithmetic], done.stderr


# ------------------------------------------------------------------------- shared parts


def test_what_is_computed_twice_is_computed_once() -> None:
    draft = Draft("f", "", "1")
    x = draft.argument(Argument("x", "1", "x", -2.0, 2.0))
    kept = draft.state("kept")
    twice = x * constant("a", 3.0) + kept
    first = draft.let("first", twice * twice)
    draft.put(kept, first * 0.25)
    routine = draft.returns(first + (x * constant("a", 3.0) + kept))
    found = shared(routine)
    text = repr(found)
    assert text.count("'a'") == 1  # one product with it is left
    one, two = Machine(routine), Machine(found)
    for value in (0.3, -1.0, 1.9, 0.0, 0.7):  # the state is another one after it is put
        assert one(x=value)[0] == two(x=value)[0]


def test_operations_that_change_nothing_are_left_out() -> None:
    draft = Draft("f", "", "1")
    x = draft.argument(Argument("x", "1", "x", -2.0, 2.0))
    routine = draft.returns((x * 1.0 + 0.0) / 1.0 - 0.0 + (-(-1.0 * x)) * (2.0 * 0.5) + 0.0 * x)
    assert repr(routine.value).count("Number") == 0
    assert Machine(routine)(x=1.5)[0] == 3.0


def test_no_golden_vector_has_a_flag_that_rounding_of_what_cancels_decides() -> None:
    """A pressure that is left between the supply and a loss, both a thousand times as large."""
    draft = Draft("left", "", "Pa")
    speed = draft.argument(Argument("speed", "m/s", "speed", 0.0, 0.2))
    pressure = draft.argument(Argument("pressure", "Pa", "pressure", 5e5, 2.5e6))
    rest = draft.let("rest", constant("supply", 5e6) - pressure - constant("loss", 2.79e7) * speed)
    draft.flag(rest, constant("least", 5e3))
    routine = inward(draft.returns(rest))
    rows = single(np.random.default_rng(3).uniform([0.0, 5e5], [0.2, 2.5e6], (20_000, 2)))
    # brought to the threshold, to within what a number of single precision can tell
    beside = 5e3 + np.random.default_rng(4).normal(0.0, 1.0, len(rows))
    rows[:, 0] = single((5e6 - rows[:, 1] - beside) / 2.79e7)
    rows = rows[rows[:, 0] < 0.2][None]
    kept = rows[:, robust(routine, rows)]
    assert kept.shape[1] > 1000
    flags = [excitation.run(routine, kept)[1]]
    for order in (1, -1):  # the sum as other compilers may take it, in single precision
        x, p = (np.float32(kept[0, :, k]) for k in (0, 1))
        loss, supply = np.float32(2.79e7) * x, np.float32(5e6)
        left = supply - p - loss if order > 0 else supply - loss - p
        flags.append(left[None] < np.float32(5e3))
    assert np.array_equal(flags[0], flags[1])
    assert np.array_equal(flags[0], flags[2])


def test_a_constant_below_single_precision_is_written_as_zero() -> None:
    """Weights of a unit that training has switched off: a compiler would say it truncates them."""
    entry = Entry("weights", [1.1e-117, -6e-46, 0.25], "1", "weights of a unit")
    text = " ".join(macros_of(Code("net", "", "", (), numbers=(entry,)))[0].lines)
    assert "{ \\     0.0f, 0.0f, 0.25f" in text
