"""Noise on a measured input: a consistent estimate and its covariance, for any model.

With the logged input ``u = u0 + w``, draws ``w'`` of the same noise and the score ``s = J' r``

    s*(p) = s(p; u) - (E s(p; u + w') - s(p; u))

is solved, the residual whitened (:mod:`.whitening`) and focused on frequencies at which the input
is more than noise [1]_ [2]_. Derivation: ``docs/theory/noisy-inputs.md``.

References
----------
.. [1] T. Nakamura, "Corrected score function for errors-in-variables models", Biometrika 77,
   1990; S. Novick, L. Stefanski, "Corrected score estimation via complex variable simulation
   extrapolation", J. Am. Stat. Assoc. 97, 2002.
.. [2] R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2012.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..experiment import Array, Experiment, FloatArray, Signal
from ..specification import NoiseLevel
from .least_squares import project_out
from .noise import noise_floor, white_level
from .problem import Problem, StationaryPoint
from .separable import Score, evaluate, score
from .significance import CERTAIN, DECISIVE, SEEN
from .whitening import Whitening, autoregression_from_rest, causal_filter

Build = Callable[[Sequence[Experiment], Sequence[Whitening]], Problem]

_PAIRS = 6  # antithetic draws of the noise
_SPREAD = 100  # draws for the covariance of the score
_ADDS_UP = 1e-3  # share of the response to noise that may depend on the input in a linear model
_FEW = 3  # draws that show whether the noise matters
_ORDER = 8  # of the autoregression that models the response to noise of the input
_RATIOS = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0, 1.3, 1.7, 2.5])
_CLOSE = 0.03  # step [standard errors] at which the iteration ends
_STEPS = 10  # of that iteration, at most
_MOVED = 1.0  # change [standard errors] after which the residual is whitened again
_SMALL = 0.1  # bias [standard errors] after whose correction no bias remains that matters
_FAR = 0.3  # step [standard errors] after which the contribution of the noise is computed again
_COARSEST = 0.05  # largest step of a converter, as a share of the range of its signal
_LEVELS = 3  # up to so many levels a signal is a command: no converter has so few
_FOCUS = 128  # weights of the filter that leaves out frequencies of noise
_NEIGHBOURS = 11  # frequencies that are averaged, at least
_LEAST_PART = 0.01  # weight of a frequency with nothing but noise
_WEAK = 0.02  # share of the information that has to remain without the noise


def moving_inputs(experiments: Sequence[Experiment]) -> list[str]:
    """Roles that were recorded, and drive the model, in all experiments."""
    first = experiments[0]
    return [
        role
        for role, s in first.signals.items()
        if s.hold is not None and all(e.signals[role].time.size > 1 for e in experiments)
    ]


def with_noise(
    experiments: Sequence[Experiment], inputs: Mapping[str, NoiseLevel], rng: np.random.Generator
) -> list[Experiment]:
    """Return the runs with another draw of the noise added to their inputs.

    The level that a run starts from is not disturbed: it belongs to the offset.
    """
    out = []
    for e in experiments:
        for role, noise in inputs.items():
            drawn = noise.sigma * rng.standard_normal(e.signals[role].values.size)
            drawn[0] = 0.0
            e = e.with_readings(role, e.signals[role].values + drawn)
        out.append(e)
    return out


@dataclass(frozen=True)
class InputNoise:
    """White noise on an input of some experiments.

    Attributes
    ----------
    sigma, relative
        Its standard deviation [SI] and the standard error of ``sigma**2`` as a part of it.
    seed, pairs
        Seed and number of the draws.
    linear
        Whether the model is linear in the input, so that frequencies of input and output agree.
    """

    experiments: Sequence[Experiment]
    role: str
    sigma: float
    relative: float = 0.0
    seed: int = 0
    pairs: int = _PAIRS
    linear: bool = False

    @classmethod
    def seen(
        cls, experiments: Sequence[Experiment], role: str, seed: int, given: float | None = None
    ) -> InputNoise:
        """Return the noise that the logs themselves show, or the ``given`` one [SI]."""
        if given is not None:
            return cls(experiments, role, given, 0.0, seed)
        if all(_in_levels(e.signals[role]) for e in experiments):
            return cls(experiments, role, 0.0, 0.0, seed)
        found = [white_level(e[role], _converter(e.signals[role])) for e in experiments]
        sigma = float(np.median([s for s, _ in found]))
        relative = float(np.mean([r for _, r in found]) / np.sqrt(len(found)))
        return cls(experiments, role, sigma, relative, seed)

    @cached_property
    def _draws(self) -> list[list[FloatArray]]:
        rng = np.random.default_rng(self.seed)
        out = [
            [rng.standard_normal(e.signals[self.role].values.size) for e in self.experiments]
            for _ in range(self.pairs)
        ]
        for unit in (u for draw in out for u in draw):
            unit[0] = 0.0  # the level that a run starts from belongs to its offset
        return out

    def add(self, draw: int, factor: float) -> list[Experiment]:
        """Return the experiments with a draw of the noise, times ``factor``, added."""
        out = []
        for e, unit in zip(self.experiments, self._draws[draw]):
            values = e.signals[self.role].values
            out.append(e.with_readings(self.role, values + factor * self.sigma * unit))
        return out

    def whitening(
        self, build: Build, eta: FloatArray, at: StationaryPoint | None = None
    ) -> list[Whitening]:
        """Filters that whiten the residual of every experiment; ``at`` is evaluated at ``eta``."""
        at = at or evaluate(build(self.experiments, ()), eta)
        return make_filters(self._response(build, eta), at.residuals)

    def focused(self, whitening: Sequence[Whitening], times: int = 1) -> list[Whitening]:
        """Return the filters with frequencies weighted by the share of the input that is signal."""
        out = []
        for e, f in zip(self.experiments, whitening, strict=True):
            values, focus = e.signals[self.role].values, np.ones(1)
            if self.linear and e.uniform and _FOCUS <= values.size == e.samples:
                single = causal_filter(_clean_part(values, self.sigma), _FOCUS)
                for _ in range(times):
                    focus = np.convolve(focus, single)
            out.append(replace(f, focus=focus))
        return out

    def _response(self, build: Build, eta: FloatArray) -> list[FloatArray]:
        """Response of the output of every experiment to a few draws of the noise."""
        base = _outputs(build, self.experiments, eta)
        return [
            moved - known
            for k in range(_FEW)
            for moved, known in zip(_outputs(build, self.add(k, 1.0), eta), base, strict=True)
        ]

    def effect(self, build: Build, eta: FloatArray, errors: FloatArray) -> float:
        """Largest error of a parameter by the noise, in its standard errors, from a few draws.

        ``errors``, shape ``(p,)``, are the standard errors without it.
        """
        base = score(build(self.experiments, ()), eta)
        steps = np.array([
            [base.solve(score(build(self.add(k, f), ()), eta).slope - base.slope)
             for f in (1.0, -1.0)] for k in range(_FEW)
        ])  # fmt: skip
        even, odd = 0.5 * (steps[:, 0] + steps[:, 1]), 0.5 * (steps[:, 0] - steps[:, 1])
        size = np.maximum(np.abs(even.mean(axis=0)), np.sqrt(np.mean(odd**2, axis=0)))
        return float(np.max(size / np.maximum(errors, 1e-300)))

    def supported(self, build: Build, eta: FloatArray) -> InputNoise:
        """Return the noise with the level that the likelihood of the residual supports.

        Differences of the input may contain motion, or noise that the machine felt as well, so
        levels from zero to more than the present one are compared. A level that is too small to
        show in the residual is kept.
        """
        plain = build(self.experiments, ())
        at = evaluate(plain, eta)
        local = [plain.basis(i, eta).local for i in range(len(self.experiments))]
        full = self.whitening(build, eta, at)
        scores = np.array([
            _likelihood(local, at, [replace(f, drive=ratio * f.drive) for f in full])
            for ratio in _RATIOS
        ])  # fmt: skip
        best = int(np.argmax(scores))
        claimed = float(np.interp(1.0, _RATIOS, scores))
        held = all(e.signals[self.role].hold == "zoh" for e in self.experiments)
        if held and claimed - scores[0] < DECISIVE:
            return replace(self, sigma=0.0)  # a command is exact unless the residual contradicts
        if _RATIOS[best] >= 1.0 or scores[best] - claimed < DECISIVE:
            return self
        if scores[best] - scores[0] < DECISIVE:
            return replace(self, sigma=0.0)
        near = _RATIOS[scores > scores[best] - 0.5]
        ratio = float(_RATIOS[best])
        spread = max(float(np.ptp(near)) / ratio, 0.2)
        return replace(self, sigma=ratio * self.sigma, relative=spread)


def _clean_part(values: FloatArray, sigma: float) -> FloatArray:
    """Share of the power of a signal that is not white noise, shape ``(_FOCUS + 1,)``.

    It is averaged around evenly spaced frequencies from zero to half a cycle per sample.
    """
    window = np.hanning(values.size)
    spectrum = np.abs(np.fft.rfft(window * (values - values.mean()))) ** 2 / float(window @ window)
    width = max(_NEIGHBOURS, spectrum.size // _FOCUS) | 1
    padded = np.pad(spectrum, width // 2, mode="reflect")
    power = np.convolve(padded, np.full(width, 1.0 / width), "valid")
    at = np.linspace(0.0, 1.0, _FOCUS + 1)
    power = np.interp(at, np.linspace(0.0, 1.0, power.size), power)
    # chance must not decide the weight of a frequency: the score would be biased
    noise = sigma**2 * (1.0 + CERTAIN / np.sqrt(width))
    return np.maximum(1.0 - noise / np.maximum(power, 1e-300), _LEAST_PART)


def _outputs(build: Build, experiments: Sequence[Experiment], eta: FloatArray) -> list[FloatArray]:
    """Response of a model to the inputs of every experiment, from rest, ``(n_i,)`` each."""
    plain = build(experiments, ())
    return [plain.basis(i, eta).known for i in range(len(experiments))]


def make_filters(
    response: Sequence[FloatArray], residuals: Sequence[FloatArray]
) -> list[Whitening]:
    """Make filters that whiten residuals: input noise through the model, and output noise.

    ``response`` is the response of the output to draws of the noise, from rest, ``(n_i,)`` each.
    """
    a, drive = autoregression_from_rest(response, _ORDER)
    return [
        Whitening(a, drive, max(noise_floor(r), 1e-6 * float(np.std(r)), 1e-300)) for r in residuals
    ]


def _coarse(signal: Signal) -> bool:
    """Return whether the values take a few levels only."""
    return signal.resolution > _COARSEST * float(np.ptp(signal.values))


def _in_levels(signal: Signal) -> bool:
    """Return whether a signal is held at a few commanded levels, without noise."""
    return _coarse(signal) and (signal.hold == "zoh" or np.unique(signal.values).size <= _LEVELS)


def _converter(signal: Signal) -> float:
    """Step of the converter of a measured signal; 0 for a command, whose levels are exact."""
    return 0.0 if _coarse(signal) or signal.hold == "zoh" else signal.resolution


def _likelihood(
    local: Sequence[Sequence[Array]], at: StationaryPoint, whitening: Sequence[Whitening]
) -> float:
    """Log-likelihood of the residual, maximised over its scale and all unknowns."""
    rows, logarithm = [], 0.0
    for f, r, j, own_columns in zip(whitening, at.residuals, at.jacobian, local):
        white = f.filter(np.column_stack((j, r, *own_columns)))
        own = j.shape[1] + 1
        rows.append(project_out(white[:, :own], white[:, own:]))
        logarithm += f.logarithm(r.size)
    table = np.vstack(rows)
    left = project_out(table[:, -1:], table[:, :-1])
    n = table.shape[0]
    return -0.5 * (logarithm + n * float(np.log(max(float(np.sum(left**2)), 1e-300) / n)))


@dataclass(frozen=True)
class Corrected:
    """A consistent estimate from inputs with noise.

    Attributes
    ----------
    eta, covariance
        Shapes ``(p,)`` and ``(p, p)``.
    information
        ``J' J`` without the part of the noise, shape ``(p, p)``.
    bias
        Bias of the estimate without the correction, shape ``(p,)``.
    left
        Bias that the correction may have left, shape ``(p,)``.
    weak
        Whether noise explains nearly all of the information on some direction.
    converged
        Whether the iteration did.
    """

    eta: FloatArray
    covariance: FloatArray
    information: FloatArray
    bias: FloatArray
    left: FloatArray
    weak: bool
    converged: bool


def correct(noise: InputNoise, build: Build, start: FloatArray) -> Corrected:
    """Solve the corrected score equation, whitened at its own solution.

    Parameters
    ----------
    build
        Makes the solver's problem of experiments and filters. Every parameter to be estimated
        is among its nonlinear unknowns; linear ones do not depend on the input.
    start : (p,)
    """
    noise = replace(noise, linear=_is_linear(noise, build, start))
    whitening = noise.whitening(build, start)
    found = _correct(noise, build, start, whitening)
    far = np.abs(found.eta - start) > _MOVED * np.sqrt(np.diag(found.covariance))
    if not found.converged or np.any(far):
        whitening = noise.whitening(build, found.eta)
        found = _correct(noise, build, found.eta, whitening)
    if np.all(np.abs(found.bias) < _SMALL * np.sqrt(np.diag(found.covariance))):
        return found
    focused = noise.focused(whitening)
    base = score(build(noise.experiments, focused), found.eta)
    larger = _disturbed(noise, build, focused, np.sqrt(2.0))
    more = np.mean([a.slope for a in _added(base, larger, found.eta)], axis=0)
    left = 0.5 * np.linalg.solve(found.information, more) - found.bias
    return replace(found, left=left)


def _correct(
    noise: InputNoise,
    build: Build,
    start: FloatArray,
    whitening: Sequence[Whitening],
) -> Corrected:
    """Newton's iteration on the corrected score with a fixed filter."""
    focused = noise.focused(whitening)
    problem = build(noise.experiments, focused)
    disturbed = _disturbed(noise, build, focused, 1.0)
    low = np.array([u.low for u in problem.nonlinear])
    high = np.array([u.high for u in problem.nonlinear])
    rows = sum(y.size for y in problem.measured)
    eta, converged = np.clip(start, low, high), False
    length = now = np.inf
    for _ in range(_STEPS):
        base = score(problem, eta)
        if now > _FAR:  # the contribution of the noise hardly changes over a small step
            added = _added(base, disturbed, eta)
        curvature, weak = left_information(
            base.curvature, [a.curvature for a in added], noise.relative
        )
        target = Score(base.slope, curvature, base.cost)
        step = target.solve(base.slope - np.mean([a.slope for a in added], axis=0))
        # counting all rows, focused or not, makes the errors small and the criterion strict
        scale = base.cost / max(rows - eta.size, 1)
        errors = np.sqrt(scale * np.diag(np.linalg.inv(curvature)))
        now = float(np.max(np.abs(step) / errors))
        step *= min(1.0, 0.7 * length / now) if now > length else 1.0
        length = min(now, length)
        before, eta = eta, np.clip(eta + step, low, high)
        if np.all(np.abs(eta - before) <= _CLOSE * errors):
            converged = True
            break
    inverse = np.linalg.inv(curvature)
    each = np.array([target.solve(a.slope) for a in added])
    bias = each.mean(axis=0)
    # effective number of rows: the focus passes that share of white noise
    passed = sum(y.size * float(f.focus @ f.focus)
                 for y, f in zip(problem.measured, focused, strict=True))  # fmt: skip
    found = evaluate(problem, eta)
    scale = found.cost / max(passed - eta.size - sum(found.local_counts), 1.0)
    spread = _spread(noise, build, whitening, eta)
    covariance = scale * inverse @ spread @ inverse
    covariance += np.outer(bias, bias) * noise.relative**2
    covariance += np.atleast_2d(np.cov(each.T)) / len(each)
    return Corrected(eta, covariance, curvature, bias, np.zeros(eta.size), weak, converged)


def _spread(
    noise: InputNoise, build: Build, whitening: Sequence[Whitening], eta: FloatArray
) -> FloatArray:
    """Covariance of the score for whitened residuals of unit variance, shape ``(p, p)``.

    In a linear model it is ``J' J`` with all rows focused twice. Behind a dead zone it comes from
    draws of the noise of input and output, as :func:`make_filters` found them.
    """
    if noise.linear:
        return score(build(noise.experiments, noise.focused(whitening, 2)), eta).curvature
    base = _outputs(build, noise.experiments, eta)
    jacobian = evaluate(build(noise.experiments, whitening), eta).jacobian
    rng = np.random.default_rng(noise.seed)
    scores, squares = np.zeros((_SPREAD, eta.size)), 0.0
    for k in range(_SPREAD):
        drawn = replace(noise, seed=noise.seed + 1 + k, pairs=1).add(0, 1.0)
        moved = _outputs(build, drawn, eta)
        for i, (f, j) in enumerate(zip(whitening, jacobian, strict=True)):
            white = f.filter(moved[i] - base[i] + f.white * rng.standard_normal(base[i].size))
            squares += float(white @ white)
            scores[k] += white @ j
    rows = sum(known.size for known in base)
    return np.asarray(scores.T @ scores * (rows / squares))


def _is_linear(noise: InputNoise, build: Build, eta: FloatArray) -> bool:
    """Return whether the model is linear in the input, as far as a draw of the noise shows."""
    base = _outputs(build, noise.experiments, eta)
    up, down = (_outputs(build, noise.add(0, sign), eta) for sign in (1.0, -1.0))
    return all(
        np.abs(p + n - 2.0 * y).max() <= _ADDS_UP * np.abs(p - n).max()
        for y, p, n in zip(base, up, down, strict=True)
    )


def _disturbed(
    noise: InputNoise, build: Build, whitening: Sequence[Whitening], factor: float
) -> list[tuple[Problem, Problem]]:
    """Return the problems with every draw of the noise, times ``factor``, added and subtracted."""
    return [
        (build(noise.add(k, factor), whitening), build(noise.add(k, -factor), whitening))
        for k in range(_PAIRS)
    ]


def _added(
    base: Score, disturbed: Sequence[tuple[Problem, Problem]], eta: FloatArray
) -> list[Score]:
    """Contribution of every noise draw to the score and its curvature, odd parts cancelled."""
    out = []
    for up, down in disturbed:
        a, b = score(up, eta), score(down, eta)
        out.append(Score(
            0.5 * (a.slope + b.slope) - base.slope,
            0.5 * (a.curvature + b.curvature) - base.curvature, 0.0,
        ))  # fmt: skip
    return out


def left_information(
    curvature: FloatArray, added: Sequence[FloatArray], relative: float
) -> tuple[FloatArray, bool]:
    """Curvature ``(p, p)`` without the contribution of the noise, and whether it is weak.

    Parameters
    ----------
    curvature
        With the noise, shape ``(p, p)``.
    added
        Contribution of every draw of the noise, shape ``(p, p)`` each.
    relative
        Relative standard error of the power of the noise.

    Returns
    -------
    The curvature, in which directions that are all noise keep a little, and whether the remainder
    is unknown in some direction, since draws differ and the power is uncertain: no interval follows
    from it.
    """
    d = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    whole = curvature / np.outer(d, d)
    # in the coordinates in which the whole is the unit matrix
    values, vectors = np.linalg.eigh(whole)
    root = vectors * np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    each = np.array([
        np.linalg.solve(root, np.linalg.solve(root, a / np.outer(d, d)).T) for a in added
    ])  # fmt: skip
    inner = each.mean(axis=0)
    kept, axes = np.linalg.eigh(np.eye(d.size) - 0.5 * (inner + inner.T))
    along = np.einsum("ij,kil,lj->kj", axes, each, axes)  # share of the noise in every direction
    spread = np.hypot(along.std(axis=0, ddof=1), relative * along.mean(axis=0))
    weak = bool(np.any(kept < np.maximum(_WEAK, SEEN * spread)))
    clean = (axes * np.maximum(kept, _WEAK)) @ axes.T
    return root @ clean @ root.T * np.outer(d, d), weak
