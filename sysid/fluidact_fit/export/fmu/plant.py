"""The continuous model of a block that moves by itself, followed exactly over every step."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from ...block import Block, DryDriveBlock, FlowBlock, LinearBlock, LinearModel, Port
from ...control.machines import hydraulic_cylinder
from ...errors import UsageError
from ...mechanics.friction_law import FrictionLaw
from ...mechanics.hydraulic_cylinder import HydraulicMachine
from ...routines import Argument
from ..c.language import DOUBLE
from ..c.writer import Writer
from .model import Model, Result, Setting, number, table

_CHANGES = 16384  # of the input that can be on their way through a dead time


def add_plant(model: Model, block: Block, name: str) -> None:
    """Add the plant of a block that is one; others are left to their routines.

    ``name`` begins those of all functions.

    Sampling the routine of the controller would be simpler, and would put a delay of up to a
    sample time into a loop that the block is not part of. The continuous model needs no sample
    time: where the steps are one sample long, it gives the same numbers.
    """
    if isinstance(block, LinearBlock):
        _add_linear(model, block, name)
    elif isinstance(block, DryDriveBlock):
        _add_drive(model, block)
    elif isinstance(block, FlowBlock):
        _add_cylinder(model, block, name)


def _driven(model: Model, block: Block) -> tuple[Argument, str]:
    """Take the input; returns it with its C."""
    assert block.input is not None
    argument = block.argument(block.input.role, "input, held over a communication step")
    return argument, model.take(argument, "plant")[1]


def _flag(argument: Argument) -> Result:
    about = f"whether {argument.name} is beyond its range; it is then taken at the end of it"
    return Result("outside", None, about, (argument.name,))


def _add_linear(model: Model, block: LinearBlock, name: str) -> None:
    law, out = block.linear_model(), block.output
    argument, drive = _driven(model, block)
    place, flag = model.output(Result(out.role, out.unit, "output of the model"), _flag(argument))
    rest = out if law.gain is None else Port(argument.name, argument.unit)
    about = f"{rest.role} at rest before the start"
    usual = 0.0 if law.gain is None else law.rest
    start = model.parameter(Setting(f"initial_{rest.role}", rest.unit, about, usual))
    model.constants += [
        f"#define LINEAR_ORDER {law.b.size}",
        table("linear_a", law.a.tolist()),
        table("linear_b", law.b.tolist()),
        table("linear_c", law.c.tolist()),
        table("linear_range", (argument.low, argument.high)),
    ]
    if law.dead_time > 0.0:
        model.constants += [
            f"#define LINEAR_QUEUE {_CHANGES}",
            f"static const double linear_dead_time = {number(law.dead_time)};",
        ]
    model.headers.append("linear.h")
    model.memory.append("linear_memory plant;")
    at_rest = number(law.rest) if law.gain is None else start
    acting, level = _before_linear(model, law, name, drive, at_rest)
    if law.gain is None:
        model.begin.append(f"linear_begin(&memory->plant, {level}, {start});")
    else:
        output = f"{number(law.gain)} * level + {number(block.offset)}"
        model.begin.append(
            f"{{ const double level = {level}; linear_begin(&memory->plant, level, {output}); }}"
        )
    model.evaluate += [
        f"(void)linear_clamped({drive}, &{flag});",
        f"{place} = linear_output(&memory->plant);",
    ]
    model.advance += [
        f"problem = linear_advance(&memory->plant, {acting}, time, span);",
        "if (problem) return problem;",
    ]


def _before_linear(
    model: Model, law: LinearModel, name: str, drive: str, rest: str
) -> tuple[str, str]:
    """C code in front of the linear model: input transformation, and its value at rest."""
    if law.curve is None:
        model.constants += [
            "#define LINEAR_EDGES",
            table("linear_edges", law.dead_zone or (0.0, 0.0)),
        ]
        return f"linear_behind(linear_clamped({drive}, NULL))", f"linear_behind({rest})"
    writer = Writer(law.curve, name, DOUBLE)
    model.called.append(law.curve)
    model.memory.append(f"{writer.name}_state before;")
    model.begin.append(f"{writer.name}_reset(&memory->before);")
    call = f"{writer.name}(&memory->before, {{}}, NULL)"
    return call.format(f"linear_clamped({drive}, NULL)"), call.format(rest)


def _add_drive(model: Model, block: DryDriveBlock) -> None:
    out = block.output
    argument, drive = _driven(model, block)
    place, flag = model.output(Result(out.role, out.unit, "position"), _flag(argument))
    rate = Port(f"{out.role}_rate", f"{out.unit}/s")
    model.outputs.append(Result(rate.role, rate.unit, "velocity"))
    law = [model.parameter(s) for s in _drive_settings(block, argument)]
    starts = [model.parameter(Setting(f"initial_{p.role}", p.unit, "at the start", 0.0))
              for p in (out, rate)]  # fmt: skip
    model.constants.append(table("drive_range", (argument.low, argument.high)))
    model.headers.append("drive.h")
    model.memory += ["drive_memory plant;", "drive_law law;"]
    fields = ("inertia", *(f"{what}[{way}]" for what in ("viscous", "coulomb", "breakaway")
                           for way in (0, 1)))  # fmt: skip
    model.begin += [f"memory->law.{name} = {value};" for name, value in zip(fields, law)]
    model.begin += [
        f"memory->plant.position = {starts[0]};",
        f"memory->plant.velocity = {starts[1]};",
    ]
    model.evaluate += [
        f"(void)drive_clamped({drive}, &{flag});",
        f"{place} = memory->plant.position;",
        f"{model.place(1)} = memory->plant.velocity;",
    ]
    model.advance.append(f"drive_advance(&memory->plant, &memory->law, {drive}, span);")


def _drive_settings(block: DryDriveBlock, argument: Argument) -> list[Setting]:
    """Parameters of the law, in the order of the fields of ``drive_law``."""
    law = block.dry_drive()
    least = sys.float_info.min
    name, unit = law.quantity
    settings = [Setting(f"plant.{name}", unit, f"{name} that is moved", law.inertia, least)]
    per_speed = f"{argument.unit} s/{block.output.unit}"
    for word, unit, pair in (
        ("viscous", per_speed, law.viscous),
        ("coulomb", argument.unit, law.coulomb),
        ("breakaway", argument.unit, law.breakaway),
    ):
        for way, value in zip(("negative", "positive"), pair):
            settings.append(Setting(f"plant.{word}_{way}", unit, f"{word} friction", value, 0.0))
    return settings


def _add_cylinder(model: Model, block: FlowBlock, name: str) -> None:
    """The cylinder between its valve and its load; of a file without volumes only the maps."""
    try:
        (machine, values), flows = hydraulic_cylinder(block), block.plant_flows()
    except UsageError:
        return
    argument, drive = _driven(model, block)
    place, flag = model.output(Result("position", "m", "of the piston"), _flag(argument))
    measured = (Port("position_rate", "m/s"), Port("plant.pressure_1", "Pa"),
                Port("plant.pressure_2", "Pa"))  # fmt: skip
    for port, about in zip(measured, ("velocity", "of chamber 1", "of chamber 2")):
        model.outputs.append(Result(port.role, port.unit, about))
    start = model.parameter(Setting("initial_position", "m", "at rest before the start", 0.0))
    model.constants += [table("hydraulic_range", (argument.low, argument.high))]
    model.constants += _cylinder_constants(machine, values)
    for number_of, flow in enumerate(flows, 1):
        writer = Writer(flow, name, DOUBLE)
        model.constants += [
            f"{writer.signature};",
            f"#define HYDRAULIC_FLOW_{number_of}(u, p) {writer.name}(u, p, NULL)",
        ]
    model.called += flows
    model.headers.append("hydraulic.h")
    model.memory.append("hydraulic_memory plant;")
    model.begin.append(f"hydraulic_begin(&memory->plant, {start});")
    model.evaluate += [
        f"(void)hydraulic_clamped({drive}, &{flag});",
        f"{place} = memory->plant.x[HYDRAULIC_Y];",
        f"{model.place(1)} = memory->plant.x[HYDRAULIC_V];",
        f"{model.place(2)} = memory->plant.x[HYDRAULIC_P1];",
        f"{model.place(3)} = memory->plant.x[HYDRAULIC_P2];",
    ]
    model.advance += [
        f"problem = hydraulic_advance(&memory->plant, {drive}, span);",
        "if (problem) return problem;",
    ]


def _cylinder_constants(m: HydraulicMachine, values: Mapping[str, float]) -> list[str]:
    law, places = FrictionLaw.of(values), (1, 2)
    pairs = {
        "area": [m.area(i) for i in places], "volume": [m.dead_volume(i) or 0.0 for i in places],
        "rest": m.at_rest(0.0).tolist()[:2],
        "viscous": (law.viscous_negative, law.viscous_positive),
        "coulomb": (law.coulomb_negative, law.coulomb_positive),
        "breakaway": (law.breakaway_negative, law.breakaway_positive),
        "rise": (law.rise(-1.0), law.rise(1.0)),
    }  # fmt: skip
    single = {
        "mass": m.mass or 0.0, "bulk_modulus": values["bulk_modulus"], "rate": m.step_rate(values),
        # where nothing rises, any speed says so
        "rise_speed": law.stribeck_speed if law.curved else 1.0,
    }  # fmt: skip
    return [
        *(table(f"hydraulic_{name}", pair) for name, pair in pairs.items()),
        *(f"static const double hydraulic_{n} = {number(value)};" for n, value in single.items()),
    ]
