"""Attacks on what benches have besides the usual roles of a family.

Motors logged by angle or by settled points, servos that stand still at 1500 µs, lines from a
command, lines of second order. The machines are those of the families' own modules.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from ..attack import Array, Attack, Recording, cramer_rao, with_play
from . import hydraulic_motor, line

MOTOR = {**hydraulic_motor.OPEN, "curvature": 1.0}
STATIC = {k: v for k, v in MOTOR.items() if k not in ("time_constant", "dead_time")}
SERVO = {
    "dead_zone_negative": -25e-6, "dead_zone_positive": 40e-6, "command_offset": 1500e-6,
    "gain": 5.0e5, "hysteresis": 8e-6, "time_constant": 0.08, "dead_time": 0.03,
}  # fmt: skip
LINE = {"gain": 2.0e5, "time_constant": 0.12, "dead_time": 0.0147}
LAGS = {"gain": 1.0, "first": 0.12, "second": 0.035, "dead_time": 0.0147}
SCALES = {"dead_zone": 0.1, "hysteresis": 0.05, "dead_time": 0.02, "curvature": 1.0}


def travelled(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = MOTOR,
    sigma: float = 0.005,
    code: float = 0.0,
    second: float = 0.0,
    slip: float = 0.0,
    lost: float = 0.0,
    noise: float = 0.0,
    step: float = 0.02,
    n: int = 1500,
    role: str = "angle",
) -> list[Recording]:
    """Angle of a motor: its speed on a grid 40 times as fine, added up.

    ``code`` is the step of an encoder, ``slip`` a part of the way that is lost one way, ``lost``
    a share of the rows, ``noise`` is on the logged command, in parts of its range.
    """
    fine = 40
    u = hydraulic_motor.staircase(rng, n, step, 1.0)
    at = np.arange((n - 1) * fine + 1) * (step / fine)
    speed = hydraulic_motor.simulate(
        p, at, np.append(np.repeat(u[:-1], fine), u[-1]), False, second
    )
    speed = np.where(speed < 0.0, (1.0 - slip) * speed, speed)
    way = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])))) * (step / fine)
    y = way[::fine] + sigma * rng.standard_normal(n)
    y = np.round(y / code) * code if code else y
    kept = rng.random(n) >= lost
    u = u + noise * float(np.ptp(u)) * rng.standard_normal(n)
    return [{"time": (np.arange(n) * step)[kept], "command": u[kept], role: y[kept]}]


def settled(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = STATIC,
    points: int = 60,
    sigma: float = 0.3,
    share: float = 0.0,
    offset: float = 0.0,
    left: float = 0.0,
    shuffled: bool = False,
    one_way: bool = False,
) -> list[Recording]:
    """Settled points of two loops up and down.

    ``share`` of the speed is added to its noise, ``offset`` to the command, ``left`` is the part
    of each step that has not yet been made; ``shuffled`` in no order, ``one_way`` upwards only.
    """
    quarter = points // 4
    up, down = np.linspace(-1.0, 1.0, quarter), np.linspace(1.0, -1.0, quarter)
    u = np.concatenate([up] * 4 if one_way else [up, down, up, down])
    u = u + 0.02 * rng.uniform(-1.0, 1.0, u.size)
    y = hydraulic_motor.static(with_play(np.r_[0.0, u], p["hysteresis"])[1:], p)
    y = y - left * np.diff(y, prepend=y[0])
    y = y + (sigma + share * np.abs(y)) * rng.standard_normal(y.size)
    order = rng.permutation(u.size) if shuffled else np.arange(u.size)
    return [{"command": (u + offset)[order], "speed": y[order]}]


def servo(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = SERVO,
    more: float = 0.0,
    sigma: float = 0.5,
    drift: float = 0.0,
    n: int = 1500,
) -> list[Recording]:
    """Speed of a motor whose valve follows the width of a pulse, with an edge a direction.

    ``more`` is the part by which it is faster backwards, ``drift`` that of its middle [s].
    """
    step = 0.02
    u = p["command_offset"] + hydraulic_motor.staircase(rng, n, step, 400e-6)
    middle = p["command_offset"] + drift * np.linspace(-0.5, 0.5, n)
    w = with_play(u - middle, p["hysteresis"])
    x = np.maximum(w - p["dead_zone_positive"], 0.0) + np.minimum(w - p["dead_zone_negative"], 0.0)
    target = p["gain"] * x * np.where(x < 0.0, 1.0 + more, 1.0)
    t, at = np.arange(n) * step, np.arange(n) * step
    unit = {"gain": 1.0, "time_constant": p["time_constant"], "dead_time": p["dead_time"]}
    y = line.respond(unit, np.r_[-1e9, at[1:]], target, t)
    return [{"time": t, "command": u, "speed": y + sigma * rng.standard_normal(n)}]


def commanded(
    rng: np.random.Generator,
    *,
    truth: Mapping[str, float] = LINE,
    width: float = 0.0,
    top: float = np.inf,
    second: float = 0.0,
    sigma: float = 2e3,
    n: int = 1000,
) -> list[Recording]:
    """Outlet of a line over the command [V] of the valve before it.

    The valve has hysteresis of a ``width`` [V], gives at most ``top`` [V], and lags ``second`` [s].
    """
    time, at, levels = _levels(rng, n, 0.0, 10.0)
    given = np.minimum(with_play(levels, width), top)
    lags = [truth["time_constant"], *([second] if second else [])]
    y = _through(lags, truth, at, given, time)
    return [{"time": time, "command": line.held(at, levels, time),
             "outlet": 3e5 + y + sigma * rng.standard_normal(n)}]  # fmt: skip


def _levels(
    rng: np.random.Generator, n: int, low: float, high: float
) -> tuple[Array, Array, Array]:
    """Instants of ``n`` samples at 100 Hz, those at which an input changes, and its levels."""
    step = 0.01
    time = np.arange(n) * step
    at = line.switches(rng, time[-1], 0.3, 1.0)
    at[1:] = np.round(at[1:] / step) * step
    return time, at, rng.uniform(low, high, at.size)


def _through(
    lags: Sequence[float], p: Mapping[str, float], at: Array, levels: Array, time: Array
) -> Array:
    """Different lags in a row: partial fractions, each of first order."""
    y = np.zeros(time.size)
    for a in lags:
        share = a ** (len(lags) - 1) / np.prod([a - b for b in lags if b != a])
        y += share * line.respond({**p, "time_constant": a}, at, levels, time)
    return y


def second_order(
    rng: np.random.Generator,
    *,
    p: Mapping[str, float] = LAGS,
    third: float = 0.0,
    sigma: float = 0.01,
    n: int = 1000,
) -> list[Recording]:
    """A line of two lags, and of a ``third`` [s]."""
    time, at, levels = _levels(rng, n, -1.0, 1.0)
    lags = [p["first"], p["second"], *([third] if third else [])]
    y = _through(lags, p, at, levels, time)
    return [{"time": time, "inlet": line.held(at, levels, time),
             "outlet": y + sigma * rng.standard_normal(n)}]  # fmt: skip


def _as_written(p: Mapping[str, float]) -> dict[str, float]:
    """Coefficients of ``(a s + 1) (b s + 1)`` as the file has them."""
    whole = p["first"] + p["second"]
    return {"gain": p["gain"], "time_constant": whole, "dead_time": p["dead_time"],
            "second_time_constant": p["first"] * p["second"] / whole}  # fmt: skip


def _bounds_of_points(p: Mapping[str, float], sigma: float) -> dict[str, float]:
    ways = np.linspace(-1.0, 1.0, 15)
    u = np.concatenate([ways, ways[::-1], ways, ways[::-1]])
    return cramer_rao(
        lambda q: [hydraulic_motor.static(with_play(np.r_[0.0, u], q["hysteresis"])[1:], q)],
        p, sigma, nuisance=lambda n: np.zeros((n, 0)),
    )  # fmt: skip


def attacks() -> Iterator[Attack]:
    """All of them."""
    motor = partial(Attack, "hydraulic-motor", truth=MOTOR, scales=SCALES)
    angle = partial(motor, "motor by its angle", units={"command": "A", "angle": "rad"})
    yield angle("right model", record=travelled, repetitions=6)
    yield angle("encoder of 100 lines", record=partial(travelled, sigma=0.0, code=0.0157),
                repetitions=3)  # fmt: skip
    yield angle("encoder of 20 lines", record=partial(travelled, sigma=0.0, code=0.0785),
                repetitions=3)  # fmt: skip
    yield angle("5 % of the rows lost", record=partial(travelled, lost=0.05), repetitions=3)
    for second in (0.005, 0.02):
        yield angle(f"second lag of {1e3 * second:g} ms", record=partial(travelled, second=second),
                    repetitions=3)  # fmt: skip
    for slip in (0.01, 0.05):
        unlike = {k: v for k, v in MOTOR.items() if k != "gain"}
        yield angle(f"{100 * slip:g} % slower one way", truth=unlike,
                    record=partial(travelled, slip=slip), repetitions=3)  # fmt: skip
    for noise in (5e-4, 5e-3):
        yield angle(f"command with noise, {100 * noise:g} %",
                    record=partial(travelled, noise=noise),
                    repetitions=3)  # fmt: skip
    slide = {**MOTOR, "gain": 0.2}
    yield motor("motor by what it drives", "right model", truth=slide,
                units={"command": "A", "position": "m"},
                record=partial(travelled, p=slide, sigma=1e-4, role="position"),
                repetitions=4)  # fmt: skip
    points = partial(motor, "settled points", truth=STATIC, options={"mode": "static"},
                     units={"command": "A", "speed": "rad/s"})  # fmt: skip
    yield points("right model", record=settled, bounds=partial(_bounds_of_points, STATIC, 0.3),
                 repetitions=8)  # fmt: skip
    for name, more in (
        ("noise of 2 % of the speed", {"share": 0.02}),
        ("20 % of each step still to come", {"left": 0.2}),
        ("5 % of each step still to come", {"left": 0.05}),
        ("command off by 0.02 A", {"offset": 0.02}),
        ("command off by 0.005 A", {"offset": 0.005}),
        ("upwards only", {"one_way": True}),
        ("in no order", {"shuffled": True}),
        ("16 points", {"points": 16}),
    ):
        beyond = {"left": "A part of each step still to come is like hysteresis of that width.",
                  "shuffled": "Nothing in the rows tells their order."}  # fmt: skip
        yield points(name, record=partial(settled, **more), repetitions=4,
                     beyond=next((beyond[k] for k in more if k in beyond), ""))  # fmt: skip
    for name, odd, unlike in (
        ("opens softly", {"soft": 0.05}, ()),
        ("square root", {"power": 0.8}, ("gain", "curvature")),
        ("dead zone 10 % wider one way", {"dead_zone_more": 0.1}, ()),
        ("gain 5 % higher one way", {"gain_more": 0.05}, ("gain",)),
    ):
        truth = {k: v for k, v in STATIC.items() if k not in unlike}
        yield points(name, truth=truth, record=partial(settled, p={**STATIC, **odd}),
                     repetitions=4)  # fmt: skip
    pulse = partial(motor, "servo pulse", units={"command": "s", "speed": "rad/s"})
    widths = dict.fromkeys((*SERVO, "dead_zone"), 65e-6) | {"gain": 5e5, "time_constant": 0.08}
    edges = partial(
        pulse, options={"dead_zone": "asymmetric"}, scales=widths | {"dead_time": 0.03},
        fixed={"curvature": 0.0, "command_offset": SERVO["command_offset"]},
        truth={k: v for k, v in SERVO.items() if k != "command_offset"},
    )  # fmt: skip
    yield edges("an edge a direction", record=servo, repetitions=6)
    edge, offset = SERVO["dead_zone_positive"], SERVO["command_offset"] + 7e-6
    even = {**SERVO, "dead_zone_negative": -edge, "command_offset": offset}
    middle = partial(
        pulse, options={"command_offset": "estimate"}, scales=widths | {"dead_time": 0.03},
        fixed={"curvature": 0.0}, truth={"dead_zone": edge} | {
            k: v for k, v in even.items() if not k.startswith("dead_zone")},
    )  # fmt: skip
    yield middle("middle estimated", record=partial(servo, p=even), repetitions=6)
    for attack, p in ((edges, SERVO), (middle, even)):
        which = "edges" if p is SERVO else "middle"
        for more in (0.02, 0.1):
            unlike = {k: v for k, v in attack.keywords["truth"].items() if k != "gain"}
            yield attack(f"{which}, {100 * more:g} % faster backwards", truth=unlike,
                         record=partial(servo, p=p, more=more), repetitions=3)  # fmt: skip
        for drift in (5e-6, 20e-6):
            yield attack(f"{which}, 1500 us drift by {1e6 * drift:g} us",
                         record=partial(servo, p=p, drift=drift), repetitions=3)  # fmt: skip
    tube = partial(Attack, "line", units={"command": "V", "outlet": "Pa"})
    yield tube("line from a command", "right model", LINE, commanded, repetitions=6)
    for width in (0.05, 0.3):
        yield tube("line from a command", f"hysteresis of the valve, {width:g} of 10 V", LINE,
                   partial(commanded, width=width), repetitions=3)  # fmt: skip
    for top in (9.0, 7.0):
        yield tube("line from a command", f"supply reached at {top:g} of 10 V", LINE,
                   partial(commanded, top=top), repetitions=3)  # fmt: skip
    for second in (0.01, 0.04):
        yield tube("line from a command", f"valve lags {1e3 * second:g} ms", LINE,
                   partial(commanded, second=second), repetitions=3)  # fmt: skip
    tube = partial(Attack, "line", units=line.UNITS, options={"order": "second"},
                   scales={"dead_time": 0.0147})  # fmt: skip
    for name, more, third in (
        ("right model", {}, 0.0),
        ("lags nearly alike", {"second": 0.1}, 0.0),
        ("second far below the sampling", {"second": 0.004}, 0.0),
        ("third lag of 10 ms", {}, 0.01),
        ("third lag of 30 ms", {}, 0.03),
    ):
        p = {**LAGS, **more}
        yield tube("line of second order", name, _as_written(p),
                   partial(second_order, p=p, third=third), repetitions=4,
                   beyond="It fits as well as the truth: a lag of one sample is a dead time."
                   if third == 0.01 else "")  # fmt: skip
    yield Attack("line", "line of second order", "fitted as first", {"gain": LAGS["gain"]},
                 second_order, line.UNITS, repetitions=3)  # fmt: skip
