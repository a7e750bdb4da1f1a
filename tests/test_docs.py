"""Documents kept in step with the program: commands, families, docstrings, notebooks."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import FunctionType, ModuleType
from typing import get_args
from xml.etree import ElementTree

import click
import pytest

import fluidact_fit as ff
from fluidact_fit.experiment import Hold
from fluidact_fit.export import get_target, make_job
from fluidact_fit.family import Status
from fluidact_fit.options import describe
from fluidact_fit_cli.program import program

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def shell_commands(text: str) -> Iterator[list[str]]:
    """Commands of the ``sh`` and ``console`` blocks that start with the program's name."""
    for block in re.findall(r"```(?:sh|console)\n(.*?)```", text, re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.removeprefix("$ "), comments=True) if _is_typed(line) else []
            if words:
                yield words[1:]


def _is_typed(line: str) -> bool:
    return line.removeprefix("$ ").startswith("fluidact-fit ")


COMMANDS = [
    pytest.param(words, id=f"{page.stem}-{words[0]}-{number}")
    for page in PAGES
    for number, words in enumerate(shell_commands(page.read_text(encoding="utf-8")))
]
FAMILY_PAGES = ROOT / "docs" / "families"


@pytest.mark.parametrize("words", COMMANDS)
def test_commands_of_the_pages_exist(words: list[str]) -> None:
    command = program.get_command(click.Context(program), words[0])
    assert command is not None
    known = {flag for p in command.params for flag in (*p.opts, *p.secondary_opts)}
    given = {
        found[1] for word in words if (found := re.fullmatch(r"(--?[a-zA-Z][\w-]*)(=.*)?", word))
    }
    assert given <= known
    assert all((ROOT / word).exists() for word in words if re.fullmatch(r"datasets/[^*\[]+", word))


@pytest.mark.parametrize("name", ff.family_names())
def test_page_of_a_family_fits_its_dataset(name: str) -> None:
    (words,) = shell_commands((FAMILY_PAGES / f"{name}.md").read_text(encoding="utf-8"))
    assert words[0] == name
    logs = [ff.read_log(ROOT / word) for word in words if word.endswith(".csv")]
    assert len(logs) == 3
    columns = {a.split("=")[1] for o, a in pairwise(words) if o == "--column"}
    for log in logs:
        assert columns <= {column.header for column in log.columns}


@pytest.mark.parametrize("name", ff.family_names())
def test_family_has_a_sketch_with_a_text_for_those_who_do_not_see_it(name: str) -> None:
    root = ElementTree.parse(FAMILY_PAGES / f"{name}.svg").getroot()
    assert len(root.attrib["aria-label"]) > 20
    assert f"![{root.attrib['aria-label']}]({name}.svg)" in (FAMILY_PAGES / f"{name}.md").read_text(
        encoding="utf-8"
    )


def test_readme_is_short_and_names_the_two_commands_of_a_clone() -> None:
    assert len(README.splitlines()) <= 110
    assert re.findall(r"^make (demo|test) ", README, re.MULTILINE) == ["demo", "test"]


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_c_of_the_readme_compiles(tmp_path: Path) -> None:
    (block,) = re.findall(r"```c\n(.*?)```", README, re.DOTALL)
    (tmp_path / "main.c").write_text(block, encoding="utf-8")
    path = ROOT / "tests" / "golden" / ff.__version__ / "line.yaml"
    for name, content in get_target("c")(make_job(path, ff.load(path))).items():
        (tmp_path / name).write_bytes(content)
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-c", "main.c"]
    subprocess.run(command, cwd=tmp_path, check=True)


def test_python_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    block = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0]
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block, "python.md", "exec"), names)
    assert (tmp_path / "hydrostatic.yaml").is_file()
    assert names["model"] is not None


def test_the_page_of_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    (tmp_path / "datasets").symlink_to(ROOT / "datasets")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "python.md", "exec"), names)
    assert names["checked"].fits
    assert {*names["frame"]} == {
        *re.findall(r"\w+", page.partition("to_dataframe()  # ")[2].partition("\n")[0])
    }
    assert [path.name for path in names["written"]] == ["hydrostatic.json"]


def test_keywords_of_the_page_of_python_exist() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    table = page.partition("| command line |")[2].partition("\n\n")[0]
    known = {*inspect.signature(ff.fit_hydrostatic).parameters}
    for row in table.splitlines()[2:]:
        option, keyword = re.findall(r"`([^`]*)`", row)[0], re.findall(r"`(\w+)=", row)
        assert option.split()[0] in {o for c in ("fit", "hydrostatic") for o in options_of(c)}
        assert {*keyword} <= known


def options_of(name: str) -> set[str]:
    command = program.get_command(click.Context(program), name)
    assert command is not None
    return {flag for parameter in command.params for flag in parameter.opts}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def first_cells(page: str, head: str) -> list[str]:
    """Names in the first column of the table that starts with this head."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    (body,) = re.findall(rf"^\| {head} \|.*\n\|[-| ]+\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    return re.findall(r"^\| `([^`]+)`", body, re.MULTILINE)


# What a value means is told by hand on these pages; that none is left out is checked here.
# Tables that follow from the program are generated: `make lint` checks them.
def test_pages_of_recording_and_of_choice_have_every_family() -> None:
    for page in ("which-family.md", "record.md"):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        missing = [name for name in ff.family_names() if f"(families/{name}.md)" not in text]
        assert missing == [], page


def test_page_has_every_hold() -> None:
    assert {*first_cells("holds.md", "hold")} == {*get_args(Hold)}


def test_page_has_every_status() -> None:
    assert {*first_cells("parameter-file.md", "status")} == {*get_args(Status)}


@pytest.mark.parametrize("name", ff.family_names())
def test_every_item_of_a_family_is_described(name: str) -> None:
    family = ff.get_family(name)
    assert type(family).__doc__
    home = inspect.getmodule(type(family))
    equation = Path(home.__file__).with_name("equation.py")  # of a family that is a package
    text = equation.read_text(encoding="utf-8") if equation.exists() else ""
    assert max((home.__doc__ or "").count("\n"), text.partition('"""\n\n')[0].count("\n")) > 5
    for variant in family.variants:
        for item in (*variant.roles, *variant.parameters):
            assert item.description, item.name
        for parameter in variant.parameters:
            if parameter.neutral is not None and not parameter.optional:
                assert parameter.remedy, f"{parameter.name} can be refused without a remedy"
    for option in describe(family.options_type, every=True):
        assert option.help, option.name


@pytest.mark.parametrize("name", ff.family_names())
def test_family_has_a_notebook(name: str) -> None:
    number = ff.family_names().index(name) + 1
    path = ROOT / "notebooks" / f"{number:02}_{name.replace('-', '_')}.ipynb"
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 300_000
    assert "assert " in text
    assert '"execution_count": 1' in text, "committed without being executed"
    assert not re.search(r"/(home|root|tmp|work|Users)/", text), "shows a path of a machine"


def modules() -> Iterator[ModuleType]:
    yield ff
    for info in pkgutil.walk_packages(ff.__path__, "fluidact_fit."):
        yield importlib.import_module(info.name)


def public_functions() -> Iterator[tuple[str, FunctionType]]:
    for module in modules():
        for name, item in vars(module).items():
            if name.startswith("_") or getattr(item, "__module__", "") != module.__name__:
                continue
            if isinstance(item, FunctionType) and item.__name__ == name:
                yield f"{module.__name__}.{name}", item
            elif inspect.isclass(item):
                for method, function in vars(item).items():
                    plain = isinstance(function, FunctionType) and function.__name__ == method
                    if plain and not method.startswith("_"):
                        yield f"{module.__name__}.{name}.{method}", function


def sections(docstring: str) -> dict[str, list[str]]:
    """numpydoc sections: title to lines."""
    found: dict[str, list[str]] = {}
    title, lines = "", inspect.cleandoc(docstring).splitlines()
    for i, line in enumerate(lines):
        following = lines[i + 1] if i + 1 < len(lines) else ""
        if line and following and set(following) == {"-"}:
            assert len(following) == len(line), f"underline of {line!r} has another length"
            title = line
        elif set(line) != {"-"} or not line:
            found.setdefault(title, []).append(line)
    return found


KNOWN_SECTIONS = {"", "Parameters", "Returns", "Yields", "Raises", "Notes", "References",
                  "Examples", "Attributes", "Warns", "See Also"}  # fmt: skip


def test_public_functions_have_docstrings() -> None:
    missing = [name for name, function in public_functions() if not function.__doc__]
    assert missing == []


def test_docstrings_parse() -> None:
    wrong = []
    for name, function in public_functions():
        found = sections(function.__doc__ or "")
        wrong += [f"{name}: section {title!r}" for title in found if title not in KNOWN_SECTIONS]
        signature = {*inspect.signature(function).parameters}
        for line in found.get("Parameters", []):
            if line and not line.startswith(" "):
                words = re.split(r"[,:]", line.split(" : ")[0])
                documented = {word.strip().lstrip("*") for word in words if word.strip()}
                wrong += [f"{name}: {word!r}" for word in documented - signature]
    assert wrong == []


def test_documented_arrays_say_shape_or_unit() -> None:
    wrong = []
    for name, function in public_functions():
        found = sections(function.__doc__ or "")
        if "Parameters" not in found:
            continue
        arrays = [
            parameter
            for parameter, annotation in function.__annotations__.items()
            if parameter != "return" and re.search(r"\b(FloatArray|NDArray)\b", str(annotation))
        ]
        text = "\n".join(found["Parameters"])
        if any(array in text for array in arrays) and not re.search(
            r"\[.+\]|\(\w+,|SI|As in|One array per", text
        ):
            wrong.append(name)
    assert wrong == []
