"""Whether the ``model`` part of a document is the one that its parameters give."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from ..errors import FluidactError, ParameterFileError
from ..experiment import Hold
from ..specification import Described
from .document import ParameterDocument
from .problems import Location, format_path

_SAME = 1e-4  # relative; an edited parameter shows, one rounded to six digits does not
_SMALL = 1e-9  # of the largest number of a list
_REMEDY = "One of the two was changed by hand. Fit again with --fix NAME=VALUE instead."


def check_agreement(
    document: ParameterDocument, family: Described, where: str = "the document"
) -> None:
    """Compare the ``model`` part with the one the parameters give.

    A parameter changed by hand would otherwise leave a controller with the old model.

    Parameters
    ----------
    document
        The document, valid for the family.
    family
        Its family.
    where
        The file, for the message.

    Raises
    ------
    ParameterFileError
        Naming what disagrees.
    """
    variant = next((v for v in family.variants if v.name == document.variant), family.variants[0])
    discrete = document.model.get("discrete")
    settings = {"sample_time": 0.0, "hold": "zoh"} if discrete is None else discrete
    if not isinstance(settings, Mapping):
        raise ParameterFileError(where, [("model.discrete", "is not a mapping")], _REMEDY)
    step: Any = settings.get("sample_time")
    hold: Any = settings.get("hold")
    if not _is_number(step) or (discrete is not None and step <= 0.0):
        problems = [("model.discrete.sample_time", f"{step!r} is not a positive number")]
    elif hold not in get_args(Hold):
        problems = [("model.discrete.hold", f"{hold!r} is not known")]
    else:
        try:
            options = family.options_type.read(document.options or {}, from_file=True)
            due = family.model(variant, document.values(), options, float(step), hold)
        except (FluidactError, ArithmeticError, ValueError) as error:
            problems = [("model", f"cannot be made from the parameters: {error}")]
        else:
            wrong = disagreements(document.model, due, ("model",))
            problems = [(format_path(place), words) for place, words in wrong]
    if problems:
        raise ParameterFileError(where, problems, _REMEDY)


def disagreements(found: Any, due: Any, place: Location = ()) -> Iterator[tuple[Location, str]]:
    """Yield every place where a part lacks something or has another value.

    What ``found`` holds beyond ``due`` is left alone.
    """
    if isinstance(due, Mapping) and isinstance(found, Mapping):
        for key, value in due.items():
            if key in found:
                yield from disagreements(found[key], value, (*place, key))
            else:
                yield (*place, key), "missing"
    elif not _agree(found, due):
        yield place, "does not agree with the parameters"


def _agree(found: Any, due: Any, slack: float = 0.0) -> bool:
    if isinstance(due, (list, tuple)):
        if not isinstance(found, (list, tuple)) or len(found) != len(due):
            return False
        slack = _SMALL * max((abs(v) for v in due if _is_number(v)), default=0.0)
        return all(_agree(a, b, slack) for a, b in zip(found, due))
    if _is_number(due):
        return _is_number(found) and abs(found - due) <= _SAME * abs(due) + slack
    if isinstance(due, Mapping):
        return isinstance(found, Mapping) and not any(disagreements(found, due))
    return bool(found == due)


def _is_number(value: Any) -> bool:
    """Whether a value is a number that a float can hold."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and abs(value) <= sys.float_info.max
