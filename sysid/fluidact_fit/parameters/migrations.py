"""Older versions of the parameter file, step by step up to the current one."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

from .problems import Problems, find_entries

CURRENT_VERSION = 1


def _from_0(document: dict[str, Any]) -> dict[str, Any]:
    """Version 0, the draft: ``std`` instead of ``std_error``, and no ``status``."""
    for section in ("parameters", "derived"):
        for _, entry in find_entries(document, section, "*"):
            if not isinstance(entry, dict):
                continue
            # The draft wrote a standard error for whatever it had estimated.
            status = "estimated" if "std" in entry else "fixed"
            if "std" in entry and "std_error" not in entry:
                entry["std_error"] = entry.pop("std")
            if section == "parameters":
                entry.setdefault("status", status)
    return document


def _settle_holds(document: dict[str, Any]) -> dict[str, Any]:
    """Early files of version 1 say beside a hold of ``foh`` which curve it stood for.

    Their ``linear`` is called ``foh`` now, and their ``cubic`` ``smooth``.
    """
    names = {"linear": "foh", "cubic": "smooth"}
    for _, column in find_entries(document, "provenance", "logs", "*", "columns", "*"):
        if isinstance(column, dict) and "hold" in column:
            hold = column.pop("interpolation", column["hold"])
            column["hold"] = names.get(hold, hold) if isinstance(hold, str) else hold
    return document


MIGRATIONS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {0: _from_0}


def is_newer(document: Mapping[str, Any]) -> bool:
    """Return whether a document is of a version that this program does not know yet."""
    version = document.get("format_version")
    return type(version) is int and version > CURRENT_VERSION


def migrate(document: Mapping[str, Any], problems: Problems) -> dict[str, Any]:
    """Return a document brought up to the current version; the given one is left alone.

    What cannot be migrated (a version that is missing, no number, or newer than this
    program) is noted in ``problems`` and the document returned as it is.
    """
    version = document.get("format_version")
    migrated = copy.deepcopy(dict(document))
    if version is None:
        words = "missing"
    elif type(version) is not int or version < 0:  # True is an int too
        words = f"{version!r} is not a version; this program reads {CURRENT_VERSION}"
    elif is_newer(document):
        words = f"{version} is newer than this program reads ({CURRENT_VERSION})"
        words += "; upgrade fluidact-fit"
    else:
        for step in range(version, CURRENT_VERSION):
            migrated = MIGRATIONS[step](migrated)
            migrated["format_version"] = step + 1
        return _settle_holds(migrated)
    problems.add(("format_version",), words)
    return migrated
