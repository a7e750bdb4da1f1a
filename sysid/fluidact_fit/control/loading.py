"""Parameter files with the families of the registry, and the object a controller uses."""

from __future__ import annotations

import os
from collections.abc import Collection

from ..arguments import require
from ..block import Block
from ..errors import StrictError
from ..families import get_family
from ..parameters import ParameterDocument
from ..parameters import read_document as _read
from ..simulation import simulate_given


def read_document(path: str | os.PathLike[str]) -> ParameterDocument:
    """Read and check a parameter file.

    Raises
    ------
    ParameterFileError
        Naming every problem with its path and line.
    """
    return _read(path, get_family)


def load(
    path: str | os.PathLike[str],
    *,
    accept_failed: bool = False,
    accept_not_identified: bool | Collection[str] = False,
) -> Block:
    """Load a parameter file as the block a controller runs.

    Only the file is read: no log, no code, and nothing the file might point to.

    Parameters
    ----------
    path
        The file.
    accept_failed
        Load it although its verdict is FAIL: the model did not describe its own logs.
    accept_not_identified
        Names of parameters that may be used although the data could not determine them, or
        ``True`` for all.

    Returns
    -------
    Block
        A static map is called with arrays; a dynamic block has ``step``, ``simulate`` and
        ``reset``. All have ``parameters``, ``validity``, ``outside`` and ``not_identified``. An
        input beyond ``validity`` gives one ``ExtrapolationWarning`` per role.

    Raises
    ------
    ParameterFileError
        Naming every problem: what cannot be read, what is missing, and a model that does
        not agree with the parameters beside it.
    StrictError
        When the fit failed and that was not accepted.
    """
    require("truth", accept_failed=accept_failed)
    document = read_document(path)
    block = make_block(document, accept_failed=accept_failed, where=os.fspath(path))
    block.accept(accept_not_identified)
    block.watching = True
    return block


def make_block(
    document: ParameterDocument, *, accept_failed: bool = False, where: str = "the document"
) -> Block:
    """Build the block of a document that has been read.

    Raises
    ------
    StrictError
        When the fit failed and that was not accepted.
    """
    if document.fit.verdict == "fail" and not accept_failed:
        raise StrictError(
            "the fit of this file failed: its model does not describe the logs it was fitted to",
            where=where,
            remedy="Fit again, or load it anyway with load(path, accept_failed=True).",
        )
    family = get_family(document.family)
    block = family.block(family.variant(document.variant), document)
    block.log_simulator = simulate_given
    return block
