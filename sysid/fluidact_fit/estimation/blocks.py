"""Long records in blocks of rows: what is kept of each is a triangle, not its rows.

Least squares need no rows: whatever is computed of the columns of a table, be it a solution, a
projection or a sum of squares, depends on the products of its columns alone, and the triangle
``R`` of its QR decomposition has the same products as the table. The triangle of a table of two
parts is that of ``R`` of the first on top of the second [1]_. That is as exact as one
decomposition of all rows, whatever the sizes of the columns; sums of products instead would square
their condition, and lose a parameter that is known to six digits only.

References
----------
.. [1] J. Demmel, L. Grigori, M. Hoemmen, J. Langou, "Communication-optimal parallel and
   sequential QR and LU factorizations", SIAM J. Scientific Computing 34(1), 2012.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..experiment import FloatArray

ROWS = 1 << 15  # rows of a block: what is made of it stays in the cache


def blocks(rows: int) -> Iterator[slice]:
    """Cut a record into blocks; a record no longer than one, or an empty one, is one."""
    for begin in range(0, max(rows, 1), ROWS):
        yield slice(begin, min(begin + ROWS, rows))


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
    waiting: list[FloatArray] = []
    for table in tables:
        waiting.append(table)
        if len(waiting) > 1:
            waiting = [triangle(np.concatenate(waiting))]
    return waiting[0]


def triangle(table: FloatArray) -> FloatArray:
    """``R`` of the QR decomposition of a table, shape ``(min(n, c), c)``."""
    if not np.all(np.isfinite(table)):
        raise np.linalg.LinAlgError("the model gives no finite numbers")
    return np.asarray(np.linalg.qr(table, mode="r"))
