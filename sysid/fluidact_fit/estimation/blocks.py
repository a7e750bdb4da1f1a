"""Long records in blocks of rows, of each of which only a triangle is kept.

Least squares depend on the products of columns alone, and the triangle ``R`` of a QR
decomposition has the same products as its table. The triangle of two tables is that of ``R`` of the
first on top of the second [1]_.

References
----------
.. [1] J. Demmel, L. Grigori, M. Hoemmen, J. Langou, "Communication-optimal parallel and
   sequential QR and LU factorizations", SIAM J. Scientific Computing 34(1), 2012.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..experiment import Array, FloatArray
from ..rows import blocks, side_by_side


def rows_of(
    columns: Sequence[FloatArray], mean: FloatArray | None = None, before: int = 0
) -> Iterator[FloatArray]:
    """Iterate over blocks of rows of a table that is never made whole.

    Parameters
    ----------
    columns
        Its columns, shapes ``(n,)`` or ``(n, c)``, from left to right.
    mean
        Subtracted from every row.
    before
        Number of preceding rows that a block includes, as far as there are any.
    """
    for at in blocks(len(columns[0])):
        rows = slice(max(at.start - before, 0), at.stop)
        block = side_by_side(*(x[rows] for x in columns))
        yield block if mean is None else block - mean


def joined(tables: Sequence[Array]) -> Array:
    """All tables, one below the other; without a copy where there is one."""
    return tables[0] if len(tables) == 1 else np.concatenate(tables)


def condense(tables: Iterable[FloatArray]) -> FloatArray:
    """Rows with the same products of columns as all tables, one below the other.

    Parameters
    ----------
    tables
        Of shape ``(n_i, c)``, one after the other. A single one is returned as it is.

    Returns
    -------
    (m, c), with ``m`` at most ``c`` for several tables.
    """
    each = iter(tables)
    found, second = next(each), next(each, None)
    if second is None or not found.shape[1]:
        return found
    found = _triangle(found, second)
    for table in each:
        found = _triangle(found, table)
    return found


def _triangle(above: FloatArray, below: FloatArray) -> FloatArray:
    """Triangle of two tables; :func:`numpy.linalg.qr` takes four times as long."""
    from scipy.linalg.lapack import dgeqrf

    columns = np.concatenate((above.T, below.T), axis=1)  # as LAPACK has them
    return np.triu(dgeqrf(columns.T, overwrite_a=True)[0][: len(columns)])


def condensed(tables: Sequence[FloatArray]) -> FloatArray:
    """`condense` of all rows of some tables."""
    return condense(block for table in tables for block in rows_of([table]))
