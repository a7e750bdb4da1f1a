"""Exact sampling of linear continuous-time models.

``x' = A x + B u(t)``, ``y(t) = C x(t - dead_time)`` with ``u`` a piecewise polynomial
(:mod:`.inputs`). The state is propagated from node to node of the input and carried to
each instant of the log by one further partial step, so that a dead time of any fraction
of a sample, uneven sampling and inputs with their own nodes need no approximation.

All functions are analytic in ``A``, ``B``, ``C`` and the dead time: with complex
arguments ``theta + 1e-30j`` the imaginary part of the output is the exact derivative [1]_.

References
----------
.. [1] W. Squire, G. Trapp, "Using complex variables to estimate derivatives of real
   functions", SIAM Review 40(1), 1998.
.. [2] C. F. Van Loan, "Computing integrals involving the matrix exponential", IEEE
   Trans. Automatic Control 23(3), 1978.
.. [3] M. Paterson, L. Stockmeyer, "On the number of nonscalar multiplications necessary
   to evaluate polynomials", SIAM J. Computing 2(1), 1973.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil, factorial, log2
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import Array, FloatArray
from ..rows import blocks
from .grid import SAME_STEP, Grid, group, make_grid
from .inputs import PiecewiseInput
from .recursion import orbit, scan

# Taylor coefficients of exp up to degree 15, four to a row; what is left out is
# 0.5**16 / 16! = 7e-19: below rounding for a norm of one half.
_FACTORIALS = np.array([float(factorial(k)) for k in range(16)])
_SERIES = 1.0 / _FACTORIALS.reshape(4, 4)


def transition(
    a: Array, b: Array | None, steps: Array, degree: int = 0
) -> tuple[Array, Array | None]:
    """Transition and input matrices of ``x' = A x + B u`` over steps of given lengths.

    With ``u(s) = sum_i c_i s**i`` on ``[0, h]``:
    ``x(h) = phi(h) x(0) + sum_i gamma_i(h) c_i h**i``.

    Computed as one exponential of the matrix extended by a chain of integrators [2]_,
    with scaling, a Taylor polynomial and squaring: only sums and products, hence
    analytic, and stable for equal, zero and complex poles alike.

    Parameters
    ----------
    a : (n, n)
    b : (n,) or None for the transition matrix alone
    steps : (k,) [s]
    degree
        Highest power of the input.

    Returns
    -------
    phi : (k, n, n)
    gamma : (k, n, degree + 1) or None
    """
    n = a.shape[0]
    size = n if b is None else n + degree + 1
    kind = np.result_type(a, steps, float if b is None else b)
    m = np.zeros((steps.size, size, size), dtype=kind)
    m[:, :n, :n] = a * steps[:, None, None]
    if b is not None:
        m[:, :n, n] = b * steps[:, None]
        for i in range(n, n + degree):
            m[:, i, i + 1] = 1.0
    norm = float(np.abs(m).sum(axis=1).max(initial=0.0))
    squarings = max(0, ceil(log2(norm / 0.5))) if norm > 0.5 else 0
    m /= 2.0**squarings
    result = _exponential_series(m)
    if squarings:
        with np.errstate(over="ignore", invalid="ignore"):  # the caller rejects what explodes
            for _ in range(squarings):
                result = result @ result
    if b is None:
        return result, None
    return result[:, :n, :n], result[:, :n, n:] * _FACTORIALS[: degree + 1]


def _exponential_series(m: Array) -> Array:
    """Taylor polynomial of ``exp`` of degree 15 for a stack of small matrices.

    Four blocks of four terms (Paterson and Stockmeyer [3]_): six products, not fifteen.
    """
    square = m @ m
    powers = np.empty((4, *m.shape), dtype=m.dtype)
    powers[0], powers[1], powers[2] = np.eye(m.shape[-1]), m, square
    np.matmul(square, m, out=powers[3])
    terms = (_SERIES @ powers.reshape(4, -1)).reshape(powers.shape)
    fourth = square @ square
    result = terms[3]
    for k in (2, 1, 0):
        result = fourth @ result + terms[k]
    return np.asarray(result)


def _scaled_transition(a: Array, b: Array, steps: Array, degree: int) -> tuple[Array, Array]:
    """`transition` with ``gamma_i h**i``, to be multiplied by the coefficients of the input."""
    phi, gamma = transition(a, b, steps, degree)
    assert gamma is not None
    return phi, gamma * (steps[:, None] ** np.arange(degree + 1))[:, None, :]


def free_response(a: Array, c: Array, grid: Grid, states: Sequence[int]) -> Array:
    """Outputs ``C exp(A (t - t0)) e_i`` for some unit initial states, shape ``(k, m)``.

    Parameters
    ----------
    a : (n, n)
    c : (n,)
    grid
        Instants of the log.
    states
        The ``i``.
    """
    count, chosen = grid.instants.size, list(states)
    phi = transition(a, None, grid.distinct)[0]
    out = np.zeros((len(chosen), count), dtype=np.result_type(phi, c))
    if phi.shape[0] > 1:
        each = phi[grid.which]

        def unforced(at: slice) -> Array:
            return np.zeros((len(each[at]), c.size))

        for response, start in zip(out, np.eye(c.size)[chosen]):
            for at, state in scan(each, unforced, start, count - 1):
                response[at] = state @ c
        return out
    row = c
    for at in blocks(count):
        if not row.any():  # what has died away is not written: zeros take no memory
            break
        rows = orbit(row, phi[0], at.stop - at.start + 1) if phi.size else row[None]
        out[:, at], row = rows[: at.stop - at.start, chosen].T, rows[-1]
    return out


def forced_response(
    a: Array,
    b: Array,
    c: Array,
    u: PiecewiseInput,
    instants: FloatArray,
    *,
    dead_time: complex = 0.0,
    grid: Grid | None = None,
) -> Array:
    """Output of ``x' = A x + B u``, ``y(t) = C x(t - dead_time)`` at given instants.

    The state is zero until the first node of the input.

    Parameters
    ----------
    a, b, c : (n, n), (n,), (n,)
    u
        Input, exact between its nodes.
    instants : (k,) [s]
    dead_time
        Any non-negative number [s].
    grid
        Grouped nodes of the input, when the caller keeps them.

    Returns
    -------
    (k,)
    """
    grid = make_grid(u.nodes) if grid is None else grid
    shift = -1j * np.imag(dead_time)
    on_nodes = instants is grid.instants and dead_time == 0.0 and not np.iscomplexobj(dead_time)
    kind = np.result_type(a, b, c, u.coefficients, u.kinks.offset, dead_time)
    out = np.zeros(instants.size, dtype=kind)
    for pieces, state in _states_at_nodes(a, b, u, grid):
        if on_nodes:
            out[pieces] = state @ c
            continue
        for at, piece, passed, which in _acting(instants, pieces, dead_time, grid):
            moved = passed + shift if shift else passed
            phi, gamma = _scaled_transition(a, b, moved, u.coefficients.shape[1] - 1)
            row, rows = np.einsum("i,kij->kj", c, phi), np.einsum("i,kij->kj", c, gamma)
            x, coefficients = state[piece - pieces.start], u.coefficients[piece]
            if moved.size == 1:
                out[at] = x @ row[0] + coefficients @ rows[0]
            else:
                out[at] = np.einsum("kn,kn->k", x, row[which])
                out[at] += np.einsum("kd,kd->k", coefficients, rows[which])
            if u.kinks.interval.size:
                out[at] += _kink_part(a, b, c, u, instants[at] - dead_time, piece)
    return out


def _acting(
    instants: FloatArray, pieces: slice, dead_time: complex, grid: Grid
) -> Iterator[tuple[slice, npt.NDArray[np.intp], FloatArray, npt.NDArray[np.integer[Any]]]]:
    """Yield the instants at which some pieces of the input act, in blocks.

    With each block come the piece that acts at each instant, ``(k,)``, how long pieces have acted
    [s], grouped, and the group of each instant, ``(k,)``.
    """
    late, unit, nodes = np.real(dead_time), grid.unit, grid.instants
    # An instant on a node belongs to either piece, but only the earlier one gives the slope for a
    # longer dead time: at zero there is no other direction.
    side = -SAME_STEP if np.imag(dead_time) != 0.0 else SAME_STEP
    even, back = instants is nodes and grid.distinct.size == 1, ceil(late / unit - side)
    if even:
        begin, end = (min(k + back, instants.size) for k in (pieces.start, pieces.stop))
    else:
        ends = [pieces.start, min(pieces.stop, nodes.size - 1)]
        begin, end = np.searchsorted(instants, nodes[ends] + (late - side * unit))
    if pieces.stop == nodes.size:  # the last piece acts for ever
        end = instants.size
    if begin >= end:
        return
    for block in blocks(end - begin):
        at = slice(begin + block.start, begin + block.stop)
        if even:
            piece = np.arange(at.start, at.stop) - back
            yield at, piece, np.array([max(back * unit - late, 0.0)]), np.zeros_like(piece)
        else:
            real = instants[at] - late
            last = np.searchsorted(nodes[pieces], real + side * unit, side="right") - 1
            piece = pieces.start + np.maximum(last, 0)
            yield at, piece, *group(np.maximum(real - nodes[piece], 0.0), unit)


def _states_at_nodes(
    a: Array, b: Array, u: PiecewiseInput, grid: Grid
) -> Iterator[tuple[slice, Array]]:
    """States at the nodes of the input from rest, block by block as `scan` yields them."""
    degree, kinks = u.coefficients.shape[1] - 1, u.kinks
    start = np.zeros(a.shape[0], dtype=np.result_type(a, b, u.coefficients, kinks.offset))
    phi, gamma = _scaled_transition(a, b, grid.distinct, degree)
    pieces, which, equal = u.coefficients[:-1], grid.which, phi.shape[0] == 1
    bent = kinks.interval
    if bent.size:
        rest = grid.distinct[which[bent]] - kinks.offset
        extra = _bend_response(a, b, kinks.bend, rest)

    def forcing(at: slice) -> Array:
        if equal:
            out = pieces[at] @ gamma[0].T
        else:
            out = np.einsum("mi,mni->mn", pieces[at], gamma[which[at]])
        first, last = np.searchsorted(bent, (at.start, at.stop))
        if first < last:
            out = out.astype(start.dtype, copy=False)
            np.add.at(out, bent[first:last] - at.start, extra[first:last])
        return out

    return scan(phi[0] if equal else phi[which], forcing, start, which.size)


def _kink_part(
    a: Array, b: Array, c: Array, u: PiecewiseInput, moments: Array, piece: npt.NDArray[np.intp]
) -> Array:
    """Contribution of kinks inside the interval of a moment to the output then, ``(k,)``."""
    kinks = u.kinks
    total: Array = np.zeros(moments.size, dtype=np.result_type(moments, kinks.offset, a, b, c))
    first = np.searchsorted(kinks.interval, piece, side="left")
    last = np.searchsorted(kinks.interval, piece, side="right")
    for ahead in range(int((last - first).max(initial=0))):
        rows = np.flatnonzero(first + ahead < last)
        k = first[rows] + ahead
        rest = moments[rows] - u.nodes[piece[rows]] - kinks.offset[k]
        passed = np.real(rest) > 0.0
        rows, k, rest = rows[passed], k[passed], rest[passed]
        if rows.size:
            total[rows] += _bend_response(a, b, kinks.bend[k], rest) @ c
    return total


def _bend_response(a: Array, b: Array, bend: Array, rest: Array) -> Array:
    """States after ``rest`` of a bend that starts at zero, shape ``(k, n)``."""
    gamma = _scaled_transition(a, b, rest, bend.shape[1])[1]
    return np.asarray(np.einsum("kni,ki->kn", gamma[:, :, 1:], bend))
