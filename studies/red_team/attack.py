"""What an attack is, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Recording = Mapping[str, Array]
"""One log: role to samples [SI], ``time`` among them where there is one."""


@dataclass(frozen=True)
class Error:
    """Error of one written parameter, or of what follows from several.

    ``deviations`` is it in stated standard errors, ``relative`` in parts of the scale;
    ``held`` whether the 95 % interval holds the truth.
    """

    deviations: float
    relative: float
    held: bool

    @classmethod
    def of(
        cls, value: float, truth: float, error: float, ends: Sequence[float], scale: float
    ) -> Error:
        """That of a value with a standard error and an interval.

        Of a skew interval, as that of a weight is, whose logarithm was estimated, the standard
        error is taken in the proportion of the side on which the truth lies.
        """
        low, high = ends
        miss, half = value - truth, 0.5 * (high - low)
        side = value - low if miss > 0.0 else high - value
        if half > 0.0:
            error *= side / half
        return cls(miss / max(error, 1e-300), miss / scale, bool(low <= truth <= high))


@dataclass(frozen=True)
class Attack:
    """A machine recorded in one way, with one thing wrong or unusual.

    Attributes
    ----------
    family
        Whose estimator is attacked.
    group, name
        Row of the table, and what distinguishes the attack within it.
    truth
        Parameters that the written values are compared with [SI], entries of lists as
        ``levels[2]``. What has no counterpart in the machine (the gain of a machine of
        another structure) is left out.
    record
        Simulates the logs with the given random numbers.
    units
        Role to SI unit.
    options, hold, fixed
        As given to ``fit``.
    scales
        What an error is relative to, where that is not the true value itself: the width of
        a dead zone for its edges.
    bounds
        Cramér-Rao standard deviations [SI] where the model is right and the sampling
        sufficient: a parameter whose 95 % interval would be narrower than 20 % must then not
        be refused. A function that gives them is called only when something was refused.
    repetitions
        How often it is recorded and fitted, each time with other random numbers.
    beyond
        Why no log of this kind can show what is wrong; what came of it is listed apart.
    judge
        Errors of what follows from the file but does not stand in it as a parameter, such as
        the points of a curve; called with the fit.
    another
        Draws another machine for each recording, where the errors of one would be the same in
        all: those of a converter that no noise shakes.
    """

    family: str
    group: str
    name: str
    truth: Mapping[str, float]
    record: Callable[[np.random.Generator], Sequence[Recording]]
    units: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    hold: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, float] | Callable[[], Mapping[str, float]] = field(default_factory=dict)
    repetitions: int = 1
    judge: Callable[[Any], Mapping[str, Error]] | None = None
    beyond: str = ""
    another: Callable[[np.random.Generator], Attack] | None = None

    def scale(self, parameter: str) -> float:
        """What the error of a parameter is relative to [SI]."""
        given = self.scales.get(parameter)
        return abs(self.truth[parameter]) if given is None else float(given)

    @property
    def determined(self) -> set[str]:
        """Parameters whose 95 % interval is narrower than 20 %, as the bound has it."""
        bounds = self.bounds() if callable(self.bounds) else self.bounds
        return {n for n, s in bounds.items() if 2.0 * 1.96 * s < 0.2 * self.scale(n)}


@dataclass(frozen=True)
class Result:
    """What came of one recording.

    Attributes
    ----------
    verdict
        ``pass``, ``warn`` or ``fail`` of the file; ``refused`` where nothing was written,
        ``crash`` where the program broke, ``endless`` where it was stopped.
    codes, message
        Warning codes, and the text of a refusal or a crash.
    errors
        Of the parameters that were estimated.
    not_identified
        Those that were written without having been measured.
    wrongly_refused
        Those that the data determine to 20 % and that were refused all the same.
    seconds
        Of processor time.
    beyond
        As in the attack.
    """

    family: str
    group: str
    name: str
    verdict: str
    codes: tuple[str, ...] = ()
    message: str = ""
    errors: Mapping[str, Error] = field(default_factory=dict)
    not_identified: tuple[str, ...] = ()
    wrongly_refused: tuple[str, ...] = ()
    seconds: float = 0.0
    beyond: str = ""

    @property
    def quiet(self) -> bool:
        """Whether the file passed without a word beyond information."""
        from fluidact_fit.notices import is_note

        return self.verdict == "pass" and all(is_note(c) for c in self.codes)

    @property
    def silent(self) -> list[str]:
        """Parameters that are wrong by more than 4 standard errors and 2 % in a passed file."""
        if self.verdict != "pass" or self.beyond:
            return []
        return [
            n for n, e in self.errors.items() if abs(e.deviations) > 4.0 and abs(e.relative) > 0.02
        ]


def with_play(values: Array, width: float) -> Array:
    """What follows values behind play, from the first one on."""
    out, now = np.empty(values.size), float(values[0])
    for k, x in enumerate(values.tolist()):
        now = min(max(now, x - 0.5 * width), x + 0.5 * width)
        out[k] = now
    return out


def cramer_rao(
    simulate: Callable[[Mapping[str, float]], Sequence[Array]],
    truth: Mapping[str, float],
    sigma: float,
    nuisance: Callable[[int], Array] | None = None,
) -> dict[str, float]:
    """Cramér-Rao standard deviations for white noise [SI].

    Parameters
    ----------
    simulate
        Noise-free outputs of all logs.
    truth
        Where; parameters at zero are moved by 1e-5.
    sigma
        Standard deviation of the noise of the output [SI].
    nuisance
        Columns ``(n, q)`` of the unknowns of a log of ``n`` samples; an offset by default.
    """
    columns: list[list[Array]] = []
    for name, value in truth.items():
        h = 1e-5 * abs(value) if value else 1e-5
        up, down = (simulate({**truth, name: value + s * h}) for s in (1.0, -1.0))
        columns.append([(a - b) / (2.0 * h) for a, b in zip(up, down)])
    information = np.zeros((len(truth), len(truth)))
    for parts in zip(*columns):
        j = np.column_stack(parts)
        local = np.ones((j.shape[0], 1)) if nuisance is None else nuisance(j.shape[0])
        j = j - local @ np.linalg.lstsq(local, j, rcond=None)[0]
        information += j.T @ j / sigma**2
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return dict(zip(truth, np.sqrt(np.maximum(np.diag(inverse), 0.0)).tolist()))
