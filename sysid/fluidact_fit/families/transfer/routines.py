"""Routines of a linear model for a controller: one step, and the inverse of its dead zone."""

from __future__ import annotations

from ...routines import Argument, Draft, Expression, Filter, Routine, constant, maximum, minimum

Edges = tuple[float, float]


def step_routine(
    argument: Argument, edges: Edges | None, law: Filter, output: tuple[str, str, float],
    period: float,
) -> Routine:  # fmt: skip
    """One step of the model; ``output`` is its name, its unit and its offset at rest."""
    name, unit, offset = output
    draft = Draft("step", f"Take the input of this sample, return the {name}.", unit, period)
    u = draft.argument(argument)
    drive: Expression = u
    if edges is not None:
        low, high = (
            constant("dead_zone_negative", edges[0]),
            constant("dead_zone_positive", edges[1]),
        )
        drive = maximum(u - high, 0.0) + minimum(u - low, 0.0)
    draft.let("drive", drive)
    return draft.returns(draft.filter(law) + constant("offset", offset))


def dead_zone_routine(input: Argument, edges: Edges) -> Routine:
    """Input that makes a wanted one act behind the dead zone."""
    (low, high), unit = edges, input.unit
    largest = max(high, -low, 1e-9 * max(abs(input.low), abs(input.high)))
    draft = Draft(
        "dead_zone_inverse", "Input that makes the wanted one act behind the dead zone.", unit
    )
    wanted = draft.argument(
        Argument("wanted", unit, f"{input.name} behind the dead zone",
                 min(input.low - low, 0.0), max(input.high - high, 0.0), recorded=False)
    )  # fmt: skip
    steep = draft.argument(
        Argument("steepness", f"1/({unit})", "one over the half-width of the band about zero in "
                 "which the jump from edge to edge is a straight line",
                 0.0, 1000.0 / largest, recorded=False)
    )  # fmt: skip
    rise = minimum(maximum(wanted, 0.0) * steep, 1.0) * constant("dead_zone_positive", high)
    fall = minimum(maximum(-wanted, 0.0) * steep, 1.0) * constant("dead_zone_negative", low)
    return draft.returns(wanted + rise + fall)
