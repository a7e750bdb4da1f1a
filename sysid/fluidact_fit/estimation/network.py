"""Small feed-forward networks: exact Jacobians, Levenberg-Marquardt from many starts.

    a_0 = x,  a_l = phi(W_l a_(l-1) + b_l),  y = W_L a_(L-1) + b_L

with ``phi(z) = max(z, 0)`` or ``tanh(z)``. A network of a few dozen parameters is a
nonlinear least-squares problem, not one for a deep-learning framework: Gauss-Newton steps
with damping [1]_ reach the accuracy of the structure in tens of iterations. Everything
works on whole arrays and in blocks of rows, so that time and memory grow linearly.

Starts are made by orthogonal matching pursuit: hinges through random samples, each taken
for what it adds to those there are. The best of many short searches go on to the end. The
searches use rounded kinks, which are sharpened step by step: a hinge can only move by the
samples that lie on its kink, and a rounded one feels them from afar.

An input of which only a few values were recorded, each with another specimen, leaves the
network free in between. :class:`Chords` hold it near a straight line there, weakly enough for
it to pass through every specimen that was recorded.

References
----------
.. [1] M. Hagan, M. Menhaj, "Training feedforward networks with the Marquardt algorithm",
   IEEE Trans. Neural Networks 5(6), 1994.
.. [2] P. J. Huber, E. Ronchetti, Robust Statistics, 2nd ed., 2009, section 7.8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..experiment import BoolArray, FloatArray
from .price import exhausted, simulated

Activation = Literal["relu", "tanh"]

_BLOCK = 4096  # rows per block: their derivatives are a few megabytes
_MANY = 40_000  # rows of the fit before the last
_HUBER = 1.5  # threshold in robust standard deviations: nearly as efficient as squares
_CHORDS = 1500  # lines along an input that is to be straight
_GOLDEN = 0.6180339887  # steps of this, modulo one, spread evenly
_SHARPER = (3.0, 6.0, 15.0, 40.0)  # sharpness of rounded kinks, in widths of the data


# -------------------------------------------------------------------------- the network


@dataclass(frozen=True)
class Network:
    """Layers of a network in standardised coordinates.

    ``weights[l]`` has shape ``(units, inputs of the layer)``, ``biases[l]`` ``(units,)``;
    the last layer is linear with one unit. While training, a finite ``sharpness`` rounds the
    kinks of ReLU units: ``log(1 + exp(sharpness z)) / sharpness``.
    """

    weights: tuple[FloatArray, ...]
    biases: tuple[FloatArray, ...]
    activation: Activation = "relu"
    sharpness: float = np.inf

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.weights[0].shape[1])

    @property
    def hidden(self) -> tuple[int, ...]:
        """Units of each hidden layer."""
        return tuple(int(b.size) for b in self.biases[:-1])

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(w.size + b.size for w, b in zip(self.weights, self.biases))

    @property
    def multiplications(self) -> int:
        """Multiplications of one evaluation: what it costs a microcontroller."""
        return sum(w.size for w in self.weights)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Output for inputs of shape ``(n, inputs)``, shape ``(n,)``."""
        return self.output(self.layer_inputs(samples_last(x)))

    def layer_inputs(self, x: FloatArray) -> list[FloatArray]:
        """What goes into each layer, ``(its inputs, n)``, for inputs of shape ``(inputs, n)``."""
        layers = [x]
        for w, b in zip(self.weights[:-1], self.biases[:-1]):
            z = w @ layers[-1]
            z += b[:, None]
            layers.append(activate(z, self.activation, self.sharpness))
        return layers

    def output(self, layers: Sequence[FloatArray]) -> FloatArray:
        """Output, shape ``(n,)``, for what :meth:`layer_inputs` returns."""
        return np.asarray((self.weights[-1] @ layers[-1])[0] + self.biases[-1])

    def vector(self) -> FloatArray:
        """All parameters in one row: weights, then biases, layer by layer."""
        return np.concatenate(
            [np.concatenate((w.ravel(), b)) for w, b in zip(self.weights, self.biases)]
        )

    def from_vector(self, p: FloatArray) -> Network:
        """A network of the same shape with other parameters."""
        weights, biases, k = [], [], 0
        for w, b in zip(self.weights, self.biases):
            weights.append(p[k : k + w.size].reshape(w.shape))
            biases.append(p[k + w.size : k + w.size + b.size])
            k += w.size + b.size
        return replace(self, weights=tuple(weights), biases=tuple(biases))


def samples_last(x: FloatArray) -> FloatArray:
    """Rows ``(n, inputs)`` turned: what is done to one unit is then one run through memory."""
    return np.ascontiguousarray(x.T)


def activate(z: FloatArray, activation: Activation, sharpness: float = np.inf) -> FloatArray:
    """``max(z, 0)`` or ``tanh(z)``, of any shape; a finite ``sharpness`` rounds the corner."""
    if activation == "tanh":
        return np.asarray(np.tanh(z))
    out = np.asarray(np.maximum(z, 0.0))
    if np.isfinite(sharpness):
        # log(1 + exp(s z)) without overflow; log1p would be slower and here no better
        tail = np.abs(z)
        tail *= -sharpness
        np.exp(tail, out=tail)
        tail += 1.0
        np.log(tail, out=tail)
        tail /= sharpness
        out += tail
    return out


def _slope(a: FloatArray, net: Network) -> FloatArray:
    """Derivative of the activation where it is ``a``."""
    if net.activation == "tanh":
        return 1.0 - a * a
    if np.isfinite(net.sharpness):
        return np.asarray(1.0 - np.exp(-net.sharpness * a))
    return np.asarray((a > 0.0).astype(float))


def propagate_back(
    net: Network, layers: Sequence[FloatArray], factors: FloatArray
) -> list[FloatArray]:
    """Derivatives of the output by the sums in each layer, each sample times its factor.

    Parameters
    ----------
    layers
        From :meth:`Network.layer_inputs`.
    factors : (n,)

    Returns
    -------
    (units, n) of each layer. At a kink of a ReLU the left derivative.
    """
    out = [factors[None, :]]
    for k in range(len(net.weights) - 1, 0, -1):
        back = net.weights[k].T @ out[-1]
        back *= _slope(layers[k], net)
        out.append(back)
    return out[::-1]


def write_derivatives(
    back: Sequence[FloatArray], layers: Sequence[FloatArray], out: npt.NDArray[np.floating]
) -> None:
    """Derivatives by all parameters from those by the sums in each layer.

    ``out`` has shape ``(parameters, n)``, in the order of :meth:`Network.vector`.
    """
    begin = 0
    for one, a in zip(back, layers):
        d, given = one.astype(out.dtype), a.astype(out.dtype)
        end = begin + d.shape[0] * given.shape[0]
        products = out[begin:end].reshape(d.shape[0], given.shape[0], -1)  # a view
        np.multiply(d[:, None, :], given[None, :, :], out=products)
        begin = end + d.shape[0]
        out[end:begin] = d


def _gradient(
    back: Sequence[FloatArray], layers: Sequence[FloatArray], factors: FloatArray
) -> FloatArray:
    """Sum of the derivatives by all parameters over the samples, each times its factor."""
    parts = []
    for one, a in zip(back, layers):
        d = one * factors
        parts += [(d @ a.T).ravel(), d.sum(axis=1)]
    return np.concatenate(parts)


# ---------------------------------------------------------------- Levenberg-Marquardt


@dataclass(frozen=True)
class Chords:
    """Lines along one input from whose chord the output is to deviate little.

    ``strength * mean((y(x_i) - (1 - t_i) y(low_i) - t_i y(high_i))^2)`` joins the cost, with
    ``x_i`` at the share ``t_i`` of the way from one end of the input's range to the other.

    ``points`` has shape ``(3, m, inputs)``: low, between, high; ``shares`` ``(3, m)`` holds
    the factors of their outputs.
    """

    points: FloatArray
    shares: FloatArray
    strength: float

    @classmethod
    def along(cls, x: FloatArray, column: int, strength: float) -> Chords:
        """Chords through evenly spaced rows of ``x``, shape ``(n, inputs)``; half at most."""
        rows = x[thin(x.shape[0], min(_CHORDS, (x.shape[0] + 1) // 2))]
        low, high = float(x[:, column].min()), float(x[:, column].max())
        t = np.mod(_GOLDEN * np.arange(rows.shape[0]), 1.0)
        points = np.repeat(rows[None, :, :], 3, axis=0)
        points[:, :, column] = low + (high - low) * np.vstack((0.0 * t, t, 0.0 * t + 1.0))
        return cls(points, np.vstack((t - 1.0, np.ones(t.size), -t)), strength)

    def blocks(self) -> list[tuple[FloatArray, FloatArray]]:
        """Points, samples last and all low ones first, and shares of a few chords each."""
        parts = _parts(self.shares.shape[1], _BLOCK // 3)
        points = [self.points[:, part].reshape(-1, self.points.shape[2]) for part in parts]
        return [(samples_last(z), self.shares[:, part]) for z, part in zip(points, parts)]


def huber_cost(residual: FloatArray, limit: float) -> float:
    """Sum of ``r^2`` up to the limit and of straight lines beyond [2]_."""
    size = np.abs(residual)
    return float(np.where(size <= limit, size**2, limit * (2.0 * size - limit)).sum())


@dataclass(frozen=True)
class Cost:
    """What training minimises: ``mean(rho(y - net(x))) + decay * sum(weights^2) + chords``.

    Attributes
    ----------
    decay
        Weight decay per sample, at outputs of unit variance. There is none of biases: it
        bends no curve towards the origin.
    limit
        Residual beyond which the cost grows linearly; infinite for least squares.
    chords
        Lines along which the output is to be nearly straight.
    """

    decay: float = 0.0
    limit: float = np.inf
    chords: Chords | None = None

    def ridge(self, net: Network, rows: int) -> FloatArray:
        """Factor of every squared parameter."""
        ones, zeros = map(np.ones_like, net.weights), map(np.zeros_like, net.biases)
        return rows * self.decay * replace(net, weights=tuple(ones), biases=tuple(zeros)).vector()


def _parts(rows: int, most: int) -> list[slice]:
    return [slice(begin, begin + most) for begin in range(0, rows, most)]


@dataclass(frozen=True)
class _Point:
    """A network with its :class:`Cost` times the number of rows.

    What its derivatives need is kept block by block: inputs of the layers, and residuals of
    the rows or deviations of the chords.
    """

    network: Network
    cost: float
    rows: Sequence[tuple[Sequence[FloatArray], FloatArray]]
    chords: Sequence[tuple[Sequence[FloatArray], FloatArray]]


class _Problem:
    """A cost on given rows, which are gone through block by block."""

    def __init__(self, net: Network, x: FloatArray, y: FloatArray, cost: Cost) -> None:
        self._limit, self._ridge = cost.limit, cost.ridge(net, y.size)
        self._rows = [(samples_last(x[part]), y[part]) for part in _parts(y.size, _BLOCK)]
        self._chords = [] if cost.chords is None else cost.chords.blocks()
        count = sum(shares.shape[1] for _, shares in self._chords)
        self._weight = 0.0 if cost.chords is None else cost.chords.strength * y.size / count

    def at(self, net: Network, most: float = np.inf) -> _Point:
        """Evaluate a network, and give up once its cost has passed the most it may be."""
        simulated(sum(y.size for _, y in self._rows))
        cost = float(self._ridge @ net.vector() ** 2)
        rows, chords = [], []
        for points, shares in self._chords:
            layers = net.layer_inputs(points)
            deviation = (shares * net.output(layers).reshape(3, -1)).sum(axis=0)
            cost += self._weight * float(deviation @ deviation)
            chords.append((layers, deviation))
        for x, y in self._rows:
            if cost >= most:
                break
            layers = net.layer_inputs(x)
            residual = y - net.output(layers)
            cost += huber_cost(residual, self._limit)
            rows.append((layers, residual))
        return _Point(net, cost, rows, chords)

    def normal_equations(self, point: _Point) -> tuple[FloatArray, FloatArray]:
        """``J'WJ`` and ``J'Wr``, penalties included.

        The matrix only shapes a step and is made in single precision; where the steps end is
        for the gradient and the cost to say.
        """
        net, size, root = point.network, point.network.parameters, np.sqrt(self._weight)
        simulated(sum(y.size for _, y in self._rows))
        matrix, gradient = np.diag(self._ridge), -self._ridge * net.vector()
        table = np.empty((size, _BLOCK), dtype=np.float32)
        for layers, residual in point.rows:
            block, roots = table[:, : residual.size], self._roots(residual)
            back = propagate_back(net, layers, roots)
            gradient += _gradient(back, layers, roots * residual)
            write_derivatives(back, layers, block)
            matrix += block @ block.T
        for (layers, deviation), (_, shares) in zip(point.chords, self._chords):
            block, ends = table[:, : deviation.size], table[:, : shares.size]
            back = propagate_back(net, layers, root * shares.ravel())
            gradient += _gradient(back, layers, np.tile(-root * deviation, 3))
            write_derivatives(back, layers, ends)
            low, between, high = ends.reshape(size, 3, -1).transpose(1, 0, 2)
            block[:] = low + between + high
            matrix += block @ block.T
        return matrix, gradient

    def _roots(self, residual: FloatArray) -> FloatArray:
        """Square roots of the weights of rows."""
        if not np.isfinite(self._limit):
            return np.ones(residual.size)
        return np.asarray(np.sqrt(self._limit / np.maximum(np.abs(residual), self._limit)))


@dataclass(frozen=True)
class Trained:
    """A network, its :class:`Cost` per row, and after how many steps it was reached."""

    network: Network
    cost: float
    iterations: int


def train_from(
    net: Network,
    x: FloatArray,
    y: FloatArray,
    cost: Cost,
    iterations: int = 100,
    tolerance: float = 1e-6,
) -> Trained:
    """Minimise a cost from a start.

    Parameters
    ----------
    net
        Where the search begins.
    x, y : (n, inputs), (n,)
        Standardised.
    iterations, tolerance
        Most steps, and the relative gain of one below which the search ends.
    """
    problem = _Problem(net, x, y, cost)
    here, damping, done, count = problem.at(net), 1e-2, False, 0
    while count < iterations and not done and not exhausted():
        count += 1
        matrix, gradient = problem.normal_equations(here)
        diagonal = np.diag(matrix)
        scale = np.maximum(diagonal, 1e-8 * diagonal.max() + 1e-12)
        for _ in range(12):
            step = np.linalg.solve(matrix + damping * np.diag(scale), gradient)
            there = problem.at(net.from_vector(here.network.vector() + step), here.cost)
            if there.cost < here.cost:
                break
            damping *= 4.0
        else:
            break
        done = here.cost - there.cost <= tolerance * here.cost
        here, damping = there, max(damping / 4.0, 1e-10)
    return Trained(here.network, here.cost / y.size, count)


# ------------------------------------------------------------------------------- starts


def make_start(
    x: FloatArray, y: FloatArray, hidden: Sequence[int], activation: Activation,
    rng: np.random.Generator,
) -> Network:  # fmt: skip
    """A network to start from: its first layer pursued, further ones random.

    The last layer is solved for by (slightly ridged) least squares. Kinks are rounded.
    """
    sharpness = _SHARPER[0] if activation == "relu" else np.inf
    few = thin(y.size, 1500)
    weights, biases = ([v] for v in _pursue(x[few], y[few], hidden[0], activation, rng))
    for inputs, units in pairwise(hidden):
        weights.append(rng.standard_normal((units, inputs)) / np.sqrt(inputs))
        biases.append(0.5 * rng.standard_normal(units))
    a = x
    for w, b in zip(weights, biases):
        a = activate(a @ w.T + b, activation, sharpness)
    columns = np.column_stack((a, np.ones(y.size)))
    square = columns.T @ columns + 1e-6 * y.size * np.eye(columns.shape[1])
    last = np.asarray(np.linalg.solve(square, y @ columns))
    return Network((*weights, last[None, :-1]), (*biases, last[-1:]), activation, sharpness)


def _pursue(
    x: FloatArray, y: FloatArray, units: int, activation: Activation, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Hinges through random samples, chosen one after the other by what each adds."""
    pool = max(400, 40 * units)
    w = rng.standard_normal((pool, x.shape[1]))
    w /= np.linalg.norm(w, axis=1)[:, None]
    b = -np.einsum("ij,ij->i", w, x[rng.integers(0, x.shape[0], pool)])
    columns = activate(x @ w.T + b, activation)
    columns -= columns.mean(axis=0)
    square = np.einsum("ij,ij->j", columns, columns)
    least = 1e-3 * np.sqrt(square) + 1e-12
    rest, basis = y - y.mean(), np.empty((units, y.size))
    chosen: list[int] = []
    for k in range(units):
        length = np.sqrt(np.maximum(square, 0.0))
        gain = np.where(length < least, -1.0, np.abs(rest @ columns) / np.maximum(length, least))
        gain[chosen] = -2.0
        best = int(np.argmax(gain))
        chosen.append(best)
        # what is left of the others need not be known: the rest, and q, are free of those before
        q, taken = columns[:, best], basis[:k]
        for _ in range(2):
            q = q - (taken @ q) @ taken
        q = basis[k] = q / max(float(np.linalg.norm(q)), 1e-300)
        rest = rest - q * (q @ rest)
        square -= (q @ columns) ** 2
    return w[chosen], b[chosen]


# ------------------------------------------------------------------------------ training


@dataclass(frozen=True)
class Training:
    """A network to be found, and how long the search for it may take.

    Attributes
    ----------
    hidden
        Units of each hidden layer.
    decay
        As in :class:`Cost`.
    starts, rows, iterations
        Searches on evenly spaced rows, and most steps of each.
    finalists
        Of them, how many are trained on up to 40 000 rows, by a robust cost whose scale
        comes from the best start.
    """

    hidden: tuple[int, ...]
    activation: Activation = "relu"
    decay: float = 1e-5
    starts: int = 16
    rows: int = 3000
    iterations: int = 40
    finalists: int = 3


@dataclass(frozen=True)
class Search:
    """What a multi-start search found: candidates, best first, and how many were tried."""

    candidates: tuple[Trained, ...]
    tried: int
    limit: float

    @property
    def best(self) -> Trained:
        """The candidate of least cost."""
        return self.candidates[0]


def thin(rows: int, most: int) -> npt.NDArray[np.intp]:
    """Evenly spaced row numbers, ``most`` at most."""
    return np.linspace(0, rows - 1, min(rows, most)).round().astype(np.intp)


def robust_deviation(residual: FloatArray) -> float:
    """Standard deviation from the median absolute residual; never zero."""
    return max(1.4826 * float(np.median(np.abs(residual))), 1e-9)


def search(
    x: FloatArray,
    y: FloatArray,
    training: Training,
    rng: np.random.Generator,
    chords: Chords | None = None,
) -> Search:
    """Train from many starts on few rows, the best of them on many.

    Parameters
    ----------
    x, y : (n, inputs), (n,)
        Standardised rows.
    chords
        As in :class:`Cost`.
    """
    few, many = thin(y.size, training.rows), thin(y.size, _MANY)
    xs, ys, steps = x[few], y[few], training.iterations
    cost = Cost(training.decay, chords=chords)
    starts = (
        make_start(xs, ys, training.hidden, training.activation, rng)
        for _ in range(training.starts)
    )
    found = [train_from(net, xs, ys, cost, steps, 1e-3) for net in starts]
    found.sort(key=lambda t: t.cost)
    sharp = [_sharpen(t.network, xs, ys, cost, steps) for t in found[: training.finalists]]
    limit = _HUBER * min(robust_deviation(ys - net(xs)) for net in sharp)
    robust = replace(cost, limit=limit)
    polished = [train_from(net, x[many], y[many], robust, 3 * steps, 1e-5) for net in sharp]
    return Search(tuple(sorted(polished, key=lambda t: t.cost)), training.starts, limit)


def _sharpen(net: Network, x: FloatArray, y: FloatArray, cost: Cost, iterations: int) -> Network:
    """Train on with kinks less and less rounded; leaves true kinks."""
    if net.activation == "relu":
        for sharpness in _SHARPER[1:]:
            start = replace(net, sharpness=sharpness)
            net = train_from(start, x, y, cost, iterations, 1e-3).network
    return replace(net, sharpness=np.inf)


def cross_validate(
    x: FloatArray,
    y: FloatArray,
    folds: Sequence[BoolArray],
    training: Training,
    seed: int,
    chords: Callable[[FloatArray], Chords | None] = lambda x: None,
) -> FloatArray:
    """Errors on rows that were not trained, fold by fold.

    Parameters
    ----------
    folds
        Rows that are held out together, ``(n,)`` each. Whole positions or whole logs:
        neighbouring samples are nearly copies of each other.
    chords
        Makes the chords from the rows that are trained.

    Returns
    -------
    (n,) errors, NaN where a row was in no fold.
    """
    error = np.full(y.size, np.nan)
    for k, held in enumerate(folds):
        rest = np.flatnonzero(~held)
        rest = rest[thin(rest.size, training.rows)]
        rng = np.random.default_rng([seed, k])
        found = search(x[rest], y[rest], training, rng, chords(x[rest]))
        error[held] = y[held] - found.best.network(x[held])
    return error
