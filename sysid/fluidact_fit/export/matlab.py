"""MATLAB, Simulink, dSPACE and Octave: a function that makes the model, and a ``.mat`` file.

No text of the parameter file is evaluated: names come from the specification, numbers are
written by this program, and texts stand as plain signs in quotes or comments.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .flat import flatten, nested
from .target import Job, plain_text

_ACROSS = 6  # numbers on a line
_LINEAR = ("continuous", "discrete")  # which become transfer functions
# Where the units of some numbers stand
_UNITS = {"parameters": "units", "std_errors": "units", "validity": "validity_units"}
_HEADER = 116  # bytes of text at the head of a .mat file


def write(job: Job) -> dict[str, bytes]:
    """Return ``NAME.m`` and ``NAME.mat``."""
    content = _content(job)
    text = "\n".join(_function(job, content)) + "\n"
    return {f"{job.name}.m": text.encode("ascii"), f"{job.name}.mat": _mat(job.name, content)}


def _content(job: Job) -> dict[str, Any]:
    """Everything that both files hold: numbers, lists of them, texts, and mappings of these."""
    block, document = job.block, job.block.document
    entries = document.parameters
    errors = {n: e.std_error for n, e in entries.items() if e.std_error is not None}
    found: dict[str, Any] = {
        "family": block.family,
        "verdict": block.verdict,
        "remarks": list(job.remarks),
        **({"origin": job.origin.to_dict()} if job.origin else {}),
        "parameters": {name: e.value for name, e in entries.items()},
        "units": {name: plain_text(e.unit) for name, e in entries.items()},
        "status": {name: str(e.status) for name, e in entries.items()},
        "std_errors": errors,
        "validity": {r: [v.low, v.high] for r, v in block.validity.items()},
        "validity_units": {r: plain_text(v.unit) for r, v in block.validity.items()},
    }
    if document.covariance is not None:
        order = [_from_one(name) for name in document.covariance.order]
        found["covariance"] = {"order": order, "matrix": document.covariance.matrix}
    return found | nested(  # model, options and offset
        (entry.key, entry.value)
        for entry in flatten(block)
        if not entry.parameter and not entry.key.startswith("validity.")
    )


def _from_one(name: str) -> str:
    """Name of a number as MATLAB counts: ``weights_1[0][2]`` is ``weights_1(1,3)``."""
    word, *indices = re.findall(r"\w+", name)
    return f"{word}({','.join(str(int(i) + 1) for i in indices)})" if indices else word


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


# ----------------------------------------------------------------------------- .mat


def _mat(name: str, content: Mapping[str, Any]) -> bytes:
    """Return a version 5 file with one struct, named like the file."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    savemat(buffer, {name: _held(content)}, format="5", long_field_names=True, oned_as="row")
    # scipy writes the platform and the time there: the same input shall give the same file
    head = b"MATLAB 5.0 MAT-file, written by fluidact-fit".ljust(_HEADER)
    return head + buffer.getvalue()[_HEADER:]


def _held(value: Any) -> Any:
    """A value as MATLAB holds it: numbers two-dimensional and double, a row of a cell array."""
    if isinstance(value, Mapping):
        return {key: _held(part) for key, part in value.items()}
    if isinstance(value, str):
        return value
    if _are_texts(value):
        cells = np.empty((1, len(value)), dtype=object)
        cells[0, :] = value
        return cells
    return np.atleast_2d(np.asarray(value, dtype=float))


# ------------------------------------------------------------------------------- .m


def _function(job: Job, content: Mapping[str, Any]) -> Iterator[str]:
    block, name = job.block, job.name
    yield f"function model = {name}()"
    yield f"% {name.upper()}  Model of the family {block.family}, written by fluidact-fit, in SI."
    yield f"%   Verdict of the fit: {block.verdict}."
    if job.origin:
        yield from (f"%   {line}" for line in job.origin.lines())
    yield from (f"%   {remark}" for remark in job.remarks)
    for key, value in content.items():
        if key not in _LINEAR:
            yield from _assignments(f"model.{key}", value, content.get(_UNITS.get(key, ""), {}))
    yield from _linear(content)
    yield "end"


def _assignments(place: str, value: Any, units: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a value, numbers with their unit behind."""
    if not isinstance(value, Mapping):
        unit = units.get(place.rpartition(".")[2], "1")
        yield f"  {place} = {_value(value)};{f'  % {unit}' if unit != '1' else ''}"
        return
    for key, part in value.items():
        yield from _assignments(f"{place}.{key}", part, units)


def _linear(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the transfer functions of a linear model; nothing for another."""
    if "numerator" not in content.get("continuous", {}):
        return
    if any(name.startswith("dead_zone") for name in content["parameters"]):
        yield "  % The dead zone stands before the transfer functions."
    yield "  if exist('OCTAVE_VERSION', 'builtin')"
    yield "    pkg('load', 'control');"
    yield "  end"
    yield f"  model.dead_time = {_value(content['continuous']['dead_time'])};  % s"
    yield f"  model.continuous = tf({_coefficients(content['continuous'])});"
    yield "  model.state_space = ss(model.continuous);"
    yield "  if ~exist('OCTAVE_VERSION', 'builtin')  % the models of Octave have no dead time"
    yield "    model.continuous.InputDelay = model.dead_time;"
    yield "    model.state_space.InputDelay = model.dead_time;"
    yield "  end"
    discrete = content.get("discrete", {})
    if "numerator" in discrete:
        yield "  % Exact for an input that is held; the dead time is in the numerator."
        period = _value(discrete["sample_time"])
        yield f"  model.discrete = tf({_coefficients(discrete)}, {period});"


def _coefficients(part: Mapping[str, Any]) -> str:
    return ", ".join(_value(part[key]) for key in ("numerator", "denominator"))


def _value(value: Any) -> str:
    """A text, a row of texts, or numbers with all the digits that a float64 has."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{plain_text(value)}'"
    if not isinstance(value, list):
        return repr(float(value))
    if _are_texts(value):
        return "{" + ", ".join(_broken([_value(text) for text in value])) + "}"
    rows = value if isinstance(value[0], list) else [value]
    joined = (", ".join(_broken([repr(float(v)) for v in row])) for row in rows)
    return "[" + "; ...\n    ".join(joined) + "]"


def _broken(numbers: Sequence[str]) -> Iterator[str]:
    """Yield numbers, a new line before some."""
    for i, number in enumerate(numbers):
        yield f"...\n    {number}" if i and i % _ACROSS == 0 else number
