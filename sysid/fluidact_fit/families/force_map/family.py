"""Force maps of a cylinder with hysteresis: small networks of command and force.

    command = f_u(force, position, motion state)               (equation 5 of [1]_)
    force   = f_F(command, position, velocity, motion state)   (equation 6 of [1]_)

    f(x) = offset + scale (W_2 phi(W_1 (x - x_0) / s_x + b_1) + b_2)

The first network is the feed-forward controller, the second the observer of the force that
needs no load cell. The paper trains 3-5-1 and 4-7-1 ReLU networks.

The motion state is printed as ``s = u_j - u_(j-1)`` (equation 3), which is zero whenever the
command rests; its sign is held instead, with a dead band against noise. A log's own direction
column may be used. Whole positions or whole logs are held out for validation, never random rows.

A ``length`` that is the same throughout each log names the specimen.

References
----------
.. [1] X. Wu, H. Hua, S. Feng, Y. Zhao, Y. Yang, Z. Liao, "Data-Driven Feedforward Force
   Control of a Single-Acting Pneumatic Cylinder with a Nonlinear Hysteresis
   Characteristic", Actuators 14, 162, 2025.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ...errors import UsageError
from ...estimation.named_model import check_request
from ...estimation.scaled_network import ScaledNetwork, checksums
from ...experiment import Experiment, Hold
from ...family import (
    Family,
    NoiseModel,
    ParameterSpec,
    Plant,
    Request,
    Runs,
    Simulated,
    Solution,
    StaticView,
    Variant,
    make_solution,
)
from .block import ForceMapBlock, branch_curves
from .certificates import Certificate
from .data import data_notices, input_table, predict_runs
from .options import ROLES, TARGETS, ForceMapOptions
from .training import file_parameters, fit_details, fit_network, training_notices


def _spec(name: str, rank: Literal[0, 1, 2], text: str, optional: bool = False) -> ParameterSpec:
    minimum = 1e-30 if name.endswith("scale") else -np.inf
    return ParameterSpec(
        name, "1", text, rank=rank, optional=optional, minimum=minimum,
        remedy="Record command, position and force over their whole ranges.",
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


class ForceMap(Family[ForceMapOptions]):
    """Small networks for the force of a cylinder with hysteresis, either way round."""

    name = "force-map"
    title = "Force map: small networks of command and force with hysteresis"
    equation = (
        "target = output_offset + output_scale * (weights_2 relu(weights_1 "
        "(inputs - input_offset) / input_scale + biases_1) + biases_2)"
    )
    variants = tuple(_variant(t) for t in TARGETS)
    options_type = ForceMapOptions
    block_type = ForceMapBlock

    def variants_for(self, options: ForceMapOptions) -> tuple[Variant, ...]:
        """The variant whose output is the target that the options name."""
        return (self.variant(options.target),)

    def estimate(
        self, variant: Variant, experiments: Sequence[Experiment], request: Request[ForceMapOptions]
    ) -> Solution[ForceMapOptions]:
        """Train the network; see :meth:`Family.estimate`."""
        check_request(variant.parameters, request)
        if request.fixed or request.start or request.bounds:
            raise UsageError(
                "the weights of a network cannot be fixed, started or bounded one by one",
                remedy="Leave out --fix, --start and --bounds; --hidden and --seed choose.",
            )
        fit = fit_network(experiments, request)
        options = fit.options
        found = Certificate.of(fit.map, fit.data, options.driver)
        return make_solution(
            self.simulate,
            experiments,
            variant,
            options,
            file_parameters(fit),
            (),  # no covariance: what the weights of a network are, others may be as well
            NoiseModel(np.zeros((0, 0))),
            notices=[
                *data_notices(fit.data),
                *(found.notices(options.target, fit.data.units) if found else ()),
                *training_notices(fit),
            ],
            details={
                **fit_details(fit),
                "certificate": found.details() if found else {"exact": False},
            },
        )

    def simulate(
        self,
        plant: Plant[ForceMapOptions],
        experiments: Sequence[Experiment],
        offset: float | None = None,
    ) -> list[Simulated]:
        """Command or force from the inputs; see :meth:`Family.simulate`."""
        network = ScaledNetwork.of(plant.values, plant.options.activation)
        return predict_runs(network, experiments, plant.options)

    def model(
        self, plant: Plant[ForceMapOptions], sample_time: float, hold: Hold
    ) -> dict[str, Any]:
        """The size of the network, and checksums of the weights and scalings."""
        options = plant.options
        net = ScaledNetwork.of(plant.values, options.activation).network
        if len(options.names) != net.inputs:
            raise UsageError(
                f"weights_1 is for {net.inputs} inputs, and the options name {options.inputs}"
            )
        return {
            "network": {
                "layers": [net.inputs, *net.hidden, 1],
                "parameters": net.parameters,
                "multiplications": net.multiplications,
                "checksums": checksums(plant.values),
            }
        }

    def static_view(self, plant: Plant[ForceMapOptions], runs: Runs) -> StaticView:
        """Output over command or force, with the branches at the outermost positions."""
        options, names = plant.options, plant.options.names
        source = next(n for n in (options.driver, *names) if n in names and n in runs[0][0])
        view = StaticView.over(runs, source, options.target, ())
        x = np.vstack([input_table(e, names, options) for e, _ in runs])[view.used]
        network = ScaledNetwork.of(plant.values, options.activation)
        return replace(view, curves=branch_curves(network, x, names, source))
