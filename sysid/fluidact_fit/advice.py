"""Advice on a log: families that fit it, parameters they would determine, commands to run.

Units say what a column can be, names what it is called, and a trial fit whether the log behaves so:
its verdict and its refusals are those of the fit itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from .assessment import direction, leads, policy
from .channels import factor_between
from .errors import FluidactError, LogError, NotIdentifiedError, UsageError
from .estimation.inputs import settle_holds
from .experiment import Experiment
from .families import family_names, get_family
from .files import powershell_command, shell_command
from .fitting import fit
from .logs import Log, experiments
from .logs.columns import default_column, time_candidate
from .logs.log import Column
from .model_free import Views, view_fit, view_runs
from .result import FitResult
from .specification import Role, Variant
from .units import same_dimension

_TRIED = 4  # families at most
_OPTION = re.compile(r"--[a-z][a-z0-9-]*[ =][A-Z][A-Z0-9]+\b")
_ROWS = 50_000  # of all logs, beyond which none is tried
_SHORTLIST = 0.75  # of the best score, down to which families are tried
_ALIKE = 1.5  # times the misfit of another, up to which fewer parameters are the better model
_APART = 3.0  # times the misfit of the best model, beyond which another is none of its rivals
_IMPOSSIBLE = -1e6
_NAMED, _CALLED, _MEASURED, _ALSO, _UNKNOWN, _USED = 3.0, 2.0, 1.0, 0.7, 0.1, 1.0
_DOUBT = 0.25  # less for a column that holds what was asked for, or another quantity by its name

# What people call the roles, in the languages of loggers: whole words of a name, without numbers.
_WORDS: dict[str, str] = {
    "command": "cmd command u set setpoint sollwert stellwert soll voltage spannung current strom "
    "valve ventil consigna consigne commande comando i pwm signal",
    "outlet": "outlet out output response druck pressure p flow q chamber far istwert ist ausgang "
    "speed",
    "inlet": "inlet in input valve source supply upstream vordruck eingang",
    "pressure": "pressure druck p chamber presion pression pressione kammer",
    "pressure_1": "pa p1 pressure1 chamber1 cap bottom",
    "pressure_2": "pb p2 pressure2 chamber2 rod",
    "pressure_drop": "dp delta drop differential differenzdruck",
    "force": "force kraft f load cell fuerza forza last",
    "position": "position pos x y weg hub stroke laser displacement place posicion posizione lage",
    "velocity": "velocity v speed geschwindigkeit vel velocidad vitesse velocita",
    "torque": "torque m moment drehmoment tau couple par coppia",
    "angle": "angle winkel phi theta rotation turn encoder angulo angolo",
    "angular_velocity": "omega speed drehzahl rpm velocity w n",
    "speed": "speed omega drehzahl rpm n velocity v",
    "flow": "flow q volumenstrom durchfluss debit caudal portata speed",
    "reading": "adc counts count raw reading pot poti potentiometer digits",
    "reference": "reference laser caliper true position pos mm gauge deflection",
    "drive_position": "drive motor antrieb input x",
    "load_position": "load last abtrieb output phi",
    "length": "length laenge",
    "direction": "direction richtung state",
}

# How people number what there are two of.
_ORDINALS = {"1": frozenset("1a"), "2": frozenset("2b")}

# Words of a column that holds what was asked for, not what was measured; roles that are that.
_REFERENCES = frozenset(
    ("ref", "reference", "soll", "sollwert", "setpoint", "target", "desired", "demand", "cmd")
)
_SET_POINTS = ("command", "reference")
# Words that say what a column is, whatever its unit allows.
_QUANTITIES = frozenset(
    ("torque", "force", "position", "angle", "velocity", "speed", "flow", "pressure")
)


@dataclass(frozen=True)
class Suggestion:
    """A family that a log may be of.

    Attributes
    ----------
    family, variant
        Names.
    columns
        Role to the number of its column, as ``"#2"``.
    score
        How well units and names agree.
    unsure
        Pairs of roles whose columns could be exchanged, for all that units, names and the order
        in time say.
    verdict
        Of a trial fit, ``"refused"`` where nothing can be determined; empty where none was made.
    fit_percent
        Of the trial.
    parameters
        How many numbers it estimated.
    not_identified
        Parameters that the logs do not determine, with what would: the words of the warning.
    reason
        Why it was refused or not tried.
    asked
        Options that have to be given first, as ``--mass NUMBER``.
    command
        How to run the fit, for a POSIX shell.
    powershell
        The same for PowerShell.
    against
        Pairs of a driving role and the output that moves the other way: a sign may be reversed.
    guessed
        Whether units and names do not suffice: something has to be added or checked.
    result
        Of the trial fit, where one was made.
    """

    family: str
    variant: str
    columns: Mapping[str, str]
    score: float
    unsure: tuple[tuple[str, str], ...] = ()
    verdict: str = ""
    fit_percent: float | None = None
    parameters: int = 0
    not_identified: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""
    asked: tuple[str, ...] = ()
    command: str = ""
    powershell: str = ""
    against: tuple[tuple[str, str], ...] = ()
    guessed: bool = False
    result: FitResult | None = field(default=None, repr=False, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """Everything but the result, as plain data."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "result"}

    @property
    def rank(self) -> tuple[int, float]:
        """Better ones are lower; of those that are alike, the simpler one has to be chosen."""
        order = {"pass": 0, "warn": 1, "": 2, "fail": 3, "refused": 4}
        missed = 100.0 if self.fit_percent is None else 100.0 - self.fit_percent
        return order[self.verdict], missed


def suggest(
    logs: Sequence[Log],
    paths: Sequence[str],
    only: str | None = None,
    *,
    trial: bool = True,
    words: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Suggestion]:
    """Return the families that fit some logs of one machine, the best first.

    Parameters
    ----------
    logs
        As read, with what is known of their columns.
    paths
        What they are called on the command line.
    only
        Judge this family alone.
    trial
        Fit the likeliest ones.
    words
        Logs and options of reading as they were typed, for the commands; without them those of the
        first log.
    progress
        Called with what is being done.
    """
    names = [only] if only else family_names()
    typed = [*paths, *_given(logs[0])] if words is None else list(words)
    time = time_candidate(logs[0])
    signals = [c for c in logs[0].columns
               if (time is None or c.index != time.column.index) and _varies(c)]  # fmt: skip
    timed = time is not None or logs[0].sample_time is not None
    found = [s for name in names for s in _best_variant(name, logs[0], signals, timed)]
    if not found:
        guessed = [*_lacking_one(names, logs[0], signals, timed),
                   *_by_order(names, logs[0], signals, timed)]  # fmt: skip
        return [_with_command(s, logs[0], typed) for s in guessed[:_TRIED]]
    found.sort(key=lambda s: -s.score)
    shortlist = [s for s in found if s.score >= _SHORTLIST * found[0].score][:_TRIED]
    rows = sum(log.rows for log in logs)
    if rows > _ROWS:
        words = f"not tried: {rows} rows are more than {_ROWS}"
        tried = [replace(s, reason=words) for s in shortlist]
    else:
        tried = [_tried(s, logs, progress) if trial else s for s in shortlist]
    return [_with_command(s, logs[0], typed) for s in _ordered(tried)]


def is_clear(found: Sequence[Suggestion]) -> bool:
    """Return whether the first suggestion is the one, without a question left."""
    if not found or found[0].verdict not in ("pass", "warn") or found[0].unsure:
        return False
    if (found[0].fit_percent or 100.0) < policy.FIT_WEAK:
        return False
    rivals = [s for s in found[1:] if s.verdict == found[0].verdict]
    best = found[0].rank[1]
    return all(s.score < found[0].score or s.rank[1] > _APART * best for s in rivals)


def views_of(s: Suggestion, logs: Sequence[Log]) -> Views | None:
    """Response of the output without a model, and that of the trial's model."""
    if s.result is not None:
        return view_fit(s.result)
    variant = get_family(s.family).variant(s.variant)
    runs: list[Experiment] = []
    try:
        for index, log in enumerate(logs):
            runs += experiments(_bound(log, s), variant, index=index)[0]
        return view_runs(variant, settle_holds(runs))
    except (LogError, UsageError):
        return None


def _ordered(tried: Sequence[Suggestion]) -> list[Suggestion]:
    """By verdict and misfit; of two that fit alike, the one with fewer numbers comes first."""
    left, out = sorted(tried, key=lambda s: (s.rank[0], -s.score, s.rank[1])), []
    while left:
        verdict = left[0].rank[0]
        alike = [s for s in left if s.rank[0] == verdict]
        least = min(s.rank[1] for s in alike)
        close = [s for s in alike if s.rank[1] <= _ALIKE * least]
        best = min(close, key=lambda s: (s.parameters, -s.score))
        out.append(best)
        left.remove(best)
    return out


# ------------------------------------------------------------------------- units and names


def _best_variant(
    name: str, log: Log, signals: Sequence[Column], timed: bool
) -> Iterator[Suggestion]:
    """Yield the variant of a family that uses the columns best, if any can."""
    family = get_family(name)
    variants = family.variants_for(family.options_type())
    candidates = (_assign(name, v, log, signals, timed) for v in variants)
    usable = [s for s in candidates if s is not None]
    if usable:
        yield max(usable, key=lambda s: s.score)


def _assign(
    family: str, variant: Variant, log: Log, columns: Sequence[Column], timed: bool
) -> Suggestion | None:
    """Assign the columns that suit the roles of a variant best."""
    roles = [r for r in variant.roles if r.name != "time"]
    required = [r for r in roles if r.required]
    named = {*log.bindings, *log.units, *log.scales, *log.holds} - {r.name for r in variant.roles}
    if len(columns) < len(required) or named:
        return None  # a role that the user speaks of is another family's
    if not timed and any(r.name == "time" and r.required for r in variant.roles):
        return None
    scores = np.array([[_score(log, r, c) for c in columns] for r in required])
    rows, chosen = linear_sum_assignment(scores, maximize=True)
    told = [scores[i, j] for i, j in zip(rows, chosen) if required[i].unit != "1"]
    if scores[rows, chosen].min() <= 0.0 or min(told) < _ALSO:
        return None  # neither unit nor name tells of some role what it is
    taken = {required[i].name: columns[j] for i, j in zip(rows, chosen, strict=True)}
    timeless = not any(r.name == "time" and r.required for r in variant.roles)
    if not _alike(variant, taken) or _has_copy(list(taken.values()), timeless):
        return None
    total = float(scores[rows, chosen].sum())
    for role in (r for r in roles if not r.required):
        left = [c for c in columns if c not in taken.values()]
        best = max(left, key=lambda c: _score(log, role, c), default=None)
        if best is not None and _score(log, role, best) > _MEASURED:
            taken[role.name] = best
            total += _score(log, role, best)
    unused = [c for c in columns if c not in taken.values() and c.unit]
    taken, unsure = _in_order(log, variant, taken)
    ends = [(r.name, variant.output.name) for r in variant.driving if variant.output.name in taken]
    against = [(r, o) for r, o in ends
               if r in taken and direction(taken[r].values, taken[o].values) < 0]  # fmt: skip
    return Suggestion(
        family, variant.name, {r: f"#{c.index}" for r, c in taken.items()},
        total / len(taken) + _USED * len(taken) / (len(taken) + len(unused)), unsure,
        against=tuple(against),
    )  # fmt: skip


def _varies(column: Column) -> bool:
    known = column.values[np.isfinite(column.values)]
    return known.size > 1 and float(np.ptp(known)) > 0.0 and not column.part_of


def _alike(variant: Variant, taken: Mapping[str, Column]) -> bool:
    """Return whether roles of which only the ratio matters are in one quantity."""
    units = [taken[r].unit or "1" for r in variant.alike if r in taken]
    return all(same_dimension(u, units[0]) for u in units)


def _has_copy(columns: Sequence[Column], timeless: bool) -> bool:
    """True if one of several columns was computed from another: a family would fit the formula.

    A calibration may be a straight line of two columns, which is all that there is to fit.
    """
    return not (timeless and len(columns) == 2) and any(
        factor_between(a.values, b.values) is not None for a, b in combinations(columns, 2)
    )


def _score(log: Log, role: Role, column: Column) -> float:
    """Score of a column for a role, by its unit and its name."""
    wanted = log.bindings.get(role.name)
    if wanted is not None:
        named = wanted in (f"#{column.index}", column.header, column.name)
        return 2.0 * _NAMED if named else _IMPOSSIBLE
    unit = log.units.get(role.name) or column.unit
    others = [u for u in role.alternatives if unit and same_dimension(unit, u)]
    if unit is None:
        measured = _MEASURED if role.unit == "1" else _UNKNOWN
    elif role.unit == "1":
        measured = _UNKNOWN  # a raw reading may be in anything
    elif same_dimension(unit, role.unit):
        measured = _MEASURED
    elif others:
        measured = _ALSO
    else:
        return _IMPOSSIBLE
    words = _words(column)
    if "_".join(words) == role.name or column.name.casefold() == role.name:
        return measured + _NAMED
    called = _is_called(role.name, words)
    asked_for = role.name not in _SET_POINTS and bool(_REFERENCES & set(words))
    another = not called and bool(_QUANTITIES & set(words))
    return measured + _CALLED * called - _DOUBT * (asked_for or another)


def _is_called(role: str, words: Sequence[str]) -> bool:
    """Return whether words name a role, or what it is and which of two: ``Druck B``."""
    if {*words, "".join(words)} & set(_WORDS.get(role, "").split()):
        return True
    kind, _, number = role.rpartition("_")
    which = _ORDINALS.get(number, frozenset()) & set(words)
    return bool(which) and bool(set(_WORDS.get(kind, "").split()) & set(words))


def _words(column: Column) -> list[str]:
    """Words of the name of a column, lower case."""
    text = "".join(c if c.isalnum() else " " for c in (column.name or "").casefold())
    return text.split()


# ----------------------------------------------------------- where units and names fall short


def _lacking_one(
    names: Sequence[str], log: Log, signals: Sequence[Column], timed: bool
) -> Iterator[Suggestion]:
    """Yield families that have all but one of their roles in the columns, and use all of these."""
    signals = _without_copies(signals)
    for name in names:
        for variant in get_family(name).variants:
            required = [r for r in variant.roles if r.required and r.name != "time"]
            needs_time = any(r.name == "time" and r.required for r in variant.roles)
            if len(required) != len(signals) + 1 or not signals or (needs_time and not timed):
                continue
            if {*log.bindings, *log.units, *log.scales} - {r.name for r in variant.roles}:
                continue  # a role that the user speaks of is another family's
            scores = np.array([[_score(log, r, c) for c in signals] for r in required])
            rows, chosen = linear_sum_assignment(scores, maximize=True)
            if scores[rows, chosen].min() < _MEASURED:
                continue
            lacking = next(r for k, r in enumerate(required) if k not in rows)
            if lacking.output:
                continue  # what is fitted has to be recorded
            alone = needs_time and lacking in variant.driving
            option = f"--step {lacking.name}=FROM:TO" if alone else f"--set {lacking.name}=VALUE"
            how = "stepped" if alone else "was constant"
            yield Suggestion(
                name, variant.name,
                {required[i].name: f"#{signals[j].index}" for i, j in zip(rows, chosen)},
                float(scores[rows, chosen].mean()), asked=(option,), guessed=True,
                reason=f"it needs {lacking.name} as well: record it, or give {option} where it "
                f"{how}.",
            )  # fmt: skip
            break


def _by_order(
    names: Sequence[str], log: Log, signals: Sequence[Column], timed: bool
) -> Iterator[Suggestion]:
    """Yield families of two plain numbers, where nothing tells what they are: the leader drives."""
    signals = _without_copies(signals)
    named = {*log.bindings, *log.units, *log.scales, *log.holds} - {"time"}
    if len(signals) != 2 or named or any(c.unit or _words(c) for c in signals):
        return
    first = leads(signals[0].values, signals[1].values)
    pair = signals if first is not False else signals[::-1]
    why = "neither names nor units tell what the columns are"
    why += "" if first is None else f"; #{pair[0].index} leads #{pair[1].index} and may drive it"
    for name in names:
        for variant in get_family(name).variants[:1]:
            required = [r for r in variant.roles if r.required and r.name != "time"]
            needs_time = any(r.name == "time" and r.required for r in variant.roles)
            plain = all("1" in (r.unit, *r.alternatives) for r in required[:-1])
            if len(required) != 2 or needs_time is (first is None) or not plain:
                continue
            yield Suggestion(
                name, variant.name, {r.name: f"#{c.index}" for r, c in zip(required, pair)}, 0.0,
                reason=f"{why}.", guessed=True,
                unsure=((required[0].name, required[1].name),) if first is None else (),
                asked=("--sample-time SECONDS",) if needs_time and not timed else (),
            )  # fmt: skip


def _without_copies(signals: Sequence[Column]) -> list[Column]:
    """Columns less those that were computed from an earlier one."""
    out: list[Column] = []
    for column in signals:
        if all(factor_between(c.values, column.values) is None for c in out):
            out.append(column)
    return out


# ---------------------------------------------------------------------------- what the log does


def _in_order(
    log: Log, variant: Variant, taken: Mapping[str, Column]
) -> tuple[dict[str, Column], tuple[tuple[str, str], ...]]:
    """Columns of input and output that suit either role as well, in the order of their changes."""
    found, unsure = dict(taken), []
    output = variant.output
    for role in (r for r in variant.driving if r.name in found and output.name in found):
        a, b = found[role.name], found[output.name]
        straight = _score(log, role, a) + _score(log, output, b)
        if abs(straight - _score(log, role, b) - _score(log, output, a)) > 1e-9:
            continue
        first = leads(a.values, b.values)
        if first is None:
            unsure.append((role.name, output.name))
        elif not first:
            found[role.name], found[output.name] = b, a
    return found, tuple(unsure)


def _tried(
    s: Suggestion, logs: Sequence[Log], progress: Callable[[str], None] | None
) -> Suggestion:
    """A suggestion with what came of a fit."""
    if progress is not None:
        progress(f"trying {s.family}")
    try:
        result = fit(s.family, [_bound(log, s) for log in logs])
    except NotIdentifiedError as error:
        return replace(s, verdict="refused", reason=_one_line(error))
    except (UsageError, LogError) as error:
        return replace(s, reason=_one_line(error), asked=tuple(_OPTION.findall(error.remedy)))
    free = [q for q in result.parameters.values() if q.status == "estimated"]
    lost = [n for n, q in result.parameters.items() if q.status == "not_identified"]
    said = [n.message for n in result.notices if n.code == "not-identified"]
    return replace(
        s, verdict=str(result.verdict), fit_percent=result.document.fit.fit_percent,
        parameters=sum(np.size(q.value) for q in free),
        not_identified={n: next((m for m in said if m.startswith(f"{n} ")), "") for n in lost},
        result=result,
    )  # fmt: skip


def _one_line(error: FluidactError) -> str:
    """Refusal and remedy in one line, in the words of the command line."""
    said = [error.what, error.expected.replace("Nothing was written.", ""), error.remedy]
    ended = (text if text.rstrip().endswith((".", ":")) else f"{text}." for text in said if text)
    return " ".join(" ".join(ended).split())


def _bound(log: Log, s: Suggestion) -> Log:
    bindings = {**log.bindings, **s.columns}
    time = time_candidate(log)
    if time is not None and log.sample_time is None:
        bindings.setdefault("time", f"#{time.column.index}")
    roles = {r.name for r in get_family(s.family).variant(s.variant).roles}
    return replace(log, bindings={r: at for r, at in bindings.items() if r in roles})


# --------------------------------------------------------------------------------- the command


def column_options(s: Suggestion, log: Log) -> list[str]:
    """``--column`` of every role that a fit would not find by itself."""
    out = []
    for role, at in _bound(log, s).bindings.items():
        if role in log.bindings:
            continue  # the user has given it
        column = next(c for c in log.columns if f"#{c.index}" == at)
        try:
            known = default_column(log, role)
        except LogError:
            known = None
        if known is not column:
            header = column.header.strip()
            plain = header and sum(c.header.strip() == header for c in log.columns) == 1
            out += ["--column", f"{role}={header if plain else at}"]
    return out


def _given(log: Log) -> list[str]:
    """Options by which the user described a log."""
    out = []
    by_role = {"column": log.bindings, "unit": log.units, "scale": log.scales, "hold": log.holds}
    for option, values in by_role.items():
        for role, value in values.items():
            text = f"{value:.12g}" if isinstance(value, float) else str(value)
            out += [f"--{option}", f"{role}={text}"]
    if log.sample_time is not None:
        out += ["--sample-time", f"{log.sample_time:.12g}"]
    if log.window_text.strip(":"):
        out += ["--window", log.window_text]
    for part in log.exclude:
        out += ["--exclude", part.text]
    return [*out, "--invalid", log.invalid] if log.invalid is not None else out


def _with_command(s: Suggestion, log: Log, typed: Sequence[str]) -> Suggestion:
    asked = [word for option in s.asked for word in option.split()]
    words = ["fluidact-fit", s.family, *typed, *column_options(s, log), *asked,
             "-o", f"{s.family}.yaml"]  # fmt: skip
    return replace(s, command=shell_command(words), powershell=powershell_command(words))
