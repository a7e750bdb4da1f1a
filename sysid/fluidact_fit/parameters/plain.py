"""Plain data: the dicts, lists, text and numbers that a parameter file can hold."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .problems import Location, Problems

_MAX_KEY = 200  # YAML allows 1024, but a key of that size is a mistake


def to_plain(value: Any) -> Any:
    """Return a value as plain dicts, lists, text and numbers.

    Numpy scalars and arrays, tuples, paths and dataclasses are converted; keys whose
    value is ``None`` are left out. Anything else is returned as it is.
    """
    if isinstance(value, Mapping):
        return {to_plain(k): to_plain(v) for k, v in value.items() if v is not None}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return to_plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, (np.ndarray, np.generic)):
        return to_plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [to_plain(item) for item in value]
    if isinstance(value, Path):
        value = os.fspath(value)
    if isinstance(value, str):
        # File names may carry bytes that are not UTF-8 as lone surrogates; no YAML holds those.
        return str(value).encode("utf-8", "surrogatepass").decode("utf-8", "replace")
    return value


def check_plain(value: Any, problems: Problems, place: Location = ()) -> None:
    """Note everything in a value that a parameter file cannot hold."""
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                problems.add((*place, str(key)), "key is not text")
            elif len(key) > _MAX_KEY:
                problems.add((*place, key), f"key is longer than {_MAX_KEY} characters")
            else:
                check_plain(item, problems, (*place, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            check_plain(item, problems, (*place, index))
    elif value is None:
        problems.add(place, "is empty; give a value or remove the key")
    elif isinstance(value, float) and not math.isfinite(value):
        problems.add(place, f"{value} is not finite")
    elif not isinstance(value, (str, int, float)):
        problems.add(place, f"a {type(value).__name__} cannot stand in a parameter file")
