"""Flow map of a proportional valve: steady flow, or speed, over the command.

    flow = q(command) sqrt(|pressure_drop| / reference) sign(pressure_drop)
    q = gain_positive x (1 + curvature x) + leakage fade,      x = min(u, s+) - d+ >= 0
    q = -gain_negative x (1 + curvature x) + leakage fade,     x = d- - max(u, s-) >= 0

and the leakage alone between the edges ``d-``, ``d+`` of the dead band (overlap of the spool); it
fades beyond either edge over the overlap of that side and ``2 |leakage| / gain``, so that the map
stays monotone [1]_. Without a pressure drop the second factor is one. The inverse is exact: a
quadratic on each side, with a jump across the band.

References
----------
.. [1] H. E. Merritt, Hydraulic Control Systems, 1967, section 5.4: flow gain, overlap and
   leakage of spool valves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..block import Block
from ..errors import LogError, Notice, NotIdentifiedError
from ..estimation.blocks import joined
from ..estimation.map import are_in_order, direction_notices
from ..estimation.motion_state import choose_dead_band, held_direction
from ..estimation.named_map import NamedFit, NamedRows, fit_named_map
from ..estimation.named_model import Values, check_request
from ..estimation.results import Refusal
from ..experiment import Array, Experiment, FloatArray, Hold
from ..family import (
    Curve,
    Excitation,
    Family,
    FamilyOptions,
    ParameterDocument,
    ParameterSpec,
    Plant,
    Request,
    Role,
    Runs,
    Simulated,
    Solution,
    StaticView,
    Structure,
    Variant,
)
from ..options import number
from ..routines import (
    Argument,
    Draft,
    Expression,
    Routine,
    by_sign,
    choose,
    constant,
    maximum,
    minimum,
    sqrt,
)

SIDES = (("positive", 1.0), ("negative", -1.0))
_LEAST_DROP = 1e-4  # of the reference: below it no flow says what it would be there
_REVERSED = 0.1  # of the largest flow: means of lower and upper commands that noise does not leave
_AGAINST = 0.5  # correlation of command and flow of the other sign, at which one is reversed


@dataclass(frozen=True)
class FlowMapOptions(FamilyOptions):
    """At which pressure drop the gains hold; settled by the fit where it was recorded."""

    reference_pressure: float | None = number(
        help="pressure drop at which the gains hold (default: the median of the log's)",
        unit="Pa", minimum=1e-9,
    )  # fmt: skip


def _sides(v: Values) -> list[tuple[float, Any, Any, Any, Any]]:
    """Sign, edge, reach of the opening, gain and leakage of both sides, as if positive."""
    return [
        (
            sign, sign * v[f"dead_band_{side}"],
            sign * (v[f"saturation_{side}"] - v[f"dead_band_{side}"]),
            v[f"gain_{side}"], sign * v["leakage"],
        )
        for side, sign in SIDES
    ]  # fmt: skip


def _fade_width(edge: Any, gain: Any, leak: Any) -> Any:
    return edge + 2.0 * leak * np.sign(np.real(leak)) / (gain + 1e-300) + 1e-300


def valve_flow(command: npt.ArrayLike, v: Values) -> Array:
    """Flow at the reference pressure drop, analytic in the values.

    Parameters
    ----------
    command : (...)
        [V]
    v
        Parameters by name [SI].

    Returns
    -------
    (...) [unit of the flow]
    """
    u = np.asarray(command, dtype=float)
    total = v["leakage"] + 0.0 * u
    for sign, edge, reach, gain, leak in _sides(v):
        reach = reach * (np.real(reach) > 0.0)
        beyond = np.where(sign * u > np.real(edge), sign * u - edge, 0.0)
        x = np.where(np.real(beyond) < np.real(reach), beyond, reach * (np.real(beyond) > 0.0))
        fade = x / _fade_width(edge, gain, leak)
        faded = np.where(np.real(fade) < 1.0, fade, 1.0)
        total = total + sign * (gain * x * (1.0 + v["curvature"] * x) - leak * faded)
    return np.asarray(total)


def valve_command(flow: npt.ArrayLike, v: Values) -> FloatArray:
    """Command for a flow at the reference pressure drop; cut at the saturations.

    The inverse of :func:`valve_flow`; it jumps across the dead band at the leakage.
    """
    q = np.asarray(flow, dtype=float)
    out = np.clip(0.0, v["dead_band_negative"], v["dead_band_positive"]) + 0.0 * q
    for sign, edge, reach, gain, leak in _sides(v):
        wanted, width = sign * q, _fade_width(edge, gain, leak)
        near = _opening(wanted - leak, gain - leak / width, gain * v["curvature"])
        x = np.where(near <= width, near, _opening(wanted, gain, gain * v["curvature"]))
        out = np.where(wanted > leak, sign * (edge + np.clip(x, 0.0, max(reach, 0.0))), out)
    return out


def _opening(rest: FloatArray, slope: float, bend: float) -> FloatArray:
    """Root of ``bend x^2 + slope x = rest`` that is zero where the rest is."""
    root = np.sqrt(np.maximum(slope**2 + 4.0 * bend * np.maximum(rest, 0.0), 0.0))
    return np.asarray(2.0 * np.maximum(rest, 0.0) / (slope + root + 1e-300))


def _pressure_factor(drop: npt.ArrayLike, reference: float, least: float = 0.0) -> FloatArray:
    """Root of the pressure ratio with its sign; no drop counts for less than a share of it."""
    ratio = np.asarray(drop, dtype=float) / reference
    return np.asarray(np.where(ratio < 0.0, -1.0, 1.0) * np.sqrt(np.maximum(np.abs(ratio), least)))


def _law(v: Values, x: FloatArray) -> Array:
    return valve_flow(x[:, 0], v) * x[:, 1]


def _side_specs(side: str, sign: float) -> tuple[ParameterSpec, ...]:
    ramp = f"Record a slow ramp of the command from zero to its {side} end."
    spec = partial(ParameterSpec, neutral=0.0)
    low, high = (0.0, np.inf) if sign > 0.0 else (-np.inf, 0.0)
    return (
        spec(f"dead_band_{side}", "V", f"{side} edge of the dead band", remedy=ramp,
             ratio=("command", "1"), minimum=low, maximum=high),
        spec(f"gain_{side}", "m3/s/V", f"flow per command just beyond the {side} edge",
             minimum=0.0, remedy=ramp, ratio=("flow", "command")),
        spec(f"saturation_{side}", "V", f"{side} command beyond which the flow grows no more",
             remedy=f"Raise the {side} command until the flow grows no more.",
             ratio=("command", "1"), minimum=low, maximum=high),
    )  # fmt: skip


_PARAMETERS = (
    *_side_specs("negative", -1.0),
    *_side_specs("positive", 1.0),
    ParameterSpec(
        "curvature", "1/V", "growth of the flow gain with the opening, of both sides", 0.0,
        remedy="Record three commands or more on a side, far apart.", ratio=("1", "command"),
    ),
    ParameterSpec(
        "leakage", "m3/s", "flow inside the dead band", 0.0,
        remedy="Hold commands inside the dead band.", ratio=("flow", "1"),
    ),
)  # fmt: skip


# --------------------------------------------------------------------- what a controller runs


class FlowMapBlock(Block):
    """Flow of a command, and the command for a wanted flow, which jumps over the dead band."""

    def __init__(self, document: ParameterDocument, variant: Variant) -> None:
        super().__init__(document, variant)
        # what the data never reached is not needed: the map ends with them
        low, high = self.validity["command"][:2]
        beyond = [f"saturation_{side}" for side, _ in SIDES]
        for side, end in (("positive", high), ("negative", -low)):
            beyond += [f"{kind}_{side}" for kind in ("dead_band", "gain") if end <= 0.0]
        self.accept([n for n in beyond if n in self.not_identified])

    @property
    def reference_pressure(self) -> float | None:
        """Pressure drop at which the gains hold [Pa]; ``None`` where it was not recorded."""
        return self.document.settled_options(FlowMapOptions).reference_pressure

    def _factor(self, pressure_drop: npt.ArrayLike | None, least: float = 0.0) -> FloatArray:
        if pressure_drop is None or self.reference_pressure is None:
            return np.ones(())
        return _pressure_factor(pressure_drop, self.reference_pressure, least)

    def _at_reference(self, flow: npt.ArrayLike, pressure_drop: npt.ArrayLike | None) -> FloatArray:
        """Flow that a wanted one is at the reference; no drop counts for less than the least."""
        return np.asarray(np.asarray(flow, dtype=float) / self._factor(pressure_drop, _LEAST_DROP))

    def _ends(self) -> tuple[float, float]:
        """Lowest and highest flow, those of the saturations at the reference."""
        v = self.numbers()
        flows = valve_flow([v[f"saturation_{side}"] for side, _ in SIDES], v)
        return float(np.real(flows).min()), float(np.real(flows).max())

    def __call__(
        self, command: npt.ArrayLike, pressure_drop: npt.ArrayLike | None = None
    ) -> float | FloatArray:
        """Flow [its unit] at a command [V]; at the reference pressure drop where none is given."""
        self.watch(command=command)
        factor = self._factor(pressure_drop)
        q = np.asarray(np.real(valve_flow(command, self.numbers())) * factor, dtype=float)
        return float(q) if q.ndim == 0 else q

    def inverse(
        self,
        flow: npt.ArrayLike,
        pressure_drop: npt.ArrayLike | None = None,
        *,
        clamp: bool = False,
    ) -> float | FloatArray:
        """Command [V] for a wanted flow: the compensation that stands before the valve.

        At the leakage itself it is the command nearest zero inside the dead band.

        Raises
        ------
        ValueError
            When a flow lies beyond what the saturations give, unless clamped.
        """
        q, (low, high) = self._at_reference(flow, pressure_drop), self._ends()
        slack = 1e-9 * (high - low)
        if not clamp and not np.all((q >= low - slack) & (q <= high + slack)):
            raise ValueError(
                f"a flow beyond {low:g} to {high:g}, what the saturations give at the "
                "reference pressure drop. Give clamp=True to take the end of the range."
            )
        u = valve_command(q, self.numbers())
        return float(u) if u.ndim == 0 else u

    def methods(self) -> Mapping[str, Callable[..., Any]]:
        """All of them; see :meth:`.Block.methods`."""
        return {
            "flow": self, "command_for": partial(self.inverse, clamp=True),
            "flow_at_reference": self._at_reference,
        }  # fmt: skip

    def predict(self, experiment: Experiment) -> FloatArray:
        """Flow of a recording; see :meth:`.Block.predict`."""
        options = self.document.settled_options(FlowMapOptions)
        return np.asarray(np.real(_law(self.numbers(), _inputs(experiment, options))))

    def routines(self) -> Sequence[Routine]:
        """Flow of a command; the command for a flow at the reference pressure drop; that flow."""
        v, unit, reference = self.numbers(), self.output.unit, self.reference_pressure
        command = self.argument("command", "command of the valve")
        about = "wanted flow" if reference is None else "wanted flow at the reference pressure drop"
        wanted = Argument("flow", unit, about, *self._ends(), recorded=False)
        forward = Draft("flow", "Steady flow of a command.", unit)
        back = Draft("command_for", "Command for a steady flow.", command.unit)
        u, q, leakage = forward.argument(command), back.argument(wanted), v["leakage"]
        low, high = v["dead_band_negative"], v["dead_band_positive"]
        total: Expression = constant("leakage", leakage)
        # compared as they are: a difference would hide that rounding decides beside the leakage
        found = choose(q, "<", leakage, low, float(np.clip(0.0, low, high)), jumps=True)
        found = choose(q, ">", leakage, high, found, jumps=True)
        for (side, _), (sign, edge, reach, gain, leak) in zip(SIDES, _sides(v)):
            width, bend = float(_fade_width(edge, gain, leak)), gain * v["curvature"]
            top = constant(f"reach_{side}", max(reach, 0.0))
            x = forward.let(f"opening_{side}", minimum(maximum(sign * u - edge, 0.0), top))
            faded = minimum(x * constant(f"per_fade_{side}", 1.0 / width), 1.0)
            total = total + sign * (x * (gain + bend * x) - leak * faded)
            if gain <= 0.0:
                continue  # a side that was never opened gives no flow, whatever the command
            beyond = maximum(sign * q - leak, 0.0)
            near = back.let(f"near_{side}", _root_of(beyond, gain - leak / width, bend))
            far = _root_of(maximum(sign * q, 0.0), gain, bend)
            found = found + sign * minimum(choose(near, ">", width, far, near), top)
        if reference is None:
            return forward.returns(total), back.returns(found)
        drop = self.argument("pressure_drop", "pressure drop over the valve")
        scale = Draft("flow_at_reference", "Flow that a wanted one is at the reference.", unit)
        asked = scale.argument(replace(wanted, about="wanted flow"))
        there, least = scale.argument(drop), _LEAST_DROP * reference
        if max(drop.low, -drop.high) < least:
            scale.flag(abs(there), constant("least_pressure_drop", least))
        return (
            forward.returns(total * _factor_of(forward.argument(drop), drop, reference)),
            back.returns(found),
            scale.returns(asked / _factor_of(there, drop, reference, least)),
        )


def _factor_of(
    drop: Expression, known: Argument, reference: float, least: float = 0.0
) -> Expression:
    """Square root of the pressure ratio with its sign, of a drop of the ``least`` size or more."""
    of_range = max(known.low, -known.high, 0.0)
    size = maximum(abs(drop), least) if least > of_range else abs(drop)
    size = sqrt(size * constant("per_reference", 1.0 / reference))
    if known.low > 0.0:
        return size
    if known.high < 0.0:
        return -size
    return by_sign(drop, size, -size, size if least else 0.0, jumps=bool(least))


def _root_of(rest: Expression, slope: float, bend: float) -> Expression:
    """Root of ``bend x^2 + slope x = rest`` for a rest that is not negative."""
    x = rest * (1.0 / slope)  # where nothing bends
    return 2.0 * x / (sqrt(maximum(x * (4.0 * bend / slope) + 1.0, 0.0)) + 1.0)


# ------------------------------------------------------------------------------- the family


class FlowMap(Family[FlowMapOptions]):
    """Steady flow of a proportional valve: dead band, gains, curvature, leakage, saturation."""

    name = "flow-map"
    title = "Flow map: dead band, gains, leakage and saturation of a proportional valve"
    equation = (
        "flow = q(command) sqrt(|pressure_drop| / reference_pressure) sign(pressure_drop), "
        "q = +-gain x (1 + curvature x) + leakage fade(x), x = opening beyond the dead band, "
        "up to saturation"
    )
    variants = (
        Variant(
            "flow-map",
            (
                Role("time", "s", "time of each sample", required=False),
                Role("command", "V", "command of the valve", hold="zoh", alternatives=("A", "1")),
                Role("pressure_drop", "Pa", "pressure drop over the valve", required=False,
                     hold="zoh"),
                Role("flow", "m3/s", "steady flow, or speed of the actuator", output=True,
                     alternatives=("m/s", "rad/s", "V", "1")),
            ),
            _PARAMETERS,
        ),
    )  # fmt: skip
    options_type = FlowMapOptions
    block_type = FlowMapBlock
    next_experiment = Excitation("points")
    structures = (
        Structure("straight, no leakage", fixed={"curvature": 0.0, "leakage": 0.0}),
        Structure("curved, no leakage", fixed={"leakage": 0.0}),
        Structure("straight, leakage", fixed={"curvature": 0.0}),
        Structure("curved, leakage"),
    )

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[FlowMapOptions]
    ) -> Solution[FlowMapOptions]:
        """Fit the map; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        options = _with_reference(request.options, experiments)
        data = NamedRows.of(
            [_inputs(e, options) for e in experiments],
            [e.signals["flow"] for e in experiments], are_in_order(experiments, "command"),
        )  # fmt: skip
        u, q = data.x[:, 0], data.y / np.where(data.x[:, 1] == 0.0, np.inf, data.x[:, 1])
        _require_flow_along(u, q, "pressure_drop" in experiments[0])
        most, largest = float(np.abs(u).max()), float(np.abs(q).max())
        limits = {
            "curvature": (-0.5 / most, np.inf), "leakage": (-largest, largest),
            "saturation_positive": (0.0, most), "saturation_negative": (-most, 0.0),
        }  # fmt: skip
        found = fit_named_map(
            _law, variant.parameters, data, lambda held: _starts(u, q, held), limits, request,
            max_half_widths={
                "dead_band_positive": 0.3 * most, "dead_band_negative": 0.3 * most,
                "saturation_positive": 0.5 * most, "saturation_negative": 0.5 * most,
                "curvature": 1.0 / most, "leakage": 0.05 * largest,
            },
            refusals=_never_recorded(u, q), optional=_unsaturated(u),
        )  # fmt: skip
        notices = [*_notices(found, experiments[0].units["flow"], most)]
        return found.solution(self.simulate, experiments, variant, options, {}, notices)

    def simulate(
        self,
        plant: Plant[FlowMapOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Flow from command and pressure drop; see :meth:`Family.simulate`."""
        return [Simulated(_law(plant.numbers, _inputs(e, plant.options))) for e in experiments]

    def model(self, plant: Plant[FlowMapOptions], sample_time: float, hold: Hold) -> dict[str, Any]:
        """Flows at the edges, saturations and midway: they change with every parameter."""
        v = plant.numbers
        ends = [v[f"saturation_{side}"] for side, _ in SIDES]
        edges = [v[f"dead_band_{side}"] for side, _ in SIDES]
        middle = [0.5 * (a + b) for a, b in zip(ends, edges)]
        commands = sorted([*ends, *edges, *middle])
        return {"curve": {"command": commands, "flow": valve_flow(commands, v).tolist()}}

    def static_view(self, plant: Plant[FlowMapOptions], runs: Runs) -> StaticView:
        """Map over command at the reference pressure drop, and the residuals of the flows on it."""
        view = StaticView.over(runs, "command", "flow", ())
        reference = plant.options.reference_pressure
        line = np.linspace(view.x.min(), view.x.max(), 500)
        label = f"flow map at {1e-5 * reference:.3g} bar" if reference else "flow map"
        law, there = (np.real(valve_flow(u, plant.numbers)) for u in (line, view.x))
        beside = there + view.measured - view.fitted  # samples of other drops would lie elsewhere
        return replace(view, measured=beside, fitted=there, curves=[Curve(label, line, law)])


# ------------------------------------------------------------------------ data and refusals


def _require_flow_along(u: FloatArray, q: FloatArray, dropped: bool) -> None:
    """Refuse flows of the other sign than command and pressure drop (``LogError``).

    So are flows of both signs where the command has one: its zero is elsewhere, as of 4 to 20 mA.
    """
    upper = u > np.median(u)
    halves = [float(q[half].mean()) if half.any() else 0.0 for half in (upper, ~upper)]
    reversed_by = min(max(halves), -min(halves))
    if float(u.min()) * float(u.max()) >= 0.0 and reversed_by > _REVERSED * np.abs(q).max():
        raise LogError(
            "the flow has both signs, and the command only one",
            expected="Expected a command that is zero where the valve is closed.",
            remedy="Subtract the command at which it is closed, such as 12 mA of 4 to 20 mA.",
        )
    size = float(np.linalg.norm(u) * np.linalg.norm(q))
    if float(u @ q) < -_AGAINST * size:
        roles = ["flow", "command", *(["pressure_drop"] if dropped else [])]
        raise LogError(
            "the flow runs against the command" + " and the pressure drop" * dropped,
            expected="Expected flow from a positive command to be positive.",
            remedy=f"Reverse one sign: {' or '.join(f'--scale {r}=-1' for r in roles)}.",
        )


def _inputs(e: Experiment, options: FlowMapOptions) -> FloatArray:
    """Command and pressure factor, 1 where no pressure drop is known, shape ``(n, 2)``."""
    u, reference = e.sampled("command"), options.reference_pressure
    if reference is None or "pressure_drop" not in e:
        return np.column_stack((u, np.ones(u.size)))
    return np.column_stack((u, _pressure_factor(e.sampled("pressure_drop"), reference)))


def _with_reference(options: FlowMapOptions, experiments: Sequence[Experiment]) -> FlowMapOptions:
    """Settle the reference: the median pressure drop, none where one log lacks it."""
    reference = options.reference_pressure
    if not all("pressure_drop" in e for e in experiments):
        reference = None
    elif reference is None:
        reference = float(
            np.median(np.abs(joined([e.sampled("pressure_drop") for e in experiments])))
        )
    return replace(options, reference_pressure=reference)


def _starts(u: FloatArray, q: FloatArray, held: Mapping[str, float]) -> list[dict[str, float]]:
    """Dead bands and saturations at several shares of the commands."""
    out = []
    for share, top in ((0.02, 1.0), (0.1, 1.0), (0.25, 1.0), (0.05, 0.8), (0.15, 0.6)):
        start = {"curvature": 0.0, "leakage": 0.0}
        for side, sign in SIDES:
            end = max(float((sign * u).max()), 0.0)
            there = sign * u > share * end
            slopes = sign * q[there] / (sign * u[there] - share * end)
            slope = float(np.median(slopes)) if slopes.size else 0.0
            start |= {
                f"dead_band_{side}": sign * share * end, f"gain_{side}": max(slope, 0.0),
                f"saturation_{side}": sign * top * end,
            }  # fmt: skip
        out.append(start | dict(held))
    return out


def _never_recorded(u: FloatArray, q: FloatArray) -> list[Refusal]:
    """Refuse the numbers of a side to which the command never goes."""
    out, recorded = [], False
    for side, sign in SIDES:
        if np.count_nonzero(sign * u > 0.0) < 3:
            names = (f"{kind}_{side}" for kind in ("dead_band", "gain", "saturation"))
            out += [Refusal(name, f"the command is never {side}.") for name in names]
        else:
            recorded = True
    if not recorded or np.ptp(q) == 0.0:
        raise NotIdentifiedError(
            "the data cannot determine any gain: command or flow never changes.",
            expected="Nothing was written.",
            remedy="Record a slow ramp of the command from one end to the other.",
        )
    return out


def _unsaturated(u: FloatArray) -> list[Refusal]:
    """Saturations, held at the last command recorded unless the data demand another."""
    return [
        Refusal(
            f"saturation_{side}", "the flow grows up to the last command that was recorded.",
            sign * max(float((sign * u).max()), 0.0),
        )
        for side, sign in SIDES
    ]  # fmt: skip


def _notices(found: NamedFit, unit: str, most: float) -> Iterator[Notice]:
    """Warn of a map that misses, and of flows that differ between rising and falling commands."""
    data = found.data
    span, misfit = float(np.ptp(data.y)), found.misfit
    if misfit is not None and misfit.matters(5e-3 * span):
        yield Notice(
            "curve-misses",
            f"the map misses the flow by {misfit.rms:.3g} {unit} (RMS), while samples beside each "
            f"other scatter by {np.sqrt(misfit.within):.3g}, most of all at a command of "
            f"{misfit.worst:.4g}: the valve has another shape. Look at the picture (--plot).",
        )
    rising = [
        0.5 + 0.5 * held_direction(u, max(choose_dead_band(u), 1e-3 * most))
        for u in data.by_log(data.x[:, 0])
    ]
    words = (
        "the flow", "commands", "hysteresis of the spool, or a flow that lags behind a ramp. "
        "Ramp more slowly, or hold commands.",
    )  # fmt: skip
    one_way = (
        "the command moves in one direction only: hysteresis of the spool cannot be seen, and "
        "the map holds for this direction. Ramp the command up and down."
    )
    yield from direction_notices(
        words, one_way, lambda q: f"{q:.3g} {unit}", 2e-3 * span,
        data.by_log(found.jacobian), data.by_log(found.residual), rising,
    )  # fmt: skip
