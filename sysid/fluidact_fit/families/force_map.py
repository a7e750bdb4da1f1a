"""Force maps of a cylinder with hysteresis: small networks of command and force.

    command = f_u(force, position, motion state)               (equation 5 of [1]_)
    force   = f_F(command, position, velocity, motion state)   (equation 6 of [1]_)

    f(x) = offset + scale (W_2 phi(W_1 (x - x_0) / s_x + b_1) + b_2)

The first network is the feed-forward controller, the second the observer of the force that
needs no load cell. Spring, friction and valve are not modelled one by one: that is the gray
box ``spring-cylinder``. The paper trains 3-5-1 and 4-7-1 ReLU networks.

The motion state is printed as ``s = u_j - u_(j-1)`` (equation 3). Taken literally it is
zero whenever the command rests and grows with the sampling time; the branches of the
hysteresis are told apart by its sign, held while the command rests. A dead band keeps
noise from reversing it. A log's own direction column may be used instead.

Samples of one position are nearly copies of each other, so whole positions or whole logs
are held out for validation, never random rows.

A ``length`` that is the same throughout each log names the specimen. Specimens differ by more
than their lengths: a curve through all of them is no guide to the next, so that between the
recorded lengths the output is held near a straight line (:class:`..estimation.network.Chords`).
How near is judged on the recorded logs alone: by the error on whole lengths held out, and by
the error on the lengths there are.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force
   Control of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis
   Characteristic", Actuators 14, 162, 2025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..branches import fill_start
from ..errors import UsageError
from ..estimation.parametric import check_request
from ..experiment import Experiment, FloatArray, Hold
from ..family import Estimate, Family, Option, ParameterSpec, Request, StaticView, Value, Variant
from .maps.block import ForceMapBlock, branch_curves
from .maps.certificates import certificate_notice, certify
from .maps.data import column_of, data_notices, input_table
from .maps.equation import force_map, network_of
from .maps.options import ROLES, TARGETS, Options, default_inputs, driver, input_layers
from .maps.results import chosen_options, file_parameters, fit_details
from .maps.training import fit_network, spike_notice

__all__ = ["ForceMap", "ForceMapBlock", "force_map"]


def _spec(name: str, rank: int, text: str, optional: bool = False) -> ParameterSpec:
    scaling = name.startswith(("input", "output"))
    minimum = 1e-300 if name.endswith("scale") else -np.inf
    return ParameterSpec(
        name, "1", text, rank=rank, optional=optional, minimum=minimum,  # type: ignore[arg-type]
        remedy="Record command, position and force over their whole ranges.",
        any_unit=scaling,
    )  # fmt: skip


_PARAMETERS = (
    _spec("weights_1", 2, "weights of the first layer: one row per unit, one column per input"),
    _spec("biases_1", 1, "biases of the first layer"),
    _spec("weights_2", 2, "weights of the second layer (the output with one hidden layer)"),
    _spec("biases_2", 1, "biases of the second layer"),
    _spec("weights_3", 2, "weights of the output with two hidden layers", True),
    _spec("biases_3", 1, "bias of the output with two hidden layers", True),
    _spec("input_offset", 1, "taken off each input, in its SI unit"),
    _spec("input_scale", 1, "each input is divided by, in its SI unit"),
    _spec("output_offset", 0, "added to the scaled output, in the SI unit of the target"),
    _spec("output_scale", 0, "the output is multiplied by, in the SI unit of the target"),
    _spec("input_low", 1, "lowest value of each input in the data, in its SI unit", True),
    _spec("input_high", 1, "highest value of each input in the data, in its SI unit", True),
)


def _variant(target: str) -> Variant:
    roles = tuple(replace(r, output=r.name == target) for r in ROLES)
    return Variant(target, roles, _PARAMETERS)


class ForceMap(Family):
    """Small networks for the force of a cylinder with hysteresis, either way round."""

    name = "force-map"
    title = "Force map: small networks of command and force with hysteresis"
    equation = (
        "target = output_offset + output_scale * (weights_2 relu(weights_1 "
        "(inputs - input_offset) / input_scale + biases_1) + biases_2)"
    )
    variants = tuple(_variant(t) for t in TARGETS)
    options = (
        Option("target", "choice", "what the network predicts: the command for a wanted force, "
               "or the force", default="command", choices=TARGETS),
        Option("inputs", "text", "inputs in order, as force,position,direction; compare tries the "
               "four input layers of the paper (default: the paper's best)"),
        Option("hidden", "text", "hidden units, as 5 or 16,16; auto adds units while validation "
               "gains (default: 5 for the command, 7 for the force)"),
        Option("activation", "choice", "of the hidden units", default="relu",
               choices=("relu", "tanh")),
        Option("dead-band", "float", "change of the command that reverses the motion state, in "
               "its SI unit (default: from its noise)", minimum=0.0),
        Option("starts", "int", "searches from different starts", default=16, minimum=1),
    )  # fmt: skip

    def variants_for(self, options: Mapping[str, Any]) -> tuple[Variant, ...]:
        """The variant whose output is the target that the options name."""
        target = options.get("target") or "command"
        return tuple(v for v in self.variants if v.name == target)

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request
    ) -> Estimate:
        """Train the network; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        if request.fixed or request.start or request.bounds:
            raise UsageError(
                "the weights of a network cannot be fixed, started or bounded one by one",
                remedy="Leave out --fix, --start and --bounds; --hidden and --seed choose.",
            )
        options = Options.read(request.options)
        fit, rows = fit_network(experiments, options, request)
        data = fit.data
        certificate = certify(fit.network, fit.scaling, data)
        notices = [
            *data_notices(data),
            *certificate_notice(certificate, data, driver(options), options.target),
            *spike_notice(fit),
        ]
        details = fit_details(fit, rows, options, certificate)
        del details["_rows"]
        measured = np.where(data.used, data.y, np.nan)
        return Estimate(
            file_parameters(fit), {}, (), np.zeros((0, 0)), data.split(fit.predicted),
            data.split(measured), notices, details,
            options=chosen_options(data.names, fit.network, options),
        )  # fmt: skip

    def simulate(
        self,
        variant: Variant,
        parameters: Mapping[str, Value],
        experiment: Experiment,
        options: Mapping[str, Any],
    ) -> FloatArray:
        """Command or force from the inputs; see :meth:`Family.simulate`."""
        chosen = Options.read(options)
        names = chosen.inputs or default_inputs(chosen, [experiment])
        x = input_table(experiment, names, chosen)
        if "direction" in names:
            fill_start(x[:, names.index("direction")])
        return force_map(parameters, x, chosen.activation)

    def model_section(
        self, variant: Variant, parameters: Mapping[str, Value], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The size of the network; weights and scalings are the parameters."""
        net = network_of(parameters)
        return {
            "network": {
                "layers": [net.inputs, *net.hidden, 1],
                "parameters": net.parameters,
                "multiplications": net.multiplications,
            }
        }

    def static_view(
        self,
        variant: Variant,
        estimate: Estimate,
        experiments: Sequence[Experiment],
        options: Mapping[str, Any],
    ) -> StaticView:
        """Output over command or force, with the branches at the outermost positions."""
        chosen = Options.read(options)
        names = chosen.inputs or default_inputs(chosen, experiments)
        source = driver(chosen) if driver(chosen) in names else names[0]
        x = np.vstack([input_table(e, names, chosen) for e in experiments])
        raw = np.concatenate([column_of(e, chosen.target) for e in experiments])
        used = np.isfinite(np.concatenate(list(estimate.measured)))
        values = {n: q.value for n, q in estimate.parameters.items()}
        unit = experiments[0].signals[source].unit if source in experiments[0] else "m/s"
        return StaticView(
            source, unit, chosen.target, experiments[0].signals[chosen.target].unit,
            x[:, names.index(source)], raw, np.concatenate(list(estimate.simulated)), used,
            branch_curves(values, x[used], names, names.index(source), chosen.activation),
        )  # fmt: skip

    def block(self, variant: Variant, document: Mapping[str, Any]) -> ForceMapBlock:
        """The map that a controller calls with its inputs by name."""
        chosen = Options.read(document.get("options") or {})
        values = {n: p["value"] for n, p in document["parameters"].items()}
        names = chosen.inputs or input_layers(chosen.target)[2 if chosen.target == "command" else 3]
        return ForceMapBlock(values, names, chosen.target, chosen.activation)
