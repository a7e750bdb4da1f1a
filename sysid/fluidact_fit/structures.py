"""Structures of one family compared on the same logs: which terms do the data support?

Every structure that the family declares (:class:`.Structure`) is fitted to the same logs. Two
judges decide, and a term has to convince both:

- **Held-out logs.** Each log in turn is left out, the others are fitted, and the one left out is
  simulated (long lists are left out in a few groups). A single log is fitted on its first two
  thirds and judged by the last.
- **The Bayesian information criterion** ``BIC = -2 ln L + k ln n`` [1]_ for ``k`` estimated
  parameters. Likelihoods are comparable only on identical samples with one noise model, so
  samples that any structure leaves out are left out for all of them, and the residuals of all
  pass the same autoregressive filter: that of the structure which misses least. The likelihood is
  then Gaussian with a free variance for each measured channel,
  ``-2 ln L = sum_c n_c ln(S_c / n_c)``, ``S_c`` being the sum of squares that the filter leaves.

A structure with more parameters is preferred where its BIC is lower by more than
``EVIDENCE`` and it predicts the held-out logs no worse. 6 is "strong" evidence [2]_.

References
----------
.. [1] G. Schwarz, "Estimating the dimension of a model", Annals of Statistics 6, 1978.
.. [2] R. Kass, A. Raftery, "Bayes factors", Journal of the American Statistical Association 90,
   1995.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from .errors import LogError, NotIdentifiedError, UsageError
from .estimation.uncertainty import fit_autoregression, innovations
from .experiment import FloatArray, where_finite
from .families import family_names, get_family
from .family import Family, FamilyOptions, Structure
from .fitting import fit, numbers_in_si, units_of_numbers
from .logs import Log, LogLike, Reading, open_logs
from .outcome import Simulation, agreement
from .result import FitResult

EVIDENCE = 6.0  # difference of the BIC that an additional parameter has to be worth
_CLEARLY = 1.1  # ratio of the errors on held-out logs, from which on the criterion is doubted
_NO_WORSE = 1.01  # ratio of the errors on held-out logs, up to which they are alike
_MOVES = 2.0  # standard errors by which a parameter has to differ to be listed
_GROUPS = 4  # most fits without some of the logs
_PART = 2.0 / 3.0  # of a single log, that is fitted where the rest judges
_HIGHEST = 20  # order of the autoregression of the residuals


@dataclass(frozen=True)
class Move:
    """A parameter that another structure estimates elsewhere.

    ``deviation`` is the difference to the recommended structure in its standard errors.
    """

    name: str
    unit: str
    recommended: float
    value: float
    deviation: float

    @property
    def std_error(self) -> float:
        """Standard error of the recommended structure's value."""
        return abs((self.value - self.recommended) / self.deviation)


@dataclass(frozen=True)
class StructureFit:
    """One structure, fitted and judged.

    Attributes
    ----------
    name, options, fixed
        As the family declares them (:class:`.Structure`).
    parameters
        How many parameters were estimated.
    fit_percent, held_out_percent
        Of the logs that were fitted, and of the same logs while they were held out [%]; ``None``
        where there is none.
    held_out_rmse
        The error behind the latter [unit of the output].
    verdict
        ``pass``, ``warn``, ``fail``, or ``refused``.
    bic_difference
        BIC above that of the structure with the lowest; ``None`` where it was refused.
    moved
        Parameters that differ from those of the recommended structure.
    reason
        Why it was refused, or why its held-out logs could not be judged.
    """

    name: str
    options: Mapping[str, str]
    fixed: Mapping[str, float]
    parameters: int = 0
    fit_percent: float | None = None
    held_out_percent: float | None = None
    held_out_rmse: float | None = None
    verdict: str = "refused"
    bic_difference: float | None = None
    moved: tuple[Move, ...] = ()
    reason: str = ""

    @property
    def settings(self) -> list[tuple[str, str]]:
        """Options of the command line that select this structure, beside ``--fix``."""
        return [(f"--{name}", value) for name, value in self.options.items()]


@dataclass(frozen=True)
class StructureComparison:
    """Structures of a family on the same logs, in the order of the family.

    Attributes
    ----------
    family
        Its name.
    structures
        One entry each, those included that were refused.
    recommended
        Name of the one to use; ``None`` where all were refused, or the criterion and the held-out
        logs disagree.
    preferred
        Where they disagree: the structure by the criterion, and that by the held-out logs.
    held_out
        How the held-out data were chosen, a clause; empty where there were none.
    samples
        Samples on which the criterion compares.
    """

    family: str
    structures: tuple[StructureFit, ...]
    recommended: str | None
    held_out: str
    samples: int
    preferred: tuple[str, ...] = ()

    @property
    def best(self) -> StructureFit | None:
        """The recommended structure."""
        return next((s for s in self.structures if s.name == self.recommended), None)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers and text."""
        return asdict(self)


def compare_structures(
    family: str,
    logs: Sequence[LogLike] | LogLike,
    *,
    fixed: Mapping[str, float | str] | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> StructureComparison:
    """Fit the structures that a family declares to the same logs, and recommend one.

    Parameters
    ----------
    family
        Name of the family, for example ``"valve"``.
    logs
        As :func:`.fitting.fit` takes them.
    fixed
        Parameters held in all structures, by name, in SI or as text with a unit.
    progress
        Called with progress messages.
    **options
        Whatever else :func:`.fitting.fit` takes, but ``validate``. An option that tells structures
        apart limits the comparison to those with this setting.

    Returns
    -------
    StructureComparison

    Raises
    ------
    UsageError
        For a family without structures, options that leave fewer than two, or options that are
        wrong for all.
    LogError
        When the logs cannot be used by any.
    """
    chosen = get_family(family)
    held = numbers_in_si("--fix", fixed, units_of_numbers(chosen))
    structures = _structures(chosen, options, held)
    how = {name: options.pop(name) for name in Reading.__annotations__ if name in options}
    trial = _Trial(family, open_logs(logs, **how), held, options, progress or (lambda words: None))
    numbers = [f"{k} of {len(structures)}" for k in range(1, len(structures) + 1)]
    whole = [trial.fit_all(s, number) for s, number in zip(structures, numbers, strict=True)]
    results = [r for r in whole if isinstance(r, FitResult)]
    if not results:
        _raise_what_all_have(whole)
    folds, words = _folds(trial.logs, results[0]) if results else ([], "")
    criteria, samples = bayes_criteria(results)
    above = iter(np.array(criteria) - min(criteria, default=0.0))
    fits = []
    for structure, r, number in zip(structures, whole, numbers, strict=True):
        if isinstance(r, FitResult):
            one = _entry(structure, r, float(next(above)))
            fits.append(trial.hold_out(one, structure, folds, number))
        else:
            fits.append(_refused(structure, r))
    best = _recommended(fits)
    if best is None:
        return StructureComparison(family, tuple(fits), None, words, samples)
    fits = _with_moves(fits, whole, fits.index(best))
    if (rival := _rival(fits, best)) is not None:
        names = (best.name, rival.name)
        return StructureComparison(family, tuple(fits), None, words, samples, names)
    return StructureComparison(family, tuple(fits), best.name, words, samples)


_Fold = tuple[Sequence[Log], Sequence[Log]]  # logs to fit, and those held out
_Refusal = NotIdentifiedError | LogError | UsageError


def _structures(
    family: Family[FamilyOptions], options: Mapping[str, Any], held: Mapping[str, float]
) -> list[Structure]:
    """Structures that agree with what is given; ``UsageError`` for fewer than two."""
    if not family.structures:
        others = [name for name in family_names() if get_family(name).structures]
        raise UsageError(
            f"{family.name} has one structure only.",
            expected=f"Families with several: {', '.join(others)}.",
            remedy="Compare parameter files instead, fitted with different options.",
        )
    given = {name.replace("_", "-"): value for name, value in options.items()}
    distinct: dict[Any, Structure] = {}  # what is held may make two structures the same one
    for s in family.structures:
        agrees = all(given.get(k, v) == v for k, v in s.options.items())
        if agrees and all(held.get(k, v) == v for k, v in s.fixed.items()):
            key = (frozenset(s.options.items()), frozenset({**s.fixed, **held}.items()))
            distinct.setdefault(key, s)
    found = list(distinct.values())
    if len(found) < 2:
        settings = dict.fromkeys(f"--{k}" for s in family.structures for k in s.options)
        settings |= dict.fromkeys(f"--fix {k}" for s in family.structures for k in s.fixed)
        raise UsageError(
            f"the options given leave {len(found)} of {len(family.structures)} structures of "
            f"{family.name}, so there is nothing to compare.",
            remedy=f"Leave out what tells the structures apart: {', '.join(settings)}.",
        )
    return found


@dataclass(frozen=True)
class _Trial:
    """Common part of all fits of a comparison."""

    family: str
    logs: Sequence[Log]
    held: Mapping[str, float]
    options: Mapping[str, Any]
    progress: Callable[[str], None]

    def fit_all(self, structure: Structure, number: str) -> FitResult | _Refusal:
        """The structure fitted to all logs, or why it was refused."""
        self.progress(f"structure {number}, {structure.name}: fitting")
        try:
            return self._fit(structure, self.logs)
        except (NotIdentifiedError, LogError, UsageError) as error:
            return error

    def hold_out(
        self, one: StructureFit, structure: Structure, folds: Sequence[_Fold], number: str
    ) -> StructureFit:
        """The entry of a structure with how well it predicts the logs that were held out."""
        runs: list[Simulation] = []
        for k, (fitted, judged) in enumerate(folds, 1):
            part = f"held-out part {k} of {len(folds)}"
            self.progress(f"structure {number}, {structure.name}: {part}")
            try:
                runs += self._fit(structure, fitted, validate=judged).validation
            except (NotIdentifiedError, LogError, UsageError) as error:
                return replace(one, reason=f"{part} cannot be judged: {error.what}")
        if not runs:
            return one
        found = agreement(runs)
        return replace(one, held_out_percent=found.fit_percent, held_out_rmse=found.rmse)

    def _fit(self, structure: Structure, logs: Sequence[Log], **more: Any) -> FitResult:
        chosen = {name.replace("-", "_"): value for name, value in structure.options.items()}
        fixed = {**structure.fixed, **self.held}
        return fit(self.family, list(logs), fixed=fixed, **{**self.options, **chosen}, **more)


def _refused(structure: Structure, error: _Refusal) -> StructureFit:
    return StructureFit(structure.name, structure.options, structure.fixed, reason=error.what)


def _entry(structure: Structure, found: FitResult, bic_difference: float) -> StructureFit:
    return StructureFit(
        structure.name, structure.options, structure.fixed, len(found.solution.names),
        agreement(found.fitted).fit_percent, verdict=found.verdict, bic_difference=bic_difference,
    )  # fmt: skip


def _raise_what_all_have(found: Sequence[FitResult | _Refusal]) -> None:
    """Raise what is wrong with the options or the logs, and not with the structures."""
    errors = [e for e in found if isinstance(e, UsageError | LogError)]
    if len(errors) == len(found):
        raise errors[0]


def _folds(logs: Sequence[Log], found: FitResult) -> tuple[list[_Fold], str]:
    """Split of the logs into fitted and held out, and a description of the choice."""
    if len(logs) > 1:
        groups = np.array_split(np.arange(len(logs)), min(len(logs), _GROUPS))
        folds: list[_Fold] = [
            ([log for k, log in enumerate(logs) if k not in out], [logs[k] for k in out])
            for out in groups
        ]
        each = "each log" if len(groups) == len(logs) else f"each of {len(groups)} groups of logs"
        return folds, f"{each} in turn"
    if not any(role.name == "time" and role.required for role in found.variant.roles):
        return [], ""
    longest = max((e.time for e in found.experiments), key=np.ptp)
    cut = float(longest[0] + _PART * np.ptp(longest))
    low, high = logs[0].window or (None, None)
    fitted, judged = (replace(logs[0], window=w) for w in ((low, cut), (cut, high)))
    return [([fitted], [judged])], f"the last third of the log, from {cut:.6g} s on"


def bayes_criteria(results: Sequence[FitResult]) -> tuple[list[float], int]:
    """BIC of fits to the same logs on identical samples, and how many samples these are.

    See the module for the likelihood.
    """
    if not results:
        return [], 0
    roles = dict.fromkeys(role for r in results for s in r.fitted for role in _residuals(r, s))
    scores, samples = np.zeros(len(results)), 0
    for role in roles:
        tables = [[_residuals(r, s).get(role) for s in r.fitted] for r in results]
        runs = list(_common(tables))
        errors = [sum(float(x @ x) for x in fit_of) for fit_of in zip(*runs)]
        least = [fit_of[int(np.argmin(errors))] for fit_of in runs]
        timed = all(e.time.size for e in results[0].experiments)
        a = fit_autoregression(least, _HIGHEST)[0] if timed else np.zeros(0)
        left = [[innovations(x, a) for x in fit_of] for fit_of in runs]
        n = sum(fit_of[0].size for fit_of in left)
        sums = [sum(float(x @ x) for x in fit_of) for fit_of in zip(*left)]
        scores += n * np.log(np.maximum(sums, np.finfo(float).tiny) / max(n, 1))
        samples += n
    counts = np.array([len(r.solution.names) for r in results])
    return [float(x) for x in scores + counts * np.log(max(samples, 1))], samples


def _residuals(result: FitResult, run: Simulation) -> dict[str, FloatArray]:
    """Residuals of every measured channel, NaN at samples that were left out or set aside."""
    output = result.variant.output.name
    found = {output: np.array(run.residual, dtype=float)}
    found |= {role: measured - simulated for role, (measured, simulated) in run.others.items()}
    for role, values in found.items():
        values[list(run.experiment.signals[role].recorded)] = np.nan
    return found


def _common(
    tables: Sequence[Sequence[FloatArray | None]],
) -> Iterator[list[FloatArray]]:
    """Per run the residuals of every fit over the samples that all of them describe."""
    for run in zip(*tables, strict=True):
        known = [x for x in run if x is not None]
        if len(known) < len(run):
            continue
        used = np.logical_and.reduce([where_finite(x) for x in known])
        yield [x[used] for x in known]


def _recommended(fits: Sequence[StructureFit]) -> StructureFit | None:
    """The simplest structure that no other one beats on both counts; see the module."""
    able = [s for s in fits if s.bic_difference is not None]
    able = [s for s in able if s.verdict != "fail"] or able
    best: StructureFit | None = None
    for one in sorted(able, key=lambda s: s.parameters):
        if best is None or _is_better(one, best):
            best = one
    return best


def _rival(fits: Sequence[StructureFit], best: StructureFit) -> StructureFit | None:
    """Return a structure that predicts the held-out logs clearly better than the best one."""
    known = [s for s in fits if s.held_out_rmse is not None and s.verdict != "fail"]
    rival = min(known, key=lambda s: s.held_out_rmse or 0.0, default=None)
    if rival is None or best.held_out_rmse is None:
        return None
    return rival if _CLEARLY * (rival.held_out_rmse or 0.0) < best.held_out_rmse else None


def _is_better(one: StructureFit, best: StructureFit) -> bool:
    if (one.bic_difference or 0.0) > (best.bic_difference or 0.0) - EVIDENCE:
        return False
    if best.held_out_rmse is None:
        return True
    return one.held_out_rmse is not None and one.held_out_rmse <= _NO_WORSE * best.held_out_rmse


def _with_moves(
    fits: Sequence[StructureFit], found: Sequence[FitResult | _Refusal], best: int
) -> list[StructureFit]:
    """The entries with the parameters that differ from those of the best."""
    base = found[best]
    return [
        replace(one, moved=tuple(_moves(base, r)))
        if isinstance(base, FitResult) and isinstance(r, FitResult) and r is not base
        else one
        for one, r in zip(fits, found, strict=True)
    ]


def _moves(base: FitResult, other: FitResult) -> Iterator[Move]:
    """Parameters that both estimate, and that differ by more than their uncertainty."""
    for name, q in base.parameters.items():
        there = other.parameters.get(name)
        both = there is not None and q.status == there.status == "estimated"
        if there is None or not both or not isinstance(q.std_error, float) or not q.std_error:
            continue
        z = (there.number - q.number) / q.std_error
        if abs(z) > _MOVES:
            yield Move(name, q.unit, q.number, there.number, z)
