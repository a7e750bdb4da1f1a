"""One mass with dry friction under a force that is held: from event to event within a sample.

    M v' = F - b v - s F_k,   v = 0 while -F_s- <= F <= F_s+

in closed form, or in error-controlled steps where friction falls with the speed (:mod:`.curved`).
"""

from __future__ import annotations

from functools import cached_property
from math import inf, log1p

from .curved import Slide, slide_of
from .motion import DryMass
from .phi import phi_real

_EVENTS = 4  # of a sample under one force: moving, stopped, moving the other way


class HeldMass(DryMass):
    """A mass that is followed from sample to sample."""

    def advance(self, place: float, speed: float, force: float, span: float) -> tuple[float, float]:
        """Place and speed after a force [N or N m] was held for a span [s]."""
        for _ in range(_EVENTS):
            place, speed, span = self._move(place, speed, force, span)
            if span <= 0.0:
                break
        return place, speed

    @cached_property
    def _slides(self) -> dict[int, Slide]:
        """Motion under the curve, by direction; none without one."""
        return {way: slide_of(self, way) for way in (1, -1)} if self.speed else {}

    def _move(
        self, place: float, v: float, force: float, span: float
    ) -> tuple[float, float, float]:
        """Advance until the span ends or the motion stops; the last is what is left of it [s]."""
        law = self.law
        forward = v > 0.0 if v != 0.0 else force > law.breakaway_positive
        if v == 0.0 and not forward and force >= -law.breakaway_negative:
            return place, 0.0, 0.0
        if self._slides:
            return self._slide(place, v, force, span, 1 if forward else -1)
        viscous = law.viscous_positive if forward else law.viscous_negative
        net = force - (law.coulomb_positive if forward else -law.coulomb_negative)
        stop = _time_to_stop(v, net, viscous, self.inertia)
        time = min(stop, span)
        rate = viscous / self.inertia
        one, two = phi_real(-rate * time, 2)
        push = net / self.inertia * time
        place += v * time * one + push * time * two
        if stop > span:
            return place, v * (1.0 - rate * time * one) + push * one, 0.0
        return place, 0.0, span - stop

    def _slide(
        self, place: float, v: float, force: float, span: float, way: int
    ) -> tuple[float, float, float]:
        """Advance like :meth:`_move` where friction falls with the speed."""
        slide = self._slides[way]
        steps = slide.divide(abs(v), 0.0, span, slide.held(way * force), span)
        place += way * sum(s.way for s in steps)
        if not steps or steps[-1].after > 0.0:
            return place, way * steps[-1].after if steps else 0.0, 0.0
        return place, 0.0, span - steps[-1].offset - steps[-1].span


def _time_to_stop(v: float, net: float, viscous: float, inertia: float) -> float:
    """Time until a moving mass stops under a constant force [s], infinite when it never does."""
    if v == 0.0 or v * net >= 0.0:
        return inf
    x = -v * viscous / net
    factor = log1p(x) / x if x > 1e-9 else 1.0 - 0.5 * x
    return -v * inertia / net * factor
