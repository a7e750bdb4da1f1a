"""Routines as function blocks of Structured Text."""

from __future__ import annotations

from collections.abc import Sequence

from ...routines import Argument, Routine
from ...routines.expression import Binary, Choose, Expression, Item, Name, Number, Unary
from ...routines.routine import Filter, Layer, Let, Matrix, Solve
from ...routines.sharing import shared
from ..branches import Branches, Words
from .words import INDENT, Names, array, block_comment, comment, literal, number, section, wrapped

_LEVELS = {"+": 1, "-": 1, "*": 2, "/": 2}
_CALLS = {"abs": "ABS", "sqrt": "SQRT", "exp": "EXP", "log": "LN", "min": "MIN", "max": "MAX"}
_ALONE, _ATOM = 0, 3


class FunctionBlock(Branches):
    """A routine as a function block.

    ``value`` and ``outside`` are its outputs; where something is kept between calls, a call with
    ``reset`` is the first one again. Whatever is not kept stands in ``VAR_TEMP``.

    Parameters
    ----------
    name
        Of the function block.
    routine
        What it does; what it computes twice is computed once.
    """

    words = Words(
        "IF {} THEN", "ELSIF {} THEN", "ELSE", "END_IF;", "{} := {};", " OR ",
        "NOT ({0} >= {1} OR {0} < {1})", "NOT ({0} >= {1} AND {0} <= {2})", "outside := TRUE;",
        ("outside := TRUE;",),
    )  # fmt: skip

    def __init__(self, name: str, routine: Routine) -> None:
        self.name, self.routine = name, (routine := shared(routine))
        self._names = Names()
        self._known, self._states, self._ends = {}, {}, {}
        self._counters: dict[str, str] = {}
        self._constants: dict[tuple[str, float], str] = {}
        self._held: list[str] = []
        self._tables: list[str] = []
        self._scratch: list[str] = []
        self._resets: list[str] = []
        self._body: list[str] = []
        self._depth = 0
        for own in ("value", "outside", "reset"):
            self._names.new(own)
        self.inputs = tuple(self._names.new(a.name) for a in routine.arguments)
        self._keep_states()
        self._clamp_all()
        self._compute()
        self._assign("value", routine.value)
        if routine.careful and not routine.keeps:
            self._numbers_only("value")

    def lines(self) -> list[str]:
        """The function block, with a comment that says what it does."""
        r = self.routine
        taken: list[str] = []
        for i, a in zip(self.inputs, r.arguments):
            taken += wrapped(f"{i} : LREAL; {comment(described(a))}", 1)
        resets = []
        if r.keeps:
            about = "TRUE: forget what was kept, this is the first call"
            taken.append(f"{INDENT}reset : BOOL; {comment(about)}")
            resets = [f"IF reset OR NOT {self._begun} THEN", *self._resets, "END_IF;"]
        given = [
            f"{INDENT}value : LREAL; {comment(f'[{r.unit}]')}",
            f"{INDENT}outside : BOOL; {comment('TRUE: an argument lay beyond its range')}",
        ]
        return [
            *block_comment(self._about()),
            f"FUNCTION_BLOCK {self.name}",
            *section("VAR_INPUT", taken),
            *section("VAR_OUTPUT", given),
            *section("VAR", self._held),
            *section("VAR CONSTANT", self._tables),
            *section("VAR_TEMP", self._scratch),
            *resets,
            *self._body,
            "END_FUNCTION_BLOCK",
        ]

    def _about(self) -> list[str]:
        period = self.routine.sample_time
        return [self.routine.about, *([f"Call it every {period:.9g} s."] if period else [])]

    # ------------------------------------------------------------------------- declarations

    def _temporary(self, wanted: str, kind: str = "LREAL") -> str:
        name = self._names.new(wanted)
        self._scratch.append(f"{INDENT}{name} : {kind};")
        return name

    def _list(self, wanted: str, length: int, held: bool = False) -> str:
        name = self._names.new(wanted)
        line = f"{INDENT}{name} : ARRAY[0..{length - 1}] OF LREAL;"
        (self._held if held else self._scratch).append(line)
        return name

    def _vector(self, wanted: str, values: Sequence[float]) -> str:
        name = self._names.new(wanted)
        self._tables += array(name, [literal(v) for v in values], [len(values)], "LREAL")
        return name

    def _matrix(self, wanted: str, values: Matrix) -> str:
        name, shape = self._names.new(wanted), [len(values), len(values[0])]
        flat = [literal(v) for row in values for v in row]
        self._tables += array(name, flat, shape, "LREAL")
        return name

    def _keep_states(self) -> None:
        self._begun = ""
        if self.routine.keeps:  # one place says where everything begins
            self._begun = self._names.new("begun")
            self._held.append(f"{INDENT}{self._begun} : BOOL;")
            self._resets.append(f"{INDENT}{self._begun} := TRUE;")
        for s in self.routine.states:
            name = self._known[s.name] = self._states[s.name] = self._names.new(s.name)
            self._held.append(f"{INDENT}{name} : LREAL;")
            self._resets.append(f"{INDENT}{name} := {literal(s.initial)};")

    def _clamp_all(self) -> None:
        self._say("outside := FALSE;")
        for a, given in zip(self.routine.arguments, self.inputs):
            low, high = self._names.new(f"{given}_low"), self._names.new(f"{given}_high")
            self._tables += [*number(low, a.low, f"[{a.unit}]"), *number(high, a.high)]
            self._ends[a.name] = given, low, high
            used = self._known[a.name] = self._temporary(f"{given}_used")
            self._say(
                f"{used} := {given};",
                f"IF {given} > {high} THEN",
                f"{INDENT}{used} := {high};",
                f"{INDENT}outside := TRUE;",
                f"ELSIF NOT ({given} >= {low}) THEN",  # also what is not a number
                f"{INDENT}{used} := {low};",
                f"{INDENT}outside := TRUE;",
                "END_IF;",
            )

    # --------------------------------------------------------------------------- expressions

    def _number(self, e: Number) -> str:
        """A number by its name where it has one."""
        if not e.name or e.value == 0.0:
            return literal(e.value)
        if (e.name, e.value) not in self._constants:
            self._constants[e.name, e.value] = name = self._names.new(e.name)
            self._tables += number(name, e.value)
        return self._constants[e.name, e.value]

    def _say(self, *lines: str) -> None:
        for line in lines:
            within = (len(line) - len(line.lstrip())) // len(INDENT)
            self._body += wrapped(line.lstrip(), self._depth + within)

    def _text(self, e: Expression, level: int = _ALONE) -> str:
        """An expression; in parentheses where it binds less than ``level``.

        A choice becomes a statement that stands before, so that only one side is computed.
        """
        match e:
            case Number():
                text = self._number(e)
                own = _ALONE if text.startswith("-") else _ATOM
            case Name():
                text, own = self._known[e.name], _ATOM
            case Item():
                text, own = f"{self._known[e.name]}[{e.index}]", _ATOM
            case Unary(function="neg"):
                text, own = f"-{self._text(e.x, _ATOM)}", _ALONE
            case Unary():
                text, own = f"{_CALLS[e.function]}({self._text(e.x)})", _ATOM
            case Binary() if e.function in _LEVELS:
                own = _LEVELS[e.function]
                # the order of a sum is part of its result: the right side is kept together
                text = f"{self._text(e.a, own)} {e.function} {self._text(e.b, own + 1)}"
            case Binary():
                text = f"{_CALLS[e.function]}({self._text(e.a)}, {self._text(e.b)})"
                own = _ATOM
            case Choose():
                text, own = self._temporary("chosen"), _ATOM
                self._assign(text, e)
            case _:
                raise TypeError(e)
        return text if own >= level else f"({text})"

    def _assign(self, target: str, e: Expression) -> None:
        if isinstance(e, Choose):
            self._branch(target, e)
        else:
            self._say(f"{target} := {self._text(e)};")

    def _side(self, e: Expression) -> str:
        return self._text(e, 1)

    # ---------------------------------------------------------------------------- statements

    def _let(self, s: Let) -> None:
        name = self._temporary(s.name)
        self._assign(name, s.value)
        self._known[s.name] = name

    def _counter(self, wanted: str) -> str:
        if wanted not in self._counters:
            self._counters[wanted] = self._temporary(wanted, "DINT")
        return self._counters[wanted]

    def _layer(self, s: Layer) -> None:
        taken = self._inputs_of(s)
        weights = self._matrix(f"{s.name}_weights", s.weights)
        biases = self._vector(f"{s.name}_biases", s.biases)
        z, out = self._temporary(f"{s.name}_sum"), self._list(s.name, len(s.biases))
        i, j = self._counter("i"), self._counter("j")
        self._say(
            f"FOR {i} := 0 TO {len(s.biases) - 1} DO",
            f"{INDENT}{z} := {biases}[{i}];",
            f"{INDENT}FOR {j} := 0 TO {len(s.inputs) - 1} DO",
            f"{INDENT * 2}{z} := {z} + {weights}[{i}, {j}] * {taken}[{j}];",
            f"{INDENT}END_FOR;",
            *(INDENT + line for line in self._activated(s, z, f"{out}[{i}]")),
            "END_FOR;",
        )
        self._known[s.name] = out

    def _inputs_of(self, s: Layer) -> str:
        """The array that holds the inputs: that of the layer before, or a new one."""
        if known := self._array_of(s.inputs):
            return known
        taken = self._list(f"{s.name}_inputs", len(s.inputs))
        for k, e in enumerate(s.inputs):
            self._assign(f"{taken}[{k}]", e)
        return taken

    def _activated(self, s: Layer, z: str, out: str) -> list[str]:
        if s.activation == "relu":
            return [f"{out} := MAX({z}, 0.0);"]
        if s.activation == "linear":
            return [f"{out} := {z};"]
        # The language has no hyperbolic tangent; this way round the exponential cannot overflow.
        e = self._temporary(f"{s.name}_exp")
        return [
            f"{e} := EXP(-2.0 * ABS({z}));",
            f"{out} := (1.0 - {e}) / (1.0 + {e});",
            f"IF {z} < 0.0 THEN",
            f"{INDENT}{out} := -{out};",
            "END_IF;",
        ]

    def _solve(self, s: Solve) -> None:
        place, target = self._temporary(s.name), self._temporary(f"{s.name}_target")
        low, high = self._temporary(f"{s.name}_low"), self._temporary(f"{s.name}_high")
        k = self._counter("k")
        self._assign(target, s.target)
        self._say(f"{low} := {literal(s.low)};", f"{high} := {literal(s.high)};")
        self._say(f"FOR {k} := 1 TO {s.halvings} DO", f"{INDENT}{place} := 0.5 * ({low} + {high});")
        self._halve(s, (place, target, low, high))
        self._say("END_FOR;", f"{place} := 0.5 * ({low} + {high});")

    def _filter(self, s: Filter) -> None:
        """The inputs of ``delay + 2`` samples go round in an array; the oldest acts ``late``."""
        n, size = len(s.output), s.delay + 2
        x, step = self._list(f"{s.name}_x", n, held=True), self._list(f"{s.name}_step", n)
        line, at = self._list(f"{s.name}_line", size, held=True), self._names.new(f"{s.name}_at")
        self._held.append(f"{INDENT}{at} : DINT;")
        out, late, soon = (
            self._vector(f"{s.name}_{word}", values)
            for word, values in (("output", s.output), ("late", s.late), ("soon", s.soon))
        )
        change, y = self._matrix(f"{s.name}_change", s.change), self._temporary(s.name)
        i, j = self._counter("i"), self._counter("j")
        for name, length in ((x, n), (line, size)):
            self._resets += [
                f"{INDENT}FOR {i} := 0 TO {length - 1} DO",
                f"{INDENT * 2}{name}[{i}] := 0.0;",
                f"{INDENT}END_FOR;",
            ]
        self._resets.append(f"{INDENT}{at} := 0;")
        self._assign(f"{line}[{at}]", s.drive)
        oldest, acting = f"{line}[({at} + 1) MOD {size}]", f"{line}[({at} + 2) MOD {size}]"
        self._say(
            f"{y} := {literal(s.direct)} * {line}[{at}];",
            f"FOR {i} := 0 TO {n - 1} DO",
            f"{INDENT}{y} := {y} + {out}[{i}] * {x}[{i}];",
            f"{INDENT}{step}[{i}] := {late}[{i}] * {oldest} + {soon}[{i}] * {acting};",
            f"{INDENT}FOR {j} := 0 TO {n - 1} DO",
            f"{INDENT * 2}{step}[{i}] := {step}[{i}] + {change}[{i}, {j}] * {x}[{j}];",
            f"{INDENT}END_FOR;",
            "END_FOR;",
            f"FOR {i} := 0 TO {n - 1} DO",
            f"{INDENT}{x}[{i}] := {x}[{i}] + {step}[{i}];",
            "END_FOR;",
            f"{at} := ({at} + 1) MOD {size};",
        )
        self._known[s.name] = y


def described(a: Argument) -> str:
    """Unit, meaning and range of an argument."""
    kind = "range of the logs" if a.recorded else "not recorded, derived"
    return f"[{a.unit}] {a.about}; {a.low + 0.0:.9g} to {a.high:.9g} ({kind})"
