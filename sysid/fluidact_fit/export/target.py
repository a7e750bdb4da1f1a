"""What every export target is given, and the only way from texts of a file to texts of code."""

from __future__ import annotations

import keyword
import math
import os
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ..block import Block
from ..routines import Routine

Arithmetic = Literal["float32", "q15"]
Plain = float | int | bool | str | list[float]

_C = """auto break case char const continue default do double else enum extern float for goto if
    inline int long register restrict return short signed sizeof static struct switch typedef
    union unsigned void volatile while main asm and and_eq bitand bitor bool catch class compl
    constexpr decltype delete explicit export false friend mutable namespace new noexcept not
    not_eq nullptr operator or or_eq private protected public template this throw true try
    typeid typename using virtual wchar_t xor xor_eq"""
_ST = """abs action acos and any array asin at atan bool by byte case concat configuration constant
    cos date dint dt dword else elsif end exit exp expt false find for from function
    function_block if insert int interface interval left len limit lint ln log lreal lword max
    method mid min mod move mux not of on or persistent pointer priority program property read_only
    real ref_to reference repeat replace resource retain return right rol ror shl shr sin single
    sint sqrt step string struct super sel tan task then this time tod to transition true trunc
    type udint uint ulint until usint var while with word wstring xor"""
_MATLAB = """break case catch classdef continue else elseif end for function global if otherwise
    parfor persistent return spmd switch try while do until endfor endfunction endif endswitch
    endwhile end_try_catch end_unwind_protect unwind_protect unwind_protect_cleanup
    tf ss exist pkg model"""
_DEVICES = "con prn aux nul " + " ".join(f"com{i} lpt{i}" for i in range(1, 10))  # of Windows
_TAKEN = {w.lower() for w in (*keyword.kwlist, *keyword.softkwlist)} | {
    *_C.split(), *_ST.split(), *_MATLAB.split(), *_DEVICES.split(),
}  # fmt: skip
_END = re.compile(r"\.ya?ml$", re.IGNORECASE)
_PLAIN_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
_LONGEST_NAME = 48  # MATLAB takes 63, and targets append words to it
_LONGEST_TEXT = 300
# Neither quotes nor brackets of any comment, no escape, no format and nothing that expands.
_UNSAFE = re.compile(r"[^A-Za-z0-9 .,:_+=()/^<>-]")


@dataclass(frozen=True)
class Job:
    """One parameter file on its way to a target.

    Attributes
    ----------
    name
        Made from the name of the file: ASCII letters, digits and underscores, starting with a
        letter; no keyword of C, C++, Structured Text, Python or MATLAB.
    block
        The model. Everything in it has been accepted.
    arithmetic
        ``"q15"`` is fixed point, of the targets that know it.
    remarks
        What was accepted although the fit did not vouch for it: harmless lines that every
        export has to show.
    file
        What the files are called that need no identifier: the name of the parameter file
        where that is harmless, otherwise ``name``.
    """

    name: str
    block: Block
    arithmetic: Arithmetic = "float32"
    remarks: tuple[str, ...] = ()
    file: str = ""

    def __post_init__(self) -> None:
        """Call the files by the identifier where no other name was given."""
        if not self.file:
            object.__setattr__(self, "file", self.name)


@dataclass(frozen=True)
class Entry:
    """A key with its value, as a controller may read it.

    Attributes
    ----------
    key
        Words with dots between levels: ``mass``, ``validity.force.low``.
    value
        [``unit``]; a matrix is flattened by rows, its shape stands in two entries of its own.
    unit
        SI; empty where there is none to speak of.
    description
        What it is, in the words of the specification.
    parameter
        The parameter that it holds; empty for what stands beside the parameters.
    minimum, maximum
        Closed range of the specification, infinite where there is none.
    length
        Length of a list that the specification prescribes.
    shape
        Of the value before it was flattened.
    how
        How a parameter came to its value.
    """

    key: str
    value: Plain
    unit: str
    description: str
    parameter: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    length: int | None = None
    shape: tuple[int, ...] = ()
    how: str = ""


@dataclass(frozen=True)
class Code:
    """Routines on their way to a language that can run them: those of a block or a controller.

    ``title`` says what they are, ``about`` more of that, and ``numbers`` what they were made
    from; the rest is as in :class:`Job`.
    """

    name: str
    file: str
    title: str
    routines: tuple[Routine, ...]
    arithmetic: Arithmetic = "float32"
    remarks: tuple[str, ...] = ()
    numbers: tuple[Entry, ...] = ()
    about: str = ""
    origin: tuple[str, ...] = ()


Target = Callable[[Job], Mapping[str, bytes]]  # name of a file to its content
ControllerTarget = Callable[[Code], Mapping[str, bytes]]


def make_job(path: str | os.PathLike[str], block: Block, arithmetic: Arithmetic = "float32") -> Job:
    """Return the job of a block that was loaded from a file, everything in it accepted."""
    file = Path(path).name
    remarks = tuple(map(plain_text, remarks_of(block)))
    return Job(safe_name(file), block, arithmetic, remarks, file_stem(file))


def remarks_of(block: Block) -> Iterable[str]:
    """Yield what was accepted of a block although the fit does not vouch for it."""
    if block.verdict == "fail":
        yield "VERDICT FAIL: the model did not describe its own logs; exported as accepted"
    for name in block.not_identified:
        yield f"NOT IDENTIFIED: {name} could not be determined from the data; exported as accepted"


def file_stem(file: str) -> str:
    """Return what exports of a file are called: its own name without its end, where harmless.

    Examples
    --------
    >>> file_stem("ball-screw.yaml"), file_stem("a b.yaml"), file_stem("-o.yaml")
    ('ball-screw', 'a_b', 'o')
    """
    stem = _END.sub("", file)
    plain = _PLAIN_FILE.fullmatch(stem) and stem.lower() not in _DEVICES.split()
    return stem if plain else safe_name(file)


def safe_name(file: str) -> str:
    """Return an identifier for a file, the same in every language.

    Examples
    --------
    >>> safe_name("ball-screw.yaml"), safe_name("2nd valve.v3.yaml"), safe_name("while.yaml")
    ('ball_screw', 'p_2nd_valve_v3', 'while_p')
    """
    stem = _END.sub("", file)
    ascii_only = unicodedata.normalize("NFKD", stem).encode("ascii", "ignore").decode()
    # Structured Text allows neither two underscores in a row nor one at an end.
    name = re.sub(r"[^A-Za-z0-9]+", "_", ascii_only).strip("_")
    if not name[:1].isalpha():
        name = f"p_{name}".rstrip("_")
    name = name[:_LONGEST_NAME].rstrip("_")
    taken = name.lower() in _TAKEN or name.lower().startswith(("end_", "var_"))
    return f"{name}_p" if taken else name


def without_reading(routine: Routine) -> str:
    """Say what a careful routine does where there is nothing to compute from."""
    readings = " or ".join(a.name for a in routine.arguments if a.measured)
    beyond = f", or {readings} lies beyond its range" if readings else ""
    then = "the last output stands" if routine.keeps else "the output is none either"
    return f"Where an argument is no number{beyond}, outside is set and {then}."


def plain_text(text: str) -> str:
    """Return a text as one line that is harmless in comments and quotes of any language.

    What is not a plain sign becomes an underscore; quotes, brackets of comments, backslashes,
    question marks (trigraphs) and line ends are not plain.
    """
    plain = _UNSAFE.sub("_", text.replace(";", ","))
    return re.sub(r"/(?=/)", "_", plain)[:_LONGEST_TEXT].strip()
