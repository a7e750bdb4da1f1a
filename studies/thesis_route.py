"""The thesis' discrete route to mass and damping, beside the exact continuous-time fit.

    python studies/thesis_route.py

The thesis [1]_ fits ``X(z)/F(z) = b / ((z - q) (1 - a / z))`` to a held force: an output-error
model with one numerator coefficient and two free poles, of which ``q`` comes out near one and is
dropped, brought to continuous time by the bilinear transform: ``a = (2 - p T)/(2 + p T)``,
``p = c/m``, ``b = (1 - a) T / c``. With one numerator coefficient at a delay of one sample the
errors of the held force (``-c T / 2`` in the mass) and of the bilinear transform cancel; every
further coefficient brings that shift back.

References
----------
.. [1] D. B. Comber (thesis, 2013), "Fluid power actuation for MRI-guided interventions",
   equations 8 to 10.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import fluidact_fit as ff
from fluidact_fit.demo import load_dataset
from fluidact_fit.estimation.inputs import PiecewiseInput, apply_dead_zone
from fluidact_fit.estimation.named_model import NamedModel, make_unknowns
from fluidact_fit.estimation.parametric import Fitted, fit_named
from fluidact_fit.estimation.problem import Basis, Unknown
from fluidact_fit.estimation.recursion import scan
from fluidact_fit.experiment import Array, Experiment
from fluidact_fit.families import get_family
from fluidact_fit.family import FamilyOptions, Request

NAMES = ("mass", "damping", "dead_zone_negative", "dead_zone_positive")


def _position(phi: Array, push: Array, start: Array) -> Array:
    """First state of the recursion ``x[k+1] = phi x[k] + push[k]``."""
    states = scan(phi, push.__getitem__, start, len(push))
    return np.concatenate([x[:, 0] for _, x in states])


class DiscreteRoute:
    """The thesis' discrete model, written in mass and damping."""

    def __init__(self, experiments: Sequence[Experiment]) -> None:
        self.experiments = experiments

    def columns(self, index: int, values: Mapping[str, Any]) -> Basis:
        """Position of the discrete model, and the columns of initial speed and offset."""
        e = self.experiments[index]
        step = e.sample_time
        rate = values["damping"] / values["mass"] * step
        a = (2.0 - rate) / (2.0 + rate)
        b = (1.0 - a) * step / values["damping"]
        held = PiecewiseInput(e.time, e["force"][:, None])
        w = apply_dead_zone(held, values["dead_zone_negative"], values["dead_zone_positive"])
        push = b * w.coefficients[:-1, :1] * np.ones(2)
        phi = np.array([[values["integrator_pole"], a], [0.0 * a, a]])
        y = _position(phi, push, np.zeros(2, push.dtype))
        speed = _position(phi, np.zeros(push.shape), np.array([0.0, 1.0]))
        return Basis(y, local=[speed, np.ones(y.size)])

    def fit(self, start: Mapping[str, float]) -> Fitted:
        """Fit mass, damping, both edges and the pole from a start."""
        variant = get_family("hydrostatic").variants[0]
        request = Request(FamilyOptions())
        unknowns = make_unknowns(variant.parameters, NAMES, dict(start), request)
        unknowns["integrator_pole"] = Unknown("integrator_pole", 0.5, 1.5, 1e-2)
        model = NamedModel(
            (*NAMES, "integrator_pole"), (), self.columns, [e["position"] for e in self.experiments]
        )
        begin = {**start, "integrator_pole": 1.0}
        return fit_named(model, variant.parameters, request, unknowns, [begin])


def main() -> None:
    """Print both estimates of the dataset's logs."""
    say = sys.stdout.write
    data = load_dataset("hydrostatic")
    exact = ff.fit("hydrostatic", data.read(), **data.options)
    start = {n: exact.parameters[n].number for n in NAMES}
    route = DiscreteRoute(exact.experiments).fit(start)
    say("parameter            truth      exact      discrete route\n")
    for n in NAMES:
        q = exact.parameters[n]
        say(
            f"{n:20s} {data.truth[n]['value']:9.4g}  {q.number:9.5g} ± {q.std_error:.2g}  "
            f"{route.values[n]:9.5g} ± {route.std_error(n):.2g}\n"
        )
    shift = -0.5 * exact.parameters["damping"].number * exact.experiments[0].sample_time
    say(f"pole taken for one: {route.values['integrator_pole']:.6f}\n")
    say(f"a held force alone would move the mass by {shift:+.3g} kg\n")


if __name__ == "__main__":
    main()
