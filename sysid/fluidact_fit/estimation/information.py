"""Information of an experiment about the parameters, before it is recorded.

The derivative of the model output by the parameters, with everything that belongs to one
log (offset, initial state) projected out, is all that Fisher's information needs:
``M = J' J / sigma^2`` and the standard errors are the roots of the diagonal of ``M^-1``
[1]_.

References
----------
.. [1] G. Goodwin, R. Payne, Dynamic System Identification: Experiment Design and Data
   Analysis, 1977, chapter 6.
.. [2] D. Titterington, "Algorithms for computing D-optimal designs on a finite design
   space", Proc. Conf. Information Sciences and Systems, 1976.
"""

from __future__ import annotations

import numpy as np

from ..experiment import FloatArray
from ..specification import STEP, Information
from .least_squares import project_out, scaled_inverse
from .named_model import NamedModel, Values

_ROUNDS = 3000  # of the algorithm that shares the samples out


def sensitivity(model: NamedModel, values: Values, level: float = 0.0) -> Information:
    """Information of the model's first experiment at given values.

    Parameters
    ----------
    model
        Its outputs need not have been measured.
    values
        Every parameter by name [SI].
    level
        Output at rest [SI].
    """
    names, count = model.nonlinear, len(model.linear)
    basis = model.columns(0, values)
    shared, local = np.zeros(len(basis.shared)), np.zeros(len(basis.local))
    shared[:count] = [float(values[n]) for n in model.linear]
    if model.slopes is not None:
        rows = list(model.slopes(0, dict(values), list(names))[1])
    else:
        steps = [STEP * max(abs(float(values[n])), 1e-9) for n in names]
        moved = [{**values, n: float(values[n]) + 1j * h} for n, h in zip(names, steps)]
        rows = [model.columns(0, v).slope(shared, local, h) for v, h in zip(moved, steps)]
    output = level + basis.combined(shared, local)
    jacobian = np.array([*rows, *basis.shared[:count]]).T
    nuisance = np.reshape([*basis.shared[count:], *basis.local], (-1, output.size)).T
    return Information((*names, *model.linear), project_out(jacobian, nuisance), output)


def cramer_rao(normal: FloatArray) -> FloatArray:
    """Inverse of an information matrix, shape ``(p, p)``; infinite where there is none."""
    out, lost = scaled_inverse(normal, 1e-13, 1e-6)
    out[lost, lost] = np.inf
    return out


def optimal_measure(rows: FloatArray, scales: FloatArray, criterion: str | int) -> FloatArray:
    """Share of the samples to take at every point of a grid.

    Multiplicative algorithm [2]_: each share grows with how much the criterion gains by
    its point.

    Parameters
    ----------
    rows : (n, p)
        Derivative of the output at the points of the grid.
    scales : (p,)
        Size by which each standard error is divided.
    criterion
        ``"determinant"``, ``"worst"`` (the largest scaled variance, as a norm of order
        eight), or the index of one parameter.

    Returns
    -------
    (n,) shares that add up to one.
    """
    x = rows * scales
    share = np.full(x.shape[0], 1.0 / x.shape[0])
    # a norm of order r moves r + 1 times as fast: smaller steps keep it from swinging
    power = 1.0 / 9.0 if criterion == "worst" else 0.5
    ridge = 1e-10 * np.eye(x.shape[1]) * float(np.mean(x**2))
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv(x.T @ (share[:, None] * x) + ridge)
        towards = (x @ inverse) ** 2
        variance = np.diag(inverse)
        if criterion == "determinant":
            gain = np.einsum("ij,jk,ik->i", x, inverse, x)
        elif criterion == "worst":
            gain = towards @ (variance / variance.max()) ** 7
        else:
            gain = towards[:, int(criterion)]
        share = share * np.maximum(gain, 0.0) ** power
        share /= share.sum()
    return np.asarray(share)
