"""MATLAB, Simulink, dSPACE and Octave: a function that makes the model, and a ``.mat`` file.

No text of the parameter file is evaluated: names come from the specification, numbers are
written by this program, and texts stand as plain signs in quotes or comments.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..specification import Value
from .flat import flatten
from .target import Entry, Job, plain_text

_ACROSS = 6  # numbers on a line
_HEADER = 116  # bytes of text at the head of a .mat file


def write(job: Job) -> dict[str, bytes]:
    """Return ``NAME.m`` and ``NAME.mat``."""
    text = "\n".join(_function(job)) + "\n"
    return {f"{job.name}.m": text.encode("ascii"), f"{job.name}.mat": _mat(job)}


# ----------------------------------------------------------------------------- .mat


def _mat(job: Job) -> bytes:
    """Return a version 5 file with one struct, named like the file."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {job.name: _content(job)}, format="5", long_field_names=True, oned_as="row")
    # scipy writes the platform and the time there: the same input shall give the same file
    head = b"MATLAB 5.0 MAT-file, written by fluidact-fit".ljust(_HEADER)
    return head + buffer.getvalue()[_HEADER:]


def _content(job: Job) -> dict[str, Any]:
    block, document = job.block, job.block.document
    entries = document.parameters
    errors = {n: e.std_error for n, e in entries.items() if e.std_error is not None}
    found: dict[str, Any] = {
        "family": block.family,
        "verdict": block.verdict,
        "remarks": _texts(job.remarks),
        **({"origin": job.origin.to_dict()} if job.origin else {}),
        "parameters": {name: _numbers(e.value) for name, e in entries.items()},
        "units": {name: plain_text(e.unit) for name, e in entries.items()},
        "status": {name: str(e.status) for name, e in entries.items()},
        "std_errors": {name: _numbers(error) for name, error in errors.items()},
        "validity": {r: np.array([[v.low, v.high]]) for r, v in block.validity.items()},
        "validity_units": {r: plain_text(v.unit) for r, v in block.validity.items()},
    }
    if document.covariance is not None:
        matrix = np.array(document.covariance.matrix, dtype=float)
        order = [_from_one(name) for name in document.covariance.order]
        found["covariance"] = {"order": _texts(order), "matrix": matrix}
    for key, value in _beside(job):
        _put(found, key, value if isinstance(value, str) else _numbers(value))
    return found


def _beside(job: Job) -> Iterator[tuple[str, Any]]:
    """Yield what stands beside the parameters: model, options and offset."""
    for entry in flatten(job.block):
        if not entry.parameter and not entry.key.startswith("validity."):
            yield entry.key, entry.value


def _from_one(name: str) -> str:
    """Name of a number as MATLAB counts: ``weights_1[0][2]`` is ``weights_1(1,3)``."""
    word, *indices = re.findall(r"\w+", name)
    return f"{word}({','.join(str(int(i) + 1) for i in indices)})" if indices else word


def _put(top: dict[str, Any], key: str, value: Any) -> None:
    *path, last = key.split(".")
    for word in path:
        top = top.setdefault(word, {})
    top[last] = value


def _numbers(value: Any) -> Any:
    """A number, row or matrix as MATLAB holds it: two-dimensional and double."""
    return np.atleast_2d(np.asarray(value, dtype=float))


def _texts(lines: Sequence[str]) -> Any:
    """A row of a cell array."""
    cells = np.empty((1, len(lines)), dtype=object)
    cells[0, :] = list(lines)
    return cells


# ------------------------------------------------------------------------------- .m


def _function(job: Job) -> Iterator[str]:
    block, name = job.block, job.name
    yield f"function model = {name}()"
    yield f"% {name.upper()}  Model of the family {block.family}, written by fluidact-fit, in SI."
    yield f"%   Verdict of the fit: {block.verdict}."
    if job.origin:
        yield from (f"%   {line}" for line in job.origin.lines())
    yield from (f"%   {remark}" for remark in job.remarks)
    yield f"  model.family = {_quoted(block.family)};"
    yield f"  model.verdict = {_quoted(block.verdict)};"
    yield f"  model.remarks = {_cell(job.remarks)};"
    for key, text in (job.origin.to_dict() if job.origin else {}).items():
        yield f"  model.origin.{key} = {_quoted(text)};"
    yield from _quantities(job)
    for role, v in block.validity.items():
        yield f"  model.validity.{role} = {_matrix([v.low, v.high])};  % {plain_text(v.unit)}"
    for key, value in _beside(job):
        if key.partition(".")[0] not in ("continuous", "discrete"):
            yield f"  model.{key} = {_value(value)};"
    yield from _linear(job)
    yield "end"


def _quantities(job: Job) -> Iterator[str]:
    document = job.block.document
    for name, entry in document.parameters.items():
        unit = plain_text(entry.unit)
        yield f"  model.parameters.{name} = {_matrix(entry.value)};  % {unit}"
        yield f"  model.units.{name} = {_quoted(unit)};"
        yield f"  model.status.{name} = {_quoted(entry.status)};"
        if entry.std_error is not None:
            yield f"  model.std_errors.{name} = {_matrix(entry.std_error)};"
    if document.covariance is not None:
        order = [_from_one(name) for name in document.covariance.order]
        yield f"  model.covariance.order = {_cell(order)};"
        yield f"  model.covariance.matrix = {_matrix(document.covariance.matrix)};"


def _linear(job: Job) -> Iterator[str]:
    """Yield the transfer functions of a linear model; nothing for another."""
    entries = {e.key: e for e in flatten(job.block)}
    if "continuous.numerator" not in entries:
        return
    names = [key for key in entries if key.startswith("dead_zone")]
    if names:
        yield "  % The dead zone stands before the transfer functions."
    yield "  if exist('OCTAVE_VERSION', 'builtin')"
    yield "    pkg('load', 'control');"
    yield "  end"
    yield f"  model.dead_time = {_of(entries, 'continuous.dead_time')};  % s"
    yield "  model.continuous = tf(" + _coefficients(entries, "continuous") + ");"
    yield "  model.state_space = ss(model.continuous);"
    yield "  if ~exist('OCTAVE_VERSION', 'builtin')  % the models of Octave have no dead time"
    yield "    model.continuous.InputDelay = model.dead_time;"
    yield "    model.state_space.InputDelay = model.dead_time;"
    yield "  end"
    if "discrete.numerator" in entries:
        yield "  % Exact for an input that is held; the dead time is in the numerator."
        period = _of(entries, "discrete.sample_time")
        yield f"  model.discrete = tf({_coefficients(entries, 'discrete')}, {period});"


def _of(entries: dict[str, Entry], key: str) -> str:
    return _value(entries[key].value)


def _coefficients(entries: dict[str, Entry], part: str) -> str:
    return ", ".join(_of(entries, f"{part}.{key}") for key in ("numerator", "denominator"))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return _quoted(value) if isinstance(value, str) else _matrix(value)


def _matrix(value: Value) -> str:
    """Numbers with all the digits that a float64 has."""
    if not isinstance(value, list):
        return repr(float(value))
    rows = value if isinstance(value[0], list) else [value]
    joined = (", ".join(_broken([repr(float(v)) for v in row])) for row in rows)
    return "[" + "; ...\n    ".join(joined) + "]"


def _broken(numbers: Sequence[str]) -> Iterator[str]:
    """Yield numbers, a new line before some."""
    for i, number in enumerate(numbers):
        yield f"...\n    {number}" if i and i % _ACROSS == 0 else number


def _quoted(text: str) -> str:
    return f"'{plain_text(text)}'"


def _cell(texts: Sequence[str]) -> str:
    return "{" + ", ".join(_broken([_quoted(text) for text in texts])) + "}"
