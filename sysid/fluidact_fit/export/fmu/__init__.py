"""Functional mock-up units (FMI 2.0, co-simulation), with sources and a library for Linux."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence

from ...block import Block, SteppedBlock
from ...errors import UsageError
from ...specification import scalars
from ..target import Job
from .build import compile_library
from .description import describe
from .maps import add_maps
from .model import Model, Setting, Unit
from .plant import add_plant
from .source import INTERFACE, library, source

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the first time that an archive can tell


def write(job: Job) -> Mapping[str, bytes]:
    """Return ``NAME.fmu``, in which everything is called by the identifier.

    Raises
    ------
    OutputError
        Where there is no C compiler for Linux on x86-64: a unit without a library is not given.
    """
    xml, sources = describe_unit(job)
    files = {"modelDescription.xml": xml}
    files[f"binaries/linux64/{job.name}.so"] = compile_library(job.name, sources)
    files |= {f"sources/{name}": text.encode("ascii") for name, text in sources.items()}
    return {f"{job.file}.fmu": _archive(files)}


def describe_unit(job: Job) -> tuple[bytes, Mapping[str, str]]:
    """Return ``modelDescription.xml`` and the C files by name; nothing is compiled.

    The GUID is that of the content: two units have the same one when they do the same.
    """
    unit = _unit(job)
    headers = {"fmi2_types.h", *INTERFACE, *unit.model.headers}
    sources = {name: library(name) for name in sorted(headers)}
    texts = "\0".join([source(unit, ""), *sources.values()])
    guid = "{" + hashlib.sha256(describe(unit, "") + texts.encode("ascii")).hexdigest() + "}"
    return describe(unit, guid), {f"{job.name}.c": source(unit, guid), **sources}


def _unit(job: Job) -> Unit:
    block, model = job.block, Model()
    add_plant(model, block, job.name)
    routines = block.routines()
    if not model.outputs and any(r.sample_time for r in routines):
        raise UsageError(
            f"no unit can be made of the family {block.family}: a routine of it is called once a "
            "sample, and it holds no continuous model",
            remedy="Take another target.",
        )
    add_maps(model, [r for r in routines if not r.sample_time], job.name)
    about = f"Model of the family {block.family}, verdict of the fit: {block.verdict}"
    period = block.sample_time if isinstance(block, SteppedBlock) else 0.0
    said = (*(job.origin.lines() if job.origin else ()), *job.remarks)
    return Unit(job.name, about, said, model, _constants(block), period)


def _constants(block: Block) -> Sequence[Setting]:
    """Single numbers of the file: to be seen, not to be changed, since code depends on them."""
    return [
        Setting(f"parameters.{name}", block.document.parameters[name].unit,
                block.variant.parameter(name).description, value)
        for name, value in scalars(block.parameters).items()
    ]  # fmt: skip


def _archive(files: Mapping[str, bytes]) -> bytes:
    """A ZIP archive that is the same for the same files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, content)
    return buffer.getvalue()
