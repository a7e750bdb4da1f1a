"""Size of the house: lines, largest file, longest function, long signatures, uses of ``Any``.

``make house`` prints it for this checkout, ``python tools/house.py ROOT`` for another one.

Lines are all lines of the ``.py`` files of ``sysid`` and ``cli``, blank ones and comments
included. A function counts as long in its signature with seven parameters or more, ``self``,
``cls``, ``*args`` and ``**kwargs`` left out. A use of ``Any`` is an occurrence of the name outside
imports, comments and texts; the lines with one in ``sysid`` are counted beside it.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

MANY = 7
_PACKAGES = ("sysid", "cli")
_Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Function:
    """A function or method: where it stands, its lines and parameters."""

    place: str
    lines: int
    parameters: int


@dataclass(frozen=True)
class Module:
    """One file: lines, functions, and the line of every use of ``Any``."""

    path: Path
    lines: int
    functions: tuple[Function, ...]
    any_lines: tuple[int, ...]


def count_parameters(node: _Function) -> int:
    """Parameters a caller has to think of."""
    positional = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
    if positional[:1] in (["self"], ["cls"]):
        positional = positional[1:]
    return len(positional) + len(node.args.kwonlyargs)


def find_any(source: str) -> Iterator[int]:
    """Yield the line of every ``Any`` that is not being imported."""
    importing = False
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.NEWLINE:
            importing = False
        elif token.type == tokenize.NAME and token.string == "import":
            importing = True
        elif token.type == tokenize.NAME and token.string == "Any" and not importing:
            yield token.start[0]


def measure(path: Path) -> Module:
    """Measure one file."""
    source = path.read_text(encoding="utf-8")
    functions = tuple(
        Function(
            f"{path}:{node.lineno} {node.name}",
            (node.end_lineno or node.lineno) - node.lineno + 1,
            count_parameters(node),
        )
        for node in ast.walk(ast.parse(source))
        if isinstance(node, _Function)
    )
    return Module(path, len(source.splitlines()), functions, tuple(find_any(source)))


def survey(root: Path) -> list[Module]:
    """Measure every file of both packages."""
    return [
        measure(path) for package in _PACKAGES for path in sorted((root / package).rglob("*.py"))
    ]


def describe(modules: list[Module], root: Path) -> str:
    """The figures as text, one per line."""

    def short(place: object) -> str:
        return str(place).removeprefix(f"{root}/")

    functions = [function for module in modules for function in module.functions]
    largest = max(modules, key=lambda module: module.lines)
    longest = max(functions, key=lambda function: function.lines)
    widest = max(functions, key=lambda function: function.parameters)
    wide = sum(function.parameters >= MANY for function in functions)
    wider = sum(function.parameters > MANY for function in functions)
    uses = sum(len(module.any_lines) for module in modules)
    lines_with_any = sum(
        len({*module.any_lines}) for module in modules if module.path.is_relative_to(root / "sysid")
    )
    rows = [
        ("files", f"{len(modules)}"),
        ("lines", f"{sum(module.lines for module in modules)}"),
        ("largest file", f"{largest.lines} lines, {short(largest.path)}"),
        ("functions", f"{len(functions)}"),
        ("longest function", f"{longest.lines} lines, {short(longest.place)}"),
        (f"{MANY} parameters or more", f"{wide} functions ({wider} with more than {MANY})"),
        ("most parameters", f"{widest.parameters}, {short(widest.place)}"),
        ("uses of Any", f"{uses} ({lines_with_any} lines of sysid)"),
    ]
    return "\n".join(f"{name:24}{value}" for name, value in rows)


def main() -> None:
    """Print the figures."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    sys.stdout.write(describe(survey(root.resolve()), root.resolve()) + "\n")


if __name__ == "__main__":
    main()
