"""Commands that are held from sample to sample and arrive late, each by its own time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from math import floor


class HeldCommands:
    """Commands that arrive during a sample, in pieces between which something changes.

    Parameters
    ----------
    delays
        Of each command [s], any fraction of a sample.
    sample_time
        [s]
    """

    def __init__(self, delays: Sequence[float], sample_time: float) -> None:
        self._sample_time = sample_time
        self._whole = [floor(d / sample_time + 1e-9) for d in delays]
        self._late = [max(d - w * sample_time, 0.0) for d, w in zip(delays, self._whole)]
        self.reset([0.0] * len(delays))

    def reset(self, values: Sequence[float]) -> None:
        """Have sent these for ever."""
        length = max(self._whole, default=0) + 2
        self._sent = deque([tuple(values)] * length, maxlen=length)

    def send(self, command: Sequence[float]) -> Iterator[tuple[float, list[float]]]:
        """Hold commands for one sample; yields how long [s] which ones act, one after the other."""
        self._sent.append(tuple(command))
        arrivals = sorted({0.0, *self._late})
        ends = [*arrivals[1:], self._sample_time]
        for start, end in zip(arrivals, ends):
            yield end - start, [self._acting(i, start) for i in range(len(command))]

    def _acting(self, i: int, since: float) -> float:
        """Command that acts from an instant of the sample on."""
        ago = self._whole[i] + (1 if since < self._late[i] else 0)
        return self._sent[-1 - ago][i]
