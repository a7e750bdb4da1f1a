"""Size of the house: lines, largest file, longest function, long signatures, uses of ``Any``.

``make house`` prints it for this checkout, ``python tools/house.py ROOT`` for another one.

With ``--packages`` it prints lines and tuning constants of every package instead.

Lines are all lines of the ``.py`` files of ``sysid`` and ``cli``, blank ones and comments
included. A tuning constant is a number, or a tuple of numbers, that a module names at its top. A
function counts as long in its signature with seven parameters or more, ``self``, ``cls``, ``*args``
and ``**kwargs`` left out. A use of ``Any`` is an occurrence of the name outside imports, comments
and texts; the lines with one in ``sysid`` are counted beside it.
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
    """One file: lines, functions, the line of every use of ``Any``, and its tuning constants."""

    path: Path
    lines: int
    functions: tuple[Function, ...]
    any_lines: tuple[int, ...]
    constants: tuple[str, ...]


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


def find_constants(tree: ast.Module) -> Iterator[str]:
    """Yield the names of numbers, and of tuples of them, at the top of a module."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and _is_number(node.value):
            for target in node.targets:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                yield from (name.id for name in names if isinstance(name, ast.Name))


def _is_number(node: ast.expr) -> bool:
    """Whether an expression is made of numbers alone."""
    if isinstance(node, ast.Tuple):
        return bool(node.elts) and all(map(_is_number, node.elts))
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def measure(path: Path) -> Module:
    """Measure one file."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    functions = tuple(
        Function(
            f"{path}:{node.lineno} {node.name}",
            (node.end_lineno or node.lineno) - node.lineno + 1,
            count_parameters(node),
        )
        for node in ast.walk(tree)
        if isinstance(node, _Function)
    )
    lines, uses = len(source.splitlines()), tuple(find_any(source))
    return Module(path, lines, functions, uses, tuple(find_constants(tree)))


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


def describe_packages(modules: list[Module], root: Path) -> str:
    """Lines and tuning constants of every package, one package per line."""
    table: dict[str, tuple[int, int]] = {}
    for module in modules:
        parts = module.path.relative_to(root).parts[1:-1]
        package = "/".join(parts[:2])
        lines, constants = table.get(package, (0, 0))
        table[package] = lines + module.lines, constants + len(module.constants)
    rows = [f"{name:32}{lines:8}{constants:12}" for name, (lines, constants) in table.items()]
    totals = [sum(column) for column in zip(*table.values(), strict=True)]
    head = f"{'package':32}{'lines':>8}{'constants':>12}"
    return "\n".join([head, *rows, f"{'all':32}{totals[0]:8}{totals[1]:12}"])


def main() -> None:
    """Print the figures."""
    given = [word for word in sys.argv[1:] if word != "--packages"]
    root = Path(given[0] if given else Path(__file__).parents[1]).resolve()
    show = describe_packages if "--packages" in sys.argv else describe
    sys.stdout.write(show(survey(root), root) + "\n")


if __name__ == "__main__":
    main()
