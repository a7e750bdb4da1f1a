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

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from math import ceil, factorial, log2

import numpy as np
import numpy.typing as npt

from ..experiment import Array, FloatArray
from .grid import SAME_STEP, Grid, group, make_grid
from .inputs import PiecewiseInput
from .recursion import BlockRecursion, orbit, scan

# Taylor coefficients of exp up to degree 15, four to a row; what is left out is
# 0.5**16 / 16! = 7e-19: below rounding for a norm of one half.
_FACTORIALS = np.array([float(factorial(k)) for k in range(16)])
_SERIES = 1.0 / _FACTORIALS.reshape(4, 4)
_HEAD = 8192  # samples within which the free response of a fast system is over
_FORGOTTEN = 1e-60  # part of a free response at its start that is nothing


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
    if steps.size > 1:
        return _transition(a, b, steps, degree)
    # several logs of equal steps ask for the same one after the other
    given = [a, steps] if b is None else [a, steps, b]
    return _recent(tuple((x.tobytes(), x.dtype.char) for x in given), degree)


@lru_cache(maxsize=16)
def _recent(given: tuple[tuple[bytes, str], ...], degree: int) -> tuple[Array, Array | None]:
    a, steps, *b = (np.frombuffer(content, kind) for content, kind in given)
    n = round(a.size**0.5)
    phi, gamma = _transition(a.reshape(n, n), b[0] if b else None, steps, degree)
    for kept in (phi, gamma):
        if kept is not None:
            kept.flags.writeable = False
    return phi, gamma


def _transition(a: Array, b: Array | None, steps: Array, degree: int) -> tuple[Array, Array | None]:
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


def free_response(a: Array, c: Array, grid: Grid, driven: tuple[Array, int] | None = None) -> Array:
    """Outputs ``C exp(A (t - t0)) e_i`` for every unit initial state, shape ``(m, n)``.

    Parameters
    ----------
    a : (n, n)
    c : (n,)
    grid
        Instants of the log.
    driven
        Input matrix ``(n,)``, and the highest power of the input, where a forced response of the
        same steps is computed as well: one exponential serves both.
    """
    m = grid.which.size
    if m == 0:
        return c[None, :].copy()
    phi = _transition_of(a, grid, driven)
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


def _transition_of(a: Array, grid: Grid, driven: tuple[Array, int] | None) -> Array:
    """Transition matrices of a free response; unequal steps share none that could be kept."""
    if driven is None or grid.distinct.size > 1:
        return transition(a, None, grid.distinct)[0]
    return transition(a, driven[0], grid.distinct, driven[1])[0]


def free_pieces(
    a: Array, c: Array, grid: Grid, parts: Sequence[slice], driven: tuple[Array, int] | None
) -> Iterator[Array]:
    """`free_response` over consecutive parts of a record, one after the other."""
    row, last = c, grid.which.size
    even = len(parts) > 1 and grid.distinct.size == 1
    step = _transition_of(a, grid, driven)[0] if even else None
    for part in parts:
        if step is not None and _is_settled(row, row @ step):  # how it began is long forgotten
            yield np.broadcast_to(row, (part.stop - part.start, c.size))
            continue
        columns = free_response(a, row, grid.part(part.start, min(part.stop, last)), driven)
        yield columns[: part.stop - part.start]
        # exponentials of one matrix commute: what has passed can be taken first
        row = columns[-1]
        row = np.where(np.abs(np.real(row)) > _FORGOTTEN * np.abs(c).max(), row, 0.0)


def _is_settled(row: Array, later: Array) -> bool:
    """Return whether a step changes neither a response nor, where it is complex, its derivative."""
    change = later - row
    return all(
        np.abs(part(change)).max() <= 1e-15 * np.abs(part(row)).max() for part in (np.real, np.imag)
    )


def _free_columns(step: Array, c: Array, m: int) -> Array:
    """Free responses over ``m`` steps, shape ``(m + 1, n)``."""
    if step.ndim == 2:
        return orbit(c, step, m + 1)
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
    before = np.searchsorted(grid.instants, real + _side(dead_time) * unit, side="right") - 1
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


def forced_pieces(
    a: Array,
    b: Array,
    c: Array,
    u: PiecewiseInput,
    nodes: Grid,
    samples: Grid,
    parts: Sequence[slice],
    *,
    dead_time: complex,
    shape: Callable[[PiecewiseInput], PiecewiseInput] | None,
    run: Callable[[PiecewiseInput, Grid, Array | None], Array] | None,
) -> Iterator[Array]:
    """`forced_response` over consecutive parts of a record; the state goes from one to the next.

    Parameters
    ----------
    nodes, samples
        Instants of the input and of the record; one object where they are the same.
    parts
        Consecutive samples.
    shape
        What the input passes first.
    run
        States at some nodes, where the caller keeps them.
    """
    if _are_alike(nodes, samples):
        yield from _even_pieces(a, b, c, u, nodes, samples, parts, dead_time, shape, run)
        return
    run = partial(states_at_nodes, a, b) if run is None else run
    nudge = _side(dead_time) * nodes.unit
    first, state, end = 0, None, nodes.which.size
    for part in parts:
        last = end
        if part.stop < samples.instants.size:
            real = samples.instants[part.stop - 1] - np.real(dead_time) + nudge
            last = max(int(np.searchsorted(nodes.instants, real, side="right")) - 1, first)
        some, grid = _between(u, first, last, shape), nodes.part(first, last)
        states = run(some, grid, state)
        yield forced_response(
            a, b, c, some, samples.instants[part], dead_time=dead_time, grid=grid, states=states
        )
        first, state = last, states[-1]


def _side(dead_time: complex) -> float:
    """Piece to which an instant on a node belongs, in steps.

    Either, but only the earlier one gives the slope for a longer dead time: at zero there is no
    other direction.
    """
    return -SAME_STEP if np.imag(dead_time) != 0.0 else SAME_STEP


def _even_pieces(
    a: Array, b: Array, c: Array, u: PiecewiseInput, nodes: Grid, samples: Grid,
    parts: Sequence[slice], dead_time: complex,
    shape: Callable[[PiecewiseInput], PiecewiseInput] | None,
    run: Callable[[PiecewiseInput, Grid, Array | None], Array] | None,
) -> Iterator[Array]:  # fmt: skip
    """`forced_pieces` of records with equal steps; no states where the caller keeps none."""
    later = nodes.instants[0] - samples.instants[0] + dead_time
    # samples from a node to the instant that it acts on
    back = ceil(np.real(later) / nodes.distinct[0] - _side(dead_time))
    late: complex = max(back * nodes.distinct[0] - np.real(later), 0.0)
    if np.imag(dead_time) != 0.0:
        late = late - 1j * np.imag(dead_time)
    response = None
    if run is None:
        response = _response(a, b, c, nodes.distinct, late, u.coefficients.shape[1] - 1)
        run = partial(states_at_nodes, a, b)
    first, state, end = 0, np.zeros(a.shape[0], dtype=np.result_type(a, b)), nodes.which.size
    for part in parts:
        last = max(part.stop - 1 - back, first) if part.stop < samples.instants.size else end
        some = _between(u, first, last, shape)
        begin = min(max(part.start, back), part.stop)
        at = slice(begin - back - first, part.stop - back - first)
        if response is not None and not some.kinks.interval.size:
            y, state = response.run(some.coefficients, state)
            y = y[at]
        else:
            states = run(some, nodes.part(first, last), state)
            state = states[-1]
            instants = samples.instants[begin : part.stop]
            y = _even_output(a, b, c, some, states, at, (instants, dead_time), late)
        # nothing acts before
        yield y if begin == part.start else np.concatenate((np.zeros(begin - part.start), y))
        first = last


def _response(
    a: Array, b: Array, c: Array, step: FloatArray, late: complex, degree: int
) -> BlockRecursion:
    """Outputs ``late`` [s] after nodes that are a step apart, shape ``(1,)`` [s]."""
    phi, gamma = _scaled_transition(a, b, step, degree)
    if abs(late) == 0.0:
        return BlockRecursion(phi[0], gamma[0], c, np.zeros(degree + 1))
    on, more = _scaled_transition(a, b, np.array([late]), degree)
    return BlockRecursion(phi[0], gamma[0], c @ on[0], c @ more[0])


def _are_alike(nodes: Grid, samples: Grid) -> bool:
    """True if two records have equal steps, and the first does not begin before the second."""
    if nodes is samples:
        return nodes.distinct.size == 1
    if nodes.distinct.size != 1 or samples.distinct.size != 1:
        return False
    apart = abs(nodes.distinct[0] - samples.distinct[0]) * nodes.which.size
    return bool(
        nodes.which.size == samples.which.size
        and nodes.instants[0] >= samples.instants[0]
        and apart <= SAME_STEP * nodes.unit
    )


def _between(
    u: PiecewiseInput,
    first: int,
    last: int,
    shape: Callable[[PiecewiseInput], PiecewiseInput] | None,
) -> PiecewiseInput:
    """An input from one node to another, both included, as it is shaped."""
    if shape is None:
        nodes = u.nodes[first : last + 1]
        return PiecewiseInput(nodes, u.coefficients[first : last + 1])
    # what happens before a node depends on the value at it
    nodes = u.nodes[first : last + 2]
    some = shape(PiecewiseInput(nodes, u.coefficients[first : last + 2]))
    count = last + 1 - first
    nodes = some.nodes[0:count]
    return PiecewiseInput(nodes, some.coefficients[:count], some.kinks)


def _even_output(
    a: Array, b: Array, c: Array, u: PiecewiseInput, states: Array, at: slice,
    seen: tuple[FloatArray, complex], late: complex,
) -> Array:  # fmt: skip
    """Output ``late`` [s] after some nodes of a grid of equal steps.

    It is ``seen`` at some instants, a dead time later [s].
    """
    if abs(late) == 0.0:
        return np.asarray(states[at] @ c)
    phi, gamma = _scaled_transition(a, b, np.array([late]), u.coefficients.shape[1] - 1)
    y = states[at] @ (c @ phi[0]) + u.coefficients[at] @ (c @ gamma[0])
    if u.kinks.interval.size:
        moments = np.asarray(seen[0]) - seen[1]
        y = y + _kink_part(a, b, c, u, moments, np.arange(at.start, at.stop), u.nodes)
    return np.asarray(y)


def states_at_nodes(
    a: Array, b: Array, u: PiecewiseInput, grid: Grid, start: Array | None = None
) -> Array:
    """States at the nodes of the input, ``(m, n)``, from ``start``, ``(n,)``, or rest."""
    degree = u.coefficients.shape[1] - 1
    start = np.zeros(a.shape[0], dtype=np.result_type(a, b)) if start is None else start
    if grid.which.size == 0:
        return start[None]
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
    return scan(phi[0] if equal else phi[grid.which], forcing, start)


def _kink_part(
    a: Array,
    b: Array,
    c: Array,
    u: PiecewiseInput,
    moments: Array,
    piece: npt.NDArray[np.intp],
    nodes: FloatArray,
) -> Array:
    """Contribution of kinks inside the interval of an instant to the output there."""
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
