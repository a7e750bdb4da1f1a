"""Linear models with dead time, and the same behind a dead zone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from ..discrete import companion, discretise
from ..errors import UsageError
from ..estimation.inputs import PiecewiseInput, apply_dead_zone
from ..estimation.linear import forced_response
from ..experiment import FloatArray, Hold
from ..parameters import ParameterDocument
from .base import ModelBlock, Port
from .section import Difference, Section


@dataclass(frozen=True)
class TransferFunction:
    """``exp(-dead_time s) numerator(s) / denominator(s)``, falling powers of ``s``."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time: float

    @property
    def gain(self) -> float | None:
        """Steady output per input; ``None`` for an integrating model."""
        last = self.denominator[-1]
        return None if last == 0.0 else self.numerator[-1] / last


class DynamicBlock(ModelBlock):
    """A linear model that steps once per sample.

    The difference equation is the exact sampling of the continuous model for an input
    that is held between samples, whatever its dead time.
    """

    def __init__(
        self, document: ParameterDocument, section: Section, input: Port, output: Port
    ) -> None:
        super().__init__(document, input, output)
        self._section = section
        self._use(section.discrete)
        self.reset()

    def _use(self, discrete: Difference | None) -> None:
        self._discrete = discrete
        self._num: list[float] = list(discrete.numerator) if discrete else []
        self._den: list[float] = list(discrete.denominator) if discrete else []

    @property
    def sample_time(self) -> float:
        """Period of :meth:`step` [s]; 0 when the file holds no discrete model."""
        return self._discrete.sample_time if self._discrete else 0.0

    def transfer_function(self) -> TransferFunction:
        """Return the continuous model (without a dead zone, which stands before it)."""
        s = self._section
        return TransferFunction(s.numerator, s.denominator, s.dead_time)

    def difference_equation(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return numerator and denominator of the discrete model, rising powers of ``1/z``."""
        return tuple(self._num), tuple(self._den)

    def with_sample_time(self, sample_time: float) -> Self:
        """Return the same model, at rest, stepping at another period.

        Parameters
        ----------
        sample_time
            [s]
        """
        if not (np.isfinite(sample_time) and sample_time > 0.0):
            raise UsageError(f"sample_time {sample_time!r} is not a positive number")
        s = self._section
        d = discretise(s.numerator, s.denominator, sample_time, "zoh", s.dead_time)
        discrete = Difference(sample_time, tuple(d["numerator"]), tuple(d["denominator"]))
        section = replace(s, discrete=discrete)
        return type(self)(self.document, section, self.input, self.output)

    def actuate(self, value: float) -> float:
        """Return what reaches the linear model [unit of the input]: the input itself."""
        return value

    def reset(self, *, input: float = 0.0, output: float | None = None) -> None:
        """Return to rest.

        Parameters
        ----------
        input
            Input that was applied until now [unit of the input]. An integrating model is at
            rest only without input: what passes its dead zone then acts from now on.
        output
            Output at rest [unit of the output]; what the input gives in the long run when
            left out, 0 for an integrating model. Anything else stays as an offset.
        """
        level, start = self._rest(input, output)
        self._level, self._start = level, start
        self._state = [0.0] * max(len(self._num) - 1, 1)

    def _rest(self, input: float, output: float | None) -> tuple[float, float]:
        """Input and output about which the linear model moves."""
        gain = self.transfer_function().gain
        if gain is None:
            return 0.0, 0.0 if output is None else output
        level = self.actuate(input)
        return level, gain * level if output is None else output

    def step(self, value: float) -> float:
        """Take the input of this sample and return the output at the same instant.

        The input acts until the next call, one ``sample_time`` later.

        Parameters
        ----------
        value
            [unit of the input]

        Returns
        -------
        float
            [unit of the output]

        Raises
        ------
        UsageError
            When the file holds no discrete model.
        """
        if not self._num:
            raise UsageError(
                "the parameter file holds no discrete model",
                remedy="Use with_sample_time(...), or fit with --controller-sample-time.",
            )
        num, den, state = self._num, self._den, self._state
        u = self.actuate(value) - self._level
        y = num[0] * u + state[0]
        last = len(state) - 1
        for i in range(last):  # direct form II transposed
            state[i] = num[i + 1] * u - den[i + 1] * y + state[i + 1]
        if len(num) > 1:
            state[last] = num[last + 1] * u - den[last + 1] * y
        return y + self._start

    def simulate(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
    ) -> FloatArray:
        """Simulate a whole record from rest; the state of :meth:`step` is not touched.

        Parameters
        ----------
        values : (n,)
            Input [unit of the input].
        time : (n,), optional
            Instants [s], evenly spaced or not. The continuous model is then solved exactly
            for an input that moves as ``hold`` says. Without it the samples are one
            ``sample_time`` apart and the difference equation is stepped.
        hold
            ``"zoh"``, ``"linear"``, ``"cubic"`` or ``"foh"`` (cubic where the samples are
            smooth, else straight lines).
        before
            Input before the first sample; the first value when left out.
        output
            Output before the first sample, as in :meth:`reset`.

        Returns
        -------
        (n,)
            Output [unit of the output].
        """
        if time is None:
            return self._stepped(np.asarray(values, dtype=float), before, output)
        u, t, ahead = self._signal(values, time, hold, before)
        level, start = self._rest(ahead, output)
        moved = self._shape(u)
        coefficients = moved.coefficients.copy()
        coefficients[:, 0] -= level
        a, b, c = _balanced(self._section)
        y = forced_response(
            a, b, c, replace(moved, coefficients=coefficients), t,
            dead_time=self._section.dead_time,
        )  # fmt: skip
        return np.asarray(np.real(y) + start)

    def _stepped(self, u: FloatArray, before: float | None, output: float | None) -> FloatArray:
        copy = type(self)(self.document, self._section, self.input, self.output)
        if u.size:
            copy.reset(input=float(u[0]) if before is None else before, output=output)
        return np.array([copy.step(v) for v in u.tolist()], dtype=float)

    def _shape(self, u: PiecewiseInput) -> PiecewiseInput:
        """What reaches the linear model of a whole input."""
        return u


class HammersteinBlock(DynamicBlock):
    """A linear model behind a dead zone of slope one: ``DZ(u) -> linear model``."""

    def __init__(
        self, document: ParameterDocument, section: Section, input: Port, output: Port
    ) -> None:
        assert section.dead_zone is not None
        self._low, self._high = section.dead_zone
        super().__init__(document, section, input, output)

    @property
    def dead_zone(self) -> tuple[float, float]:
        """Negative and positive edge [unit of the input]."""
        return self._low, self._high

    def actuate(self, value: float) -> float:
        """Return what passes the dead zone [unit of the input]."""
        if value > self._high:
            return value - self._high
        return value - self._low if value < self._low else 0.0

    def dead_zone_inverse(self, force: float, *, band: float = 0.0) -> float:
        """Return the input that makes ``force`` act behind the dead zone.

        ``dead_zone_inverse(w) = w + edge`` on the side of ``w``, so that the dead zone and
        its inverse in series do nothing.

        Parameters
        ----------
        force
            Wanted behind the dead zone [unit of the input].
        band
            Half-width about zero within which the jump from edge to edge is replaced by a
            straight line [unit of the input]: noise about zero then does not rattle.
        """
        if abs(force) < band:
            edge = self._high if force > 0.0 else -self._low
            return force * (1.0 + edge / band)
        if force > 0.0:
            return force + self._high
        return force + self._low if force < 0.0 else 0.0

    def _shape(self, u: PiecewiseInput) -> PiecewiseInput:
        return apply_dead_zone(u, self._low, self._high)


def _balanced(section: Section) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State space in a time scale in which the coefficients are of order one."""
    den = np.asarray(section.denominator) / section.denominator[0]
    order = den.size - 1
    sizes = [abs(d) ** (1.0 / k) for k, d in enumerate(den) if k > 0 and d != 0.0]
    rate = max(sizes) if sizes else 1.0
    powers = rate ** -np.arange(order + 1.0)
    num = np.zeros(order + 1)
    num[order + 1 - len(section.numerator) :] = section.numerator
    a, b, c = companion(
        (num * powers / section.denominator[0])[1:].tolist(), (den * powers).tolist()
    )
    return a * rate, b * rate, c
