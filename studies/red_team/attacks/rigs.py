"""Attacks by the rig: clocks that drift apart, slow or sticking sensors, stops, two machines.

The machine of each family is that of its own module; what is wrong is what stands around it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.signal import lfilter

from ..attack import Attack, Recording, with_play
from . import hydraulic_motor, hydrostatic, line, spring_cylinder, valve

LINE = {"gain": 1.0, "time_constant": 0.12, "dead_time": 0.0147}
VALVE = {"gain": 1.0, "natural_frequency": 20.0, "damping_ratio": 0.7}
Record = Callable[[np.random.Generator], Sequence[Recording]]


def _drifting(
    rng: np.random.Generator, record: Record, role: str, share: float, sigma: float
) -> list[Recording]:
    """A channel of a second device, whose clock is faster by a share."""
    out = []
    for r in record(rng):
        t = r["time"]
        late = np.interp(t * (1.0 + share), t, r[role])
        out.append({**r, role: late + sigma * rng.standard_normal(t.size)})
    return out


def _together(rng: np.random.Generator, records: Sequence[Record]) -> list[Recording]:
    """Logs of different machines."""
    return [r for record in records for r in record(rng)]


def _lagging(
    recording: Recording, rng: np.random.Generator, role: str, lag: float, held: bool
) -> Recording:
    """A sensor that follows with a lag [s] what is held, or straight, between the samples."""
    x, share = recording[role], float(recording["time"][1]) / lag
    keep = np.exp(-share)
    before, now = 1.0 - keep, 0.0
    if not held:
        now = 1.0 - (1.0 - keep) / share
        before -= now
    start = [(before + keep) * x[0]]
    return {**recording, role: lfilter([now, before], [1.0, -keep], x, zi=start)[0]}


def _sticking(
    recording: Recording, rng: np.random.Generator, role: str, share: float, sigma: float
) -> Recording:
    """A sensor that stays until it is wrong by a share of its range, and then jumps."""
    clean = recording[role]
    limit, now = share * float(np.ptp(clean)), float(clean[0])
    seen = np.empty(clean.size)
    for k, x in enumerate(clean.tolist()):
        now = x if abs(x - now) > limit else now
        seen[k] = now
    return {**recording, role: seen + sigma * rng.standard_normal(clean.size)}


def _reflected(rng: np.random.Generator, share: float, sigma: float = 0.01) -> list[Recording]:
    """A tube whose waves come back: what arrives after 3, 5, … times the dead time."""
    step, n, p = 0.01, 1000, LINE
    t = np.arange(n) * step
    at = line.switches(rng, t[-1], 0.3, 1.0)
    at[1:] = np.round(at[1:] / step) * step
    levels = rng.uniform(-1.0, 1.0, at.size)
    y = np.zeros(n)
    for k in range(12):
        late = {**p, "dead_time": (2 * k + 1) * p["dead_time"]}
        y += (1.0 + share) * (-share) ** k * line.respond(late, at, levels, t)
    return [{"time": t, "inlet": line.held(at, levels, t),
             "outlet": y + sigma * rng.standard_normal(n)}]  # fmt: skip


def _regulated(rng: np.random.Generator, sigma: float = 0.02) -> list[Recording]:
    """A PI controller at one set point: all that moves comes from the noise and the load."""
    step, n, gain, tau, dead = 0.01, 3000, 2.0, 0.4, 10
    u, y, x, total = np.zeros(n), np.zeros(n), 0.0, 0.0
    keep, load = np.exp(-step / tau), 0.0
    for k in range(n):
        load = 0.995 * load + 0.01 * rng.standard_normal()
        y[k] = x + load + sigma * rng.standard_normal()
        total += step * -y[k]
        u[k] = -0.6 * y[k] + 1.2 * total
        x = keep * x + (1.0 - keep) * gain * (u[k - dead] if k >= dead else 0.0)
    return [{"time": np.arange(n) * step, "inlet": u, "outlet": y}]


def _droop(r: Recording, rng: np.random.Generator, share: float, tau: float) -> Recording:
    """A supply whose pressure falls with the flow that was drawn, as an accumulator's."""
    y = r["speed"]
    keep = np.exp(-float(r["time"][1]) / tau)
    drawn = lfilter([1.0 - keep], [1.0, -keep], np.abs(y) / np.abs(y).max())
    return {**r, "speed": y * (1.0 - share * drawn)}


def _stopped(
    rng: np.random.Generator, share: float, truth: Mapping[str, float], sigma: float = 0.01
) -> list[Recording]:
    """A hydrostatic transmission that runs against a stop on the way out."""
    h = 0.01 / hydrostatic.FINE
    t = np.arange(999 * hydrostatic.FINE + 1) * h
    u = hydrostatic.wave(rng, t, 1.0, -12.0, 12.0)
    free = hydrostatic.respond(truth, u, h)
    end = float(np.quantile(free, 1.0 - share))
    rate, x, v = truth["damping"] / truth["mass"], 0.0, 0.0
    out = np.empty(u.size)
    for k, push in enumerate(hydrostatic.beyond(truth, u).tolist()):
        out[k] = x
        final = push / truth["damping"]
        v = final + (v - final) * np.exp(-rate * h)
        x += h * v
        if x > end:
            x, v = end, 0.0
    y = out[:: hydrostatic.FINE]
    noisy = y + sigma * y.std() * rng.standard_normal(y.size)
    return [{"time": np.arange(y.size) * 0.01, "force": u[:: hydrostatic.FINE], "position": noisy}]


def _dead_band(
    rng: np.random.Generator, share: float, sigma: float = 0.01, n: int = 1000
) -> list[Recording]:
    """A valve that nothing passes until its command is beyond a share of the largest."""
    u = valve.levels(rng, n, 0.01, 0.3, 1.0)
    open_by = np.sign(u) * np.maximum(np.abs(u) - share, 0.0)
    y = valve.simulate(VALVE, open_by, 0.01) + sigma * rng.standard_normal(n)
    return [{"time": np.arange(n) * 0.01, "command": u, "outlet": y}]


def _wrapped(r: Recording, rng: np.random.Generator, role: str, span: float) -> Recording:
    """A counter that begins again."""
    return {**r, role: (r[role] - r[role].min()) % (span * float(np.ptp(r[role])))}


def _resampled(r: Recording, rng: np.random.Generator, rate: float) -> Recording:
    """A log brought to another rate on straight lines."""
    t = r["time"]
    new = np.arange(0.0, t[-1], t[1] / rate)
    return {role: new if role == "time" else np.interp(new, t, x) for role, x in r.items()}


def _off_zero(r: Recording, rng: np.random.Generator, by: float) -> Recording:
    """A load cell that reads another force while nothing acts."""
    return {**r, "force": r["force"] + by}


def _valve_before(r: Recording, rng: np.random.Generator, width: float) -> Recording:
    """A proportional valve with hysteresis, in volts, before the cylinder."""
    u = r["command"]
    late = with_play(u, width)
    return {**r, "force": r["force"] + spring_cylinder.TRUTH["pressure_gain"] * (late - u)}


def attacks() -> Iterator[Attack]:
    """All of them."""
    tube = partial(Attack, "line", units=line.UNITS)
    spool = partial(Attack, "valve", units=valve.UNITS)
    motor = partial(Attack, "hydraulic-motor", units=hydraulic_motor.UNITS)
    press = partial(Attack, "hydrostatic", units=hydrostatic.UNITS)
    for share in (1e-3, 3e-3, 1e-2):
        name = f"{1e3 * share:g} ms in a second"
        for attack, truth, record, role, sigma in (
            (tube, LINE, partial(line.smooth, truth=LINE, sigma=0.0), "outlet", 0.005),
            (spool, VALVE, partial(valve.record, truth=VALVE, sigma=0.0), "outlet", 0.01),
            (motor, hydraulic_motor.TRUTH, partial(hydraulic_motor.log, sigma=0.0), "speed", 0.5),
        ):
            yield attack("clocks that drift apart", name, truth, repetitions=3, record=partial(
                _drifting, record=record, role=role, share=share, sigma=sigma))  # fmt: skip
    for factor in (1.05, 1.2, 1.5):
        name = f"{factor:g} times as slow"
        for attack, truth, record, which in (
            (tube, LINE, line.record, "time_constant"),
            (spool, VALVE, valve.record, "natural_frequency"),
        ):
            other = {**truth, which: truth[which] * factor}
            both = [partial(record, truth=truth), partial(record, truth=other)]
            yield attack("two machines", name, truth, partial(_together, records=both),
                         repetitions=3)  # fmt: skip
        p = {**hydraulic_motor.TRUTH, "gain": hydraulic_motor.TRUTH["gain"] * factor}
        both = [hydraulic_motor.log, partial(hydraulic_motor.log, p=p)]
        yield motor("two machines", f"{factor:g} times as fast", hydraulic_motor.TRUTH,
                    partial(_together, records=both), repetitions=2)  # fmt: skip
        heavy = {**hydrostatic.TRUTH, "damping": hydrostatic.TRUTH["damping"] * factor}
        both = [hydrostatic.record, partial(hydrostatic.record, truth=heavy)]
        yield press("two machines", f"{factor:g} times the damping", hydrostatic.TRUTH,
                    partial(_together, records=both), repetitions=2)  # fmt: skip
    for lag in (0.003, 0.01, 0.03, 0.1):
        for hold in ("held", "smooth"):
            held = hold == "held"
            record = partial(line.record if held else line.smooth, truth=LINE)
            yield tube("lag of the inlet's sensor", f"{1e3 * lag:g} ms, {hold}", LINE,
                       partial(_spoilt, record=record,
                               spoil=partial(_lagging, role="inlet", lag=lag, held=held)),
                       repetitions=3,
                       beyond="" if held or lag > 0.003 else
                       "A lag far below the sampling is a shift of time.")  # fmt: skip
    for share in (0.1, 0.3, -0.3):
        yield tube("reflections", f"{100 * share:g} %", LINE, partial(_reflected, share=share),
                   repetitions=4)  # fmt: skip
    for share in (0.005, 0.02, 0.05):
        name = f"stays within {100 * share:g} % of its range"
        yield tube("sticking outlet", name, LINE, repetitions=3, record=partial(
            _spoilt, record=partial(line.smooth, truth=LINE, sigma=0.0),
            spoil=partial(_sticking, role="outlet", share=share, sigma=0.003)))  # fmt: skip
    yield tube("regulator at one set point", "PI", {"gain": 2.0, "time_constant": 0.4},
               _regulated, hold={"inlet": "zoh"}, repetitions=4)  # fmt: skip
    for share in (0.05, 0.1, 0.2):
        for tau in (0.2, 1.0, 5.0):
            spoil = partial(_droop, share=share, tau=tau)
            # a gain is that of the mean supply, and what a supply loses by flow is a curve
            unlike = {k: v for k, v in hydraulic_motor.TRUTH.items()
                      if k not in ("curvature", "gain")}  # fmt: skip
            yield motor("droop of the supply", f"{100 * share:g} %, {tau:g} s", unlike,
                        partial(hydraulic_motor.log, spoil=spoil), repetitions=2,
                        scales={"dead_zone": 0.1, "hysteresis": 0.05,
                                "dead_time": 0.02})  # fmt: skip
    for share in (0.02, 0.1, 0.3):
        yield press("hard stop", f"beyond {100 * (1 - share):g} % of the way", hydrostatic.TRUTH,
                    partial(_stopped, share=share, truth=hydrostatic.TRUTH),
                    repetitions=3)  # fmt: skip
        yield spool("dead band", f"{100 * share:g} %", VALVE, partial(_dead_band, share=share),
                    repetitions=3)  # fmt: skip
    for span in (0.5, 0.3):
        yield press("wraps", f"{span:g} of the range", hydrostatic.TRUTH, repetitions=2,
                    record=partial(_spoilt, record=hydrostatic.record,
                                   spoil=partial(_wrapped, role="position",
                                                 span=span)))  # fmt: skip
    for rate in (1.5, 2.0, 3.7):
        for attack, truth, record in (
            (tube, LINE, line.smooth),
            (press, hydrostatic.TRUTH, hydrostatic.record),
        ):
            yield attack("resampled on straight lines", f"{rate:g} times as fast", truth,
                         partial(_spoilt, record=partial(record, truth=truth),
                                 spoil=partial(_resampled, rate=rate)),
                         repetitions=3)  # fmt: skip
    for by in (-6.0, -1.0, 2.0, 5.0):
        unlike = ("dead_zone_negative", "dead_zone_positive")  # both edges move with the zero
        rest = {k: v for k, v in hydrostatic.TRUTH.items() if k not in unlike}
        yield press("zero of the load cell", f"{by:+g} N", rest,
                    partial(_spoilt, record=hydrostatic.record, spoil=partial(_off_zero, by=by)),
                    repetitions=3)  # fmt: skip
    for width in (0.05, 0.2):
        yield Attack("spring-cylinder", "hysteresis of the valve", f"{width:g} V",
                     spring_cylinder.TRUTH, partial(spring_cylinder.log, p=spring_cylinder.TRUTH,
                                                    spoil=partial(_valve_before, width=width)),
                     spring_cylinder.UNITS, repetitions=3,
                     beyond="From a command, both levels are those of valve and cylinder "
                     "together, which the file says.")  # fmt: skip


def _spoilt(
    rng: np.random.Generator,
    record: Record,
    spoil: Callable[[Recording, np.random.Generator], Recording],
) -> list[Recording]:
    return [spoil(r, rng) for r in record(rng)]
