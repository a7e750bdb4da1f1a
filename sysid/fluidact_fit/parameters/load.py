"""Parameter files in and out.

A file that is read has to agree with itself: a parameter changed by hand would otherwise leave
a controller with the old model.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeGuard, get_args

import numpy as np

from ..arguments import require
from ..errors import FluidactError, ParameterFileError, shortened
from ..experiment import Hold
from ..specification import Described, entry_name, propagate
from .atomic import write_atomically
from .document import ParameterDocument
from .problems import Location, Problems, format_path
from .validation import Lookup, validate
from .version import check_version, is_newer
from .yaml_io import YamlText, dump_yaml, parse_yaml, read_yaml, to_plain

Problem = tuple[Location, str]
CONTROLLER_FORMAT = "fluidact-controller"  # of the files that ``control`` reads

# Suffixes by which a log is recognised where a parameter file was expected.
_LOGS = {
    ".csv", ".tsv", ".txt", ".dat", ".xlsx", ".ods", ".mat", ".h5", ".hdf5", ".parquet", ".feather",
    ".npz", ".tdms", ".mcap", ".bag", ".mf4", ".asc", ".lvm", ".gz", ".zip",
}  # fmt: skip
_FIT_IT = (
    "Fit the log first: fluidact-fit inspect shows with which command. The parameter file (.yaml) "
    "that the fit writes is what to give here."
)
_REMEDY = "Correct these, or fit again and use the new file."
_CHANGED = "One of the two was changed by hand. Fit again with --fix NAME=VALUE instead."
_BY_COVARIANCE = ("wald", "wald-log", "profile")  # methods of intervals
_SAME = 1e-4  # relative; an edited parameter shows, one rounded to six digits does not
_SMALL = 1e-9  # of the largest number of a list
_LEAST = 1e-150  # an error whose square is no number any more
_DETAILS = 20  # lines
_ONE = len(dump_yaml({"key": 0}).splitlines())  # lines of a text with a single entry
_ALIKE = 0.05  # relative; an error may be rounded to two digits


def read_document(path: str | os.PathLike[str], lookup: Lookup) -> ParameterDocument:
    """Read and check a parameter file; ``lookup`` finds a family by name.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    require("path", path=path)
    where = os.fspath(path)
    try:
        text = read_yaml(path)
    except ParameterFileError as error:
        if Path(path).suffix.lower() in _LOGS and os.path.isfile(path):
            raise ParameterFileError(where, [("", "looks like a log")], _FIT_IT) from error
        raise
    return _read(text, lookup, where)


def parse_document(text: str, lookup: Lookup, where: str = "the document") -> ParameterDocument:
    """Read a parameter document from text, as :func:`read_document` does from a file."""
    return _read(parse_yaml(text, where), lookup, where)


def make_document(
    document: Mapping[str, Any], lookup: Lookup, where: str = "the document"
) -> ParameterDocument:
    """Check a document held in memory.

    Numpy scalars and arrays, tuples, ``Quantity`` and ``Notice`` are converted; keys
    whose value is ``None`` are left out.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path.
    """
    return _check(YamlText(to_plain(document), Problems(), {}), lookup, where)


def dump_document(document: ParameterDocument) -> str:
    """Return a document as the text of a parameter file.

    Of the details of the fit the file has those that take a line each, ``_DETAILS`` at most; the
    document has all of them.
    """
    plain = document.to_dict()
    details = plain["fit"].get("details") or {}
    short = {k: v for k, v in details.items() if len(dump_yaml({k: v}).splitlines()) == _ONE}
    plain["fit"]["details"] = {k: short[k] for k in list(short)[:_DETAILS]} or None
    return dump_yaml(plain)


def save_document(
    document: ParameterDocument,
    path: str | os.PathLike[str],
    overwrite: bool = False,
    inputs: Iterable[str | os.PathLike[str]] = (),
) -> Path:
    """Write a parameter file, whole or not at all, and never over one of its ``inputs``.

    Raises
    ------
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    text = dump_document(document)
    return write_atomically(path, text, overwrite=overwrite, inputs=inputs)


def _read(text: YamlText, lookup: Lookup, where: str) -> ParameterDocument:
    document = _check(text, lookup, where)
    check_agreement(document, lookup(document.family), where)
    return document


def _refuse_controller(data: Mapping[str, Any], where: str) -> None:
    if data.get("format") == CONTROLLER_FORMAT:
        raise ParameterFileError(
            where,
            [("", "is a controller file, not a parameter file")],
            "Give it with --controller, and name the parameter files of the machine instead of it.",
        )


def _check(text: YamlText, lookup: Lookup, where: str) -> ParameterDocument:
    _refuse_controller(text.data, where)
    # What a newer version calls a problem is unknown here: nothing else is worth saying.
    check_version(text.data, text.problems)
    document = None if is_newer(text.data) else validate(text.data, text.problems, lookup)
    if document is None:
        raise ParameterFileError(where, text.problems.listed(text.lines), _REMEDY)
    return document


def check_agreement(
    document: ParameterDocument, family: Described, where: str = "the document"
) -> None:
    """Compare the ``model`` part of a valid document with the one that its parameters give.

    So are the derived numbers that follow from the parameters; standard errors are compared with
    the covariance.

    Raises
    ------
    ParameterFileError
        Naming every place that disagrees.
    """
    wrong = [
        *_strange_model(document, family),
        *_strange_offset(document, family),
        *_strange_errors(document),
        *_strange_derived(document, family),
    ]
    if wrong:
        raise ParameterFileError(where, [(format_path(p), words) for p, words in wrong], _CHANGED)


def _strange_model(document: ParameterDocument, family: Described) -> Iterator[Problem]:
    """Yield where the ``model`` part is not what the parameters give, its offset aside."""
    discrete = document.model.get("discrete")
    settings = {"sample_time": 0.0, "hold": "zoh"} if discrete is None else discrete
    here = ("model", "discrete")
    if not isinstance(settings, Mapping):
        yield here, "is not a mapping"
        return
    step: Any = settings.get("sample_time")
    hold: Any = settings.get("hold")
    if not _is_number(step) or (discrete is not None and step <= 0.0):
        yield (*here, "sample_time"), f"{shortened(repr(step), 60)} is not a positive number"
    elif hold not in get_args(Hold):
        yield (*here, "hold"), f"{shortened(repr(hold), 60)} is not known"
    else:
        try:
            due = family.model(document.plant(family), float(step), hold)
        except (FluidactError, ArithmeticError, ValueError) as error:
            yield ("model",), f"cannot be made from the parameters: {error}"
            return
        model = {key: part for key, part in document.model.items() if key != "output_offset"}
        yield from disagreements(model, due, ("model",))


def _strange_offset(document: ParameterDocument, family: Described) -> Iterator[Problem]:
    """Yield what is wrong with the output at rest, which is a mean over the fitted logs."""
    place, found = ("model", "output_offset"), document.model.get("output_offset")
    offsets = [log.offset.value for log in document.fit.logs if log.offset is not None]
    if not family.steady_offset or not offsets:
        if found is not None:
            yield place, "unknown key"
    elif found is None:
        yield place, "missing"
    elif not _is_number(found):
        yield place, f"{shortened(repr(found), 60)} is not a number"
    else:
        low, high = min(offsets), max(offsets)
        slack = _SAME * max(abs(low), abs(high))
        if not low - slack <= found <= high + slack:
            words = f"{found!r} does not agree with the offsets of the logs"
            yield place, f"{words}, {low:.6g} to {high:.6g}"


def _strange_errors(document: ParameterDocument) -> Iterator[Problem]:
    """Yield standard errors that are not the roots of the variances in the covariance."""
    if document.covariance is None:
        if any(p.method in _BY_COVARIANCE for p in document.parameters.values()):
            yield ("covariance",), "missing, and the standard errors come from it"
        return
    spread = dict(zip(document.covariance.order, np.sqrt(np.diag(document.covariance.matrix))))
    for name, entry in document.parameters.items():
        if entry.std_error is None:
            continue
        for index, error in np.ndenumerate(np.asarray(entry.std_error, dtype=float)):
            due = spread.get(entry_name(name, index), error)
            if abs(error - due) > _ALIKE * due + _LEAST:
                words = f"{float(error)!r} does not agree with the covariance, {due:.6g}"
                yield ("parameters", name, "std_error", *index), words


def _strange_derived(document: ParameterDocument, family: Described) -> Iterator[Problem]:
    """Yield derived numbers, and errors of them, that are not those of the parameters."""
    options = document.settled_options(family.options_type)
    values: Mapping[str, Any] = document.values()
    order, matrix = [], np.zeros((0, 0))
    if document.covariance is not None and set(document.covariance.order) <= values.keys():
        order, matrix = document.covariance.order, np.array(document.covariance.matrix)
    try:
        due = propagate(lambda v: family.derived(v, options), values, order, matrix)
    except (FluidactError, ArithmeticError, ValueError) as failure:
        yield ("derived",), f"cannot be made from the parameters: {failure}"
        return
    for name in due.keys() & document.derived.keys():
        (value, error), entry = due[name], document.derived[name]
        place = ("derived", name)
        slack = _ALIKE * max(error or 0.0, _LEAST)
        yield from disagreements(entry.value, value, (*place, "value"), slack)
        if error and _is_number(entry.std_error) and abs(entry.std_error - error) > slack:
            words = f"{entry.std_error!r} does not agree with the covariance, which gives"
            yield (*place, "std_error"), f"{words} {error:.6g}"


def disagreements(
    found: Any, due: Any, place: Location = (), slack: float = 0.0
) -> Iterator[Problem]:
    """Yield every place where a part lacks something, has another value, or something more.

    A list is one place; its numbers may be off by a ``slack``, a small part of its largest.
    """
    if isinstance(due, Mapping) and isinstance(found, Mapping):
        for key, value in due.items():
            if key in found:
                yield from disagreements(found[key], value, (*place, key))
            else:
                yield (*place, key), "missing"
        for key in found.keys() - due.keys():
            yield (*place, key), "unknown key"
        return
    if isinstance(due, (list, tuple)):
        slack = _SMALL * max((abs(v) for v in due if _is_number(v)), default=0.0)
        same = isinstance(found, (list, tuple)) and len(found) == len(due)
        same = same and not any(any(disagreements(*pair, (), slack)) for pair in zip(found, due))
    elif _is_number(due):
        same = _is_number(found) and abs(found - due) <= _SAME * abs(due) + slack
    else:
        same = found == due
    if not same:
        numbers = _is_number(found) and _is_number(due)
        said = f"{found!r} does" if numbers else "does"
        given = f", which give {due!r}" if numbers else ""
        yield place, f"{said} not agree with the parameters{given}"


def _is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a number that a float can hold."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and abs(value) <= sys.float_info.max
