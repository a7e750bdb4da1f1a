"""A parameter file as a controller's list of keys: one level of numbers, with their units.

Targets that know no matrices and no texts are made from it, and the list of a controller is
compared with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ..block import Block
from ..experiment import FloatArray
from ..families import get_family
from ..options import describe
from ..parameters.document import Parameter
from ..specification import ParameterSpec
from .target import Code, Entry, Job, Plain, plain_text, with_ranges


def flatten(block: Block) -> list[Entry]:
    """Return parameters, model, options and validity of a block as a flat list."""
    return [*parameters_of(block), *_model(block), *_options(block), *_validity(block)]


def nested(entries: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Keys with dots as maps within maps."""
    top: dict[str, Any] = {}
    for key, value in entries:
        *path, last = key.split(".")
        place = top
        for word in path:
            place = place.setdefault(word, {})
        place[last] = value
    return top


def code_of(job: Job) -> Code:
    """Everything that a controller calls of a block, and its parameters."""
    block = job.block
    routines, left_out = with_ranges(job.file, block.routines())
    return Code(
        job.name, job.file, block.family, routines, job.arithmetic, (*job.remarks, *left_out),
        tuple(parameters_of(block)), f"Verdict of the fit: {block.verdict}.",
        (job.origin,) if job.origin else (),
    )  # fmt: skip


def _known_how(parameter: Parameter) -> str:
    """Origin of a parameter's value: its status and its standard error, if it has one."""
    words = parameter.status.replace("_", " ")
    error = parameter.std_error
    return f"{words}, standard error {error:.3g}" if isinstance(error, float) else words


def parameters_of(block: Block) -> Iterator[Entry]:
    """Yield the parameters of a block, matrices with their shape."""
    for name, value in block.parameters.items():
        spec, found = block.variant.parameter(name), block.document.parameters[name]
        numbers = np.asarray(value, dtype=float)
        yield _entry(spec, numbers, found.unit, _known_how(found))
        if numbers.ndim == 2:
            for word, count in zip(("rows", "columns"), numbers.shape):
                about = f"{word} of {name}, which is flattened by rows"
                yield Entry(f"{name}_{word}", count, "", about, name)


def _entry(spec: ParameterSpec, numbers: FloatArray, unit: str, how: str) -> Entry:
    flat: Plain = float(numbers) if numbers.ndim == 0 else numbers.ravel().tolist()
    return Entry(
        spec.name, flat, unit, spec.description, spec.name, float(spec.minimum),
        float(spec.maximum), spec.length if spec.rank == 1 else None, numbers.shape, how,
    )  # fmt: skip


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
        value = getattr(options, option.keyword)
        if value is None or (isinstance(value, str) and plain_text(value) != value):
            continue  # a text that another language might take for more stays in the metadata
        plain: Plain = [float(v) for v in value] if option.kind == "range" else value
        key = f"options.{option.keyword}"
        yield Entry(key, plain, option.unit, option.help)


def _validity(block: Block) -> Iterator[Entry]:
    for role, covered in block.validity.items():
        for end, about in (("low", "lowest"), ("high", "highest")):
            number = float(getattr(covered, end))
            words = f"{about} {role} that the fitted logs covered"
            yield Entry(f"validity.{role}.{end}", number, covered.unit, words)
