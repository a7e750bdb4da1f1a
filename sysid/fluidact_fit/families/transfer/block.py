"""A linear model with dead time behind an optional dead zone, stepped once per sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import LinearBlock, LinearModel, SampleSimulator
from ...errors import UsageError
from ...estimation.inputs import apply_dead_zone, make_signal, piecewise
from ...estimation.linear import forced_response
from ...estimation.sampled import Sampled, Stepper, difference_equation, discretise, sample
from ...estimation.transfer_model import EDGES, input_level, state_space
from ...experiment import Experiment, FloatArray, Hold, Signal
from ...parameters.document import ParameterDocument
from ...routines import Routine
from ...specification import Variant


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

    def state_space(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """``(A, B, C)`` without the dead time, in a time scale of its own."""
        return state_space(self.numerator, self.denominator)


class TransferBlock(LinearBlock, SampleSimulator):
    """A linear model that steps once per sample, with a dead zone before it where it has one.

    The difference equation is the exact sampling of the continuous model for an input that
    is held between samples, whatever its dead time.
    """

    def __init__(
        self, document: ParameterDocument, variant: Variant,
        law: Callable[[Mapping[str, float]], TransferFunction],
    ) -> None:  # fmt: skip
        super().__init__(document, variant)
        self._law = law

    def _begin(self) -> None:
        self._stepper: Stepper | None = None  # nothing has been put in yet

    @cached_property
    def _linear(self) -> TransferFunction:
        return self._law(self.numbers())

    @cached_property
    def dead_zone(self) -> tuple[float, float] | None:
        """Negative and positive edge [unit of the input]; ``None`` for a linear model."""
        if EDGES[0] not in self.parameters:
            return None
        values = self.numbers()
        return values[EDGES[0]], values[EDGES[1]]

    def transfer_function(self) -> TransferFunction:
        """Return the continuous model (without a dead zone, which stands before it)."""
        return self._linear

    def linear_model(self) -> LinearModel:
        """Return the model in state space, in a time scale of its own."""
        f = self._linear
        return LinearModel(*f.state_space(), f.dead_time, self.dead_zone, f.gain)

    def _sampled(self) -> Sampled:
        """Return the discrete model in state space."""
        self._need_sample_time("discrete model")
        f = self._linear
        return sample(*f.state_space(), f.dead_time, self.sample_time)

    def difference_equation(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return numerator and denominator of the discrete model, rising powers of ``1/z``."""
        self._need_sample_time("discrete model")
        f = self._linear
        d = discretise(f.numerator, f.denominator, self.sample_time, f.dead_time)
        return tuple(d["numerator"]), tuple(d["denominator"])

    def to_control(self, *, discrete: bool = False, pade: int = 0) -> Any:
        """Return the model as a transfer function of python-control.

        The dead zone stands before it, as in :meth:`transfer_function`, and is not part of it.

        Parameters
        ----------
        discrete
            The discrete model at :attr:`sample_time`, exact with its dead time.
        pade
            Order of the Pade approximation of the dead time, which python-control has no
            other form of in continuous time.

        Returns
        -------
        control.TransferFunction
            Output per input [unit of the output/unit of the input].

        Raises
        ------
        UsageError
            When python-control is not installed, the file holds no discrete model, or a dead
            time would be lost.
        """
        try:
            import control
        except ImportError:
            raise UsageError(
                "python-control is not installed.",
                remedy="Install it with: pip install 'fluidact-fit[control]'",
            ) from None
        if discrete:
            return control.tf(*map(list, self.difference_equation()), self.sample_time)
        f = self._linear
        if f.dead_time > 0.0 and pade < 1:
            raise UsageError(
                f"python-control has no dead time in continuous time, here {f.dead_time:g} s",
                remedy="Give pade=3 for an approximation, or discrete=True for the exact discrete "
                "model.",
            )
        delay = control.tf(*control.pade(f.dead_time, pade)) if f.dead_time > 0.0 else 1.0
        return delay * control.tf(list(f.numerator), list(f.denominator))

    def actuate(self, value: float) -> float:
        """Return what reaches the linear model [unit of the input]."""
        low, high = self.dead_zone or (0.0, 0.0)
        return max(value - high, 0.0) + min(value - low, 0.0)

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
            straight line [unit of the input]: noise about zero then causes no chatter.
        """
        low, high = self.dead_zone or (0.0, 0.0)
        if force == 0.0:
            return 0.0
        share = abs(force) / band if abs(force) < band else 1.0
        return force + share * (high if force > 0.0 else low)

    def reset(self, *, input: float = 0.0, output: float | None = None) -> None:
        """Return to rest.

        Parameters
        ----------
        input
            Input that was applied until now [unit of the input]. An integrating model is at
            rest only without input: what passes its dead zone then acts from now on.
        output
            Output at rest [unit of the output]; what the input gives in the long run, with
            the :attr:`offset`, when left out; 0 for an integrating model.
        """
        model = self._sampled()
        self._level, self._start = self._rest(input, output)
        self._stepper = Stepper(model, np.zeros(model.new.size))

    def _rest(self, input: float, output: float | None) -> tuple[float, float]:
        """Input and output about which the linear model moves."""
        gain = self._linear.gain
        if gain is None:
            return 0.0, 0.0 if output is None else output
        level = self.actuate(input)
        return level, gain * level + self.offset if output is None else output

    def _step(self, value: float) -> float:
        """Take one step of the discrete model."""
        if self._stepper is None:
            self.reset()
        assert self._stepper is not None
        return self._stepper.step(self.actuate(value) - self._level) + self._start

    def simulate_samples(
        self,
        values: npt.ArrayLike,
        time: npt.ArrayLike | None = None,
        *,
        hold: Hold = "zoh",
        before: float | None = None,
        output: float | None = None,
    ) -> FloatArray:
        """Simulate a whole record from rest; see :meth:`.SampleSimulator.simulate_samples`.

        With instants the continuous model is solved exactly for an input that moves as ``hold``
        says, without them the difference equation is stepped. ``output`` is as in :meth:`reset`.
        """
        role = self.variant.driving[0]
        self.watch(**{role.name: values})
        if time is None:
            return self._stepped(np.asarray(values, dtype=float), before, output)
        signal = make_signal(role.name, values, time, role.unit, hold)
        level = float(signal.values[0]) if before is None else before
        return self._respond(signal, signal.time, level, output)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Output from the input of an experiment, from rest; see :meth:`.Block.predict`."""
        signal = experiment.signals[self.variant.driving[0].name]
        return self._respond(signal, experiment.time, input_level(signal), None)

    def routines(self) -> Sequence[Routine]:
        """One step of the model, and the inverse of its dead zone where it has one."""
        from .routines import dead_zone_routine, step_routine

        input, output = self._port(self.variant.driving[0]), self.output
        argument = self.argument(input.role, "input of this sample")
        result = output.role, output.unit, 0.0 if self._linear.gain is None else self.offset
        law = difference_equation(self._sampled())
        step = step_routine(argument, self.dead_zone, law, result, self.sample_time)
        if self.dead_zone is None:
            return [step]
        return [step, dead_zone_routine(argument, self.dead_zone)]

    def _respond(
        self, signal: Signal, instants: FloatArray, before: float, output: float | None
    ) -> FloatArray:
        """Response to an input after a level of rest, exactly."""
        (level, start), u = self._rest(before, output), piecewise(signal)
        if self.dead_zone is not None:
            u = apply_dead_zone(u, *self.dead_zone)
        u = replace(u, coefficients=u.coefficients - level * np.eye(1, u.coefficients.shape[1]))
        f = self._linear
        y = forced_response(*f.state_space(), u, instants, dead_time=f.dead_time)
        return np.asarray(np.real(y) + start)

    def _stepped(self, u: FloatArray, before: float | None, output: float | None) -> FloatArray:
        copy = self.with_sample_time(self.sample_time) if self.sample_time else self
        if u.size:
            copy.reset(input=float(u[0]) if before is None else before, output=output)
        return np.array([copy.step(v) for v in u.tolist()], dtype=float)
