"""Input of every export target, and the only way from texts of a file to texts of code."""

from __future__ import annotations

import hashlib
import keyword
import math
import os
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..block import Block
from ..errors import UsageError
from ..routines import Routine
from ..version import __version__

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
# Headers of C: a file of that name beside the others would be included in its place.
_HEADERS = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal
    stdalign stdarg stdatomic stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn
    string tgmath threads time uchar wchar wctype unistd arduino"""
_DEVICES = "con prn aux nul " + " ".join(f"com{i} lpt{i}" for i in range(1, 10))  # of Windows
_TAKEN = {w.lower() for w in (*keyword.kwlist, *keyword.softkwlist)} | {
    *_C.split(), *_ST.split(), *_MATLAB.split(), *_HEADERS.split(), *_DEVICES.split(),
}  # fmt: skip
_NO_FILES = {*_DEVICES.split(), *_HEADERS.split()}
_END = re.compile(r"\.ya?ml$", re.IGNORECASE)
_PLAIN_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
_VERSION = re.compile(r"[0-9][0-9A-Za-z.+-]{0,40}")
_DATE = re.compile(r"\d{4}-\d\d-\d\d(T\d\d:\d\d:\d\d(\.\d{1,9})?(Z|[+-]\d\d:\d\d))?")
_LONGEST_NAME = 48  # MATLAB takes 63, and targets append words to it
_LONGEST_TEXT = 300
# Neither quotes nor brackets of any comment, no escape, no format and nothing that expands.
_UNSAFE = re.compile(r"[^A-Za-z0-9 .,:_+=()/^<>-]")


@dataclass(frozen=True)
class Origin:
    """Origin of an export: the same for the same file, whenever it is made.

    Attributes
    ----------
    file
        Name of the parameter or controller file.
    sha256
        Of its content.
    tool
        What wrote it; empty for a file that is written by hand.
    created
        When, as it says.
    verdict
        Of the fit; empty where there is none.
    """

    file: str
    sha256: str
    tool: str = ""
    created: str = ""
    verdict: str = ""

    def to_dict(self) -> dict[str, str]:
        """All that is known, with what exports it."""
        found = {**asdict(self), "exported_by": f"fluidact-fit {__version__}"}
        return {key: value for key, value in found.items() if value}

    def lines(self) -> tuple[str, ...]:
        """Say it in harmless lines."""
        found = [f"Exported by fluidact-fit {__version__} from {self.file}."]
        if self.tool:
            found.append(
                f"The file was written by {self.tool} at {self.created}, verdict {self.verdict}."
            )
        return (*found, f"SHA-256 of the file: {self.sha256}")


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
    origin
        Where it comes from.
    """

    name: str
    block: Block
    arithmetic: Arithmetic = "float32"
    remarks: tuple[str, ...] = ()
    file: str = ""
    origin: Origin | None = None

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
    origin: tuple[Origin, ...] = ()

    @property
    def origin_lines(self) -> list[str]:
        """Lines that name the origin, safe inside a comment."""
        return [line for origin in self.origin for line in origin.lines()]


Target = Callable[[Job], Mapping[str, bytes]]  # name of a file to its content
ControllerTarget = Callable[[Code], Mapping[str, bytes]]


def make_job(
    path: str | os.PathLike[str], block: Block, arithmetic: Arithmetic = "float32",
    sha256: str = "",
) -> Job:  # fmt: skip
    """Return the job of a block that was loaded from a file, everything in it accepted.

    ``sha256`` is that of the content of the file.
    """
    file = Path(path).name
    remarks = tuple(map(plain_text, remarks_of(block)))
    origin = origin_of(path, sha256, block) if sha256 else None
    return Job(safe_name(file), block, arithmetic, remarks, file_stem(file), origin)


def origin_of(path: str | os.PathLike[str], sha256: str, block: Block | None = None) -> Origin:
    """Return the origin of an export of a file; ``block`` was loaded from it."""
    file = plain_text(Path(path).name)
    if block is None:
        return Origin(file, sha256)
    made = block.document.provenance
    version = made.tool.version if _VERSION.fullmatch(made.tool.version) else "unknown"
    created = made.created if _DATE.fullmatch(made.created) else "an unknown date"
    return Origin(file, sha256, f"fluidact-fit {version}", created, block.verdict)


def sha256_of(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file that has been read."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def with_ranges(name: str, routines: Iterable[Routine]) -> tuple[tuple[Routine, ...], list[str]]:
    """The functions whose arguments have a range, and remarks on those that are left out.

    ``UsageError`` where the first one, which is the model itself, has an argument without.
    """
    kept: list[Routine] = []
    remarks = []
    for r in routines:
        for a in r.arguments:
            if float(np.float32(a.low)) < float(np.float32(a.high)):
                continue
            said = f"{a.name}, whose range is the single value {a.low + 0.0:.9g} {a.unit}"
            if not kept:
                raise UsageError(
                    f"{r.name} of {name} is a function of {said}.",
                    remedy="Fit logs in which it varies, or export the numbers alone: --to json, "
                    "ros2 or matlab.",
                )
            remarks.append(plain_text(f"LEFT OUT: {r.name}, a function of {said}"))
            break
        else:
            kept.append(r)
    return tuple(kept), remarks


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
    plain = _PLAIN_FILE.fullmatch(stem) and stem.lower() not in _NO_FILES
    return stem if plain else safe_name(file)


def renamed(path: str | os.PathLike[str]) -> str:
    """Remark on a name that had to change; empty if it did not."""
    stem = _END.sub("", Path(path).name)
    if stem.lower() not in _TAKEN:
        return ""
    if stem.lower() in _NO_FILES:
        why = "a header of C" if stem.lower() in _HEADERS.split() else "a device of Windows"
        return f"{Path(path).name} is exported as {safe_name(stem)}: {stem} is {why}."
    return f"{Path(path).name}: {stem} is a reserved word, identifiers are {safe_name(stem)}."


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
