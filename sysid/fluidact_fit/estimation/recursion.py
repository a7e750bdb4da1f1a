"""Linear recursions over samples in whole arrays."""

from __future__ import annotations

from functools import cache
from math import ceil

import numpy as np
import numpy.typing as npt

from ..experiment import Array, FloatArray
from ..rows import blocks

_PER_STEP = 20  # parts that begin in the time of a step of all parts side by side
_SHORT = 16_000  # numbers of a forcing for which one banded system is quicker than blocks


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

    def cut(values: npt.ArrayLike, idle: float) -> FloatArray:
        if np.ndim(values) == 0:
            return np.broadcast_to(np.asarray(values, dtype=float), (width, rows))
        out = np.full(rows * width, idle)
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
    out, now = np.empty(values.size), float(values[0])
    for at in blocks(values.size):
        part = values[at]
        out[at] = clamped(now, part - 0.5 * width, part + 0.5 * width, 0.0, part.size)
        now = float(out[at][-1])
    return out


def scan(phi: Array, forcing: Array, start: Array) -> Array:
    """Solve ``x[j+1] = phi[j] x[j] + forcing[j]`` in whole arrays.

    Parameters
    ----------
    phi : (n, n) for equal steps, or (m, n, n)
    forcing : (m, n)
    start : (n,)

    Returns
    -------
    (m + 1, n), starting with ``start``.
    """
    if phi.ndim == 3:
        return _scan_unequal(phi, forcing, start)
    return (_scan_short if forcing.size <= _SHORT else _scan_equal)(phi, forcing, start)


def _scan_short(phi: Array, forcing: Array, start: Array) -> Array:
    """`scan` for few equal steps: one triangular band, all states one below the other."""
    from scipy.linalg.blas import dtbsv, ztbsv

    m, n = forcing.shape
    kind = np.result_type(phi, forcing, start)
    column = np.zeros((n, 2 * n), dtype=kind)  # of the band, for every entry of a state
    column[:, 0] = 1.0
    for k in range(n):
        column[k, n - k : 2 * n - k] = -phi[:, k]
    band = np.tile(column, (m + 1, 1)).T
    states = np.concatenate((start, forcing.ravel()), dtype=kind)
    solve = ztbsv if kind.kind == "c" else dtbsv
    return np.asarray(solve(2 * n - 1, band, states, lower=1, diag=1)).reshape(m + 1, n)


@cache
def _lags(width: int) -> npt.NDArray[np.intp]:
    """``1 + i - j`` for ``i >= j`` and 0 above, shape ``(width, width)`` of ``(j, i)``."""
    k = np.arange(width)
    return np.maximum(1 + k[None, :] - k[:, None], 0)


def _scan_equal(phi: Array, forcing: Array, start: Array) -> Array:
    """`scan` for equal steps: blocks of steps as one product with a matrix of powers.

    The blocks' end states obey the same recursion with ``phi**width``, so it is solved
    by the same function.
    """
    m, n = forcing.shape
    width = 12
    blocks = -(-m // width)
    kind = np.result_type(phi, forcing, start)
    powers = np.zeros((width + 2, n, n), dtype=kind)
    powers[1:] = orbit(np.eye(n), phi, width + 1)
    answer = powers[_lags(width)].transpose(0, 3, 1, 2).reshape(width * n, width * n)
    local = _in_blocks(forcing, blocks, width, kind).reshape(blocks, width * n) @ answer
    if blocks > 1:
        carry = _scan_equal(powers[-1], local[:-1, -n:], start)
    else:
        carry = np.asarray(start, dtype=kind)[None]
    local += carry @ powers[2:].transpose(2, 0, 1).reshape(n, width * n)
    return np.vstack((start, local.reshape(blocks * width, n)[:m]))


def _in_blocks(steps: Array, blocks: int, width: int, kind: npt.DTypeLike) -> Array:
    """Cut what belongs to steps into blocks of equal width, zeros at the end."""
    out = np.zeros((blocks * width, *steps.shape[1:]), dtype=kind)
    out[: steps.shape[0]] = steps
    return out.reshape(blocks, width, *steps.shape[1:])


def _scan_unequal(phi: Array, forcing: Array, start: Array) -> Array:
    """`scan` for a matrix of its own per step.

    The recursion is cut into about ``sqrt(m)`` blocks that advance side by side from
    zero; the blocks' end states are then chained and added.
    """
    m, n = forcing.shape
    width = max(1, ceil(m**0.5))
    blocks = -(-m // width)
    kind = np.result_type(phi, forcing, start)
    padded = _in_blocks(forcing, blocks, width, kind)
    full = _in_blocks(phi, blocks, width, kind)
    local = np.empty((width, blocks, n), dtype=kind)
    products = np.empty((width, blocks, n, n), dtype=kind)
    state = np.zeros((blocks, n), dtype=kind)
    product = np.broadcast_to(np.eye(n, dtype=kind), (blocks, n, n))
    for j in range(width):
        state = (full[:, j] @ state[:, :, None])[:, :, 0] + padded[:, j]
        local[j] = state
        product = full[:, j] @ product
        products[j] = product
    carry = np.empty((blocks, n), dtype=kind)
    x = np.asarray(start, dtype=kind)
    for k in range(blocks):
        carry[k] = x
        x = product[k] @ x + state[k]
    local += (products @ carry[None, :, :, None])[..., 0]
    return np.vstack((start, local.transpose(1, 0, 2).reshape(blocks * width, n)[:m]))
