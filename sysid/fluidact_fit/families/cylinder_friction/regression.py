"""Linear regression with instruments, and the covariance of autocorrelated noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...estimation.least_squares import scaled_least_squares
from ...estimation.noise import common_step
from ...estimation.results import Solved
from ...estimation.uncertainty import Uncertainty, covariance, enlarge, long_run, score_covariance
from ...experiment import BoolArray, FloatArray
from .options import ONE_SIDED
from .samples import Data


@dataclass(frozen=True)
class Regression:
    """A solved regression.

    ``free`` is the solution without bounds and ``values`` the one within them, both with what
    was held; ``residuals`` are per run, of the matched and of the unfiltered forces. ``speed`` is
    the Stribeck speed about which the equation was linear [m/s].
    """

    free: Solved
    values: dict[str, float]
    residuals: list[FloatArray]
    bare_residuals: list[FloatArray]
    uncertainty: Uncertainty
    speed: float


class System:
    """The linear regression: columns by name, values held, bounds.

    Friction is not linear in the Stribeck speed: the unknown is then a change of it from
    ``stribeck``, level and speed [N, m/s] at which the equation is made linear. ``exponent`` is
    2 except where other shapes are compared.

    ``noisier`` is the same system of logs with the noise of their motion once more: the columns of
    the rise are not linear in a speed, and the noise in them is in the residual as well (a
    corrected score, see :mod:`...estimation.input_noise`).
    """

    def __init__(
        self,
        data: Sequence[Data],
        names: Sequence[str],
        held: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        stribeck: tuple[float, float] = (0.0, 0.0),
        exponent: float = 2.0,
        noisier: Sequence[System] = (),
    ) -> None:
        self.names, self.data, self.held = tuple(names), data, held or {}
        self.stribeck, self.exponent, self.noisier = stribeck, exponent, noisier
        self.start = np.array([stribeck[1] if n == "stribeck_speed" else 0.0 for n in names])
        limits = limits or {}
        ends = [limits.get(n, (-np.inf, np.inf)) for n in names]
        self.limits = np.array(ends).reshape(-1, 2) - self.start[:, None]
        self.columns, self.instruments, self.right = [], [], []
        for d in data:
            i = d.experiment.log
            signs, low = d.direction[d.kept], [d.smoothed(c)[d.kept] for c in self._low(d)]
            regressor, quiet = (self._speeds(d, v) for v in (d.motion.regressor, d.motion.velocity))
            rows = _Rows(signs, *regressor, low, i)
            self.columns.append(rows.columns(self.names))
            self.instruments.append(_Rows(signs, *quiet, low, i).columns(self.names))
            self.right.append(d.matched[d.kept] - self._force(np.zeros(len(names)), rows))

    def _speeds(self, d: Data, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A velocity at the kept samples, and the part of it that is forward [m/s].

        The part is made only where it is used: it takes a filter of its own.
        """
        used = not set(ONE_SIDED).isdisjoint((*self.names, *self.held))
        return speed[d.kept], (d.forward(speed) if used else speed)[d.kept]

    def _low(self, d: Data) -> list[FloatArray]:
        """Forces per Stribeck level and per change of the Stribeck speed, if there is any."""
        level, speed = self.stribeck
        if speed <= 0.0:
            return []
        share, slope = d.low(speed, self.exponent)
        return [share, level * slope]

    def _force(self, x: FloatArray, rows: _Rows) -> FloatArray:
        """Force of the unknowns and of what is held, shape ``(n,)`` [N]."""
        held = {n: value for n, value in self.held.items() if n != "stribeck_speed"}
        columns = rows.columns((*self.names, *held))
        return np.asarray(columns @ np.array([*x, *held.values()]))

    @property
    def rates(self) -> tuple[str, ...]:
        """Viscous coefficients among the unknowns."""
        return tuple(n for n in self.names if n in ("viscous", *ONE_SIDED))

    @cached_property
    def _normal(self) -> FloatArray:
        """The normal equations ``Z' A`` and ``Z' b``, common noise subtracted, ``(p, p + 1)``."""
        a, z = np.vstack(self.columns), np.vstack(self.instruments)
        out = z.T @ np.column_stack((a, np.concatenate(self.right)))
        for name in self.rates:
            k = self.names.index(name)
            noise = sum(int(_felt(d, name).sum()) * d.motion.shared**2 for d in self.data)
            own = 1.0 / max(float(_invert(z.T @ z)[k, k]), 1e-300)
            # where noise is most of it there is a warning, and no remedy in arithmetic
            out[k, k] -= min(noise, 0.3 * own)
        return np.asarray(out)

    @cached_property
    def _corrected(self) -> FloatArray:
        """The normal equations without what noise of the motion has added, ``(p, p + 1)``.

        It has added what it adds to them once more.
        """
        if not self.noisier:
            return self._normal
        more = np.mean([s._normal for s in self.noisier], axis=0)
        return np.asarray(2.0 * self._normal - more)

    @cached_property
    def _inverse(self) -> FloatArray:
        """Inverse of the normal equations' matrix, shape ``(p, p)``."""
        return _invert(self._corrected[:, :-1])

    def jacobian(self) -> list[FloatArray]:
        """Derivative of the unfiltered forces, shape ``(support, p)``, per run.

        The estimate is ``K e`` with the noise ``e`` of the unfiltered forces; ``pinv(K)`` is a
        Jacobian whose least-squares estimate is just that.
        """
        spread = [d.spread(z) for d, z in zip(self.data, self.instruments)]
        return _equivalent(spread, self._inverse)

    def quiet(self) -> tuple[float, dict[str, float]]:
        """Least sum of squares [N2] over quiet velocities, and the values that give it.

        To compare laws: that of a measured velocity would fall with ``viscous``, times which
        its noise is in it.
        """
        columns = []
        for d, full in zip(self.data, self.columns):
            part = full.copy()
            for name in self.rates if not d.motion.reach else ():
                quiet = np.where(_felt(d, name), d.motion.sharp[d.kept], 0.0)
                part[:, self.names.index(name)] = quiet
            columns.append(part)
        a, b = np.vstack(columns), np.concatenate(self.right)
        x = scaled_least_squares(a, b)
        return float(np.sum((b - a @ x) ** 2)), self._named(x)

    def solve(self) -> Regression:
        """The estimate within the bounds, with the covariance of the free problem."""
        x = self._inverse @ self._corrected[:, -1]
        bare = self._bare_residuals(x, [d.motion.bare for d in self.data])
        found = self._uncertainty(x, bare)
        values = {**self.held, **self._named(x)}
        free = Solved(
            values, self.names, found.covariance, found.degrees, independent=found.independent
        )
        low, high = self.limits.T
        if np.any((x < low) | (x > high)):
            x = _bounded(np.vstack(self.instruments), x, low, high)
            values = {**values, **self._named(x)}
        residuals = self._matched_residuals(x)
        return Regression(free, values, residuals, bare, found, self.stribeck[1])

    def _named(self, x: FloatArray) -> dict[str, float]:
        return dict(zip(self.names, (x + self.start).tolist()))

    def _matched_residuals(self, x: FloatArray) -> list[FloatArray]:
        return [y - c @ x for y, c in zip(self.right, self.columns)]

    def _bare_residuals(self, x: FloatArray, speeds: Sequence[FloatArray]) -> list[FloatArray]:
        """Friction less that of the solution at the given velocities, shape ``(support,)``."""
        out = []
        for d, speed in zip(self.data, speeds):
            at, sign = d.support, np.sign(d.motion.velocity)
            low, forward = [c[at] for c in self._low(d)], np.where(sign > 0.0, speed, 0.0)
            rows = _Rows(sign[at], speed[at], forward[at], low, d.experiment.log)
            out.append(d.friction[at] - self._force(x, rows))
        return out

    def _uncertainty(self, x: FloatArray, bare: Sequence[FloatArray]) -> Uncertainty:
        """Covariance of the free solution; a stroke is one stretch of correlated noise."""
        jacobian, support = self.jacobian(), [d.support for d in self.data]
        found = self._covariance(jacobian, bare, support)
        if not all(d.motion.shared > 0.0 for d in self.data):
            # the residuals of a quiet velocity lack the noise of the readings except for its
            # slow part, the only one that matters to slow regressors; white noise hides it
            rest = self._bare_residuals(x, [d.motion.sharp for d in self.data])
            found = _larger(found, self._covariance(jacobian, rest, support))
        if self.noisier:
            # noise of the speed is largest in the force where that rises, and there the rise is
            # told: the residual has not the same variance everywhere
            scattered = np.diag(self._score_covariance(x))
            found = replace(found, covariance=enlarge(found.covariance, scattered))
        matched = self._covariance(
            _equivalent(self.instruments, self._inverse),
            self._matched_residuals(x),
            [d.kept for d in self.data],
        )
        if not _alike(np.concatenate(bare)):
            # a velocity made of positions is off at reversals and right in between: where a few
            # samples have most of the error, their own sizes say what it does to the estimate
            runs = [[slice(0, r.size)] for r in bare]
            return _larger(found, score_covariance(jacobian, bare, runs))
        # the unfiltered motion may be noisier by far, as the acceleration of a heavy mass is
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.diag(found.covariance) / np.diag(matched.covariance)
        return matched if np.nanmin(ratio, initial=np.inf) > 4.0 else found

    def _scores(self, x: FloatArray) -> list[FloatArray]:
        """Terms of ``Z' (b - A x)`` of every run, shape ``(n, p)`` each, zero where not kept."""
        out = []
        for d, z, r in zip(self.data, self.instruments, self._matched_residuals(x)):
            full = np.zeros((d.kept.size, z.shape[1]))
            full[d.kept] = z * r[:, None]
            out.append(full)
        return out

    def _score_covariance(self, x: FloatArray) -> FloatArray:
        """Covariance by the scatter of the terms of the corrected score, shape ``(p, p)``."""
        more = zip(*(s._scores(x) for s in self.noisier))
        terms = [2.0 * own - np.mean(m, axis=0) for own, m in zip(self._scores(x), more)]
        spread = sum(long_run(t - t.mean(axis=0)) for t in terms)
        return np.asarray(self._inverse @ spread @ self._inverse.T)

    @cached_property
    def _converter(self) -> float:
        """Step of what logged the drive [N]; 0 where there was none, or nothing shows it."""
        step = max(d.resolution for d in self.data)
        if step > 0.0 or not all(d.driven for d in self.data):
            return step
        return common_step(np.unique(np.concatenate([d.reading for d in self.data])))

    def _covariance(
        self,
        jacobian: Sequence[FloatArray],
        residuals: Sequence[FloatArray],
        samples: Sequence[BoolArray],
    ) -> Uncertainty:
        """Covariance from the residuals at some samples of every run, and their correlation."""
        columns, rest, readings = [], [], []
        for d, j, r, at in zip(self.data, jacobian, residuals, samples):
            cuts = _stretches(at)
            columns += [part for part in np.split(j, cuts) if part.size]
            rest += [part for part in np.split(r, cuts) if part.size]
            readings += [
                (part, self._converter) for part in np.split(d.reading[at], cuts) if part.size
            ]
        timed = all(d.experiment.time.size for d in self.data)
        return covariance(columns, rest, robust=timed, small_sample=True, readings=readings)


def _larger(found: Uncertainty, other: Uncertainty) -> Uncertainty:
    """The first uncertainty with the larger variances of both."""
    variances = np.diag(other.covariance)
    if not np.any(variances > np.diag(found.covariance)):
        return found
    return replace(
        found,
        covariance=enlarge(found.covariance, variances),
        degrees=min(found.degrees, other.degrees),
        order=max(found.order, other.order),
    )


def _alike(rest: FloatArray) -> bool:
    """Whether residuals are noise of one size, and not large in few samples."""
    usual = 1.4826 * float(np.median(np.abs(rest)))  # that of a normal scatter
    return usual > 0.5 * float(np.sqrt(np.mean(rest**2)))


def _lengths(columns: FloatArray) -> FloatArray:
    """Norm of every column, 1 where it is zero."""
    size = np.linalg.norm(columns, axis=0)
    return np.where(size == 0.0, 1.0, size)


def _equivalent(instruments: Sequence[FloatArray], inverse: FloatArray) -> list[FloatArray]:
    """Jacobians whose least-squares estimate has the gains ``Z inverse'``, per run."""
    gains = np.vstack(instruments) @ inverse.T
    size = _lengths(gains)
    gains = gains / size
    jacobian = gains @ np.linalg.pinv(gains.T @ gains) / size
    return np.split(jacobian, np.cumsum([z.shape[0] for z in instruments])[:-1])


def _invert(matrix: FloatArray) -> FloatArray:
    """Inverse of a matrix of unknowns in any units."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(np.linalg.pinv(matrix / np.outer(scale, scale)) / np.outer(scale, scale))


def _stretches(kept: BoolArray) -> list[int]:
    """Where one stroke ends and another begins, as indices into the kept samples.

    Remnants of fewer than 20 samples stay with the stretch before them.
    """
    index = np.flatnonzero(kept)
    out: list[int] = []
    for cut in (np.flatnonzero(np.diff(index) > 1) + 1).tolist():
        if cut - (out[-1] if out else 0) >= 20 and index.size - cut >= 20:
            out.append(cut)
    return out


def _felt(d: Data, name: str) -> BoolArray:
    """Which of the kept samples feel a viscous coefficient, shape ``(kept,)``."""
    if name == "viscous":
        return np.ones(d.speed.size, dtype=bool)
    return d.side(name.removeprefix("viscous_"))


@dataclass(frozen=True)
class _Rows:
    """Samples of a run, shape ``(n,)`` each.

    ``sign`` is the (smoothed) direction, ``forward`` the part of ``speed`` in the positive
    one [m/s]; ``low`` are the forces of the Stribeck parameters, ``log`` numbers the log.
    """

    sign: FloatArray
    speed: FloatArray
    forward: FloatArray
    low: Sequence[FloatArray]
    log: int

    def columns(self, names: Sequence[str]) -> FloatArray:
        """What multiplies the unknowns, shape ``(n, p)``."""
        one, zero = np.ones(self.speed.size), np.zeros(self.speed.size)
        known = {
            "coulomb_positive": 0.5 * (1.0 + self.sign),
            "coulomb_negative": -0.5 * (1.0 - self.sign),
            "coulomb_mean": self.sign,
            "viscous": self.speed,
            "viscous_positive": self.forward,
            "viscous_negative": self.speed - self.forward,
            "offset": one,
            f"offset[{self.log}]": one,
            **dict(zip(("stribeck", "stribeck_speed"), self.low)),
        }
        return np.column_stack([known.get(n, zero) for n in names])


def _bounded(z: FloatArray, x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Least squares within bounds, from the free solution; equal bounds hold an unknown."""
    from scipy.optimize import lsq_linear

    scale = _lengths(z)
    a = np.asarray(np.linalg.qr(z / scale, mode="r"))
    y, low, high = a @ (scale * x), low * scale, high * scale
    free = low < high
    out = np.where(free, 0.0, low)
    if free.any():
        rest = y - a[:, ~free] @ out[~free]
        out[free] = lsq_linear(a[:, free], rest, (low[free], high[free]), method="bvls").x
    return np.asarray(out / scale)
