"""Linear regression with instruments, and the covariance of autocorrelated noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...estimation.uncertainty import Uncertainty, covariance, enlarge, t_quantile
from ...experiment import FloatArray
from .filters import Mask
from .samples import Data


@dataclass(frozen=True)
class Regression:
    """A solved regression: values by name and residuals per log, matched and unfiltered."""

    values: dict[str, float]
    names: tuple[str, ...]
    residuals: list[FloatArray]
    bare_residuals: list[FloatArray]
    uncertainty: Uncertainty
    free_values: dict[str, float] = field(default_factory=dict)

    @property
    def quantile(self) -> float:
        return t_quantile(0.975, self.uncertainty.degrees)

    def std_error(self, weights: Mapping[str, float]) -> float:
        """Standard error of a weighted sum of unknowns."""
        w = np.array([weights.get(n, 0.0) for n in self.names])
        return float(np.sqrt(max(float(w @ self.uncertainty.covariance @ w), 0.0)))


class System:
    """The linear regression: columns by name, values held, bounds."""

    def __init__(
        self,
        data: Sequence[Data],
        names: Sequence[str],
        held: Mapping[str, float],
        limits: Mapping[str, tuple[float, float]],
    ) -> None:
        self.names, self.data, self.held = tuple(names), data, held
        self.limits = [limits.get(n, (-np.inf, np.inf)) for n in names]
        self.columns, self.instruments, self.right = [], [], []
        for d in data:
            i = d.experiment.log
            signs, regressor = d.direction[d.kept], d.motion.regressor[d.kept]
            self.columns.append(_columns(self.names, signs, regressor, i))
            self.instruments.append(_columns(self.names, signs, d.speed, i))
            self.right.append(d.matched[d.kept] - _held_force(held, signs, regressor, i))
        self.timed = all(d.experiment.time.size for d in data)

    def _normal(self) -> tuple[FloatArray, FloatArray]:
        """Normal equations ``Z' A x = Z' y``, common noise subtracted; shapes (p, p), (p,)."""
        a, z = np.vstack(self.columns), np.vstack(self.instruments)
        matrix = z.T @ a
        if "viscous" in self.names:
            k = self.names.index("viscous")
            noise = sum(int(d.kept.sum()) * d.motion.shared**2 for d in self.data)
            own = 1.0 / max(float(_invert(z.T @ z)[k, k]), 1e-300)
            # where noise is most of it there is a warning, and no remedy in arithmetic
            matrix[k, k] -= min(noise, 0.3 * own)
        return matrix, z.T @ np.concatenate(self.right)

    def jacobian(self) -> FloatArray:
        """Derivative of the unfiltered forces, shape ``(support, p)``, of all logs."""
        inverse = _invert(self._normal()[0])
        spread = [d.spread(z) for d, z in zip(self.data, self.instruments)]
        return np.vstack(_equivalent(spread, inverse))

    def solve(self) -> Regression:
        """The estimate within the bounds, with the covariance of the free problem."""
        matrix, right = self._normal()
        inverse = _invert(matrix)
        x = inverse @ right
        free = dict(zip(self.names, x.tolist()))
        uncertainty, bare = self._uncertainty(inverse, x)
        low, high = np.array(self.limits).T
        if np.any((x < low) | (x > high)):
            z = np.vstack(self.instruments)
            scale = np.linalg.norm(z, axis=0)
            scale[scale == 0.0] = 1.0
            a = np.asarray(np.linalg.qr(z / scale, mode="r"))
            x = _bounded(a, a @ (scale * x), low * scale, high * scale) / scale
        residuals = [r - c @ x for r, c in zip(self.right, self.columns)]
        values_by_name = dict(zip(self.names, x.tolist()))
        return Regression(values_by_name, self.names, residuals, bare, uncertainty, free)

    def _uncertainty(
        self, inverse: FloatArray, x: FloatArray
    ) -> tuple[Uncertainty, list[FloatArray]]:
        """Covariance of the free solution; a stroke is one stretch of correlated noise.

        The estimate is ``K e`` with the noise ``e`` of the unfiltered forces; ``pinv(K)`` is a
        Jacobian whose least-squares estimate is just that.
        """
        spread = [d.spread(z) for d, z in zip(self.data, self.instruments)]
        jacobian = _equivalent(spread, inverse)
        columns, residuals, bare = [], [], []
        for d, j in zip(self.data, jacobian):
            at, i = d.support, d.experiment.log
            sign, speed = np.sign(d.motion.velocity[at]), d.motion.bare[at]
            r = d.friction[at] - _held_force(self.held, sign, speed, i)
            r = r - _columns(self.names, sign, speed, i) @ x
            bare.append(r)
            cuts = _stretches(at)
            columns += [part for part in np.split(j, cuts) if part.size]
            residuals += [part for part in np.split(r, cuts) if part.size]
        found = covariance(columns, residuals, robust=self.timed, small_sample=True)
        found = self._with_hidden_correlation(found, columns, x)
        matched = self._matched_uncertainty(inverse, x)
        # of very fast strokes the unfiltered velocity is not known well enough
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.diag(found.covariance) / np.diag(matched.covariance)
        return (matched if np.nanmin(ratio, initial=np.inf) > 4.0 else found), bare

    def _with_hidden_correlation(
        self, found: Uncertainty, columns: Sequence[FloatArray], x: FloatArray
    ) -> Uncertainty:
        """Enlarge by the autocorrelation of the force that white noise of a velocity hides.

        The residuals of a quiet velocity lack the noise of the readings except for its slow
        part, the only one that matters to slow regressors.
        """
        if all(d.motion.shared > 0.0 for d in self.data):
            return found
        residuals = []
        for d in self.data:
            at, i = d.support, d.experiment.log
            sign, speed = np.sign(d.motion.velocity[at]), d.motion.sharp[at]
            r = d.friction[at] - _held_force(self.held, sign, speed, i)
            r = r - _columns(self.names, sign, speed, i) @ x
            residuals += [part for part in np.split(r, _stretches(at)) if part.size]
        quiet = covariance(columns, residuals, robust=self.timed, small_sample=True)
        before, now = np.diag(found.covariance), np.diag(quiet.covariance)
        if not np.any(now > before):
            return found
        larger = enlarge(found.covariance, now)
        return replace(
            found,
            covariance=larger,
            degrees=min(found.degrees, quiet.degrees),
            order=max(found.order, quiet.order),
        )

    def _matched_uncertainty(self, inverse: FloatArray, x: FloatArray) -> Uncertainty:
        """Covariance from the residuals of the filtered forces and their autocorrelation."""
        columns, residuals = [], []
        jacobian = _equivalent(self.instruments, inverse)
        for d, j, c, y in zip(self.data, jacobian, self.columns, self.right):
            cuts = _stretches(d.kept)
            columns += [part for part in np.split(j, cuts) if part.size]
            residuals += [part for part in np.split(y - c @ x, cuts) if part.size]
        return covariance(columns, residuals, robust=self.timed, small_sample=True)


def _equivalent(instruments: Sequence[FloatArray], inverse: FloatArray) -> list[FloatArray]:
    """Jacobians whose least-squares estimate has the gains ``Z inverse'``, per log."""
    gains = np.vstack(instruments) @ inverse.T
    size = np.linalg.norm(gains, axis=0)
    size[size == 0.0] = 1.0
    gains = gains / size
    jacobian = gains @ np.linalg.pinv(gains.T @ gains) / size
    return np.split(jacobian, np.cumsum([z.shape[0] for z in instruments])[:-1])


def _invert(matrix: FloatArray) -> FloatArray:
    """Inverse of a matrix of unknowns in any units."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.pinv(matrix / np.outer(scale, scale)) / np.outer(scale, scale))


def _stretches(kept: Mask) -> list[int]:
    """Where one stroke ends and another begins, as indices into the kept samples.

    Remnants of fewer than 20 samples stay with the stretch before them.
    """
    index = np.flatnonzero(kept)
    out: list[int] = []
    for cut in (np.flatnonzero(np.diff(index) > 1) + 1).tolist():
        if cut - (out[-1] if out else 0) >= 20 and index.size - cut >= 20:
            out.append(cut)
    return out


def _column(name: str, sign: FloatArray, speed: FloatArray, log: int) -> FloatArray:
    """What multiplies an unknown, shape ``(n,)``; ``sign`` is the (smoothed) direction."""
    if name == "coulomb_positive":
        return np.asarray(0.5 * (1.0 + sign))
    if name == "coulomb_negative":
        return np.asarray(-0.5 * (1.0 - sign))
    if name == "coulomb_mean":
        return sign
    if name == "viscous":
        return speed
    return np.full(speed.size, 1.0 if name in ("offset", f"offset[{log}]") else 0.0)


def _columns(names: Sequence[str], sign: FloatArray, speed: FloatArray, log: int) -> FloatArray:
    return np.column_stack([_column(n, sign, speed, log) for n in names])


def _held_force(
    held: Mapping[str, float], sign: FloatArray, speed: FloatArray, log: int
) -> FloatArray:
    """Force of what is not estimated, shape ``(n,)`` [N]."""
    out = np.zeros(speed.size)
    for name, value in held.items():
        out += value * _column(name, sign, speed, log)
    return out


def _bounded(a: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Bounded least squares; unknowns whose bounds coincide are held there."""
    from scipy.optimize import lsq_linear

    x = np.where(low == high, low, 0.0)
    free = low < high
    if free.any():
        rest = y - a[:, ~free] @ x[~free]
        x[free] = lsq_linear(a[:, free], rest, (low[free], high[free]), method="bvls").x
    return np.asarray(x)
