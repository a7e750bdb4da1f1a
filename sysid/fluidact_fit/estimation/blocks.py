"""Long records in blocks of rows: what is kept of each is a triangle, not its rows.

Least squares depend on the products of columns alone, and the triangle ``R`` of a QR
decomposition has the same products as its table. The triangle of two tables is that of ``R`` of the
first on top of the second [1]_.

Products of the columns themselves would square their condition. Those of ``B R^-1``, ``B`` being
the next block, do not: with ``R^-T B'B R^-1 + 1 = U'U`` the triangle of both is ``U R`` [2]_. The
condition of the sum is at most its trace, which is kept small.

References
----------
.. [1] J. Demmel, L. Grigori, M. Hoemmen, J. Langou, "Communication-optimal parallel and
   sequential QR and LU factorizations", SIAM J. Scientific Computing 34(1), 2012.
.. [2] T. Fukaya, R. Kannan, Y. Nakatsukasa, Y. Yamamoto, Y. Yanagisawa, "Shifted Cholesky QR for
   computing the QR factorization of ill-conditioned matrices", SIAM J. Scientific Computing
   42(1), 2020.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..experiment import FloatArray
from ..rows import blocks

_APART = 1e-7  # least part of a column that the ones before leave, to divide by a triangle
_SMALL = 900_000  # multiplications up to which BLAS takes a product for small
_GROWN = 1e5  # trace of the sum of products beyond which a new triangle is taken


def rows_of(tables: Sequence[FloatArray]) -> Iterator[FloatArray]:
    """All blocks of some tables."""
    return (table[at] for table in tables for at in blocks(table.shape[0]))


def joined(tables: Sequence[FloatArray]) -> FloatArray:
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

    Raises
    ------
    LinAlgError
        Where there are several, and not all numbers are finite.
    """
    each = iter(tables)
    first, second = next(each), next(each, None)
    if second is None or not first.shape[1]:
        return first
    found = _Condensed(np.concatenate((first, second)))
    for table in each:
        found.add(table)
    return found.triangle


def condensed(tables: Sequence[FloatArray]) -> FloatArray:
    """`condense` of all rows of some tables."""
    return condense(rows_of(tables))


class _Condensed:
    """The triangle of the rows so far, as ``root(products) anchor``."""

    def __init__(self, table: FloatArray) -> None:
        self._take(table)

    def _take(self, table: FloatArray) -> None:
        """Take the triangle of a table."""
        if not np.all(np.isfinite(table)):
            raise np.linalg.LinAlgError("the model gives no finite numbers")
        self.anchor = np.asarray(np.linalg.qr(table, mode="r"))
        c = self.anchor.shape[1]
        self.products = np.eye(self.anchor.shape[0])
        norms = np.linalg.norm(self.anchor, axis=0)
        self.used = norms > 0.0
        rest = np.abs(np.diag(self.anchor))[self.used[: self.anchor.shape[0]]]
        self.inverse: FloatArray | None = None
        if self.anchor.shape[0] == c and np.all(rest > _APART * norms[self.used]):
            # a column of nothing but zeros stays out, as long as it is one
            whole = self.anchor + np.diag(np.where(self.used, 0.0, 1.0))
            self.inverse = np.linalg.inv(whole / np.where(self.used, norms, 1.0))
            self.inverse /= np.where(self.used, norms, 1.0)[:, None]

    @property
    def triangle(self) -> FloatArray:
        """The triangle of all rows."""
        return np.asarray(np.linalg.cholesky(self.products).T @ self.anchor)

    def add(self, table: FloatArray) -> None:
        """Add rows below."""
        if self.inverse is None or np.any(table[:, ~self.used]):
            self._take(np.vstack((self.triangle, table)))
            return
        more = self._turned_products(table)
        trace = float(np.trace(self.products) + np.trace(more))
        if trace < _GROWN:
            self.products += more
        else:  # rows far larger than those before would be lost in the products, or those in them
            self._take(np.vstack((self.triangle, table)))

    def _turned_products(self, table: FloatArray) -> FloatArray:
        """``B'B`` of ``B = table R^-1``, some rows after the other.

        BLAS has fast code for small products of two tables; it takes three times as long for large
        ones, and for what numpy calls where both are the same.
        """
        from scipy.linalg.blas import dgemm

        assert self.inverse is not None
        more = np.zeros_like(self.inverse)
        count = _SMALL // more.size + 1
        for begin in range(0, len(table), count):
            turned = self.inverse.T @ table[begin : begin + count].T
            more += dgemm(1.0, turned.T, turned.T, trans_a=True)
        return more
