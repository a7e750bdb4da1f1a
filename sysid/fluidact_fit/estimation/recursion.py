"""Linear recursions over samples in whole arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import ceil

import numpy as np
import numpy.typing as npt

from ..experiment import Array, FloatArray
from ..rows import blocks

_PER_STEP = 20  # parts that begin in the time of a step of all parts side by side


def orbit(start: Array, phi: Array, count: int) -> Array:
    """``start phi**k`` for ``k`` below ``count``, as many again with every product."""
    out = np.empty((count, *start.shape), dtype=np.result_type(start, phi))
    out[0] = start
    have, top = 1, phi
    while have < count:
        more = min(have, count - have)
        np.matmul(out[:more], top, out=out[have : have + more])
        have += more
        if have < count:
            top = top @ top
    return out


def run_recursion(driven: Array, coefficients: npt.ArrayLike) -> Array:
    """``y_k = driven_k + sum_i c_i y_(k-i)``, nothing before the first; samples first.

    ``coefficients`` are of shape ``(q,)``, or ``(q, n)`` where they change: column ``j`` holds
    what sample ``j`` adds to those that follow. A triangular band: this saves the second that
    ``scipy.signal`` takes to be imported, and a general solver is ten times slower.
    """
    from scipy.linalg.blas import dtbsv

    c = np.asarray(coefficients, dtype=float)
    band = np.empty((c.shape[0] + 1, driven.shape[0]), order="F")
    band[0] = 1.0
    band[1:] = -c if c.ndim == 2 else -c[:, None]
    out = np.array(driven, dtype=float, order="F")
    columns = out.reshape(driven.shape[0], -1, order="A").T
    for k, column in enumerate(columns):
        columns[k] = dtbsv(c.shape[0], band, column, lower=1, diag=1)
    return out


def clamped(
    start: float, low: npt.ArrayLike, high: npt.ArrayLike, steps: npt.ArrayLike, count: int
) -> FloatArray:
    """``x_k = min(max(x_(k-1) + steps_k, low_k), high_k)``, shape ``(count,)``; exact.

    A step followed by a clamp, and any number of them one after the other, is again a step
    followed by a clamp. Parts are first taken as one such each, which gives the value that each
    begins with, and then advance side by side.
    """
    width = max(1, ceil((count / _PER_STEP) ** 0.5))  # of a part
    rows = -(-count // width)

    def cut(values: npt.ArrayLike, padding: float) -> FloatArray:
        if np.ndim(values) == 0:
            return np.broadcast_to(np.asarray(values, dtype=float), (width, rows))
        out = np.full(rows * width, padding)
        out[:count] = values
        return out.reshape(rows, width).T

    a, b, c = cut(steps, 0.0), cut(low, -np.inf), cut(high, np.inf)
    step, least, most = np.zeros(rows), np.full(rows, -np.inf), np.full(rows, np.inf)
    for more, lowest, highest in zip(a, b, c, strict=True):
        step += more
        least = np.minimum(np.maximum(least + more, lowest), highest)
        most = np.minimum(np.maximum(most + more, lowest), highest)
    begins, x = [], start
    for more, lowest, highest in zip(step.tolist(), least.tolist(), most.tolist(), strict=True):
        begins.append(x)
        x = min(max(x + more, lowest), highest)
    now = np.array(begins)
    found = np.empty((rows, width))
    for j, (more, lowest, highest) in enumerate(zip(a, b, c, strict=True)):
        found[:, j] = now = np.minimum(np.maximum(now + more, lowest), highest)
    return found.reshape(-1)[:count]


def behind_play(values: FloatArray, width: float) -> FloatArray:
    """``w_k = min(max(w_(k-1), u_k - h/2), u_k + h/2)``, starting at the first value, ``(n,)``."""
    low, high = values - 0.5 * width, values + 0.5 * width
    return clamped(float(values[0]), low, high, 0.0, values.size)


def scan(
    phi: Array, forcing: Callable[[slice], Array], start: Array, count: int
) -> Iterator[tuple[slice, Array]]:
    """Solve ``x[j+1] = phi[j] x[j] + forcing[j]``, block by block.

    Parameters
    ----------
    phi : (n, n) for equal steps, or (count, n, n)
    forcing
        ``forcing(at)``: that of a block of steps, shape ``(m, n)``; a long record never has all.
    start : (n,)
        Complex where a forcing is.
    count
        Number of steps.

    Yields
    ------
    Indices and states of one block after the other, ``(m, n)``: ``count + 1`` states in all,
    beginning with ``start``. A long record needs less memory where they are not kept.
    """
    from scipy.linalg.blas import dtbsv, ztbsv

    n, kind = start.size, np.result_type(phi, start)
    solve = ztbsv if kind.kind == "c" else dtbsv
    band = np.zeros((2 * n, 0))
    for at in blocks(count):
        entries = (at.stop - at.start + 1) * n
        if phi.ndim == 3 or band.shape[1] < entries:
            band = _band(phi[at] if phi.ndim == 3 else phi, entries // n, kind)
        driven = np.concatenate((start, forcing(at).ravel()), dtype=kind)
        states = solve(2 * n - 1, band[:, :entries], driven, lower=1, diag=1, overwrite_x=True)
        states, end = states.reshape(-1, n), at.stop + (at.stop == count)
        yield slice(at.start, end), states[: end - at.start]
        start = states[-1]


def _band(phi: Array, count: int, kind: npt.DTypeLike) -> Array:
    """Triangular band ``(2 n, count n)`` of ``x[j+1] - phi x[j]``, all states one below the other.

    What stands in its last ``n`` columns below the diagonal is beyond the states.
    """
    n = phi.shape[-1]
    columns = np.zeros((count, n, 2 * n), dtype=kind)
    columns[..., 0] = 1.0
    for k in range(n):
        columns[: count - 1, k, n - k : 2 * n - k] = -phi[..., k]
    return columns.reshape(-1, 2 * n).T
