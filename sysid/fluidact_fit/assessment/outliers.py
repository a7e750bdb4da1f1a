"""Outliers of an output: samples that the model of all others contradicts.

A spike that stands out of its record is replaced when the log is read (:mod:`.logs.spikes`). A
smaller one shows only beside the model: its residual is one that none of that many samples
should have, those beside it are as usual, and no input jumped. Such a sample is set aside by
putting in its place what the model of the other samples gives there, and the fit is done again.
With the hat matrix ``H`` of the fit and its residuals ``r``, what the model of the others misses
the samples ``S`` by is ``(I - H_SS)^-1 r_S`` [1]_, so one fit more settles them.

Only where nothing is left that stands alone is that an answer. Where the model misses several
samples in a row, or those after a jump of an input, it is the model that is wrong there, and no
sample is set aside.

References
----------
.. [1] R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982, section 3.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import Notice
from ..experiment import Experiment, FloatArray
from ..logs.log import count_of
from ..logs.spikes import where_inputs_move
from .leverage import Effect, Influence
from .optimum import Optimum

_WIDE = 2  # samples that an outlier may be wide
_SHARE = 0.005  # largest part of the samples that can be outliers
_MOST = 100  # and their largest number: more are not few
_HELD = 0.05  # leverage beyond which a sample holds a parameter that the others do not
_LISTED = 5


@dataclass(frozen=True)
class Outlier:
    """A sample that was set aside.

    ``place`` says where it is, ``measured`` and ``replaced`` what was recorded and what it was
    fitted with [``unit``], ``text`` both in the unit of the log; ``run`` and ``sample`` count
    from 0.
    """

    run: int
    role: str
    sample: int
    place: str
    measured: float
    replaced: float
    unit: str
    text: str = ""

    @property
    def entry(self) -> dict[str, Any]:
        """As the file has it."""
        names = ("place", "role", "measured", "replaced", "unit")
        return {name: getattr(self, name) for name in names}


def find_outliers(at: Optimum | None) -> list[Outlier] | None:
    """Samples to set aside; ``None`` where one is outlying that cannot be."""
    influence = None if at is None else at.influence
    if at is None or influence is None:
        return []
    found = [e for e in influence.effects if e.outlying]
    if not found:
        return []
    samples = at.samples
    if len(found) > most_outliers(samples) or any(e.leverage >= _HELD for e in found):
        return None
    if not _alone(at, influence, found):
        return None
    out = []
    for e, more in zip(found, _missed_by_the_others(at, influence, found)):
        s = at.series[e.series]
        signal, k = s.experiment.signals[s.role], int(np.flatnonzero(s.used)[e.row])
        if signal.values.size != s.used.size:
            return None
        value = float(signal.values[k])
        left = value - float(more) * s.scale
        place = at.place(e.series, e.row)
        text = f"{signal.text(value, '.4g')} instead of {signal.text(left, '.4g')}"
        out.append(Outlier(s.run, s.role, k, place, value, left, signal.unit, text))
    return out


def most_outliers(samples: int) -> int:
    """How many of that many samples can be outliers."""
    return int(min(_MOST, max(3, _SHARE * samples)))


def _alone(at: Optimum, influence: Influence, found: Sequence[Effect]) -> bool:
    """Whether each has few odd samples beside it, and no input jumped there."""
    for series in {e.series for e in found}:
        s, odd = at.series[series], influence.odd[series]
        if np.any(odd[_WIDE:] - odd[:-_WIDE] == _WIDE):  # more in a row than that
            return False
        if s.experiment.time.size:
            moved = where_inputs_move(s.experiment, at.variant)[s.used]
            if any(moved[e.row] for e in found if e.series == series):
                return False
    return True


def _missed_by_the_others(at: Optimum, influence: Influence, found: Sequence[Effect]) -> FloatArray:
    """Residuals of some samples from the model of all others, shape ``(m,)``."""
    q = np.array([at.jacobians[e.series][e.row] for e in found]) @ influence.inverse
    r = np.array([at.residuals[e.series][e.row] for e in found])
    return np.asarray(np.linalg.solve(np.eye(len(found)) - q @ q.T, r))


def set_aside(runs: Sequence[Experiment], outliers: Sequence[Outlier]) -> list[Experiment]:
    """The same runs with what the model gives in the place of outliers."""
    out = list(runs)
    for o in outliers:
        run = out[o.run]
        signal = run.signals[o.role]
        values = signal.values.copy()
        values[o.sample] = o.replaced
        recorded = {o.sample: o.measured, **signal.recorded}
        signal = replace(signal, values=values, recorded=recorded)
        out[o.run] = replace(run, signals={**run.signals, o.role: signal})
    return out


def outlier_notice(outliers: Sequence[Outlier]) -> Notice:
    """A warning that names what was set aside."""
    n = len(outliers)
    listed = "; ".join(f"{o.place}: {o.text}" for o in outliers[:_LISTED])
    more = f"; and {n - _LISTED} more, all in fit.details" if n > _LISTED else ""
    one = n == 1
    verb, was, which = ("lies", "was", "it lies") if one else ("lie", "were", "they lie")
    return Notice(
        "outliers",
        f"{count_of(n, 'sample')} {verb} where the model of all others cannot be, and {was} left "
        f"out of the fit, which would have followed {'it' if one else 'them'} ({listed}{more}). "
        f"Check the cable, the converter and the logger; where {which} at reversals, sample "
        "faster.",
    )
