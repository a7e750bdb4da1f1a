"""Routines as C99: expressions and statements, in single or in double precision.

Numbers other than 0, 1, 2 and a half stand under names: those of the parameters where the header
has them, else of the routine.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from ...routines import Argument, Routine
from ...routines.evaluate import SINGLE_HALVINGS
from ...routines.expression import (
    Binary,
    Choose,
    Expression,
    Item,
    Name,
    Number,
    Unary,
    parts_of,
)
from ...routines.routine import Filter, Flag, Layer, Let, Matrix, Put, Solve, State, Statement
from ...routines.sharing import shared, word_of
from .language import WIDTH, Folded, Names, Precision, fold, unread, wrapped

_OPERATORS = {"+": "+", "-": "-", "*": "*", "/": "/"}
_PLAIN = (0.0, 0.5, 1.0, 2.0)  # numbers that say nothing of a machine
_LONG = 84  # signs of an expression: what is longer and part of another gets a name


class Writer:
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
        self.routine, self.prefix, self.precision = shared(routine), prefix, precision
        named, times = macros or {}, Counter((macros or {}).values())
        # two parameters of one value: which is meant is not known
        self._macros = {value: name for name, value in named.items() if times[value] == 1}
        self._constants: dict[str, float] = {}
        self._named = dict(named)
        self._names = Names(a.name for a in routine.arguments)
        self._known = {s.name: f"state->{s.name}" for s in routine.states}
        self._counters: list[str] = []
        self._tables: list[str] = []
        self._body: list[str] = []
        self._depth, self._whole = 1, False
        self._context = ""
        self._starts = {s.name: self._start_of(s) for s in routine.states}
        self._clamp_all()
        interrupts = self.routine.careful and self.routine.keeps
        if interrupts:
            self._interrupt()
            self._depth = 2
        for s in self.routine.body:
            self._run(s)
        self._depth = 1
        if interrupts:
            self._say("}")
        self._context = "value"
        self._result = self._text_of(self.routine.value)
        if self.routine.careful and not self.routine.keeps:
            self._result = self._numbers_only(self._result)

    @property
    def name(self) -> str:
        """Name of the function."""
        return f"{self.prefix}_{self.routine.name}"

    # ------------------------------------------------------------------------- constants

    def _number(self, value: float, name: str = "") -> str:
        """A number by its name; negative ones in parentheses."""
        if abs(value) in _PLAIN and not name:
            text = self.precision.literal(abs(value))
            return f"(-{text})" if value < 0.0 else text
        for sign, text in ((1.0, "{}"), (-1.0, "(-{})")):
            own = f"{self.prefix}_{name}".upper()
            if self._named.get(own) == sign * value:
                return text.format(own)
            if sign * value in self._macros:
                return text.format(self._macros[sign * value])
        if value < 0.0:
            return f"(-{self._number(-value, name)})"
        wanted = f"{self.name}_{name or self._context}".upper()
        number, macro = 0, wanted
        while macro in self._named or self._constants.get(macro, value) != value:
            number += 1
            macro = f"{wanted}_{number}"
        self._constants[macro] = value
        return macro

    def _start_of(self, s: State) -> str:
        """What a state is after a reset, by its name where it belongs to the machine."""
        plain = abs(s.initial) in _PLAIN
        return self._number(s.initial, "" if plain else f"{s.name}_start")

    def _limit(self, value: float, name: str) -> str:
        """A number that has a name even where it is a plain one, such as the end of a range."""
        macro = f"{self.name}_{name}".upper()
        self._constants[macro] = value
        return macro

    # ----------------------------------------------------------------------- expressions

    def _say(self, *lines: str) -> None:
        for line in lines:
            indent = "    " * self._depth + line[: len(line) - len(line.lstrip())]
            self._body += wrapped(line.lstrip(), indent)

    def _text_of(self, e: Expression) -> str:
        """An expression that stands alone."""
        text = self._written(e)
        return text[1:-1] if isinstance(e, Binary | Choose) and _enclosed(text) else text

    def _text(self, e: Expression) -> str:
        """An expression, in parentheses where it has an operator.

        What is long becomes a statement that stands before.
        """
        text = self._written(e)
        if len(text) > _LONG and isinstance(e, Unary | Binary) and not self._whole:
            name = self._names.new(word_of(e))
            bare = text[1:-1] if _enclosed(text) else text
            self._say(f"const {self.precision.type} {name} = {bare};")
            return name
        return text

    def _written(self, e: Expression) -> str:
        match e:
            case Number():
                return self._number(e.value, e.name)
            case Name():
                return self._known[e.name]
            case Item():
                return f"{self._known[e.name]}[{e.index}]"
            case Unary(function="neg"):
                return f"(-{self._text(e.x)})"
            case Unary():
                function = "fabs" if e.function == "abs" else e.function
                return f"{function}{self.precision.suffix}({self._text_of(e.x)})"
            case Binary() if e.function in _OPERATORS:
                return f"({self._left(e)} {e.function} {self._text(e.b)})"
            case Binary():
                return f"{self.prefix}_{e.function}({self._text_of(e.a)}, {self._text_of(e.b)})"
            case Choose():
                if _is_short(e):
                    return f"({self._condition(e)} ? {self._text(e.yes)} : {self._text(e.no)})"
                chosen = self._names.new("chosen")
                self._assign(chosen, e, declare=True)
                return chosen
        raise TypeError(e)

    def _left(self, e: Binary) -> str:
        """The left side of an operator; a chain of one operator needs no parentheses."""
        text = self._text(e.a)
        if isinstance(e.a, Binary) and e.a.function == e.function and _enclosed(text):
            return text[1:-1]
        return text

    def _condition(self, e: Choose | Flag) -> str:
        relation = e.relation if isinstance(e, Choose) else "<"
        return f"({self._text(e.a)} {relation} {self._text(e.b)})"

    def _assign(self, target: str, e: Expression, declare: bool = False) -> None:
        """Give a variable a value: a long choice by branches, of which one is computed."""
        if not isinstance(e, Choose) or _is_short(e):
            kind = f"const {self.precision.type} " if declare else ""
            self._say(f"{kind}{target} = {self._text_of(e)};")
            return
        if declare:
            self._say(f"{self.precision.type} {target};")
        word = "if"
        while True:
            self._whole = word != "if"  # before an else there is no place for a statement
            condition = self._condition(e)
            self._whole = False
            self._say(f"{word} {condition} {{")
            self._nested(target, e.yes)
            rest = e.no
            # a condition that is a long choice itself needs statements before it
            if not isinstance(rest, Choose) or _has_choice(rest.a) or _has_choice(rest.b):
                break
            e, word = rest, "} else if"
        self._say("} else {")
        self._nested(target, rest)
        self._say("}")

    def _nested(self, target: str, e: Expression) -> None:
        self._depth += 1
        self._assign(target, e)
        self._depth -= 1

    # ------------------------------------------------------------------------ statements

    def _clamp_all(self) -> None:
        for a in self.routine.arguments:
            low = self._limit(a.low, f"{a.name}_low")
            high = self._limit(a.high, f"{a.name}_high")
            used = self._names.new(f"{a.name}_used")
            self._known[a.name] = used
            call = f"{self.prefix}_within({a.name}, {low}, {high}, &beyond)"
            self._say(f"const {self.precision.type} {used} = {call};")
        self._body.append("")

    def _unreadable(self, a: Argument) -> str:
        """Condition under which nothing is computed from an argument."""
        low, high = (self._limit(v, f"{a.name}_{w}") for v, w in ((a.low, "low"), (a.high, "high")))
        if a.measured:
            return f"!(({a.name} >= {low}) && ({a.name} <= {high}))"
        return f"!(({a.name} >= {low}) || ({a.name} < {low}))"  # what is not a number

    def _interrupt(self) -> None:
        """The branch that computes nothing; the body stands in the other one."""
        conditions = [self._unreadable(a) for a in self.routine.arguments]
        self._say(f"if ({' || '.join(conditions)}) {{")
        self._depth = 2
        self._say("/* nothing to compute from: the last output stands */", "beyond = 1;")
        for s in self.routine.interrupted:
            self._assign(f"state->{s.state}", s.value)
        self._depth = 1
        self._say("} else {")

    def _numbers_only(self, result: str) -> str:
        """The result, but no number where an argument is none."""
        self._say(f"{self.precision.type} result = {result};")
        for a in self.routine.arguments:
            self._say(f"if ({self._unreadable(a)}) {{", f"    result = {a.name};", "}")
        return "result"

    def _run(self, s: Statement) -> None:
        self._context = s.state if isinstance(s, Put) else getattr(s, "name", "limit")
        match s:
            case Let():
                name = self._names.new(s.name)
                self._assign(name, s.value, declare=True)
                self._known[s.name] = name
            case Put():
                self._assign(f"state->{s.state}", s.value)
                self._known[s.state] = f"state->{s.state}"
            case Flag():
                self._say(f"if {self._condition(s)} {{", "    beyond = 1;", "}")
            case Layer():
                self._layer(s)
            case Solve():
                self._solve(s)
            case Filter():
                self._filter(s)

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
                f"if {self._condition(folded.switch)} {{",
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
        first, n = folded.inputs[0], len(folded.inputs)
        if isinstance(first, Item) and folded.inputs == tuple(
            Item(first.name, k) for k in range(n)
        ):
            return self._known[first.name]
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
        before = dict(self._known)
        self._known[s.name] = name
        self._depth += 1
        for let in s.body:
            self._run(let)
        self._context = s.name
        self._say(
            f"if ({self._text(s.value)} {'<' if s.rising else '>'} {target}) {{",
            f"    {below} = {name};",
            "} else {",
            f"    {above} = {name};",
            "}",
            f"{name} = {middle};",
        )
        self._depth -= 1
        self._say("}")
        self._known = {**before, s.name: name}

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

    def _sum(self, terms: Sequence[tuple[float, str, str]]) -> str:
        """Sum of products with constants, by value and name; those with zero are left out."""
        products = [
            x if c == 1.0 else f"({self._number(c, f'{self._context}_{name}')} * {x})"
            for c, name, x in terms
            if c != 0.0
        ]
        if len(products) == 1 and _enclosed(products[0]):
            return products[0][1:-1]
        return " + ".join(products) or self.precision.literal(0.0)

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


def _has_choice(e: Expression) -> bool:
    return isinstance(e, Choose) or any(map(_has_choice, parts_of(e)))


def _is_short(e: Choose) -> bool:
    """Whether a choice is between values that are at hand."""
    if _has_choice(e.a) or _has_choice(e.b):
        return False
    return all(isinstance(x, Number | Name | Item) or _is_negated(x) for x in (e.yes, e.no))


def _is_negated(e: Expression) -> bool:
    return isinstance(e, Unary) and e.function == "neg" and isinstance(e.x, Name)


def _enclosed(text: str) -> bool:
    """Whether the first parenthesis of a text is closed by its last sign."""
    depth = 0
    for k, sign in enumerate(text):
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if depth == 0:
            return k == len(text) - 1 and text[0] == "("
    return False
