"""Parameter files in and out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import ParameterFileError
from .agreement import check_agreement
from .atomic import write_atomically
from .document import ParameterDocument
from .migrations import is_newer, migrate
from .plain import to_plain
from .problems import Location, Problems
from .validation import Lookup, validate
from .yaml_io import YamlText, dump_yaml, parse_yaml, read_yaml

_REMEDY = "Correct these, or fit again and use the new file."


def read_document(path: str | os.PathLike[str], lookup: Lookup) -> ParameterDocument:
    """Read, migrate and check a parameter file; ``lookup`` finds a family by name.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    return _read(read_yaml(path), lookup, os.fspath(path))


def parse_document(text: str, lookup: Lookup, where: str = "the document") -> ParameterDocument:
    """Read a parameter document from text, as ``read_document`` does from a file.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
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
    return _check(to_plain(document), Problems(), {}, lookup, where)


def dump_document(document: ParameterDocument) -> str:
    """Return a document as the text of a parameter file."""
    return dump_yaml(document.to_dict())


def save_document(
    document: ParameterDocument, path: str | os.PathLike[str], overwrite: bool = False
) -> Path:
    """Write a parameter file, whole or not at all.

    Raises
    ------
    OutputError
        When the file exists and may not be replaced, or cannot be written.
    """
    return write_atomically(path, dump_document(document), overwrite=overwrite)


def _read(text: YamlText, lookup: Lookup, where: str) -> ParameterDocument:
    document = _check(text.data, text.problems, text.lines, lookup, where)
    check_agreement(document, lookup(document.family), where)
    return document


def _check(
    data: dict[str, Any],
    problems: Problems,
    lines: Mapping[Location, int],
    lookup: Lookup,
    where: str,
) -> ParameterDocument:
    # What a newer version calls a problem is unknown here: nothing else is worth saying.
    migrated = migrate(data, problems)
    document = None if is_newer(data) else validate(migrated, problems, lookup)
    if document is None:
        raise ParameterFileError(where, problems.listed(lines), _REMEDY)
    return document
