"""A parameter file as a controller's list of keys: one level of numbers, with their units.

Targets that know no matrices and no texts are made from it, and the list of a controller is
compared with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..block import Block
from ..families import get_family
from ..options import describe
from ..parameters.document import Parameter
from ..specification import ParameterSpec
from .target import plain_text

Plain = float | int | bool | str | list[float]


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
    """

    key: str
    value: Plain
    unit: str
    description: str
    parameter: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    length: int | None = None


def flatten(block: Block) -> list[Entry]:
    """Return parameters, model, options and validity of a block as a flat list."""
    return [*parameters_of(block), *_model(block), *_options(block), *_validity(block)]


def known_how(parameter: Parameter) -> str:
    """How a parameter came to its value: its status and its standard error, if it has one."""
    words = parameter.status.replace("_", " ")
    error = parameter.std_error
    return f"{words}, standard error {error:.3g}" if isinstance(error, float) else words


def parameters_of(block: Block) -> Iterator[Entry]:
    """Yield the parameters of a block, matrices with their shape."""
    for name, value in block.parameters.items():
        spec, unit = block.variant.parameter(name), block.document.parameters[name].unit
        numbers = np.asarray(value, dtype=float)
        flat: Plain = float(numbers) if numbers.ndim == 0 else numbers.ravel().tolist()
        yield _entry(spec, flat, unit)
        if numbers.ndim == 2:
            rows, columns = numbers.shape
            about = f"of {name}, which is flattened by rows"
            yield Entry(f"{name}_rows", rows, "", f"rows {about}", name)
            yield Entry(f"{name}_columns", columns, "", f"columns {about}", name)


def _entry(spec: ParameterSpec, value: Plain, unit: str) -> Entry:
    low, high = float(spec.minimum), float(spec.maximum)
    length = spec.length if spec.rank == 1 else None
    return Entry(spec.name, value, unit, spec.description, spec.name, low, high, length)


def _model(block: Block) -> Iterator[Entry]:
    model = block.document.model
    words = {"continuous": "falling powers of s", "discrete": "rising powers of 1/z"}
    for part, powers in words.items():
        found: Any = model.get(part)
        if found is None:
            continue
        for key in ("numerator", "denominator"):
            if key in found:
                numbers = [float(v) for v in found[key]]
                yield Entry(f"{part}.{key}", numbers, "", f"{key} of the {part} model, {powers}")
        for key, about in (("dead_time", "dead time"), ("sample_time", "sample time")):
            if key in found:
                yield Entry(f"{part}.{key}", float(found[key]), "s", f"{about} of the {part} model")
    if "output_offset" in model:
        about = "output at rest without input, mean over the fitted logs"
        yield Entry("output_offset", block.offset, block.output.unit, about)


def _options(block: Block) -> Iterator[Entry]:
    """Yield what the fit settled and the user gave: areas, masses, choices."""
    kind = get_family(block.family).options_type
    options = block.document.settled_options(kind)
    for option in describe(kind, every=True):
        value = getattr(options, option.name.replace("-", "_"))
        if value is None or (isinstance(value, str) and plain_text(value) != value):
            continue  # a text that another language might take for more stays in the metadata
        plain: Plain = [float(v) for v in value] if option.kind == "range" else value
        key = f"options.{option.name.replace('-', '_')}"
        yield Entry(key, plain, option.unit, option.help)


def _validity(block: Block) -> Iterator[Entry]:
    for role, covered in block.validity.items():
        for end, about in (("low", "lowest"), ("high", "highest")):
            number = float(getattr(covered, end))
            words = f"{about} {role} that the fitted logs covered"
            yield Entry(f"validity.{role}.{end}", number, covered.unit, words)
