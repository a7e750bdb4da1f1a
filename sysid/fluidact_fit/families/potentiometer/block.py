"""A calibrated potentiometer for a controller: in Python, and as the code that one runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...block import Block, as_motion_state
from ...experiment import Experiment, FloatArray
from ...parameters.document import ParameterDocument
from ...routines import (
    Argument,
    Draft,
    Expression,
    Name,
    Routine,
    Solve,
    choose,
    constant,
    maximum,
    minimum,
    polynomial,
)
from ...specification import Variant
from ...units import after_number
from .calibration import Calibration, rising_share
from .rational_bezier import power_coefficients

_HALVINGS = 30
_LEAST_BAND = 1e-6  # of the readings: what is turned by less is beyond single precision
_BRANCHES = ("curve", "falling")
_CALLED = {"m": "position", "rad": "angle", "Pa": "pressure", "N": "force", "N m": "torque"}


class PotentiometerBlock(Block):
    """A calibrated potentiometer: reading in, metres (or what the reference was in) out.

    With two branches an array is a recording, its direction found from the start; a
    controller that gets one reading at a time calls `step`, which remembers the direction.
    ``direction`` (1 rising, -1 falling, 0 between) overrides both.
    """

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        super().__init__(document, variant)
        self.reset()

    @cached_property
    def _calibration(self) -> Calibration:
        return Calibration.of(self.parameters)

    def reset(self) -> None:
        """Forget the direction of motion."""
        self._last, self._state = float("nan"), 0.0

    def __call__(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Position of a reading or an array of readings [unit of the reference]; clamped."""
        self.watch(reading=reading)
        y = self._calibration.position(np.asarray(reading, dtype=float), direction)
        return float(y) if y.ndim == 0 else y

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """Position and its inverse; see :meth:`.Block.methods`."""
        return {called(self.output.unit): self, "reading_at": partial(self.inverse, clamp=True)}

    def routines(self) -> Sequence[Routine]:
        """Position of a reading, and the reading at a position of a monotone curve."""
        unit = self.argument("reading", "raw reading").unit
        return routines_of(self._calibration, unit, self.output.unit)

    def predict(self, experiment: Experiment) -> FloatArray:
        """Positions of a recording; see :meth:`.Block.predict`."""
        return self._calibration.position(experiment.sampled("reading"))

    def step(self, reading: float) -> float:
        """Position of the next reading of a controller [unit of the reference].

        Raises
        ------
        ValueError
            When the reading is not a finite number; the direction is then as before.
        """
        c, reading = self._calibration, self.sample("reading", reading)
        if len(c.curves) > 1:
            pair = np.array([reading if np.isnan(self._last) else self._last, reading])
            share = rising_share(pair, c.dead_band, self._state)[-1]
            self._last, self._state = reading, float(2.0 * share - 1.0)
        return float(c.value(c.place(np.asarray(reading)), 0.5 + 0.5 * self._state))

    def sensitivity(
        self, reading: npt.ArrayLike, direction: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Change of position per reading [unit of the reference per that of the reading].

        0 beyond the range.
        """
        s = self._calibration.slope(np.asarray(reading, dtype=float), direction)
        return float(s) if s.ndim == 0 else s

    def inverse(
        self, metres: npt.ArrayLike, direction: float = 0.0, *, clamp: bool = False
    ) -> float | FloatArray:
        """Reading at a position, to the spacing of floating point numbers.

        Parameters
        ----------
        metres : scalar or (n,)
            [unit of the reference]: metres where that was a position.
        direction
            With two branches: 1 rising, -1 falling, 0 the mean of both.
        clamp
            Take the end of the range for positions beyond it.

        Raises
        ------
        ValueError
            When a position is beyond the range (unless clamped) or the curve turns back,
            so that a position has several readings.
        UsageError
            When a direction is not one of these.
        """
        y, c = np.asarray(metres, dtype=float), self._calibration
        if not c.monotone:
            raise ValueError(
                "the curve is not monotone: one position has several readings. "
                "Fit again with monotone=True (--monotone)."
            )
        share = float(0.5 + 0.5 * as_motion_state(direction))
        ends = [float(c.value(np.asarray(t), share)) for t in (0.0, 1.0)]
        slack = 1e-12 * abs(ends[1] - ends[0])
        outside = ~((y >= min(ends) - slack) & (y <= max(ends) + slack))
        if np.any(np.isnan(y)) or (np.any(outside) and not clamp):
            first = float(y[outside].flat[0])
            unit = after_number(self.output.unit)
            raise ValueError(
                f"{first:g}{unit} is outside the calibrated range {min(ends):g} to "
                f"{max(ends):g}{unit}. "
                "Give clamp=True to take the end of the range."
            )
        x = c.low + (c.high - c.low) * c.invert(y, share)
        return float(x) if x.ndim == 0 else x


# ------------------------------------------------------------------- what a controller runs


def called(unit: str) -> str:
    """Name of a quantity in a unit in a controller's code."""
    return _CALLED.get(unit, "value")


def _value(c: Calibration, t: Expression, share: Expression | None) -> Expression:
    """Position at the place ``t``; of two branches by the share of the rising one."""
    found = []
    for (points, weights), name in zip(c.curves, _BRANCHES):
        w = weights / weights.max()
        above = power_coefficients(w * (points - points[0])).tolist()
        below = power_coefficients(w).tolist()
        ratio = polynomial(above, t, f"{name}_above") / polynomial(below, t, f"{name}_below")
        found.append(ratio + constant(f"{name}_first", points[0]))
    return found[0] if share is None else found[1] + share * (found[0] - found[1])


def _place(c: Calibration, reading: Expression) -> Expression:
    """Place of a reading in its range."""
    return (reading - constant("first", c.low)) * constant("per_span", 1.0 / (c.high - c.low))


def _share(c: Calibration, draft: Draft) -> Expression | None:
    """Share of the rising branch by a direction that is given, ``None`` with one curve."""
    if len(c.curves) == 1:
        return None
    return 0.5 + 0.5 * draft.argument(
        Argument("direction", "1", "1 rising, -1 falling, 0 between", -1.0, 1.0)
    )


def routines_of(c: Calibration, unit: str, output: str = "m") -> Sequence[Routine]:
    """Return the routines; ``unit`` is that of the reading, ``output`` that of the reference."""
    reading, name = Argument("reading", unit, "raw reading", c.low, c.high), called(output)
    draft = Draft(name, f"{name.capitalize()} of a reading.", output)
    t = draft.let("place", _place(c, draft.argument(reading)))
    share = _share(c, draft)
    if share is None:
        found = [draft.returns(_value(c, t, None))]
    else:
        found = [draft.returns(_value(c, t, draft.let("share", share)))]
        found.append(_tracking(c, name, output, reading))
    if c.monotone:
        found.append(_inverse(c, name, output, unit))
    return found


def _inverse(c: Calibration, name: str, output: str, unit: str) -> Routine:
    """Reading at a position, where each has one."""
    article = "an" if name[0] in "aeiou" else "a"
    draft = Draft("reading_at", f"Reading at {article} {name}, by halving the range.", unit)
    ends = np.array([[p[0], p[-1]] for p, _ in c.curves])
    wanted = draft.argument(Argument(name, output, name, float(ends.min()), float(ends.max())))
    value = _value(c, Name("place"), _share(c, draft))
    rising = bool(ends[0, 1] >= ends[0, 0])
    place = draft.solve(Solve("place", 0.0, 1.0, (), value, wanted, rising, _HALVINGS))
    return draft.returns(place * constant("span", c.high - c.low) + constant("first", c.low))


def _tracking(c: Calibration, name: str, output: str, reading: Argument) -> Routine:
    """Position where the direction is found from the readings themselves."""
    draft = Draft(
        "step", f"{name.capitalize()} of the next reading; the direction is kept.", output
    )
    x = draft.argument(reading)
    last, state, begun = draft.state("last"), draft.state("state"), draft.state("begun")
    moved = draft.let("moved", choose(begun, ">", 0.0, x - last, 0.0))
    band = max(c.dead_band, _LEAST_BAND * (c.high - c.low))
    change = moved * constant("per_half_dead_band", 2.0 / band)
    draft.put(state, minimum(maximum(state + change, -1.0), 1.0))
    draft.put(last, x)
    draft.put(begun, 1.0)
    t = draft.let("place", _place(c, x))
    return draft.returns(_value(c, t, draft.let("share", 0.5 + 0.5 * state)))
