"""Routines as C99: statements and functions, in single or in double precision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ...routines import Routine
from ...routines.evaluate import SINGLE_HALVINGS
from ...routines.expression import Name
from ...routines.routine import Filter, Layer, Let, Matrix, Solve
from .expressions import Expressions
from .language import WIDTH, Folded, Precision, fold, unread, wrapped


class Writer(Expressions):
    """One routine as lines of C.

    Parameters
    ----------
    routine
        What is written; what it computes twice is computed once.
    prefix
        Begins every name that it gives.
    precision
        Of all numbers.
    macros
        Numbers that the header names.
    """

    def __init__(
        self, routine: Routine, prefix: str, precision: Precision,
        macros: Mapping[str, float] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(routine, prefix, precision, macros)
        self._counters: list[str] = []
        self._tables: list[str] = []
        self._starts = {s.name: self._start_of(s) for s in routine.states}
        self._clamp_all()
        self._compute()
        self._context = "value"
        self._result = self._text_of(self.routine.value)
        if self.routine.careful and not self.routine.keeps:
            self._say(f"{precision.type} result = {self._result};")
            self._result = "result"
            self._numbers_only(self._result)

    # ------------------------------------------------------------------------ statements

    def _clamp_all(self) -> None:
        self._ends = {}
        for a in self.routine.arguments:
            low = self._limit(a.low, f"{a.name}_low")
            high = self._limit(a.high, f"{a.name}_high")
            self._ends[a.name] = a.name, low, high
            used = self._known[a.name] = self._names.new(f"{a.name}_used")
            call = f"{self.prefix}_within({a.name}, {low}, {high}, &beyond)"
            self._say(f"const {self.precision.type} {used} = {call};")
        self._body.append("")

    def _let(self, s: Let) -> None:
        name = self._names.new(s.name)
        self._assign(name, s.value, declare=True)
        self._known[s.name] = name

    def _counter(self, name: str) -> None:
        if name not in self._counters:
            self._counters.append(name)

    def _list(self, name: str, rows: Matrix) -> None:
        """A matrix as one list, its rows in order: walking along it takes no index of two."""
        self._tables += self._declared(f"{name}[{len(rows) * len(rows[0])}]", rows, ("", ""))

    def _matrix(self, name: str, rows: Matrix) -> None:
        self._tables += self._declared(f"{name}[{len(rows)}][{len(rows[0])}]", rows, ("{", "}"))

    def _declared(self, name: str, rows: Matrix, ends: tuple[str, str]) -> Iterator[str]:
        real, place = self.precision.type, f"{self.prefix.upper()}_TABLE"
        yield f"static const {real} {name} {place} = {{"
        for k, row in enumerate(rows):
            text = ", ".join(map(self.precision.literal, row))
            comma = "," if k < len(rows) - 1 else ""
            yield from wrapped(f"{ends[0]}{text}{ends[1]}{comma}", "    ", "    ", WIDTH - 4)
        yield "};"

    def _read(self, table: str) -> str:
        return f"{self.prefix.upper()}_READ({table})"

    def _layer(self, s: Layer) -> None:
        real, folded = self.precision.type, fold(s)
        table, out = f"{self.name}_{s.name}", self._names.new(s.name)
        self._list(f"{table}_weights", folded.weights)
        self._matrix(f"{table}_biases", folded.biases)
        self._counter("row")
        self._counter("column")
        x, side = self._inputs_of(s, folded), "0"
        if folded.switch:
            side = self._names.new(f"{s.name}_side")
            self._say(
                f"int {side} = 1;",
                f"if ({self._condition(folded.switch)}) {{",
                f"    {side} = 0;",
                "}",
            )
        zero = self.precision.literal(0.0)
        activated = {
            "relu": f"(sum > {zero}) ? sum : {zero}",
            "tanh": f"tanh{self.precision.suffix}(sum)",
            "linear": "sum",
        }[s.activation]
        weight, n, m = self._names.new(f"{s.name}_weight"), len(folded.inputs), len(s.biases)
        self._say(
            f"const {real} *{weight} = {table}_weights;",
            f"{real} {out}[{m}];",
            f"for (row = 0; row < {m}; row++) {{",
            f"    {real} sum = {self._read(f'{table}_biases[{side}][row]')};",
            f"    for (column = 0; column < {n}; column++) {{",
            f"        sum += {self._read(f'*{weight}')} * {x}[column];",
            f"        {weight}++;",
            "    }",
            f"    {out}[row] = {activated};",
            "}",
        )
        self._known[s.name] = out

    def _inputs_of(self, s: Layer, folded: Folded) -> str:
        """The array that holds the inputs: that of the layer before, or a new one."""
        if known := self._array_of(folded.inputs):
            return known
        n = len(folded.inputs)
        x = self._names.new(f"{s.name}_inputs")
        inputs = ", ".join(self._text_of(e) for e in folded.inputs)
        self._say(f"const {self.precision.type} {x}[{n}] = {{{inputs}}};")
        return x

    def _solve(self, s: Solve) -> None:
        real, name = self.precision.type, self._names.new(s.name)
        count = min(s.halvings, SINGLE_HALVINGS) if self.precision.suffix else s.halvings
        low, high = (
            self._number(v, f"{s.name}_{w}") for v, w in ((s.low, "low"), (s.high, "high"))
        )
        target, below, above = (self._names.new(f"{s.name}_{w}") for w in ("target", "from", "to"))
        half = self.precision.literal(0.5)
        middle = f"{half} * ({below} + {above})"
        self._counter("row")
        self._assign(target, s.target, declare=True)
        self._say(
            f"{real} {below} = {low};",
            f"{real} {above} = {high};",
            f"{real} {name} = {middle};",
            f"for (row = 0; row < {count}; row++) {{",
        )
        self._halve(s, (name, target, below, above), f"{name} = {middle};")
        self._say("}")

    def _filter(self, s: Filter) -> None:
        """The equation; without a delay the newest input acts at once, and none is kept for it."""
        real, x, n = self.precision.type, f"state->{s.name}", len(s.output)
        if isinstance(s.drive, Name):
            drive = self._known[s.drive.name]
        else:
            drive = self._names.new(f"{s.name}_drive")
            self._assign(drive, s.drive, declare=True)
        out = self._names.new(s.name)
        terms = [(c, f"output_{k}", f"{x}[{k}]") for k, c in enumerate(s.output)]
        self._say(f"const {real} {out} = {self._sum([*terms, (s.direct, 'direct', drive)])};")
        late = soon = drive
        line, at = f"{x}_line", f"{x}_at"
        place = f"{line}[{at}]" if s.delay else f"{line}[0]"
        if any(s.late):
            late = self._names.new(f"{s.name}_late")
            self._say(f"const {real} {late} = {place};")
        if _keeps_line(s):
            self._say(f"{place} = {drive};")
        if s.delay:
            soon = self._names.new(f"{s.name}_soon")
            self._say(
                f"{at} = ({at} < {s.delay}) ? ({at} + 1) : 0;", f"const {real} {soon} = {place};"
            )
        moves = [self._names.new(f"{s.name}_move_{k}") for k in range(n)]
        for k, move in enumerate(moves):
            terms = [(c, f"change_{k}_{j}", f"{x}[{j}]") for j, c in enumerate(s.change[k])]
            terms += [(s.late[k], f"late_{k}", late), (s.soon[k], f"soon_{k}", soon)]
            self._say(f"const {real} {move} = {self._sum(terms)};")
        self._say(*(f"{x}[{k}] += {move};" for k, move in enumerate(moves)))
        self._known[s.name] = out

    # -------------------------------------------------------------------------- function

    @property
    def signature(self) -> str:
        """The function without its end."""
        real = self.precision.type
        arguments = [f"{self.name}_state *state"] if self.routine.keeps else []
        arguments += [f"{real} {a.name}" for a in self.routine.arguments]
        return f"{real} {self.name}({', '.join(arguments)}, int *outside)"

    def prototype(self) -> list[str]:
        """The declaration of the function."""
        return wrapped(f"{self.signature};", "")

    def structure(self) -> list[str]:
        """The type of what is kept between calls, and how it is reset; empty without."""
        if not self.routine.keeps:
            return []
        real = self.precision.type
        fields = [f"    {real} {s.name};" for s in self.routine.states]
        for f in self.routine.filters:
            fields.append(f"    {real} {f.name}[{len(f.output)}];")
            if _keeps_line(f):
                fields.append(f"    {real} {f.name}_line[{f.delay + 1}];")
            if f.delay:
                fields.append(f"    int {f.name}_at;")
        kind = f"{self.name}_state"
        return [
            "typedef struct {",
            *fields,
            f"}} {kind};",
            f"void {self.name}_reset({kind} *state);",
        ]

    def tables(self) -> Iterator[str]:
        """Constants of the function as macros."""
        for macro, value in self._constants.items():
            text = self.precision.literal(value)
            yield f"#define {macro} {f'({text})' if value < 0.0 else text}"

    def reset(self) -> list[str]:
        """The function that resets what is kept; empty without."""
        if not self.routine.keeps:
            return []
        literal, lines, loops = self.precision.literal, list[str](), list[tuple[str, int]]()
        for s in self.routine.states:
            lines.append(f"    state->{s.name} = {self._starts[s.name]};")
        for f in self.routine.filters:
            loops.append((f.name, len(f.output)))
            loops += [(f"{f.name}_line", f.delay + 1)] if _keeps_line(f) else []
            lines += [f"    state->{f.name}_at = 0;"] if f.delay else []
        for name, size in loops:
            lines += [
                f"    for (k = 0; k < {size}; k++) {{",
                f"        state->{name}[k] = {literal(0.0)};",
                "    }",
            ]
        head = ["    int k;", ""] if loops else []
        return [f"void {self.name}_reset({self.name}_state *state)", "{", *head, *lines, "}"]

    def function(self) -> list[str]:
        """The function itself."""
        lines = [
            *wrapped(self.signature, ""), "{", *(f"    {line}" for line in self._tables),
            "    int beyond = 0;", *(f"    int {name};" for name in self._counters),
            *self._body, "",
            "    if (outside != NULL) {", "        *outside = beyond;", "    }",
            *wrapped(f"return {self._result};", "    "), "}",
        ]  # fmt: skip
        return unread(lines, [self._known[a.name] for a in self.routine.arguments])


def _keeps_line(s: Filter) -> bool:
    return s.delay > 0 or any(s.late)
