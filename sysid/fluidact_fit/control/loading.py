"""From a parameter file to the object a controller holds."""

from __future__ import annotations

import os

from ..errors import ParameterFileError
from ..families import get_family
from ..family import Block, Family, Variant
from ..parameters import ParameterDocument, read_document
from .base import ModelBlock, Port
from .drive import DriveBlock, has_stick_slip
from .dynamic import DynamicBlock, HammersteinBlock
from .section import check_agreement, read_section


def load(path: str | os.PathLike[str]) -> Block:
    """Load a parameter file as the block a controller runs.

    Only the file is read: no log, no code, and nothing the file might point to.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Block
        A static map is called with arrays; a dynamic block (:class:`.ModelBlock`) has
        ``step``, ``simulate``, ``reset``, ``validity`` and ``outside``.

    Raises
    ------
    ParameterFileError
        Naming every problem: what cannot be read, what is missing, and a model that does
        not agree with the parameters beside it.
    """
    return make_block(read_document(path), os.fspath(path))


def make_block(document: ParameterDocument, where: str = "the document") -> Block:
    """Build the block of a document that has been read.

    Raises
    ------
    ParameterFileError
        When its ``model`` part is damaged.
    """
    family = get_family(document.family)
    variant = _variant(document, family)
    own = family.block(variant, document.to_dict())
    return _generic(document, family, variant, where) if own is None else own


def _variant(document: ParameterDocument, family: Family) -> Variant:
    for variant in family.variants:
        if variant.name == document.variant:
            return variant
    names = set(document.parameters)
    return next(
        (v for v in family.variants if names <= {p.name for p in v.parameters}),
        family.variants[0],
    )


def _generic(
    document: ParameterDocument, family: Family, variant: Variant, where: str
) -> ModelBlock:
    """The block that the ``model`` part describes."""
    section = read_section(document, where)
    check_agreement(document, family, variant, where)
    drives = [r for r in variant.roles if r.hold is not None]
    if not drives:
        problem = ("model", f"{family.name} has no input that a block could run from")
        raise ParameterFileError(where, [problem])
    ports = [
        Port(r.name, document.validity[r.name].unit if r.name in document.validity else r.unit)
        for r in (drives[0], variant.output)
    ]
    if has_stick_slip(document):
        return DriveBlock(document, section, *ports)
    kind = DynamicBlock if section.dead_zone is None else HammersteinBlock
    return kind(document, section, *ports)
