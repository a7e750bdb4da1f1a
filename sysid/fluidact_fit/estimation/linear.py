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

from dataclasses import dataclass
from functools import cache
from math import ceil, factorial, log2
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import FloatArray
from .inputs import PiecewiseInput

Array = npt.NDArray[Any]

# Taylor coefficients of exp up to degree 15, four to a row; what is left out is
# 0.5**16 / 16! = 7e-19: below rounding for a norm of one half.
_SERIES = 1.0 / np.array([float(factorial(k)) for k in range(16)]).reshape(4, 4)
_HEAD = 8192  # samples within which the free response of a fast system is over
_SAME_STEP = 1e-9  # steps closer than this share of the median step count as equal


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
        chain = np.arange(degree)
        m[:, n + chain, n + chain + 1] = 1.0
    norm = float(np.abs(m).sum(axis=1).max(initial=0.0))
    squarings = max(0, ceil(log2(norm / 0.5))) if norm > 0.5 else 0
    m /= 2.0**squarings
    result = _exponential_series(m)
    with np.errstate(over="ignore", invalid="ignore"):  # what explodes is the caller's to reject
        for _ in range(squarings):
            result = result @ result
    if b is None:
        return result, None
    weights = np.array([float(factorial(i)) for i in range(degree + 1)])
    return result[:, :n, :n], result[:, :n, n:] * weights


def _exponential_series(m: Array) -> Array:
    """Taylor polynomial of ``exp`` of degree 15 for a stack of small matrices.

    Four blocks of four terms (Paterson and Stockmeyer [3]_): six products, not fifteen.
    """
    square = m @ m
    powers = np.empty((4, *m.shape), dtype=m.dtype)
    powers[0], powers[1], powers[2] = np.eye(m.shape[-1]), m, square
    np.matmul(square, m, out=powers[3])
    blocks = (_SERIES @ powers.reshape(4, -1)).reshape(powers.shape)
    fourth = square @ square
    result = blocks[3]
    for k in (2, 1, 0):
        result = fourth @ result + blocks[k]
    return np.asarray(result)


def _scaled_transition(a: Array, b: Array, steps: Array, degree: int) -> tuple[Array, Array]:
    """`transition` with ``gamma_i h**i``, to be multiplied by the coefficients of the input."""
    phi, gamma = transition(a, b, steps, degree)
    assert gamma is not None
    return phi, gamma * (steps[:, None] ** np.arange(degree + 1))[:, None, :]


def _orbit(start: Array, phi: Array, count: int) -> Array:
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
    return (_scan_equal if phi.ndim == 2 else _scan_unequal)(phi, forcing, start)


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
    powers[1:] = _orbit(np.eye(n), phi, width + 1)
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


@dataclass(frozen=True)
class Grid:
    """Steps between instants, grouped into distinct lengths.

    ``distinct`` has shape ``(g,)`` [s] and ``which`` shape ``(m,)``: step ``j`` has the
    length ``distinct[which[j]]``. Real log times are a grid plus rounding noise, so
    lengths within a billionth of the median are one.
    """

    instants: FloatArray
    distinct: FloatArray
    which: npt.NDArray[np.intp]

    @property
    def unit(self) -> float:
        """A typical step [s]."""
        if self.distinct.size < 2:
            return float(self.distinct[0]) if self.distinct.size else 1.0
        return float(np.median(self.distinct))


def group(lengths: FloatArray, unit: float) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Group lengths that agree within a billionth of ``unit``; shapes as in `Grid`."""
    if lengths.size == 0:
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    low, high = lengths.min(), lengths.max()
    if high - low <= _SAME_STEP * unit:
        return np.array([lengths.mean()]), np.zeros(lengths.size, dtype=np.intp)
    _, first, which = np.unique(
        np.rint(lengths / (_SAME_STEP * unit)), return_index=True, return_inverse=True
    )
    return lengths[first], which


def make_grid(instants: FloatArray) -> Grid:
    """Group the steps of a sequence of instants, shape ``(m + 1,)`` [s]."""
    steps = np.diff(instants)
    unit = float(np.median(steps)) if steps.size else 1.0
    if steps.size and float(np.ptp(steps)) <= 1e-6 * unit:
        # a snapped log: what is left is the rounding of t0 + k Ts
        mean = (instants[-1] - instants[0]) / steps.size
        return Grid(instants, np.array([mean]), np.zeros(steps.size, dtype=np.intp))
    distinct, which = group(steps, unit)
    return Grid(instants, distinct, which)


def free_response(a: Array, c: Array, grid: Grid) -> Array:
    """Outputs ``C exp(A (t - t0)) e_i`` for every unit initial state, shape ``(m, n)``.

    Parameters
    ----------
    a : (n, n)
    c : (n,)
    grid
        Instants of the log.
    """
    m = grid.which.size
    if m == 0:
        return c[None, :].copy()
    phi, _ = transition(a, None, grid.distinct)
    # a stable system forgets: what is left after the head is the last value
    head = min(m, _HEAD) if phi.shape[0] == 1 else m
    step = phi[0] if phi.shape[0] == 1 else phi[grid.which]
    columns = _free_columns(step, c, head)
    if head < m:
        change = np.abs(columns[-1] - columns[-2])
        if np.all(change <= 1e-15 * np.abs(columns).max(axis=0)):
            tail = np.broadcast_to(columns[-1], (m - head, c.size))
            return np.concatenate((columns, tail))
        columns = _free_columns(step, c, m)
    return columns


def _free_columns(step: Array, c: Array, m: int) -> Array:
    """Free responses over ``m`` steps, shape ``(m + 1, n)``."""
    if step.ndim == 2:
        return _orbit(c, step, m + 1)
    none = np.zeros((m, c.size))
    return np.column_stack([scan(step, none, e) @ c for e in np.eye(c.size)])


def forced_response(
    a: Array,
    b: Array,
    c: Array,
    u: PiecewiseInput,
    instants: FloatArray,
    *,
    dead_time: complex = 0.0,
    grid: Grid | None = None,
    states: Array | None = None,
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
    states
        What `states_at_nodes` returned for the same ``a``, ``b``, ``u`` and grid.

    Returns
    -------
    (k,)
    """
    grid = make_grid(u.nodes) if grid is None else grid
    if states is None:
        states = states_at_nodes(a, b, u, grid)
    if instants is grid.instants and not np.iscomplexobj(dead_time) and dead_time == 0.0:
        return np.asarray(states @ c)
    unit = grid.unit
    real = instants - np.real(dead_time)
    # An instant that falls on a node belongs to either piece, but only the earlier one
    # gives the slope for a longer dead time: at zero there is no other direction.
    nudge = -_SAME_STEP if np.imag(dead_time) != 0.0 else _SAME_STEP
    before = np.searchsorted(grid.instants, real + nudge * unit, side="right") - 1
    inside = before >= 0
    piece = np.where(inside, before, 0)
    partial = np.maximum(real - grid.instants[piece], 0.0)
    distinct, which = group(partial[inside], unit)
    which_all = np.zeros(instants.size, dtype=np.intp)
    which_all[inside] = which
    if distinct.size == 0:
        return np.zeros(instants.size, dtype=np.result_type(states, c))
    shift = -1j * np.imag(dead_time)
    moved = distinct + shift if np.imag(dead_time) != 0.0 else distinct
    if moved.size == 1 and abs(moved[0]) == 0.0:
        y = states[piece] @ c
    else:
        phi, gamma = _scaled_transition(a, b, moved, u.coefficients.shape[1] - 1)
        row, rows = np.einsum("i,kij->kj", c, phi), np.einsum("i,kij->kj", c, gamma)
        if moved.size == 1:
            y = states[piece] @ row[0] + u.coefficients[piece] @ rows[0]
        else:
            y = np.einsum("kn,kn->k", states[piece], row[which_all])
            y = y + np.einsum("kd,kd->k", u.coefficients[piece], rows[which_all])
        y += _kink_part(a, b, c, u, instants - dead_time, piece, grid.instants)
    return np.where(inside, y, 0.0)


def states_at_nodes(a: Array, b: Array, u: PiecewiseInput, grid: Grid) -> Array:
    """States at the nodes of the input, shape ``(m, n)``, from rest."""
    n, degree = a.shape[0], u.coefficients.shape[1] - 1
    if grid.which.size == 0:
        return np.zeros((1, n), dtype=np.result_type(a, b))
    phi, gamma = _scaled_transition(a, b, grid.distinct, degree)
    pieces = u.coefficients[:-1]
    equal = phi.shape[0] == 1
    if equal:
        forcing = pieces @ gamma[0].T
    else:
        forcing = np.einsum("mi,mni->mn", pieces, gamma[grid.which])
    kinks = u.kinks
    if kinks.interval.size:
        last = kinks.interval < grid.which.size
        index = kinks.interval[last]
        rest = grid.distinct[grid.which[index]] - kinks.offset[last]
        extra = _bend_response(a, b, kinks.bend[last], rest)
        forcing = forcing.astype(np.result_type(forcing, extra))
        np.add.at(forcing, index, extra)
    return scan(phi[0] if equal else phi[grid.which], forcing, np.zeros(n))


def _kink_part(
    a: Array,
    b: Array,
    c: Array,
    u: PiecewiseInput,
    moments: Array,
    piece: npt.NDArray[np.intp],
    nodes: FloatArray,
) -> Array:
    """What kinks inside the interval of an instant add to the output there."""
    kinks = u.kinks
    total: Array = np.zeros(moments.size, dtype=np.result_type(moments, kinks.offset, a, b, c))
    if kinks.interval.size == 0:
        return total
    order = np.argsort(kinks.interval, kind="stable")
    sorted_intervals = kinks.interval[order]
    first = np.searchsorted(sorted_intervals, piece, side="left")
    last = np.searchsorted(sorted_intervals, piece, side="right")
    for ahead in range(int((last - first).max(initial=0))):
        rows = np.flatnonzero(first + ahead < last)
        k = order[first[rows] + ahead]
        rest = moments[rows] - nodes[piece[rows]] - kinks.offset[k]
        passed = np.real(rest) > 0.0
        rows, k, rest = rows[passed], k[passed], rest[passed]
        if rows.size:
            total[rows] += _bend_response(a, b, kinks.bend[k], rest) @ c
    return total


def _bend_response(a: Array, b: Array, bend: Array, rest: Array) -> Array:
    """States after ``rest`` of a bend that starts at zero, shape ``(k, n)``."""
    gamma = _scaled_transition(a, b, rest, bend.shape[1])[1]
    return np.asarray(np.einsum("kni,ki->kn", gamma[:, :, 1:], bend))
